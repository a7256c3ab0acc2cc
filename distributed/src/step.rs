//! A step: the particles of a rank, what of other ranks comes near them, and trees of both.

use crate::agree::{Arguments, Call, agree};
use crate::error::{Error, Problem};
use crate::exchange::Exchange;
use crate::particle::{Particle, Points};
use crate::reach::{Reach, check_particles};
use crate::route::Route;
use crate::top::Top;
use core::fmt;
use mbkd::{PointParams, PointTree};

/// A step of a simulation on one rank: all ranks call it together, and each gets the lists of its own particles.
///
/// Particles move on straight ways between the places at times 0 and 1. Every list has the bits that it has in one process.
///
/// ```
/// use mbkd::TimeInterval;
/// use mbkd_distributed::{Exchange, Particle, Query, Reach, Step, Threads};
/// Threads::run(2, |ranks| {
///     // Rank 0 has a particle at rest, rank 1 one that passes it.
///     let own = match ranks.rank() {
///         0 => Particle::fixed(10, [0.0; 3]),
///         _ => Particle { id: 20, open: [-4.0, 0.5, 0.0], close: [4.0, 0.5, 0.0] },
///     };
///     let step = Step::new(ranks, &[own], &Reach::within(1.0))?;
///     assert_eq!(step.halo()[0].id, 30 - own.id);
///     assert_eq!(step.neighbor_lists(0.5, 1.0)?.row(0)[0].distance_squared, 0.25);
///     assert!(step.neighbor_lists(0.0, 1.0)?.row(0).is_empty());
///     assert_eq!(step.neighbor_lists_swept(TimeInterval::FULL, 1.0)?.row(0)[0].closest, 0.5);
///     let queries = [Query { at: [0.0, 1.0, 0.0], except: None }];
///     assert_eq!(step.k_nearest(&queries, 0.5, 1)?.row(0)[0].id, 20);
///     Ok::<_, mbkd_distributed::Error>(())
/// });
/// ```
pub struct Step<'e, E> {
    pub(crate) exchange: &'e E,
    pub(crate) reach: Reach,
    /// In the order of ids, as the halo is: the numbers by which trees settle ties are then in that order too.
    pub(crate) particles: Vec<Particle>,
    pub(crate) halo: Vec<Particle>,
    route: Route,
    pub(crate) top: Top,
    /// Trees of the own particles, and of the halo.
    pub(crate) own: PointTree,
    pub(crate) near: PointTree,
}

impl<E> fmt::Debug for Step<'_, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (particles, halo) = (self.particles.len(), self.halo.len());
        let mut step = f.debug_struct("Step");
        step.field("reach", &self.reach).field("particles", &particles).field("halo", &halo).finish_non_exhaustive()
    }
}

impl<'e, E: Exchange> Step<'e, E> {
    /// Prepares a step for radii up to that of `reach`: replicates the top of all ranks' particles, sends each rank what
    /// may come within the radius of its particles during the step, and builds trees. All ranks call this together.
    ///
    /// Particles may be on any rank, also all on one; answers do not depend on it. Costs little where they come from
    /// [`distribute`](crate::distribute), and where the reach is short: everything that is within it is copied. Errors:
    /// [`Problem`] names them; [`Problem::TooMany`] is found before anything is sent.
    pub fn new(exchange: &'e E, particles: &[Particle], reach: &Reach) -> Result<Step<'e, E>, Error> {
        Step::of_fewer(u32::MAX.into(), exchange, particles, reach)
    }

    /// [`Step::new`] for ranks that hold fewer particles than a limit, copies included.
    fn of_fewer(limit: u64, exchange: &'e E, particles: &[Particle], reach: &Reach) -> Result<Step<'e, E>, Error> {
        let arguments = Arguments::new(Call::Step).radius(reach.radius).periods(reach.periods);
        agree(exchange, arguments, reach.check().and_then(|()| check_particles(particles, reach.periods)))?;
        let mut particles = particles.to_vec();
        particles.sort_by_key(|particle| particle.id);
        let (top, chunks) = Top::new(exchange, &particles, reach.periods);
        let to = top.halo(exchange.rank(), &chunks, &particles, reach.radius.into());
        let mut held: Vec<u64> = to.iter().map(|to| to.len() as u64).collect();
        held[exchange.rank()] += particles.len() as u64;
        exchange.sum(&mut held);
        // All ranks see the same numbers.
        if let Some(rank) = held.iter().position(|&held| held >= limit) {
            return Err(Error { rank, problem: Problem::TooMany { found: held[rank] as usize } });
        }
        let (route, halo) = Route::of(exchange, &particles, to, |particle| particle.id);
        let (own, near) = (tree(&particles), tree(&halo));
        Ok(Step { exchange, reach: *reach, particles, halo, route, top, own, near })
    }

    /// The particles of this rank, in the order of ids: list i is that of particle i.
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// Copies of particles of other ranks that may come within the radius, in the order of ids.
    pub fn halo(&self) -> &[Particle] {
        &self.halo
    }

    /// How the halo came: takes values of [`Step::particles`], in this order, to those that have copies of them.
    pub fn halo_route(&self) -> &Route {
        &self.route
    }
}

/// The tree of particles that have been checked.
fn tree(particles: &[Particle]) -> PointTree {
    let tree = PointTree::build(&Points(particles), &PointParams::default());
    tree.unwrap_or_else(|error| unreachable!("the particles have been checked: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Threads;

    #[test]
    fn a_halo_that_does_not_fit_is_an_error_on_every_rank() {
        let errors = |limit: u64, radius: f32| {
            Threads::run(3, |ranks| {
                // Two particles on rank 0, one on each of the others.
                let at = |x: f32| Particle::fixed(x as u64, [x, 0.0, 0.0]);
                let own = [at(ranks.rank() as f32), at(10.0)];
                let own = if ranks.rank() == 0 { &own[..] } else { &own[..1] };
                Step::of_fewer(limit, ranks, own, &Reach::within(radius)).err()
            })
        };
        let error = Some(Error { rank: 0, problem: Problem::TooMany { found: 4 } });
        assert_eq!(errors(4, f32::INFINITY), [error; 3]);
        assert_eq!(errors(5, f32::INFINITY), [None; 3]);
        // The particle at 10 is a copy nowhere; ranks 0 and 1 hold three.
        let error = Some(Error { rank: 0, problem: Problem::TooMany { found: 3 } });
        assert_eq!(errors(3, 1.0), [error; 3]);
        assert_eq!(errors(4, 1.0), [None; 3]);
    }
}
