//! Choosing a structure by its cost: small builds, sample queries, counted work.
//!
//! What pays depends on how far points move relative to their neighbours, on how many do, and on how
//! long they live; no formula over these was as good as trying. So compact parts of the set are built
//! in each structure that comes into question, and a few hundred searches among them are counted in
//! nodes and blocks. Counting instead of timing makes the choice the same on every machine.

use super::build::{Plan, parts};
use super::counted::{CountedSearch, search_counted};
use super::fast::mark_fast;
use super::moving_reference::{Mover, places};
use super::order::order_runs;
use super::search::KeepLanes;
use super::search::candidates::Candidates;
use crate::geometry::{KeyTime, TimeInterval};
use crate::progress::Progress;
use crate::simd::{Lanes, Mask, SimdLevel};
use crate::tuning::points::{
    BLOCK_PRICE, COLD, GAIN, HALF_COLD, REFERENCE_BYTES, SAMPLE, SAMPLES, SEARCH_PRICE, SEARCHES,
};
use glam::Vec3;

/// What was tried and what it costs per search, in node visits of a small tree.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Trial {
    pub(super) plan: Plan,
    /// Plan of the fast points where they have a layer of their own.
    pub(super) fast: Option<Plan>,
    pub(super) cost: f64,
    /// References of the sampled points: what it takes in memory.
    references: usize,
}

/// Movers of a segment that stand for the whole set.
struct Sample {
    movers: Vec<Mover>,
    keys: usize,
    segment: usize,
    /// Points of the set for each of the sample.
    scale: f64,
}

/// The cheapest structure for movers, which are all those of one segment, and all that was tried.
pub(super) fn choose(movers: &[Mover], keys: usize, segment: usize, most: f32, simd: SimdLevel) -> (Trial, Vec<Trial>) {
    let simple = Plan::Boxes(1);
    if movers.is_empty() {
        let trial = Trial { plan: simple, fast: None, cost: 0.0, references: 0 };
        return (trial.clone(), vec![trial]);
    }
    let samples = samples(movers, keys, segment);
    let fast: usize = samples.iter().map(|s| s.movers.iter().filter(|m| m.fast).count()).sum();
    let few = fast > 0 && fast * 4 < samples.iter().map(|s| s.movers.len()).sum::<usize>();
    let trial = |plan: Plan, fast: Option<Plan>| {
        let all = samples.iter().map(|s| work(s, plan, fast, simd));
        let (cost, references) = all.fold((0.0, 0), |sum, (cost, n)| (sum.0 + cost, sum.1 + n));
        Trial { plan, fast, cost: cost / samples.len() as f64, references }
    };
    let mut trials = vec![trial(simple, None)];
    let finer = [2, 4, 8, 16, 32].map(Plan::Boxes);
    let affordable = |plan: &Plan| {
        let total = || -> usize { movers.iter().map(|m| references(m.life, plan.parts(), keys)).sum() };
        plan.parts() as f32 <= most || total() as f64 <= f64::from(most) * movers.len() as f64
    };
    // Finer parts until twice finer does not help any more.
    let mut refine = |fixed: Option<Plan>| {
        let mut before = f64::INFINITY;
        for plan in finer.into_iter().filter(affordable) {
            let (slow, fast) = fixed.map_or((plan, None), |slow| (slow, Some(plan)));
            let next = trial(slow, fast);
            let cost = next.cost;
            trials.push(next);
            if cost > before * 0.98 {
                break;
            }
            before = cost;
        }
    };
    refine(None);
    if few {
        refine(Some(simple));
    }
    // Of those that cost about the least, the smallest; of equally small ones the first, the simplest.
    let least = trials.iter().map(|t| t.cost).fold(f64::INFINITY, f64::min);
    let cheap = trials.iter().filter(|t| t.cost * GAIN <= least);
    let best = cheap.min_by_key(|t| t.references).unwrap_or(&trials[0]).clone();
    (best, trials)
}

/// In how many trees of a segment a point counts.
fn references(life: TimeInterval, parts: usize, keys: usize) -> usize {
    if keys > 2 {
        return parts;
    }
    let at = |t: f32| ((t * parts as f32) as usize).min(parts - 1);
    at(life.end()) - at(life.begin()) + 1
}

/// Compact parts of the set, far from each other, fast movers marked.
fn samples(movers: &[Mover], keys: usize, segment: usize) -> Vec<Sample> {
    let part = parts(keys, 1)[segment];
    let sample = |mut chosen: Vec<Mover>| {
        mark_fast(&mut chosen, &part);
        let scale = movers.len() as f64 / chosen.len().max(1) as f64;
        Sample { movers: chosen, keys, segment, scale }
    };
    if movers.len() <= 2 * SAMPLE {
        return vec![sample(movers.to_vec())];
    }
    let mut items = places(movers, &part);
    let runs = items.len() / SAMPLE;
    let wanted: Vec<usize> = (0..SAMPLES).map(|i| (2 * i + 1) * runs / (2 * SAMPLES)).collect();
    order_runs(&mut items, SAMPLE, &wanted);
    let run = |run: usize| items[run * SAMPLE..(run + 1) * SAMPLE].iter();
    wanted.into_iter().map(|i| sample(run(i).map(|item| movers[item.index as usize]).collect())).collect()
}

/// Counted and priced work of searches for eight neighbours, each layer in the middle part of its plan,
/// and the references it takes.
fn work(sample: &Sample, plan: Plan, fast: Option<Plan>, simd: SimdLevel) -> (f64, usize) {
    let Sample { movers, keys, segment, scale } = sample;
    let group = |plan: Plan, keep: &dyn Fn(&Mover) -> bool| {
        let count = plan.parts();
        let part = parts(*keys, count)[segment * count + count / 2];
        let inside = |m: &Mover| Some(Mover { alive: m.life.intersect(part.interval)?, ..*m });
        let layer = plan.layer(
            &[part],
            |_| movers.iter().filter(|m| keep(m)).filter_map(inside).collect(),
            &Progress::new(None),
        );
        let references: usize = movers.iter().filter(|m| keep(m)).map(|m| references(m.life, count, *keys)).sum();
        ([layer], part.interval, references)
    };
    let groups = match fast {
        Some(fast) => vec![group(plan, &|m| !m.fast), group(fast, &|m| m.fast)],
        None => vec![group(plan, &|_| true)],
    };
    let mut candidates = Candidates::default();
    let mut total = 0.0;
    for i in 0..SEARCHES {
        let m = &movers[i * movers.len() / SEARCHES];
        // Times in an order that has nothing to do with the places, each in the part that was built.
        let fraction = ((i * 89) % SEARCHES) as f32 / SEARCHES as f32;
        let time = |interval: &TimeInterval| interval.begin() + interval.duration() * fraction;
        let at = KeyTime::new(time(&groups[0].1), *keys);
        let point = at.position(Vec3::from_array(m.open), Vec3::from_array(m.close));
        let layers: Vec<_> = groups.iter().map(|g| (&g.0[..], time(&g.1))).collect();
        let all = |_: &Lanes<u32>, mask: Mask| mask;
        let search =
            CountedSearch { layers: &layers, point, k: 8, bound: f32::MAX, shrink: 1.0, keep: KeepLanes(&all) };
        let work = search_counted(simd, &search, &mut candidates);
        total += work.nodes as f64 + BLOCK_PRICE * work.blocks as f64;
    }
    let references: usize = groups.iter().map(|g| g.2).sum();
    let bytes = references as f64 * scale * REFERENCE_BYTES;
    (SEARCH_PRICE + COLD * bytes / (bytes + HALF_COLD) + total / SEARCHES as f64, references)
}
