//! Moving some meshes of a set, for a refit in which the others stay where they are.
//!
//! A refit reads the vertices of all triangles in the leaf blocks that it rewrites: those of the meshes that moved, and of other
//! triangles beside them in a block. Only these are copied, so that what stays where it is costs nothing.

use super::copy_meshes::{append, counts, digest, frame_of};
use super::triangle_set::{Triangles, Vertices};
use crate::error::{BuildError, RefitError};
use crate::geometry::{Aabb, Frame, TimeInterval};
use crate::parallel;
use crate::primitive::mesh::merge_keys::given_key;
use crate::primitive::mesh::triangle_mesh::{MeshExtent, TriangleMesh};
use crate::simd::huge_vec;
use glam::{DVec3, Vec3};

impl TriangleMesh {
    /// Appends the positions of the corners of a triangle, each at `keys` kept keys, in world space. All that is read is checked.
    fn append_corners(&self, to: &mut Vec<DVec3>, mesh: usize, triangle: usize, keys: usize) -> Result<(), BuildError> {
        for index in self.indices[triangle] {
            for key in (0..keys).map(|key| given_key(self.keys.len(), keys, key)) {
                let (vertex, vertices) = (index as usize, self.keys.vertices(key));
                if vertex >= vertices {
                    return Err(BuildError::IndexOutOfRange { mesh, triangle, index, vertices });
                }
                to.push(self.valid_position(mesh, key, vertex)?);
            }
        }
        Ok(())
    }
}

impl Triangles {
    /// Moves the meshes for which `moved` is set, if that leaves tree space as it is; returns whether it does. If it does not, all
    /// coordinates change. Of the other meshes, only the triangles `beside` get vertices, until [`Triangles::drop_vertices`].
    ///
    /// After an error, or if it returns false, nothing has changed.
    pub(in crate::primitive) fn move_meshes(
        &mut self,
        meshes: &[TriangleMesh],
        moved: &[bool],
        beside: &[u32],
        others: Aabb,
    ) -> Result<bool, RefitError> {
        self.require_same_sizes(meshes)?;
        if self.extents.len() != meshes.len() {
            return Ok(false);
        }
        if let Some(mesh) = meshes.iter().position(|mesh| mesh.keys.is_empty()) {
            return Err(BuildError::NoKeys { mesh }.into());
        }
        let list: Vec<usize> = (0..meshes.len()).filter(|&i| moved[i]).collect();
        let extents =
            list.iter().map(|&i| meshes[i].extent(i, self.extents.get(i))).collect::<Result<Vec<MeshExtent>, _>>();
        let extents = extents?;
        let still = self.extents.iter().zip(moved).filter(|&(_, &moved)| !moved).map(|(of, _)| of);
        let frame = frame_of(meshes, still.chain(&extents).map(|of| of.swept), others);
        if !frame.maps_as(&self.frame) {
            return Ok(false);
        }
        for &i in &list {
            self.keys_again(i, &meshes[i], frame)?;
            if digest(&meshes[i].indices) != self.meshes[i].indices {
                return Err(RefitError::Topology { mesh: i });
            }
        }
        // Vertices that no triangle uses may have come or gone.
        let resized =
            |(&i, of): (&usize, &MeshExtent)| meshes[i].is_precise() && of.vertices != self.extents[i].vertices;
        if list.iter().zip(&extents).any(resized) {
            return Ok(false);
        }
        let kept = |i: usize| self.meshes[i].keys;
        let mut of_beside = Vec::with_capacity(6 * beside.len());
        for &id in beside {
            let i = self.mesh_of(id);
            let triangle = (id - self.meshes[i].first) as usize;
            meshes[i].append_corners(&mut of_beside, i, triangle, kept(i))?;
        }
        let copied: usize = list.iter().zip(&extents).map(|(&i, of)| kept(i) * of.vertices).sum();
        let copied = copied + of_beside.len();
        if copied >= u32::MAX as usize {
            return Ok(false);
        }

        let mut positions: Vec<Vec3> = huge_vec(copied);
        // The system provides zeros when they are first touched, and most are not.
        let mut corners = vec![[0; 3]; self.len];
        for &i in &list {
            let corner = append(&mut positions, &meshes[i], kept(i), frame);
            let of_mesh = &mut corners[self.meshes[i].first as usize..][..meshes[i].len()];
            let indices = meshes[i].indices.chunks(parallel::CHUNK);
            let mut parts: Vec<_> = of_mesh.chunks_mut(parallel::CHUNK).zip(indices).collect();
            parallel::each(&mut parts, |(to, from)| {
                to.iter_mut().zip(*from).for_each(|(to, from)| *to = from.map(&corner));
            });
        }
        let mut first = positions.len() as u32;
        positions.extend(of_beside.iter().map(|&p| frame.point(p)));
        for &id in beside {
            let keys = kept(self.mesh_of(id)) as u32;
            corners[id as usize] = [first, first + keys, first + 2 * keys];
            first += 3 * keys;
        }
        self.counts = counts(meshes, self.meshes.iter().map(|mesh| mesh.keys));
        self.rewrite_precise(meshes, moved, frame);
        for (&i, &extent) in list.iter().zip(&extents) {
            (self.meshes[i].active, self.meshes[i].mask, self.extents[i]) = (meshes[i].active, meshes[i].mask, extent);
        }
        self.always_active = self.meshes.iter().all(|mesh| mesh.active == TimeInterval::FULL);
        (self.frame, self.vertices) = (frame, Vertices { positions, corners });
        Ok(true)
    }

    /// Overwrites the vertices that are kept in f64 of the meshes that moved, which have as many vertices as before.
    fn rewrite_precise(&mut self, meshes: &[TriangleMesh], moved: &[bool], frame: Frame) {
        let mut first = 0;
        for i in 0..meshes.len() {
            let keys = self.meshes[i].keys;
            if self.meshes[i].precise.is_none() {
                continue;
            }
            if moved[i] {
                self.precise.rewrite(first, &meshes[i], keys, frame);
            }
            first += self.extents[i].vertices * keys;
        }
    }
}
