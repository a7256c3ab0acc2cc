//! What a traversal does with the hits it finds.

use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::hit::{Hit, SetHit};
use crate::ray::kernel::tree_ray::TreeRay;
use core::ops::ControlFlow;
use std::collections::HashSet;

/// A hit with its primitive's id.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub hit: SetHit,
    pub id: u32,
}

impl Found {
    /// The hit in the form of an answer.
    #[inline(always)]
    pub fn answer(&self, scene: &Scene) -> Hit {
        self.hit.answer(scene.mesh_and_primitive(self.id))
    }
}

/// Receives hits in any order. Its limit is used for culling: hits strictly farther away do not matter.
pub(crate) trait Collect {
    /// Whether nearer children should be visited first.
    const ORDERED: bool;
    /// Whether the position of a hit does not matter, so that [`Collect::found`] may end the query instead of an offered hit.
    const ANYWHERE: bool = false;
    /// The largest `t` that still matters.
    fn limit(&self) -> f32;
    /// The limit as a distance in tree space, rounded up if inexact.
    fn reach(&self) -> f32;
    /// Whether a hit within the ray's range and the limit would change the answer if the filter accepts it.
    #[inline(always)]
    fn wants(&self, _: &Found) -> bool {
        true
    }
    /// Takes such a hit; true ends the query.
    fn take(&mut self, found: Found, scene: &Scene) -> bool;
    /// Takes a hit within the ray's range and the limit, unless the filter refuses it; true ends the query.
    #[inline(always)]
    fn offer(&mut self, found: Found, ray: &TreeRay, scene: &Scene, filter: &impl Filter) -> bool {
        self.wants(&found) && filter.accepts(|| (ray.index, found.answer(scene))) && self.take(found, scene)
    }
    /// Goes on to the next piece of the ray, where distances are measured from another origin.
    fn move_on(&mut self, ray: &TreeRay);
    /// Whether no hit can change the answer any more.
    #[inline(always)]
    fn is_final(&self) -> bool {
        false
    }
    /// A distance in tree space. A hit that is certainly no farther away, on a primitive that the query sees, need not be offered.
    #[inline(always)]
    fn certain(&self, _ray: &TreeRay) -> f32 {
        f32::NEG_INFINITY
    }
    /// Reports that there is such a hit.
    #[inline(always)]
    fn found(&mut self) {}
}

/// Keeps the nearest hit; of equally near hits the one with the lowest id.
#[derive(Clone, Copy)]
pub(crate) struct Closest {
    t_max: f32,
    pub reach: f32,
    pub best: Option<Found>,
}

impl Closest {
    #[inline(always)]
    pub fn new(ray: &TreeRay) -> Closest {
        Closest { t_max: ray.t_max(), reach: ray.end, best: None }
    }
}

impl Collect for Closest {
    const ORDERED: bool = true;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn reach(&self) -> f32 {
        self.reach
    }

    #[inline(always)]
    fn wants(&self, found: &Found) -> bool {
        match self.best {
            Some(best) => found.hit.t < best.hit.t || (found.hit.t == best.hit.t && found.id < best.id),
            None => true,
        }
    }

    #[inline(always)]
    fn take(&mut self, found: Found, _: &Scene) -> bool {
        self.t_max = found.hit.t;
        self.reach = found.hit.reach;
        self.best = Some(found);
        false
    }

    #[inline(always)]
    fn move_on(&mut self, ray: &TreeRay) {
        self.reach = match self.best {
            Some(best) => ray.reach(best.hit.t).min(ray.end),
            None => ray.end,
        };
    }
}

/// Stops at the first hit.
#[derive(Clone, Copy)]
pub(crate) struct Any {
    t_max: f32,
    pub reach: f32,
    pub found: bool,
    /// Whether the filter accepts every hit.
    all: bool,
}

impl Any {
    /// `all` tells whether the filter accepts every hit.
    #[inline(always)]
    pub fn new(ray: &TreeRay, all: bool) -> Any {
        Any { t_max: ray.t_max(), reach: ray.end, found: false, all }
    }
}

impl Collect for Any {
    const ORDERED: bool = false;
    const ANYWHERE: bool = true;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn reach(&self) -> f32 {
        self.reach
    }

    #[inline(always)]
    fn take(&mut self, _: Found, _: &Scene) -> bool {
        self.found = true;
        true
    }

    #[inline(always)]
    fn move_on(&mut self, ray: &TreeRay) {
        self.reach = ray.end;
    }

    #[inline(always)]
    fn is_final(&self) -> bool {
        self.found
    }

    #[inline(always)]
    fn certain(&self, ray: &TreeRay) -> f32 {
        if self.all { ray.certain_end() } else { f32::NEG_INFINITY }
    }

    #[inline(always)]
    fn found(&mut self) {
        self.found = true;
    }
}

/// The caller's function that is called with each hit.
pub(in crate::ray) type HitVisitor<'a> = &'a mut dyn FnMut(Hit) -> ControlFlow<()>;

/// Passes every primitive that is hit to a visitor, once. Without a visitor, stops at the first hit.
pub(crate) struct All<'a> {
    t_max: f32,
    reach: f32,
    visitor: Option<HitVisitor<'a>>,
    /// Whether the position of a hit does not matter: there is no visitor, and the filter accepts every hit.
    anywhere: bool,
    /// The primitives that were passed on; `None` if each is found once.
    passed: Option<Passed>,
    /// The last return value of the visitor; without one, `Break` once there is a hit.
    pub flow: ControlFlow<()>,
}

impl<'a> All<'a> {
    /// `all` tells whether the filter accepts every hit, `repeats` whether a primitive may be found in several leaves.
    pub fn new(ray: &TreeRay, visitor: Option<HitVisitor<'a>>, all: bool, repeats: bool) -> All<'a> {
        All {
            t_max: ray.t_max(),
            reach: ray.end,
            anywhere: all && visitor.is_none(),
            visitor,
            passed: repeats.then(Passed::new),
            flow: ControlFlow::Continue(()),
        }
    }
}

/// The ids of primitives that were passed on: first in a short array, and in a hash set once the array is full. The memory grows
/// with the size of the answer.
struct Passed {
    few: [u32; FEW],
    count: usize,
    many: HashSet<u32>,
}

/// The number of ids that are searched one by one.
const FEW: usize = 24;

impl Passed {
    fn new() -> Passed {
        Passed { few: [0; FEW], count: 0, many: HashSet::new() }
    }

    /// Returns whether the id is new, and stores it.
    fn first_time(&mut self, id: u32) -> bool {
        if self.few[..self.count].contains(&id) {
            false
        } else if self.count < FEW {
            self.few[self.count] = id;
            self.count += 1;
            true
        } else {
            self.many.insert(id)
        }
    }
}

impl Collect for All<'_> {
    const ORDERED: bool = false;
    const ANYWHERE: bool = true;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn reach(&self) -> f32 {
        self.reach
    }

    #[inline(always)]
    fn take(&mut self, found: Found, scene: &Scene) -> bool {
        let Some(visitor) = &mut self.visitor else {
            self.found();
            return true;
        };
        if self.passed.as_mut().is_none_or(|passed| passed.first_time(found.id)) {
            self.flow = visitor(found.answer(scene));
        }
        self.flow.is_break()
    }

    #[inline(always)]
    fn move_on(&mut self, ray: &TreeRay) {
        self.reach = ray.end;
    }

    #[inline(always)]
    fn is_final(&self) -> bool {
        self.flow.is_break()
    }

    #[inline(always)]
    fn certain(&self, ray: &TreeRay) -> f32 {
        if self.anywhere { ray.certain_end() } else { f32::NEG_INFINITY }
    }

    #[inline(always)]
    fn found(&mut self) {
        self.flow = ControlFlow::Break(());
    }
}
