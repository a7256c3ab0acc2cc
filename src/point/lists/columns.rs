//! The columns of neighbour lists: ids, distances and displacements.

use super::list_rows::ListData;
use super::row_moves::RowMoves;
use crate::simd::{LANES, huge_vec};

/// Ids, distances and displacements of neighbours, in columns. The content of columns that were not requested is
/// unspecified.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    pub(super) ids: Vec<u32>,
    /// Squared distances, and displacements along the axes.
    pub(super) floats: [Vec<f32>; 4],
    /// Which of these are requested.
    pub(super) requested: [bool; 4],
}

/// Room in columns, in those that are requested.
pub(super) struct Room<'a> {
    ids: &'a mut [u32],
    floats: [Option<&'a mut [f32]>; 4],
}

impl ListData for Columns {
    type Room<'a> = Room<'a>;

    fn room(&mut self, begin: usize) -> Room<'_> {
        let mut requested = self.requested.into_iter();
        let floats = self.floats.each_mut().map(|column| match requested.next() {
            Some(true) => Some(column.get_mut(begin..).unwrap_or_default()),
            _ => None,
        });
        Room { ids: self.ids.get_mut(begin..).unwrap_or_default(), floats }
    }

    fn take<'a>(room: &mut Room<'a>, count: usize) -> Option<Room<'a>>
    where
        Self: 'a,
    {
        let short = room.floats.iter().flatten().any(|column| column.len() < count);
        if short || room.ids.len() < count {
            return None;
        }
        let floats = room.floats.each_mut().map(|column| column.as_mut().map(|column| first(column, count)));
        Some(Room { ids: first(&mut room.ids, count), floats })
    }

    fn fill(&self, room: Room<'_>) {
        let Room { ids, floats } = room;
        ids.copy_from_slice(&self.ids[..ids.len()]);
        for (to, from) in floats.into_iter().zip(&self.floats) {
            if let Some(to) = to {
                to.copy_from_slice(&from[..to.len()]);
            }
        }
    }

    fn make_room(&mut self, length: usize) {
        grow(&mut self.ids, length);
        for (requested, column) in self.requested.into_iter().zip(&mut self.floats) {
            if requested {
                grow(column, length);
            }
        }
    }

    fn copy_rows(&self, moves: &RowMoves<'_>, to: &mut Columns, end: usize) {
        to.requested = self.requested;
        to.make_room(end);
        moves.copy(&self.ids, &mut to.ids[..end]);
        for (requested, (from, to)) in self.requested.into_iter().zip(self.floats.iter().zip(&mut to.floats)) {
            if requested {
                moves.copy(from, &mut to[..end]);
            }
        }
    }

    fn bytes(&self) -> usize {
        let floats = self.floats.iter().map(Vec::capacity).sum::<usize>();
        (self.ids.capacity() + floats) * 4
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
