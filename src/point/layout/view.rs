//! The interface between searches and trees: boxes and points as they are at the query's time.
//!
//! The picture to have in mind: a pyramid of 16-wide nodes, all leaves on the same level. A search
//! gets from a node the squared distances to its sixteen child boxes, and from a block those to its
//! sixteen points; motion and active intervals are handled inside.
//!
//! **Why no search ever loses a neighbour.** The squared distance of a point is computed as
//! `(dx·dx + dy·dy) + dz·dz` with `d = p − q`, each step rounded once, and that of a box in the same
//! order with `d = max(lo − q, q − hi, 0)`. Rounding to nearest is monotone: `a ≤ b` gives
//! `fl(a) ≤ fl(b)`. As `lo ≤ p ≤ hi` in floats, every `d` of the box is at most the |d| of the point,
//! so is every square and every sum. The computed distance of a box is never above that of a point
//! in it, and culling what is *strictly* farther than the bound keeps ties too.

use super::shape::Shape;
use crate::simd::{LANES, Lanes, Mask, Simd};
use glam::Vec3;

/// Coordinates of the query point in all lanes, and the query's time in the forms that trees need.
#[derive(Clone, Copy)]
pub(in crate::point) struct Target<S: Simd> {
    pub(in crate::point) point: [S::F; 3],
    /// Signed step from the nearer key of a moving tree, in [-1/2, 1/2].
    pub(in crate::point) step: S::F,
    /// Position between the keys, in [0, 1].
    pub(in crate::point) phase: S::F,
    /// The query's time, for intervals.
    pub(in crate::point) time: S::F,
}

impl<S: Simd> Target<S> {
    /// A target for static trees.
    #[inline(always)]
    pub(in crate::point) fn static_point(s: S, q: Vec3) -> Target<S> {
        let zero = s.splat(0.0);
        Target { point: [s.splat(q.x), s.splat(q.y), s.splat(q.z)], step: zero, phase: zero, time: zero }
    }
}

/// The leaves of a tree at a time: blocks of sixteen points, numbered over the whole tree.
pub(in crate::point) trait LeafView: Copy {
    /// Blocks per leaf.
    fn leaf_blocks(&self) -> usize;
    /// The query in all lanes.
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S>;
    /// Squared distances to the points; infinite if there is no point at this time.
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F;
    /// Prefetches a leaf that will probably be visited soon.
    fn prefetch_leaf(&self, block: usize);
    /// Bytes of all leaves: tells in which cache most of them are, and so whether prefetching pays.
    fn leaf_bytes(&self) -> usize;
    /// Ids of a block's points.
    fn ids(&self, block: usize) -> &Lanes<u32>;
}

/// A tree of boxes at a time.
///
/// Nodes are numbered over the whole tree. Level 0 holds the bottom nodes, whose lanes
/// are leaves; a leaf is [`LeafView::leaf_blocks`] consecutive blocks of sixteen points.
pub(in crate::point) trait View: LeafView {
    /// Squared radius of a ball that holds as many points as a leaf does, in squared diagonals of the leaf's box: an
    /// estimate. It is about a fifth in space and on surfaces alike; boxes that hold moving points the whole time
    /// are larger than their contents, and leaves in which few points are active at a time hold less.
    const BALL: f32;
    /// How many nodes its levels have.
    fn shape(&self) -> &Shape;
    /// Level and number of the root node.
    #[inline(always)]
    fn root(&self) -> (usize, usize) {
        self.shape().root()
    }
    /// The child of lane 0 of a node above level 0; lane i has the i-th node after it.
    #[inline(always)]
    fn first_child(&self, level: usize, node: usize) -> usize {
        self.shape().first_child(level, node)
    }
    /// The first block of lane 0 of a bottom node; lane i begins `i * leaf_blocks` later.
    #[inline(always)]
    fn first_block(&self, node: usize) -> usize {
        node * LANES * self.leaf_blocks()
    }
    /// Squared distances to the child boxes, infinite if there is no child at this time; and which of them hold the
    /// point, which is known much earlier.
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask);
    /// Squared diagonals of the child boxes.
    fn box_sizes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F;
    /// Prefetches a node that will probably be visited soon.
    fn prefetch_node(&self, node: usize);
}

/// A tree at a time, with positions relative to one place for all of it: what neighbour lists need. Positions in f64 are rounded to
/// f32 relative to the view's query point.
pub(in crate::point) trait CoordinateView: View {
    /// Lower and upper faces of the child boxes, which hold the exact positions. Where there is no child at this time, the lower
    /// one along the first axis is above the upper, or not a number.
    fn faces<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> ([S::F; 3], [S::F; 3]);
    /// Positions of the points; the first coordinate is at least [`f32::MAX`] if there is no point at this time.
    fn positions<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> [S::F; 3];
    /// The positions in f64, where the others are rounded; the first coordinate is infinite if there is no point at this time.
    #[inline(always)]
    fn double_positions<S: Simd>(&self, _s: S, _block: usize) -> Option<DoubleRows> {
        None
    }
    /// Lanes with a child at this time.
    #[inline(always)]
    fn present<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> Mask {
        let (lo, hi) = self.faces(s, target, node);
        s.le(lo[0], hi[0])
    }
}

/// Coordinates of sixteen points in f64, in rows.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(in crate::point) struct DoubleRows(pub(in crate::point) [Lanes<f64>; 3]);

/// The squared length of `(x, y, z)`, in the one order of operations that all answers share.
#[inline(always)]
pub(in crate::point) fn squared<S: Simd>(x: S::F, y: S::F, z: S::F) -> S::F {
    (x * x + y * y) + z * z
}

/// Squared distance of boxes from a point, and which of them hold it.
#[inline(always)]
pub(in crate::point) fn outside<S: Simd>(s: S, point: &[S::F; 3], lo: [S::F; 3], hi: [S::F; 3]) -> (S::F, Mask) {
    let x = gap(s, point[0], lo[0], hi[0]);
    let y = gap(s, point[1], lo[1], hi[1]);
    let z = gap(s, point[2], lo[2], hi[2]);
    let widest = s.max_signed(s.max_signed(x, y), z);
    (squared::<S>(x, y, z), s.le_signed(widest, s.splat(0.0)))
}

/// The magnitude of each lane.
#[inline(always)]
pub(in crate::point) fn magnitude<S: Simd>(s: S, x: S::F) -> S::F {
    s.max(x, s.splat(0.0) - x)
}

/// Squared diagonals of boxes.
#[inline(always)]
pub(in crate::point) fn diagonal<S: Simd>(lo: [S::F; 3], hi: [S::F; 3]) -> S::F {
    squared::<S>(hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2])
}

/// How far a coordinate is outside intervals. (Not a closure, here and in the trees: a closure cannot be marked
/// `inline(always)`, and if it is not inlined, each of its operations becomes a call.)
#[inline(always)]
fn gap<S: Simd>(s: S, at: S::F, lo: S::F, hi: S::F) -> S::F {
    s.max_with_zero(lo - at, at - hi)
}

/// Three rows.
#[inline(always)]
pub(in crate::point) fn rows<S: Simd>(s: S, rows: &[Lanes<f32>; 3]) -> [S::F; 3] {
    [s.load(&rows[0]), s.load(&rows[1]), s.load(&rows[2])]
}
