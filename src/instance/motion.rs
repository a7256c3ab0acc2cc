//! Transforms as queries evaluate them.
//!
//! Everything is computed in f64, never fused, by the same code for queries and for callers
//! ([`InstanceTree::local_ray`](crate::InstanceTree::local_ray)), so that answers can be compared bit for bit.

use super::columns::{Columns, product, solved};
use super::distortion::Distortion;
use super::error::InstanceError;
use super::transform::{Pose, Transform};
use crate::geometry::{KeyPhase, Ray, angle_of_chord, lerp, sine_and_cosine};
use crate::primitive::widest_step;
use crate::simd::{Portable, Simd, THREE, magnitude, vector, vector_lanes};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

/// The motion of one instance; its keys are in [`Motions`].
#[derive(Clone, Copy, Debug)]
pub(super) enum Motion {
    /// A static transform: the key, with the inverse of its matrix and its translation.
    Static { key: u32, inverse: Columns },
    /// Matrices, interpolated linearly.
    Matrices { first: u32, keys: u32 },
    /// Poses, interpolated.
    Poses { first: u32, keys: u32 },
}

/// The origin and the direction of a ray in the space of an instance, in three lanes each.
pub(super) struct Inward<S: Simd> {
    pub origin: S::D,
    pub dir: [f32; 4],
}

impl<S: Simd> Inward<S> {
    /// Both as vectors.
    #[inline(always)]
    pub fn vectors(&self, s: S) -> (DVec3, Vec3) {
        let [x, y, z, _] = self.dir;
        (vector(s, self.origin), Vec3::new(x, y, z))
    }
}

/// The keys of all instances.
#[derive(Clone, Default)]
pub(super) struct Motions {
    matrices: Vec<Columns>,
    poses: Vec<PoseKey>,
}

/// A pose and the rotation from it to the next: `rotation cos(angle w) + across sin(angle w)` for `w` in [0, 1], with
/// orthogonal quaternions `rotation` and `across`.
#[derive(Clone, Copy)]
struct PoseKey {
    scale: DVec3,
    translation: DVec3,
    rotation: DQuat,
    across: DQuat,
    /// Half the angle of the rotation in space.
    angle: f64,
}

/// The keys that are not on straight lines between others, and the effect on rounding errors of these as well; all keys if that
/// is not known.
fn without_straight_keys(keys: &[DAffine3], distortion: Distortion) -> (Vec<DAffine3>, Distortion) {
    let step = widest_step(keys.len(), false, |key| keys[key].to_cols_array());
    let kept: Vec<DAffine3> = keys.iter().step_by(step).copied().collect();
    let between = |pair: &[DAffine3]| Distortion::between(pair[0].matrix3, pair[1].matrix3);
    match kept.windows(2).try_fold(distortion, |all, pair| Some(all.max(between(pair)?))) {
        Some(all) => (kept, all),
        None => (keys.to_vec(), distortion),
    }
}

/// Checks that there are keys, of finite numbers and unit quaternions.
fn check_numbers(transform: &Transform, instance: usize) -> Result<(), InstanceError> {
    let wrong = |key: usize, finite: bool, unit: bool| match (finite, unit) {
        (false, _) => Err(InstanceError::NonFinite { instance, key }),
        (true, false) => Err(InstanceError::NotUnit { instance, key }),
        (true, true) => Ok(()),
    };
    match transform {
        Transform::Matrices(keys) if !keys.is_empty() => {
            keys.iter().enumerate().try_for_each(|(key, matrix)| wrong(key, matrix.is_finite(), true))
        }
        Transform::Poses(keys) if !keys.is_empty() => keys.iter().enumerate().try_for_each(|(key, pose)| {
            let finite = pose.scale.is_finite() && pose.translation.is_finite() && pose.rotation.is_finite();
            wrong(key, finite, (pose.rotation.length() - 1.0).abs() <= UNIT)
        }),
        _ => Err(InstanceError::NoKeys { instance }),
    }
}

/// The places at the keys to which a transform maps everything, if each key has one.
fn places_of_point(transform: &Transform) -> Option<Vec<DVec3>> {
    match transform {
        Transform::Matrices(keys) => {
            keys.iter().map(|key| (key.matrix3 == DMat3::ZERO).then_some(key.translation)).collect()
        }
        Transform::Poses(keys) => {
            keys.iter().map(|key| (key.scale == DVec3::ZERO).then_some(key.translation)).collect()
        }
    }
}

/// The number of the first of `more` keys that follow `stored` ones; an error if 32 bits cannot number them all.
fn first_key(stored: usize, more: usize, instance: usize) -> Result<u32, InstanceError> {
    match u32::try_from(stored.saturating_add(more)) {
        Ok(_) => Ok(stored as u32),
        Err(_) => Err(InstanceError::TooManyKeys { instance }),
    }
}

impl Motions {
    /// Checks a transform, adds it, and returns its effect on rounding errors; none of a transform that maps everything to one
    /// point at all times.
    pub fn add(
        &mut self,
        transform: &Transform,
        instance: usize,
    ) -> Result<(Motion, Option<Distortion>), InstanceError> {
        check_numbers(transform, instance)?;
        if let Some(places) = places_of_point(transform) {
            return Ok((self.add_point(&places, instance)?, None));
        }
        let (motion, distortion) = match transform {
            Transform::Matrices(keys) => self.add_matrices(keys, instance),
            Transform::Poses(keys) => self.add_poses(keys, instance),
        }?;
        Ok((motion, Some(distortion)))
    }

    /// Adds the motion of a point, which maps no ray inward ([`Motions::inward`]).
    fn add_point(&mut self, places: &[DVec3], instance: usize) -> Result<Motion, InstanceError> {
        let first = first_key(self.matrices.len(), places.len(), instance)?;
        self.matrices.extend(places.iter().map(|&place| Columns::new(DMat3::ZERO, place)));
        Ok(match *places {
            // With this matrix instead of an inverse, directions become zero.
            [place] => Motion::Static { key: first, inverse: Columns::new(DMat3::ZERO, place) },
            _ => Motion::Matrices { first, keys: places.len() as u32 },
        })
    }

    fn add_matrices(&mut self, keys: &[DAffine3], instance: usize) -> Result<(Motion, Distortion), InstanceError> {
        let Some(&begin) = keys.first() else { return Err(InstanceError::NoKeys { instance }) };
        let mut distortion = Distortion::NONE;
        for (key, matrix) in keys.iter().enumerate() {
            let of_key = Distortion::between(matrix.matrix3, matrix.matrix3);
            distortion = distortion.max(of_key.ok_or(InstanceError::Singular { instance, key })?);
        }
        let first = first_key(self.matrices.len(), keys.len(), instance)?;
        // Equal keys are merged into one.
        if keys.iter().all(|&key| key == begin) {
            self.matrices.push(Columns::new(begin.matrix3, begin.translation));
            let inverse = Columns::new(begin.matrix3.inverse(), begin.translation);
            return Ok((Motion::Static { key: first, inverse }, distortion));
        }
        for (key, pair) in keys.windows(2).enumerate() {
            let between = Distortion::between(pair[0].matrix3, pair[1].matrix3);
            distortion = distortion.max(between.ok_or(InstanceError::SingularBetween { instance, key })?);
        }
        let (kept, distortion) = without_straight_keys(keys, distortion);
        self.matrices.extend(kept.iter().map(|key| Columns::new(key.matrix3, key.translation)));
        Ok((Motion::Matrices { first, keys: kept.len() as u32 }, distortion))
    }

    fn add_poses(&mut self, keys: &[Pose], instance: usize) -> Result<(Motion, Distortion), InstanceError> {
        let Some(begin) = keys.first() else { return Err(InstanceError::NoKeys { instance }) };
        let mut distortion = Distortion::NONE;
        for (key, pose) in keys.iter().enumerate() {
            if pose.scale.abs().min_element() <= 0.0 {
                return Err(InstanceError::Singular { instance, key });
            }
            if key > 0 && pose.scale.signum() != begin.scale.signum() {
                return Err(InstanceError::SingularBetween { instance, key: key - 1 });
            }
            distortion = distortion.max(Distortion::of_scale(pose.scale));
        }
        if keys.iter().all(|key| key == begin) {
            let pose = Pose { rotation: begin.rotation.normalize(), ..*begin };
            return self.add_matrices(&[pose.matrix()], instance);
        }
        let first = first_key(self.poses.len(), keys.len(), instance)?;
        for (i, pose) in keys.iter().enumerate() {
            self.poses.push(PoseKey::new(pose, keys.get(i + 1).unwrap_or(pose)));
        }
        Ok((Motion::Poses { first, keys: keys.len() as u32 }, distortion))
    }

    /// Releases excess capacity.
    pub fn shrink_to_fit(&mut self) {
        self.matrices.shrink_to_fit();
        self.poses.shrink_to_fit();
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.matrices.capacity() * size_of::<Columns>() + self.poses.capacity() * size_of::<PoseKey>()
    }

    /// The columns of interpolated matrices at a time, from the nearer of two keys, so that both are met exactly.
    #[inline(always)]
    fn interpolated<S: Simd>(&self, s: S, first: u32, KeyPhase { segment, w }: KeyPhase) -> [S::D; 4] {
        let at = first as usize + segment;
        let ([ax, ay, az, at], [bx, by, bz, bt]) = (self.matrices[at].load(s), self.matrices[at + 1].load(s));
        if w < 0.5 {
            let w = s.splat_d(w);
            return [ax + (bx - ax) * w, ay + (by - ay) * w, az + (bz - az) * w, at + (bt - at) * w];
        }
        let w = s.splat_d(w - 1.0);
        [bx + (bx - ax) * w, by + (by - ay) * w, bz + (bz - az) * w, bt + (bt - at) * w]
    }

    /// The scale, the rotation and the translation of interpolated poses at a time.
    #[inline(always)]
    fn pose_at(&self, first: u32, KeyPhase { segment, w }: KeyPhase) -> (DVec3, DMat3, DVec3) {
        let at = first as usize + segment;
        let (a, b) = (&self.poses[at], &self.poses[at + 1]);
        let rotation = DMat3::from_quat(a.rotation_at(w));
        (lerp(a.scale, b.scale, w), rotation, lerp(a.translation, b.translation, w))
    }

    /// The matrix from the instance's space to the outer space, at a time in [0, 1].
    pub fn matrix(&self, motion: &Motion, time: f64) -> DAffine3 {
        match *motion {
            Motion::Static { key, .. } => self.matrices[key as usize].matrix(),
            Motion::Matrices { first, keys } => {
                let [x, y, z, translation] = self
                    .interpolated(Portable, first, KeyPhase::new(time, keys as usize))
                    .map(|column| vector(Portable, column));
                DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation }
            }
            Motion::Poses { first, keys } => {
                let (scale, rotation, translation) = self.pose_at(first, KeyPhase::new(time, keys as usize));
                DAffine3 { matrix3: rotation * DMat3::from_diagonal(scale), translation }
            }
        }
    }

    /// Origin and direction of a ray in the instance's space, with the same `t`: the origin in f64, the direction
    /// rounded to f32 once. Returns `None` if the direction is so long or so short that rounding it would lose more
    /// than that.
    ///
    /// Inlined into ray traversal, so that it is compiled for each instruction set.
    #[inline(always)]
    pub fn inward<S: Simd>(&self, s: S, motion: &Motion, ray: &Ray) -> Option<Inward<S>> {
        let (from, dir) = (vector_lanes(s, ray.origin), s.widen(ray.dir.to_array()));
        let time = f64::from(ray.time);
        let (origin, dir) = match *motion {
            Motion::Static { ref inverse, .. } => {
                let [x, y, z, translation] = inverse.load(s);
                (product::<S>(s, [x, y, z], from - translation), product::<S>(s, [x, y, z], dir))
            }
            Motion::Matrices { first, keys } => {
                let [x, y, z, translation] = self.interpolated(s, first, KeyPhase::new(time, keys as usize));
                solved::<S>(s, [x, y, z], from - translation, dir)
            }
            Motion::Poses { first, keys } => {
                let (scale, rotation, translation) = self.pose_at(first, KeyPhase::new(time, keys as usize));
                let back = rotation.transpose();
                let origin = (back * (ray.origin - translation)) / scale;
                (vector_lanes(s, origin), vector_lanes(s, (back * ray.dir.as_dvec3()) / scale))
            }
        };
        let size = magnitude(s, dir);
        let not_short = s.le_d(s.splat_d(SHORTEST), size) & THREE;
        let not_long = s.le_d(size, s.splat_d(SHORTEST.recip())) & THREE;
        (not_short != 0 && not_long == THREE).then(|| Inward { origin, dir: s.narrow(dir) })
    }

    /// The breakpoints of a motion: times at which its velocity may jump, or the rotation has advanced by [`ARC`]. Between
    /// two of them it is smooth. Returns those strictly inside an interval, with its ends.
    pub fn breakpoints(&self, motion: &Motion, begin: f64, end: f64) -> Vec<f64> {
        let (first, keys, rotates) = match *motion {
            Motion::Static { .. } => return vec![begin, end],
            Motion::Matrices { first, keys } => (first, keys, false),
            Motion::Poses { first, keys } => (first, keys, true),
        };
        let segments = keys as usize - 1;
        let mut times = vec![begin];
        let from = ((begin * segments as f64) as usize).min(segments - 1);
        for segment in from..segments {
            let angle = if rotates { 2.0 * self.poses[first as usize + segment].angle } else { 0.0 };
            let steps = (angle / ARC).ceil().max(1.0);
            for step in 0..steps as usize {
                let time = (segment as f64 + step as f64 / steps) / segments as f64;
                if begin < time && time < end {
                    times.push(time);
                }
            }
            if (segment + 1) as f64 / segments as f64 >= end {
                break;
            }
        }
        times.push(end);
        times
    }

    /// The curvature of a motion during an interval without breakpoints.
    pub fn bend(&self, motion: &Motion, [begin, end]: [f64; 2]) -> Bend {
        match *motion {
            Motion::Static { .. } => Bend::Straight,
            Motion::Matrices { .. } => {
                let by = self.matrix(motion, end).matrix3 - self.matrix(motion, begin).matrix3;
                Bend::Matrices([by.x_axis.abs(), by.y_axis.abs(), by.z_axis.abs()])
            }
            Motion::Poses { first, keys } => {
                // The segment is found by the midpoint, since an end may belong to the segment before.
                let segment = KeyPhase::new(0.5 * (begin + end), keys as usize).segment;
                let pose = &self.poses[first as usize + segment];
                let angle = 2.0 * pose.angle * (end - begin) * f64::from(keys - 1);
                // Without the rotation, which takes far longer.
                let [s0, s1] = [begin, end].map(|time| {
                    let KeyPhase { segment, w } = KeyPhase::new(time, keys as usize);
                    let [a, b] = [0, 1].map(|key| &self.poses[first as usize + segment + key]);
                    lerp(a.scale, b.scale, w)
                });
                Bend::Poses { angle, scale: s0.abs().max(s1.abs()), scaled: (s1 - s0).abs() }
            }
        }
    }
}

/// The curvature of a motion during an interval without breakpoints.
pub(super) enum Bend {
    /// No curvature.
    Straight,
    /// How far the columns of the matrix move, per axis.
    Matrices([DVec3; 3]),
    /// The angle of the rotation, the greatest scale, and the change of the scale.
    Poses { angle: f64, scale: DVec3, scaled: DVec3 },
}

impl Bend {
    /// The greatest distance, per axis of the outer space, of a point of the instance's space at a time inside the
    /// interval from the line between its positions at the ends. In its own space the point moves linearly, by at most
    /// `moved`, between places whose coordinates are at most `far`.
    ///
    /// A function `f` is at most `h^2 / 8 |f''|` away from its chord over `h`. With matrices `f = T + M x`, of which
    /// `T`, `M` and `x` are linear: `h^2 f'' = 2 ΔM Δx`. With poses `f = T + R y` and `y = S x`, where `R` rotates at a
    /// uniform rate, by `φ` in all: `h^2 |f''| <= φ^2 |y| + 2 φ |h y'| + |h^2 y''|`, with `|h y'| <= |ΔS x| + |S Δx|`
    /// and `h^2 y'' = 2 ΔS Δx`.
    pub fn bulge(&self, far: DVec3, moved: DVec3) -> DVec3 {
        match *self {
            Bend::Straight => DVec3::ZERO,
            Bend::Matrices([x, y, z]) => 0.25 * (x * moved.x + y * moved.y + z * moved.z),
            Bend::Poses { angle, scale, scaled } => {
                let y = (scale * far).length();
                let slope = (scaled * far + scale * moved).length();
                let bend = 2.0 * (scaled * moved).length();
                DVec3::splat((angle * angle * y + 2.0 * angle * slope + bend) / 8.0)
            }
        }
    }
}

/// The greatest deviation of a quaternion's length from 1.
const UNIT: f64 = 1e-5;

/// The greatest angle (in radians) between the times at which boxes of a rotating instance are made: arcs stick out of
/// their chords by 1/500 of the radius.
const ARC: f64 = 0.125;

/// The least longest component of a direction in an instance's space, and one over the greatest. Rounding to f32 then
/// moves every component by at most 2^-24 of itself, or by 2^-49 of the longest.
const SHORTEST: f64 = 1.0 / (1u128 << 100) as f64;

impl PoseKey {
    fn new(pose: &Pose, next: &Pose) -> PoseKey {
        let rotation = pose.rotation.normalize();
        let mut to = next.rotation.normalize();
        if rotation.dot(to) < 0.0 {
            // The same rotation along the shorter arc.
            to = -to;
        }
        // Exact for small angles, too.
        let angle = angle_of_chord((to - rotation).length());
        let across = to - rotation * rotation.dot(to);
        let length = across.length();
        let across = if length > 0.0 { across * length.recip() } else { DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0) };
        PoseKey { scale: pose.scale, translation: pose.translation, rotation, across, angle }
    }

    #[inline]
    fn rotation_at(&self, w: f64) -> DQuat {
        let (sin, cos) = sine_and_cosine(self.angle * w);
        self.rotation * cos + self.across * sin
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(axis: DVec3, angle: f64, scale: f64, translation: DVec3) -> Pose {
        Pose { rotation: DQuat::from_axis_angle(axis.normalize(), angle), scale: DVec3::splat(scale), translation }
    }

    /// Quaternions may be off by a little, and count as if they were not.
    #[test]
    fn poses_have_the_matrices_of_their_instances() {
        let rotation = DQuat::from_rotation_z(1.2) * (1.0 + 9e-6);
        let pose = Pose { rotation, translation: DVec3::Y, scale: DVec3::new(1.0, 2.0, -3.0) };
        let mut motions = Motions::default();
        let (motion, _) = motions.add(&pose.into(), 0).unwrap();
        assert!(pose.matrix().abs_diff_eq(motions.matrix(&motion, 0.3), 1e-12));
    }

    #[test]
    fn rotations_take_the_shorter_arc_at_a_uniform_rate() {
        let axis = DVec3::new(1.0, 2.0, -0.5);
        for angle in [0.0, 1e-9, 0.3, 2.0, 3.1, -3.0] {
            let (a, mut b) = (pose(axis, 0.2, 1.0, DVec3::ZERO), pose(axis, 0.2 + angle, 1.0, DVec3::ZERO));
            for _ in 0..2 {
                let mut motions = Motions::default();
                let (motion, _) = motions.add(&vec![a, b].into(), 0).unwrap();
                for i in 0..=16 {
                    let w = f64::from(i) / 16.0;
                    let found = motions.matrix(&motion, w).matrix3;
                    let expected = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), 0.2 + angle * w));
                    assert!(found.abs_diff_eq(expected, 1e-14), "{angle} at {w}: {found} {expected}");
                }
                b.rotation = -b.rotation; // the same rotation
            }
        }
    }

    #[test]
    fn rays_are_mapped_into_the_instances_space_and_keep_their_t() {
        let keys = vec![
            pose(DVec3::X, 0.4, 2.0, DVec3::new(1.0, 2.0, 3.0)),
            pose(DVec3::Y, -0.4, 0.5, DVec3::new(-4.0, 2.0, 3.0)),
            pose(DVec3::Z, 1.4, 3.0, DVec3::new(5.0, 0.0, -3.0)),
        ];
        let matrices: Vec<DAffine3> = keys.iter().map(Pose::matrix).collect();
        for transform in [Transform::from(keys.clone()), matrices.into(), keys[1].into()] {
            let mut motions = Motions::default();
            let (motion, _) = motions.add(&transform, 0).unwrap();
            for i in 0..=20 {
                let ray = Ray::new(Vec3::new(0.3, -7.0, 2.0), Vec3::new(0.1, 3.0, -2.0)).at_time(i as f32 / 20.0);
                let (origin, dir) = motions.inward(Portable, &motion, &ray).unwrap().vectors(Portable);
                let local = Ray { origin, dir, ..ray };
                let matrix = motions.matrix(&motion, f64::from(ray.time));
                for t in [0.0, 1.0, 7.0] {
                    let there = matrix.transform_point3(local.point(t));
                    assert!(there.abs_diff_eq(ray.point(t), 1e-5), "{there} {}", ray.point(t));
                }
            }
        }
    }

    #[test]
    fn matrices_on_a_line_keep_two_keys_and_those_on_several_their_bends() {
        let ends: Vec<DAffine3> = [(0.3, 2.0), (0.9, 1.5), (0.2, 1.0)]
            .map(|(angle, size)| pose(DVec3::Y, angle, size, DVec3::new(angle, size, 7.0)).matrix())
            .to_vec();
        let sampled = |lines: usize, by: f64| -> Vec<DAffine3> {
            let step = 64 / lines;
            let at = |key: usize| {
                let (segment, w) = (key / step, (key % step) as f64 / step as f64);
                let [from, to] = [segment, segment + 1].map(|key| ends[key.min(2)].to_cols_array());
                let mut at = DAffine3::from_cols_array(&core::array::from_fn(|i| from[i] * (1.0 - w) + to[i] * w));
                at.translation.y += if key == 20 { by } else { 0.0 };
                at
            };
            (0..=64).map(at).collect()
        };
        for (lines, by, kept) in [(1, 0.0, 2), (2, 0.0, 3), (1, 1e-12, 65)] {
            let (given, mut motions) = (sampled(lines, by), Motions::default());
            let (motion, _) = motions.add(&given.clone().into(), 0).unwrap();
            assert_eq!(motions.matrices.len(), kept, "{lines} lines, off by {by}");
            for (key, given) in given.iter().enumerate() {
                assert!(motions.matrix(&motion, key as f64 / 64.0).abs_diff_eq(*given, 1e-14));
            }
        }
    }

    #[test]
    #[cfg(target_pointer_width = "64")] // with 32 bits no memory holds so many
    fn keys_beyond_what_32_bits_number_are_an_error() {
        let most = u32::MAX as usize;
        assert_eq!(first_key(most - 3, 3, 7), Ok(u32::MAX - 3));
        for (stored, more) in [(most - 3, 4), (most, 1), (0, most + 1), (most + 1, 0), (1, usize::MAX)] {
            assert_eq!(first_key(stored, more, 7), Err(InstanceError::TooManyKeys { instance: 7 }), "{stored} {more}");
        }
    }

    #[test]
    fn directions_that_f32_cannot_hold_are_rejected() {
        let mut motions = Motions::default();
        for (scale, seen) in [(1.0, true), (1e20, true), (1e-20, true), (1e33, false), (1e-33, false)] {
            let (motion, _) = motions.add(&pose(DVec3::X, 1.0, scale, DVec3::ZERO).into(), 0).unwrap();
            let ray = Ray::new(Vec3::ZERO, Vec3::ONE);
            assert_eq!(motions.inward(Portable, &motion, &ray).is_some(), seen, "{scale}");
        }
    }
}
