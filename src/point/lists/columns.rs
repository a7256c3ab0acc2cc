//! What is known of each neighbour, in columns.

use crate::simd::{LANES, huge_vec};

/// What is known of each neighbour, in columns; those not asked for hold anything.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    pub(super) ids: Vec<u32>,
    pub(super) distances: Vec<f32>,
    pub(super) displacements: [Vec<f32>; 3],
}

impl Columns {
    /// All columns of f32.
    pub(super) fn floats(&mut self) -> [&mut Vec<f32>; 4] {
        let [x, y, z] = &mut self.displacements;
        [&mut self.distances, x, y, z]
    }

    pub(super) fn bytes(&self) -> usize {
        let floats = self.distances.capacity() + self.displacements.iter().map(Vec::capacity).sum::<usize>();
        (self.ids.capacity() + floats) * 4
    }

    /// Gives the columns that are asked for at least this length.
    pub(super) fn make_room(&mut self, length: usize, asked: [bool; 4]) {
        grow(&mut self.ids, length);
        for (asked, column) in asked.into_iter().zip(self.floats()) {
            if asked {
                grow(column, length);
            }
        }
    }
}

/// At least this length, with room to grow.
fn grow<T: Copy + Default>(column: &mut Vec<T>, length: usize) {
    if column.len() < length {
        // A new vector on huge pages: most of the time of the first lists would go into mapping small ones.
        let mut larger = huge_vec(length + length / 2 + LANES);
        larger.extend_from_slice(column);
        larger.resize(larger.capacity(), T::default());
        *column = larger;
    }
}
