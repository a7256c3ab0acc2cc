//! Validating that the nodes of a k-d tree form a tree, whatever its leaves hold.

use super::kd_tree::{KdNode, KdView};
use crate::limits::DEPTH_LIMIT;

/// An invalid link.
pub(crate) enum BadLink {
    /// A node that is reached twice or never, an index outside of the tree, or a plane that is not finite.
    Node(usize),
    /// A leaf whose range is out of bounds or overlaps another leaf's.
    Leaf(usize),
    /// A leaf at this depth, which is too deep.
    Depth(usize),
}

/// Validates nodes whose leaves have disjoint ranges of `items` items; returns the depth of the deepest leaf.
pub(crate) fn check_links(nodes: &[KdNode], items: usize) -> Result<usize, BadLink> {
    let (mut reached, mut owned) = (vec![false; nodes.len()], vec![false; items]);
    let (mut stack, mut deepest) = (vec![(0usize, 0usize)], 0);
    while let Some((node, depth)) = stack.pop() {
        match reached.get_mut(node) {
            Some(seen) if !*seen => *seen = true,
            _ => return Err(BadLink::Node(node)),
        }
        if depth > DEPTH_LIMIT {
            return Err(BadLink::Depth(depth));
        }
        match nodes[node].view() {
            KdView::Inner { right, plane } => {
                if right as usize <= node + 1 || !plane.position.is_finite() || !plane.velocity.is_finite() {
                    return Err(BadLink::Node(node));
                }
                stack.extend([(right as usize, depth + 1), (node + 1, depth + 1)]);
            }
            KdView::Leaf { first, count } => {
                deepest = deepest.max(depth);
                let range = first as usize..first as usize + count as usize;
                let own = owned.get_mut(range).ok_or(BadLink::Leaf(node))?;
                if own.iter().any(|&o| o) {
                    return Err(BadLink::Leaf(node));
                }
                own.fill(true);
            }
        }
    }
    match reached.iter().position(|&seen| !seen) {
        Some(node) => Err(BadLink::Node(node)),
        None => Ok(deepest),
    }
}
