//! Checking the links of a k-d tree, before queries traverse one that was read from a file.

use super::validation_error::ValidationError;
use crate::file::{FileError, broken, require};
use crate::kd::{BadLink, KdTree, KdView, check_links};
use crate::limits::DEPTH_LIMIT;

impl KdTree {
    /// Returns the tree if queries can traverse it safely.
    pub(crate) fn checked(self, primitives: usize) -> Result<KdTree, FileError> {
        require(self.depth as usize <= DEPTH_LIMIT, "the recorded depth is more than a traversal can follow")?;
        require(!self.root.min.is_nan() && !self.root.max.is_nan(), "the bounds of the root are not a number")?;
        // Statistics count those too that no leaf has.
        let known = self.references.iter().all(|r| (r.id as usize) < primitives);
        require(known, "a reference is to a primitive that is not there")?;
        match self.validate_links(primitives) {
            Ok(()) => Ok(self),
            Err(ValidationError::Depth { .. }) => broken("a leaf is deeper than the recorded depth"),
            Err(ValidationError::References { .. }) => {
                broken("a leaf has references outside the array or with an invalid id or time interval")
            }
            Err(_) => broken("a node is reached twice, never, or has a link outside the tree"),
        }
    }

    /// Checks all invariants that a traversal relies on.
    pub(in crate::layout) fn validate_links(&self, primitives: usize) -> Result<(), ValidationError> {
        let depth = check_links(&self.nodes, self.references.len()).map_err(|wrong| match wrong {
            BadLink::Node(node) => ValidationError::Links { node },
            BadLink::Leaf(node) => ValidationError::References { node },
            BadLink::Depth(depth) => ValidationError::Depth { depth },
        })?;
        if depth > self.depth as usize {
            return Err(ValidationError::Depth { depth });
        }
        for (node, at) in self.nodes.iter().enumerate() {
            let KdView::Leaf { first, count } = at.view() else { continue };
            let own = &self.references[first as usize..][..count as usize];
            if !own.iter().all(|r| (r.id as usize) < primitives && r.begin < r.end) {
                return Err(ValidationError::References { node });
            }
        }
        Ok(())
    }
}
