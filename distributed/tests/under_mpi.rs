//! Processes of an MPI program against one process: starts itself under `mpirun`, on 1 to 4 ranks.

mod common;

use common::{compare::compare, refused::refused};
use mbkd_distributed::{Exchange, Mpi};
use std::process::{Command, exit};

/// What tells a process that it is a rank.
const RANK: &str = "--rank";

fn main() {
    if std::env::args().any(|argument| argument == RANK) {
        return rank();
    }
    let program = std::env::current_exe().expect("this test is a file");
    for ranks in 1..=4 {
        let mut command = Command::new("mpirun");
        // In containers the tests often run as root, on fewer cores than ranks. A rank that waits for ever is an error.
        command.args(["--allow-run-as-root", "--oversubscribe", "--timeout", "300", "-n", &ranks.to_string()]);
        let status = command.arg(&program).arg(RANK).status();
        match status {
            Ok(status) if status.success() => {}
            Ok(status) => panic!("{ranks} ranks: {status}"),
            Err(error) => panic!("mpirun cannot be started: {error}; see install-mpi.sh"),
        }
    }
}

/// One rank.
fn rank() {
    let universe = mpi::initialize().expect("MPI starts once");
    // A rank that panics must not wait for the others to end, nor they for it.
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        report(panic);
        exit(101);
    }));
    let ranks = Mpi::new(&universe.world());
    let mut compared = [compare(&ranks) as u64];
    ranks.sum(&mut compared);
    refused(&ranks);
    assert!(compared[0] > 10_000);
    if ranks.rank() == 0 {
        println!("{} ranks: {} lists have the bits of one process", ranks.size(), compared[0]);
    }
}
