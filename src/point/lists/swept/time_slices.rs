//! Which trees are compared with which, and when.
//!
//! Where the shutter is divided, each time slice has a tree of its own. Points that are near each other for long are so
//! in several slices. Two trees are compared during the times that both cover. An encounter is reported where it begins:
//! in the slice of the one point and the slice of the other that contain this time. The begin is computed from the two
//! points and their radius alone. So it is the same wherever the pair comes up, and exactly one comparison reports it.
//!
//! **Why none is lost.** Let an encounter begin at the computed time x, which is in the active intervals of both points.
//! Each point has a reference in the slice of its layer that contains x, so these slices are compared at x.
//!
//! The slice that begins where the interval of the query ends is searched in two cases only: an active interval begins
//! there, in any layer, or the time is that of a key: in the segment before, rounding may put points beside where they are at the
//! key. All other points are in the slice before, too, and at the same places. If that slice is the last that is searched, it
//! reports all later encounters.
//!
//! The exact begin differs from x by at most 2^-25 of the time that both points exist: it comes from the root of a
//! difference of f64 products. So at x the distance of the two exceeds the radius by at most 2^-25 of their relative
//! motion, one of the 64 units of slack in [`super`]. f32 rounds the times of keys. There the first and the last slice
//! of a segment report all that is beyond them, and ranges of times are widened by more than that.
//!
//! **Another set** may have other keys. Then slices are compared during the times that are in both segments. An encounter that
//! begins with such a range, or is under way then, begins at a key of one of the sets, which may lie before the begin of its own
//! slice by rounding and still be in the slice of the other that ends there. So these are compared as well, though they only touch.
//! A point that begins to exist at such a key counts behind it only, as at keys of its own.

use super::coordinate::{SweptCoordinate, SweptLayer};
use super::window::Segment;
use crate::parallel;
use crate::point::layout::over_interval::{BlockTree, PathRows, bottom_nodes};
use crate::point::layout::slice_tree::{SliceTree, slices_during};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::lists::reach::Reach;
use core::ops::Range;
use std::collections::HashMap;

/// The tree of a time slice, or one for all times.
pub(super) enum SweptTree<'a, C: SweptCoordinate> {
    Static(&'a C::Static),
    Moving(&'a C::Moving),
}

/// A tree and the times during which it is searched.
pub(super) struct SweptSlice<'a, C: SweptCoordinate> {
    pub(super) tree: SweptTree<'a, C>,
    pub(super) times: [f32; 2],
    /// Number of keys and segment where anything moves, or another set has other keys.
    pub(super) segment: Option<(usize, usize)>,
    /// The slice reports the encounters that begin from the first of these times to before the second.
    pub(super) reports: [f64; 2],
}

/// Encounters that begin at any time.
const ALWAYS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// A slice whose points are compared with those of others, all during the same times.
pub(super) struct Pairing {
    /// The index of the slice.
    pub(super) own: usize,
    /// The indices of the others.
    pub(super) others: Vec<usize>,
    pub(super) times: [f32; 2],
}

/// Excesses beyond this part of the least radius are measured for each node of a tree.
const NOTICED: f64 = 1.0 / 1024.0;

/// See [`SweptCoordinate::excess`]: what all points have, if that is nothing beside the `least` radius, else for each slice what
/// those of a node have. `motion` is the most by which displacements differ, and whether all sets have the same keys.
pub(super) fn excesses<C: SweptCoordinate>(
    slices: &[SweptSlice<'_, C>],
    segments: usize,
    (motion, same_keys): (f64, bool),
    least: impl FnOnce() -> f32,
) -> (f64, Option<OwnExcess>, Vec<Reach>) {
    let of_all = C::excess(segments, || magnitude(slices), motion);
    if of_all <= 0.0 || of_all <= NOTICED * f64::from(least()) {
        return (of_all, None, Vec::new());
    }
    // Where keys differ, two points pass any parts of their displacements in the same time, which differ by less than the sum.
    let usual = if same_keys { usual_displacement(slices) } else { [0.0; 3] };
    let own = OwnExcess { segments, usual };
    (0.0, Some(own), parallel::map(slices.len(), |i| slices[i].excesses(&own)))
}

/// The [`SweptCoordinate::excess`] of points by themselves: that of a pair is at most the sum.
#[derive(Clone, Copy)]
pub(super) struct OwnExcess {
    segments: usize,
    /// Two points differ in their motion by at most the sum of what either differs from this. Which displacement it is does not
    /// matter, but it should be that of most points.
    usual: [f64; 3],
}

impl OwnExcess {
    /// The greatest excess of some points.
    pub(super) fn of<C: SweptCoordinate>(&self, points: &PathRows<C>) -> f64 {
        C::excess(self.segments, || points.magnitude(), points.motion(C::displacement, self.usual))
    }
}

/// The displacement between two keys that is in the middle along each axis, of one point of each block.
fn usual_displacement<C: SweptCoordinate>(slices: &[SweptSlice<'_, C>]) -> [f64; 3] {
    let trees = || slices.iter().map(SweptSlice::points);
    let first = |tree: &dyn BlockTree<Coordinate = C>, block: usize, axis: usize| {
        let points = tree.rows(block);
        (points.id[0] != u32::MAX).then(|| C::displacement(points.open[axis][0], points.close[axis][0]))
    };
    core::array::from_fn(|axis| {
        let of_tree = |tree: &dyn BlockTree<Coordinate = C>| -> Vec<f64> {
            (0..tree.block_count()).filter_map(|block| first(tree, block, axis)).collect()
        };
        let mut all: Vec<f64> = trees().flat_map(of_tree).collect();
        let middle = all.len() / 2;
        if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 }
    })
}

/// The largest magnitude of a coordinate. (Looked for only where it counts: it takes a look at every point.)
pub(super) fn magnitude<C: SweptCoordinate>(slices: &[SweptSlice<'_, C>]) -> f64 {
    slices.iter().map(|slice| slice.points().magnitude()).fold(0.0, f64::max)
}

impl<C: SweptCoordinate> SweptSlice<'_, C> {
    /// The tree, for what is asked once for all of its points.
    pub(super) fn points(&self) -> &dyn BlockTree<Coordinate = C> {
        match self.tree {
            SweptTree::Static(tree) => tree,
            SweptTree::Moving(tree) => tree,
        }
    }

    /// The ids of the points that exist at some time of the slice.
    pub(super) fn ids(&self) -> Vec<u32> {
        self.points().ids_during(self.times)
    }

    /// Whether these are slices of the same points at rest.
    pub(super) fn has_same_points(&self, other: &Self) -> bool {
        matches!((&self.tree, &other.tree), (SweptTree::Static(tree), SweptTree::Static(same)) if core::ptr::eq(*tree, *same))
    }

    /// The greatest radius below each lane of each node.
    pub(super) fn reach(&self, radii: &[f32]) -> Reach {
        let mut reach = Reach::default();
        reach.measure(self.points(), None, radii);
        reach
    }

    /// The greatest excess of the points below each lane of each node, rounded up.
    fn excesses(&self, own: &OwnExcess) -> Reach {
        let rounded = |excess: f64| (excess as f32).next_up();
        let (mut reach, tree) = (Reach::default(), self.points());
        reach.measure_blocks(tree, |block| rounded(own.of(&tree.rows(block))));
        reach
    }

    /// Whether some points do not count throughout.
    pub(super) fn timed(&self) -> bool {
        matches!(self.tree, SweptTree::Moving(tree) if tree.timed())
    }

    /// Whether a time is in the slice, or in the segment between keys that ends with it.
    fn holds(&self, time: f32) -> bool {
        match self.tree {
            SweptTree::Static(_) => true,
            SweptTree::Moving(tree) => tree.slice().interval.contains(time) || beside_key(&tree.slice(), time),
        }
    }

    /// The bottom nodes.
    pub(super) fn bottom_nodes(&self) -> Vec<usize> {
        // All of them: absent children begin later than any time.
        bottom_nodes(self.points(), [f32::NEG_INFINITY, f32::MAX])
    }
}

/// Whether an active interval begins exactly where a time slice of its layer does.
pub(super) fn begins_with_a_slice<C: SweptCoordinate>(layer: &SweptLayer<'_, C>, time: f32) -> bool {
    let begins = |tree: &C::Moving| tree.slice().interval.begin() == time && tree.begins_at(time);
    matches!(*layer, SweptLayer::Moving(trees) if slices_during(trees, [time; 2]).iter().any(begins))
}

/// Whether a time that is the begin or the end of a time slice, and a key rounded to f32, lies within the segment in
/// exact arithmetic: the rounded time is after the key that the slice begins with, or before the key that it ends with.
fn beside_key(slice: &SegmentSlice, time: f32) -> bool {
    let begins = slice.phases[0] == 0.0 && time == slice.interval.begin();
    let ends = slice.phases[1] == 1.0 && time == slice.interval.end();
    let along = f64::from(time) * (slice.keys.max(2) - 1) as f64 - slice.segment as f64;
    (begins || ends) && 0.0 < along && along < 1.0
}

/// The time slices of a layer that are searched between two times, in one segment between keys where that is given.
///
/// A slice that begins at the last of the times is searched only where an active interval begins there too (see
/// [`begins_with_a_slice`]), or a segment between keys. A slice that ends at the first of the times is
/// searched only where the exact time of the key lies behind it.
///
/// Where another set has other keys, what is at rest is searched in one segment after the other, between `divided` keys: so its
/// encounters are the same, whether a structure has it together with points that move or not.
pub(super) fn time_slices_of<'a, C: SweptCoordinate>(
    layer: &SweptLayer<'a, C>,
    times: [f32; 2],
    begins: bool,
    (segment, divided): (Option<usize>, Option<usize>),
) -> Vec<SweptSlice<'a, C>> {
    let trees = match *layer {
        SweptLayer::Static(tree) => {
            let whole = SweptSlice { tree: SweptTree::Static(tree), times, segment: None, reports: ALWAYS };
            let Some(keys) = divided else { return vec![whole] };
            let key = |number: usize| (number as f64 / (keys - 1) as f64) as f32;
            let of_segment = |number: usize| {
                let times = [times[0].max(key(number)), times[1].min(key(number + 1))];
                let tree = SweptTree::Static(tree);
                (times[0] <= times[1]).then_some(SweptSlice {
                    tree,
                    times,
                    segment: Some((keys, number)),
                    reports: ALWAYS,
                })
            };
            let numbers = (0..keys - 1).filter(|number| segment.is_none_or(|segment| segment == *number));
            return numbers.filter_map(of_segment).collect();
        }
        SweptLayer::Moving(trees) => {
            slices_during(trees, times).iter().filter(|tree| segment.is_none_or(|s| s == tree.slice().segment))
        }
    };
    let slice = |tree: &'a C::Moving| {
        let interval = tree.slice().interval;
        let reports = [interval.begin(), interval.end_bound()].map(f64::from);
        let both = [times[0].max(interval.begin()), times[1].min(interval.end())];
        let last = both[0] == times[1] && times[0] < times[1];
        let begins_with_a_key = tree.slice().phases[0] == 0.0;
        let more_than_an_end = times[0] < interval.end_bound() && (begins || begins_with_a_key || !last);
        let searched = both[0] <= both[1] && (more_than_an_end || beside_key(&tree.slice(), both[0]));
        let of_keys = Some((tree.slice().keys, tree.slice().segment));
        searched.then_some(SweptSlice { tree: SweptTree::Moving(tree), times: both, segment: of_keys, reports })
    };
    let mut slices: Vec<SweptSlice<'a, C>> = trees.filter_map(slice).collect();
    // The times of keys are rounded, and the slice beside the key may not be searched.
    for of_segment in slices.chunk_by_mut(|a, b| a.segment == b.segment) {
        let last = of_segment.len() - 1;
        of_segment[0].reports[0] = ALWAYS[0];
        of_segment[last].reports[1] = ALWAYS[1];
    }
    slices
}

/// Which of the first `own` slices are compared when with which in some layers. Each layer has a range of slices, in the order of
/// time.
pub(super) fn pairings<C: SweptCoordinate>(
    slices: &[SweptSlice<'_, C>],
    own: usize,
    layers: &[Range<usize>],
    times: [f32; 2],
) -> Vec<Pairing> {
    let mut pairings: Vec<Pairing> = Vec::new();
    for (own, slice) in slices[..own].iter().enumerate() {
        // By their times: what is at rest meets every slice of what moves, and points with many keys have tens of thousands.
        let mut known = HashMap::new();
        for layer in layers {
            let before = slices[layer.clone()].partition_point(|other| other.times[1] < slice.times[0]);
            for (number, other) in slices.iter().enumerate().take(layer.end).skip(layer.start + before) {
                let both = [slice.times[0].max(other.times[0]), slice.times[1].min(other.times[1])];
                if both[0] > both[1] {
                    break;
                }
                let (mut same_keys, mut overlap) = (true, true);
                if let (Some(own), Some(of_other)) = (slice.segment, other.segment) {
                    same_keys = own.0 == of_other.0;
                    overlap = Segment::new(own.0, own.1).overlaps(&Segment::new(of_other.0, of_other.1));
                }
                // A slice does not contain its end.
                let touching = both[0] == both[1] && both[0] < times[1] && same_keys;
                if !overlap || touching && !(slice.holds(both[0]) && other.holds(both[0])) {
                    continue;
                }
                // Zero may have a sign.
                let at = *known.entry(both.map(|time| (time + 0.0).to_bits())).or_insert_with(|| {
                    pairings.push(Pairing { own, others: Vec::new(), times: both });
                    pairings.len() - 1
                });
                pairings[at].others.push(number);
            }
        }
    }
    pairings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point::params::PointParams;
    use crate::point::tree::PointTree;
    use crate::primitive::PointArrays;
    use crate::random::Random;
    use glam::Vec3;

    /// 38 points at rest meet every segment of two that move, and each pair of slices is compared once during each of its times.
    #[test]
    fn what_is_at_rest_is_compared_with_each_slice_during_its_times() {
        const SEGMENTS: usize = 64;
        let mut random = Random(3);
        let first: Vec<Vec3> = (0..40).map(|_| random.vec()).collect();
        let mut key = |_| first.iter().enumerate().map(|(i, &p)| if i < 38 { p } else { random.vec() }).collect();
        let keys: Vec<Vec<Vec3>> = (0..=SEGMENTS).map(&mut key).collect();
        let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
        let points = PointArrays { keys: &keys, active: &[], ids: &[] };
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let layers = f32::layers(&tree);
        assert!(matches!(layers[..], [SweptLayer::Static(_), SweptLayer::Moving(_)]));
        let (mut slices, mut ranges, times) = (Vec::new(), Vec::new(), [0.0, 1.0]);
        for layer in &layers {
            let begin = slices.len();
            slices.extend(time_slices_of(layer, times, false, (None, None)));
            ranges.push(begin..slices.len());
        }
        let found = pairings(&slices, slices.len(), &ranges, times);
        let mut compared = Vec::new();
        for pairing in &found {
            let during = pairing.times.map(f32::to_bits);
            compared.extend(pairing.others.iter().map(|&other| (pairing.own, other, during)));
        }
        compared.sort_unstable();
        let moving = slices.len() - 1;
        let of_rest = compared.iter().filter(|&&(own, other, _)| own == 0 && other > 0).count();
        assert!(moving >= SEGMENTS && of_rest == moving, "{of_rest} of {moving}");
        assert!(compared.windows(2).all(|two| two[0] != two[1]));
        // The groups of a slice are looked at once for each of its times: those at rest during all, and in each slice.
        assert_eq!(found.len(), 1 + 2 * moving);
    }
}
