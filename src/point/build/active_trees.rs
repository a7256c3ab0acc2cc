//! The choice of a structure for points with active intervals, by trees of the whole set.
//!
//! The shorter time slices are, the fewer points exist in one of them, and the sooner its tree is built. So the first trees are
//! those of the shortest slices, at the times with a quarter and three quarters of the points before them, and the work of searches
//! in them is counted: points that burst apart are far from each other most of the time, but not at first. What longer slices cost
//! is expected by the numbers of their points, and by how much larger the boxes of these trees would be ([`super::excess`]). Of
//! those that promise to be chosen such trees are built and measured, too.

use super::cost::{ReferenceCounts, Visits, memory_cost};
use super::excess::{Excess, excess, leaves_by_position};
use super::layer_request::{LayerRequest, slices_named};
use super::partial_layer::PartialLayer;
use super::slice_points::{SlicePoints, points_of_slice};
use crate::point::search::layers::Layer;
use crate::simd::{LANES, MovingPointBlock};
use crate::tuning::points::{MAX_COST, MOST_ALIKE, OWN_TREES, SHORT_SLICES, VISITED};

/// Whether trees of slices take less time than another way to choose.
fn takes_less_time(request: LayerRequest<'_>) -> bool {
    let LayerRequest { source, points, max_references, .. } = request;
    // Between several keys, the number of references does not say how many points exist.
    if source.all_persist() || source.keys > 2 || points.len() <= LANES {
        return false;
    }
    let exist: f64 = points.iter().map(|&point| source.active(point as usize).fine_duration()).sum();
    let n = points.len() as f64;
    let affordable = n + SHORT_SLICES * exist <= f64::from(max_references) * n;
    points.len() <= *OWN_TREES.end() || affordable
}

/// Begins the cheapest layer for all points, and gives the reason for its number of time slices; `None` where another way to choose
/// takes less time.
pub(in crate::point) fn by_active_trees(request: LayerRequest<'_>) -> Option<(PartialLayer<'_>, String)> {
    if !takes_less_time(request) {
        return None;
    }
    let counts = ReferenceCounts::of(request.source, request.points);
    let slices = counts.affordable(request.max_references);
    let quarters = counts.quarters;
    let begin = |slices: usize, time: f32| PartialLayer::at(request, slices, time);
    let mut next = slices.last().copied();
    let mut trees = Trees { counts, slices, tried: Vec::new() };
    while let Some(slices) = next {
        let [time, later] = quarters;
        let layer = begin(slices, time);
        let other = (!layer.holds(later) && trees.may_differ(slices)).then(|| begin(slices, later));
        trees.measure(layer, other);
        next = trees.next().filter(|_| !request.progress.cancelled());
    }
    let costs = trees.tried.iter().map(|tried| format!("{} {:.1}", slices_named(tried.layer.per_segment), tried.cost));
    let costs = costs.collect::<Vec<_>>().join(", ");
    let layer = trees.chosen().unwrap_or_else(|| begin(1, 0.5));
    let why = format!("chosen from searches in the whole set: {} (costs: {costs})", slices_named(layer.per_segment));
    Some((layer, why))
}

/// The layers of which one tree is built.
struct Trees<'a> {
    counts: ReferenceCounts,
    /// The numbers of time slices that are affordable: powers of two.
    slices: Vec<usize>,
    tried: Vec<Tried<'a>>,
}

/// A layer, and what searches in its trees visit.
struct Tried<'a> {
    layer: PartialLayer<'a>,
    trees: Vec<Measured>,
    cost: f64,
}

/// What searches in the tree of a time slice visit.
struct Measured {
    visits: Visits,
    /// How much larger boxes would be for the motion of points, with each affordable number of time slices.
    sizes: Vec<Excess>,
}

impl Tried<'_> {
    fn slices(&self) -> usize {
        self.layer.per_segment
    }
}

impl<'a> Trees<'a> {
    /// Counts the work of searches in the tree of a layer, and in that of another time slice.
    fn measure(&mut self, layer: PartialLayer<'a>, other: Option<PartialLayer<'a>>) {
        let trees: Vec<Measured> = [&layer].into_iter().chain(&other).map(|of| self.measured(of)).collect();
        let cost = mean(trees.iter().map(|tree| tree.visits)) + self.memory_cost(layer.per_segment);
        let layer = match other {
            Some(other) => layer.and(other),
            None => layer,
        };
        self.tried.push(Tried { layer, trees, cost });
    }

    fn measured(&self, layer: &PartialLayer) -> Measured {
        let LayerRequest { source, points, simd, .. } = layer.request;
        let slice = *layer.slice();
        let middle = slice.middle_phase() as f32;
        let sizes = |leaves: &[MovingPointBlock]| excess(leaves, middle, &self.slices, simd);
        let sizes = match &layer.tree {
            Layer::Moving(trees) if !layer.by_motion => sizes(&trees[0].leaves.blocks),
            _ => {
                let existing = points_of_slice(source, points, &slice);
                sizes(&leaves_by_position(&SlicePoints::<true>::new(source, &existing, &slice), &slice))
            }
        };
        Measured { visits: layer.visits(), sizes }
    }

    /// The cost of the memory of so many time slices: beside a reference there are its interval and that of its point.
    fn memory_cost(&self, slices: usize) -> f64 {
        memory_cost(self.counts.with(slices) * 3 / 2)
    }

    /// The one of the trees tried whose number of time slices is nearest.
    fn nearest(&self, slices: usize) -> Option<&Tried<'a>> {
        self.tried.iter().min_by_key(|tried| level(tried.slices()).abs_diff(level(slices)))
    }

    /// What searches in trees of so many time slices visit at the times of the trees of another number, as is expected by those.
    fn visits(&self, slices: usize, tried: &Tried) -> impl ExactSizeIterator<Item = Visits> {
        let now = tried.slices();
        // Searches pass by points that do not exist at their time, and visit larger boxes.
        let [in_slice, in_now] = [slices, now].map(|slices| self.counts.with(slices) as f64 / slices as f64);
        tried.trees.iter().map(move |Measured { visits, sizes }| {
            let ([of_slice, of_now], more) = ([slices, now].map(|slices| sizes[level(slices)]), in_slice / in_now);
            let nodes = visits.nodes * (more * of_slice.nodes / of_now.nodes).powf(VISITED);
            let blocks = visits.blocks * (more * of_slice.leaves / of_now.leaves).powf(VISITED);
            Visits { nodes, blocks }
        })
    }

    /// The measured cost of so many time slices, or what is expected by the trees of the number nearest to it.
    fn expected(&self, slices: usize) -> f64 {
        self.nearest(slices).map_or(f64::INFINITY, |tried| match tried.slices() == slices {
            true => tried.cost,
            false => mean(self.visits(slices, tried)) + self.memory_cost(slices),
        })
    }

    /// Whether searches may cost much more at one of the two times, so that trees of both are needed.
    fn may_differ(&self, slices: usize) -> bool {
        self.nearest(slices).is_none_or(|tried| {
            let costs = self.visits(slices, tried).map(Visits::cost);
            let [least, most] = costs.fold([f64::INFINITY, 0.0f64], |[a, b], cost| [a.min(cost), b.max(cost)]);
            least < MOST_ALIKE * most
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

fn level(slices: usize) -> usize {
    slices.ilog2() as usize
}

/// The mean cost.
fn mean(of: impl ExactSizeIterator<Item = Visits>) -> f64 {
    let count = of.len() as f64;
    of.map(Visits::cost).sum::<f64>() / count
}
