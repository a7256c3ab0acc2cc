//! A list of custom primitives and spheres, as a tree holds them.

use super::custom::Primitive;
use super::primitive_set::PrimitiveSet;
use super::sphere::MovingSphere;
use crate::error::BuildError;
use crate::geometry::{Aabb, Frame, LinearBounds, LinearBox3, TimeInterval};
use crate::limits::MAX_COORDINATE;
use crate::parallel::{self, CHUNK};
use crate::progress::Progress;
use crate::simd::prefetch;
use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering};
use glam::DVec3;
use std::sync::Arc;

/// Custom primitives, as a [`RayTree`](crate::RayTree) holds them.
pub struct Shapes<P> {
    /// Shared by copies of a tree. They do not change: a refit puts others in their place.
    shapes: Arc<Vec<P>>,
    /// Active intervals; empty if all shapes exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Visibility masks; empty if all shapes have all bits.
    masks: Vec<u32>,
    /// The bytes of spheres' keys in leaf blocks.
    key_bytes: usize,
    /// The [`kind`] of each shape, or the one that all have, as it was when they were taken: builders ask often and rely on the
    /// answer.
    kinds: Vec<u32>,
    frame: Frame,
    /// The box that holds all shapes at all times.
    swept: Aabb,
    /// The lowest primitive that returned invalid bounds over a part of its interval, or [`NONE`].
    bad: AtomicU32,
}

impl<P> fmt::Debug for Shapes<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shapes").field("len", &self.shapes.len()).finish_non_exhaustive()
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
    pub fn of<P: Primitive>(shapes: &[P], progress: &Progress) -> Result<ShapesExtent, BuildError> {
        if shapes.len() >= NONE as usize {
            return Err(BuildError::TooManyPrimitives { found: shapes.len() });
        }
        let mut active: Vec<TimeInterval> = shapes.iter().map(Primitive::active).collect();
        let mut swept = Aabb::EMPTY;
        let progress = progress.in_units(shapes.len());
        for (primitive, (shape, &active)) in shapes.iter().zip(&active).enumerate() {
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
        let mut masks: Vec<u32> = shapes.iter().map(Primitive::mask).collect();
        if masks.iter().all(|&mask| mask == u32::MAX) {
            masks = Vec::new();
        }
        Ok(ShapesExtent { active, masks, swept })
    }

    /// The active interval of a shape.
    pub fn active(&self, shape: usize) -> TimeInterval {
        self.active.get(shape).copied().unwrap_or(TimeInterval::FULL)
    }
}

/// The kind of leaf block for a shape: a sphere of more than two keys shares one with those of as many.
fn kind(shape: &impl Primitive) -> u32 {
    match shape.as_sphere() {
        Some(sphere) if sphere.keys.len() > 2 => sphere.keys.len() as u32,
        _ => 0,
    }
}

/// The same shapes without the keys that they do not need.
pub(super) fn with_merged_keys<P: Primitive>(mut shapes: Vec<P>) -> Vec<P> {
    let mut parts: Vec<_> = shapes.chunks_mut(CHUNK).collect();
    parallel::each(&mut parts, |part| part.iter_mut().for_each(P::merge_keys));
    shapes
}

/// Not derived, since the shapes themselves are not copied.
impl<P> Clone for Shapes<P> {
    fn clone(&self) -> Shapes<P> {
        Shapes {
            shapes: self.shapes.clone(),
            active: self.active.clone(),
            masks: self.masks.clone(),
            kinds: self.kinds.clone(),
            bad: AtomicU32::new(self.bad.load(Ordering::Relaxed)),
            ..*self
        }
    }
}

impl<P: Primitive> Shapes<P> {
    /// A set of shapes, after checking their bounds over their whole intervals.
    pub(crate) fn new(shapes: Vec<P>) -> Result<Shapes<P>, BuildError> {
        Shapes::read(shapes, &Progress::new(None))
    }

    /// The same as a part of a build.
    pub(crate) fn read(shapes: Vec<P>, progress: &Progress) -> Result<Shapes<P>, BuildError> {
        let shapes = with_merged_keys(shapes);
        let extent = ShapesExtent::of(&shapes, progress)?;
        let frame = Frame::around(extent.swept);
        Ok(Shapes::within(shapes.into(), extent, frame))
    }

    /// Shapes that were checked, in a tree space that holds them.
    pub(crate) fn within(shapes: Arc<Vec<P>>, extent: ShapesExtent, frame: Frame) -> Shapes<P> {
        let keys = shapes.iter().filter_map(|shape| Some(shape.as_sphere()?.keys.len()));
        let key_bytes = keys.sum::<usize>() * SPHERE_KEY_BYTES;
        let mut kinds: Vec<u32> = shapes.iter().map(kind).collect();
        if kinds.iter().all(|kind| *kind == kinds[0]) {
            kinds.truncate(1);
            kinds.shrink_to_fit();
        }
        let ShapesExtent { active, masks, swept } = extent;
        Shapes { shapes, active, masks, key_bytes, kinds, frame, swept, bad: AtomicU32::new(NONE) }
    }

    /// Active intervals as bounds; empty if all shapes exist throughout the shutter.
    pub(crate) fn active_bounds(&self) -> Vec<[f32; 2]> {
        self.active.iter().map(|active| active.to_bounds()).collect()
    }

    /// The shapes as they were given, after [`Primitive::merge_keys`].
    pub(crate) fn shapes(&self) -> &[P] {
        &self.shapes
    }

    /// The box that holds all shapes at all times, in world space.
    pub(super) fn swept(&self) -> Aabb {
        self.swept
    }

    /// What is known of the shapes, as it was read when they were taken.
    pub(super) fn extent(&self) -> ShapesExtent {
        ShapesExtent { active: self.active.clone(), masks: self.masks.clone(), swept: self.swept }
    }

    /// Replaces the frame by one that maps points to the same coordinates.
    pub(super) fn set_frame(&mut self, frame: Frame) {
        debug_assert!(self.frame.maps_as(&frame));
        self.frame = frame;
    }

    /// The shapes, for a set that replaces this one.
    pub(super) fn shared(&self) -> Arc<Vec<P>> {
        self.shapes.clone()
    }
}

impl<P: Primitive> PrimitiveSet for Shapes<P> {
    fn len(&self) -> usize {
        self.shapes.len()
    }

    fn active(&self, id: u32) -> TimeInterval {
        if self.always_active() { TimeInterval::FULL } else { self.active[id as usize] }
    }

    fn always_active(&self) -> bool {
        self.active.is_empty()
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        let of = |id: u32| if self.leaf_kind(id) > 2 { self.active(id) } else { TimeInterval::FULL };
        (0..self.shapes.len() as u32).map(of).collect()
    }

    /// For a primitive with contradictory bounds the bounds of all primitives: these hold its first bounds.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let outward = |b: Aabb| self.frame.outward(b);
        let everything = || outward(self.frame.bounds);
        let bounds = self.shapes[id as usize].bounds(over);
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
        self.shapes[id as usize].as_sphere()
    }

    fn mask(&self, id: u32) -> u32 {
        if self.masks.is_empty() { u32::MAX } else { self.masks[id as usize] }
    }

    fn masks(&self) -> Vec<u32> {
        match self.masks.is_empty() {
            true => vec![u32::MAX; self.len().min(1)],
            false => self.masks.clone(),
        }
    }

    fn prefetch(&self, id: u32) {
        prefetch(&self.shapes[id as usize]);
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
        self.shapes.capacity() * size_of::<P>()
            + self.active.capacity() * size_of::<TimeInterval>()
            + self.masks.capacity() * size_of::<u32>()
            + self.kinds.capacity() * size_of::<u32>()
    }
}
