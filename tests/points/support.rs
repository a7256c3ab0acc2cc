//! Brute force over all points, in plain code: the reference for every query.
#![allow(dead_code)] // each test file uses its part

pub use crate::random::Random;
use mbkd::{
    MovingPoint, Neighbor, PointArrays, PointParams, PointStructure, PointTree, SimdLevel, TimeInterval, glam::Vec3,
};

/// Points with positions at evenly spaced keys, and when they are active.
#[derive(Clone, Debug)]
pub struct Cloud {
    pub keys: Vec<Vec<Vec3>>,
    pub active: Vec<TimeInterval>,
}

impl Cloud {
    pub fn still(at: Vec<Vec3>) -> Cloud {
        let active = vec![TimeInterval::FULL; at.len()];
        Cloud { keys: vec![at], active }
    }

    pub fn moving(points: &[MovingPoint]) -> Cloud {
        Cloud {
            keys: vec![points.iter().map(|p| p.open).collect(), points.iter().map(|p| p.close).collect()],
            active: points.iter().map(|p| p.active).collect(),
        }
    }

    pub fn len(&self) -> usize {
        self.active.len()
    }

    /// The position of a point at a time: interpolated in f32 from the nearer key.
    pub fn at(&self, point: usize, time: f32) -> Vec3 {
        let segments = self.keys.len() - 1;
        if segments == 0 {
            return self.keys[0][point];
        }
        let along = time * segments as f32;
        let segment = (along as usize).min(segments - 1);
        let (a, b) = (self.keys[segment][point], self.keys[segment + 1][point]);
        let s = along - segment as f32;
        let along = |a: f32, b: f32| if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) };
        Vec3::new(along(a.x, b.x), along(a.y, b.y), along(a.z, b.z))
    }

    /// All points that exist at a time, in order of (distance, id).
    pub fn sorted(&self, q: Vec3, time: f32) -> Vec<Neighbor> {
        let mut all: Vec<Neighbor> = (0..self.len())
            .filter(|&i| self.active[i].contains(time))
            .map(|i| {
                let d = self.at(i, time) - q;
                Neighbor { id: i as u32, distance_squared: (d.x * d.x + d.y * d.y) + d.z * d.z }
            })
            .collect();
        all.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        all
    }
}

/// The kinds of sets that searches are tested on.
pub const KINDS: [&str; 18] = [
    "uniform",
    "surface",
    "equal",
    "line",
    "lattice",
    "plane",
    "two places",
    "denormal",
    "huge",
    "coherent",
    "random",
    "fast few",
    "wild speeds",
    "short intervals",
    "converging",
    "tiny steps",
    "fast cluster",
    "flows",
];

/// `count` points of a kind.
pub fn cloud(kind: &str, count: usize, rng: &mut Random) -> Cloud {
    let mut points = Vec::new();
    for i in 0..count {
        let p = rng.vec();
        let spacing = 2.0 / (count as f32).cbrt();
        let grid = |x: f32| (x * 6.0).round() / 4.0;
        points.push(match kind {
            "uniform" => MovingPoint::fixed(p),
            "surface" => MovingPoint::fixed(p.normalize_or_zero() + p * 1e-3),
            "equal" => MovingPoint::fixed(Vec3::new(0.3, -0.1, 0.7)),
            "line" => MovingPoint::fixed(Vec3::new(p.x, 0.25, -1.0)),
            "lattice" => MovingPoint::fixed(Vec3::new(grid(p.x), grid(p.y), grid(p.z))),
            "plane" => MovingPoint::new(Vec3::new(p.x, 0.5, p.z), Vec3::new(p.z, 0.5, p.x)),
            "two places" => MovingPoint::fixed(Vec3::splat(if p.x < 0.0 { -1.0 } else { 1.0 })),
            "denormal" => MovingPoint::new(p * 1e-39, p * 2e-39),
            "huge" => MovingPoint::new(p * 1e18, -p * 1e18),
            "coherent" => MovingPoint::new(p, p + Vec3::new(0.4 + 0.1 * p.y, 0.2, -0.1 * p.x)),
            "random" => MovingPoint::new(p, p + rng.vec() * spacing * 2.0),
            "fast few" => MovingPoint::new(p, if i % 17 == 0 { p + rng.vec() * 3.0 } else { p + rng.vec() * 1e-3 }),
            // All fast points are neighbours of each other at mid-shutter (and `Automatic` does not separate them).
            "fast cluster" if i % 17 == 0 => {
                let (middle, half) = (p * 0.1 + 5.0, rng.vec().normalize_or(Vec3::X) * 1.5);
                MovingPoint::new(middle - half, middle + half)
            }
            "fast cluster" => MovingPoint::new(p, p + rng.vec() * 1e-3),
            // Three flows through each other in a rotating field: points are divided by motion.
            "flows" => {
                let way = [Vec3::X, Vec3::NEG_X, Vec3::Y][i % 3];
                MovingPoint::new(p, p + way + Vec3::new(-p.y, p.x, 0.0))
            }
            "wild speeds" => MovingPoint::new(p, p + rng.vec() * 10f32.powi((rng.bits() % 12) as i32 - 6)),
            "short intervals" => {
                let begin = rng.unit() * 0.95;
                let end = (begin + 0.02 + 0.08 * rng.unit()).min(1.0);
                MovingPoint::new(p, p + rng.vec() * spacing).with_active(TimeInterval::new(begin, end).unwrap())
            }
            // All points coincide at mid-shutter, and are on a grid before.
            "converging" => {
                let p = Vec3::new(grid(p.x), grid(p.y), grid(p.z));
                MovingPoint::new(p, -p)
            }
            "tiny steps" => MovingPoint::new(p + 1000.0, p + 1000.0 + rng.vec() * 1e-4),
            _ => unreachable!("{kind}"),
        });
    }
    Cloud::moving(&points)
}

/// Every structure that trees of points can have.
pub const STRUCTURES: [PointStructure; 4] =
    [PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(3), PointStructure::Kd];

/// The tree of `cloud` with that structure and instruction set.
pub fn build(cloud: &Cloud, structure: PointStructure, simd: SimdLevel) -> PointTree {
    let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
    let params = PointParams { structure, simd, max_references: 3.0, ..PointParams::default() };
    PointTree::build(&PointArrays { keys: &keys, active: &cloud.active, ids: &[] }, &params).unwrap()
}
