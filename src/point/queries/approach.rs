//! Closest approach: the point that comes nearest to a query that itself moves, and when.
//!
//! The picture to have in mind: relative to the query every point moves along a straight line
//! ([`super::pair_approach`]); a box has a lower bound of distance over the whole interval. Boxes are visited in the
//! order of these bounds until none can beat the best point.
//!
//! A point is evaluated for each segment between keys over its whole interval, never for a part of it, and so is a static
//! point in a structure without keys; so the answer does not depend on the structure.
//!
//! **Why no bound of a box excludes the answer.** Let u = 2^-53 and M be the largest coordinate of the query at either end.
//! - Ends of time ranges are exact as phases in a segment, also where they are keys; so a range of phases has no gap to the
//!   next segment. A step between may end an ulp early, which is less than 2u of the query's way.
//! - The fraction of the query's interval is off by at most 7u of itself. With 5u for the rest, the position of the query is
//!   within 2·7uM + 5uM = 19uM of the exact one per axis; with that end, 23uM.
//! - Faces of moving boxes are farther out than the points by 2^-24 of the sizes that are rounded there, in f32
//!   (`point/layout/linear_bounds.rs`), or by 2^-49 of the centre (`point/layout/double_box.rs`). Rounding the face itself moves it
//!   by u of the query's coordinate and of the gap.
//! - So the distance of a box is too large by less than √3·24uM < 0.5e-14 M, and a fraction 2^-50 of itself. But a distance
//!   is excluded only if it is beyond that of a point as computed, raised by 1.5e-14 M, of which 0.9e-14 remain
//!   ([`Overlap::estimate`]), and by two ulp of f32, of which one remains.
//! - The gap along one axis is wrong by less, 24uM and that fraction of itself. So it is within what is left of the distance at the
//!   time at which a point of the box comes as near as that, and what [`meet`] computes from both ends of the interval is within it
//!   then, but for the rounding of two quotients in [0, 1], 3u each.
//!
//! **Ties.** Points in a row beside the query's path are all as near. Once an exact distance is known, boxes that hold nothing
//! nearer are visited in the order of the time from which on a point may be as near ([`QueryPath::earliest`]), and not at all if
//! that is later than the best time. A box holds nothing nearer if its distance, lowered by what it may be wrong by, is above the
//! middle between the best distance and the float before it, since distances are rounded to f32 once. Its points then come as
//! near at a time at which all gaps together are within the distance that excludes points, as above; what remains of a square
//! after those of two other axes is lowered by 2^-49 of itself for rounding.

use super::pair_approach::{Overlap, QueryPath};
use crate::geometry::{Aabb, Plane, TimeInterval};
use crate::kd::KdView;
use crate::limits::MAX_POINT_COORDINATE;
use crate::point::layout::kd_points::{KdPoints, plane_error};
use crate::point::layout::over_interval::{BlockTree, BoxTree, PointPath, greater, lesser};
use crate::point::layout::slice_tree::slices_during;
use crate::point::leaf_order::segment_slice::{SegmentSlice, exact_phase, segments};
use crate::point::search::layers::Layer;
use crate::point::tree::PointTree;
use crate::primitive::Position;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};
use core::cmp::Reverse;
use core::ops::Range;
use glam::DVec3;
use std::collections::BinaryHeap;

/// The closest approach of a point to a moving query.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Approach {
    /// The point's id.
    pub id: u32,
    /// The time at which it is nearest; the first such time.
    pub time: f32,
    /// The distance at that time (not squared: the square of a very small distance underflows in f32).
    pub distance: f32,
}

impl Approach {
    /// Order of answers: nearer first, then earlier, then the lower id.
    pub(super) fn key(&self) -> (u32, u32, u32) {
        (self.distance.to_bits(), self.time.to_bits(), self.id)
    }
}

/// A point that may be the answer, judging by its distance in f64.
struct Pending {
    /// A lower bound of its distance.
    least: f64,
    point: PointPath,
    overlap: Overlap,
}

/// The state of a search.
struct Search {
    /// Points that come no nearer than this are no answers.
    most: f64,
    /// The squared distance from which on nothing is nearer than the best answer, but perhaps as near and earlier.
    tied: f64,
    /// Exact distances are expensive, and few of these points need one in the end.
    pending: Vec<Pending>,
    best: Option<Nearest>,
    /// How many nodes of boxes were visited.
    visited: usize,
}

/// The nearest point so far, its path and the segment between keys of its answer.
struct Nearest {
    answer: Approach,
    point: PointPath,
    segment: f64,
}

/// The largest number of points that wait for exact distances.
const MAX_PENDING: usize = 64;

impl Search {
    /// For points that come nearer than a distance.
    fn new(most: f64) -> Search {
        Search { most, tied: f64::INFINITY, pending: Vec::new(), best: None, visited: 0 }
    }

    /// Adds a point whose distance is known up to the slack.
    fn add(&mut self, path: &QueryPath, (about, slack): (f64, f64), point: PointPath, overlap: Overlap) {
        self.most = self.most.min(equally_near(about + slack));
        self.pending.push(Pending { least: about - slack, point, overlap });
        if self.pending.len() == MAX_PENDING {
            self.resolve(path);
        }
    }

    /// Whether a point goes the same way as the nearest one so far and has a higher id. Thousands of points may lie in one place,
    /// and their estimates exclude none of them.
    fn follows(&self, point: &PointPath, segment: f64) -> bool {
        self.best.as_ref().is_some_and(|best| {
            let way = |p: &PointPath| (p.open, p.close, p.active);
            point.id >= best.point.id && segment == best.segment && way(point) == way(&best.point)
        })
    }

    /// Computes exact distances for the pending points that may still be the answer.
    fn resolve(&mut self, path: &QueryPath) {
        let mut pending = core::mem::take(&mut self.pending);
        for Pending { least, point, overlap } in pending.drain(..) {
            let segment = overlap.segment();
            if least <= self.most && !self.follows(&point, segment) {
                let (time, distance) = overlap.closest(path, &point);
                let answer = Approach { id: point.id, time, distance };
                if self.best.as_ref().is_none_or(|best| answer.key() < best.answer.key()) {
                    self.tied = path.tied(distance);
                    self.best = Some(Nearest { answer, point, segment });
                }
            }
        }
        self.pending = pending;
    }

    /// Whether what is nearest at a time or after it is nearest later than the best answer.
    fn is_later(&self, time: f64) -> bool {
        self.best.as_ref().is_some_and(|best| time as f32 > best.answer.time)
    }
}

/// [`QueryPath::bounds`] of a node, compiled for an instruction set.
struct Bounds<'a, T> {
    path: &'a QueryPath,
    tree: &'a T,
    node: usize,
    most: f64,
}

impl<T: BoxTree> Kernel for Bounds<'_, T> {
    type Output = Lanes<f64>;
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Lanes<f64> {
        self.path.bounds(self.tree, self.node, self.most)
    }
}

/// Up to where points may be as near as a distance when both are rounded, and so have the earlier time or the lower id: an f32 ulp
/// farther, and one more.
pub(super) fn equally_near(distance: f64) -> f64 {
    distance * (1.0 + 2.0 * f64::from(f32::EPSILON)) + f64::from(f32::from_bits(1))
}

/// Whether a lower bound of squared distances excludes better answers.
#[inline(always)]
fn is_beyond(bound: f64, search: &Search) -> bool {
    bound > search.most * search.most
}

/// More than the time of a key, which a slice reaches exactly, lies beside the f32 at which the slice ends or begins.
const BESIDE_KEY: f32 = 4.0 * f32::EPSILON;

/// More than the rounding of two fractions of an interval.
const FRACTION_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// For each lane, whether there may be a time at which no gap is greater than a distance. Gaps are those below and above a box
/// along each axis, negative inside, and linear between the first and the last that are given.
#[inline(always)]
fn meet(first: [&[Lanes<f64>; 3]; 2], last: [&[Lanes<f64>; 3]; 2], most: f64) -> Lanes<bool> {
    let (mut enter, mut leave) = ([0.0; LANES], [1.0; LANES]);
    for (first, last) in first.into_iter().zip(last) {
        for axis in 0..3 {
            for lane in 0..LANES {
                let (from, to) = (first[axis][lane], last[axis][lane]);
                let crossing = (most - from) / (to - from);
                // One that is too great at both ends is so in between, which leaves no time.
                enter[lane] =
                    greater(enter[lane], if from > most { if to > most { 2.0 } else { crossing } } else { 0.0 });
                leave[lane] = lesser(leave[lane], if to > most && from <= most { crossing } else { 1.0 });
            }
        }
    }
    core::array::from_fn(|lane| enter[lane] <= leave[lane] + FRACTION_ROUNDING)
}

/// Number of equal steps of an interval over which a box is bounded separately.
const STEPS: usize = 4;

impl QueryPath {
    /// See [`Search::tied`].
    fn tied(&self, best: f32) -> f64 {
        if best == 0.0 {
            return 0.0;
        }
        let middle = 0.5 * (f64::from(best) + f64::from(best.next_down()));
        let size = self.from.abs().max(self.to.abs()).max_element();
        (middle * (1.0 + 2f64.powi(-48)) + 1.5e-14 * size).powi(2)
    }

    /// The begin and the end of the interval as phases in the segment of a time slice; exact.
    #[inline(always)]
    fn phases(&self, slice: &SegmentSlice) -> [f64; 2] {
        self.times.map(|time| exact_phase(time as f32, slice.keys, slice.segment))
    }

    /// Lower bounds of the squared distances to the points in each lane's box during the interval; NaN if nothing is
    /// active, or if the box is never within the distance `most` along all axes at once.
    ///
    /// Over each step both the box and the query move linearly, so the gap along an axis is least at an end of the step.
    /// (Plain loops over lanes, which the compiler vectorizes, with the same bits on every instruction set.)
    #[inline(always)]
    fn bounds<T: BoxTree>(&self, tree: &T, node: usize, most: f64) -> Lanes<f64> {
        let slice = tree.slice();
        let [first, last] = self.phases(&slice);
        let [begins, ends] = tree.times(node);
        let (mut begin, mut end) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let exists = begins[lane] < f32::INFINITY;
            begin[lane] = if exists { greater(slice.exact_phase(begins[lane]), first) } else { f64::INFINITY };
            end[lane] = lesser(slice.exact_phase(ends[lane]), last);
        }
        let rate = if last > first { 1.0 / (last - first) } else { 0.0 };
        let (from, displacement) = (self.from.to_array(), (self.to - self.from).to_array());
        let mut least = [f64::INFINITY; LANES];
        let (mut low_before, mut high_before) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let (mut low_at_first, mut high_at_first) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for step in 0..=STEPS {
            let fraction = step as f64 / STEPS as f64;
            let (mut passed, mut phase) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                phase[lane] = begin[lane] + (end[lane] - begin[lane]) * fraction;
                passed[lane] = (phase[lane] - first) * rate;
            }
            let [lo, hi] = tree.faces(node, &phase);
            let mut square = [0.0; LANES];
            for axis in 0..3 {
                for lane in 0..LANES {
                    let at = from[axis] + displacement[axis] * passed[lane];
                    let low = lo[axis][lane] - at;
                    let high = at - hi[axis][lane];
                    let below = lesser(low_before[axis][lane], low);
                    let above = lesser(high_before[axis][lane], high);
                    let outside = greater(greater(below, above), 0.0);
                    square[lane] += outside * outside;
                    (low_before[axis][lane], high_before[axis][lane]) = (low, high);
                }
            }
            if step > 0 {
                for lane in 0..LANES {
                    least[lane] = lesser(square[lane], least[lane]);
                }
            } else {
                (low_at_first, high_at_first) = (low_before, high_before);
            }
        }
        // A step may cross many boxes along each axis, at different times.
        let meets = meet([&low_at_first, &high_at_first], [&low_before, &high_before], most);
        core::array::from_fn(|lane| if begin[lane] <= end[lane] && meets[lane] { least[lane] } else { f64::NAN })
    }

    /// A lower bound of the time from which on a point in the box of a lane may be as near as `most`; infinite if none ever is. For
    /// boxes that [`QueryPath::bounds`] does not exclude.
    #[cold]
    fn earliest<T: BoxTree>(&self, tree: &T, node: usize, lane: usize, most: f64) -> f64 {
        let slice = tree.slice();
        let [first, last] = self.phases(&slice);
        let [begins, ends] = tree.times(node);
        let range = [greater(slice.exact_phase(begins[lane]), first), lesser(slice.exact_phase(ends[lane]), last)];
        let rate = if last > first { 1.0 / (last - first) } else { 0.0 };
        // Below and above the box, at the first and the last time.
        let gaps = range.map(|phase| {
            let [lo, hi] = tree.faces(node, &[phase; LANES]);
            let at = (self.from + (self.to - self.from) * ((phase - first) * rate)).to_array();
            [0, 1, 2].map(|axis| [lo[axis][lane] - at[axis], at[axis] - hi[axis][lane]])
        });
        let side = |axis: usize, side: usize| [gaps[0][axis][side], gaps[1][axis][side]];
        let least =
            |axis| [0, 1].iter().fold(0.0, |gap, &of| greater(gap, lesser(side(axis, of)[0], side(axis, of)[1])));
        let squares: [f64; 3] = [0, 1, 2].map(|axis| f64::powi(least(axis), 2));
        let mut enter = 0.0;
        for axis in 0..3 {
            let within = remainder(most, squares[(axis + 1) % 3] + squares[(axis + 2) % 3]);
            for [from, to] in [side(axis, 0), side(axis, 1)] {
                if from > within {
                    enter = greater(enter, if to > within { f64::INFINITY } else { (within - from) / (to - from) });
                }
            }
        }
        let phase = range[0] + (range[1] - range[0]) * (enter - FRACTION_ROUNDING);
        (phase + slice.segment as f64) / segments(slice.keys) as f64 - FRACTION_ROUNDING
    }

    /// Searches a tree of boxes.
    fn search_boxes<T: BlockTree>(&self, simd: SimdLevel, tree: &T, keep: &impl Fn(u32) -> bool, search: &mut Search) {
        let SegmentSlice { keys, segment, .. } = tree.slice();
        let segments = if keys < 2 { self.segments() } else { segment..segment + 1 };
        let (top, root) = tree.shape().root();
        // By squared distance, and the time from which on there may be points of it, where these may tie with the best answer.
        let mut open = BinaryHeap::from([Reverse((0, 0, top, root))]);
        while let Some(Reverse((bits, time, level, node))) = open.pop() {
            if is_beyond(f64::from_bits(bits), search) {
                return;
            }
            if time > 0 && search.is_later(f64::from_bits(time)) {
                continue;
            }
            search.visited += 1;
            let (first, stride) = tree.shape().children(level, node);
            let bounds = dispatch(simd, Bounds { path: self, tree, node, most: search.most });
            // Nearest leaves first: the others are then seldom visited.
            let mut lanes: [usize; LANES] = core::array::from_fn(|lane| lane);
            if level == 0 {
                lanes.sort_unstable_by_key(|&lane| bounds[lane].to_bits());
            }
            for lane in lanes {
                let (mut bound, mut time) = (bounds[lane], 0.0);
                if bound.is_nan() || is_beyond(bound, search) {
                    continue;
                }
                if bound >= search.tied {
                    (bound, time) = (search.tied, greater(self.earliest(tree, node, lane, search.most), 0.0));
                    if search.is_later(time) {
                        continue;
                    }
                }
                let child = first + lane * stride;
                if level > 0 {
                    open.push(Reverse((bound.to_bits(), time.to_bits(), level - 1, child)));
                    continue;
                }
                for block in child..child + stride {
                    for point in tree.rows(block).point_paths() {
                        self.visit_point(point, segments.clone(), keep, search);
                    }
                }
            }
        }
    }

    /// The segments between keys that the interval overlaps, if only at an end.
    fn segments(&self) -> Range<usize> {
        let segments = segments(self.keys);
        let [first, last] = self.times.map(|time| time * segments as f64);
        (first.ceil() as usize).saturating_sub(1)..(last as usize + 1).min(segments)
    }

    /// Searches a k-d tree: both sides of each plane, the nearer one first.
    fn search_kd(
        &self,
        tree: &KdPoints,
        slack: impl Fn(&KdPoints, u32, &Plane) -> f64,
        keep: &impl Fn(u32) -> bool,
        search: &mut Search,
    ) {
        let slice = &tree.slice;
        let [start, stop] = self.phases(slice);
        let (first, last) = (start.max(slice.phases[0]), stop.min(slice.phases[1]));
        if first > last {
            return;
        }
        let segments = segments(slice.keys) as f64;
        let phases: [f64; STEPS + 1] = core::array::from_fn(|i| first + (last - first) * (i as f64 / STEPS as f64));
        let times = phases.map(|phase| (phase + slice.segment as f64) / segments);
        let rate = if stop > start { 1.0 / (stop - start) } else { 0.0 };
        let query = phases.map(|phase| (self.from + (self.to - self.from) * ((phase - start) * rate)).to_array());
        let gaps = outside(&tree.bounds(), &query);
        let mut open = vec![Entry { node: 0, distance: least_square(&gaps), gaps, within: [0.0, 1.0] }];
        while let Some(Entry { node, distance, gaps, within }) = open.pop() {
            let nearest_at = first + (last - first) * (within[0] - FRACTION_ROUNDING);
            let time = (nearest_at + slice.segment as f64) / segments - FRACTION_ROUNDING;
            if is_beyond(distance, search) || distance >= search.tied && search.is_later(time) {
                continue;
            }
            match tree.node(node) {
                KdView::Leaf { first, count } => {
                    for block in first as usize..(first + count) as usize {
                        for point in tree.leaves.paths(block).point_paths() {
                            self.visit_point(point, slice.segment..slice.segment + 1, keep, search);
                        }
                    }
                }
                KdView::Inner { plane, right } => {
                    let axis = plane.axis;
                    let at = times.map(|t| f64::from(plane.position) + f64::from(plane.velocity) * t);
                    let least = |axis: usize| gaps[axis].iter().fold(f64::INFINITY, |least, &gap| lesser(gap, least));
                    let others = [1, 2].map(|next| least((axis + next) % 3));
                    let most = remainder(search.most, others[0] * others[0] + others[1] * others[1]);
                    let child = |node: u32, sign: f64| {
                        let mut gaps = gaps;
                        let slack = slack(tree, node, &plane);
                        let gap = |i: usize| sign * (at[i] - query[i][axis]) - slack;
                        for (step, least) in gaps[axis].iter_mut().enumerate() {
                            // Linear over the step, so it is least at an end.
                            *least = greater(*least, lesser(gap(step), gap(step + 1)));
                        }
                        let within = while_within(within, [gap(0), gap(STEPS)], most);
                        // The path may cross many cells along each axis, at different times.
                        let meets = within[0] <= within[1] + FRACTION_ROUNDING;
                        let distance = if meets { least_square(&gaps) } else { f64::INFINITY };
                        Entry { node, distance, gaps, within }
                    };
                    let (below, above) = (child(node + 1, -1.0), child(right, 1.0));
                    let above_first = (above.distance, above.within[0]) < (below.distance, below.within[0]);
                    open.extend(if above_first { [below, above] } else { [above, below] });
                }
            }
        }
    }

    /// Evaluates a point in some segments between keys.
    fn visit_point(&self, point: PointPath, segments: Range<usize>, keep: &impl Fn(u32) -> bool, search: &mut Search) {
        for segment in segments {
            if search.follows(&point, segment as f64) {
                continue;
            }
            let Some(overlap) = Overlap::new(self, &point, segment) else { continue };
            let (about, slack) = overlap.estimate(self, &point);
            if about - slack <= search.most && keep(point.id) {
                search.add(self, (about, slack), point, overlap);
            }
        }
    }
}

/// How far a point below a node may be outside of the half-space of the plane above the node.
///
/// The slack of the tree holds at its times. To the exact begin or end of its segment it is a float at most, in which a
/// point moves by what that slack allows for the rounding of phases; the plane moves by its error.
fn plane_slack(tree: &KdPoints, node: u32, plane: &Plane) -> f64 {
    tree.slack(node) + plane_error(plane)
}

/// A subtree of a k-d tree on the stack.
#[derive(Clone, Copy)]
struct Entry {
    node: u32,
    /// A lower bound of the squared distances of its points.
    distance: f64,
    /// Lower bounds of the distances of the query from the subtree over each step, per axis.
    gaps: [[f64; STEPS]; 3],
    /// The part of the way on which the subtree is near enough along each axis.
    within: [f64; 2],
}

/// Lower bounds of the distances of a box at rest from a query along each axis, over each step, given where the query is at the
/// ends of steps.
fn outside(cell: &Aabb, query: &[[f64; 3]; STEPS + 1]) -> [[f64; STEPS]; 3] {
    let [min, max] = [cell.min, cell.max].map(|corner| corner.to_array());
    core::array::from_fn(|axis| {
        core::array::from_fn(|step| {
            let [from, to] = [query[step][axis], query[step + 1][axis]];
            let (below, above) = (min[axis] - greater(from, to), lesser(from, to) - max[axis]);
            greater(greater(below, above), 0.0)
        })
    })
}

/// The least of the squared distances over the steps.
fn least_square(gaps: &[[f64; STEPS]; 3]) -> f64 {
    let square = |step: usize| gaps.iter().map(|gap| gap[step] * gap[step]).sum::<f64>();
    (0..STEPS).map(square).fold(f64::INFINITY, f64::min)
}

/// How far along an axis something within a distance may be if the squares along the others are at least this much.
fn remainder(most: f64, others: f64) -> f64 {
    (most * most * (1.0 + 2f64.powi(-49)) - others).max(0.0).sqrt()
}

/// The part of `[begin, end]` in which a gap that is linear over `[0, 1]` is no greater than a distance; inverted if it never is.
fn while_within([begin, end]: [f64; 2], [from, to]: [f64; 2], most: f64) -> [f64; 2] {
    let crossing = (most - from) / (to - from);
    match (from > most, to > most) {
        (false, false) => [begin, end],
        (true, false) => [greater(begin, crossing), end],
        (false, true) => [begin, lesser(end, crossing)],
        (true, true) => [f64::INFINITY, end],
    }
}

impl PointTree {
    /// The point that comes nearest to a query that moves on a straight line from `from` at the begin of
    /// `interval` to `to` at its end, and when.
    ///
    /// Times are continuous here and active intervals include both ends, because the nearest moment may be the last. (An active
    /// interval that begins or ends with the float next to a key which is no float may begin or end with the key.) Each point has a
    /// nearest moment in each segment between keys. Ties of their distances, as rounded to f32, go to the earlier time, then to the
    /// lower id. The distance is the exact one of these numbers, rounded to f32, as long as it is more than 2^-70 of the largest
    /// coordinate. The time is rounded to f32 from one in f64. Finds nothing for positions that are not finite or farther from the
    /// origin than [`MAX_POINT_COORDINATE`]. In periodic boxes:
    /// [`PeriodicPoints::closest_approach`](crate::PeriodicPoints::closest_approach). Cost: 3 to 16 microseconds among points that
    /// move little, some dozens if they move far across each other. Of points that come equally near, as those of a row beside the
    /// query's path do, only the first are compared if the row goes along an axis, and all if it goes askew.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::X, -Vec3::X), MovingPoint::fixed(Vec3::Y * 3.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let up = tree.closest_approach(Vec3::ZERO, Vec3::Y * 2.0, TimeInterval::FULL).unwrap();
    /// assert_eq!(up.id, 0);
    /// assert!((up.time - 0.25).abs() < 1e-6 && (up.distance - 0.5f32.sqrt()).abs() < 1e-6);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn closest_approach<Q: Position>(&self, from: Q, to: Q, interval: TimeInterval) -> Option<Approach> {
        self.closest_approach_filtered(from, to, interval, |_| true)
    }

    /// The same among the points whose id the predicate returns true for. It must be pure.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::X, -Vec3::X), MovingPoint::fixed(Vec3::Y * 3.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let (own, interval) = (0, TimeInterval::FULL);
    /// let other = tree.closest_approach_filtered(Vec3::X, -Vec3::X, interval, |id| id != own).unwrap();
    /// assert_eq!((other.id, other.time, other.distance), (1, 0.5, 3.0));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn closest_approach_filtered<Q: Position>(
        &self,
        from: Q,
        to: Q,
        interval: TimeInterval,
        keep: impl Fn(u32) -> bool,
    ) -> Option<Approach> {
        self.approach_within([from, to], interval, f64::INFINITY, &keep)
    }

    /// The same among points that come as near as a distance. Finds others only if there are none of these.
    pub(super) fn approach_within<Q: Position>(
        &self,
        [from, to]: [Q; 2],
        interval: TimeInterval,
        most: f64,
        keep: &impl Fn(u32) -> bool,
    ) -> Option<Approach> {
        let relative = [from, to].map(|p| p.relative(self.origin).as_dvec3());
        // Also false for NaN.
        let valid = |p: DVec3| p.abs().cmple(DVec3::splat(MAX_POINT_COORDINATE)).all();
        if !relative.into_iter().all(valid) {
            return None;
        }
        let times = [interval.begin().into(), interval.end().into()];
        let keys = self.keys();
        let [from, to] = if self.is_double() { [from.wide(), to.wide()] } else { relative };
        let path = QueryPath { from, to, times, keys };
        let mut search = Search::new(most);
        let around = [interval.begin() - BESIDE_KEY, interval.end() + BESIDE_KEY];
        for layer in &self.layers {
            match layer {
                Layer::Static(tree) => path.search_boxes(self.simd, tree, keep, &mut search),
                Layer::Moving(trees) => slices_during(trees, around)
                    .iter()
                    .for_each(|tree| path.search_boxes(self.simd, tree, keep, &mut search)),
                Layer::Kd(trees) => slices_during(trees, around)
                    .iter()
                    .for_each(|tree| path.search_kd(tree, plane_slack, keep, &mut search)),
                Layer::Double(trees) => slices_during(trees, around)
                    .iter()
                    .for_each(|tree| path.search_boxes(self.simd, tree, keep, &mut search)),
            }
        }
        search.resolve(&path);
        search.best.map(|best| best.answer)
    }
}

#[cfg(test)]
mod tests;
