//! The k-d layout in files: nodes and references as they are in memory.

use super::kd_tree::KdTree;
use crate::file::{Decoder, Encoder, FileError};

impl KdTree {
    /// Writes the whole tree.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.root)?;
        to.put(self.depth)?;
        to.array(&self.nodes)?;
        to.array(&self.references)
    }

    /// Reads a tree that [`KdTree::encode`] wrote, without validating it.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<KdTree, FileError> {
        Ok(KdTree { root: from.get()?, depth: from.get()?, nodes: from.array()?, references: from.array()? })
    }
}
