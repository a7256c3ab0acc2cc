//! The keys of sixteen vertices with more than two keys, as rows.

use super::tubes::RowsOfKeys;
use crate::simd::{LANES, Lanes, Simd, lanes_at, transpose};
use core::ops::{Range, RangeInclusive};

/// Some keys of sixteen vertices, which are written as rows of sixteen numbers: the coordinates of a vertex at successive keys
/// follow each other in memory, so the rows are a transpose.
pub(in crate::primitive) struct KeysOfVertices<'a> {
    coordinates: &'a [f32],
    keys: Range<usize>,
    /// The first coordinate of each vertex.
    begins: Lanes<usize>,
    rows: &'a mut [f32],
}

impl<'a> KeysOfVertices<'a> {
    /// For some keys; `memory` may have any contents.
    pub fn new(coordinates: &'a [f32], keys: RangeInclusive<usize>, memory: &'a mut Vec<f32>) -> KeysOfVertices<'a> {
        let keys = *keys.start()..keys.end() + 1;
        // Sixteen rows are written at once.
        let needed = (3 * keys.len()).next_multiple_of(LANES) * LANES;
        if memory.len() < needed {
            memory.resize(needed, 0.0);
        }
        KeysOfVertices { coordinates, keys, begins: [0; LANES], rows: &mut memory[..needed] }
    }

    pub fn keys(&self) -> Range<usize> {
        self.keys.clone()
    }

    /// Chooses up to sixteen vertices; other lanes repeat the first one.
    pub fn set(&mut self, vertices: &[u32]) {
        self.begins = [3 * (vertices[0] as usize + self.keys.start); LANES];
        for (begin, &vertex) in self.begins.iter_mut().zip(vertices) {
            *begin = 3 * (vertex as usize + self.keys.start);
        }
    }

    /// The rows of the vertices.
    #[inline(always)]
    pub fn transposed<S: Simd>(&mut self, s: S) -> RowsOfKeys<'_> {
        for (first, rows) in (0..).step_by(LANES).zip(self.rows.as_chunks_mut::<{ LANES * LANES }>().0) {
            // Loops, since mapped arrays become calls.
            let mut all = [s.splat(0.0); LANES];
            for (of_vertex, begin) in all.iter_mut().zip(self.begins) {
                *of_vertex = s.load(&lanes_from(self.coordinates, begin + first));
            }
            for (&row, to) in transpose(s, all).iter().zip(rows.as_chunks_mut().0) {
                s.store(row, to);
            }
        }
        RowsOfKeys { words: self.rows, first: self.keys.start, keys: self.keys.len(), width: LANES, rows: 3 }
    }
}

/// Sixteen numbers from an index, or as many as there are, and zeros.
#[inline(always)]
fn lanes_from(from: &[f32], at: usize) -> Lanes<f32> {
    if at + LANES <= from.len() {
        return *lanes_at(from, at);
    }
    let mut lanes = [0.0; LANES];
    for (lane, &x) in lanes.iter_mut().zip(from.get(at..).unwrap_or_default()) {
        *lane = x;
    }
    lanes
}
