//! The tree over f64 points for a time slice, and its view at a time.
//!
//! The picture to have in mind: the same pyramid of sixteen-wide nodes, but each node has a centre of its own in f64, and
//! boxes in f32 relative to it; so boxes are as fine as their contents, wherever these are. Leaves hold f64 positions. The
//! distance of a point is computed in f64 and rounded to f32 once; order, ties and radii use that number.
//!
//! **Why no search ever loses a neighbour.** Let `q` be the query and `m` the centre of a node at the query's time, both in f64.
//! The boxes of the node are relative to `m`, and so is the query: `p = q − m`, rounded to f32, is off by u = 2^-24 of itself. With
//! `h` an exact face of the contents of a box, the query on its outer side at a distance `g`, |p| is at most |h| + g. Faces as
//! computed are farther out than `h` by more than u|h| and by 1e-22 (`super::double_box` has the sum), so the gap is at most g (1 +
//! u) before it is rounded; and if the query is not on the outer side, there is no gap. Rounding the gap, squaring it, and adding
//! squares makes at most seven roundings of u in the square of the distance, with those of p. It is multiplied by 1 − 2^-20 (16 u):
//! then it is below the exact squared distance of any point in the box by more than f64 rounds that (if squares underflow, the
//! 1e-22 compensate for it). And rounding to f32 is monotone. So the distance of the box is never above that of a point in it.

use super::double_box::DoubleNode;
use crate::file::{Encoder, FileError};
use crate::point::layout::boxes::Boxes;
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::layout::shape::Shape;
use crate::point::layout::slice_tree::{SliceTree, TreeSize};
use crate::point::layout::view::{
    CoordinateView, DoubleRows, LeafView, Target, View, diagonal, magnitude, outside, rows,
};
use crate::point::leaf_order::segment_slice::{SegmentSlice, exact_phase};
use crate::simd::{LANES, Lanes, Mask, Simd, prefetch};
use glam::{DVec3, Vec3};

/// Positions of sixteen points at the earlier key of the segment, in rows.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(in crate::point) struct DoubleBlock {
    pub(in crate::point) begin: DoubleRows,
    pub(in crate::point) id: Lanes<u32>,
}

/// Coordinates of no point.
pub(in crate::point) const NO_POINTS: DoubleRows = DoubleRows([[ABSENT; LANES]; 3]);

impl DoubleBlock {
    /// No point.
    pub(in crate::point) const EMPTY: DoubleBlock = DoubleBlock { begin: NO_POINTS, id: [u32::MAX; LANES] };

    /// Sets the position at the earlier key, and the id, of one lane.
    #[inline(always)]
    pub(in crate::point) fn set(&mut self, lane: usize, at: DVec3, id: u32) {
        for (row, x) in self.begin.0.iter_mut().zip(at.to_array()) {
            row[lane] = x;
        }
        self.id[lane] = id;
    }
}

/// The coordinates of absent points: every squared distance to them is infinite in f32.
pub(in crate::point) const ABSENT: f64 = 1e150;

/// The factor on squared distances of boxes.
const SHRINK: f32 = 1.0 - 1.0 / 1_048_576.0;

/// Points given in f64, in a complete 16-ary tree for one time slice.
#[derive(Clone)]
pub(in crate::point) struct DoubleTree {
    pub(in crate::point) slice: SegmentSlice,
    pub(in crate::point) shape: Shape,
    pub(in crate::point) nodes: Vec<DoubleNode>,
    /// Displacements of the faces until the end of the slice; empty if all points are static.
    pub(in crate::point) slopes: Vec<Boxes>,
    pub(in crate::point) blocks: Vec<DoubleBlock>,
    /// Positions at the later key; empty if all points are static.
    pub(in crate::point) ends: Vec<DoubleRows>,
    /// Active intervals of nodes and points; empty if all are active throughout.
    pub(in crate::point) node_times: Vec<LaneIntervals>,
    pub(in crate::point) block_times: Vec<LaneIntervals>,
    /// Whole intervals of the points; empty if all exist throughout the shutter.
    pub(in crate::point) active: Vec<LaneIntervals>,
    pub(in crate::point) references: usize,
}

/// The position at a phase between two keys, from the nearer one.
#[inline(always)]
pub(in crate::point) fn between([a, b]: [DVec3; 2], phase: f64) -> DVec3 {
    let (s, from_end) = nearer(phase);
    (if from_end { b } else { a }) + (b - a) * s
}

/// The step from the nearer key, and whether that is the later one.
#[inline(always)]
fn nearer(phase: f64) -> (f64, bool) {
    if phase < 0.5 { (phase, false) } else { (phase - 1.0, true) }
}

impl DoubleTree {
    /// The shape of a tree over `count` points.
    pub(in crate::point) fn shape(count: usize, moves: bool) -> Shape {
        if moves { Shape::with_leaf(count, 1) } else { Shape::flattest(count) }
    }

    /// Whether its points may move or exist for a while only.
    pub(in crate::point) fn moves(&self) -> bool {
        !self.slopes.is_empty()
    }

    /// The centre of a node at a time.
    pub(in crate::point) fn center(&self, node: usize, time: f32) -> DVec3 {
        DVec3::from_array(self.nodes[node].middle_at(self.within(self.phase_at(time))))
    }

    /// The phase of a time between the keys; exact.
    #[inline(always)]
    pub(in crate::point) fn phase_at(&self, time: f32) -> f64 {
        let SegmentSlice { keys, segment, phases: [begin, end], .. } = self.slice;
        exact_phase(time, keys, segment).max(begin).min(end)
    }

    /// The fraction of the slice at a phase between the keys, in [0, 1].
    #[inline(always)]
    fn within(&self, phase: f64) -> f64 {
        self.fraction(phase).clamp(0.0, 1.0)
    }

    /// The same, outside of [0, 1] where the phase is outside of the slice.
    #[inline(always)]
    pub(in crate::point) fn fraction(&self, phase: f64) -> f64 {
        let [begin, end] = self.slice.phases;
        if end > begin { (phase - begin) / (end - begin) } else { 0.0 }
    }

    /// The tree at a time of its slice, seen from a query point.
    #[inline(always)]
    pub(in crate::point) fn at<const MOVING: bool>(&self, query: DVec3, time: f32) -> DoubleView<'_, MOVING> {
        let phase = if MOVING { self.phase_at(time) } else { 0.0 };
        let (step, from_end) = nearer(phase);
        let within = if MOVING { self.within(phase) } else { 0.0 };
        DoubleView { tree: self, query: query.to_array(), time, within, step, from_end }
    }
}

impl SliceTree for DoubleTree {
    #[inline(always)]
    fn slice(&self) -> SegmentSlice {
        self.slice
    }
    fn size(&self) -> TreeSize {
        let bytes = self.nodes.capacity() * size_of::<DoubleNode>()
            + self.slopes.capacity() * size_of::<Boxes>()
            + self.blocks.capacity() * size_of::<DoubleBlock>()
            + self.ends.capacity() * size_of::<DoubleRows>()
            + (self.node_times.capacity() + self.block_times.capacity() + self.active.capacity())
                * size_of::<LaneIntervals>();
        TreeSize { references: self.references, nodes: self.nodes.len(), levels: self.shape.levels, bytes }
    }
    fn block_count(&self) -> usize {
        self.blocks.len()
    }
    fn block_ids(&self, block: usize) -> &Lanes<u32> {
        &self.blocks[block].id
    }
    fn block_ids_mut(&mut self, block: usize) -> &mut Lanes<u32> {
        &mut self.blocks[block].id
    }
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.references as u64)?;
        to.array(&self.nodes)?;
        to.array(&self.slopes)?;
        to.array(&self.blocks)?;
        to.array(&self.ends)?;
        to.array(&self.node_times)?;
        to.array(&self.block_times)?;
        to.array(&self.active)
    }
}

/// A tree at a time, seen from a query point.
#[derive(Clone, Copy)]
pub(in crate::point) struct DoubleView<'a, const MOVING: bool> {
    tree: &'a DoubleTree,
    query: [f64; 3],
    time: f32,
    /// The fraction of the slice at the time.
    within: f64,
    /// Step from the nearer key.
    step: f64,
    from_end: bool,
}

impl<const MOVING: bool> DoubleView<'_, MOVING> {
    /// Faces relative to the centre.
    #[inline(always)]
    fn relative_faces<S: Simd>(&self, s: S, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let boxes = &self.tree.nodes[node].boxes;
        let (lo, hi) = (rows(s, &boxes.lo), rows(s, &boxes.hi));
        if !MOVING {
            return (lo, hi);
        }
        let (slopes, w) = (&self.tree.slopes[node], s.splat(self.within as f32));
        let ([ax, ay, az], [bx, by, bz]) = (rows(s, &slopes.lo), rows(s, &slopes.hi));
        ([lo[0] + ax * w, lo[1] + ay * w, lo[2] + az * w], [hi[0] + bx * w, hi[1] + by * w, hi[2] + bz * w])
    }

    /// The query relative to the centre of a node.
    #[inline(always)]
    fn relative_query<S: Simd>(&self, s: S, node: usize) -> [S::F; 3] {
        let node = &self.tree.nodes[node];
        let [x, y, z] = if MOVING { node.middle_at(self.within) } else { node.middle };
        let [qx, qy, qz] = self.query;
        [s.splat((qx - x) as f32), s.splat((qy - y) as f32), s.splat((qz - z) as f32)]
    }

    /// The lanes that are active at the time.
    #[inline(always)]
    fn active_at<S: Simd>(&self, s: S, times: &[LaneIntervals], at: usize) -> Mask {
        if times.is_empty() { Mask::MAX } else { times[at].active_at(s, s.splat(self.time)) }
    }

    /// Coordinates of four moving points of a block along an axis.
    #[inline(always)]
    fn four_coordinates<S: Simd>(&self, s: S, block: usize, axis: usize, four: usize) -> S::D {
        let begin = s.load_d(&self.tree.blocks[block].begin.0[axis].as_chunks().0[four]);
        let end = s.load_d(&self.tree.ends[block].0[axis].as_chunks().0[four]);
        let base = if self.from_end { end } else { begin };
        base + (end - begin) * s.splat_d(self.step)
    }

    /// The positions of the points of a block; infinite along the first axis, for any period, where there is no active point.
    #[inline(always)]
    fn position_rows<S: Simd>(&self, s: S, block: usize) -> DoubleRows {
        let mut positions = self.tree.blocks[block].begin;
        if MOVING {
            for (axis, row) in positions.0.iter_mut().enumerate() {
                for (four, to) in row.as_chunks_mut().0.iter_mut().enumerate() {
                    *to = s.lanes_d(self.four_coordinates(s, block, axis, four));
                }
            }
        }
        let active = if MOVING { self.active_at(s, &self.tree.block_times, block) } else { Mask::MAX };
        for (lane, x) in positions.0[0].iter_mut().enumerate() {
            *x = if active >> lane & 1 != 0 && *x != ABSENT { *x } else { f64::INFINITY };
        }
        positions
    }

    /// Offsets of four moving points of a block from the query along an axis.
    #[inline(always)]
    fn apart<S: Simd>(&self, s: S, block: usize, axis: usize, four: usize) -> S::D {
        self.four_coordinates(s, block, axis, four) - s.splat_d(self.query[axis])
    }

    /// Squared distances of four moving points of a block.
    #[inline(always)]
    fn four_distances<S: Simd>(&self, s: S, block: usize, four: usize) -> S::D {
        let x = self.apart(s, block, 0, four);
        let y = self.apart(s, block, 1, four);
        let z = self.apart(s, block, 2, four);
        (x * x + y * y) + z * z
    }
}

impl<const MOVING: bool> LeafView for DoubleView<'_, MOVING> {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        if MOVING { 1 } else { self.tree.shape.leaf_blocks }
    }
    /// The view holds the query point, in f64.
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, _: Vec3) -> Target<S> {
        Target::static_point(s, Vec3::ZERO)
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, _: &Target<S>, block: usize) -> S::F {
        if !MOVING {
            return s.squared_distances(self.tree.blocks[block].begin.0.each_ref(), self.query);
        }
        let distances = s.narrow_all([
            self.four_distances(s, block, 0),
            self.four_distances(s, block, 1),
            self.four_distances(s, block, 2),
            self.four_distances(s, block, 3),
        ]);
        if self.tree.block_times.is_empty() {
            return distances;
        }
        s.select(self.active_at(s, &self.tree.block_times, block), distances, s.splat(f32::INFINITY))
    }
    #[inline(always)]
    fn prefetch_leaf(&self, block: usize) {
        if let Some(blocks) = self.tree.blocks.get(block..block + self.leaf_blocks()) {
            blocks.iter().for_each(prefetch);
            if MOVING {
                prefetch(&self.tree.ends[block]);
            }
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        self.tree.blocks.len() * size_of::<DoubleBlock>() + self.tree.ends.len() * size_of::<DoubleRows>()
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.tree.blocks[block].id
    }
}

impl<const MOVING: bool> View for DoubleView<'_, MOVING> {
    const BALL: f32 = if MOVING { 0.14 } else { 0.18 };

    #[inline(always)]
    fn shape(&self) -> &Shape {
        &self.tree.shape
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, _: &Target<S>, node: usize) -> (S::F, Mask) {
        let (lo, hi) = self.relative_faces(s, node);
        let (distances, holding) = outside(s, &self.relative_query(s, node), lo, hi);
        let distances = distances * s.splat(SHRINK);
        if !MOVING || self.tree.node_times.is_empty() {
            return (distances, holding);
        }
        let active = self.active_at(s, &self.tree.node_times, node);
        (s.select(active, distances, s.splat(f32::INFINITY)), holding & active)
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, _: &Target<S>, node: usize) -> S::F {
        let (lo, hi) = self.relative_faces(s, node);
        diagonal::<S>(lo, hi)
    }
    #[inline(always)]
    fn prefetch_node(&self, node: usize) {
        prefetch(&self.tree.nodes[node]);
        if MOVING {
            prefetch(&self.tree.slopes[node]);
        }
    }
}

impl<const MOVING: bool> CoordinateView for DoubleView<'_, MOVING> {
    /// **Rounding.** Faces relative to the centre of the node hold the contents, and 1e-22 more. The query is rounded relative to
    /// the centre, by u of its distance from there, and the difference of the two numbers and the face in the end by u of their sum
    /// each. The face is moved outward by 4u of the sum.
    #[inline(always)]
    fn faces<S: Simd>(&self, s: S, _: &Target<S>, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let ((mut lo, mut hi), query) = (self.relative_faces(s, node), self.relative_query(s, node));
        let four_units = s.splat(2.0 * f32::EPSILON);
        for axis in 0..3 {
            let distance = magnitude(s, query[axis]);
            lo[axis] = (lo[axis] - query[axis]) - (magnitude(s, lo[axis]) + distance) * four_units;
            hi[axis] = (hi[axis] - query[axis]) + (magnitude(s, hi[axis]) + distance) * four_units;
        }
        if MOVING && !self.tree.node_times.is_empty() {
            let active = self.active_at(s, &self.tree.node_times, node);
            lo[0] = s.select(active, lo[0], s.splat(f32::INFINITY));
        }
        (lo, hi)
    }
    #[inline(always)]
    fn positions<S: Simd>(&self, s: S, _: &Target<S>, block: usize) -> [S::F; 3] {
        let DoubleRows([x, y, z]) = self.position_rows(s, block);
        let [qx, qy, qz] = self.query;
        [relative_row(s, &x, qx), relative_row(s, &y, qy), relative_row(s, &z, qz)]
    }
    #[inline(always)]
    fn double_positions<S: Simd>(&self, s: S, block: usize) -> Option<DoubleRows> {
        Some(self.position_rows(s, block))
    }
}

/// Coordinates relative to that of the query, rounded.
#[inline(always)]
fn relative_row<S: Simd>(s: S, row: &Lanes<f64>, query: f64) -> S::F {
    let (row, query) = (row.as_chunks().0, s.splat_d(query));
    s.narrow_all([
        s.load_d(&row[0]) - query,
        s.load_d(&row[1]) - query,
        s.load_d(&row[2]) - query,
        s.load_d(&row[3]) - query,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point::build::source::Source;
    use crate::point::params::Precision;
    use crate::progress::Progress;
    use crate::random::Random;
    use crate::simd::{Kernel, SimdLevel, dispatch};

    /// Counts boxes of leaves that are farther from the query than one of their points, with squared distances multiplied
    /// by `less`.
    struct Lost<'a> {
        view: DoubleView<'a, false>,
        less: f32,
    }

    impl Kernel for Lost<'_> {
        type Output = usize;
        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> usize {
            let Lost { view, less } = self;
            let target = view.target(s, Vec3::ZERO);
            let (lo, hi) = view.relative_faces(s, 0);
            let boxes = outside(s, &view.relative_query(s, 0), lo, hi).0 * s.splat(less);
            let leaves = view.tree.blocks.len();
            let lost = |&leaf: &usize| {
                let nearest = s.reduce_min_u(s.to_bits(view.point_distances(s, &target, leaf)));
                s.lane(boxes, leaf) > f32::from_bits(nearest)
            };
            (0..leaves).filter(lost).count()
        }
    }

    #[test]
    fn no_box_is_farther_than_its_points_and_some_would_be_without_less() {
        let mut random = Random(7);
        let (mut lost, mut lost_without) = (0, 0);
        for round in 0..2000 {
            let offset = [0.0, 1e9][round % 2];
            // Of the size of the set, or so small that squares underflow.
            let size = [1.0, 1e-3, 1e-20][round % 3];
            let far = 10f64.powi(round as i32 % 9);
            let mut random_vec =
                |size: f64| DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64()) * size;
            let points: Vec<DVec3> = (0..256).map(|_| random_vec(size) + offset).collect();
            let source = Source::read(&points, Precision::Automatic).expect("points are in order");
            let slice = SegmentSlice::AT_REST;
            if !source.is_double() {
                continue;
            }
            let tree = DoubleTree::build(&source, slice, (0..256).collect(), false, &Progress::new(None));
            let view = tree.at::<false>(points[0] + random_vec(size * far), 0.0);
            for simd in SimdLevel::available() {
                lost += dispatch(simd, Lost { view, less: SHRINK });
                lost_without += dispatch(simd, Lost { view, less: 1.0 });
            }
        }
        assert_eq!(lost, 0);
        assert!(lost_without > 20, "a factor that no box needs");
    }
}
