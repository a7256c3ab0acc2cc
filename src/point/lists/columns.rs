//! The columns of neighbour lists: ids, distances and displacements.

use crate::simd::{LANES, huge_vec};

/// Ids, distances and displacements of neighbours, in columns. The content of columns that were not requested is
/// unspecified.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    pub(super) ids: Vec<u32>,
    /// Squared distances, and displacements along the axes.
    pub(super) floats: [Vec<f32>; 4],
}

impl Columns {
    /// The room in the columns from an index on.
    pub(super) fn room(&mut self, begin: usize, requested: [bool; 4]) -> Room<'_> {
        let mut from = requested.into_iter();
        let floats = self.floats.each_mut().map(|column| match from.next() {
            Some(true) => column.get_mut(begin..).unwrap_or_default(),
            _ => Default::default(),
        });
        Room { ids: self.ids.get_mut(begin..).unwrap_or_default(), floats, requested }
    }

    pub(super) fn bytes(&self) -> usize {
        let floats = self.floats.iter().map(Vec::capacity).sum::<usize>();
        (self.ids.capacity() + floats) * 4
    }

    /// Gives the requested columns at least this length.
    pub(super) fn make_room(&mut self, length: usize, requested: [bool; 4]) {
        grow(&mut self.ids, length);
        for (requested, column) in requested.into_iter().zip(&mut self.floats) {
            if requested {
                grow(column, length);
            }
        }
    }
}

/// Room in columns. Columns that were not requested have none.
pub(super) struct Room<'a> {
    ids: &'a mut [u32],
    floats: [&'a mut [f32]; 4],
    requested: [bool; 4],
}

impl<'a> Room<'a> {
    /// Takes the first `count` elements, if there are so many.
    pub(super) fn take(&mut self, count: usize) -> Option<Room<'a>> {
        let short =
            self.requested.iter().zip(&self.floats).any(|(requested, column)| *requested && column.len() < count);
        if short || self.ids.len() < count {
            return None;
        }
        let floats = core::array::from_fn(|i| first(&mut self.floats[i], if self.requested[i] { count } else { 0 }));
        Some(Room { ids: first(&mut self.ids, count), floats, requested: self.requested })
    }

    /// Copies what columns begin with.
    pub(super) fn fill(self, from: &Columns) {
        let Room { ids, floats, .. } = self;
        ids.copy_from_slice(&from.ids[..ids.len()]);
        for (to, from) in floats.into_iter().zip(&from.floats) {
            to.copy_from_slice(&from[..to.len()]);
        }
    }
}

/// Takes the first `count` items off a slice.
fn first<'a, T>(items: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, rest) = core::mem::take(items).split_at_mut(count);
    *items = rest;
    first
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
