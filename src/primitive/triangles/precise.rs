//! Triangles whose vertices are kept in f64, of meshes with [`Keys::Precise`](crate::primitive::Keys::Precise).
//!
//! Trees are built of the same vertices rounded to f32, as of any other mesh, with boxes larger by that rounding. So are the
//! margins with which queries test leaf blocks (`ray/kernel/shear.rs`). Hits and nearest points are computed from the vertices in
//! f64.

use super::triangle_set::Triangles;
use crate::geometry::{KeyTime, TimeInterval, ULP};
use glam::DVec3;

impl Triangles {
    /// Whether the vertices of any triangle are kept in f64.
    #[inline(always)]
    pub(crate) fn any_precise(&self) -> bool {
        !self.precise.is_empty()
    }

    /// Whether the vertices of a triangle are kept in f64.
    #[inline(always)]
    pub(crate) fn is_precise(&self, id: u32) -> bool {
        !self.precise.is_empty() && self.mesh(id).precise.is_some()
    }

    /// The corners of a triangle at a time, if its vertices are kept in f64.
    #[inline]
    pub(crate) fn precise_corners(&self, id: u32, t: f32) -> Option<[DVec3; 3]> {
        if self.precise.is_empty() {
            return None;
        }
        let mesh = self.mesh(id);
        let triangle = mesh.precise? + (id - mesh.first);
        let at = KeyTime::new(t, mesh.keys);
        let (first, last) = (at.segment, (at.segment + 1).min(mesh.keys - 1));
        let corners = self.precise.corners[triangle as usize];
        Some(corners.map(|v| {
            let keys = &self.precise.positions[v as usize..];
            at.fine_position(keys[first], keys[last])
        }))
    }

    /// The padding of bounds for the rounding of vertices to f32; 0 if vertices are f32.
    ///
    /// Rounding is up to 1 ULP of the coordinate at each key, and no more in between; the other ULP is for
    /// rounding the box that the padding is added to. The constant is for coordinates that are denormal in f32, or zero.
    #[inline(always)]
    pub(in crate::primitive) fn rounding(&self, id: u32, over: TimeInterval) -> f32 {
        if self.is_precise(id) { 2.0 * ULP * self.magnitude(id, over) + f32::MIN_POSITIVE } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::LinearBox3;
    use crate::primitive::{PrimitiveSet, TriangleMesh};
    use crate::random::Random;

    /// Corners outside of their bounds over a part of the shutter, with all of the padding and without that for rounding.
    fn outside(keys: usize) -> [usize; 2] {
        let (mut random, mut lost) = (Random(9 + keys as u64), [0, 0]);
        for _ in 0..200 {
            let mut corners = || (0..3).map(|_| DVec3::from([0; 3].map(|_| random.signed_f64()))).collect();
            let positions: Vec<Vec<DVec3>> = (0..keys).map(|_| corners()).collect();
            let mesh = TriangleMesh::new(vec![[0, 1, 2]], positions).precise();
            let set = Triangles::new(&[mesh]).unwrap();
            let (a, b) = (random.signed_f64().abs() as f32, random.signed_f64().abs() as f32);
            let over = TimeInterval::half_open(a.min(b), a.max(b) + 1e-3).unwrap();
            let LinearBox3 { begin, end } = set.bounds(0, over);
            for i in 0..=20 {
                let t = (over.begin() + over.duration() * (i as f32 / 20.0)).min(over.end());
                let w = f64::from(t - over.begin()) / f64::from(over.end() - over.begin());
                for (lost, less) in lost.iter_mut().zip([0.0, set.rounding(0, over)]) {
                    let low = begin.min.as_dvec3().lerp(end.min.as_dvec3(), w) + f64::from(less);
                    let high = begin.max.as_dvec3().lerp(end.max.as_dvec3(), w) - f64::from(less);
                    let corners = set.precise_corners(0, t).unwrap();
                    *lost += corners.into_iter().filter(|p| p.cmplt(low).any() || p.cmpgt(high).any()).count();
                }
            }
        }
        lost
    }

    #[test]
    fn bounds_hold_corners_in_f64_and_would_not_without_padding() {
        for keys in [1, 2, 3, 9] {
            let [with, without] = outside(keys);
            assert_eq!(with, 0, "{keys} keys");
            // Moving triangles are padded for the f32 rounding of their motion as well, which does not occur here.
            assert!(without > 100 || keys > 1, "{keys} keys: a padding that nothing needs");
        }
    }

    #[test]
    fn keys_on_lines_are_dropped_up_to_the_rounding_of_f64() {
        let mut random = Random(4);
        let [open, close]: [Vec<DVec3>; 2] = core::array::from_fn(|_| (0..300).map(|_| 5e6 + random.dvec()).collect());
        let sampled = |by: f64| {
            let key = |key: usize| {
                let w = key as f64 / 64.0;
                let at = |i: usize| open[i] + (close[i] - open[i]) * w + if key == 20 && i == 150 { by } else { 0.0 };
                (0..300).map(at).collect()
            };
            TriangleMesh::new(vec![[0, 1, 2]], (0..65).map(key).collect::<Vec<Vec<DVec3>>>()).precise()
        };
        for (by, kept) in [(0.0, 2), (2e-9, 2), (1e-8, 65)] {
            assert_eq!(Triangles::new(&[sampled(by)]).unwrap().keys(0), kept, "off by {by}");
        }
    }

    #[test]
    fn every_bit_is_kept_and_equal_keys_are_one() {
        let mut random = Random(3);
        for around in [0.0, 1e-9, 5e6] {
            let mut place = || DVec3::splat(around) + DVec3::from([0; 3].map(|_| random.signed_f64()));
            let [open, close]: [Vec<DVec3>; 2] = core::array::from_fn(|_| (0..3).map(|_| place()).collect());
            let still = TriangleMesh::new(vec![[0, 1, 2]], vec![open.clone(); 5]).precise();
            let moving = TriangleMesh::new(vec![[0, 1, 2]; 2], vec![open.clone(), close.clone()]).precise();
            let set = Triangles::new(&[still, moving]).unwrap();
            assert_eq!((set.keys(0), set.keys(1), set.keys(2)), (1, 2, 2));
            let at = |id: u32, t: f32| set.precise_corners(id, t).unwrap().map(|p| set.frame().fine_to_world(p));
            assert_eq!((at(0, 0.3).to_vec(), at(2, 0.0).to_vec(), at(1, 1.0).to_vec()), (open.clone(), open, close));
        }
    }
}
