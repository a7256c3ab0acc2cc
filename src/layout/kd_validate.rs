//! Checking a finished k-d tree: its links, and that every primitive is in every leaf it reaches at every sampled time.
//!
//! For tests after builds, and for development of the builder.

use crate::file::{FileError, broken, require};
use crate::geometry::{Box3, TimeInterval, ULP};
use crate::limits::DEPTH_LIMIT;
use crate::mbkd::{BadLink, KdTree, KdView, check_links};
use crate::primitive::PrimitiveSet;
use core::fmt;

/// A violation found in a tree by [`RayTree::validate`](crate::RayTree::validate): a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ValidationError {
    /// A node is reached twice, never, or links outside the tree.
    Links {
        /// The node.
        node: usize,
    },
    /// The tree is deeper than recorded, or deeper than a traversal can follow.
    Depth {
        /// Depth of a leaf.
        depth: usize,
    },
    /// A leaf's references lie outside the array, overlap another leaf's, or have the id of no primitive or an empty time interval.
    References {
        /// The leaf.
        node: usize,
    },
    /// A primitive is in a leaf's cell at some time, but the leaf has no reference to it that is active then.
    Missing {
        /// The primitive's id.
        primitive: u32,
        /// The time.
        time: f32,
        /// The leaf.
        node: usize,
    },
    /// A primitive extends beyond a box above its leaf at some time.
    Bounds {
        /// The primitive's id.
        primitive: u32,
        /// The time.
        time: f32,
        /// The leaf.
        node: usize,
    },
}

impl fmt::Display for ValidationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ValidationError::Links { node } => {
                write!(f, "node {node} is reached twice, never, or has a link outside the tree")
            }
            ValidationError::Depth { depth } => {
                write!(f, "a leaf has depth {depth}, more than the tree records or a traversal can follow")
            }
            ValidationError::References { node } => write!(
                f,
                "the references of leaf {node} are shared, outside the array, or have an invalid id or interval"
            ),
            ValidationError::Missing { primitive, time, node } => {
                write!(
                    f,
                    "primitive {primitive} is in the cell of leaf {node} at time {time}, but the leaf has no reference to it"
                )
            }
            ValidationError::Bounds { primitive, time, node } => {
                write!(f, "primitive {primitive} of leaf {node} extends beyond a box above the leaf at time {time}")
            }
        }
    }
}

impl std::error::Error for ValidationError {}

/// Cells are shrunk by this before primitives are searched in them. A primitive that only touches a face, within the rounding of clipping,
/// may be stored on the other side.
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
            let middle = active.begin() + 0.5 * active.duration();
            let times = mine.iter().step_by(step).map(|&(_, t)| t).chain([active.begin(), middle, active.end()]);
            for time in times.filter(|&t| active.contains(t)) {
                self.find_missing(set, id, time)?;
            }
        }
        Ok(())
    }

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
    fn validate_links(&self, primitives: usize) -> Result<(), ValidationError> {
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
                    let at = plane.at(time) as f32;
                    let (mut below, mut above): (Box3, Box3) = (cell, cell);
                    below.max[plane.axis] = below.max[plane.axis].min(at);
                    above.min[plane.axis] = above.min[plane.axis].max(at);
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
