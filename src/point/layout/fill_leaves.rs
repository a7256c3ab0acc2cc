//! From points below bottom nodes to leaf blocks and boxes.

use super::boxes::Boxes;
use crate::parallel;
use crate::point::leaf_order::bottom_order::{MOST, Rows, SPARE};
use crate::progress::Progress;
use crate::simd::{Kernel, LANES, PointBlock, Simd, SimdLevel, dispatch};

/// Where the points of bottom nodes come from.
pub(in crate::point) trait BottomPoints: Sync {
    /// Takes the points from number `first` on, as many as `count`, with their indices. `blocks` are those that they will be in,
    /// which are written anew afterwards.
    fn take(&self, first: usize, count: usize, blocks: &mut [PointBlock], to: &mut Rows<MOST>);
    /// Prefetches the points that will be in these blocks soon; a hint.
    #[inline(always)]
    fn prefetch(&self, _blocks: &[PointBlock]) {}
    /// The id of a point.
    fn id(&self, index: u32) -> u32;
}

/// Bottom nodes and the blocks below them, to be filled.
pub(in crate::point) struct BottomNodes<'a> {
    /// Number of the first point.
    pub(in crate::point) first: usize,
    /// Number of points; not all nodes may have some.
    pub(in crate::point) count: usize,
    pub(in crate::point) nodes: &'a mut [Boxes],
    pub(in crate::point) blocks: &'a mut [PointBlock],
    /// Blocks of each leaf.
    pub(in crate::point) leaf_blocks: usize,
}

/// Nodes that one thread fills at a time.
const SHARE: usize = 64;

/// Takes the points of each bottom node, puts them in order, and writes its blocks and boxes. `progress` counts points; once it is
/// cancelled, nothing more is written.
pub(in crate::point) fn fill(bottoms: BottomNodes<'_>, points: &impl BottomPoints, progress: &Progress) {
    let BottomNodes { first, count, nodes, blocks, leaf_blocks } = bottoms;
    if nodes.len() > SHARE {
        let half = nodes.len() / 2;
        let (nodes, more_nodes) = nodes.split_at_mut(half);
        let (blocks, more_blocks) = blocks.split_at_mut(half * LANES * leaf_blocks);
        let left = (half * LANES * LANES * leaf_blocks).min(count);
        parallel::both(
            || fill(BottomNodes { first, count: left, nodes, blocks, leaf_blocks }, points, progress),
            || {
                let (first, count) = (first + left, count - left);
                let (nodes, blocks) = (more_nodes, more_blocks);
                fill(BottomNodes { first, count, nodes, blocks, leaf_blocks }, points, progress)
            },
        );
        return;
    }
    if progress.cancelled() {
        return;
    }
    progress.finished(count.min(nodes.len() * LANES * LANES * leaf_blocks) as f64);
    // What is written does not depend on the instruction set.
    dispatch(SimdLevel::best(), Fill { bottoms: BottomNodes { first, count, nodes, blocks, leaf_blocks }, points });
}

struct Fill<'a, P> {
    bottoms: BottomNodes<'a>,
    points: &'a P,
}

impl<P: BottomPoints> Kernel for Fill<'_, P> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Fill { bottoms: BottomNodes { first, count, nodes, blocks, leaf_blocks }, points } = self;
        let (mut rows, mut spare) = (Rows::<MOST>::EMPTY, Rows::<SPARE>::EMPTY);
        let share = LANES * leaf_blocks;
        for (number, node) in nodes.iter_mut().enumerate() {
            let (done, next) = blocks.split_at_mut((number + 1) * share);
            points.prefetch(next.get(..share).unwrap_or_default());
            let blocks = &mut done[number * share..];
            let before = number * share * LANES;
            let count = count.saturating_sub(before).min(share * LANES);
            points.take(first + before, count, blocks, &mut rows);
            rows.order(s, count, leaf_blocks * LANES, &mut spare);
            let mut boxes = Boxes::NONE;
            for (number, block) in blocks.iter_mut().enumerate() {
                if number * LANES >= count {
                    *block = PointBlock::EMPTY;
                    continue;
                }
                let here = rows.vector(s, number * LANES);
                for axis in 0..3 {
                    s.store(here.at[axis], &mut block.at[axis]);
                    let lane = number / leaf_blocks;
                    let (least, most) = range(s, here.at[axis]);
                    boxes.lo[axis][lane] = least.min(boxes.lo[axis][lane]);
                    boxes.hi[axis][lane] = most.max(boxes.hi[axis][lane]);
                }
                s.store_u(here.index, &mut block.id);
                for id in block.id.iter_mut().take(count - number * LANES) {
                    *id = points.id(*id);
                }
            }
            *node = boxes;
        }
    }
}

/// The least and the greatest of sixteen coordinates that are finite.
#[inline(always)]
fn range<S: Simd>(s: S, x: S::F) -> (f32, f32) {
    let y = s.select(s.lt(x, s.splat(f32::INFINITY)), x, s.splat(f32::NEG_INFINITY));
    let (lo, hi) = (s.min(x, s.swap_lanes::<8>(x)), s.max(y, s.swap_lanes::<8>(y)));
    let (lo, hi) = (s.min(lo, s.swap_lanes::<4>(lo)), s.max(hi, s.swap_lanes::<4>(hi)));
    let (lo, hi) = (s.min(lo, s.swap_lanes::<2>(lo)), s.max(hi, s.swap_lanes::<2>(hi)));
    let (lo, hi) = (s.min(lo, s.swap_lanes::<1>(lo)), s.max(hi, s.swap_lanes::<1>(hi)));
    (s.lane(lo, 0), s.lane(hi, 0))
}
