//! What the validation of a tree finds.

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
    /// In a wide or lazy tree also: the recorded leaf block of a triangle does not hold it, or a primitive is not in exactly one
    /// subtree.
    References {
        /// The leaf; 0 where it is not one leaf.
        node: usize,
    },
    /// A primitive is in the cell of a leaf of a k-d tree at some time, but the leaf has no reference to it that is active then; or
    /// no leaf of a wide tree holds it, or a subtree of a lazy one is in no leaf.
    Missing {
        /// The primitive's id, or the subtree's.
        primitive: u32,
        /// The time.
        time: f32,
        /// The leaf of the k-d tree; 0 in others.
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
                "the references of leaf {node} are shared, outside the array, not those that are recorded, or have an invalid id or \
                 interval"
            ),
            ValidationError::Missing { primitive, time, node } => {
                write!(
                    f,
                    "primitive or subtree {primitive} is missing at time {time}: from leaf {node} of a k-d tree, or from all of another"
                )
            }
            ValidationError::Bounds { primitive, time, node } => {
                write!(f, "primitive {primitive} of leaf {node} extends beyond a box above the leaf at time {time}")
            }
        }
    }
}

impl std::error::Error for ValidationError {}
