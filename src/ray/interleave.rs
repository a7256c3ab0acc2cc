//! Many rays at once through the wide layout, a block each by turns.
//!
//! The picture: a waiter who serves several tables. A ray that needs a block which is not in the cache would
//! wait for it as long as dozens of tests take; so the block is asked for, and the other rays of the
//! group take their turns until it has come. Answers do not depend on it. On a tree that fits the cache it only
//! costs, so small trees are asked ray by ray; and so are trees most of which stands still, whose steps are short.

use super::collect::{Any, Closest, Collect, Found};
use super::filter::Everything;
use super::hit::Hit;
use super::intersect::RaySource;
use super::shear::Sheared;
use super::traverser::Traverser;
use super::tree_ray::TreeRay;
use super::wide_traversal::RayQuery;
use crate::geometry::Ray;
use crate::layout::{ChildRef, WideTree};
use crate::simd::{Kernel, Simd};
use crate::traverse::{Cursor, StackOf, WideTraversal};

/// Rays on their way at the same time.
const GROUP: usize = 8;

/// What a batch asks of each of its rays.
pub(crate) trait Asks {
    /// An answer.
    type Answer: Copy + Send + PartialEq;
    /// The answer of a ray that hits nothing.
    const NOTHING: Self::Answer;
    /// What gathers it.
    type Collect: Collect;
    /// Whether blocks are visited from near to far.
    const ORDERED: bool = Self::Collect::ORDERED;
    /// A collector for a ray's hits.
    fn collect(ray: &TreeRay) -> Self::Collect;
    /// How far the ray still looks as a distance in tree space; below zero where it has its answer.
    fn reach(collect: &Self::Collect) -> f32;
    /// The answer, once the ray is through.
    fn answer(collect: &Self::Collect, set: &impl RaySource) -> Self::Answer;
}

type Accept = fn(&Found) -> bool;

fn accept(_: &Found) -> bool {
    true
}

/// The nearest hit of each ray.
pub(crate) struct Closests;

impl Asks for Closests {
    type Answer = Option<Hit>;
    const NOTHING: Option<Hit> = None;
    type Collect = Closest<Accept>;

    #[inline(always)]
    fn collect(ray: &TreeRay) -> Closest<Accept> {
        Closest { t_max: ray.t_max(), reach: ray.end, best: None, accept }
    }

    #[inline(always)]
    fn reach(collect: &Closest<Accept>) -> f32 {
        collect.reach
    }

    #[inline(always)]
    fn answer(collect: &Closest<Accept>, set: &impl RaySource) -> Option<Hit> {
        collect.best.map(|found| found.hit.answer(set.name(found.id)))
    }
}

/// Whether each ray hits anything.
pub(crate) struct Anys;

impl Asks for Anys {
    type Answer = bool;
    const NOTHING: bool = false;
    type Collect = Any<Accept>;

    #[inline(always)]
    fn collect(ray: &TreeRay) -> Any<Accept> {
        Any { t_max: ray.t_max(), reach: ray.end, found: false, accept }
    }

    #[inline(always)]
    fn reach(collect: &Any<Accept>) -> f32 {
        if collect.found { -1.0 } else { collect.reach }
    }

    #[inline(always)]
    fn answer(collect: &Any<Accept>, _: &impl RaySource) -> bool {
        collect.found
    }
}

/// A batch, to be dispatched to an instruction set. There are as many answers as rays, all still
/// [`Asks::NOTHING`].
pub(crate) struct Batch<'a, G, A: Asks> {
    pub tree: &'a WideTree,
    pub set: &'a G,
    pub rays: &'a [Ray],
    pub answers: &'a mut [A::Answer],
}

/// A ray of the group.
struct Turn<'a, C> {
    /// Its place in the batch.
    index: usize,
    ray: TreeRay<'a>,
    sheared: Option<Sheared>,
    cursor: Cursor<'a>,
    collect: C,
}

impl<G: RaySource, A: Asks> Kernel for Batch<'_, G, A> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Batch { tree, set, rays, answers } = self;
        if tree.root == ChildRef::NOTHING {
            return;
        }
        let traverser = Traverser { arena: &tree.arena, lists: tree.lists, set, filter: &Everything };
        let traversal = WideTraversal::by_turns(&tree.arena);
        let mut waiting = rays.iter().enumerate().filter_map(|(i, ray)| Some((i, TreeRay::new(ray, set.frame())?)));
        let mut memory: [StackOf; GROUP] = core::array::from_fn(|_| StackOf::new());
        let mut group: Vec<Turn<'_, A::Collect>> = Vec::with_capacity(GROUP);
        for (memory, (index, ray)) in memory.iter_mut().zip(&mut waiting) {
            let cursor = Cursor::new(tree.root, memory.stack(tree.waiting()));
            let collect = A::collect(&ray);
            group.push(Turn { index, ray, sheared: None, cursor, collect });
        }
        while !group.is_empty() {
            let mut i = 0;
            while i < group.len() {
                let turn = &mut group[i];
                let Turn { ray, sheared, cursor, collect, .. } = turn;
                let mut query = RayQuery { traverser: &traverser, ray, sheared, collect, observer: &mut () };
                if traversal.advance(s, cursor, &mut query).is_continue() {
                    traverser.arena.prefetch(cursor.at.at(), cursor.at.lines());
                    i += 1;
                    continue;
                }
                answers[turn.index] = A::answer(&turn.collect, set);
                match waiting.next() {
                    Some((index, ray)) => {
                        turn.cursor.restart(tree.root);
                        turn.collect = A::collect(&ray);
                        (turn.index, turn.ray, turn.sheared) = (index, ray, None);
                        i += 1;
                    }
                    None => {
                        group.swap_remove(i);
                    }
                }
            }
        }
    }
}
