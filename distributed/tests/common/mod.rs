//! Sets of particles, their lists in one process, and the comparison, for threads and for MPI alike.

pub mod compare;
pub mod one_process;
pub mod refused;
pub mod sets;
