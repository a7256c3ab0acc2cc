//! Trees of custom primitives of any type, compiled once in this crate.
//!
//! Builders and queries are generic over the geometry, and are compiled for each instruction set. If they were compiled
//! for the caller's types, every program with a custom primitive would compile all of them again. So they are compiled
//! for [`ErasedShapes`], which calls the caller's code through `dyn`: for each primitive that a ray reaches, for the closest
//! points of each leaf, for each bound that a build needs. Boxes, nodes and the order of visits are the crate's own.

use super::closest_point::closest_search::ClosestPointSource;
use super::closest_point::point_query::{Candidate, QueryInTree};
use super::compiled::{Compiled, Layout, Queries, Target, lay_out};
use super::hit::SetHit;
use super::kernel::shear::Sheared;
use super::kernel::tree_ray::TreeRay;
use super::traversal::intersect::RaySource;
use crate::error::BuildError;
use crate::file::{Encoder, FileError, FileKind};
use crate::geometry::{Frame, LinearBox3, TimeInterval};
use crate::layout::{Statistics, WideSource};
use crate::params::BuildParams;
use crate::primitive::{MovingSphere, Primitive, PrimitiveSet, Shapes};
use crate::progress::Progress;

/// [`Shapes`] of any type.
trait AnyShapes: PrimitiveSet {
    fn intersect(&self, id: u32, ray: &TreeRay, sheared: &Sheared) -> Option<SetHit>;
    fn first_within(&self, ids: &[u32], query: &QueryInTree, limit: f32) -> Option<(usize, Candidate)>;
}

impl<P: Primitive> AnyShapes for Shapes<P> {
    fn intersect(&self, id: u32, ray: &TreeRay, sheared: &Sheared) -> Option<SetHit> {
        RaySource::intersect(self, id, ray, sheared)
    }
    fn first_within(&self, ids: &[u32], query: &QueryInTree, limit: f32) -> Option<(usize, Candidate)> {
        ClosestPointSource::first_within(self, ids, query, limit)
    }
}

/// Custom primitives with their type erased.
pub(super) struct ErasedShapes<'a> {
    shapes: &'a dyn AnyShapes,
    // Copied here so that reading it needs no dynamic call.
    frame: &'a Frame,
    always_active: bool,
    kinds_differ: bool,
}

impl ErasedShapes<'_> {
    fn of<P: Primitive>(shapes: &Shapes<P>) -> ErasedShapes<'_> {
        let (always_active, kinds_differ) = (shapes.always_active(), shapes.kinds_differ());
        ErasedShapes { frame: shapes.frame(), always_active, kinds_differ, shapes }
    }
}

impl PrimitiveSet for ErasedShapes<'_> {
    fn len(&self) -> usize {
        self.shapes.len()
    }

    fn active(&self, id: u32) -> TimeInterval {
        self.shapes.active(id)
    }

    #[inline(always)]
    fn always_active(&self) -> bool {
        self.always_active
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        self.shapes.intervals_of_keys()
    }

    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        self.shapes.bounds(id, over)
    }

    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        self.shapes.sphere(id)
    }

    fn mask(&self, id: u32) -> u32 {
        self.shapes.mask(id)
    }

    fn masks(&self) -> Vec<u32> {
        self.shapes.masks()
    }

    fn leaf_kind(&self, id: u32) -> u32 {
        self.shapes.leaf_kind(id)
    }

    fn kinds_differ(&self) -> bool {
        self.kinds_differ
    }

    fn prefetch(&self, id: u32) {
        self.shapes.prefetch(id);
    }

    fn prefetch_vertices(&self, id: u32, over: TimeInterval) {
        self.shapes.prefetch_vertices(id, over);
    }

    fn further_key_bytes(&self) -> usize {
        self.shapes.further_key_bytes()
    }

    fn frame(&self) -> &Frame {
        self.frame
    }

    fn input_error(&self) -> Result<(), BuildError> {
        self.shapes.input_error()
    }

    fn bytes(&self) -> usize {
        self.shapes.bytes()
    }
}

impl WideSource for ErasedShapes<'_> {}

impl RaySource for ErasedShapes<'_> {
    #[inline(always)]
    fn intersect(&self, id: u32, ray: &TreeRay, sheared: &Sheared) -> Option<SetHit> {
        self.shapes.intersect(id, ray, sheared)
    }
}

impl ClosestPointSource for ErasedShapes<'_> {
    fn closest_point(&self, id: u32, query: &QueryInTree) -> Option<Candidate> {
        self.first_within(&[id], query, f32::INFINITY).map(|(_, candidate)| candidate)
    }

    #[inline(always)]
    fn first_within(&self, ids: &[u32], query: &QueryInTree, limit: f32) -> Option<(usize, Candidate)> {
        self.shapes.first_within(ids, query, limit)
    }
}

/// The queries, at addresses in this crate: a caller that inlined this would compile them all.
#[inline(never)]
fn queries<'a>() -> &'a Queries<ErasedShapes<'a>> {
    &Queries::TABLE
}

/// The build, likewise.
#[inline(never)]
fn lay_out_erased(
    mut erased: ErasedShapes<'_>,
    params: &BuildParams,
    progress: &Progress,
) -> Result<(Layout, Statistics), BuildError> {
    lay_out(&mut erased, params, progress)
}

impl<P: Primitive> Compiled for Shapes<P> {
    const QUERIES: Queries<Shapes<P>> = Queries {
        closest: |on, ray| on.erased(|of, on| (of.closest)(on, ray)),
        closest_guarded: |on, ray, guards| on.erased(|of, on| (of.closest_guarded)(on, ray, guards)),
        any: |on, ray| on.erased(|of, on| (of.any)(on, ray)),
        any_guarded: |on, ray, guards| on.erased(|of, on| (of.any_guarded)(on, ray, guards)),
        closest_point: |on, query| on.erased(|of, on| (of.closest_point)(on, query)),
        closest_point_guarded: |on, query, guards| on.erased(|of, on| (of.closest_point_guarded)(on, query, guards)),
        all: |on, ray, visitor| on.erased(|of, on| (of.all)(on, ray, visitor)),
        all_guarded: |on, ray, guards, visitor| on.erased(|of, on| (of.all_guarded)(on, ray, guards, visitor)),
        singly_closest: |on, task| on.erased(|of, on| (of.singly_closest)(on, task)),
        interleaved_closest: |on, task| on.erased(|of, on| (of.interleaved_closest)(on, task)),
        streams_closest: |on, task| on.erased(|of, on| (of.streams_closest)(on, task)),
        streams_any: |on, task| on.erased(|of, on| (of.streams_any)(on, task)),
    };

    fn lay_out(&mut self, params: &BuildParams, progress: &Progress) -> Result<(Layout, Statistics), BuildError> {
        lay_out_erased(ErasedShapes::of(self), params, progress)
    }

    const FILE: FileKind = FileKind::Primitives;

    fn write(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.encode(to)
    }
}

impl<P: Primitive> Target<'_, Shapes<P>> {
    /// Asks a query of the same layout, with the type of its primitives erased.
    #[inline(always)]
    fn erased<R>(self, ask: impl for<'a> FnOnce(&Queries<ErasedShapes<'a>>, Target<'a, ErasedShapes<'a>>) -> R) -> R {
        let geometry = &ErasedShapes::of(self.geometry);
        ask(queries(), Target { layout: self.layout, geometry, outline: self.outline, simd: self.simd })
    }
}
