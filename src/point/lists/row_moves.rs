//! Lists copied to other places, in another order.

use crate::parallel;

/// Lists that one task copies.
const SHARE: usize = 1024;

/// The row of a point that does not exist.
pub(super) const ABSENT: u32 = u32::MAX;

/// Which list comes from where.
pub(super) struct RowMoves<'a> {
    /// By new row.
    rows: &'a [u32],
    old: &'a [usize],
    new: &'a [usize],
}

impl<'a> RowMoves<'a> {
    /// Of rows to the places of others, whose offsets are computed here.
    pub(super) fn new(rows: &'a [u32], old: &'a [usize], new: &'a mut Vec<usize>) -> RowMoves<'a> {
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
