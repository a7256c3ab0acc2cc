//! Lists in one process: the library asked about the whole set, and comparing all where the library has no such question.

use super::sets::Set;
use mbkd::{Encounter, NeighborLists, PointArrays, PointParams, PointTree, TimeInterval};
use mbkd_distributed::{Nearest, Particle, Query};
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

    fn moved(&self, at: [f32; 3], image: [i32; 3]) -> [f32; 3] {
        let by = |axis: usize| f64::from(image[axis]) * f64::from(self.set.periods[axis].unwrap_or(0.0));
        [0, 1, 2].map(|axis| (f64::from(at[axis]) + by(axis)) as f32)
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

    /// Compares all particles; without periodic axes, asks the library too.
    pub fn nearest(&self, query: &Query, time: f32, k: usize) -> Vec<Nearest> {
        let others = || self.particles.iter().filter(|p| Some(p.id) != query.except);
        let images: Vec<_> = (-3..=3).map(|i| self.moved(query.at, [i; 3])).collect();
        let nearest = |p: &Particle| {
            let at = position(p, time);
            // The nearest image is the nearest along each axis: rounding is monotone.
            let least = |axis: usize| images.iter().map(|q| (at[axis] - q[axis]).abs()).fold(f32::INFINITY, f32::min);
            let [x, y, z] = [0, 1, 2].map(least);
            Nearest { id: p.id, distance_squared: (x * x + y * y) + z * z }
        };
        let mut all: Vec<Nearest> = others().map(nearest).collect();
        all.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        all.truncate(k);
        if self.set.periods == [None; 3] {
            let except = |place: u32| Some(self.particles[place as usize].id) != query.except;
            let found = self.tree.query(query.at, time).filter(except).nearest_n(k);
            let found = found.iter().map(|n| (self.particles[n.id as usize].id, n.distance_squared));
            assert!(found.eq(all.iter().map(|n| (n.id, n.distance_squared))), "the two references differ");
        }
        all
    }
}

/// Where a particle is at a time: from the nearer end, as the library has it.
pub fn position(p: &Particle, time: f32) -> [f32; 3] {
    let (base, s) = if time < 0.5 { (p.open, time) } else { (p.close, time - 1.0) };
    [0, 1, 2].map(|axis| base[axis] + (p.close[axis] - p.open[axis]) * s)
}
