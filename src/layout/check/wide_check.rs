//! Checking a tree that was read from a file, before queries traverse it.
//!
//! Queries rely on invariants of the tree. They follow references without bounds checks of their own, their stack is just as deep
//! as the tree, and boxes tell them which lanes of a node have a child. A build ensures this, but a file may hold anything. So
//! every block is visited once before the first query, and every invariant that queries rely on is checked. The *values* of boxes
//! and corners are not checked: wrong ones cause wrong answers ([`WideTree::validate`] finds those), but no panics.

use crate::file::{FileError, broken, require};
use crate::layout::leaf::ids::ids_of_leaf;
use crate::layout::leaf::keyed::KeyedLeaf;
use crate::layout::leaf::source::WideSource;
use crate::layout::leaf::spheres::SphereLeaf;
use crate::layout::leaf_index::Found;
use crate::layout::node_boxes::NOWHERE;
use crate::layout::wide_node::{ChildRef, Kind, node_rows, shared_count};
use crate::layout::wide_tree::{Counts, WideTree};
use crate::limits::{MAX_MESH_KEYS, MAX_TIME_SLICES};
use crate::primitive::{PrimitiveSet, Triangles};
use crate::simd::LANES;

/// More levels than any build makes: the build halves nodes by count below level 44, and again below each time node.
const MOST_LEVELS: u32 = 256;

impl WideTree {
    /// An error for the first violation that could break a query; otherwise the counts and the table of leaf blocks.
    pub(in crate::layout) fn check<S: WideSource>(&self, set: &S) -> Result<(Counts, Vec<u32>), FileError> {
        require((1..=MAX_TIME_SLICES).contains(&self.slices), "the header has no time slices or too many")?;
        let no_triangles = set.triangles().is_none_or(|triangles| triangles.len() == 0) && set.len() > 0;
        require(!no_triangles || self.lists == 0, "a tree of shapes has leaf blocks of triangles")?;
        let words = self.arena.ints();
        // Each primitive takes a few bytes, so tables of primitives are in proportion to the file.
        require(set.len() <= words.len(), "there are more primitives than words in the tree")?;
        let found = self.check_nodes()?;
        let of_leaves = LeafCheck { tree: self, words, set, triangles: set.triangles(), bent: set.bent() };
        self.index_checked_leaves(set, &found, |leaf| of_leaves.check(leaf))
    }

    /// Checks all nodes: each is reached once, so that traversals end, and none is too deep. Leaf blocks are recorded only.
    fn check_nodes(&self) -> Result<Found, FileError> {
        let words = self.arena.ints().len();
        let mut reached = vec![false; words / LANES];
        let mut found = Found::default();
        let mut stack = vec![(self.root, 0)];
        stack.retain(|&(root, _)| root != ChildRef::NOTHING);
        while let Some((at, depth)) = stack.pop() {
            require(depth <= MOST_LEVELS, "a path from the root has more than 256 levels")?;
            if at.kind().is_leaf() {
                found.add_leaf(at, depth);
                continue;
            }
            found.add_node(at.kind());
            let rows = node_rows(at.kind());
            require(at.at() + rows * LANES <= words, "a reference to a node points outside the tree")?;
            let reached = &mut reached[at.at() / LANES];
            require(!*reached, "two references point to the same node")?;
            *reached = true;
            if at.kind() == Kind::Time {
                let slices = self.arena.ints()[at.at()] as usize;
                require((1..=MAX_TIME_SLICES).contains(&slices), "a time node has no time slices or too many")?;
                require(at.at() + 1 + slices <= words, "a time node extends beyond the tree")?;
            } else {
                self.check_boxes(at, rows)?;
            }
            let before = stack.len();
            stack.extend(self.children(at).map(|child| (child, depth + 1)));
            // The stack of a query is as deep as the deepest leaf.
            require(stack.len() > before, "a node has no children")?;
            let missing = at.kind() == Kind::Time && stack.len() - before < self.slots(at).len();
            require(!missing, "a time node has no child for one of its time slices")?;
        }
        found.each_leaf_once();
        Ok(found)
    }

    /// Checks that faces are finite numbers in range, and that no query enters a lane without a child.
    fn check_boxes(&self, node: ChildRef, rows: usize) -> Result<(), FileError> {
        let faces = &self.arena.floats()[node.at()..][..(rows - 1) * LANES];
        // Without a branch for each, so that the comparisons are vectorized.
        let fine = faces.iter().fold(true, |fine, face| fine & (face.abs() <= NOWHERE));
        require(fine, "a box of a node has a coordinate that is not a number or out of range")?;
        for (lane, _) in self.slots(node).iter().enumerate().filter(|(_, child)| **child == ChildRef::NOTHING.0) {
            let nowhere = faces[lane..].iter().step_by(LANES).enumerate().all(|(row, &face)| match row {
                0 | 2 | 4 => face == NOWHERE,
                1 | 3 | 5 => face == -NOWHERE,
                _ => face == 0.0,
            });
            require(nowhere, "a node has a box in a lane without a child")?;
        }
        Ok(())
    }
}

/// The inputs of the check of leaf blocks.
struct LeafCheck<'a, S> {
    tree: &'a WideTree,
    words: &'a [u32],
    set: &'a S,
    triangles: Option<&'a Triangles>,
    /// Whether some of the triangles have more than two keys.
    bent: bool,
}

impl<S: WideSource> LeafCheck<'_, S> {
    fn check(&self, leaf: ChildRef) -> Result<(), FileError> {
        let Some(block) = self.words.get(leaf.at()..) else {
            return broken("a reference to a leaf block points outside the tree");
        };
        let listed = self.tree.is_list(leaf);
        let Some(triangles) = self.triangles.filter(|_| !listed) else {
            require(
                leaf.kind() == Kind::OtherLeaf && block.len() >= leaf.len(),
                "an id list has the wrong kind or extends beyond the tree",
            )?;
            self.check_spheres(block, leaf.len())?;
            let fine = block[..leaf.len()].iter().all(|&id| (id as usize) < self.set.len() && self.set.is_listed(id));
            return require(fine, "an id list has an id of no primitive, or of a triangle stored in leaf blocks");
        };
        let keys = match leaf.kind() {
            Kind::OtherLeaf => Some(self.check_keyed(leaf, block)?),
            Kind::SharedLeaf | Kind::SharedStaticLeaf => {
                self.check_shared(leaf, block, leaf.kind().leaf_rows() * leaf.len())?;
                None
            }
            // These have no vertex numbers or keys to check.
            _ => None,
        };
        let Some(ids) = ids_of_leaf(leaf, block, listed) else {
            return broken("a leaf block extends beyond the tree");
        };
        for &id in &block[ids] {
            require((id as usize) < triangles.len(), "a leaf block of triangles has an id of no triangle")?;
            let own = if self.bent { triangles.keys(id) } else { 2 };
            let fits = keys.map_or(own <= 2, |keys| own > 2 && own == keys);
            require(fits, "a leaf block has another number of keys than its triangles")?;
        }
        Ok(())
    }

    /// Checks what follows a list of `n` ids.
    fn check_spheres(&self, block: &[u32], n: usize) -> Result<(), FileError> {
        let whole = SphereLeaf::words_of_list(block, n).is_some();
        require(whole, "a list of shapes extends beyond the tree")?;
        let Some(leaf) = SphereLeaf::of(block, n) else { return Ok(()) };
        let SphereLeaf { keys, first, held, .. } = leaf;
        let fine = keys <= MAX_MESH_KEYS && (keys.min(2)..=keys).contains(&held) && first <= keys - held;
        require(fine && leaf.is_valid(block, n), "the range of keys of a block of spheres is invalid")
    }

    /// Checks the triangles of a block with shared vertices, whose vertex numbers begin at a word of the block.
    fn check_shared(&self, leaf: ChildRef, block: &[u32], at: usize) -> Result<(), FileError> {
        let Some(numbers) = block.get(at..) else { return broken("a leaf block extends beyond the tree") };
        let count = numbers.first().map_or(LANES, |&first| shared_count(first));
        require(numbers.len() >= 2 * count, "a leaf block extends beyond the tree")?;
        let there = |number: &u32| [0, 4, 8].iter().all(|shift| ((number >> shift & 15) as usize) < leaf.len());
        require(numbers[..count].iter().all(there), "a triangle has a vertex number that its leaf block does not have")
    }

    /// Checks a block of more than two keys; returns the number of keys of its triangles.
    fn check_keyed(&self, leaf: ChildRef, block: &[u32]) -> Result<usize, FileError> {
        let Some(header) = block.get(..3) else { return broken("a leaf block extends beyond the tree") };
        let keyed = KeyedLeaf::of(header, leaf.len());
        // So few that sums of words do not overflow.
        let fine = (2..=MAX_MESH_KEYS).contains(&keyed.segments) && (2..=keyed.segments + 1).contains(&keyed.keys);
        require(
            fine && keyed.first <= keyed.segments + 1 - keyed.keys,
            "the range of keys of a leaf block is invalid",
        )?;
        require(keyed.words() <= block.len(), "a leaf block extends beyond the tree")?;
        if keyed.shared {
            let count = shared_count(block[keyed.vertices()]);
            require(count == keyed.count, "a leaf block has two different numbers of triangles")?;
            self.check_shared(leaf, block, keyed.vertices())?;
        } else {
            require(keyed.count == leaf.len(), "a leaf block has two different numbers of triangles")?;
        }
        Ok(keyed.segments + 1)
    }
}
