//! Choosing the split plane: the surface area heuristic at plane time, with time-weighted counts
//! (section 3.1.1 of the paper).
//!
//! The cost of a plane is `K_T + K_I / SA(N) * (L * SA(left) + R * SA(right))`, the areas being those of the
//! cells at plane time. `L` is the sum, over the voting references, of the time each spends left of the plane
//! (`t_c2 - t_0` in the paper). Take one reference with the lower bound moving from `l0` to `l1`: as a
//! function of the plane's position `s` this time is a ramp, 0 up to `min(l0, l1)`, the whole duration from
//! `max(l0, l1)` on, linear between. A sum of ramps is kept as steps and slopes per bin, so that all
//! planes of an axis are priced in one pass over the references: O(n) per node, O(n log n) for the tree.
//! Binning was preferred to sorted events because ramps make twice the events and because
//! references that move do not keep one sorted order during the shutter.

use super::reference::Reference;
use crate::geometry::{Box3, LinearBox3, Plane, TimeInterval};
use crate::params::KdParams;

/// Where a primitive is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// During the interval (the whole primitive, not only its part in the cell).
    pub whole: LinearBox3,
    /// Its part in the node's cell at its voting time (of a Normal reference: [`Reference::home`]).
    pub part: Box3,
}

/// A reference of a primitive.
pub(crate) type BoxReference = Reference<Bounds>;

/// Keeps it small: it is copied at every level.
const _: () = assert!(size_of::<BoxReference>() <= 88);

/// Bins per axis.
const BINS: usize = 32;
/// Candidate planes per axis: the bins' edges.
const EDGES: usize = BINS + 1;
/// How far beyond the outermost part a plane that cuts off empty space stands, in tree space: rays
/// that graze the parts then need not visit the empty side.
const MARGIN: f32 = 1e-5;

/// A plane and its cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Split {
    pub plane: Plane,
    pub cost: f64,
}

/// How much a reference counts.
pub(crate) fn weight(reference: &BoxReference, params: &KdParams) -> f64 {
    if params.time_weighted { f64::from(reference.interval.duration()) } else { 1.0 }
}

/// The cost of a leaf with the given sum of weights.
pub(crate) fn leaf_cost(weight: f64, params: &KdParams) -> f64 {
    f64::from(params.intersection_cost) * weight
}

/// The cheapest plane through a cell (given at plane time), if there is any candidate. The parts of the voters are those
/// at the time of their interval that `voting_time` names.
pub(crate) fn best_split(
    references: &[BoxReference],
    cell: Box3,
    params: &KdParams,
    voting_time: impl Fn(TimeInterval) -> f32 + Copy,
) -> Option<Split> {
    let mut best: Option<Split> = None;
    for axis in 0..3 {
        let mut consider = |velocity: f32| {
            if let Some(split) = best_on_axis(references, cell, axis, velocity, params, voting_time)
                && best.is_none_or(|b| split.cost < b.cost)
            {
                best = Some(split);
            }
        };
        consider(0.0);
        if params.moving_planes {
            let velocity = mean_velocity(references, axis);
            if velocity != 0.0 {
                consider(velocity);
            }
        }
    }
    best
}

/// The mean velocity of the voters along an axis, weighted by the time they live.
fn mean_velocity(references: &[BoxReference], axis: usize) -> f32 {
    let (mut way, mut time) = (0.0f64, 0.0f64);
    for r in references.iter().filter(|r| r.votes) {
        let (b, e) = (r.bounds.whole.begin, r.bounds.whole.end);
        way += f64::from((e.min[axis] - b.min[axis]) + (e.max[axis] - b.max[axis])) * 0.5;
        time += f64::from(r.interval.duration());
    }
    if time > 0.0 { ((way / time) as f32).clamp(-4.0, 4.0) } else { 0.0 }
}

/// A sum of steps and ramps over the edges of one axis.
struct Ramps {
    /// At edge `k` the sum so far jumps by this.
    step: [f64; EDGES + 1],
    /// From edge `k` on it also rises by this per unit of position.
    slope: [f64; EDGES + 1],
}

impl Ramps {
    const ZERO: Ramps = Ramps { step: [0.0; EDGES + 1], slope: [0.0; EDGES + 1] };

    /// Adds a ramp from 0 at `from` to `height` at `to`; `first` and `full` are the first edges beyond each.
    #[inline]
    fn add(&mut self, from: f32, to: f32, first: usize, full: usize, height: f64) {
        if first >= full {
            self.step[full] += height;
            return;
        }
        let (from, to) = (f64::from(from), f64::from(to));
        let slope = height / (to - from);
        self.slope[first] += slope;
        self.step[first] -= slope * from;
        self.slope[full] -= slope;
        self.step[full] += slope * from + height;
    }
}

/// The candidate planes of one axis, evenly spaced over what the parts of the references cover.
struct Edges {
    low: f32,
    width: f32,
    scale: f32,
}

impl Edges {
    fn new(low: f32, high: f32) -> Edges {
        let width = (high - low) / BINS as f32;
        Edges { low, width, scale: if width > 0.0 { 1.0 / width } else { 0.0 } }
    }

    fn position(&self, k: usize) -> f32 {
        match k {
            0 => self.low - MARGIN,
            BINS => self.low + self.width * BINS as f32 + MARGIN,
            _ => self.low + self.width * k as f32,
        }
    }

    /// The first edge beyond `x`; EDGES for none.
    #[inline]
    fn beyond(&self, x: f32) -> usize {
        // Saturates: below the first edge 0, NaN 0.
        if x < self.low { 0 } else { (((x - self.low) * self.scale) as usize).min(BINS - 1) + 1 }
    }
}

/// Lower and upper bound of a reference at the begin and end of its interval in the frame of a plane that moves
/// with `velocity`, shrunk to its part in the cell at time `voted`.
#[inline]
fn lines(r: &BoxReference, axis: usize, velocity: f32, plane_time: f32, voted: f32) -> ([f32; 2], [f32; 2]) {
    let (begin, end) = (r.interval.begin(), r.interval.end());
    let w = if end > begin { (voted - begin) / (end - begin) } else { 0.0 };
    let (l0, l1) = (r.bounds.whole.begin.min[axis], r.bounds.whole.end.min[axis]);
    let (u0, u1) = (r.bounds.whole.begin.max[axis], r.bounds.whole.end.max[axis]);
    // How far the part in the cell stays behind the whole primitive, at the voting time.
    let raise = r.bounds.part.min[axis] - (l0 + (l1 - l0) * w);
    let lower = r.bounds.part.max[axis] - (u0 + (u1 - u0) * w);
    let (s0, s1) = (velocity * (begin - plane_time), velocity * (end - plane_time));
    ([l0 + raise - s0, l1 + raise - s1], [u0 + lower - s0, u1 + lower - s1])
}

fn best_on_axis(
    references: &[BoxReference],
    cell: Box3,
    axis: usize,
    velocity: f32,
    params: &KdParams,
    voting_time: impl Fn(TimeInterval) -> f32,
) -> Option<Split> {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for r in references.iter().filter(|r| r.votes) {
        low = low.min(r.bounds.part.min[axis]);
        high = high.max(r.bounds.part.max[axis]);
    }
    let edges = Edges::new(low.max(cell.min[axis]), high.min(cell.max[axis]));
    let (mut left, mut right) = (Ramps::ZERO, Ramps::ZERO);
    let mut total = 0.0;
    for r in references.iter().filter(|r| r.votes) {
        let weight = weight(r, params);
        total += weight;
        let (lower, upper) = lines(r, axis, velocity, params.plane_time, voting_time(r.interval));
        let (l_min, l_max) = (lower[0].min(lower[1]), lower[0].max(lower[1]));
        let (u_min, u_max) = (upper[0].min(upper[1]), upper[0].max(upper[1]));
        if params.time_weighted {
            left.add(l_min, l_max, edges.beyond(l_min), edges.beyond(l_max), weight);
            right.add(u_min, u_max, edges.beyond(u_min), edges.beyond(u_max), weight);
        } else {
            left.step[edges.beyond(l_min)] += weight;
            right.step[edges.beyond(u_max)] += weight;
        }
    }
    let full = cell.half_area();
    let (mut best, mut sums) = (None::<Split>, [0.0f64; 4]);
    for k in 0..EDGES {
        for (sum, change) in sums.iter_mut().zip([left.step[k], left.slope[k], right.step[k], right.slope[k]]) {
            *sum += change;
        }
        let at = edges.position(k);
        if !(cell.min[axis] < at && at < cell.max[axis]) {
            continue;
        }
        let s = f64::from(at);
        let clean = |x: f64| if x < 1e-9 * total { 0.0 } else { x };
        let l = clean(sums[0] + sums[1] * s);
        let r = clean(total - (sums[2] + sums[3] * s));
        let (mut below, mut above) = (cell, cell);
        below.max[axis] = at;
        above.min[axis] = at;
        let areas = l * f64::from(below.half_area()) + r * f64::from(above.half_area());
        let mut cost = f64::from(params.traversal_cost) + f64::from(params.intersection_cost) * areas / f64::from(full);
        if l == 0.0 || r == 0.0 {
            cost *= f64::from(params.empty_factor);
        }
        if best.is_none_or(|b| cost < b.cost) {
            best = Some(Split { plane: Plane { axis, position: at - velocity * params.plane_time, velocity }, cost });
        }
    }
    best
}
