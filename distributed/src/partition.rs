//! Which rank has which particles: ranges of a Morton curve with the same work.

use crate::agree::{Arguments, Call, agree};
use crate::curve::Curve;
use crate::error::{Error, Problem};
use crate::exchange::{Exchange, gather};
use crate::particle::Particle;
use crate::reach::{check_particles, check_periods};
use crate::route::Route;
use crate::swept_box::{Periods, SweptBox};

/// Moves all particles to the ranks that they belong to, so that each rank has about the same work and particles close
/// to each other: a range of a Morton curve each. All ranks call this together.
///
/// `work[i]` says what particle i costs, such as 1 + its number of neighbours in the last step; zero counts as one. Where it is
/// empty, all cost the same. Ranks may begin with any particles, or none. Returns the particles of this rank in the order of ids,
/// and the route by which they came, for whatever else is known of them. A particle's image along `periods` decides where it
/// belongs; positions stay as they are.
///
/// Cost: sorting the own particles, 63 sums of one number for each rank, and the particles that change ranks. Ranges
/// are exact but for particles at the same place of the curve (in the same cell, 2^21 of them along the box), which stay
/// together. Errors: [`Problem::Coordinate`], [`Problem::FarFromPeriod`], [`Problem::Period`], [`Problem::Length`].
///
/// ```
/// use mbkd_distributed::{Exchange, Particle, Threads, distribute};
/// let counts = Threads::run(2, |ranks| {
///     let all: Vec<_> = (0..10).map(|i| Particle::fixed(i, [i as f32, 0.0, 0.0])).collect();
///     // All begin on one rank; the first costs as much as the others together.
///     let own = if ranks.rank() == 0 { &all[..] } else { &[] };
///     let work: Vec<u32> = own.iter().map(|p| if p.id == 0 { 9 } else { 1 }).collect();
///     distribute(ranks, own, &work, [None; 3]).map(|(particles, _)| particles.len())
/// });
/// assert_eq!(counts, [Ok(1), Ok(9)]);
/// ```
pub fn distribute(
    exchange: &impl Exchange,
    particles: &[Particle],
    work: &[u32],
    periods: [Option<f32>; 3],
) -> Result<(Vec<Particle>, Route), Error> {
    agree(exchange, Arguments::new(Call::Distribute).periods(periods), check(particles, work, periods))?;
    let own = SweptBox::around(particles.iter().map(SweptBox::from));
    let curve = Curve::new(&SweptBox::around(gather(exchange, &[own]).concat()), periods);
    let places: Vec<u64> = particles.iter().map(|particle| curve.place(particle)).collect();
    let mut costs: Vec<(u64, u64)> = (0..)
        .zip(&places)
        .map(|(i, &place): (usize, _)| (place, work.get(i).map_or(1, |&w| w.max(1).into())))
        .collect();
    costs.sort_unstable();
    let bounds = bounds(exchange, &costs);
    let mut to = vec![Vec::new(); exchange.size()];
    for (i, place) in (0..).zip(&places) {
        to[bounds.partition_point(|bound| bound <= place)].push(i);
    }
    let (route, particles) = Route::of(exchange, particles, to, |particle| particle.id);
    Ok((particles, route))
}

fn check(particles: &[Particle], work: &[u32], periods: Periods) -> Result<(), Problem> {
    check_periods(periods)?;
    check_particles(particles, periods)?;
    let fits = work.is_empty() || work.len() == particles.len();
    if fits { Ok(()) } else { Err(Problem::Length { found: work.len() }) }
}

/// Where the ranges of all ranks but the first begin, so that the work of each is the same. `costs` are places and their
/// work, in order.
///
/// By bisection: for each bound, all ranks add up the work before the middle of where it may be, until it is known.
fn bounds(exchange: &impl Exchange, costs: &[(u64, u64)]) -> Vec<u64> {
    let mut before = vec![0];
    before.extend(costs.iter().scan(0, |sum, (_, work)| {
        *sum += work;
        Some(*sum)
    }));
    let work_before = |places: &[u64]| {
        let own = |&place: &u64| before[costs.partition_point(|cost| cost.0 < place)];
        let mut sums: Vec<u64> = places.iter().map(own).collect();
        exchange.sum(&mut sums);
        sums
    };
    const END: u64 = 1 << 63;
    let total = u128::from(work_before(&[END])[0]);
    let ranks = exchange.size() as u128;
    let targets: Vec<u64> = (1..ranks).map(|rank| (total * rank / ranks) as u64).collect();
    // Bounds lie from `lo` to `hi`; the work before these is at most the target, and more.
    let mut lo = vec![(0u64, 0u64); targets.len()];
    let mut hi = vec![(END, total as u64); targets.len()];
    while lo.iter().zip(&hi).any(|(lo, hi)| hi.0 - lo.0 > 1) {
        let middles: Vec<u64> = lo.iter().zip(&hi).map(|(lo, hi)| lo.0 + (hi.0 - lo.0) / 2).collect();
        for (i, sum) in work_before(&middles).into_iter().enumerate() {
            let side = if sum <= targets[i] { &mut lo[i] } else { &mut hi[i] };
            *side = (middles[i], sum);
        }
    }
    let nearer = |(i, &target): (usize, &u64)| {
        let (lo, hi) = (lo[i], hi[i]);
        if target - lo.1 <= hi.1 - target { lo.0 } else { hi.0 }
    };
    targets.iter().enumerate().map(nearer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Threads;

    fn shares(ranks: usize, costs: &[(u64, u64)]) -> Vec<u64> {
        let bounds = Threads::run(ranks, |exchange| {
            let mut own: Vec<_> = costs.iter().copied().skip(exchange.rank()).step_by(ranks).collect();
            own.sort_unstable();
            bounds(exchange, &own)
        });
        assert!(bounds.iter().all(|b| *b == bounds[0] && b.is_sorted()));
        let mut shares = vec![0; ranks];
        for (place, work) in costs {
            shares[bounds[0].partition_point(|bound| bound <= place)] += work;
        }
        shares
    }

    #[test]
    fn work_is_shared_out_to_the_last_particle() {
        let costs: Vec<_> = (0..1000u64).map(|i| (i * i * i * 7919 % (1 << 40), 1 + i % 13)).collect();
        let total: u64 = costs.iter().map(|c| c.1).sum();
        for ranks in 1..9 {
            for share in shares(ranks, &costs) {
                assert!(share.abs_diff(total / ranks as u64) <= 14, "{share} of {total} on {ranks} ranks");
            }
        }
    }

    #[test]
    fn one_place_stays_on_one_rank() {
        assert_eq!(shares(3, &[(5, 1); 100]).iter().filter(|share| **share > 0).count(), 1);
        assert_eq!(shares(4, &[]), [0; 4]);
        let apart = shares(5, &[(1, 1), (2, 1)]);
        assert_eq!(apart.iter().sum::<u64>(), 2);
        assert_eq!(shares(2, &[(0, 1), ((1 << 63) - 1, 1)]), [1, 1]);
        assert_eq!(shares(2, &[(7, 1), (9, 100)]), [1, 100]);
    }
}
