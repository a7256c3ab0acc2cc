//! Whether the nodes of a k-d tree are linked so that a traversal can follow them, whatever their leaves hold.

use super::kd_tree::{KdNode, KdView};
use crate::limits::DEPTH_LIMIT;

/// Where a traversal would stumble.
pub(crate) enum BadLink {
    /// At a node that is reached twice, never, or from outside of the tree, or whose plane is nowhere.
    Node(usize),
    /// At a leaf that does not have what it names for itself.
    Leaf(usize),
    /// At this depth.
    Depth(usize),
}

/// Checks nodes whose leaves share out `items` objects among them; the depth of the deepest leaf.
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
