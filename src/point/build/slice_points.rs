//! References to the points of a time slice: read in place, where the set was read to.

use super::source::Source;
use crate::geometry::TimeInterval;
use crate::point::leaf_order::moving_reference::{MovingReference, References};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use std::borrow::Cow;

/// Points of a set that exist during a time slice; unless `ACTIVE`, of a set without active intervals. Their numbers are those in
/// the set.
pub(in crate::point) struct SlicePoints<'a, const ACTIVE: bool> {
    source: &'a Source,
    points: &'a [u32],
    interval: TimeInterval,
    /// The keys before and behind.
    keys: [usize; 2],
}

impl<'a, const ACTIVE: bool> SlicePoints<'a, ACTIVE> {
    pub(in crate::point) fn new(source: &'a Source, points: &'a [u32], slice: &SegmentSlice) -> Self {
        SlicePoints { source, points, interval: slice.interval, keys: slice.ends() }
    }

    /// The active interval of a point, and its intersection with the time slice.
    #[inline(always)]
    fn times(&self, point: u32) -> [TimeInterval; 2] {
        if !ACTIVE {
            return [TimeInterval::FULL, self.interval];
        }
        let active = self.source.active(point as usize);
        [active, active.intersect(self.interval).unwrap_or(self.interval)]
    }
}

impl<const ACTIVE: bool> References for SlicePoints<'_, ACTIVE> {
    fn len(&self) -> usize {
        self.points.len()
    }
    #[inline(always)]
    fn number(&self, i: usize) -> u32 {
        self.points[i]
    }
    #[inline(always)]
    fn reference(&self, number: u32) -> MovingReference {
        let (open, close) =
            (self.source.at(number as usize, self.keys[0]), self.source.at(number as usize, self.keys[1]));
        let [active, interval] = self.times(number);
        MovingReference { open, close, interval, active, id: self.source.id(number as usize), fast: false }
    }
    #[inline(always)]
    fn prefetch(&self, number: u32) {
        self.source.prefetch(number as usize, self.keys[0]);
        if ACTIVE {
            self.source.prefetch_active(number as usize);
        }
    }
    fn timed(&self, slice: &SegmentSlice) -> bool {
        ACTIVE && self.points.iter().any(|&point| self.times(point)[1] != slice.interval)
    }
    fn have_active_intervals(&self) -> bool {
        ACTIVE && self.points.iter().any(|&point| self.times(point)[0] != TimeInterval::FULL)
    }
}

/// The references to some points of a set during a time slice, of those that exist then.
pub(in crate::point) fn references(source: &Source, points: &[u32], slice: &SegmentSlice) -> Vec<MovingReference> {
    let existing = points_of_slice(source, points, slice);
    let of_slice = SlicePoints::<true>::new(source, &existing, slice);
    existing.iter().map(|&point| of_slice.reference(point)).collect()
}

/// Of some points those that exist during a time slice.
pub(in crate::point) fn points_of_slice<'a>(
    source: &Source,
    points: &'a [u32],
    slice: &SegmentSlice,
) -> Cow<'a, [u32]> {
    if source.all_persist() {
        return Cow::Borrowed(points);
    }
    let (mut existing, mut count) = (vec![0; points.len()], 0);
    // Without branches: whether a point exists is hard to predict.
    for &point in points {
        existing[count] = point;
        count += usize::from(source.active(point as usize).intersect(slice.interval).is_some());
    }
    existing.truncate(count);
    Cow::Owned(existing)
}

/// The same for each of some time slices, at least one, which follow each other and together are the shutter.
pub(in crate::point) fn points_of_slices<'a>(
    source: &Source,
    points: &'a [u32],
    slices: &[SegmentSlice],
) -> Vec<Cow<'a, [u32]>> {
    if source.all_persist() {
        return vec![Cow::Borrowed(points); slices.len()];
    }
    let mut existing = vec![Vec::new(); slices.len()];
    for &point in points {
        let active = source.active(point as usize);
        // Slices have nearly the same length.
        let mut at = ((active.begin() * slices.len() as f32) as usize).min(slices.len() - 1);
        while slices[at].interval.begin() > active.begin() {
            at -= 1;
        }
        while slices[at].interval.end_bound() <= active.begin() {
            at += 1;
        }
        while at < slices.len() && slices[at].interval.begin() < active.end_bound() {
            existing[at].push(point);
            at += 1;
        }
    }
    existing.into_iter().map(Cow::Owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point::build::cost::{FINEST, ReferenceCounts};
    use crate::point::build::time_slices::time_slices;
    use crate::random::Random;
    use crate::{MovingPoint, Precision};

    #[test]
    fn each_slice_has_the_points_that_exist_in_it() {
        let mut random = Random(3);
        // Some begin and end where slices do.
        let mut time =
            |i: usize| if i.is_multiple_of(3) { (random.unit() * 32.0).floor() / 32.0 } else { random.unit() };
        let point = |i: usize| {
            let (a, b) = (time(i), time(i + 1));
            let active = TimeInterval::new(a.min(b), a.max(b)).unwrap_or(TimeInterval::FULL);
            MovingPoint::fixed(glam::Vec3::ZERO).with_active(active)
        };
        let points: Vec<MovingPoint> = (0..1000).map(point).collect();
        let source = Source::read(&points[..], Precision::Automatic).unwrap();
        let some: Vec<u32> = (0..1000u32).filter(|i| !i.is_multiple_of(7)).collect();
        for (keys, per_segment) in [(2, 1), (2, 2), (2, 8), (2, FINEST), (5, 1), (5, 3), (12, 2)] {
            let slices = time_slices(keys, per_segment);
            let found = points_of_slices(&source, &some, &slices);
            for (slice, found) in slices.iter().zip(&found) {
                let exists = |&&i: &&u32| points[i as usize].active.intersect(slice.interval).is_some();
                assert!(some.iter().filter(exists).eq(found.iter()), "{per_segment} slices of {keys} keys");
                assert_eq!(*found, points_of_slice(&source, &some, slice));
            }
            if keys == 2 {
                let count = found.iter().map(|points| points.len()).sum::<usize>();
                let counts = ReferenceCounts::of(&source, &some);
                assert_eq!(counts.with(per_segment), count);
                if per_segment == FINEST {
                    for (time, quarters) in counts.quarters.into_iter().zip([1, 3]) {
                        let at = slices.iter().position(|slice| slice.interval.contains(time)).unwrap();
                        let before = found[..at].iter().map(|points| points.len()).sum::<usize>();
                        let until = before + found[at].len();
                        assert!(4 * before < quarters * count && quarters * count <= 4 * until, "{before} of {count}");
                    }
                }
            }
        }
        let source =
            Source::read(&[MovingPoint::new(glam::Vec3::ZERO, glam::Vec3::X); 5][..], Precision::Automatic).unwrap();
        let (slices, all) = (time_slices(2, 4), [0, 1, 2, 3, 4]);
        assert!(points_of_slices(&source, &all, &slices).iter().all(|points| **points == all));
        assert_eq!(ReferenceCounts::of(&source, &all).with(4), 20);
    }
}
