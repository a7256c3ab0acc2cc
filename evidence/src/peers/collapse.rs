//! The choice of the children of a wide node among the subtrees of a binary tree.
//!
//! Starting with both halves, the child with the most visits, by its surface area, is replaced by its own two, until
//! the node is full or only leaves are left (Wald, Benthin and Boulos, "Getting Rid of Packets: Efficient SIMD
//! Single-Ray Traversal using Multi-branching BVHs", RT 2008). Leaves stay as the binary build made them.

use super::subtree::{Content, Subtree};
use super::wide_node::WIDTH;

/// The children of the wide node for an inner node with these halves.
pub fn children(halves: &[Subtree; 2]) -> Vec<&Subtree> {
    let mut children: Vec<&Subtree> = halves.iter().collect();
    while children.len() < WIDTH {
        let inner = |(at, child): (usize, &&'_ Subtree)| match child.content {
            Content::Inner(_) => Some((at, child.visits())),
            Content::Leaf { .. } => None,
        };
        let most = children.iter().enumerate().filter_map(inner).max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, _)) = most else { break };
        let Content::Inner(halves) = &children[at].content else { break };
        children[at] = &halves[0];
        children.push(&halves[1]);
    }
    children
}
