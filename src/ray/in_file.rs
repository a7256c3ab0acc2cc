//! Ray trees in files.

use super::compiled::Layout;
use super::ray_tree::{Geometry, RayTree};
use crate::file::{self, Decoder, Encoder, FileError, FileKind, broken};
use crate::kd::KdTree;
use crate::layout::WideTree;
use crate::primitive::{Primitive, SceneRecord, Shapes, ShapesRecord};
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

impl<G: Geometry> RayTree<G> {
    /// The tree of a layout over its primitives, if the layout passes the checks that queries rely on.
    fn checked(geometry: G, layout: Layout) -> Result<RayTree<G>, FileError> {
        let (layout, statistics) = match layout {
            Layout::Wide(tree) => {
                let tree = tree.checked(&geometry)?;
                let statistics = tree.statistics(&geometry);
                (Layout::Wide(tree), statistics)
            }
            Layout::Kd(tree) => {
                let tree = tree.checked(geometry.len())?;
                let statistics = tree.statistics(&geometry);
                (Layout::Kd(tree), statistics)
            }
            Layout::Lazy(_) => return Err(FileError::Lazy),
        };
        Ok(RayTree::assemble(geometry, layout, statistics, true))
    }
}

impl<G: Geometry> RayTree<G> {
    /// Writes the tree: meshes, spheres and layout, about as many bytes as [`statistics`](RayTree::statistics) reports
    /// for memory. The bytes are the same on every machine and for any number of threads of the build. `docs/files.md`
    /// describes them.
    ///
    /// Of a tree of custom primitives ([`RayTree::of_primitives`]) it writes their number, bounds and times, and the layout, since
    /// only the caller knows their type: [`RayTree::read_primitives_from`] reads it.
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
    /// [`FileError::CustomShape`] if a scene has a custom primitive, [`FileError::Lazy`] for a lazy tree, and
    /// errors of the sink.
    pub fn write_to(&self, sink: &mut impl Write) -> Result<(), FileError> {
        self.encode(sink)
    }

    fn encode(&self, sink: &mut dyn Write) -> Result<(), FileError> {
        self.layout.can_be_written()?;
        file::write(sink, G::FILE, |to| {
            self.geometry.write(to)?;
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
}

impl RayTree {
    /// Reads a tree that [`RayTree::write_to`] wrote, and no byte more. The tree gives the same answers as the written
    /// one, bit for bit, on any machine. Queries run on the widest instruction set of this machine.
    ///
    /// Takes a small part of the time of the build: the bytes are read once, added to the checksum and copied to their
    /// place, and the tree is traversed once to check it.
    ///
    /// # Errors
    /// A [`FileError`] that names the fault. The checksum detects damage. A forged file is rejected if a query could fail
    /// on it; otherwise the answers are arbitrary.
    pub fn read_from(source: &mut impl Read) -> Result<RayTree, FileError> {
        Self::decode(source, None)
    }

    fn decode(source: &mut dyn Read, length: Option<u64>) -> Result<RayTree, FileError> {
        let raw = |from: &mut Decoder<'_>| Ok((SceneRecord::decode(from)?, Layout::decode(from)?));
        Decoder::begin(source, FileKind::Scene, length)?.whole(raw, |(scene, layout)| {
            let scene = match &layout {
                // Each triangle is in at least one leaf block.
                Layout::Wide(tree) => scene.checked(tree.arena.len(), true)?,
                Layout::Kd(_) | Layout::Lazy(_) => scene.checked(usize::MAX, false)?,
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
        file::load(path.as_ref(), Self::decode)
    }
}

impl<P: Primitive> RayTree<Shapes<P>> {
    /// Reads a tree of custom primitives; `primitives` have to be those that it was built of, in the same order.
    ///
    /// ```
    /// use mbkd::{BuildParams, FileError, MovingSphere, RayTree, glam::DVec3};
    /// let ball = |x: f64| MovingSphere::fixed(DVec3::X * x, 1.0);
    /// let tree = RayTree::of_primitives(vec![ball(0.0), ball(5.0)], &BuildParams::default())?;
    /// let mut bytes = Vec::new();
    /// tree.write_to(&mut bytes)?;
    /// let again = RayTree::read_primitives_from(&mut bytes.as_slice(), tree.primitives().to_vec())?;
    /// assert_eq!(again.statistics().primitives, 2);
    /// let other = RayTree::read_primitives_from(&mut bytes.as_slice(), vec![ball(0.0), ball(6.0)]);
    /// assert!(matches!(other, Err(FileError::OtherPrimitives { .. })));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::read_from`], [`FileError::Primitives`] as [`RayTree::of_primitives`], and
    /// [`FileError::OtherPrimitives`] if number, bounds or times of the primitives are not those of the file. (Other
    /// differences cannot be detected: answers are then arbitrary.)
    pub fn read_primitives_from(source: &mut impl Read, primitives: Vec<P>) -> Result<RayTree<Shapes<P>>, FileError> {
        Self::decode(source, None, primitives)
    }

    fn decode(source: &mut dyn Read, length: Option<u64>, primitives: Vec<P>) -> Result<RayTree<Shapes<P>>, FileError> {
        let raw = |from: &mut Decoder<'_>| Ok((ShapesRecord::decode(from)?, Layout::decode(from)?));
        Decoder::begin(source, FileKind::Primitives, length)?
            .whole(raw, |(shapes, layout)| RayTree::checked(shapes.checked(primitives)?, layout))
    }

    /// [`RayTree::read_primitives_from`] a file that holds nothing else. Faster, since the length of a file is known beforehand.
    ///
    /// ```
    /// use mbkd::{BuildParams, MovingSphere, RayTree, glam::DVec3};
    /// let balls = vec![MovingSphere::fixed(DVec3::ZERO, 1.0), MovingSphere::fixed(DVec3::X * 5.0, 1.0)];
    /// let path = std::env::temp_dir().join(format!("mbkd-balls-{}.tree", std::process::id()));
    /// RayTree::of_primitives(balls.clone(), &BuildParams::default())?.save(&path)?;
    /// let again = RayTree::load_primitives(&path, balls)?;
    /// assert_eq!(again.statistics().primitives, 2);
    /// std::fs::remove_file(&path)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::read_primitives_from`], with the path ([`FileError::At`]).
    pub fn load_primitives(path: impl AsRef<Path>, primitives: Vec<P>) -> Result<RayTree<Shapes<P>>, FileError> {
        file::load(path.as_ref(), |source, length| Self::decode(source, length, primitives))
    }
}
