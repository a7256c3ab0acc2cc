//! A common interface of all structures: the tree, its queries and its statistics.

use super::binary_tree::BinaryTree;
use super::bvh::{self, BvhParams};
use super::four_d::FourD;
use super::four_d_build::{self, FourDParams};
use super::library_kd::LibraryKd;
use super::time_slices::TimeSlices;
use super::wide_tree::WideTree;
use mbkd::baseline::TriangleTests;
use mbkd::{BuildError, BuildParams, FileError, Hit, KdParams, Observer, Ray, RayTree, SimdLevel, TriangleMesh};
use std::fmt;

/// A structure and its build parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Structure {
    /// Object splits, boxes interpolated.
    BvhI,
    /// Also spatial splits at mid-shutter.
    Msbvh(BvhParams),
    /// Time as a fourth axis.
    FourD(FourDParams),
    /// A number of static trees with these parameters.
    Slices(usize, BuildParams),
    /// A binary tree collapsed to the wide layout, with sixteen children per node.
    Collapsed(Collapsed),
    /// One of the library's own trees.
    Library(BuildParams),
    /// The same on the baseline instruction set of the architecture: the one that the peers are compiled for, unless
    /// compiler flags select another.
    Portable(BuildParams),
}

/// A binary tree that is collapsed to the wide layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Collapsed {
    /// BVH_i or MSBVH.
    Bvh(BvhParams),
    /// The 4D k-d tree: children have boxes and times.
    FourD(FourDParams),
    /// One of the library's k-d trees: the classic one, the paper's, or the one with moving planes.
    Kd(KdParams),
}

impl Structure {
    /// An MSBVH of at most two references per triangle.
    pub fn msbvh() -> Structure {
        Structure::Msbvh(BvhParams::MSBVH)
    }

    /// The library's default tree.
    pub fn wide() -> Structure {
        Structure::Library(BuildParams::default())
    }
}

/// A built structure.
enum Tree {
    Binary(BinaryTree, TriangleTests),
    FourD(FourD, TriangleTests),
    Wide(WideTree, TriangleTests),
    Slices(TimeSlices),
    Library(Box<RayTree>),
}

/// Why a structure could not be built.
#[derive(Debug)]
pub enum PeerError {
    /// An error in a mesh or a parameter.
    Build(BuildError),
    /// A tree of the library could not be read from its file format.
    File(FileError),
}

impl fmt::Display for PeerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PeerError::Build(error) => error.fmt(f),
            PeerError::File(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for PeerError {}

impl From<BuildError> for PeerError {
    fn from(error: BuildError) -> PeerError {
        PeerError::Build(error)
    }
}

impl From<FileError> for PeerError {
    fn from(error: FileError) -> PeerError {
        PeerError::File(error)
    }
}

/// A structure over a scene.
pub struct Peer {
    tree: Tree,
}

/// Sizes and counts of a structure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PeerStatistics {
    /// Triangles.
    pub triangles: usize,
    /// Inner nodes.
    pub nodes: usize,
    /// Leaves.
    pub leaves: usize,
    /// References in leaves.
    pub references: usize,
    /// Nodes that split time.
    pub time_nodes: usize,
    /// Share of all references that are active for part of the time only; for the library's k-d trees only.
    pub timed: f64,
    /// Bytes of nodes and references.
    pub tree_bytes: usize,
    /// Bytes of the triangles that they refer to.
    pub triangle_bytes: usize,
    /// Share of the build time spent in duplication; for the library's k-d trees only.
    pub duplication_time: f64,
    /// Share of the build time spent in propagation, likewise.
    pub propagation_time: f64,
}

impl PeerStatistics {
    /// Share of all references that are not the first of their triangle.
    pub fn duplicates(&self) -> f64 {
        self.references.saturating_sub(self.triangles) as f64 / self.references.max(1) as f64
    }

    /// All bytes.
    pub fn bytes(&self) -> usize {
        self.tree_bytes + self.triangle_bytes
    }

    fn of_library(trees: &[RayTree]) -> PeerStatistics {
        let mut sum = PeerStatistics::default();
        for tree in trees {
            let of = tree.statistics();
            sum.triangles += of.primitives;
            sum.nodes += of.nodes;
            sum.leaves += of.leaves;
            sum.references += of.references;
            sum.time_nodes += of.time_nodes;
            sum.tree_bytes += of.bytes;
            sum.triangle_bytes += of.primitive_bytes;
            (sum.timed, sum.duplication_time, sum.propagation_time) =
                (of.timed, of.duplication_time, of.propagation_time);
        }
        sum
    }
}

impl Peer {
    /// Builds a structure.
    ///
    /// # Errors
    /// An error in a mesh or a parameter, as [`RayTree::build`] reports it.
    pub fn build(structure: &Structure, meshes: &[TriangleMesh]) -> Result<Peer, PeerError> {
        let library = |params: &BuildParams| RayTree::build(meshes, params).map(Box::new);
        let tree = match structure {
            Structure::BvhI => Peer::binary(BvhParams::BVH_I, meshes)?,
            Structure::Msbvh(params) => Peer::binary(*params, meshes)?,
            Structure::FourD(params) => {
                let tests = TriangleTests::new(meshes)?;
                Tree::FourD(four_d_build::build(&tests, *params), tests)
            }
            Structure::Slices(slices, params) => Tree::Slices(TimeSlices::new(meshes, *slices, params)?),
            Structure::Collapsed(of) => Peer::collapsed(of, meshes)?,
            Structure::Library(params) => Tree::Library(library(params)?),
            Structure::Portable(params) => Tree::Library(Box::new(library(params)?.with_simd(SimdLevel::BASELINE))),
        };
        Ok(Peer { tree })
    }

    fn binary(params: BvhParams, meshes: &[TriangleMesh]) -> Result<Tree, BuildError> {
        let tests = TriangleTests::new(meshes)?;
        Ok(Tree::Binary(BinaryTree::new(&bvh::build(&tests, params)), tests))
    }

    fn collapsed(of: &Collapsed, meshes: &[TriangleMesh]) -> Result<Tree, PeerError> {
        let tests = TriangleTests::new(meshes)?;
        let binary = match of {
            Collapsed::Bvh(params) => bvh::build(&tests, *params),
            Collapsed::FourD(params) => four_d_build::build(&tests, *params).subtree(&tests),
            Collapsed::Kd(params) => {
                LibraryKd::of(&RayTree::build(meshes, &BuildParams::kd(*params))?)?.subtree(&tests)
            }
        };
        Ok(Tree::Wide(WideTree::new(&binary), tests))
    }

    /// The closest hit of a ray.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        match &self.tree {
            Tree::Binary(tree, tests) => tree.closest_hit(tests, ray, &mut ()),
            Tree::FourD(tree, tests) => tree.closest_hit(tests, ray, &mut ()),
            Tree::Wide(tree, tests) => tree.closest_hit(tests, ray, &mut ()),
            Tree::Slices(slices) => slices.closest_hit(ray),
            Tree::Library(tree) => tree.closest_hit(ray),
        }
    }

    /// [`Peer::closest_hit`] with an observer.
    pub fn closest_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        match &self.tree {
            Tree::Binary(tree, tests) => tree.closest_hit(tests, ray, observer),
            Tree::FourD(tree, tests) => tree.closest_hit(tests, ray, observer),
            Tree::Wide(tree, tests) => tree.closest_hit(tests, ray, observer),
            Tree::Slices(slices) => slices.closest_hit_observed(ray, observer),
            Tree::Library(tree) => tree.closest_hit_observed(ray, observer),
        }
    }

    /// The library's tree, if it is one.
    pub fn library(&self) -> Option<&RayTree> {
        match &self.tree {
            Tree::Library(tree) => Some(tree),
            _ => None,
        }
    }

    /// Sizes and counts of the tree.
    pub fn statistics(&self) -> PeerStatistics {
        let of = |[nodes, leaves, references]: [usize; 3], tree_bytes: usize, tests: &TriangleTests| PeerStatistics {
            triangles: tests.len(),
            nodes,
            leaves,
            references,
            tree_bytes,
            triangle_bytes: tests.bytes(),
            ..PeerStatistics::default()
        };
        match &self.tree {
            Tree::Binary(tree, tests) => of(tree.sizes(), tree.bytes(), tests),
            Tree::FourD(tree, tests) => {
                PeerStatistics { time_nodes: tree.time_nodes(), ..of(tree.sizes(), tree.bytes(), tests) }
            }
            Tree::Wide(tree, tests) => of(tree.sizes(), tree.bytes(), tests),
            Tree::Slices(slices) => PeerStatistics::of_library(slices.trees()),
            Tree::Library(tree) => PeerStatistics::of_library(std::slice::from_ref(tree)),
        }
    }
}
