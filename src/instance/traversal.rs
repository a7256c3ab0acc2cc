//! Ray traversal of a tree of instances.
//!
//! The tree over instances is traversed like every wide tree. A leaf is one instance: the ray is mapped into its space
//! and answered by the queries of the placed tree, so all guarantees of those (layouts, instruction sets, ties) hold
//! here. In a closest-hit query, the inner ray ends at the best hit so far, in its own `t`. A ray that misses the box
//! of the placed tree in its own space does not enter it.
//!
//! Why no hit is missed: `placements` bounds how far outside of its box a primitive of an instance may be hit.

use super::hit::{InstanceHit, InstancePath};
use super::placements::Placements;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::layout::ChildRef;
use crate::primitive::PrimitiveSet;
use crate::ray::{Filter, Guards, Hit, LeafVisitor, ObjectTraversal, Observer, Offer, RayTree, TreeRay};
use crate::simd::{Simd, dispatch};
use core::ops::ControlFlow;

/// A query of all instances that a ray meets, and what it has found.
trait InstanceQuery {
    /// Whether instances are visited front to back.
    const ORDERED: bool;

    /// Queries the tree of an instance, whose path ends with this index, with a ray in its space that ends where no hit
    /// matters any more. Returns the ray's new end; `Break` ends the query.
    fn query_tree(
        &mut self,
        tree: &RayTree,
        ray: &Ray,
        path: (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32>;

    /// The new end of a ray after some instances, whose trees may be any; `Break` ends the query.
    fn end(&self, ray: &Ray) -> ControlFlow<(), f32>;
}

// In each query the usual case is inlined; all other cases are calls, which would spill the registers of the traversal.

/// The closest hit; of several at the same `t` that of the lowest path, and of these the lowest primitive.
struct ClosestInstance {
    best: Option<InstanceHit>,
}

impl InstanceQuery for ClosestInstance {
    const ORDERED: bool = true;

    #[inline(always)]
    fn query_tree(
        &mut self,
        tree: &RayTree,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        let found =
            if guards.are_none() { tree.closest_hit_inside(ray) } else { closest(tree, ray, path.then(id), guards) };
        let Some(hit) = found else { return ControlFlow::Continue(ray.t_max) };
        // Read first, so that it does not wait until the whole hit is copied.
        let (t, path) = (hit.t, path.then(id));
        if self.best.is_none_or(|best| t < best.hit.t || t == best.hit.t && path < best.path) {
            self.best = Some(InstanceHit { path, hit });
        }
        ControlFlow::Continue(t)
    }

    fn end(&self, ray: &Ray) -> ControlFlow<(), f32> {
        ControlFlow::Continue(self.best.map_or(ray.t_max, |best| best.hit.t))
    }
}

#[inline(never)]
fn closest(tree: &RayTree, ray: &Ray, path: InstancePath, guards: &mut Guards<'_, InstanceHit>) -> Option<Hit> {
    guards.inside(in_tree(path), |guards| tree.closest_hit_guarded(ray, guards))
}

/// Whether there is a hit.
struct AnyInstance {
    found: bool,
}

impl InstanceQuery for AnyInstance {
    const ORDERED: bool = false;

    #[inline(always)]
    fn query_tree(
        &mut self,
        tree: &RayTree,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        self.found = if guards.are_none() { tree.any_hit_inside(ray) } else { any(tree, ray, path.then(id), guards) };
        self.end(ray)
    }

    #[inline(always)]
    fn end(&self, ray: &Ray) -> ControlFlow<(), f32> {
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(ray.t_max) }
    }
}

#[inline(never)]
fn any(tree: &RayTree, ray: &Ray, path: InstancePath, guards: &mut Guards<'_, InstanceHit>) -> bool {
    guards.inside(in_tree(path), |guards| tree.any_hit_guarded(ray, guards))
}

/// Passes every hit to the visitor.
struct AllInstances<'a> {
    visitor: &'a mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    flow: ControlFlow<()>,
}

impl InstanceQuery for AllInstances<'_> {
    const ORDERED: bool = false;

    #[inline(never)]
    fn query_tree(
        &mut self,
        tree: &RayTree,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        let path = path.then(id);
        let mut visitor = |hit| (self.visitor)(InstanceHit { path, hit });
        self.flow = guards.inside(in_tree(path), |guards| tree.all_hits_guarded(ray, guards, &mut visitor));
        self.end(ray)
    }

    fn end(&self, ray: &Ray) -> ControlFlow<(), f32> {
        self.flow?;
        ControlFlow::Continue(ray.t_max)
    }
}

/// A hit in the tree at the end of a path.
fn in_tree(path: InstancePath) -> impl Fn(&Offer) -> InstanceHit {
    move |&(_, hit)| InstanceHit { path, hit }
}

impl InstanceTree {
    /// The closest hit.
    pub(super) fn closest(&self, ray: &Ray, mut guards: Guards<'_, InstanceHit>) -> Option<InstanceHit> {
        let mut query = ClosestInstance { best: None };
        self.run(ray, InstancePath::default(), &mut guards, &mut query);
        query.best
    }

    /// Whether there is a hit.
    pub(super) fn any(&self, ray: &Ray, mut guards: Guards<'_, InstanceHit>) -> bool {
        let mut query = AnyInstance { found: false };
        self.run(ray, InstancePath::default(), &mut guards, &mut query);
        query.found
    }

    /// Calls `visitor` with all hits until it breaks; returns its last return value.
    pub(super) fn all(
        &self,
        ray: &Ray,
        mut guards: Guards<'_, InstanceHit>,
        visitor: &mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let mut query = AllInstances { visitor, flow: ControlFlow::Continue(()) };
        self.run(ray, InstancePath::default(), &mut guards, &mut query);
        query.flow
    }

    /// Runs a query over all instances that matter, whose paths continue `path`.
    fn run<Q: InstanceQuery>(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
        query: &mut Q,
    ) {
        if self.wide.root == ChildRef::NOTHING {
            return;
        }
        let (set, trees) = (&self.placements, &self.trees[..]);
        let (mut tree_ray, regular) = TreeRay::of(ray, set.frame(), f32::INFINITY);
        if !regular || set.is_far(&tree_ray) {
            set.recompute(&mut tree_ray);
        }
        if tree_ray.has_empty_range() {
            return;
        }
        let visitor = &mut InstanceVisitor { set, trees, local: *ray, path, guards, query };
        let (tree, tree_ray) = (&self.wide, &tree_ray);
        if Q::ORDERED {
            dispatch(self.simd, ObjectTraversal::<true, _> { tree, ray, tree_ray, visitor });
        } else {
            dispatch(self.simd, ObjectTraversal::<false, _> { tree, ray, tree_ray, visitor });
        }
    }

    /// The same where this tree is placed itself; returns the ray's new end.
    #[inline(never)]
    fn run_inside<Q: InstanceQuery>(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
        query: &mut Q,
    ) -> ControlFlow<(), f32> {
        self.run(ray, path, guards, query);
        query.end(ray)
    }
}

/// The state of a query during the traversal of the tree over instances.
struct InstanceVisitor<'a, 'b, Q> {
    set: &'a Placements,
    trees: &'a [InstanceOf],
    /// The ray in the space of the current instance. It is updated in place, and only where it differs: copying a ray
    /// would wait for the stores before.
    local: Ray,
    path: InstancePath,
    guards: &'a mut Guards<'b, InstanceHit>,
    query: &'a mut Q,
}

impl<Q: InstanceQuery> LeafVisitor for InstanceVisitor<'_, '_, Q> {
    #[inline(always)]
    fn mask(&self) -> Option<u32> {
        self.guards.visible.mask()
    }

    #[inline(always)]
    fn node(&mut self) {
        self.guards.observer.node();
    }

    #[inline(always)]
    fn leaf(&mut self) {
        self.guards.observer.leaf();
    }

    #[inline(always)]
    fn object<S: Simd>(&mut self, s: S, id: u32, ray: &Ray) -> ControlFlow<(), f32> {
        let InstanceVisitor { set, trees, path, ref mut local, ref mut guards, ref mut query } = *self;
        let one = &set.placed[id as usize];
        if !(one.active.contains(ray.time) && guards.visible.sees(|| one.mask)) {
            return ControlFlow::Continue(ray.t_max);
        }
        let Some(inward) = set.motions.inward(s, &one.motion, ray) else {
            return ControlFlow::Continue(ray.t_max);
        };
        if set.outlines[one.tree as usize].is_missed_from(s, inward.origin, s.widen_four(&inward.dir), ray) {
            return ControlFlow::Continue(ray.t_max);
        }
        (local.origin, local.dir) = inward.vectors(s);
        if local.t_max != ray.t_max {
            local.t_max = ray.t_max;
        }
        match &trees[one.tree as usize] {
            InstanceOf::Tree(tree) => query.query_tree(tree, local, (path, id), guards),
            InstanceOf::Instances(tree) => tree.run_inside(local, path.then(id), guards, &mut **query),
        }
    }
}
