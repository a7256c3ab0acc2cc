//! The optimal collapse of a binary tree into sixteen-way nodes, by dynamic programming.
//!
//! For every binary subtree and every `j` from 1 to 16 the least cost of covering the subtree by at most `j`
//! children of some wide node above it. A single child is either a leaf block or a wide node of its
//! own, whose sixteen places are again shared out between the two halves. (The idea for four-way trees is
//! in Pinter, "Surface area heuristic for wide bounding volume hierarchies"; the recurrence is the same.)

use super::binned::{BinaryNode, mean_half_area};
use crate::simd::{LANES, huge_vec};

/// What the steps of a query cost, relative to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Prices {
    /// Visiting a node whose boxes move.
    pub node: f32,
    /// Opening a leaf block.
    pub leaf: f32,
    /// Each primitive in it.
    pub primitive: f32,
    /// Factor for nodes and leaves in which nothing moves.
    pub still: f32,
    /// Most primitives in one leaf block; 1 where the references are whole blocks already.
    pub most: usize,
}

/// A child of a wide node: a binary node, taken as a leaf block or as a wide node of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WideChild {
    pub node: u32,
    pub leaf: bool,
}

/// The decisions for a whole tree.
pub(crate) struct Collapse {
    /// For each node and number of places: how many go to the left half; 0: this node is one child.
    left: Vec<[u8; LANES]>,
    /// Whether the node, as one child, is a leaf block.
    leaf: Vec<bool>,
    /// Cost of the whole tree: the sum over what is visited of price times area.
    pub total: f32,
}

impl Collapse {
    /// Decides for every node, from the leaves up. `leaf_cost` gives the price of a node as a leaf
    /// block (relative to one visit), or nothing where it cannot be one.
    pub fn new(nodes: &[BinaryNode], prices: Prices, leaf_cost: impl Fn(&BinaryNode) -> Option<f32>) -> Collapse {
        let mut cost = huge_vec(nodes.len());
        cost.resize(nodes.len(), [0.0f32; LANES]);
        let mut left = huge_vec(nodes.len());
        left.resize(nodes.len(), [0u8; LANES]);
        let mut leaf = vec![false; nodes.len()];
        for x in (0..nodes.len()).rev() {
            let node = &nodes[x];
            let area = mean_half_area(&node.bounds);
            let still = if node.moving { 1.0 } else { prices.still };
            let as_leaf = leaf_cost(node).map_or(f32::INFINITY, |c| c * area * still);
            if node.right == 0 {
                cost[x] = [as_leaf; LANES];
                leaf[x] = true;
                continue;
            }
            let (l, r) = (cost[x + 1], cost[x + node.right as usize]);
            // best[j] covers both halves by j + 1 children together.
            let mut best = [(f32::INFINITY, 0u8); LANES];
            for i in 0..LANES - 1 {
                for j in 0..LANES - 1 - i {
                    let sum = l[i] + r[j];
                    let place = &mut best[i + j + 1];
                    if sum < place.0 {
                        *place = (sum, i as u8 + 1);
                    }
                }
            }
            let as_node = prices.node * still * area + best[LANES - 1].0;
            leaf[x] = as_leaf <= as_node;
            cost[x][0] = as_leaf.min(as_node);
            for j in 1..LANES {
                (cost[x][j], left[x][j]) = (cost[x][j - 1], left[x][j - 1]);
                // Equal cost goes to one child: fewer boxes.
                if best[j].0 < cost[x][j] {
                    (cost[x][j], left[x][j]) = best[j];
                }
            }
            // The full node's own share-out is needed where this node is a wide node.
            left[x][0] = best[LANES - 1].1;
        }
        let total = cost.first().map_or(0.0, |c| c[0]);
        Collapse { left, leaf, total }
    }

    /// Whether a node, taken as one child, is a leaf block.
    pub fn is_leaf(&self, node: u32) -> bool {
        self.leaf[node as usize]
    }

    /// The children of a wide node, at most sixteen, from left to right.
    pub fn children(&self, nodes: &[BinaryNode], of: u32, out: &mut Vec<WideChild>) {
        out.clear();
        let share = self.left[of as usize][0];
        self.forest(nodes, of + 1, share, out);
        self.forest(nodes, of + nodes[of as usize].right, LANES as u8 - share, out);
    }

    /// The binary nodes that become leaf blocks, from left to right.
    pub fn leaves(&self, nodes: &[BinaryNode]) -> Vec<BinaryNode> {
        let mut leaves = Vec::new();
        if nodes.is_empty() {
            return leaves;
        }
        if self.leaf[0] {
            return vec![nodes[0]];
        }
        let mut children = Vec::with_capacity(LANES);
        let mut inner = vec![0];
        while let Some(x) = inner.pop() {
            self.children(nodes, x, &mut children);
            leaves.extend(children.iter().filter(|c| c.leaf).map(|c| nodes[c.node as usize]));
            inner.extend(children.iter().rev().filter(|c| !c.leaf).map(|c| c.node));
        }
        leaves
    }

    /// Covers a subtree by at most `places` children. The recursion is at most sixteen deep: every level
    /// shares out places, of which both halves get one or more.
    fn forest(&self, nodes: &[BinaryNode], x: u32, places: u8, out: &mut Vec<WideChild>) {
        let share = if places > 1 { self.left[x as usize][places as usize - 1] } else { 0 };
        if share == 0 {
            out.push(WideChild { node: x, leaf: self.leaf[x as usize] });
            return;
        }
        // The decision may have been made with fewer places than there are; the right half gets the
        // number it was made with, which is what its own table holds at equal cost.
        self.forest(nodes, x + 1, share, out);
        self.forest(nodes, x + nodes[x as usize].right, places - share, out);
    }
}
