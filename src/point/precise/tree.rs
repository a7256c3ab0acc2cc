//! The tree over f64 points for a part of the shutter, as searches see it.
//!
//! **Why no search ever loses a neighbour.** Let `q` be the query and `m` the middle of a node at the query's time, both
//! in f64. The boxes of the node are relative to `m`; the query is so only up to rounding: `from = q − m` is within
//! 2^-23 of itself and the node's slack of the exact difference, in f32 as well. So the query is taken as
//! the interval `from ± (2^-22 |from| + slack)`, and the gap between it and the box is, as computed, at most the exact
//! gap times 1 + 2^-24 and less than it by at least 1e-22. The sum of squares is rounded five times, then multiplied by
//! 1 − 2^-21: it is at most the exact squared distance of any point in the box times 1 − 2^-22 (where squares underflow,
//! the 1e-22 make up for it), which is less than the point's squared distance as computed in f64. And rounding that to
//! f32 is monotone. So the distance of the box is never above that of a point in it.

use super::hull::Middle;
use crate::geometry::TimeInterval;
use crate::point::moving_leaf::Times;
use crate::point::moving_reference::{Part, exact_phase};
use crate::point::over_interval::{Boxed, Flight};
use crate::point::snapshot::{Boxes, Leaves, Target, View, diagonal, rows, squared};
use crate::point::static_tree::Shape;
use crate::simd::{LANES, Lanes, Mask, Simd, prefetch};
use glam::{DVec3, Vec3};

/// Coordinates of sixteen points, in rows.
pub(super) type Rows = [Lanes<f64>; 3];

/// Where absent points are: every squared distance to there is infinite in f32.
pub(super) const ABSENT: f64 = 1e150;

/// Relative width of the interval around a query in f32.
const AROUND: f64 = 1.0 / 4_194_304.0;

/// What squared distances of boxes are multiplied by.
const LESS: f32 = 1.0 - 1.0 / 2_097_152.0;

/// Points given in f64, in a complete 16-ary tree for one part of the shutter.
#[derive(Clone)]
pub(in crate::point) struct PreciseTree {
    pub(super) part: Part,
    pub(super) shape: Shape,
    /// Boxes at the begin of the part, relative to the middles.
    pub(super) nodes: Vec<Boxes>,
    /// How far they move until its end; empty where nothing moves.
    pub(super) slopes: Vec<Boxes>,
    pub(super) middles: Vec<Middle>,
    /// Positions at the earlier key of the segment.
    pub(super) begins: Vec<Rows>,
    /// At the later one; empty where nothing moves.
    pub(super) ends: Vec<Rows>,
    pub(super) ids: Vec<Lanes<u32>>,
    /// When nodes and points count; empty where all count throughout.
    pub(super) node_times: Vec<Times>,
    pub(super) block_times: Vec<Times>,
    /// Whole lives of the points; empty where all live throughout.
    pub(super) lives: Vec<Times>,
    pub(super) references: usize,
}

/// The position at a phase between two keys, from the nearer one.
#[inline(always)]
pub(super) fn between([a, b]: [DVec3; 2], phase: f64) -> DVec3 {
    let (s, from_end) = nearer(phase);
    (if from_end { b } else { a }) + (b - a) * s
}

/// The step from the nearer key, and whether that is the later one.
#[inline(always)]
fn nearer(phase: f64) -> (f64, bool) {
    if phase < 0.5 { (phase, false) } else { (phase - 1.0, true) }
}

impl PreciseTree {
    /// The part of the shutter it answers for.
    pub(in crate::point) fn part(&self) -> &Part {
        &self.part
    }

    /// Whether it is for points that move or live for a while.
    pub(in crate::point) fn moves(&self) -> bool {
        !self.slopes.is_empty()
    }

    /// Bytes allocated.
    pub(in crate::point) fn bytes(&self) -> usize {
        (self.nodes.capacity() + self.slopes.capacity()) * size_of::<Boxes>()
            + self.middles.capacity() * size_of::<Middle>()
            + (self.begins.capacity() + self.ends.capacity()) * size_of::<Rows>()
            + self.ids.capacity() * size_of::<Lanes<u32>>()
            + (self.node_times.capacity() + self.block_times.capacity() + self.lives.capacity()) * size_of::<Times>()
    }

    /// Number of points in it.
    pub(in crate::point) fn references(&self) -> usize {
        self.references
    }

    /// Number of nodes.
    pub(in crate::point) fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Number of levels of nodes.
    pub(in crate::point) fn levels(&self) -> usize {
        self.shape.levels
    }

    /// Where a time lies between the keys; exact.
    #[inline(always)]
    fn phase_at(&self, time: f32) -> f64 {
        let Part { keys, segment, phases: [begin, end], .. } = self.part;
        exact_phase(time, keys, segment).clamp(begin, end)
    }

    /// Where a phase between the keys lies in the part, in [0, 1].
    #[inline(always)]
    fn within(&self, phase: f64) -> f64 {
        let [begin, end] = self.part.phases;
        if end > begin { ((phase - begin) / (end - begin)).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The tree at a time, which lies in its part, asked from a place.
    #[inline(always)]
    pub(in crate::point) fn at<const MOVING: bool>(&self, query: DVec3, time: f32) -> PreciseView<'_, MOVING> {
        let phase = if MOVING { self.phase_at(time) } else { 0.0 };
        let (step, from_end) = nearer(phase);
        let within = if MOVING { self.within(phase) } else { 0.0 };
        PreciseView { tree: self, query: query.to_array(), time, within, step, from_end }
    }
}

/// A tree at a time, asked from a place.
#[derive(Clone, Copy)]
pub(in crate::point) struct PreciseView<'a, const MOVING: bool> {
    tree: &'a PreciseTree,
    query: [f64; 3],
    time: f32,
    /// Where the time lies in the part.
    within: f64,
    /// Step from the nearer key.
    step: f64,
    from_end: bool,
}

impl<const MOVING: bool> PreciseView<'_, MOVING> {
    /// Faces relative to the middle.
    #[inline(always)]
    fn relative<S: Simd>(&self, s: S, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let boxes = &self.tree.nodes[node];
        let (lo, hi) = (rows(s, &boxes.lo), rows(s, &boxes.hi));
        if !MOVING {
            return (lo, hi);
        }
        let (slopes, w) = (&self.tree.slopes[node], s.splat(self.within as f32));
        let ([ax, ay, az], [bx, by, bz]) = (rows(s, &slopes.lo), rows(s, &slopes.hi));
        ([lo[0] + ax * w, lo[1] + ay * w, lo[2] + az * w], [hi[0] + bx * w, hi[1] + by * w, hi[2] + bz * w])
    }

    /// The middle of a node at the time.
    #[inline(always)]
    fn middle(&self, node: usize) -> [f64; 3] {
        let Middle { at, way, .. } = &self.tree.middles[node];
        if !MOVING {
            return *at;
        }
        let w = self.within;
        [at[0] + way[0] * w, at[1] + way[1] * w, at[2] + way[2] * w]
    }

    /// The query relative to the middle of a node, as an interval for each axis.
    #[inline(always)]
    fn around(&self, node: usize) -> ([f32; 3], [f32; 3]) {
        let middle = self.middle(node);
        let slack = self.tree.middles[node].slack;
        let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let from = self.query[axis] - middle[axis];
            let slack = from.abs() * AROUND + slack;
            (low[axis], high[axis]) = ((from - slack) as f32, (from + slack) as f32);
        }
        (low, high)
    }

    /// Lanes of a row of times that count.
    #[inline(always)]
    fn counting<S: Simd>(&self, s: S, times: &[Times], at: usize) -> Mask {
        if times.is_empty() { Mask::MAX } else { times[at].counting(s, s.splat(self.time)) }
    }

    /// A coordinate of the points of a block.
    #[inline(always)]
    fn coordinate(&self, block: usize, axis: usize) -> Lanes<f64> {
        let begin = &self.tree.begins[block][axis];
        if !MOVING {
            return *begin;
        }
        let end = &self.tree.ends[block][axis];
        let base = if self.from_end { end } else { begin };
        let mut at = [0.0; LANES];
        for lane in 0..LANES {
            at[lane] = base[lane] + (end[lane] - begin[lane]) * self.step;
        }
        at
    }
}

impl<const MOVING: bool> Leaves for PreciseView<'_, MOVING> {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        1
    }
    /// The place of the query is known to the view, in f64.
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, _: Vec3) -> Target<S> {
        Target::still(s, Vec3::ZERO)
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, _: &Target<S>, block: usize) -> S::F {
        let (x, y, z) = (self.coordinate(block, 0), self.coordinate(block, 1), self.coordinate(block, 2));
        let [qx, qy, qz] = self.query;
        let mut distances = [0.0; LANES];
        for lane in 0..LANES {
            let (dx, dy, dz) = (x[lane] - qx, y[lane] - qy, z[lane] - qz);
            distances[lane] = ((dx * dx + dy * dy) + dz * dz) as f32;
        }
        let distances = s.load(&distances);
        if !MOVING || self.tree.block_times.is_empty() {
            return distances;
        }
        s.select(self.counting(s, &self.tree.block_times, block), distances, s.splat(f32::INFINITY))
    }
    #[inline(always)]
    fn expect_leaf(&self, block: usize) {
        if let Some(rows) = self.tree.begins.get(block) {
            prefetch(rows);
            if MOVING {
                prefetch(&self.tree.ends[block]);
            }
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        (self.tree.begins.len() + self.tree.ends.len()) * size_of::<Rows>()
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.tree.ids[block]
    }
}

impl<const MOVING: bool> View for PreciseView<'_, MOVING> {
    const BALL: f32 = if MOVING { 0.14 } else { 0.18 };

    #[inline(always)]
    fn root(&self) -> (usize, usize) {
        (self.tree.shape.levels - 1, self.tree.nodes.len() - 1)
    }
    #[inline(always)]
    fn first_child(&self, level: usize, node: usize) -> usize {
        let begin = &self.tree.shape.begin;
        begin[level - 1] + (node - begin[level]) * LANES
    }
    #[inline(always)]
    fn first_block(&self, node: usize) -> usize {
        node * LANES
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, _: &Target<S>, node: usize) -> (S::F, Mask) {
        let (lo, hi) = self.relative(s, node);
        let (low, high) = self.around(node);
        // No closure: it might not be inlined.
        let x = s.max_with_zero(lo[0] - s.splat(high[0]), s.splat(low[0]) - hi[0]);
        let y = s.max_with_zero(lo[1] - s.splat(high[1]), s.splat(low[1]) - hi[1]);
        let z = s.max_with_zero(lo[2] - s.splat(high[2]), s.splat(low[2]) - hi[2]);
        let widest = s.max_signed(s.max_signed(x, y), z);
        let holding = s.le_signed(widest, s.splat(0.0));
        let distances = squared::<S>(x, y, z) * s.splat(LESS);
        if !MOVING || self.tree.node_times.is_empty() {
            return (distances, holding);
        }
        let counting = self.counting(s, &self.tree.node_times, node);
        (s.select(counting, distances, s.splat(f32::INFINITY)), holding & counting)
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, _: &Target<S>, node: usize) -> S::F {
        let (lo, hi) = self.relative(s, node);
        diagonal::<S>(lo, hi)
    }
    #[inline(always)]
    fn expect_node(&self, node: usize) {
        prefetch(&self.tree.nodes[node]);
        prefetch(&self.tree.middles[node]);
        if MOVING {
            prefetch(&self.tree.slopes[node]);
        }
    }
}

impl Boxed for PreciseTree {
    /// Times are off by 2^-53 of the shutter at most.
    const SLACK: [f64; 2] = [1e-14, 1e-14];

    fn part(&self) -> (usize, usize, [f64; 2]) {
        let segments = (self.part.keys.max(2) - 1) as f64;
        let times = self.part.phases.map(|phase| (phase + self.part.segment as f64) / segments);
        (self.part.keys, self.part.segment, times)
    }
    fn top(&self) -> (usize, usize) {
        (self.shape.levels - 1, self.nodes.len() - 1)
    }
    fn behind(&self, level: usize, node: usize) -> (usize, usize) {
        let begin = &self.shape.begin;
        (if level == 0 { node * LANES } else { begin[level - 1] + (node - begin[level]) * LANES }, 1)
    }
    fn times(&self, node: usize) -> [Lanes<f64>; 2] {
        // What counts from the begin of the part does so from its exact begin on, likewise at the end.
        let (_, _, [first, last]) = Boxed::part(self);
        let interval = self.part.interval;
        let Some(times) = self.node_times.get(node) else {
            return [
                self.nodes[node].lo[0].map(|x| if x < f32::INFINITY { first } else { f64::INFINITY }),
                [last; LANES],
            ];
        };
        [
            times.begin.map(|t| if t <= interval.begin() { first } else { t.into() }),
            times.end.map(|t| if t >= interval.end_bound() { last } else { t.into() }),
        ]
    }
    #[inline(always)]
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let (boxes, slopes, middle) = (&self.nodes[node], self.slopes.get(node), &self.middles[node]);
        let w = phase.map(|phase| self.within(phase));
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (number, (faces, boxes)) in faces.iter_mut().zip([&boxes.lo, &boxes.hi]).enumerate() {
            for axis in 0..3 {
                for lane in 0..LANES {
                    let slope = slopes.map_or(0.0, |slopes| [&slopes.lo, &slopes.hi][number][axis][lane]);
                    let place = middle.at[axis] + middle.way[axis] * w[lane];
                    faces[axis][lane] = place + (f64::from(boxes[axis][lane]) + f64::from(slope) * w[lane]);
                }
            }
        }
        faces
    }
    fn counts(&self, block: usize, lane: usize, time: f32) -> bool {
        self.block_times.get(block).is_none_or(|times| times.begin[lane] <= time && time < times.end[lane])
    }
    fn flight(&self, block: usize, lane: usize) -> Option<Flight> {
        let id = self.ids.get(block)?[lane];
        let life = self.lives.get(block).map(|t| TimeInterval::half_open(t.begin[lane], t.end[lane]));
        let life = life.unwrap_or(Some(TimeInterval::FULL))?;
        let open = self.begins[block].map(|row| row[lane]);
        let close = self.ends.get(block).map_or(open, |rows| rows.map(|row| row[lane]));
        (id != u32::MAX).then_some(Flight { id, open, close, life })
    }
    fn phase(&self, time: f32) -> f64 {
        self.phase_at(time)
    }
    fn position(&self, flight: &Flight, time: f32) -> DVec3 {
        between([flight.open, flight.close].map(DVec3::from_array), self.phase_at(time))
    }
}
