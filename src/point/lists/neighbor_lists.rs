//! Neighbour lists one behind the other, in memory that is used again.

use super::columns::Columns;
use super::list_rows::ListRows;
use super::prepare::Prepared;
use super::reordering::Reordering;
use super::worker::Worker;
use core::ops::Range;

/// Neighbour lists of all points, in compressed sparse rows: the lists one behind the other, and where each begins.
///
/// Memory of the caller. Used for one query after the other, it grows until it fits the largest, and allocates nothing
/// from then on.
///
/// ```
/// use mbkd::{NeighborLists, PointParams, PointTree};
/// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
/// let mut lists = NeighborLists::new();
/// tree.neighbor_lists(0.0, 2.0).in_order().run(&mut lists)?;
/// assert_eq!(lists.offsets(), [0, 1, 2, 2]);
/// assert_eq!(lists.ids(), [1, 0]);
/// for (id, row) in lists.iter() {
///     println!("{id}: {row:?}");
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct NeighborLists {
    pub(super) rows: ListRows<Columns>,
    pub(super) reordering: Reordering<Columns>,
    pub(super) prepared: Prepared,
    pub(super) workers: Vec<Worker>,
}

/// The lists and the columns that were requested; not the memory.
impl PartialEq for NeighborLists {
    fn eq(&self, other: &NeighborLists) -> bool {
        self.rows.data.requested == other.rows.data.requested
            && (self.offsets(), self.points(), self.ids()) == (other.offsets(), other.points(), other.ids())
            && self.distances_squared() == other.distances_squared()
            && self.displacements() == other.displacements()
    }
}

impl NeighborLists {
    /// No lists, no memory.
    pub fn new() -> NeighborLists {
        NeighborLists::default()
    }

    /// Drops all lists and keeps the memory.
    ///
    /// ```
    /// use mbkd::{NeighborLists, PointParams, PointTree};
    /// let mut lists = NeighborLists::new();
    /// PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default())?.neighbor_lists(0.0, 2.0).run(&mut lists)?;
    /// assert_eq!(lists.len(), 2);
    /// lists.clear();
    /// assert!(lists.is_empty() && lists.bytes() > 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Number of lists: one for each point that exists at the time, or for each id with
    /// [`in_order`](super::ListQuery::in_order).
    pub fn len(&self) -> usize {
        self.rows.points.len()
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.rows.points.is_empty()
    }

    /// Where each list begins in the columns, and where the last one ends.
    pub fn offsets(&self) -> &[usize] {
        self.rows.offsets()
    }

    /// The id of the point that each list belongs to: in the order of the tree, in which neighbours in space are close
    /// together; or 0, 1, 2, … with [`in_order`](super::ListQuery::in_order).
    pub fn points(&self) -> &[u32] {
        &self.rows.points
    }

    /// Number of neighbours in all lists.
    pub fn neighbors(&self) -> usize {
        self.rows.end()
    }

    /// The neighbours' ids, list after list.
    pub fn ids(&self) -> &[u32] {
        &self.rows.data.ids[..self.neighbors()]
    }

    /// The squared distance of each neighbour, as [`Neighbor`](crate::Neighbor) has it; empty unless requested with
    /// [`with_distances`](super::ListQuery::with_distances).
    pub fn distances_squared(&self) -> &[f32] {
        self.column(0)
    }

    /// The displacement from the point to each neighbour along the three axes, to the nearest image along periodic ones; empty
    /// unless requested with [`with_displacements`](super::ListQuery::with_displacements).
    pub fn displacements(&self) -> [&[f32]; 3] {
        [1, 2, 3].map(|column| self.column(column))
    }

    fn column(&self, column: usize) -> &[f32] {
        let Columns { floats, requested, .. } = &self.rows.data;
        if requested[column] { &floats[column][..self.neighbors()] } else { &[] }
    }

    /// Where list `row` is in the columns.
    ///
    /// ```
    /// use mbkd::{NeighborLists, PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]], &PointParams::default())?;
    /// let mut lists = NeighborLists::new();
    /// tree.neighbor_lists(0.0, 2.0).with_distances().sorted().in_order().run(&mut lists)?;
    /// assert_eq!(lists.distances_squared()[lists.range(1)], [1.0, 4.0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    /// If `row` is not less than [`NeighborLists::len`].
    pub fn range(&self, row: usize) -> Range<usize> {
        self.rows.offsets[row]..self.rows.offsets[row + 1]
    }

    /// The ids of list `row`.
    ///
    /// # Panics
    /// If `row` is not less than [`NeighborLists::len`].
    pub fn row(&self, row: usize) -> &[u32] {
        &self.rows.data.ids[self.range(row)]
    }

    /// The lists, each with the id of its point.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, &[u32])> {
        (0..self.len()).map(move |row| (self.rows.points[row], self.row(row)))
    }

    /// Bytes allocated, for the lists and for making them.
    pub fn bytes(&self) -> usize {
        let workers: usize = self.workers.iter().map(Worker::bytes).sum();
        self.rows.bytes()
            + self.prepared.bytes()
            + self.reordering.bytes()
            + self.workers.capacity() * size_of::<Worker>()
            + workers
    }
}
