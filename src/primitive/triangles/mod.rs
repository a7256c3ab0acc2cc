//! The triangles of all meshes in tree space: copied for a build, moved for a refit, written to files.

pub(super) mod copy_meshes;
pub(super) mod move_meshes;
pub(super) mod precise;
pub(super) mod triangle_set;
pub(super) mod triangles_file;
