//! What the trees of time slices have in common, whatever their structure.

use crate::point::leaf_order::segment_slice::SegmentSlice;

/// A tree over the points of a time slice.
pub(in crate::point) trait SliceTree {
    /// The time slice that the tree covers.
    fn time_slice(&self) -> &SegmentSlice;
    /// Number of references.
    fn references(&self) -> usize;
    /// Number of nodes of sixteen boxes, or of planes.
    fn node_count(&self) -> usize;
    /// Levels of nodes, or planes above the deepest leaf.
    fn levels(&self) -> usize;
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}

/// The index of the tree that is responsible for a time in [0, 1].
#[inline(always)]
pub(in crate::point) fn slice_at<T: SliceTree>(trees: &[T], time: f32) -> usize {
    trees.partition_point(|tree| tree.time_slice().interval.end_bound() <= time).min(trees.len() - 1)
}

/// The trees of the slices that lie between two times, or reach them: those before and behind are passed over without a look at
/// each, of which there may be tens of thousands.
pub(in crate::point) fn slices_during<T: SliceTree>(trees: &[T], [first, last]: [f32; 2]) -> &[T] {
    let begin = trees.partition_point(|tree| tree.time_slice().interval.end() < first);
    let end = trees.partition_point(|tree| tree.time_slice().interval.begin() <= last);
    trees.get(begin..end).unwrap_or(&[])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::random::Random;

    struct Slice(SegmentSlice);

    impl SliceTree for Slice {
        fn time_slice(&self) -> &SegmentSlice {
            &self.0
        }
        fn references(&self) -> usize {
            0
        }
        fn node_count(&self) -> usize {
            0
        }
        fn levels(&self) -> usize {
            0
        }
        fn bytes(&self) -> usize {
            0
        }
    }

    #[test]
    fn slices_during_an_interval_are_those_that_reach_it() {
        let slice = |i: u16| {
            let interval = TimeInterval::new(f32::from(i) / 100.0, f32::from(i + 1) / 100.0).unwrap();
            Slice(SegmentSlice { keys: 101, segment: i.into(), interval, phases: [0.0, 1.0] })
        };
        let slices: Vec<Slice> = (0..100).map(slice).collect();
        let mut random = Random(8);
        for i in 0..1000u16 {
            let time = |x: f32| if i.is_multiple_of(3) { (x * 100.0).round() / 100.0 } else { 1.4 * x - 0.2 };
            let (a, b) = (time(random.unit()), time(random.unit()));
            let [first, last] = if i.is_multiple_of(2) { [a, a] } else { [a.min(b), a.max(b)] };
            let reaches = |of: &&Slice| of.0.interval.begin() <= last && first <= of.0.interval.end();
            let expected: Vec<usize> = slices.iter().filter(reaches).map(|of| of.0.segment).collect();
            let found: Vec<usize> = slices_during(&slices, [first, last]).iter().map(|of| of.0.segment).collect();
            assert_eq!(found, expected, "{first} {last}");
        }
        assert!(slices_during::<Slice>(&[], [0.0, 1.0]).is_empty());
    }
}
