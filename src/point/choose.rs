//! Choosing a structure by its cost: small builds, sample queries, counted work.
//!
//! What pays depends on how far points move relative to their neighbours, on how many do, and on how
//! long they live; no formula over these was as good as trying. So samples of the set are built
//! in each structure that comes into question, and a few hundred searches among them are counted in
//! nodes and blocks. Counting instead of timing makes the choice the same on every machine.

use super::build::{Plan, Source, parts_of};
use super::counted::{CountedSearch, search_counted};
use super::moving_reference::{Mover, Part, places};
use super::order::include;
use super::partition::Layer;
use super::sample::{Sample, Sampler, spread};
use super::search::KeepLanes;
use super::search::candidates::Candidates;
use super::static_tree::Shape;
use crate::geometry::{KeyTime, TimeInterval};
use crate::progress::Progress;
use crate::simd::{Item, Lanes, Mask, SimdLevel};
use crate::tuning::points::{BLOCK_PRICE, COLD, GAIN, HALF_COLD, REFERENCE_BYTES, SEARCHED, SEARCHES};
use glam::Vec3;

/// What was tried and what it costs per search, in node visits of a small tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trial {
    pub(super) plan: Plan,
    /// Plan of the fast points where they have a layer of their own.
    pub(super) fast: Option<Plan>,
    pub(super) cost: f64,
    /// References of the sampled points: what it takes in memory.
    references: usize,
}

/// Structures for some points of a set, tried in samples.
pub(super) struct Trials<'a> {
    source: &'a Source,
    points: &'a [u32],
    /// References that are allowed for each point.
    most: f32,
    simd: SimdLevel,
    sampler: Sampler<'a>,
    pub(super) all: Vec<Trial>,
}

/// Most parts of a segment.
const FINEST: usize = 32;

impl<'a> Trials<'a> {
    /// Tries finer and finer parts for all of at least one point, and for the fast ones if they are few, until twice finer does not
    /// help any more.
    pub(super) fn new(source: &'a Source, points: &'a [u32], most: f32, simd: SimdLevel) -> Trials<'a> {
        let mut trials = Trials { source, points, most, simd, sampler: Sampler::new(source, points), all: Vec::new() };
        let simple = Plan::Boxes(1);
        let samples = trials.sampler.samples(1, true);
        let fast: usize = samples.iter().map(|s| s.movers.iter().filter(|m| m.fast).count()).sum();
        let few = fast > 0 && fast * 4 < samples.iter().map(|s| s.movers.len()).sum::<usize>();
        let mut before = [trials.add(&samples, simple, None); 2];
        let mut goes_on = [true, few];
        let mut parts = 2;
        while goes_on != [false; 2] && trials.affordable(parts) {
            let (samples, plan) = (trials.sampler.samples(parts, few), Plan::Boxes(parts));
            for (i, (slow, fast)) in [(plan, None), (simple, Some(plan))].into_iter().enumerate() {
                if goes_on[i] {
                    let cost = trials.add(&samples, slow, fast);
                    goes_on[i] = cost <= before[i] * 0.98;
                    before[i] = cost;
                }
            }
            parts *= 2;
        }
        trials
    }

    /// Of those that cost about the least, the smallest; of equally small ones the first, the simplest. If fast points are not to
    /// have a layer of their own, of those with one for all.
    pub(super) fn best(&self, apart: bool) -> Trial {
        let all = || self.all.iter().filter(|trial| apart || trial.fast.is_none());
        let least = all().map(|trial| trial.cost).fold(f64::INFINITY, f64::min);
        let cheap = all().filter(|trial| trial.cost * GAIN <= least);
        *cheap.min_by_key(|trial| trial.references).unwrap_or(&self.all[0])
    }

    /// What parts half as long cost, if they may be made.
    pub(super) fn finer(&mut self, plan: Plan) -> Option<f64> {
        let plan = Plan::Boxes(2 * plan.parts());
        if let Some(trial) = self.all.iter().find(|trial| (trial.plan, trial.fast) == (plan, None)) {
            return Some(trial.cost);
        }
        self.affordable(plan.parts()).then(|| self.add(&self.sampler.samples(plan.parts(), false), plan, None))
    }

    /// What layers over all points cost, of which there is the tree for a part of the shutter, and which have so many references in all.
    pub(super) fn measured(&self, layers: &[&Layer], references: usize, part: &Part) -> f64 {
        let later = (part.segment + 1).min(part.keys - 1);
        let ends = |i: usize| {
            let point = self.points[spread(i, self.points.len())] as usize;
            [part.segment, later].map(|key| self.source.at(point, key))
        };
        let points: Vec<_> = (0..self.searches()).map(ends).collect();
        priced(visited(layers, part, &points, self.simd), references)
    }

    /// Tries a structure; what it costs. Where nobody lives during a sample's part of the shutter, it says nothing.
    fn add(&mut self, samples: &[Sample], plan: Plan, fast: Option<Plan>) -> f64 {
        let non_empty = samples.iter().filter(|sample| !sample.movers.is_empty());
        let count = non_empty.clone().count().max(1);
        let searches = self.searches().div_ceil(count);
        let all = non_empty.map(|s| work(s, searches, (plan, fast), self.simd));
        let (cost, references) = all.fold((0.0, 0), |sum, (cost, n)| (sum.0 + cost, sum.1 + n));
        let cost = cost / count as f64;
        self.all.push(Trial { plan, fast, cost, references });
        cost
    }

    /// Searches by which a structure is tried.
    fn searches(&self) -> usize {
        let [least, most] = SEARCHES;
        (self.points.len() / SEARCHED).clamp(least, most)
    }

    /// Whether there may be so many parts in a segment.
    pub(super) fn affordable(&self, parts: usize) -> bool {
        let all = || references_of(self.source, self.points, parts) as f64;
        let within = || all() <= f64::from(self.most) * self.points.len() as f64;
        parts <= FINEST && (parts as f32 <= self.most || within())
    }
}

/// References of points in so many parts.
pub(super) fn references_of(source: &Source, points: &[u32], parts: usize) -> usize {
    points.iter().map(|&i| references(source.alive(i as usize), parts, source.keys)).sum()
}

/// In how many trees of a segment a point counts.
fn references(life: TimeInterval, parts: usize, keys: usize) -> usize {
    if keys > 2 {
        return parts;
    }
    let at = |t: f32| ((t * parts as f32) as usize).min(parts - 1);
    at(life.end()) - at(life.begin()) + 1
}

/// What a search costs that visits so many nodes, blocks priced as such, where there are so many references.
fn priced(visited: f64, references: usize) -> f64 {
    let bytes = references as f64 * REFERENCE_BYTES;
    COLD * bytes / (bytes + HALF_COLD) + visited
}

/// Counted and priced work of searches during the part of the shutter that a sample stands for, and the references it takes.
fn work(sample: &Sample, searches: usize, (plan, fast): (Plan, Option<Plan>), simd: SimdLevel) -> (f64, usize) {
    let Sample { movers, part, scale } = sample;
    let Part { keys, segment, interval, .. } = part;
    let group = |plan: Plan, keep: &dyn Fn(&Mover) -> bool| {
        let count = plan.parts();
        let answers = |part: &Part| part.interval.contains(interval.begin());
        let part = parts_of(*segment, *keys, count).find(answers).unwrap_or(*part);
        let inside = |m: &Mover| Some(Mover { alive: m.life.intersect(part.interval)?, ..*m });
        let layer = plan.layer(
            &[part],
            |_| movers.iter().filter(|m| keep(m)).filter_map(inside).collect(),
            &Progress::new(None),
        );
        let references: usize = movers.iter().filter(|m| keep(m)).map(|m| references(m.life, count, *keys)).sum();
        (layer, references)
    };
    let groups = match fast {
        Some(fast) => vec![group(plan, &|m| !m.fast), group(fast, &|m| m.fast)],
        None => vec![group(plan, &|_| true)],
    };
    let layers: Vec<&Layer> = groups.iter().map(|(layer, _)| layer).collect();
    let points: Vec<_> = central(movers, part, searches).into_iter().map(|m| [m.open, m.close]).collect();
    let references: usize = groups.iter().map(|(_, references)| references).sum();
    let all = (references as f64 * scale) as usize;
    // The whole set takes a higher tree, of which searches visit a node more on each level.
    let higher = [movers.len(), (movers.len() as f64 * scale) as usize].map(|count| Shape::with_leaf(count, 1).levels);
    let higher = higher[1].saturating_sub(higher[0]) as f64;
    (priced(visited(&layers, part, &points, simd) + higher, all), references)
}

/// Nodes, and blocks priced as such, that a search for eight neighbours visits in layers; of searches from points between their keys, at
/// times in a part of the shutter.
fn visited(layers: &[&Layer], part: &Part, points: &[[[f32; 3]; 2]], simd: SimdLevel) -> f64 {
    let mut candidates = Candidates::default();
    let mut total = 0.0;
    for (i, ends) in points.iter().enumerate() {
        // Times in an order that has nothing to do with the places.
        let fraction = ((i * 89) % points.len()) as f32 / points.len() as f32;
        let time = part.interval.begin() + part.interval.duration() * fraction;
        let layers: Vec<_> = layers.iter().map(|layer| (core::slice::from_ref(*layer), time)).collect();
        let [open, close] = ends.map(Vec3::from_array);
        let point = KeyTime::new(time, part.keys).position(open, close);
        let all = |_: &Lanes<u32>, mask: Mask| mask;
        let search =
            CountedSearch { layers: &layers, point, k: 8, bound: f32::MAX, shrink: 1.0, keep: KeepLanes(&all) };
        let work = search_counted(simd, &search, &mut candidates);
        total += work.nodes as f64 + BLOCK_PRICE * work.blocks as f64;
    }
    total / points.len() as f64
}

/// The movers nearest to the middle of a sample in the middle of its part of the shutter. What comes among them at other times is in the
/// sample, too, unless it comes from far.
fn central<'a>(movers: &'a [Mover], part: &Part, count: usize) -> Vec<&'a Mover> {
    let places = places(movers, part.middle_phase());
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    places.iter().for_each(|item| include(&mut lo, &mut hi, item.at));
    let off = |axis: usize, x: f32| {
        let size = hi[axis] - lo[axis];
        if size > 0.0 { ((x - lo[axis]) / size - 0.5).abs() } else { 0.0 }
    };
    let off = |item: &Item| (0..3).map(|axis| off(axis, item.at[axis])).fold(0.0, f32::max);
    let mut all: Vec<(f32, u32)> = places.iter().map(|item| (off(item), item.index)).collect();
    if count < all.len() {
        all.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(count);
    }
    all.into_iter().map(|(_, index)| &movers[index as usize]).collect()
}
