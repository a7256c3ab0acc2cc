//! How far neighbours may be.

use super::error::{ListError, RadiusOf};
use crate::simd::Simd;

/// How far neighbours may be.
///
/// The squared distance is compared with the squared radius, both computed in f32 (distances of points kept in f64 are rounded to
/// it). Lists over an interval compare both in f64, with sums of radii that are rounded to f32 likewise. Radii of listed points are
/// by id, those of queries ([`PointTree::within_lists`](crate::PointTree::within_lists)) by index.
///
/// ```
/// use mbkd::{NeighborLists, PointParams, PointTree, Radii};
/// let centers = [[0.0f32, 0.0, 0.0], [1.5, 0.0, 0.0], [4.0, 0.0, 0.0]];
/// let radii = [1.0, 0.5, 1.9];
/// let tree = PointTree::build(&centers, &PointParams::default())?;
/// let mut contacts = NeighborLists::new();
/// tree.neighbor_lists(0.0, Radii::Sum { own: &radii, others: &radii }).pairs_once().in_order().run(&mut contacts)?;
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
    /// An error for the first one that is no radius.
    pub(super) fn check(&self) -> Result<(), ListError> {
        let check = |radii: &[f32], of: fn(u32) -> RadiusOf| match radii.iter().position(|&radius| is_bad(radius)) {
            Some(id) => Err(ListError::Radius { of: Some(of(id as u32)) }),
            None => Ok(()),
        };
        if matches!(self, Radii::Equal(radius) if is_bad(*radius)) {
            return Err(ListError::Radius { of: None });
        }
        check(self.own().unwrap_or_default(), RadiusOf::Point)?;
        check(self.others().unwrap_or_default(), RadiusOf::Listed)
    }

    /// An error if these are not of the same kind as others, or one is greater.
    pub(super) fn check_within(&self, longer: &Radii<'_>) -> Result<(), ListError> {
        let within = |radii: &[f32], longer: &[f32]| radii.iter().zip(longer).all(|(radius, longer)| radius <= longer);
        let all_within = match (self, longer) {
            (Radii::Equal(radius), Radii::Equal(longer)) => radius <= longer,
            (Radii::Own(own), Radii::Own(longer)) => within(own, longer),
            (Radii::Larger { own, others }, Radii::Larger { own: longer, others: longer_others })
            | (Radii::Sum { own, others }, Radii::Sum { own: longer, others: longer_others }) => {
                within(own, longer) && within(others, longer_others)
            }
            _ => return Err(ListError::RadiiDiffer),
        };
        if all_within { Ok(()) } else { Err(ListError::Skin) }
    }

    /// The radius of a point whose list is made.
    #[inline(always)]
    pub(super) fn of(&self, id: u32) -> f32 {
        match self {
            Radii::Equal(radius) => *radius,
            Radii::Own(own) | Radii::Larger { own, .. } | Radii::Sum { own, .. } => radius_of(own, id),
        }
    }

    /// The radii of the points whose lists are made, unless all have the same.
    #[inline(always)]
    pub(super) fn own(&self) -> Option<&'a [f32]> {
        match self {
            Radii::Equal(_) => None,
            Radii::Own(own) | Radii::Larger { own, .. } | Radii::Sum { own, .. } => Some(own),
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

    /// How far two points with these ids may be from each other, of one whose list is made and of another.
    pub(super) fn of_ids(&self, own: u32, other: u32) -> f32 {
        self.of_pair(self.of(own), self.others().map_or(0.0, |radii| radius_of(radii, other)))
    }

    /// A radius that no pair's is less than; infinite where there are no radii.
    pub(super) fn least(&self) -> f32 {
        let least = |radii: &[f32]| radii.iter().copied().fold(f32::INFINITY, f32::min);
        match self {
            Radii::Equal(radius) => *radius,
            Radii::Own(own) => least(own),
            Radii::Larger { own, others } | Radii::Sum { own, others } => self.of_pair(least(own), least(others)),
        }
    }

    /// How far two points may be from each other, of one whose list is made and of another.
    #[inline(always)]
    pub(super) fn of_pair(&self, own: f32, other: f32) -> f32 {
        if matches!(self, Radii::Sum { .. }) { own + other } else { own.max(other) }
    }

    /// [`Radii::of_pair`] of one point and sixteen others.
    #[inline(always)]
    pub(super) fn joint<S: Simd>(&self, s: S, own: S::F, others: S::F) -> S::F {
        if matches!(self, Radii::Sum { .. }) { own + others } else { s.max(own, others) }
    }
}

/// By how much farther than radii boxes are searched: where positions are rounded.
///
/// **Why no neighbour is lost.** Let u = 2^-24. Positions in f64 are rounded relative to a place in the box around a group of
/// points, so by u times their distance from there: at most the size g of that box for a point of the group, and g + r for a
/// neighbour within r of it. Along each axis the computed gap of two boxes, or of a point and a box, exceeds the exact difference
/// of two positions in them by at most (2g + r)u and by u of itself, hence the square root of the sum of the squares by less than
/// 4(g + r)u and 3u of itself. That the squared distance is computed as at most that of the radius means that r is at most 2u of
/// itself above the radius (or 1e-22, where squares underflow). Adding 16u of the radius and of g is enough with the rounding of
/// these sums and of their square.
#[derive(Clone, Copy, Debug)]
pub(super) struct Margin {
    factor: f32,
    sum: f32,
}

impl Default for Margin {
    fn default() -> Margin {
        Margin::NONE
    }
}

impl Margin {
    /// For positions that are not rounded.
    pub(super) const NONE: Margin = Margin { factor: 1.0, sum: 0.0 };

    /// For points of a group that have coordinates up to `size`, relative to the place where they are rounded.
    pub(super) fn of_rounding(size: f32) -> Margin {
        const UNITS: f32 = 8.0 * f32::EPSILON;
        Margin { factor: 1.0 + UNITS, sum: UNITS * size + 1e-21 }
    }

    /// For radii that are longer by this. (The margin for rounding, which is not zero, has room for what is rounded here.)
    pub(super) fn beyond(self, Allowance { factor, sum }: Allowance) -> Margin {
        let own = f64::from(self.factor);
        Margin { factor: (own * factor) as f32, sum: self.sum + (own * sum) as f32 }
    }

    /// The squared distance up to which boxes are near whose points are within a radius.
    #[inline(always)]
    pub(super) fn squared<S: Simd>(self, s: S, radii: S::F) -> S::F {
        squared_radii(s, radii * s.splat(self.factor) + s.splat(self.sum))
    }
}

/// By how much radii are longer than they are given, in f64: for each radius `r` it is `r * factor + sum`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowance {
    pub(super) factor: f64,
    pub(super) sum: f64,
}

impl Default for Allowance {
    /// Not at all: each radius is what it is.
    fn default() -> Allowance {
        Allowance { factor: 1.0, sum: 0.0 }
    }
}

impl Allowance {
    /// A radius with the allowance.
    #[inline(always)]
    pub(super) fn added_to(self, radius: f32) -> f64 {
        f64::from(radius) * self.factor + self.sum
    }

    /// Those of four.
    #[inline(always)]
    pub(super) fn added_to_four<S: Simd>(self, s: S, radii: &[f32; 4]) -> S::D {
        s.widen_four(radii) * s.splat_d(self.factor) + s.splat_d(self.sum)
    }
}

/// Whether this is no radius, and no skin.
pub(super) fn is_bad(radius: f32) -> bool {
    radius.is_nan() || radius < 0.0
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

/// The square of a radius, rounded up to a finite f32. (That counts where squares underflow: three terms of a squared gap may
/// be rounded up by half the least f32 each.)
pub(super) fn squared_up(radius: f64) -> f32 {
    ((radius * radius).min(f32::MAX.into()) as f32).next_up().min(f32::MAX)
}
