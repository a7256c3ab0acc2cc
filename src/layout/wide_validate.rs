//! Checking a finished wide tree.

use super::kd_validate::ValidationError;
use super::leaf_block::WideSource;
use super::wide_node::{ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS};
use super::wide_tree::WideTree;
use crate::geometry::KeyTime;
use crate::primitive::PrimitiveSet;
use crate::simd::LANES;

/// Times at which a tree is walked; the odd numbers fall into every time part and on no boundary.
const TIMES: [f32; 9] = [0.0, 0.03, 0.17, 0.29, 0.43, 0.61, 0.79, 0.97, 1.0];

impl WideTree {
    /// Checks that all blocks lie inside the arena and are met once, and that at a number of times every
    /// primitive is in some leaf block.
    pub fn validate<S: WideSource>(&self, set: &S) -> Result<(), ValidationError> {
        let words = self.arena.ints().len();
        for time in TIMES {
            let mut seen = vec![false; set.len()];
            let mut visited = 0;
            let mut stack = vec![self.root];
            while let Some(at) = stack.pop() {
                if at == ChildRef::NOTHING {
                    continue;
                }
                let node = at.at() / LANES;
                visited += 1;
                let length = match at.kind() {
                    Kind::Node => NODE_ROWS * LANES,
                    Kind::StillNode => STILL_NODE_ROWS * LANES,
                    _ => 2,
                };
                // More blocks than lines: some are met again and again.
                if at.at() + length > words || visited * LANES > words {
                    return Err(ValidationError::Links { node });
                }
                if at.kind().is_leaf() {
                    for &id in self.ids::<S>(at).ok_or(ValidationError::Links { node })? {
                        let Some(seen) = seen.get_mut(id as usize) else {
                            return Err(ValidationError::References { node });
                        };
                        *seen = true;
                    }
                } else if at.kind() == Kind::Time {
                    let parts = self.children(at);
                    stack.push(ChildRef(parts[KeyTime::new(time, parts.len() + 1).segment]));
                } else {
                    stack.extend(self.children(at).iter().map(|&c| ChildRef(c)));
                }
            }
            if let Some(id) = seen.iter().position(|&s| !s) {
                return Err(ValidationError::Missing { primitive: id as u32, time, node: 0 });
            }
        }
        // It is known of each piece of a motion in which leaf block it is.
        let triangles = set.triangles();
        for (id, triangles) in triangles.into_iter().flat_map(|t| (0..t.len() as u32).map(move |id| (id, t))) {
            for segment in 0..triangles.keys(id).max(2) - 1 {
                let leaf = self.blocks.get(triangles.piece(id, segment)).map(|&leaf| ChildRef(leaf));
                if !leaf.and_then(|leaf| self.ids::<S>(leaf)).is_some_and(|ids| ids.contains(&id)) {
                    return Err(ValidationError::References { node: 0 });
                }
            }
        }
        Ok(())
    }
}
