//! Refitting: new positions for a tree with the same structure.
//!
//! The coordinates of primitives that moved are rewritten in their leaf blocks, and boxes are recomputed from the leaves up, all in place.
//! If nothing changed below a box, the box is kept, clipped to a cell or not. So the static parts of a scene do not become worse. All
//! other boxes hold whole primitives. Subtrees that are contiguous in the arena are refitted by any thread ([`super::refit_plan`]), and
//! the nodes above them last.
//!
//! The answers stay those of brute force, but the tree may become slower. Its cost is the sum over nodes and leaf blocks of the cost of a visit times
//! area, per area of the root. This is nearly what the build minimizes (MacDonald and Booth, "Heuristics for ray tracing using space
//! subdivision", 1990). Its growth tells when a new tree is better (Lauterbach et al., "RT-DEFORM", 2006, use ratios of areas).

use super::leaf_block::{MovedLeaf, WideSource};
use super::leaf_ids::Ids;
use super::node_boxes::{BoxRows, MeasuredBoxes};
use super::refit_plan::{Above, Plan, SharedLeaves, Touched};
use super::wide_node::{ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS};
use super::wide_tree::WideTree;
use super::write::read_box;
use crate::bvh::mean_half_area;
use crate::geometry::{Aabb, Box3, LinearBounds, LinearBox3, TimeInterval, ULP};
use crate::parallel;
use crate::simd::{LANES, Lanes, Mask, SimdLevel, lanes_at, lanes_of, prefetch};
use crate::time::{COST_MODEL, time_slice};
use core::ops::Range;
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
            Moved::Some(meshes) => Some((0..).zip(meshes).filter(|&(_, &moved)| moved).map(|(i, _)| i).collect()),
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
    /// Overwrites the coordinates in the tree by those of a set with the same primitives. Returns the work done, and the tree's cost per
    /// area of its root, relative to the cost when it was built.
    ///
    /// The first refit makes `plan`, which belongs to the tree from then on.
    pub fn refit<S: WideSource>(&mut self, set: &S, moved: &Moved, plan: &mut Option<Box<Plan>>) -> (Done, f64) {
        let plan = plan.get_or_insert_with(|| {
            let mut plan = Box::new(Plan::of(self, set));
            // Everything is visited, and nothing is written.
            plan.built = self.refit_by(set, &Moved::Nothing, &mut plan).1;
            plan
        });
        let (done, cost) = self.refit_by(set, moved, plan);
        (done, if plan.built > 0.0 && cost > 0.0 { cost / plan.built } else { 1.0 })
    }

    /// Refits the units of a plan, and then the nodes above them. Returns the work done, and the cost per area of the root.
    fn refit_by<S: WideSource>(&mut self, set: &S, moved: &Moved, plan: &mut Plan) -> (Done, f64) {
        let (lists, level) = (self.lists, SimdLevel::best());
        let touched = plan.touched(moved.list().as_deref());
        let places = &plan.places;
        let mut pass = Pass { set, moved, lists, level, changed: Vec::new(), places, known: Vec::new() };
        let words = self.arena.ints_mut();
        // Leaf blocks that several hierarchies share come first, since the hierarchies read them.
        let mut done = pass.shared_leaves(words, &plan.shared, &touched);
        let units = pass.units(words, plan, &touched);
        pass.known = plan.units.iter().map(|unit| Subtree { bounds: None, cost: unit.cost }).collect();
        for (i, subtree, of_unit) in units {
            (plan.units[i].cost, pass.known[i]) = (subtree.cost, subtree);
            done = done.add(of_unit);
        }
        let mut place = Place { words, begin: 0, shared: 0..0, shared_words: None, done };
        for &Above { at, over, shared } in &plan.above {
            place.shared = shared.map_or(0..0, |shared| plan.shared[shared].words.clone());
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
struct Subtree {
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
    /// The shared leaf blocks that changed, sorted.
    changed: Vec<u32>,
    places: &'a HashMap<u32, usize>,
    /// The results for the first of the subtrees in `places`, as many as are done.
    known: Vec<Subtree>,
}

/// A section of the arena that one thread alone writes.
struct Place<'a> {
    words: &'a mut [u32],
    /// The word of the arena at which the section begins.
    begin: usize,
    /// The position of the shared leaf blocks, which are written already, and their words if they are not in this section.
    shared: Range<usize>,
    shared_words: Option<&'a [u32]>,
    done: Done,
}

impl Place<'_> {
    /// The words of the arena from the begin of a block.
    fn block(&self, at: ChildRef) -> &[u32] {
        match self.shared_words {
            Some(words) if self.shared.contains(&at.at()) => &words[at.at() - self.shared.start..],
            _ => &self.words[at.at() - self.begin..],
        }
    }

    /// Prefetches the ids of a leaf block.
    fn prefetch_ids(&self, leaf: ChildRef) {
        if leaf != ChildRef::NOTHING && leaf.kind().is_leaf() {
            let ids = leaf.kind().leaf_rows() * leaf.len();
            self.block(leaf)[ids..].chunks(LANES).take(2).for_each(|line| prefetch(&line[0]));
        }
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
    /// Rewrites shared leaf blocks, and records which of them changed.
    fn shared_leaves(&mut self, words: &mut [u32], shared: &[SharedLeaves], touched: &Touched) -> Done {
        let mut done = Done::default();
        let shared = shared.iter().zip(&touched.shared).filter(|&(_, &touched)| touched);
        for (SharedLeaves { leaves, words: of_leaves }, _) in shared {
            let runs: Vec<&[ChildRef]> = leaves.chunks(TOGETHER).collect();
            let ends = runs.iter().skip(1).map(|run| run[0].at()).chain([of_leaves.end]);
            let places: Vec<Range<usize>> = runs.iter().zip(ends).map(|(run, end)| run[0].at()..end).collect();
            let mut tasks: Vec<_> = cut(words, &places).zip(runs).collect();
            let found = parallel::each(&mut tasks, |(place, run)| {
                let mut changed = |leaf: ChildRef| {
                    let held = self.held(place, leaf);
                    self.rewrite(place, leaf, &held, TimeInterval::FULL).is_some()
                };
                let changed: Vec<u32> = run.iter().filter(|&&leaf| changed(leaf)).map(|leaf| leaf.0).collect();
                (changed, place.done)
            });
            for (changed, of_run) in found {
                self.changed.extend(changed);
                done = done.add(of_run);
            }
        }
        self.changed.sort_unstable();
        done
    }

    /// Refits the units in which something may have changed; returns their numbers, results and work.
    fn units(&self, words: &mut [u32], plan: &Plan, touched: &Touched) -> Vec<(usize, Subtree, Done)> {
        let units = plan.units.iter().enumerate().filter(|&(i, _)| touched.units[i]);
        let units = units.map(|(i, unit)| (unit.words.clone(), Some(i), unit.shared));
        let shared = plan.shared.iter().enumerate().map(|(i, shared)| (shared.words.clone(), None, Some(i)));
        let mut sections: Vec<(Range<usize>, Option<usize>, Option<usize>)> = units.chain(shared).collect();
        sections.sort_unstable_by_key(|section| section.0.start);
        let ranges: Vec<Range<usize>> = sections.iter().map(|section| section.0.clone()).collect();
        let (mut tasks, mut shared_words) = (Vec::new(), vec![None; plan.shared.len()]);
        for (place, (_, unit, shared)) in cut(words, &ranges).zip(sections) {
            match (unit, shared) {
                (None, Some(shared)) => shared_words[shared] = Some(&*place.words),
                (Some(unit), _) => tasks.push((place, unit)),
                (None, None) => {}
            }
        }
        for (place, unit) in &mut tasks {
            if let Some(shared) = plan.units[*unit].shared {
                place.shared = plan.shared[shared].words.clone();
                place.shared_words = shared_words[shared];
            }
        }
        parallel::each(&mut tasks, |(place, i)| {
            let unit = &plan.units[*i];
            (*i, self.node(place, unit.root, unit.over), place.done)
        })
    }

    /// The result for a subtree if it is done already.
    fn known(&self, root: ChildRef) -> Option<Subtree> {
        // Most nodes are below units, where nothing is known.
        if self.known.is_empty() { None } else { self.known.get(*self.places.get(&root.0)?).copied() }
    }

    /// Refits a node and everything below it whose result is not known yet. The recursion is as deep as the tree.
    fn node(&self, place: &mut Place<'_>, at: ChildRef, over: TimeInterval) -> Subtree {
        place.done.visited += 1;
        let kind = at.kind();
        let rows = if kind == Kind::Node { NODE_ROWS } else { STATIC_NODE_ROWS };
        let children = lanes_at(place.block(at), (rows - 1) * LANES).map(ChildRef);
        // In large trees leaf blocks come from memory: first their ids, then the vertex numbers of their triangles, and the
        // coordinates, old and new, while the block before is rewritten.
        children.iter().for_each(|&child| place.prefetch_ids(child));
        let held = children.map(|child| self.held_ahead(place, child));
        if let Some(first) = held.iter().position(|held| held.count > 0) {
            self.set.prefetch_leaf(place.block(children[first]), children[first], held[first].ids());
        }
        let (mut boxes, mut visits) = (BoxRows::NONE, [0.0f64; LANES]);
        let (mut cost, mut changed): (f64, Mask) = (0.0, 0);
        for (lane, child) in children.into_iter().enumerate() {
            if child == ChildRef::NOTHING {
                continue;
            }
            let bounds = if child.kind().is_leaf() {
                if let Some(next) = held.get(lane + 1).filter(|next| next.count > 0) {
                    self.set.prefetch_leaf(place.block(children[lane + 1]), children[lane + 1], next.ids());
                }
                let (bounds, visit) = self.leaf(place, child, &held[lane], over);
                visits[lane] = visit;
                bounds
            } else {
                let Subtree { bounds, cost: below } =
                    self.known(child).unwrap_or_else(|| self.node(place, child, over));
                cost += below;
                bounds
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
            boxes.set(lane, &bounds);
        }
        if changed != 0 {
            boxes.write(place.block_mut(at), kind, changed, over, self.level);
        }
        let MeasuredBoxes { areas, still, all } = boxes.measured(self.level);
        for lane in 0..LANES {
            let still = if still >> lane & 1 != 0 { COST_MODEL.static_factor } else { 1.0 };
            cost += visits[lane] * f64::from(still * areas[lane]);
        }
        place.done.nodes += usize::from(changed != 0);
        let still = if kind == Kind::Node { 1.0 } else { COST_MODEL.static_factor };
        cost += f64::from(COST_MODEL.node * still) * area(&all);
        Subtree { bounds: (changed != 0).then_some(all), cost }
    }

    /// Refits a leaf block unless that is done already. Returns its bounds if it changed, and the cost of a visit.
    fn leaf(
        &self,
        place: &mut Place<'_>,
        leaf: ChildRef,
        held: &InLeaf,
        over: TimeInterval,
    ) -> (Option<LinearBox3>, f64) {
        let bounds = match place.shared.contains(&leaf.at()) {
            true => {
                let changed = self.changed.binary_search(&leaf.0).is_ok();
                changed.then(|| self.set.leaf_bounds(place.block(leaf), self.moved_leaf(leaf, held, over)))
            }
            false => self.rewrite(place, leaf, held, over),
        };
        (bounds, f64::from(COST_MODEL.leaf_of(held.count)))
    }

    /// Rewrites the coordinates of a leaf block; returns its bounds if any of them changed.
    fn rewrite(&self, place: &mut Place<'_>, leaf: ChildRef, held: &InLeaf, over: TimeInterval) -> Option<LinearBox3> {
        place.done.visited += 1;
        if !self.moved.any(self.set, held.ids()) {
            return None;
        }
        let bounds = self.set.rewrite_leaf(place.block_mut(leaf), self.moved_leaf(leaf, held, over));
        place.done.leaves += usize::from(bounds.is_some());
        bounds
    }

    fn moved_leaf<'a>(&self, leaf: ChildRef, held: &'a InLeaf, over: TimeInterval) -> MovedLeaf<'a> {
        MovedLeaf { leaf, ids: held.ids(), over, level: self.level }
    }

    fn held(&self, place: &Place<'_>, leaf: ChildRef) -> InLeaf {
        let block = place.block(leaf);
        let lists = !S::TRIANGLES || leaf.at() >= self.lists;
        let mut held = InLeaf::NONE;
        if let Some(Ids { first, count }) = Ids::of(leaf, block, lists) {
            held = InLeaf { ids: lanes_of(&block[first..], count), count };
        }
        held
    }

    /// The primitives of a child that is a leaf block. Their vertex numbers are prefetched.
    fn held_ahead(&self, place: &Place<'_>, child: ChildRef) -> InLeaf {
        if child == ChildRef::NOTHING || !child.kind().is_leaf() {
            return InLeaf::NONE;
        }
        let held = self.held(place, child);
        if !place.shared.contains(&child.at()) {
            held.ids().iter().for_each(|&id| self.set.prefetch(id));
        }
        held
    }

    /// The result for a time node above subtrees whose results are known.
    fn time_node(&self, place: &mut Place<'_>, at: ChildRef, over: TimeInterval) -> Subtree {
        place.done.visited += 1;
        let slices: Vec<ChildRef> = slices_of(place, at);
        let (mut cost, mut changed) = (0.0, false);
        for (i, &slice) in slices.iter().enumerate() {
            if slice.kind().is_leaf() {
                let over = time_slice(i, slices.len());
                let held = self.held(place, slice);
                let (bounds, visit) = self.leaf(place, slice, &held, over);
                changed |= bounds.is_some();
                cost += visit * area(&self.bounds(place, slice, over));
            } else if let Some(slice) = self.known(slice) {
                changed |= slice.bounds.is_some();
                cost += slice.cost;
            }
        }
        let bounds = changed.then(|| self.bounds(place, at, over));
        Subtree { bounds, cost: cost / slices.len().max(1) as f64 }
    }

    /// Linear bounds of a subtree that has been refitted.
    fn bounds(&self, place: &Place<'_>, at: ChildRef, over: TimeInterval) -> LinearBox3 {
        let rows = match at.kind() {
            Kind::Node => NODE_ROWS,
            Kind::StaticNode => STATIC_NODE_ROWS,
            Kind::Time => return self.bounds_of_slices(place, at, over),
            _ => {
                let held = self.held(place, at);
                return self.set.leaf_bounds(place.block(at), self.moved_leaf(at, &held, over));
            }
        };
        let block = place.block(at);
        let lanes = (0..LANES).filter(|lane| block[(rows - 1) * LANES + lane] != ChildRef::NOTHING.0);
        lanes.fold(LinearBox3::EMPTY, |all, lane| all.union(read_box(block, at.kind(), lane, over)))
    }

    /// Linear bounds of all slices of a time node: the line between the first and the last state, moved outward until it holds each slice
    /// at both of its ends. Each slice is linear between its ends.
    ///
    /// Computed in f64, whose rounding errors are negligible beside the padding of the result.
    fn bounds_of_slices(&self, place: &Place<'_>, at: ChildRef, over: TimeInterval) -> LinearBox3 {
        let slices = slices_of(place, at);
        let fine = |b: Box3| Aabb { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        let mut all: Option<LinearBounds> = None;
        let each: Vec<(TimeInterval, LinearBox3)> = (0..slices.len())
            .map(|i| time_slice(i, slices.len()))
            .zip(&slices)
            .map(|(over, &slice)| (over, self.bounds(place, slice, over)))
            .collect();
        for (_, slice) in &each {
            let begin = all.map_or(fine(slice.begin), |all| all.begin);
            all = Some(LinearBounds { begin, end: fine(slice.end) });
        }
        let Some(mut all) = all else { return LinearBox3::EMPTY };
        for (over_slice, slice) in each {
            let w = |t: f32| (f64::from(t) - f64::from(over.begin())) / over.fine_duration();
            all.include(w(over_slice.begin()), fine(slice.begin));
            all.include(w(over_slice.end()), fine(slice.end));
        }
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
        Place { words, begin: range.start, shared: 0..0, shared_words: None, done: Done::default() }
    })
}

fn area(bounds: &LinearBox3) -> f64 {
    f64::from(mean_half_area(bounds))
}
