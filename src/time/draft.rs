//! The draft of a tree before it is written: references, binary tree, and its collapse into wide nodes.
//!
//! Long primitives fill little of their boxes. In that case they are pre-split into several references under a budget
//! before the build, if samples show that the expected cost of a ray falls enough: one or two neighbourhoods of 512 to
//! 4096 references, with and without pre-splitting. The cost of a tree is the sum over its nodes and leaf blocks of
//! cost times visits, which the collapse returns.

use super::existence::{any_changes, any_comes_or_goes};
use super::time_slice::TimeSlice;
use crate::bvh::{
    BinaryNode, BinaryTree, Collapse, LeafKind, Reference, ReplacedSubtree, SurfaceDensity, WideChild, build_binary,
    join_leaves, leaf_cost, motion_factor, neighbourhoods, presplit, reinsert,
};
use crate::geometry::{CornerBounds, LaneBounds, LinearBox3, TimeInterval};
use crate::parallel;
use crate::params::WideParams;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use crate::simd::{fill, huge_vec};
use crate::tuning::presplit::{
    MAX_PRESPLIT_COST, MIN_AREA_RATIO, PRESPLIT_SAMPLE, PRESPLIT_SAMPLES, UNCERTAIN_PRESPLIT_COST,
};
use crate::tuning::wide::{BINARY_LEAF, BYTES_PER_REFERENCE, NODE_COST};

/// A drafted tree over the shutter or one of equal slices of it.
pub(crate) struct Draft {
    pub slice: TimeSlice,
    /// The interval of the slice.
    pub over: TimeInterval,
    pub references: Vec<Reference>,
    /// The number of primitives that they refer to.
    pub primitives: usize,
    /// Whether references may be sub-references, which bound a part of their primitive.
    pub presplit: bool,
    /// Whether its subtrees have been moved to better places.
    reinserted: bool,
    /// Half the area of a box per area of the triangle in it.
    ratio: Option<f64>,
    /// Predicts how often boxes are visited: what its costs are computed with.
    pub density: SurfaceDensity,
    pub binary: BinaryTree,
    pub collapse: Collapse,
}

impl Draft {
    /// What was decided on pre-splitting, for drafts of other slices.
    pub fn decided(&self) -> PresplitDecision {
        PresplitDecision { ratio: self.ratio, pays: self.presplit }
    }

    /// The expected cost of a subtree for rays during a slice of the shutter, with the boxes of the whole.
    pub fn cost_during(&self, of: u32, slice: TimeSlice) -> f32 {
        let [first, last] = slice.times();
        let (mut cost, mut nodes, mut children) =
            (0.0, vec![WideChild { node: of, leaf: self.collapse.is_leaf(of) }], Vec::new());
        while let Some(WideChild { node: x, leaf }) = nodes.pop() {
            let node = &self.binary[x as usize];
            let bounds = LinearBox3 { begin: node.bounds.at(first), end: node.bounds.at(last) };
            let step = if leaf { leaf_cost(node.count as usize) } else { NODE_COST };
            cost += step * motion_factor(node.moving) * self.density.visits(&bounds);
            if !leaf {
                self.collapse.children(&self.binary, x, &mut children);
                nodes.extend(&children);
            }
        }
        cost
    }

    /// The share of the first child in the cost of both children of a node.
    pub fn low_share(&self, x: u32) -> f32 {
        let [low, high] = [x + 1, x + self.binary[x as usize].right].map(|child| self.collapse.cost(child));
        if low + high > 0.0 { low / (low + high) } else { 0.5 }
    }

    /// Makes subtrees single children, which others have replaced, and moves subtrees to better places unless that has been done.
    /// Afterwards only the references of nodes that may be leaf blocks are side by side. Of no use once `progress` is cancelled.
    pub fn replace_subtrees<S: PrimitiveSet>(
        &mut self,
        set: &S,
        replaced: &mut [ReplacedSubtree],
        progress: &Progress,
    ) {
        if !self.reinserted {
            let better = reinsert(&self.binary, &mut self.references, replaced, self.density, progress);
            if let Some(better) = better {
                self.binary = better;
                self.collapse_again(set, progress);
            }
            if replaced.is_empty() {
                self.join_leaves(set, progress);
            }
        }
        if !progress.cancelled() {
            self.collapse.replace_subtrees(&self.binary, self.density, replaced);
        }
    }

    fn collapse_again<S: PrimitiveSet>(&mut self, set: &S, progress: &Progress) {
        let progress = progress.rest(COLLAPSE_AGAIN);
        self.collapse = collapse(set, &self.binary, &self.references, self.density, &progress);
    }

    /// Joins leaf blocks that are no neighbours, if that pays and all primitives are of one kind.
    fn join_leaves<S: PrimitiveSet>(&mut self, set: &S, progress: &Progress) {
        if !progress.cancelled()
            && !set.kinds_differ()
            && let Some(better) =
                join_leaves(&self.binary, &self.collapse, &mut self.references, self.density, set.per_leaf())
        {
            self.binary = better;
            self.collapse_again(set, progress);
        }
    }

    /// Whether anything below a node changes during the shutter.
    pub fn changes<S: PrimitiveSet>(&self, set: &S, x: u32) -> bool {
        let node = &self.binary[x as usize];
        node.moving || any_comes_or_goes(set, self.references(node))
    }

    /// The references below a binary node.
    pub fn references(&self, node: &BinaryNode) -> &[Reference] {
        &self.references[node.first as usize..][..node.count as usize]
    }

    /// The primitives below a binary node, sorted, without duplicates.
    pub fn primitives_below(&self, of: u32) -> Vec<u32> {
        let mut ids: Vec<u32> = self.references(&self.binary[of as usize]).iter().map(Reference::id).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }
}

/// How trees are drafted.
#[derive(Clone, Copy)]
pub(crate) struct DraftParams {
    pub wide: WideParams,
    /// What a sample of the primitives has decided, if there was one.
    pub decided: Option<PresplitDecision>,
}

impl DraftParams {
    /// Parameters for which each draft decides by itself.
    pub fn new(wide: WideParams) -> DraftParams {
        DraftParams { wide, decided: None }
    }

    /// The parameters of one of several separate trees, between which the memory for pre-splitting is divided. Each holds this
    /// share of the primitives.
    pub fn of_each_tree(&self, count: usize, share: f32) -> DraftParams {
        let bytes_per_primitive = self.wide.bytes_per_primitive / (count as f32 * share);
        DraftParams { wide: WideParams { bytes_per_primitive, ..self.wide }, ..*self }
    }

    /// The references per primitive that pre-splitting may make.
    fn most_references(&self) -> f32 {
        self.wide.max_references.min(self.wide.bytes_per_primitive / BYTES_PER_REFERENCE)
    }
}

/// Whether some primitives are pre-split.
#[derive(Clone, Copy, Default)]
pub(crate) struct PresplitDecision {
    /// Half the area of a box per area of the triangle in it, see [`area_ratio`].
    ratio: Option<f64>,
    pays: bool,
}

/// When the subtrees of a draft are moved to better places.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum WhenToReinsert {
    /// Never: costs are to be compared with those of other drafts, or time slices decided on.
    Later,
    /// At once if nothing changes during the shutter, so that nothing is to be decided.
    OfStatic,
    /// Before the collapse.
    Now,
}

impl WhenToReinsert {
    /// Whether it is time.
    fn is_due<S: PrimitiveSet>(self, set: &S, binary: &BinaryTree, references: &[Reference]) -> bool {
        match self {
            WhenToReinsert::Later => false,
            WhenToReinsert::OfStatic => {
                binary.first().is_some_and(|root| !root.moving) && !any_comes_or_goes(set, references)
            }
            WhenToReinsert::Now => true,
        }
    }
}

/// Drafts one tree, pre-split if that pays. A density is given if its costs are to be compared with those of other
/// trees. `None` once `progress` is cancelled.
pub(crate) fn draft_tree<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    slice: TimeSlice,
    params: &DraftParams,
    density: Option<SurfaceDensity>,
    reinsertion: WhenToReinsert,
    progress: &Progress,
) -> Option<Draft> {
    let Prepared { mut references, ratio, budget, density } =
        prepare(set, ids, slice, params, density, &progress.subtask(PREPARING));
    let draft = match params.decided {
        // A sample of a few would be all of them.
        None if budget.is_some() && references.len() <= *PRESPLIT_SAMPLE.start() => {
            let mut better = draft_better(set, references, slice, budget, density, progress)?;
            if reinsertion.is_due(set, &better.binary, &better.references) {
                better.replace_subtrees(set, &mut [], progress);
                better.reinserted = true;
            }
            better
        }
        decided => {
            // If that was decided, elongated primitives are to be split.
            let pays =
                |&budget: &f32| decided.is_some() || presplit_pays(set, &references, slice, budget, density, progress);
            let budget = budget.filter(pays);
            if progress.cancelled() {
                return None;
            }
            if let Some(budget) = budget {
                presplit(&mut references, corner_bounds(set, slice.interval()), budget);
            }
            let rest = &progress.rest(1.0);
            draft_with(set, references, slice, budget.is_some(), density, reinsertion, rest)?
        }
    };
    (!progress.cancelled()).then_some(Draft { primitives: ids.len(), ratio, ..draft })
}

/// Shares of the steps of a draft, about: making references is so much of the whole, the object splits are so much of the rest, and
/// a collapse is so much of what follows if subtrees are moved before it and leaf blocks may be joined after it.
const PREPARING: f64 = 0.1;
const SPLITTING: f64 = 0.75;
const COLLAPSE: f64 = 0.6;
const COLLAPSE_AGAIN: f64 = 0.3;

/// The share in the rest of a draft of each sample that decides whether to pre-split.
const PRESPLIT_TRIAL: f64 = 0.05;

/// What a draft is made of.
struct Prepared {
    references: Vec<Reference>,
    /// Half the area of a box per area of the triangle in it.
    ratio: Option<f64>,
    /// The references per primitive that pre-splitting may make; `None` if it is out of the question.
    budget: Option<f32>,
    density: SurfaceDensity,
}

/// Makes a reference for each primitive.
fn prepare<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    slice: TimeSlice,
    params: &DraftParams,
    density: Option<SurfaceDensity>,
    progress: &Progress,
) -> Prepared {
    let over = slice.interval();
    let ratio = params.decided.map_or_else(|| area_ratio(set, ids, over), |decided| decided.ratio);
    let budget = params.most_references();
    let elongated = is_elongated(budget, ratio) && params.decided.is_none_or(|decided| decided.pays);
    // Room for all sub-references from the start: memory that is not touched costs nothing.
    let most = if elongated { (ids.len() as f64 * f64::from(budget)) as usize + 1 } else { ids.len() };
    // Some more for reinsertion.
    let mut references = huge_vec(most + most / 16);
    add_references(set, ids, over, &mut references, progress);
    let density = density.unwrap_or_else(|| SurfaceDensity::of(&references, ratio.unwrap_or(LEAST_AREA_RATIO)));
    Prepared { references, ratio, budget: elongated.then_some(budget), density }
}

/// Drafts a tree and, within the budget, a pre-split one, and keeps that if it pays.
fn draft_better<S: PrimitiveSet>(
    set: &S,
    mut references: Vec<Reference>,
    slice: TimeSlice,
    budget: Option<f32>,
    density: SurfaceDensity,
    progress: &Progress,
) -> Option<Draft> {
    let draft = |references, split: bool| {
        draft_with(set, references, slice, split, density, WhenToReinsert::Later, &progress.rest(0.5))
    };
    let Some(budget) = budget else { return draft(references, false) };
    let whole = draft(references.clone(), false)?;
    presplit(&mut references, corner_bounds(set, slice.interval()), budget);
    let split = draft(references, true)?;
    Some(if split.collapse.total() < whole.collapse.total() * MAX_PRESPLIT_COST { split } else { whole })
}

/// Primitives whose bounds are computed together: they stay in a near cache.
const TOGETHER: usize = 256;

/// Primitives between two reports of progress: a multiple of that. Not fitted: they take a few hundred microseconds.
const REPORTED: usize = 16 * TOGETHER;

/// Appends a reference for each of some primitives. Once `progress` is cancelled, some are missing or of nothing.
fn add_references<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    over: TimeInterval,
    references: &mut Vec<Reference>,
    progress: &Progress,
) {
    if !ids.is_sorted() {
        return fill(references, ids.len(), |i| Reference::new(set.bounds(ids[i], over), ids[i]));
    }
    let tubes = set.tubes(ids, over);
    let progress = progress.in_units(ids.len());
    let write = |ids: &[u32], references: &mut [Reference]| {
        let mut bounds = [LaneBounds::EMPTY; TOGETHER];
        set.lane_bounds(ids, over, &tubes, &mut bounds[..ids.len()]);
        Reference::write(ids, &bounds, references);
    };
    let unset = Reference::new(LinearBox3::EMPTY, 0);
    if parallel::threads() == 1 {
        for ids in ids.chunks(REPORTED).take_while(|_| !progress.cancelled()) {
            for ids in ids.chunks(TOGETHER) {
                let first = references.len();
                references.resize(first + ids.len(), unset);
                write(ids, &mut references[first..]);
            }
            progress.finished(ids.len() as f64);
        }
        return;
    }
    references.resize(ids.len(), unset);
    let mut parts: Vec<_> = ids.chunks(REPORTED).zip(references.chunks_mut(REPORTED)).collect();
    parallel::each(&mut parts, |(ids, references)| {
        if !progress.cancelled() {
            let parts = ids.chunks(TOGETHER).zip(references.chunks_mut(TOGETHER));
            parts.for_each(|(ids, references)| write(ids, references));
            progress.finished(ids.len() as f64);
        }
    });
}

/// Drafts a tree over a sample, pre-split if that pays for the sample as a whole, and returns the decision. There is no draft if
/// nothing is to be decided: the sample does not change, and pre-splits are out of the question.
pub(crate) fn draft_sample<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    params: &WideParams,
) -> (Option<Draft>, PresplitDecision) {
    let (params, progress) = (DraftParams::new(*params), &Progress::new(None));
    let ratio = area_ratio(set, ids, TimeInterval::FULL);
    if !is_elongated(params.most_references(), ratio) && !any_changes(set, ids) {
        return (None, PresplitDecision { ratio, pays: false });
    }
    let params = DraftParams { decided: Some(PresplitDecision { ratio, pays: true }), ..params };
    let Prepared { references, budget, density, .. } = prepare(set, ids, TimeSlice::WHOLE, &params, None, progress);
    let draft = draft_better(set, references, TimeSlice::WHOLE, budget, density, progress);
    let draft = draft.map(|draft| Draft { primitives: ids.len(), ratio, ..draft });
    let decided = draft.as_ref().map_or(PresplitDecision { ratio, pays: false }, Draft::decided);
    (draft, decided)
}

/// Whether triangles fill so little of their boxes that pre-splitting may pay.
fn is_elongated(budget: f32, ratio: Option<f64>) -> bool {
    budget > 1.0 && ratio.is_some_and(|ratio| ratio >= MIN_AREA_RATIO)
}

/// Bounds of the corners of a primitive during an interval. The same function wherever references are pre-split, so that this is
/// compiled once.
fn corner_bounds<S: PrimitiveSet>(set: &S, over: TimeInterval) -> impl Fn(u32) -> Option<CornerBounds> + Sync {
    move |id| set.corner_bounds(id, over)
}

/// Whether pre-splitting pays in a few samples of neighbouring references.
fn presplit_pays<S: PrimitiveSet>(
    set: &S,
    references: &[Reference],
    slice: TimeSlice,
    budget: f32,
    density: SurfaceDensity,
    progress: &Progress,
) -> bool {
    let over = slice.interval();
    let n = references.len();
    let most = (n / (16 * PRESPLIT_SAMPLES)).clamp(*PRESPLIT_SAMPLE.start(), *PRESPLIT_SAMPLE.end());
    let (mut with, mut without) = (0.0, 0.0);
    for sample in neighbourhoods(references, PRESPLIT_SAMPLES, most) {
        let progress = progress.rest(PRESPLIT_TRIAL);
        let cost = |references: Vec<Reference>| {
            let draft =
                draft_with(set, references, slice, true, density, WhenToReinsert::Later, &progress.subtask(0.5));
            draft.map_or(0.0, |draft| draft.collapse.total())
        };
        let mut split = sample.clone();
        presplit(&mut split, corner_bounds(set, over), budget);
        let (split, whole) = parallel::both(|| cost(split), || cost(sample));
        with += split;
        without += whole;
        if !UNCERTAIN_PRESPLIT_COST.contains(&(with / without)) {
            break;
        }
    }
    with < without * MAX_PRESPLIT_COST
}

/// Drafts one tree; `presplit` tells whether references may be sub-references, which bound a part of their primitive. `None` once
/// `progress` is cancelled.
fn draft_with<S: PrimitiveSet>(
    set: &S,
    mut references: Vec<Reference>,
    slice: TimeSlice,
    presplit: bool,
    density: SurfaceDensity,
    reinsertion: WhenToReinsert,
    progress: &Progress,
) -> Option<Draft> {
    let kind = |id: u32| set.leaf_kind(id);
    let kinds: Option<&LeafKind<'_>> = if set.kinds_differ() { Some(&kind) } else { None };
    let per_leaf = set.per_leaf();
    let [stop, overlapping] = [*BINARY_LEAF.start(), *BINARY_LEAF.end()].map(|most| most.min(per_leaf));
    // A node above them would cost as much as one block of all of them.
    let n = references.len();
    let one_block = kinds.is_none() && n <= per_leaf && leaf_cost(n) <= NODE_COST;
    let (leaf, large) = if one_block { (n..=n, None) } else { (stop..=overlapping, Some(density)) };
    let mut binary = build_binary(&mut references, leaf, kinds, large, &progress.subtask(SPLITTING));
    if progress.cancelled() {
        return None;
    }
    let now = reinsertion.is_due(set, &binary, &references);
    if now && let Some(better) = reinsert(&binary, &mut references, &mut [], density, progress) {
        binary = better;
    }
    let collapse = collapse(set, &binary, &references, density, &progress.rest(if now { COLLAPSE } else { 1.0 }));
    let primitives = references.len();
    let over = slice.interval();
    let mut draft = Draft {
        slice,
        over,
        references,
        primitives,
        presplit,
        reinserted: now,
        ratio: None,
        density,
        binary,
        collapse,
    };
    if now {
        draft.join_leaves(set, progress);
    }
    (!progress.cancelled()).then_some(draft)
}

/// Collapses a binary tree over references into wide nodes and leaf blocks.
fn collapse<S: PrimitiveSet>(
    set: &S,
    binary: &BinaryTree,
    references: &[Reference],
    density: SurfaceDensity,
    progress: &Progress,
) -> Collapse {
    let (kinds_differ, per_leaf) = (set.kinds_differ(), set.per_leaf());
    let cost = |node: &BinaryNode| {
        if node.count as usize > per_leaf {
            return None;
        }
        let block = &references[node.first as usize..][..node.count as usize];
        let fits = !kinds_differ || one_block(set, block, node.right == 0);
        fits.then_some(leaf_cost(node.count as usize))
    };
    Collapse::new(binary, density, cost, progress)
}

/// Whether references may form a leaf block: they are of one kind and, unless they cannot be split further, fit.
fn one_block<S: PrimitiveSet>(set: &S, references: &[Reference], last: bool) -> bool {
    let ids = &Reference::ids(references)[..references.len()];
    let kind = set.leaf_kind(ids[0]);
    ids.iter().all(|&id| set.leaf_kind(id) == kind) && (kind == 0 || last || set.fits_block(ids))
}

/// The least ratio of half the area of a box to the area of its contents: that of a triangle that fills half a flat
/// box. That of spheres is hardly less, as a ray sees half of their surface.
const LEAST_AREA_RATIO: f64 = 2.0;

/// The sum of half-areas of the boxes, per area of the triangles in them; `None` for primitives that cannot be split.
fn area_ratio<S: PrimitiveSet>(set: &S, ids: &[u32], over: TimeInterval) -> Option<f64> {
    let (mut boxes, mut triangles) = (0.0, 0.0);
    // A sample of one or two thousand is enough.
    for &id in ids.iter().step_by(ids.len() / 2048 + 1) {
        let Some([around, own]) = set.areas(id, over) else { continue };
        boxes += f64::from(around);
        triangles += f64::from(own);
    }
    (triangles > 0.0).then_some(boxes / triangles)
}

/// How many leaf blocks ahead the numbers of vertices are prefetched; the vertices follow one block ahead.
const AHEAD: usize = 4;

/// Prefetches the data of the blocks that follow block `i`, as bounds over an interval need them.
pub(crate) fn prefetch_blocks<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    of: &[BinaryNode],
    i: usize,
    over: TimeInterval,
) {
    let next = if i == 0 { 0..of.len().min(AHEAD + 1) } else { i + AHEAD..of.len().min(i + AHEAD + 1) };
    for node in of.get(next).unwrap_or_default() {
        draft.references(node).iter().for_each(|r| set.prefetch(r.id()));
    }
    for node in of.iter().skip(i + 1).take(1) {
        draft.references(node).iter().for_each(|r| set.prefetch_vertices(r.id(), over));
    }
}
