//! What can be asked of a tree of instances about rays.

use super::hit::{InstanceHit, InstancePath};
use super::query::Look;
use super::tree::InstanceTree;
use crate::geometry::Ray;
use crate::ray::{Observer, in_parallel};
use core::ops::ControlFlow;

impl InstanceTree {
    /// The nearest hit of a ray: the least `t`, of several at the same `t` the one with the lowest path, and of these the
    /// lowest (mesh, primitive).
    pub fn closest_hit(&self, ray: &Ray) -> Option<InstanceHit> {
        self.closest(ray, InstancePath::default(), &mut Look::Plain)
    }

    /// Whether the ray hits anything. Stops at the first hit found.
    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.any(ray, InstancePath::default(), &mut Look::Plain)
    }

    /// Calls `visitor` with every primitive of every instance that the ray hits, each once (with its nearest hit), in no
    /// particular order, until it breaks. Returns what the visitor said last.
    pub fn all_hits(&self, ray: &Ray, mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>) -> ControlFlow<()> {
        self.all(ray, InstancePath::default(), &mut Look::Plain, &mut visitor)
    }

    /// [`InstanceTree::closest_hit`] among the hits that `accept` accepts in instances whose [mask](super::Instance::with_mask) shares a
    /// bit with `mask`, on meshes whose masks do.
    ///
    /// `accept` must be pure: it may be asked several times about the same hit, and not about all hits.
    pub fn closest_hit_filtered(
        &self,
        ray: &Ray,
        mask: u32,
        accept: impl Fn(&InstanceHit) -> bool,
    ) -> Option<InstanceHit> {
        self.closest(ray, InstancePath::default(), &mut Look::Filtered { mask, accept: &accept })
    }

    /// [`InstanceTree::any_hit`] among the hits that mask and filter let through.
    pub fn any_hit_filtered(&self, ray: &Ray, mask: u32, accept: impl Fn(&InstanceHit) -> bool) -> bool {
        self.any(ray, InstancePath::default(), &mut Look::Filtered { mask, accept: &accept })
    }

    /// [`InstanceTree::all_hits`] among the hits that mask and filter let through.
    pub fn all_hits_filtered(
        &self,
        ray: &Ray,
        mask: u32,
        accept: impl Fn(&InstanceHit) -> bool,
        mut visitor: impl FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.all(ray, InstancePath::default(), &mut Look::Filtered { mask, accept: &accept }, &mut visitor)
    }

    /// [`InstanceTree::closest_hit`], telling `observer` what it does: nodes and leaves over instances (a leaf is an instance)
    /// and in the trees that are placed.
    pub fn closest_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> Option<InstanceHit> {
        self.closest(ray, InstancePath::default(), &mut Look::Observed(observer))
    }

    /// [`InstanceTree::any_hit`], telling `observer` what it does.
    pub fn any_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> bool {
        self.any(ray, InstancePath::default(), &mut Look::Observed(observer))
    }

    /// [`InstanceTree::closest_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    pub fn closest_hits(&self, rays: &[Ray], hits: &mut Vec<Option<InstanceHit>>) {
        self.batch(rays, hits, None, |ray| self.closest_hit(ray));
    }

    /// [`InstanceTree::any_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    pub fn any_hits(&self, rays: &[Ray], hits: &mut Vec<bool>) {
        self.batch(rays, hits, false, |ray| self.any_hit(ray));
    }

    fn batch<T: Copy + Send>(&self, rays: &[Ray], answers: &mut Vec<T>, nothing: T, one: impl Fn(&Ray) -> T + Sync) {
        answers.clear();
        answers.resize(rays.len(), nothing);
        in_parallel(rays, answers, |rays: &[Ray], answers: &mut [T]| {
            for (ray, answer) in rays.iter().zip(answers) {
                *answer = one(ray);
            }
        });
    }
}
