//! Points in f32 or f64, and their encounters and distances by comparing all pairs in plain arithmetic.

#![allow(dead_code)] // not all of it without threads

use crate::encounter::{Pair, images};
use crate::support::{self, Cloud, Random};
use mbkd::{
    Encounter, EncounterLists, MovingPoint, PointArrays, PointParams, PointStructure, PointTree, Precision, SimdLevel,
    TimeInterval,
    glam::{DVec3, Vec3},
};

/// Points with positions at evenly spaced keys.
#[derive(Clone, Debug)]
pub struct Set {
    /// Numbers of f32 if `single`.
    pub keys: Vec<Vec<DVec3>>,
    pub active: Vec<TimeInterval>,
    pub single: bool,
}

/// Lengths of the periodic box around points of a kind.
pub const LENGTHS: [f64; 3] = [1.0, 0.7, 1.9];

/// The kinds of places and motions that images are tested on.
pub const KINDS: [&str; 7] =
    ["in the box", "at the faces", "half a period apart", "periods away", "drifting", "far and fast", "some at rest"];

/// Structures of trees in f64.
pub const DOUBLE_STRUCTURES: [PointStructure; 3] =
    [PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(3)];

/// Clusters in f64: their sizes, how far they are apart, speeds, and how far away all of it is.
pub const CLUSTERS: [(f64, f64, f64, f64); 8] = [
    (1.0, 1e7, 0.3, 0.0),
    (1e-3, 1e7, 1e-4, 0.0),
    (1e-2, 0.0, 3e-3, 1e9),
    (1e-2, 0.0, 3.0, 1e9),
    (1.0, 0.0, 2.0, 0.0),
    (1e-3, 1e7, 1e3, 0.0),
    (1e-20, 1e-3, 1e-20, 0.0),
    (1e-25, 1e-22, 1e-24, 0.0),
];

/// The lengths of the box along some axes.
pub fn periods_along(axes: [bool; 3]) -> [Option<f64>; 3] {
    [0, 1, 2].map(|axis| axes[axis].then_some(LENGTHS[axis]))
}

/// Sets of every kind, some with more than two keys.
pub fn clouds(count: usize) -> impl Iterator<Item = (String, Cloud, Random)> {
    support::KINDS.into_iter().enumerate().map(move |(number, kind)| {
        let mut rng = Random(500 + number as u64);
        let mut cloud = support::cloud(kind, count, &mut rng);
        if number % 3 != 0 {
            for _ in 0..number % 3 {
                let last = cloud.keys.last().unwrap();
                let next = last.iter().zip(&cloud.keys[0]).map(|(a, b)| if rng.unit() < 0.5 { *a } else { *b });
                let next = next.collect();
                cloud.keys.push(next);
            }
        }
        (format!("{kind}, {} keys", cloud.keys.len()), cloud, rng)
    })
}

pub fn size(cloud: &Cloud) -> f32 {
    cloud.keys.iter().flatten().fold(1e-40, |most, p| p.abs().max_element().max(most))
}

impl From<&Cloud> for Set {
    fn from(cloud: &Cloud) -> Set {
        let keys = cloud.keys.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect();
        Set { keys, active: cloud.active.clone(), single: true }
    }
}

impl Set {
    /// Points that are always active.
    pub fn new(keys: Vec<Vec<DVec3>>, single: bool) -> Set {
        let active = vec![TimeInterval::FULL; keys[0].len()];
        let mut set = Set { keys, active, single };
        set.round();
        set
    }

    /// Points in f32 with two keys.
    pub fn of_points(points: &[MovingPoint]) -> Set {
        Set::from(&Cloud::moving(points))
    }

    /// Points of a kind around a box with these lengths.
    pub fn of_kind(kind: &str, count: usize, keys: usize, single: bool, rng: &mut Random) -> Set {
        let lengths = DVec3::from_array(LENGTHS);
        let mut set = Set { keys: vec![Vec::new(); keys], active: Vec::new(), single };
        for i in 0..count {
            let unit = (rng.dvec() + 1.0) * 0.5;
            let mut whole = |most: usize| DVec3::from_array([0; 3].map(|_| rng.below(most) as f64));
            let off = [0.0, 1e-16, -1e-16, 6e-8, -6e-8, 1e-3];
            let at = lengths
                * match kind {
                    "at the faces" => whole(2) + off[i % 6],
                    "half a period apart" => whole(4) * 0.5 + off[i % 6],
                    "periods away" => unit + whole(4) - 1.0,
                    _ => unit,
                };
            let speed = match kind {
                "drifting" | "in the box" => 0.05,
                "far and fast" => 1.5,
                "half a period apart" | "at the faces" if i % 2 == 0 => 1e-3,
                "some at rest" if i % 2 == 0 => 0.0,
                _ => 0.3,
            };
            let drift = if kind == "drifting" { DVec3::new(2.3, -0.7, 1.1) } else { DVec3::ZERO };
            let mut place = at;
            for key in &mut set.keys {
                key.push(if single { place.as_vec3().as_dvec3() } else { place });
                place += rng.dvec() * speed + drift;
            }
            set.active.push(part_of_the_shutter(kind == "periods away" && i % 3 == 0, rng));
        }
        set
    }

    /// Two clusters of this size, at this distance, in f64.
    pub fn clusters(
        count: usize,
        keys: usize,
        (size, apart, speed): (f64, f64, f64),
        partly_active: bool,
        rng: &mut Random,
    ) -> Set {
        let mut set = Set { keys: vec![Vec::new(); keys], active: Vec::new(), single: false };
        for i in 0..count {
            let mut at = rng.dvec() * size + DVec3::new(0.7, 1.0, -0.3) * (apart * (i % 2) as f64);
            for key in &mut set.keys {
                key.push(at);
                at += rng.dvec() * speed + DVec3::X * (3.0 * speed);
            }
            set.active.push(part_of_the_shutter(partly_active && i % 3 == 0, rng));
        }
        set
    }

    /// The same points far away, where coordinates keep fewer of their bits.
    pub fn far_away(mut self, by: f64) -> Set {
        for at in self.keys.iter_mut().flatten() {
            *at += DVec3::new(1.0, -0.7, 0.3) * by;
        }
        self.round();
        self
    }

    fn round(&mut self) {
        if self.single {
            self.keys.iter_mut().flatten().for_each(|p| *p = p.as_vec3().as_dvec3());
        }
    }

    pub fn len(&self) -> usize {
        self.active.len()
    }

    /// The numbers of segments between keys.
    pub fn segments(&self) -> usize {
        (self.keys.len() - 1).max(1)
    }

    fn key(&self, number: usize, point: usize) -> DVec3 {
        self.keys[number.min(self.keys.len() - 1)][point]
    }

    pub fn tree(&self, structure: PointStructure, simd: SimdLevel) -> PointTree {
        let precision = if self.single { Precision::Single } else { Precision::Double };
        let params = PointParams { structure, simd, precision, max_references: 3.0 };
        if self.single {
            let keys: Vec<Vec<Vec3>> = self.keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
            let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
            return PointTree::build(&PointArrays { keys: &keys, active: &self.active, ids: &[] }, &params).unwrap();
        }
        let keys: Vec<&[DVec3]> = self.keys.iter().map(Vec::as_slice).collect();
        PointTree::build(&PointArrays { keys: &keys, active: &self.active, ids: &[] }, &params).unwrap()
    }

    /// Structures that trees of the set can have.
    pub fn structures(&self) -> impl Iterator<Item = PointStructure> + use<> {
        DOUBLE_STRUCTURES.into_iter().chain(self.single.then_some(PointStructure::Kd))
    }

    /// Lengths as lists use them: those of points in f32 are rounded to it.
    pub fn rounded(&self, periods: [Option<f64>; 3]) -> [Option<f64>; 3] {
        periods.map(|length| length.map(|length| if self.single { f64::from(length as f32) } else { length }))
    }

    /// By how much points are moved to all images that may be nearest to another point, and to more.
    pub fn images(&self, periods: [Option<f64>; 3]) -> Vec<DVec3> {
        self.images_among(self, periods)
    }

    /// The same with those of another set.
    pub fn images_among(&self, other: &Set, periods: [Option<f64>; 3]) -> Vec<DVec3> {
        let periods = self.rounded(periods);
        let all = || self.keys.iter().chain(&other.keys).flatten();
        let extent = all().copied().fold(DVec3::MIN, DVec3::max) - all().copied().fold(DVec3::MAX, DVec3::min);
        let most = (0..3).filter_map(|axis| Some((extent[axis] / periods[axis]?) as i32 + 1));
        images(periods, most.max().unwrap_or(0))
    }

    /// The position of a point at a time, as queries compute it: from the nearer key.
    pub fn at(&self, i: usize, time: f32) -> DVec3 {
        let segments = self.segments();
        if self.single {
            let along = time * segments as f32;
            let segment = (along as usize).min(segments - 1);
            let [a, b] = [segment, segment + 1].map(|number| self.key(number, i).as_vec3());
            let s = along - segment as f32;
            let place = if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) };
            return place.as_dvec3();
        }
        // The product is exact.
        let along = f64::from(time) * segments as f64;
        let segment = (along as usize).min(segments - 1);
        let [a, b] = [segment, segment + 1].map(|number| self.key(number, i));
        let s = along - segment as f64;
        if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) }
    }

    /// The displacement between the nearest images of two places, and its square, as lists at a time compute them.
    pub fn apart(&self, [a, b]: [DVec3; 2], periods: [Option<f64>; 3]) -> ([f32; 3], f32) {
        if self.single {
            let d = b.as_vec3() - a.as_vec3();
            let near = [0, 1, 2].map(|axis| match periods[axis].map(|length| length as f32) {
                Some(length) => d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length,
                None => d[axis],
            });
            return (near, (near[0] * near[0] + near[1] * near[1]) + near[2] * near[2]);
        }
        let d = b - a;
        let near = [0, 1, 2].map(|axis| match periods[axis] {
            Some(length) => d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length,
            None => d[axis],
        });
        (near.map(|x| x as f32), ((near[0] * near[0] + near[1] * near[1]) + near[2] * near[2]) as f32)
    }

    /// The squared distance of the nearest images of a point and one of another set at a time.
    pub fn squared(&self, (i, other, j): (usize, &Set, usize), periods: [Option<f64>; 3], time: f32) -> f32 {
        self.apart([self.at(i, time), other.at(j, time)], periods).1
    }

    /// The encounter of a point and one of another set in any of their images.
    pub fn meet(
        &self,
        (i, other, j): (usize, &Set, usize),
        images: &[DVec3],
        times: [f64; 2],
        square: f64,
    ) -> Option<Encounter> {
        let sets = [(self, i), (other, j)];
        let pair = Pair {
            id: j as u32,
            segments: sets.map(|(set, _)| set.segments()),
            keys: &|k, number| sets[k].0.key(number, sets[k].1),
            active: [self.active[i], other.active[j]],
            images,
        };
        pair.meet(times, square)
    }

    /// The encounters of a point with all others.
    pub fn meet_others(
        &self,
        i: usize,
        interval: TimeInterval,
        images: &[DVec3],
        radius: impl Fn(usize) -> f32,
    ) -> Vec<Encounter> {
        let times = [interval.begin(), interval.end()].map(f64::from);
        let others = (0..self.len()).filter(|&j| j != i);
        others.filter_map(|j| self.meet((i, self, j), images, times, f64::from(radius(j)).powi(2))).collect()
    }

    /// The encounters of all points.
    pub fn meet_all(
        &self,
        interval: TimeInterval,
        images: &[DVec3],
        radius: impl Fn(usize, usize) -> f32,
    ) -> Vec<Vec<Encounter>> {
        (0..self.len()).map(|i| self.meet_others(i, interval, images, |j| radius(i, j))).collect()
    }
}

fn part_of_the_shutter(only: bool, rng: &mut Random) -> TimeInterval {
    let begin = rng.unit() * 0.8;
    if only { TimeInterval::new(begin, begin + 0.2).unwrap() } else { TimeInterval::FULL }
}

/// Where points are as they are given, without images.
pub const AS_GIVEN: [DVec3; 1] = [DVec3::ZERO];

/// Whether lists hold these encounters, in any order.
pub fn check(found: &EncounterLists, expected: &[Vec<Encounter>], what: &str) {
    let mut rows = vec![None; expected.len()];
    for (id, row) in found.iter() {
        let mut row = row.to_vec();
        row.sort_unstable_by_key(|e| e.id);
        assert!(rows[id as usize].replace(row).is_none(), "{what}: point {id} has two lists");
    }
    for (i, (row, expected)) in rows.iter().zip(expected).enumerate() {
        assert_eq!(row.as_deref().unwrap_or_default(), expected, "{what}: point {i}");
    }
}
