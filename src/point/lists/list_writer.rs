//! Lists in the making: room for them, what is written, and where each ends.

use super::candidates::write;
use super::columns::Columns;
use super::coordinate::Seen;
use super::list_request::Listing;
use super::list_rows::{ListData, ListRows};
use crate::simd::{LANES, Lanes, Mask, Simd};
use core::ops::Range;

/// Lists in the making, one behind the other.
#[derive(Clone, Debug, Default)]
pub(super) struct ListWriter {
    pub(super) rows: ListRows<Columns>,
    /// The lowest id of a point with more neighbours than are allowed.
    pub(super) crowded: Option<u32>,
    /// Keys of a list to be sorted, and a column on its way.
    keys: Vec<u64>,
    column: Vec<f32>,
}

impl ListWriter {
    pub(super) fn bytes(&self) -> usize {
        self.rows.bytes() + self.keys.capacity() * 8 + self.column.capacity() * 4
    }

    /// Whether any list of points with these ids counts: all do, until one is too long. Then only those of lower ids may change the
    /// error.
    #[inline(always)]
    pub(super) fn want_any(&self, ids: &Lanes<u32>) -> bool {
        self.crowded.is_none_or(|crowded| ids.iter().any(|&id| id < crowded))
    }

    /// Makes room for `more` neighbours and a vector.
    #[inline(always)]
    pub(super) fn reserve(&mut self, more: usize, listing: &Listing) {
        let (length, columns) = (self.rows.end() + more + LANES, &self.rows.data);
        let room = columns.ids.len() >= length
            && (!listing.distances || columns.floats[0].len() >= length)
            && (!listing.displacements || columns.floats[3].len() >= length);
        if !room {
            self.grow(length);
        }
    }

    #[cold]
    fn grow(&mut self, length: usize) {
        self.rows.data.make_room(length);
    }

    /// Ends the list of a point; drops it if it has too many neighbours.
    #[inline(always)]
    pub(super) fn end_list(&mut self, id: u32, begin: usize, mut end: usize, listing: &Listing) {
        if end - begin > listing.most {
            self.crowded = Some(self.crowded.map_or(id, |other| other.min(id)));
            end = begin;
        }
        if listing.sorted {
            self.sort(begin..end, listing);
        }
        self.rows.points.push(id);
        self.rows.offsets.push(end);
    }

    /// Sorts a list by id.
    fn sort(&mut self, list: Range<usize>, listing: &Listing) {
        let columns = &mut self.rows.data;
        if !listing.distances && !listing.displacements {
            return columns.ids[list].sort_unstable();
        }
        self.keys.clear();
        let ids = columns.ids[list.clone()].iter();
        self.keys.extend((0..).zip(ids).map(|(index, &id)| u64::from(id) << 32 | index));
        self.keys.sort_unstable();
        for (id, key) in columns.ids[list.clone()].iter_mut().zip(&self.keys) {
            *id = (key >> 32) as u32;
        }
        for (requested, column) in columns.requested.into_iter().zip(&mut columns.floats) {
            if requested {
                self.column.clear();
                self.column.extend_from_slice(&column[list.clone()]);
                for (to, key) in column[list.clone()].iter_mut().zip(&self.keys) {
                    *to = self.column[*key as u32 as usize];
                }
            }
        }
    }
}

/// Writes the requested ones of displacements and squared distances to index `end` and on.
#[inline(always)]
pub(super) fn write_requested<S: Simd>(
    s: S,
    listing: &Listing,
    [distances, displacements_x, displacements_y, displacements_z]: &mut [Vec<f32>; 4],
    end: usize,
    Seen { displacements: [x, y, z], squared }: Seen<S>,
    hits: Mask,
) {
    if listing.distances {
        write(s, distances, end, squared, hits);
    }
    if listing.displacements {
        write(s, displacements_x, end, x, hits);
        write(s, displacements_y, end, y, hits);
        write(s, displacements_z, end, z, hits);
    }
}
