//! Lists one behind the other, in compressed sparse rows.

use super::row_moves::RowMoves;

/// Lists one behind the other, whatever they hold.
#[derive(Clone, Debug, Default)]
pub(super) struct ListRows<D> {
    /// Begin of each list, and the end of the last; empty if there never was one.
    pub(super) offsets: Vec<usize>,
    /// The id of the point of each list.
    pub(super) points: Vec<u32>,
    /// Longer than what is in use, so that nothing is cleared from query to query.
    pub(super) data: D,
}

impl<D: ListData> ListRows<D> {
    /// Drops all lists and keeps the memory; ready for the first.
    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.offsets.clear();
        self.offsets.push(0);
    }

    /// Where each list begins, and where the last one ends.
    pub(super) fn offsets(&self) -> &[usize] {
        if self.offsets.is_empty() { &[0] } else { &self.offsets }
    }

    /// Where the last list ends.
    #[inline(always)]
    pub(super) fn end(&self) -> usize {
        self.offsets.last().map_or(0, |end| *end)
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.offsets.capacity() * size_of::<usize>() + self.points.capacity() * size_of::<u32>() + self.data.bytes()
    }
}

/// What lists hold, one list behind the other: columns, or encounters.
pub(super) trait ListData: Sync {
    /// Room for some of it.
    type Room<'a>: Send
    where
        Self: 'a;
    /// The room from an index on.
    fn room(&mut self, begin: usize) -> Self::Room<'_>;
    /// Takes the first `count` elements off some room, if there are so many.
    fn take<'a>(room: &mut Self::Room<'a>, count: usize) -> Option<Self::Room<'a>>
    where
        Self: 'a;
    /// Fills room with what this begins with.
    fn fill(&self, room: Self::Room<'_>);
    /// Makes it at least as long.
    fn make_room(&mut self, length: usize);
    /// Copies all lists, which end there, to other places, where they end as well.
    fn copy_rows(&self, moves: &RowMoves<'_>, to: &mut Self, end: usize);
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}
