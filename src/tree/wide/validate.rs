//! Checking a finished wide tree.

use super::build::WideTree;
use super::layout::{ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS};
use crate::motion::{KeyTime, PrimitiveSet};
use crate::simd::LANES;
use crate::tree::ValidationError;

/// Times at which a tree is walked; the odd numbers fall into every time part and on no boundary.
const TIMES: [f32; 9] = [0.0, 0.03, 0.17, 0.29, 0.43, 0.61, 0.79, 0.97, 1.0];

impl WideTree {
    /// Checks that all blocks lie inside the arena and are met once, and that at a number of times every
    /// primitive is in some leaf block.
    pub fn validate(&self, set: &impl PrimitiveSet) -> Result<(), ValidationError> {
        let words = self.arena.ints().len();
        for time in TIMES {
            let mut seen = vec![false; set.len()];
            let mut visited = 0;
            let mut stack = vec![self.root];
            while let Some(at) = stack.pop() {
                let node = at.at() / LANES;
                let rows = |n: usize| n * LANES;
                let length = match at.kind() {
                    Kind::Nothing => continue,
                    Kind::Node => rows(NODE_ROWS),
                    Kind::StillNode => rows(STILL_NODE_ROWS),
                    Kind::Time => 2,
                    kind => kind.leaf_shape().map_or(0, |shape| shape.ids(at.len()) + at.len()),
                };
                visited += 1;
                // More blocks than lines: some are met again and again.
                if at.at() + length > words || visited * LANES > words {
                    return Err(ValidationError::Links { node });
                }
                match at.kind() {
                    Kind::Time => {
                        let parts = self.children(at);
                        stack.push(ChildRef(parts[KeyTime::new(time, parts.len() + 1).segment]));
                    }
                    kind => match kind.leaf_shape() {
                        Some(shape) => {
                            for &id in &self.arena.ints()[at.at() + shape.ids(at.len())..][..at.len()] {
                                let Some(seen) = seen.get_mut(id as usize) else {
                                    return Err(ValidationError::References { node });
                                };
                                *seen = true;
                            }
                        }
                        None => stack.extend(self.children(at).iter().map(|&c| ChildRef(c))),
                    },
                }
            }
            if let Some(id) = seen.iter().position(|&s| !s) {
                return Err(ValidationError::Missing { primitive: id as u32, time, node: 0 });
            }
        }
        Ok(())
    }
}
