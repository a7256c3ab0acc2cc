//! Choosing a structure by its cost: small builds, sample queries, counted work.
//!
//! What pays depends on how far points move relative to their neighbours, on how many do, and on how
//! long they live; no formula over these was as good as trying. So compact parts of the set are built
//! in each structure that comes into question, and a few hundred searches among them are counted in
//! nodes and blocks. Counting instead of timing makes the choice the same on every machine.

use super::build::{Cut, Plan, part_tree, parts};
use super::hull::Span;
use super::layer::{Layer, walk_all};
use super::mover::{Mover, Part};
use super::order::{Item, order};
use super::search::k_nearest::{Candidates, KNearest};
use super::search::{KeepAll, NeighborWork};
use crate::SimdLevel;
use crate::motion::{KeyTime, TimeInterval};
use crate::simd::{Kernel, LANES, Simd, dispatch};
use glam::Vec3;

/// A mover is fast when it moves farther, relative to its neighbours, than this many times the size of
/// the leaf they would share.
const FAST: f64 = 2.0;

/// Marks the movers that move far relative to their neighbours, to be cut at planes.
pub(super) fn mark_fast(movers: &mut [Mover], part: &Part) {
    let mut items = places(movers, part);
    order(&mut items, LANES);
    for leaf in items.chunks(LANES) {
        let mut way = [[0.0; LANES]; 3];
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (lane, item) in leaf.iter().enumerate() {
            let m = &movers[item.index as usize];
            for axis in 0..3 {
                way[axis][lane] = f64::from(m.close[axis]) - f64::from(m.open[axis]);
                lo[axis] = lo[axis].min(item.at[axis].into());
                hi[axis] = hi[axis].max(item.at[axis].into());
            }
        }
        let size = (hi[0] - lo[0]).max(hi[1] - lo[1]).max(hi[2] - lo[2]);
        let usual = way.map(|mut row| {
            let row = &mut row[..leaf.len()];
            row.sort_unstable_by(f64::total_cmp);
            row[row.len() / 2]
        });
        for (lane, item) in leaf.iter().enumerate() {
            let m = &mut movers[item.index as usize];
            let Span { range, .. } = m.span(part);
            let far = (0..3).map(|a| (way[a][lane] - usual[a]).abs()).fold(0.0, f64::max) * (range[1] - range[0]);
            m.cut = far > FAST * size;
        }
    }
}

/// Where movers are at mid-part.
fn places(movers: &[Mover], part: &Part) -> Vec<Item> {
    let phase = f64::from(part.phase(part.middle()));
    let place = |(index, m): (usize, &Mover)| Item {
        at: core::array::from_fn(|axis| m.at(axis, phase) as f32),
        index: index as u32,
    };
    movers.iter().enumerate().map(place).collect()
}

/// Points of each sample, samples, and searches in each of them.
const SAMPLE: usize = 1 << 15;
const SAMPLES: usize = 2;
const SEARCHES: usize = 192;

/// Price of a block in nodes: a node has twelve rows and leads on, a block has six and does not.
const BLOCK_PRICE: f64 = 0.7;

/// A structure must be this much cheaper than a simpler one to be taken.
const GAIN: f64 = 0.93;

/// What was tried and what it costs per search, in node visits.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Trial {
    pub(super) plan: Plan,
    pub(super) cost: f64,
}

/// The cheapest plan for movers, which are all those of the middle segment, and what was tried.
pub(super) fn choose(movers: &[Mover], keys: usize, max_references: f32, simd: SimdLevel) -> (Plan, Vec<Trial>) {
    let simple = Plan { parts: 1, life_levels: 0, cut: Cut::Nothing, references: max_references };
    let segment = (keys.max(2) - 1) / 2;
    let samples = samples(movers, keys, segment);
    let lives = movers.iter().any(|m| m.alive.begin() > 0.0 || m.alive.end() < 1.0) && keys <= 2;
    let mut plans = vec![simple];
    if lives {
        plans.extend([2, 3].map(|life_levels| Plan { life_levels, ..simple }));
    }
    let mut marked: Vec<Mover> = samples.concat();
    if let Some(part) = parts(keys, 1).get(segment) {
        mark_fast(&mut marked, part);
    }
    let fast = marked.iter().filter(|m| m.cut).count();
    if fast > 0 && fast * 4 < marked.len() {
        plans.push(Plan { cut: Cut::Fast, references: max_references.min(1.5), ..simple });
    }
    plans.extend([2, 4, 8, 16, 32].map(|parts| Plan { parts, ..simple }));
    let mut trials: Vec<Trial> = Vec::new();
    let mut best = 0;
    for plan in plans {
        let total: usize = movers.iter().map(|m| references(m.alive, &plan, keys)).sum();
        if plan.parts > 1 && total as f64 > f64::from(max_references) * movers.len() as f64 {
            break;
        }
        let cost = samples.iter().map(|s| work(s, keys, segment, &plan, simd)).sum::<f64>() / SAMPLES as f64;
        trials.push(Trial { plan, cost });
        if cost < trials[best].cost * GAIN {
            best = trials.len() - 1;
        } else if plan.parts > 2 * trials[best].plan.parts {
            // Twice finer has not helped.
            break;
        }
    }
    (trials[best].plan, trials)
}

/// In how many trees of a segment a mover counts.
fn references(alive: TimeInterval, plan: &Plan, keys: usize) -> usize {
    if keys > 2 {
        return plan.parts;
    }
    let at = |t: f32| ((t * plan.parts as f32) as usize).min(plan.parts - 1);
    at(alive.end()) - at(alive.begin()) + 1
}

/// Compact parts of the set, far from each other.
fn samples(movers: &[Mover], keys: usize, segment: usize) -> Vec<Vec<Mover>> {
    let Some(part) = parts(keys, 1).get(segment).copied() else { return vec![movers.to_vec()] };
    if movers.len() <= 2 * SAMPLE {
        return vec![movers.to_vec()];
    }
    let mut items = places(movers, &part);
    order(&mut items, SAMPLE);
    let runs = items.len() / SAMPLE;
    (0..SAMPLES)
        .map(|i| {
            let run = (2 * i + 1) * runs / (2 * SAMPLES);
            items[run * SAMPLE..(run + 1) * SAMPLE].iter().map(|item| movers[item.index as usize]).collect()
        })
        .collect()
}

/// Counted work of searches for eight neighbours in the middle part that a plan makes.
fn work(sample: &[Mover], keys: usize, segment: usize, plan: &Plan, simd: SimdLevel) -> f64 {
    let parts = parts(keys, plan.parts);
    let Some(part) = parts.get(segment * plan.parts + plan.parts / 2).copied() else { return f64::INFINITY };
    let inside: Vec<Mover> =
        sample.iter().filter_map(|m| Some(Mover { alive: m.alive.intersect(part.interval)?, ..*m })).collect();
    if inside.is_empty() {
        return 0.0;
    }
    let layers = [Layer::Moving(vec![part_tree(inside, part, plan)])];
    let mut candidates = Candidates::default();
    let mut total = NeighborWork::default();
    for i in 0..SEARCHES {
        // Times in an order that has nothing to do with the places.
        let fraction = ((i * 89) % SEARCHES) as f32 / SEARCHES as f32;
        let time = part.interval.begin() + part.interval.duration() * fraction;
        let m = &sample[i * sample.len() / SEARCHES];
        let at = KeyTime::new(time, keys);
        let point = at.position(Vec3::from_array(m.open), Vec3::from_array(m.close));
        dispatch(simd, Count { layers: &layers, point, time, candidates: &mut candidates, total: &mut total });
    }
    (total.nodes as f64 + BLOCK_PRICE * total.blocks as f64) / SEARCHES as f64
}

struct Count<'a> {
    layers: &'a [Layer],
    point: Vec3,
    time: f32,
    candidates: &'a mut Candidates,
    total: &'a mut NeighborWork,
}

impl Kernel for Count<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let mut search = KNearest::within(8, f32::MAX, 1.0, self.candidates, &KeepAll, self.total);
        walk_all(s, self.layers, (self.point, self.time), &mut search);
    }
}
