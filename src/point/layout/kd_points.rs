//! The k-d layout over points: the paper's tree for one time slice.
//!
//! Inner nodes are planes that may move, the same nodes as in the k-d tree for rays. A point that crosses a plane is in
//! several leaves, in each for the time it spends there; at every time it is in exactly one of them, so no point is
//! found twice. Leaves are blocks of sixteen references with their intervals. Sections 3.1.1 and 3.1.2 of the paper;
//! built by [`build_kd_over_points`], traversed by [`KdFront`](crate::point::search::kd_search::KdFront).
//!
//! **Slack.** A search culls the far side of a plane if everything in it is too far away. A point that is active
//! there at time t may be computed on the wrong side of the plane, by no more than the slack of the subtree. Let
//! u = 2^-24 and a point go from a to b in a segment of 1/n of the shutter.
//! - The computed position is off by at most (|b − a| + max(|a|, |b|))u: see [`super::linear_bounds`].
//! - Queries compute t·n in f32, exact for n = 1: the phase is off by at most n·u, the position by |b − a|n·u.
//! - The time of crossing is computed from the length of an interval in f32, which is rounded by at most u/2, and is
//!   rounded to the nearest f32, by at most u/2. In that time the point moves by at most |b − a|n·u and the plane, whose
//!   velocity is w, by |w|u.
//!
//! All of this is raised by 2^-10 of itself, which covers the f64 rounding of the build, and by 2^-140 for what
//! underflows. The first terms depend on the point: the slack of a subtree is that of the worst reference in it, so one
//! distant point affects only those searches that come near its own leaves. The last depends on the plane.

use super::linear_face::UNIT;
use super::moving_leaf::MovingLeaves;
use super::moving_tree::MovingTree;
use super::moving_view::TreeAtTime;
use super::over_interval::{PointPath, all_lanes};
use super::slice_tree::{SliceTree, TreeSize};
use super::static_tree::StaticTree;
use crate::file::{Encoder, FileError};
use crate::geometry::{Aabb, Box3, KeyTime, Plane};
use crate::kd::{KdNode, KdView, PointReference, Trajectories, Trajectory, build_kd_over_points};
use crate::point::leaf_order::moving_reference::MovingReference;
use crate::point::leaf_order::segment_slice::{SegmentSlice, segments};
use crate::progress::Progress;
use crate::simd::{Item, LANES, Lanes, MovingPointBlock, huge_vec_of};
use glam::{DVec3, Vec3};

/// Points between two keys in the k-d layout.
#[derive(Clone)]
pub(in crate::point) struct KdPoints {
    pub(in crate::point) slice: SegmentSlice,
    /// The box of all points at both keys.
    pub(super) root: Box3,
    /// A leaf has its first block and its number of blocks.
    pub(in crate::point) nodes: Vec<KdNode>,
    /// How far a point below a node may be computed outside of the half-space of the plane above the node.
    pub(in crate::point) slack: Vec<f32>,
    pub(in crate::point) leaves: MovingLeaves,
    pub(in crate::point) depth: usize,
    pub(in crate::point) references: usize,
}

impl KdPoints {
    /// Builds the tree of one time slice with at most `most` references per point.
    pub(in crate::point) fn build(
        references: &[MovingReference],
        slice: SegmentSlice,
        most: f32,
        progress: &Progress,
    ) -> KdPoints {
        let reference = |(id, m): (usize, &MovingReference)| PointReference {
            id: id as u32,
            interval: m.interval,
            bounds: Trajectory { open: m.open, close: m.close },
            in_sah: true,
        };
        let all: Vec<_> = references.iter().enumerate().map(reference).collect();
        let segments = segments(slice.keys);
        let points = Trajectories { segments, segment: slice.segment, middle: slice.middle() };
        let tree = build_kd_over_points(points, all, references.len() as f64 * f64::from(most), progress);
        let (mut nodes, stored) = (tree.nodes, tree.references);
        let has_active_intervals = references.iter().any(|m| m.active != crate::TimeInterval::FULL);
        let blocks = |node: &KdNode| match node.view() {
            KdView::Leaf { count, .. } => (count as usize).div_ceil(LANES),
            KdView::Inner { .. } => 0,
        };
        let mut leaves = MovingLeaves::of(
            huge_vec_of(MovingPointBlock::EMPTY, nodes.iter().map(blocks).sum()),
            true,
            has_active_intervals,
        );
        let (mut rows, mut next) = (leaves.rows(), 0);
        let mut slack = vec![0.0; nodes.len()];
        for (node, slack) in nodes.iter_mut().zip(&mut slack) {
            let KdView::Leaf { first, count } = node.view() else { continue };
            let own = &stored[first as usize..][..count as usize];
            let begin = next;
            for lanes in own.chunks(LANES) {
                for (lane, r) in lanes.iter().enumerate() {
                    let reference = &references[r.id as usize];
                    rows.set(next, lane, reference);
                    rows.set_times(next, lane, [r.begin, r.end], reference.active);
                }
                next += 1;
            }
            *slack = own.iter().map(|r| error(&references[r.id as usize], segments)).fold(0.0, f32::max);
            *node = KdNode::leaf(begin as u32, (next - begin) as u32);
        }
        // Children follow their parents.
        for i in (0..nodes.len()).rev() {
            if let KdView::Inner { plane, right } = nodes[i].view() {
                let (left, right) = (i + 1, right as usize);
                slack[i] = slack[left].max(slack[right]);
                let own = raised(plane_error(&plane));
                slack[left] = (slack[left] + own).next_up();
                slack[right] = (slack[right] + own).next_up();
            }
        }
        KdPoints { slice, root: tree.root, nodes, slack, leaves, depth: tree.depth as usize, references: stored.len() }
    }

    /// A box around all points at all times, as they are computed; empty if there are none.
    pub(in crate::point) fn bounds(&self) -> Aabb {
        let [min, max] = [self.root.min, self.root.max].map(|corner| corner.as_dvec3());
        // Along no axis does a point move farther than from face to face, or lie farther from zero than both.
        let (motion, far) = ((max - min).max(DVec3::ZERO), (-min).max(max).max(DVec3::ZERO));
        let pad = DVec3::from_array(core::array::from_fn(|i| {
            TINY + axis_error(motion[i], far[i], segments(self.slice.keys))
        }));
        Aabb { min: min - pad, max: max + pad }
    }

    /// A node.
    #[inline(always)]
    pub(in crate::point) fn node(&self, node: u32) -> KdView {
        self.nodes[node as usize].view()
    }

    /// How far a point below a node may be computed outside of the half-space of the plane above the node.
    #[inline(always)]
    pub(in crate::point) fn slack(&self, node: u32) -> f64 {
        f64::from(self.slack[node as usize])
    }

    /// A static tree over the points that are active at a time of the slice, at their positions then.
    pub(in crate::point) fn static_tree_at(&self, time: f32) -> StaticTree {
        let (ids, positions): (Vec<u32>, Vec<Vec3>) =
            self.leaves.active_points(KeyTime::new(time, self.slice.keys), time).unzip();
        let item = |(index, position): (usize, &Vec3)| Item { at: position.to_array(), index: index as u32 };
        let rows = StaticTree::rows(positions.len(), positions.iter().enumerate().map(item));
        StaticTree::build(positions.len(), rows, |index| ids[index as usize], &Progress::new(None))
    }

    /// A tree of moving boxes over the same points.
    pub(in crate::point) fn box_tree(&self) -> MovingTree {
        let references = all_lanes(0..self.leaves.blocks.len()).filter_map(|(block, lane)| {
            let point = self.leaves.paths(block).point_path(lane)?;
            let (PointPath { id, active, .. }, [open, close]) = (point, point.ends());
            let interval = active.intersect(self.slice.interval)?;
            // A point has a reference in each leaf that it passes through; the first one begins when the point does.
            let first = self.leaves.times(block, lane)[0] == interval.begin();
            first.then_some(MovingReference { open, close, interval, active, id, fast: false })
        });
        MovingTree::build(&references.collect::<Vec<_>>()[..], self.slice, &Progress::new(None))
    }

    /// The tree at a time, which lies in its slice.
    #[inline(always)]
    pub(in crate::point) fn at(&self, time: f32) -> KdPointsView<'_> {
        TreeAtTime::new(self, &self.leaves, &self.slice, time)
    }
}

/// Room for what underflows.
const TINY: f64 = 512.0 * f32::from_bits(1) as f64;

/// Rounded up, with room for what underflows.
fn raised(x: f64) -> f32 {
    ((x + TINY) as f32).next_up()
}

/// How far a plane is from where the build computed it, at the time at which a point crosses it.
#[inline(always)]
pub(in crate::point) fn plane_error(plane: &Plane) -> f64 {
    UNIT * f64::from(plane.velocity).abs()
}

/// How far a coordinate may be computed from where the build computed it, but for underflow, given static planes: of a point that
/// moves this far from key to key and is never farther from zero than this.
fn axis_error(motion: f64, far: f64, segments: usize) -> f64 {
    let along = if segments > 1 { 2.0 * segments as f64 } else { 1.0 };
    UNIT * ((1.0 + along) * motion + far)
}

/// How far a point may be computed from where the build computed it, given static planes.
fn error(m: &MovingReference, segments: usize) -> f32 {
    let axis = |i: usize| {
        let (a, b) = (f64::from(m.open[i]), f64::from(m.close[i]));
        axis_error((b - a).abs(), a.abs().max(b.abs()), segments)
    };
    raised(axis(0).max(axis(1)).max(axis(2)))
}

impl SliceTree for KdPoints {
    #[inline(always)]
    fn slice(&self) -> SegmentSlice {
        self.slice
    }
    fn size(&self) -> TreeSize {
        let of_nodes = self.nodes.capacity() * size_of::<KdNode>() + self.slack.capacity() * size_of::<f32>();
        let (nodes, bytes) = (self.nodes.len() / 2, of_nodes + self.leaves.bytes());
        TreeSize { references: self.references, nodes, levels: self.depth, bytes }
    }
    fn block_count(&self) -> usize {
        self.leaves.blocks.len()
    }
    fn block_ids(&self, block: usize) -> &Lanes<u32> {
        self.leaves.ids(block)
    }
    fn block_ids_mut(&mut self, block: usize) -> &mut Lanes<u32> {
        &mut self.leaves.blocks[block].id
    }
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.root)?;
        to.array(&self.nodes)?;
        to.array(&self.slack)?;
        self.leaves.encode(to)
    }
}

/// A k-d tree over points at a time.
pub(in crate::point) type KdPointsView<'a> = TreeAtTime<'a, KdPoints, true>;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::point::build::time_slices::time_slices;
    use crate::random::Random;

    /// Calls `visit` with the planes above each leaf, the sides it lies on (-1 below) with their slack, and its blocks.
    fn leaves(
        tree: &KdPoints,
        node: u32,
        above: &mut Vec<(Plane, f64, f64)>,
        visit: &mut impl FnMut(&[(Plane, f64, f64)], usize),
    ) {
        match tree.node(node) {
            KdView::Leaf { first, count } => (first..first + count).for_each(|block| visit(above, block as usize)),
            KdView::Inner { plane, right } => {
                for (child, side) in [(node + 1, -1.0), (right, 1.0)] {
                    above.push((plane, side, tree.slack(child)));
                    leaves(tree, child, above, visit);
                    above.pop();
                }
            }
        }
    }

    /// How far points are computed on the wrong side of planes, at the first and last times at which they are active
    /// there: the maximum, as a fraction of the slack.
    fn worst(keys: usize, offset: f32, size: f32, speed: f32) -> f64 {
        let mut random = Random(11);
        let mut random_vec = |by: f32| core::array::from_fn::<f32, 3, _>(|_| random.signed() * by);
        let references: Vec<MovingReference> = (0..800)
            .map(|id| {
                let open = random_vec(size).map(|x| x + offset);
                let motion = random_vec(speed * size);
                let close = core::array::from_fn(|i| open[i] + motion[i]);
                let interval = TimeInterval::FULL;
                MovingReference { open, close, interval, active: interval, id, fast: false }
            })
            .collect();
        let slice = time_slices(keys, 1)[(keys - 1) / 2];
        let inside: Vec<MovingReference> =
            references.iter().map(|m| MovingReference { interval: slice.interval, ..*m }).collect();
        let tree = KdPoints::build(&inside, slice, 16.0, &Progress::new(None));
        let mut worst: f64 = 0.0;
        leaves(&tree, 0, &mut Vec::new(), &mut |planes, block| {
            for lane in 0..LANES {
                let Some(point) = tree.leaves.paths(block).point_path(lane) else { continue };
                let [begin, end] = tree.leaves.times(block, lane);
                for time in [begin, end.next_down().min(1.0)] {
                    let at = point.position(KeyTime::new(time, keys));
                    for &(plane, side, slack) in planes {
                        let outside = -side * (f64::from(at[plane.axis]) - plane.at(time));
                        worst = worst.max(outside / slack);
                    }
                }
            }
        });
        worst
    }

    #[test]
    fn slack_covers_what_rounding_puts_on_the_wrong_side_and_little_more() {
        for keys in [2, 3, 8, 100] {
            for (offset, size, speed) in [
                (0.0, 1.0, 1.0),
                (0.0, 1e-3, 30.0),
                (1000.0, 1.0, 0.1),
                (-3e7, 1e3, 5.0),
                (0.0, 1e18, 1.0),
                (0.0, 1e-40, 2.0),
            ] {
                let worst = worst(keys, offset, size, speed);
                let what = format!("{keys} keys, {offset} ± {size}, speed {speed}");
                assert!(worst <= 1.0, "{what}: {worst} of the slack");
                assert!(size < 1e-30 || worst > 0.02, "{what}: {worst} of the slack, which is far more than it takes");
            }
        }
    }

    #[test]
    fn bounds_hold_all_computed_positions_and_are_padded_on_each_axis_by_itself() {
        let mut random = Random(5);
        for keys in [2, 3, 100] {
            let slice = time_slices(keys, 1)[(keys - 1) / 2];
            let references: Vec<MovingReference> = (0..200)
                .map(|id| {
                    let open = [9e5 + random.signed(), 1e-4 * random.signed(), -3.0 - 1e-3 * random.unit()];
                    let close = [open[0], -open[1], if id % 2 == 0 { 2.0 } else { 1.0 }];
                    let active = TimeInterval::FULL;
                    MovingReference { open, close, interval: slice.interval, active, id, fast: false }
                })
                .collect();
            let tree = KdPoints::build(&references, slice, 16.0, &Progress::new(None));
            let bounds = tree.bounds();
            let size = bounds.max - bounds.min;
            assert!(size.x < 2.5 && size.y < 2.1e-4 && size.z < 5.002, "{keys} keys: {size}");
            for point in
                all_lanes(0..tree.leaves.blocks.len()).filter_map(|(b, lane)| tree.leaves.paths(b).point_path(lane))
            {
                for step in 0..=64 {
                    let [begin, end] = [slice.interval.begin(), slice.interval.end()];
                    let time = (begin + (end - begin) * step as f32 / 64.0).min(end);
                    let at = point.position(KeyTime::new(time, keys)).as_dvec3();
                    assert!(bounds.contains(at), "{keys} keys, at {time}: {at} is outside of {bounds:?}");
                }
            }
        }
    }
}
