//! The plan of a refit: a partition of the tree into subtrees that are contiguous in the arena, so that threads can
//! write them concurrently, and the nodes above them.
//!
//! The hierarchies of time slices may share leaf blocks (*segments*). Those are stored apart, and are rewritten first.

use super::keyed_leaf::KeyedLeaf;
use super::leaf_block::WideSource;
use super::leaf_ids::Ids;
use super::sphere_leaf::SphereLeaf;
use super::wide_node::{ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS};
use super::wide_tree::WideTree;
use crate::geometry::TimeInterval;
use crate::simd::LANES;
use crate::time::time_slice;
use core::ops::Range;
use std::collections::HashMap;

/// A subtree that is contiguous in the arena.
pub(crate) struct Unit {
    pub root: ChildRef,
    /// Its words in the arena.
    pub words: Range<usize>,
    /// The time interval of its boxes.
    pub over: TimeInterval,
    /// The index of its shared leaf blocks, if it has any.
    pub shared: Option<usize>,
    /// The meshes in it, as a bit set of their indices modulo 64.
    pub meshes: u64,
    /// The sum of cost times area when it was last visited.
    pub cost: f64,
}

/// A node above units, or a time node.
pub(crate) struct Above {
    pub at: ChildRef,
    pub over: TimeInterval,
    pub shared: Option<usize>,
}

/// The leaf blocks that the time slices of a time node share, in the order of the arena.
pub(crate) struct SharedLeaves {
    pub leaves: Vec<ChildRef>,
    pub words: Range<usize>,
    pub meshes: u64,
}

/// The partition of a tree, made by its first refit.
#[derive(Default)]
pub(crate) struct Plan {
    pub units: Vec<Unit>,
    /// Children before their parents.
    pub above: Vec<Above>,
    pub shared: Vec<SharedLeaves>,
    /// The position of each of these subtrees by its root: the units, and then the nodes above.
    pub places: HashMap<u32, usize>,
    /// Cost of the tree per area of its root when it was built.
    pub built: f64,
}

/// The bit of a mesh among 64.
pub(super) fn mesh_bit(mesh: usize) -> u64 {
    1 << (mesh % 64)
}

/// The greatest number of lines of a unit: some five hundred triangles, few enough that static geometry beside moving
/// geometry is skipped, and enough that hardly any node is above the units.
const LINES: usize = 512;

/// The extent of a subtree in the arena.
struct Extent {
    /// From its first word to the end of its last one; empty if `begin` is after `end`.
    begin: usize,
    end: usize,
    lines: usize,
    meshes: u64,
    /// Whether it may be part of a unit.
    open: bool,
}

impl Plan {
    /// The plan for a finished tree. Visits every block.
    pub fn of<S: WideSource>(tree: &WideTree, set: &S) -> Plan {
        let mut plan = Plan::default();
        if tree.root != ChildRef::NOTHING && !tree.root.kind().is_leaf() {
            let whole = plan.explore(tree, set, tree.root, TimeInterval::FULL, None);
            plan.close(tree.root, whole, TimeInterval::FULL, None);
        }
        let roots = plan.units.iter().map(|unit| unit.root).chain(plan.above.iter().map(|above| above.at));
        plan.places = roots.zip(0..).map(|(root, place)| (root.0, place)).collect();
        plan
    }

    /// Makes a subtree a unit, unless it contains units already.
    fn close(&mut self, root: ChildRef, extent: Extent, over: TimeInterval, shared: Option<usize>) {
        if extent.open && !root.kind().is_leaf() {
            self.units.push(Unit {
                root,
                words: extent.begin..extent.end,
                over,
                shared,
                meshes: extent.meshes,
                cost: 0.0,
            });
        }
    }

    /// The extent of a subtree. The recursion is as deep as the tree.
    fn explore<S: WideSource>(
        &mut self,
        tree: &WideTree,
        set: &S,
        at: ChildRef,
        over: TimeInterval,
        shared: Option<usize>,
    ) -> Extent {
        let rows = match at.kind() {
            Kind::Node => NODE_ROWS,
            Kind::StaticNode => STATIC_NODE_ROWS,
            Kind::Time => return self.explore_slices(tree, set, at, over),
            _ => return self.leaf(tree, set, at, shared),
        };
        let (begin, end) = (at.at(), at.at() + rows * LANES);
        let mut all = Extent { begin, end, lines: rows, meshes: 0, open: true };
        let mut below = Vec::with_capacity(LANES);
        for child in tree.children(at).iter().map(|&child| ChildRef(child)).filter(|&c| c != ChildRef::NOTHING) {
            let extent = self.explore(tree, set, child, over, shared);
            (all.begin, all.end) = (all.begin.min(extent.begin), all.end.max(extent.end));
            all.lines += extent.lines;
            all.meshes |= extent.meshes;
            all.open &= extent.open;
            below.push((child, extent));
        }
        // The subtree is contiguous if it has as many lines as its extent.
        all.open &= all.lines <= LINES && all.lines * LANES == all.end - all.begin;
        if !all.open {
            below.into_iter().for_each(|(child, extent)| self.close(child, extent, over, shared));
            self.above.push(Above { at, over, shared });
        }
        all
    }

    fn explore_slices<S: WideSource>(&mut self, tree: &WideTree, set: &S, at: ChildRef, over: TimeInterval) -> Extent {
        let slices: Vec<ChildRef> = tree.children(at).iter().map(|&slice| ChildRef(slice)).collect();
        let mut of_all: Vec<ChildRef> = slices.iter().flat_map(|&slice| leaves(tree, slice)).collect();
        let found = of_all.len();
        of_all.sort_unstable_by_key(|leaf| leaf.0);
        of_all.dedup();
        // Slices that share leaf blocks may have no block in common if each lacks what does not exist in it. Then their blocks are
        // treated as their own.
        let shared = (of_all.len() < found).then(|| {
            let extents: Vec<Extent> = of_all.iter().map(|&leaf| self.leaf(tree, set, leaf, None)).collect();
            let meshes = extents.iter().fold(0, |meshes, extent| meshes | extent.meshes);
            let words = extents[0].begin..extents[extents.len() - 1].end;
            self.shared.push(SharedLeaves { leaves: of_all, words, meshes });
            self.shared.len() - 1
        });
        let mut meshes = 0;
        for (i, &slice) in slices.iter().enumerate() {
            let over = time_slice(i, slices.len());
            let extent = self.explore(tree, set, slice, over, shared);
            meshes |= extent.meshes;
            self.close(slice, extent, over, shared);
        }
        self.above.push(Above { at, over, shared });
        Extent { begin: at.at(), end: at.at() + LANES, lines: 1, meshes, open: false }
    }

    fn leaf<S: WideSource>(&self, tree: &WideTree, set: &S, leaf: ChildRef, shared: Option<usize>) -> Extent {
        let ids = tree.ids::<S>(leaf).unwrap_or(&[]);
        let meshes = ids.iter().fold(0, |meshes, &id| meshes | mesh_bit(set.mesh_and_primitive(id).0 as usize));
        if shared.is_some_and(|shared| self.shared[shared].words.contains(&leaf.at())) {
            return Extent { begin: usize::MAX, end: 0, lines: 0, meshes, open: true };
        }
        let lines = tree.words::<S>(leaf).div_ceil(LANES);
        Extent { begin: leaf.at(), end: leaf.at() + lines * LANES, lines, meshes, open: true }
    }
}

/// The leaf blocks of one time slice.
fn leaves(tree: &WideTree, of: ChildRef) -> Vec<ChildRef> {
    let (mut leaves, mut stack) = (Vec::new(), vec![of]);
    while let Some(at) = stack.pop() {
        if at.kind().is_leaf() {
            leaves.push(at);
        } else {
            stack.extend(tree.children(at).iter().map(|&child| ChildRef(child)).filter(|&c| c != ChildRef::NOTHING));
        }
    }
    leaves
}

impl WideTree {
    /// Number of words of a leaf block.
    fn words<S: WideSource>(&self, leaf: ChildRef) -> usize {
        if leaf.kind() == Kind::OtherLeaf && !self.is_list::<S>(leaf) {
            return KeyedLeaf::read(self.arena.ints(), leaf).words();
        }
        let block = &self.arena.ints()[leaf.at()..];
        if self.is_list::<S>(leaf) {
            return SphereLeaf::words_of_list(block, leaf.len()).unwrap_or(0);
        }
        // Ids come last.
        Ids::of(leaf, block, false).map_or(0, |ids| ids.first + ids.count)
    }
}
