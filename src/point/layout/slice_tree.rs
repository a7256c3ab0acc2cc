//! What the trees of time slices have in common, whatever their structure.

use crate::file::{Encoder, FileError};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::simd::Lanes;

/// How large a tree is.
pub(in crate::point) struct TreeSize {
    pub(in crate::point) references: usize,
    /// Nodes of sixteen boxes, or planes.
    pub(in crate::point) nodes: usize,
    /// Levels of nodes, or planes above the deepest leaf.
    pub(in crate::point) levels: usize,
    /// Bytes allocated.
    pub(in crate::point) bytes: usize,
}

/// A tree over the points of a time slice, in blocks of sixteen.
pub(in crate::point) trait SliceTree {
    /// The time slice that the tree covers.
    fn slice(&self) -> SegmentSlice;
    /// How large it is.
    fn size(&self) -> TreeSize;
    /// Number of blocks.
    fn block_count(&self) -> usize;
    /// The ids of a block, `u32::MAX` in lanes without a point.
    fn block_ids(&self, block: usize) -> &Lanes<u32>;
    /// The same, to be changed.
    fn block_ids_mut(&mut self, block: usize) -> &mut Lanes<u32>;
    /// Writes everything except the time slice to a file.
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError>;
}

/// The ids of all references, in the order of the tree.
pub(in crate::point) fn all_ids<T: SliceTree + ?Sized>(tree: &T) -> impl Iterator<Item = u32> {
    (0..tree.block_count()).flat_map(|block| *tree.block_ids(block)).filter(|&id| id != u32::MAX)
}

/// The index of the tree that is responsible for a time in [0, 1].
#[inline(always)]
pub(in crate::point) fn slice_at<T: SliceTree>(trees: &[T], time: f32) -> usize {
    trees.partition_point(|tree| tree.slice().interval.end_bound() <= time).min(trees.len() - 1)
}

/// The trees of the slices that lie between two times, or reach them: those before and behind are passed over without a look at
/// each, of which there may be tens of thousands.
pub(in crate::point) fn slices_during<T: SliceTree>(trees: &[T], [first, last]: [f32; 2]) -> &[T] {
    let begin = trees.partition_point(|tree| tree.slice().interval.end() < first);
    let end = trees.partition_point(|tree| tree.slice().interval.begin() <= last);
    trees.get(begin..end).unwrap_or(&[])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::point::layout::moving_tree::MovingTree;
    use crate::progress::Progress;
    use crate::random::Random;

    #[test]
    fn slices_during_an_interval_are_those_that_reach_it() {
        let slice = |i: u16| {
            let interval = TimeInterval::new(f32::from(i) / 100.0, f32::from(i + 1) / 100.0).unwrap();
            SegmentSlice { keys: 101, segment: i.into(), interval, phases: [0.0, 1.0] }
        };
        let empty = |i: u16| MovingTree::build(&[][..], slice(i), &Progress::new(None));
        let trees: Vec<MovingTree> = (0..100).map(empty).collect();
        let mut random = Random(8);
        for i in 0..1000u16 {
            let time = |x: f32| if i.is_multiple_of(3) { (x * 100.0).round() / 100.0 } else { 1.4 * x - 0.2 };
            let (a, b) = (time(random.unit()), time(random.unit()));
            let [first, last] = if i.is_multiple_of(2) { [a, a] } else { [a.min(b), a.max(b)] };
            let reaches = |of: &&MovingTree| of.slice.interval.begin() <= last && first <= of.slice.interval.end();
            let expected: Vec<usize> = trees.iter().filter(reaches).map(|of| of.slice.segment).collect();
            let found: Vec<usize> = slices_during(&trees, [first, last]).iter().map(|of| of.slice.segment).collect();
            assert_eq!(found, expected, "{first} {last}");
        }
        assert!(slices_during::<MovingTree>(&[], [0.0, 1.0]).is_empty());
    }
}
