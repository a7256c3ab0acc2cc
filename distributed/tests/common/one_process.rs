//! Lists in one process: the library asked about the whole set.

use super::sets::Set;
use mbkd::{Encounter, NeighborLists, PointArrays, PointParams, PointTree, TimeInterval};
use mbkd_distributed::{Neighbor, Particle, Query};
use std::collections::HashMap;

/// Particles by id, and their lists.
pub struct Whole<'a> {
    set: &'a Set,
    particles: Vec<Particle>,
    tree: PointTree,
}

fn tree(particles: &[Particle]) -> PointTree {
    let open: Vec<_> = particles.iter().map(|p| p.open).collect();
    let close: Vec<_> = particles.iter().map(|p| p.close).collect();
    let points = PointArrays { keys: &[&open, &close], active: &[], ids: &[] };
    PointTree::build(&points, &PointParams::default()).unwrap()
}

impl<'a> Whole<'a> {
    pub fn new(set: &'a Set) -> Whole<'a> {
        let mut particles = set.particles.clone();
        particles.sort_by_key(|p| p.id);
        Whole { set, tree: tree(&particles), particles }
    }

    /// Ids and squared distances.
    pub fn lists(&self, time: f32, radius: f32) -> HashMap<u64, Vec<(u64, f32)>> {
        let mut lists = NeighborLists::new();
        let query = self.tree.neighbor_lists(time, radius).periodic(self.set.periods);
        query.with_distances().sorted().in_order().run(&mut lists).unwrap();
        let row = |i: usize| {
            let ends = lists.offsets()[i]..lists.offsets()[i + 1];
            let ids = lists.ids()[ends.clone()].iter().map(|&j| self.particles[j as usize].id);
            ids.zip(lists.distances_squared()[ends].iter().copied()).collect()
        };
        (0..lists.len()).map(|i| (self.particles[i].id, row(i))).collect()
    }

    /// Ids, and times and squared distances.
    pub fn swept(&self, interval: TimeInterval, radius: f32) -> HashMap<u64, Vec<(u64, [f32; 4])>> {
        let query = self.tree.neighbor_lists_swept(interval, radius).periodic(self.set.periods);
        let lists = query.sorted().in_order().collect().unwrap();
        let id = |place: u32| self.particles[place as usize].id;
        let row = |list: &[Encounter]| {
            list.iter().map(|e| (id(e.id), [e.enter, e.leave, e.closest, e.distance_squared])).collect()
        };
        lists.iter().map(|(place, list)| (id(place), row(list))).collect()
    }

    pub fn nearest(&self, query: &Query, time: f32, k: usize) -> Vec<Neighbor> {
        let except = |place: u32| Some(self.particles[place as usize].id) != query.except;
        let periodic = self.tree.periodic(self.set.periods).unwrap();
        let found = periodic.query(query.at, time).filter(except).nearest_n(k);
        let nearest = |n: &mbkd::Neighbor| Neighbor {
            id: self.particles[n.id as usize].id,
            distance_squared: n.distance_squared,
        };
        found.iter().map(nearest).collect()
    }
}

/// Where a particle is at a time: from the nearer end, as the library has it.
pub fn position(p: &Particle, time: f32) -> [f32; 3] {
    let (base, s) = if time < 0.5 { (p.open, time) } else { (p.close, time - 1.0) };
    [0, 1, 2].map(|axis| base[axis] + (p.close[axis] - p.open[axis]) * s)
}
