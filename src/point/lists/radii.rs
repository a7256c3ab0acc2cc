//! How far neighbours may be.

/// How far neighbours may be.
///
/// The squared distance is compared with the squared radius, both computed in f32.
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
}

impl From<f32> for Radii<'_> {
    fn from(radius: f32) -> Self {
        Radii::Equal(radius)
    }
}

impl Radii<'_> {
    /// The squared distance up to which neighbours of a point count, as far as that is its own matter.
    #[inline(always)]
    pub(super) fn bound(&self, id: u32) -> f32 {
        match self {
            Radii::Equal(radius) => squared_radius(*radius),
            Radii::Own(own) | Radii::Larger { own, .. } => bound_of(own, id),
        }
    }
}

/// The squared radius of a point; 0 for lanes without one.
#[inline(always)]
pub(super) fn bound_of(radii: &[f32], id: u32) -> f32 {
    radii.get(id as usize).map_or(0.0, |&radius| squared_radius(radius))
}

/// The squared distance up to which points count as within a radius.
#[inline(always)]
pub(super) fn squared_radius(radius: f32) -> f32 {
    (radius * radius).min(f32::MAX)
}
