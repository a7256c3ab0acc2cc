//! Rays in a tree of instances.
//!
//! The way through the tree over instances is that of every wide tree. A leaf is one instance: the ray is brought into its space
//! and asked of the tree there by the queries of that tree, so whatever holds for those (layouts, instruction sets, ties) holds here.
//! Of a search for the nearest, the ray in there ends at the best hit so far, in its own `t`. A ray that passes by the box of what is
//! placed, as it is in its own space, does not enter.
//!
//! Why nothing is missed: see `placements`, which says how far outside of its box something in an instance may be hit.

use super::hit::{InstanceHit, InstancePath};
use super::placements::Placements;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::layout::ChildRef;
use crate::primitive::PrimitiveSet;
use crate::ray::{Observer, Stops, TreeRay, Way};
use crate::simd::dispatch;
use core::ops::ControlFlow;

/// Who looks on, or what is seen.
pub(super) enum Look<'a, T = InstanceHit> {
    /// Everything, unobserved.
    Plain,
    /// Instances and meshes whose masks share a bit with this one, answers that are accepted.
    Filtered { mask: u32, accept: &'a dyn Fn(&T) -> bool },
    /// Everything, observed.
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

/// What is asked of each instance on the way.
trait Question {
    /// Whether near instances are asked first.
    const ORDERED: bool;
    /// Asks the tree of an instance (which the path leads to with this number at its end), by a ray in its space that ends where
    /// nothing farther matters. Returns the end from now on; `Break` ends the query.
    fn ask(
        &mut self,
        of: &InstanceOf,
        ray: &Ray,
        path: (InstancePath, u32),
        look: &mut Look<'_>,
    ) -> ControlFlow<(), f32>;
}

/// The nearest hit; of several at the same `t` that of the lowest path, and of these the lowest primitive.
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
        // The usual case stands here, and all else is a call, which would push the way there out of registers.
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
        // Likewise.
        self.found = match (of, &look) {
            (InstanceOf::Tree(tree), Look::Plain) => tree.any_hit(ray),
            _ => of.any_hit(ray, path.then(id), look),
        };
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(ray.t_max) }
    }
}

/// Hands on every hit.
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
    /// The nearest hit, named by a path that goes on from `path`.
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

    /// The question, once all instances that matter were asked.
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

/// What is asked on the way through the tree over instances.
struct Asked<'a, 'b, Q> {
    set: &'a Placements,
    trees: &'a [InstanceOf],
    /// The ray in the space of the instance that is asked. It stays where it is, and only what differs is written: a ray that is
    /// copied waits for the stores before.
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
