//! The boxes of a node, written sixteen at once, and read one by one.
//!
//! A face of a box is the line that a query evaluates as `at + velocity * t`. It goes through a bound at both ends of an
//! interval and is moved outward until the *computed* `at + velocity * t` holds the bound at every time of the interval.
//!
//! Proof: the computed value differs from `at + velocity * t` by at most two roundings of sizes below
//! |at| + |velocity| (one where it is fused), that is by less than 2^-23 (|at| + |velocity|); `at` is moved by
//! twice that and then by one float. Both the bound and the line are linear in t, so it is enough that the line lies
//! beyond the bound at both ends; this is ensured in f64, whose own rounding (2^-53) is negligible beside the float
//! step. A static face is moved by the padding of its box and rounded outward.

use super::wide_node::Kind;
use crate::geometry::{Box3, KERNEL_ULPS, LinearBox3, TimeInterval, ULP};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch, lanes_at_mut};
use glam::Vec3;

/// By how many times the rounding of the query a face is moved.
const ROUNDINGS: f64 = 2.0;

/// Bounds that no ray meets, for the lanes without a child: from far on one side to far on the other. Scaled by the
/// reciprocal of any direction it stays finite.
pub(super) const NOWHERE: f32 = 1e30;

/// Up to sixteen boxes in rows: the lower corners at the begin, the upper ones, and both at the end.
pub(super) struct BoxRows {
    rows: [Lanes<f32>; 12],
    present: Mask,
}

impl BoxRows {
    pub const NONE: BoxRows = BoxRows { rows: [[0.0; LANES]; 12], present: 0 };

    #[inline]
    pub fn set(&mut self, lane: usize, of: &LinearBox3) {
        let corners = [of.begin.min, of.begin.max, of.end.min, of.end.max];
        for (rows, corner) in self.rows.chunks_exact_mut(3).zip(corners) {
            for (row, x) in rows.iter_mut().zip(corner.to_array()) {
                row[lane % LANES] = x;
            }
        }
        self.present |= 1 << lane;
    }

    /// Writes the boxes of some lanes into the node that begins at `words[0]`; for a static node, they must be static.
    /// Lanes without a box are written such that no ray meets them.
    pub fn write(&self, words: &mut [u32], kind: Kind, lanes: Mask, over: TimeInterval, level: SimdLevel) {
        dispatch(level, Write { boxes: self, words, moving: kind == Kind::Node, lanes, over, roundings: ROUNDINGS });
    }
}

/// See [`BoxRows::write`].
struct Write<'a> {
    boxes: &'a BoxRows,
    words: &'a mut [u32],
    /// Whether the node has rows for velocities.
    moving: bool,
    lanes: Mask,
    over: TimeInterval,
    roundings: f64,
}

/// The lines through the faces of one side and axis.
struct MovingFaces<S: Simd> {
    at: S::F,
    velocity: S::F,
}

impl Kernel for Write<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let pad = self.pad(s);
        for axis in 0..3 {
            self.side::<S, false>(s, axis, &pad);
            self.side::<S, true>(s, axis, &pad);
        }
    }
}

impl Write<'_> {
    /// The padding of the faces of each box, so that a ray that hits a primitive in it also meets the box: the part of the
    /// kernel's rounding that grows with the coordinates of the primitive. The other part, which grows with those of the
    /// origin, is added to the ray. Sums and products of f32 are exact in f64 here.
    #[inline(always)]
    fn pad<S: Simd>(&self, s: S) -> [S::D; 4] {
        let rows = &self.boxes.rows;
        let mut magnitude = s.splat(0.0);
        for axis in 0..3 {
            for end in [0, 6] {
                let (low, high) = (s.load(&rows[end + axis]), s.load(&rows[end + 3 + axis]));
                magnitude = s.max(magnitude, s.max(s.splat(0.0) - low, high));
            }
        }
        let mut lanes = [0.0; LANES];
        s.store(magnitude, &mut lanes);
        let unit = s.splat_d(f64::from(KERNEL_ULPS * ULP));
        let four = |i: usize| unit * s.widen_four(&lanes.as_chunks().0[i]);
        [four(0), four(1), four(2), four(3)]
    }

    /// Writes the lower or upper faces along an axis.
    #[inline(always)]
    fn side<S: Simd, const UPPER: bool>(&mut self, s: S, axis: usize, pad: &[S::D; 4]) {
        let faces = self.faces::<S, UPPER>(s, axis, pad);
        let absent = if UPPER { -NOWHERE } else { NOWHERE };
        let row = 2 * axis + usize::from(UPPER);
        self.replace(s, row, s.select(self.boxes.present, faces.at, s.splat(absent)));
        if self.moving {
            self.replace(s, row + 6, s.select(self.boxes.present, faces.velocity, s.splat(0.0)));
        }
    }

    /// Writes a row of the chosen lanes.
    #[inline(always)]
    fn replace<S: Simd>(&mut self, s: S, row: usize, by: S::F) {
        let words = lanes_at_mut(self.words, row * LANES);
        s.store_u(s.select_u(self.lanes, s.to_bits(by), s.load_u(words)), words);
    }

    #[inline(always)]
    fn faces<S: Simd, const UPPER: bool>(&self, s: S, axis: usize, pad: &[S::D; 4]) -> MovingFaces<S> {
        let row = axis + if UPPER { 3 } else { 0 };
        let (begin, end) = (&self.boxes.rows[row], &self.boxes.rows[row + 6]);
        let outward = |x: S::D, by: S::D| if UPPER { x + by } else { x - by };
        let beyond = |a: S::D, b: S::D| if UPPER { s.max_d(a, b) } else { s.min_d(a, b) };
        let (t0, t1) = (f64::from(self.over.begin()), f64::from(self.over.end()));
        let (first, last, duration) = (s.splat_d(t0), s.splat_d(t1), s.splat_d(t1 - t0));
        let (zero, rounding) = (s.splat_d(0.0), s.splat_d(f64::from(f32::EPSILON) * self.roundings));
        let (mut still, mut moving, mut velocity) = ([zero; 4], [zero; 4], [zero; 4]);
        // The static faces that the nearest float does not lie inside of.
        let mut held: Mask = 0;
        for i in 0..4 {
            let (b0, b1) = (s.widen_four(&begin.as_chunks().0[i]), s.widen_four(&end.as_chunks().0[i]));
            still[i] = outward(b0, pad[i]);
            let nearest = s.widen_four(&s.narrow(still[i]));
            held |= (if UPPER { s.le_d(still[i], nearest) } else { s.le_d(nearest, still[i]) }) << (4 * i);
            velocity[i] = if t1 > t0 { (b1 - b0) / duration } else { zero };
            let v = s.widen_four(&s.narrow(velocity[i]));
            let line = beyond(b0 - v * first, b1 - v * last);
            let size = s.max_d(line, zero - line) + s.max_d(v, zero - v);
            moving[i] = outward(line, rounding * size + pad[i]);
        }
        let next = |x: S::F| if UPPER { next_up(s, x) } else { next_down(s, x) };
        let of_still = s.narrow_all(still);
        let of_still = s.select(held, of_still, next(of_still));
        let of_moving = next(s.narrow_all(moving));
        let are_still = s.eq(s.load(begin), s.load(end));
        MovingFaces {
            at: s.select(are_still, of_still, of_moving),
            velocity: s.select(are_still, s.splat(0.0), s.narrow_all(velocity)),
        }
    }
}

/// Linear bounds of the contents of a box of the node that begins at `words[0]`, slightly wider than those that were
/// written.
///
/// Products of f32 are exact in f64, and the rounding of the sum is far less than the f32 step that each face is moved
/// outward.
pub(super) fn read_box(words: &[u32], kind: Kind, lane: usize, over: TimeInterval) -> LinearBox3 {
    let word = |row: usize| f32::from_bits(words[row * LANES + lane]);
    let face = |row: usize, time: f32, side: f64| {
        let velocity = if kind == Kind::Node { word(row + 6) } else { 0.0 };
        match velocity {
            0.0 => word(row),
            _ => {
                let at = (f64::from(word(row)) + f64::from(velocity) * f64::from(time)) as f32;
                if side > 0.0 { at.next_up() } else { at.next_down() }
            }
        }
    };
    let at = |time: f32| Box3 {
        min: Vec3::from([0, 2, 4].map(|row| face(row, time, -1.0))),
        max: Vec3::from([1, 3, 5].map(|row| face(row, time, 1.0))),
    };
    LinearBox3 { begin: at(over.begin()), end: at(over.end()) }
}

/// The next greater floats ([`f32::next_up`]).
#[inline(always)]
fn next_up<S: Simd>(s: S, x: S::F) -> S::F {
    let (zero, bits) = (s.splat(0.0), s.to_bits(x));
    let next = s.select_u(s.lt(x, zero), s.add_u(bits, s.splat_u(u32::MAX)), s.add_u(bits, s.splat_u(1)));
    s.from_bits(s.select_u(s.eq(x, zero), s.splat_u(1), next))
}

/// The next lesser floats ([`f32::next_down`]).
#[inline(always)]
fn next_down<S: Simd>(s: S, x: S::F) -> S::F {
    let (zero, bits) = (s.splat(0.0), s.to_bits(x));
    let next = s.select_u(s.lt(zero, x), s.add_u(bits, s.splat_u(u32::MAX)), s.add_u(bits, s.splat_u(1)));
    s.from_bits(s.select_u(s.eq(x, zero), s.splat_u(0x8000_0001), next))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::wide_node::NODE_ROWS;
    use crate::random::Random;

    /// One face, as its row and its velocity's, by the definition.
    fn face(begin: f32, end: f32, over: TimeInterval, side: f64, pad: f64) -> [f32; 2] {
        if begin == end {
            let x = f64::from(begin) + side * pad;
            let at = x as f32;
            let inside = side * (f64::from(at) - x) < 0.0;
            return [if inside { next(at, side) } else { at }, 0.0];
        }
        let (t0, t1) = (f64::from(over.begin()), f64::from(over.end()));
        let (b0, b1) = (f64::from(begin), f64::from(end));
        let v = ((b1 - b0) / (t1 - t0)) as f32;
        let line = side * (side * (b0 - f64::from(v) * t0)).max(side * (b1 - f64::from(v) * t1));
        let slack = f64::from(f32::EPSILON) * ROUNDINGS * (line.abs() + f64::from(v).abs());
        [next((line + side * (slack + pad)) as f32, side), v]
    }

    fn next(x: f32, side: f64) -> f32 {
        if side > 0.0 { x.next_up() } else { x.next_down() }
    }

    /// Boxes of all sizes and places, some static, some of them points, some around or at zero.
    fn boxes(random: &mut Random) -> Vec<LinearBox3> {
        let mut corner = |i: usize| {
            let p = random.vec() * [1.0, 1e-30, 1e-3, 1e-42][i % 4];
            if i.is_multiple_of(7) { Vec3::new(0.0, p.y, -0.0) } else { p }
        };
        (0..1 + (corner(0).y.abs() * 15.99) as usize)
            .map(|i| {
                let (a, b, c, d) = (corner(i), corner(i + i / 5), corner(i), corner(i + 1));
                let begin = Box3 { min: a.min(b), max: a.max(b) };
                let end = Box3 { min: c.min(d), max: c.max(d) };
                match i % 3 {
                    0 => LinearBox3 { begin, end: begin },
                    1 => LinearBox3 { begin, end },
                    _ => LinearBox3 { begin: Box3 { min: a, max: a }, end: Box3 { min: a, max: a.max(c) } },
                }
            })
            .collect()
    }

    #[test]
    fn rows_are_the_definition_and_the_same_on_all_instruction_sets() {
        let mut random = Random(4);
        for round in 0..2000 {
            let boxes = boxes(&mut random);
            let (a, b) = (random.signed().abs(), random.signed().abs());
            let over =
                if round % 2 == 0 { TimeInterval::FULL } else { TimeInterval::half_open(a.min(b), a.max(b)).unwrap() };
            let lanes = if round % 3 == 0 { Mask::MAX } else { (random.signed().abs() * 65535.0) as Mask };
            let mut rows = BoxRows::NONE;
            boxes.iter().enumerate().for_each(|(lane, b)| rows.set(lane, b));
            for level in SimdLevel::available() {
                let mut words = vec![7; NODE_ROWS * LANES];
                rows.write(&mut words, Kind::Node, lanes, over, level);
                for lane in 0..LANES {
                    for axis in 0..3 {
                        let (low, high) = match boxes.get(lane) {
                            _ if lanes >> lane & 1 == 0 => ([f32::from_bits(7); 2], [f32::from_bits(7); 2]),
                            None => ([NOWHERE, 0.0], [-NOWHERE, 0.0]),
                            Some(b) => {
                                let magnitude = b.begin.magnitude().max(b.end.magnitude());
                                let pad = f64::from(KERNEL_ULPS * ULP) * f64::from(magnitude);
                                (
                                    face(b.begin.min[axis], b.end.min[axis], over, -1.0, pad),
                                    face(b.begin.max[axis], b.end.max[axis], over, 1.0, pad),
                                )
                            }
                        };
                        let word = |row: usize| f32::from_bits(words[row * LANES + lane]);
                        let found = [word(2 * axis), word(2 * axis + 6), word(2 * axis + 1), word(2 * axis + 7)];
                        assert_eq!(found, [low[0], low[1], high[0], high[1]], "{level}, {:?}", boxes.get(lane));
                    }
                }
            }
        }
    }

    /// If the rounding of the query were ignored, one face in a hundred would be computed inside of its bound.
    #[test]
    fn faces_lie_beyond_their_bounds_as_the_query_computes_them() {
        let lost = faces_inside(ROUNDINGS);
        assert!(lost == 0, "{lost} of 1.8 million");
        assert!(faces_inside(0.0) > 1000, "the slack is not needed");
    }

    /// Counts faces, moved by so many roundings, that are computed on the wrong side of their bounds.
    fn faces_inside(roundings: f64) -> usize {
        let mut lost = 0;
        let mut random = Random(1);
        for i in 0..100_000 {
            let scale = if i % 3 == 0 { 1e-4 } else { 1.0 };
            let (a, b) = (random.signed().abs() * scale + 0.5 * random.signed().abs(), random.signed().abs());
            let Some(over) = TimeInterval::half_open(a.min(b), a.max(b)) else { continue };
            let (begin, end) = (random.signed(), random.signed() * scale);
            for side in [-1.0f32, 1.0] {
                let f = face_alone(begin, end, over, side, roundings);
                for j in 0..=8 {
                    let t = (over.begin() + over.duration() * (j as f32 / 8.0)).min(over.end());
                    let w = f64::from(t - over.begin()) / f64::from(over.end() - over.begin()).max(1e-30);
                    let bound = f64::from(begin) + (f64::from(end) - f64::from(begin)) * w.min(1.0);
                    for computed in [f[1].mul_add(t, f[0]), f[1] * t + f[0]] {
                        // The bound itself is computed with the rounding of f64 and of t - begin in f32.
                        let slack = 2.0 * f64::from(f32::EPSILON) * f64::from((end - begin).abs()) * w;
                        lost += usize::from(f64::from(side) * (f64::from(computed) - bound) < -slack);
                    }
                }
            }
        }
        lost
    }

    /// A face that is not padded, moved by so many roundings.
    fn face_alone(begin: f32, end: f32, over: TimeInterval, side: f32, roundings: f64) -> [f32; 2] {
        /// The faces of all sides along x, without padding.
        struct Alone<'a>(Write<'a>, bool);
        impl Kernel for Alone<'_> {
            type Output = [f32; 2];
            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> [f32; 2] {
                let pad = [s.splat_d(0.0); 4];
                let MovingFaces { at, velocity } = match self.1 {
                    true => self.0.faces::<S, true>(s, 0, &pad),
                    false => self.0.faces::<S, false>(s, 0, &pad),
                };
                [s.lane(at, 0), s.lane(velocity, 0)]
            }
        }
        let mut boxes = BoxRows::NONE;
        let point = |x: f32| Box3 { min: Vec3::splat(x), max: Vec3::splat(x) };
        boxes.set(0, &LinearBox3 { begin: point(begin), end: point(end) });
        let write = Write { boxes: &boxes, words: &mut [], moving: true, lanes: 1, over, roundings };
        dispatch(SimdLevel::best(), Alone(write, side > 0.0))
    }

    #[test]
    fn a_static_face_is_its_bound() {
        assert_eq!(face_alone(0.1, 0.1, TimeInterval::FULL, 1.0, ROUNDINGS), [0.1, 0.0]);
    }
}
