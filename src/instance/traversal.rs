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
use crate::ray::{Filter, Guards, Hit, LeafVisitor, ObjectTraversal, Observer, Offer, TreeRay};
use crate::simd::{Simd, dispatch};
use core::ops::ControlFlow;

/// A query of all instances that a ray meets.
trait InstanceQuery {
    /// Whether instances are visited front to back.
    const ORDERED: bool;
    /// Queries the tree of an instance, whose path ends with this index, with a ray in its space that ends where no hit
    /// matters any more. Returns the ray's new end; `Break` ends the query.
    fn query_instance(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        path: (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32>;
}

/// The closest hit; of several at the same `t` that of the lowest path, and of these the lowest primitive.
struct ClosestInstance {
    best: Option<InstanceHit>,
}

impl ClosestInstance {
    /// Takes a hit at `t`, which does not wait until the whole hit is copied. Returns `t`.
    #[inline(always)]
    fn offer(&mut self, t: f32, hit: Hit, path: InstancePath) -> f32 {
        if self.best.is_none_or(|best| t < best.hit.t || t == best.hit.t && path < best.path) {
            self.best = Some(InstanceHit { path, hit });
        }
        t
    }
}

impl InstanceQuery for ClosestInstance {
    const ORDERED: bool = true;

    #[inline(always)]
    fn query_instance(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        // The usual case is inlined here; all other cases are calls, which would spill the registers of the traversal.
        let end = match of {
            InstanceOf::Tree(tree) if guards.are_none() => {
                let Some(hit) = tree.closest_hit_inside(ray) else { return ControlFlow::Continue(ray.t_max) };
                self.offer(hit.t, hit, path.then(id))
            }
            _ => {
                let Some(found) = of.closest_hit(ray, path.then(id), guards) else {
                    return ControlFlow::Continue(ray.t_max);
                };
                self.offer(found.hit.t, found.hit, found.path)
            }
        };
        ControlFlow::Continue(end)
    }
}

/// Whether there is a hit.
struct AnyInstance {
    found: bool,
}

impl InstanceQuery for AnyInstance {
    const ORDERED: bool = false;

    #[inline(always)]
    fn query_instance(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        // As above.
        self.found = match of {
            InstanceOf::Tree(tree) if guards.are_none() => tree.any_hit_inside(ray),
            _ => of.any_hit(ray, path.then(id), guards),
        };
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(ray.t_max) }
    }
}

/// Passes every hit to the visitor.
struct AllInstances<'a> {
    visitor: &'a mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    flow: ControlFlow<()>,
}

impl InstanceQuery for AllInstances<'_> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn query_instance(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        guards: &mut Guards<'_, InstanceHit>,
    ) -> ControlFlow<(), f32> {
        self.flow = of.all_hits(ray, path.then(id), guards, self.visitor);
        self.flow?;
        ControlFlow::Continue(ray.t_max)
    }
}

impl InstanceOf {
    #[inline(never)]
    fn closest_hit(&self, ray: &Ray, path: InstancePath, guards: &mut Guards<'_, InstanceHit>) -> Option<InstanceHit> {
        match self {
            InstanceOf::Instances(tree) => tree.closest(ray, path, guards),
            InstanceOf::Tree(tree) => {
                let hit = guards.inside(in_tree(path), |guards| tree.closest_hit_guarded(ray, guards))?;
                Some(InstanceHit { path, hit })
            }
        }
    }

    #[inline(never)]
    fn any_hit(&self, ray: &Ray, path: InstancePath, guards: &mut Guards<'_, InstanceHit>) -> bool {
        match self {
            InstanceOf::Instances(tree) => tree.any(ray, path, guards),
            InstanceOf::Tree(tree) => guards.inside(in_tree(path), |guards| tree.any_hit_guarded(ray, guards)),
        }
    }

    #[inline(never)]
    fn all_hits(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
        visitor: &mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        match self {
            InstanceOf::Instances(tree) => tree.all(ray, path, guards, visitor),
            InstanceOf::Tree(tree) => guards.inside(in_tree(path), |guards| {
                tree.all_hits_guarded(ray, guards, &mut |hit| visitor(InstanceHit { path, hit }))
            }),
        }
    }
}

/// A hit in the tree at the end of a path.
fn in_tree(path: InstancePath) -> impl Fn(&Offer) -> InstanceHit {
    move |&(_, hit)| InstanceHit { path, hit }
}

impl InstanceTree {
    /// The closest hit; its path continues `path`.
    pub(super) fn closest(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
    ) -> Option<InstanceHit> {
        self.run(ray, path, guards, ClosestInstance { best: None }).best
    }

    pub(super) fn any(&self, ray: &Ray, path: InstancePath, guards: &mut Guards<'_, InstanceHit>) -> bool {
        self.run(ray, path, guards, AnyInstance { found: false }).found
    }

    pub(super) fn all(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
        visitor: &mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.run(ray, path, guards, AllInstances { visitor, flow: ControlFlow::Continue(()) }).flow
    }

    /// Runs a query over all instances that matter.
    fn run<Q: InstanceQuery>(
        &self,
        ray: &Ray,
        path: InstancePath,
        guards: &mut Guards<'_, InstanceHit>,
        query: Q,
    ) -> Q {
        if self.wide.root == ChildRef::NOTHING {
            return query;
        }
        let (set, trees) = (&self.placements, &self.trees[..]);
        let (mut tree_ray, regular) = TreeRay::of(ray, set.frame(), f32::INFINITY);
        if !regular || set.is_far(&tree_ray) {
            set.recompute(&mut tree_ray);
        }
        if tree_ray.has_empty_range() {
            return query;
        }
        let mut visitor = InstanceVisitor { set, trees, local: *ray, path, guards, query };
        let (tree, tree_ray) = (&self.wide, &tree_ray);
        if Q::ORDERED {
            dispatch(self.simd, ObjectTraversal::<true, _> { tree, ray, tree_ray, visitor: &mut visitor });
        } else {
            dispatch(self.simd, ObjectTraversal::<false, _> { tree, ray, tree_ray, visitor: &mut visitor });
        }
        visitor.query
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
    query: Q,
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
        query.query_instance(&trees[one.tree as usize], local, (path, id), guards)
    }
}
