//! The extent of a placed tree in its own space, as the build uses it.

use crate::geometry::LinearBounds;

/// The extent of a placed tree in its own space.
pub(super) struct Extent {
    /// Linear bounds over the shutter.
    pub bounds: LinearBounds,
    /// Bounds of its subtrees: boxes around a rotated tree are tighter if they hold the corners of several small boxes
    /// instead of one.
    pub subtrees: Vec<LinearBounds>,
    /// The greatest distance from the middle of its space.
    pub reach: f64,
    /// By how many ULP of the distance to a ray's origin its hits may lie outside of its box; not 0 for trees of
    /// instances only.
    pub deviation: f64,
}

/// By how many ULP of the size of a tree its hits may lie outside of its box: the rounding of its kernel
/// ([`KERNEL_ULPS`] of the triangle and of an origin within 64 sizes, 1300 in all), and that of its vertices, with a
/// margin.
///
/// [`KERNEL_ULPS`]: crate::geometry::KERNEL_ULPS
pub(super) const INNER_ULPS: f64 = 1400.0;
