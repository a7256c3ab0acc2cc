//! A ray through a tree whose leaves list things that are asked themselves: instances, subtrees that are built on demand.
//!
//! The way is that of every wide tree. In each leaf that the ray comes to, what it lists is asked; of a search for the nearest, the
//! ray ends from then on at the best hit so far.

use super::tree_ray::TreeRay;
use crate::geometry::Ray;
use crate::layout::{ChildRef, WideTree};
use crate::simd::{Kernel, Mask, Simd};
use crate::traverse::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// What a ray does on its way.
pub(crate) trait Stops {
    /// A node is about to be tested.
    fn node(&mut self);
    /// A leaf is about to be looked at.
    fn leaf(&mut self);
    /// Asks one of what a leaf lists. The ray ends where nothing farther matters; returns the end from now on. `Break` ends the
    /// way.
    fn ask(&mut self, id: u32, ray: &Ray) -> ControlFlow<(), f32>;
}

/// The way of a ray, to be dispatched to an instruction set; if it is `ORDERED`, what is near is asked first.
pub(crate) struct Way<'a, const ORDERED: bool, Q: ?Sized> {
    /// The tree, which must not be empty.
    pub tree: &'a WideTree,
    /// The ray as it was asked.
    pub ray: &'a Ray,
    /// The same in tree space.
    pub tree_ray: &'a TreeRay<'a>,
    pub stops: &'a mut Q,
}

impl<const ORDERED: bool, Q: Stops + ?Sized> Kernel for Way<'_, ORDERED, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Way { tree, ray, tree_ray, stops } = self;
        let (ray, reach) = (Ray { t_max: tree_ray.t_max(), ..*ray }, tree_ray.end);
        let mut query = OnTheWay::<ORDERED, Q> { tree, tree_ray, ray, reach, stops };
        let mut memory = StackOf::new();
        let mut cursor = Cursor::new(tree.root, memory.stack(tree.waiting()));
        let traversal = WideTraversal::new(&tree.arena);
        while traversal.advance(s, &mut cursor, &mut query).is_continue() {}
    }
}

/// A ray on its way.
struct OnTheWay<'a, const ORDERED: bool, Q: ?Sized> {
    tree: &'a WideTree,
    tree_ray: &'a TreeRay<'a>,
    /// The ray as it was asked, up to where something still matters.
    ray: Ray,
    /// The same end as a distance in tree space.
    reach: f32,
    stops: &'a mut Q,
}

impl<S: Simd, const ORDERED: bool, Q: Stops + ?Sized> WideQuery<S> for OnTheWay<'_, ORDERED, Q> {
    const ORDERED: bool = ORDERED;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.ray.time
    }

    #[inline(always)]
    fn node(&mut self) {
        self.stops.node();
    }

    #[inline(always)]
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        self.tree_ray.slabs.enter::<S, ROWS>(s, block, self.reach)
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.tree_ray.slabs.key(self.reach)
    }

    #[inline(always)]
    fn leaf(&mut self, _: S, leaf: ChildRef) -> ControlFlow<()> {
        self.stops.leaf();
        for i in leaf.at()..leaf.at() + leaf.len() {
            let end = self.stops.ask(self.tree.arena.ints()[i], &self.ray).map_break(|()| ())?;
            if end < self.ray.t_max {
                self.ray.t_max = end;
                self.reach = self.tree_ray.reach(end);
            }
        }
        ControlFlow::Continue(())
    }
}
