//! The references that a binary tree is built over: linear bounds and an id, in one cache line.

use crate::geometry::{Box3, LaneBounds, LinearBox3};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};
use glam::{Vec3, Vec4};

/// One entry of a primitive in the tree being built: its linear bounds during the build's time interval, and its id.
///
/// Sixteen lanes, loaded, united and moved as one register: the bounds as [`Packed`] has them, and in its spare lanes
/// the sum of the box corners at both ends (four times the mid-time centre) and the id.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Reference(pub(super) Packed);

/// The lane of the id.
const ID: usize = 15;

/// The lanes of the centre as a mask.
const CENTRES: Mask = 1 << 6 | 1 << 7 | 1 << 14;

/// The lane of the opposite face at the other end, for each lower face, and the lanes that are summed for the centre.
const OPPOSITE: Lanes<u32> = [11, 12, 13, 8, 9, 10, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
const FIRST: Lanes<u32> = [0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 2, 0];
const SECOND: Lanes<u32> = [3, 3, 3, 3, 3, 3, 3, 4, 3, 3, 3, 3, 3, 3, 5, 3];

impl Reference {
    /// The lanes of the centre.
    pub(super) const CENTRE: [usize; 3] = [6, 7, 14];

    /// A reference with linear bounds over the build's interval.
    #[inline]
    pub fn new(bounds: LinearBox3, id: u32) -> Reference {
        Reference::of(Packed::new(&bounds), id)
    }

    /// A reference with packed bounds.
    #[inline]
    pub(super) fn of(mut packed: Packed, id: u32) -> Reference {
        let p = &mut packed.0;
        for (axis, lane) in Reference::CENTRE.into_iter().enumerate() {
            p[lane] = (p[LOW + axis] - p[HIGH + 3 + axis]) + (p[LOW + 3 + axis] - p[HIGH + axis]);
        }
        p[ID] = f32::from_bits(id);
        Reference(packed)
    }

    /// A reference with packed bounds in lanes.
    #[inline(always)]
    pub(super) fn of_lanes<S: Simd>(s: S, bounds: S::F, id: u32) -> Reference {
        let across = bounds - s.permute(bounds, s.load_u(&OPPOSITE));
        let centre = s.permute(across, s.load_u(&FIRST)) + s.permute(across, s.load_u(&SECOND));
        let id = s.from_bits(s.splat_u(id));
        let mut packed = Packed::EMPTY;
        s.store(s.select(1 << ID, id, s.select(CENTRES, centre, bounds)), &mut packed.0);
        Reference(packed)
    }

    /// Writes a reference for each of some primitives with bounds in lanes.
    pub fn write(ids: &[u32], bounds: &[LaneBounds], out: &mut [Reference]) {
        dispatch(SimdLevel::best(), Write { ids, bounds, out });
    }

    /// Its bounds; the spare lanes hold centre and id.
    #[inline]
    pub(super) fn packed(&self) -> &Packed {
        &self.0
    }

    /// The id of the primitive, or of another object that the caller builds over.
    #[inline]
    pub fn id(&self) -> u32 {
        self.0.0[ID].to_bits()
    }

    /// The ids of references, of which one leaf block holds all; 0 in the lanes beyond.
    #[inline]
    pub fn ids(references: &[Reference]) -> Lanes<u32> {
        let mut ids = [0; LANES];
        ids.iter_mut().zip(references).for_each(|(id, r)| *id = r.id());
        ids
    }

    /// Linear bounds over the interval.
    #[inline]
    pub fn bounds(&self) -> LinearBox3 {
        self.0.bounds()
    }

    /// Whether its bounds are empty.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether it moves within the interval.
    #[inline]
    pub fn moving(&self) -> bool {
        let p = &self.0.0;
        p[LOW..LOW + 3] != p[LOW + 3..LOW + 6] || p[HIGH..HIGH + 3] != p[HIGH + 3..HIGH + 6]
    }

    /// Four times the mid-time centre; the last lane is 0.
    #[inline(always)]
    pub(super) fn centre(&self) -> Vec4 {
        let ([x, y, z], lanes) = (Reference::CENTRE, &self.0.0);
        Vec4::new(lanes[x], lanes[y], lanes[z], 0.0)
    }
}

/// [`Reference::write`].
struct Write<'a> {
    ids: &'a [u32],
    bounds: &'a [LaneBounds],
    out: &'a mut [Reference],
}

/// The lanes of [`LaneBounds`] in the order of [`Packed`].
const TOGETHER: Lanes<u32> = [0, 1, 2, 4, 5, 6, 3, 3, 8, 9, 10, 12, 13, 14, 3, 3];

impl Kernel for Write<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for ((&id, bounds), to) in self.ids.iter().zip(self.bounds).zip(self.out) {
            *to = Reference::of_lanes(s, s.permute(s.load(&bounds.0), s.load_u(&TOGETHER)), id);
        }
    }
}

/// Linear bounds as lanes: lower x y z at the beginning and at the end, two spare lanes; negated upper x y z at the
/// beginning and at the end, two spare lanes. With the upper faces negated a union is one minimum, and the sum of both
/// halves is the negated extent.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Packed(pub Lanes<f32>);

/// The first lane of the lower faces, and of the upper ones.
const LOW: usize = 0;
const HIGH: usize = 8;

impl Packed {
    pub const EMPTY: Packed = Packed([f32::INFINITY; LANES]);

    #[inline(always)]
    pub fn new(b: &LinearBox3) -> Packed {
        let (low0, low1) = (b.begin.min, b.end.min);
        let (high0, high1) = (-b.begin.max, -b.end.max);
        Packed([
            low0.x, low0.y, low0.z, low1.x, low1.y, low1.z, 0.0, 0.0, high0.x, high0.y, high0.z, high1.x, high1.y,
            high1.z, 0.0, 0.0,
        ])
    }

    /// The minimum in each lane.
    pub fn least(self, other: Packed) -> Packed {
        Packed(core::array::from_fn(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }

    /// Whether these are still the bounds [`Packed::EMPTY`].
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0[LOW] == f32::INFINITY
    }

    #[inline(always)]
    pub fn bounds(&self) -> LinearBox3 {
        let at = |i: usize| Vec3::new(self.0[i], self.0[i + 1], self.0[i + 2]);
        LinearBox3 { begin: Box3 { min: at(LOW), max: -at(HIGH) }, end: Box3 { min: at(LOW + 3), max: -at(HIGH + 3) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let rises = LinearBox3 { begin, end: Box3 { max: begin.max + Vec3::Z, ..begin } };
        assert!(Reference::new(rises, 0).moving());
    }
}
