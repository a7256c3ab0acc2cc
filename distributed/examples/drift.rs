//! Particles that drift through a periodic box for some steps, and what the ranks have to say to each other.
//!
//! `cargo run --release --example drift` for one process; `mpirun -n 4 target/release/examples/drift 200000` for four and as many
//! particles in all.

use mbkd::TimeInterval;
use mbkd_distributed::{Counted, Exchange, Mpi, Particle, Query, Reach, Step, distribute};
use mbkd_scenes::Random;
use mpi::Threading;
use std::time::{Duration, Instant};

/// Steps of the simulation.
const STEPS: usize = 5;

/// Neighbours that a particle has on average.
const NEIGHBOURS: f32 = 40.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (universe, _) = mpi::initialize_with_threading(Threading::Funneled).ok_or("MPI has been started already")?;
    let mpi = Mpi::new(&universe.world());
    let count: u64 = std::env::args().nth(1).map_or(Ok(100_000), |count| count.parse())?;
    let spacing = (count.max(1) as f32).cbrt().recip();
    let radius = spacing * (NEIGHBOURS / 4.18879).cbrt();
    let reach = Reach { radius, periods: [Some(1.0); 3] };

    // Each rank begins with every n-th particle, wherever that is.
    let mut particles: Vec<Particle> =
        (0..count).skip(mpi.rank()).step_by(mpi.size()).map(|id| started(id, spacing)).collect();
    let mut work = Vec::new();
    if mpi.rank() == 0 {
        println!("{count} particles on {} ranks, radius {radius:.4} of a periodic box of size 1", mpi.size());
        println!(
            "step | moved to other ranks, kB in all | halo, largest, kB in all | nearest, kB in all | replicated kB per rank | work, largest by mean | seconds of the slowest rank: move, halo, lists, swept, nearest"
        );
    }
    for step in 0..STEPS {
        let mut clock = Clock::new();
        let moving = Counted::new(&mpi);
        let (own, route) = distribute(&moving, &particles, &work, reach.periods)?;
        clock.lap();
        let halo = Counted::new(&mpi);
        let now = Step::new(&halo, &own, &reach)?;
        clock.lap();
        let lists = now.neighbor_lists(0.0, radius)?;
        clock.lap();
        let swept = now.neighbor_lists_swept(TimeInterval::FULL, radius)?;
        clock.lap();
        let for_lists = halo.volume();
        let queries: Vec<Query> = own.iter().map(|p| Query { at: p.open, except: Some(p.id) }).collect();
        let nearest = now.k_nearest(&queries, 0.0, 8)?;
        clock.lap();

        // What the next step costs each particle: itself, and its neighbours.
        work = lists.iter().map(|row| 1 + row.len() as u32).collect();
        let own_work = work.iter().map(|&work| u64::from(work)).sum();
        let replicated = moving.volume().replicated + halo.volume().replicated;
        let mut sums = [
            route.leaving(&mpi) as u64,
            moving.volume().sent,
            for_lists.sent,
            halo.volume().sent - for_lists.sent,
            own_work,
            lists.entries().len() as u64,
            swept.entries().len() as u64,
            nearest.entries().len() as u64,
        ];
        mpi.sum(&mut sums);
        let largest = [largest(&mpi, now.halo().len() as u64), largest(&mpi, own_work)];
        let seconds = clock.laps.map(|lap| largest_lap(&mpi, lap));
        let [left, moved, for_halo, for_nearest, all_work, neighbours, encounters, found] = sums;
        if mpi.rank() == 0 {
            let balance = largest[1] as f64 * mpi.size() as f64 / all_work.max(1) as f64;
            let [a, b, c, d, e] = seconds;
            println!(
                "{step} | {left}, {} | {}, {} | {} | {} | {balance:.3} | {a:.3}, {b:.3}, {c:.3}, {d:.3}, {e:.3}",
                kilobytes(moved),
                largest[0],
                kilobytes(for_halo),
                kilobytes(for_nearest),
                kilobytes(replicated),
            );
            println!("  {neighbours} neighbours, {encounters} encounters during the step, {found} nearest");
        }
        particles = own.iter().map(|p| advanced(p, spacing)).collect();
    }
    Ok(())
}

/// A pseudo-random place, denser towards the middle of the box; the same on every rank.
fn started(id: u64, spacing: f32) -> Particle {
    let mut random = Random(id);
    let at = [0.5 * (random.unit() + random.unit()), random.unit(), random.unit()];
    advanced(&Particle::fixed(id, at), spacing)
}

/// The next step: a vortex about the middle, and a wind that carries everything through the periodic faces. Particles at the
/// rim move a little more than their spacing.
fn advanced(p: &Particle, spacing: f32) -> Particle {
    let open = p.close.map(|x| x - x.floor());
    let way = [1.0 - 1.2 * (open[1] - 0.5), 1.2 * (open[0] - 0.5), 0.3];
    let close = [0, 1, 2].map(|axis| open[axis] + spacing * way[axis]);
    Particle { id: p.id, open, close }
}

/// The times of the parts of a step.
struct Clock {
    since: Instant,
    laps: [Duration; 5],
    next: usize,
}

impl Clock {
    fn new() -> Clock {
        Clock { since: Instant::now(), laps: [Duration::ZERO; 5], next: 0 }
    }

    fn lap(&mut self) {
        self.laps[self.next] = self.since.elapsed();
        self.next += 1;
        self.since = Instant::now();
    }
}

/// The largest number of any rank.
fn largest(mpi: &Mpi, own: u64) -> u64 {
    let all = mpi.gather_bytes(&own.to_le_bytes());
    let number = |bytes: &Vec<u8>| u64::from_le_bytes(bytes[..].try_into().expect("eight bytes of each rank"));
    all.iter().map(number).max().unwrap_or(own)
}

/// The longest time of any rank, in seconds.
fn largest_lap(mpi: &Mpi, own: Duration) -> f64 {
    largest(mpi, own.as_micros() as u64) as f64 * 1e-6
}

fn kilobytes(bytes: u64) -> u64 {
    bytes.div_ceil(1000)
}
