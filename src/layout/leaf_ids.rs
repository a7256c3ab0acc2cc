//! The position of the ids in leaf blocks of all kinds.

use super::keyed_leaf::KeyedLeaf;
use super::wide_node::{ChildRef, Kind, shared_count};

/// The position of the ids of a leaf block.
pub(crate) struct Ids {
    /// The first, relative to the beginning of the block.
    pub first: usize,
    pub count: usize,
}

impl Ids {
    /// The position in a block that begins at `words[0]`; `lists` tells whether leaves of kind `OtherLeaf` are lists of
    /// ids. `None` if the block is incomplete.
    #[inline]
    pub fn of(leaf: ChildRef, words: &[u32], lists: bool) -> Option<Ids> {
        let len = leaf.len();
        if leaf.kind() == Kind::OtherLeaf && !lists {
            let keyed = KeyedLeaf::of(words.get(..3)?, len);
            return (keyed.words() <= words.len()).then(|| Ids { first: keyed.ids(), count: keyed.count });
        }
        let rows = leaf.kind().leaf_rows() * len;
        let ids = match leaf.kind() {
            Kind::Node | Kind::StaticNode | Kind::Time => return None,
            // Behind the rows and the sizes.
            Kind::Leaf | Kind::StaticLeaf => Ids { first: rows + 1, count: len },
            // Behind the rows and the numbers of vertices.
            Kind::SharedLeaf | Kind::SharedStaticLeaf => {
                let count = shared_count(*words.get(rows)?);
                Ids { first: rows + count, count }
            }
            Kind::OtherLeaf => Ids { first: 0, count: len },
        };
        (ids.first + ids.count <= words.len()).then_some(ids)
    }
}
