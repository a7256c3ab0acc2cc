//! The k-d build over points: planes through the median, with each point on exactly one side of a plane at every time.

use super::builder::{Budget, build};
use super::classify::Rounding;
use super::kd_tree::KdTree;
use super::reference::{Moving, Reference};
use crate::geometry::{AxisExtent, Box3, Line, LinearBox3, Plane};
use crate::limits::MAX_NODES;
use crate::params::usual_depth;
use crate::progress::Progress;
use glam::Vec3;

/// The trajectory of a point: a straight line from one key to the next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trajectory {
    pub open: [f32; 3],
    pub close: [f32; 3],
}

/// A reference of a point.
pub(crate) type PointReference = Reference<Trajectory>;

/// Points between two keys.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trajectories {
    /// Segments of the shutter, each between two keys.
    pub segments: usize,
    /// The segment that all trajectories belong to.
    pub segment: usize,
    /// The time at which the side of a point decides where it is a Normal reference.
    pub middle: f32,
}

/// A node with at most this many references becomes a leaf: one block of lanes.
const LEAF: usize = 16;

/// Builds a k-d tree with at most `references` references, from one reference for each point.
///
/// It never exceeds the limits of the layout: both children of a node have references ([`Moving::worthwhile`]), so there
/// are fewer than two nodes for each reference. Once `progress` is cancelled, the remaining nodes become leaves.
pub(crate) fn build_kd_over_points(
    points: Trajectories,
    all: Vec<PointReference>,
    references: f64,
    progress: &Progress,
) -> KdTree {
    let corners = all.iter().flat_map(|r| [r.bounds.open, r.bounds.close]);
    let root = corners.fold(Box3::EMPTY, |b, p| b.include(Vec3::from_array(p)));
    let budget = Budget {
        depth: usual_depth(all.len()),
        references: references.min((MAX_NODES / 2) as f64),
        propagated_vote: true,
    };
    build(&points, all, root, budget, progress).0
}

impl Trajectories {
    /// A coordinate at a time, in f64 without noticeable rounding.
    #[inline]
    fn at(&self, trajectory: &Trajectory, axis: usize, time: f32) -> f64 {
        let phase = f64::from(time) * self.segments as f64 - self.segment as f64;
        let (open, close) = (f64::from(trajectory.open[axis]), f64::from(trajectory.close[axis]));
        open + (close - open) * phase
    }

    /// Median velocity of the references along an axis: a very fast one does not affect the velocity of a plane.
    fn median_velocity<'a>(&self, references: impl Iterator<Item = &'a PointReference>, axis: usize) -> f32 {
        let velocity = |r: &PointReference| {
            let Line { begin, end } = self.extent(r, axis).lower;
            ((end - begin) / f64::from(r.interval.duration())) as f32
        };
        let mut velocities: Vec<f32> = references.map(velocity).filter(|v| v.is_finite()).collect();
        let rank = velocities.len() / 2;
        if velocities.is_empty() { 0.0 } else { *velocities.select_nth_unstable_by(rank, f32::total_cmp).1 }
    }
}

/// The spread of references along an axis, relative to a plane that moves with them.
struct Spread {
    velocity: f32,
    /// The position of each in the middle of its interval.
    places: Vec<f32>,
    /// Greatest difference of places.
    width: f64,
    /// How far they move on average.
    motion: f64,
}

impl Spread {
    /// A score of a split along the axis: the width, reduced if many references cross.
    fn score(&self) -> f64 {
        if self.width > 0.0 { self.width * (self.width / (self.width + self.motion)) } else { 0.0 }
    }

    /// The median; if no place is below it, the least place above. `None` if all places are equal.
    fn divide(mut self) -> Option<f32> {
        let rank = self.places.len() / 2;
        let (below, &mut median, above) = self.places.select_nth_unstable_by(rank, f32::total_cmp);
        if below.iter().any(|&x| x < median) {
            return Some(median);
        }
        above.iter().copied().filter(|&x| x > median).min_by(f32::total_cmp)
    }
}

impl Moving for Trajectories {
    type Bounds = Trajectory;
    const ROUNDING: Rounding = Rounding::ExactlyOnce;

    fn plane_time(&self) -> f32 {
        self.middle
    }

    #[inline]
    fn extent(&self, reference: &PointReference, axis: usize) -> AxisExtent {
        let interval = reference.interval;
        let [begin, end] = [interval.begin(), interval.end()].map(|t| self.at(&reference.bounds, axis, t));
        AxisExtent { interval, lower: Line { begin, end }, upper: Line { begin, end } }
    }

    /// A plane through the median of the positions of the references in the middle of their intervals, including BP
    /// references, which are most of them if points move far. It moves with the median velocity.
    fn choose(&self, normal: &[PointReference], bp: &[PointReference], _cell: LinearBox3) -> Option<Plane> {
        let all = || normal.iter().chain(bp);
        if normal.len() + bp.len() <= LEAF {
            return None;
        }
        let spread = |axis: usize| {
            let velocity = self.median_velocity(all(), axis);
            let mut spread = Spread { velocity, places: Vec::new(), width: 0.0, motion: 0.0 };
            spread.places.reserve_exact(normal.len() + bp.len());
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for r in all() {
                let Line { begin, end } = self.extent(r, axis).lower;
                let [first, last] = [r.interval.begin(), r.interval.end()].map(f64::from);
                let velocity = f64::from(velocity);
                let place = 0.5 * ((begin - velocity * first) + (end - velocity * last));
                spread.motion += ((end - begin) - velocity * (last - first)).abs();
                spread.places.push(place as f32);
                (low, high) = (low.min(place), high.max(place));
            }
            spread.motion /= spread.places.len() as f64;
            spread.width = high - low;
            spread
        };
        let spreads = [0, 1, 2].map(spread);
        let mut axis = 0;
        for other in [1, 2] {
            if spreads[other].score() > spreads[axis].score() {
                axis = other;
            }
        }
        let best = spreads.into_iter().nth(axis)?;
        let velocity = best.velocity;
        Some(Plane { axis, position: best.divide()?, velocity })
    }

    /// References that nearly all cross a plane are better left in one leaf. Those of a burst from one place are not: half
    /// of them are on the first side of a plane for a moment only.
    fn worthwhile(&self, before: usize, [left, right]: [usize; 2]) -> bool {
        left > 0 && right > 0 && 4 * (left + right) <= 7 * before
    }

    fn fitted(
        &self,
        child: PointReference,
        _parent: &PointReference,
        _cell: LinearBox3,
        _crosses: bool,
    ) -> Option<PointReference> {
        Some(child)
    }
}
