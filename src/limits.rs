//! Limits of inputs and layouts that several modules check. A limit of one module only is a constant of that module.

use glam::Vec3;

/// The largest magnitude a coordinate may have: the f32 next to 1e30, which is a little larger. Beyond it builds return an error.
/// (Points have a smaller limit as well, [`MAX_POINT_COORDINATE`].)
pub const MAX_COORDINATE: f64 = 1e30_f32 as f64;

/// The largest magnitude of a point's coordinate, relative to the tree's origin: squared distances between
/// such points fit into f32.
pub const MAX_POINT_COORDINATE: f64 = 1e18;

/// Whether a position relative to the origin of a point tree is finite and not too far away.
#[inline(always)]
pub(crate) fn is_in_range(position: Vec3) -> bool {
    // Also false for NaN.
    position.abs().cmple(Vec3::splat(MAX_POINT_COORDINATE as f32)).all()
}

/// The most keys of a set of points.
pub(crate) const MAX_KEYS: usize = 1 << 16;

/// The most keys of a mesh. Leaf blocks hold keys of spheres up to this number; trees only list the ids of spheres with more.
pub(crate) const MAX_MESH_KEYS: usize = 1 << 24;

/// The most time slices of a point tree that can be requested.
pub(crate) const MAX_POINT_TIME_SLICES: usize = 1024;

/// The most references per primitive in a wide tree that can be requested
/// ([`WideParams::max_references`](crate::WideParams::max_references)).
pub(crate) const MOST_REFERENCES: usize = 8;

/// The most slices of the shutter in a wide tree.
pub(crate) const MAX_TIME_SLICES: usize = 16;

/// The deepest a k-d tree may be: the traversal stack holds this many entries.
pub(crate) const DEPTH_LIMIT: usize = 60;

/// The most nodes of a k-d tree: the right child's index has 30 bits.
pub(crate) const MAX_NODES: usize = 1 << 30;

/// The most levels of nodes of a point tree: 16^8 leaves are more than 2^32 points fill.
pub(crate) const MAX_LEVELS: usize = 9;
