//! Bounds of sixteen triangles with many keys at once: the computation of [`super::bent_bounds`] in lanes.
//!
//! The numbers are the same, bit for bit (but for the signs of zeros): the same operations on the same operands, and the
//! greatest of some numbers is the same in any order. Lower bounds are negated throughout, so that all results are maxima.
//! The tube of a vertex that several triangles share is computed once.

use super::bent_bounds::TUBE_ULPS;
use crate::geometry::{Box3, KeyTime, LinearBox3, ULP};
use crate::primitive::key_window::Window;
use crate::simd::{LANES, Lanes, Mask, Rows, Simd, transpose};
use glam::Vec3;

/// The greatest of the values at the three corners of each triangle.
#[inline(always)]
fn greatest_corner<S: Simd>(s: S, vertices: S::F, corners: S::U) -> S::F {
    let [a, b, c] = at_corners(s, vertices, corners);
    s.max(s.max(a, b), c)
}

/// Bounds in lanes: for each axis the negated lower one, and the upper one.
pub(crate) type FaceLanes<S> = [[<S as Simd>::F; 2]; 3];

/// The values of vertices at the three corners of each triangle, whose lanes have four bits each.
#[inline(always)]
pub(crate) fn at_corners<S: Simd>(s: S, vertices: S::F, corners: S::U) -> [S::F; 3] {
    [
        s.permute(vertices, corners),
        s.permute(vertices, s.shift_right::<4>(corners)),
        s.permute(vertices, s.shift_right::<8>(corners)),
    ]
}

/// Rows of coordinates at successive keys: of vertices (three for each key), or of corners (nine).
#[derive(Clone, Copy)]
pub(crate) struct RowsOfKeys<'a> {
    pub words: &'a [f32],
    /// The first key, and the number of keys.
    pub first: usize,
    pub keys: usize,
    /// The number of floats in a row, and of rows for a key.
    pub width: usize,
    pub rows: usize,
}

impl<'a> RowsOfKeys<'a> {
    /// The rows of a key.
    #[inline(always)]
    pub fn at(&self, key: usize) -> Rows<'a> {
        Rows::new(&self.words[(key - self.first) * self.rows * self.width..], self.width, self.rows)
    }

    /// The points whose coordinates are in three successive rows, at a time.
    #[inline(always)]
    fn state<S: Simd>(&self, s: S, time: KeyTime, row: usize) -> [S::F; 3] {
        let (low, high) = (self.at(time.segment), self.at(time.segment + 1));
        let mut state = [s.splat(0.0); 3];
        for (axis, state) in state.iter_mut().enumerate() {
            let (a, b) = (s.load_row(&low, row + axis), s.load_row(&high, row + axis));
            *state = (if time.from_end { b } else { a }) + (b - a) * s.splat(time.s);
        }
        state
    }

    /// The tubes of the points whose coordinates are in three successive rows. Keys around the window that are not there do
    /// not count.
    #[inline(always)]
    pub fn tubes<S: Simd>(&self, s: S, window: &Window, row: usize) -> Tubes<S> {
        let zero = s.splat(0.0);
        let (begin, end) = (self.state(s, window.begin, row), self.state(s, window.end, row));
        let way = [end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]];
        let (mut below, mut above) = ([zero; 3], [zero; 3]);
        // The coordinates on both sides of zero that are farthest from it.
        let (mut least, mut most) = (zero, zero);
        for key in window.inner.clone() {
            let (rows, w) = (self.at(key), s.splat(window.fraction(key)));
            for axis in 0..3 {
                let place = s.load_row(&rows, row + axis);
                let off = place - (begin[axis] + way[axis] * w);
                below[axis] = s.min(below[axis], off);
                above[axis] = s.max(above[axis], off);
                (least, most) = (s.min(least, place), s.max(most, place));
            }
        }
        let held = self.first..self.first + self.keys;
        for key in window.around.clone().filter(|key| held.contains(key) && !window.inner.contains(key)) {
            let rows = self.at(key);
            for axis in 0..3 {
                let place = s.load_row(&rows, row + axis);
                (least, most) = (s.min(least, place), s.max(most, place));
            }
        }
        let (mut first, mut last) = ([[zero; 2]; 3], [[zero; 2]; 3]);
        for axis in 0..3 {
            first[axis] = [zero - (begin[axis] + below[axis]), begin[axis] + above[axis]];
            last[axis] = [zero - (end[axis] + below[axis]), end[axis] + above[axis]];
        }
        Tubes { ends: [first, last], size: s.max(most, zero - least) }
    }
}

/// One tube per lane, of a vertex or of one of the corners; or the bounds of a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Tubes<S: Simd> {
    /// At the begin and the end of the interval.
    ends: [FaceLanes<S>; 2],
    /// The largest coordinate.
    pub size: S::F,
}

impl<S: Simd> Tubes<S> {
    /// The bounds around both.
    #[inline(always)]
    pub fn unite(&mut self, s: S, other: &Tubes<S>) {
        for (faces, others) in self.ends.iter_mut().zip(&other.ends) {
            for (sides, others) in faces.iter_mut().zip(others) {
                for (side, &other) in sides.iter_mut().zip(others) {
                    *side = s.max(*side, other);
                }
            }
        }
        self.size = s.max(self.size, other.size);
    }

    /// The bounds of triangles whose corners are some of these vertices.
    #[inline(always)]
    pub fn of_triangles(&self, s: S, corners: S::U) -> Tubes<S> {
        let mut all = *self;
        for faces in &mut all.ends {
            for side in faces.as_flattened_mut() {
                *side = greatest_corner(s, *side, corners);
            }
        }
        all.size = greatest_corner(s, all.size, corners);
        all
    }

    /// The padded faces of the triangles `present`, in the order of [`bounds_of_faces`]; `slack` is that of vertices with a
    /// coordinate of 1, and `size` the largest coordinate.
    #[inline(always)]
    pub fn padded(&self, s: S, size: S::F, slack: f32, present: Mask) -> [S::F; 12] {
        let pad = size * s.splat(slack) * s.splat(2.0) + size * s.splat(TUBE_ULPS * ULP);
        let mut all = [pad; 12];
        for (end, faces) in self.ends.iter().enumerate() {
            for (axis, &[low, high]) in faces.iter().enumerate() {
                (all[6 * end + axis], all[6 * end + 3 + axis]) = (low + pad, high + pad);
            }
        }
        let mut unmoved = present;
        for face in 0..6 {
            unmoved &= s.eq(all[face], all[6 + face]);
        }
        if unmoved != 0 {
            // As for single triangles: a motion that returns to its begin is a motion nevertheless.
            let mut upper = [0.0f32; LANES];
            s.store(all[9], &mut upper);
            for (lane, x) in upper.iter_mut().enumerate() {
                *x = if unmoved >> lane & 1 == 1 { x.next_up() } else { *x };
            }
            all[9] = s.load(&upper);
        }
        all
    }
}

/// The same faces of each lane as `LaneBounds`.
#[inline(always)]
pub(in crate::primitive) fn lanes_of_faces<S: Simd>(s: S, faces: &[S::F; 12]) -> [S::F; LANES] {
    let zero = s.splat(0.0);
    let mut all = [zero; LANES];
    for axis in 0..3 {
        all[axis] = zero - faces[axis];
        all[4 + axis] = zero - faces[6 + axis];
        all[8 + axis] = zero - faces[3 + axis];
        all[12 + axis] = zero - faces[9 + axis];
    }
    transpose(s, all)
}

/// Bounds from their faces: three negated lower and three upper ones at the begin of the interval, and as many at its end.
pub(crate) fn bounds_of_faces(faces: &Lanes<f32>) -> LinearBox3 {
    let [a, b, c, d, e, f, g, h, i, j, k, l, ..] = *faces;
    // Not the negative, which would be a negative zero.
    let low = |x: f32, y: f32, z: f32| Vec3::ZERO - Vec3::new(x, y, z);
    let begin = Box3 { min: low(a, b, c), max: Vec3::new(d, e, f) };
    let end = Box3 { min: low(g, h, i), max: Vec3::new(j, k, l) };
    LinearBox3 { begin, end }
}
