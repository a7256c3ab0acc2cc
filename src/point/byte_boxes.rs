//! Sixteen boxes in two cache lines: faces as bytes, counted in steps from the corner of the node.
//!
//! The picture to have in mind: a grid of 256 lines per axis over a node; each child's box is rounded outward to
//! it. The bottom nodes of a tree are fifteen times as many as all others together, and searches that jump from
//! place to place find them in the cache more often the smaller they are. The boxes grow by half a percent.
//!
//! **Rounding.** A face is `corner + count · step`. Steps have sixteen significant bits and counts eight, so the
//! product is exact and the sum is rounded once, fused or not: every instruction set sees the same face. Counts are
//! chosen by that very computation: lower faces at or below, upper faces at or above the true ones. Count 0
//! is the corner itself, and count 255 reaches the other corner: the step is at least a 255th of the way, and
//! rounding to nearest never takes a sum below a float that it exceeds. So `lo <= p <= hi` holds in floats for every
//! point, which is all that the proof in [`super::snapshot`] asks of a box.
//!
//! **Far neighbours.** A child far away from the others makes the grid coarse, and all boxes of the node larger than what
//! is in them. Where that is so, the node refers to one with floats instead.

use super::snapshot::{Boxes, diagonal, outside};
use crate::simd::{LANES, Lanes, Mask, Simd};

/// Sixteen boxes on the grid of their node. An absent one has its lower faces at 255 and its upper ones at 0:
/// searches see it as a box like any other, and find nothing behind it.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct ByteBoxes {
    pub(super) corner: [f32; 3],
    pub(super) step: [f32; 3],
    pub(super) lo: [Lanes<u8>; 3],
    pub(super) hi: [Lanes<u8>; 3],
}

/// The greatest count.
const MOST: u8 = u8::MAX;

/// A grid is too coarse for a box whose longest side is less than this many of its steps.
const FINE: f32 = 3.0;

/// A grid must be fine enough for all but this many boxes.
const MOST_COARSE: usize = 3;

/// In the place of a step: the node refers to one with floats.
const ELSEWHERE: f32 = -1.0;

impl ByteBoxes {
    /// Sixteen absent boxes.
    pub(super) const NONE: ByteBoxes =
        ByteBoxes { corner: [0.0; 3], step: [0.0; 3], lo: [[MOST; LANES]; 3], hi: [[0; LANES]; 3] };

    /// A node that refers to the boxes with this number.
    pub(super) fn elsewhere(number: usize) -> ByteBoxes {
        let corner = [f32::from_bits(number as u32), 0.0, 0.0];
        ByteBoxes { corner, step: [ELSEWHERE, 0.0, 0.0], ..ByteBoxes::NONE }
    }

    /// The number of the boxes that it refers to.
    #[inline(always)]
    pub(super) fn number_elsewhere(&self) -> Option<usize> {
        (self.step[0] == ELSEWHERE).then(|| self.corner[0].to_bits() as usize)
    }

    /// Whether rounding to the grid makes some of the boxes much larger.
    pub(super) fn coarse(boxes: &Boxes) -> bool {
        let (corner, far) = boxes.hull();
        let widest = (0..3).map(|axis| far[axis] - corner[axis]).fold(0.0, f32::max);
        let coarse = |&lane: &usize| {
            let longest = (0..3).map(|axis| boxes.hi[axis][lane] - boxes.lo[axis][lane]).fold(0.0, f32::max);
            boxes.lo[0][lane] <= boxes.hi[0][lane] && longest < FINE * widest / f32::from(MOST)
        };
        (0..LANES).filter(coarse).count() > MOST_COARSE
    }

    /// The boxes, rounded outward.
    pub(super) fn around(boxes: &Boxes) -> ByteBoxes {
        let mut bytes = ByteBoxes::NONE;
        let (corner, far) = boxes.hull();
        if corner[0] > far[0] {
            return bytes;
        }
        for axis in 0..3 {
            let step = step(corner[axis], far[axis]);
            (bytes.corner[axis], bytes.step[axis]) = (corner[axis], step);
            for lane in 0..LANES {
                let (lo, hi) = (boxes.lo[axis][lane], boxes.hi[axis][lane]);
                if lo <= hi {
                    // Casts saturate; the loops put right what the division rounded.
                    let count = |x: f32| (f64::from(x) - f64::from(corner[axis])) / f64::from(step);
                    let (mut low, mut high) = (count(lo).floor() as u8, count(hi).ceil() as u8);
                    while face(corner[axis], step, low) > lo {
                        low -= 1;
                    }
                    while face(corner[axis], step, high) < hi {
                        high += 1;
                    }
                    (bytes.lo[axis][lane], bytes.hi[axis][lane]) = (low, high);
                }
            }
        }
        bytes
    }

    /// Which lanes there are.
    #[inline(always)]
    pub(super) fn present(&self) -> Lanes<bool> {
        let mut present = [false; LANES];
        for (lane, there) in present.iter_mut().enumerate() {
            *there = self.lo[0][lane] <= self.hi[0][lane];
        }
        present
    }

    /// Lower and upper faces of all lanes, absent ones too.
    #[inline(always)]
    pub(super) fn all_faces(&self) -> [[Lanes<f32>; 3]; 2] {
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, counts) in faces.iter_mut().zip([&self.lo, &self.hi]) {
            for axis in 0..3 {
                for lane in 0..LANES {
                    faces[axis][lane] = face(self.corner[axis], self.step[axis], counts[axis][lane]);
                }
            }
        }
        faces
    }

    /// The box around all sixteen; an absent one where none of them is there.
    pub(super) fn hull(&self) -> ([f32; 3], [f32; 3]) {
        if self.present() == [false; LANES] {
            return ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        }
        let most = |axis: usize| self.hi[axis].iter().copied().fold(0, u8::max);
        (self.corner, core::array::from_fn(|axis| face(self.corner[axis], self.step[axis], most(axis))))
    }

    /// Squared distances of the boxes from a point, and which of them hold it.
    #[inline(always)]
    pub(super) fn outside<S: Simd>(&self, s: S, point: &[S::F; 3]) -> (S::F, Mask) {
        outside(s, point, self.faces(s, &self.lo), self.faces(s, &self.hi))
    }

    /// Lower and upper faces of all lanes, absent ones too.
    #[inline(always)]
    pub(super) fn face_rows<S: Simd>(&self, s: S) -> ([S::F; 3], [S::F; 3]) {
        (self.faces(s, &self.lo), self.faces(s, &self.hi))
    }

    /// Squared diagonals of the boxes.
    #[inline(always)]
    pub(super) fn sizes<S: Simd>(&self, s: S) -> S::F {
        diagonal::<S>(self.faces(s, &self.lo), self.faces(s, &self.hi))
    }

    #[inline(always)]
    fn faces<S: Simd>(&self, s: S, counts: &[Lanes<u8>; 3]) -> [S::F; 3] {
        [self.row(s, counts, 0), self.row(s, counts, 1), self.row(s, counts, 2)]
    }

    #[inline(always)]
    fn row<S: Simd>(&self, s: S, counts: &[Lanes<u8>; 3], axis: usize) -> S::F {
        s.mul_add(s.load_bytes(&counts[axis]), s.splat(self.step[axis]), s.splat(self.corner[axis]))
    }
}

/// A step of sixteen significant bits, 255 of which reach from one coordinate to another.
fn step(from: f32, to: f32) -> f32 {
    let exact = (f64::from(to) - f64::from(from)) / f64::from(MOST);
    let above = (exact as f32).next_up().max(f32::MIN_POSITIVE);
    f32::from_bits((above.to_bits() + 0xff) & !0xff)
}

/// A face as searches compute it.
#[inline(always)]
fn face(corner: f32, step: f32, count: u8) -> f32 {
    corner + f32::from(count) * step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::{Kernel, SimdLevel, dispatch};

    /// Distances of the boxes as searches compute them.
    struct Distances<'a>(&'a ByteBoxes, [f32; 3]);

    impl Kernel for Distances<'_> {
        type Output = Lanes<f32>;
        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Lanes<f32> {
            let mut to = [0.0; LANES];
            s.store(self.0.outside(s, &self.1.map(|x| s.splat(x))).0, &mut to);
            to
        }
    }

    #[test]
    fn boxes_are_rounded_outward_and_by_little() {
        let mut random = Random(11);
        for round in 0..3000 {
            // From one place to all that is allowed, near zero and far from it.
            let size = [0.0, 1e-44, 1e-39, 1e-3, 1.0, 1e18][round % 6];
            let offset = [0.0, 1e-40, -3.0, 1e6, -1e18][round / 6 % 5];
            let mut boxes = Boxes::NONE;
            let present = round % 17;
            for lane in 0..present {
                let mut corner = || core::array::from_fn(|_| offset + random.unit() * size);
                let (a, b): ([f32; 3], [f32; 3]) = (corner(), corner());
                let least = core::array::from_fn(|i| a[i].min(b[i]));
                boxes.include(lane, least, core::array::from_fn(|i| a[i].max(b[i])));
            }
            let bytes = ByteBoxes::around(&boxes);
            let (corner, far) = boxes.hull();
            let (there, faces) = (bytes.present(), bytes.all_faces());
            assert!((0..LANES).all(|lane| there[lane] == (lane < present)), "round {round}");
            let corners = |lane: usize| faces.map(|rows| rows.map(|row| row[lane]));
            for lane in 0..present {
                let [lo, hi]: [[f32; 3]; 2] = corners(lane);
                for axis in 0..3 {
                    let (exact_lo, exact_hi) = (boxes.lo[axis][lane], boxes.hi[axis][lane]);
                    assert!(lo[axis] <= exact_lo && exact_hi <= hi[axis], "round {round}, lane {lane}");
                    let grid = (far[axis] - corner[axis]) / 254.0 + f32::MIN_POSITIVE;
                    let most = grid + (exact_lo.abs().max(exact_hi.abs())) * f32::EPSILON;
                    assert!(exact_lo - lo[axis] <= most && hi[axis] - exact_hi <= most, "round {round}, lane {lane}");
                }
            }
            let (hull_lo, hull_hi) = bytes.hull();
            assert!(present > 0 || hull_lo > hull_hi, "round {round}");
            assert!(present == 0 || (0..3).all(|axis| hull_lo[axis] <= corner[axis] && far[axis] <= hull_hi[axis]));
            // What searches see is what was checked above, fused or not.
            let point = core::array::from_fn(|_| offset + (random.unit() * 3.0 - 1.0) * size);
            for simd in SimdLevel::available() {
                let distances = dispatch(simd, Distances(&bytes, point));
                for (lane, distance) in distances.into_iter().take(present).enumerate() {
                    let [lo, hi] = corners(lane);
                    let gap = |i: usize| (lo[i] - point[i]).max(point[i] - hi[i]).max(0.0);
                    let expected = (gap(0) * gap(0) + gap(1) * gap(1)) + gap(2) * gap(2);
                    assert_eq!(distance.to_bits(), expected.to_bits(), "{simd}, round {round}, lane {lane}");
                }
            }
        }
    }
}
