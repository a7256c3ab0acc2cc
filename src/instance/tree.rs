//! The tree over instances, and its accessors.

use super::error::InstanceError;
use super::extent::Extent;
use super::hit::MAX_NESTING;
use super::motion::Motions;
use super::placements::{Placed, Placements};
use super::transform::Transform;
use crate::error::BuildError;
use crate::geometry::{Aabb, LinearBounds, Ray, TimeInterval};
use crate::layout::{ValidationError, WideSource, WideTree};
use crate::parallel;
use crate::params::WideParams;
use crate::primitive::PrimitiveSet;
use crate::progress::{Callback, Progress};
use crate::ray::{Outline, RayTree};
use crate::simd::{Portable, SimdLevel};
use glam::DAffine3;
use std::collections::HashMap;
use std::sync::Arc;

/// The contents of an [`Instance`].
#[derive(Clone, Debug)]
pub enum InstanceOf {
    /// A tree of meshes and other shapes.
    Tree(Arc<RayTree>),
    /// A tree of instances.
    Instances(Arc<InstanceTree>),
}

impl From<Arc<RayTree>> for InstanceOf {
    fn from(tree: Arc<RayTree>) -> InstanceOf {
        InstanceOf::Tree(tree)
    }
}

impl From<Arc<InstanceTree>> for InstanceOf {
    fn from(tree: Arc<InstanceTree>) -> InstanceOf {
        InstanceOf::Instances(tree)
    }
}

impl InstanceOf {
    /// Identifies the tree by its address.
    pub(super) fn address(&self) -> usize {
        match self {
            InstanceOf::Tree(tree) => Arc::as_ptr(tree) as usize,
            InstanceOf::Instances(tree) => Arc::as_ptr(tree) as usize,
        }
    }

    /// The number of levels of instances in it.
    fn levels(&self) -> usize {
        match self {
            InstanceOf::Tree(_) => 0,
            InstanceOf::Instances(tree) => tree.levels,
        }
    }

    /// Whether there is no primitive in it.
    fn is_empty(&self) -> bool {
        match self {
            InstanceOf::Tree(tree) => tree.bounds().is_none(),
            InstanceOf::Instances(tree) => tree.bounds.is_none(),
        }
    }

    /// Its extent in its own space; without subtrees if there is nothing in it.
    fn extent(&self) -> Extent {
        if self.is_empty() {
            return Extent { subtrees: Vec::new(), outline: Outline::EVERYTHING, reach: 0.0, deviation: 0.0 };
        }
        let (subtrees, frame, outline, deviation) = match self {
            InstanceOf::Tree(tree) => (tree.linear_bounds_of_subtrees(), tree.frame(), *tree.outline(), 0.0),
            InstanceOf::Instances(tree) => {
                let frame = tree.placements.frame();
                let swept = LinearBounds::fixed(frame.bounds);
                let bounds = tree.wide.linear_bounds(frame).unwrap_or(swept);
                let subtrees = tree.wide.bounds_of_children(frame).unwrap_or_else(|| vec![bounds]);
                (subtrees, frame, Outline::EVERYTHING, tree.placements.deviation)
            }
        };
        Extent { subtrees, outline, reach: f64::from(frame.reach) / frame.scale, deviation }
    }
}

/// A tree, placed.
///
/// ```
/// use std::sync::Arc;
/// use mbkd::{BuildParams, Instance, RayTree, TimeInterval, glam::{DAffine3, DVec3}};
/// let tree = Arc::new(RayTree::build(&[], &BuildParams::default())?);
/// let there = Instance::new(tree, DAffine3::from_translation(DVec3::X)).with_mask(0b10);
/// let gone_later = there.clone().with_active(TimeInterval::new(0.0, 0.5).unwrap());
/// assert_eq!(there.mask, gone_later.mask);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Instance {
    /// The tree that is placed.
    pub of: InstanceOf,
    /// Its transforms, at the keys of the shutter. Motion inside the placed tree runs on the same clock.
    pub transform: Transform,
    /// A masked query sees the instance if its mask and this one share a bit, and in it the meshes and shapes whose masks do.
    pub mask: u32,
    /// The time interval in which the instance exists.
    pub active: TimeInterval,
}

impl Instance {
    /// A tree (`Arc<RayTree>`, `Arc<InstanceTree>`), placed by a transform ([`Transform`], a matrix, a
    /// [`Pose`](crate::Pose), or several of them).
    pub fn new(of: impl Into<InstanceOf>, transform: impl Into<Transform>) -> Instance {
        Instance { of: of.into(), transform: transform.into(), mask: u32::MAX, active: TimeInterval::FULL }
    }

    /// The instance with a visibility mask.
    pub fn with_mask(self, mask: u32) -> Instance {
        Instance { mask, ..self }
    }

    /// The instance, existing during `active` only.
    pub fn with_active(self, active: TimeInterval) -> Instance {
        Instance { active, ..self }
    }
}

/// Trees placed many times, moving: the ray queries of a [`RayTree`], without a copy of the placed trees.
///
/// A ray is mapped into the space of every instance whose box it meets, and unless it misses the box of the placed tree
/// there, that tree answers it. `t` keeps its meaning: it counts in lengths of the caller's direction. Each answer is
/// that of querying all instances with their [`InstanceTree::local_ray`], bit for bit. The direction in an instance's
/// space is rounded to f32, like that of every ray; so from a distance of `d`, a hit may lie `2^-24 d` beside the exact
/// ray, or more under transforms that nearly flatten space.
///
/// ```
/// use std::sync::Arc;
/// use mbkd::glam::{DQuat, DVec3, Vec3};
/// use mbkd::{BuildParams, Instance, InstanceTree, Pose, Ray, RayTree, TriangleMesh, WideParams};
/// // A sail that makes a quarter turn about z while the shutter is open, at two places.
/// let corners = vec![Vec3::ZERO, Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 1.0)];
/// let sail = RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], corners)], &BuildParams::default())?;
/// let sail = Arc::new(sail);
/// let turning = |translation: DVec3| {
///     [0.0, 90f64.to_radians()].map(|angle| Pose { rotation: DQuat::from_rotation_z(angle), translation, ..Pose::IDENTITY })
/// };
/// let place = |x: f64| Instance::new(sail.clone(), turning(DVec3::X * x).to_vec());
/// let mill = InstanceTree::build(vec![place(0.0), place(10.0)], &WideParams::default())?;
///
/// let along = Ray::new(Vec3::new(10.7, -5.0, 0.1), Vec3::Y);
/// let hit = mill.closest_hit(&along).unwrap();
/// assert_eq!((&hit.path[..], hit.hit.primitive, hit.hit.t), (&[1][..], 0, 5.0));
/// let turned = mill.closest_hit(&along.at_time(0.5)).unwrap(); // by 45 degrees
/// assert!((turned.hit.t - 5.7).abs() < 1e-6);
/// assert!(mill.triangle_normal(&turned, 0.5).abs_diff_eq(Vec3::new(0.5, -0.5, 0.0).normalize(), 1e-6));
/// # Ok::<(), mbkd::InstanceError>(())
/// ```
#[derive(Clone)]
pub struct InstanceTree {
    pub(super) wide: WideTree,
    pub(super) placements: Placements,
    /// The distinct trees that are placed.
    pub(super) trees: Vec<InstanceOf>,
    pub(super) simd: SimdLevel,
    /// Levels of instances, at least 1.
    levels: usize,
    /// The box of all instances that hold anything, while they exist.
    bounds: Option<Aabb>,
}

impl core::fmt::Debug for InstanceTree {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        // What is known without visiting the placed trees.
        f.debug_struct("InstanceTree").field("len", &self.len()).field("levels", &self.levels).finish_non_exhaustive()
    }
}

/// The share of reading the instances in a build, about.
const READING: f64 = 0.3;

/// Instances between two reports of progress. Not fitted: they take a few hundred microseconds.
const REPORTED: usize = 1024;

impl InstanceTree {
    /// Builds a tree over instances; paths consist of indices into `instances`.
    ///
    /// Takes O(n log n) time for `n` instances, whatever they place, and several hundred bytes for each (docs/rays.md).
    /// [`WideParams::bytes_per_primitive`] counts per instance.
    ///
    /// An instance with a scale of 0 along all axes at all keys is hidden (a pose with scale 0, a matrix of zeros beside its
    /// translation): it keeps its index, no query sees it, and it does not count in the bounds. A scale of 0 at some keys only, or
    /// along some axes only, is an error.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Pose, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let sized = |scale: f64| Instance::new(of.clone(), Pose { scale: DVec3::splat(scale), ..Pose::IDENTITY });
    /// let tree = InstanceTree::build(vec![sized(0.0), sized(1.0)], &WideParams::default())?;
    /// let hit = tree.closest_hit(&Ray::new(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z)).unwrap();
    /// assert_eq!((tree.len(), &hit.path[..]), (2, &[1][..]));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    ///
    /// # Errors
    /// An [`InstanceError`] that names the transform or parameter at fault. An empty tree is valid.
    pub fn build(instances: Vec<Instance>, params: &WideParams) -> Result<InstanceTree, InstanceError> {
        InstanceTree::build_reporting(instances, params, &Progress::new(None))
    }

    /// [`InstanceTree::build`] that calls `progress` as [`RayTree::build_with_progress`] does. `Break` cancels the build, which
    /// then returns [`BuildError::Cancelled`] in an [`InstanceError::Build`].
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{BuildError, InstanceError, InstanceTree, WideParams};
    /// let stop = |_: f32| ControlFlow::Break(());
    /// let tree = InstanceTree::build_with_progress(Vec::new(), &WideParams::default(), &stop);
    /// assert_eq!(tree.unwrap_err(), InstanceError::Build(BuildError::Cancelled));
    /// ```
    ///
    /// # Errors
    /// As [`InstanceTree::build`]; [`BuildError::Cancelled`] if `progress` broke.
    pub fn build_with_progress(
        instances: Vec<Instance>,
        params: &WideParams,
        progress: Callback<'_>,
    ) -> Result<InstanceTree, InstanceError> {
        InstanceTree::build_reporting(instances, params, &Progress::new(Some(progress)))
    }

    /// Builds on one thread if there are few instances.
    fn build_reporting(
        instances: Vec<Instance>,
        params: &WideParams,
        progress: &Progress,
    ) -> Result<InstanceTree, InstanceError> {
        parallel::entered(instances.len(), || {
            let tree = InstanceTree::padded(instances, params, 1.0, progress)?;
            if progress.complete() { Err(BuildError::Cancelled.into()) } else { Ok(tree) }
        })
    }

    /// [`InstanceTree::build`] with this share of the padding of boxes: 1, or less in tests.
    fn padded(
        instances: Vec<Instance>,
        params: &WideParams,
        padding: f64,
        progress: &Progress,
    ) -> Result<InstanceTree, InstanceError> {
        params.validate()?;
        if instances.len() >= u32::MAX as usize {
            return Err(BuildError::TooManyPrimitives { found: instances.len() }.into());
        }
        let mut motions = Motions::default();
        let (mut trees, mut known, mut levels) = (Vec::new(), HashMap::new(), 1);
        let mut placed = Vec::with_capacity(instances.len());
        let reading = progress.subtask(READING);
        let reading = reading.in_units(instances.len());
        for (i, instance) in instances.into_iter().enumerate() {
            if i.is_multiple_of(REPORTED) {
                reading.check()?;
                reading.finished(REPORTED as f64);
            }
            let Instance { of, transform, mask, active } = instance;
            let (motion, distortion) = motions.add(&transform, i)?;
            levels = levels.max(1 + of.levels());
            if levels > MAX_NESTING {
                return Err(InstanceError::TooDeep { instance: i });
            }
            let tree = *known.entry(of.address()).or_insert_with(|| {
                trees.push(of);
                trees.len() as u32 - 1
            });
            placed.push((Placed { motion, active, mask, tree }, distortion));
        }
        motions.shrink_to_fit();
        let extents = trees.iter().map(InstanceOf::extent).collect();
        let mut placements = Placements::new(placed, motions, extents, padding)?;
        let bounds = placements.bounds();
        let wide = WideTree::build(&placements, params, &progress.rest(1.0))?;
        placements.release_build_data();
        Ok(InstanceTree { wide, placements, trees, simd: SimdLevel::best(), levels, bounds })
    }

    /// Number of instances of the outermost level, hidden ones included.
    pub fn len(&self) -> usize {
        self.placements.placed.len()
    }

    /// Whether there is no instance.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The tree that an instance of the outermost level places; `None` if there is no such instance.
    pub fn placed(&self, instance: u32) -> Option<&InstanceOf> {
        Some(&self.trees[self.placements.placed.get(instance as usize)?.tree as usize])
    }

    /// A ray mapped into the own space of an instance of the outermost level, at the ray's time and with the same `t`:
    /// the ray that queries use for the placed tree, if the instance's mask and active interval allow. `None` if there
    /// is no such instance, if it is hidden, if the time lies outside `[0, 1]`, or if the direction there is shorter than
    /// 2^-100 or longer than 2^100.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// let local = tree.local_ray(1, &ray).unwrap();
    /// assert_eq!((local.origin.z, local.dir), (-2.0, Vec3::Z));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn local_ray(&self, instance: u32, ray: &Ray) -> Option<Ray> {
        let one = self.placements.placed.get(instance as usize)?;
        if !(0.0..=1.0).contains(&ray.time) {
            return None;
        }
        let (origin, dir) = self.placements.motions.inward(Portable, &one.motion, ray)?.vectors(Portable);
        Some(Ray { origin, dir, ..*ray })
    }

    /// The matrix from the space of the tree at the end of a path to that of this tree, at a time of the shutter.
    /// `None` if the path is invalid or the time lies outside `[0, 1]`.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// assert_eq!(tree.matrix(&[1], 0.5).unwrap().translation, DVec3::Z * 2.0);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn matrix(&self, path: &[u32], time: f32) -> Option<DAffine3> {
        let (&first, rest) = path.split_first()?;
        let one = self.placements.placed.get(first as usize)?;
        if !(0.0..=1.0).contains(&time) {
            return None;
        }
        let matrix = self.placements.motions.matrix(&one.motion, f64::from(time));
        match &self.trees[one.tree as usize] {
            InstanceOf::Instances(tree) if !rest.is_empty() => Some(matrix * tree.matrix(rest, time)?),
            _ => rest.is_empty().then_some(matrix),
        }
    }

    /// The tree of primitives at the end of a path.
    pub fn tree(&self, path: &[u32]) -> Option<&RayTree> {
        let (&first, rest) = path.split_first()?;
        match self.placed(first)? {
            InstanceOf::Tree(tree) => rest.is_empty().then_some(&**tree),
            InstanceOf::Instances(tree) => tree.tree(rest),
        }
    }

    /// A box around all instances while they exist, slightly enlarged for rounding (by a ten-thousandth of the scene's size or so);
    /// `None` if no instance holds a primitive. Hidden instances do not count.
    pub fn bounds(&self) -> Option<Aabb> {
        self.bounds
    }

    /// Checks the structure of the tree over instances, as [`RayTree::validate`] does. For tests.
    ///
    /// # Errors
    /// The first violation found, which would be a defect of this crate.
    pub fn validate(&self) -> Result<(), ValidationError> {
        self.wide.validate(&self.placements)
    }

    /// The tree with its queries on another instruction set of this CPU, for tests and measurements; placed trees keep
    /// theirs. Answers do not change.
    pub fn with_simd(self, simd: SimdLevel) -> InstanceTree {
        InstanceTree { simd, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::BruteForce;
    use crate::params::BuildParams;
    use crate::primitive::TriangleMesh;
    use crate::random::Random;
    use glam::{DMat3, DVec3, Vec3};

    /// Counts hits of rays at the edges of a cube under sheared matrices, and those that are lost.
    fn lost(padding: f64, away: f32) -> (usize, usize) {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
        let faces = [
            [0, 1, 2],
            [1, 3, 2],
            [4, 6, 5],
            [5, 6, 7],
            [0, 4, 1],
            [1, 4, 5],
            [2, 3, 6],
            [3, 7, 6],
            [0, 2, 4],
            [2, 6, 4],
            [1, 5, 3],
            [3, 5, 7],
        ];
        let cube = TriangleMesh::fixed(faces.to_vec(), (0..8).map(corner).collect());
        let tree = Arc::new(RayTree::build(core::slice::from_ref(&cube), &BuildParams::default()).expect("a cube"));
        let oracle = BruteForce::new(&[cube]).expect("a cube");
        let (mut random, mut hits, mut lost) = (Random(5), 0, 0);
        for _ in 0..300 {
            let shear = DVec3::new(f64::from(random.signed()) * 3000.0, 1.0, 0.0);
            let matrix3 = DMat3::from_cols(DVec3::X, shear, random.vec().as_dvec3() + DVec3::Z * 2.0);
            let matrix = DAffine3 { matrix3, translation: random.vec().as_dvec3() };
            let instance = Instance::new(tree.clone(), matrix);
            let (both, params) = (vec![instance.clone(), instance], WideParams::default());
            let placed = InstanceTree::padded(both, &params, padding, &Progress::new(None)).expect("instances");
            for _ in 0..200 {
                // The edges along y are those where the box of the image is tight.
                let edge = Vec3::new(
                    (random.signed() > 0.0) as u8 as f32,
                    random.signed().abs().round(),
                    (random.signed() > 0.0) as u8 as f32,
                );
                // Beside the image, by less than the greatest shift of a hit by the rounding of the direction.
                let beside = f64::from(random.signed()) * shear.x * f64::from(away) / f64::from(1 << 24);
                let target = matrix.transform_point3(edge.as_dvec3()) + DVec3::X * beside;
                let origin = target + (random.vec() * away).as_dvec3();
                let ray = Ray::new(origin, (target - origin).as_vec3());
                let Some(local) = placed.local_ray(0, &ray) else { continue };
                let (expected, found) = (oracle.closest_hit(&local), placed.closest_hit(&ray).map(|found| found.hit));
                hits += usize::from(expected.is_some());
                lost += usize::from(expected != found);
            }
        }
        (hits, lost)
    }

    #[test]
    fn padding_is_enough_for_rounding_and_needed() {
        for away in [3000.0, 10_000.0] {
            let (hits, none) = lost(1.0, away);
            assert!(hits > 5000 && none == 0, "{none} of {hits} lost");
            let (_, some) = lost(0.0, away);
            assert!(some > 20, "the padding is not needed: {some}");
        }
        // From far away hits are few, since rounding the direction moves them by more than the cube.
        assert_eq!(lost(1.0, 1e8).1, 0);
    }
}
