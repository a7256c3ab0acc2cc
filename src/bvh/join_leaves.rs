//! Joining leaf blocks of one wide node that are not neighbours in the binary tree.
//!
//! The collapse makes a leaf block of a binary subtree. Where a few large primitives overlap many small ones, object splits take
//! them off one side after the other, as their centres are far apart. So they end up in several blocks of one wide node, and each
//! ray at that node visits all of these. One block of all of them costs less.
//!
//! Blocks that cost less together are moved beside each other in the binary tree, and the tree is collapsed again. Like reinsertion
//! ([`super::reinsertion`]), whose means this uses, it is done at the top of the tree only, where most can be gained in little
//! time, and only if that pays.

use super::builder::{BinaryNode, BinaryTree};
use super::collapse::{Collapse, WideChild};
use super::costs::{leaf_cost, motion_factor};
use super::reference::Reference;
use super::reinsertion::Reinsertion;
use super::visits::SurfaceDensity;
use crate::geometry::LinearBox3;
use crate::simd::LANES;
use crate::tuning::reinsertion::{LEAST_GAIN, LEAST_NODES, SHARE};
use core::cmp::Reverse;
use std::collections::BinaryHeap;

/// Moves leaf blocks beside others with which they cost less, and returns the better tree, to be collapsed again; `None` if little
/// is to be gained. A block has at most `most` primitives. As after reinsertion, only the references of nodes that may be leaf
/// blocks are side by side in it.
pub(crate) fn join_leaves(
    nodes: &[BinaryNode],
    collapse: &Collapse,
    references: &mut Vec<Reference>,
    density: SurfaceDensity,
    most: usize,
) -> Option<BinaryTree> {
    if nodes.len() < LEAST_NODES {
        return None;
    }
    // A wide node absorbs about as many binary ones as it has children.
    let count = (((nodes.len() / LANES) as f32 * SHARE) as usize).max(LEAST_NODES);
    let (mut joins, mut gained) = (Vec::new(), 0.0);
    for (x, children) in most_visited(nodes, collapse, density, count) {
        let mut blocks: Vec<Block> =
            children.iter().filter(|child| child.leaf).map(|child| Block::of(nodes, child.node, density)).collect();
        let mut pairs = Vec::new();
        while let Some((a, b, gain)) = best_pair(&blocks, density, most) {
            pairs.push((blocks[a].node, blocks[b].node));
            gained += gain;
            blocks[a] = blocks[a].with(&blocks[b], density);
            blocks.remove(b);
        }
        if !pairs.is_empty() {
            joins.push((x, children, pairs));
        }
    }
    if gained < LEAST_GAIN * collapse.total() || joins.is_empty() {
        return None;
    }
    let mut tree = Reinsertion::new(nodes, Vec::new(), density);
    for (x, children, pairs) in joins {
        // The nodes that the wide node has absorbed.
        let mut absorbed = vec![x];
        while let Some(of) = absorbed.pop() {
            let below = tree.open(of).into_iter().flatten();
            absorbed.extend(below.filter(|&below| children.iter().all(|child| child.node != below)));
        }
        // A joined block is the node that was moved along.
        let mut joined: Vec<(u32, u32)> = Vec::new();
        for (a, b) in pairs {
            let now = |x: u32| joined.iter().rev().find(|moved| moved.0 == x).map_or(x, |moved| moved.1);
            let both = tree.join(now(a), now(b));
            joined.push((a, both));
        }
    }
    tree.write(references, &mut [])
}

/// A leaf block, or several that are to be joined.
#[derive(Clone, Copy)]
struct Block {
    /// The binary node of the first of them.
    node: u32,
    count: u32,
    bounds: LinearBox3,
    moving: bool,
    visits: f32,
}

impl Block {
    fn of(nodes: &[BinaryNode], node: u32, density: SurfaceDensity) -> Block {
        let BinaryNode { bounds, count, moving, .. } = nodes[node as usize];
        Block { node, count, bounds, moving, visits: visits(&bounds, moving, density) }
    }

    fn with(&self, other: &Block, density: SurfaceDensity) -> Block {
        let (bounds, moving) = (self.bounds.union(other.bounds), self.moving | other.moving);
        let visits = visits(&bounds, moving, density);
        Block { count: self.count + other.count, bounds, moving, visits, ..*self }
    }

    fn cost(&self) -> f32 {
        leaf_cost(self.count as usize) * self.visits
    }
}

/// How often something is visited, by cost.
fn visits(bounds: &LinearBox3, moving: bool, density: SurfaceDensity) -> f32 {
    density.visits(bounds) * motion_factor(moving)
}

/// The two blocks that gain most if they are joined to one of at most `most` primitives, and what they gain.
fn best_pair(blocks: &[Block], density: SurfaceDensity, most: usize) -> Option<(usize, usize, f32)> {
    let mut best: Option<(usize, usize, f32)> = None;
    for (i, a) in blocks.iter().enumerate() {
        for (j, b) in blocks.iter().enumerate().skip(i + 1) {
            if (a.count + b.count) as usize > most {
                continue;
            }
            let apart = a.cost() + b.cost();
            let least = best.map_or(1e-6 * apart, |best| best.2);
            // Both together are visited at least as often as either of them.
            let one = leaf_cost((a.count + b.count) as usize);
            if apart - one * a.visits.max(b.visits) > least {
                let gain = apart - a.with(b, density).cost();
                if gain > least {
                    best = Some((i, j, gain));
                }
            }
        }
    }
    best
}

/// The wide nodes that are visited most often, at most `count`, with their children.
fn most_visited(
    nodes: &[BinaryNode],
    collapse: &Collapse,
    density: SurfaceDensity,
    count: usize,
) -> Vec<(u32, Vec<WideChild>)> {
    let (mut found, mut next) = (Vec::new(), BinaryHeap::new());
    let mut x = if collapse.is_leaf(0) { None } else { Some(0) };
    while let Some(node) = x.filter(|_| found.len() < count) {
        let mut children = Vec::with_capacity(LANES);
        collapse.children(nodes, node, &mut children);
        for child in children.iter().filter(|child| !child.leaf) {
            let BinaryNode { bounds, moving, .. } = &nodes[child.node as usize];
            next.push((visits(bounds, *moving, density).to_bits(), Reverse(child.node)));
        }
        found.push((node, children));
        x = next.pop().map(|(_, Reverse(child))| child);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::builder::build_binary;
    use crate::geometry::Box3;
    use crate::progress::Progress;
    use crate::random::Random;
    use glam::Vec3;

    fn collapsed(nodes: &[BinaryNode]) -> Collapse {
        let cost = |node: &BinaryNode| (node.count <= 16).then_some(leaf_cost(node.count as usize));
        Collapse::new(nodes, SurfaceDensity::NONE, cost, &Progress::new(None))
    }

    /// Small boxes, some of which move, and large ones around all of them.
    fn references(large: u32, small: u32, moving: bool) -> Vec<Reference> {
        let mut random = Random(3);
        let mut references = Vec::new();
        for id in 0..large + small {
            let (spread, size) = if id < large { (20.0, 100.0) } else { (1.0, 0.01) };
            let at = random.vec() * spread;
            let end = if moving && id % 3 == 0 { Vec3::X * 0.1 } else { Vec3::ZERO };
            let [begin, end] = [Vec3::ZERO, end].map(|by| Box3 { min: at + by - size, max: at + by + size });
            references.push(Reference::new(LinearBox3 { begin, end }, id));
        }
        references
    }

    #[test]
    fn large_blocks_around_small_ones_become_one() {
        for (large, moving) in [(12, false), (12, true), (40, false)] {
            let mut references = references(large, 4000, moving);
            let nodes = build_binary(&mut references, 8..=16, None, Some(SurfaceDensity::NONE), &Progress::new(None));
            let before = collapsed(&nodes);
            let better =
                join_leaves(&nodes, &before, &mut references, SurfaceDensity::NONE, 16).expect("several blocks");
            let after = collapsed(&better);
            assert!(after.total() < 0.98 * before.total(), "{} {}", before.total(), after.total());
            let leaves = after.leaves(&better, 0);
            let mut seen = vec![0; large as usize + 4000];
            for leaf in &leaves {
                let of = &references[leaf.first as usize..][..leaf.count as usize];
                of.iter().for_each(|r| seen[r.id() as usize] += 1);
                let bounds = of.iter().fold(LinearBox3::EMPTY, |all, r| all.union(r.bounds()));
                assert_eq!((bounds, of.iter().any(Reference::moving)), (leaf.bounds, leaf.moving));
            }
            assert!(seen.iter().all(|&n| n == 1), "each reference is in one leaf");
            let blocks = |leaves: &[BinaryNode]| leaves.iter().filter(|leaf| leaf.bounds.begin.max.x > 50.0).count();
            let (now, then) = (blocks(&leaves), blocks(&before.leaves(&nodes, 0)));
            assert!(now < then && now <= large.div_ceil(16) as usize + 1, "{now} instead of {then}");
        }
    }

    #[test]
    fn trees_of_which_little_is_to_be_gained_stay_as_they_are() {
        for count in [1, 30, 4096] {
            let mut references = references(0, count, false);
            let nodes = build_binary(&mut references, 8..=16, None, None, &Progress::new(None));
            assert!(
                join_leaves(&nodes, &collapsed(&nodes), &mut references, SurfaceDensity::NONE, 16).is_none(),
                "{count}"
            );
        }
    }
}
