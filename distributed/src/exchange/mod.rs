//! How ranks talk: three things that all of them do together.

mod counted;
#[cfg(feature = "mpi")]
mod mpi;
mod threads;

pub use counted::{Counted, Volume};
#[cfg(feature = "mpi")]
pub use mpi::Mpi;
pub use threads::Threads;

use bytemuck::Pod;

/// A group of ranks that talk to each other. Every rank calls the same functions in the same order.
///
/// `Mpi` is the one for clusters; [`Threads`] are ranks in one process, for tests and for trying things out.
pub trait Exchange {
    /// The number of this rank, below [`Exchange::size`].
    fn rank(&self) -> usize;
    /// How many ranks there are.
    fn size(&self) -> usize;
    /// Sends `parts[r]` to rank r; returns what each rank sent here, by rank.
    fn swap_bytes(&self, parts: &[&[u8]]) -> Vec<Vec<u8>>;
    /// What each rank gave, by rank, on every rank.
    fn gather_bytes(&self, own: &[u8]) -> Vec<Vec<u8>>;
    /// Adds up each number over all ranks.
    fn sum(&self, numbers: &mut [u64]);
}

/// Sends `parts[r]` to rank r; returns what each rank sent here.
pub(crate) fn swap<T: Pod>(exchange: &impl Exchange, parts: &[Vec<T>]) -> Vec<Vec<T>> {
    let bytes: Vec<&[u8]> = parts.iter().map(|part| bytemuck::cast_slice(part)).collect();
    exchange.swap_bytes(&bytes).iter().map(|part| bytemuck::pod_collect_to_vec(part)).collect()
}

/// What each rank gave, by rank.
pub(crate) fn gather<T: Pod>(exchange: &impl Exchange, own: &[T]) -> Vec<Vec<T>> {
    let all = exchange.gather_bytes(bytemuck::cast_slice(own));
    all.iter().map(|part| bytemuck::pod_collect_to_vec(part)).collect()
}
