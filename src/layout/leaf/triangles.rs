//! Leaf blocks of triangles: writing those of at most two keys, and what they have in common with those of more
//! ([`super::keyed`]).

use super::needed_segments::needed_segments;
use crate::layout::wide_node::{CORNER_ROWS, ChildRef, Kind, Sizes, VERTEX_ROWS};
use crate::primitive::{Shared, Triangles};
use crate::simd::{Arena, LANES, Lanes};
use crate::time::TimeSlice;
use core::ops::Range;
use glam::Vec3;

impl Triangles {
    /// The number of words of a block of triangles.
    pub(in crate::layout) fn leaf_words(&self, ids: &[u32], slice: TimeSlice) -> usize {
        let (n, most) = (ids.len(), ids.iter().map(|&id| self.keys(id)).max().unwrap_or(1));
        let shared = Shared::of(self, ids);
        if most > 2 {
            return self.keyed_words(shared.as_ref(), n, most, needed_segments(self, ids, most, slice));
        }
        shared.map_or(most * CORNER_ROWS * n + 1 + n, |shared| most * VERTEX_ROWS * shared.count + 2 * n)
    }

    /// Writes a block of triangles.
    pub(in crate::layout) fn write_leaf(&self, arena: &mut Arena, ids: &[u32], slice: TimeSlice) -> Option<ChildRef> {
        let most = ids.iter().map(|&id| self.keys(id)).max().unwrap_or(1);
        let n = ids.len();
        arena.align();
        if most > 2 {
            return self.write_keyed(arena, ids, most, needed_segments(self, ids, most, slice));
        }
        if let Some(shared) = Shared::of(self, ids) {
            return shared.write(self, arena, ids, most);
        }
        let (kind, rows) = match most {
            1 => (Kind::StaticLeaf, CORNER_ROWS),
            _ => (Kind::Leaf, 2 * CORNER_ROWS),
        };
        let at = arena.grow(rows * n + 1 + n);
        let words = &mut arena.ints_mut()[at..];
        words[rows * n + 1..][..n].copy_from_slice(ids);
        self.fill_own(words, ids, rows / CORNER_ROWS);
        words[rows * n] = self.sizes(ids, 0..rows / CORNER_ROWS);
        ChildRef::new(kind, at, n)
    }

    /// Writes the corners of a block without shared vertices; returns whether any changed.
    pub(in crate::layout) fn fill_own(&self, words: &mut [u32], ids: &[u32], keys: usize) -> bool {
        let n = ids.len();
        let (first_key, others) = words.split_at_mut(CORNER_ROWS * n);
        let mut changed = 0;
        for (lane, &id) in ids.iter().enumerate() {
            let [first, last] = self.corners_at_both(id);
            changed |= write_corners(first_key, n, lane, first);
            if keys > 1 {
                changed |= write_corners(&mut others[..CORNER_ROWS * n], n, lane, last);
            }
        }
        changed != 0
    }

    /// The sizes of a block of some triangles at some keys (see [`Sizes`]).
    pub(in crate::layout) fn sizes(&self, ids: &[u32], keys: Range<usize>) -> u32 {
        let mut sizes = Sizes::default();
        for &id in ids {
            // Looked up once for all keys.
            let (stride, [a, b, c]) = (self.stride(id), self.vertices(id));
            let of = |vertex: u32| self.run(vertex, stride, keys.clone());
            for ((&a, &b), &c) in of(a).zip(of(b)).zip(of(c)) {
                sizes.include(a, b, c);
            }
        }
        sizes.word()
    }
}

impl Shared {
    /// Reconstructed from a block that was written for the same triangles; `numbers` begins with the row of vertex
    /// numbers, and there are `count` vertices.
    pub(in crate::layout) fn again(set: &Triangles, ids: &[u32], numbers: &[u32], count: usize) -> Shared {
        let mut shared = Shared { vertices: [0; LANES], strides: [0; LANES], count, corners: [0; LANES] };
        for (&id, &corners) in ids.iter().zip(numbers) {
            let [a, b, c] = set.vertices(id);
            let place = |i: usize| (corners >> (4 * i)) as usize % LANES;
            (shared.vertices[place(0)], shared.vertices[place(1)], shared.vertices[place(2)]) = (a, b, c);
        }
        match set.common_stride(ids) {
            Some(stride) => shared.strides = [stride; LANES],
            None => {
                for ((&corners, stride), _) in numbers.iter().zip(set.strides(ids)).zip(ids) {
                    for i in 0..3 {
                        shared.strides[(corners >> (4 * i)) as usize % LANES] = stride;
                    }
                }
            }
        }
        shared
    }

    /// Writes the block, of one or two keys.
    fn write(&self, set: &Triangles, arena: &mut Arena, ids: &[u32], keys: usize) -> Option<ChildRef> {
        let (v, n) = (self.count, ids.len());
        let row = keys * VERTEX_ROWS * v;
        let at = arena.grow(row + 2 * n);
        let words = &mut arena.ints_mut()[at..];
        let numbers = &mut words[row..row + 2 * n];
        numbers[..n].copy_from_slice(&self.corners[..n]);
        numbers[0] |= (n as u32 - 1) << 12;
        numbers[n..].copy_from_slice(ids);
        self.fill(set, words, keys);
        set_sizes(&mut words[row], set.sizes(ids, 0..keys));
        ChildRef::new(if keys == 1 { Kind::SharedStaticLeaf } else { Kind::SharedLeaf }, at, v)
    }

    /// Writes the vertices of such a block; returns whether any changed.
    pub(in crate::layout) fn fill(&self, set: &Triangles, words: &mut [u32], keys: usize) -> bool {
        let each = words.chunks_exact_mut(VERTEX_ROWS * self.count).take(keys).enumerate();
        each.fold(0, |changed, (key, words)| changed | self.write_key(set, words, key)) != 0
    }

    /// The coordinates of all vertices of a set, and the first of each of these at a key; the vertices have more than
    /// two keys, whose coordinates follow each other.
    pub(in crate::layout) fn runs<'a>(&self, set: &'a Triangles, key: usize) -> (&'a [f32], Lanes<usize>) {
        (set.coordinates(), self.vertices.map(|vertex| 3 * (vertex as usize + key)))
    }

    /// Writes the rows of one key; returns the bits that changed.
    #[inline(always)]
    pub(in crate::layout) fn write_key(&self, set: &Triangles, words: &mut [u32], key: usize) -> u32 {
        let mut changed = 0;
        let (x, others) = words.split_at_mut(self.count);
        let (y, z) = others.split_at_mut(self.count);
        let vertices = self.vertices.iter().zip(&self.strides);
        for (((x, y), z), (&vertex, &stride)) in x.iter_mut().zip(y).zip(z).zip(vertices) {
            let position = set.position(vertex, key * stride as usize);
            changed |= replace(x, position.x) | replace(y, position.y) | replace(z, position.z);
        }
        changed
    }
}

/// Puts sizes into the upper half of the word that they share.
pub(in crate::layout) fn set_sizes(word: &mut u32, sizes: u32) {
    *word = *word & 0xffff | sizes;
}

/// Writes the corners of one triangle into lane `lane` of nine rows of `n`; returns the bits that changed.
#[inline(always)]
pub(in crate::layout) fn write_corners(words: &mut [u32], n: usize, lane: usize, [a, b, c]: [Vec3; 3]) -> u32 {
    let mut changed = 0;
    for (row, x) in words.chunks_exact_mut(n).zip([a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]) {
        changed |= replace(&mut row[lane], x);
    }
    changed
}

/// Overwrites a word with a number; returns the bits that changed.
#[inline(always)]
fn replace(word: &mut u32, by: f32) -> u32 {
    let before = core::mem::replace(word, by.to_bits());
    before ^ *word
}
