//! Scenes of meshes, spheres and custom primitives.

use super::key_window::Intervals;
use super::mesh::triangle_mesh::TriangleMesh;
use super::primitive_set::{PrimitiveSet, include_each};
use super::shape_list::ShapeList;
use super::shapes::{Shapes, ShapesExtent};
use super::sphere::MovingSphere;
use super::triangles::triangle_set::Triangles;
use crate::error::{BuildError, RefitError};
use crate::geometry::{Box3, CornerBounds, Frame, LaneBounds, LinearBox3, TimeInterval};
use crate::progress::Progress;
use core::fmt;
use std::sync::Arc;

/// Triangle meshes and other shapes in one tree space, as a [`RayTree`](crate::RayTree) holds them.
///
/// The ids of triangles come first, so that the lowest id is the lowest (mesh, primitive).
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) triangles: Triangles,
    pub(crate) shapes: Shapes,
    /// Number of triangles: the id of the first shape.
    first: u32,
    /// Number of meshes: the mesh index of shapes.
    meshes: u32,
    always_active: bool,
}

impl fmt::Debug for Scene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (meshes, triangles, shapes) = (self.meshes, self.first, self.shapes.len());
        let mut scene = f.debug_struct("Scene");
        scene.field("meshes", &meshes).field("triangles", &triangles).field("shapes", &shapes).finish_non_exhaustive()
    }
}

/// Shapes that a refit puts in the place of others, after checking their bounds.
pub(crate) struct OtherShapes {
    shapes: Arc<dyn ShapeList>,
    extent: ShapesExtent,
}

impl OtherShapes {
    /// The active intervals of the shapes.
    pub(crate) fn active(&self) -> impl Iterator<Item = TimeInterval> {
        (0..self.shapes.count()).map(|shape| self.extent.active(shape))
    }
}

impl Scene {
    /// Checks all primitives and maps them to one tree space.
    pub(crate) fn new(meshes: &[TriangleMesh], shapes: Box<dyn ShapeList>) -> Result<Scene, BuildError> {
        Scene::read(meshes, shapes, &Progress::new(None))
    }

    /// The same as a part of a build.
    pub(crate) fn read(
        meshes: &[TriangleMesh],
        mut shapes: Box<dyn ShapeList>,
        progress: &Progress,
    ) -> Result<Scene, BuildError> {
        shapes.merge_keys();
        let all = shapes.count() + meshes.iter().map(TriangleMesh::len).sum::<usize>();
        let extent = ShapesExtent::of(&*shapes, &progress.subtask(shapes.count() as f64 / all.max(1) as f64))?;
        let triangles = Triangles::with_bounds(meshes, extent.swept, &progress.rest(1.0))?;
        Scene::of(triangles, shapes.into(), extent)
    }

    /// Other shapes for this scene, if they are valid and as many.
    pub(crate) fn other_shapes(&self, mut shapes: Box<dyn ShapeList>) -> Result<OtherShapes, RefitError> {
        shapes.merge_keys();
        let extent = ShapesExtent::of(&*shapes, &Progress::new(None))?;
        let (expected, found) = (self.shapes.len(), shapes.count());
        if found != expected {
            return Err(RefitError::Shapes { expected, found });
        }
        Ok(OtherShapes { shapes: shapes.into(), extent })
    }

    /// The same scene with other positions of the meshes and, if given, other shapes.
    pub(crate) fn again(&self, meshes: &[TriangleMesh], other: Option<OtherShapes>) -> Result<Scene, RefitError> {
        let swept = other.as_ref().map_or(self.shapes.extent().swept, |other| other.extent.swept);
        let triangles = self.triangles.with_positions(meshes, swept)?;
        let OtherShapes { shapes, extent } = other.unwrap_or_else(|| OtherShapes {
            extent: self.shapes.extent().clone(),
            shapes: self.shapes.list().clone(),
        });
        Ok(Scene::of(triangles, shapes, extent)?)
    }

    /// Moves the meshes for which `moved` is set, if that leaves tree space as it is; returns whether it does
    /// ([`Triangles::move_meshes`]).
    pub(crate) fn move_meshes(
        &mut self,
        meshes: &[TriangleMesh],
        moved: &[bool],
        beside: &[u32],
    ) -> Result<bool, RefitError> {
        let stays = self.triangles.move_meshes(meshes, moved, beside, self.shapes.extent().swept)?;
        if stays {
            self.shapes.set_frame(*self.triangles.frame());
            self.always_active = self.triangles.always_active() && self.shapes.always_active();
        }
        Ok(stays)
    }

    fn of(triangles: Triangles, shapes: Arc<dyn ShapeList>, extent: ShapesExtent) -> Result<Scene, BuildError> {
        let shapes = Shapes::within(shapes, extent, *triangles.frame());
        Scene::of_sets(triangles, shapes)
    }

    /// A scene of triangles and shapes that are in one tree space already.
    pub(super) fn of_sets(triangles: Triangles, shapes: Shapes) -> Result<Scene, BuildError> {
        let found = triangles.len() + shapes.len();
        if found >= u32::MAX as usize {
            return Err(BuildError::TooManyPrimitives { found });
        }
        let always_active = triangles.always_active() && shapes.always_active();
        let (first, meshes) = (triangles.len() as u32, triangles.meshes.len() as u32);
        Ok(Scene { triangles, shapes, first, meshes, always_active })
    }

    /// The index of the shape with this id; `None` for a triangle.
    #[inline(always)]
    pub(crate) fn shape(&self, id: u32) -> Option<u32> {
        id.checked_sub(self.first)
    }
}

impl PrimitiveSet for Scene {
    fn len(&self) -> usize {
        self.triangles.len() + self.shapes.len()
    }

    fn active(&self, id: u32) -> TimeInterval {
        match self.shape(id) {
            None => self.triangles.active(id),
            Some(shape) => self.shapes.active(shape),
        }
    }

    #[inline(always)]
    fn always_active(&self) -> bool {
        self.always_active
    }

    fn active_intervals(&self) -> Vec<TimeInterval> {
        let mut intervals = self.triangles.active_intervals();
        intervals.extend(self.shapes.active_intervals());
        intervals
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        let mut intervals = self.triangles.intervals_of_keys();
        intervals.extend(self.shapes.intervals_of_keys());
        intervals
    }

    #[inline(always)]
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        match self.shape(id) {
            None => self.triangles.bounds(id, over),
            Some(shape) => self.shapes.bounds(shape, over),
        }
    }

    fn lane_bounds(&self, ids: &[u32], over: TimeInterval, out: &mut [LaneBounds]) {
        let triangles = ids.partition_point(|&id| id < self.first);
        self.triangles.lane_bounds(&ids[..triangles], over, &mut out[..triangles]);
        for (&id, to) in ids[triangles..].iter().zip(&mut out[triangles..]) {
            *to = LaneBounds::of(&self.bounds(id, over));
        }
    }

    fn include_bounds(&self, ids: &[u32], over: &mut Intervals<'_>, out: &mut [LinearBox3]) {
        if ids.iter().all(|&id| id < self.first) {
            return self.triangles.include_bounds(ids, over, out);
        }
        include_each(self, ids, over, out);
    }

    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3 {
        match self.shape(id) {
            None => self.triangles.clipped(id, time, cell),
            Some(shape) => self.shapes.clipped(shape, time, cell),
        }
    }

    fn is_disjoint(&self, id: u32, over: TimeInterval, cell: LinearBox3) -> bool {
        match self.shape(id) {
            None => self.triangles.is_disjoint(id, over, cell),
            Some(shape) => self.shapes.is_disjoint(shape, over, cell),
        }
    }

    #[inline(always)]
    fn corner_bounds(&self, id: u32, over: TimeInterval) -> Option<CornerBounds> {
        match self.shape(id) {
            None => self.triangles.corner_bounds(id, over),
            Some(_) => None,
        }
    }

    fn prefetch(&self, id: u32) {
        match self.shape(id) {
            None => self.triangles.prefetch(id),
            Some(shape) => self.shapes.prefetch(shape),
        }
    }

    fn prefetch_vertices(&self, id: u32, over: TimeInterval) {
        match self.shape(id) {
            None => self.triangles.prefetch_vertices(id, over),
            Some(shape) => self.shapes.prefetch_vertices(shape, over),
        }
    }

    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        self.shapes.sphere(self.shape(id)?)
    }

    fn mask(&self, id: u32) -> u32 {
        match self.shape(id) {
            None => self.triangles.mask(id),
            Some(shape) => self.shapes.mask(shape),
        }
    }

    fn masks(&self) -> Vec<u32> {
        let mut masks = self.triangles.masks();
        masks.extend(self.shapes.masks());
        masks
    }

    #[inline]
    fn mesh_and_primitive(&self, id: u32) -> (u32, u32) {
        match self.shape(id) {
            None => self.triangles.mesh_and_primitive(id),
            Some(shape) => (self.meshes, shape),
        }
    }

    fn frame(&self) -> &Frame {
        self.triangles.frame()
    }

    fn leaf_kind(&self, id: u32) -> u32 {
        match self.shape(id) {
            None => self.triangles.leaf_kind(id),
            Some(shape) => self.shapes.leaf_kind(shape),
        }
    }

    fn kinds_differ(&self) -> bool {
        self.triangles.kinds_differ() || self.shapes.kinds_differ()
    }

    fn fits_block(&self, ids: &[u32]) -> bool {
        ids.iter().any(|&id| self.shape(id).is_some()) || self.triangles.fits_block(ids)
    }

    fn bent(&self) -> bool {
        self.triangles.bent()
    }

    fn further_key_bytes(&self) -> usize {
        self.triangles.further_key_bytes() + self.shapes.further_key_bytes()
    }

    fn positions(&self) -> [usize; 2] {
        self.triangles.positions()
    }

    fn input_error(&self) -> Result<(), BuildError> {
        self.shapes.input_error()
    }

    fn bytes(&self) -> usize {
        self.triangles.bytes() + self.shapes.bytes()
    }
}
