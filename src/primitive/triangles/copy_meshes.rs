//! Copying meshes into tree space: for a build, and for refitting a tree to the next frame.

use super::triangle_set::{Triangles, Vertices};
use crate::error::{BuildError, RefitError};
use crate::geometry::{Aabb, Frame, TimeInterval};
use crate::parallel;
use crate::primitive::mesh::merge_keys::given_key;
use crate::primitive::mesh::mesh_index::{MeshIndex, MeshInfo};
use crate::primitive::mesh::precise_vertices::PreciseVertices;
use crate::primitive::mesh::triangle_mesh::{Keys, MeshExtent, TriangleMesh};
use crate::progress::Progress;
use crate::simd::{fill, huge_vec, prefetch};
use core::ops::Range;
use glam::Vec3;

impl Triangles {
    /// Checks the meshes and copies them into tree space.
    #[cfg(test)]
    pub(crate) fn new(meshes: &[TriangleMesh]) -> Result<Triangles, BuildError> {
        Triangles::with_bounds(meshes, Aabb::EMPTY, &Progress::new(None))
    }

    /// Checks the meshes and copies them into a tree space that also holds the bounds of other primitives.
    pub(crate) fn with_bounds(
        meshes: &[TriangleMesh],
        others: Aabb,
        progress: &Progress,
    ) -> Result<Triangles, BuildError> {
        let extents = extents(meshes, &[], &progress.subtask(CHECKING))?;
        let frame = frame_of(meshes, extents.iter().map(|of| of.swept), others);
        // Redundant keys are dropped: static meshes and linear motion have no cost for them.
        let kept = each(meshes, &progress.subtask(MERGING), |_, mesh| Ok(mesh.kept_keys(frame)))?;
        Triangles::copied(meshes, frame, &kept, &progress.rest(1.0))
    }

    /// The same meshes with other positions and the same numbers of kept keys.
    pub(crate) fn with_positions(&self, meshes: &[TriangleMesh], others: Aabb) -> Result<Triangles, RefitError> {
        self.require_same_sizes(meshes)?;
        let progress = Progress::new(None);
        let extents = extents(meshes, &self.extents, &progress)?;
        let frame = frame_of(meshes, extents.iter().map(|of| of.swept), others);
        let kept =
            (0..).zip(meshes).map(|(i, mesh)| self.keys_again(i, mesh, frame)).collect::<Result<Vec<usize>, _>>()?;
        let again = Triangles::copied(meshes, frame, &kept, &progress)?;
        match again.meshes.iter().zip(&self.meshes).position(|(a, b)| a.indices != b.indices) {
            Some(mesh) => Err(RefitError::Topology { mesh }),
            None => Ok(Triangles { extents, ..again }),
        }
    }

    /// An error unless there are as many meshes, of as many triangles.
    pub(in crate::primitive) fn require_same_sizes(&self, meshes: &[TriangleMesh]) -> Result<(), RefitError> {
        if meshes.len() != self.meshes.len() {
            return Err(RefitError::Count { expected: self.meshes.len(), found: meshes.len() });
        }
        match (0..).zip(meshes).find(|&(i, mesh)| mesh.len() != self.ids_of_mesh(i).len()) {
            Some((mesh, _)) => Err(RefitError::Topology { mesh }),
            None => Ok(()),
        }
    }

    /// The number of keys that are kept of a mesh that was checked: as many as before, if no more are needed.
    pub(in crate::primitive) fn keys_again(
        &self,
        i: usize,
        mesh: &TriangleMesh,
        frame: Frame,
    ) -> Result<usize, RefitError> {
        let before = &self.meshes[i];
        if mesh.is_precise() != before.precise.is_some() {
            return Err(RefitError::Precision { mesh: i });
        }
        let found = mesh.kept_keys(frame);
        // What stands still has a place for any number of keys, also if it is to keep another one.
        if found > 1 && found != before.keys && mesh.needed_keys(frame) > 1 {
            return Err(RefitError::Keys { mesh: i, expected: before.keys, found });
        }
        Ok(before.keys)
    }

    /// Copies meshes that were checked, with `kept` evenly spaced keys of each.
    fn copied(
        meshes: &[TriangleMesh],
        frame: Frame,
        kept: &[usize],
        progress: &Progress,
    ) -> Result<Triangles, BuildError> {
        let total = meshes.iter().map(TriangleMesh::len).sum();
        let counts = counts(meshes, kept.iter().copied());
        if counts[1] >= u32::MAX as usize {
            return Err(BuildError::TooManyPositions { found: counts[1] });
        }
        let mut positions = huge_vec(counts[1]);
        let mut corners = huge_vec(total);
        let (mut infos, mut bent, mut precise) = (Vec::with_capacity(meshes.len()), 0, 0);
        each(meshes, progress, |i, mesh| {
            let (keys, first) = (kept[i], corners.len() as u32);
            let corner = append(&mut positions, mesh, keys, frame);
            fill(&mut corners, mesh.len(), |t| mesh.indices[t].map(&corner));
            let (active, mask, indices) = (mesh.active, mesh.mask, digest(&mesh.indices));
            let in_f64 = mesh.is_precise().then_some(precise);
            precise += if mesh.is_precise() { mesh.len() as u32 } else { 0 };
            let stride = usize::from(keys > 1);
            infos.push(MeshInfo { first, bent_before: bent, keys, stride, active, mask, indices, precise: in_f64 });
            bent += if keys > 2 { mesh.len() } else { 0 };
            Ok(())
        })?;
        let index = MeshIndex::new(meshes.iter().map(TriangleMesh::len), total);
        let always_active = meshes.iter().all(|m| m.active == TimeInterval::FULL);
        let vertices = Vertices { positions, corners };
        let precise = PreciseVertices::of(meshes, kept, frame);
        let extents = Vec::new();
        Ok(Triangles {
            frame,
            meshes: infos,
            len: total,
            index,
            always_active,
            bent,
            counts,
            vertices,
            precise,
            extents,
        })
    }
}

/// Vertices whose keys are all written together: a few cache lines of each key are read, and the written block stays in a
/// cache.
const TOGETHER: usize = 64;

/// Numbers of vertex positions over all keys: given, and kept.
pub(in crate::primitive) fn counts(meshes: &[TriangleMesh], kept: impl Iterator<Item = usize>) -> [usize; 2] {
    let each = meshes.iter().zip(kept);
    let of = each.map(|(mesh, kept)| [mesh.keys.len(), kept].map(|keys| keys * mesh.keys.vertices(0)));
    of.fold([0; 2], |all, of| [all[0] + of[0], all[1] + of[1]])
}

/// Appends the positions of a mesh at the keys that are kept, vertex by vertex. Returns where the first key of a vertex is.
pub(in crate::primitive) fn append(
    positions: &mut Vec<Vec3>,
    mesh: &TriangleMesh,
    keys: usize,
    frame: Frame,
) -> impl Fn(u32) -> u32 + Sync + use<> {
    let place = positions.len() as u32;
    let given: Vec<usize> = (0..keys).map(|key| given_key(mesh.keys.len(), keys, key)).collect();
    // The kind of positions is matched once for all of them.
    match &mesh.keys {
        Keys::F32(at) => match frame.in_f32() {
            Some((origin, scale)) => append_keys(positions, at, &given, |p| (p - origin) * scale),
            None => append_keys(positions, at, &given, |p| frame.point(p.as_dvec3())),
        },
        Keys::F64(at) | Keys::Precise(at) => append_keys(positions, at, &given, |p| frame.point(p)),
    }
    move |vertex| place + vertex * keys as u32
}

/// Appends the positions at some keys, vertex by vertex.
fn append_keys<P: Copy + Sync>(
    positions: &mut Vec<Vec3>,
    at: &[Vec<P>],
    keys: &[usize],
    map: impl Fn(P) -> Vec3 + Sync,
) {
    let vertices = at[0].len();
    let alone = vertices <= parallel::CHUNK || parallel::threads() == 1;
    match *keys {
        [key] => return fill(positions, vertices, |v| map(at[key][v])),
        [first, last] if alone => {
            return positions.extend(at[first].iter().zip(&at[last]).flat_map(|(&a, &b)| [map(a), map(b)]));
        }
        _ => {}
    }
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
    if alone {
        // Memory is written once, instead of zeros first.
        let mut block = vec![Vec3::ZERO; TOGETHER.min(vertices) * keys.len()];
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

/// Shares of the steps of reading meshes, about.
const CHECKING: f64 = 0.25;
const MERGING: f64 = 0.25;

/// Does something with each mesh and its index; meshes count by their sizes in `progress`.
fn each<T>(
    meshes: &[TriangleMesh],
    progress: &Progress,
    mut f: impl FnMut(usize, &TriangleMesh) -> Result<T, BuildError>,
) -> Result<Vec<T>, BuildError> {
    // Nothing is known of a mesh that was not checked yet.
    let vertices = |mesh: &TriangleMesh| (0..mesh.keys.len()).map(|key| mesh.keys.vertices(key)).sum::<usize>();
    let size = |mesh: &TriangleMesh| vertices(mesh) + mesh.len();
    let progress = progress.in_units(meshes.iter().map(size).sum());
    let done = (0..).zip(meshes).map(|(i, mesh)| {
        progress.check()?;
        let done = f(i, mesh)?;
        progress.finished(size(mesh) as f64);
        Ok(done)
    });
    done.collect()
}

/// Checks meshes, and returns how far each reaches. `before` is how far they did with the same triangles, or empty.
fn extents(meshes: &[TriangleMesh], before: &[MeshExtent], progress: &Progress) -> Result<Vec<MeshExtent>, BuildError> {
    let extents = each(meshes, progress, |i, mesh| mesh.extent(i, before.get(i)))?;
    let found: usize = meshes.iter().map(TriangleMesh::len).sum();
    if found >= u32::MAX as usize {
        return Err(BuildError::TooManyPrimitives { found });
    }
    Ok(extents)
}

/// The frame of meshes with these bounds, and of the other primitives.
pub(in crate::primitive) fn frame_of(
    meshes: &[TriangleMesh],
    swept: impl Iterator<Item = Aabb>,
    others: Aabb,
) -> Frame {
    let swept = swept.fold(others, Aabb::union);
    let given = || meshes.iter().filter(|mesh| !mesh.is_empty());
    if given().any(|mesh| matches!(mesh.keys, Keys::F32(_))) {
        return Frame::exact(swept);
    }
    // Boxes of shapes near zero are precise there, however far others are.
    let rounded = given().next().is_some() && !given().any(TriangleMesh::is_precise);
    if rounded { Frame::around(swept) } else { Frame::exact_in_f64(swept) }
}

/// A hash of the vertex indices: the sum of the indices of all triangles, each mixed with its position
/// (as in splitmix64), so that the order of additions does not matter.
pub(in crate::primitive) fn digest(indices: &[[u32; 3]]) -> u64 {
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
