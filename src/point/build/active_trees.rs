//! The choice of a structure for points with active intervals, by trees of the whole set.
//!
//! The shorter time slices are, the fewer points exist in one of them, and the sooner its tree is built. So the first is that of the
//! shortest slices, at a time with as many points before it as behind it, and the work of searches in it is counted. What longer slices
//! cost is expected by the numbers of their points, and by how much larger the boxes of that tree would be ([`super::excess`]). Of those
//! that promise to be chosen the first tree is built and measured, too.

use super::cost::{ReferenceCounts, Visits, memory_cost};
use super::excess::{Excess, excess, leaves_of};
use super::partial_layer::{PartialLayer, name};
use super::plan::Plan;
use super::slice_points::{SlicePoints, points_of_slice};
use super::source::Source;
use crate::point::leaf_order::fast_points::order_at;
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::{LANES, MovingPointBlock, SimdLevel};
use crate::tuning::points::{MAX_COST, OWN_TREES, SHORT_SLICES, VISITED};

/// Whether the structure for so many points, at least one, is chosen by trees of slices.
pub(in crate::point) fn by_active_trees(source: &Source, points: &[u32], max_references: f32) -> bool {
    // Between several keys, the number of references does not say how many points exist.
    if source.all_persist() || source.keys > 2 || points.len() <= LANES {
        return false;
    }
    let exist: f64 = points.iter().map(|&point| source.active(point as usize).fine_duration()).sum();
    let n = points.len() as f64;
    let affordable = n + SHORT_SLICES * exist <= f64::from(max_references) * n;
    points.len() <= *OWN_TREES.end() || affordable
}

/// Begins the cheapest layer for all points; and the reason for its plan.
pub(in crate::point) fn layer_by_active_trees<'a>(
    source: &'a Source,
    points: &'a [u32],
    max_references: f32,
    simd: SimdLevel,
    progress: &Progress,
) -> (PartialLayer<'a>, String) {
    let counts = ReferenceCounts::of(source, points);
    let slices = counts.affordable(max_references);
    let middle = counts.middle;
    let begin = |slices: usize| PartialLayer::at(source, points, Plan::Boxes(slices), middle, progress);
    let mut next = slices.last().copied();
    let mut trees = Trees { counts, slices, simd, tried: Vec::new() };
    while let Some(slices) = next {
        trees.measure(source, begin(slices));
        next = trees.next().filter(|_| !progress.cancelled());
    }
    let costs = trees.tried.iter().map(|tried| format!("{} {:.1}", name(tried.layer.plan), tried.cost));
    let costs = costs.collect::<Vec<_>>().join(", ");
    let layer = trees.chosen().unwrap_or_else(|| begin(1));
    let why = format!("chosen from searches in the whole set: {} (costs: {costs})", name(layer.plan));
    (layer, why)
}

/// The layers of which one tree is built.
struct Trees<'a> {
    counts: ReferenceCounts,
    /// The numbers of time slices that are affordable: powers of two.
    slices: Vec<usize>,
    simd: SimdLevel,
    tried: Vec<Tried<'a>>,
}

/// A layer, and what searches in its tree visit.
struct Tried<'a> {
    layer: PartialLayer<'a>,
    visits: Visits,
    cost: f64,
    /// How much larger boxes would be for the motion of points, with each affordable number of time slices.
    sizes: Vec<Excess>,
}

impl Tried<'_> {
    fn slices(&self) -> usize {
        self.layer.plan.time_slices()
    }
}

impl<'a> Trees<'a> {
    /// Counts the work of searches.
    fn measure(&mut self, source: &'a Source, layer: PartialLayer<'a>) {
        let slice = *layer.slice();
        let middle = slice.middle_phase();
        let sizes = |leaves: &[MovingPointBlock]| excess(leaves, middle as f32, &self.slices, self.simd);
        let sizes = match &layer.tree {
            Layer::Moving(trees) if !layer.by_motion => sizes(&trees[0].leaves.blocks),
            _ => {
                let existing = points_of_slice(source, layer.points, &slice);
                let references = SlicePoints::<true>::new(source, &existing, &slice);
                sizes(&leaves_of(&references, &order_at(&references, middle)))
            }
        };
        let (visits, slices) = (layer.visits(self.simd), layer.plan.time_slices());
        let cost = visits.cost() + self.memory_cost(slices);
        self.tried.push(Tried { layer, visits, cost, sizes });
    }

    /// The cost of the memory of so many time slices: beside a reference there are its interval and that of its point.
    fn memory_cost(&self, slices: usize) -> f64 {
        memory_cost(self.counts.with(slices) * 3 / 2)
    }

    /// The measured cost of so many time slices, or what is expected by the tree of the number nearest to it.
    fn expected(&self, slices: usize) -> f64 {
        let level = |slices: usize| slices.ilog2() as usize;
        let nearest = self.tried.iter().min_by_key(|tried| level(tried.slices()).abs_diff(level(slices)));
        nearest.map_or(f64::INFINITY, |Tried { layer, visits, cost, sizes }| {
            let now = layer.plan.time_slices();
            if now == slices {
                return *cost;
            }
            // Searches pass by points that do not exist at their time, and visit larger boxes.
            let [in_slice, in_now] = [slices, now].map(|slices| self.counts.with(slices) as f64 / slices as f64);
            let ([of_slice, of_now], more) = ([slices, now].map(|slices| sizes[level(slices)]), in_slice / in_now);
            let nodes = visits.nodes * (more * of_slice.nodes / of_now.nodes).powf(VISITED);
            let blocks = visits.blocks * (more * of_slice.leaves / of_now.leaves).powf(VISITED);
            Visits { nodes, blocks }.cost() + self.memory_cost(slices)
        })
    }

    /// The number of time slices that promises to be chosen, if it was not tried.
    fn next(&self) -> Option<usize> {
        let least = self.slices.iter().map(|&slices| self.expected(slices)).fold(f64::INFINITY, f64::min);
        let longest = self.slices.iter().copied().find(|&slices| self.expected(slices) * MAX_COST <= least)?;
        self.tried.iter().all(|tried| tried.slices() != longest).then_some(longest)
    }

    /// The layer with the longest time slices among those of about the least cost.
    fn chosen(self) -> Option<PartialLayer<'a>> {
        let least = self.tried.iter().map(|tried| tried.cost).fold(f64::INFINITY, f64::min);
        let cheap = self.tried.into_iter().filter(|tried| tried.cost * MAX_COST <= least);
        cheap.min_by_key(Tried::slices).map(|tried| tried.layer)
    }
}
