//! The queries of a tree as plain functions, compiled once where the tree is built.
//!
//! A query is generic over the geometry, the filter and the observer, and is compiled for each instruction set and layout.
//! If callers instantiated it, every crate that asks a tree of triangles would compile all of that again. So a tree carries the
//! addresses of its queries: those of triangles come from this crate, those of the caller's own primitives from the crate
//! that builds the tree. Filters, observers and visitors are called through `dyn`, once per accepted hit or visited block.

use super::closest_point::{
    ClosestPoint, ClosestPointQuery, ClosestPointSource, closest_point_in_kd, closest_point_in_wide,
};
use super::interleave::{Anys, Asks, Batch, Closests};
use super::intersect::RaySource;
use super::query::{AllQuery, AnyQuery, Asked, ClosestQuery, OfWide, Query};
use super::{Everything, Filter, Hit, Observer, Ray, Visible};
use crate::layout::WideTree;
use crate::mbkd::KdTree;
use crate::simd::{SimdLevel, dispatch};
use core::ops::ControlFlow;

/// The arrays that queries walk.
pub(super) enum Layout {
    Wide(WideTree),
    Kd(KdTree),
}

/// What a query is asked of.
pub(super) struct Target<'a, G> {
    pub layout: &'a Layout,
    pub geometry: &'a G,
    pub simd: SimdLevel,
}

/// The caller's function that is called with each hit.
pub(super) type Visitor<'a> = &'a mut dyn FnMut(Hit) -> ControlFlow<()>;

/// A mask and the caller's filter of what is found.
pub(super) type Seen<'a, T> = Visible<&'a dyn Fn(&T) -> bool>;

type Watch<'a> = &'a mut dyn Observer;

/// A query `Q` that looks for a `T` and gives an `R`: plain, with a filter, and with an observer.
pub(super) struct Forms<G, Q, T, R> {
    pub plain: fn(Target<'_, G>, &Q) -> R,
    pub filtered: fn(Target<'_, G>, &Q, &Seen<'_, T>) -> R,
    pub observed: fn(Target<'_, G>, &Q, Watch<'_>) -> R,
}

/// All queries of a geometry.
pub(super) struct Queries<G> {
    pub closest: Forms<G, Ray, Hit, Option<Hit>>,
    pub any: Forms<G, Ray, Hit, bool>,
    pub closest_point: Forms<G, ClosestPointQuery, ClosestPoint, Option<ClosestPoint>>,
    pub all: fn(Target<'_, G>, &Ray, Visitor<'_>) -> ControlFlow<()>,
    pub all_filtered: fn(Target<'_, G>, &Ray, &Seen<'_, Hit>, Visitor<'_>) -> ControlFlow<()>,
    pub all_observed: fn(Target<'_, G>, &Ray, Watch<'_>, Visitor<'_>) -> ControlFlow<()>,
    /// Interleaved traversal of many rays through the wide layout.
    pub interleaved_closest: fn(Target<'_, G>, &[Ray], &mut [Option<Hit>]),
    pub interleaved_any: fn(Target<'_, G>, &[Ray], &mut [bool]),
}

impl<G: RaySource + ClosestPointSource> Queries<G> {
    /// The addresses of all queries; whoever names them compiles them.
    pub(super) const TABLE: Queries<G> = Queries {
        closest: Forms {
            plain: Queries::plain_closest,
            filtered: |on, ray, seen| on.closest(ray, seen, &mut ()),
            observed: |on, ray, mut watch| on.closest(ray, &Everything, &mut watch),
        },
        any: Forms {
            plain: Queries::plain_any,
            filtered: |on, ray, seen| on.any(ray, seen, &mut ()),
            observed: |on, ray, mut watch| on.any(ray, &Everything, &mut watch),
        },
        closest_point: Forms {
            plain: |on, query| on.closest_point(query, &Everything, &mut ()),
            filtered: |on, query, seen| on.closest_point(query, seen, &mut ()),
            observed: |on, query, mut watch| on.closest_point(query, &Everything, &mut watch),
        },
        all: |on, ray, visitor| on.all(ray, &Everything, &mut (), visitor),
        all_filtered: |on, ray, seen, visitor| on.all(ray, seen, &mut (), visitor),
        all_observed: |on, ray, mut watch, visitor| on.all(ray, &Everything, &mut watch, visitor),
        interleaved_closest: |on, rays, hits| on.interleaved::<Closests>(rays, hits),
        interleaved_any: |on, rays, hits| on.interleaved::<Anys>(rays, hits),
    };

    /// The plain queries are functions of their own: the address of a closure is that of a shim which calls it.
    fn plain_closest(on: Target<'_, G>, ray: &Ray) -> Option<Hit> {
        on.closest(ray, &Everything, &mut ())
    }

    /// The same for whether there is a hit.
    fn plain_any(on: Target<'_, G>, ray: &Ray) -> bool {
        on.any(ray, &Everything, &mut ())
    }
}

impl<G> Clone for Target<'_, G> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<G> Copy for Target<'_, G> {}

impl<G: ClosestPointSource> Target<'_, G> {
    #[inline(always)]
    fn closest_point(
        self,
        query: &ClosestPointQuery,
        filter: &impl Filter<ClosestPoint>,
        observer: &mut impl Observer,
    ) -> Option<ClosestPoint> {
        match self.layout {
            Layout::Wide(tree) => closest_point_in_wide(self.simd, tree, self.geometry, query, filter, observer),
            Layout::Kd(tree) => closest_point_in_kd(tree, self.geometry, query, filter, observer),
        }
    }
}

impl<G: RaySource> Target<'_, G> {
    /// Asks the layout; the one place that knows the layouts apart.
    #[inline(always)]
    fn ask<Q: Query>(self, query: Q) -> Q::Answer {
        match self.layout {
            Layout::Wide(tree) => dispatch(self.simd, OfWide { tree, query }),
            Layout::Kd(tree) => query.ask(tree),
        }
    }

    #[inline(always)]
    fn closest(self, ray: &Ray, filter: &impl Filter, observer: &mut impl Observer) -> Option<Hit> {
        self.ask(ClosestQuery(Asked { set: self.geometry, ray, filter, observer }))
    }

    #[inline(always)]
    fn any(self, ray: &Ray, filter: &impl Filter, observer: &mut impl Observer) -> bool {
        self.ask(AnyQuery(Asked { set: self.geometry, ray, filter, observer }))
    }

    #[inline(always)]
    fn all(
        self,
        ray: &Ray,
        filter: &impl Filter,
        observer: &mut impl Observer,
        visitor: Visitor<'_>,
    ) -> ControlFlow<()> {
        self.ask(AllQuery { asked: Asked { set: self.geometry, ray, filter, observer }, visitor })
    }

    /// Nothing to do in a k-d layout, whose rays are never interleaved.
    #[inline(always)]
    fn interleaved<A: Asks>(self, rays: &[Ray], answers: &mut [A::Answer]) {
        if let Layout::Wide(tree) = self.layout {
            dispatch(self.simd, Batch::<G, A> { tree, set: self.geometry, rays, answers });
        }
    }
}
