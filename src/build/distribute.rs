//! Handing references to the children of a split plane: the paper's duplication (section 3.1.1) and
//! propagation (section 3.1.2).
//!
//! A node under construction has Normal references, which lie in its cell at mid-shutter and choose its plane,
//! and BP references, which come into the cell at another time only. Both are classified against the plane
//! with the same code ([`classify`]); what is called duplication for the first is called propagation
//! for the second.

use super::reference::{Reference, Source};
use super::{Plane, classify};
use crate::motion::{Box3, LinearBox3, PrimitiveSet, TimeInterval};

/// The references of a node under construction.
#[derive(Debug, Default)]
pub(crate) struct References {
    /// In the cell at mid-shutter.
    pub normal: Vec<Reference>,
    /// In the cell at another time: the paper's virtual BP node.
    pub bp: Vec<Reference>,
}

impl References {
    pub fn len(&self) -> usize {
        self.normal.len() + self.bp.len()
    }

    pub fn iter(&self) -> impl Iterator<Item = &Reference> {
        self.normal.iter().chain(&self.bp)
    }
}

/// The two children of a node while references are handed to them.
pub(crate) struct Children<'a, S> {
    source: &'a Source<'a, S>,
    plane: Plane,
    /// Cells at shutter open and close: left, right.
    pub cells: [LinearBox3; 2],
    pub references: [References; 2],
}

impl<'a, S: PrimitiveSet> Children<'a, S> {
    pub fn new(source: &'a Source<'a, S>, plane: Plane, cell: LinearBox3) -> Children<'a, S> {
        // A moving plane may leave the parent's cell at other times. Taking the plane for the child's face all
        // the same keeps the cell a superset of the true one, which is all that is asked of it.
        let (open, close) = (plane.position, plane.position + plane.velocity);
        let (mut left, mut right) = (cell, cell);
        left.begin.max[plane.axis] = open;
        left.end.max[plane.axis] = close;
        right.begin.min[plane.axis] = open;
        right.end.min[plane.axis] = close;
        Children { source, plane, cells: [left, right], references: Default::default() }
    }

    /// Duplication: a Normal reference that crosses the plane goes to the Normal node of the side where it is at
    /// mid-shutter and, duplicated, to the BP node of the other (the paper's four cases from the left and four
    /// from the right). One that lies across the plane at mid-shutter goes to both Normal nodes, one that never
    /// crosses to one.
    pub fn duplicate(&mut self, reference: &Reference) {
        self.assign(reference, reference.votes);
    }

    /// Propagation: a BP reference that does not cross this plane becomes a Normal reference of the one child, or
    /// of both if it lies across the plane throughout; one that crosses becomes Normal where it is at
    /// mid-shutter, or at the time of its interval that comes nearest, and stays BP on the other side: with the
    /// mirrored ones, six cases.
    pub fn propagate(&mut self, reference: &Reference, propagated_vote: bool) {
        self.assign(reference, propagated_vote);
    }

    fn assign(&mut self, reference: &Reference, votes: bool) {
        let sides = classify(reference.bounds.along(self.plane.axis, reference.interval), self.plane);
        let both = sides.left.is_some() && sides.right.is_some();
        for (side, interval) in [sides.left, sides.right].into_iter().enumerate() {
            let Some(interval) = interval else { continue };
            let home = Reference::home(reference.interval, self.source.plane_time);
            let normal = !both || interval.contains(home);
            let Some(child) = self.narrowed(reference, side, interval, both, normal && votes) else { continue };
            let lists = &mut self.references[side];
            if normal { lists.normal.push(child) } else { lists.bp.push(child) }
        }
    }

    /// The reference as the child sees it; nothing if the primitive never touches the child's cell.
    fn narrowed(
        &self,
        reference: &Reference,
        side: usize,
        interval: TimeInterval,
        cut: bool,
        votes: bool,
    ) -> Option<Reference> {
        let mut child = Reference { interval, votes, ..*reference };
        if interval != reference.interval {
            child.bounds = self.source.bounds(child.id, interval);
        }
        let cell = self.cells[side];
        if cut && self.source.misses(&child, over(cell, interval)) {
            return None;
        }
        // The part changes where the plane cuts it, when it is looked at at another time, and when the reference
        // begins to vote.
        let home = |i| Reference::home(i, self.source.plane_time);
        if votes && (cut || !reference.votes || home(interval) != home(reference.interval)) {
            child.part = self.source.part(&child, cell);
        }
        Some(child)
    }
}

/// A cell given at shutter open and close, as it is at the begin and end of an interval.
fn over(cell: LinearBox3, interval: TimeInterval) -> LinearBox3 {
    if cell.begin == cell.end {
        return cell;
    }
    let at = |t: f32| -> Box3 { cell.at(t) };
    LinearBox3 { begin: at(interval.begin()), end: at(interval.end()) }
}
