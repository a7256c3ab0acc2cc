//! Lists in the order of ids instead of that of the tree.

use super::error::ListError;
use super::scheduling::ListData;
use crate::parallel;

/// Lists that one task copies.
const SHARE: usize = 1024;

/// Memory for bringing lists into the order of ids.
#[derive(Clone, Debug, Default)]
pub(super) struct Reordering<D> {
    data: D,
    offsets: Vec<usize>,
    /// The row of each id.
    rows: Vec<u32>,
}

impl<D: ListData> Reordering<D> {
    /// Brings lists into the order of `count` ids: where each begins and the last ends, the ids of their points, and what is in
    /// them.
    pub(super) fn reorder(
        &mut self,
        count: usize,
        (offsets, points, data): (&mut Vec<usize>, &mut Vec<u32>, &mut D),
    ) -> Result<(), ListError> {
        rows_of_ids(points, count, &mut self.rows)?;
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

/// The row of a point that does not exist.
const ABSENT: u32 = u32::MAX;

/// Which list comes from where.
pub(super) struct RowMoves<'a> {
    /// By new row.
    rows: &'a [u32],
    old: &'a [usize],
    new: &'a [usize],
}

impl<'a> RowMoves<'a> {
    /// Of rows to the places of others, whose offsets are computed here.
    fn new(rows: &'a [u32], old: &'a [usize], new: &'a mut Vec<usize>) -> RowMoves<'a> {
        let mut end = 0;
        new.clear();
        new.push(0);
        new.extend(rows.iter().map(|&row| {
            if row != ABSENT {
                end += old[row as usize + 1] - old[row as usize];
            }
            end
        }));
        RowMoves { rows, old, new }
    }

    /// Copies a column, halves at the same time.
    pub(super) fn copy<T: Copy + Send + Sync>(&self, from: &[T], to: &mut [T]) {
        if self.rows.len() > SHARE {
            let half = self.rows.len() / 2;
            let (left, right) = self.rows.split_at(half);
            let (to_left, to_right) = to.split_at_mut(self.new[half] - self.new[0]);
            let (old, new) = (self.old, self.new);
            parallel::both(
                || RowMoves { rows: left, old, new: &new[..=half] }.copy(from, to_left),
                || RowMoves { rows: right, old, new: &new[half..] }.copy(from, to_right),
            );
            return;
        }
        for (&row, ends) in self.rows.iter().zip(self.new.windows(2)) {
            if row != ABSENT {
                let row = row as usize;
                let to = &mut to[ends[0] - self.new[0]..ends[1] - self.new[0]];
                to.copy_from_slice(&from[self.old[row]..self.old[row + 1]]);
            }
        }
    }
}
