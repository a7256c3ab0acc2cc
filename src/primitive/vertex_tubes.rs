//! The tubes of all vertices of meshes, in memory.

use crate::geometry::LaneBounds;

/// The tubes of the vertices of some meshes over an interval, of which the bounds of many triangles are made.
#[derive(Default)]
pub(crate) struct VertexTubes(pub(super) Vec<MeshTubes>);

/// Those of one mesh.
pub(super) struct MeshTubes {
    pub mesh: usize,
    /// The first vertex, and the distance between the numbers of successive ones.
    pub first: u32,
    pub apart: u32,
    /// Not padded; the lane [`SIZE`] holds the negated largest coordinate.
    pub tubes: Vec<LaneBounds>,
}

/// A lane that means nothing in bounds.
pub(super) const SIZE: usize = 3;

impl VertexTubes {
    /// Those of a mesh.
    pub(super) fn of_mesh(&self, mesh: usize) -> Option<&MeshTubes> {
        self.0.iter().find(|of| of.mesh == mesh)
    }
}

impl MeshTubes {
    /// The tube of a vertex.
    #[inline(always)]
    pub(super) fn of(&self, vertex: u32) -> &LaneBounds {
        &self.tubes[((vertex - self.first) / self.apart) as usize]
    }
}
