//! Vertices of meshes that are kept in f64.

use super::mesh::TriangleMesh;
use crate::geometry::Frame;
use crate::parallel;
use crate::simd::huge_vec;
use core::ops::Range;
use glam::DVec3;

/// The vertices of all meshes that are kept in f64, in tree space.
#[derive(Default)]
pub(super) struct PreciseVertices {
    /// Mesh by mesh, vertex by vertex, key by key.
    pub(super) positions: Vec<DVec3>,
    /// The corners of each triangle of these meshes, as indices of their first keys in `positions`.
    pub(super) corners: Vec<[u32; 3]>,
}

impl PreciseVertices {
    /// The vertices of meshes with `kept` keys each, of which `key(mesh, i)` is the `i`-th.
    pub(super) fn of(
        meshes: &[TriangleMesh],
        kept: &[usize],
        frame: Frame,
        key: impl Fn(usize, usize) -> usize + Sync,
    ) -> PreciseVertices {
        let precise = || meshes.iter().zip(kept).enumerate().filter(|(_, (mesh, _))| mesh.is_precise());
        let positions = precise().map(|(_, (mesh, &keys))| keys * mesh.keys.vertices(0)).sum();
        let corners = precise().map(|(_, (mesh, _))| mesh.len()).sum();
        let mut all = PreciseVertices { positions: huge_vec(positions), corners: huge_vec(corners) };
        for (m, (mesh, &keys)) in precise() {
            let first = all.positions.len() as u32;
            parallel::fill(&mut all.positions, mesh.keys.vertices(0) * keys, |i| {
                frame.fine_point(mesh.keys.position(key(m, i % keys), i / keys))
            });
            let place = |v: u32| first + v * keys as u32;
            parallel::fill(&mut all.corners, mesh.len(), |t| mesh.indices[t].map(place));
        }
        all
    }

    /// Whether there are no such meshes with triangles.
    #[inline(always)]
    pub(super) fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    pub(super) fn bytes(&self) -> usize {
        self.positions.capacity() * size_of::<DVec3>() + self.corners.capacity() * size_of::<[u32; 3]>()
    }

    /// Whether all vertices of a range of triangles with this many keys exist.
    pub(super) fn contains(&self, triangles: Range<usize>, keys: u32) -> bool {
        let end = self.positions.len() as u64;
        let there = |&vertex: &u32| u64::from(vertex) + u64::from(keys) <= end;
        self.corners.get(triangles).is_some_and(|corners| corners.iter().flatten().all(there))
    }
}
