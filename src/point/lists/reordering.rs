//! Lists in the order of ids instead of that of the tree.

use super::error::ListError;
use super::list_rows::{ListData, ListRows};
use super::row_moves::{ABSENT, RowMoves};

/// Memory for bringing lists into the order of ids.
#[derive(Clone, Debug, Default)]
pub(super) struct Reordering<D> {
    data: D,
    offsets: Vec<usize>,
    /// The row of each id.
    rows: Vec<u32>,
}

impl<D: ListData> Reordering<D> {
    /// Brings lists into the order of `count` ids. After an error there are none.
    pub(super) fn reorder(&mut self, count: usize, lists: &mut ListRows<D>) -> Result<(), ListError> {
        if let Err(error) = rows_of_ids(&lists.points, count, &mut self.rows) {
            lists.clear();
            return Err(error);
        }
        let ListRows { offsets, points, data } = lists;
        let moves = RowMoves::new(&self.rows, offsets, &mut self.offsets);
        data.copy_rows(&moves, &mut self.data, offsets.last().copied().unwrap_or(0));
        core::mem::swap(data, &mut self.data);
        core::mem::swap(offsets, &mut self.offsets);
        points.clear();
        points.extend(0..count as u32);
        Ok(())
    }

    pub(super) fn bytes(&self) -> usize {
        self.data.bytes() + self.offsets.capacity() * size_of::<usize>() + self.rows.capacity() * size_of::<u32>()
    }
}

/// The row of each of `count` ids, given the ids of rows; an error if one is too large or has two rows.
fn rows_of_ids(points: &[u32], count: usize, rows: &mut Vec<u32>) -> Result<(), ListError> {
    rows.clear();
    rows.resize(count, ABSENT);
    for (row, &id) in points.iter().enumerate() {
        match rows.get_mut(id as usize) {
            Some(to) if *to == ABSENT => *to = row as u32,
            _ => return Err(ListError::Ids { id }),
        }
    }
    Ok(())
}
