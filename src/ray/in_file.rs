//! Ray trees in files.

use super::layout::Layout;
use super::ray_tree::RayTree;
use crate::file::{self, Decoder, Encoder, FileError, FileKind, broken};
use crate::kd::KdTree;
use crate::layout::WideTree;
use crate::primitive::{Primitive, PrimitiveSet, Scene, SceneRecord, ShapeList};
use std::io::{Read, Write};
use std::path::Path;

/// The numbers of the layouts in files.
const WIDE: u32 = 0;
const KD: u32 = 1;

impl Layout {
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        match self {
            Layout::Wide(tree) => {
                to.put(WIDE)?;
                tree.encode(to)
            }
            Layout::Kd(tree) => {
                to.put(KD)?;
                tree.encode(to)
            }
            Layout::Lazy(_) => Err(FileError::Lazy),
        }
    }

    /// Returns an error if the layout cannot be written, before any byte is written.
    fn can_be_written(&self) -> Result<(), FileError> {
        if let Layout::Lazy(_) = self { Err(FileError::Lazy) } else { Ok(()) }
    }

    /// Reads a written layout; nothing of it is checked but the layout's number.
    fn decode(from: &mut Decoder<'_>) -> Result<Layout, FileError> {
        match from.get::<u32>()? {
            WIDE => Ok(Layout::Wide(WideTree::decode(from)?)),
            KD => Ok(Layout::Kd(KdTree::decode(from)?)),
            _ => broken("it has no layout that is known"),
        }
    }
}

impl RayTree {
    /// The tree of a layout over its primitives, if the layout passes the checks that queries rely on.
    fn checked(scene: Scene, layout: Layout) -> Result<RayTree, FileError> {
        let (layout, statistics) = match layout {
            Layout::Wide(tree) => {
                let tree = tree.checked(&scene)?;
                let statistics = tree.statistics(&scene);
                (Layout::Wide(tree), statistics)
            }
            Layout::Kd(tree) => {
                let tree = tree.checked(scene.len())?;
                let statistics = tree.statistics(&scene);
                (Layout::Kd(tree), statistics)
            }
            Layout::Lazy(_) => return Err(FileError::Lazy),
        };
        Ok(RayTree::assemble(scene, layout, statistics, true))
    }

    /// Writes the tree: meshes, spheres and layout, about as many bytes as [`statistics`](RayTree::statistics) reports
    /// for memory. The bytes are the same on every machine and for any number of threads of the build. `docs/files.md`
    /// describes them.
    ///
    /// Of custom primitives, whose type only the caller knows, it writes their number, masks, active intervals and common bounds:
    /// [`RayTree::read_with_shapes_from`] reads a tree that has some.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let mut bytes = Vec::new();
    /// tree.write_to(&mut bytes)?;
    /// let again = RayTree::read_from(&mut bytes.as_slice())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z);
    /// assert_eq!(again.closest_hit(&ray), tree.closest_hit(&ray));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`FileError::Lazy`] for a lazy tree, and errors of the sink.
    pub fn write_to(&self, sink: &mut impl Write) -> Result<(), FileError> {
        self.encode(sink)
    }

    fn encode(&self, sink: &mut dyn Write) -> Result<(), FileError> {
        self.layout.can_be_written()?;
        file::write(sink, FileKind::Rays, |to| {
            self.scene.encode(to)?;
            self.layout.encode(to)
        })
    }

    /// [`RayTree::write_to`] a file, which appears under this name only once it is complete: it is written next to it and then
    /// renamed. A symbolic link is followed; a pipe or device is written to directly.
    ///
    /// # Errors
    /// As [`RayTree::write_to`], with the path ([`FileError::At`]).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FileError> {
        file::save(path.as_ref(), |sink| self.encode(sink))
    }

    /// Reads a tree that [`RayTree::write_to`] wrote, and no byte more. The tree gives the same answers as the written
    /// one, bit for bit, on any machine. Queries run on the widest instruction set of this machine.
    ///
    /// Takes a small part of the time of the build: the bytes are read once, added to the checksum and copied to their
    /// place, and the tree is traversed once to check it.
    ///
    /// # Errors
    /// A [`FileError`] that names the fault; [`FileError::CustomShapes`] for a tree with custom primitives. The checksum detects
    /// damage. A forged file is rejected if a query could fail on it; otherwise the answers are arbitrary.
    pub fn read_from(source: &mut impl Read) -> Result<RayTree, FileError> {
        Self::decode(source, None, None)
    }

    fn decode(
        source: &mut dyn Read,
        length: Option<u64>,
        shapes: Option<Box<dyn ShapeList>>,
    ) -> Result<RayTree, FileError> {
        let raw = |from: &mut Decoder<'_>| Ok((SceneRecord::decode(from)?, Layout::decode(from)?));
        Decoder::begin(source, FileKind::Rays, length)?.whole(raw, |(scene, layout)| {
            let scene = match &layout {
                // Each triangle is in at least one leaf block.
                Layout::Wide(tree) => scene.checked((tree.arena.len(), true), shapes)?,
                Layout::Kd(_) | Layout::Lazy(_) => scene.checked((usize::MAX, false), shapes)?,
            };
            RayTree::checked(scene, layout)
        })
    }

    /// [`RayTree::read_from`] a file that holds nothing else. Faster, since the length of a file is known beforehand.
    ///
    /// ```no_run
    /// use mbkd::RayTree;
    /// let tree = RayTree::load("hall.mbkd")?;
    /// println!("{} triangles", tree.statistics().primitives);
    /// # Ok::<(), mbkd::FileError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::read_from`], with the path ([`FileError::At`]).
    pub fn load(path: impl AsRef<Path>) -> Result<RayTree, FileError> {
        file::load(path.as_ref(), |source, length| Self::decode(source, length, None))
    }

    /// [`RayTree::read_from`] for a tree with custom primitives. `shapes` have to be those that the tree was built of
    /// ([`RayTree::of_scene`]) or refitted to, spheres included, in the same order.
    ///
    /// ```
    /// use mbkd::{BuildParams, FileError, MovingSphere, RayTree, Shape, glam::DVec3};
    /// // They stand for primitives of a type of yours.
    /// let shapes = |x: f64| Vec::from([0.0, x].map(|x| Shape::custom(MovingSphere::fixed(DVec3::X * x, 1.0))));
    /// let tree = RayTree::of_scene(&[], shapes(5.0), &BuildParams::default())?;
    /// let mut bytes = Vec::new();
    /// tree.write_to(&mut bytes)?;
    /// let again = RayTree::read_with_shapes_from(&mut bytes.as_slice(), shapes(5.0))?;
    /// assert_eq!(again.statistics().primitives, 2);
    /// let other = RayTree::read_with_shapes_from(&mut bytes.as_slice(), shapes(6.0));
    /// assert!(matches!(other, Err(FileError::OtherShapes { .. })));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::read_from`], [`FileError::Shapes`] as [`RayTree::of_scene`], and [`FileError::OtherShapes`] if the spheres, or
    /// the number, masks, active intervals or common bounds of the shapes are not those of the file. (Other differences between
    /// custom primitives cannot be detected: answers are then arbitrary.)
    pub fn read_with_shapes_from<P: Primitive + 'static>(
        source: &mut impl Read,
        shapes: Vec<P>,
    ) -> Result<RayTree, FileError> {
        Self::decode(source, None, Some(Box::new(shapes)))
    }

    /// [`RayTree::read_with_shapes_from`] a file that holds nothing else. Faster, since the length of a file is known beforehand.
    ///
    /// ```
    /// use mbkd::{BuildParams, MovingSphere, RayTree, Shape, glam::DVec3};
    /// let shapes = || Vec::from([0.0, 5.0].map(|x| Shape::custom(MovingSphere::fixed(DVec3::X * x, 1.0))));
    /// let path = std::env::temp_dir().join(format!("mbkd-shapes-{}.tree", std::process::id()));
    /// RayTree::of_scene(&[], shapes(), &BuildParams::default())?.save(&path)?;
    /// let again = RayTree::load_with_shapes(&path, shapes())?;
    /// assert_eq!(again.statistics().primitives, 2);
    /// std::fs::remove_file(&path)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::read_with_shapes_from`], with the path ([`FileError::At`]).
    pub fn load_with_shapes<P: Primitive + 'static>(
        path: impl AsRef<Path>,
        shapes: Vec<P>,
    ) -> Result<RayTree, FileError> {
        file::load(path.as_ref(), |source, length| Self::decode(source, length, Some(Box::new(shapes))))
    }
}
