//! Leaf blocks that the hierarchies of several time slices share, in a refit.
//!
//! They are rewritten before the hierarchies are refitted. A block is in the cache then, so its bounds in all slices are computed
//! at once, and the hierarchies do not read it.

use crate::geometry::LinearBox3;
use crate::layout::wide_node::ChildRef;
use crate::simd::LANES;
use core::ops::Range;

/// A leaf block, and in which time slices it is.
#[derive(Clone, Copy)]
pub(crate) struct SharedLeaf {
    pub leaf: ChildRef,
    /// One bit for each slice.
    pub slices: u32,
}

/// The leaf blocks that the slices of a time node share, in the order of the arena.
#[derive(Clone)]
pub(crate) struct SharedBlocks {
    pub leaves: Vec<SharedLeaf>,
    pub words: Range<usize>,
    /// The number of slices.
    pub slices: usize,
    /// For each section of the words, the number of the first block that begins in it or behind it.
    first: Vec<u32>,
}

/// Words of a section: about those of a block.
const SECTION: usize = 16 * LANES;

impl SharedBlocks {
    /// For the leaf blocks of some slices, which end before word `end`.
    pub fn new(leaves: Vec<SharedLeaf>, end: usize, slices: usize) -> SharedBlocks {
        let words = leaves[0].leaf.at()..end;
        let sections = words.clone().step_by(SECTION);
        let first = sections.map(|begin| leaves.partition_point(|of| of.leaf.at() < begin) as u32).collect();
        SharedBlocks { leaves, words, slices, first }
    }

    /// Whether a leaf block is one of them.
    pub fn have(&self, leaf: ChildRef) -> bool {
        self.words.contains(&leaf.at())
    }

    /// The number of one of the blocks.
    pub fn number(&self, leaf: ChildRef) -> usize {
        let first = self.first[(leaf.at() - self.words.start) / SECTION] as usize;
        first + self.leaves[first..].iter().take_while(|of| of.leaf.at() < leaf.at()).count()
    }
}

/// The leaf blocks of some slices, in the order of the arena; `None` if no block is in several.
pub(in crate::layout) fn shared_leaves(slices: &[Vec<ChildRef>]) -> Option<Vec<SharedLeaf>> {
    let all = slices.iter().enumerate().flat_map(|(i, leaves)| leaves.iter().map(move |&leaf| (leaf, 1 << i)));
    let mut all: Vec<SharedLeaf> = all.map(|(leaf, slices)| SharedLeaf { leaf, slices }).collect();
    let found = all.len();
    all.sort_unstable_by_key(|of| of.leaf.0);
    all.dedup_by(|next, of| {
        let same = next.leaf == of.leaf;
        of.slices |= if same { next.slices } else { 0 };
        same
    });
    (all.len() < found).then_some(all)
}

/// What became of one of the blocks.
#[derive(Clone, Copy)]
struct Visited {
    primitives: u32,
    slices: u32,
    /// The index of its bounds in the first of its slices, those in the others follow; `None` if it did not change.
    bounds: Option<u32>,
}

/// The results for the leaf blocks that the slices of a time node share.
#[derive(Default)]
pub(in crate::layout) struct SharedBounds {
    /// In the order of the arena.
    visited: Vec<Visited>,
    bounds: Vec<LinearBox3>,
}

impl SharedBounds {
    /// Adds the next block and its bounds in each of its slices, or none if it did not change.
    pub fn push(&mut self, of: SharedLeaf, primitives: usize, bounds: impl IntoIterator<Item = LinearBox3>) {
        let first = self.bounds.len();
        self.bounds.extend(bounds);
        let bounds = (self.bounds.len() > first).then_some(first as u32);
        self.visited.push(Visited { primitives: primitives as u32, slices: of.slices, bounds });
    }

    /// Adds the blocks that follow.
    pub fn append(&mut self, other: SharedBounds) {
        let first = self.bounds.len() as u32;
        let moved = |of: Visited| Visited { bounds: of.bounds.map(|bounds| bounds + first), ..of };
        self.visited.extend(other.visited.into_iter().map(moved));
        self.bounds.extend(other.bounds);
    }

    /// The bounds of the block of some number in one of its slices if it changed, and the number of its primitives; `None` if no
    /// block was visited.
    pub fn of(&self, number: usize, slice: usize) -> Option<(Option<LinearBox3>, usize)> {
        let Visited { primitives, slices, bounds } = *self.visited.get(number)?;
        let before = (slices & ((1 << slice) - 1)).count_ones() as usize;
        Some((bounds.map(|first| self.bounds[first as usize + before]), primitives as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::layout::wide_node::Kind;
    use glam::Vec3;

    fn leaf(line: usize) -> ChildRef {
        ChildRef::new(Kind::SharedLeaf, LANES * line, 8).expect("a small arena")
    }

    #[test]
    fn blocks_know_their_slices_and_are_numbered_in_the_order_of_the_arena() {
        assert!(shared_leaves(&[vec![leaf(3), leaf(1)], vec![leaf(2)]]).is_none());
        let shared = shared_leaves(&[vec![leaf(70), leaf(1)], vec![leaf(2)], vec![leaf(1), leaf(2)]]);
        let shared = shared.expect("two blocks are in two slices");
        assert!(shared.iter().map(|of| (of.leaf, of.slices)).eq([(leaf(1), 0b101), (leaf(2), 0b110), (leaf(70), 1)]));
        let shared = SharedBlocks::new(shared, 80 * LANES, 3);
        assert!([1, 2, 70].map(|line| shared.number(leaf(line))).iter().eq(&[0, 1, 2]));
        assert!(shared.have(leaf(1)) && !shared.have(leaf(0)) && !shared.have(leaf(80)));
        let lines: Vec<usize> = (0..500).map(|i| 3 * i + i * i % 3).collect();
        let all = lines.iter().map(|&line| SharedLeaf { leaf: leaf(line), slices: 1 }).collect();
        let shared = SharedBlocks::new(all, 1600 * LANES, 3);
        assert!(lines.iter().map(|&line| shared.number(leaf(line))).eq(0..500));
    }

    #[test]
    fn bounds_are_those_of_the_block_in_the_slice() {
        let cube = |x: f32| {
            let cube = Box3 { min: Vec3::splat(-x), max: Vec3::splat(x) };
            LinearBox3 { begin: cube, end: cube }
        };
        let of = |slices| SharedLeaf { leaf: leaf(0), slices };
        let (mut all, mut others) = (SharedBounds::default(), SharedBounds::default());
        all.push(of(0b101), 5, [cube(1.0), cube(2.0)]);
        others.push(of(0b110), 6, []);
        others.push(of(1), 7, [cube(3.0)]);
        all.append(others);
        assert_eq!([all.of(0, 0), all.of(0, 2)], [(Some(cube(1.0)), 5), (Some(cube(2.0)), 5)].map(Some));
        assert_eq!([all.of(1, 1), all.of(2, 0)], [(None, 6), (Some(cube(3.0)), 7)].map(Some));
        assert_eq!(SharedBounds::default().of(0, 0), None);
    }
}
