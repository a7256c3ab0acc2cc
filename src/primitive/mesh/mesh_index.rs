//! What is known of each mesh, and which mesh a triangle belongs to.

use crate::geometry::{KeyTime, TimeInterval};

/// What is known of a mesh beside its vertices.
#[derive(Clone)]
pub(in crate::primitive) struct MeshInfo {
    /// Id of the first triangle.
    pub(in crate::primitive) first: u32,
    /// Number of bent triangles before it, see `Triangles::entries_of`.
    pub(in crate::primitive) bent_before: usize,
    /// Number of keys.
    pub(in crate::primitive) keys: usize,
    /// The stride of successive keys of a vertex in the positions: 1, or 0 if there is one only.
    pub(in crate::primitive) stride: usize,
    pub(in crate::primitive) active: TimeInterval,
    pub(in crate::primitive) mask: u32,
    /// A hash of the vertex indices ([`crate::primitive::triangles::copy_meshes`]).
    pub(in crate::primitive) indices: u64,
    /// The index of its first triangle among those whose vertices are kept in f64, if its own are.
    pub(in crate::primitive) precise: Option<u32>,
}

impl MeshInfo {
    /// The motion segments in which the mesh exists, the first and the last.
    #[inline(always)]
    pub(in crate::primitive) fn segments_of_life(&self) -> [usize; 2] {
        [self.active.begin(), self.active.last()].map(|t| KeyTime::new(t, self.keys).segment)
    }
}

/// The meshes of some triangles, from which that of any triangle is found.
#[derive(Clone)]
pub(in crate::primitive) struct MeshIndex {
    /// The mesh of each of these triangles is stored: those whose ids are multiples of this power of two, and the last one.
    shift: u32,
    at: Vec<u32>,
}

/// Where meshes are large, the mesh of one triangle in `1 << FEW` is stored; usually the triangles up to the next one are of the
/// same mesh.
const FEW: u32 = 5;

/// With so many triangles per mesh or fewer, each triangle's mesh is stored. Together they take no more memory than what is known
/// of the meshes, among which a search would otherwise wait for the caches several times.
const SMALL: usize = size_of::<MeshInfo>() / size_of::<u32>();

impl MeshIndex {
    /// For meshes of these numbers of triangles.
    pub fn new(lengths: impl ExactSizeIterator<Item = usize>, triangles: usize) -> MeshIndex {
        let shift = if triangles <= SMALL * lengths.len() { 0 } else { FEW };
        let mut at = Vec::with_capacity((triangles >> shift) + 2);
        let (mut end, mut last) = (0usize, 0);
        for (i, length) in (0..).zip(lengths) {
            end += length;
            at.resize(end.div_ceil(1 << shift), i);
            last = if length > 0 { i } else { last };
        }
        at.push(last);
        MeshIndex { shift, at }
    }

    /// The index of a triangle's mesh.
    #[inline(always)]
    pub fn mesh(&self, meshes: &[MeshInfo], id: u32) -> usize {
        let place = (id >> self.shift) as usize;
        let (first, last) = (self.at[place] as usize, self.at[place + 1] as usize);
        if first == last || self.shift == 0 {
            return first;
        }
        // The last of those that begin at the triangle or before: empty ones begin where the next one does.
        first + meshes[first..=last].partition_point(|mesh| mesh.first <= id) - 1
    }

    /// The index of a mesh near a triangle, or its own.
    #[inline(always)]
    pub fn near(&self, id: u32) -> usize {
        self.at[(id >> self.shift) as usize] as usize
    }

    pub fn bytes(&self) -> usize {
        self.at.capacity() * size_of::<u32>()
    }
}
