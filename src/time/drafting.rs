//! Drafting trees: references are made, pre-split if that pays, divided by object splits, and collapsed.
//!
//! Long primitives fill little of their boxes. In that case they are pre-split into several references under a budget
//! before the build, if samples show that the expected cost of a ray falls enough: one or two neighbourhoods of 512 to
//! 4096 references, with and without pre-splitting.

use super::draft::{Draft, PresplitDecision, collapse};
use super::existence::{any_changes, any_comes_or_goes};
use super::time_slice::TimeSlice;
use crate::bvh::{
    BinaryTree, LeafKind, Reference, SurfaceDensity, build_binary, leaf_cost, neighbourhoods, presplit, reinsert,
};
use crate::geometry::{LaneBounds, LinearBox3, TimeInterval};
use crate::parallel;
use crate::params::WideParams;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use crate::simd::huge_vec;
use crate::tuning::presplit::{
    MAX_PRESPLIT_COST, MIN_AREA_RATIO, PRESPLIT_SAMPLE, PRESPLIT_SAMPLES, UNCERTAIN_PRESPLIT_COST,
};
use crate::tuning::wide::{BINARY_LEAF, BYTES_PER_REFERENCE, NODE_COST};

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

/// Shares of the steps of a draft, about: making references is so much of the whole, the object splits are so much of the rest, and
/// the collapse is so much of what follows if subtrees are moved before it and leaf blocks may be joined after it.
const PREPARING: f64 = 0.1;
const SPLITTING: f64 = 0.75;
const COLLAPSE: f64 = 0.6;

/// The share in the rest of a draft of each sample that decides whether to pre-split.
const PRESPLIT_TRIAL: f64 = 0.05;

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
    let (drafter, mut references, budget) =
        Drafter::new(set, ids, slice, params, density, &progress.subtask(PREPARING));
    let draft = match params.decided {
        // A sample of a few would be all of them.
        None if budget.is_some() && references.len() <= *PRESPLIT_SAMPLE.start() => {
            let mut better = drafter.better(references, budget, progress)?;
            if reinsertion.is_due(set, &better.binary, &better.references) {
                better.replace_subtrees(set, &mut [], progress);
                better.reinserted = true;
            }
            better
        }
        decided => {
            // If that was decided, elongated primitives are to be split.
            let pays = |&budget: &f32| decided.is_some() || drafter.presplit_pays(&references, budget, progress);
            let budget = budget.filter(pays);
            if progress.cancelled() {
                return None;
            }
            if let Some(budget) = budget {
                drafter.presplit(&mut references, budget);
            }
            drafter.draft(references, budget.is_some(), reinsertion, &progress.rest(1.0))?
        }
    };
    (!progress.cancelled()).then_some(draft)
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
    let (drafter, references, budget) = Drafter::new(set, ids, TimeSlice::WHOLE, &params, None, progress);
    let draft = drafter.better(references, budget, progress);
    let decided = draft.as_ref().map_or(PresplitDecision { ratio, pays: false }, Draft::decided);
    (draft, decided)
}

/// What drafts of the same primitives have in common.
struct Drafter<'a, S> {
    set: &'a S,
    /// The number of primitives.
    primitives: usize,
    slice: TimeSlice,
    /// Half the area of a box per area of the triangle in it.
    ratio: Option<f64>,
    density: SurfaceDensity,
}

impl<'a, S: PrimitiveSet> Drafter<'a, S> {
    /// Makes a reference for each primitive. Also returns how many references per primitive pre-splitting may make, unless it is
    /// out of the question.
    fn new(
        set: &'a S,
        ids: &[u32],
        slice: TimeSlice,
        params: &DraftParams,
        density: Option<SurfaceDensity>,
        progress: &Progress,
    ) -> (Drafter<'a, S>, Vec<Reference>, Option<f32>) {
        let over = slice.interval();
        let ratio = params.decided.map_or_else(|| area_ratio(set, ids, over), |decided| decided.ratio);
        let budget = params.most_references();
        let elongated = is_elongated(budget, ratio) && params.decided.is_none_or(|decided| decided.pays);
        // Room for all sub-references from the start: memory that is not touched costs nothing.
        let most = if elongated { (ids.len() as f64 * f64::from(budget)) as usize + 1 } else { ids.len() };
        // Some more for reinsertion.
        let mut references = huge_vec(most + most / 16);
        write_references(set, ids, over, &mut references, progress);
        let density = density.unwrap_or_else(|| SurfaceDensity::of(&references, ratio.unwrap_or(LEAST_AREA_RATIO)));
        let drafter = Drafter { set, primitives: ids.len(), slice, ratio, density };
        (drafter, references, elongated.then_some(budget))
    }

    /// Splits references within a budget.
    fn presplit(&self, references: &mut Vec<Reference>, budget: f32) {
        let over = self.slice.interval();
        presplit(references, |id| self.set.corner_bounds(id, over), budget);
    }

    /// Drafts a tree and, within the budget, a pre-split one, and keeps that if it pays.
    fn better(&self, mut references: Vec<Reference>, budget: Option<f32>, progress: &Progress) -> Option<Draft> {
        let draft = |references, split| self.draft(references, split, WhenToReinsert::Later, &progress.rest(0.5));
        let Some(budget) = budget else { return draft(references, false) };
        let whole = draft(references.clone(), false)?;
        self.presplit(&mut references, budget);
        let split = draft(references, true)?;
        Some(if split.collapse.total() < whole.collapse.total() * MAX_PRESPLIT_COST { split } else { whole })
    }

    /// Whether pre-splitting pays in a few samples of neighbouring references.
    fn presplit_pays(&self, references: &[Reference], budget: f32, progress: &Progress) -> bool {
        let n = references.len();
        let most = (n / (16 * PRESPLIT_SAMPLES)).clamp(*PRESPLIT_SAMPLE.start(), *PRESPLIT_SAMPLE.end());
        let (mut with, mut without) = (0.0, 0.0);
        for sample in neighbourhoods(references, PRESPLIT_SAMPLES, most) {
            let progress = progress.rest(PRESPLIT_TRIAL);
            let cost = |references| {
                let draft = self.draft(references, true, WhenToReinsert::Later, &progress.subtask(0.5));
                draft.map_or(0.0, |draft| draft.collapse.total())
            };
            let mut split = sample.clone();
            self.presplit(&mut split, budget);
            let (split, whole) = parallel::both(|| cost(split), || cost(sample));
            with += split;
            without += whole;
            if !UNCERTAIN_PRESPLIT_COST.contains(&(with / without)) {
                break;
            }
        }
        with < without * MAX_PRESPLIT_COST
    }

    /// Drafts one tree; `presplit` tells whether references may be sub-references, which bound a part of their primitive. `None`
    /// once `progress` is cancelled.
    fn draft(
        &self,
        mut references: Vec<Reference>,
        presplit: bool,
        reinsertion: WhenToReinsert,
        progress: &Progress,
    ) -> Option<Draft> {
        let &Drafter { set, primitives, slice, ratio, density } = self;
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
        let reinserted = reinsertion.is_due(set, &binary, &references);
        if reinserted && let Some(better) = reinsert(&binary, &mut references, &mut [], density, progress) {
            binary = better;
        }
        let share = if reinserted { COLLAPSE } else { 1.0 };
        let collapse = collapse(set, &binary, &references, density, &progress.rest(share));
        let over = slice.interval();
        let mut draft =
            Draft { slice, over, references, primitives, presplit, reinserted, ratio, density, binary, collapse };
        if reinserted {
            draft.join_leaves(set, progress);
        }
        (!progress.cancelled()).then_some(draft)
    }
}

/// Whether triangles fill so little of their boxes that pre-splitting may pay.
fn is_elongated(budget: f32, ratio: Option<f64>) -> bool {
    budget > 1.0 && ratio.is_some_and(|ratio| ratio >= MIN_AREA_RATIO)
}

/// The least ratio of half the area of a box to the area of its contents: that of a triangle that fills half a flat
/// box. That of spheres is hardly less, as a ray sees half of their surface.
const LEAST_AREA_RATIO: f64 = 2.0;

/// The sum of half-areas of the boxes, per area of the triangles in them; `None` for primitives that cannot be split.
fn area_ratio<S: PrimitiveSet>(set: &S, ids: &[u32], over: TimeInterval) -> Option<f64> {
    let (mut boxes, mut triangles) = (0.0, 0.0);
    // A sample of one or two thousand is enough.
    for &id in ids.iter().step_by(ids.len() / 2048 + 1) {
        let Some(corners) = set.corner_bounds(id, over) else { continue };
        boxes += f64::from(corners.union().begin.half_area());
        triangles += f64::from(corners.area());
    }
    (triangles > 0.0).then_some(boxes / triangles)
}

/// Primitives whose bounds are computed together: they stay in a near cache.
const TOGETHER: usize = 256;

/// Primitives between two reports of progress: a multiple of that. Not fitted: they take a few hundred microseconds.
const REPORTED: usize = 16 * TOGETHER;

/// Writes a reference for each of some primitives. Once `progress` is cancelled, some are of nothing.
fn write_references<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    over: TimeInterval,
    references: &mut Vec<Reference>,
    progress: &Progress,
) {
    let progress = progress.in_units(ids.len());
    let write = |ids: &[u32], references: &mut [Reference]| {
        let mut bounds = [LaneBounds::EMPTY; TOGETHER];
        set.lane_bounds(ids, over, &mut bounds[..ids.len()]);
        Reference::write(ids, &bounds, references);
    };
    references.resize(ids.len(), Reference::new(LinearBox3::EMPTY, 0));
    let mut parts: Vec<_> = ids.chunks(REPORTED).zip(references.chunks_mut(REPORTED)).collect();
    parallel::each(&mut parts, |(ids, references)| {
        if !progress.cancelled() {
            let parts = ids.chunks(TOGETHER).zip(references.chunks_mut(TOGETHER));
            parts.for_each(|(ids, references)| write(ids, references));
            progress.finished(ids.len() as f64);
        }
    });
}

#[cfg(test)]
impl Draft {
    /// The triangles of a scene, and their draft for the whole shutter with the default parameters.
    pub fn of_scene(scene: &crate::scene::Scene) -> (crate::primitive::Triangles, Draft) {
        let set = crate::primitive::Triangles::new(&scene.meshes).expect("valid meshes");
        let ids: Vec<u32> = (0..scene.triangles() as u32).collect();
        let (params, progress) = (DraftParams::new(WideParams::default()), Progress::new(None));
        let draft = draft_tree(&set, &ids, TimeSlice::WHOLE, &params, None, WhenToReinsert::Later, &progress);
        (set, draft.expect("a draft"))
    }
}
