//! How much larger boxes are because their points move.
//!
//! A search visits the boxes that a ball meets, and their number is proportional to the volume of the boxes, each enlarged by the
//! ball. So boxes of points that are close together in the middle of the shutter are compared with boxes of the same points at
//! rest. Boxes of shorter time slices in the middle follow from the same points. The levels of a tree are compared separately.
//!
//! The average is exact to a tenth where motion is of one kind. Where a few points are fast, more is visited than this says, since
//! searches begin in boxes that are much larger than others.

use super::cost::{Visits, memory_cost};
use crate::geometry::Box3;
use crate::point::layout::moving_leaf;
use crate::point::leaf_order::fast_points::order_at;
use crate::point::leaf_order::moving_reference::References;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::leaf_order::selection::least_lane;
use crate::point::leaf_order::spread::spread;
use crate::simd::{Kernel, LANES, MovingPointBlock, Simd, SimdLevel, dispatch};
use crate::tuning::points::{MAX_COST, MOST_AT_REST};

/// The volume of boxes relative to points at rest, all enlarged by a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::point) struct Excess {
    pub(in crate::point) leaves: f64,
    /// Bottom nodes.
    pub(in crate::point) nodes: f64,
    /// The nodes above these.
    above: f64,
}

impl Excess {
    /// That of one time slice for a segment, given leaves in an order by position in its middle.
    pub(in crate::point) fn of_segment(leaves: &[MovingPointBlock], simd: SimdLevel) -> Excess {
        excess(leaves, 0.5, &[1], simd)[0]
    }

    /// Whether that of one tree for each segment between keys, of so many references in all, is so small that time slices could not
    /// gain enough.
    pub(in crate::point) fn is_small(&self, references: usize) -> bool {
        let one_tree = MOST_AT_REST * self.largest() + memory_cost(references);
        MOST_AT_REST + memory_cost(2 * references) >= MAX_COST * one_tree
    }

    /// That of the level with the largest.
    pub(in crate::point) fn largest(&self) -> f64 {
        self.leaves.max(self.nodes).max(self.above)
    }

    /// What is visited in these boxes, if so much is visited in boxes that exceed those at rest by `other`.
    pub(in crate::point) fn visits(&self, other: &Excess, visits: Visits) -> Visits {
        let [nodes, leaves] = [self.nodes / other.nodes, self.leaves / other.leaves].map(|ratio| ratio.min(1.0));
        Visits { nodes: visits.nodes * nodes, blocks: visits.blocks * leaves }
    }

    /// Why nothing else is tried where it is small.
    pub(in crate::point) fn why(&self) -> String {
        let Excess { leaves, nodes, .. } = self;
        format!("leaves are {leaves:.2} times as large as those of points at rest, nodes {nodes:.2} times")
    }
}

/// The leaves of references in an order.
pub(in crate::point) fn leaves_of<R: References + ?Sized>(references: &R, order: &[u32]) -> Vec<MovingPointBlock> {
    let leaf = |numbers: &[u32]| {
        let mut block = MovingPointBlock::EMPTY;
        for (lane, &number) in numbers.iter().enumerate() {
            moving_leaf::set(&mut block, lane, &references.reference(number));
        }
        block
    };
    order.chunks(LANES).map(leaf).collect()
}

/// The leaves of references in an order by position in the middle of a time slice.
pub(in crate::point) fn leaves_by_position<R: References>(
    references: &R,
    slice: &SegmentSlice,
) -> Vec<MovingPointBlock> {
    leaves_of(references, &order_at(references, slice.middle_phase()))
}

/// The largest number of nodes above bottom nodes that are examined, and of bottom nodes below each.
const EXAMINED: [usize; 2] = [4, 8];

/// That of each of these numbers of time slices for a segment, around a phase, given leaves in an order by position at that phase.
/// Their points are taken to move on before and behind the segment.
pub(in crate::point) fn excess(
    leaves: &[MovingPointBlock],
    middle: f32,
    slices: &[usize],
    simd: SimdLevel,
) -> Vec<Excess> {
    let ends = slices.iter().flat_map(|&slices| [-0.5, 0.5].map(|half| middle + half / slices as f32));
    let phases: Vec<f32> = [middle].into_iter().chain(ends).collect();
    let mut sums = vec![[0.0; 3]; slices.len()];
    let mut counts = [0.0; 3];
    // Leaves that are full are all of the same kind.
    let full = |leaf: &&MovingPointBlock| leaf.id.iter().all(|&id| id != u32::MAX);
    for above in some(leaves, LANES * LANES, EXAMINED[0]) {
        let mut of_above = (vec![Box3::EMPTY; phases.len()], 0);
        for node in some(above, LANES, EXAMINED[1]) {
            let mut of_node = (vec![Box3::EMPTY; phases.len()], 0);
            for leaf in node.iter().filter(full) {
                let boxes = dispatch(simd, BoxesAt { leaf, phases: &phases });
                add(&mut sums, &mut counts, 0, &boxes, 1);
                include(&mut of_node, &boxes, 1);
            }
            if of_node.1 > LANES / 2 {
                add(&mut sums, &mut counts, 1, &of_node.0, of_node.1);
            }
            include(&mut of_above, &of_node.0, of_node.1);
        }
        if of_above.1 > LANES {
            add(&mut sums, &mut counts, 2, &of_above.0, of_above.1);
        }
    }
    let mean = |sum: f64, count: f64| if count > 0.0 { sum / count } else { 1.0 };
    let of = |sum: &[f64; 3]| core::array::from_fn(|level| mean(sum[level], counts[level]));
    sums.iter().map(of).map(|[leaves, nodes, above]| Excess { leaves, nodes, above }).collect()
}

/// Some of the parts of a length that leaves are divided into, at most so many.
fn some(leaves: &[MovingPointBlock], len: usize, most: usize) -> impl Iterator<Item = &[MovingPointBlock]> {
    let parts = leaves.len().div_ceil(len);
    let number = move |i| if parts <= most { i } else { spread(i, parts) };
    (0..parts.min(most)).map(move |i| &leaves[number(i) * len..leaves.len().min((number(i) + 1) * len)])
}

/// Includes boxes of `more` leaves in those of others.
fn include((around, leaves): &mut (Vec<Box3>, usize), own: &[Box3], more: usize) {
    around.iter_mut().zip(own).for_each(|(around, own)| *around = around.union(*own));
    *leaves += more;
}

/// Adds what boxes around so many leaves exceed those at rest by, which come first, each number of slices with boxes at its two
/// ends.
fn add(sums: &mut [[f64; 3]], counts: &mut [f64; 3], level: usize, boxes: &[Box3], leaves: usize) {
    counts[level] += 1.0;
    let leaf = (leaves as f64).cbrt().recip();
    let rest = sides(boxes[0]);
    let [x, y, z] = rest;
    // As large as a leaf: of points on a surface, leaves are flat, and of points on a line thin.
    let ball = leaf * x.max(y).min(y.max(z)).min(x.max(z)).max(LEAST_BALL * x.max(y).max(z));
    let volume = |size: [f64; 3]| size.map(|side| side + ball).iter().product::<f64>();
    // Of points in one place, boxes at rest have no volume.
    let at_rest = volume(rest).max(1e-200);
    for (sum, ends) in sums.iter_mut().zip(boxes[1..].chunks(2)) {
        let [begin, end] = [sides(ends[0]), sides(ends[1])];
        // Sides are linear in time, so two places of the Gaussian quadrature give the mean volume.
        let places = [0.5 - GAUSS, 0.5 + GAUSS];
        let at = |place: f64| volume(core::array::from_fn(|axis| begin[axis] + (end[axis] - begin[axis]) * place));
        sum[level] += 0.5 * places.map(at).iter().sum::<f64>() / at_rest;
    }
}

/// The least size of a ball, in sides of the box.
const LEAST_BALL: f64 = 0.02;

/// Half the root of a third.
const GAUSS: f64 = 0.288_675_134_594_812_9;

/// The sides of a box.
fn sides(of: Box3) -> [f64; 3] {
    (of.max.as_dvec3() - of.min.as_dvec3()).to_array()
}

/// The boxes around the points of a full leaf at some phases.
struct BoxesAt<'a> {
    leaf: &'a MovingPointBlock,
    phases: &'a [f32],
}

impl Kernel for BoxesAt<'_> {
    type Output = Vec<Box3>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<Box3> {
        let BoxesAt { leaf, phases } = self;
        let mut boxes = vec![Box3::EMPTY; phases.len()];
        for axis in 0..3 {
            let (open, close) = (s.load(&leaf.open[axis]), s.load(&leaf.close[axis]));
            for (around, &phase) in boxes.iter_mut().zip(phases) {
                let at = open + (close - open) * s.splat(phase);
                around.min[axis] = least_lane(s, at);
                around.max[axis] = -least_lane(s, s.splat(0.0) - at);
            }
        }
        boxes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::Vec3;

    /// Leaves along a cube, cube by cube, of sixteen points each, which move by a function of their position.
    fn leaves(count: usize, by: impl Fn(Vec3, &mut Random) -> Vec3) -> Vec<MovingPointBlock> {
        let mut random = Random(7);
        let leaf = |i: usize| {
            // The bits of the number are those of the three coordinates in turn.
            let of_axis = |axis: usize| (0..4).map(|bit| (i >> (3 * bit + axis) & 1) << bit).sum::<usize>() as f32;
            let corner = Vec3::new(of_axis(0), of_axis(1), of_axis(2));
            let mut block = MovingPointBlock::EMPTY;
            for lane in 0..LANES {
                let at = corner + 0.5 + 0.5 * random.vec();
                let by = by(at, &mut random);
                for axis in 0..3 {
                    (block.open[axis][lane], block.close[axis][lane]) = ((at - 0.5 * by)[axis], (at + 0.5 * by)[axis]);
                }
                block.id[lane] = (i * LANES + lane) as u32;
            }
            block
        };
        (0..count).map(leaf).collect()
    }

    #[test]
    fn boxes_are_larger_by_as_much_as_points_move_relative_to_each_other() {
        let all = |leaves: &[MovingPointBlock], slices: &[usize]| excess(leaves, 0.5, slices, SimdLevel::best());
        // Faces that do not move are rounded.
        for together in [leaves(1024, |_, _| Vec3::ZERO), leaves(1024, |_, _| Vec3::splat(3.0))] {
            let found = all(&together, &[1, 4])[0];
            assert!([found.leaves, found.nodes, found.above].iter().all(|x| (x - 1.0).abs() < 1e-3), "{found:?}");
            assert!(found.is_small(together.len() * LANES));
        }
        let apart = leaves(1024, |_, random| random.vec() * 2.0);
        let found = all(&apart, &[1, 2, 4, 8, 64]);
        assert!(found.windows(2).all(|two| two[1].leaves < two[0].leaves && two[1].nodes < two[0].nodes), "{found:?}");
        // By nearly a side on both sides at the ends, and so in between, since faces are linear.
        assert!((4.0..6.5).contains(&found[0].leaves), "{found:?}");
        assert!(found[0].nodes < found[0].leaves && found[0].above < found[0].nodes, "{found:?}");
        assert!(found[4].leaves < 1.01 && !found[0].is_small(apart.len() * LANES));
        // Each leaf moves by itself.
        let rigid = leaves(1024, |at, _| if at.x.floor() % 2.0 == 0.0 { Vec3::ONE } else { -Vec3::ONE });
        let found = all(&rigid, &[1])[0];
        assert!((found.leaves - 1.0).abs() < 1e-3 && found.nodes > 1.2, "{found:?}");
        let visits = found.visits(&found, Visits { nodes: 3.0, blocks: 4.0 });
        assert_eq!((visits.nodes, visits.blocks), (3.0, 4.0));
    }

    #[test]
    fn few_points_and_points_in_one_place_have_finite_sizes() {
        for leaves in [leaves(0, |_, _| Vec3::ONE), leaves(1, |_, _| Vec3::ONE), vec![MovingPointBlock::EMPTY; 20]] {
            assert!(excess(&leaves, 0.5, &[1], SimdLevel::best())[0].is_small(16));
        }
        // All are in one place in the middle.
        let mut meeting = leaves(64, |_, random| random.vec());
        for leaf in &mut meeting {
            for axis in 0..3 {
                leaf.close[axis] = leaf.open[axis].map(|x| -x);
            }
        }
        let found = excess(&meeting, 0.5, &[1, 8], SimdLevel::best());
        assert!(found.iter().all(|found| found.leaves.is_finite() && found.nodes.is_finite()), "{found:?}");
        assert!(!found[0].is_small(1024) && found[1].leaves < found[0].leaves);
    }
}
