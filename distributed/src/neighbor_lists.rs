//! Neighbour lists at a time.
//!
//! Two queries for each rank: its own particles among themselves, and among the halo. Both are run by the library with
//! the positions as they were given, and periodic axes are its own too, so that every distance is computed as in one
//! process.

use crate::agree::{Arguments, Call, agree};
use crate::error::{Error, Problem};
use crate::exchange::Exchange;
use crate::lists::Lists;
use crate::particle::Particle;
use crate::reach::{check_radius, check_time};
use crate::step::Step;
use mbkd::{ListQuery, NeighborLists};

/// A neighbour of a particle, and where its values are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalNeighbor {
    /// Its number among the particles of all ranks.
    pub id: u64,
    /// Where its values are on this rank: its index in [`Step::particles`], or, with the number of these added, in
    /// [`Step::halo`].
    pub place: u32,
    /// The squared distance, to the nearest image along periodic axes; computed in f32.
    pub distance_squared: f32,
}

impl<E: Exchange> Step<'_, E> {
    /// For each particle of this rank all others within `radius` at `time`, in the order of ids: what
    /// [`mbkd::PointTree::neighbor_lists`] finds in one process. All ranks call this together.
    ///
    /// Errors: [`Problem::Time`], [`Problem::Radius`], [`Problem::BeyondReach`] where the radius is larger than that of the step's
    /// [`Reach`](crate::Reach), [`Problem::Differs`].
    pub fn neighbor_lists(&self, time: f32, radius: f32) -> Result<Lists<LocalNeighbor>, Error> {
        let checked = check_time(time).and_then(|()| self.check_radius(radius));
        agree(self.exchange, Arguments::new(Call::Lists).times([time; 2]).radius(radius), checked)?;
        let (mut among_own, mut among_halo) = (NeighborLists::new(), NeighborLists::new());
        self.run(self.own.neighbor_lists(time, radius), &mut among_own);
        self.run(self.own.neighbor_lists(time, radius).among(&self.near), &mut among_halo);
        let mut rows = Lists::new();
        for i in 0..self.particles.len() {
            let own = row(&among_own, i, &self.particles, 0);
            let halo = row(&among_halo, i, &self.halo, self.particles.len() as u32);
            rows.push(merged(own, halo, |near| near.id));
        }
        Ok(rows)
    }

    /// Whether the halo is made for a radius.
    pub(crate) fn check_radius(&self, radius: f32) -> Result<(), Problem> {
        check_radius(radius)?;
        if radius <= self.reach.radius { Ok(()) } else { Err(Problem::BeyondReach) }
    }

    fn run(&self, query: ListQuery<'_>, lists: &mut NeighborLists) {
        let query = query.periodic(self.reach.periods).with_distances().sorted().in_order();
        query.run(lists).unwrap_or_else(|error| unreachable!("the query has been checked: {error}"));
    }
}

/// A row of lists in the order of ids, among some particles, of which the first has this place.
fn row(lists: &NeighborLists, row: usize, of: &[Particle], first: u32) -> impl Iterator<Item = LocalNeighbor> {
    let ends = lists.offsets()[row]..lists.offsets()[row + 1];
    let (ids, distances) = (&lists.ids()[ends.clone()], &lists.distances_squared()[ends]);
    ids.iter().zip(distances).map(move |(&place, &distance_squared)| LocalNeighbor {
        id: of[place as usize].id,
        place: first + place,
        distance_squared,
    })
}

/// Two lists in the order of ids as one.
pub(crate) fn merged<T>(
    a: impl Iterator<Item = T>,
    b: impl Iterator<Item = T>,
    id: impl Fn(&T) -> u64,
) -> impl Iterator<Item = T> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    core::iter::from_fn(move || match (a.peek(), b.peek()) {
        (Some(first), Some(second)) if id(second) < id(first) => b.next(),
        (Some(_), _) => a.next(),
        (None, _) => b.next(),
    })
}
