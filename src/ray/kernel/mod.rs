//! The arithmetic of one ray: in tree space, against boxes, and against triangles.

pub(super) mod outline;
mod pieces;
pub(super) mod shear;
mod slabs;
pub(super) mod tree_ray;
mod triangle;
