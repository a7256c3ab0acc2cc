//! Every list of every rank against the one of one process, bit for bit.

use super::one_process::{Whole, position};
use super::sets::{Set, sets};
use mbkd::TimeInterval;
use mbkd_distributed::{Exchange, Particle, Query, Reach, Route, Step, distribute};

/// Compares all lists of all sets. Returns how many lists of this rank were compared.
pub fn compare(ranks: &impl Exchange) -> usize {
    sets().iter().map(|set| lists_of(ranks, set)).sum()
}

/// Lists for each particle at a few times; every particle is on one rank.
fn lists_of(ranks: &impl Exchange, set: &Set) -> usize {
    let whole = Whole::new(set);
    let (own, route) = partition(ranks, set);
    let step = Step::new(ranks, &own, &Reach { radius: set.radius, periods: set.periods }).unwrap();
    assert_eq!(step.particles(), own);
    carried(ranks, set, &own, &route, &step);

    let mut compared = 0;
    let all = [step.particles(), step.halo()].concat();
    for (time, radius) in [(0.0, set.radius), (0.37, set.radius), (0.5, 0.5 * set.radius), (1.0, set.radius)] {
        let expected = whole.lists(time, radius);
        let lists = step.neighbor_lists(time, radius).unwrap();
        for (particle, row) in own.iter().zip(lists.iter()) {
            let found: Vec<_> = row.iter().map(|near| (near.id, near.distance_squared)).collect();
            assert_eq!(found, expected[&particle.id], "{}, time {time}, particle {}", set.name, particle.id);
            assert!(row.iter().all(|near| all[near.place as usize].id == near.id));
        }
        compared += lists.len();
    }
    for interval in [TimeInterval::FULL, TimeInterval::new(0.2, 0.7).unwrap()] {
        let expected = whole.swept(interval, set.radius);
        let lists = step.neighbor_lists_swept(interval, set.radius).unwrap();
        for (particle, row) in own.iter().zip(lists.iter()) {
            let found: Vec<_> = row.iter().map(|e| (e.id, [e.enter, e.leave, e.closest, e.distance_squared])).collect();
            assert_eq!(found, expected[&particle.id], "{}, swept, particle {}", set.name, particle.id);
            assert!(row.iter().all(|e| all[e.place as usize].id == e.id));
        }
        compared += lists.len();
    }
    compared + nearest_of(ranks, set, &whole, &step)
}

/// The nearest of each third particle, and of places far from the own ones and outside of everything.
fn nearest_of<E: Exchange>(ranks: &E, set: &Set, whole: &Whole, step: &Step<E>) -> usize {
    let mut compared = 0;
    // The last one is more than there are.
    for (time, k) in [(0.0, 1), (0.37, 8), (1.0, 0), (0.8, set.particles.len() / 2), (0.5, set.particles.len() + 3)] {
        let many = k > 8;
        let own = step.particles().iter().step_by(if many { 40 } else { 3 });
        let mut queries: Vec<_> = own.map(|p| Query { at: position(p, time), except: Some(p.id) }).collect();
        let x = ranks.rank() as f32 / ranks.size() as f32;
        queries.push(Query { at: [1.0 - x, x, 0.5], except: None });
        queries.push(Query { at: [-1.9 + x, 1.5, 0.5], except: Some(u64::MAX) });
        // Of which a period more would not leave much.
        queries.push(Query { at: [-1e-12; 3], except: None });
        queries.push(Query { at: [3.25; 3], except: Some(set.particles.first().map_or(7, |p| p.id)) });
        if ranks.rank() == 1 {
            queries.clear();
        }
        let rows = step.k_nearest(&queries, time, k).unwrap();
        assert_eq!(rows.len(), queries.len());
        for (query, row) in queries.iter().zip(rows.iter()) {
            assert_eq!(row, whole.nearest(query, time, k), "{}, k {k}, time {time}, {query:?}", set.name);
        }
        compared += rows.len();
    }
    compared
}

/// Hands the set out by turns, and has it distributed by some work.
fn partition(ranks: &impl Exchange, set: &Set) -> (Vec<Particle>, Route) {
    let dealt = dealt(ranks, set);
    let work: Vec<u32> = dealt.iter().map(|p| (p.id >> 24) as u32 % 7).collect();
    let (own, route) = distribute(ranks, &dealt, &work, set.periods).unwrap();
    let mut count = [own.len() as u64];
    ranks.sum(&mut count);
    assert_eq!(count[0] as usize, set.particles.len(), "{}: no particle is lost or comes twice", set.name);
    (own, route)
}

fn dealt(ranks: &impl Exchange, set: &Set) -> Vec<Particle> {
    set.particles.iter().skip(ranks.rank()).step_by(ranks.size()).copied().collect()
}

/// Values go with their particles.
fn carried<E: Exchange>(ranks: &E, set: &Set, own: &[Particle], route: &Route, step: &Step<E>) {
    let value = |p: &Particle| p.id as f32 * 0.5;
    let values: Vec<f32> = dealt(ranks, set).iter().map(value).collect();
    let arrived = route.carry(ranks, &values).unwrap();
    assert!(arrived.iter().copied().eq(own.iter().map(value)), "{}", set.name);
    let halo = step.halo_route().carry(ranks, &arrived).unwrap();
    assert!(halo.iter().copied().eq(step.halo().iter().map(value)), "{}", set.name);
}
