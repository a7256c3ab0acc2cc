//! Ray tracing and nearest-neighbour search over moving geometry, each query at its own time.
//!
//! ```
//! use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
//! let open = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
//! let close = open.iter().map(|p| p + Vec3::Z).collect();
//! let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
//! let ray = Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z);
//! assert_eq!(tree.closest_hit(&ray.at_time(0.0)).unwrap().t, 5.0);
//! assert_eq!(tree.closest_hit(&ray.at_time(1.0)).unwrap().t, 4.0);
//! # Ok::<(), mbkd::BuildError>(())
//! ```
//!
//! ```
//! use mbkd::{MovingPoint, PointParams, PointTree, glam::Vec3};
//! let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * 9.0, Vec3::X)];
//! let tree = PointTree::build(&points, &PointParams::default())?;
//! assert_eq!(tree.nearest(Vec3::X * 2.0, 0.0).unwrap().id, 0);
//! assert_eq!(tree.nearest(Vec3::X * 2.0, 1.0).unwrap().id, 1);
//! # Ok::<(), mbkd::PointError>(())
//! ```
//!
//! | for | begin with |
//! |---|---|
//! | rays against moving triangles, spheres and custom primitives | [`RayTree::build`], [`RayTree::of_scene`] |
//! | the surface nearest to a point | [`RayTree::closest_point`] |
//! | one tree placed many times, each place moving | [`InstanceTree::build`] |
//! | the next frame, the next step | [`RayTree::refit`], [`PointTree::rebuild`] |
//! | neighbours among points that move, or exist for part of the shutter | [`PointTree::build`] |
//! | all neighbours of all points, at a time or over an interval | [`PointTree::neighbor_lists`], [`PointTree::neighbor_lists_swept`] |
//! | photons gathered at the time of a camera ray | [`PhotonMap::build`] |
//! | brute force, the reference of every answer | [`baseline`] |
//!
//! [`motion`] describes moving geometry, [`ray`], [`point`] and [`instance`] have the trees and their answers; the main names are
//! also in the root. Vectors are those of [`glam`], in the version that is exported here; points may be arrays too. The folder
//! docs/ of the package has guides: choosing.md says which tree and which call suit which task.
//!
//! Without optimization the library is too slow for use. So a debug build needs, in its Cargo.toml:
//!
//! ```toml
//! [profile.dev.package.mbkd]
//! opt-level = 3
//! ```
//!
//! # Time
//!
//! The shutter is the normalized time range `[0, 1]`, whatever time the program counts in. Positions are given at any number of
//! keys spaced evenly over it and are linear in between.
//!
//! # Answers
//!
//! Every answer equals that of brute force over the same arithmetic, bit for bit, whatever the tree, the number of threads and
//! the instruction set. docs/accuracy.md says how far that arithmetic is from exact answers.
//!
//! # Bad input
//!
//! Builds return an error that says where. Queries that make no sense (NaN, a time outside of the shutter, a negative radius)
//! find nothing; lists and gathers return an error. Nothing panics but an index of an answer out of range. docs/limits.md has all
//! cases.
//!
//! # Batches
//!
//! Batches run in parallel and give the answers of single queries, in the order of the queries:
//!
//! - Rays and closest points fill a vector of the caller: [`closest_hits(&rays, &mut hits)`](RayTree::closest_hits).
//! - Queries of points and photons return their answers: [`nearest_batch(&queries)`](PointTree::nearest_batch); in a `Result` if
//!   a query can be invalid ([`gather_batch`](PhotonMap::gather_batch)).
//! - Neighbour lists are requested with options ([`neighbor_lists`](PointTree::neighbor_lists)), and `run(&mut lists)` fills
//!   memory of the caller. They come in the order of the tree unless [`in_order`](ListQuery::in_order) is one of the options.
//!
//! # Features
//!
//! `rayon` (default): builds and batches on its thread pool. Without it everything runs on the calling thread, with the same
//! answers.
//!
//! The default ray tree is a sixteen-way bounding volume hierarchy ([`Policy::Wide`]); [`KdParams::paper`] is that of "k-d Tree
//! Construction Designed for Motion Blur" (Yang, Liu, Yin, Zhang, Zhou, Wei), with which the library began.

#![warn(missing_debug_implementations)]
#![warn(clippy::missing_errors_doc, clippy::missing_panics_doc)]

pub mod baseline;
mod bvh;
mod error;
mod file;
mod geometry;
pub mod instance;
mod kd;
mod layout;
mod limits;
pub mod motion;
mod parallel;
mod params;
pub mod point;
mod primitive;
mod progress;
mod random;
pub mod ray;
mod simd;
mod time;
mod traverse;
mod tuning;

pub use error::{BuildError, IntervalError, RefitError};
pub use file::FileError;
pub use geometry::{Aabb, LinearBounds, Ray, TimeInterval, morton_code};
pub use glam;
pub use instance::{
    Instance, InstanceError, InstanceHit, InstanceOf, InstancePath, InstancePoint, InstanceStatistics, InstanceTree,
    MAX_NESTING, Pose, Transform,
};
pub use layout::{Statistics, TreeBox, ValidationError};
pub use limits::{MAX_COORDINATE, MAX_POINT_COORDINATE};
pub use params::{BuildParams, Division, KdParams, LazyParams, Policy, WideParams};
pub use point::{
    Approach, BulkQuery, Encounter, EncounterLists, GatherError, GatherParams, GatherQuery, Gathered, Keep, KeepAll,
    KeepIf, ListError, ListQuery, Neighbor, NeighborBatch, NeighborBuffer, NeighborLists, NeighborQuery, NeighborWork,
    PeriodError, PeriodicPhotons, PeriodicPoints, PeriodicQuery, Photon, PhotonMap, PhotonTime, PointError,
    PointLayerKind, PointLayerStatistics, PointParams, PointStatistics, PointStructure, PointTree, Precision, Radii,
    RadiusOf, SweptQuery, TreePoint, VisiblePoint, VisiblePoints, WithinIter, certified_duration,
};
pub use primitive::{
    Intersection, Keys, MovingPoint, MovingSphere, PointArrays, PointColumns, PointSet, Position, Primitive,
    PrimitiveError, Shape, SurfacePoint, TriangleMesh, check_primitive,
};
pub use ray::{
    ClosestPoint, ClosestPointQuery, Counters, Hit, Observer, RayTree, Refit, SurfaceInteraction, TreePrimitive,
};
pub use simd::SimdLevel;
pub use traverse::Visitor;

/// The procedural scenes of the unpublished member `scenes`, included as source, so that unit tests use them with this crate's
/// own types.
#[cfg(test)]
extern crate self as engine;
#[cfg(test)]
#[allow(dead_code, unused_imports)]
#[path = "../scenes/src/lib.rs"]
mod scene;

/// The README's example, compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}

/// The guides' examples, likewise.
#[cfg(doctest)]
mod guides {
    #[doc = include_str!("../docs/files.md")]
    mod files {}
    #[doc = include_str!("../docs/from_embree.md")]
    mod from_embree {}
    #[doc = include_str!("../docs/from_kiddo_and_nanoflann.md")]
    mod from_kiddo_and_nanoflann {}
    #[doc = include_str!("../docs/gather.md")]
    mod gather {}
    #[doc = include_str!("../docs/limits.md")]
    mod limits {}
    #[doc = include_str!("../docs/neighbors.md")]
    mod neighbors {}
    #[doc = include_str!("../docs/particles.md")]
    mod particles {}
    #[doc = include_str!("../docs/rays.md")]
    mod rays {}
    #[cfg(feature = "rayon")]
    #[doc = include_str!("../docs/threads.md")]
    mod threads {}
}
