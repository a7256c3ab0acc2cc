//! Lists of encounters, one for each point, in memory of the caller.

use super::candidate_points::WIDTH;
use super::encounter::Encounter;
use crate::parallel;
use crate::point::lists::error::ListError;
use crate::point::lists::list_rows::{ListData, ListRows};
use crate::point::lists::reordering::Reordering;
use crate::point::lists::row_moves::RowMoves;
use crate::simd::huge_vec;

/// Who comes within a radius of whom during an interval, and when: a list for each point.
///
/// ```
/// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
/// let points = [MovingPoint::new(Vec3::NEG_X, Vec3::X), MovingPoint::fixed(Vec3::Y * 0.3)];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.5).in_order().collect()?;
/// let row = lists.row(0);
/// assert_eq!((row.len(), row[0].id, row[0].closest), (1, 1, 0.5));
/// assert!((row[0].enter - 0.3).abs() < 1e-6 && (row[0].leave - 0.7).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Memory of the caller: handed to [`SweptQuery::run`](super::SweptQuery::run) again and again, it grows until it fits the largest
/// lists.
#[derive(Clone, Debug, Default)]
pub struct EncounterLists {
    pub(super) rows: EncounterRows,
    /// Lists on their way, of one group of points each.
    pub(super) shares: Vec<EncounterRows>,
    reordering: Reordering<Vec<Encounter>>,
}

/// The lists themselves.
pub(super) type EncounterRows = ListRows<Vec<Encounter>>;

impl PartialEq for EncounterLists {
    fn eq(&self, other: &EncounterLists) -> bool {
        (self.offsets(), self.points(), self.encounters()) == (other.offsets(), other.points(), other.encounters())
    }
}

impl EncounterLists {
    /// No lists, no memory.
    pub fn new() -> EncounterLists {
        EncounterLists::default()
    }

    /// Drops all lists and keeps the memory.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Number of lists: one for each point that exists at any time of the interval, and possibly some that do not; or one for each
    /// id with [`in_order`](super::SweptQuery::in_order).
    pub fn len(&self) -> usize {
        self.rows.points.len()
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.rows.points.is_empty()
    }

    /// Where each list begins in [`encounters`](EncounterLists::encounters), and where the last one ends.
    pub fn offsets(&self) -> &[usize] {
        self.rows.offsets()
    }

    /// The id of the point that each list belongs to.
    pub fn points(&self) -> &[u32] {
        &self.rows.points
    }

    /// All encounters, list after list.
    pub fn encounters(&self) -> &[Encounter] {
        &self.rows.data[..self.rows.end()]
    }

    /// The encounters of list `row`.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::NEG_X, Vec3::X), MovingPoint::fixed(Vec3::Y * 0.3)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.5).collect()?;
    /// for (row, &point) in lists.points().iter().enumerate() {
    ///     assert_eq!((lists.row(row).len(), lists.row(row)[0].id), (1, 1 - point));
    /// }
    /// assert_eq!(lists.offsets(), [0, 1, 2]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    /// If `row` is not less than [`EncounterLists::len`].
    pub fn row(&self, row: usize) -> &[Encounter] {
        &self.rows.data[self.rows.offsets[row]..self.rows.offsets[row + 1]]
    }

    /// The lists, each with the id of its point.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, &[Encounter])> {
        (0..self.len()).map(move |row| (self.rows.points[row], self.row(row)))
    }

    /// Bytes allocated, for the lists and for making them.
    pub fn bytes(&self) -> usize {
        let shares: usize = self.shares.iter().map(EncounterRows::bytes).sum();
        self.rows.bytes() + self.reordering.bytes() + self.shares.capacity() * size_of::<EncounterRows>() + shares
    }
}

/// At least this length, with room to grow; on huge pages.
#[cold]
pub(super) fn grow(encounters: &mut Vec<Encounter>, length: usize) {
    let mut larger = huge_vec(length + length / 2 + 64 * WIDTH);
    larger.extend_from_slice(encounters);
    larger.resize(larger.capacity(), Encounter::NONE);
    *encounters = larger;
}

impl ListData for Vec<Encounter> {
    type Room<'a> = &'a mut [Encounter];

    fn room(&mut self, begin: usize) -> &mut [Encounter] {
        self.get_mut(begin..).unwrap_or_default()
    }

    fn take<'a>(room: &mut &'a mut [Encounter], count: usize) -> Option<&'a mut [Encounter]>
    where
        Self: 'a,
    {
        room.split_off_mut(..count)
    }

    fn fill(&self, room: &mut [Encounter]) {
        room.copy_from_slice(&self[..room.len()]);
    }

    fn make_room(&mut self, length: usize) {
        if self.len() < length {
            grow(self, length);
        }
    }

    fn copy_rows(&self, moves: &RowMoves<'_>, to: &mut Vec<Encounter>, end: usize) {
        to.make_room(end);
        moves.copy(self, &mut to[..end]);
    }

    fn bytes(&self) -> usize {
        self.capacity() * size_of::<Encounter>()
    }
}

impl EncounterLists {
    /// Brings the lists into the order of ids, of which there are so many.
    pub(super) fn reorder(&mut self, count: usize) -> Result<(), ListError> {
        self.reordering.reorder(count, &mut self.rows)
    }

    /// Sorts each list by id.
    pub(super) fn sort(&mut self) {
        let end = self.rows.end();
        sort_rows(&self.rows.offsets, &mut self.rows.data[..end]);
    }
}

/// Lists that one task sorts.
const SHARE: usize = 1024;

/// Sorts the encounters between successive offsets, of which the first is where the slice begins; halves at the same time.
fn sort_rows(offsets: &[usize], encounters: &mut [Encounter]) {
    let (begin, rows) = (offsets[0], offsets.len() - 1);
    if rows > SHARE {
        let half = rows / 2;
        let (low, high) = encounters.split_at_mut(offsets[half] - begin);
        parallel::both(|| sort_rows(&offsets[..=half], low), || sort_rows(&offsets[half..], high));
        return;
    }
    for ends in offsets.windows(2) {
        encounters[ends[0] - begin..ends[1] - begin].sort_unstable_by_key(|encounter| encounter.id);
    }
}
