//! Writing nodes into the arena.
//!
//! Subtrees up to a fixed size are written separately by any thread and concatenated ([`super::assemble`]). The few
//! nodes above them follow.

use super::assemble::{FIRST, Fragment, write_in_order};
use crate::bvh::{BinaryNode, Collapse, WideChild, mean_half_area};
use crate::error::BuildError;
use crate::geometry::{LinearBox3, TimeInterval};
use crate::layout::node_boxes::BoxRows;
use crate::layout::wide_node::{ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS, children_mut};
use crate::progress::Progress;
use crate::simd::{Arena, LANES, Mask, SimdLevel};
use crate::tuning::wide::BYTES_PER_REFERENCE;

/// Writes the node's boxes and returns its reference; the children follow with [`set_children`].
pub(crate) fn write_node(arena: &mut Arena, boxes: &[LinearBox3], over: TimeInterval) -> Result<ChildRef, BuildError> {
    let moving = boxes.iter().any(|b| b.begin != b.end);
    let rows = if moving { NODE_ROWS } else { STATIC_NODE_ROWS };
    arena.align();
    let at = arena.grow(rows * LANES);
    let kind = if moving { Kind::Node } else { Kind::StaticNode };
    let node = ChildRef::new(kind, at, 1).ok_or(BuildError::TooLargeTree)?;
    let words = &mut arena.ints_mut()[at..at + rows * LANES];
    let mut rows = BoxRows::NONE;
    boxes.iter().enumerate().for_each(|(lane, of)| rows.set(lane, of));
    rows.write(words, kind, Mask::MAX, over, SimdLevel::best());
    Ok(node)
}

/// Fills in the children of a node.
pub(crate) fn set_children(arena: &mut Arena, node: ChildRef, children: &[ChildRef]) {
    let all = children.iter().chain(core::iter::repeat(&ChildRef::NOTHING));
    for (word, child) in children_mut(arena, node).iter_mut().zip(all) {
        *word = child.0;
    }
}

/// Writes a time node over equal time slices of the shutter.
pub(crate) fn write_time(arena: &mut Arena, slices: &[ChildRef]) -> Result<ChildRef, BuildError> {
    arena.align();
    let at = arena.grow(1 + slices.len());
    arena.ints_mut()[at] = slices.len() as u32;
    for (i, slice) in slices.iter().enumerate() {
        arena.ints_mut()[at + 1 + i] = slice.0;
    }
    ChildRef::new(Kind::Time, at, 1).ok_or(BuildError::TooLargeTree)
}

/// Subtrees with fewer references are written separately. Fixed, so that the arena does not depend on threads.
const MAX_FRAGMENT: u32 = 4096;

/// Gives the leaf blocks of binary nodes. Called through `dyn`, so that the code that writes nodes is compiled once.
pub(crate) type LeafWriter<'a> =
    &'a (dyn Fn(&mut Arena, &[BinaryNode], &mut [ChildRef]) -> Result<(), BuildError> + Sync);

/// Leaf blocks that are written per task: with many keys they are large, and a task should stay in a near cache.
const BLOCKS: usize = 32;

/// Writes a leaf block for each of some binary nodes, of so many words each, and returns them in order. The caller will append
/// `further` words.
pub(crate) fn write_blocks(
    arena: &mut Arena,
    of: &[BinaryNode],
    words: &[u32],
    further: usize,
    leaves: LeafWriter<'_>,
    progress: &Progress,
) -> Result<Vec<ChildRef>, BuildError> {
    let progress = progress.in_units(of.len());
    let tasks: Vec<&[BinaryNode]> = of.chunks(BLOCKS).collect();
    let write = |task: usize, fragment: &mut Fragment| {
        progress.check()?;
        progress.finished(tasks[task].len() as f64);
        fragment.tops.resize(tasks[task].len(), ChildRef::NOTHING);
        leaves(&mut fragment.arena, tasks[task], &mut fragment.tops)
    };
    let sizes: Vec<u32> =
        words.chunks(BLOCKS).map(|words| words.iter().fold(0, |sum: u32, &of| sum.saturating_add(of))).collect();
    write_in_order(arena, &sizes, further, 1, &|_| true, &write)
}

/// The words of the nodes of a collapsed binary tree without their leaf blocks.
pub(crate) fn words_of_nodes(binary: &[BinaryNode], collapse: &Collapse) -> usize {
    let (mut words, mut children) = (0, Vec::with_capacity(LANES));
    let mut inner = if collapse.is_leaf(0) { vec![] } else { vec![0] };
    while let Some(x) = inner.pop() {
        let rows = if binary[x as usize].moving { NODE_ROWS } else { STATIC_NODE_ROWS };
        words += rows * LANES;
        collapse.children(binary, x, &mut children);
        inner.extend(children.iter().filter(|c| !c.leaf).map(|c| c.node));
    }
    words
}

/// Writes the nodes of a collapsed binary tree, each directly followed by its leaf blocks, and returns the root. The
/// nodes above the separately written subtrees come last.
pub(crate) struct Nodes<'a> {
    pub binary: &'a [BinaryNode],
    pub collapse: &'a Collapse,
    pub over: TimeInterval,
    pub leaves: LeafWriter<'a>,
    /// Whether `leaves` writes the blocks, or returns blocks that are in the final arena already.
    pub writes: bool,
    pub progress: &'a Progress<'a>,
}

impl Nodes<'_> {
    /// Writes the whole tree (which must not be empty).
    pub fn write(&self, arena: &mut Arena) -> Result<ChildRef, BuildError> {
        if self.collapse.is_leaf(0) {
            let mut block = ChildRef::NOTHING;
            (self.leaves)(arena, &self.binary[..1], core::slice::from_mut(&mut block))?;
            return Ok(block);
        }
        let mut roots = Vec::new();
        self.find_fragments(0, &mut roots);
        // Moving subtrees take about twice as much.
        let size = |node: &BinaryNode| node.count * (1 + u32::from(node.moving));
        let sizes: Vec<u32> = roots.iter().map(|&root| size(&self.binary[root as usize])).collect();
        // Time nodes are not written here: they are in the final arena already.
        let inside = |child: ChildRef| child.kind() != Kind::Time && (self.writes || !child.kind().is_leaf());
        let progress = self.progress.in_units(self.binary[0].count as usize);
        let write = |i: usize, fragment: &mut Fragment| {
            progress.check()?;
            progress.finished(self.binary[roots[i] as usize].count.into());
            if let [root] = roots[..] {
                let bytes = BYTES_PER_REFERENCE * self.binary[root as usize].count as f32;
                fragment.arena.reserve(bytes as usize / size_of::<u32>());
            }
            let root = self.node(&mut fragment.arena, roots[i], &mut fragment.nodes, &mut None)?;
            fragment.tops.push(root);
            Ok(())
        };
        let done = write_in_order(arena, &sizes, 0, FIRST, &inside, &write)?;
        self.node(arena, 0, &mut Vec::new(), &mut Some(done.into_iter()))
    }

    /// The subtrees to be written separately, in the order in which [`Nodes::node`] reaches them.
    fn find_fragments(&self, of: u32, roots: &mut Vec<u32>) {
        if self.binary[of as usize].count <= MAX_FRAGMENT {
            roots.push(of);
            return;
        }
        for child in self.children(of).iter().filter(|c| !c.leaf) {
            self.find_fragments(child.node, roots);
        }
    }

    /// The children of a node in the order of its lanes.
    ///
    /// Occlusion queries visit the highest lane first. So leaf blocks come last, the largest at the very end: those
    /// most likely end such a query soonest.
    fn children(&self, of: u32) -> Vec<WideChild> {
        let mut children = Vec::with_capacity(LANES);
        self.collapse.children(self.binary, of, &mut children);
        let mut keyed = [((false, 0), children[0]); LANES];
        for (keyed, c) in keyed.iter_mut().zip(&children) {
            let node = &self.binary[c.node as usize];
            // A node that is too large for a block is a replaced subtree, written before.
            let block = c.leaf && node.count as usize <= LANES;
            *keyed = ((block, mean_half_area(&node.bounds).to_bits()), *c);
        }
        keyed[..children.len()].sort_by_key(|keyed| keyed.0);
        children.iter_mut().zip(keyed).for_each(|(child, keyed)| *child = keyed.1);
        children
    }

    /// Writes a node and its subtree; the subtrees in `written` are in place already. The recursion is as deep as the
    /// wide tree, which the binary build bounds.
    fn node(
        &self,
        arena: &mut Arena,
        of: u32,
        nodes: &mut Vec<ChildRef>,
        written: &mut Option<std::vec::IntoIter<ChildRef>>,
    ) -> Result<ChildRef, BuildError> {
        if self.binary[of as usize].count <= MAX_FRAGMENT
            && let Some(done) = written.as_mut().and_then(Iterator::next)
        {
            return Ok(done);
        }
        let children = self.children(of);
        let mut boxes = [LinearBox3::EMPTY; LANES];
        boxes.iter_mut().zip(&children).for_each(|(own, c)| *own = self.binary[c.node as usize].bounds);
        let node = write_node(arena, &boxes[..children.len()], self.over)?;
        nodes.push(node);
        let mut blocks = self.blocks(arena, &children)?.into_iter();
        let mut refs = [ChildRef::NOTHING; LANES];
        for (below, child) in refs.iter_mut().zip(&children) {
            *below = match child.leaf {
                true => blocks.next().unwrap_or(ChildRef::NOTHING),
                false => self.node(arena, child.node, nodes, written)?,
            };
        }
        set_children(arena, node, &refs);
        Ok(node)
    }

    /// The leaf blocks among the children of a node, in order.
    fn blocks(&self, arena: &mut Arena, children: &[WideChild]) -> Result<[ChildRef; LANES], BuildError> {
        let (mut leaves, mut blocks) = ([self.binary[0]; LANES], [ChildRef::NOTHING; LANES]);
        let mut n = 0;
        for child in children.iter().filter(|child| child.leaf) {
            leaves[n] = self.binary[child.node as usize];
            n += 1;
        }
        (self.leaves)(arena, &leaves[..n], &mut blocks[..n])?;
        Ok(blocks)
    }
}
