//! Traversal of the wide layout by a ray: nodes are tested by the slab test (`ray/kernel/slabs.rs`), leaf blocks by kernels of
//! their own ([`super::leaf`]).

use super::collect::Collect;
use super::leaf::LeafRows;
use super::ray_layout::RayLayout;
use super::traverser::Traverser;
use crate::geometry::KeyTime;
use crate::layout::{Between, CORNER_ROWS, ChildRef, KeyedLeaf, Kind, VERTEX_ROWS, WideTree};
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::kernel::shear::Sheared;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{Mask, Simd, Stack};
use crate::traverse::{Cursor, NodeBlock, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// The wide layout, and the instruction set for its traversal.
pub(crate) struct Wide<'a, S> {
    pub tree: &'a WideTree,
    pub simd: S,
    /// The stack of the traversal. It is allocated before the ray is prepared: a deep tree needs a call for it, which would spill
    /// the registers of the ray.
    pub stack: Stack<'a, u64>,
}

impl<S: Simd> RayLayout for Wide<'_, S> {
    #[inline(always)]
    fn near(&self) -> f32 {
        self.tree.near
    }

    #[inline(always)]
    fn traverse(
        self,
        scene: &Scene,
        ray: &mut TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        if self.tree.root == ChildRef::NOTHING {
            return;
        }
        let traverser = Traverser::new(self.tree, scene, filter);
        let mut cursor = Cursor::new(self.tree.root, self.stack);
        let traversal = WideTraversal::at_time(self.tree, ray.time());
        loop {
            let mut query = RayState { traverser: &traverser, ray, sheared: &mut None, collect, observer };
            while traversal.advance(self.simd, &mut cursor, &mut query).is_continue() {}
            if !ray.in_pieces || collect.is_final() || !ray.next_piece(scene.frame(), self.tree.near) {
                return;
            }
            collect.move_on(ray);
            if collect.reach() < ray.begin {
                return;
            }
            cursor.restart(self.tree.root);
        }
    }
}

/// The state of a ray during a traversal, and the parts of its query.
pub(in crate::ray) struct RayState<'a, F, C, O> {
    pub traverser: &'a Traverser<'a, F>,
    pub ray: &'a TreeRay<'a>,
    /// Computed when the ray reaches its first leaf block.
    pub sheared: &'a mut Option<Sheared>,
    pub collect: &'a mut C,
    pub observer: &'a mut O,
}

impl<S: Simd, F: Filter, C: Collect, O: Observer> WideQuery<S> for RayState<'_, F, C, O> {
    const ORDERED: bool = C::ORDERED;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.ray.time()
    }

    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        self.traverser.hides(block)
    }

    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        self.ray.slabs.enter::<S, ROWS>(s, block, self.collect.reach())
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.ray.slabs.key(self.collect.reach())
    }

    #[inline(always)]
    fn leaf(&mut self, s: S, at: ChildRef) -> ControlFlow<()> {
        let RayState { traverser, ray, .. } = *self;
        let (collect, observer) = (&mut *self.collect, &mut *self.observer);
        if self.sheared.is_none() {
            let (of, regular) = Sheared::of(ray);
            let of = self.sheared.insert(of);
            if !regular {
                of.recompute(ray);
            }
        }
        let Some(sheared) = &*self.sheared else { return ControlFlow::Continue(()) };
        // Each kind of test is called from one place, so that the code of a query fits the instruction cache.
        let still = (sheared, Between::NEVER);
        let (shared, rows, between) = match at.kind() {
            Kind::StaticLeaf => {
                let rows = LeafRows::loose(at, CORNER_ROWS);
                return ended(traverser.leaf::<S, false>(s, rows, ray, still, collect, observer));
            }
            Kind::SharedStaticLeaf => {
                let rows = LeafRows::shared(at, VERTEX_ROWS);
                return ended(traverser.shared::<S, false>(s, rows, ray, still, collect, observer));
            }
            Kind::Leaf => (false, LeafRows::loose(at, 2 * CORNER_ROWS), Between::of_two(ray.time())),
            Kind::SharedLeaf => (true, LeafRows::shared(at, 2 * VERTEX_ROWS), Between::of_two(ray.time())),
            _ if at.at() >= traverser.lists => {
                return ended(traverser.shapes(s, at, (ray, sheared), collect, observer));
            }
            _ => {
                let keyed = KeyedLeaf::read(traverser.arena.ints(), at);
                let time = KeyTime::new(ray.time(), keyed.segments + 1);
                (keyed.shared, LeafRows::keyed(at, &keyed, time.segment), Between::new(time))
            }
        };
        let moving = (sheared, between);
        ended(match shared {
            true => traverser.shared::<S, true>(s, rows, ray, moving, collect, observer),
            false => traverser.leaf::<S, true>(s, rows, ray, moving, collect, observer),
        })
    }
}

/// `Break` if the query has ended.
#[inline(always)]
fn ended(end: bool) -> ControlFlow<()> {
    if end { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
