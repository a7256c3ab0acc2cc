//! Ranks that are threads against one process.

mod common;

use common::{compare::compare, refused::refused};
use mbkd_distributed::Threads;

#[test]
fn lists_are_those_of_one_process() {
    let compared = [2, 5].map(|ranks| Threads::run(ranks, compare).iter().sum::<usize>());
    assert!(compared.iter().all(|&lists| lists > 10_000), "{compared:?}");
}

#[test]
fn a_wrong_call_is_the_same_error_on_every_rank() {
    for size in 1..5 {
        Threads::run(size, refused);
    }
}
