//! Boxes that move linearly, bounded so that rounding can never let a point out.
//!
//! A face of a moving box is a line over the phase s in [0, 1] between two keys. For a lower face a
//! slope is chosen first and rounded to f32; then the line is lowered until it is below every point
//! (or child face) at both ends of that one's own range. Both are linear, so it is below in between too.
//! Two slopes are tried and the tighter line at mid-range is taken: the mean of what is inside, and the
//! slope between the extremes at both ends.
//!
//! **Padding.** Let u = 2^-24. A point on its way from a to b is computed as `base + (b − a)·s` with |s| ≤ 1/2: the
//! difference is rounded by at most |b − a|u and then halved at least, the product by |b − a|u/2, the sum, which lies
//! between a and b, by max(|a|, |b|)u: together e = (|b − a| + max(|a|, |b|))u ([`Span::of_point`]). A face is computed
//! as `a + b·s` with s in [0, 1]: the product is rounded by |b|u, the sum by (|a| + |b|)u: together f = (|a| + 2|b|)u.
//! A lower face stays below its points by e of each and below that by its own f; around other faces, by its own f
//! only: it is below their exact lines. Both bounds are raised by 2^-10 of themselves, which covers the f64 rounding on
//! the way, and by 2^-148 for products that underflow. They hold per axis, and follow what is in the box: a point
//! far away pads the boxes that hold it and no others.

use crate::simd::{LANES, Lanes};

/// Rows of sixteen boxes whose faces are `a + b·s`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct LinearBoxes {
    pub(super) lo: [Lanes<f32>; 3],
    pub(super) lo_slope: [Lanes<f32>; 3],
    pub(super) hi: [Lanes<f32>; 3],
    pub(super) hi_slope: [Lanes<f32>; 3],
}

impl LinearBoxes {
    /// Sixteen absent boxes.
    pub(super) const NONE: LinearBoxes = LinearBoxes {
        lo: [[f32::INFINITY; LANES]; 3],
        lo_slope: [[0.0; LANES]; 3],
        hi: [[f32::NEG_INFINITY; LANES]; 3],
        hi_slope: [[0.0; LANES]; 3],
    };

    /// Lower and upper faces, each lane at a phase of its own.
    #[inline(always)]
    pub(super) fn faces(&self, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, (at, slope)) in faces.iter_mut().zip([(&self.lo, &self.lo_slope), (&self.hi, &self.hi_slope)]) {
            for axis in 0..3 {
                for lane in 0..LANES {
                    faces[axis][lane] = f64::from(at[axis][lane]) + f64::from(slope[axis][lane]) * phase[lane];
                }
            }
        }
        faces
    }

    /// Sets one lane.
    pub(super) fn set(&mut self, lane: usize, hull: &Hull) {
        for axis in 0..3 {
            self.lo[axis][lane] = hull.lo[axis].at_zero;
            self.lo_slope[axis][lane] = hull.lo[axis].slope;
            self.hi[axis][lane] = hull.hi[axis].at_zero;
            self.hi_slope[axis][lane] = hull.hi[axis].slope;
        }
    }
}

/// A face: `at_zero + slope·s`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Face {
    at_zero: f32,
    slope: f32,
}

impl Face {
    fn at(self, s: f64) -> f64 {
        f64::from(self.at_zero) + f64::from(self.slope) * s
    }
}

/// A box that moves linearly over a range of phases, and the times at which anything in it is alive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hull {
    lo: [Face; 3],
    hi: [Face; 3],
    /// First and last phase for which the faces hold.
    range: [f64; 2],
    /// Begin and end bound in time.
    pub(super) times: [f32; 2],
}

/// What a hull is put around: positions of lower and upper faces at both ends of a range.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Span {
    lo: [[f64; 2]; 3],
    hi: [[f64; 2]; 3],
    /// How far a computed position may be from the exact one.
    error: [f64; 3],
    range: [f64; 2],
    pub(super) times: [f32; 2],
}

/// Bound of the relative rounding of one operation, with room for that of f64 on the way.
const UNIT: f64 = (1.0 + 1.0 / 1024.0) / 16_777_216.0;

/// Bound of what underflow adds: twice the least f32.
const TINY: f64 = 2.0 * f32::from_bits(1) as f64;

impl Span {
    /// A point on its way from `a` to `b`, from one phase to another.
    pub(super) fn of_point(a: [f32; 3], b: [f32; 3], range: [f64; 2], times: [f32; 2]) -> Span {
        let [a, b] = [a, b].map(|p| p.map(f64::from));
        let ends = core::array::from_fn(|i| range.map(|s| a[i] + (b[i] - a[i]) * s));
        let error = core::array::from_fn(|i| UNIT * ((b[i] - a[i]).abs() + a[i].abs().max(b[i].abs())) + TINY);
        Span { lo: ends, hi: ends, error, range, times }
    }

    /// Length of its range.
    pub(super) fn duration(&self) -> f64 {
        self.range[1] - self.range[0]
    }
}

/// Multiples of the paddings that are applied: 1, except where a test shows that less loses points.
#[derive(Clone, Copy)]
struct Padding {
    point: f64,
    face: f64,
}

const FULL: Padding = Padding { point: 1.0, face: 1.0 };

impl Hull {
    /// The hull as something to be put into a larger one.
    fn span(&self) -> Span {
        let ends = |face: Face| [face.at(self.range[0]), face.at(self.range[1])];
        let [lo, hi] = [self.lo.map(ends), self.hi.map(ends)];
        Span { lo, hi, error: [0.0; 3], range: self.range, times: self.times }
    }

    /// The hull of points.
    pub(super) fn of_points(spans: &[Span]) -> Hull {
        Hull::around(spans, FULL)
    }

    /// The hull of hulls.
    pub(super) fn of_hulls(hulls: &[Hull]) -> Hull {
        let mut spans = [Span::default(); LANES];
        for (span, hull) in spans.iter_mut().zip(hulls) {
            *span = hull.span();
        }
        Hull::around(&spans[..hulls.len()], FULL)
    }

    fn around(spans: &[Span], padding: Padding) -> Hull {
        let mut hull = Hull {
            lo: [Face::default(); 3],
            hi: [Face::default(); 3],
            range: [f64::INFINITY, f64::NEG_INFINITY],
            times: [f32::INFINITY, f32::NEG_INFINITY],
        };
        for span in spans {
            hull.range = [hull.range[0].min(span.range[0]), hull.range[1].max(span.range[1])];
            hull.times = [hull.times[0].min(span.times[0]), hull.times[1].max(span.times[1])];
        }
        let whole = spans.iter().all(|span| span.range == hull.range);
        for axis in 0..3 {
            let error = |span: &Span| span.error[axis] * padding.point;
            let low = |span: &Span| span.lo[axis].map(|x| x - error(span));
            let high = |span: &Span| span.hi[axis].map(|x| -x - error(span));
            hull.lo[axis] = below(spans, low, hull.range, whole, padding.face);
            let above = below(spans, high, hull.range, whole, padding.face);
            hull.hi[axis] = Face { at_zero: -above.at_zero, slope: -above.slope };
        }
        hull
    }
}

/// A line that is computed below all the given ones.
#[inline(always)]
fn below(spans: &[Span], ends: impl Fn(&Span) -> [f64; 2], range: [f64; 2], whole: bool, pad: f64) -> Face {
    let length = range[1] - range[0];
    let (mut rise, mut duration) = (0.0, 0.0);
    let mut least = [f64::INFINITY; 2];
    for span in spans {
        let [begin, end] = ends(span);
        rise += end - begin;
        duration += span.range[1] - span.range[0];
        least = [least[0].min(begin), least[1].min(end)];
    }
    let mean = lowered(spans, &ends, if duration > 0.0 { rise / duration } else { 0.0 }, pad);
    if !whole || length <= 0.0 {
        return mean;
    }
    let chord = lowered(spans, &ends, (least[1] - least[0]) / length, pad);
    let middle = 0.5 * (range[0] + range[1]);
    if chord.at(middle) > mean.at(middle) { chord } else { mean }
}

/// The highest line of about this slope that is computed below all the given ones.
#[inline(always)]
fn lowered(spans: &[Span], ends: &impl Fn(&Span) -> [f64; 2], slope: f64, pad: f64) -> Face {
    let slope = slope as f32;
    let wide = f64::from(slope);
    let mut least = f64::INFINITY;
    for span in spans {
        let [begin, end] = ends(span);
        least = least.min(begin - wide * span.range[0]).min(end - wide * span.range[1]);
    }
    let error = UNIT * (least.abs() + 2.0 * wide.abs()) + TINY;
    Face { at_zero: down(least - error * pad), slope }
}

/// The greatest f32 at or below.
fn down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::KeyTime;
    use crate::random::Random;
    use glam::Vec3;

    /// Points on their ways: far from zero, tiny, fast and slow by turns, some of them with one that is far away.
    fn ways(round: usize, random: &mut Random) -> Vec<[Vec3; 2]> {
        let offset = [0.0, 1000.0, -3.0e7, 1e-20, 1e-42][round % 5];
        let size = [1.0, 1e-3, 1e3, 1e-22, 1e-43][round % 5];
        let speed = [0.0, 1e-4, 1.0, 50.0][round / 5 % 4] * size;
        let mut place = |by: f32| random.vec() * by;
        let mut ways: Vec<[Vec3; 2]> = (0..64)
            .map(|_| {
                let a = place(size) + offset;
                [a, a + place(speed)]
            })
            .collect();
        if round.is_multiple_of(7) {
            ways[13] = [place(1e9 * size), place(1e9 * size)];
        }
        ways
    }

    /// Faces of three levels of hulls and points, both as queries compute them.
    #[test]
    fn no_rounding_lets_a_point_out() {
        let mut random = Random(3);
        for round in 0..300 {
            let ways = ways(round, &mut random);
            let range = |i: usize| if round % 3 == 0 { [0.0, 1.0] } else { [0.25 * (i % 3) as f64, 1.0] };
            let span = |(i, way): (usize, &[Vec3; 2])| {
                Span::of_point(way[0].to_array(), way[1].to_array(), range(i), [0.0, 2.0])
            };
            let spans: Vec<Span> = ways.iter().enumerate().map(span).collect();
            let leaves: Vec<Hull> = spans.chunks(8).map(Hull::of_points).collect();
            let nodes: Vec<Hull> = leaves.chunks(4).map(Hull::of_hulls).collect();
            let root = Hull::of_hulls(&nodes);
            for step in 0..=40 {
                let at = KeyTime::new(step as f32 / 40.0, 2);
                let phase = if at.from_end { at.s + 1.0 } else { at.s };
                for (i, way) in ways.iter().enumerate() {
                    if f64::from(phase) < range(i)[0] {
                        continue;
                    }
                    let p = at.position(way[0], way[1]);
                    for hull in [&leaves[i / 8], &nodes[i / 32], &root] {
                        for axis in 0..3 {
                            let face = |f: Face| f.at_zero + f.slope * phase;
                            let (lo, hi) = (face(hull.lo[axis]), face(hull.hi[axis]));
                            assert!(lo <= p[axis] && p[axis] <= hi, "round {round}, point {i}: {lo} {p} {hi}");
                        }
                    }
                }
            }
        }
    }

    /// How often a point is computed outside of a box that touches it at one end of the range of phases for which it
    /// counts. The other points of the box hold the slope of the face far from its own. Either it is fast and passes zero
    /// there, and they stand; or it stands near zero, and they are fast.
    fn lost_where_faces_touch(fast: bool, padding: Padding) -> usize {
        let (mut random, mut lost) = (Random(3), 0);
        for _ in 0..2000 {
            let [r, w, o] = [(); 3].map(|()| 0.5 + 0.45 * random.signed());
            let (way, range) = if fast { ([-w * r, w * (1.0 - r)], [r, 1.0]) } else { ([1e-3 * w; 2], [0.0, r]) };
            let other = if fast { [3.0; 2] } else { [0.5 + o, 0.5 + o + w] };
            let span =
                |[a, b]: [f32; 2], range: [f32; 2]| Span::of_point([a; 3], [b; 3], range.map(f64::from), [0.0, 2.0]);
            let mut spans = [span(other, [0.0, 1.0]); LANES];
            spans[0] = span(way, range);
            let face = Hull::around(&spans, padding).lo[0];
            let [a, b] = way;
            let p = if r < 0.5 { a + (b - a) * r } else { b + (b - a) * (r - 1.0) };
            lost += usize::from(face.at_zero + face.slope * r > p);
        }
        lost
    }

    #[test]
    fn each_padding_is_needed() {
        for (fast, less) in [(true, Padding { point: 0.0, ..FULL }), (false, Padding { face: 0.0, ..FULL })] {
            assert_eq!(lost_where_faces_touch(fast, FULL), 0);
            assert!(lost_where_faces_touch(fast, less) > 20, "a padding that no point needs; fast {fast}");
        }
    }

    /// A point a million sizes away, in the same leaf or not, pads no axis along which it lies near.
    #[test]
    fn padding_follows_what_is_in_the_box() {
        let mut random = Random(5);
        let mut place = || [random.signed(), random.signed(), random.signed()];
        let mut spans: Vec<Span> = (0..16).map(|_| Span::of_point(place(), place(), [0.0, 1.0], [0.0, 2.0])).collect();
        let width = |hull: &Hull, axis: usize| hull.hi[axis].at(0.5) - hull.lo[axis].at(0.5);
        let before = Hull::of_points(&spans);
        spans[3] = Span::of_point([1e6, 0.1, 0.2], [-1e6, 0.2, 0.1], [0.0, 1.0], [0.0, 2.0]);
        let after = Hull::of_points(&spans);
        for axis in 1..3 {
            assert!(width(&after, axis) < width(&before, axis) + 1e-6, "axis {axis}");
        }
    }

    #[test]
    fn coherent_motion_keeps_hulls_tight() {
        let spans: Vec<Span> = (0..16)
            .map(|i| {
                let x = i as f32 / 16.0;
                Span::of_point([x; 3], [x + 5.0; 3], [0.0, 1.0], [0.0, 2.0])
            })
            .collect();
        let hull = Hull::of_points(&spans);
        for s in [0.0, 0.5, 1.0] {
            let width = hull.hi[0].at(s) - hull.lo[0].at(s);
            assert!((0.9375..0.938).contains(&width), "{width} at {s}");
        }
    }
}
