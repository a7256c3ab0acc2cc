//! Where what is placed lies in its own space, as the build knows it.

use crate::geometry::LinearBounds;

/// What is placed, in its own space.
pub(super) struct Extent {
    /// Where it is during the shutter.
    pub bounds: LinearBounds,
    /// The same of its parts: the boxes around what is turned are smaller where they need not hold the corners of one box.
    pub parts: Vec<LinearBounds>,
    /// How far from the middle of its space it reaches.
    pub reach: f64,
    /// By how many ULP of the distance to a ray's origin its hits may lie outside of its box, if it is a tree of instances; or 0.
    pub stray: f64,
}

/// ULP of the size of a tree by which its answers may lie outside of its box: its kernel's rounding ([`KERNEL_ULPS`] of
/// what is hit and of an origin within sixteen sizes, 340 in all), and that of its vertices, with some to spare.
///
/// [`KERNEL_ULPS`]: crate::geometry::KERNEL_ULPS
pub(super) const INNER_ULPS: f64 = 400.0;
