//! Queries of single rays with a mask, with a filter or without, and with an observer.

use super::filter::{Offer, Seen};
use super::guards::Guards;
use super::hit::Hit;
use super::observer::Observer;
use super::ray_tree::RayTree;
use super::traversal::collect::HitVisitor;
use crate::geometry::Ray;
use core::ops::ControlFlow;

impl RayTree {
    /// [`RayTree::closest_hit`] among the hits for which `accept` returns true, on meshes and shapes whose mask
    /// ([`TriangleMesh::mask`](crate::TriangleMesh::mask), [`MovingSphere::mask`](crate::MovingSphere::mask),
    /// [`Primitive::mask`](crate::Primitive::mask)) shares a bit with `mask`. Blocks of the tree in which `mask` hides everything
    /// are skipped (in the k-d layout, only primitives are).
    ///
    /// `accept` must be pure. It may be called several times for the same hit, and is not called for every hit.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let glass = TriangleMesh::fixed(vec![[0, 1, 2]], at(1.0)).with_mask(0b01);
    /// let wall = TriangleMesh::fixed(vec![[0, 1, 2]], at(2.0)).with_mask(0b10);
    /// let tree = RayTree::build(&[glass, wall], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// assert_eq!(tree.closest_hit_filtered(&ray, 0b11, |_| true).unwrap().mesh, 0);
    /// assert_eq!(tree.closest_hit_filtered(&ray, 0b10, |_| true).unwrap().mesh, 1);
    /// assert_eq!(tree.closest_hit_filtered(&ray, 0b11, |hit| hit.t > 1.5).unwrap().mesh, 1);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hit_filtered(&self, ray: &Ray, mask: u32, accept: impl Fn(&Hit) -> bool) -> Option<Hit> {
        self.closest_hit_guarded(ray, Guards::filtered(mask, &|(_, hit)| accept(hit)))
    }

    /// [`RayTree::closest_hit`] on meshes and shapes whose mask shares a bit with `mask`, as [`RayTree::closest_hit_filtered`]
    /// without a filter.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// assert_eq!([0b01, 0b10].map(|mask| tree.closest_hit_masked(&ray, mask).unwrap().mesh), [0, 1]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hit_masked(&self, ray: &Ray, mask: u32) -> Option<Hit> {
        self.closest_hit_guarded(ray, Guards::masked(mask))
    }

    /// [`RayTree::any_hit`] on meshes and shapes whose mask shares a bit with `mask`, as [`RayTree::any_hit_filtered`] without a
    /// filter but faster: where a hit is certain, its position is not computed.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let glass = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]).with_mask(0b01);
    /// let tree = RayTree::build(&[glass], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
    /// assert_eq!([0b01, 0b10].map(|mask| tree.any_hit_masked(&ray, mask)), [true, false]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn any_hit_masked(&self, ray: &Ray, mask: u32) -> bool {
        self.any_hit_guarded(ray, Guards::masked(mask))
    }

    /// [`RayTree::all_hits`] on meshes and shapes whose mask shares a bit with `mask`, as [`RayTree::all_hits_filtered`] without a
    /// filter.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0, 3.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let mut hits = Vec::new();
    /// let _ = tree.all_hits_masked(&Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z), 0b01, |hit| {
    ///     hits.push(hit.mesh);
    ///     ControlFlow::Continue(())
    /// });
    /// hits.sort();
    /// assert_eq!(hits, [0, 2], "the second mesh has the mask 0b10");
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn all_hits_masked(
        &self,
        ray: &Ray,
        mask: u32,
        mut visitor: impl FnMut(Hit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all_hits_guarded(ray, Guards::masked(mask), &mut visitor)
    }

    /// [`RayTree::any_hit`] among the hits that pass the mask and the filter (see [`RayTree::closest_hit_filtered`]).
    pub fn any_hit_filtered(&self, ray: &Ray, mask: u32, accept: impl Fn(&Hit) -> bool) -> bool {
        self.any_hit_guarded(ray, Guards::filtered(mask, &|(_, hit)| accept(hit)))
    }

    /// [`RayTree::all_hits`] among the hits that pass the mask and the filter (see [`RayTree::closest_hit_filtered`]).
    pub fn all_hits_filtered(
        &self,
        ray: &Ray,
        mask: u32,
        accept: impl Fn(&Hit) -> bool,
        mut visitor: impl FnMut(Hit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all_hits_guarded(ray, Guards::filtered(mask, &|(_, hit)| accept(hit)), &mut visitor)
    }

    /// [`RayTree::closest_hit`], reporting each step to `observer`.
    pub fn closest_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        self.closest_hit_guarded(ray, Guards::observed(observer))
    }

    /// [`RayTree::any_hit`], reporting each step to `observer`.
    pub fn any_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> bool {
        self.any_hit_guarded(ray, Guards::observed(observer))
    }

    /// [`RayTree::all_hits`], reporting each step to `observer`.
    pub fn all_hits_observed(
        &self,
        ray: &Ray,
        observer: &mut impl Observer,
        mut visitor: impl FnMut(Hit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all_hits_guarded(ray, Guards::observed(observer), &mut visitor)
    }

    pub(crate) fn closest_hit_guarded(&self, ray: &Ray, guards: Guards<'_, Offer>) -> Option<Hit> {
        if self.can_do_without(&guards) {
            return self.closest_hit(ray);
        }
        self.target().closest_guarded(ray, guards)
    }

    pub(crate) fn any_hit_guarded(&self, ray: &Ray, guards: Guards<'_, Offer>) -> bool {
        if self.can_do_without(&guards) {
            return self.any_hit(ray);
        }
        self.target().any_guarded(ray, guards)
    }

    pub(crate) fn all_hits_guarded(
        &self,
        ray: &Ray,
        guards: Guards<'_, Offer>,
        visitor: HitVisitor<'_>,
    ) -> ControlFlow<()> {
        if self.can_do_without(&guards) {
            return self.target().all(ray, visitor);
        }
        self.target().all_guarded(ray, guards, visitor)
    }

    /// Whether queries with these guards are answered as those without, which are faster.
    pub(super) fn can_do_without<T>(&self, guards: &Guards<'_, T>) -> bool {
        let sees_all = |visible: Seen<'_, T>| visible.accept.is_none() && self.layout.hides_nothing_from(visible.mask);
        guards.observer.is_none() && guards.visible.is_none_or(sees_all)
    }
}
