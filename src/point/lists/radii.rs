//! How far neighbours may be.

use crate::simd::Simd;

/// How far neighbours may be.
///
/// The squared distance is compared with the squared radius, both computed in f32.
///
/// ```
/// use mbkd::{NeighborCsr, PointParams, PointTree, Radii};
/// let centers = [[0.0f32, 0.0, 0.0], [1.5, 0.0, 0.0], [4.0, 0.0, 0.0]];
/// let radii = [1.0, 0.5, 1.9];
/// let tree = PointTree::build(&centers, &PointParams::default())?;
/// let mut contacts = NeighborCsr::new();
/// tree.neighbor_lists(0.0, Radii::Sum { own: &radii, others: &radii }).pairs_once().rows_by_id().run(&mut contacts)?;
/// assert_eq!(contacts.ids(), [1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radii<'a> {
    /// The same for all points.
    Equal(f32),
    /// Each point lists what is within its own radius; its neighbour may not list it. One radius for each id.
    Own(&'a [f32]),
    /// Two points are neighbours where either is within the radius of the other: within the larger of the two.
    Larger {
        /// Radii by id of the points that lists are made for.
        own: &'a [f32],
        /// Radii by id of the points that are listed: the same again if a set is searched for its own neighbours.
        others: &'a [f32],
    },
    /// Two points are neighbours within the sum of their radii: spheres that touch or overlap. The sum is rounded to f32.
    Sum {
        /// As for [`Radii::Larger`].
        own: &'a [f32],
        /// Likewise.
        others: &'a [f32],
    },
}

impl From<f32> for Radii<'_> {
    fn from(radius: f32) -> Self {
        Radii::Equal(radius)
    }
}

impl<'a> Radii<'a> {
    /// The radius of a point whose list is made.
    #[inline(always)]
    pub(super) fn of(&self, id: u32) -> f32 {
        match self {
            Radii::Equal(radius) => *radius,
            Radii::Own(own) | Radii::Larger { own, .. } | Radii::Sum { own, .. } => radius_of(own, id),
        }
    }

    /// The radii of the points that are listed, where these count.
    #[inline(always)]
    pub(super) fn others(&self) -> Option<&'a [f32]> {
        match self {
            Radii::Equal(_) | Radii::Own(_) => None,
            Radii::Larger { others, .. } | Radii::Sum { others, .. } => Some(others),
        }
    }

    /// How far two points may be from each other, of one whose list is made and of others.
    #[inline(always)]
    pub(super) fn joint<S: Simd>(&self, s: S, own: S::F, others: S::F) -> S::F {
        if matches!(self, Radii::Sum { .. }) { own + others } else { s.max(own, others) }
    }
}

/// The radius of a point; 0 for lanes without one.
#[inline(always)]
pub(super) fn radius_of(radii: &[f32], id: u32) -> f32 {
    radii.get(id as usize).copied().unwrap_or(0.0)
}

/// [`squared_radius`] of several.
#[inline(always)]
pub(super) fn squared_radii<S: Simd>(s: S, radii: S::F) -> S::F {
    s.min(radii * radii, s.splat(f32::MAX))
}

/// The squared distance up to which points count as within a radius.
#[inline(always)]
pub(super) fn squared_radius(radius: f32) -> f32 {
    (radius * radius).min(f32::MAX)
}
