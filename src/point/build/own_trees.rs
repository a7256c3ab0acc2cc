//! The choice of a structure for small sets of points that exist throughout, by trees of the whole set.
//!
//! Trees of some thousand points take little more time than samples of them, which are so small that searches in them miss half of
//! what they would visit. The linear tree is built, and how much larger its boxes are for the motion says whether time slices can
//! gain anything ([`super::excess`]). If so, the work of searches in it is counted, and that of shorter slices is predicted by
//! their boxes. The first tree of those that promise most is built, and its searches are counted, as long as that gains.

use super::cost::{ReferenceCounts, Visits, memory_cost};
use super::excess::{Excess, excess, leaves_by_position};
use super::layer_request::{LayerRequest, slices_named};
use super::partial_layer::PartialLayer;
use super::slice_points::SlicePoints;
use super::source::Source;
use super::time_slices::{linear_tree, middle_slice};
use crate::point::layout::moving_tree::WithoutFast;
use crate::point::leaf_order::segment_slice::segments;
use crate::simd::MovingPointBlock;
use crate::tuning::points::{MAX_COST, NEARLY, OVERESTIMATED, OWN_TREES};
use core::iter;

/// Begins the cheapest layer for all points, and gives the reason for its number of time slices; `None` where another way to choose
/// takes less time.
pub(in crate::point) fn by_own_trees<'a>(request: LayerRequest<'a>) -> Option<(PartialLayer<'a>, String)> {
    let LayerRequest { source, points, max_references, simd, progress } = request;
    if !source.all_persist() || !OWN_TREES.contains(&points.len()) {
        return None;
    }
    let WithoutFast { tree, by_motion, .. } = linear_tree(source, points, None, progress);
    let by_position = by_motion.then(|| by_position(source, points));
    let leaves = by_position.as_ref().unwrap_or(&tree.leaves.blocks);
    let of_one = Excess::of_segment(leaves, simd);
    let slices = ReferenceCounts::of(source, points).affordable(max_references);
    let references = points.len() * segments(source.keys);
    if of_one.is_small(references) || slices.len() == 1 {
        return Some((PartialLayer::linear(request, tree), of_one.why()));
    }
    let sizes = excess(leaves, 0.5, &slices, simd);
    let mut measured = Vec::new();
    let mut measure = |layer: PartialLayer<'a>| {
        let visits = layer.visits();
        let cost = visits.cost() + memory_cost(references * layer.per_segment);
        measured.push(format!("{} {cost:.1}", slices_named(layer.per_segment)));
        Measured { layer, visits, cost }
    };
    let mut best = measure(PartialLayer::linear(request, tree));
    let mut limit = MAX_COST;
    while !progress.cancelled() {
        let now = best.layer.per_segment;
        let size_of = |slices: usize| sizes[slices.ilog2() as usize];
        let predicted = |slices: usize| {
            size_of(slices).visits(&size_of(now), best.visits).cost() + memory_cost(references * slices)
        };
        let finer = || slices.iter().copied().filter(|&slices| slices > now);
        let least = finer().map(predicted).fold(f64::INFINITY, f64::min);
        let Some(slices) = finer().find(|&slices| predicted(slices) * NEARLY <= least && least < best.cost * limit)
        else {
            break;
        };
        let most = predicted(slices) * OVERESTIMATED;
        let mut begin = |slices: usize| measure(PartialLayer::new(request, slices));
        let mut next = begin(slices);
        // Where points meet in the middle of the shutter, it is only certain that one slice is too few.
        let meet = next.cost > most;
        let coarser = iter::successors(Some(slices / 2), |slices| Some(slices / 2));
        for slices in coarser.take_while(|&slices| meet && slices > now) {
            let other = begin(slices);
            if other.cost * MAX_COST > next.cost {
                break;
            }
            next = other;
        }
        if next.cost >= best.cost * MAX_COST {
            break;
        }
        (best, limit) = (next, NEARLY);
        if meet {
            break;
        }
    }
    let measured = measured.join(", ");
    let why =
        format!("chosen from searches in the whole set: {} (costs: {measured})", slices_named(best.layer.per_segment));
    Some((best.layer, why))
}

/// A layer of which one tree is built, what searches in it visit, and their cost.
struct Measured<'a> {
    layer: PartialLayer<'a>,
    visits: Visits,
    cost: f64,
}

/// The leaves of all points, ordered by position alone.
fn by_position(source: &Source, points: &[u32]) -> Vec<MovingPointBlock> {
    let slice = middle_slice(source.keys);
    leaves_by_position(&SlicePoints::<false>::new(source, points, &slice), &slice)
}
