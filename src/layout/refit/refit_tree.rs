//! Refitting: new positions for a tree with the same structure.
//!
//! The coordinates of primitives that moved are rewritten in their leaf blocks, and boxes are recomputed from the leaves up, all in
//! place. If nothing changed below a box, the box is kept. So the static parts of a scene do not become worse. Of triangles that
//! were split before the build, a leaf block holds the same part as before ([`super::parts`]). Subtrees that are contiguous
//! in the arena are refitted by any thread ([`super::plan`]), and the nodes above them last.
//!
//! The answers stay those of brute force, but the tree may become slower. Its cost is the sum over nodes and leaf blocks of the
//! cost of a visit times area, per area of the root. This is nearly what the build minimizes (MacDonald and Booth, "Heuristics for
//! ray tracing using space subdivision", 1990). Its growth tells when a new tree is better (Lauterbach et al., "RT-DEFORM", 2006,
//! use ratios of areas).

use super::parts::Parts;
use super::plan::{Above, RefitPlan, SharingSlice, Touched, moved_meshes};
use super::shared_blocks::{SharedBlocks, SharedBounds, SharedLeaf};
use crate::bvh::{leaf_cost, mean_half_area, motion_factor};
use crate::geometry::{Aabb, Box3, LinearBounds, LinearBox3, TimeInterval, ULP};
use crate::layout::leaf::ids::ids_of_leaf;
use crate::layout::leaf::source::{MovedLeaf, WideSource};
use crate::layout::node_boxes::{BoxRows, read_box};
use crate::layout::wide_node::{ChildRef, Kind, node_rows};
use crate::layout::wide_tree::WideTree;
use crate::parallel;
use crate::simd::{LANES, Lanes, Mask, SimdLevel, lanes_at, lanes_of, prefetch};
use crate::time::time_slice;
use crate::tuning::wide::NODE_COST;
use core::ops::Range;
use core::{array, iter};
use std::collections::HashMap;

/// The meshes that may have changed since the tree was written.
#[derive(Clone, Debug)]
pub(crate) enum Moved {
    All,
    /// For each mesh, and after them for the shapes, whether it may have changed.
    Some(Vec<bool>),
    /// Nothing changed, but everything is to be visited.
    Nothing,
}

impl Moved {
    fn any<S: WideSource>(&self, set: &S, ids: &[u32]) -> bool {
        match self {
            Moved::All => true,
            Moved::Some(meshes) => ids.iter().any(|&id| meshes[set.mesh_and_primitive(id).0 as usize]),
            Moved::Nothing => false,
        }
    }

    /// The numbers of the meshes, unless everything is to be visited.
    fn list(&self) -> Option<Vec<u32>> {
        match self {
            Moved::Some(meshes) => Some(moved_meshes(meshes)),
            Moved::All | Moved::Nothing => None,
        }
    }
}

/// The work of a refit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Done {
    /// Nodes and leaf blocks that were rewritten.
    pub nodes: usize,
    pub leaves: usize,
    /// Blocks that were visited, including those that were rewritten.
    pub visited: usize,
}

impl Done {
    fn add(self, other: Done) -> Done {
        Done {
            nodes: self.nodes + other.nodes,
            leaves: self.leaves + other.leaves,
            visited: self.visited + other.visited,
        }
    }
}

impl WideTree {
    /// Overwrites the coordinates in the tree by those of a set with the same primitives. Returns the work done, and the tree's
    /// cost per area of its root, relative to the cost when it was built.
    ///
    /// The first refit makes `plan`, which belongs to the tree from then on.
    pub fn refit<S: WideSource>(&mut self, set: &S, moved: &Moved, plan: &mut Option<Box<RefitPlan>>) -> (Done, f64) {
        let plan = plan.get_or_insert_with(|| {
            let mut plan = Box::new(RefitPlan::of(self, set));
            // Everything is visited, and nothing is written.
            plan.built = self.refit_by(set, &Moved::Nothing, &mut plan).1;
            plan
        });
        let (done, cost) = self.refit_by(set, moved, plan);
        (done, if plan.built > 0.0 && cost > 0.0 { cost / plan.built } else { 1.0 })
    }

    /// Refits the units of a plan, and then the nodes above them. Returns the work done, and the cost per area of the root.
    fn refit_by<S: WideSource>(&mut self, set: &S, moved: &Moved, plan: &mut RefitPlan) -> (Done, f64) {
        let touched = plan.touched(moved.list().as_deref());
        let words = self.arena.ints_mut();
        let mut pass = Pass {
            set,
            moved,
            lists: self.lists,
            level: SimdLevel::best(),
            parts: &plan.parts,
            shared: &plan.shared,
            in_slices: Vec::new(),
            places: &plan.places,
            known: Vec::new(),
        };
        // Leaf blocks that several hierarchies share come first, since the hierarchies need their bounds.
        let mut done = pass.shared_leaves(words, &touched);
        let units = pass.units(words, plan, &touched);
        pass.known = plan.units.iter().map(|unit| Refitted { bounds: None, cost: unit.cost }).collect();
        for (i, subtree, of_unit) in units {
            (plan.units[i].cost, pass.known[i]) = (subtree.cost, subtree);
            done = done.add(of_unit);
        }
        let mut place = Place { words, begin: 0, slice: None, done };
        for &Above { at, over, slice } in &plan.above {
            place.slice = slice;
            let subtree = match at.kind() {
                Kind::Time => pass.time_node(&mut place, at, over),
                _ => pass.node(&mut place, at, over),
            };
            pass.known.push(subtree);
        }
        if self.root == ChildRef::NOTHING {
            return (done, 0.0);
        }
        let cost = match self.root.kind().is_leaf() {
            true => {
                let held = pass.held(&place, self.root);
                pass.leaf(&mut place, self.root, &held, TimeInterval::FULL).1
            }
            false => {
                pass.known(self.root).map_or(0.0, |root| root.cost)
                    / area(&pass.bounds(&place, self.root, TimeInterval::FULL))
            }
        };
        (place.done, cost)
    }
}

/// The result for a subtree.
#[derive(Clone, Copy)]
struct Refitted {
    /// Its bounds; `None` if nothing in it changed.
    bounds: Option<LinearBox3>,
    /// The sum over its nodes and leaf blocks of the cost of a visit times area.
    cost: f64,
}

/// The state of one refit.
struct Pass<'a, S> {
    set: &'a S,
    moved: &'a Moved,
    /// The word at which lists of ids begin.
    lists: usize,
    level: SimdLevel,
    parts: &'a Parts,
    /// The leaf blocks that slices share, and their results.
    shared: &'a [SharedBlocks],
    in_slices: Vec<SharedBounds>,
    places: &'a HashMap<u32, usize>,
    /// The results for the first of the subtrees in `places`, as many as are done.
    known: Vec<Refitted>,
}

/// A section of the arena that one thread alone writes.
struct Place<'a> {
    words: &'a mut [u32],
    /// The word of the arena at which the section begins.
    begin: usize,
    /// The time slice of its hierarchy. The leaf blocks that slices share are done already, and may be in another section.
    slice: Option<SharingSlice>,
    done: Done,
}

impl Place<'_> {
    /// The words of the arena from the begin of a block.
    fn block(&self, at: ChildRef) -> &[u32] {
        &self.words[at.at() - self.begin..]
    }

    fn block_mut(&mut self, at: ChildRef) -> &mut [u32] {
        &mut self.words[at.at() - self.begin..]
    }
}

/// The primitives of a leaf block.
struct InLeaf {
    ids: Lanes<u32>,
    count: usize,
}

impl InLeaf {
    const NONE: InLeaf = InLeaf { ids: [0; LANES], count: 0 };

    fn ids(&self) -> &[u32] {
        &self.ids[..self.count]
    }
}

/// The number of shared leaf blocks per task.
const TOGETHER: usize = 64;

impl<S: WideSource> Pass<'_, S> {
    /// Rewrites shared leaf blocks, and records their bounds.
    fn shared_leaves(&mut self, words: &mut [u32], touched: &Touched) -> Done {
        let mut done = Done::default();
        for (SharedBlocks { leaves, words: of_leaves, slices, .. }, &touched) in self.shared.iter().zip(&touched.shared)
        {
            let mut in_slices = SharedBounds::default();
            let leaves = if touched { &leaves[..] } else { &[] };
            let runs: Vec<&[SharedLeaf]> = leaves.chunks(TOGETHER).collect();
            let ends = runs.iter().skip(1).map(|run| run[0].leaf.at()).chain([of_leaves.end]);
            let places: Vec<Range<usize>> = runs.iter().zip(ends).map(|(run, end)| run[0].leaf.at()..end).collect();
            let mut tasks: Vec<_> = cut(words, &places).zip(runs).collect();
            for (of_run, done_in_run) in parallel::each(&mut tasks, |(place, run)| {
                let mut of_run = SharedBounds::default();
                run.chunks(LANES).for_each(|run| self.shared_run(place, run, *slices, &mut of_run));
                (of_run, place.done)
            }) {
                in_slices.append(of_run);
                done = done.add(done_in_run);
            }
            self.in_slices.push(in_slices);
        }
        done
    }

    /// Rewrites up to sixteen shared leaf blocks.
    fn shared_run(&self, place: &mut Place<'_>, run: &[SharedLeaf], slices: usize, bounds: &mut SharedBounds) {
        let leaves = array::from_fn(|i| run.get(i).map_or(ChildRef::NOTHING, |of| of.leaf));
        self.in_order(place, &leaves, |place, i, held| {
            let leaf = leaves[i];
            let mut slices_of = (0..slices).filter(|slice| run[i].slices >> slice & 1 != 0);
            let over = |slice: usize| time_slice(slice, slices);
            match slices_of.next().and_then(|first| self.rewrite(place, leaf, held, over(first))) {
                None => bounds.push(run[i], held.count, []),
                Some(first) => {
                    let others = slices_of.map(|slice| self.leaf_bounds(place, leaf, held, over(slice)));
                    bounds.push(run[i], held.count, iter::once(first).chain(others));
                }
            }
        });
    }

    /// Refits the units in which something may have changed; returns their numbers, results and work.
    fn units(&self, words: &mut [u32], plan: &RefitPlan, touched: &Touched) -> Vec<(usize, Refitted, Done)> {
        let mut units: Vec<usize> = (0..plan.units.len()).filter(|&i| touched.units[i]).collect();
        units.sort_unstable_by_key(|&i| plan.units[i].words.start);
        let ranges: Vec<Range<usize>> = units.iter().map(|&i| plan.units[i].words.clone()).collect();
        let mut tasks: Vec<_> = cut(words, &ranges).zip(units).collect();
        parallel::each(&mut tasks, |(place, i)| {
            let unit = &plan.units[*i];
            place.slice = unit.slice;
            (*i, self.node(place, unit.root, unit.over), place.done)
        })
    }

    /// The result for a subtree if it is done already.
    fn known(&self, root: ChildRef) -> Option<Refitted> {
        // Most nodes are below units, where nothing is known.
        if self.known.is_empty() { None } else { self.known.get(*self.places.get(&root.0)?).copied() }
    }

    /// Refits a node and everything below it whose result is not known yet. The recursion is as deep as the tree.
    fn node(&self, place: &mut Place<'_>, at: ChildRef, over: TimeInterval) -> Refitted {
        place.done.visited += 1;
        let kind = at.kind();
        let children = lanes_at(place.block(at), (node_rows(kind) - 1) * LANES).map(ChildRef);
        let (mut boxes, mut all) = (BoxRows::NONE, LinearBox3::EMPTY);
        let (mut cost, mut changed): (f64, Mask) = (0.0, 0);
        self.in_order(place, &children, |place, lane, held| {
            let child = children[lane];
            let mut visit = 0.0;
            let bounds = if child.kind().is_leaf() {
                let leaf = self.leaf(place, child, held, over);
                visit = leaf.1;
                leaf.0
            } else {
                let below = self.known(child).unwrap_or_else(|| self.node(place, child, over));
                cost += below.cost;
                below.bounds
            };
            let bounds = match bounds {
                Some(bounds) => {
                    changed |= 1 << lane;
                    // A static node has no rows for motion.
                    let swept = bounds.swept();
                    if kind == Kind::Node { bounds } else { LinearBox3 { begin: swept, end: swept } }
                }
                None => read_box(place.block(at), kind, lane, over),
            };
            cost += visit * f64::from(motion_factor(bounds.begin != bounds.end) * mean_half_area(&bounds));
            all = all.union(bounds);
            boxes.set(lane, &bounds);
        });
        if changed != 0 {
            boxes.write(place.block_mut(at), kind, changed, over, self.level);
        }
        place.done.nodes += usize::from(changed != 0);
        cost += f64::from(NODE_COST * motion_factor(kind == Kind::Node)) * area(&all);
        Refitted { bounds: (changed != 0).then_some(all), cost }
    }

    /// Refits a leaf block unless that is done already. Returns its bounds if it changed, and the cost of a visit.
    fn leaf(
        &self,
        place: &mut Place<'_>,
        leaf: ChildRef,
        held: &InLeaf,
        over: TimeInterval,
    ) -> (Option<LinearBox3>, f64) {
        let (bounds, count) = match place.slice.filter(|slice| self.shares(*slice, leaf)) {
            // Nodes above units are visited even if nothing below them was. They are in the same section as the blocks.
            Some(SharingSlice { shared, index }) => self.in_slices[shared]
                .of(self.shared[shared].number(leaf), index)
                .unwrap_or_else(|| (None, self.held(place, leaf).count)),
            None => (self.rewrite(place, leaf, held, over), held.count),
        };
        (bounds, f64::from(leaf_cost(count)))
    }

    /// Whether a leaf block is one that a slice shares with others.
    fn shares(&self, slice: SharingSlice, leaf: ChildRef) -> bool {
        self.shared[slice.shared].have(leaf)
    }

    /// Rewrites the coordinates of a leaf block; returns its bounds if any of them changed.
    fn rewrite(&self, place: &mut Place<'_>, leaf: ChildRef, held: &InLeaf, over: TimeInterval) -> Option<LinearBox3> {
        place.done.visited += 1;
        if !self.moved.any(self.set, held.ids()) {
            return None;
        }
        let bounds = self.set.rewrite_leaf(place.block_mut(leaf), self.moved_leaf(leaf, held, over));
        place.done.leaves += usize::from(bounds.is_some());
        bounds.map(|bounds| self.parts.bounds(self.set, leaf, held.ids(), over).unwrap_or(bounds))
    }

    /// The bounds of a leaf block that has been rewritten.
    fn leaf_bounds(&self, place: &Place<'_>, leaf: ChildRef, held: &InLeaf, over: TimeInterval) -> LinearBox3 {
        let parts = self.parts.bounds(self.set, leaf, held.ids(), over);
        parts.unwrap_or_else(|| self.set.leaf_bounds(place.block(leaf), self.moved_leaf(leaf, held, over)))
    }

    fn moved_leaf<'a>(&self, leaf: ChildRef, held: &'a InLeaf, over: TimeInterval) -> MovedLeaf<'a> {
        MovedLeaf { leaf, ids: held.ids(), over, level: self.level }
    }

    fn held(&self, place: &Place<'_>, leaf: ChildRef) -> InLeaf {
        let block = place.block(leaf);
        match ids_of_leaf(leaf, block, leaf.at() >= self.lists) {
            Some(ids) => InLeaf { ids: lanes_of(&block[ids.start..], ids.len()), count: ids.len() },
            None => InLeaf::NONE,
        }
    }

    /// Calls `each` with the number of every block, and with the primitives that it holds if it is a leaf block to be rewritten.
    ///
    /// In large trees leaf blocks come from memory: first their ids, then the vertex numbers of their triangles, and the
    /// coordinates, old and new, while `each` is busy with the block before.
    #[inline(always)]
    fn in_order<'a>(
        &self,
        place: &mut Place<'a>,
        blocks: &Lanes<ChildRef>,
        mut each: impl FnMut(&mut Place<'a>, usize, &InLeaf),
    ) {
        let slice = place.slice;
        let is_read = |block: ChildRef| {
            block != ChildRef::NOTHING && block.kind().is_leaf() && slice.is_none_or(|slice| !self.shares(slice, block))
        };
        for leaf in blocks.iter().copied().filter(|&block| is_read(block)) {
            let ids = leaf.kind().leaf_rows() * leaf.len();
            place.block(leaf)[ids..].chunks(LANES).take(2).for_each(|line| prefetch(&line[0]));
        }
        let held = blocks.map(|block| if is_read(block) { self.held(place, block) } else { InLeaf::NONE });
        held.iter().flat_map(InLeaf::ids).for_each(|&id| self.set.prefetch(id));
        let prefetch = |place: &Place<'_>, lane: usize| {
            if held[lane].count > 0 {
                self.set.prefetch_leaf(place.block(blocks[lane]), blocks[lane], held[lane].ids());
            }
        };
        prefetch(place, held.iter().position(|held| held.count > 0).unwrap_or(0));
        for lane in (0..LANES).filter(|&lane| blocks[lane] != ChildRef::NOTHING) {
            if held[lane].count > 0 && lane + 1 < LANES {
                prefetch(place, lane + 1);
            }
            each(place, lane, &held[lane]);
        }
    }

    /// The result for a time node above subtrees whose results are known.
    fn time_node(&self, place: &mut Place<'_>, at: ChildRef, over: TimeInterval) -> Refitted {
        place.done.visited += 1;
        let slices: Vec<ChildRef> = slices_of(place, at);
        let (mut cost, mut changed) = (0.0, false);
        for (i, &slice) in slices.iter().enumerate() {
            if slice.kind().is_leaf() {
                let over = time_slice(i, slices.len());
                let held = self.held(place, slice);
                place.slice = place.slice.map(|slice| SharingSlice { index: i, ..slice });
                let (bounds, visit) = self.leaf(place, slice, &held, over);
                changed |= bounds.is_some();
                cost += visit * area(&self.bounds(place, slice, over));
            } else if let Some(slice) = self.known(slice) {
                changed |= slice.bounds.is_some();
                cost += slice.cost;
            }
        }
        let bounds = changed.then(|| self.bounds(place, at, over));
        Refitted { bounds, cost: cost / slices.len().max(1) as f64 }
    }

    /// Linear bounds of a subtree that has been refitted.
    fn bounds(&self, place: &Place<'_>, at: ChildRef, over: TimeInterval) -> LinearBox3 {
        let rows = match at.kind() {
            Kind::Time => return self.bounds_of_slices(place, at, over),
            kind if kind.is_leaf() => {
                let held = self.held(place, at);
                return self.leaf_bounds(place, at, &held, over);
            }
            kind => node_rows(kind),
        };
        let block = place.block(at);
        let lanes = (0..LANES).filter(|lane| block[(rows - 1) * LANES + lane] != ChildRef::NOTHING.0);
        lanes.fold(LinearBox3::EMPTY, |all, lane| all.union(read_box(block, at.kind(), lane, over)))
    }

    /// Linear bounds of all slices of a time node ([`LinearBounds::of_slices`]).
    ///
    /// Computed in f64, whose rounding errors are negligible beside the padding of the result.
    fn bounds_of_slices(&self, place: &Place<'_>, at: ChildRef, over: TimeInterval) -> LinearBox3 {
        let slices = slices_of(place, at);
        let fine = |b: Box3| Aabb { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        let fraction = |t: f32| (f64::from(t) - f64::from(over.begin())) / over.fine_duration();
        let bounds = |(i, &slice): (usize, &ChildRef)| {
            let over = time_slice(i, slices.len());
            let bounds = self.bounds(place, slice, over);
            let fine = LinearBounds { begin: fine(bounds.begin), end: fine(bounds.end) };
            ([over.begin(), over.end()].map(fraction), fine)
        };
        let each: Vec<([f64; 2], LinearBounds)> = slices.iter().enumerate().map(bounds).collect();
        let Some(all) = LinearBounds::of_slices(&each) else { return LinearBox3::EMPTY };
        let outward = |b: Aabb| {
            let b = Box3 { min: b.min.as_vec3(), max: b.max.as_vec3() };
            b.pad(4.0 * ULP * b.magnitude())
        };
        LinearBox3 { begin: outward(all.begin), end: outward(all.end) }
    }
}

/// The children of a time node.
fn slices_of(place: &Place<'_>, at: ChildRef) -> Vec<ChildRef> {
    let block = place.block(at);
    block[1..][..block[0] as usize].iter().map(|&slice| ChildRef(slice)).collect()
}

/// Cuts sections out of the arena. The ranges must be sorted and disjoint.
fn cut<'a>(words: &'a mut [u32], ranges: &[Range<usize>]) -> impl Iterator<Item = Place<'a>> {
    let (mut rest, mut at) = (words, 0);
    ranges.iter().map(move |range| {
        let (_, behind) = core::mem::take(&mut rest).split_at_mut(range.start - at);
        let (words, behind) = behind.split_at_mut(range.len());
        (rest, at) = (behind, range.end);
        Place { words, begin: range.start, slice: None, done: Done::default() }
    })
}

fn area(bounds: &LinearBox3) -> f64 {
    f64::from(mean_half_area(bounds))
}
