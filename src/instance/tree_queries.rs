//! The public ray queries of [`InstanceTree`].

use super::hit::InstanceHit;
use super::tree::InstanceTree;
use crate::geometry::Ray;
use crate::ray::{Guards, Observer, answer_each};
use core::ops::ControlFlow;

impl InstanceTree {
    /// The closest hit of a ray: the least `t`, of several at the same `t` the one with the lowest path, and of these
    /// the lowest (mesh, primitive).
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
    /// let found = tree.closest_hit(&ray).unwrap();
    /// assert_eq!((found.path[0], found.hit.t), (0, 1.0));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_hit(&self, ray: &Ray) -> Option<InstanceHit> {
        self.closest(ray, Guards::none())
    }

    /// Whether the ray hits anything. Stops at the first hit found.
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
    /// assert_eq!([0.5, 1.5].map(|end| tree.any_hit(&ray.between(0.0, end))), [false, true]);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.any(ray, Guards::none())
    }

    /// Calls `visitor` with every primitive of every instance that the ray hits, each once (with its closest hit), in
    /// no particular order, until it breaks. Returns the last return value of `visitor`.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// let mut found = Vec::new();
    /// let _ = tree.all_hits(&ray, |hit| {
    ///     found.push(hit.path[0]);
    ///     ControlFlow::Continue(())
    /// });
    /// found.sort();
    /// assert_eq!(found, [0, 1]);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn all_hits(&self, ray: &Ray, mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>) -> ControlFlow<()> {
        self.all(ray, Guards::none(), &mut visitor)
    }

    /// [`InstanceTree::closest_hit`] in instances whose [mask](super::Instance::with_mask) shares a bit with `mask`, on meshes and
    /// shapes whose masks do.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z)).with_mask(z as u32);
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// assert_eq!(tree.closest_hit_masked(&ray, 0b10).unwrap().path[0], 1);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_hit_masked(&self, ray: &Ray, mask: u32) -> Option<InstanceHit> {
        self.closest(ray, Guards::masked(mask))
    }

    /// [`InstanceTree::any_hit`] with a mask, as that of [`InstanceTree::closest_hit_masked`]. It is faster than
    /// [`InstanceTree::any_hit_filtered`]: where a hit is certain, its position is not computed.
    pub fn any_hit_masked(&self, ray: &Ray, mask: u32) -> bool {
        self.any(ray, Guards::masked(mask))
    }

    /// [`InstanceTree::all_hits`] with a mask, as that of [`InstanceTree::closest_hit_masked`].
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z)).with_mask(z as u32);
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0), place(3.0)], &WideParams::default())?;
    /// let mut hits = Vec::new();
    /// let _ = tree.all_hits_masked(&Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z), 0b01, |hit| {
    ///     hits.push(hit.path[0]);
    ///     ControlFlow::Continue(())
    /// });
    /// hits.sort();
    /// assert_eq!(hits, [0, 2], "the second instance has the mask 0b10");
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn all_hits_masked(
        &self,
        ray: &Ray,
        mask: u32,
        mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all(ray, Guards::masked(mask), &mut visitor)
    }

    /// [`InstanceTree::closest_hit`] among the hits for which `accept` returns true, in instances whose
    /// [mask](super::Instance::with_mask) shares a bit with `mask`, on meshes and shapes whose masks do.
    ///
    /// `accept` must be pure: it may be called several times for the same hit, and is not called for every hit.
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
    /// let second = tree.closest_hit_filtered(&ray, u32::MAX, |found| found.path[0] != 0);
    /// assert_eq!(second.unwrap().hit.t, 2.0);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_hit_filtered(
        &self,
        ray: &Ray,
        mask: u32,
        accept: impl Fn(&InstanceHit) -> bool,
    ) -> Option<InstanceHit> {
        self.closest(ray, Guards::filtered(mask, &accept))
    }

    /// [`InstanceTree::any_hit`] among the hits that pass the mask and the filter.
    pub fn any_hit_filtered(&self, ray: &Ray, mask: u32, accept: impl Fn(&InstanceHit) -> bool) -> bool {
        self.any(ray, Guards::filtered(mask, &accept))
    }

    /// [`InstanceTree::all_hits`] among the hits that pass the mask and the filter.
    pub fn all_hits_filtered(
        &self,
        ray: &Ray,
        mask: u32,
        accept: impl Fn(&InstanceHit) -> bool,
        mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all(ray, Guards::filtered(mask, &accept), &mut visitor)
    }

    /// [`InstanceTree::closest_hit`], reporting each step to `observer`: nodes and leaves of the tree over instances (a
    /// leaf is an instance) and of the placed trees.
    pub fn closest_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> Option<InstanceHit> {
        self.closest(ray, Guards::observed(observer))
    }

    /// [`InstanceTree::any_hit`], reporting each step to `observer`.
    pub fn any_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> bool {
        self.any(ray, Guards::observed(observer))
    }

    /// [`InstanceTree::all_hits`], reporting each step to `observer`.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Counters, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let (mut hits, mut work) = (0, Counters::default());
    /// let _ = tree.all_hits_observed(&Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z), &mut work, |_| {
    ///     hits += 1;
    ///     ControlFlow::Continue(())
    /// });
    /// assert_eq!(hits, 2);
    /// assert!(work.leaves >= 2);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn all_hits_observed(
        &self,
        ray: &Ray,
        observer: &mut impl Observer,
        mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all(ray, Guards::observed(observer), &mut visitor)
    }

    /// [`InstanceTree::closest_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
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
    /// let mut hits = Vec::new(); // memory that is used again
    /// tree.closest_hits(&[ray, ray.between(1.5, 9.0)], &mut hits);
    /// assert_eq!(hits.iter().map(|hit| hit.unwrap().path[0]).collect::<Vec<_>>(), [0, 1]);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_hits(&self, rays: &[Ray], hits: &mut Vec<Option<InstanceHit>>) {
        answer_each(rays, hits, |_, ray| self.closest_hit(ray));
    }

    /// [`InstanceTree::any_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    pub fn any_hits(&self, rays: &[Ray], hits: &mut Vec<bool>) {
        answer_each(rays, hits, |_, ray| self.any_hit(ray));
    }

    /// [`InstanceTree::closest_hit_masked`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    pub fn closest_hits_masked(&self, rays: &[Ray], mask: u32, hits: &mut Vec<Option<InstanceHit>>) {
        answer_each(rays, hits, |_, ray| self.closest_hit_masked(ray, mask));
    }

    /// [`InstanceTree::any_hit_masked`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    pub fn any_hits_masked(&self, rays: &[Ray], mask: u32, hits: &mut Vec<bool>) {
        answer_each(rays, hits, |_, ray| self.any_hit_masked(ray, mask));
    }

    /// [`InstanceTree::closest_hit_filtered`] for many rays, in parallel. `hits` is cleared and gets one answer per
    /// ray, in order. `accept` gets the index of the ray in `rays` with each hit; it must be pure, and is called from
    /// any thread.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// // Rays that begin in an instance and must not hit it again.
    /// let begin_in = [0, 1];
    /// let rays = [1.0, 2.0].map(|z| Ray::new(Vec3::new(0.2, 0.2, z), Vec3::Z));
    /// let mut hits = Vec::new();
    /// tree.closest_hits_filtered(&rays, u32::MAX, |i, hit| hit.path[0] != begin_in[i], &mut hits);
    /// assert_eq!(hits.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false]);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_hits_filtered(
        &self,
        rays: &[Ray],
        mask: u32,
        accept: impl Fn(usize, &InstanceHit) -> bool + Sync,
        hits: &mut Vec<Option<InstanceHit>>,
    ) {
        answer_each(rays, hits, |i, ray| self.closest_hit_filtered(ray, mask, |hit| accept(i, hit)));
    }

    /// [`InstanceTree::any_hit_filtered`] for many rays, in parallel, with a filter as that of
    /// [`InstanceTree::closest_hits_filtered`]. `hits` is cleared and gets one answer per ray, in order.
    pub fn any_hits_filtered(
        &self,
        rays: &[Ray],
        mask: u32,
        accept: impl Fn(usize, &InstanceHit) -> bool + Sync,
        hits: &mut Vec<bool>,
    ) {
        answer_each(rays, hits, |i, ray| self.any_hit_filtered(ray, mask, |hit| accept(i, hit)));
    }
}
