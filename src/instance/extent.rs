//! The extent of a placed tree in its own space, as the build uses it.

use crate::geometry::LinearBounds;
use crate::ray::Outline;

/// The extent of a placed tree in its own space.
#[derive(Clone)]
pub(super) struct Extent {
    /// Bounds of its subtrees: boxes around a rotated tree are tighter if they hold the corners of several small boxes
    /// instead of one.
    pub subtrees: Vec<LinearBounds>,
    /// Which rays miss it.
    pub outline: Outline,
    /// The greatest distance from the middle of its space.
    pub reach: f64,
    /// By how many ULP of the distance to a ray's origin its hits may lie outside of its box; not 0 for trees of
    /// instances only.
    pub deviation: f64,
}
