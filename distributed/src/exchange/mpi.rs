//! Ranks that are processes of an MPI program.

use super::Exchange;
use core::fmt;
use mpi::collective::SystemOperation;
use mpi::datatype::PartitionMut;
use mpi::request::multiple_scope;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives, Destination, Source};

/// Ranks that are processes of an MPI program, over a communicator of their own.
///
/// Calls come from the thread that has initialized MPI. Trees, lists and searches use further threads, which do not call it: unless
/// there is one thread only, initialize with `mpi::initialize_with_threading(Threading::Funneled)`.
///
/// ```no_run
/// use mbkd_distributed::{Exchange, Mpi};
/// let universe = mpi::initialize().expect("MPI starts once");
/// let ranks = Mpi::new(&universe.world());
/// println!("rank {} of {}", ranks.rank(), ranks.size());
/// ```
pub struct Mpi {
    group: SimpleCommunicator,
}

impl fmt::Debug for Mpi {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Mpi").field("rank", &self.rank()).field("size", &self.size()).finish()
    }
}

/// Bytes of a message: MPI counts in `i32`.
const MESSAGE: usize = 1 << 30;

impl Mpi {
    /// A group of the same ranks, whose messages do not meet those of others. All ranks call this together.
    pub fn new(ranks: &impl Communicator) -> Mpi {
        Mpi { group: ranks.duplicate() }
    }
}

impl Exchange for Mpi {
    fn rank(&self) -> usize {
        self.group.rank() as usize
    }

    fn size(&self) -> usize {
        self.group.size() as usize
    }

    /// One number to and from every rank, and then messages among those that have something to say.
    fn swap_bytes(&self, parts: &[&[u8]]) -> Vec<Vec<u8>> {
        let lengths: Vec<u64> = parts.iter().map(|part| part.len() as u64).collect();
        let mut theirs = vec![0u64; self.size()];
        self.group.all_to_all_into(&lengths[..], &mut theirs[..]);
        let mut received: Vec<Vec<u8>> = theirs.iter().map(|&length| vec![0; length as usize]).collect();
        received[self.rank()].copy_from_slice(parts[self.rank()]);
        multiple_scope(2 * self.size(), |scope, open| {
            let others = |rank: &usize| *rank != self.rank();
            for (rank, part) in received.iter_mut().enumerate().filter(|(rank, _)| others(rank)) {
                let from = self.group.process_at_rank(rank as i32);
                part.chunks_mut(MESSAGE).for_each(|bytes| {
                    open.add(from.immediate_receive_into(scope, bytes));
                });
            }
            for (rank, part) in parts.iter().enumerate().filter(|(rank, _)| others(rank)) {
                let to = self.group.process_at_rank(rank as i32);
                part.chunks(MESSAGE).for_each(|bytes| {
                    open.add(to.immediate_send(scope, bytes));
                });
            }
            open.wait_all(&mut Vec::new());
        });
        received
    }

    /// What is gathered is small (below 2 GiB together): some kilobytes of each rank.
    fn gather_bytes(&self, own: &[u8]) -> Vec<Vec<u8>> {
        // A byte more, so that no part is empty: the address of an empty slice of bytes is 1, by which OpenMPI means
        // "in place".
        let own = [own, &[0]].concat();
        let mut lengths = vec![0i32; self.size()];
        self.group.all_gather_into(&(own.len() as i32), &mut lengths[..]);
        let mut end = 0;
        let begins: Vec<i32> = lengths.iter().map(|length| (end, end += length).0).collect();
        let mut all = vec![0u8; end as usize];
        let mut parts = PartitionMut::new(&mut all[..], &lengths[..], &begins[..]);
        self.group.all_gather_varcount_into(&own[..], &mut parts);
        let part = |(&begin, length): (&i32, &i32)| all[begin as usize..(begin + length - 1) as usize].to_vec();
        begins.iter().zip(&lengths).map(part).collect()
    }

    fn sum(&self, numbers: &mut [u64]) {
        let own = numbers.to_vec();
        // The address of an empty slice means something else to MPI; all ranks have as many numbers.
        if !own.is_empty() {
            self.group.all_reduce_into(&own[..], numbers, SystemOperation::sum());
        }
    }
}
