//! The position of the ids in leaf blocks of all kinds.

use super::keyed_leaf::KeyedLeaf;
use super::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS, shared_count};

/// The position of the ids of a leaf block.
pub(crate) struct Ids {
    /// The first, relative to the beginning of the block.
    pub first: usize,
    pub count: usize,
}

impl Ids {
    /// The position in a block that begins at `words[0]`; `lists` tells whether leaves of kind `OtherLeaf` are lists of
    /// ids. `None` if the block is incomplete.
    pub fn of(leaf: ChildRef, words: &[u32], lists: bool) -> Option<Ids> {
        let len = leaf.len();
        if leaf.kind() == Kind::OtherLeaf && !lists {
            let keyed = KeyedLeaf::of(words.get(..3)?, len);
            return (keyed.words() <= words.len()).then(|| Ids { first: keyed.ids(), count: keyed.count });
        }
        // Behind the rows and the sizes.
        let loose = |rows: usize| Ids { first: rows * len + 1, count: len };
        let shared = |rows: usize| {
            let corners = rows * len;
            let count = shared_count(*words.get(corners)?);
            Some(Ids { first: corners + count, count })
        };
        let ids = match leaf.kind() {
            Kind::Node | Kind::StaticNode | Kind::Time => return None,
            Kind::Leaf => loose(2 * CORNER_ROWS),
            Kind::StaticLeaf => loose(CORNER_ROWS),
            Kind::SharedLeaf => shared(2 * VERTEX_ROWS)?,
            Kind::SharedStaticLeaf => shared(VERTEX_ROWS)?,
            Kind::OtherLeaf => Ids { first: 0, count: len },
        };
        (ids.first + ids.count <= words.len()).then_some(ids)
    }
}
