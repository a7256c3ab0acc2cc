//! Lists in the order of ids instead of that of the tree.

use super::csr::NeighborCsr;
use super::error::ListError;
use super::list_request::ListRequest;
use crate::parallel;

/// Lists that one task copies.
const SHARE: usize = 1024;

/// Brings the lists into the order of ids.
pub(super) fn reorder(request: &ListRequest<'_>, lists: &mut NeighborCsr) -> Result<(), ListError> {
    let count = request.tree.len();
    let from = &mut lists.rows;
    from.clear();
    from.resize(count, ABSENT);
    for (row, &id) in lists.points.iter().enumerate() {
        match from.get_mut(id as usize) {
            Some(to) if *to == ABSENT => *to = row as u32,
            _ => {
                lists.clear();
                return Err(ListError::Ids { id });
            }
        }
    }
    let length = |row: u32| match row {
        ABSENT => 0,
        row => lists.offsets[row as usize + 1] - lists.offsets[row as usize],
    };
    let offsets = &mut lists.new_offsets;
    offsets.clear();
    offsets.push(0);
    let mut end = 0;
    for &row in lists.rows.iter() {
        end += length(row);
        offsets.push(end);
    }
    lists.spare.make_room(end, request.listing.columns());
    let moves = RowMoves { rows: &lists.rows, old: &lists.offsets, new: offsets };
    moves.copy(&lists.columns.ids, &mut lists.spare.ids[..end]);
    for (requested, (to, from)) in
        request.listing.columns().into_iter().zip(lists.spare.floats.iter_mut().zip(&lists.columns.floats))
    {
        if requested {
            moves.copy(from, &mut to[..end]);
        }
    }
    core::mem::swap(&mut lists.columns, &mut lists.spare);
    core::mem::swap(&mut lists.offsets, &mut lists.new_offsets);
    lists.points.clear();
    lists.points.extend(0..count as u32);
    Ok(())
}

/// The row of a point that does not exist.
const ABSENT: u32 = u32::MAX;

/// Which list comes from where.
struct RowMoves<'a> {
    /// By new row.
    rows: &'a [u32],
    old: &'a [usize],
    new: &'a [usize],
}

impl RowMoves<'_> {
    /// Copies a column, halves at the same time.
    fn copy<T: Copy + Send + Sync>(&self, from: &[T], to: &mut [T]) {
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
