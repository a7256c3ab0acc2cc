//! The k-d layout in files: nodes and references as they lie in memory.

use super::kd_tree::{KdNode, KdReference, KdTree};
use crate::file::{Decoder, Encoder, FileError, Record};
use crate::geometry::Box3;

impl Record for KdNode {
    const BYTES: usize = 12;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        self.to_words().put(to);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> KdNode {
        KdNode::of_words(Record::get(from))
    }
}

impl Record for KdReference {
    const BYTES: usize = 12;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        [self.id, self.begin.to_bits(), self.end.to_bits()].put(to);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> KdReference {
        let [id, begin, end] = <[u32; 3]>::get(from);
        KdReference { id, begin: f32::from_bits(begin), end: f32::from_bits(end) }
    }
}

impl KdTree {
    /// Writes the whole tree.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.root.encode(to)?;
        to.put(self.depth)?;
        to.array(&self.nodes)?;
        to.array(&self.references)
    }

    /// Reads what was written; nothing of it is checked.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<KdTree, FileError> {
        let root = Box3::decode(from)?;
        Ok(KdTree { root, depth: from.get()?, nodes: from.array()?, references: from.array()? })
    }
}
