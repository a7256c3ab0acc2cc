//! Replacing subtrees of a collapsed tree by separately built ones, which count as single children.

use super::builder::BinaryNode;
use super::collapse::{Collapse, Costs, Solver};
use super::visits::SurfaceDensity;
use crate::progress::Progress;
use crate::simd::{LANES, SimdLevel};

/// A subtree that is one child of the wide node above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ReplacedSubtree {
    /// Its binary node.
    pub node: u32,
    /// Its cost: the sum over its visited nodes and blocks of cost times visits.
    pub cost: f32,
}

impl Collapse {
    /// Makes subtrees single children, and repeats the decisions for the nodes above them; all others are unchanged.
    ///
    /// `replaced` must be sorted by node; none may lie below another or be the root.
    pub fn replace_subtrees(&mut self, nodes: &[BinaryNode], density: SurfaceDensity, replaced: &[ReplacedSubtree]) {
        if !replaced.is_empty() {
            // No node above a replaced subtree is a leaf block.
            let (leaf_cost, progress) = (|_: &BinaryNode| None, &Progress::new(None));
            let solver = Solver { simd: SimdLevel::best(), density, leaf_cost, progress };
            self.decide_above(&solver, nodes, 0, replaced);
        }
    }

    /// Decides for a node above replaced subtrees. The recursion is as deep as the binary tree.
    fn decide_above<L: Fn(&BinaryNode) -> Option<f32> + Sync>(
        &mut self,
        solver: &Solver<'_, L>,
        nodes: &[BinaryNode],
        x: u32,
        replaced: &[ReplacedSubtree],
    ) -> Costs {
        if let [ReplacedSubtree { node, cost }] = *replaced
            && node == x
        {
            (self.left[x as usize], self.one[x as usize]) = ([0; LANES], cost);
            return Costs { by_places: [cost; LANES], enough: 1 };
        }
        let node = &nodes[x as usize];
        let (low, high) = (x + 1, x + node.right);
        let (below_low, below_high) = replaced.split_at(replaced.partition_point(|g| g.node < high));
        let mut side = |of: u32, replaced: &[ReplacedSubtree]| match replaced.is_empty() {
            true => self.costs(nodes, of),
            false => self.decide_above(solver, nodes, of, replaced),
        };
        let (l, r) = (side(low, below_low), side(high, below_high));
        solver.join(node, (&mut self.left[x as usize], &mut self.one[x as usize]), (&l, &r))
    }

    /// The least costs of covering a subtree, by the decisions made before.
    fn costs(&self, nodes: &[BinaryNode], x: u32) -> Costs {
        let mut children = Vec::with_capacity(LANES);
        let by_places = core::array::from_fn(|i| {
            children.clear();
            self.forest(nodes, x, i as u8 + 1, &mut children);
            children.iter().map(|child| self.cost(child.node)).sum()
        });
        Costs { by_places, enough: LANES }
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
    use crate::tuning::wide::NODE_COST;
    use glam::Vec3;

    const DENSITY: SurfaceDensity = SurfaceDensity(9.0);

    fn leaf_cost(node: &BinaryNode) -> Option<f32> {
        (node.count <= 16).then_some(costs::leaf_cost(node.count as usize))
    }

    /// The cost of the wide tree by its decisions, and the replaced subtrees found in it.
    fn walk(
        nodes: &[BinaryNode],
        collapse: &Collapse,
        x: u32,
        replaced: &[ReplacedSubtree],
        met: &mut Vec<u32>,
    ) -> f64 {
        if let Some(subtree) = replaced.iter().find(|r| r.node == x) {
            met.push(x);
            return f64::from(subtree.cost);
        }
        let node = &nodes[x as usize];
        let area = f64::from(DENSITY.visits(&node.bounds));
        if collapse.is_leaf(x) {
            return f64::from(leaf_cost(node).unwrap()) * area;
        }
        let mut children = Vec::new();
        collapse.children(nodes, x, &mut children);
        assert!((2..=LANES).contains(&children.len()));
        f64::from(NODE_COST) * area + children.iter().map(|c| walk(nodes, collapse, c.node, replaced, met)).sum::<f64>()
    }

    #[test]
    fn replaced_subtrees_are_single_children_and_the_rest_has_least_cost() {
        let mut random = Random(9);
        let mut references: Vec<Reference> = (0..5000)
            .map(|id| {
                let at = Vec3::new(random.unit(), random.unit(), random.unit());
                let (a, b) = (
                    Box3 { min: at, max: at + 0.03 * random.unit() },
                    Box3 { min: at, max: at + 0.05 * random.unit() },
                );
                Reference::new(LinearBox3 { begin: a, end: b }, id)
            })
            .collect();
        let nodes = build_binary(&mut references, 4..=4, None, None, &Progress::new(None));
        let new = || Collapse::new(&nodes, DENSITY, leaf_cost, &Progress::new(None));
        // With their present cost, taken as single children.
        let mut replaced = Vec::new();
        let mut x = 0;
        while (x as usize) < nodes.len() {
            let node = &nodes[x as usize];
            let skip = if node.right == 0 { 1 } else { skipped(&nodes, x) };
            if (100..400).contains(&node.count) {
                replaced.push(ReplacedSubtree { node: x, cost: new().cost(x) });
                x += skip;
            } else {
                x += 1;
            }
        }
        assert!(replaced.len() > 8);
        let mut free = new();
        let before = free.total();
        free.replace_subtrees(&nodes, DENSITY, &[]);
        assert_eq!(free.total(), before);
        for some in [&replaced[..1], &replaced[3..5], &replaced[..]] {
            let mut collapse = new();
            collapse.replace_subtrees(&nodes, DENSITY, some);
            let mut met = Vec::new();
            let cost = walk(&nodes, &collapse, 0, some, &mut met);
            met.sort_unstable();
            assert_eq!(met, some.iter().map(|g| g.node).collect::<Vec<_>>());
            assert!((cost / f64::from(collapse.total()) - 1.0).abs() < 1e-4, "{cost} {}", collapse.total());
            // Nothing is gained, and no more lost than a level of nodes above the replaced subtrees.
            assert!(collapse.total() >= before * 0.9999 && collapse.total() < before * 1.3, "{}", collapse.total());
        }
    }

    /// Number of nodes of a subtree.
    fn skipped(nodes: &[BinaryNode], x: u32) -> u32 {
        let node = &nodes[x as usize];
        if node.right == 0 { 1 } else { node.right + skipped(nodes, x + node.right) }
    }
}
