//! Vertices of meshes that are kept in f64.

use super::merge_keys::given_key;
use super::triangle_mesh::TriangleMesh;
use crate::geometry::Frame;
use crate::parallel;
use crate::simd::{fill, huge_vec};
use core::ops::Range;
use glam::DVec3;

/// The vertices of all meshes that are kept in f64, in tree space.
#[derive(Clone, Default)]
pub(in crate::primitive) struct PreciseVertices {
    /// Mesh by mesh, vertex by vertex, key by key.
    pub(in crate::primitive) positions: Vec<DVec3>,
    /// The corners of each triangle of these meshes, as indices of their first keys in `positions`.
    pub(in crate::primitive) corners: Vec<[u32; 3]>,
}

impl PreciseVertices {
    /// The vertices of meshes with `kept` keys each.
    pub(in crate::primitive) fn of(meshes: &[TriangleMesh], kept: &[usize], frame: Frame) -> PreciseVertices {
        let precise = || meshes.iter().zip(kept).filter(|(mesh, _)| mesh.is_precise());
        let positions = precise().map(|(mesh, &keys)| keys * mesh.keys.vertices(0)).sum();
        let corners = precise().map(|(mesh, _)| mesh.len()).sum();
        let mut all = PreciseVertices { positions: huge_vec(positions), corners: huge_vec(corners) };
        for (mesh, &keys) in precise() {
            let first = all.positions.len() as u32;
            fill(&mut all.positions, mesh.keys.vertices(0) * keys, position(mesh, keys, frame));
            let place = |v: u32| first + v * keys as u32;
            fill(&mut all.corners, mesh.len(), |t| mesh.indices[t].map(place));
        }
        all
    }

    /// Overwrites the positions of a mesh, which begin with number `first`, by as many others.
    pub(in crate::primitive) fn rewrite(&mut self, first: usize, mesh: &TriangleMesh, keys: usize, frame: Frame) {
        let position = position(mesh, keys, frame);
        let of_mesh = &mut self.positions[first..][..mesh.keys.vertices(0) * keys];
        let mut parts: Vec<_> = (0..).step_by(parallel::CHUNK).zip(of_mesh.chunks_mut(parallel::CHUNK)).collect();
        parallel::each(&mut parts, |(begin, part)| {
            part.iter_mut().enumerate().for_each(|(i, to)| *to = position(*begin + i));
        });
    }

    /// Whether there are no such meshes with triangles.
    #[inline(always)]
    pub(in crate::primitive) fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    pub(in crate::primitive) fn bytes(&self) -> usize {
        self.positions.capacity() * size_of::<DVec3>() + self.corners.capacity() * size_of::<[u32; 3]>()
    }

    /// Whether all vertices of a range of triangles with this many keys exist.
    pub(in crate::primitive) fn contains(&self, triangles: Range<usize>, keys: u32) -> bool {
        let end = self.positions.len() as u64;
        let there = |&vertex: &u32| u64::from(vertex) + u64::from(keys) <= end;
        self.corners.get(triangles).is_some_and(|corners| corners.iter().flatten().all(there))
    }
}

/// The position with number `i` of a mesh of which `keys` keys are kept.
fn position(mesh: &TriangleMesh, keys: usize, frame: Frame) -> impl Fn(usize) -> DVec3 + Sync {
    move |i| frame.fine_point(mesh.keys.position(given_key(mesh.keys.len(), keys, i % keys), i / keys))
}
