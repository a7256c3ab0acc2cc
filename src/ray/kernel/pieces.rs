//! Rays from far away, in pieces.
//!
//! Boxes grow by the rounding of a ray's origin, which is as large as a small object if the ray begins a million times its size
//! away: such a ray would test every triangle of each object that it passes. If everything is far away, the origin is moved to
//! the scene ([`TreeRay::recompute`]). But the scene may be a planet, the object a car on it, and the ray begin in orbit, which
//! is near the planet. Then the ray is cut where its origin can be moved much nearer to zero, and what is found on the pieces is
//! one answer. Only boxes near zero can be small: the others grow by the rounding of their own coordinates.
//!
//! Where pieces end affects the boxes that are visited only. Hits are decided in f64 from the caller's ray, and count if they are
//! in its range, on whichever piece they are found; so a piece may well find what lies on another one. Every hit lies on some
//! piece: each goes a little beyond the begin of the next, by far more than rounding.

use super::tree_ray::{Direction, TreeRay, in_29_bits};
use crate::geometry::Frame;
use glam::{DVec3, Vec3};

/// The share of the way to the point that is nearest to zero which a piece covers.
const PART: f64 = 15.0 / 16.0;

/// The next origin must be this much nearer to zero.
const LEAST_GAIN: f64 = 4.0;

/// By how much pieces overlap, relative to their lengths.
const OVERLAP: f64 = 1.0 / 1024.0;

impl TreeRay<'_> {
    /// Ends the ray where its first piece does, if it begins farther than `near` from zero and gains from that.
    pub(super) fn cut(&mut self, frame: &Frame, near: f32) {
        // Lines begin behind their origin.
        if self.begin < 0.0 || self.has_empty_range() {
            return;
        }
        while let Some(next) = self.end_of_piece(near) {
            let end = ((next - self.advance) * (1.0 + OVERLAP)) as f32;
            if end >= self.begin {
                self.in_pieces = true;
                self.end = self.end.min(end);
                return;
            }
            // The range begins on a later piece.
            self.move_to(next, frame);
        }
    }

    /// Goes on to the next piece; false if there is none.
    #[cold]
    #[inline(never)]
    pub fn next_piece(&mut self, frame: &Frame, near: f32) -> bool {
        let Some(next) = self.end_of_piece(near) else { return false };
        self.move_to(next, frame);
        self.cut(frame, near);
        self.in_pieces = true;
        !self.has_empty_range()
    }

    /// Moves the origin along the ray.
    fn move_to(&mut self, advance: f64, frame: &Frame) {
        let ([x, y, z, _], index) = (self.from, self.index);
        let (from, dir) = (DVec3::new(x, y, z), Direction::of(self.original.dir));
        *self = TreeRay::advanced(self.original, frame, (from, dir), advance);
        self.index = index;
    }

    /// How far the origin of the next piece is moved along the ray; `None` if this piece goes to the end of the ray.
    fn end_of_piece(&self, near: f32) -> Option<f64> {
        let [x, y, z, _] = self.origin;
        let (origin, step) = (Vec3::new(x, y, z).as_dvec3(), Direction::of(self.original.dir).step());
        let size = origin.abs().max_element();
        let next = in_29_bits(self.advance + PART * -origin.dot(step) / step.length_squared());
        // So there are few pieces, and each has a length.
        let then = (origin + step * (next - self.advance)).abs().max_element();
        (size > f64::from(near) && next > self.advance && then * LEAST_GAIN <= size).then_some(next)
    }
}
