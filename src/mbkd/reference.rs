//! References: a primitive in a node, for a time.

use crate::geometry::{Box3, LinearBox3, TimeInterval};
use crate::primitive::PrimitiveSet;

/// One entry of a primitive in a node under construction.
///
/// The same primitive may have several references in different nodes, and in overlapping intervals; all that
/// counts is that at every time each place where the primitive is has one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    /// The primitive.
    pub id: u32,
    /// When it counts in this node.
    pub interval: TimeInterval,
    /// Where it is during the interval (the whole primitive, not only its part in the cell).
    pub bounds: LinearBox3,
    /// Bounds of its part in the node's cell at its voting time ([`Reference::home`]).
    pub part: Box3,
    /// Whether it takes part in choosing planes.
    pub votes: bool,
}

impl Reference {
    /// The time of an interval that is nearest to the plane time: where a reference is then decides in which
    /// child it is a Normal reference. For a reference that lives at mid-shutter that is mid-shutter.
    #[inline]
    pub fn home(interval: TimeInterval, plane_time: f32) -> f32 {
        plane_time.clamp(interval.begin(), interval.end_bound().next_down())
    }
}

/// What the builder asks of primitives, which depends on whether the tree knows time intervals.
pub(crate) struct Source<'a, S> {
    pub set: &'a S,
    /// The classic tree sees boxes swept over the shutter, which stand still.
    pub swept: bool,
    pub plane_time: f32,
}

impl<S: PrimitiveSet> Source<'_, S> {
    /// The reference of a whole primitive.
    pub fn reference(&self, id: u32) -> Reference {
        let interval = self.set.active(id);
        let bounds = self.bounds(id, interval);
        Reference { id, interval, bounds, part: bounds.swept(), votes: true }
    }

    /// Linear bounds over an interval.
    pub fn bounds(&self, id: u32, interval: TimeInterval) -> LinearBox3 {
        let bounds = self.set.bounds(id, interval);
        if !self.swept {
            return bounds;
        }
        let swept = bounds.swept();
        LinearBox3 { begin: swept, end: swept }
    }

    /// Whether moving bounds stand for the primitive itself, so that its shape may be looked at.
    fn exact(&self, bounds: &LinearBox3) -> bool {
        !self.swept || bounds.begin == bounds.end
    }

    /// Bounds of the part of a reference in a cell at its voting time. Where nothing of it is in the cell
    /// then, a place on the cell's surface.
    pub fn part(&self, reference: &Reference, cell: LinearBox3) -> Box3 {
        let home = Reference::home(reference.interval, self.plane_time);
        let cell = cell.at(home);
        let part = if self.exact(&reference.bounds) {
            self.set.clipped(reference.id, home, cell)
        } else {
            reference.bounds.begin.intersection(cell)
        };
        if !part.is_empty() {
            return part;
        }
        let duration = reference.interval.duration();
        let w = if duration > 0.0 { (home - reference.interval.begin()) / duration } else { 0.0 };
        let whole = reference.bounds.at(w);
        let clamp = |p: glam::Vec3| p.max(cell.min).min(cell.max);
        Box3 { min: clamp(whole.min), max: clamp(whole.max) }
    }

    /// Whether the primitive is certainly outside the cell during the whole interval, though its bounds
    /// are not. The cell is given at shutter open and close.
    pub fn misses(&self, reference: &Reference, cell: LinearBox3) -> bool {
        self.exact(&reference.bounds) && self.set.misses(reference.id, reference.interval, cell)
    }
}
