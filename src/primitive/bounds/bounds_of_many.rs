//! Bounds of many triangles, fast: the coarse build of a lazy tree spends most of its time on them, and builds over many time
//! slices a tenth.

use crate::geometry::{KeyTime, LaneBounds, TimeInterval};
use crate::primitive::key_window::Intervals;
use crate::primitive::mesh::mesh_index::MeshInfo;
use crate::primitive::primitive_set::PrimitiveSet;
use crate::primitive::triangles::triangle_set::Triangles;
use glam::Vec4;

impl Triangles {
    /// `PrimitiveSet::lane_bounds`: mesh by mesh.
    pub(in crate::primitive) fn lane_bounds_of_meshes(
        &self,
        mut ids: &[u32],
        over: TimeInterval,
        mut out: &mut [LaneBounds],
    ) {
        while let Some(&first) = ids.first() {
            let mesh = self.mesh_of(first);
            let end = self.meshes.get(mesh + 1).map_or(self.len as u32, |next| next.first);
            // Mostly all of them are of one mesh.
            let own = match ids.last() {
                Some(&last) if last < end => ids.len(),
                _ => ids.partition_point(|&id| id < end),
            };
            let of_mesh;
            (of_mesh, ids) = ids.split_at(own);
            let to;
            (to, out) = out.split_at_mut(own);
            self.lane_bounds_in_mesh(&self.meshes[mesh], of_mesh, over, to);
        }
    }

    fn lane_bounds_in_mesh(&self, mesh: &MeshInfo, ids: &[u32], over: TimeInterval, out: &mut [LaneBounds]) {
        if mesh.keys > 2 && mesh.precise.is_none() {
            return self.bent_lane_bounds(ids, mesh.keys, &mut Intervals::new(&[over]), out);
        }
        if mesh.precise.is_some() {
            for (&id, to) in ids.iter().zip(out) {
                *to = LaneBounds::of(&self.bounds(id, over));
            }
            return;
        }
        if mesh.keys == 1 {
            for (&id, to) in ids.iter().zip(out) {
                let [low, high] = self.extremes(self.vertices(id), 0);
                *to = LaneBounds::new([low; 2], [high; 2]);
            }
            return;
        }
        if over != TimeInterval::FULL {
            return self.lane_bounds_over(mesh.stride, ids, over, out);
        }
        for (&id, to) in ids.iter().zip(out) {
            let corners = self.vertices(id);
            let ([low, high], [low_end, high_end]) = (self.extremes(corners, 0), self.extremes(corners, mesh.stride));
            let magnitude = -low.min(low_end).min(high.min(high_end));
            let slack = Triangles::slack(2, magnitude.x.max(magnitude.y).max(magnitude.z));
            *to = LaneBounds::new([low - slack, low_end - slack], [high - slack, high_end - slack]);
        }
    }

    /// The bounds of triangles of a mesh with two keys, `stride` apart, over a part of the shutter.
    fn lane_bounds_over(&self, stride: usize, ids: &[u32], over: TimeInterval, out: &mut [LaneBounds]) {
        let [begin, end] = [over.begin(), over.end()].map(|t| KeyTime::new(t, 2));
        for (&id, to) in ids.iter().zip(out) {
            let (mut low, mut high) = ([Vec4::INFINITY; 2], [Vec4::NEG_INFINITY; 2]);
            let mut magnitude = Vec4::ZERO;
            for vertex in self.vertices(id) {
                let (first, last) = (self.lanes_of(vertex, 0), self.lanes_of(vertex, stride));
                magnitude = magnitude.max(first.abs()).max(last.abs());
                let (first, last) = (begin.position_of_lanes(first, last), end.position_of_lanes(first, last));
                (low[0], high[0]) = (low[0].min(first), high[0].max(first));
                (low[1], high[1]) = (low[1].min(last), high[1].max(last));
            }
            let slack = Triangles::slack(2, magnitude.truncate().max_element());
            *to = LaneBounds::new([low[0] - slack, low[1] - slack], [-high[0] - slack, -high[1] - slack]);
        }
    }

    /// The least coordinates of three vertices, `offset` behind their first keys, and the least negated ones.
    #[inline(always)]
    fn extremes(&self, [a, b, c]: [u32; 3], offset: usize) -> [Vec4; 2] {
        let [a, b, c] = [self.lanes_of(a, offset), self.lanes_of(b, offset), self.lanes_of(c, offset)];
        [a.min(b).min(c), -a.max(b).max(c)]
    }

    /// A position; the last lane is any finite number.
    #[inline(always)]
    fn lanes_of(&self, vertex: u32, offset: usize) -> Vec4 {
        let at = 3 * (vertex as usize + offset);
        match self.coordinates().get(at..at + 4) {
            Some(lanes) => Vec4::from_slice(lanes),
            None => self.position(vertex, offset).extend(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::TriangleMesh;
    use crate::random::Random;
    use crate::time::time_slice;
    use glam::Vec3;

    #[test]
    fn lane_bounds_are_the_bounds_over_the_whole_shutter_and_parts_of_it() {
        let mut random = Random(11);
        let mut mesh = |keys: usize, triangles: usize| {
            let mut key = || (0..20).map(|_| random.vec()).collect::<Vec<Vec3>>();
            let keys: Vec<Vec<Vec3>> = (0..keys).map(|_| key()).collect();
            let mut index = || (random.unit() * 20.0) as u32 % 20;
            // The last vertex, behind which there is no other coordinate.
            let last = [0, 1, 19];
            let indices = (0..triangles).map(|_| [index(), index(), index()]).chain([last]).collect();
            TriangleMesh::new(indices, keys)
        };
        let precise = |mesh: TriangleMesh| {
            let in_f64 = |key: usize| (0..20).map(|v| mesh.keys.position(key, v)).collect();
            let keys: Vec<Vec<glam::DVec3>> = (0..mesh.keys.len()).map(in_f64).collect();
            TriangleMesh::new(mesh.indices.clone(), keys).precise()
        };
        let meshes = [mesh(2, 40), mesh(1, 3), mesh(1, 0), mesh(5, 30), precise(mesh(2, 9)), mesh(1, 70), mesh(2, 33)];
        let set = Triangles::new(&meshes).unwrap();
        for (first, step) in [(0, 1), (1, 1), (39, 1), (41, 1), (77, 1), (3, 7)] {
            let ids: Vec<u32> = (first..set.len() as u32).step_by(step).collect();
            for over in [TimeInterval::FULL, time_slice(0, 4), time_slice(2, 4), time_slice(15, 16)] {
                let mut out = vec![LaneBounds::EMPTY; ids.len()];
                set.lane_bounds(&ids, over, &mut out);
                for (&id, of) in ids.iter().zip(out) {
                    assert_eq!(of.bounds(), set.bounds(id, over), "{id}, {over:?}");
                }
            }
        }
    }
}
