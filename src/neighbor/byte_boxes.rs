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
//! point, which is all that the proof in `view` asks of a box.

use super::view::{Boxes, outside};
use crate::simd::{LANES, Lanes, Simd};

/// Sixteen boxes on the grid of their node. An absent one has its lower faces at 255 and its upper ones at 0:
/// searches see it as a box like any other, and find nothing behind it.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct ByteBoxes {
    corner: [f32; 3],
    step: [f32; 3],
    lo: [Lanes<u8>; 3],
    hi: [Lanes<u8>; 3],
}

/// The greatest count.
const MOST: u8 = u8::MAX;

impl ByteBoxes {
    /// Sixteen absent boxes.
    pub(super) const NONE: ByteBoxes =
        ByteBoxes { corner: [0.0; 3], step: [0.0; 3], lo: [[MOST; LANES]; 3], hi: [[0; LANES]; 3] };

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

    /// Lower and upper corner of a lane's box; nothing where it is absent.
    pub(super) fn corners(&self, lane: usize) -> Option<[[f32; 3]; 2]> {
        let at = |rows: &[Lanes<u8>; 3]| {
            core::array::from_fn(|axis| face(self.corner[axis], self.step[axis], rows[axis][lane]))
        };
        (self.lo[0][lane] <= self.hi[0][lane]).then(|| [at(&self.lo), at(&self.hi)])
    }

    /// The box around all sixteen.
    pub(super) fn hull(&self) -> ([f32; 3], [f32; 3]) {
        let most = |axis: usize| self.hi[axis].iter().copied().fold(0, u8::max);
        (self.corner, core::array::from_fn(|axis| face(self.corner[axis], self.step[axis], most(axis))))
    }

    /// Squared distances of the boxes from a point.
    #[inline(always)]
    pub(super) fn distances<S: Simd>(&self, s: S, point: &[S::F; 3]) -> S::F {
        outside(s, point, self.faces(s, &self.lo), self.faces(s, &self.hi))
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
fn face(corner: f32, step: f32, count: u8) -> f32 {
    corner + f32::from(count) * step
}
