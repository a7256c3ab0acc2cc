//! Scenes in files: triangles and spheres. Of custom primitives, whose type only the caller knows, a file has what tells whether
//! the same ones are given when it is loaded: their number, masks, active intervals and common bounds.

use super::primitive_set::PrimitiveSet;
use super::scene::Scene;
use super::shape_list::ShapeList;
use super::shapes::{Shapes, ShapesExtent};
use super::sphere::MovingSphere;
use super::triangles::triangles_file::TrianglesRecord;
use crate::error::BuildError;
use crate::file::{Decoder, Encoder, FileError, require};
use crate::geometry::{Aabb, Frame, TimeInterval};
use crate::progress::Progress;
use glam::DVec3;
use std::sync::Arc;

/// In the place of the number of keys, for a shape that is no sphere.
const CUSTOM: u32 = u32::MAX;

/// The contents of a file for a scene, not validated yet.
pub(crate) struct SceneRecord {
    triangles: TrianglesRecord,
    shapes: ShapesRecord,
    frame: Frame,
}

/// The contents of a file for the shapes of a scene.
struct ShapesRecord {
    /// The box that holds all shapes at all times.
    swept: Aabb,
    /// The number of keys of each sphere, or [`CUSTOM`], and the active interval and the mask of each shape.
    key_counts: Vec<u32>,
    active: Vec<[f32; 2]>,
    masks: Vec<u32>,
    /// The centers and radii of spheres at all keys.
    keys: Vec<[f64; 4]>,
}

impl Scene {
    /// Writes everything but custom primitives.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.triangles.encode(to)?;
        let ShapesRecord { swept, key_counts, active, masks, keys } = ShapesRecord::of(&self.shapes);
        to.put([swept.min, swept.max].map(|corner| corner.to_array()))?;
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
        let [min, max] = from.get::<[[f64; 3]; 2]>()?.map(DVec3::from_array);
        let (key_counts, active, masks) = (from.array()?, from.array()?, from.array()?);
        let shapes = ShapesRecord { swept: Aabb { min, max }, key_counts, active, masks, keys: from.array()? };
        Ok(SceneRecord { triangles, shapes, frame })
    }

    /// The scene, with at most `most` triangles, whose vertices are in leaf blocks or here. Its shapes are those `given`, if they
    /// are the same, or, without any, the spheres of the file.
    pub(crate) fn checked(
        self,
        (most, in_leaves): (usize, bool),
        given: Option<Box<dyn ShapeList>>,
    ) -> Result<Scene, FileError> {
        let triangles = self.triangles.checked(most, in_leaves)?;
        let shapes = match given {
            Some(shapes) => self.shapes.same(shapes, self.frame)?,
            None => self.shapes.spheres(self.frame)?,
        };
        let wrong = |_: BuildError| FileError::Broken { what: "there are too many primitives" };
        Scene::of_sets(triangles, shapes).map_err(wrong)
    }
}

impl ShapesRecord {
    fn of(set: &Shapes) -> ShapesRecord {
        let mut record = ShapesRecord {
            swept: set.extent().swept,
            key_counts: Vec::with_capacity(set.len()),
            active: Vec::with_capacity(set.len()),
            masks: Vec::with_capacity(set.len()),
            keys: Vec::new(),
        };
        for id in 0..set.len() as u32 {
            record.active.push(set.active(id).to_bounds());
            record.masks.push(set.mask(id));
            match set.list().plain_sphere(id as usize) {
                Some(sphere) => {
                    record.key_counts.push(sphere.keys.len() as u32);
                    record
                        .keys
                        .extend(sphere.keys.iter().map(|(center, radius)| [center.x, center.y, center.z, *radius]));
                }
                None => record.key_counts.push(CUSTOM),
            }
        }
        record
    }

    /// The spheres; an error if there are other shapes.
    fn spheres(&self, frame: Frame) -> Result<Shapes, FileError> {
        let custom = self.key_counts.iter().filter(|&&count| count == CUSTOM).count();
        if custom > 0 {
            return Err(FileError::CustomShapes { custom });
        }
        let spheres = self.key_counts.len();
        let all: u64 = self.key_counts.iter().map(|&keys| u64::from(keys)).sum();
        require(self.active.len() == spheres && self.masks.len() == spheres, "there are too few or too many spheres")?;
        require(all == self.keys.len() as u64, "the numbers of keys of spheres are wrong")?;
        let mut keys = self.keys.iter().map(|&[x, y, z, radius]| (DVec3::new(x, y, z), radius));
        let mut shapes = Vec::with_capacity(spheres);
        for ((&count, &bounds), &mask) in self.key_counts.iter().zip(&self.active).zip(&self.masks) {
            let keys = keys.by_ref().take(count as usize).collect();
            shapes.push(MovingSphere { keys, active: TimeInterval::of_bounds(bounds)?, mask });
        }
        let wrong = |_: BuildError| FileError::Broken { what: "a sphere has invalid coordinates" };
        let extent = ShapesExtent::of(&shapes, &Progress::new(None)).map_err(wrong)?;
        Ok(Shapes::within(Arc::new(shapes), extent, frame))
    }

    /// The given shapes if, as far as can be told, they are those of the record.
    fn same(&self, mut given: Box<dyn ShapeList>, frame: Frame) -> Result<Shapes, FileError> {
        given.merge_keys();
        let extent = ShapesExtent::of(&*given, &Progress::new(None)).map_err(FileError::Shapes)?;
        let given = Shapes::within(given.into(), extent, frame);
        let of = ShapesRecord::of(&given);
        // By their bits: a list is the same as itself, whatever numbers are in it.
        let bits = |record: &ShapesRecord| record.keys.iter().map(|key| key.map(f64::to_bits)).collect::<Vec<_>>();
        let what = match () {
            () if of.key_counts.len() != self.key_counts.len() => "their numbers",
            () if of.key_counts != self.key_counts || bits(&of) != bits(self) => "the spheres among them",
            () if of.active != self.active => "their active intervals",
            () if of.masks != self.masks => "their masks",
            () if of.swept != self.swept => "their bounds",
            () => return Ok(given),
        };
        Err(FileError::OtherShapes { what })
    }
}
