//! The criteria of an encounter: how near two points have to come, and which pairs count.

use super::candidate_points::WIDTH;
use super::images::Images;
use crate::point::lists::candidates::Within;
use crate::point::lists::radii::{Allowance, Margin, Radii, radius_of, squared_up};
use crate::simd::{Lanes, Simd};

/// The criteria of an encounter, the same for all points of a group. (Those of a whole sweep have neither a greatest radius nor a
/// first time.)
#[derive(Clone, Copy)]
pub(super) struct Criteria<'a> {
    pub(super) radii: Radii<'a>,
    /// How much farther than their radius pairs may be.
    pub(super) allowance: Allowance,
    /// The greatest radius of one of the points, if pairs have radii of their own.
    pub(super) own: f32,
    /// Whether each pair is reported to the point with the lower id only.
    pub(super) pairs_once: bool,
    /// Whether the others are another set, whose ids have nothing to do with these.
    pub(super) other_set: bool,
    /// The group's first time.
    pub(super) first_time: f32,
    /// Pairs nearer than this at the first time are excluded, if both points exist then.
    pub(super) excluded_within: Option<f64>,
    /// Whether some points do not exist throughout the shutter.
    pub(super) has_active_intervals: bool,
    pub(super) images: Images,
}

impl Criteria<'_> {
    /// How near boxes have to be to a point with this radius, or to several with such.
    #[inline(always)]
    pub(super) fn within(&self, own: f32) -> Within<'_> {
        match self.radii {
            Radii::Equal(radius) => Within::Squared(squared_up(self.allowance.added_to(radius))),
            _ => Within::Radius(&self.radii, own, Margin::of_rounding(0.0).beyond(self.allowance)),
        }
    }

    /// How far two points may be from each other that have at most these radii, where pairs have radii of their own.
    #[inline(always)]
    pub(super) fn longest(&self, own: f32, other: f32) -> f64 {
        let radius = if let Radii::Equal(radius) = self.radii { radius } else { self.radii.of_pair(own, other) };
        self.allowance.added_to(radius)
    }

    /// The greatest radius of points with these ids, unless all have the same.
    #[inline(always)]
    pub(super) fn greatest(&self, ids: &Lanes<u32>) -> f32 {
        let Some(own) = self.radii.own() else { return 0.0 };
        let mut most = 0.0;
        for &id in ids {
            most = f32::max(most, radius_of(own, id));
        }
        most
    }

    /// The squared distance within which a point meets any other whose radius does not count.
    #[inline(always)]
    pub(super) fn square(&self, own: u32) -> f64 {
        let radius = self.allowance.added_to(self.radii.of(own));
        radius * radius
    }

    /// The squared distances within which a point meets four others, whose radii are among `others`.
    #[inline(always)]
    pub(super) fn squares<S: Simd>(&self, s: S, own: u32, others: &[f32], [a, b, c, d]: [u32; WIDTH]) -> S::D {
        let own = self.radii.of(own);
        let [a, b, c, d] = [radius_of(others, a), radius_of(others, b), radius_of(others, c), radius_of(others, d)];
        let radii = self.radii;
        let radii = [radii.of_pair(own, a), radii.of_pair(own, b), radii.of_pair(own, c), radii.of_pair(own, d)];
        let radii = self.allowance.added_to_four(s, &radii);
        radii * radii
    }
}
