//! The k nearest particles of places, whichever rank has them.
//!
//! Each rank searches its own particles first. The distance of the k-th found bounds the others; where there are fewer, the
//! replicated top says within which distance there are enough. So one round is enough: ranks that have a box within the
//! bound are queried with the bound, and what they find is merged in the order of (distance, id).
//!
//! Along periodic axes it is the query that is moved by whole periods, as [`mbkd::PeriodicQuery`] moves it, and sent once for each
//! image that may be the nearest of some particle. A particle counts at the nearest of its images.

use crate::agree::{Arguments, Call, agree};
use crate::curve::Curve;
use crate::error::{Error, Problem};
use crate::exchange::{Exchange, swap};
use crate::lists::Lists;
use crate::particle::Particle;
use crate::reach::{check_time, fits, near_zero};
use crate::step::Step;
use crate::swept_box::{Image, SweptBox, moved, near, shift};
use bytemuck::{Pod, Zeroable};
use mbkd::NeighborBatch;
use std::collections::BTreeMap;

/// A place to find particles near.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// Where.
    pub at: [f32; 3],
    /// A particle that does not count, such as the one that is at the place itself.
    pub except: Option<u64>,
}

/// A particle that was found, on any rank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbor {
    /// Its number among the particles of all ranks.
    pub id: u64,
    /// The squared distance, computed in f32.
    pub distance_squared: f32,
}

/// A search among the particles of a rank for a query, of this rank or of another.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Request {
    except: u64,
    excepts: u32,
    query: u32,
    at: [f32; 3],
    radius: f32,
}

/// A particle on its way back.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Answer {
    id: u64,
    distance_squared: f32,
    query: u32,
}

/// Queries that are looked at together.
const TOGETHER: usize = 256;

impl<E: Exchange> Step<'_, E> {
    /// For each query the `k` nearest particles of all ranks at `time`, in the order of (distance, id): what
    /// [`mbkd::NeighborQuery::nearest_n`] finds in one process, along periodic axes [`mbkd::PeriodicQuery::nearest_n`]. All ranks
    /// call this together, each with queries of its own, or none.
    ///
    /// The radius of the step does not limit the search. Cost: a search among the own particles for each query, and for those near
    /// other ranks' boxes one more there; searches use all threads. Far from the own particles many ranks are queried: let those
    /// query that are near. Errors: [`Problem::Time`], [`Problem::Query`], [`Problem::Differs`].
    pub fn k_nearest(&self, queries: &[Query], time: f32, k: usize) -> Result<Lists<Neighbor>, Error> {
        let checked = check_time(time).and_then(|()| self.check_queries(queries));
        agree(self.exchange, Arguments::new(Call::Nearest).times([time; 2]).k(k), checked)?;
        let here = |(i, query): (u32, &Query)| Request {
            except: query.except.unwrap_or(0),
            excepts: query.except.is_some().into(),
            query: i,
            at: moved(query.at, [0; 3], self.reach.periods),
            radius: f32::INFINITY,
        };
        let searches: Vec<Request> = (0..).zip(queries).map(here).collect();
        let mut own = Lists::new();
        for (search, found) in searches.iter().zip(self.search(&searches, time, k).iter()) {
            own.push(self.named(found, search, k));
        }
        let mut requests = vec![Vec::new(); self.exchange.size()];
        if k > 0 {
            for members in together(&searches) {
                self.add_requests(queries, &searches, &members, &own, k, &mut requests);
            }
        }
        let received = swap(self.exchange, &requests);
        let found = self.search(&received.concat(), time, k);
        let mut found = found.iter();
        let mut answers = vec![Vec::new(); received.len()];
        for (answers, received) in answers.iter_mut().zip(&received) {
            for (request, found) in received.iter().zip(&mut found) {
                let answer = |Neighbor { id, distance_squared }| Answer { id, distance_squared, query: request.query };
                answers.extend(self.named(found, request, k).map(answer));
            }
        }
        Ok(merged(&own, swap(self.exchange, &answers).concat(), k))
    }

    fn check_queries(&self, queries: &[Query]) -> Result<(), Problem> {
        if queries.len() >= u32::MAX as usize {
            return Err(Problem::Query { index: queries.len() });
        }
        let bad = |query: &Query| !(fits(query.at) && near_zero(query.at, self.reach.periods));
        queries.iter().position(bad).map_or(Ok(()), |index| Err(Problem::Query { index }))
    }

    /// The nearest of this rank's particles: `k`, and one more in the place of one that does not count.
    fn search(&self, searches: &[Request], time: f32, k: usize) -> NeighborBatch {
        let places: Vec<([f32; 3], f32)> = searches.iter().map(|search| (search.at, time)).collect();
        let most = if k > 0 { k.saturating_add(1) } else { 0 };
        self.own.nearest_n_batch_with(&places, most, |i, query| query.radius(searches[i].radius))
    }

    /// What a search has found, without what does not count.
    fn named(&self, found: &[mbkd::Neighbor], search: &Request, k: usize) -> impl Iterator<Item = Neighbor> {
        let except = (search.excepts != 0).then_some(search.except);
        let nearest = |&mbkd::Neighbor { id, distance_squared }| Neighbor {
            id: self.particles[id as usize].id,
            distance_squared,
        };
        found.iter().map(nearest).filter(move |nearest| Some(nearest.id) != except).take(k)
    }

    /// Adds the requests to each rank for some queries that are close to each other.
    fn add_requests(
        &self,
        queries: &[Query],
        searches: &[Request],
        members: &[u32],
        own: &Lists<Neighbor>,
        k: usize,
        requests: &mut [Vec<Request>],
    ) {
        let rank = self.exchange.rank();
        let around = SweptBox::around(members.iter().map(|&i| SweptBox::of_place(searches[i as usize].at)));
        let found = |i: u32| {
            let row = own.row(i as usize);
            row.get(k - 1).map_or(f64::INFINITY, |last| upper(f64::from(last.distance_squared).sqrt()))
        };
        let at_home = self.top.hulls[rank].contains(&around) && members.iter().all(|&i| found(i) < f64::INFINITY);
        // One more, in the place of one that does not count.
        let enough = if at_home { f64::INFINITY } else { self.top.enough(&around, (k as u64).saturating_add(1)) };
        let bound = |i: u32| found(i).min(enough);
        let most = members.iter().map(|&i| bound(i)).fold(0.0, f64::max);
        let periods = self.reach.periods;
        for (to, requests) in requests.iter_mut().enumerate() {
            let mut boxes: BTreeMap<Image, Vec<&SweptBox>> = BTreeMap::new();
            for (image, near) in self.top.near(to, &around, most) {
                boxes.entry(image).or_default().push(near);
            }
            for (image, boxes) in boxes.iter().filter(|(image, _)| (to, **image) != (rank, [0; 3])) {
                let by = shift(*image, periods);
                for &i in members {
                    let (search, bound) = (searches[i as usize], bound(i));
                    let place = SweptBox::of_place(search.at);
                    if boxes.iter().any(|b| near(&place, b, by, bound)) {
                        let at = moved(queries[i as usize].at, *image, periods);
                        requests.push(Request { at, radius: (bound as f32).next_up(), ..search });
                    }
                }
            }
        }
    }
}

/// A distance whose square in f32 is not below that of the one given.
fn upper(distance: f64) -> f64 {
    distance * (1.0 + 1e-6) + 1e-18
}

/// Searches in groups that are close to each other.
fn together(searches: &[Request]) -> impl Iterator<Item = Vec<u32>> + use<> {
    let hull = SweptBox::around(searches.iter().map(|search| SweptBox::of_place(search.at)));
    let curve = Curve::new(&hull, [None; 3]);
    let place = |search: &Request| (curve.place(&Particle::fixed(0, search.at)), search.query);
    let mut order: Vec<(u64, u32)> = searches.iter().map(place).collect();
    order.sort_unstable();
    let groups = order.len().div_ceil(TOGETHER);
    (0..groups).map(move |group| {
        let members = &order[group * TOGETHER..order.len().min((group + 1) * TOGETHER)];
        members.iter().map(|member| member.1).collect()
    })
}

/// The k nearest of what was found here and elsewhere.
fn merged(own: &Lists<Neighbor>, mut answers: Vec<Answer>, k: usize) -> Lists<Neighbor> {
    answers.sort_unstable_by_key(|answer| answer.query);
    let (mut rows, mut answers, mut row) = (Lists::new(), answers.into_iter().peekable(), Vec::new());
    for (i, found) in (0..).zip(own.iter()) {
        row.clear();
        row.extend_from_slice(found);
        while let Some(Answer { id, distance_squared, .. }) = answers.next_if(|answer| answer.query == i) {
            row.push(Neighbor { id, distance_squared });
        }
        if row.len() > found.len() {
            // Of each particle the nearest image.
            row.sort_unstable_by(|a, b| a.id.cmp(&b.id).then(a.distance_squared.total_cmp(&b.distance_squared)));
            row.dedup_by_key(|nearest| nearest.id);
            row.sort_unstable_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        }
        rows.push(row.iter().copied().take(k));
    }
    rows
}
