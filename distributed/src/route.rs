//! Which values go where, to be gone again with other values of the same particles.

use crate::agree::{Arguments, Call, agree};
use crate::error::{Error, Problem};
use crate::exchange::{Exchange, swap};
use bytemuck::Pod;

/// The ways of particles from rank to rank: with the particles themselves, and with whatever else is known of them.
///
/// [`distribute`](crate::distribute) returns the one by which particles came to their ranks,
/// [`Step::halo_route`](crate::Step::halo_route) the one by which copies came to others.
///
/// ```
/// use mbkd_distributed::{Exchange, Particle, Threads, distribute};
/// let masses = Threads::run(2, |ranks| {
///     // Both particles of a rank go to the same one.
///     let x = 1.0 - ranks.rank() as f32;
///     let own = [0, 1].map(|i| Particle::fixed(2 * ranks.rank() as u64 + i, [x, 0.0, 0.0]));
///     let mass = own.map(|p| 10.0 * p.id as f32);
///     let (particles, route) = distribute(ranks, &own, &[], [None; 3])?;
///     let mass = route.carry(ranks, &mass)?;
///     assert!(particles.iter().zip(&mass).all(|(p, m)| *m == 10.0 * p.id as f32));
///     Ok::<_, mbkd_distributed::Error>(mass)
/// });
/// assert_eq!(masses, [Ok(vec![20.0, 30.0]), Ok(vec![0.0, 10.0])]);
/// ```
#[derive(Clone, Debug)]
pub struct Route {
    /// Values that the sender has.
    len: usize,
    /// By rank, the index of each value that goes there.
    sent: Vec<Vec<u32>>,
    /// Which of the values that arrive stands where.
    order: Vec<usize>,
}

impl Route {
    /// Sends items, `to[r]` being those that go to rank r; returns the way, and what arrived in the order of its keys.
    pub(crate) fn of<T: Pod, K: Ord>(
        exchange: &impl Exchange,
        items: &[T],
        to: Vec<Vec<u32>>,
        key: impl Fn(&T) -> K,
    ) -> (Route, Vec<T>) {
        let mut route = Route { len: items.len(), sent: to, order: Vec::new() };
        let arrived = route.send(exchange, items);
        route.order = (0..arrived.len()).collect();
        route.order.sort_by_key(|&i| key(&arrived[i]));
        let sorted = route.order.iter().map(|&i| arrived[i]).collect();
        (route, sorted)
    }

    /// Takes values the same way: `values[i]` belongs to particle i of the sender; returns one value for each particle
    /// that arrived, in the order of these. All ranks call this together, of routes that were made together.
    ///
    /// Errors: [`Problem::Length`] where there is not one value for each particle, [`Problem::Ranks`] where more or fewer ranks
    /// made the route.
    pub fn carry<T: Pod>(&self, exchange: &impl Exchange, values: &[T]) -> Result<Vec<T>, Error> {
        let checked = match (self.sent.len(), values.len()) {
            (ranks, _) if ranks != exchange.size() => Err(Problem::Ranks { found: ranks }),
            (_, values) if values != self.len => Err(Problem::Length { found: values }),
            _ => Ok(()),
        };
        agree(exchange, Arguments::new(Call::Carry).k(size_of::<T>()), checked)?;
        let arrived = self.send(exchange, values);
        Ok(self.order.iter().map(|&i| arrived[i]).collect())
    }

    fn send<T: Pod>(&self, exchange: &impl Exchange, values: &[T]) -> Vec<T> {
        let parts: Vec<Vec<T>> =
            self.sent.iter().map(|sent| sent.iter().map(|&i| values[i as usize]).collect()).collect();
        swap(exchange, &parts).concat()
    }

    /// How many values go to other ranks than this one.
    pub fn leaving(&self, exchange: &impl Exchange) -> usize {
        let others = (0..).zip(&self.sent).filter(|(rank, _)| *rank != exchange.rank());
        others.map(|(_, sent): (usize, _)| sent.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Particle, Threads, distribute};

    #[test]
    fn a_route_is_between_the_ranks_that_made_it() {
        let own = [Particle::fixed(0, [0.0; 3])];
        let routes = Threads::run(2, |ranks| distribute(ranks, &own, &[], [None; 3]).map(|(_, route)| route));
        let [Ok(route), Ok(_)] = &routes[..] else { panic!("two routes") };
        for size in [1, 3] {
            let carried = Threads::run(size, |ranks| route.carry(ranks, &[1u8]));
            assert_eq!(carried, vec![Err(Error { rank: 0, problem: Problem::Ranks { found: 2 } }); size]);
        }
    }
}
