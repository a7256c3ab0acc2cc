//! Checking a finished k-d tree: its links, and that every primitive is in every leaf it reaches at every sampled time.
//!
//! For tests after builds, and for development of the builder.

use super::validation_error::ValidationError;
use crate::geometry::{TimeInterval, ULP};
use crate::kd::{KdTree, KdView};
use crate::primitive::PrimitiveSet;

/// Cells are shrunk by this before primitives are searched in them. A primitive that only touches a face, within the rounding of
/// clipping, may be stored on the other side.
const MARGIN: f32 = 128.0 * ULP;
/// The number of sampled times per primitive, besides the beginning, middle and end.
const TIMES: usize = 24;

impl KdTree {
    /// Checks links, depth and references, and at a number of times per primitive (among them those at which its
    /// references begin and end) that every leaf whose cell it reaches has a reference to it.
    pub fn validate(&self, set: &impl PrimitiveSet) -> Result<(), ValidationError> {
        self.validate_links(set.len())?;
        let mut changes: Vec<(u32, f32)> = Vec::with_capacity(2 * self.references.len());
        for r in &self.references {
            changes.extend([r.begin, r.end, r.end.next_down()].map(|t| (r.id, t.min(1.0))));
        }
        changes.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        changes.dedup();
        let mut rest = changes.as_slice();
        for id in 0..set.len() as u32 {
            let active = set.active(id);
            let own = rest.iter().position(|&(of, _)| of != id).unwrap_or(rest.len());
            let (mine, others) = rest.split_at(own);
            rest = others;
            let step = mine.len().div_ceil(TIMES).max(1);
            let times = [active.begin(), active.middle(), active.end()];
            let times = mine.iter().step_by(step).map(|&(_, t)| t).chain(times);
            for time in times.filter(|&t| active.contains(t)) {
                self.find_missing(set, id, time)?;
            }
        }
        Ok(())
    }

    /// Descends to all leaves that the primitive reaches at one time.
    fn find_missing(&self, set: &impl PrimitiveSet, id: u32, time: f32) -> Result<(), ValidationError> {
        let Some(instant) = TimeInterval::half_open(time, time.next_up()) else { return Ok(()) };
        let bounds = set.bounds(id, instant).begin;
        let mut stack = vec![(0usize, self.root)];
        while let Some((node, cell)) = stack.pop() {
            let shrunk = cell.pad(-MARGIN);
            if bounds.intersection(shrunk).is_empty() {
                continue;
            }
            match self.nodes[node].view() {
                KdView::Inner { plane, right } => {
                    let [below, above] = plane.halves(cell, time);
                    stack.extend([(right as usize, above), (node + 1, below)]);
                }
                KdView::Leaf { first, count } => {
                    let references = &self.references[first as usize..][..count as usize];
                    let listed = references.iter().any(|r| r.id == id && r.is_active_at(time));
                    if !listed && !set.clipped(id, time, shrunk).is_empty() {
                        return Err(ValidationError::Missing { primitive: id, time, node });
                    }
                }
            }
        }
        Ok(())
    }
}
