//! What searches in trees cost: the nodes and blocks that they visit, and memory.
//!
//! Counting instead of timing makes the choice of a structure the same on every machine.

use super::source::Source;
use crate::geometry::{KeyTime, TimeInterval};
use crate::point::leaf_order::moving_reference::TimeSlice;
use crate::point::leaf_order::spread::spread;
use crate::point::search::KeepLanes;
use crate::point::search::candidates::Candidates;
use crate::point::search::counted_search::{CountedSearch, search_counted};
use crate::point::search::layers::Layer;
use crate::simd::{Lanes, Mask, SimdLevel};
use crate::tuning::points::{BLOCK_COST, HALF_UNCACHED_BYTES, REFERENCE_BYTES, SEARCHED, SEARCHES, UNCACHED_COST};
use glam::Vec3;
use std::borrow::Cow;

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
        slice: &TimeSlice,
        points: &[([[f32; 3]; 2], TimeInterval)],
        simd: SimdLevel,
    ) -> Visits {
        let mut candidates = Candidates::default();
        let (mut nodes, mut blocks) = (0, 0);
        for (i, (ends, interval)) in points.iter().enumerate() {
            // Times in an order that is independent of the positions.
            let fraction = ((i * 89) % points.len()) as f32 / points.len() as f32;
            let time = interval.begin() + interval.duration() * fraction;
            let layers: Vec<_> = layers.iter().map(|layer| (core::slice::from_ref(*layer), time)).collect();
            let [open, close] = ends.map(Vec3::from_array);
            let point = KeyTime::new(time, slice.keys).position(open, close);
            let all = |_: &Lanes<u32>, mask: Mask| mask;
            let search =
                CountedSearch { layers: &layers, point, k: 8, bound: f32::MAX, shrink: 1.0, keep: KeepLanes(&all) };
            let work = search_counted(simd, &search, &mut candidates);
            nodes += work.nodes;
            blocks += work.blocks;
        }
        let count = points.len() as f64;
        Visits { nodes: nodes as f64 / count, blocks: blocks as f64 / count }
    }

    /// Those of searches at some of the points of a set that exist in a time slice, while they do.
    pub(in crate::point) fn among(
        source: &Source,
        points: &[u32],
        layers: &[&Layer],
        slice: &TimeSlice,
        simd: SimdLevel,
    ) -> Visits {
        let later = (slice.segment + 1).min(slice.keys - 1);
        let interval = |point: u32| source.active(point as usize).intersect(slice.interval);
        let mut existing = Cow::Borrowed(points);
        if !source.all_persist() && points.iter().any(|&point| interval(point).is_some()) {
            existing.to_mut().retain(|&point| interval(point).is_some());
        }
        let place = |i: usize| {
            let point = existing[spread(i, existing.len())];
            let ends = [slice.segment, later].map(|key| source.at(point as usize, key));
            (ends, interval(point).unwrap_or(slice.interval))
        };
        let points: Vec<_> = (0..searches(points.len())).map(place).collect();
        Visits::count(layers, slice, &points, simd)
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

/// The cost of memory to a search, from the number of references.
pub(in crate::point) fn memory_cost(references: usize) -> f64 {
    let bytes = references as f64 * REFERENCE_BYTES;
    UNCACHED_COST * bytes / (bytes + HALF_UNCACHED_BYTES)
}

/// The number of references to points, with this many time slices for each segment.
pub(in crate::point) fn references_of(source: &Source, points: &[u32], slices: usize) -> usize {
    if source.all_persist() {
        return points.len() * slices;
    }
    points.iter().map(|&i| trees_of(source.active(i as usize), slices, source.keys)).sum()
}

/// The number of trees of a segment in which a point is active.
pub(in crate::point) fn trees_of(active: TimeInterval, slices: usize, keys: usize) -> usize {
    if keys > 2 {
        return slices;
    }
    let at = |t: f32| ((t * slices as f32) as usize).min(slices - 1);
    at(active.end()) - at(active.begin()) + 1
}
