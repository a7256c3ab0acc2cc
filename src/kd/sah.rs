//! Choosing the split plane: the surface area heuristic at plane time, with time-weighted counts
//! (section 3.1.1 of the paper).
//!
//! The cost of a plane is `K_T + K_I / SA(N) * (L * SA(left) + R * SA(right))`, the areas being those of the
//! cells at plane time. `L` is the sum, over the contributing references, of the time each spends left of the plane
//! (`t_c2 - t_0` in the paper). Take one reference with the lower bound moving from `l0` to `l1`: as a
//! function of the plane's position `s` this time is a ramp, 0 up to `min(l0, l1)`, the whole duration from
//! `max(l0, l1)` on, linear between. A sum of ramps is kept as steps and slopes per bin, so that all
//! planes of all axes are evaluated in two passes over the references: O(n) per node, O(n log n) for the tree.
//! Binning was preferred to sorted events because ramps make twice the events and because
//! references that move do not keep one sorted order during the shutter.

use super::reference::Reference;
use crate::geometry::{Box3, LinearBox3, Plane, TimeInterval};
use crate::params::KdParams;
use glam::{DVec3, Vec3};

/// The bounds of a primitive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// During the interval (the whole primitive, not clipped to the cell).
    pub whole: LinearBox3,
    /// Clipped to the node's cell, at its representative time (see [`Reference::representative_time`]).
    pub clipped: Box3,
}

/// A reference of a primitive.
pub(crate) type BoxReference = Reference<Bounds>;

/// It must stay small: it is copied at every level.
const _: () = assert!(size_of::<BoxReference>() <= 88);

/// Bins per axis, fewer than 256.
const BINS: usize = 32;
/// Candidate planes per axis: the bins' edges.
const EDGES: usize = BINS + 1;
/// The distance of a plane that cuts off empty space from the outermost clipped bounds, in tree space: rays
/// that graze the primitives then need not visit the empty side.
const MARGIN: f32 = 1e-5;
/// The distance is at most this fraction of the extent of all of them, or small objects would have large cells.
const MARGIN_OF_SIZE: f32 = 0.01;
/// And at least this fraction of the largest coordinate, so that no primitive lies in the plane.
const LEAST_MARGIN: f32 = 1e-6;

/// A plane and its cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Split {
    pub plane: Plane,
    pub cost: f64,
}

/// The weight of a reference.
pub(crate) fn weight(reference: &BoxReference, params: &KdParams) -> f64 {
    if params.time_weighted { f64::from(reference.interval.duration()) } else { 1.0 }
}

/// The cost of a leaf with the given sum of weights.
pub(crate) fn leaf_cost(weight: f64, params: &KdParams) -> f64 {
    f64::from(params.intersection_cost) * weight
}

/// The cheapest plane through a cell (given at plane time), if there is any candidate. The clipped bounds of the contributing
/// references are those at their `representative` time.
pub(crate) fn best_split(
    references: &[BoxReference],
    cell: Box3,
    params: &KdParams,
    representative: impl Fn(TimeInterval) -> f32,
) -> Option<Split> {
    let span = Span::of(references);
    let (low, high) = (span.low.max(cell.min), span.high.min(cell.max));
    let velocity = if params.moving_planes { span.mean_velocity() } else { Vec3::ZERO };
    let least = LEAST_MARGIN * low.abs().max(high.abs()).max_element();
    let margin = MARGIN.min(MARGIN_OF_SIZE * (high - low).max_element()).max(least);
    let sweep = |axis: usize| Sweep::new(low[axis], high[axis], margin);
    let mut fixed = [0, 1, 2].map(sweep);
    let mut moving = [0, 1, 2].map(|axis| (velocity[axis] != 0.0).then(|| sweep(axis)));
    let mut total = 0.0;
    for r in references.iter().filter(|r| r.in_sah) {
        let weight = weight(r, params);
        total += weight;
        let Lines { lower, upper } = lines(r, representative(r.interval));
        let since = [r.interval.begin(), r.interval.end()].map(|t| t - params.plane_time);
        for axis in 0..3 {
            let (lower, upper) = (lower.map(|p| p[axis]), upper.map(|p| p[axis]));
            fixed[axis].add(lower, upper, weight, params.time_weighted);
            if let Some(sweep) = &mut moving[axis] {
                let [s0, s1] = since.map(|t| velocity[axis] * t);
                let ([l0, l1], [u0, u1]) = (lower, upper);
                sweep.add([l0 - s0, l1 - s1], [u0 - s0, u1 - s1], weight, params.time_weighted);
            }
        }
    }
    let mut best: Option<Split> = None;
    for axis in 0..3 {
        for (sweep, velocity) in [(Some(&fixed[axis]), 0.0), (moving[axis].as_ref(), velocity[axis])] {
            if let Some((at, cost)) = sweep.and_then(|sweep| sweep.cheapest(axis, cell, total, params))
                && best.is_none_or(|b| cost < b.cost)
            {
                let position = at - velocity * params.plane_time;
                best = Some(Split { plane: Plane { axis, position, velocity }, cost });
            }
        }
    }
    best
}

/// The extent of the clipped bounds of the contributing references, and their motion.
struct Span {
    low: Vec3,
    high: Vec3,
    /// The sums of the displacements of their centres, and of their durations.
    displacement: DVec3,
    time: f64,
}

impl Span {
    fn of(references: &[BoxReference]) -> Span {
        let mut span = Span { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, displacement: DVec3::ZERO, time: 0.0 };
        for r in references.iter().filter(|r| r.in_sah) {
            span.low = span.low.min(r.bounds.clipped.min);
            span.high = span.high.max(r.bounds.clipped.max);
            let (b, e) = (r.bounds.whole.begin, r.bounds.whole.end);
            span.displacement += ((e.min - b.min) + (e.max - b.max)).as_dvec3() * 0.5;
            span.time += f64::from(r.interval.duration());
        }
        span
    }

    /// The mean velocity of the references, weighted by duration.
    fn mean_velocity(&self) -> Vec3 {
        if self.time > 0.0 {
            (self.displacement / self.time).as_vec3().clamp(Vec3::splat(-4.0), Vec3::splat(4.0))
        } else {
            Vec3::ZERO
        }
    }
}

/// The candidate planes of one axis, evenly spaced over the extent of the clipped bounds of the references.
struct Edges {
    low: f32,
    width: f32,
    scale: f32,
    /// The distance of the first and the last from the extent.
    margin: f32,
}

impl Edges {
    fn new(low: f32, high: f32, margin: f32) -> Edges {
        let width = (high - low) / BINS as f32;
        Edges { low, width, scale: if width > 0.0 { 1.0 / width } else { 0.0 }, margin }
    }

    fn position(&self, k: usize) -> f32 {
        match k {
            0 => self.low - self.margin,
            BINS => self.low + self.width * BINS as f32 + self.margin,
            _ => self.low + self.width * k as f32,
        }
    }

    /// The first edge beyond `x`; [`BINS`] if there is none.
    #[inline(always)]
    fn beyond(&self, x: f32) -> usize {
        // Saturates, in few instructions for a type this small: NaN is 0.
        if x < self.low { 0 } else { usize::from(((x - self.low) * self.scale) as u8).min(BINS - 1) + 1 }
    }
}

/// The change of the sums at an edge: from there on a sum is larger by a step, and rises by a slope per unit of position.
/// There are two sums: of the times left of a plane, and of those not right of it.
type Change = [f64; 4];

/// The indices of the two sums in a [`Change`].
const LEFT: usize = 0;
const RIGHT: usize = 2;

/// Sums over the references for all planes of one axis that move with the same velocity.
struct Sweep {
    edges: Edges,
    changes: [Change; EDGES],
}

impl Sweep {
    fn new(low: f32, high: f32, margin: f32) -> Sweep {
        Sweep { edges: Edges::new(low, high, margin), changes: [[0.0; 4]; EDGES] }
    }

    /// Adds a reference with a lower and an upper bound at the begin and end of its interval.
    #[inline(always)]
    fn add(&mut self, lower: [f32; 2], upper: [f32; 2], weight: f64, time_weighted: bool) {
        let (l_min, l_max) = (lower[0].min(lower[1]), lower[0].max(lower[1]));
        let (u_min, u_max) = (upper[0].min(upper[1]), upper[0].max(upper[1]));
        if time_weighted {
            self.ramp::<LEFT>(l_min, l_max, weight);
            self.ramp::<RIGHT>(u_min, u_max, weight);
        } else {
            self.changes[self.edges.beyond(l_min)][LEFT] += weight;
            self.changes[self.edges.beyond(u_max)][RIGHT] += weight;
        }
    }

    /// Adds a ramp from 0 at `from` to `height` at `to`.
    #[inline(always)]
    fn ramp<const SUM: usize>(&mut self, from: f32, to: f32, height: f64) {
        let full = self.edges.beyond(to);
        let first = if from == to { full } else { self.edges.beyond(from) };
        if first >= full {
            self.changes[full][SUM] += height;
            return;
        }
        let (from, to) = (f64::from(from), f64::from(to));
        let slope = height / (to - from);
        self.changes[first][SUM + 1] += slope;
        self.changes[first][SUM] -= slope * from;
        self.changes[full][SUM + 1] -= slope;
        self.changes[full][SUM] += slope * from + height;
    }

    /// The position of the cheapest plane within a cell at plane time, and its cost; `total` is the weight of all references.
    fn cheapest(&self, axis: usize, cell: Box3, total: f64, params: &KdParams) -> Option<(f32, f64)> {
        match axis {
            0 => self.cheapest_along::<0>(cell, total, params),
            1 => self.cheapest_along::<1>(cell, total, params),
            _ => self.cheapest_along::<2>(cell, total, params),
        }
    }

    /// The same for an axis known at compile time, which is vectorized over planes.
    fn cheapest_along<const AXIS: usize>(&self, cell: Box3, total: f64, params: &KdParams) -> Option<(f32, f64)> {
        let mut at = [0.0f32; EDGES];
        let (mut left, mut right) = ([0.0f64; EDGES], [0.0f64; EDGES]);
        let mut sums: Change = [0.0; 4];
        for k in 0..EDGES {
            for (sum, change) in sums.iter_mut().zip(self.changes[k]) {
                *sum += change;
            }
            at[k] = self.edges.position(k);
            let s = f64::from(at[k]);
            left[k] = sums[LEFT] + sums[LEFT + 1] * s;
            right[k] = total - (sums[RIGHT] + sums[RIGHT + 1] * s);
        }
        let size = cell.max - cell.min;
        let half_area = |along: f32| {
            let mut size = size;
            size[AXIS] = along;
            f64::from(Box3 { min: Vec3::ZERO, max: size }.half_area())
        };
        let full = f64::from(cell.half_area());
        let (traversal, intersection) = (f64::from(params.traversal_cost), f64::from(params.intersection_cost));
        let (least, empty_factor) = (1e-9 * total, f64::from(params.empty_factor));
        let mut costs = [0.0f64; EDGES];
        for k in 0..EDGES {
            let clean = |x: f64| if x < least { 0.0 } else { x };
            let (l, r) = (clean(left[k]), clean(right[k]));
            let (below, above) = (half_area(at[k] - cell.min[AXIS]), half_area(cell.max[AXIS] - at[k]));
            let cost = traversal + intersection * (l * below + r * above) / full;
            costs[k] = if (l == 0.0) | (r == 0.0) { cost * empty_factor } else { cost };
        }
        let mut best: Option<(f32, f64)> = None;
        for (at, cost) in at.into_iter().zip(costs) {
            if cell.min[AXIS] < at && at < cell.max[AXIS] && best.is_none_or(|(_, least)| cost < least) {
                best = Some((at, cost));
            }
        }
        best
    }
}

/// Bounds at the begin and end of an interval.
struct Lines {
    lower: [Vec3; 2],
    upper: [Vec3; 2],
}

/// The bounds of a reference, shrunk to the clipped ones at its representative time `time`.
#[inline(always)]
fn lines(r: &BoxReference, time: f32) -> Lines {
    let (begin, end) = (r.interval.begin(), r.interval.end());
    let w = if end > begin { (time - begin) / (end - begin) } else { 0.0 };
    let (b, e) = (r.bounds.whole.begin, r.bounds.whole.end);
    // The difference between the clipped bounds and those of the whole primitive, at the representative time.
    let raise = r.bounds.clipped.min - (b.min + (e.min - b.min) * w);
    let lower = r.bounds.clipped.max - (b.max + (e.max - b.max) * w);
    Lines { lower: [b.min + raise, e.min + raise], upper: [b.max + lower, e.max + lower] }
}
