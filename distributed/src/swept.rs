//! Neighbour lists over an interval of time: made as those at one time are, of the own particles among themselves and among the
//! halo.

use crate::agree::{Arguments, Call, agree};
use crate::error::Error;
use crate::exchange::Exchange;
use crate::lists::Lists;
use crate::neighbor_lists::merged;
use crate::particle::Particle;
use crate::step::Step;
use mbkd::{EncounterLists, SweptQuery, TimeInterval};

/// A particle that passes another, and when. [`mbkd::Encounter`] has more on times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// The other particle.
    pub id: u64,
    /// Where its values are on this rank: its index in [`Step::particles`], or, with the number of these added, in
    /// [`Step::halo`].
    pub place: u32,
    /// The first time within the radius.
    pub enter: f32,
    /// The last time within the radius. Along periodic axes they may part in between, where different images meet.
    pub leave: f32,
    /// When they are nearest; the first such time.
    pub closest: f32,
    /// The squared distance then.
    pub distance_squared: f32,
}

impl<E: Exchange> Step<'_, E> {
    /// For each particle of this rank all others that come within `radius` at some time of the interval, in the order of
    /// ids: what [`mbkd::PointTree::neighbor_lists_swept`] finds in one process, along periodic axes with
    /// [`mbkd::SweptQuery::periodic`]. All ranks call this together.
    ///
    /// A pair has one encounter, whatever images it meets in. Errors: those of [`Step::neighbor_lists`].
    pub fn neighbor_lists_swept(&self, interval: TimeInterval, radius: f32) -> Result<Lists<Encounter>, Error> {
        let arguments = Arguments::new(Call::Swept).times([interval.begin(), interval.end()]).radius(radius);
        agree(self.exchange, arguments, self.check_radius(radius))?;
        let query = self.own.neighbor_lists_swept(interval, radius);
        let (among_own, among_halo) = (self.encounters(query), self.encounters(query.among(&self.near)));
        let mut rows = Lists::new();
        for i in 0..self.particles.len() {
            let own = named(among_own.row(i), &self.particles, 0);
            let halo = named(among_halo.row(i), &self.halo, self.particles.len() as u32);
            rows.push(merged(own, halo, |encounter| encounter.id));
        }
        Ok(rows)
    }

    fn encounters(&self, query: SweptQuery<'_>) -> EncounterLists {
        let lists = query.periodic(self.reach.periods).sorted().in_order().collect();
        lists.unwrap_or_else(|error| unreachable!("the query has been checked: {error}"))
    }
}

/// Encounters with some particles, of which the first has this place.
fn named(row: &[mbkd::Encounter], of: &[Particle], first: u32) -> impl Iterator<Item = Encounter> {
    row.iter().map(move |&mbkd::Encounter { id: place, enter, leave, closest, distance_squared }| Encounter {
        id: of[place as usize].id,
        place: first + place,
        enter,
        leave,
        closest,
        distance_squared,
    })
}
