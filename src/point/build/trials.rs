//! Choosing a structure by its cost: small builds, sample queries, counted work.
//!
//! The best structure depends on how far points move relative to their neighbours, on how many do, and on how
//! long they exist; no formula over these was as good as trials. So samples of the set are built
//! in each candidate structure, and the work of a few hundred searches among them is counted ([`super::cost`]).
//!
//! The work if all points rested is counted as well: where little is to be gained, nothing else is tried.

use super::cost::{FINEST, ReferenceCounts, Visits, memory_cost, searches, trees_of};
use super::excess::Excess;
use super::layer_request::LayerRequest;
use super::sample::{Sample, Sampler};
use super::time_slices::time_slices_of;
use crate::point::layout::moving_tree::MovingTree;
use crate::point::layout::shape::Shape;
use crate::point::leaf_order::motion_groups::{Displaced, MotionDivision, SAMPLE, cost_of_slices};
use crate::point::leaf_order::moving_reference::MovingReference;
use crate::point::leaf_order::segment_slice::{SegmentSlice, segments};
use crate::point::leaf_order::spread::spread;
use crate::point::leaf_order::widest_axis::include;
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::{LANES, SimdLevel};
use crate::tuning::points::{MAX_COST, MAX_PREDICTED_COST, MAX_REFINED_COST};
use core::iter;
use std::borrow::Cow;

/// A structure that was tried, and its cost per search, in node visits of a small tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::point) struct Trial {
    /// Time slices of each segment between keys.
    pub(in crate::point) slices: usize,
    /// Those of the fast points if they have a layer of their own.
    pub(in crate::point) fast: Option<usize>,
    pub(in crate::point) cost: f64,
    /// References of the sampled points: a measure of its memory.
    references: usize,
}

/// Trials of structures for some points of a set, on samples.
pub(in crate::point) struct Trials<'a> {
    pub(in crate::point) request: LayerRequest<'a>,
    references: ReferenceCounts,
    sampler: Sampler<'a>,
    pub(in crate::point) all: Vec<Trial>,
    /// The longest side of a leaf of usual size.
    pub(in crate::point) leaf_size: f32,
    /// Samples of one tree for all points.
    whole: Vec<Sample>,
    /// The work of a search if all points rested. No number of time slices makes it less.
    at_rest: f64,
    /// The cost if the fast points had a layer of their own and rested; infinite unless they are few.
    fast_at_rest: f64,
    /// What trees of the samples that are divided by motion cost at least, relative to points at rest; 1 for those divided by
    /// position.
    flows: Vec<f64>,
}

/// The share of each trial in the rest of the build, about.
const TRIAL: f64 = 0.05;

/// One tree for each segment.
const LINEAR: usize = 1;

/// Of the searches of a trial, one in so many is made among points at rest: they differ little from each other.
const BOUNDED: usize = 2;

impl<'a> Trials<'a> {
    /// Takes samples.
    pub(in crate::point) fn new(request: LayerRequest<'a>) -> Trials<'a> {
        let LayerRequest { source, points, simd, progress, .. } = request;
        let _reported = progress.rest(TRIAL);
        let sampler = Sampler::new(source, points, simd);
        let whole = sampler.samples(1, true);
        let mut sizes: Vec<f32> = whole.iter().map(|sample| sample.leaf_size).collect();
        sizes.sort_by(f32::total_cmp);
        let leaf_size = sizes[sizes.len() / 2];
        let (all, at_rest, fast_at_rest) = (Vec::new(), 0.0, f64::INFINITY);
        let flows = whole.iter().map(least_with_flows).collect();
        let references = ReferenceCounts::of(source, points);
        Trials { request, references, sampler, all, leaf_size, whole, at_rest, fast_at_rest, flows }
    }

    /// Whether points of the samples that are close together stay together, so that nothing can cost much less than one tree.
    pub(in crate::point) fn stay_together(&self) -> bool {
        let excess_of = |sample: &Sample| Excess::of_segment(&sample.leaves(), self.request.simd);
        let references = self.request.points.len() * segments(self.request.source.keys);
        self.request.source.all_persist() && self.whole.iter().all(|sample| excess_of(sample).is_small(references))
    }

    /// Tries one tree for all points, and counts the work at rest.
    pub(in crate::point) fn try_one_tree(&mut self) {
        let linear = self.work(&self.whole, (LINEAR, None), self.searches());
        self.all.push(Trial { slices: LINEAR, fast: None, cost: linear.cost, references: linear.references });
        self.at_rest = self.work_at_rest(&self.whole);
        self.fast_at_rest = self.cost_with_fast_at_rest();
    }

    /// Whether a layer for the fast points is expected to cost less than any number of time slices for all, so that neither needs
    /// trials.
    pub(in crate::point) fn fast_first(&self) -> bool {
        let slices = self.few_slices();
        self.fast_at_rest <= self.least_of_one_layer() * MAX_COST
            && self.may_have(slices, references_with_fast(&self.whole, slices))
    }

    /// The number of time slices, more than one, that should be tried first.
    pub(in crate::point) fn few_slices(&self) -> usize {
        self.guess(1, self.all[0].cost).max(2)
    }

    /// Tries time slices for all points, and for the fast ones alone if they are few and `fast_too`.
    ///
    /// How many slices are tried first is guessed from the work with one of them and that at rest. Then finer and finer ones are
    /// tried as long as halving the slices helps and still can, and coarser ones if the guess is not confirmed.
    pub(in crate::point) fn try_slices(&mut self, fast_too: bool) {
        let (linear, guess) = (self.all[0].cost, self.few_slices());
        let finer = || iter::successors(Some(guess), |n| Some(2 * n)).take_while(|n| self.affordable(*n));
        let may_gain = finer().any(|slices| !self.flows_exceed(slices, linear * MAX_COST));
        let mut goes_on = [may_gain, fast_too && self.fast_at_rest <= linear * MAX_REFINED_COST];
        let mut before = [linear; 2];
        let mut slices = guess;
        loop {
            goes_on[0] = goes_on[0] && self.may_gain(slices, self.least() * MAX_COST);
            // Nothing makes a layer for the fast points cost less than if they rested.
            goes_on[1] = goes_on[1]
                && self.fast_at_rest <= self.least()
                && self.may_have(slices, references_with_fast(&self.whole, slices));
            if goes_on == [false; 2] || self.request.progress.cancelled() {
                break;
            }
            let samples = self.sampler.samples(slices, goes_on[1]);
            if goes_on[0] {
                let cost = self.add(&samples, slices, None);
                if slices == guess && guess > 2 {
                    // Points may meet in the middle of the shutter, which is not the middle of these slices.
                    self.at_rest = self.work_at_rest(&samples);
                }
                goes_on[0] = cost <= before[0] * MAX_REFINED_COST;
                before[0] = cost;
            }
            if goes_on[1] {
                let cost = self.add(&samples, LINEAR, Some(slices));
                // How finely they are divided is found out in the set itself.
                goes_on[1] = cost <= before[1] * MAX_REFINED_COST && self.best(true).fast.is_none();
                before[1] = cost;
            }
            slices *= 2;
        }
        // Where few points cause most of the work, it decreases faster than expected.
        let limit = MAX_COST * self.expected(1, linear)(guess);
        let mut slices = if self.tried(guess).is_some_and(|cost| cost < limit) { guess / 2 } else { 1 };
        while slices > 1 && !self.request.progress.cancelled() {
            let samples = self.sampler.samples(slices, false);
            let cost = self.add(&samples, slices, None);
            slices = if cost * MAX_COST <= self.least() { slices / 2 } else { 1 };
        }
    }

    /// The work of a search in samples if their points rested.
    fn work_at_rest(&self, samples: &[Sample]) -> f64 {
        let at_rest: Vec<Sample> = samples.iter().map(Sample::at_rest).collect();
        self.work(&at_rest, (LINEAR, None), self.searches() / BOUNDED).visited
    }

    /// The cost if the fast points had a layer of their own and rested, the least that time slices of it can achieve; infinite
    /// unless they are few.
    fn cost_with_fast_at_rest(&self) -> f64 {
        let all = || self.whole.iter().flat_map(|sample| &sample.references);
        let fast = all().filter(|m| m.fast).count();
        if fast == 0 || fast * 4 >= all().count() {
            return f64::INFINITY;
        }
        let at_rest: Vec<Sample> = self.whole.iter().map(Sample::with_fast_at_rest).collect();
        self.work(&at_rest, (LINEAR, Some(LINEAR)), self.searches() / BOUNDED).cost
    }

    /// What numbers of time slices should cost if so many cost so much. Boxes exceed those of points at rest by lengths that are
    /// proportional to the duration of a slice. A search visits the boxes at a place, so the work is proportional to their volume.
    fn expected(&self, slices: usize, cost: f64) -> impl Fn(usize) -> f64 {
        let memory = |slices| self.memory_cost(slices);
        let visited = cost - memory(slices);
        let excess = ((visited / self.at_rest).cbrt() - 1.0).max(0.0) * slices as f64;
        move |slices| self.at_rest * (1.0 + excess / slices as f64).powi(3) + memory(slices)
    }

    /// The smallest number of time slices that should be as good as any, from the one whose cost is known.
    fn guess(&self, slices: usize, cost: f64) -> usize {
        let expected = self.expected(slices, cost);
        let finer =
            || iter::successors(Some(slices), |n| Some(2 * n)).take_while(|n| *n == slices || self.affordable(*n));
        let least = finer().map(&expected).fold(f64::INFINITY, f64::min);
        finer().find(|n| expected(*n) * MAX_COST <= least).unwrap_or(slices)
    }

    /// The least cost of one layer for all points that was tried, or is expected by what was tried.
    pub(in crate::point) fn least_of_one_layer(&self) -> f64 {
        let Trial { slices, cost, .. } = self.best(false);
        self.expected(slices, cost)(self.guess(slices, cost))
    }

    /// Whether so many time slices of all points are affordable and may cost less than a limit.
    fn may_gain(&self, slices: usize, limit: f64) -> bool {
        self.at_rest + self.memory_cost(slices) < limit && self.affordable(slices)
    }

    /// Whether so many time slices should cost clearly more than a limit because flows pass through each other: their leaves hold
    /// points of all flows at a place, or of one flow each, as those of one tree do. (Of the cost of both kinds the least is
    /// expected.)
    fn flows_exceed(&self, slices: usize, limit: f64) -> bool {
        if self.flows.iter().all(|&flows| flows == 1.0) {
            return false;
        }
        let least = |(sample, &flows): (&Sample, &f64)| {
            if flows > 1.0 { flows.min(cost_of_slices(&sample.some_leaves(), slices)) } else { 1.0 }
        };
        let least = self.whole.iter().zip(&self.flows).map(least).sum::<f64>() / self.whole.len() as f64;
        self.at_rest * least * MAX_COST + self.memory_cost(slices) >= limit
    }

    /// The cost of memory of so many time slices of all points.
    pub(in crate::point) fn memory_cost(&self, slices: usize) -> f64 {
        memory_cost(self.references.with(slices) * segments(self.request.source.keys))
    }

    /// The least cost of what was tried.
    fn least(&self) -> f64 {
        self.all.iter().map(|trial| trial.cost).fold(f64::INFINITY, f64::min)
    }

    /// The cost of so many time slices of all points, if they were tried.
    fn tried(&self, slices: usize) -> Option<f64> {
        let same = |trial: &&Trial| (trial.slices, trial.fast) == (slices, None);
        self.all.iter().find(same).map(|trial| trial.cost)
    }

    /// The smallest structure among those of about the least cost; of equally small ones the first, which is the
    /// simplest. Unless `separate_fast`, only structures with one layer for all points are considered.
    pub(in crate::point) fn best(&self, separate_fast: bool) -> Trial {
        let all = || self.all.iter().filter(|trial| separate_fast || trial.fast.is_none());
        let least = all().map(|trial| trial.cost).fold(f64::INFINITY, f64::min);
        let cheap = all().filter(|trial| trial.cost * MAX_COST <= least);
        *cheap.min_by_key(|trial| trial.references).unwrap_or(&self.all[0])
    }

    /// The greater number of time slices whose measurement in the whole set is worth its tree, given the cost of one number there.
    pub(in crate::point) fn finer(&mut self, slices: usize, cost: f64) -> Option<usize> {
        let (halved, limit) = (2 * slices, cost * MAX_PREDICTED_COST);
        if !self.may_gain(halved, limit) || self.flows_exceed(halved, limit) {
            return None;
        }
        let predicted = self.tried(halved).unwrap_or_else(|| {
            let samples = self.sampler.samples(halved, false);
            self.add(&samples, halved, None)
        });
        // Samples did not see what makes this one expensive, so they may not see what makes the next one expensive either. Where
        // points meet in the middle of this slice, half of it costs less than the shortest ones are expected to.
        let (guess, expected) = (self.guess(slices, cost).max(halved), self.expected(slices, cost));
        let meet = predicted < expected(guess) * MAX_COST;
        (predicted < limit).then_some(if meet { halved } else { guess })
    }

    /// Raises the work at rest to what follows from the costs of longer and shorter time slices in the whole set, if trees are not
    /// divided by motion: the third root of the work is a line over the duration of a slice.
    pub(in crate::point) fn learn(&mut self, longer: (usize, f64), shorter: (usize, f64)) {
        let [(longer, of_longer), (shorter, of_shorter)] =
            [longer, shorter].map(|(slices, cost)| (1.0 / slices as f64, (cost - self.memory_cost(slices)).cbrt()));
        if self.flows.iter().all(|&flows| flows == 1.0) {
            let at_rest = of_shorter - shorter * (of_longer - of_shorter) / (longer - shorter);
            self.at_rest = self.at_rest.max(at_rest.powi(3));
        }
    }

    /// The cost of layers over all points with this many references in each segment, measured in their trees of one time slice.
    pub(in crate::point) fn measured(&self, layers: &[&Layer], references: usize, slice: &SegmentSlice) -> f64 {
        let memory = memory_cost(references * segments(self.request.source.keys));
        Visits::among(self.request, layers, slice).cost() + memory
    }

    /// Tries a structure and returns its cost.
    fn add(&mut self, samples: &[Sample], slices: usize, fast: Option<usize>) -> f64 {
        let Work { cost, references, .. } = self.work(samples, (slices, fast), self.searches());
        self.all.push(Trial { slices, fast, cost, references });
        cost
    }

    /// The work of searches in samples, on average. Those without active points in their time slice are skipped.
    fn work(&self, samples: &[Sample], slices: (usize, Option<usize>), searches: usize) -> Work {
        let _reported = self.request.progress.rest(TRIAL);
        let non_empty = samples.iter().filter(|sample| !sample.references.is_empty());
        let count = non_empty.clone().count().max(1);
        let searches = searches.div_ceil(count);
        let mut sum = Work { visited: 0.0, cost: 0.0, references: 0 };
        for own in non_empty.map(|sample| work(sample, searches, slices, self.request.simd)) {
            sum.visited += own.visited / count as f64;
            sum.cost += own.cost / count as f64;
            sum.references += own.references;
        }
        sum
    }

    /// The number of searches of a trial.
    fn searches(&self) -> usize {
        searches(self.request.points.len())
    }

    /// Whether a segment may have this many time slices of all points.
    pub(in crate::point) fn affordable(&self, slices: usize) -> bool {
        slices <= FINEST && self.may_have(slices, self.references.with(slices) as f64)
    }

    /// Whether a segment may have this many time slices of some points, if there are so many references to all in all.
    pub(in crate::point) fn may_have(&self, slices: usize, references: f64) -> bool {
        slices <= FINEST && references <= f64::from(self.request.max_references) * self.request.points.len() as f64
    }
}

/// What a tree of a sample that is divided by motion costs at least, relative to points at rest; 1 if it is divided by position.
fn least_with_flows(sample: &Sample) -> f64 {
    let count = sample.references.len();
    let some: Vec<Displaced> = (0..SAMPLE.min(count)).map(|i| sample.displaced(spread(i, count))).collect();
    let division = (count > 0).then(|| MotionDivision::of(&some, count, LANES * LANES)).flatten();
    division.map_or(1.0, |division| division.least_cost)
}

/// The number of references to all points if this many time slices of a segment hold the fast ones, by samples.
fn references_with_fast(samples: &[Sample], slices: usize) -> f64 {
    let own = |sample: &Sample| {
        let trees = |m: &MovingReference| if m.fast { trees_of(m.active, slices, sample.slice.keys) } else { 1 };
        sample.scale * sample.references.iter().map(trees).sum::<usize>() as f64
    };
    samples.iter().map(own).sum::<f64>() / samples.len() as f64
}

/// What searches in a structure do, on average.
struct Work {
    /// The weighted number of visited nodes and blocks.
    visited: f64,
    /// With the cost of memory.
    cost: f64,
    /// References of the sampled points.
    references: usize,
}

/// The work of searches during the time slice that a sample represents.
fn work(sample: &Sample, searches: usize, (slices, fast): (usize, Option<usize>), simd: SimdLevel) -> Work {
    let Sample { references, slice, scale, .. } = sample;
    let SegmentSlice { keys, segment, interval, .. } = slice;
    let group = |slices: usize, keep: &dyn Fn(&MovingReference) -> bool| {
        let answers = |slice: &SegmentSlice| slice.interval.contains(interval.begin());
        let slice = time_slices_of(*segment, *keys, slices).find(answers).unwrap_or(*slice);
        let inside =
            |m: &MovingReference| Some(MovingReference { interval: m.active.intersect(slice.interval)?, ..*m });
        let inside: Cow<[MovingReference]> = match (fast, slices) {
            (None, 1) => Cow::Borrowed(references),
            _ => references.iter().filter(|m| keep(m)).filter_map(inside).collect(),
        };
        let layer = Layer::Moving(vec![MovingTree::build(&inside[..], slice, &Progress::new(None))]);
        let kept = references.iter().filter(|m| keep(m));
        let count: usize = kept.map(|m| trees_of(m.active, slices, *keys)).sum();
        (layer, count)
    };
    let groups = match fast {
        Some(fast) => vec![group(slices, &|m| !m.fast), group(fast, &|m| m.fast)],
        None => vec![group(slices, &|_| true)],
    };
    let layers: Vec<&Layer> = groups.iter().map(|(layer, _)| layer).collect();
    let points: Vec<_> =
        central(references, slice, searches).into_iter().map(|m| ([m.open, m.close], *interval)).collect();
    let count: usize = groups.iter().map(|(_, count)| count).sum();
    // The tree of the whole set is higher, and searches visit one more node on each further level.
    let whole = (references.len() as f64 * scale) as usize;
    let higher = [references.len(), whole].map(|count| Shape::with_leaf(count, 1).levels);
    let higher = higher[1].saturating_sub(higher[0]) as f64;
    let visited = Visits::count(&layers, slice, &points, simd).cost() + higher;
    let memory = memory_cost((count as f64 * scale) as usize * segments(*keys));
    Work { visited, cost: visited + memory, references: count }
}

/// The references nearest to the middle of a sample in the middle of its time slice. Points that come among
/// them at other times are in the sample as well, unless they come from far away.
fn central<'a>(references: &'a [MovingReference], slice: &SegmentSlice, count: usize) -> Vec<&'a MovingReference> {
    let positions: Vec<[f32; 3]> = references.iter().map(|m| m.position(slice.middle_phase())).collect();
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    positions.iter().for_each(|&at| include(&mut lo, &mut hi, at));
    let off = |axis: usize, x: f32| {
        let size = hi[axis] - lo[axis];
        if size > 0.0 { ((x - lo[axis]) / size - 0.5).abs() } else { 0.0 }
    };
    let off = |at: &[f32; 3]| (0..3).map(|axis| off(axis, at[axis])).fold(0.0, f32::max);
    let mut all: Vec<(f32, usize)> = positions.iter().map(off).zip(0..).collect();
    if count < all.len() {
        all.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(count);
    }
    all.into_iter().map(|(_, index)| &references[index]).collect()
}
