//! Top-down construction of the paper's tree.
//!
//! One recursion for primitives and points ([`Moving`] is what differs). A node's plane is chosen by its Normal
//! references at mid-shutter; they are duplicated, its BP references propagated ([`Children`]), and the children built
//! in turn, in parallel if they are large. The result of a node depends on its own references and budgets only, so the
//! tree is the same for any number of threads.
//!
//! Budgets: the leaves below a node may have a limited number of references altogether. A plane that needs more is
//! rejected (the node becomes a leaf); the rest of the budget is divided between the children by the number of their
//! references.

use super::build_times::BuildTimes;
use super::kd_tree::{KdNode, KdReference, KdTree};
use super::partition::{Children, References};
use super::reference::{Moving, Reference};
use crate::geometry::{Box3, LinearBox3, Plane};
use crate::limits::MAX_NODES;
use crate::parallel;
use crate::progress::Progress;
use std::time::Instant;

/// Subtrees with fewer references are built on the thread that split them off.
const PARALLEL_FROM: usize = 4096;
/// Below this depth no subtree is given to other threads: merging costs a copy of the subtree per level.
const PARALLEL_DEPTH: u32 = 8;

/// The limits of a build. Reaching a limit makes a leaf.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Budget {
    /// The greatest depth, at most [`DEPTH_LIMIT`](crate::limits::DEPTH_LIMIT).
    pub depth: u32,
    /// The greatest number of references in all leaves.
    pub references: f64,
    /// Whether a BP reference that lies on one side of a plane contributes to the choice of planes again.
    pub propagated_vote: bool,
}

/// Builds a k-d tree over objects with these references, within `root`, which holds all of them at all times. The tree
/// is invalid if the build was cancelled, or if it exceeds the limits of the layout.
pub(crate) fn build<M: Moving>(
    objects: &M,
    references: Vec<Reference<M::Bounds>>,
    root: Box3,
    budget: Budget,
    progress: &Progress,
) -> (KdTree, BuildTimes) {
    let builder = Builder { objects, budget, progress };
    let node = Node {
        cell: LinearBox3 { begin: root, end: root },
        references: References { normal: references, bp: Vec::new() },
        depth: 0,
        budget: budget.references.min(f64::from(u32::MAX)) as u64,
        fraction: 1.0,
    };
    let mut out = Output::default();
    builder.build(node, &mut out);
    out.nodes.shrink_to_fit();
    out.references.shrink_to_fit();
    (KdTree { root, nodes: out.nodes, references: out.references, depth: out.depth }, out.times)
}

/// A node under construction.
struct Node<B> {
    /// The cell at shutter open and close.
    cell: LinearBox3,
    references: References<B>,
    depth: u32,
    /// References that the leaves below may hold altogether.
    budget: u64,
    /// The node's share of the work, for progress.
    fraction: f64,
}

/// A finished subtree; indices are relative to its begin.
#[derive(Default)]
struct Output {
    nodes: Vec<KdNode>,
    references: Vec<KdReference>,
    depth: u32,
    times: BuildTimes,
}

impl Output {
    /// Appends a subtree behind this one.
    fn append(&mut self, other: Output) {
        let (node_base, reference_base) = (self.nodes.len() as u32, self.references.len() as u32);
        self.nodes.extend(other.nodes.iter().map(|n| n.shifted(node_base, reference_base)));
        self.references.extend_from_slice(&other.references);
        self.depth = self.depth.max(other.depth);
        self.times.add(other.times);
    }
}

struct Builder<'a, M> {
    objects: &'a M,
    budget: Budget,
    progress: &'a Progress<'a>,
}

impl<M: Moving> Builder<'_, M> {
    /// Appends the subtree of a node to `out`. Recursion is bounded by the depth budget.
    fn build(&self, node: Node<M::Bounds>, out: &mut Output) {
        out.depth = out.depth.max(node.depth);
        let Some((plane, [left, right])) = self.split(&node, &mut out.times) else {
            return self.leaf(&node, out);
        };
        let large = left.references.len().min(right.references.len()) >= PARALLEL_FROM;
        let parallel = large && node.depth < PARALLEL_DEPTH;
        drop(node);
        let at = out.nodes.len();
        out.nodes.push(KdNode::leaf(0, 0));
        if parallel {
            let subtree = |node| {
                let mut out = Output::default();
                self.build(node, &mut out);
                out
            };
            let (left, right) = parallel::both(|| subtree(left), || subtree(right));
            out.append(left);
            out.nodes[at] = KdNode::inner(plane, self.checked(out.nodes.len()));
            out.append(right);
        } else {
            self.build(left, out);
            out.nodes[at] = KdNode::inner(plane, self.checked(out.nodes.len()));
            self.build(right, out);
        }
    }

    /// A node index; if it is out of range, the build is about to fail with an error.
    fn checked(&self, index: usize) -> u32 {
        index.min(MAX_NODES - 1) as u32
    }

    fn leaf(&self, node: &Node<M::Bounds>, out: &mut Output) {
        let first = out.references.len() as u32;
        out.references.extend(node.references.iter().map(|r| KdReference::new(r.id, r.interval)));
        // In the order of ids: better locality, and independent of the order of the partition.
        out.references[first as usize..].sort_unstable_by_key(|r| (r.id, r.begin.to_bits()));
        out.nodes.push(KdNode::leaf(first, node.references.len() as u32));
        self.progress.finished(node.fraction);
    }

    /// The plane and the children; `None` if the node becomes a leaf.
    fn split(&self, node: &Node<M::Bounds>, times: &mut BuildTimes) -> Option<(Plane, [Node<M::Bounds>; 2])> {
        let references = &node.references;
        if node.depth >= self.budget.depth || references.len() < 2 || self.progress.cancelled() {
            return None;
        }
        let start = Instant::now();
        let plane = self.objects.choose(&references.normal, &references.bp, node.cell);
        let chosen = Instant::now();
        times.planes += chosen - start;
        let plane = plane?;

        let mut children = Children::new(self.objects, plane, node.cell);
        for r in &references.normal {
            children.duplicate(r);
        }
        let duplicated = Instant::now();
        times.duplication += duplicated - chosen;
        for r in &references.bp {
            children.propagate(r, self.budget.propagated_vote);
        }
        times.propagation += duplicated.elapsed();

        let [l, r] = [0, 1].map(|side| children.references[side].len());
        let sum = (l + r) as u64;
        if sum > node.budget || !self.objects.worthwhile(references.len(), [l, r]) {
            return None;
        }
        let spare = (node.budget - sum) as f64;
        let share = |n: usize| if sum > 0 { n as f64 / sum as f64 } else { 0.5 };
        let [left, right] = children.references;
        let child = |side: usize, references: References<M::Bounds>| Node {
            cell: children.cells[side],
            budget: references.len() as u64 + (spare * share(references.len())) as u64,
            fraction: node.fraction * share(references.len()),
            references,
            depth: node.depth + 1,
        };
        Some((plane, [child(0, left), child(1, right)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kd::{KdView, build_kd};
    use crate::params::KdParams;
    use crate::primitive::{TriangleMesh, Triangles};
    use crate::scene;
    use glam::Vec3;

    #[cfg(feature = "rayon")]
    #[test]
    fn the_same_tree_on_any_number_of_threads() {
        for params in [KdParams::paper(), KdParams { moving_planes: true, ..KdParams::paper() }] {
            for name in ["hairball", "hall"] {
                let scene = (scene::find(name).unwrap().make)(12_000);
                let set = Triangles::new(&scene.meshes).unwrap();
                let on = |threads| {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    pool.install(|| build_kd(&set, &params, &Progress::new(None)).unwrap().0)
                };
                let one = on(1);
                let references = one.references.len();
                assert!(references > 4 * PARALLEL_FROM, "large enough to be divided: {references} references");
                for threads in [2, 3, 8] {
                    assert!(on(threads) == one, "{name} with {threads} threads");
                }
            }
        }
    }

    #[test]
    fn the_budget_bounds_references_and_is_used() {
        let scene = (scene::find("tornado").unwrap().make)(5_000);
        let set = Triangles::new(&scene.meshes).unwrap();
        let mut before = 0;
        for max_references in [1.0, 2.0, 8.0, 30.0] {
            let params = KdParams { max_references, ..KdParams::paper() };
            let (tree, _) = build_kd(&set, &params, &Progress::new(None)).unwrap();
            let n = tree.references.len();
            assert!(n <= (max_references * 5_000.0) as usize && n >= before, "{n} with {max_references}");
            before = n;
        }
        assert!(before > 5 * 5_000);
    }

    #[test]
    fn depth_is_a_budget_too() {
        let scene = (scene::find("hall").unwrap().make)(5_000);
        let set = Triangles::new(&scene.meshes).unwrap();
        for max_depth in [0, 1, 7] {
            let params = KdParams { max_depth: Some(max_depth), ..KdParams::paper() };
            let (tree, _) = build_kd(&set, &params, &Progress::new(None)).unwrap();
            assert_eq!((tree.depth, tree.validate(&set)), (max_depth, Ok(())));
        }
    }

    /// A swarm flies into a cell that is empty at mid-shutter: it has BP references only, and is split nevertheless.
    #[test]
    fn a_cell_that_is_only_visited_is_no_single_leaf() {
        let (side, mut open) = (24, Vec::new());
        for i in 0..side * side {
            let at = Vec3::new(-1.0, (i % side) as f32, (i / side) as f32 * 1.1);
            open.extend([at, at + Vec3::Y * 0.5, at + Vec3::Z * 0.5]);
        }
        let close = open.iter().map(|p| p + Vec3::X * 1.5).collect();
        let triangles = (0..(side * side) as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let set = Triangles::new(&[TriangleMesh::new(triangles, vec![open, close])]).unwrap();
        let (tree, _) = build_kd(&set, &KdParams::paper(), &Progress::new(None)).unwrap();
        assert_eq!(tree.validate(&set), Ok(()));
        let leaves = tree.nodes.iter().filter_map(|node| match node.view() {
            KdView::Leaf { count, .. } => Some(count),
            KdView::Inner { .. } => None,
        });
        assert!(leaves.max() < Some(32));
    }
}
