//! Bounds of many triangles with more than two keys, sixteen at once.
//!
//! The keys of up to sixteen vertices are transposed into rows, of which [`super::tubes`] makes the bounds of the triangles
//! between these vertices, over any number of intervals.

use super::shared_vertices::Shared;
use super::triangles::Triangles;
use super::tubes::{RowsOfKeys, bounds_of_faces};
use super::window::{Intervals, Window};
use crate::geometry::{LaneBounds, LinearBox3};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch, greatest_of_each, lanes_at, transpose};
use core::ops::Range;

impl Triangles {
    /// The bounds of triangles of one mesh with `keys` keys, more than two, over a single interval.
    pub(super) fn bent_lane_bounds(&self, ids: &[u32], keys: usize, over: &mut Intervals<'_>, out: &mut [LaneBounds]) {
        self.in_groups(ids, keys, over, |level, group, done| {
            dispatch(level, Each { window: &group.windows[0], out: &mut out[done..done + group.count], group });
        });
    }

    /// Extends `out` by the bounds of triangles with `keys` keys, more than two: one element for each interval.
    pub(super) fn include_bent(&self, ids: &[u32], keys: usize, over: &mut Intervals<'_>, out: &mut [LinearBox3]) {
        self.in_groups(ids, keys, over, |level, group, _| dispatch(level, Together { group, out }));
    }

    /// Calls `f` with groups of triangles and the number of those before.
    fn in_groups(
        &self,
        mut ids: &[u32],
        keys: usize,
        over: &mut Intervals<'_>,
        mut f: impl FnMut(SimdLevel, Group<'_>, usize),
    ) {
        let level = SimdLevel::best();
        let slack = Triangles::slack(keys, 1.0);
        let (windows, rows) = over.windows(keys);
        let first = windows.iter().map(|window| *window.around.start()).min().unwrap_or(0);
        let last = windows.iter().map(|window| *window.around.end()).max().unwrap_or(0);
        // The transpose writes whole groups of rows.
        let needed = (3 * (last + 1 - first)).next_multiple_of(LANES) * LANES;
        if rows.len() < needed {
            rows.resize(needed, 0.0);
        }
        let mut done = 0;
        while !ids.is_empty() {
            let (Shared { vertices, count: of_vertices, mut corners, .. }, count) = Shared::of_first(self, ids);
            // Other lanes repeat the first one, so that they change nothing.
            let mut begins = [3 * (vertices[0] as usize + first); LANES];
            for (begin, &vertex) in begins.iter_mut().zip(&vertices[..of_vertices]) {
                *begin = 3 * (vertex as usize + first);
            }
            let one = corners[0];
            corners[count..].fill(one);
            // The vertices of most of the next group.
            for &id in ids[count..].iter().take(count) {
                self.vertices(id).into_iter().for_each(|vertex| self.prefetch_keys(vertex, first..last + 1));
            }
            let coordinates = self.coordinates();
            let keys = first..last + 1;
            f(
                level,
                Group { coordinates, begins, keys, corners, count, windows, slack, rows: &mut rows[..needed] },
                done,
            );
            done += count;
            ids = &ids[count..];
        }
    }
}

/// Up to sixteen triangles between up to sixteen vertices.
struct Group<'a> {
    coordinates: &'a [f32],
    /// The first needed coordinate of each vertex.
    begins: Lanes<usize>,
    /// The keys that are needed.
    keys: Range<usize>,
    /// The lanes of the corners of each triangle, four bits each.
    corners: Lanes<u32>,
    /// Number of triangles.
    count: usize,
    windows: &'a [Window],
    /// The slack of vertices, per magnitude.
    slack: f32,
    rows: &'a mut [f32],
}

impl Group<'_> {
    /// The coordinates of the vertices in rows.
    #[inline(always)]
    fn transposed<S: Simd>(&mut self, s: S) -> RowsOfKeys<'_> {
        for (first, rows) in (0..).step_by(LANES).zip(self.rows.as_chunks_mut::<{ LANES * LANES }>().0) {
            // Loops, since mapped arrays become calls.
            let mut all = [s.splat(0.0); LANES];
            for (of_vertex, begin) in all.iter_mut().zip(self.begins) {
                *of_vertex = s.load(&lanes_from(self.coordinates, begin + first));
            }
            for (&row, to) in transpose(s, all).iter().zip(rows.as_chunks_mut().0) {
                s.store(row, to);
            }
        }
        RowsOfKeys { words: self.rows, first: self.keys.start, keys: self.keys.len(), width: LANES, rows: 3 }
    }
}

/// Sixteen numbers from an index, or as many as there are, and zeros.
#[inline(always)]
fn lanes_from(from: &[f32], at: usize) -> Lanes<f32> {
    if at + LANES <= from.len() {
        return *lanes_at(from, at);
    }
    let mut lanes = [0.0; LANES];
    for (lane, &x) in lanes.iter_mut().zip(from.get(at..).unwrap_or_default()) {
        *lane = x;
    }
    lanes
}

/// The faces of the triangles of a group over an interval.
#[inline(always)]
fn faces<S: Simd>(s: S, rows: &RowsOfKeys<'_>, window: &Window, corners: S::U, slack: f32) -> [S::F; 12] {
    let triangles = rows.tubes(s, window, 0).of_triangles(s, corners);
    triangles.padded(s, triangles.size, slack, Mask::MAX)
}

/// Writes the bounds of each triangle.
struct Each<'a> {
    group: Group<'a>,
    window: &'a Window,
    out: &'a mut [LaneBounds],
}

impl Kernel for Each<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Each { mut group, window, out } = self;
        let (corners, slack) = (s.load_u(&group.corners), group.slack);
        let rows = group.transposed(s);
        let faces = faces(s, &rows, window, corners, slack);
        let zero = s.splat(0.0);
        let mut all = [zero; LANES];
        for axis in 0..3 {
            all[axis] = zero - faces[axis];
            all[4 + axis] = zero - faces[6 + axis];
            all[8 + axis] = zero - faces[3 + axis];
            all[12 + axis] = zero - faces[9 + axis];
        }
        let all = transpose(s, all);
        for (to, &bounds) in out.iter_mut().zip(&all) {
            s.store(bounds, &mut to.0);
        }
    }
}

/// Extends bounds over each of the intervals by those of the triangles.
struct Together<'a, 'b> {
    group: Group<'a>,
    out: &'b mut [LinearBox3],
}

impl Kernel for Together<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Together { mut group, out } = self;
        let (corners, slack, windows) = (s.load_u(&group.corners), group.slack, group.windows);
        let rows = group.transposed(s);
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
