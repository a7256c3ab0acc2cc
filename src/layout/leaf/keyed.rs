//! Leaf blocks of triangles whose motion has more than two keys.
//!
//! A block stores each key once that its queries may need, in order of time. A query reads the rows of the two keys around its
//! time. The front of the block holds what does not depend on time. Its size follows from the reference to the block. So the
//! reference and the time alone determine the position of the rows ([`KeyedRows`]), and a query prefetches them together with the
//! front:
//!
//! | words | |
//! |---|---|
//! | 3 | number of segments between the mesh's keys; first key in the block; numbers of keys and of triangles, and the form |
//! | n | with shared vertices: the three vertices of each triangle, as in other blocks |
//! | 1 | without shared vertices: the sizes (see [`crate::layout::wide_node`]) |
//! | n | ids |
//! | | unused, up to word 35, or up to word 3 + 4 w if rows have w < 8 numbers and there are at most 2 w triangles |
//! | rows | for each key: x y z of v vertices, or nine rows of n corners |

use super::key_rows::KeyRows;
use super::source::WideSource;
use super::triangles::{set_sizes, write_corners};
use crate::geometry::KeyTime;
use crate::layout::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS};
use crate::primitive::{Shared, Triangles};
use crate::simd::{Arena, LANES, SimdLevel, dispatch};

/// The header of such a block.
#[derive(Clone, Copy)]
pub(crate) struct KeyedLeaf {
    /// Segments between the keys of the mesh.
    pub segments: usize,
    /// The first key in the block, and the number of keys in it.
    pub first: usize,
    pub keys: usize,
    /// Whether vertices are shared.
    pub shared: bool,
    /// Number of triangles.
    pub count: usize,
    /// The number of floats in a row: vertices, or triangles.
    pub width: usize,
}

/// Words of the header.
const HEADER: usize = 3;

/// The number of words in front of rows of `width` numbers, if there are at most `2 * width` triangles.
#[inline(always)]
fn front(width: usize) -> usize {
    HEADER + 2 * LANES.min(2 * width)
}

impl KeyedLeaf {
    /// A block of `count` triangles with `keys` keys each, which holds the keys of the segments from `first` to `last`.
    pub fn new(shared: Option<&Shared>, count: usize, keys: usize, [first, last]: [usize; 2]) -> KeyedLeaf {
        let width = shared.map_or(count, |shared| shared.count);
        KeyedLeaf { segments: keys - 1, first, keys: last + 2 - first, shared: shared.is_some(), count, width }
    }

    /// Reads the header of a leaf block; `words` are those of the arena.
    #[inline(always)]
    pub fn read(words: &[u32], leaf: ChildRef) -> KeyedLeaf {
        KeyedLeaf::of(&words[leaf.at()..leaf.at() + HEADER], leaf.len())
    }

    /// Decodes the first three words of a block; `width` is the length in the reference to it.
    #[inline(always)]
    pub fn of(words: &[u32], width: usize) -> KeyedLeaf {
        let (segments, first, form) = (words[0], words[1], words[2]);
        KeyedLeaf {
            segments: segments as usize,
            first: first as usize,
            keys: (form >> 5) as usize,
            shared: form & 1 != 0,
            count: (form >> 1) as usize % LANES + 1,
            width,
        }
    }

    /// The offset of the vertex numbers of the triangles from the begin of the block.
    #[inline(always)]
    pub fn vertices(&self) -> usize {
        HEADER
    }

    /// The offset of the ids from the begin of the block.
    #[inline(always)]
    pub fn ids(&self) -> usize {
        HEADER + if self.shared { self.count } else { 1 }
    }

    /// The offset of the rows of the key at which a segment begins; the rows of the next key follow. For a segment that is not in
    /// the block, the offset of some rows of the block.
    #[inline(always)]
    pub fn rows(&self, segment: usize) -> usize {
        let key = segment.saturating_sub(self.first).min(self.keys.saturating_sub(2));
        self.front() + key * self.key_words()
    }

    /// The number of words in front of the rows.
    #[inline(always)]
    pub fn front(&self) -> usize {
        front(self.width).max(HEADER + 2 * self.count)
    }

    /// The number of words of one key.
    #[inline(always)]
    pub fn key_words(&self) -> usize {
        self.width * if self.shared { VERTEX_ROWS } else { CORNER_ROWS }
    }

    /// The number of words of the whole block.
    pub fn words(&self) -> usize {
        self.front() + self.keys * self.key_words()
    }

    /// Whether the block has all keys of the segments from `first` to `last`.
    pub fn holds(&self, [first, last]: [usize; 2]) -> bool {
        self.first <= first && last + 1 < self.first + self.keys
    }
}

/// How most of a tree's blocks with many keys divide the shutter. With this, a query can prefetch the rows of a block before it has
/// read anything of the block. For other blocks the position may be wrong, which costs time and nothing else.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KeyedRows {
    /// Segments between keys; 0 if there are no such blocks.
    segments: u32,
    /// The number of time slices with blocks of their own.
    slices: u32,
}

/// The number of primitives whose number of keys is sampled.
const SAMPLES: usize = 64;

impl KeyedRows {
    /// For a tree whose leaf blocks hold the primitives `ids` of a set.
    pub fn of<S: WideSource>(set: &S, ids: &[u32], slices: usize) -> KeyedRows {
        let sampled = ids.iter().step_by(ids.len() / SAMPLES + 1).filter(|&&id| set.sphere(id).is_none());
        let kinds = sampled.map(|&id| set.leaf_kind(id));
        let mut keys: Vec<u32> = kinds.filter(|&keys| keys > 2).collect();
        keys.sort_unstable();
        let most = keys.chunk_by(|a, b| a == b).max_by_key(|same| same.len());
        KeyedRows { segments: most.map_or(0, |same| same[0] - 1), slices: slices as u32 }
    }

    /// The key within a block at which the rows for a time begin; `None` if there are no such blocks.
    #[inline(always)]
    pub fn at(self, time: f32) -> Option<u32> {
        let KeyedRows { segments, slices } = self;
        if segments == 0 {
            return None;
        }
        let slice = KeyTime::new(time, slices as usize + 1).segment as u32;
        let segment = KeyTime::new(time, segments as usize + 1).segment as u32;
        Some(segment.saturating_sub(slice * segments / slices.max(1)))
    }

    /// The word of the arena at which the rows of the block's key number `key` begin, in a block with shared vertices.
    #[inline(always)]
    pub fn begin(block: ChildRef, key: u32) -> usize {
        block.at() + front(block.len()) + key as usize * VERTEX_ROWS * block.len()
    }
}

impl Triangles {
    /// The number of words of a block of so many triangles, as [`Triangles::write_keyed`] writes it.
    pub(in crate::layout) fn keyed_words(
        &self,
        shared: Option<&Shared>,
        count: usize,
        keys: usize,
        segments: [usize; 2],
    ) -> usize {
        KeyedLeaf::new(shared, count, keys, segments).words()
    }

    /// Writes a block of triangles with `keys` keys each. The block holds the keys of the segments from `first` to `last`. Returns
    /// `None` if the arena is full.
    pub(in crate::layout) fn write_keyed(
        &self,
        arena: &mut Arena,
        ids: &[u32],
        keys: usize,
        [first, last]: [usize; 2],
    ) -> Option<ChildRef> {
        let shared = Shared::of(self, ids);
        let leaf = KeyedLeaf::new(shared.as_ref(), ids.len(), keys, [first, last]);
        let KeyedLeaf { segments, keys: held, count, width, .. } = leaf;
        let at = arena.grow(leaf.words());
        let form = (held as u32) << 5 | (count as u32 - 1) << 1 | u32::from(leaf.shared);
        let words = &mut arena.ints_mut()[at..];
        words[..HEADER].copy_from_slice(&[segments as u32, first as u32, form]);
        if let Some(shared) = &shared {
            words[leaf.vertices()..][..count].copy_from_slice(&shared.corners[..count]);
            words[leaf.vertices()] |= (count as u32 - 1) << 12;
        }
        words[leaf.ids()..][..count].copy_from_slice(ids);
        let level = SimdLevel::best();
        self.fill_keyed(words, &leaf, ids, shared.as_ref(), level);
        let sizes = leaf.sizes(words, level);
        // The lower half of this word holds the vertices of the first triangle, or zero.
        set_sizes(&mut words[leaf.vertices()], sizes);
        ChildRef::new(Kind::OtherLeaf, at, width)
    }

    /// Writes the coordinates of a block; returns whether any changed.
    pub(in crate::layout) fn fill_keyed(
        &self,
        words: &mut [u32],
        leaf: &KeyedLeaf,
        ids: &[u32],
        shared: Option<&Shared>,
        level: SimdLevel,
    ) -> bool {
        let words = &mut words[leaf.front()..leaf.words()];
        if let Some(shared) = shared {
            let (coordinates, begins) = shared.runs(self, leaf.first);
            return dispatch(level, KeyRows { words, coordinates, begins, rows: VERTEX_ROWS * leaf.keys });
        }
        let mut changed = 0;
        for (lane, &id) in ids.iter().enumerate() {
            // Looked up once for all keys.
            let (stride, corners) = (self.stride(id), self.vertices(id));
            for (rows, key) in words.chunks_exact_mut(leaf.key_words()).zip(leaf.first..) {
                let [a, b, c] = corners;
                let at = |vertex: u32| self.position(vertex, key * stride);
                changed |= write_corners(rows, leaf.count, lane, [at(a), at(b), at(c)]);
            }
        }
        changed != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Frame;
    use crate::layout::WideTree;
    use crate::params::{Division, WideParams};
    use crate::primitive::{Scene, no_shapes};
    use crate::progress::Progress;
    use crate::scene;

    #[test]
    fn rows_are_prefetched_at_their_position() {
        let set = Scene::new(&scene::turning(3000, 17).meshes, no_shapes()).expect("a scene");
        for division in [Division::Automatic, Division::Whole, Division::SharedLeaves(4), Division::SeparateTrees(4)] {
            let params = WideParams { division, ..WideParams::default() };
            let tree = WideTree::build(&set, &params, &Progress::new(None)).expect("a tree");
            let mut blocks = 0;
            for time in [0.0, 0.03, 0.249, 0.25, 0.5, 0.77, 1.0] {
                let key = tree.keyed_rows.at(time).expect("blocks of many keys");
                tree.boxes(time, Frame::WORLD, 1, &mut |b, leaf| {
                    let keyed = KeyedLeaf::read(tree.arena.ints(), leaf);
                    if b.leaf && keyed.shared && keyed.count <= 2 * leaf.len() {
                        let rows = leaf.at() + keyed.rows(KeyTime::new(time, keyed.segments + 1).segment);
                        assert_eq!(KeyedRows::begin(leaf, key), rows, "{division:?} at {time}");
                        blocks += 1;
                    }
                });
            }
            assert!(blocks > 100, "{blocks}");
        }
    }
}
