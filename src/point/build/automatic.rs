//! The automatic choice of a structure, and its build.
//!
//! Small sets and those with short active intervals are compared by trees of the whole set ([`super::own_trees`],
//! [`super::active_trees`]). Where points of samples that are close together stay together, as those of the finished tree do,
//! nothing can cost much less than one tree ([`super::excess`]). Otherwise samples give a first choice ([`super::trials`]). Where
//! few points are fast and cause most of the work, they are put apart without more trials, and these only follow if that costs more
//! than expected. Samples hardly contain points that come from far away, so a structure may turn out to cost more. Therefore the
//! tree of one time slice is built over the whole set, and the work of searches in it is counted. If shorter slices promise to cost
//! less, the tree of one of those is built as well. The trees of the structure that is finally chosen are reused.

use super::active_trees::by_active_trees;
use super::cost::ReferenceCounts;
use super::excess::Excess;
use super::layer_request::{ChosenLayer, LayerRequest, slices_named};
use super::own_trees::by_own_trees;
use super::partial_layer::PartialLayer;
use super::time_slices::linear_tree;
use super::trials::{Trial, Trials};
use crate::point::layout::moving_tree::{MovingTree, WithoutFast};
use crate::point::leaf_order::segment_slice::segments;
use crate::progress::Progress;
use crate::simd::LANES;
use crate::tuning::points::{MAX_COST, MAX_PREDICTED_COST, MAX_REFINED_COST};

/// So many points fit below one bottom node. Trials would cost many times as much as the tree.
const FEW: usize = LANES * LANES;

const WHY_FEW: &str = "so few points fit below one node";

/// The layers of the points.
pub(in crate::point) fn moving_layers(request: LayerRequest<'_>) -> Vec<ChosenLayer> {
    let LayerRequest { source, points, simd, progress, .. } = request;
    if let Some((layer, why)) = by_whole_trees(request) {
        return vec![layer.finish(why, progress)];
    }
    if points.len() <= FEW {
        let layer = PartialLayer::new(request, 1);
        return vec![layer.finish(WHY_FEW.to_string(), progress)];
    }
    let mut trials = Trials::new(request);
    // The linear tree of all points between the keys in the middle, once it is built.
    let mut ready = None;
    if trials.stay_together() {
        let WithoutFast { tree, by_motion, .. } = linear_tree(source, points, None, progress);
        let size = Excess::of_segment(&tree.leaves.blocks, simd);
        if size.is_small(points.len() * segments(source.keys)) && !by_motion {
            let layer = PartialLayer::linear(request, tree);
            return vec![layer.finish(size.why(), progress)];
        }
        ready = Some(tree);
    }
    trials.try_one_tree();
    let fast_first = trials.fast_first();
    if !fast_first {
        trials.try_slices(true);
    }
    let (fast, slow);
    let mut separated = None;
    if fast_first || trials.best(true).fast.is_some() {
        let tree;
        (fast, slow, tree) = split_fast(&mut trials);
        (separated, ready) = match fast[..] {
            [] => (None, Some(tree)),
            _ => (Some(Separated::new((&slow, tree), &fast, &trials)), None),
        };
    }
    let costs_less = |trials: &Trials, factor: f64| {
        separated.as_ref().is_some_and(|separated| separated.cost * factor <= trials.least_of_one_layer())
    };
    let mut chosen = fast_first && costs_less(&trials, MAX_COST);
    if fast_first && !chosen {
        trials.try_slices(false);
    }
    chosen = chosen || costs_less(&trials, MAX_PREDICTED_COST);
    let why = explain(&trials);
    if let Some(separated) = separated.take_if(|_| chosen) {
        return separated.finish(why, progress);
    }
    let (whole, cost, mut measured) = one_layer(&mut trials, ready);
    if let Some(separated) = separated {
        if separated.cost * MAX_COST <= cost {
            return separated.finish(why, progress);
        }
        let Separated { fast, cost, .. } = separated;
        measured = format!("{measured}, fast points apart in {} {cost:.1}", slices_named(fast.per_segment));
    }
    vec![whole.finish(format!("{why}; {measured}"), progress)]
}

/// The number of time slices of each segment in one layer for all points, and the reason for it.
pub(in crate::point) fn slices_for_all(request: LayerRequest<'_>) -> (usize, String) {
    if let Some((layer, why)) = by_whole_trees(request) {
        return (layer.per_segment, why);
    }
    if request.points.len() <= FEW {
        return (1, WHY_FEW.to_string());
    }
    let mut trials = Trials::new(request);
    trials.try_one_tree();
    trials.try_slices(false);
    let why = explain(&trials);
    let (whole, _, measured) = one_layer(&mut trials, None);
    (whole.per_segment, format!("{why}; {measured}"))
}

/// Begins the cheapest layer for all points by trees of the whole set, if that takes less time than samples; and the reason for its
/// number of time slices.
fn by_whole_trees(request: LayerRequest<'_>) -> Option<(PartialLayer<'_>, String)> {
    by_own_trees(request).or_else(|| by_active_trees(request))
}

/// Begins the cheapest layer for all points; returns it, its cost, and a description of the measurements. The linear tree of all
/// points between the keys in the middle may be `ready`.
fn one_layer<'a>(trials: &mut Trials<'a>, ready: Option<MovingTree>) -> (PartialLayer<'a>, f64, String) {
    let request @ LayerRequest { source, points, progress, .. } = trials.request;
    let mut layer = match trials.best(false).slices {
        1 => {
            let tree = ready.unwrap_or_else(|| linear_tree(source, points, None, progress).tree);
            PartialLayer::linear(request, tree)
        }
        slices => PartialLayer::new(request, slices),
    };
    let cost_of = |layer: &PartialLayer, trials: &Trials| layer.visits().cost() + trials.memory_cost(layer.per_segment);
    let mut cost = cost_of(&layer, trials);
    let mut measured = vec![format!("in the whole set {} {cost:.1}", slices_named(layer.per_segment))];
    while let Some(finer) = trials.finer(layer.per_segment, cost).filter(|_| !progress.cancelled()) {
        let next = PartialLayer::new(request, finer);
        let of_next = cost_of(&next, trials);
        measured.push(format!("{} {of_next:.1}", slices_named(next.per_segment)));
        if of_next >= cost * MAX_COST {
            break;
        }
        trials.learn((layer.per_segment, cost), (next.per_segment, of_next));
        (layer, cost) = (next, of_next);
    }
    let measured = format!("{}: {}", measured.join(", "), slices_named(layer.per_segment));
    (layer, cost, measured)
}

/// The fast points, the others, and the linear tree of those between the keys in the middle.
fn split_fast(trials: &mut Trials) -> (Vec<u32>, Vec<u32>, MovingTree) {
    let LayerRequest { source, points, progress, .. } = trials.request;
    let leaf_size = Some(trials.leaf_size);
    let WithoutFast { tree, fast, .. } = linear_tree(source, points, leaf_size, progress);
    let mut is_fast = vec![false; source.len];
    fast.iter().for_each(|&point| is_fast[point as usize] = true);
    let slow = points.iter().copied().filter(|&point| !is_fast[point as usize]).collect();
    (fast, slow, tree)
}

/// Two layers, one of them for the fast points.
struct Separated<'a> {
    slow: PartialLayer<'a>,
    fast: PartialLayer<'a>,
    cost: f64,
}

impl<'a> Separated<'a> {
    fn new((slow, tree): (&'a [u32], MovingTree), fast: &'a [u32], trials: &Trials<'a>) -> Separated<'a> {
        let [slow, fast] = [slow, fast].map(|points| LayerRequest { points, ..trials.request });
        let [of_slow, of_fast] = [slow, fast].map(|request| ReferenceCounts::of(request.source, request.points));
        let references = |slices: usize| of_slow.with(1) + of_fast.with(slices);
        let slow = PartialLayer::linear(slow, tree);
        let begin = |slices: usize| {
            let fast = PartialLayer::new(fast, slices);
            let cost = trials.measured(&[&slow.tree, &fast.tree], references(slices), fast.slice());
            (fast, cost)
        };
        let affordable = |slices: usize| trials.may_have(slices, references(slices) as f64);
        // Fast points gain more by time slices than all together. There may be more of them than samples promised.
        let mut slices = 2 * trials.few_slices();
        while slices > 1 && !affordable(slices) {
            slices /= 2;
        }
        let (mut of_fast, mut cost) = begin(slices);
        // Trees over a few points are built quickly and take little memory.
        while !trials.request.progress.cancelled() && affordable(2 * of_fast.per_segment) {
            let finer = begin(2 * of_fast.per_segment);
            if finer.1 > cost * MAX_REFINED_COST {
                break;
            }
            (of_fast, cost) = finer;
        }
        Separated { slow, fast: of_fast, cost }
    }

    fn finish(self, why: String, progress: &Progress) -> Vec<ChosenLayer> {
        let Separated { slow, fast, cost } = self;
        let [of_slow, of_fast] = [&slow, &fast].map(|layer| layer.request.points.len() as f64);
        let of_slow = progress.rest(of_slow / (of_slow + of_fast));
        let why = format!("{why}; in the whole set fast points apart in {} {cost:.1}", slices_named(fast.per_segment));
        let slow = slow.finish(why, &of_slow);
        drop(of_slow);
        vec![slow, fast.finish("fast points, apart from the others".to_string(), progress)]
    }
}

/// A description of the trials.
fn explain(trials: &Trials) -> String {
    let name = |trial: &Trial| match trial.fast {
        Some(fast) => format!("fast points apart in {}", slices_named(fast)),
        None => slices_named(trial.slices),
    };
    let costs: Vec<String> = trials.all.iter().map(|t| format!("{} {:.1}", name(t), t.cost)).collect();
    format!("chosen from trial searches: {} (costs: {})", name(&trials.best(true)), costs.join(", "))
}
