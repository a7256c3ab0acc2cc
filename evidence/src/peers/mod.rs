//! The structures that the paper compares its tree with, and others in use for moving geometry.
//!
//! - **BVH_i** ([`Structure::BvhI`]): object splits by the surface area heuristic at mid-shutter; boxes at both ends of
//!   the shutter, interpolated.
//! - **MSBVH** ([`Structure::Msbvh`]; Grünschloß, Stich, Nawaz and Keller, "MSBVH: An efficient acceleration data
//!   structure for ray traced motion blur", HPG 2011): also spatial splits at mid-shutter, as in SBVH (Stich, Friedrich
//!   and Dietrich, HPG 2009); the parts are bounded anew at both ends.
//! - **4D k-d** ([`Structure::FourD`]; Olsson, "Ray-tracing time-continuous animations using 4D KD-trees", 2007): time
//!   is a fourth axis that nodes may split; references have no intervals.
//! - Any of these binary trees, and the library's own k-d trees, **collapsed to the wide layout**
//!   ([`Structure::Collapsed`]): nodes of sixteen children with boxes at both ends of the shutter, interpolated. Cells
//!   of k-d trees get boxes for that (`cell`).
//! - **Time slices** ([`Structure::Slices`]): static trees at several times, of which a ray takes the nearest. The only
//!   one with approximate answers.
//! - The library's own trees ([`Structure::Library`]), also on the instruction set that the others are compiled for
//!   ([`Structure::Portable`]).
//!
//! All of them test triangles with [`mbkd::baseline::TriangleTests`], so that they differ in structure only. Both BVHs
//! share one builder (`bvh`), one layout and one traversal (`binary_tree`); all wide layouts share one collapse
//! (`collapse`), one layout and one traversal (`wide_tree`). Costs of steps and tests are those of the library's k-d
//! trees.

mod binary_tree;
mod boxes;
mod bvh;
mod cell;
mod collapse;
mod four_d;
mod four_d_build;
mod library_kd;
mod object_split;
mod parts;
mod peer;
mod spatial_split;
mod subtree;
mod time_slices;
mod wide_node;
mod wide_tree;

pub use bvh::BvhParams;
pub use four_d_build::FourDParams;
pub use peer::{Collapsed, Peer, PeerError, PeerStatistics, Structure};
pub use time_slices::at_time;

/// Cost of a step through an inner node, as in the library's k-d trees.
const STEP: f32 = 1.0;

/// Cost of testing a triangle, likewise.
const TEST: f32 = 2.0;

/// The greatest depth of a tree.
const DEPTH: usize = 60;

/// Half the spacing of f32 just below 1: the unit of rounding errors.
const ULP: f32 = f32::EPSILON * 0.5;

/// Subtrees with fewer references are built on the same thread as their parent.
const PARALLEL_FROM: usize = 4096;

/// The best hit: the least `t`, and of several at the same `t` the lowest index.
struct Nearest {
    found: Option<(mbkd::Hit, u32)>,
    /// Hits farther than this are ignored.
    limit: f32,
    /// Boxes and cells that begin at a greater distance are culled.
    reach: f32,
}

impl Nearest {
    fn new(ray: &mbkd::baseline::PreparedRay) -> Nearest {
        Nearest { found: None, limit: f32::INFINITY, reach: ray.range().1 }
    }

    /// Tests a triangle. A triangle in several leaves may be tested several times.
    #[inline(always)]
    fn test(&mut self, tests: &mbkd::baseline::TriangleTests, ray: &mbkd::baseline::PreparedRay, index: u32) {
        if let Some(hit) = tests.hit(ray, index, self.limit)
            && self.found.is_none_or(|(best, of)| hit.t < best.t || index < of)
        {
            self.found = Some((hit, index));
            self.limit = hit.t;
            self.reach = ray.reach(hit.t);
        }
    }
}
