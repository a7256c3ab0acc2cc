//! Errors of builds and refits, precise enough to correct the input.

use crate::limits::{MAX_COORDINATE, MAX_MESH_KEYS};
use core::fmt;

/// Why a tree could not be built. Bad input never panics; it returns this error.
///
/// ```
/// use mbkd::{BuildError, BuildParams, RayTree, TriangleMesh, glam::Vec3};
/// let triangle = vec![Vec3::ZERO, Vec3::X, Vec3::new(f32::NAN, 0.0, 0.0)];
/// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], triangle);
/// let error = RayTree::build(&[mesh], &BuildParams::default()).unwrap_err();
/// assert_eq!(error, BuildError::NonFinite { mesh: 0, key: 0, vertex: 2 });
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum BuildError {
    /// A mesh has no keys; give positions for at least one time.
    NoKeys {
        /// The mesh.
        mesh: usize,
    },
    /// A mesh has more keys than are allowed (2^24).
    TooManyKeys {
        /// The mesh.
        mesh: usize,
        /// How many there were.
        found: usize,
    },
    /// The keys of a mesh have different numbers of vertices.
    KeyLength {
        /// The mesh.
        mesh: usize,
        /// The key that differs from key 0.
        key: usize,
        /// Vertices of key 0.
        expected: usize,
        /// Vertices of this key.
        found: usize,
    },
    /// A triangle has the index of a vertex that does not exist.
    IndexOutOfRange {
        /// The mesh.
        mesh: usize,
        /// The triangle within the mesh.
        triangle: usize,
        /// The index it gives.
        index: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A vertex position is NaN or infinite.
    NonFinite {
        /// The mesh.
        mesh: usize,
        /// The key.
        key: usize,
        /// The vertex.
        vertex: usize,
    },
    /// A coordinate is farther from zero than [`crate::MAX_COORDINATE`].
    TooLarge {
        /// The mesh.
        mesh: usize,
        /// The key.
        key: usize,
        /// The vertex.
        vertex: usize,
    },
    /// A custom primitive returned bounds that are NaN, infinite, too large or inverted, over its
    /// active interval or another part of the shutter.
    BadBounds {
        /// The primitive's index.
        primitive: usize,
    },
    /// More primitives than 32-bit ids can name.
    TooManyPrimitives {
        /// How many there were.
        found: usize,
    },
    /// More vertex positions, over all keys of all meshes, than 32 bits can number.
    TooManyPositions {
        /// How many there were.
        found: usize,
    },
    /// The tree would be larger than its references can number (2 GiB of nodes and leaf blocks).
    TooLargeTree,
    /// The tree would be larger than [`crate::WideParams::bytes_per_primitive`] allows, even without any splits.
    OverBudget {
        /// Its bytes.
        bytes: usize,
        /// The budget.
        budget: usize,
    },
    /// A build parameter is outside its range.
    Parameter {
        /// The field of [`crate::WideParams`], [`crate::KdParams`] or [`crate::LazyParams`].
        name: &'static str,
        /// Its valid range.
        expected: &'static str,
    },
    /// The tree would need more nodes or references than its indices can name; lower
    /// [`crate::KdParams::max_references`] or split the scene.
    TooManyReferences,
    /// The progress callback returned `Break`.
    Cancelled,
}

impl fmt::Display for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            BuildError::NoKeys { mesh } => {
                write!(f, "mesh {mesh} has no key: give its vertex positions for at least one time")
            }
            BuildError::TooManyKeys { mesh, found } => {
                write!(f, "mesh {mesh} has {found} keys, more than the {MAX_MESH_KEYS} that are allowed")
            }
            BuildError::KeyLength { mesh, key, expected, found } => {
                write!(f, "mesh {mesh}: key {key} has {found} vertices, but key 0 has {expected}; keys must agree")
            }
            BuildError::IndexOutOfRange { mesh, triangle, index, vertices } => {
                write!(
                    f,
                    "mesh {mesh}: triangle {triangle} names vertex {index}, but there are only {vertices}, counted from 0"
                )
            }
            BuildError::NonFinite { mesh, key, vertex } => {
                write!(f, "mesh {mesh}: vertex {vertex} of key {key} is NaN or infinite")
            }
            BuildError::TooLarge { mesh, key, vertex } => {
                write!(
                    f,
                    "mesh {mesh}: vertex {vertex} of key {key} lies beyond {:e}; move or scale the scene",
                    MAX_COORDINATE as f32
                )
            }
            BuildError::BadBounds { primitive } => {
                write!(
                    f,
                    "shape or primitive {primitive}: its bounds are NaN, infinite, inverted or beyond {:e} (`check_primitive` tells over which interval)",
                    MAX_COORDINATE as f32
                )
            }
            BuildError::TooManyPrimitives { found } => {
                write!(f, "{found} primitives are more than one tree can name (2^32 - 2); split the scene")
            }
            BuildError::TooManyPositions { found } => {
                write!(f, "{found} vertex positions are more than one tree can number (2^32 - 2); split the scene")
            }
            BuildError::OverBudget { bytes, budget } => {
                write!(f, "the tree would take {bytes} bytes, but {budget} are allowed: raise bytes_per_primitive")
            }
            BuildError::TooLargeTree => {
                write!(
                    f,
                    "the tree would be larger than 2 GiB; split the scene into several trees, and place them in an `InstanceTree`"
                )
            }
            BuildError::Parameter { name, expected } => write!(f, "build parameter `{name}` must be {expected}"),
            BuildError::TooManyReferences => f.write_str(
                "the tree needs more references than it can name: lower `max_references` or split the scene",
            ),
            BuildError::Cancelled => f.write_str("the build was cancelled by its progress callback"),
        }
    }
}

impl std::error::Error for BuildError {}

/// Why a tree could not be refitted. The tree is unchanged and answers as before: build a new one. (But see [`RefitError::Input`].)
///
/// ```
/// use mbkd::{BuildParams, RayTree, RefitError, TriangleMesh, glam::Vec3};
/// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
/// let mut tree = RayTree::build(&[mesh.clone()], &BuildParams::default())?;
/// assert_eq!(tree.refit(&[]).unwrap_err(), RefitError::Count { expected: 1, found: 0 });
/// let other = TriangleMesh { indices: vec![[2, 1, 0]], ..mesh };
/// assert_eq!(tree.refit(&[other]).unwrap_err(), RefitError::Topology { mesh: 0 });
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum RefitError {
    /// A tree of a k-d policy: only boxes can be refitted, not planes.
    Policy,
    /// A lazy tree, which is built about as fast as it could be refitted.
    Lazy,
    /// A tree that was read from a file, which does not have the vertex indices of triangles, and is validated only as far
    /// as queries need.
    FromFile,
    /// Another number of meshes.
    Count {
        /// How many the tree was built of.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// A mesh has other triangles: another number, or other vertex indices.
    Topology {
        /// The mesh.
        mesh: usize,
    },
    /// A mesh needs another number of keys than leaf blocks are laid out for, after redundant keys are merged
    /// (see [`TriangleMesh`](crate::TriangleMesh)). A static mesh always fits, and so does a mesh with as many keys that are all
    /// kept ([`TriangleMesh::keep_keys`](crate::TriangleMesh::keep_keys)).
    Keys {
        /// The mesh.
        mesh: usize,
        /// The number that the tree was built for.
        expected: usize,
        /// The number that it needs.
        found: usize,
    },
    /// A mesh exists at times when it did not when the tree was built, and the tree left it out of time slices, or its keys at
    /// these times.
    Active {
        /// The mesh.
        mesh: usize,
    },
    /// The same of a sphere or custom primitive.
    ActiveShape {
        /// Its index among the shapes.
        shape: usize,
    },
    /// There is no mesh with this index.
    NoMesh {
        /// The index that was named as moved.
        mesh: usize,
        /// The number of meshes.
        meshes: usize,
    },
    /// A mesh is kept in f64 ([`TriangleMesh::precise`](crate::TriangleMesh::precise)) and was not, or the other way round.
    Precision {
        /// The mesh.
        mesh: usize,
    },
    /// Another number of spheres or custom primitives.
    Shapes {
        /// How many the tree was built of.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// The input would be invalid for a build as well.
    ///
    /// If the error is [`BuildError::BadBounds`] and only the bounds over a part of the shutter are bad, the tree has the new
    /// positions already: its other primitives answer for these, and it treats the one that is named as unbounded.
    Input(BuildError),
}

impl From<BuildError> for RefitError {
    fn from(error: BuildError) -> RefitError {
        RefitError::Input(error)
    }
}

impl fmt::Display for RefitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RefitError::Policy => f.write_str("a tree of a k-d policy cannot be refitted: build it again"),
            RefitError::Lazy => {
                f.write_str("a lazy tree cannot be refitted: build it again, which takes about as long")
            }
            RefitError::FromFile => f.write_str("a tree from a file cannot be refitted: build it of its meshes"),
            RefitError::Count { expected, found } => {
                write!(f, "the tree was built of {expected} meshes, not of {found}: build it again")
            }
            RefitError::Topology { mesh } => {
                write!(f, "mesh {mesh} has other triangles than the tree was built of: build it again")
            }
            RefitError::Keys { mesh, expected, found } => {
                write!(
                    f,
                    "mesh {mesh} needs {found} keys after merging, and the tree was built for {expected}: build it again (`TriangleMesh::keep_keys` keeps redundant keys)"
                )
            }
            RefitError::Active { mesh } => {
                write!(f, "mesh {mesh} exists at times at which it did not when the tree was built: build it again")
            }
            RefitError::ActiveShape { shape } => {
                write!(f, "shape {shape} exists at times at which it did not when the tree was built: build it again")
            }
            RefitError::NoMesh { mesh, meshes } => {
                write!(f, "mesh {mesh} is named as moved, but there are only {meshes}")
            }
            RefitError::Precision { mesh } => {
                write!(f, "mesh {mesh} is to be kept in another precision than the tree was built with: build it again")
            }
            RefitError::Shapes { expected, found } => {
                write!(f, "the tree was built of {expected} shapes, not of {found}: build it again")
            }
            RefitError::Input(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for RefitError {}

/// Why a time interval could not be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntervalError {
    /// The begin that was given.
    pub begin: f32,
    /// The end that was given.
    pub end: f32,
}

impl fmt::Display for IntervalError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "[{}, {}) is not a time interval of the shutter: 0 <= begin < end <= 1 must hold",
            self.begin, self.end
        )
    }
}

impl std::error::Error for IntervalError {}
