//! The position of the ids in leaf blocks of all kinds.

use super::keyed::KeyedLeaf;
use crate::layout::wide_node::{ChildRef, Kind, shared_count};
use core::ops::Range;

/// The words of the ids of a leaf block that begins at `words[0]`; `list` tells whether a leaf of kind `OtherLeaf` is a list of
/// ids. `None` if the block is incomplete.
#[inline]
pub(in crate::layout) fn ids_of_leaf(leaf: ChildRef, words: &[u32], list: bool) -> Option<Range<usize>> {
    let len = leaf.len();
    let rows = leaf.kind().leaf_rows() * len;
    let (first, count) = match leaf.kind() {
        Kind::Node | Kind::StaticNode | Kind::Time => return None,
        // Behind the rows and the sizes.
        Kind::Leaf | Kind::StaticLeaf => (rows + 1, len),
        // Behind the rows and the numbers of vertices.
        Kind::SharedLeaf | Kind::SharedStaticLeaf => {
            let count = shared_count(*words.get(rows)?);
            (rows + count, count)
        }
        Kind::OtherLeaf if list => (0, len),
        Kind::OtherLeaf => {
            let keyed = KeyedLeaf::of(words.get(..3)?, len);
            return (keyed.words() <= words.len()).then(|| keyed.ids()..keyed.ids() + keyed.count);
        }
    };
    (first + count <= words.len()).then_some(first..first + count)
}
