//! Ray traversal of a tree whose leaves list objects with queries of their own: instances, and subtrees that are built
//! on demand.
//!
//! The traversal is that of every wide tree. In each leaf that the ray reaches, the listed objects are queried. In a
//! search for the closest hit, the ray ends from then on at the best hit so far.

use crate::geometry::Ray;
use crate::layout::{ChildRef, WideTree};
use crate::ray::kernel::tree_ray::TreeRay;
use crate::simd::{Kernel, Mask, Simd};
use crate::traverse::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// The callbacks of a ray's traversal.
pub(crate) trait LeafVisitor {
    /// Objects take part whose visibility masks share a bit with this one; all of them if there is none.
    fn mask(&self) -> Option<u32>;
    /// A node is about to be tested.
    fn node(&mut self);
    /// A leaf is about to be visited.
    fn leaf(&mut self);
    /// Queries one of the objects that a leaf lists. Returns the new end of the ray, beyond which no hit matters.
    /// `Break` ends the traversal.
    fn object<S: Simd>(&mut self, s: S, id: u32, ray: &Ray) -> ControlFlow<(), f32>;
}

/// The traversal of a ray, to be dispatched to an instruction set; if `ORDERED`, front to back.
pub(crate) struct ObjectTraversal<'a, const ORDERED: bool, Q: ?Sized> {
    /// The tree, which must not be empty.
    pub tree: &'a WideTree,
    /// The ray as the caller gave it.
    pub ray: &'a Ray,
    /// The ray in tree space.
    pub tree_ray: &'a TreeRay<'a>,
    pub visitor: &'a mut Q,
}

impl<const ORDERED: bool, Q: LeafVisitor + ?Sized> Kernel for ObjectTraversal<'_, ORDERED, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let ObjectTraversal { tree, ray, tree_ray, visitor } = self;
        let (ray, reach) = (Ray { t_max: tree_ray.t_max(), ..*ray }, tree_ray.end);
        let mut query = ObjectRayState::<ORDERED, Q> { tree, tree_ray, ray, reach, mask: visitor.mask(), visitor };
        let mut memory = StackOf::new();
        let mut cursor = Cursor::new(tree.root, memory.stack(tree.max_stack()));
        let traversal = WideTraversal::new(&tree.arena);
        while traversal.advance(s, &mut cursor, &mut query).is_continue() {}
    }
}

/// The state of a traversal.
struct ObjectRayState<'a, const ORDERED: bool, Q: ?Sized> {
    tree: &'a WideTree,
    tree_ray: &'a TreeRay<'a>,
    /// The caller's ray, shortened to where a hit still matters.
    ray: Ray,
    /// The same end as a distance in tree space.
    reach: f32,
    /// The mask of the query.
    mask: Option<u32>,
    visitor: &'a mut Q,
}

impl<S: Simd, const ORDERED: bool, Q: LeafVisitor + ?Sized> WideQuery<S> for ObjectRayState<'_, ORDERED, Q> {
    const ORDERED: bool = ORDERED;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.ray.time
    }

    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        self.tree.masks.hide(block, self.mask)
    }

    #[inline(always)]
    fn node(&mut self) {
        self.visitor.node();
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
    fn leaf(&mut self, s: S, leaf: ChildRef) -> ControlFlow<()> {
        self.visitor.leaf();
        for i in leaf.at()..leaf.at() + leaf.len() {
            let end = self.visitor.object(s, self.tree.arena.ints()[i], &self.ray).map_break(|()| ())?;
            if end < self.ray.t_max {
                self.ray.t_max = end;
                self.reach = self.tree_ray.reach(end);
            }
        }
        ControlFlow::Continue(())
    }
}
