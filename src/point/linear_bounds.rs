//! Boxes that move linearly, bounded so that rounding can never let a point out.
//!
//! A face of a moving box is a line over the phase s in [0, 1] between two keys. For a lower face a
//! slope is chosen first and rounded to f32; then the line is lowered until it is below every point
//! (or child face) at both ends of that one's own range. Both are linear, so it is below in between too.
//! Two slopes are tried and the tighter line at mid-range is taken: the mean of what is inside, and the
//! slope between the extremes at both ends.
//!
//! **Padding.** Let M bound the coordinates and u = 2^-24. A point is computed as `base + (b − a)·s` with
//! |s| ≤ 1/2: two roundings of at most 2M·u halved, one of 2M·u halved, one of about M·u: below 4Mu.
//! A face is computed as `a + b·s` with |b| ≤ 2M (a mean or chord of slopes that are at most 2M) and
//! |a| ≤ 3M: below 2Mu + 5Mu. Faces of points are lowered by 16Mu, which covers both and the f64 rounding
//! on the way. Faces around faces are lowered no further: they are below the exact lines of those, and
//! so below the points by the same 16Mu, whatever the level.

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
    pub(super) lo: [[f64; 2]; 3],
    pub(super) hi: [[f64; 2]; 3],
    pub(super) range: [f64; 2],
    pub(super) times: [f32; 2],
}

impl Hull {
    /// The hull as something to be put into a larger one.
    fn span(&self) -> Span {
        let ends = |face: Face| [face.at(self.range[0]), face.at(self.range[1])];
        Span { lo: self.lo.map(ends), hi: self.hi.map(ends), range: self.range, times: self.times }
    }

    /// The hull of points, whose coordinates are at most `magnitude`.
    pub(super) fn of_points(spans: &[Span], magnitude: f32) -> Hull {
        Hull::around(spans, f64::from(magnitude) * (16.0 / 16_777_216.0))
    }

    /// The hull of hulls.
    pub(super) fn of_hulls(hulls: &[Hull]) -> Hull {
        let mut spans = [Span::default(); LANES];
        for (span, hull) in spans.iter_mut().zip(hulls) {
            *span = hull.span();
        }
        Hull::around(&spans[..hulls.len()], 0.0)
    }

    fn around(spans: &[Span], pad: f64) -> Hull {
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
            hull.lo[axis] = below(spans, |span| span.lo[axis], hull.range, whole, pad);
            let above = below(spans, |span| span.hi[axis].map(|x| -x), hull.range, whole, pad);
            hull.hi[axis] = Face { at_zero: -above.at_zero, slope: -above.slope };
        }
        hull
    }
}

/// A line below all the given ones, by `pad`.
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

/// The highest line of about this slope that stays below all the given ones by `pad`.
#[inline(always)]
fn lowered(spans: &[Span], ends: &impl Fn(&Span) -> [f64; 2], slope: f64, pad: f64) -> Face {
    let slope = slope as f32;
    let wide = f64::from(slope);
    let mut least = f64::INFINITY;
    for span in spans {
        let [begin, end] = ends(span);
        least = least.min(begin - wide * span.range[0]).min(end - wide * span.range[1]);
    }
    Face { at_zero: down(least - pad), slope }
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
    use glam::Vec3;

    fn next(state: &mut u64) -> f32 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Faces of three levels of hulls, evaluated as queries do, against points as queries compute them.
    #[test]
    fn no_rounding_lets_a_point_out() {
        let mut state = 3;
        for round in 0..300 {
            // Far from zero, tiny, fast and slow by turns.
            let offset = [0.0, 1000.0, -3.0e7, 1e-20][round % 4];
            let size = [1.0, 1e-3, 1e3, 1e-22][round % 4];
            let speed = [0.0, 1e-4, 1.0, 50.0][round / 4 % 4] * size;
            let mut place = |by: f32| Vec3::new(next(&mut state), next(&mut state), next(&mut state)) * by;
            let ways: Vec<[Vec3; 2]> = (0..64)
                .map(|_| {
                    let a = place(size) + offset;
                    [a, a + place(speed)]
                })
                .collect();
            let magnitude = ways.iter().flatten().map(|p| p.abs().max_element()).fold(0.0, f32::max);
            let range = |i: usize| if round % 3 == 0 { [0.0, 1.0] } else { [0.25 * (i % 3) as f64, 1.0] };
            let span = |(i, way): (usize, &[Vec3; 2])| {
                let at = |s: f64| way[0].as_dvec3() + (way[1].as_dvec3() - way[0].as_dvec3()) * s;
                let ends = range(i).map(at);
                let rows = core::array::from_fn(|axis| ends.map(|p| p[axis]));
                Span { lo: rows, hi: rows, range: range(i), times: [0.0, 2.0] }
            };
            let spans: Vec<Span> = ways.iter().enumerate().map(span).collect();
            let leaves: Vec<Hull> = spans.chunks(8).map(|s| Hull::of_points(s, magnitude)).collect();
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

    #[test]
    fn coherent_motion_keeps_hulls_tight() {
        let spans: Vec<Span> = (0..16)
            .map(|i| {
                let x = f64::from(i) / 16.0;
                Span { lo: [[x, x + 5.0]; 3], hi: [[x, x + 5.0]; 3], range: [0.0, 1.0], times: [0.0, 2.0] }
            })
            .collect();
        let hull = Hull::of_points(&spans, 6.0);
        for s in [0.0, 0.5, 1.0] {
            let width = hull.hi[0].at(s) - hull.lo[0].at(s);
            assert!((0.9375..0.938).contains(&width), "{width} at {s}");
        }
    }
}
