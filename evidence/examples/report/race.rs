//! Ways to answer the same queries, timed in turns and judged by what is really nearest.

use mbkd::MovingPoint;
use mbkd_evidence::point_sets::{Query, judge, true_distances};
use mbkd_evidence::timing::{self, Times};
use rayon::prelude::*;
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

/// Finds the ids of the nearest neighbours of a query.
type Answer<'a> = Box<dyn FnMut(Query, &mut Vec<u32>) + 'a>;

/// A way to answer queries.
pub struct Contestant<'a> {
    /// Method and setting.
    pub name: String,
    /// The search.
    pub answer: Answer<'a>,
}

/// What a contestant's answers cost and are worth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Nanoseconds per query.
    pub ns: f64,
    /// Share of the places that hold no neighbour.
    pub wrong: f64,
    /// Mean of how much farther found points are than the true ones, relative to these.
    pub farther: f64,
}

/// Points, queries among them, and the truth about some of these.
pub struct Ground {
    /// What moves.
    pub points: Vec<MovingPoint>,
    /// What is asked.
    pub queries: Vec<Query>,
    /// Queries spread over all of them, each with the distances of its nearest neighbours.
    judged: Vec<(Query, Vec<f64>)>,
}

impl Ground {
    /// Looks at every point for `judged` of the queries and their `k` nearest. Uses all threads.
    pub fn new(points: Vec<MovingPoint>, queries: Vec<Query>, k: usize, judged: usize) -> Ground {
        let some: Vec<Query> = queries.iter().step_by((queries.len() / judged).max(1)).copied().collect();
        let judged = some.into_par_iter().map(|query| (query, true_distances(&points, query, k))).collect();
        Ground { points, queries, judged }
    }
}

/// How long a race may take.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Rounds, of which the median counts.
    pub rounds: usize,
    /// Seconds of a contestant's turn. Who is slow answers fewer queries, spread over all of them.
    pub turn: f64,
}

/// Judges all contestants by the same queries, then times them in turns.
pub fn race(ground: &Ground, effort: Effort, contestants: &mut [Contestant]) -> Vec<Outcome> {
    let Ground { points, queries, judged } = ground;
    let places: usize = judged.iter().map(|(_, truth)| truth.len()).sum();
    let mut outcomes = vec![Outcome::default(); contestants.len()];
    let mut strides = Vec::new();
    let mut found = Vec::new();
    for (contestant, outcome) in contestants.iter_mut().zip(&mut outcomes) {
        let mut seconds = 0.0;
        for (query, truth) in judged {
            let start = Instant::now();
            (contestant.answer)(*query, &mut found);
            seconds += start.elapsed().as_secs_f64();
            let error = judge(points, *query, &found, truth);
            outcome.wrong += error.wrong as f64 / places.max(1) as f64;
            outcome.farther += error.farther / judged.len() as f64;
        }
        let all = seconds / judged.len() as f64 * queries.len() as f64;
        strides.push(((all / effort.turn).ceil() as usize).clamp(1, queries.len() / 20 + 1));
    }
    let mut times = vec![Vec::new(); contestants.len()];
    for _ in 0..effort.rounds {
        for ((contestant, &stride), times) in contestants.iter_mut().zip(&strides).zip(&mut times) {
            let start = Instant::now();
            for &query in queries.iter().step_by(stride) {
                (contestant.answer)(query, &mut found);
                black_box(&found);
            }
            times.push(start.elapsed().as_nanos() as f64 / queries.len().div_ceil(stride) as f64);
        }
    }
    for (outcome, times) in outcomes.iter_mut().zip(times) {
        outcome.ns = Times::of(times).median;
    }
    outcomes
}

/// Does some work with one thread, however many there are.
pub fn on_one_thread<T: Send>(work: impl FnOnce() -> Result<T, Box<dyn Error>> + Send) -> Result<T, Box<dyn Error>> {
    // An error that may change threads is one in words.
    Ok(timing::on_one_thread(|| work().map_err(|e| e.to_string()))?)
}

/// The median time of some runs, in seconds, and what the last one made.
pub fn timed<T>(rounds: usize, mut run: impl FnMut() -> T) -> (f64, T) {
    let mut times = Vec::new();
    loop {
        let start = Instant::now();
        let made = run();
        times.push(start.elapsed().as_secs_f64());
        if times.len() >= rounds {
            return (Times::of(times).median, made);
        }
    }
}
