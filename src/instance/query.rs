//! Rays in a tree of instances.
//!
//! The way through the tree over instances is that of every wide tree. A leaf is one instance: the ray is brought into its space
//! and asked of the tree there by the queries of that tree, so whatever holds for those (layouts, instruction sets, ties) holds here.
//! Of a search for the nearest, the ray in there ends at the best hit so far, in its own `t`.
//!
//! Why nothing is missed: see `placements`, which says how far outside of its box something in an instance may be hit.

use super::hit::{InstanceHit, InstancePath};
use super::placements::Placements;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::layout::{ChildRef, WideTree};
use crate::ray::{Observer, Slabs, TreeRay};
use crate::simd::{Kernel, Mask, Simd, dispatch};
use crate::traverse::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// Who looks on, or what is seen.
pub(super) enum Look<'a> {
    /// Everything, unobserved.
    Plain,
    /// Instances and meshes whose masks share a bit with this one, hits that are accepted.
    Filtered { mask: u32, accept: &'a dyn Fn(&InstanceHit) -> bool },
    /// Everything, observed.
    Observed(&'a mut dyn Observer),
}

impl Look<'_> {
    #[inline]
    fn sees(&self, mask: u32) -> bool {
        match self {
            Look::Filtered { mask: wanted, .. } => wanted & mask != 0,
            _ => true,
        }
    }

    #[inline]
    fn observe(&mut self, what: fn(&mut dyn Observer)) {
        if let Look::Observed(observer) = self {
            what(*observer);
        }
    }
}

/// What is asked of each instance on the way.
trait Question {
    /// Whether near instances are asked first.
    const ORDERED: bool;
    /// Asks the tree of an instance, by a ray in its space that ends where nothing farther matters. Returns the end from now
    /// on; `Break` ends the query.
    fn ask(&mut self, of: &InstanceOf, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> ControlFlow<(), f32>;
}

/// The nearest hit; of several at the same `t` that of the lowest path, and of these the lowest primitive.
struct Closest {
    best: Option<InstanceHit>,
}

impl Question for Closest {
    const ORDERED: bool = true;

    #[inline]
    fn ask(&mut self, of: &InstanceOf, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> ControlFlow<(), f32> {
        let Some(found) = of.closest_hit(ray, path, look) else { return ControlFlow::Continue(ray.t_max) };
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

    #[inline]
    fn ask(&mut self, of: &InstanceOf, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> ControlFlow<(), f32> {
        self.found = of.any_hit(ray, path, look);
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

    #[inline]
    fn ask(&mut self, of: &InstanceOf, ray: &Ray, path: InstancePath, look: &mut Look<'_>) -> ControlFlow<(), f32> {
        self.flow = of.all_hits(ray, path, look, self.visitor);
        self.flow?;
        ControlFlow::Continue(ray.t_max)
    }
}

impl InstanceOf {
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
        let (wide, set, trees) = (&self.wide, &self.placements, &self.trees[..]);
        dispatch(self.simd, Asked { wide, set, trees, ray, path, look, question })
    }
}

/// A query, to be dispatched to an instruction set.
struct Asked<'a, 'b, Q> {
    wide: &'a WideTree,
    set: &'a Placements,
    trees: &'a [InstanceOf],
    ray: &'a Ray,
    path: InstancePath,
    look: &'a mut Look<'b>,
    question: Q,
}

impl<Q: Question> Kernel for Asked<'_, '_, Q> {
    type Output = Q;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Q {
        let wide = self.wide;
        let Some(tree_ray) = self.set.tree_ray(self.ray) else { return self.question };
        let slabs = Slabs::new(&tree_ray);
        let (ray, reach) = (Ray { t_max: tree_ray.t_max, ..*self.ray }, tree_ray.end);
        let mut query = InstanceQuery { of: self, tree_ray: &tree_ray, slabs: &slabs, ray, reach };
        let mut memory = StackOf::new();
        let mut cursor = Cursor::new(wide.root, memory.stack(wide.waiting()));
        let traversal = WideTraversal::new(&wide.arena);
        while traversal.advance(s, &mut cursor, &mut query).is_continue() {}
        query.of.question
    }
}

/// A ray on its way through the tree over instances.
struct InstanceQuery<'a, 'b, Q> {
    of: Asked<'a, 'b, Q>,
    tree_ray: &'a TreeRay,
    slabs: &'a Slabs,
    /// The ray as it was asked, up to where something still matters.
    ray: Ray,
    /// The same end as a distance in tree space.
    reach: f32,
}

impl<Q: Question> InstanceQuery<'_, '_, Q> {
    /// Asks one instance.
    #[inline]
    fn instance(&mut self, id: u32) -> ControlFlow<()> {
        let Asked { set, trees, path, ref mut look, ref mut question, .. } = self.of;
        let one = &set.placed[id as usize];
        if !(one.active.contains(self.ray.time) && look.sees(one.mask)) {
            return ControlFlow::Continue(());
        }
        let Some(local) = set.motions.local_ray(&one.motion, &self.ray) else { return ControlFlow::Continue(()) };
        let end = question.ask(&trees[one.tree as usize], &local, path.then(id), look).map_break(|()| ())?;
        if end < self.ray.t_max {
            self.ray.t_max = end;
            self.reach = self.tree_ray.reach(end);
        }
        ControlFlow::Continue(())
    }
}

impl<S: Simd, Q: Question> WideQuery<S> for InstanceQuery<'_, '_, Q> {
    const ORDERED: bool = Q::ORDERED;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.ray.time
    }

    #[inline(always)]
    fn node(&mut self) {
        self.of.look.observe(|observer| observer.node());
    }

    #[inline(always)]
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        self.slabs.enter::<S, ROWS>(s, block, self.reach)
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.slabs.key(self.reach)
    }

    #[inline(always)]
    fn leaf(&mut self, _: S, leaf: ChildRef) -> ControlFlow<()> {
        self.of.look.observe(|observer| observer.leaf());
        for i in leaf.at()..leaf.at() + leaf.len() {
            self.instance(self.of.wide.arena.ints()[i])?;
        }
        ControlFlow::Continue(())
    }
}
