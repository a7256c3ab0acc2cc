//! Triangle meshes as the caller gives them: vertices at several keys, which of them are needed, and what is known of each mesh.

pub(super) mod merge_keys;
pub(super) mod mesh_index;
pub(super) mod precise_vertices;
pub(super) mod triangle_mesh;
