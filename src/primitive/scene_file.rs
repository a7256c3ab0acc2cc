//! Scenes in files: triangles and spheres. For custom primitives a file has only their number, bounds and
//! intervals, to verify that the same ones are passed when the file is loaded.

use super::custom::Primitive;
use super::primitive_set::PrimitiveSet;
use super::scene::{Scene, Shape};
use super::shapes::{Shapes, ShapesExtent};
use super::sphere::MovingSphere;
use super::triangles::triangles_file::TrianglesRecord;
use crate::error::BuildError;
use crate::file::{Decoder, Encoder, FileError, require};
use crate::geometry::{Frame, TimeInterval};
use crate::progress::Progress;
use glam::DVec3;

/// The contents of a file for a scene, not validated yet.
pub(crate) struct SceneRecord {
    triangles: TrianglesRecord,
    /// The number of keys, the active interval and the mask of each sphere, and the centers and radii at all keys.
    key_counts: Vec<u32>,
    active: Vec<[f32; 2]>,
    masks: Vec<u32>,
    keys: Vec<[f64; 4]>,
    frame: Frame,
}

impl Scene {
    /// Writes everything; an error if a shape is a custom primitive.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        let (mut key_counts, mut active, mut masks, mut keys) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (i, shape) in self.shapes.shapes().iter().enumerate() {
            let Shape::Sphere(sphere) = shape else { return Err(FileError::CustomShape { shape: i }) };
            key_counts.push(sphere.keys.len() as u32);
            active.push(sphere.active.to_bounds());
            masks.push(sphere.mask);
            keys.extend(sphere.keys.iter().map(|(center, radius)| [center.x, center.y, center.z, *radius]));
        }
        self.triangles.encode(to)?;
        to.array(&key_counts)?;
        to.array(&active)?;
        to.array(&masks)?;
        to.array(&keys)
    }
}

impl SceneRecord {
    /// Reads a scene that [`Scene::encode`] wrote.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<SceneRecord, FileError> {
        let triangles = TrianglesRecord::decode(from)?;
        let frame = triangles.frame;
        let (key_counts, active, masks) = (from.array()?, from.array()?, from.array()?);
        Ok(SceneRecord { triangles, frame, key_counts, active, masks, keys: from.array()? })
    }

    /// The scene, with at most `most` triangles, whose vertices are in leaf blocks or here.
    pub(crate) fn checked(self, most: usize, in_leaves: bool) -> Result<Scene, FileError> {
        let triangles = self.triangles.checked(most, in_leaves)?;
        let all: u64 = self.key_counts.iter().map(|&keys| u64::from(keys)).sum();
        let spheres = self.key_counts.len();
        require(self.active.len() == spheres && self.masks.len() == spheres, "there are too few or too many spheres")?;
        require(all == self.keys.len() as u64, "the numbers of keys of spheres are wrong")?;
        let mut keys = self.keys.iter().map(|&[x, y, z, radius]| (DVec3::new(x, y, z), radius));
        let mut shapes = Vec::with_capacity(spheres);
        for ((&count, &bounds), &mask) in self.key_counts.iter().zip(&self.active).zip(&self.masks) {
            let keys = keys.by_ref().take(count as usize).collect();
            shapes.push(Shape::Sphere(MovingSphere { keys, active: TimeInterval::of_bounds(bounds)?, mask }));
        }
        let wrong = |_: BuildError| FileError::Broken { what: "a sphere has invalid coordinates" };
        let extent = ShapesExtent::of(&shapes, &Progress::new(None)).map_err(wrong)?;
        let wrong = |_: BuildError| FileError::Broken { what: "there are too many primitives" };
        Scene::of_sets(triangles, Shapes::within(shapes.into(), extent, self.frame)).map_err(wrong)
    }
}

/// The contents of a file for custom primitives, not validated yet.
pub(crate) struct ShapesRecord {
    frame: Frame,
    len: u64,
    active: Vec<[f32; 2]>,
}

impl<P: Primitive> Shapes<P> {
    /// Writes the number, the bounds and the intervals of the primitives, but not the primitives.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.frame().encode(to)?;
        to.put(self.len() as u64)?;
        to.array(&self.active_bounds())
    }
}

impl ShapesRecord {
    /// Reads a record that [`Shapes::encode`] wrote.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<ShapesRecord, FileError> {
        Ok(ShapesRecord { frame: Frame::decode(from)?, len: from.get()?, active: from.array()? })
    }

    /// The primitives, if their number, bounds and intervals are those of the file.
    pub(crate) fn checked<P: Primitive>(self, primitives: Vec<P>) -> Result<Shapes<P>, FileError> {
        let shapes = Shapes::new(primitives).map_err(FileError::Primitives)?;
        let what = match () {
            () if shapes.len() as u64 != self.len => "their number",
            () if *shapes.frame() != self.frame => "their bounds",
            () if shapes.active_bounds() != self.active => "their active intervals",
            () => return Ok(shapes),
        };
        Err(FileError::OtherPrimitives { what })
    }
}
