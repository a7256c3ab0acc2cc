//! The optimal collapse of a binary tree into sixteen-way nodes, by dynamic programming.
//!
//! For every binary subtree and every `j` from 1 to 16 it computes the least cost of covering the subtree by at most
//! `j` children of some wide node above it. A single child is either a leaf block or a wide node of its own, whose
//! sixteen slots are again divided between the two halves. (The idea for four-way trees is in Pinter, "Surface area
//! heuristic for wide bounding volume hierarchies"; the recurrence is the same.)

use super::builder::BinaryNode;
use super::costs::motion_factor;
use super::visits::SurfaceDensity;
use crate::parallel;
use crate::progress::Progress;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch, huge_vec, lanes_at};
use crate::tuning::wide::NODE_COST;

/// A child of a wide node: a binary node, taken as a leaf block or as a wide node of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WideChild {
    pub node: u32,
    pub leaf: bool,
}

/// The decisions for a whole tree.
pub(crate) struct Collapse {
    /// For each node and number of slots: how many go to the left half; 0: this node is one child. For a single slot
    /// (the first entry) 0 means a leaf block, otherwise it is the share of the left half of sixteen.
    pub(super) left: Vec<[u8; LANES]>,
    /// Cost of each node as one child: the sum over its visited nodes and blocks of cost times visits.
    pub(super) one: Vec<f32>,
}

/// The least costs of covering a subtree by at most 1, 2, … 16 children.
#[derive(Clone, Copy)]
pub(super) struct Costs {
    pub by_places: Lanes<f32>,
    /// With more slots than this (at most sixteen) the cost does not decrease.
    pub enough: usize,
}

/// More subtrees than this hardly ever wait for their siblings.
const MOST_WAITING: usize = 64;

/// Trees of at least this many nodes are processed by several threads.
const PARALLEL: usize = 8192;

/// Nodes between two reports of progress. Not fitted: they take about a millisecond.
const REPORTED: usize = 4096;

impl Collapse {
    /// Decides for every node, from the leaves up. `leaf_cost` gives the cost of a node as a leaf block (relative to
    /// one visit), or `None` if it cannot be one. Once `progress` is cancelled, decisions are missing.
    pub fn new(
        nodes: &[BinaryNode],
        density: SurfaceDensity,
        leaf_cost: impl Fn(&BinaryNode) -> Option<f32> + Sync,
        progress: &Progress,
    ) -> Collapse {
        let mut left = huge_vec(nodes.len());
        left.resize(nodes.len(), [0u8; LANES]);
        let mut one = huge_vec(nodes.len());
        one.resize(nodes.len(), 0.0f32);
        if !nodes.is_empty() {
            let progress = &progress.in_units(nodes.len());
            Solver { simd: SimdLevel::best(), density, leaf_cost, progress }.subtree(nodes, &mut left, &mut one);
        }
        Collapse { left, one }
    }

    /// Cost of the whole tree.
    pub fn total(&self) -> f32 {
        self.cost(0)
    }

    /// Cost of a subtree: the sum over its visited nodes and blocks of cost times visits.
    pub fn cost(&self, node: u32) -> f32 {
        self.one.get(node as usize).copied().unwrap_or(0.0)
    }

    /// Whether a node, taken as one child, is a leaf block.
    pub fn is_leaf(&self, node: u32) -> bool {
        self.left[node as usize][0] == 0
    }

    /// The children of a wide node, at most sixteen, from left to right.
    pub fn children(&self, nodes: &[BinaryNode], of: u32, out: &mut Vec<WideChild>) {
        out.clear();
        let share = self.left[of as usize][0];
        self.forest(nodes, of + 1, share, out);
        self.forest(nodes, of + nodes[of as usize].right, LANES as u8 - share, out);
    }

    /// The binary nodes in the subtree `of` that become leaf blocks, from left to right within each wide node.
    pub fn leaves(&self, nodes: &[BinaryNode], of: u32) -> Vec<BinaryNode> {
        if self.is_leaf(of) {
            return vec![nodes[of as usize]];
        }
        let mut leaves = Vec::new();
        let mut children = Vec::with_capacity(LANES);
        let mut inner = vec![of];
        while let Some(x) = inner.pop() {
            self.children(nodes, x, &mut children);
            leaves.extend(children.iter().filter(|c| c.leaf).map(|c| nodes[c.node as usize]));
            inner.extend(children.iter().rev().filter(|c| !c.leaf).map(|c| c.node));
        }
        leaves
    }

    /// Covers a subtree by at most `places` children. The recursion is at most sixteen deep: every level divides the
    /// slots, and both halves get at least one.
    pub(super) fn forest(&self, nodes: &[BinaryNode], x: u32, places: u8, out: &mut Vec<WideChild>) {
        let share = if places > 1 { self.left[x as usize][places as usize - 1] } else { 0 };
        if share == 0 {
            out.push(WideChild { node: x, leaf: self.is_leaf(x) });
            return;
        }
        self.forest(nodes, x + 1, share, out);
        self.forest(nodes, x + nodes[x as usize].right, places - share, out);
    }
}

/// The inputs of the decisions.
pub(super) struct Solver<'a, L> {
    pub simd: SimdLevel,
    /// Predicts how often boxes are visited.
    pub density: SurfaceDensity,
    pub leaf_cost: L,
    /// In nodes.
    pub progress: &'a Progress<'a>,
}

impl<L: Fn(&BinaryNode) -> Option<f32> + Sync> Solver<'_, L> {
    /// Decides for a subtree: `nodes` in preorder, and the slices of the decisions that belong to them.
    fn subtree(&self, nodes: &[BinaryNode], left: &mut [[u8; LANES]], one: &mut [f32]) -> Costs {
        if nodes.len() > PARALLEL && nodes[0].right > 0 && parallel::threads() > 1 {
            let right = nodes[0].right as usize;
            let ((left0, left), (one0, one)) = (left.split_at_mut(1), one.split_at_mut(1));
            let (left_low, left_high) = left.split_at_mut(right - 1);
            let (one_low, one_high) = one.split_at_mut(right - 1);
            let (low, high) = parallel::both(
                || self.subtree(&nodes[1..right], left_low, one_low),
                || self.subtree(&nodes[right..], left_high, one_high),
            );
            return self.join(&nodes[0], (&mut left0[0], &mut one0[0]), (&low, &high));
        }
        dispatch(self.simd, Sweep { solver: self, nodes, left, one })
    }

    /// Decides for a node above two solved subtrees.
    pub fn join(&self, node: &BinaryNode, own: (&mut [u8; LANES], &mut f32), children: (&Costs, &Costs)) -> Costs {
        dispatch(self.simd, Join { solver: self, node, own, children })
    }

    /// Decides for one node, given the costs of its halves.
    #[inline(always)]
    fn node<S: Simd>(
        &self,
        s: S,
        node: &BinaryNode,
        (left, one): (&mut [u8; LANES], &mut f32),
        (l, r): (&Costs, &Costs),
    ) -> Costs {
        // best[j] covers both halves by j + 1 children together; of equal costs the smallest share of the left wins.
        let mut shifted = [f32::INFINITY; 2 * LANES];
        shifted[LANES..].copy_from_slice(&r.by_places);
        let (mut best, mut share) = (s.splat(f32::INFINITY), s.splat_u(0));
        for i in 0..l.enough.min(LANES - 1) {
            let sum = s.splat(l.by_places[i]) + s.load(lanes_at(&shifted, LANES - 1 - i));
            let better = s.lt(sum, best);
            best = s.select(better, sum, best);
            share = s.select_u(better, s.splat_u(i as u32 + 1), share);
        }
        let (visits, factor) = (self.density.visits(&node.bounds), motion_factor(node.moving));
        let as_leaf = (self.leaf_cost)(node).map_or(f32::INFINITY, |c| c * visits * factor);
        let as_node = NODE_COST * factor * visits + s.lane(best, LANES - 1);
        *one = as_leaf.min(as_node);
        // More slots never cost more, so a single child at most ties; a tie goes to it: fewer boxes.
        let single = s.splat(*one);
        let divide = s.lt(best, single);
        let mut shares = [0; LANES];
        s.store_u(share, &mut shares);
        for (j, out) in left.iter_mut().enumerate() {
            *out = if divide >> j & 1 != 0 { shares[j] as u8 } else { 0 };
        }
        left[0] = if as_leaf <= as_node { 0 } else { shares[LANES - 1] as u8 };
        let mut costs = Costs { by_places: [0.0; LANES], enough: (l.enough + r.enough).min(LANES) };
        s.store(s.select(divide, best, single), &mut costs.by_places);
        costs
    }
}

/// A node above two solved subtrees.
struct Join<'a, L> {
    solver: &'a Solver<'a, L>,
    node: &'a BinaryNode,
    own: (&'a mut [u8; LANES], &'a mut f32),
    children: (&'a Costs, &'a Costs),
}

impl<L: Fn(&BinaryNode) -> Option<f32> + Sync> Kernel for Join<'_, L> {
    type Output = Costs;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Costs {
        self.solver.node(s, self.node, self.own, self.children)
    }
}

/// A whole subtree, last node first: the costs of subtrees whose parents are still to come form a stack.
struct Sweep<'a, L> {
    solver: &'a Solver<'a, L>,
    nodes: &'a [BinaryNode],
    left: &'a mut [[u8; LANES]],
    one: &'a mut [f32],
}

impl<L: Fn(&BinaryNode) -> Option<f32> + Sync> Kernel for Sweep<'_, L> {
    type Output = Costs;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Costs {
        let nothing = Costs { by_places: [0.0; LANES], enough: 1 };
        let mut waiting: Vec<Costs> = Vec::with_capacity(self.nodes.len().min(MOST_WAITING));
        let decisions = self.left.rchunks_mut(REPORTED).zip(self.one.rchunks_mut(REPORTED));
        for (nodes, (left, one)) in self.nodes.rchunks(REPORTED).zip(decisions) {
            if self.solver.progress.cancelled() {
                break;
            }
            for ((node, left), one) in nodes.iter().zip(left).zip(one).rev() {
                let costs = if node.right == 0 {
                    let cost = (self.solver.leaf_cost)(node).unwrap_or(f32::INFINITY);
                    *one = cost * self.solver.density.visits(&node.bounds) * motion_factor(node.moving);
                    Costs { by_places: [*one; LANES], enough: 1 }
                } else {
                    let l = waiting.pop().unwrap_or(nothing);
                    let r = waiting.pop().unwrap_or(nothing);
                    self.solver.node(s, node, (left, one), (&l, &r))
                };
                waiting.push(costs);
            }
            self.solver.progress.finished(nodes.len() as f64);
        }
        waiting.pop().unwrap_or(nothing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::builder::build_binary;
    use crate::bvh::costs;
    use crate::bvh::reference::Reference;
    use crate::geometry::{Box3, LinearBox3};
    use crate::random::Random;
    use glam::Vec3;

    const DENSITY: SurfaceDensity = SurfaceDensity(9.0);

    fn leaf_cost(node: &BinaryNode) -> Option<f32> {
        (node.count <= 16).then_some(costs::leaf_cost(node.count as usize))
    }

    /// How often a node is visited, by cost.
    fn weight(node: &BinaryNode) -> f64 {
        f64::from(DENSITY.visits(&node.bounds)) * f64::from(motion_factor(node.moving))
    }

    /// The recurrence, computed directly.
    fn least(nodes: &[BinaryNode], x: usize) -> [f64; LANES] {
        let node = &nodes[x];
        let weight = weight(node);
        let as_leaf = leaf_cost(node).map_or(f64::INFINITY, |c| f64::from(c) * weight);
        if node.right == 0 {
            return [as_leaf; LANES];
        }
        let (l, r) = (least(nodes, x + 1), least(nodes, x + node.right as usize));
        let forest = |places: usize| (1..places).map(|i| l[i - 1] + r[places - i - 1]).fold(f64::INFINITY, f64::min);
        let one = as_leaf.min(f64::from(NODE_COST) * weight + forest(LANES));
        core::array::from_fn(|j| (1..=j + 1).map(forest).fold(one, f64::min))
    }

    fn cost_of(nodes: &[BinaryNode], collapse: &Collapse, x: u32) -> f64 {
        let node = &nodes[x as usize];
        let weight = weight(node);
        if collapse.is_leaf(x) {
            return f64::from(leaf_cost(node).unwrap()) * weight;
        }
        let mut children = Vec::new();
        collapse.children(nodes, x, &mut children);
        assert!((2..=LANES).contains(&children.len()));
        f64::from(NODE_COST) * weight + children.iter().map(|c| cost_of(nodes, collapse, c.node)).sum::<f64>()
    }

    #[test]
    fn the_collapse_costs_what_the_recurrence_says() {
        let mut random = Random(5);
        for n in [1, 5, 17, 64, 700, 20_000] {
            let mut references: Vec<Reference> = (0..n)
                .map(|id| {
                    let begin = Vec3::new(random.unit(), random.unit(), random.unit());
                    let end = if id % 3 == 0 {
                        begin
                    } else {
                        begin + 0.1 * Vec3::new(random.unit(), random.unit(), random.unit())
                    };
                    let around = |p: Vec3, r: f32| Box3 { min: p, max: p + r };
                    let size = 0.1 * random.unit();
                    Reference::new(LinearBox3 { begin: around(begin, size), end: around(end, size) }, id)
                })
                .collect();
            let nodes = build_binary(&mut references, 4..=4, None, None, &Progress::new(None));
            let collapse = Collapse::new(&nodes, DENSITY, leaf_cost, &Progress::new(None));
            let (expected, made) = (least(&nodes, 0)[0], cost_of(&nodes, &collapse, 0));
            assert!((made / expected - 1.0).abs() < 1e-4, "{n}: {made} instead of {expected}");
            assert!((f64::from(collapse.total()) / expected - 1.0).abs() < 1e-4);
            let leaves = collapse.leaves(&nodes, 0);
            assert_eq!(leaves.iter().map(|l| l.count).sum::<u32>(), n);
        }
    }
}
