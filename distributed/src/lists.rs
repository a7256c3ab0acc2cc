//! Lists one behind the other.

/// A list for each particle of a rank, or for each query, one behind the other.
///
/// ```
/// use mbkd_distributed::{Particle, Reach, Step, Threads};
/// Threads::run(1, |ranks| {
///     let particles = [3, 5].map(|id| Particle::fixed(id, [id as f32, 0.0, 0.0]));
///     let step = Step::new(ranks, &particles, &Reach::within(2.5)).unwrap();
///     let lists = step.neighbor_lists(0.0, 2.5).unwrap();
///     assert_eq!((lists.len(), lists.row(0)[0].id, lists.row(1)[0].distance_squared), (2, 5, 4.0));
/// });
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Lists<T> {
    offsets: Vec<usize>,
    entries: Vec<T>,
}

impl<T> Lists<T> {
    pub(crate) fn new() -> Lists<T> {
        Lists { offsets: vec![0], entries: Vec::new() }
    }

    /// Appends a list.
    pub(crate) fn push(&mut self, row: impl IntoIterator<Item = T>) {
        self.entries.extend(row);
        self.offsets.push(self.entries.len());
    }

    /// Number of lists.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A list. Panics where `row` is not less than [`Lists::len`].
    pub fn row(&self, row: usize) -> &[T] {
        &self.entries[self.offsets[row]..self.offsets[row + 1]]
    }

    /// All lists.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[T]> {
        self.offsets.windows(2).map(|ends| &self.entries[ends[0]..ends[1]])
    }

    /// The entries of all lists.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }
}
