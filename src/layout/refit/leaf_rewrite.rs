//! Rewriting the coordinates of leaf blocks, when a tree is refitted.

use crate::geometry::LinearBox3;
use crate::layout::leaf::keyed::KeyedLeaf;
use crate::layout::leaf::source::MovedLeaf;
use crate::layout::leaf::triangles::set_sizes;
use crate::layout::wide_node::{ChildRef, Kind};
use crate::primitive::{Shared, Triangles};
use crate::simd::{LANES, prefetch};

impl Triangles {
    /// Prefetches a block that will be rewritten, and its vertices.
    pub(in crate::layout) fn prefetch_leaf(&self, words: &[u32], leaf: ChildRef, ids: &[u32]) {
        if leaf.kind() != Kind::OtherLeaf {
            words[..leaf.kind().leaf_rows() * leaf.len()].chunks(LANES).for_each(|line| prefetch(&line[0]));
            return ids.iter().for_each(|&id| self.prefetch_positions(id));
        }
        let keyed = KeyedLeaf::of(words, leaf.len());
        words[..keyed.words()].chunks(LANES).for_each(|line| prefetch(&line[0]));
        let mut found = 0;
        for (&id, numbers) in ids.iter().zip(&words[keyed.vertices()..]) {
            for (i, vertex) in self.vertices(id).into_iter().enumerate() {
                // Vertices are numbered in the order in which they occur first.
                if !keyed.shared || (numbers >> (4 * i)) as usize % LANES == found {
                    found += 1;
                    self.prefetch_keys(vertex, keyed.first..keyed.first + keyed.keys);
                }
            }
        }
    }

    /// Rewrites the coordinates and sizes of a block, and returns the bounds of its triangles; `None` if no coordinate changed.
    pub(in crate::layout) fn rewrite_leaf(&self, words: &mut [u32], of: MovedLeaf<'_>) -> Option<LinearBox3> {
        let MovedLeaf { leaf, ids, level, .. } = of;
        let n = leaf.len();
        let again = |words: &[u32], numbers: usize| Shared::again(self, ids, &words[numbers..], n);
        // What follows the rows: the sizes, or the vertex numbers, whose first word has them too.
        let behind = leaf.kind().leaf_rows() * n;
        let (changed, sizes) = match leaf.kind() {
            Kind::StaticLeaf => (self.fill_own(words, ids, 1), behind),
            Kind::Leaf => (self.fill_own(words, ids, 2), behind),
            Kind::SharedStaticLeaf => (again(words, behind).fill(self, words, 1), behind),
            Kind::SharedLeaf => (again(words, behind).fill(self, words, 2), behind),
            Kind::OtherLeaf => {
                let keyed = KeyedLeaf::of(words, n);
                let shared = keyed.shared.then(|| again(words, keyed.vertices()));
                (self.fill_keyed(words, &keyed, ids, shared.as_ref(), level), keyed.vertices())
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
