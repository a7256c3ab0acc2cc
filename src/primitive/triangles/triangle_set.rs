//! Triangle meshes in tree space, with all vertices in shared arrays.
//!
//! The data that a build needs (vertex positions) and the data that answers need (the mesh of a triangle, its active
//! interval and mask) are separate: leaf blocks of the wide layout hold all corners, and then the vertices are released.

use crate::geometry::{
    Box3, CornerBounds, Frame, INSTANTS, Instant, KeyTime, LaneBounds, LinearBox3, TimeInterval, are_disjoint,
    clip_triangle,
};
use crate::primitive::key_window::Intervals;
use crate::primitive::mesh::mesh_index::{MeshIndex, MeshInfo};
use crate::primitive::mesh::precise_vertices::PreciseVertices;
use crate::primitive::mesh::triangle_mesh::MeshExtent;
use crate::primitive::primitive_set::{PrimitiveSet, include_each};
use crate::simd::{LANES, Lanes, as_coordinates, prefetch};
use core::ops::Range;
use glam::{DVec3, Vec3};

/// The triangles of several meshes, as a [`RayTree`](crate::RayTree) holds them, in one tree space.
///
/// A triangle's id counts through the meshes in their order, so that the lowest id is the lowest
/// (mesh, triangle).
#[derive(Clone)]
pub struct Triangles {
    pub(in crate::primitive) frame: Frame,
    pub(in crate::primitive) meshes: Vec<MeshInfo>,
    /// Number of triangles.
    pub(in crate::primitive) len: usize,
    pub(in crate::primitive) index: MeshIndex,
    pub(in crate::primitive) always_active: bool,
    /// Number of triangles of meshes with more than two keys.
    pub(in crate::primitive) bent: usize,
    /// Numbers of vertex positions over all keys: given, and kept.
    pub(in crate::primitive) counts: [usize; 2],
    /// Empty once leaf blocks hold them.
    pub(in crate::primitive) vertices: Vertices,
    /// The vertices that are kept in f64.
    pub(in crate::primitive) precise: PreciseVertices,
    /// How far each mesh reaches, for refits in which only some of them move; empty before the first refit.
    pub(in crate::primitive) extents: Vec<MeshExtent>,
}

/// The vertices of all triangles.
#[derive(Clone, Default)]
pub(in crate::primitive) struct Vertices {
    /// The positions of all meshes: mesh by mesh, in each vertex by vertex, since one key of a vertex is usually read together with
    /// all others.
    pub(in crate::primitive) positions: Vec<Vec3>,
    /// The corners of each triangle, as indices of their first keys in `positions`.
    pub(in crate::primitive) corners: Vec<[u32; 3]>,
}

impl Triangles {
    /// Releases the f32 vertices: from now on there are ids, masks and intervals, but no corners and no bounds.
    pub(crate) fn drop_vertices(&mut self) {
        self.vertices = Vertices::default();
    }

    /// The index of a triangle's mesh.
    #[inline(always)]
    pub(in crate::primitive) fn mesh_of(&self, id: u32) -> usize {
        self.index.mesh(&self.meshes, id)
    }

    #[inline(always)]
    pub(in crate::primitive) fn mesh(&self, id: u32) -> &MeshInfo {
        &self.meshes[self.mesh_of(id)]
    }

    /// The number of meshes.
    pub(crate) fn mesh_count(&self) -> usize {
        self.meshes.len()
    }

    /// Number of keys of the triangle's mesh; 1 if the mesh is static.
    #[inline(always)]
    pub(crate) fn keys(&self, id: u32) -> usize {
        self.mesh(id).keys
    }

    /// The id of a triangle of a mesh, if there is such a triangle.
    pub(crate) fn id(&self, mesh: u32, triangle: u32) -> Option<u32> {
        let of_mesh = ((mesh as usize) < self.meshes.len()).then(|| self.ids_of_mesh(mesh as usize))?;
        of_mesh.start.checked_add(triangle).filter(|id| of_mesh.contains(id))
    }

    /// The ids of the triangles of a mesh.
    pub(in crate::primitive) fn ids_of_mesh(&self, mesh: usize) -> Range<u32> {
        self.meshes[mesh].first..self.meshes.get(mesh + 1).map_or(self.len as u32, |next| next.first)
    }

    /// The entries of a triangle in a table with `slices` entries for each bent triangle (of a mesh with more than two keys)
    /// and one for each other: the first, and their number.
    #[inline]
    pub(crate) fn entries_of(&self, id: u32, slices: usize) -> (usize, usize) {
        let mesh = self.mesh(id);
        let bent = mesh.keys > 2;
        let before = mesh.bent_before + if bent { (id - mesh.first) as usize } else { 0 };
        (id as usize + before * (slices - 1), if bent { slices } else { 1 })
    }

    /// Number of entries of such a table.
    pub(crate) fn entries(&self, slices: usize) -> usize {
        self.len + self.bent * (slices - 1)
    }

    /// The vertices of a triangle: indices that are unique among all meshes.
    #[inline(always)]
    pub(crate) fn vertices(&self, id: u32) -> [u32; 3] {
        self.vertices.corners[id as usize]
    }

    /// The stride of successive keys of a triangle's vertices, for [`Triangles::position`]; 0 if it is static.
    #[inline(always)]
    pub(crate) fn stride(&self, id: u32) -> usize {
        self.mesh(id).stride
    }

    /// The stride of some triangles, in ascending order, if they are all of one mesh.
    #[inline(always)]
    pub(crate) fn common_stride(&self, ids: &[u32]) -> Option<u32> {
        let mesh = self.mesh_of(*ids.first()?);
        (mesh == self.mesh_of(*ids.last()?)).then(|| self.meshes[mesh].stride as u32)
    }

    /// The strides of up to sixteen triangles in ascending order.
    #[inline(always)]
    pub(crate) fn strides(&self, ids: &[u32]) -> Lanes<u32> {
        if let Some(stride) = self.common_stride(ids) {
            return [stride; LANES];
        }
        let mut strides = [0; LANES];
        for (stride, &id) in strides.iter_mut().zip(ids) {
            *stride = self.stride(id) as u32;
        }
        strides
    }

    /// The position of a vertex at key `n` of its mesh, where `offset` is `n` times the stride.
    #[inline(always)]
    pub(crate) fn position(&self, vertex: u32, offset: usize) -> Vec3 {
        self.vertices.positions[vertex as usize + offset]
    }

    /// The positions of a vertex at some keys of its mesh, `stride` apart; a static vertex has one.
    #[inline(always)]
    pub(crate) fn run(&self, vertex: u32, stride: usize, keys: Range<usize>) -> impl Iterator<Item = &Vec3> {
        let last = keys.end - 1;
        let of = &self.vertices.positions[vertex as usize + keys.start * stride..=vertex as usize + last * stride];
        of.iter().step_by(stride.max(1))
    }

    /// The coordinates of all vertices at all keys, in the order of [`Triangles::position`].
    #[inline(always)]
    pub(crate) fn coordinates(&self) -> &[f32] {
        as_coordinates(&self.vertices.positions)
    }

    /// The positions of a vertex at all keys, for a mesh with more than two keys.
    #[inline(always)]
    pub(crate) fn keys_of_vertex(&self, vertex: u32, keys: usize) -> &[Vec3] {
        &self.vertices.positions[vertex as usize..][..keys]
    }

    /// Prefetches the positions of a vertex at some keys, for a mesh with more than two keys.
    #[inline]
    pub(crate) fn prefetch_keys(&self, vertex: u32, keys: Range<usize>) {
        let keys = vertex as usize + keys.start..vertex as usize + keys.end;
        let of = self.vertices.positions.get(keys).unwrap_or(&[]);
        of.iter().step_by(KEYS_IN_LINE).chain(of.last()).for_each(prefetch);
    }

    /// The corners at one key.
    #[inline(always)]
    pub(crate) fn corners_at_key(&self, id: u32, key: usize) -> [Vec3; 3] {
        let (offset, [a, b, c]) = (key * self.stride(id), self.vertices(id));
        // Each by itself: mapped arrays become calls.
        [self.position(a, offset), self.position(b, offset), self.position(c, offset)]
    }

    /// The corners at both keys of a mesh with two; twice the same for a static mesh.
    #[inline(always)]
    pub(crate) fn corners_at_both(&self, id: u32) -> [[Vec3; 3]; 2] {
        let &MeshInfo { keys, stride, .. } = self.mesh(id);
        let [a, b, c] = self.vertices(id);
        // Each by itself: mapped arrays become calls.
        let last = (keys - 1) * stride;
        [
            [self.position(a, 0), self.position(b, 0), self.position(c, 0)],
            [self.position(a, last), self.position(b, last), self.position(c, last)],
        ]
    }

    /// The motion segments in which a triangle exists, the first and the last: no query needs the keys of others.
    #[inline(always)]
    pub(crate) fn segments_of_life(&self, id: u32) -> [usize; 2] {
        self.mesh(id).segments_of_life()
    }

    /// The corners at any time, as trees have them that hold only the keys that queries need: where the triangle does not exist, in
    /// the nearest motion segment in which it does.
    pub(crate) fn corners_at_any_time(&self, id: u32, t: f32) -> [DVec3; 3] {
        let mesh = self.mesh(id);
        if mesh.keys <= 2 {
            return self.fine_corners(id, t);
        }
        let at = KeyTime::within(t, mesh.keys, mesh.segments_of_life());
        let [a, b] = [at.segment, at.segment + 1].map(|key| self.corners_at_key(id, key));
        core::array::from_fn(|i| at.fine_position(a[i].as_dvec3(), b[i].as_dvec3()))
    }

    /// The corners at time `t` in f32, exactly as queries of closest points compute them.
    #[inline(always)]
    pub(crate) fn corners(&self, id: u32, t: f32) -> [Vec3; 3] {
        let &MeshInfo { keys, stride, .. } = self.mesh(id);
        let [a, b, c] = self.vertices(id);
        // Each by itself: mapped arrays become calls.
        if keys == 1 {
            return [self.position(a, 0), self.position(b, 0), self.position(c, 0)];
        }
        let at = KeyTime::new(t, keys);
        let (first, last) = (at.segment * stride, (at.segment + 1) * stride);
        [
            at.position(self.position(a, first), self.position(a, last)),
            at.position(self.position(b, first), self.position(b, last)),
            at.position(self.position(c, first), self.position(c, last)),
        ]
    }

    /// The corners at a time in f64 (see [`KeyTime::fine_position`]), exactly as ray queries compute them.
    #[inline(always)]
    pub(crate) fn fine_corners(&self, id: u32, t: f32) -> [DVec3; 3] {
        let &MeshInfo { keys, stride, .. } = self.mesh(id);
        let at = KeyTime::new(t, keys);
        let first = at.segment * stride;
        let last = if keys == 1 { first } else { first + stride };
        let fine = |v: u32, offset: usize| self.position(v, offset).as_dvec3();
        self.vertices(id).map(|v| at.fine_position(fine(v, first), fine(v, last)))
    }

    /// The corners at both ends of an interval, up to the signs of zeros.
    #[inline(always)]
    pub(crate) fn ends(&self, id: u32, over: TimeInterval) -> [[Vec3; 3]; 2] {
        let &MeshInfo { keys, stride, .. } = self.mesh(id);
        let [a, b, c] = self.vertices(id);
        let key = |offset: usize| [self.position(a, offset), self.position(b, offset), self.position(c, offset)];
        if keys == 1 {
            return [key(0), key(0)];
        }
        if keys == 2 && over.begin() == 0.0 && over.end() == 1.0 {
            return [key(0), key(stride)];
        }
        let at = |t: f32| {
            let at = KeyTime::new(t, keys);
            let (begin, end) = (at.segment * stride, (at.segment + 1) * stride);
            let between = |v: u32| at.position(self.position(v, begin), self.position(v, end));
            [between(a), between(b), between(c)]
        };
        [at(over.begin()), at(over.end())]
    }

    /// Prefetches the vertices of a triangle at the first two keys.
    #[inline]
    pub(crate) fn prefetch_positions(&self, id: u32) {
        for vertex in self.vertices(id) {
            let at = [vertex as usize, vertex as usize + 1];
            at.into_iter().filter_map(|at| self.vertices.positions.get(at)).for_each(prefetch);
        }
    }

    /// Linear bounds of the vertices in f32.
    fn bounds_in_f32(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let keys = self.keys(id);
        if keys == 1 {
            let bounds = box_of(self.corners_at_key(id, 0));
            return LinearBox3 { begin: bounds, end: bounds };
        }
        if keys > 2 {
            return self.bent_bounds(id, keys, over);
        }
        let [begin, end] = self.ends(id, over);
        let bounds = LinearBox3 { begin: box_of(begin), end: box_of(end) };
        // A part of the shutter lies between both keys; its own ends may be nearer to zero.
        let magnitude = if over == TimeInterval::FULL { bounds.swept().magnitude() } else { self.magnitude(id, over) };
        let slack = Triangles::slack(keys, magnitude);
        LinearBox3 { begin: bounds.begin.pad(slack), end: bounds.end.pad(slack) }
    }
}

/// The number of positions in a cache line of 64 bytes.
const KEYS_IN_LINE: usize = 5;

pub(in crate::primitive) fn box_of(corners: [Vec3; 3]) -> Box3 {
    corners.into_iter().fold(Box3::EMPTY, Box3::include)
}

impl PrimitiveSet for Triangles {
    fn len(&self) -> usize {
        self.len
    }

    fn active(&self, id: u32) -> TimeInterval {
        self.mesh(id).active
    }

    fn always_active(&self) -> bool {
        self.always_active
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        let of = |mesh: &MeshInfo| if mesh.keys > 2 { mesh.active } else { TimeInterval::FULL };
        self.meshes.iter().map(of).collect()
    }

    fn active_intervals(&self) -> Vec<TimeInterval> {
        self.meshes.iter().map(|mesh| mesh.active).collect()
    }

    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let bounds = self.bounds_in_f32(id, over);
        if !self.is_precise(id) {
            return bounds;
        }
        let rounding = self.rounding(id, over);
        LinearBox3 { begin: bounds.begin.pad(rounding), end: bounds.end.pad(rounding) }
    }

    fn lane_bounds(&self, ids: &[u32], over: TimeInterval, out: &mut [LaneBounds]) {
        self.lane_bounds_of_meshes(ids, over, out);
    }

    fn include_bounds(&self, ids: &[u32], over: &mut Intervals<'_>, out: &mut [LinearBox3]) {
        let keys = ids.first().map_or(1, |&id| self.keys(id));
        if keys > 2 && !ids.iter().any(|&id| self.is_precise(id)) {
            return self.include_bent(ids, keys, over, out);
        }
        include_each(self, ids, over, out);
    }

    fn leaf_kind(&self, id: u32) -> u32 {
        match self.keys(id) {
            ..=2 => 0,
            keys => keys as u32,
        }
    }

    /// Blocks of many keys are large if their triangles share vertices but have too many for a block of shared vertices.
    fn fits_block(&self, ids: &[u32]) -> bool {
        let (mut different, mut n) = ([0; 3 * LANES], 0);
        for &id in ids {
            for vertex in self.vertices(id) {
                if !different[..n].contains(&vertex) {
                    different[n] = vertex;
                    n += 1;
                }
            }
            // However many more there are.
            if n > LANES && 4 * n > 9 * ids.len() {
                return true;
            }
        }
        n <= LANES
    }

    fn bent(&self) -> bool {
        self.further_key_bytes() > 0
    }

    fn further_key_bytes(&self) -> usize {
        let of = |mesh: usize| self.ids_of_mesh(mesh).len() * self.meshes[mesh].keys.saturating_sub(2);
        (0..self.meshes.len()).map(of).sum::<usize>() * size_of::<[Vec3; 3]>()
    }

    #[inline(always)]
    fn corner_bounds(&self, id: u32, over: TimeInterval) -> Option<CornerBounds> {
        let keys = self.keys(id);
        let mut bounds = match keys {
            ..=2 => {
                let [begin, end] = self.ends(id, over);
                // Without motion nothing is rounded.
                let slack = if keys == 1 { 0.0 } else { Triangles::slack(keys, self.magnitude(id, over)) };
                CornerBounds::of_lines(begin, end, slack)
            }
            _ => self.tubes_of_corners(id, keys, over),
        };
        bounds.slack += self.rounding(id, over);
        Some(bounds)
    }

    fn prefetch(&self, id: u32) {
        prefetch(&self.vertices.corners[id as usize]);
    }

    fn prefetch_vertices(&self, id: u32, over: TimeInterval) {
        // Of a mesh near the triangle's: to find its own takes as long as waiting for what is prefetched.
        let keys = if self.bent == 0 { 2 } else { self.meshes[self.index.near(id)].keys };
        if keys <= 2 {
            return self.prefetch_positions(id);
        }
        let key = |time: f32| (time * (keys - 1) as f32) as usize;
        let needed = key(over.begin())..(key(over.end()) + 2).min(keys);
        for vertex in self.vertices(id) {
            self.prefetch_keys(vertex, needed.clone());
        }
    }

    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3 {
        clip_triangle(self.corners(id, time), cell)
    }

    fn is_disjoint(&self, id: u32, over: TimeInterval, cell: LinearBox3) -> bool {
        let keys = self.keys(id);
        let at = |t: f32, cell: Box3| Instant { corners: self.corners(id, t), cell };
        if keys == 1 && cell.begin == cell.end {
            return are_disjoint(&[at(0.0, cell.begin)], self.rounding(id, over));
        }
        // Both ends and the keys between.
        let mut instants = [at(over.begin(), cell.begin); INSTANTS];
        let mut n = 1;
        let segments = (keys - 1) as f32;
        for key in inner_keys(over, keys) {
            if n == INSTANTS - 1 {
                return false;
            }
            let t = key as f32 / segments;
            let w = (t - over.begin()) / over.duration();
            instants[n] = at(t, cell.at(w));
            n += 1;
        }
        instants[n] = at(over.end(), cell.end);
        are_disjoint(&instants[..=n], Triangles::slack(keys, self.magnitude(id, over)) + self.rounding(id, over))
    }

    fn mask(&self, id: u32) -> u32 {
        self.mesh(id).mask
    }

    fn masks(&self) -> Vec<u32> {
        // Empty meshes count as well, which does no harm.
        self.meshes.iter().map(|mesh| mesh.mask).collect()
    }

    fn positions(&self) -> [usize; 2] {
        self.counts
    }

    #[inline]
    fn mesh_and_primitive(&self, id: u32) -> (u32, u32) {
        // Called for each hit; for a single mesh no lookup is needed.
        let mesh = if self.meshes.len() == 1 { 0 } else { self.mesh_of(id) };
        (mesh as u32, id - self.meshes[mesh].first)
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn bytes(&self) -> usize {
        self.vertices.positions.capacity() * size_of::<Vec3>()
            + self.vertices.corners.capacity() * size_of::<[u32; 3]>()
            + self.precise.bytes()
            + self.meshes.capacity() * size_of::<MeshInfo>()
            + self.index.bytes()
            + self.extents.capacity() * size_of::<MeshExtent>()
    }
}

/// The keys strictly inside an interval (and perhaps one at its end).
fn inner_keys(over: TimeInterval, keys: usize) -> Range<usize> {
    let segments = (keys - 1) as f32;
    let first = (over.begin() * segments).floor() as usize + 1;
    first..((over.end() * segments).ceil() as usize).min(keys - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::TriangleMesh;
    use crate::random::Random;

    #[test]
    fn bounds_hold_the_kernels_corners_at_every_time() {
        let mut random = Random(11);
        for keys in [1usize, 2, 3, 4, 9] {
            let positions = (0..keys)
                .map(|_| (0..3).map(|_| Vec3::new(random.unit(), random.unit(), random.unit())).collect())
                .collect::<Vec<Vec<Vec3>>>();
            let set = Triangles::new(&[TriangleMesh::new(vec![[0, 1, 2]], positions)]).unwrap();
            for _ in 0..200 {
                let (a, b) = (random.unit(), random.unit());
                let over = TimeInterval::half_open(a.min(b), a.max(b) + 1e-3).unwrap();
                let bounds = set.bounds(0, over);
                for i in 0..=64 {
                    let t = over.begin() + over.duration() * (i as f32 / 64.0);
                    let w = (t - over.begin()) / over.duration();
                    let now = bounds.at(w.clamp(0.0, 1.0));
                    for p in set.corners(0, t.min(over.end())) {
                        assert!(p.cmpge(now.min).all() && p.cmple(now.max).all(), "{keys} keys, {over:?}, t {t}");
                    }
                }
            }
        }
    }

    #[test]
    fn equal_keys_are_one_key_and_ids_count_through_the_meshes() {
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let still = TriangleMesh::new(vec![[0, 1, 2]; 3], vec![corners.clone(), corners.clone()]);
        let empty = TriangleMesh::fixed(vec![], vec![]);
        let moved = TriangleMesh::new(vec![[0, 1, 2]; 2], vec![corners.clone(), vec![Vec3::ONE; 3]]);
        let set = Triangles::new(&[still, empty, moved]).unwrap();
        assert_eq!((set.len(), set.keys(2), set.keys(3)), (5, 1, 2));
        assert_eq!(
            (set.mesh_and_primitive(2), set.mesh_and_primitive(3), set.mesh_and_primitive(4)),
            ((0, 2), (2, 0), (2, 1))
        );
        // Meshes that begin and end anywhere, many of them in a block, with empty ones before, between and behind.
        let mut random = Random(3);
        let meshes: Vec<TriangleMesh> = (0..200)
            .map(|i| {
                let most = if i % 50 < 30 { 4 } else { 90 };
                let n = (random.unit() * most as f32) as usize;
                let n = if i % 7 == 0 || i > 195 { 0 } else { n };
                TriangleMesh::fixed(vec![[0, 1, 2]; n], corners.clone())
            })
            .collect();
        let set = Triangles::new(&meshes).unwrap();
        let pairs = meshes.iter().enumerate().flat_map(|(i, mesh)| (0..mesh.len()).map(move |t| (i as u32, t as u32)));
        assert!(pairs.eq((0..set.len() as u32).map(|id| set.mesh_and_primitive(id))));
    }
}
