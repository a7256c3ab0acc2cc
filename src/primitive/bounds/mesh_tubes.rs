//! Bounds of most triangles of a mesh with more than two keys: the tube of each vertex is computed once, from vertices in the
//! order of memory.

use super::bent_bounds::TUBE_ULPS;
use super::keys_of_vertices::KeysOfVertices;
use super::tubes::lanes_of_faces;
use crate::geometry::{LaneBounds, TimeInterval, ULP};
use crate::parallel;
use crate::primitive::key_window::Window;
use crate::primitive::triangles::triangle_set::Triangles;
use crate::primitive::vertex_tubes::{MeshTubes, SIZE, VertexTubes};
use crate::simd::{Kernel, LANES, Mask, Simd, SimdLevel, dispatch, huge_vec_of};

/// Vertices whose tubes are computed by one thread.
const TOGETHER: usize = 32 * LANES;

impl Triangles {
    /// The tubes of meshes of which there are at least as many triangles among `ids`, in ascending order, as vertices.
    pub(in crate::primitive) fn tubes_of_meshes(&self, mut ids: &[u32], over: TimeInterval) -> VertexTubes {
        let mut all = VertexTubes::default();
        while let Some(&id) = ids.first() {
            let mesh = self.mesh_of(id);
            let end = self.ids_of_mesh(mesh).end;
            let own;
            (own, ids) = ids.split_at(ids.partition_point(|&id| id < end));
            let keys = self.meshes[mesh].keys;
            if keys <= 2 || self.meshes[mesh].precise.is_some() {
                continue;
            }
            let vertices = own.iter().flat_map(|&id| self.vertices(id));
            let (first, last) = vertices.fold((u32::MAX, 0), |(first, last), v| (first.min(v), last.max(v)));
            let count = (last - first) as usize / keys + 1;
            if count <= own.len() {
                let tubes = self.tubes_of(first, count, keys, over, SimdLevel::best());
                all.0.push(MeshTubes { mesh, first, apart: keys as u32, tubes });
            }
        }
        all
    }

    /// The tubes of `count` successive vertices.
    fn tubes_of(&self, first: u32, count: usize, keys: usize, over: TimeInterval, level: SimdLevel) -> Vec<LaneBounds> {
        let window = &Window::new(over, keys);
        let mut tubes = huge_vec_of(LaneBounds::EMPTY, count);
        let mut parts: Vec<_> = (0..).step_by(TOGETHER).zip(tubes.chunks_mut(TOGETHER)).collect();
        parallel::each(&mut parts, |(before, tubes)| {
            let mut memory = Vec::new();
            let mut of = KeysOfVertices::new(self.coordinates(), window.around.clone(), &mut memory);
            for (i, tubes) in (*before..).step_by(LANES).zip(tubes.chunks_mut(LANES)) {
                let mut vertices = [0; 2 * LANES];
                for (i, vertex) in (i..count).zip(&mut vertices) {
                    *vertex = first + (i * keys) as u32;
                }
                of.set(&vertices[..tubes.len()]);
                // Those of the next step.
                for &vertex in &vertices[LANES..] {
                    self.prefetch_keys(vertex, of.keys());
                }
                dispatch(level, WriteTubes { of: &mut of, window, tubes });
            }
        });
        tubes
    }

    /// The bounds of triangles of such a mesh, which has `keys` keys.
    pub(in crate::primitive) fn bounds_of_tubes(
        &self,
        ids: &[u32],
        keys: usize,
        of: &MeshTubes,
        out: &mut [LaneBounds],
    ) {
        dispatch(SimdLevel::best(), WriteBounds { set: self, ids, of, slack: Triangles::slack(keys, 1.0), out });
    }
}

/// Writes the tubes of sixteen vertices.
struct WriteTubes<'a, 'b> {
    of: &'a mut KeysOfVertices<'b>,
    window: &'a Window,
    tubes: &'a mut [LaneBounds],
}

impl Kernel for WriteTubes<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let WriteTubes { of, window, tubes } = self;
        let all = of.transposed(s).tubes(s, window, 0);
        for (to, &tube) in tubes.iter_mut().zip(&lanes_of_faces(s, &all.faces(), all.size)) {
            s.store(tube, &mut to.0);
        }
    }
}

/// Writes the bounds of triangles.
struct WriteBounds<'a> {
    set: &'a Triangles,
    ids: &'a [u32],
    of: &'a MeshTubes,
    /// The slack of vertices, per magnitude.
    slack: f32,
    out: &'a mut [LaneBounds],
}

/// The lanes of faces, at the begin and the end of the interval.
const FACES: Mask = 0x7777;

impl Kernel for WriteBounds<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let WriteBounds { set, ids, of, slack, out } = self;
        for (&id, to) in ids.iter().zip(out) {
            let [a, b, c] = set.vertices(id);
            let [a, b, c] = [s.load(&of.of(a).0), s.load(&of.of(b).0), s.load(&of.of(c).0)];
            let least = s.min(s.min(a, b), c);
            let size = -s.lane(least, SIZE);
            let pad = size * slack * 2.0 + size * (TUBE_ULPS * ULP);
            let bounds = least - s.splat(pad);
            s.store(bounds, &mut to.0);
            if s.eq(bounds, s.swap_lanes::<4>(bounds)) & FACES == FACES {
                // As for single triangles: a motion that returns to its begin is a motion nevertheless.
                to.0[12] = -(-to.0[12]).next_up();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{PrimitiveSet, TriangleMesh};
    use crate::random::Random;
    use glam::Vec3;

    #[test]
    fn triangles_of_a_mesh_have_their_bounds_on_all_instruction_sets() {
        let mut random = Random(17);
        for (keys, vertices) in [(3, 300), (4, 17), (9, 33), (65, 1000)] {
            let at: Vec<Vec3> = (0..vertices).map(|_| random.vec() * 2.0).collect();
            let mut key = |_| {
                let moved = |(i, &p): (usize, &Vec3)| if i % 40 < 8 { p } else { p + random.vec() * 0.1 };
                at.iter().enumerate().map(moved).collect()
            };
            let positions = (0..keys).map(&mut key).collect::<Vec<Vec<Vec3>>>();
            let indices = (0..2 * vertices as u32).map(|i| [0, 7, 13].map(|d| (i + d) % vertices as u32)).collect();
            let mesh = TriangleMesh::new(indices, positions);
            // The last one is the end of the array.
            let set = Triangles::new(&[mesh.clone(), mesh]).expect("meshes");
            let ids: Vec<u32> = (0..set.len() as u32).collect();
            for over in [(0.0, 2.0), (0.0, 0.26), (0.2499, 0.5), (0.71, 0.72), (0.9, 2.0)] {
                let over = TimeInterval::half_open(over.0, over.1).expect("not empty");
                let tubes = set.tubes_of_meshes(&ids, over);
                assert_eq!(tubes.0.len(), 2);
                for of in &tubes.0 {
                    for level in SimdLevel::available() {
                        let again = set.tubes_of(of.first, vertices, keys, over, level);
                        let same =
                            |(a, b): (&LaneBounds, &LaneBounds)| a.bounds() == b.bounds() && a.0[SIZE] == b.0[SIZE];
                        assert!(of.tubes.len() == vertices && of.tubes.iter().zip(&again).all(same), "{keys}, {level}");
                        let own: Vec<u32> = ids.iter().copied().filter(|&id| set.mesh_of(id) == of.mesh).collect();
                        let mut out = vec![LaneBounds::EMPTY; own.len()];
                        let slack = Triangles::slack(keys, 1.0);
                        dispatch(level, WriteBounds { set: &set, ids: &own, of, slack, out: &mut out });
                        for (&id, found) in own.iter().zip(&out) {
                            assert_eq!(found.bounds(), set.bounds(id, over), "{keys} keys, {over:?}, {id}, {level}");
                        }
                    }
                }
            }
            assert!(set.tubes_of_meshes(&ids[..vertices / 2], TimeInterval::FULL).0.is_empty());
        }
    }
}
