//! What a binary tree is built over: linear bounds and an id, in one cache line.

use crate::motion::{Box3, LinearBox3};
use crate::simd::{LANES, Lanes};
use glam::{BVec4A, Vec3, Vec4};

/// One entry of a primitive in the tree being built: where it is during the build's time interval.
///
/// Sixteen lanes: the bounds as [`Packed`] has them, the sum of the box corners at both ends (four times the
/// mid-time centre), the id. Whole references are loaded, united and moved as one register.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Reference(pub(super) Packed);

/// The lanes of the centre and of the id.
const CENTRE: usize = 12;
const ID: usize = 15;

impl Reference {
    /// A reference with linear bounds over the build's interval.
    #[inline]
    pub fn new(bounds: LinearBox3, id: u32) -> Reference {
        let mut packed = Packed::new(&bounds);
        let centre = (bounds.begin.min + bounds.end.max) + (bounds.begin.max + bounds.end.min);
        packed.0[CENTRE..ID].copy_from_slice(&centre.to_array());
        packed.0[ID] = f32::from_bits(id);
        Reference(packed)
    }

    /// The primitive, or what else the caller builds over.
    #[inline]
    pub fn id(&self) -> u32 {
        self.0.0[ID].to_bits()
    }

    /// Linear bounds over the interval.
    #[inline]
    pub fn bounds(&self) -> LinearBox3 {
        self.0.bounds()
    }

    /// Whether it moves within the interval.
    #[inline]
    pub fn moving(&self) -> bool {
        self.0.0[..6] != self.0.0[6..12]
    }

    /// Four times the mid-time centre; the last lane is 0 (the id, read as a number, might be denormal, which
    /// is slow).
    #[inline(always)]
    pub(super) fn centre(&self) -> Vec4 {
        Vec4::select(BVec4A::new(true, true, true, false), self.0.four(CENTRE), Vec4::ZERO)
    }
}

/// Linear bounds as lanes: lower x y z and negated upper x y z at the begin, the same at the end, four more
/// lanes. With the upper faces negated a union is one minimum.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Packed(pub Lanes<f32>);

impl Packed {
    pub const EMPTY: Packed = Packed([f32::INFINITY; LANES]);

    #[inline(always)]
    pub fn new(b: &LinearBox3) -> Packed {
        let (low0, low1) = (b.begin.min, b.end.min);
        let (high0, high1) = (-b.begin.max, -b.end.max);
        Packed([
            low0.x, low0.y, low0.z, high0.x, high0.y, high0.z, low1.x, low1.y, low1.z, high1.x, high1.y, high1.z, 0.0,
            0.0, 0.0, 0.0,
        ])
    }

    /// Four lanes from lane `i`.
    #[inline(always)]
    fn four(&self, i: usize) -> Vec4 {
        Vec4::from_slice(&self.0[i..i + 4])
    }

    /// Six times the mean half area over the interval, as a sum of the first three lanes; 0 for empty bounds.
    ///
    /// With h(d) = xy + yz + zx it is h(d0) + h(d1) + h(d0 + d1) (see [`super::mean_half_area`]), which is
    /// d0 · rot(2 d0 + d1) + d1 · rot(2 d1 + d0), where rot (x, y, z) = (y, z, x).
    #[inline(always)]
    pub fn area_terms(&self) -> Vec4 {
        let d0 = (-(self.four(0) + self.four(3))).max(Vec4::ZERO);
        let d1 = (-(self.four(6) + self.four(9))).max(Vec4::ZERO);
        let sum = d0 + d1;
        let (a, b) = (sum + d0, sum + d1);
        d0 * Vec4::new(a.y, a.z, a.x, a.w) + d1 * Vec4::new(b.y, b.z, b.x, b.w)
    }

    #[inline(always)]
    pub fn bounds(&self) -> LinearBox3 {
        let p = &self.0;
        let at = |i: usize| Vec3::new(p[i], p[i + 1], p[i + 2]);
        LinearBox3 { begin: Box3 { min: at(0), max: -at(3) }, end: Box3 { min: at(6), max: -at(9) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::object::binned::mean_half_area;

    #[test]
    fn a_reference_keeps_what_it_is_given() {
        let begin = Box3 { min: Vec3::new(-0.5, 0.1, 0.2), max: Vec3::new(0.25, 0.3, 1.0) };
        let end = Box3 { min: Vec3::new(-0.25, 0.0, 0.5), max: Vec3::new(0.5, 0.75, 0.5) };
        let moved = Reference::new(LinearBox3 { begin, end }, u32::MAX);
        assert_eq!((moved.bounds(), moved.id(), moved.moving()), (LinearBox3 { begin, end }, u32::MAX, true));
        assert!(!Reference::new(LinearBox3 { begin, end: begin }, 0).moving());
        let centre = (begin.min + begin.max + end.min + end.max).to_array();
        for (a, b) in moved.centre().to_array().into_iter().zip(centre) {
            assert!((a - b).abs() < 1e-6);
        }
        let terms = moved.0.area_terms();
        let area = (terms.x + terms.y + terms.z) / 6.0;
        assert!((area / mean_half_area(&moved.bounds()) - 1.0).abs() < 1e-6);
        assert_eq!(Packed::EMPTY.area_terms().truncate(), Vec3::ZERO);
    }
}
