//! Random sets of points in f32 and f64 that move, bend, and exist for a while, and all their distances in plain code.

use crate::random::{Places, Random};
use crate::scenes::refined;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Neighbor, PointArrays, PointError, PointParams, PointStructure, PointTree, SimdLevel, TimeInterval};

/// Points with positions at evenly spaced keys.
#[derive(Clone, Debug)]
pub struct Cloud {
    pub keys: Vec<Vec<DVec3>>,
    pub active: Vec<TimeInterval>,
    pub ids: Vec<u32>,
    /// Whether they are kept in f64; otherwise all are f32 numbers.
    pub double: bool,
    pub places: Places,
    /// The number of keys that describe the motion: others are on straight lines between them.
    kept: usize,
}

impl Cloud {
    pub fn random(random: &mut Random, most: usize, double: bool) -> Cloud {
        let places = Places::random(random, 16);
        let count = random.count(most);
        let keys = random.pick(&[1, 1, 2, 2, 2, 3, 4, 5, 9, 12]).min(1 + 60_000 / (count + 1));
        let (style, far) = (random.below(8), places.scale * random.pick(&[1e-6, 0.01, 0.1, 0.5, 2.0, 9.0]));
        let (shift, fast) = (random.vec() * far, random.pick(&[1, 1, 2, 17]));
        let start: Vec<DVec3> = (0..count).map(|_| places.place(random)).collect();
        let ways: Vec<DVec3> = start.iter().map(|_| random.vec() * far).collect();
        let mut place = |key: usize, i: usize| {
            let phase = key as f64 / (keys.max(2) - 1) as f64;
            match style {
                _ if !i.is_multiple_of(fast) => start[i],
                0 => start[i] + shift * phase,
                1 => start[i] + [shift, -shift, DVec3::new(shift.y, shift.z, 0.0)][i % 3] * phase,
                // All are in one place once.
                2 => places.offset + (start[i] - places.offset) * (1.0 - 2.0 * phase),
                3 => start[i] + ways[i] * f64::from(key.is_multiple_of(2)),
                4 => start[i] + random.vec() * far,
                5 => start[i] + ways[i] * random.power(-6, 0) * phase,
                _ => start[i] + ways[i] * phase,
            }
        };
        let mut keys: Vec<Vec<DVec3>> = (0..keys).map(|key| (0..count).map(|i| place(key, i)).collect()).collect();
        if random.one_in(5) {
            // So many that seventeen time slices of each are not too many.
            keys = refined(random, keys, (20_000 / (count + 1)).min(900), places.scale);
        }
        // Some at exactly the same places.
        for i in (1..count).step_by(random.pick(&[2, 7, usize::MAX])) {
            let from = random.below(i);
            keys.iter_mut().for_each(|key| key[i] = key[from]);
        }
        let partly = random.pick(&[1, 2, 10, usize::MAX, usize::MAX, usize::MAX]);
        let active = (0..count).map(|_| if random.one_in(partly) { random.interval() } else { TimeInterval::FULL });
        let active = active.collect();
        let mut cloud = Cloud { keys, active, ids: (0..count as u32).collect(), double, places, kept: 0 };
        if random.one_in(6) {
            (1..count).rev().for_each(|i| cloud.ids.swap(i, random.below(i + 1)));
        }
        if double {
            // One number that f32 does not have, so that the set is kept in f64.
            if let Some(first) = cloud.keys[0].first_mut() {
                first.x += places.scale * 1.000_000_1e-5;
            }
            cloud.kept = cloud.kept_keys();
        } else {
            cloud.round(DVec3::ZERO);
        }
        cloud
    }

    /// Rounds positions relative to an origin, which they are relative to from then on.
    pub fn round(&mut self, origin: DVec3) {
        self.keys.iter_mut().flatten().for_each(|p| *p = (*p - origin).as_vec3().as_dvec3());
        self.double = false;
        self.kept = self.kept_keys();
    }

    /// Takes a set of f32 numbers for one in f64, as [`mbkd::Precision::Double`] does.
    pub fn widen(&mut self) {
        self.double = true;
        self.kept = self.kept_keys();
    }

    /// The rule of [`mbkd::PointArrays`]: keys on lines between every second, third, … are dropped, up to 4 times 2^-24, or 2^-53
    /// in f64.
    fn kept_keys(&self) -> usize {
        let keys = &self.keys;
        if keys.iter().all(|key| *key == keys[0]) {
            return 1;
        }
        let (segments, ulp) = (keys.len() - 1, if self.double { 0.5 * f64::EPSILON } else { 0.5f64.powi(24) });
        let straight = |kept: usize| {
            let step = segments / kept;
            (0..segments).all(|key| {
                let (first, w) = (key / step * step, (key % step) as f64 / step as f64);
                (0..self.len()).all(|i| {
                    let (a, b) = (keys[first][i], keys[first + step][i]);
                    let size = a.abs().max(b.abs()) * (4.0 * ulp);
                    (keys[key][i] - (a * (1.0 - w) + b * w)).abs().cmple(size).all()
                })
            })
        };
        let kept = (1..=segments).filter(|&kept| segments.is_multiple_of(kept)).find(|&kept| straight(kept));
        kept.unwrap_or(segments) + 1
    }

    pub fn len(&self) -> usize {
        self.active.len()
    }

    /// Number of keys that are kept, at least 2.
    pub fn segments(&self) -> usize {
        (self.kept - 1).max(1)
    }

    /// A position at one of the kept keys.
    pub fn key(&self, key: usize, i: usize) -> DVec3 {
        if self.kept < 2 { self.keys[0][i] } else { self.keys[key * ((self.keys.len() - 1) / (self.kept - 1))][i] }
    }

    /// The position of a point at a time of the shutter, interpolated from the nearer key.
    pub fn at(&self, i: usize, time: f32) -> DVec3 {
        let segments = self.segments();
        if self.double {
            let along = f64::from(time) * segments as f64;
            let segment = (along as usize).min(segments - 1);
            let (a, b, s) = (self.key(segment, i), self.key(segment + 1, i), along - segment as f64);
            return if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) };
        }
        let along = time * segments as f32;
        let segment = (along as usize).min(segments - 1);
        let (a, b) = (self.key(segment, i).as_vec3(), self.key(segment + 1, i).as_vec3());
        let s = along - segment as f32;
        let p = if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) };
        p.as_dvec3()
    }

    /// The squared distance of two positions, in the precision of the set.
    pub fn squared(&self, a: DVec3, b: DVec3) -> f32 {
        if self.double {
            let d = a - b;
            return ((d.x * d.x + d.y * d.y) + d.z * d.z) as f32;
        }
        let d: Vec3 = a.as_vec3() - b.as_vec3();
        (d.x * d.x + d.y * d.y) + d.z * d.z
    }

    /// All points that exist at a time, in order of (distance, id).
    pub fn sorted(&self, q: DVec3, time: f32) -> Vec<Neighbor> {
        let exist = (0..self.len()).filter(|&i| self.active[i].contains(time));
        let neighbor = |i| Neighbor { id: self.ids[i], distance_squared: self.squared(self.at(i, time), q) };
        let mut all: Vec<Neighbor> = exist.map(neighbor).collect();
        all.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        all
    }

    /// A tree; positions are given in the precision of the set.
    pub fn tree(&self, params: &PointParams) -> Result<PointTree, PointError> {
        self.with_set(|single, double| match (single, double) {
            (Some(set), _) => PointTree::build(&set, params),
            (_, Some(set)) => PointTree::build(&set, params),
            _ => PointTree::build::<[Vec3]>(&[], params),
        })
    }

    /// Calls a function with the points as a build takes them: in f32, or in f64.
    pub fn with_set<T>(
        &self,
        take: impl FnOnce(Option<PointArrays<'_, Vec3>>, Option<PointArrays<'_, DVec3>>) -> T,
    ) -> T {
        let (active, ids) = (&self.active[..], &self.ids[..]);
        if self.double {
            let keys: Vec<&[DVec3]> = self.keys.iter().map(Vec::as_slice).collect();
            return take(None, Some(PointArrays { keys: &keys, active, ids }));
        }
        let keys: Vec<Vec<Vec3>> = self.keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
        let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
        take(Some(PointArrays { keys: &keys, active, ids }), None)
    }

    /// A place near the points, often one of them.
    pub fn query(&self, random: &mut Random, time: f32) -> DVec3 {
        let i = random.below(self.len());
        let member =
            if self.len() == 0 || time.is_nan() { self.places.offset } else { self.at(i, time.clamp(0.0, 1.0)) };
        let far = random.pick(&[0.0, 1e-7, 1e-3, 0.1, 1.0, 3.0]);
        let q = member + random.vec() * self.places.scale * far;
        if self.double { q } else { q.as_vec3().as_dvec3() }
    }
}

/// Any parameters.
pub fn params(random: &mut Random) -> PointParams {
    let structure = match random.below(6) {
        0 => PointStructure::Linear,
        1 => PointStructure::TimeSlices(random.pick(&[1, 2, 3, 5, 8, 17])),
        2 | 3 => PointStructure::Kd,
        _ => PointStructure::Automatic,
    };
    let simd = random.pick(&SimdLevel::available());
    PointParams { structure, simd, max_references: random.pick(&[1.0, 2.0, 8.0, 30.0]), ..PointParams::default() }
}
