//! What lists hold.

use super::row_moves::RowMoves;

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
