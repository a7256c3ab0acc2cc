//! The visibility masks of blocks, by which queries with a mask skip what is hidden from them as a whole.

use super::leaf::source::WideSource;
use super::wide_node::ChildRef;
use super::wide_tree::{BlockIntervals, BlockMasks, WideTree};

impl BlockMasks {
    /// The masks of a tree over a set, whose leaf blocks hold the primitives `ids`.
    pub(super) fn of<'a, S: WideSource>(
        tree: &'a WideTree,
        set: &S,
        ids: impl Fn(ChildRef) -> Option<&'a [u32]>,
    ) -> BlockMasks {
        let masks = set.masks();
        let Some(&first) = masks.first() else { return BlockMasks::UNKNOWN };
        if masks.iter().all(|&mask| mask == first) {
            return BlockMasks { all: first, common: first, by_line: Vec::new() };
        }
        let of_leaf = |leaf| ids(leaf).unwrap_or_default().iter().fold(0, |all, &id| all | set.mask(id));
        let by_line = tree.unions(0, of_leaf, |one, other| one | other);
        let all = masks.iter().fold(0, |all, mask| all | mask);
        BlockMasks { all, common: masks.iter().fold(u32::MAX, |common, mask| common & mask), by_line }
    }
}

impl WideTree {
    /// Finds the masks of all blocks, and when something in them exists, of a new tree or where that of the set has changed.
    pub(crate) fn summarize_blocks<S: WideSource>(&mut self, set: &S) {
        self.masks = BlockMasks::of(self, set, |leaf| self.ids(leaf));
        self.intervals = BlockIntervals::of(self, set, |leaf| self.ids(leaf));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{Division, WideParams};
    use crate::primitive::{MovingSphere, PrimitiveSet, Scene, TriangleMesh};
    use crate::progress::Progress;
    use crate::random::Random;
    use glam::{DVec3, Vec3};

    fn soup(random: &mut Random, mask: u32) -> TriangleMesh {
        let positions: Vec<Vec<Vec3>> = (0..2).map(|_| (0..600).map(|_| random.vec()).collect()).collect();
        TriangleMesh::new((0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions).with_mask(mask)
    }

    fn built(masks: &[u32], division: Division, balls: bool) -> (Scene, WideTree) {
        let mut random = Random(11);
        let meshes: Vec<TriangleMesh> = masks.iter().map(|&mask| soup(&mut random, mask)).collect();
        let balls = if balls { vec![MovingSphere::fixed(DVec3::ZERO, 0.1)] } else { Vec::new() };
        let set = Scene::new(&meshes, Box::new(balls)).expect("a scene");
        let params = WideParams { division, ..WideParams::default() };
        let tree = WideTree::build(&set, &params, &Progress::new(None)).expect("a tree");
        (set, tree)
    }

    /// The union of the masks of all primitives below a block.
    fn below(set: &Scene, tree: &WideTree, block: ChildRef) -> u32 {
        match tree.ids(block) {
            Some(ids) => ids.iter().fold(0, |all, &id| all | set.mask(id)),
            None => tree.children(block).fold(0, |all, child| all | below(set, tree, child)),
        }
    }

    #[test]
    fn every_block_has_the_masks_of_what_is_in_it() {
        for division in [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(2)] {
            let (set, mut tree) = built(&[0b1, 0b110, 0], division, false);
            let mut stack = vec![tree.root];
            let mut unions = Vec::new();
            while let Some(at) = stack.pop() {
                assert_eq!(tree.masks.union(at), below(&set, &tree, at), "{division:?}");
                unions.push(tree.masks.union(at));
                stack.extend(tree.children(at));
            }
            assert!(unions.contains(&0b111) && unions.iter().any(|&union| union != 0b111));
            // As in a refit to other masks.
            let (other, _) = built(&[0b1000, 0b1000, 0b1000], division, false);
            tree.summarize_blocks(&other);
            assert_eq!((tree.masks.union(tree.root), tree.masks.bytes()), (0b1000, 0));
        }
    }

    #[test]
    fn common_masks_take_no_memory_and_shapes_have_all_bits_by_default() {
        let (_, tree) = built(&[0b10; 2], Division::Whole, false);
        assert_eq!((tree.masks.union(tree.root), tree.masks.bytes()), (0b10, 0));
        let (_, tree) = built(&[0b10], Division::Whole, true);
        assert_eq!(tree.masks.union(tree.root), u32::MAX);
        // What has the bit in common sees all of it.
        assert_eq!([0b110, 0b101].map(|mask| tree.masks.hide_nothing_from(mask)), [true, false]);
        let (_, tree) = built(&[0b110, 0b011], Division::Whole, false);
        assert_eq!([0b010, 0b101].map(|mask| tree.masks.hide_nothing_from(mask)), [true, false]);
        let (_, empty) = built(&[], Division::Whole, false);
        assert_eq!((empty.masks.bytes(), empty.masks.hide_nothing_from(u32::MAX)), (0, false));
    }
}
