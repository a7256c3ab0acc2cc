//! The wide layout in files: its blocks as they are in memory, and the fields that cannot be derived from them.

use super::leaf::source::WideSource;
use super::wide_node::ChildRef;
use super::wide_tree::WideTree;
use crate::file::{Decoder, Encoder, FileError};
use crate::layout::leaf::keyed::KeyedRows;
use crate::simd::{Arena, LANES};

/// Words of one cache line.
type Words = [u32; LANES];

impl WideTree {
    /// Writes the fields, and all blocks.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put([self.root.0, u32::from(self.presplit), self.slices as u32])?;
        // There may be no lists.
        to.put(if self.lists == usize::MAX { u64::MAX } else { self.lists as u64 })?;
        to.array::<Words>(self.arena.ints()[..self.arena.len()].as_chunks().0)
    }

    /// Reads a written tree; nothing of it is checked.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<WideTree, FileError> {
        let [root, presplit, slices] = from.get::<[u32; 3]>()?;
        let lists = usize::try_from(from.get::<u64>()?).unwrap_or(usize::MAX);
        let count = from.count::<Words>()?;
        let mut arena = Arena::default();
        // With the padding lines that follow the last block.
        arena.reserve_exact((from.room::<Words>(count) + LANES) * LANES);
        from.items::<Words>(count, &mut arena)?;
        let (root, presplit, slices) = (ChildRef(root), presplit != 0, slices as usize);
        Ok(WideTree { arena, root, presplit, slices, ..WideTree::empty(lists) })
    }

    /// Returns the tree, indexed, if queries can traverse it safely.
    pub(crate) fn checked<S: WideSource>(mut self, set: &S) -> Result<WideTree, FileError> {
        (self.counts, self.blocks) = self.check(set)?;
        self.near = self.fine_within();
        self.arena.compact();
        self.summarize_blocks(set);
        let held: Vec<u32> =
            (0..set.len() as u32).step_by(set.len() / 1024 + 1).filter(|&id| !set.is_listed(id)).collect();
        self.keyed_rows = KeyedRows::of(set, &held, self.slices);
        Ok(self)
    }
}
