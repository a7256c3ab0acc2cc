//! What the trees of time slices have in common, whatever their structure.

use crate::point::leaf_order::moving_reference::SegmentSlice;

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
