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
use crate::ray::{Observer, Stops, TreeRay, Way};
use crate::simd::dispatch;
use core::ops::ControlFlow;

/// The filter or observer of a query.
pub(super) enum Look<'a, T = InstanceHit> {
    /// Everything, unobserved.
    Plain,
    /// Instances and meshes whose masks share a bit with this one, answers that are accepted.
    Filtered { mask: u32, accept: &'a dyn Fn(&T) -> bool },
    /// Everything, with an observer.
    Observed(&'a mut dyn Observer),
}

impl<T> Look<'_, T> {
    #[inline]
    pub fn sees(&self, mask: u32) -> bool {
        match self {
            Look::Filtered { mask: wanted, .. } => wanted & mask != 0,
            _ => true,
        }
    }

    #[inline]
    pub fn observe(&mut self, what: fn(&mut dyn Observer)) {
        if let Look::Observed(observer) = self {
            what(*observer);
        }
    }
}

/// A query of all instances that a ray meets.
trait Question {
    /// Whether instances are visited front to back.
    const ORDERED: bool;
    /// Queries the tree of an instance, whose path ends with this index, with a ray in its space that ends where no hit
    /// matters any more. Returns the ray's new end; `Break` ends the query.
    fn ask(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        path: (InstancePath, u32),
        look: &mut Look<'_>,
    ) -> ControlFlow<(), f32>;
}

/// The closest hit; of several at the same `t` that of the lowest path, and of these the lowest primitive.
struct Closest {
    best: Option<InstanceHit>,
}

impl Question for Closest {
    const ORDERED: bool = true;

    #[inline(always)]
    fn ask(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        look: &mut Look<'_>,
    ) -> ControlFlow<(), f32> {
        // The usual case is inlined here; all other cases are calls, which would spill the registers of the traversal.
        let found = match (of, &look) {
            (InstanceOf::Tree(tree), Look::Plain) => {
                tree.closest_hit(ray).map(|hit| InstanceHit { path: path.then(id), hit })
            }
            _ => of.closest_hit(ray, path.then(id), look),
        };
        let Some(found) = found else { return ControlFlow::Continue(ray.t_max) };
        let better = self
            .best
            .is_none_or(|best| found.hit.t < best.hit.t || found.hit.t == best.hit.t && found.path < best.path);
        if better {
            self.best = Some(found);
        }
        ControlFlow::Continue(found.hit.t)
    }
}

/// Whether there is a hit.
struct Any {
    found: bool,
}

impl Question for Any {
    const ORDERED: bool = false;

    #[inline(always)]
    fn ask(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        look: &mut Look<'_>,
    ) -> ControlFlow<(), f32> {
        // As above.
        self.found = match (of, &look) {
            (InstanceOf::Tree(tree), Look::Plain) => tree.any_hit(ray),
            _ => of.any_hit(ray, path.then(id), look),
        };
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(ray.t_max) }
    }
}

/// Passes every hit to the visitor.
struct All<'a> {
    visitor: &'a mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    flow: ControlFlow<()>,
}

impl Question for All<'_> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn ask(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        (path, id): (InstancePath, u32),
        look: &mut Look<'_>,
    ) -> ControlFlow<(), f32> {
        self.flow = of.all_hits(ray, path.then(id), look, self.visitor);
        self.flow?;
        ControlFlow::Continue(ray.t_max)
    }
}

impl InstanceOf {
    #[inline(never)]
    fn closest_hit(&self, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> Option<InstanceHit> {
        let tree = match self {
            InstanceOf::Tree(tree) => tree,
            InstanceOf::Instances(tree) => return tree.closest(ray, path, look),
        };
        let hit = match look {
            Look::Plain => tree.closest_hit(ray),
            Look::Filtered { mask, accept } => {
                tree.closest_hit_filtered(ray, *mask, |&hit| accept(&InstanceHit { path, hit }))
            }
            Look::Observed(observer) => tree.closest_hit_observed(ray, observer),
        };
        hit.map(|hit| InstanceHit { path, hit })
    }

    #[inline(never)]
    fn any_hit(&self, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> bool {
        let tree = match self {
            InstanceOf::Tree(tree) => tree,
            InstanceOf::Instances(tree) => return tree.any(ray, path, look),
        };
        match look {
            Look::Plain => tree.any_hit(ray),
            Look::Filtered { mask, accept } => {
                tree.any_hit_filtered(ray, *mask, |&hit| accept(&InstanceHit { path, hit }))
            }
            Look::Observed(observer) => tree.any_hit_observed(ray, observer),
        }
    }

    #[inline(never)]
    fn all_hits(
        &self,
        ray: &Ray,
        path: InstancePath,
        look: &mut Look<'_>,
        visitor: &mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let tree = match self {
            InstanceOf::Tree(tree) => tree,
            InstanceOf::Instances(tree) => return tree.all(ray, path, look, visitor),
        };
        let visitor = |hit| visitor(InstanceHit { path, hit });
        match look {
            Look::Plain => tree.all_hits(ray, visitor),
            Look::Filtered { mask, accept } => {
                tree.all_hits_filtered(ray, *mask, |&hit| accept(&InstanceHit { path, hit }), visitor)
            }
            Look::Observed(observer) => tree.all_hits_observed(ray, observer, visitor),
        }
    }
}

impl InstanceTree {
    /// The closest hit; its path continues `path`.
    pub(super) fn closest(&self, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> Option<InstanceHit> {
        self.asked(ray, path, look, Closest { best: None }).best
    }

    pub(super) fn any(&self, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> bool {
        self.asked(ray, path, look, Any { found: false }).found
    }

    pub(super) fn all(
        &self,
        ray: &Ray,
        path: InstancePath,
        look: &mut Look<'_>,
        visitor: &mut dyn FnMut(InstanceHit) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.asked(ray, path, look, All { visitor, flow: ControlFlow::Continue(()) }).flow
    }

    /// Runs a query over all instances that matter.
    fn asked<Q: Question>(&self, ray: &Ray, path: InstancePath, look: &mut Look<'_>, question: Q) -> Q {
        if self.wide.root == ChildRef::NOTHING {
            return question;
        }
        let (set, trees) = (&self.placements, &self.trees[..]);
        let (mut tree_ray, usual) = TreeRay::of(ray, set.frame());
        if !usual || set.is_far(&tree_ray) {
            set.mend(&mut tree_ray);
        }
        if tree_ray.sees_nothing() {
            return question;
        }
        let mut stops = Asked { set, trees, local: *ray, path, look, question };
        let (tree, tree_ray) = (&self.wide, &tree_ray);
        if Q::ORDERED {
            dispatch(self.simd, Way::<true, _> { tree, ray, tree_ray, stops: &mut stops });
        } else {
            dispatch(self.simd, Way::<false, _> { tree, ray, tree_ray, stops: &mut stops });
        }
        stops.question
    }
}

/// The state of a query during the traversal of the tree over instances.
struct Asked<'a, 'b, Q> {
    set: &'a Placements,
    trees: &'a [InstanceOf],
    /// The ray in the space of the current instance. It is updated in place, and only where it differs: copying a ray
    /// would wait for the stores before.
    local: Ray,
    path: InstancePath,
    look: &'a mut Look<'b>,
    question: Q,
}

impl<Q: Question> Stops for Asked<'_, '_, Q> {
    #[inline(always)]
    fn node(&mut self) {
        self.look.observe(|observer| observer.node());
    }

    #[inline(always)]
    fn leaf(&mut self) {
        self.look.observe(|observer| observer.leaf());
    }

    #[inline(always)]
    fn ask(&mut self, id: u32, ray: &Ray) -> ControlFlow<(), f32> {
        let Asked { set, trees, path, ref mut local, ref mut look, ref mut question } = *self;
        let one = &set.placed[id as usize];
        if !(one.active.contains(ray.time) && look.sees(one.mask)) {
            return ControlFlow::Continue(ray.t_max);
        }
        let Some((origin, dir)) = set.motions.inward(&one.motion, ray) else {
            return ControlFlow::Continue(ray.t_max);
        };
        (local.origin, local.dir) = (origin, dir);
        if set.outlines[one.tree as usize].is_missed(local) {
            return ControlFlow::Continue(ray.t_max);
        }
        if local.t_max != ray.t_max {
            local.t_max = ray.t_max;
        }
        question.ask(&trees[one.tree as usize], local, (path, id), look)
    }
}
