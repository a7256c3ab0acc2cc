//! The time slices of the shutter, and the trees and layers of moving points over them.

use super::slice_points::{SlicePoints, points_of_slice, points_of_slices, references};
use super::source::Source;
use crate::geometry::{KeyTime, TimeInterval};
use crate::point::layout::double_tree::DoubleTree;
use crate::point::layout::kd_points::KdPoints;
use crate::point::layout::moving_tree::{MovingTree, WithoutFast};
use crate::point::leaf_order::segment_slice::{SegmentSlice, exact_phase, segments};
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::PointBlock;
use std::borrow::Cow;

/// The time slice between the keys in the middle. It stands for all segments where one has to.
pub(in crate::point) fn middle_slice(keys: usize) -> SegmentSlice {
    time_slices(keys, 1)[segments(keys) / 2]
}

/// The time slices of the shutter: `per_segment` for each segment between keys.
pub(in crate::point) fn time_slices(keys: usize, per_segment: usize) -> Vec<SegmentSlice> {
    (0..segments(keys)).flat_map(|segment| time_slices_of(segment, keys, per_segment)).collect()
}

/// The same for points in f64, whose positions at a time are exact: no slice contains a time before its segment or after it.
pub(in crate::point) fn double_time_slices(keys: usize, per_segment: usize) -> Vec<SegmentSlice> {
    let of = |segment| slices_between(segment, keys, per_segment, KeyTime::not_before);
    (0..segments(keys)).flat_map(of).collect()
}

/// The time slices of one segment. It begins and ends where queries that multiply in f32 find it to.
pub(in crate::point) fn time_slices_of(
    segment: usize,
    keys: usize,
    per_segment: usize,
) -> impl Iterator<Item = SegmentSlice> {
    slices_between(segment, keys, per_segment, KeyTime::first_time)
}

/// The time slices of one segment; `first_time` gives the first time of a segment.
fn slices_between(
    segment: usize,
    keys: usize,
    per_segment: usize,
    first_time: fn(usize, usize) -> f32,
) -> impl Iterator<Item = SegmentSlice> {
    let (begin, end) = (segment * per_segment, (segment + 1) * per_segment);
    let count = segments(keys) * per_segment;
    let bound = move |i: usize| match i {
        _ if i == count => 2.0,
        _ if i.is_multiple_of(per_segment) => first_time(i / per_segment, keys),
        _ => (i as f64 / count as f64) as f32,
    };
    (begin..end).filter_map(move |i| {
        let interval = TimeInterval::half_open(bound(i), bound(i + 1))?;
        let at = |i: usize| exact_phase(bound(i), keys, segment);
        let phases = [if i == begin { 0.0 } else { at(i) }, if i + 1 == end { 1.0 } else { at(i + 1) }];
        Some(SegmentSlice { keys, segment, interval, phases })
    })
}

/// The tree of points that all exist during a time slice; without fast ones, whose numbers in the set are returned, if the longest
/// side of a leaf of usual size is given. Trees that are built one after the other share the memory `more`. Once `progress` is
/// cancelled, it is empty.
pub(in crate::point) fn tree(
    source: &Source,
    existing: &[u32],
    slice: &SegmentSlice,
    without_fast: Option<f32>,
    more: &mut Vec<PointBlock>,
    progress: &Progress,
) -> WithoutFast {
    let existing = if progress.cancelled() { &[] } else { existing };
    if source.all_persist() {
        let references = SlicePoints::<false>::new(source, existing, slice);
        return MovingTree::build_without_fast(&references, *slice, without_fast, more, progress);
    }
    let references = SlicePoints::<true>::new(source, existing, slice);
    MovingTree::build_without_fast(&references, *slice, without_fast, more, progress)
}

/// The share in the rest of a build of trees that will probably be used, but may turn out to be one of several that are tried.
pub(in crate::point) const PROBABLE: f64 = 0.9;

/// The tree of one time slice between the keys in the middle; see [`tree`].
pub(in crate::point) fn linear_tree(
    source: &Source,
    points: &[u32],
    without_fast: Option<f32>,
    progress: &Progress,
) -> WithoutFast {
    let slice = middle_slice(source.keys);
    let existing = points_of_slice(source, points, &slice);
    let progress = progress.rest(PROBABLE / segments(source.keys) as f64);
    tree(source, &existing, &slice, without_fast, &mut Vec::new(), &progress)
}

/// Builds a layer of some of the points: a tree of boxes for each of the time slices, which follow each other and together are the
/// shutter. Some may be ready, each with the index of its slice.
pub(in crate::point) fn moving_layer(
    source: &Source,
    points: &[u32],
    slices: &[SegmentSlice],
    mut ready: Vec<(usize, MovingTree)>,
    progress: &Progress,
) -> Layer {
    let (progress, mut more) = (progress.in_units(slices.len() - ready.len()), Vec::new());
    let existing = points_of_slices(source, points, slices);
    let tree_of = |(i, (slice, existing)): (usize, (&SegmentSlice, Cow<[u32]>))| match ready
        .iter()
        .position(|&(at, _)| at == i)
    {
        Some(place) => ready.swap_remove(place).1,
        None => tree(source, &existing, slice, None, &mut more, &progress.subtask(1.0)).tree,
    };
    Layer::Moving(slices.iter().zip(existing).enumerate().map(tree_of).collect())
}

/// Builds a layer of some of the points in f64: trees of boxes, so many side by side in time for each segment between keys.
pub(in crate::point) fn double_layer(
    source: &Source,
    points: &[u32],
    per_segment: usize,
    progress: &Progress,
) -> Layer {
    let slices = double_time_slices(source.keys, per_segment);
    let progress = progress.in_units(slices.len());
    let tree = |slice: SegmentSlice| {
        let points = if progress.cancelled() { Vec::new() } else { points.to_vec() };
        DoubleTree::build(source, slice, points, true, &progress.subtask(1.0))
    };
    Layer::Double(slices.into_iter().map(tree).collect())
}

/// Builds a layer of points in f64 that are static.
pub(in crate::point) fn static_double_layer(
    source: &Source,
    points: impl Iterator<Item = usize>,
    progress: &Progress,
) -> Layer {
    let points = points.map(|point| point as u32).collect();
    Layer::Double(vec![DoubleTree::build(source, SegmentSlice::AT_REST, points, false, progress)])
}

/// Builds a layer of some of the points: one k-d tree for each segment, with at most `most` references for each point.
pub(in crate::point) fn kd_layer(source: &Source, points: &[u32], most: f32, progress: &Progress) -> Layer {
    let slices = time_slices(source.keys, 1);
    let progress = progress.in_units(slices.len());
    let tree = |slice: &SegmentSlice| {
        let points = if progress.cancelled() { &[] } else { points };
        KdPoints::build(&references(source, points, slice), *slice, most, &progress.subtask(1.0))
    };
    Layer::Kd(slices.iter().map(tree).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_is_in_one_slice_and_in_its_segment() {
        for keys in [1, 2, 3, 4, 8, 11, 26] {
            for per_segment in [1, 2, 3, 8] {
                let slices = time_slices(keys, per_segment);
                assert_eq!(slices.len(), segments(keys) * per_segment);
                let bounds = slices.iter().flat_map(|p| [p.interval.begin(), p.interval.end()]);
                let near = bounds.flat_map(|t| [t.next_down(), t, t.next_up()]);
                for t in near.chain((0..=997).map(|i| i as f32 / 997.0)).filter(|t| (0.0..=1.0).contains(t)) {
                    let holding: Vec<&SegmentSlice> = slices.iter().filter(|p| p.interval.contains(t)).collect();
                    assert_eq!(holding.len(), 1, "{keys} keys, {per_segment} slices each, time {t}");
                    assert_eq!(KeyTime::new(t, keys).segment, holding[0].segment, "{keys} keys, time {t}");
                }
            }
        }
    }
}
