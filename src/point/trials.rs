//! Choosing a structure by its cost: small builds, sample queries, counted work.
//!
//! The best structure depends on how far points move relative to their neighbours, on how many do, and on how
//! long they exist; no formula over these was as good as trials. So samples of the set are built
//! in each candidate structure, and the work of a few hundred searches among them is counted in
//! nodes and blocks. Counting instead of timing makes the choice the same on every machine.

use super::build::{Plan, time_slices_of};
use super::counted_search::{CountedSearch, search_counted};
use super::layers::Layer;
use super::moving_reference::{MovingReference, TimeSlice, positions_at};
use super::moving_tree::MovingTree;
use super::sample::{Sample, Sampler};
use super::search::KeepLanes;
use super::search::candidates::Candidates;
use super::source::Source;
use super::spread::spread;
use super::static_tree::Shape;
use super::widest_axis::include;
use crate::geometry::{KeyTime, TimeInterval};
use crate::progress::Progress;
use crate::simd::{Item, Lanes, Mask, SimdLevel};
use crate::tuning::points::{
    BLOCK_COST, HALF_UNCACHED_BYTES, MAX_COST, REFERENCE_BYTES, SEARCHED, SEARCHES, UNCACHED_COST,
};
use glam::Vec3;

/// A structure that was tried, and its cost per search, in node visits of a small tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trial {
    pub(super) plan: Plan,
    /// Plan of the fast points if they have a layer of their own.
    pub(super) fast: Option<Plan>,
    pub(super) cost: f64,
    /// References of the sampled points: a measure of its memory.
    references: usize,
}

/// Trials of structures for some points of a set, on samples.
pub(super) struct Trials<'a> {
    source: &'a Source,
    points: &'a [u32],
    /// The allowed number of references per point.
    most: f32,
    simd: SimdLevel,
    sampler: Sampler<'a>,
    pub(super) all: Vec<Trial>,
    /// The longest side of a leaf of usual size.
    pub(super) leaf_size: f32,
}

/// The largest number of time slices of a segment.
const FINEST: usize = 32;

impl<'a> Trials<'a> {
    /// Tries finer and finer time slices for all points (at least one), and for the fast ones alone if they are few, until
    /// halving the slices does not help any more.
    pub(super) fn new(source: &'a Source, points: &'a [u32], most: f32, simd: SimdLevel) -> Trials<'a> {
        let sampler = Sampler::new(source, points, simd);
        let mut trials = Trials { source, points, most, simd, sampler, all: Vec::new(), leaf_size: 0.0 };
        let simple = Plan::Boxes(1);
        let samples = trials.sampler.samples(1, true);
        let mut sizes: Vec<f32> = samples.iter().map(|sample| sample.leaf_size).collect();
        sizes.sort_by(f32::total_cmp);
        trials.leaf_size = sizes[sizes.len() / 2];
        let fast: usize = samples.iter().map(|s| s.references.iter().filter(|m| m.fast).count()).sum();
        let few = fast > 0 && fast * 4 < samples.iter().map(|s| s.references.len()).sum::<usize>();
        let mut before = [trials.add(&samples, simple, None); 2];
        let mut goes_on = [true, few];
        let mut slices = 2;
        loop {
            let with_fast = |m: &MovingReference| if m.fast { trees_of(m.active, slices, source.keys) } else { 1 };
            let per_point = samples.iter().map(|s| s.scale * s.references.iter().map(with_fast).sum::<usize>() as f64);
            let within =
                [trials.affordable(slices), trials.may_have(slices, per_point.sum::<f64>() / samples.len() as f64)];
            goes_on = [goes_on[0] && within[0], goes_on[1] && within[1]];
            if goes_on == [false; 2] {
                break;
            }
            let (samples, plan) = (trials.sampler.samples(slices, few), Plan::Boxes(slices));
            for (i, (slow, fast)) in [(plan, None), (simple, Some(plan))].into_iter().enumerate() {
                if goes_on[i] {
                    let cost = trials.add(&samples, slow, fast);
                    goes_on[i] = cost <= before[i] * 0.98;
                    before[i] = cost;
                }
            }
            slices *= 2;
        }
        trials
    }

    /// The smallest structure among those of about the least cost; of equally small ones the first, which is the
    /// simplest. Unless `separate_fast`, only structures with one layer for all points are considered.
    pub(super) fn best(&self, separate_fast: bool) -> Trial {
        let all = || self.all.iter().filter(|trial| separate_fast || trial.fast.is_none());
        let least = all().map(|trial| trial.cost).fold(f64::INFINITY, f64::min);
        let cheap = all().filter(|trial| trial.cost * MAX_COST <= least);
        *cheap.min_by_key(|trial| trial.references).unwrap_or(&self.all[0])
    }

    /// The cost with time slices half as long, if these are affordable.
    pub(super) fn finer(&mut self, plan: Plan) -> Option<f64> {
        let plan = Plan::Boxes(2 * plan.time_slices());
        if let Some(trial) = self.all.iter().find(|trial| (trial.plan, trial.fast) == (plan, None)) {
            return Some(trial.cost);
        }
        self.affordable(plan.time_slices()).then(|| {
            let samples = self.sampler.samples(plan.time_slices(), false);
            self.add(&samples, plan, None)
        })
    }

    /// The cost of layers over all points with this many references in all, measured in their trees of one time slice.
    pub(super) fn measured(&self, layers: &[&Layer], references: usize, slice: &TimeSlice) -> f64 {
        let later = (slice.segment + 1).min(slice.keys - 1);
        let ends = |i: usize| {
            let point = self.points[spread(i, self.points.len())] as usize;
            [slice.segment, later].map(|key| self.source.at(point, key))
        };
        let points: Vec<_> = (0..self.searches()).map(ends).collect();
        search_cost(visited(layers, slice, &points, self.simd), references)
    }

    /// Tries a structure and returns its cost. Samples without active points in their time slice are skipped.
    fn add(&mut self, samples: &[Sample], plan: Plan, fast: Option<Plan>) -> f64 {
        let non_empty = samples.iter().filter(|sample| !sample.references.is_empty());
        let count = non_empty.clone().count().max(1);
        let searches = self.searches().div_ceil(count);
        let all = non_empty.map(|s| work(s, searches, (plan, fast), self.simd));
        let (cost, references) = all.fold((0.0, 0), |sum, (cost, n)| (sum.0 + cost, sum.1 + n));
        let cost = cost / count as f64;
        self.all.push(Trial { plan, fast, cost, references });
        cost
    }

    /// The number of searches of a trial.
    fn searches(&self) -> usize {
        let [least, most] = SEARCHES;
        (self.points.len() / SEARCHED).clamp(least, most)
    }

    /// Whether a segment may have this many time slices of all points.
    pub(super) fn affordable(&self, slices: usize) -> bool {
        if slices as f32 <= self.most {
            return slices <= FINEST;
        }
        self.may_have(slices, references_of(self.source, self.points, slices) as f64)
    }

    /// Whether a segment may have this many time slices of some points, if there are so many references to all in all.
    pub(super) fn may_have(&self, slices: usize, references: f64) -> bool {
        slices <= FINEST && references <= f64::from(self.most) * self.points.len() as f64
    }
}

/// The number of references to points, with this many time slices for each segment.
pub(super) fn references_of(source: &Source, points: &[u32], slices: usize) -> usize {
    if source.all_persist() {
        return points.len() * slices;
    }
    points.iter().map(|&i| trees_of(source.active(i as usize), slices, source.keys)).sum()
}

/// The number of trees of a segment in which a point is active.
fn trees_of(active: TimeInterval, slices: usize, keys: usize) -> usize {
    if keys > 2 {
        return slices;
    }
    let at = |t: f32| ((t * slices as f32) as usize).min(slices - 1);
    at(active.end()) - at(active.begin()) + 1
}

/// The cost of a search from the weighted number of visited nodes and blocks, and the number of references.
fn search_cost(visited: f64, references: usize) -> f64 {
    let bytes = references as f64 * REFERENCE_BYTES;
    UNCACHED_COST * bytes / (bytes + HALF_UNCACHED_BYTES) + visited
}

/// The weighted work of searches during the time slice that a sample represents, and its references.
fn work(sample: &Sample, searches: usize, (plan, fast): (Plan, Option<Plan>), simd: SimdLevel) -> (f64, usize) {
    let Sample { references, slice, scale, .. } = sample;
    let TimeSlice { keys, segment, interval, .. } = slice;
    let group = |plan: Plan, keep: &dyn Fn(&MovingReference) -> bool| {
        let count = plan.time_slices();
        let answers = |slice: &TimeSlice| slice.interval.contains(interval.begin());
        let slice = time_slices_of(*segment, *keys, count).find(answers).unwrap_or(*slice);
        let inside =
            |m: &MovingReference| Some(MovingReference { interval: m.active.intersect(slice.interval)?, ..*m });
        let inside: Vec<MovingReference> = references.iter().filter(|m| keep(m)).filter_map(inside).collect();
        let layer = Layer::Moving(vec![MovingTree::build(&inside[..], slice, &Progress::new(None))]);
        let kept = references.iter().filter(|m| keep(m));
        let count: usize = kept.map(|m| trees_of(m.active, count, *keys)).sum();
        (layer, count)
    };
    let groups = match fast {
        Some(fast) => vec![group(plan, &|m| !m.fast), group(fast, &|m| m.fast)],
        None => vec![group(plan, &|_| true)],
    };
    let layers: Vec<&Layer> = groups.iter().map(|(layer, _)| layer).collect();
    let points: Vec<_> = central(references, slice, searches).into_iter().map(|m| [m.open, m.close]).collect();
    let count: usize = groups.iter().map(|(_, count)| count).sum();
    let all = (count as f64 * scale) as usize;
    // The tree of the whole set is higher, and searches visit one more node on each further level.
    let whole = (references.len() as f64 * scale) as usize;
    let higher = [references.len(), whole].map(|count| Shape::with_leaf(count, 1).levels);
    let higher = higher[1].saturating_sub(higher[0]) as f64;
    (search_cost(visited(&layers, slice, &points, simd) + higher, all), count)
}

/// The weighted number of nodes and blocks that a search for eight neighbours visits in layers, averaged over searches
/// at points between their keys, at times of a time slice.
fn visited(layers: &[&Layer], slice: &TimeSlice, points: &[[[f32; 3]; 2]], simd: SimdLevel) -> f64 {
    let mut candidates = Candidates::default();
    let mut total = 0.0;
    for (i, ends) in points.iter().enumerate() {
        // Times in an order that is independent of the positions.
        let fraction = ((i * 89) % points.len()) as f32 / points.len() as f32;
        let time = slice.interval.begin() + slice.interval.duration() * fraction;
        let layers: Vec<_> = layers.iter().map(|layer| (core::slice::from_ref(*layer), time)).collect();
        let [open, close] = ends.map(Vec3::from_array);
        let point = KeyTime::new(time, slice.keys).position(open, close);
        let all = |_: &Lanes<u32>, mask: Mask| mask;
        let search =
            CountedSearch { layers: &layers, point, k: 8, bound: f32::MAX, shrink: 1.0, keep: KeepLanes(&all) };
        let work = search_counted(simd, &search, &mut candidates);
        total += work.nodes as f64 + BLOCK_COST * work.blocks as f64;
    }
    total / points.len() as f64
}

/// The references nearest to the middle of a sample in the middle of its time slice. Points that come among
/// them at other times are in the sample as well, unless they come from far away.
fn central<'a>(references: &'a [MovingReference], slice: &TimeSlice, count: usize) -> Vec<&'a MovingReference> {
    let items = positions_at(references, slice.middle_phase());
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    items.iter().for_each(|item| include(&mut lo, &mut hi, item.at));
    let off = |axis: usize, x: f32| {
        let size = hi[axis] - lo[axis];
        if size > 0.0 { ((x - lo[axis]) / size - 0.5).abs() } else { 0.0 }
    };
    let off = |item: &Item| (0..3).map(|axis| off(axis, item.at[axis])).fold(0.0, f32::max);
    let mut all: Vec<(f32, u32)> = items.iter().map(|item| (off(item), item.index)).collect();
    if count < all.len() {
        all.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(count);
    }
    all.into_iter().map(|(_, index)| &references[index as usize]).collect()
}
