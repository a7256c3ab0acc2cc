//! Neighbour lists over an interval of time.
//!
//! One tree holds the own particles, the halo, and of both the images that come near: copies a whole number of periods away, each
//! coordinate rounded to f32. Lists are those of the own particles at their own places, so an encounter is computed from
//! the particle itself and an image of the other one, whichever rank asks.

use crate::agree::{Arguments, Call, agree};
use crate::error::{Error, Problem};
use crate::exchange::Exchange;
use crate::particle::Particle;
use crate::rows::Rows;
use crate::step::{Step, tree};
use crate::swept_box::{Image, SweptBox, images, moved, near, shift};
use mbkd::{Encounter, TimeInterval};

/// Two particles passing each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// The other particle.
    pub id: u64,
    /// How many periods along each axis the image of it is away that comes near; zero where space is not periodic.
    pub image: [i32; 3],
    /// The first time within the radius.
    pub enter: f32,
    /// The last time within the radius.
    pub leave: f32,
    /// When they are nearest; the first such time.
    pub closest: f32,
    /// The squared distance then.
    pub distance_squared: f32,
}

impl<E: Exchange> Step<'_, E> {
    /// For each particle of this rank all others that come within `radius` at some time of the interval, in the order of
    /// ids and then of images: what [`mbkd::PointTree::neighbor_lists_swept`] finds in one process, along periodic axes
    /// among the particles and their images. All ranks call this together.
    ///
    /// A particle that comes near from both sides of a periodic box is listed with either image. Errors: those of
    /// [`Step::neighbor_lists`], and [`Problem::TooMany`] where a rank has more particles and images than fit.
    pub fn neighbor_lists_swept(&self, interval: TimeInterval, radius: f32) -> Result<Rows<Meeting>, Error> {
        let arguments = Arguments::new(Call::Swept).times([interval.begin(), interval.end()]).radius(radius);
        let (all, whose) = self.with_images();
        let fits = if all.len() < u32::MAX as usize { Ok(()) } else { Err(Problem::TooMany { found: all.len() }) };
        agree(self.exchange, arguments, self.check_radius(radius).and(fits))?;
        let lists = tree(&all).neighbor_lists_swept(interval, radius).collect();
        let lists = lists.unwrap_or_else(|error| unreachable!("the query has been checked: {error}"));
        let mut own: Vec<&[Encounter]> = vec![&[]; self.particles.len()];
        for (place, list) in lists.iter() {
            if let Some(own) = own.get_mut(place as usize) {
                *own = list;
            }
        }
        let mut rows = Rows::new();
        let mut row = Vec::new();
        for list in own {
            row.clear();
            row.extend(list.iter().map(|&Encounter { id: place, enter, leave, closest, distance_squared }| {
                let (id, image) = whose[place as usize];
                Meeting { id, image, enter, leave, closest, distance_squared }
            }));
            row.sort_unstable_by_key(|meeting: &Meeting| (meeting.id, meeting.image));
            rows.push(row.iter().copied());
        }
        Ok(rows)
    }

    /// The own particles, the halo, and the images of both that come near the own ones; and what each of them is.
    fn with_images(&self) -> (Vec<Particle>, Vec<(u64, Image)>) {
        let (periods, radius) = (self.reach.periods, f64::from(self.reach.radius));
        let mut all = [&self.particles[..], &self.halo].concat();
        let mut whose: Vec<(u64, Image)> = all.iter().map(|particle| (particle.id, [0; 3])).collect();
        let rank = self.exchange.rank();
        for i in (0..all.len()).filter(|_| periods.iter().any(Option::is_some)) {
            let (particle, swept) = (all[i], SweptBox::from(&all[i]));
            for image in images(&swept, &self.top.hulls[rank], periods, radius).filter(|image| *image != [0; 3]) {
                let by = shift(image, periods);
                if self.top.boxes[rank].iter().any(|own| near(&swept, own, by, radius)) {
                    let [open, close] = [particle.open, particle.close].map(|at| moved(at, image, periods));
                    all.push(Particle { open, close, ..particle });
                    whose.push((particle.id, image));
                }
            }
        }
        (all, whose)
    }
}
