//! Bounds of many triangles with more than two keys, sixteen at once.
//!
//! The keys of up to sixteen vertices are transposed into rows, of which [`super::tubes`] makes the bounds of the triangles
//! between these vertices, over any number of intervals.

use super::keys_of_vertices::KeysOfVertices;
use super::shared_vertices::Shared;
use super::tubes::{RowsOfKeys, bounds_of_faces, lanes_of_faces};
use crate::geometry::{LaneBounds, LinearBox3};
use crate::primitive::key_window::{Intervals, Window};
use crate::primitive::triangles::triangle_set::Triangles;
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch, greatest_of_each};
use core::ops::Range;

impl Triangles {
    /// The bounds of triangles of one mesh with `keys` keys, more than two, over a single interval.
    pub(in crate::primitive) fn bent_lane_bounds(
        &self,
        ids: &[u32],
        keys: usize,
        over: &mut Intervals<'_>,
        out: &mut [LaneBounds],
    ) {
        self.in_groups(ids, keys, over, |level, group, of| dispatch(level, Each { group, out: &mut out[of] }));
    }

    /// Extends `out` by the bounds of triangles with `keys` keys, more than two: one element for each interval.
    pub(in crate::primitive) fn include_bent(
        &self,
        ids: &[u32],
        keys: usize,
        over: &mut Intervals<'_>,
        out: &mut [LinearBox3],
    ) {
        self.in_groups(ids, keys, over, |level, group, _| dispatch(level, Together { group, out }));
    }

    /// Calls `f` with groups of triangles and their places.
    fn in_groups(
        &self,
        mut ids: &[u32],
        keys: usize,
        over: &mut Intervals<'_>,
        mut f: impl FnMut(SimdLevel, Group<'_, '_>, Range<usize>),
    ) {
        let level = over.level;
        let slack = Triangles::slack(keys, 1.0);
        let (windows, memory) = over.windows(keys);
        let first = windows.iter().map(|window| *window.around.start()).min().unwrap_or(0);
        let last = windows.iter().map(|window| *window.around.end()).max().unwrap_or(0);
        let mut of = KeysOfVertices::new(self.coordinates(), first..=last, memory);
        let mut done = 0;
        let mut next = Shared::of_first(self, ids);
        while !ids.is_empty() {
            let (Shared { vertices, count: of_vertices, mut corners, .. }, count) = next;
            ids = &ids[count..];
            next = Shared::of_first(self, ids);
            for &vertex in &next.0.vertices[..next.0.count] {
                self.prefetch_keys(vertex, of.keys());
            }
            of.set(&vertices[..of_vertices]);
            // Other lanes repeat the first triangle, so that they change nothing.
            let first = corners[0];
            corners[count..].fill(first);
            f(level, Group { of: &mut of, corners, windows, slack }, done..done + count);
            done += count;
        }
    }
}

/// Up to sixteen triangles between up to sixteen vertices.
struct Group<'a, 'b> {
    of: &'a mut KeysOfVertices<'b>,
    /// The lanes of the corners of each triangle, four bits each.
    corners: Lanes<u32>,
    windows: &'a [Window],
    /// The slack of vertices, per magnitude.
    slack: f32,
}

/// The faces of the triangles of a group over an interval.
#[inline(always)]
fn faces<S: Simd>(s: S, rows: &RowsOfKeys<'_>, window: &Window, corners: S::U, slack: f32) -> [S::F; 12] {
    let triangles = rows.tubes(s, window, 0).of_triangles(s, corners);
    triangles.padded(s, triangles.size, slack, Mask::MAX)
}

/// Writes the bounds of each triangle over the first interval.
struct Each<'a, 'b, 'c> {
    group: Group<'a, 'b>,
    out: &'c mut [LaneBounds],
}

impl Kernel for Each<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Each { group: Group { of, corners, windows, slack }, out } = self;
        let rows = of.transposed(s);
        let faces = faces(s, &rows, &windows[0], s.load_u(&corners), slack);
        for (to, &bounds) in out.iter_mut().zip(&lanes_of_faces(s, &faces)) {
            s.store(bounds, &mut to.0);
        }
    }
}

/// Extends bounds over each of the intervals by those of the triangles.
struct Together<'a, 'b, 'c> {
    group: Group<'a, 'b>,
    out: &'c mut [LinearBox3],
}

impl Kernel for Together<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Together { group: Group { of, corners, windows, slack }, out } = self;
        let (corners, rows) = (s.load_u(&corners), of.transposed(s));
        for (window, to) in windows.iter().zip(out) {
            let faces = faces(s, &rows, window, corners, slack);
            let mut all = [faces[0]; LANES];
            all[..12].copy_from_slice(&faces);
            let mut greatest = [0.0; LANES];
            s.store(greatest_of_each(s, all), &mut greatest);
            *to = to.union(bounds_of_faces(&greatest));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::primitive::{PrimitiveSet, TriangleMesh};
    use crate::random::Random;
    use glam::Vec3;

    /// A strip and single triangles of random vertices, some of which stand still, and a mesh behind which there is nothing.
    fn meshes(keys: usize, random: &mut Random) -> [TriangleMesh; 3] {
        let mut mesh = |indices: Vec<[u32; 3]>| {
            let vertices = indices.as_flattened().iter().max().map_or(0, |&most| most as usize + 1);
            let mut place = |scale: f32| (0..vertices).map(|_| random.vec() * scale).collect::<Vec<Vec3>>();
            let at = place(2.0);
            let still = |vertex: usize| (8..16).contains(&(vertex % 40));
            let key = |_| {
                let offsets = place(0.1);
                (0..vertices).map(|v| if still(v) { at[v] } else { at[v] + offsets[v] }).collect()
            };
            TriangleMesh::new(indices, (0..keys).map(key).collect::<Vec<Vec<Vec3>>>())
        };
        let strip = (0..70).map(|i| [i, i + 1, i + 2]).collect();
        let single = (0..50).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        // A vertex may occur twice in a triangle.
        [mesh(strip), mesh(single), mesh(vec![[0, 1, 2], [2, 1, 1]])]
    }

    #[test]
    fn groups_have_the_bounds_of_their_triangles_on_all_instruction_sets() {
        let mut random = Random(41);
        for keys in [3, 4, 5, 9, 18, 65] {
            let set = Triangles::new(&meshes(keys, &mut random)).expect("meshes");
            let ids: Vec<u32> = (0..set.len() as u32).collect();
            let part = |a: f32, b: f32| TimeInterval::half_open(a, b).expect("not empty");
            let over = [TimeInterval::FULL, part(0.0, 0.26), part(0.2499, 0.5), part(0.71, 0.72), part(0.9, 2.0)];
            for level in SimdLevel::available() {
                for &over in &over {
                    let mut out = vec![LaneBounds::EMPTY; ids.len()];
                    let mut intervals = Intervals::new(core::slice::from_ref(&over));
                    intervals.level = level;
                    set.bent_lane_bounds(&ids, keys, &mut intervals, &mut out);
                    for (&id, found) in ids.iter().zip(&out) {
                        assert_eq!(found.bounds(), set.bounds(id, over), "{keys} keys, {over:?}, {id}, {level}");
                    }
                }
                let mut intervals = Intervals::new(&over);
                intervals.level = level;
                for some in ids.chunks(13) {
                    let mut out = [LinearBox3::EMPTY; 5];
                    set.include_bent(some, keys, &mut intervals, &mut out);
                    for (&over, found) in over.iter().zip(out) {
                        let all = some.iter().map(|&id| set.bounds(id, over));
                        let all = all.fold(LinearBox3::EMPTY, LinearBox3::union);
                        assert_eq!(found, all, "{keys} keys, {over:?}, {some:?}, {level}");
                    }
                }
            }
        }
    }
}
