//! Dividing points by their motion, where several flows pass through each other.
//!
//! A leaf of points that are close together in the middle of a time slice has a large box if they belong to different flows: faces
//! are linear in time, so faces around points that part are as far from each other in the middle of the slice as at its ends. A
//! leaf of one flow holds points that are farther apart in the middle, since only some of those at a place belong to it, but its
//! box is small at all times. So a range of points can be divided by motion instead of position.
//!
//! Which is better is decided by a sample of the range. The cost is the number of leaves that a ball as large as a leaf meets,
//! averaged over the slice. The points on both sides of a division have larger leaves, and their displacements spread less.
//!
//! A flow also turns, stretches and shears. Dividing by position takes care of that, so what counts is the displacement relative to
//! the affine motion that fits the sample best.
//!
//! Divisions by velocity are known from indexes of moving objects: Tao, Papadias and Sun, "The TPR*-tree: an optimized
//! spatio-temporal access method for predictive queries" (2003).

use crate::simd::LANES;
use crate::tuning::points::{MAX_MOTION_COST, MIN_MOTION_SPREAD};
use glam::{DMat3, DVec3};

/// A point, and its displacement during a time slice.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct Displaced {
    pub(in crate::point) at: DVec3,
    pub(in crate::point) by: DVec3,
}

/// A division of a range of points by motion.
pub(in crate::point) struct MotionDivision {
    /// The number of points with the lowest keys.
    pub(in crate::point) left: usize,
    /// What it costs at least, if points of each side move together, relative to points that do not move and are not divided.
    pub(in crate::point) least_cost: f64,
    axis: usize,
    /// The expected displacement along the axis: at a place, and how it grows with the position.
    middle: DVec3,
    usual: f64,
    by_position: DVec3,
}

/// The number of points of a range that should be examined.
pub(in crate::point) const SAMPLE: usize = 128;

/// Half of the distance between the least and the greatest of evenly distributed numbers, relative to their standard deviation (the
/// root of 3): the size of a box around points at one place, averaged over the slice, if these numbers are their displacements.
const HALF_SPREAD: f64 = 1.732;

/// Of the sorted sample every so many points a cut is tried.
const STEP: usize = 4;

impl MotionDivision {
    /// The division of `count` points, of which a sample is given, into subtrees of `block` points each. `None` if division by
    /// position is better. Where flows do not fill whole subtrees, the last one of a flow has points of the next one as well.
    pub(in crate::point) fn of(sample: &[Displaced], count: usize, block: usize) -> Option<MotionDivision> {
        let expected = AffineMotion::of(sample);
        let leaf = leaf_size(sample, count);
        let off: Vec<DVec3> = sample.iter().map(|point| expected.off(point)).collect();
        let mut whole = Moments::default();
        off.iter().for_each(|&off| whole.add(off));
        let most = MAX_MOTION_COST * cost(leaf, leaf, whole.deviation());
        // A small spread is most common.
        let at_rest = cost(leaf, leaf, DVec3::ZERO);
        if most < at_rest {
            return None;
        }
        let (mut best, mut least) = (None, most);
        let cuts: Vec<Cut> = (STEP..off.len()).step_by(STEP).map(|part| Cut::new(part, off.len(), leaf)).collect();
        for axis in 0..3 {
            // Little is to be gained along this axis.
            if HALF_SPREAD * whole.deviation()[axis] < MIN_MOTION_SPREAD * leaf.max_element() {
                continue;
            }
            // Keys and numbers in one word are sorted several times as fast as the vectors.
            let key = |(i, off): (usize, &DVec3)| u64::from(sortable(off[axis] as f32)) << 32 | i as u64;
            let mut order: Vec<u64> = off.iter().enumerate().map(key).collect();
            order.sort_unstable();
            let mut low = Moments::default();
            for (some, cut) in order.chunks(STEP).zip(&cuts) {
                some.iter().for_each(|&key| low.add(off[key as u32 as usize]));
                let left = (cut.share * count as f64 / block as f64).round() as usize * block;
                let cost = cut.cost(leaf, low.deviation(), whole.without(&low).deviation());
                if cost < least && left > 0 && left < count {
                    let least_cost = cut.cost(leaf, DVec3::ZERO, DVec3::ZERO) / at_rest;
                    (best, least) = (Some((axis, left, least_cost)), cost);
                }
            }
        }
        let AffineMotion { middle, displacement, by_position } = expected;
        best.map(|(axis, left, least_cost)| {
            let (usual, by_position) = (displacement[axis], by_position.row(axis));
            MotionDivision { left, least_cost, axis, middle, usual, by_position }
        })
    }

    /// The key by which a point is divided from others.
    #[inline(always)]
    pub(in crate::point) fn key(&self, point: &Displaced) -> f64 {
        point.by[self.axis] - self.usual - self.by_position.dot(point.at - self.middle)
    }
}

/// Bits that are in the order of the numbers.
fn sortable(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// A division of a sample in two.
struct Cut {
    /// The share of the points that are on the left.
    share: f64,
    /// The sizes of leaves on both sides without motion.
    leaves: [DVec3; 2],
}

impl Cut {
    fn new(part: usize, count: usize, leaf: DVec3) -> Cut {
        let share = part as f64 / count as f64;
        Cut { share, leaves: [share, 1.0 - share].map(|share| leaf / share.cbrt()) }
    }

    fn cost(&self, leaf: DVec3, low: DVec3, high: DVec3) -> f64 {
        self.share * cost(leaf, self.leaves[0], low) + (1.0 - self.share) * cost(leaf, self.leaves[1], high)
    }
}

/// What leaves of points that are divided by position cost with so many time slices, relative to points at rest: points in the
/// order of leaves.
pub(in crate::point) fn cost_of_slices(points: &[Displaced], slices: usize) -> f64 {
    let mut sum = DVec3::ZERO;
    let mut at_rest = DVec3::ZERO;
    for leaf in points.chunks_exact(LANES) {
        let size = |phase: f64| {
            let at = || leaf.iter().map(|point| point.at + phase * point.by);
            let greatest = at().fold(DVec3::NEG_INFINITY, DVec3::max);
            greatest - at().fold(DVec3::INFINITY, DVec3::min)
        };
        let end = 0.5 / slices as f64;
        at_rest += size(0.0);
        // Faces are linear, so their distance in the middle is that at the ends on average.
        sum += 0.5 * (size(-end) + size(end));
    }
    // The ball and the leaf are of the same size.
    let least = cost(at_rest, at_rest, DVec3::ZERO);
    // Of points in one place, leaves have no size.
    if least > 0.0 { cost(at_rest, sum, DVec3::ZERO) / least } else { 1.0 }
}

/// The number of leaves of a size that a ball meets, relative to the number of leaves that have a corner in it. The ball is as
/// large as the leaves of all points, `leaf`.
fn cost(leaf: DVec3, size: DVec3, deviation: DVec3) -> f64 {
    // Of points on a surface, leaves are flat.
    let ball = leaf.x.max(leaf.y).min(leaf.y.max(leaf.z)).min(leaf.x.max(leaf.z));
    (size + ball + HALF_SPREAD * deviation).element_product()
}

/// The size of the leaves of `count` points that are spread like those of a sample.
fn leaf_size(sample: &[Displaced], count: usize) -> DVec3 {
    let least = sample.iter().fold(DVec3::INFINITY, |least, point| least.min(point.at));
    let greatest = sample.iter().fold(DVec3::NEG_INFINITY, |greatest, point| greatest.max(point.at));
    let mut size = greatest - least;
    let mut count = count;
    while count > LANES {
        let longest = size.max_position();
        size[longest] *= 0.5;
        count = count.div_ceil(2);
    }
    size
}

/// Displacement as an affine function of the position.
struct AffineMotion {
    middle: DVec3,
    displacement: DVec3,
    by_position: DMat3,
}

impl AffineMotion {
    /// That of least squares.
    fn of(sample: &[Displaced]) -> AffineMotion {
        let part = 1.0 / sample.len() as f64;
        let (mut middle, mut displacement) = (DVec3::ZERO, DVec3::ZERO);
        for point in sample {
            middle += part * point.at;
            displacement += part * point.by;
        }
        let (mut squares, mut products) = (DMat3::ZERO, DMat3::ZERO);
        for point in sample {
            let at = point.at - middle;
            squares += outer(at, at);
            products += outer(point.by - displacement, at);
        }
        // Across a plane or a line in which all points lie, displacement is constant.
        let size = squares.x_axis.x + squares.y_axis.y + squares.z_axis.z;
        let regular = squares + DMat3::from_diagonal(DVec3::splat(1e-6 * size));
        let by_position = if size > 0.0 { products * regular.inverse() } else { DMat3::ZERO };
        // Of points that nearly coincide, squares vanish.
        let by_position = if by_position.is_finite() { by_position } else { DMat3::ZERO };
        AffineMotion { middle, displacement, by_position }
    }

    /// The displacement of a point relative to what is expected at its position.
    #[inline(always)]
    fn off(&self, point: &Displaced) -> DVec3 {
        point.by - self.displacement - self.by_position * (point.at - self.middle)
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Sums of numbers and of their squares, per axis.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: DVec3,
    squares: DVec3,
}

impl Moments {
    fn add(&mut self, x: DVec3) {
        self.count += 1.0;
        self.sum += x;
        self.squares += x * x;
    }

    fn without(&self, part: &Moments) -> Moments {
        Moments { count: self.count - part.count, sum: self.sum - part.sum, squares: self.squares - part.squares }
    }

    /// The standard deviation.
    fn deviation(&self) -> DVec3 {
        let count = self.count.max(1.0);
        let mean = self.sum / count;
        (self.squares / count - mean * mean).max(DVec3::ZERO).map(f64::sqrt)
    }
}

#[cfg(test)]
mod tests {
    use super::super::spread::spread;
    use super::*;
    use crate::random::Random;

    /// Points in a cube, sixteen times sixteen leaves of them, displaced by a function of the position and a number.
    fn points(by: impl Fn(DVec3, usize, &mut Random) -> DVec3) -> Vec<Displaced> {
        let mut random = Random(3);
        let mut point = |i| {
            let at = random.vec().as_dvec3();
            Displaced { at, by: by(at, i, &mut random) }
        };
        (0..4096).map(&mut point).collect()
    }

    fn divided(points: &[Displaced]) -> Option<MotionDivision> {
        let sample: Vec<Displaced> = (0..SAMPLE).map(|i| points[spread(i, points.len())]).collect();
        MotionDivision::of(&sample, points.len(), 256)
    }

    /// The numbers of the points on both sides that are displaced forward along x, and of all on the left.
    fn forward(points: &[Displaced], division: &MotionDivision) -> [usize; 3] {
        let mut order: Vec<&Displaced> = points.iter().collect();
        order.sort_by(|a, b| division.key(a).total_cmp(&division.key(b)));
        let (low, high) = order.split_at(division.left);
        let count = |side: &[&Displaced]| side.iter().filter(|point| point.by.x > 0.0).count();
        [count(low), count(high), division.left]
    }

    #[test]
    fn flows_are_divided_from_each_other() {
        for forwards in [2, 4] {
            let way = |i: usize| if i.is_multiple_of(forwards) { DVec3::X } else { DVec3::NEG_X };
            let all = points(|_, i, _| way(i));
            let division = divided(&all).expect("two flows");
            let [low, high, left] = forward(&all, &division);
            assert!(low < left / 8 && high > (4096 - left) * 7 / 8, "{low} and {high}, {left} on the left");
            // In flows that turn, stretch and shear as well.
            let turn = |at: DVec3| DVec3::new(2.0 * at.y, at.z - 2.0 * at.x, 3.0 * at.x);
            let turned = points(|at, i, _| way(i) + turn(at));
            assert_eq!(divided(&turned).map(|division| division.left), Some(division.left));
        }
    }

    #[test]
    fn flows_cost_as_much_in_shorter_slices_until_leaves_of_all_of_them_are_small() {
        // A cube of sixteen points for each leaf, whose side is 1/6 of that of all.
        let in_leaves = |by: f64| {
            let mut random = Random(5);
            let point = |i: usize| {
                let at = DVec3::new((i / 16 % 6) as f64, (i / 96 % 6) as f64, 0.0)
                    + DVec3::from_array([0; 3].map(|_| random.unit_f64()));
                Displaced { at: at / 6.0, by: DVec3::X * by * if i.is_multiple_of(2) { 1.0 } else { -1.0 } }
            };
            (0..36 * LANES).map(point).collect::<Vec<_>>()
        };
        assert_eq!(cost_of_slices(&in_leaves(0.0), 1), 1.0);
        let costs: Vec<f64> = [1, 2, 4, 32].map(|slices| cost_of_slices(&in_leaves(1.0), slices)).to_vec();
        assert!(costs.windows(2).all(|two| two[1] < two[0]), "{costs:?}");
        // Two boxes of a sixth are a whole apart at both ends.
        assert!((3.0..5.0).contains(&costs[0]) && costs[3] < 1.15, "{costs:?}");
        let division =
            divided(&points(|_, i, _| DVec3::X * if i.is_multiple_of(2) { 1.0 } else { -1.0 })).expect("two flows");
        assert!((1.3..1.5).contains(&division.least_cost), "{}", division.least_cost);
    }

    #[test]
    fn points_are_not_divided_where_that_costs_more() {
        assert!(divided(&points(|_, _, _| DVec3::ZERO)).is_none());
        assert!(divided(&points(|_, _, random| random.vec().as_dvec3() * 0.05)).is_none());
        // Affine motion is no reason, however fast.
        assert!(divided(&points(|at, _, _| at * 50.0 + DVec3::X)).is_none());
        // Two flows that part by less than a leaf.
        assert!(divided(&points(|_, i, _| DVec3::X * 0.05 * (i % 2) as f64)).is_none());
        // Random motion over many leaves is.
        assert!(divided(&points(|_, _, random| random.vec().as_dvec3())).is_some());
    }

    #[test]
    fn points_in_one_place_or_on_a_line_have_finite_keys() {
        for along in [DVec3::ZERO, DVec3::X, DVec3::splat(1e-30), DVec3::splat(1e18)] {
            let all = points(|_, _, _| DVec3::ZERO).into_iter().enumerate();
            let moved = |(i, point): (usize, Displaced)| {
                let by = if i % 2 == 0 { DVec3::Y } else { DVec3::NEG_Y };
                Displaced { at: point.at.x * along, by }
            };
            let all: Vec<Displaced> = all.map(moved).collect();
            if let Some(division) = divided(&all) {
                assert!(all.iter().all(|point| division.key(point).is_finite()), "along {along}");
            }
        }
    }
}
