//! Triangles in files: the meshes, and the vertices unless leaf blocks hold them.

use super::triangle_set::{Triangles, Vertices};
use crate::file::{Decoder, Encoder, FileError, Record, require};
use crate::geometry::{Frame, TimeInterval};
use crate::limits::MAX_MESH_KEYS;
use crate::primitive::mesh::mesh_index::{MeshIndex, MeshInfo};
use crate::primitive::mesh::precise_vertices::PreciseVertices;

/// Added to the number of keys of a mesh whose vertices are kept in f64.
const PRECISE: u32 = 1 << 31;

/// The encoding of a mesh in files.
#[derive(Clone, Copy)]
struct MeshRecord {
    triangles: u32,
    keys: u32,
    precise: bool,
    stride: u32,
    mask: u32,
    active: [f32; 2],
}

impl Record for MeshRecord {
    const BYTES: usize = 24;
    fn put(&self, to: &mut [u8]) {
        let active = self.active.map(f32::to_bits);
        let keys = self.keys | if self.precise { PRECISE } else { 0 };
        [self.triangles, keys, self.stride, self.mask, active[0], active[1]].put(to);
    }
    fn get(from: &[u8]) -> MeshRecord {
        let [triangles, keys, stride, mask, begin, end] = Record::get(from);
        let (keys, precise) = (keys & !PRECISE, keys & PRECISE != 0);
        MeshRecord { triangles, keys, precise, stride, mask, active: [begin, end].map(f32::from_bits) }
    }
}

/// The contents of a file for triangles, not validated yet.
pub(crate) struct TrianglesRecord {
    pub(in crate::primitive) frame: Frame,
    counts: [u64; 2],
    meshes: Vec<MeshRecord>,
    vertices: Vertices,
    precise: PreciseVertices,
}

impl Triangles {
    /// Writes everything.
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.frame.encode(to)?;
        to.put(self.counts.map(|count| count as u64))?;
        let record = |(i, mesh): (usize, &MeshInfo)| MeshRecord {
            triangles: self.ids_of_mesh(i).len() as u32,
            keys: mesh.keys as u32,
            precise: mesh.precise.is_some(),
            stride: mesh.stride as u32,
            mask: mesh.mask,
            active: mesh.active.to_bounds(),
        };
        to.array(&self.meshes.iter().enumerate().map(record).collect::<Vec<_>>())?;
        to.array(&self.vertices.positions)?;
        to.array(&self.vertices.corners)?;
        // Only if there are such meshes: others need not name empty arrays.
        if self.meshes.iter().any(|mesh| mesh.precise.is_some()) {
            to.array(&self.precise.positions)?;
            to.array(&self.precise.corners)?;
        }
        Ok(())
    }
}

impl TrianglesRecord {
    /// Reads triangles that [`Triangles::encode`] wrote.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<TrianglesRecord, FileError> {
        let frame = Frame::decode(from)?;
        let (counts, meshes) = (from.get()?, from.array::<MeshRecord>()?);
        let vertices = Vertices { positions: from.array()?, corners: from.array()? };
        let precise = match meshes.iter().any(|mesh| mesh.precise) {
            true => PreciseVertices { positions: from.array()?, corners: from.array()? },
            false => PreciseVertices::default(),
        };
        Ok(TrianglesRecord { frame, counts, meshes, vertices, precise })
    }

    /// The triangles, if they are at most `most`, and if all vertices exist, or none of them if they are in leaf blocks.
    pub(crate) fn checked(self, most: usize, in_leaves: bool) -> Result<Triangles, FileError> {
        let TrianglesRecord { frame, counts, meshes, vertices, precise } = self;
        let total: u64 = meshes.iter().map(|mesh| u64::from(mesh.triangles)).sum();
        require(total <= most as u64 && total < u64::from(u32::MAX), "there are more triangles than it could hold")?;
        let len = total as usize;
        require(vertices.corners.len() == if in_leaves { 0 } else { len }, "triangles have no vertices")?;
        require(!in_leaves || vertices.positions.is_empty(), "there are vertices without triangles")?;
        let (mut infos, mut first, mut bent, mut in_f64) = (Vec::with_capacity(meshes.len()), 0, 0, 0);
        for mesh in &meshes {
            require((1..=MAX_MESH_KEYS).contains(&(mesh.keys as usize)), "a mesh has no or too many keys")?;
            let (keys, stride) = (mesh.keys as usize, mesh.stride as usize);
            let active = TimeInterval::of_bounds(mesh.active)?;
            // The hash is not in files: trees from files cannot be refitted.
            let (bent_before, mask, indices) = (bent, mesh.mask, 0);
            let of_mesh = mesh.precise.then_some(in_f64 as u32);
            infos.push(MeshInfo {
                first: first as u32,
                bent_before,
                keys,
                stride,
                active,
                mask,
                indices,
                precise: of_mesh,
            });
            if mesh.precise {
                let end = in_f64 + mesh.triangles as usize;
                require(precise.contains(in_f64..end, mesh.keys), "a triangle in f64 has no vertices")?;
                in_f64 = end;
            }
            require(mesh.stride == u32::from(mesh.keys > 1), "the keys of a vertex are not where they should be")?;
            let end = first + mesh.triangles as usize;
            if !in_leaves && mesh.triangles > 0 {
                // The offset of the last key of a vertex from its first.
                let last = u64::from(mesh.keys - 1);
                let positions = vertices.positions.len() as u64;
                let there = vertices.corners[first..end].iter().flatten().all(|&v| u64::from(v) + last < positions);
                require(there, "a triangle has an invalid vertex index")?;
            }
            first = end;
            bent += if keys > 2 { mesh.triangles as usize } else { 0 };
        }
        require(precise.corners.len() == in_f64, "there are vertices in f64 without triangles")?;
        let index = MeshIndex::new(meshes.iter().map(|mesh| mesh.triangles as usize), len);
        let always_active = infos.iter().all(|mesh| mesh.active == TimeInterval::FULL);
        let counts = counts.map(|count| usize::try_from(count).unwrap_or(usize::MAX));
        let extents = Vec::new();
        Ok(Triangles { frame, meshes: infos, len, index, always_active, bent, counts, vertices, precise, extents })
    }
}
