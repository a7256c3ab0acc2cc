//! Memory of neighbour queries.

use super::images::Image;
use crate::point::neighbor::Neighbor;
use crate::point::search::candidates::Candidates;
use core::cell::Cell;

/// Bytes that a thread keeps at most.
const MOST_KEPT: usize = 1 << 20;

thread_local! {
    /// For queries that return a vector: most of their time would go into allocating and clearing what they need besides.
    static KEPT: Cell<NeighborBuffer> = Cell::default();
}

/// Memory for results and candidates. A loop that reuses a buffer allocates nothing once the buffer has grown to the size
/// that the queries need.
///
/// ```
/// use mbkd::{NeighborBuffer, PointParams, PointTree};
/// let points = [[0.0f32; 3], [1.0; 3], [2.0; 3]];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let mut buffer = NeighborBuffer::new();
/// for (i, p) in points.iter().enumerate() {
///     let others = tree.query(*p, 0.0).filter(|id| id != i as u32).nearest_n_into(2, &mut buffer);
///     assert_eq!(others.len(), 2);
/// }
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct NeighborBuffer {
    pub(in crate::point) candidates: Candidates,
    pub(in crate::point) found: Vec<Neighbor>,
    /// Of a query in periodic space: images of its place, and what is found from one of them.
    pub(in crate::point) images: Vec<Image>,
    pub(in crate::point) of_image: Vec<Neighbor>,
}

impl NeighborBuffer {
    /// An empty buffer; it grows with the first queries.
    pub fn new() -> NeighborBuffer {
        NeighborBuffer::default()
    }

    /// The results of the last query of a [`PointTree`](crate::PointTree).
    pub fn found(&self) -> &[Neighbor] {
        &self.found
    }

    /// The memory that this thread keeps for queries that return a vector; new if such a query is running, whose filter makes this
    /// one.
    pub(super) fn take() -> NeighborBuffer {
        KEPT.try_with(Cell::take).unwrap_or_default()
    }

    /// The results, in memory of their own. The thread keeps the buffer, unless it is large.
    pub(super) fn into_found(self) -> Vec<Neighbor> {
        if self.is_large() {
            return self.found;
        }
        let found = self.found.to_vec();
        self.give_back();
        found
    }

    /// Leaves the buffer to the thread, unless it is large.
    pub(super) fn give_back(self) {
        if !self.is_large() {
            // Where the thread is ending, nothing is kept.
            let _ = KEPT.try_with(|kept| kept.set(self));
        }
    }

    fn is_large(&self) -> bool {
        let neighbors = (self.found.capacity() + self.of_image.capacity()) * size_of::<Neighbor>();
        neighbors + self.images.capacity() * size_of::<Image>() + self.candidates.bytes() > MOST_KEPT
    }
}
