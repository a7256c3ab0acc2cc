//! Copying meshes into tree space: for a build, and for refitting a tree to the next frame.

use super::mesh::{Keys, TriangleMesh};
use super::precise_vertices::PreciseVertices;
use super::triangles::{BLOCK, MeshInfo, Triangles, Vertices, segments};
use crate::error::{BuildError, RefitError};
use crate::geometry::{Aabb, Frame, TimeInterval};
use crate::parallel;
use crate::simd::{huge_vec, prefetch};
use core::ops::Range;
use glam::Vec3;

impl Triangles {
    /// Checks the meshes and copies them into tree space.
    #[cfg(test)]
    pub(crate) fn new(meshes: &[TriangleMesh]) -> Result<Triangles, BuildError> {
        Triangles::with_bounds(meshes, Aabb::EMPTY)
    }

    /// Checks the meshes and copies them into a tree space that also holds the bounds of other primitives.
    pub(crate) fn with_bounds(meshes: &[TriangleMesh], others: Aabb) -> Result<Triangles, BuildError> {
        let frame = checked(meshes, others)?;
        // Redundant keys are dropped: static meshes and linear motion have no cost for them.
        let kept: Vec<usize> = meshes.iter().map(|mesh| mesh.kept_keys(frame)).collect();
        Triangles::copied(meshes, frame, &kept)
    }

    /// The same meshes with other positions and the same numbers of kept keys.
    pub(crate) fn with_positions(&self, meshes: &[TriangleMesh], others: Aabb) -> Result<Triangles, RefitError> {
        if meshes.len() != self.meshes.len() {
            return Err(RefitError::Count { expected: self.meshes.len(), found: meshes.len() });
        }
        for (i, mesh) in meshes.iter().enumerate() {
            if mesh.len() != self.len_of(i) {
                return Err(RefitError::Topology { mesh: i });
            }
        }
        let frame = checked(meshes, others).map_err(RefitError::Input)?;
        let mut kept = Vec::with_capacity(meshes.len());
        for (i, (mesh, before)) in meshes.iter().zip(&self.meshes).enumerate() {
            if mesh.is_precise() != before.precise.is_some() {
                return Err(RefitError::Precision { mesh: i });
            }
            let needed = mesh.kept_keys(frame);
            if needed > 1 && needed != before.keys {
                return Err(RefitError::Keys { mesh: i, expected: before.keys, found: needed });
            }
            kept.push(before.keys);
        }
        let again = Triangles::copied(meshes, frame, &kept).map_err(RefitError::Input)?;
        match again.meshes.iter().zip(&self.meshes).position(|(a, b)| a.indices != b.indices) {
            Some(mesh) => Err(RefitError::Topology { mesh }),
            None => Ok(again),
        }
    }

    /// Copies meshes that were checked, with `kept` evenly spaced keys of each.
    fn copied(meshes: &[TriangleMesh], frame: Frame, kept: &[usize]) -> Result<Triangles, BuildError> {
        let total = meshes.iter().map(TriangleMesh::len).sum();
        let positions_of = |mesh: &TriangleMesh, keys: usize| keys * mesh.keys.vertices(0);
        let given: usize = meshes.iter().map(|mesh| positions_of(mesh, mesh.keys.len())).sum();
        let found: usize = meshes.iter().zip(kept).map(|(mesh, &keys)| positions_of(mesh, keys)).sum();
        if found >= u32::MAX as usize {
            return Err(BuildError::TooManyPositions { found });
        }
        let mut positions = huge_vec(found);
        let mut corners = huge_vec(total);
        let (mut infos, mut bent, mut precise) = (Vec::with_capacity(meshes.len()), 0, 0);
        // If all keys are equal there may be fewer than are kept.
        let given_key = |mesh: usize, key: usize| {
            let given = meshes[mesh].keys.len();
            (key * (segments(given) / segments(kept[mesh]))).min(given - 1)
        };
        for (m, (mesh, &keys)) in meshes.iter().zip(kept).enumerate() {
            let (first, place) = (corners.len() as u32, positions.len());
            let vertices = mesh.keys.vertices(0);
            // The strides of the keys of a vertex, and of successive vertices.
            let [stride, apart] = match keys {
                ..=1 => [0, 1],
                2 => [vertices, 1],
                _ => [1, keys],
            };
            let given: Vec<usize> = (0..keys).map(|key| given_key(m, key)).collect();
            // The kind of positions is matched once for all of them.
            match &mesh.keys {
                Keys::F32(at) => match frame.in_f32() {
                    Some((origin, scale)) => append(&mut positions, at, &given, |p| (p - origin) * scale),
                    None => append(&mut positions, at, &given, |p| frame.point(p.as_dvec3())),
                },
                Keys::F64(at) | Keys::Precise(at) => append(&mut positions, at, &given, |p| frame.point(p)),
            }
            let corner = |v: u32| place as u32 + v * apart as u32;
            parallel::fill(&mut corners, mesh.len(), |t| mesh.indices[t].map(corner));
            let (active, mask, indices) = (mesh.active, mesh.mask, digest(&mesh.indices));
            let in_f64 = mesh.is_precise().then_some(precise);
            precise += if mesh.is_precise() { mesh.len() as u32 } else { 0 };
            infos.push(MeshInfo { first, bent_before: bent, keys, stride, active, mask, indices, precise: in_f64 });
            bent += if keys > 2 { mesh.len() } else { 0 };
        }
        let mesh_at = mesh_at(meshes.iter().map(TriangleMesh::len), total);
        let always_active = meshes.iter().all(|m| m.active == TimeInterval::FULL);
        let vertices = Vertices { positions, corners };
        let counts = [given, found];
        let precise = PreciseVertices::of(meshes, kept, frame, given_key);
        Ok(Triangles { frame, meshes: infos, len: total, mesh_at, always_active, bent, counts, vertices, precise })
    }

    /// Number of triangles of a mesh.
    fn len_of(&self, mesh: usize) -> usize {
        let end = self.meshes.get(mesh + 1).map_or(self.len, |next| next.first as usize);
        end - self.meshes[mesh].first as usize
    }
}

/// Vertices whose keys are all written together: a few cache lines of each key are read, and the written block stays in a
/// cache.
const TOGETHER: usize = 64;

/// Appends the positions of a mesh at some keys: key by key up to two keys, vertex by vertex beyond.
fn append<P: Copy + Sync>(positions: &mut Vec<Vec3>, at: &[Vec<P>], keys: &[usize], map: impl Fn(P) -> Vec3 + Sync) {
    if keys.len() <= 2 {
        keys.iter().for_each(|&key| parallel::fill(positions, at[key].len(), |v| map(at[key][v])));
        return;
    }
    let vertices = at[0].len();
    let begin = positions.len();
    let copy = |first: usize, block: &mut [Vec3]| {
        for (place, &key) in keys.iter().enumerate() {
            let given = &at[key][first..];
            // So few lines of a key are over before the processor foresees the next ones.
            given.iter().skip(TOGETHER).take(TOGETHER).step_by(64 / size_of::<P>()).for_each(prefetch);
            for (of_vertex, &given) in block.chunks_exact_mut(keys.len()).zip(given) {
                of_vertex[place] = map(given);
            }
        }
    };
    if parallel::threads() == 1 {
        // Memory is written once, instead of zeros first.
        let mut block = vec![Vec3::ZERO; TOGETHER * keys.len()];
        for first in (0..vertices).step_by(TOGETHER) {
            let block = &mut block[..TOGETHER.min(vertices - first) * keys.len()];
            copy(first, block);
            positions.extend_from_slice(block);
        }
        return;
    }
    positions.resize(begin + vertices * keys.len(), Vec3::ZERO);
    let mut blocks: Vec<(usize, &mut [Vec3])> =
        (0..).step_by(TOGETHER).zip(positions[begin..].chunks_mut(TOGETHER * keys.len())).collect();
    parallel::each(&mut blocks, |(first, block)| copy(*first, block));
}

/// Checks meshes, and returns the frame of them and of the other primitives.
fn checked(meshes: &[TriangleMesh], others: Aabb) -> Result<Frame, BuildError> {
    let mut swept = others;
    for (i, mesh) in meshes.iter().enumerate() {
        swept = swept.union(mesh.validate(i)?);
    }
    let found: usize = meshes.iter().map(TriangleMesh::len).sum();
    if found >= u32::MAX as usize {
        return Err(BuildError::TooManyPrimitives { found });
    }
    let given = || meshes.iter().filter(|mesh| mesh.keys.vertices(0) > 0);
    if given().any(|mesh| matches!(mesh.keys, Keys::F32(_))) {
        return Ok(Frame::exact(swept));
    }
    Ok(if given().any(TriangleMesh::is_precise) { Frame::exact_in_f64(swept) } else { Frame::around(swept) })
}

/// A hash of the vertex indices: the sum of the indices of all triangles, each mixed with its position
/// (as in splitmix64), so that the order of additions does not matter.
fn digest(indices: &[[u32; 3]]) -> u64 {
    let mixed = |place: usize, [a, b, c]: [u32; 3]| {
        let place = (place as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let pair = (u64::from(a) | u64::from(b) << 32).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (place ^ pair).wrapping_add(u64::from(c).wrapping_mul(0x94d0_49bb_1331_11eb));
        let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed ^ mixed >> 27
    };
    let of = |range: Range<usize>| range.map(|i| mixed(i, indices[i])).fold(0, u64::wrapping_add);
    parallel::parts(indices.len(), of).fold(0, u64::wrapping_add)
}

/// The mesh of every [`BLOCK`]-th triangle, and of the last, given the number of triangles of each mesh.
pub(super) fn mesh_at(lengths: impl Iterator<Item = usize>, total: usize) -> Vec<u32> {
    let mut mesh_at = Vec::with_capacity(total / BLOCK + 2);
    let (mut end, mut last) = (0usize, 0);
    for (i, length) in (0..).zip(lengths) {
        end += length;
        mesh_at.resize(end.div_ceil(BLOCK), i);
        last = if length > 0 { i } else { last };
    }
    mesh_at.push(last);
    mesh_at
}
