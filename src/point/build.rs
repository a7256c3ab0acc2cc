//! From the points that move to layers: dividing the shutter into parts, each with a tree of its own.

use super::moving_reference::{MovingReference, Part, exact_phase};
use super::moving_tree::MovingTree;
use super::partition::Layer;
use super::plane_tree::PlaneTree;
use super::source::Source;
use crate::geometry::{KeyTime, TimeInterval};
use crate::progress::Progress;

/// How moving points are put into trees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Plan {
    /// Trees of boxes, so many side by side in time for each segment between keys.
    Boxes(usize),
    /// One k-d tree for each segment, with at most so many references for each point.
    Planes(f32),
}

impl Plan {
    /// Trees for each segment between keys.
    pub(super) fn parts(self) -> usize {
        match self {
            Plan::Boxes(parts) => parts,
            Plan::Planes(_) => 1,
        }
    }

    /// The layer over `movers` of each of these parts of the shutter; over none of them once `progress` is cancelled.
    pub(super) fn layer(
        self,
        parts: &[Part],
        movers: impl Fn(&Part) -> Vec<MovingReference>,
        progress: &Progress,
    ) -> Layer {
        let movers = |part: &Part| if progress.cancelled() { Vec::new() } else { movers(part) };
        let progress = progress.part(1.0 / parts.len() as f64);
        let boxes = |part: &Part| MovingTree::build(&movers(part), *part, &progress);
        match self {
            Plan::Boxes(_) => Layer::Moving(parts.iter().map(boxes).collect()),
            Plan::Planes(most) => {
                let planes = |part: &Part| PlaneTree::build(&movers(part), *part, most, &progress);
                Layer::Planes(parts.iter().map(planes).collect())
            }
        }
    }
}

/// The segment between keys that stands for all of them where one has to.
pub(super) fn middle_segment(keys: usize) -> usize {
    (keys.max(2) - 1) / 2
}

/// The parts into which the shutter is divided: `per_segment` for each segment between keys.
pub(super) fn parts(keys: usize, per_segment: usize) -> Vec<Part> {
    (0..(keys - 1).max(1)).flat_map(|segment| parts_of(segment, keys, per_segment)).collect()
}

/// The same of one segment.
pub(super) fn parts_of(segment: usize, keys: usize, per_segment: usize) -> impl Iterator<Item = Part> {
    let (begin, end) = (segment * per_segment, (segment + 1) * per_segment);
    let count = (keys - 1).max(1) * per_segment;
    let bound = move |i: usize| if i == count { 2.0 } else { boundary(i, per_segment, keys) };
    (begin..end).filter_map(move |i| {
        let interval = TimeInterval::half_open(bound(i), bound(i + 1))?;
        let at = |i: usize| exact_phase(bound(i), keys, segment);
        let phases = [if i == begin { 0.0 } else { at(i) }, if i + 1 == end { 1.0 } else { at(i + 1) }];
        Some(Part { keys, segment, interval, phases })
    })
}

/// Begin of part `i`.
fn boundary(i: usize, per_segment: usize, keys: usize) -> f32 {
    if i.is_multiple_of(per_segment) {
        return KeyTime::first_time(i / per_segment, keys);
    }
    (i as f64 / ((keys - 1).max(1) * per_segment) as f64) as f32
}

/// Builds a moving layer of some of the points.
pub(super) fn moving_layer(
    source: &Source,
    select: impl Iterator<Item = usize> + Clone,
    plan: Plan,
    progress: &Progress,
) -> Layer {
    let movers = |part: &Part| source.movers(part, select.clone(), |i| source.id(i));
    plan.layer(&parts(source.keys, plan.parts()), movers, progress)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_is_in_one_part_and_in_its_segment() {
        for keys in [1, 2, 3, 4, 8, 11, 26] {
            for per_segment in [1, 2, 3, 8] {
                let parts = parts(keys, per_segment);
                assert_eq!(parts.len(), (keys - 1).max(1) * per_segment);
                let bounds = parts.iter().flat_map(|p| [p.interval.begin(), p.interval.end()]);
                let near = bounds.flat_map(|t| [t.next_down(), t, t.next_up()]);
                for t in near.chain((0..=997).map(|i| i as f32 / 997.0)).filter(|t| (0.0..=1.0).contains(t)) {
                    let holding: Vec<&Part> = parts.iter().filter(|p| p.interval.contains(t)).collect();
                    assert_eq!(holding.len(), 1, "{keys} keys, {per_segment} parts each, time {t}");
                    assert_eq!(KeyTime::new(t, keys).segment, holding[0].segment, "{keys} keys, time {t}");
                }
            }
        }
    }
}
