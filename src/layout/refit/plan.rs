//! The plan of a refit: a partition of the tree into subtrees that are contiguous in the arena, so that threads can
//! write them concurrently, and the nodes above them.
//!
//! It also says which parts of split triangles leaf blocks hold ([`super::parts`]).
//!
//! Leaf blocks that hierarchies of time slices share are stored apart, and are rewritten first.

use super::built_place::BuiltPlace;
use super::parts::Parts;
use super::shared_blocks::{SharedBlocks, shared_leaves};
use crate::geometry::TimeInterval;
use crate::layout::leaf::ids::ids_of_leaf;
use crate::layout::leaf::keyed::KeyedLeaf;
use crate::layout::leaf::source::WideSource;
use crate::layout::leaf::spheres::SphereLeaf;
use crate::layout::wide_node::{ChildRef, Kind, node_rows};
use crate::layout::wide_tree::WideTree;
use crate::simd::LANES;
use crate::time::time_slice;
use core::ops::Range;
use std::collections::HashMap;

/// A subtree that is contiguous in the arena.
#[derive(Clone)]
pub(crate) struct Unit {
    pub root: ChildRef,
    /// Its words in the arena.
    pub words: Range<usize>,
    /// The time interval of its boxes.
    pub over: TimeInterval,
    /// The time slice with shared leaf blocks that it is in, if any.
    pub slice: Option<SharingSlice>,
    /// The sum of cost times area when it was last visited.
    pub cost: f64,
}

/// A node above units, or a time node.
#[derive(Clone)]
pub(crate) struct Above {
    pub at: ChildRef,
    pub over: TimeInterval,
    pub slice: Option<SharingSlice>,
}

/// A time slice whose leaf blocks are shared.
#[derive(Clone, Copy)]
pub(crate) struct SharingSlice {
    /// The index of the leaf blocks that it shares with others.
    pub shared: usize,
    /// Its number.
    pub index: usize,
}

/// The meshes that have primitives in some parts of a tree.
#[derive(Clone, Default)]
struct Holders(
    /// The mesh and the index of the part, sorted.
    Vec<(u32, u32)>,
);

impl Holders {
    /// Records that a part holds these meshes, of which some may be repeated.
    fn add(&mut self, meshes: &mut [u32], part: usize) {
        meshes.sort_unstable();
        self.0.extend(meshes.chunk_by(|a, b| a == b).map(|same| (same[0], part as u32)));
    }

    fn of_mesh(&self, mesh: u32) -> impl Iterator<Item = usize> {
        let first = self.0.partition_point(|&(other, _)| other < mesh);
        self.0[first..].iter().take_while(move |&&(other, _)| other == mesh).map(|&(_, part)| part as usize)
    }

    /// Which of `parts` parts hold one of these meshes.
    fn of_meshes(&self, meshes: &[u32], parts: usize) -> Vec<bool> {
        let mut found = vec![false; parts];
        meshes.iter().flat_map(|&mesh| self.of_mesh(mesh)).for_each(|part| found[part] = true);
        found
    }
}

/// The parts of a plan in which something may have changed.
pub(in crate::layout) struct Touched {
    pub units: Vec<bool>,
    pub shared: Vec<bool>,
}

/// The partition of a tree, made by its first refit.
#[derive(Clone, Default)]
pub(crate) struct RefitPlan {
    pub units: Vec<Unit>,
    /// Children before their parents.
    pub above: Vec<Above>,
    pub shared: Vec<SharedBlocks>,
    /// The position of each of these subtrees by its root: the units, and then the nodes above.
    pub places: HashMap<u32, usize>,
    /// Cost of the tree per area of its root when it was built.
    pub built: f64,
    /// Where it was then; `None` if it is empty.
    pub place: Option<BuiltPlace>,
    /// What leaf blocks hold of triangles that were split.
    pub(in crate::layout) parts: Parts,
    /// The leaf blocks that hold primitives of several meshes.
    mixed: Vec<ChildRef>,
    units_of: Holders,
    shared_of: Holders,
    mixed_of: Holders,
}

/// The greatest number of lines of a unit: some five hundred triangles, few enough that static geometry beside moving
/// geometry is skipped, and enough that hardly any node is above the units.
const LINES: usize = 512;

/// The extent of a subtree in the arena.
struct ArenaExtent {
    /// From its first word to the end of its last one; empty if `begin` is after `end`.
    begin: usize,
    end: usize,
    lines: usize,
    /// Its meshes in [`Exploration::meshes`].
    meshes: Range<usize>,
    /// Whether it may be part of a unit.
    open: bool,
}

/// The search for the units of a tree.
struct Exploration<'a, S> {
    tree: &'a WideTree,
    set: &'a S,
    plan: RefitPlan,
    /// The meshes of subtrees that may be part of a unit, some of them repeated.
    meshes: Vec<u32>,
}

impl RefitPlan {
    /// The plan for a finished tree. Visits every block.
    pub fn of<S: WideSource>(tree: &WideTree, set: &S) -> RefitPlan {
        let mut exploration = Exploration { tree, set, plan: RefitPlan::default(), meshes: Vec::new() };
        if tree.root != ChildRef::NOTHING && !tree.root.kind().is_leaf() {
            let whole = exploration.explore(tree.root, TimeInterval::FULL, None);
            exploration.close(tree.root, whole, TimeInterval::FULL, None);
        }
        let mut plan = exploration.plan;
        plan.units_of.0.sort_unstable();
        plan.shared_of.0.sort_unstable();
        plan.mixed_of.0.sort_unstable();
        let roots = plan.units.iter().map(|unit| unit.root).chain(plan.above.iter().map(|above| above.at));
        plan.places = roots.zip(0..).map(|(root, place)| (root.0, place)).collect();
        plan
    }

    /// The parts that hold one of these meshes; all of them for `None`.
    pub(in crate::layout) fn touched(&self, meshes: Option<&[u32]>) -> Touched {
        let (units, shared) = (self.units.len(), self.shared.len());
        match meshes {
            None => Touched { units: vec![true; units], shared: vec![true; shared] },
            Some(meshes) => {
                let units = self.units_of.of_meshes(meshes, units);
                let mut shared = self.shared_of.of_meshes(meshes, shared);
                // A unit reads the results for its shared leaf blocks, though it may be others that changed.
                for slice in self.units.iter().zip(&units).filter_map(|(unit, &touched)| unit.slice.filter(|_| touched))
                {
                    shared[slice.shared] = true;
                }
                Touched { units, shared }
            }
        }
    }
}

impl<S: WideSource> Exploration<'_, S> {
    /// Makes a subtree a unit, unless it contains units already.
    fn close(&mut self, root: ChildRef, extent: ArenaExtent, over: TimeInterval, slice: Option<SharingSlice>) {
        if extent.open && !root.kind().is_leaf() {
            self.plan.units_of.add(&mut self.meshes[extent.meshes], self.plan.units.len());
            self.plan.units.push(Unit { root, words: extent.begin..extent.end, over, slice, cost: 0.0 });
        }
    }

    /// The extent of a subtree. The recursion is as deep as the tree.
    fn explore(&mut self, at: ChildRef, over: TimeInterval, slice: Option<SharingSlice>) -> ArenaExtent {
        let rows = match at.kind() {
            Kind::Time => return self.explore_slices(at, over),
            kind if kind.is_leaf() => return self.leaf(at, slice),
            kind => node_rows(kind),
        };
        let (begin, end, first) = (at.at(), at.at() + rows * LANES, self.meshes.len());
        let mut all = ArenaExtent { begin, end, lines: rows, meshes: first..first, open: true };
        let mut below = Vec::with_capacity(LANES);
        for (lane, child) in self.tree.lanes(at) {
            if self.tree.presplit && child.kind().is_leaf() {
                self.plan.parts.add(self.tree, self.set, (at, lane), child, over);
            }
            let extent = self.explore(child, over, slice);
            (all.begin, all.end) = (all.begin.min(extent.begin), all.end.max(extent.end));
            all.lines += extent.lines;
            all.open &= extent.open;
            below.push((child, extent));
        }
        all.meshes.end = self.meshes.len();
        // The subtree is contiguous if it has as many lines as its extent.
        all.open &= all.lines <= LINES && all.lines * LANES == all.end - all.begin;
        if !all.open {
            below.into_iter().for_each(|(child, extent)| self.close(child, extent, over, slice));
            self.plan.above.push(Above { at, over, slice });
            // Nothing above is part of a unit.
            self.meshes.truncate(first);
        }
        all
    }

    fn explore_slices(&mut self, at: ChildRef, over: TimeInterval) -> ArenaExtent {
        let slices: Vec<ChildRef> = self.tree.children(at).collect();
        let of_slices: Vec<Vec<ChildRef>> = slices.iter().map(|&slice| self.tree.leaves_below(slice)).collect();
        let first = self.meshes.len();
        // Slices that share leaf blocks may have no block in common if each lacks what does not exist in it. Then their blocks are
        // treated as their own.
        let shared = shared_leaves(&of_slices).map(|leaves| {
            let end = leaves.iter().fold(0, |_, of| self.leaf(of.leaf, None).end);
            self.plan.shared_of.add(&mut self.meshes[first..], self.plan.shared.len());
            self.plan.shared.push(SharedBlocks::new(leaves, end, slices.len()));
            self.plan.shared.len() - 1
        });
        let numbered = |index: usize| shared.map(|shared| SharingSlice { shared, index });
        for (i, &slice) in slices.iter().enumerate() {
            let over = time_slice(i, slices.len());
            let extent = self.explore(slice, over, numbered(i));
            self.close(slice, extent, over, numbered(i));
            self.meshes.truncate(first);
        }
        self.plan.above.push(Above { at, over, slice: numbered(0) });
        ArenaExtent { begin: at.at(), end: at.at() + LANES, lines: 1, meshes: first..first, open: false }
    }

    fn leaf(&mut self, leaf: ChildRef, slice: Option<SharingSlice>) -> ArenaExtent {
        let first = self.meshes.len();
        for &id in self.tree.ids(leaf).unwrap_or(&[]) {
            let mesh = self.set.mesh_and_primitive(id).0;
            if self.meshes.last() != Some(&mesh) || self.meshes.len() == first {
                self.meshes.push(mesh);
            }
        }
        let meshes = first..self.meshes.len();
        if slice.is_some_and(|slice| self.plan.shared[slice.shared].have(leaf)) {
            return ArenaExtent { begin: usize::MAX, end: 0, lines: 0, meshes, open: true };
        }
        if meshes.len() > 1 {
            self.plan.mixed_of.add(&mut self.meshes[first..], self.plan.mixed.len());
            self.plan.mixed.push(leaf);
        }
        let lines = self.tree.words(leaf).div_ceil(LANES);
        ArenaExtent { begin: leaf.at(), end: leaf.at() + lines * LANES, lines, meshes, open: true }
    }
}

/// The numbers of the meshes that are marked.
pub(in crate::layout) fn moved_meshes(moved: &[bool]) -> Vec<u32> {
    (0..).zip(moved).filter(|&(_, &moved)| moved).map(|(mesh, _)| mesh).collect()
}

impl WideTree {
    /// The triangles of other meshes whose vertices a refit reads if these meshes move: those in the leaf blocks that it rewrites,
    /// and in the few leaf blocks that are the whole tree or a whole time slice, since these have no box in a node. `None` if there
    /// are more than `most`.
    pub fn beside<S: WideSource>(&self, set: &S, moved: &[bool], plan: &RefitPlan, most: usize) -> Option<Vec<u32>> {
        let touched = plan.mixed_of.of_meshes(&moved_meshes(moved), plan.mixed.len());
        let mixed = plan.mixed.iter().zip(touched).filter(|&(_, touched)| touched).map(|(&leaf, _)| leaf);
        let times = plan.above.iter().filter(|above| above.at.kind() == Kind::Time);
        let slices = times.flat_map(|above| self.children(above.at));
        let whole = slices.chain([self.root]).filter(|&child| child != ChildRef::NOTHING && child.kind().is_leaf());
        let ids = mixed.chain(whole).flat_map(|leaf| self.ids(leaf).unwrap_or(&[])).copied();
        // A triangle may be in several blocks.
        let (mut found, mut beside) = (vec![false; set.len()], Vec::new());
        for id in ids.filter(|&id| !set.is_listed(id) && !moved[set.mesh_and_primitive(id).0 as usize]) {
            if !core::mem::replace(&mut found[id as usize], true) {
                if beside.len() == most {
                    return None;
                }
                beside.push(id);
            }
        }
        beside.sort_unstable();
        Some(beside)
    }

    /// Number of words of a leaf block.
    fn words(&self, leaf: ChildRef) -> usize {
        let block = &self.arena.ints()[leaf.at()..];
        match leaf.kind() {
            _ if self.is_list(leaf) => SphereLeaf::words_of_list(block, leaf.len()).unwrap_or(0),
            Kind::OtherLeaf => KeyedLeaf::of(block, leaf.len()).words(),
            // Ids come last.
            _ => ids_of_leaf(leaf, block, false).map_or(0, |ids| ids.end),
        }
    }
}
