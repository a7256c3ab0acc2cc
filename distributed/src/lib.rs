//! Neighbours of moving particles over the processes of a cluster: each rank gets the lists of its own particles,
//! bit-identical to those of one process.
//!
//! ```
//! use mbkd_distributed::{Particle, Reach, Step, Threads, distribute};
//! // In an MPI program, `Mpi::new(&universe.world())` is in the place of `ranks`.
//! let counts = Threads::run(2, |ranks| {
//!     use mbkd_distributed::Exchange;
//!     // Any rank may begin with any particles.
//!     let mine = (0..50).map(|i| 2 * i + ranks.rank() as u64);
//!     let mine: Vec<_> = mine.map(|id| Particle::fixed(id, [id as f32, 0.0, 0.0])).collect();
//!     let (mine, _) = distribute(ranks, &mine, &[], [None; 3])?;
//!     let step = Step::new(ranks, &mine, &Reach::within(3.0))?;
//!     let lists = step.neighbor_lists(0.0, 3.0)?;
//!     Ok::<_, mbkd_distributed::Error>((lists.entries().len(), step.halo().len()))
//! });
//! assert_eq!(counts, [Ok((50 * 6 - 6, 3)), Ok((50 * 6 - 6, 3))]);
//! ```
//!
//! A step of a simulation: [`distribute`] moves particles to ranks, ranges of a Morton curve with equal work. [`Step::new`]
//! replicates about 64 swept boxes of each rank, from which every rank knows the ranks that its particles may come near, and
//! sends copies of those particles (the halo). Each rank then makes its lists locally. Queries for the k nearest need no
//! radius: they are sent to the ranks whose boxes are near enough.
//!
//! All ranks make the same calls with the same arguments. They compare these first, so that a wrong one is the same
//! [`Error`] on every rank.
//!
//! | module | contents |
//! |---|---|
//! | `particle`, `lists` | input and output |
//! | `error`, `exchange` | errors; communication between ranks: MPI, or threads for tests |
//! | `agree`, `reach` | comparing and checking arguments |
//! | `swept_box`, `curve` | boxes and their periodic images; the Morton curve |
//! | `route`, `partition`, `top` | routing of messages; the ranges; the replicated boxes |
//! | `step` | a prepared step |
//! | `neighbor_lists`, `swept`, `k_nearest` | queries of a step |

#![warn(missing_debug_implementations)]

mod agree;
mod curve;
mod error;
mod exchange;
mod k_nearest;
mod lists;
mod neighbor_lists;
mod particle;
mod partition;
mod reach;
mod route;
mod step;
mod swept;
mod swept_box;
mod top;

pub use error::{Error, Problem};
#[cfg(feature = "mpi")]
pub use exchange::Mpi;
pub use exchange::{Counted, Exchange, Threads, Volume};
pub use k_nearest::{Neighbor, Query};
pub use lists::Lists;
pub use neighbor_lists::LocalNeighbor;
pub use particle::Particle;
pub use partition::distribute;
pub use reach::{LONGEST_PERIOD, MOST_PERIODS, Reach, SHORTEST_PERIOD};
pub use route::Route;
pub use step::Step;
pub use swept::Encounter;
