//! Brings together the lists of points that come up more than once.
//!
//! Where the shutter is divided, a point has a list in each time slice, and a pair an encounter in each segment between
//! keys. All lists of a point are copied to their final position and sorted by id. Encounters of the same pair become one.
//! Each point is merged by itself, so little memory is needed beside the lists.

use super::encounter::Encounter;
use super::encounter_lists::EncounterRows;
use crate::parallel;
use crate::point::lists::list_rows::ListData;

/// One of the lists of a point: its id, the share, and the number of the list in it.
type Row = (u32, u32, u32);

/// Lists, or points, that one task does.
const SHARE: usize = 256;

impl EncounterRows {
    /// One list for each of these points, and for all in the shares; one encounter for each pair; in the order of ids, in place of
    /// what the lists held. So the shares need no lists of points that meet nothing.
    pub(super) fn merge(&mut self, shares: &[EncounterRows], mut ids: Vec<u32>) {
        let mut rows: Vec<Row> = Vec::with_capacity(shares.iter().map(|lists| lists.points.len()).sum());
        for (share, lists) in shares.iter().enumerate() {
            rows.extend(lists.points.iter().enumerate().map(|(row, &id)| (id, share as u32, row as u32)));
        }
        sort(&mut rows);
        ids.extend(rows.chunk_by(|a, b| a.0 == b.0).map(|rows| rows[0].0));
        ids.sort_unstable();
        ids.dedup();
        let mut rest = &rows[..];
        let of_point = |&id: &u32| {
            let of_id;
            (of_id, rest) = rest.split_at(rest.iter().take_while(|row| row.0 == id).count());
            of_id
        };
        let points: Vec<&[Row]> = ids.iter().map(of_point).collect();
        self.clear();
        self.points.extend(&ids);
        for rows in &points {
            let length: usize = rows.iter().map(|row| list(shares, row).len()).sum();
            self.offsets.push(self.end() + length);
        }
        let end = self.end();
        self.data.make_room(end);
        let mut lengths = vec![0; points.len()];
        let all = Points { shares, rows: &points, ends: &self.offsets };
        all.merge(&mut self.data[..end], &mut lengths);
        // Lists that have become shorter move up.
        let mut end = 0;
        for (point, length) in lengths.into_iter().enumerate() {
            let begin = self.offsets[point];
            if begin != end {
                self.data.copy_within(begin..begin + length, end);
            }
            self.offsets[point] = end;
            end += length;
        }
        if let Some(last) = self.offsets.last_mut() {
            *last = end;
        }
    }
}

fn list<'a>(shares: &'a [EncounterRows], &(_, share, row): &Row) -> &'a [Encounter] {
    let (share, row) = (&shares[share as usize], row as usize);
    &share.data[share.offsets[row]..share.offsets[row + 1]]
}

/// Sorts, halves at the same time.
fn sort(rows: &mut [Row]) {
    if rows.len() <= 16 * SHARE {
        rows.sort_unstable();
        return;
    }
    let half = rows.len() / 2;
    rows.select_nth_unstable(half);
    let (low, high) = rows.split_at_mut(half);
    parallel::both(|| sort(low), || sort(high));
}

/// Points, the lists of each, and where each one's encounters end, the first entry being where the first one's begin.
struct Points<'a> {
    shares: &'a [EncounterRows],
    rows: &'a [&'a [Row]],
    ends: &'a [usize],
}

impl Points<'_> {
    /// Writes the encounters of each point to their final position, and how many there are.
    fn merge(&self, to: &mut [Encounter], lengths: &mut [usize]) {
        if self.rows.len() > SHARE {
            let half = self.rows.len() / 2;
            let (rows, more_rows) = self.rows.split_at(half);
            let (to, more_to) = to.split_at_mut(self.ends[half] - self.ends[0]);
            let (lengths, more_lengths) = lengths.split_at_mut(half);
            parallel::both(
                || Points { rows, ends: &self.ends[..=half], ..*self }.merge(to, lengths),
                || Points { rows: more_rows, ends: &self.ends[half..], ..*self }.merge(more_to, more_lengths),
            );
            return;
        }
        for ((rows, ends), length) in self.rows.iter().zip(self.ends.windows(2)).zip(lengths) {
            let to = &mut to[ends[0] - self.ends[0]..ends[1] - self.ends[0]];
            let mut end = 0;
            for row in *rows {
                let list = list(self.shares, row);
                to[end..end + list.len()].copy_from_slice(list);
                end += list.len();
            }
            *length = unite(to);
        }
    }
}

/// Puts the encounters of a point in order of ids, and those with the same id together; how many are left.
pub(super) fn unite(encounters: &mut [Encounter]) -> usize {
    encounters.sort_unstable_by_key(|encounter| encounter.id);
    let mut end = 0;
    for from in 0..encounters.len() {
        let encounter = encounters[from];
        if end > 0 && encounters[end - 1].id == encounter.id {
            encounters[end - 1] = encounters[end - 1].and(encounter);
        } else {
            encounters[end] = encounter;
            end += 1;
        }
    }
    end
}
