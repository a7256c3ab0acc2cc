//! The rows of vertices at many keys.
//!
//! The coordinates of one vertex at successive keys follow each other in the set, those of all vertices at one key in a
//! leaf block. So the rows are a transpose, of which sixteen are written at a time.

use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, lanes_at, lanes_at_mut, transpose};

/// Writes the rows of up to sixteen vertices; returns whether any number changed.
pub(in crate::layout) struct KeyRows<'a> {
    /// The rows, of as many numbers as there are vertices.
    pub words: &'a mut [u32],
    pub coordinates: &'a [f32],
    /// The first coordinate of each vertex; any of a vertex for the lanes beyond.
    pub begins: Lanes<usize>,
    /// The number of rows.
    pub rows: usize,
}

/// So few rows are not worth a transpose.
const FEW: usize = 3;

impl Kernel for KeyRows<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let KeyRows { words, coordinates, begins, rows } = self;
        let width = words.len() / rows;
        assert!(width <= LANES, "a row has a lane for each vertex");
        let mut equal = Mask::MAX;
        // Each row overlaps the next one, which overwrites the rest.
        let mut written = [0; LANES * (LANES + 1)];
        let mut first = 0;
        while rows > first + FEW && rows >= LANES {
            // The last ones may be written twice.
            first = first.min(rows - LANES);
            // A loop, since mapped arrays become calls.
            let mut all = [s.splat(0.0); LANES];
            for (of_vertex, begin) in all.iter_mut().zip(begins) {
                *of_vertex = s.load(lanes_at(coordinates, begin + first));
            }
            for (i, &row) in transpose(s, all).iter().enumerate() {
                s.store_u(s.to_bits(row), lanes_at_mut(&mut written, i * width));
            }
            let words = words[first * width..][..LANES * width].as_chunks_mut().0;
            for (words, now) in words.iter_mut().zip(written.as_chunks().0) {
                let now = s.load_u(now);
                equal &= s.eq_u(now, s.load_u(words));
                s.store_u(now, words);
            }
            first += LANES;
        }
        let mut changed = 0;
        for (row, words) in (first..rows).zip(words[first.min(rows) * width..].chunks_exact_mut(width)) {
            for (word, begin) in words.iter_mut().zip(begins) {
                let before = core::mem::replace(word, coordinates[begin + row].to_bits());
                changed |= before ^ *word;
            }
        }
        equal != Mask::MAX || changed != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::{SimdLevel, dispatch};

    #[test]
    fn rows_are_a_transpose_and_changes_are_found_on_all_instruction_sets() {
        let mut random = Random(6);
        let coordinates: Vec<f32> = (0..5000).map(|_| random.signed()).collect();
        for (rows, width) in
            [3, 6, 9, 15, 18, 27, 48, 51, 99].into_iter().flat_map(|rows| (3..=LANES).map(move |w| (rows, w)))
        {
            let mut begins = [0; LANES];
            begins[..width].fill_with(|| (random.signed().abs() * 4900.0) as usize);
            let expected: Vec<u32> =
                (0..rows * width).map(|i| coordinates[begins[i % width] + i / width].to_bits()).collect();
            for level in SimdLevel::available() {
                for spoiled in (0..rows * width).step_by(7) {
                    let mut words = expected.clone();
                    words[spoiled] ^= 1 << 31;
                    let mut write =
                        || dispatch(level, KeyRows { words: &mut words, coordinates: &coordinates, begins, rows });
                    assert!(write() && !write(), "{rows} rows of {width}, {level}, word {spoiled}");
                    assert_eq!(words, expected, "{rows} rows of {width}, {level}");
                }
            }
        }
    }
}
