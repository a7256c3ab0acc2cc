//! The spheres and custom primitives of a scene.

use super::custom::Primitive;
use super::primitive_set::PrimitiveSet;
use super::shape_list::ShapeList;
use super::sphere::MovingSphere;
use crate::error::BuildError;
use crate::geometry::{Aabb, Frame, LinearBounds, LinearBox3, TimeInterval};
use crate::limits::MAX_COORDINATE;
use crate::parallel::CHUNK;
use crate::progress::Progress;
use crate::simd::prefetch;
use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering};
use glam::DVec3;
use std::sync::Arc;

/// The shapes of a scene.
pub(crate) struct Shapes {
    /// Shared by copies of a tree. They do not change: a refit puts others in their place.
    shapes: Arc<dyn ShapeList>,
    extent: ShapesExtent,
    /// The bytes of spheres' keys in leaf blocks.
    key_bytes: usize,
    /// The [`kind`] of each shape, or the one that all have, as it was when they were taken: builders ask often and rely on the
    /// answer.
    kinds: Vec<u32>,
    frame: Frame,
    /// The lowest primitive that returned invalid bounds over a part of its interval, or [`NONE`].
    bad: AtomicU32,
}

impl fmt::Debug for Shapes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shapes").field("len", &self.shapes.count()).finish_non_exhaustive()
    }
}

/// What a sphere at one key takes in a leaf block, in f32 and in f64, at most: an arena may be a thirty-second larger than its
/// blocks.
pub(crate) const SPHERE_KEY_BYTES: usize = size_of::<([f32; 4], [f64; 4])>() * 33 / 32 + 1;

/// No primitive has this id.
const NONE: u32 = u32::MAX;

/// Bounds over a part of the interval are used if they reach at most this many times as far from the origin of tree space
/// as those over the whole interval. A chord shifted to hold the keys between reaches twice as far from its begin.
const FARTHEST: f32 = 4.0;

/// Whether bounds are boxes within [`MAX_COORDINATE`]: not NaN, infinite or inverted.
fn are_boxes(bounds: LinearBounds) -> bool {
    [bounds.begin, bounds.end].into_iter().all(|b| {
        // Comparisons in this form also refuse NaN.
        b.min.cmple(b.max).all() && b.min.abs().max(b.max.abs()).cmple(DVec3::splat(MAX_COORDINATE)).all()
    })
}

/// The intervals, masks and bounds of shapes. The interval and the mask of each shape are read here, and nowhere else.
#[derive(Clone)]
pub(crate) struct ShapesExtent {
    /// Active intervals; empty if all shapes exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Visibility masks; empty if all shapes have all bits.
    masks: Vec<u32>,
    /// The box that holds all shapes at all times.
    pub swept: Aabb,
}

impl ShapesExtent {
    /// Checks that the bounds of shapes over their whole intervals are valid boxes.
    pub fn of(shapes: &dyn ShapeList, progress: &Progress) -> Result<ShapesExtent, BuildError> {
        if shapes.count() >= NONE as usize {
            return Err(BuildError::TooManyPrimitives { found: shapes.count() });
        }
        let all = || (0..shapes.count()).map(|shape| shapes.shape(shape));
        let mut active: Vec<TimeInterval> = all().map(Primitive::active).collect();
        let mut swept = Aabb::EMPTY;
        let progress = progress.in_units(shapes.count());
        for (primitive, (shape, &active)) in all().zip(&active).enumerate() {
            if primitive.is_multiple_of(CHUNK) {
                progress.check()?;
                progress.finished(CHUNK as f64);
            }
            let bounds = shape.bounds(active);
            if !are_boxes(bounds) {
                return Err(BuildError::BadBounds { primitive });
            }
            swept = swept.union(bounds.swept());
        }
        if active.iter().all(|&active| active == TimeInterval::FULL) {
            active = Vec::new();
        }
        let mut masks: Vec<u32> = all().map(Primitive::mask).collect();
        if masks.iter().all(|&mask| mask == u32::MAX) {
            masks = Vec::new();
        }
        Ok(ShapesExtent { active, masks, swept })
    }

    /// The active interval of a shape.
    pub fn active(&self, shape: usize) -> TimeInterval {
        self.active.get(shape).copied().unwrap_or(TimeInterval::FULL)
    }

    /// The visibility mask of a shape.
    pub fn mask(&self, shape: usize) -> u32 {
        self.masks.get(shape).copied().unwrap_or(u32::MAX)
    }
}

/// The kind of leaf block for a shape: a sphere of more than two keys shares one with those of as many.
fn kind(shape: &dyn Primitive) -> u32 {
    match shape.as_sphere() {
        Some(sphere) if sphere.keys.len() > 2 => sphere.keys.len() as u32,
        _ => 0,
    }
}

/// Not derived, since the shapes themselves are not copied.
impl Clone for Shapes {
    fn clone(&self) -> Shapes {
        Shapes {
            shapes: self.shapes.clone(),
            extent: self.extent.clone(),
            kinds: self.kinds.clone(),
            bad: AtomicU32::new(self.bad.load(Ordering::Relaxed)),
            ..*self
        }
    }
}

impl Shapes {
    /// Shapes that were checked, in a tree space that holds them.
    pub(crate) fn within(shapes: Arc<dyn ShapeList>, extent: ShapesExtent, frame: Frame) -> Shapes {
        let all = || (0..shapes.count()).map(|shape| shapes.shape(shape));
        let keys = all().filter_map(|shape| Some(shape.as_sphere()?.keys.len()));
        let key_bytes = keys.sum::<usize>() * SPHERE_KEY_BYTES;
        let mut kinds: Vec<u32> = all().map(kind).collect();
        if kinds.iter().all(|kind| *kind == kinds[0]) {
            kinds.truncate(1);
            kinds.shrink_to_fit();
        }
        Shapes { shapes, extent, key_bytes, kinds, frame, bad: AtomicU32::new(NONE) }
    }

    /// A shape as it was given, after [`Primitive::merge_keys`].
    #[inline]
    pub(crate) fn get(&self, shape: u32) -> &dyn Primitive {
        self.shapes.shape(shape as usize)
    }

    /// What is known of the shapes, as it was read when they were taken.
    pub(super) fn extent(&self) -> &ShapesExtent {
        &self.extent
    }

    /// Replaces the frame by one that maps points to the same coordinates.
    pub(super) fn set_frame(&mut self, frame: Frame) {
        debug_assert!(self.frame.maps_as(&frame));
        self.frame = frame;
    }

    /// All of them.
    pub(super) fn list(&self) -> &Arc<dyn ShapeList> {
        &self.shapes
    }
}

impl PrimitiveSet for Shapes {
    fn len(&self) -> usize {
        self.shapes.count()
    }

    fn active(&self, id: u32) -> TimeInterval {
        self.extent.active(id as usize)
    }

    fn always_active(&self) -> bool {
        self.extent.active.is_empty()
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        let of = |id: u32| if self.leaf_kind(id) > 2 { self.active(id) } else { TimeInterval::FULL };
        (0..self.len() as u32).map(of).collect()
    }

    /// For a primitive with contradictory bounds the bounds of all primitives: these hold its first bounds.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let outward = |b: Aabb| self.frame.outward(b);
        let everything = || outward(self.frame.bounds);
        let bounds = self.get(id).bounds(over);
        if !are_boxes(bounds) {
            self.bad.fetch_min(id, Ordering::Relaxed);
            return LinearBox3 { begin: everything(), end: everything() };
        }
        let bounds = LinearBox3 { begin: outward(bounds.begin), end: outward(bounds.end) };
        if bounds.swept().magnitude() <= FARTHEST * self.frame.reach {
            return bounds;
        }
        LinearBox3 { begin: everything(), end: everything() }
    }

    fn leaf_kind(&self, id: u32) -> u32 {
        if self.kinds_differ() { self.kinds[id as usize] } else { self.kinds[0] }
    }

    fn kinds_differ(&self) -> bool {
        self.kinds.len() > 1
    }

    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        self.get(id).as_sphere()
    }

    fn mask(&self, id: u32) -> u32 {
        self.extent.mask(id as usize)
    }

    fn masks(&self) -> Vec<u32> {
        match self.extent.masks.is_empty() {
            true => vec![u32::MAX; self.len().min(1)],
            false => self.extent.masks.clone(),
        }
    }

    fn prefetch(&self, id: u32) {
        prefetch(self.get(id));
    }

    fn prefetch_vertices(&self, id: u32, _: TimeInterval) {
        if let Some(key) = self.sphere(id).and_then(|sphere| sphere.keys.first()) {
            prefetch(key);
        }
    }

    fn further_key_bytes(&self) -> usize {
        self.key_bytes
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn input_error(&self) -> Result<(), BuildError> {
        match self.bad.load(Ordering::Relaxed) {
            NONE => Ok(()),
            primitive => Err(BuildError::BadBounds { primitive: primitive as usize }),
        }
    }

    fn bytes(&self) -> usize {
        self.shapes.bytes()
            + self.extent.active.capacity() * size_of::<TimeInterval>()
            + self.extent.masks.capacity() * size_of::<u32>()
            + self.kinds.capacity() * size_of::<u32>()
    }
}
