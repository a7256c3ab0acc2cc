//! The k-d build over primitives: planes by the surface area heuristic, intervals rounded outward.

use super::build_times::BuildTimes;
use super::builder::{Budget, build};
use super::classify::Rounding;
use super::kd_tree::KdTree;
use super::reference::{Moving, Reference, representative_time};
use super::sah::{Bounds, BoxReference, Split, best_split, leaf_cost, weight};
use crate::error::BuildError;
use crate::geometry::{AxisExtent, Box3, LinearBox3, Plane, TimeInterval};
use crate::limits::MAX_NODES;
use crate::params::KdParams;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use glam::Vec3;

/// Builds a k-d tree over primitives by the policy of `params`, which must be valid.
pub(crate) fn build_kd<S: PrimitiveSet>(
    set: &S,
    params: &KdParams,
    progress: &Progress,
) -> Result<(KdTree, BuildTimes), BuildError> {
    let objects = Primitives { set, params };
    let mut references: Vec<_> = (0..set.len() as u32).map(|id| objects.reference(id)).collect();
    // The swept root: all primitives at all times. Padded, so that flat scenes have a volume.
    let mut root = references.iter().fold(Box3::EMPTY, |b, r| b.union(r.bounds.whole.swept()));
    if references.is_empty() {
        root = Box3 { min: Vec3::ZERO, max: Vec3::ZERO };
    }
    let root = root.pad(1e-5 * root.magnitude());
    for r in &mut references {
        r.bounds.clipped =
            objects.clipped(r, LinearBox3 { begin: root, end: root }, r.representative_time(params.plane_time));
    }
    let budget = Budget {
        depth: params.depth_for(set.len()),
        references: set.len() as f64 * f64::from(params.max_references),
        propagated_vote: params.propagated_vote,
    };
    let (tree, times) = build(&objects, references, root, budget, progress);
    if progress.cancelled() {
        return Err(BuildError::Cancelled);
    }
    if tree.nodes.len() > MAX_NODES || tree.references.len() > u32::MAX as usize {
        return Err(BuildError::TooManyReferences);
    }
    Ok((tree, times))
}

/// Primitives, with the parameters of the choice of planes.
pub(crate) struct Primitives<'a, S> {
    pub set: &'a S,
    pub params: &'a KdParams,
}

impl<S: PrimitiveSet> Primitives<'_, S> {
    /// The reference of a whole primitive.
    pub fn reference(&self, id: u32) -> BoxReference {
        let interval = self.set.active(id);
        let whole = self.bounds(id, interval);
        Reference { id, interval, bounds: Bounds { whole, clipped: whole.swept() }, in_sah: true }
    }

    /// The classic tree has no intervals: it uses boxes swept over the shutter, which are static.
    fn swept(&self) -> bool {
        !self.params.intervals
    }

    /// Linear bounds over an interval.
    fn bounds(&self, id: u32, interval: TimeInterval) -> LinearBox3 {
        let bounds = self.set.bounds(id, interval);
        if !self.swept() {
            return bounds;
        }
        let swept = bounds.swept();
        LinearBox3 { begin: swept, end: swept }
    }

    /// Whether bounds follow the primitive itself, so that its shape may be used for clipping.
    fn exact(&self, bounds: &LinearBox3) -> bool {
        !self.swept() || bounds.begin == bounds.end
    }

    /// The bounds of a reference, clipped to a cell, at a time of its interval. If nothing of it is in the cell
    /// then, the nearest place on the cell's surface.
    fn clipped(&self, reference: &BoxReference, cell: LinearBox3, time: f32) -> Box3 {
        let cell = cell.at(time);
        let whole = reference.bounds.whole;
        let clipped = if self.exact(&whole) {
            self.set.clipped(reference.id, time, cell)
        } else {
            whole.begin.intersection(cell)
        };
        if !clipped.is_empty() {
            return clipped;
        }
        let duration = reference.interval.duration();
        let w = if duration > 0.0 { (time - reference.interval.begin()) / duration } else { 0.0 };
        let whole = whole.at(w);
        let clamp = |p: Vec3| p.max(cell.min).min(cell.max);
        Box3 { min: clamp(whole.min), max: clamp(whole.max) }
    }
}

impl<S: PrimitiveSet> Moving for Primitives<'_, S> {
    type Bounds = Bounds;
    const ROUNDING: Rounding = Rounding::Outward;

    fn plane_time(&self) -> f32 {
        self.params.plane_time
    }

    #[inline]
    fn extent(&self, reference: &BoxReference, axis: usize) -> AxisExtent {
        reference.bounds.whole.along(axis, reference.interval)
    }

    fn choose(&self, normal: &[BoxReference], bp: &[BoxReference], cell: LinearBox3) -> Option<Plane> {
        let at_plane_time = cell.at(self.params.plane_time);
        let cheapest = |voters: &[BoxReference], split: Option<Split>| {
            let total: f64 = voters.iter().filter(|r| r.in_sah).map(|r| weight(r, self.params)).sum();
            split.filter(|split| split.cost < leaf_cost(total, self.params)).map(|split| split.plane)
        };
        let plane_time = self.params.plane_time;
        let split =
            best_split(normal, at_plane_time, self.params, |interval| representative_time(interval, plane_time));
        let plane = cheapest(normal, split);
        if plane.is_some() || bp.len() <= normal.len() {
            return plane;
        }
        // In the paper only Normal references choose the plane. If most references of the cell only cross it at some
        // other time, that would make a leaf of hundreds. So all contribute to the SAH, each at the middle of its
        // interval: at the time that is nearest to mid-shutter most are just entering, on the face of the cell.
        let voter = |r: &BoxReference| {
            let clipped = self.clipped(r, cell, r.interval.middle());
            Reference { in_sah: true, bounds: Bounds { clipped, ..r.bounds }, ..*r }
        };
        let all: Vec<BoxReference> = normal.iter().chain(bp).map(voter).collect();
        cheapest(&all, best_split(&all, at_plane_time, self.params, |interval| interval.middle()))
    }

    /// Always: the SAH has compared the costs.
    fn worthwhile(&self, _before: usize, _children: [usize; 2]) -> bool {
        true
    }

    fn fitted(
        &self,
        mut child: BoxReference,
        parent: &BoxReference,
        cell: LinearBox3,
        crosses: bool,
    ) -> Option<BoxReference> {
        let (id, interval) = (child.id, child.interval);
        if interval != parent.interval {
            child.bounds.whole = self.bounds(id, interval);
        }
        if crosses && self.exact(&child.bounds.whole) && self.set.is_disjoint(id, interval, over(cell, interval)) {
            return None;
        }
        // The clipped bounds change if the plane crosses them, if its representative time changes, and if the reference
        // begins to contribute to the SAH.
        let at = |i| representative_time(i, self.params.plane_time);
        if child.in_sah && (crosses || !parent.in_sah || at(interval) != at(parent.interval)) {
            child.bounds.clipped = self.clipped(&child, cell, at(interval));
        }
        Some(child)
    }
}

/// A cell given at shutter open and close, as it is at the begin and end of an interval.
fn over(cell: LinearBox3, interval: TimeInterval) -> LinearBox3 {
    if cell.begin == cell.end {
        return cell;
    }
    LinearBox3 { begin: cell.at(interval.begin()), end: cell.at(interval.end()) }
}
