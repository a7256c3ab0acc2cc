//! Many rays at once through the wide layout, a block each by turns.
//!
//! The picture: a waiter who serves several tables. A ray that needs a block which is not in the cache would
//! wait for it as long as dozens of tests take; so the block is asked for, and the other rays of the
//! group take their turns until it has come. Answers do not depend on it. On a tree that fits the cache it only
//! costs, so small trees are asked ray by ray; and so are trees most of which stands still, whose steps are short,
//! and rays of which each finds what it needs where the one before it has been.

use super::collect::{Any, Closest, Collect, Found};
use super::filter::Everything;
use super::hit::Hit;
use super::query_ray::{Ray, TreeRay};
use super::wide::{Forms, Journey, Scene, StackOf};
use crate::simd::{Kernel, Simd};
use crate::tree::wide::{ChildRef, WideSource, WideTree};

/// Rays on their way at the same time.
const GROUP: usize = 8;

/// Whether most rays find what they need where the one before them has been: those that look nearly the same way, as
/// the rays of a camera do, and those that begin near it, unless the tree is divided in time and they look at other times,
/// or they ask for any hit, in no order. `scale` makes a distance one in tree space.
pub(crate) fn follow_each_other(rays: &[Ray], scale: f64, divided: bool, ordered: bool) -> bool {
    const SAMPLES: usize = 16;
    /// The cosine of a few degrees.
    const SAME_WAY: f32 = 0.99;
    /// In tree space, where a scene is two across.
    const NEAR: f64 = 0.4;
    const SAME_TIME: f32 = 1.0 / 16.0;
    let step = rays.len().div_ceil(SAMPLES).max(1);
    let (mut following, mut pairs) = (0, 0);
    for pair in rays.windows(2).step_by(step) {
        let [a, b] = [pair[0], pair[1]];
        let same_way = a.dir.normalize_or_zero().dot(b.dir.normalize_or_zero()) > SAME_WAY;
        let near = (a.origin - b.origin).length() * scale < NEAR;
        let same_tree = !divided || (a.time - b.time).abs() < SAME_TIME;
        following += usize::from(same_way | (near & same_tree & ordered));
        pairs += 1;
    }
    2 * following > pairs
}

/// What a batch asks of each of its rays.
pub(crate) trait Asks {
    /// An answer.
    type Answer: Copy + Send;
    /// The answer of a ray that hits nothing.
    const NOTHING: Self::Answer;
    /// What gathers it.
    type Collect: Collect;
    /// Whether blocks are visited from near to far.
    const ORDERED: bool = Self::Collect::ORDERED;
    /// A collector for hits up to a distance.
    fn collect(t_max: f32) -> Self::Collect;
    /// The answer, once the ray is through.
    fn answer(collect: &Self::Collect, set: &impl WideSource, ray: &TreeRay) -> Self::Answer;
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
    fn collect(t_max: f32) -> Closest<Accept> {
        Closest { t_max, best: None, accept }
    }

    #[inline(always)]
    fn answer(collect: &Closest<Accept>, set: &impl WideSource, ray: &TreeRay) -> Option<Hit> {
        collect.best.map(|found| ray.answer(found.hit, set.name(found.id)))
    }
}

/// Whether each ray hits anything.
pub(crate) struct Anys;

impl Asks for Anys {
    type Answer = bool;
    const NOTHING: bool = false;
    type Collect = Any<Accept>;

    #[inline(always)]
    fn collect(t_max: f32) -> Any<Accept> {
        Any { t_max, found: false, accept }
    }

    #[inline(always)]
    fn answer(collect: &Any<Accept>, _: &impl WideSource, _: &TreeRay) -> bool {
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
    ray: TreeRay,
    forms: Forms,
    journey: Journey<'a>,
    collect: C,
}

impl<G: WideSource, A: Asks> Kernel for Batch<'_, G, A> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Batch { tree, set, rays, answers } = self;
        if tree.root == ChildRef::NOTHING {
            return;
        }
        let scene = Scene { arena: &tree.arena, set, filter: &Everything, ahead: false };
        let mut waiting = rays.iter().enumerate().filter_map(|(i, ray)| Some((i, TreeRay::new(ray, &set.frame())?)));
        let mut memory: [StackOf; GROUP] = core::array::from_fn(|_| StackOf::new());
        let mut group: Vec<Turn<'_, A::Collect>> = Vec::with_capacity(GROUP);
        for (memory, (index, ray)) in memory.iter_mut().zip(&mut waiting) {
            let journey = Journey::new(tree.root, memory.stack(tree.waiting()));
            let collect = A::collect(ray.t_max);
            group.push(Turn { index, forms: Forms::new(&ray), ray, journey, collect });
        }
        while !group.is_empty() {
            let mut i = 0;
            while i < group.len() {
                let turn = &mut group[i];
                if scene.advance(s, &turn.ray, &turn.forms, &mut turn.journey, &mut turn.collect, &mut ()) {
                    scene.arena.prefetch(turn.journey.at.at(), turn.journey.at.lines());
                    i += 1;
                    continue;
                }
                answers[turn.index] = A::answer(&turn.collect, set, &turn.ray);
                match waiting.next() {
                    Some((index, ray)) => {
                        turn.journey.restart(tree.root);
                        turn.collect = A::collect(ray.t_max);
                        turn.forms = Forms::new(&ray);
                        (turn.index, turn.ray) = (index, ray);
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn rays_follow_each_other_from_a_camera_and_from_near_places_but_not_through_a_tree_divided_in_time() {
        let camera = |i: usize| Ray::new(Vec3::ZERO, Vec3::new(i as f32 * 1e-3, 1.0, 2.0)).at_time((i % 2) as f32);
        let any_way = |i: usize| Vec3::new((i * 31 % 17) as f32 - 8.0, (i % 3) as f32, 1.0);
        let near = |i: usize| Ray::new(Vec3::splat(i as f32 * 1e-3), any_way(i)).at_time((i % 2) as f32);
        let scattered = |i: usize| Ray { origin: any_way(i * 7).as_dvec3(), ..near(i) };
        for count in [2, 9, 256] {
            let follow = |ray: &dyn Fn(usize) -> Ray, divided: bool| {
                let rays: Vec<Ray> = (0..count).map(ray).collect();
                follow_each_other(&rays, 1.0, divided, true)
            };
            let follow_anywhere = |ray: &dyn Fn(usize) -> Ray| {
                let rays: Vec<Ray> = (0..count).map(ray).collect();
                follow_each_other(&rays, 1.0, false, false)
            };
            assert!(follow_anywhere(&camera) && !follow_anywhere(&near) && !follow_anywhere(&scattered));
            assert!(follow(&camera, false) && follow(&camera, true));
            assert!(follow(&near, false) && !follow(&near, true));
            assert!(follow(&|i| near(i).at_time(0.5), true));
            assert!(!follow(&scattered, false) && !follow(&scattered, true));
        }
        assert!(!follow_each_other(&[], 1.0, false, true) && !follow_each_other(&[camera(0)], 1.0, false, true));
        let nowhere = Ray { dir: Vec3::NAN, origin: Vec3::NAN.as_dvec3(), ..camera(0) };
        assert!(!follow_each_other(&[nowhere; 4], 1.0, false, true));
    }
}
