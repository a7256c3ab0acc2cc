//! The points of the candidates, of which four are evaluated side by side.

use super::coordinate::SweptCoordinate;
use crate::geometry::TimeInterval;
use crate::point::layout::over_interval::{PathRows, PointPath};
use crate::simd::{LANES, Simd};

/// Points that are evaluated side by side.
pub(super) const WIDTH: usize = 4;

/// A point that may be met, between two keys.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct PointKeys<C> {
    /// Where it is at both keys.
    keys: [C; 6],
    id: u32,
}

/// Points that may be met.
#[derive(Default)]
pub(super) struct CandidatePoints<C> {
    points: Vec<PointKeys<C>>,
    /// Begin and end bound of their active intervals; empty if all points exist throughout.
    active: Vec<[f32; 2]>,
}

impl<C: SweptCoordinate> CandidatePoints<C> {
    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.active.clear();
    }

    /// Appends sixteen points; unless `has_active_intervals`, they exist throughout.
    #[inline(always)]
    pub(super) fn push(&mut self, points: &PathRows<C>, has_active_intervals: bool) {
        let PathRows { open: [x, y, z], close: [u, v, w], begin, end, id } = points;
        let keys = |i: usize| PointKeys { keys: [x[i], y[i], z[i], u[i], v[i], w[i]], id: id[i] };
        let all: [PointKeys<C>; LANES] = core::array::from_fn(keys);
        self.points.extend_from_slice(&all);
        if has_active_intervals {
            self.active.extend((0..LANES).map(|i| [begin[i], end[i]]));
        }
    }

    /// Four of them.
    #[inline(always)]
    pub(super) fn four(&self, at: [u32; WIDTH]) -> FourPoints<'_, C> {
        let [a, b, c, d] = at;
        let point = |i: u32| &self.points[i as usize];
        FourPoints { points: [point(a), point(b), point(c), point(d)], others: self, at }
    }
}

/// Four candidate points.
pub(super) struct FourPoints<'a, C> {
    points: [&'a PointKeys<C>; WIDTH],
    others: &'a CandidatePoints<C>,
    at: [u32; WIDTH],
}

impl<C: SweptCoordinate> FourPoints<'_, C> {
    #[inline(always)]
    pub(super) fn ids(&self) -> [u32; WIDTH] {
        [self.points[0].id, self.points[1].id, self.points[2].id, self.points[3].id]
    }

    /// Where they are at both keys.
    #[inline(always)]
    pub(super) fn ends<S: Simd>(&self, s: S) -> [[S::D; 3]; 2] {
        let [a, b, c, d] = &self.points;
        let (a, b, c, d) = (&a.keys, &b.keys, &c.keys, &d.keys);
        let [x, y, z, u] = s.transpose_d([
            C::load_four(s, &[a[0], a[1], a[2], a[3]]),
            C::load_four(s, &[b[0], b[1], b[2], b[3]]),
            C::load_four(s, &[c[0], c[1], c[2], c[3]]),
            C::load_four(s, &[d[0], d[1], d[2], d[3]]),
        ]);
        let [_, _, v, w] = s.transpose_d([
            C::load_four(s, &[a[2], a[3], a[4], a[5]]),
            C::load_four(s, &[b[2], b[3], b[4], b[5]]),
            C::load_four(s, &[c[2], c[3], c[4], c[5]]),
            C::load_four(s, &[d[2], d[3], d[4], d[5]]),
        ]);
        [[x, y, z], [u, v, w]]
    }

    /// Begins and end bounds of their active intervals.
    #[inline(always)]
    pub(super) fn active(&self) -> [[f32; WIDTH]; 2] {
        let (mut begins, mut ends) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (lane, &i) in self.at.iter().enumerate() {
            [begins[lane], ends[lane]] = self.others.active[i as usize];
        }
        [begins, ends]
    }

    /// One of the points.
    pub(super) fn point_path(&self, lane: usize) -> PointPath {
        let PointKeys { keys: [x, y, z, u, v, w], id } = *self.points[lane];
        let active = self.others.active.get(self.at[lane] as usize);
        let active = active.and_then(|&[begin, end]| TimeInterval::half_open(begin, end)).unwrap_or(TimeInterval::FULL);
        PointPath { id, open: [x, y, z].map(C::into), close: [u, v, w].map(C::into), active }
    }
}
