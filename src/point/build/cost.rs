//! What searches in trees cost: the nodes and blocks that they visit, and memory.
//!
//! Counting instead of timing makes the choice of a structure the same on every machine.

use super::layer_request::LayerRequest;
use super::source::Source;
use crate::geometry::{KeyTime, TimeInterval};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::leaf_order::spread::spread;
use crate::point::search::KeepLanes;
use crate::point::search::candidates::Candidates;
use crate::point::search::counted_search::{CountedSearch, search_counted};
use crate::point::search::layers::Layer;
use crate::simd::SimdLevel;
use crate::tuning::points::{
    BLOCK_COST, HALF_UNCACHED_BYTES, MOST_AT_REST, REFERENCE_BYTES, SEARCHED, SEARCHES, UNCACHED_COST,
};
use core::iter;
use glam::Vec3;

/// The largest number of time slices of a segment that is tried.
pub(in crate::point) const FINEST: usize = 32;

/// Searches are counted in so many parts, evenly spread over all, until they have visited enough.
const PARTS: usize = 4;

/// What a search for eight neighbours visits, on average.
#[derive(Clone, Copy)]
pub(in crate::point) struct Visits {
    pub(in crate::point) nodes: f64,
    pub(in crate::point) blocks: f64,
}

impl Visits {
    /// Counts the visits of searches in layers, at points between their keys of a time slice, each at a time of its interval.
    pub(in crate::point) fn count(
        layers: &[&Layer],
        slice: &SegmentSlice,
        points: &[([[f32; 3]; 2], TimeInterval)],
        simd: SimdLevel,
    ) -> Visits {
        let mut candidates = Candidates::default();
        let (mut visited, mut done) = (Visits { nodes: 0.0, blocks: 0.0 }, 0);
        let (layers, count) =
            (layers.iter().map(|&layer| core::slice::from_ref(layer)).collect::<Vec<_>>(), points.len());
        for part in 0..PARTS {
            for (i, (ends, interval)) in points.iter().enumerate().skip(part).step_by(PARTS) {
                // Times in an order that is independent of the positions.
                let fraction = ((i * 89) % count) as f32 / count as f32;
                let time = interval.begin() + interval.duration() * fraction;
                let [open, close] = ends.map(Vec3::from_array);
                let point = KeyTime::new(time, slice.keys).position(open, close);
                let (layers, keep) = (&layers[..], KeepLanes::ALL);
                let search = CountedSearch { layers, point, time, k: 8, bound: f32::MAX, shrink: 1.0, keep };
                let work = search_counted(simd, &search, &mut candidates);
                visited.nodes += work.nodes as f64;
                visited.blocks += work.blocks as f64;
                done += 1;
            }
            // Fewer searches show that a structure is bad, and take long in it.
            if visited.cost() >= MOST_AT_REST * count as f64 {
                break;
            }
        }
        let done = done as f64;
        Visits { nodes: visited.nodes / done, blocks: visited.blocks / done }
    }

    /// Those of searches at some of the points of a request that exist in a time slice, while they do.
    pub(in crate::point) fn among(request: LayerRequest<'_>, layers: &[&Layer], slice: &SegmentSlice) -> Visits {
        let LayerRequest { source, points, simd, .. } = request;
        let count = searches(points.len());
        let place =
            |point: u32, interval: TimeInterval| (slice.ends().map(|key| source.at(point as usize, key)), interval);
        let all = || (0..points.len()).map(|i| points[spread(i, points.len())]);
        let existing = |point: u32| Some(place(point, source.active(point as usize).intersect(slice.interval)?));
        let mut places: Vec<_> = all().filter_map(existing).take(count).collect();
        if places.is_empty() {
            places.extend(all().take(count).map(|point| place(point, slice.interval)));
        }
        Visits::count(layers, slice, &places, simd)
    }

    /// Their cost, in nodes.
    pub(in crate::point) fn cost(self) -> f64 {
        self.nodes + BLOCK_COST * self.blocks
    }
}

/// The number of searches that measure a structure for so many points.
pub(in crate::point) fn searches(points: usize) -> usize {
    let [least, most] = SEARCHES;
    (points / SEARCHED).clamp(least, most)
}

/// The cost of memory to a search, from the number of references in the trees of all segments between keys.
pub(in crate::point) fn memory_cost(references: usize) -> f64 {
    let bytes = references as f64 * REFERENCE_BYTES;
    UNCACHED_COST * bytes / (bytes + HALF_UNCACHED_BYTES)
}

/// The numbers of references to some points, with any number of time slices for each segment.
pub(in crate::point) struct ReferenceCounts {
    points: usize,
    /// Those with 1, 2, 4 time slices and so on, up to [`FINEST`]; empty if each point is in all trees.
    counts: Vec<usize>,
    /// Times with about a quarter of the references before the first one and behind the second one.
    pub(in crate::point) quarters: [f32; 2],
}

impl ReferenceCounts {
    pub(in crate::point) fn of(source: &Source, points: &[u32]) -> ReferenceCounts {
        let (mut counts, mut quarters) = (Vec::new(), [0.25, 0.75]);
        if !source.all_persist() && source.keys <= 2 {
            let mut all = [0; FINEST.ilog2() as usize + 1];
            let (mut first, mut behind) = ([0; FINEST], [0; FINEST + 1]);
            for &point in points {
                let [begin, end] = slices_at_ends(source.active(point as usize), FINEST);
                first[begin] += 1;
                behind[end + 1] += 1;
                for (count, halvings) in all.iter_mut().zip((0..=FINEST.ilog2()).rev()) {
                    *count += (end >> halvings) - (begin >> halvings) + 1;
                }
            }
            counts.extend(all);
            let (mut exist, mut before) = (0, 0);
            let references_before = first.iter().zip(behind).map(|(first, behind)| {
                exist = exist + first - behind;
                before += exist;
                before
            });
            let references_before: Vec<usize> = references_before.collect();
            quarters = [1, 3].map(|quarters| {
                let part = quarters * all[FINEST.ilog2() as usize];
                let slice = references_before.partition_point(|&before| 4 * before < part);
                (slice as f32 + 0.5) / FINEST as f32
            });
        }
        ReferenceCounts { points: points.len(), counts, quarters }
    }

    /// That with this many time slices, a power of two.
    pub(in crate::point) fn with(&self, slices: usize) -> usize {
        self.counts.get(slices.ilog2() as usize).copied().unwrap_or(self.points * slices)
    }

    /// The numbers of time slices that take at most so many references per point: powers of two, up to [`FINEST`].
    pub(in crate::point) fn affordable(&self, max_references: f32) -> Vec<usize> {
        let most = f64::from(max_references) * self.points as f64;
        let affordable = |slices: &usize| *slices <= FINEST && self.with(*slices) as f64 <= most;
        iter::successors(Some(1), |slices| Some(2 * slices)).take_while(affordable).collect()
    }
}

/// The numbers of the time slices of the only segment that hold the first and the last time of an interval.
fn slices_at_ends(active: TimeInterval, slices: usize) -> [usize; 2] {
    [active.begin(), active.end_bound().next_down()].map(|t| ((t * slices as f32) as usize).min(slices - 1))
}

/// The number of trees of a segment in which a point is active.
pub(in crate::point) fn trees_of(active: TimeInterval, slices: usize, keys: usize) -> usize {
    if keys > 2 {
        return slices;
    }
    let [begin, end] = slices_at_ends(active, slices);
    end - begin + 1
}
