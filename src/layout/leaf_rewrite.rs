//! Rewriting the coordinates of leaf blocks, when a tree is refitted.

use super::keyed_leaf::KeyedLeaf;
use super::leaf_block::{MovedLeaf, Shared, set_sizes};
use super::wide_node::{CORNER_ROWS, Kind, VERTEX_ROWS};
use crate::geometry::LinearBox3;
use crate::primitive::Triangles;

impl Triangles {
    /// Rewrites the coordinates and sizes of a block, and returns the bounds of its triangles; `None` if no coordinate changed.
    pub(super) fn rewrite_leaf(&self, words: &mut [u32], of: MovedLeaf<'_>) -> Option<LinearBox3> {
        let MovedLeaf { leaf, ids, .. } = of;
        let n = leaf.len();
        let again = |words: &[u32], numbers: usize| Shared::again(self, ids, &words[numbers..], n);
        // The word that the sizes share, or have for themselves, too.
        let (changed, sizes) = match leaf.kind() {
            Kind::StaticLeaf => (self.fill_own(words, ids, 1), CORNER_ROWS * n),
            Kind::Leaf => (self.fill_own(words, ids, 2), 2 * CORNER_ROWS * n),
            Kind::SharedStaticLeaf => (again(words, VERTEX_ROWS * n).fill(self, words, 1), VERTEX_ROWS * n),
            Kind::SharedLeaf => (again(words, 2 * VERTEX_ROWS * n).fill(self, words, 2), 2 * VERTEX_ROWS * n),
            Kind::OtherLeaf => {
                let keyed = KeyedLeaf::of(words, n);
                let shared = keyed.shared.then(|| again(words, keyed.vertices()));
                (self.fill_keyed(words, &keyed, ids, shared.as_ref()), keyed.vertices())
            }
            Kind::Node | Kind::StaticNode | Kind::Time => return None,
        };
        changed.then(|| {
            let measured = self.measured(words, of);
            set_sizes(&mut words[sizes], measured.sizes);
            measured.bounds
        })
    }
}
