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
        let spheres = self.shapes.spheres()?;
        let (shapes, extent) = match given {
            Some(shapes) => self.shapes.same(&spheres, shapes)?,
            None => {
                let custom = spheres.iter().filter(|sphere| sphere.is_none()).count();
                if custom > 0 {
                    return Err(FileError::CustomShapes { custom });
                }
                let shapes: Box<dyn ShapeList> = Box::new(spheres.into_iter().flatten().collect::<Vec<_>>());
                let wrong = |_: BuildError| FileError::Broken { what: "a sphere has invalid coordinates" };
                let extent = ShapesExtent::of(&*shapes, &Progress::new(None)).map_err(wrong)?;
                (shapes, extent)
            }
        };
        let wrong = |_: BuildError| FileError::Broken { what: "there are too many primitives" };
        Scene::of_sets(triangles, Shapes::within(shapes.into(), extent, self.frame)).map_err(wrong)
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

    /// The spheres, and `None` for each custom primitive.
    fn spheres(&self) -> Result<Vec<Option<MovingSphere>>, FileError> {
        let shapes = self.key_counts.len();
        require(self.active.len() == shapes && self.masks.len() == shapes, "there are too few or too many shapes")?;
        let counts = self.key_counts.iter().filter(|&&count| count != CUSTOM);
        let all: u64 = counts.map(|&keys| u64::from(keys)).sum();
        require(all == self.keys.len() as u64, "the numbers of keys of spheres are wrong")?;
        let mut keys = self.keys.iter().map(|&[x, y, z, radius]| (DVec3::new(x, y, z), radius));
        let mut spheres = Vec::with_capacity(shapes);
        for ((&count, &bounds), &mask) in self.key_counts.iter().zip(&self.active).zip(&self.masks) {
            let active = TimeInterval::of_bounds(bounds)?;
            let mut sphere = || MovingSphere { keys: keys.by_ref().take(count as usize).collect(), active, mask };
            spheres.push((count != CUSTOM).then(&mut sphere));
        }
        Ok(spheres)
    }

    /// The shapes with their extent if, as far as can be told, the record is of them: `spheres` are those of the record.
    fn same(
        &self,
        spheres: &[Option<MovingSphere>],
        mut shapes: Box<dyn ShapeList>,
    ) -> Result<(Box<dyn ShapeList>, ShapesExtent), FileError> {
        shapes.merge_keys();
        let extent = ShapesExtent::of(&*shapes, &Progress::new(None)).map_err(FileError::Shapes)?;
        let all = 0..spheres.len();
        let what = match () {
            () if shapes.count() != spheres.len() => "their numbers",
            () if all.clone().any(|i| shapes.plain_sphere(i) != spheres[i].as_ref()) => "the spheres among them",
            () if all.clone().any(|i| extent.active(i).to_bounds() != self.active[i]) => "their active intervals",
            () if all.clone().any(|i| extent.mask(i) != self.masks[i]) => "their masks",
            () if extent.swept != self.swept => "their bounds",
            () => return Ok((shapes, extent)),
        };
        Err(FileError::OtherShapes { what })
    }
}
