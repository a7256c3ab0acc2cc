//! Pre-splitting references before the build: a long triangle becomes several references, each bounded by its own part
//! (Ernst and Greiner, "Early Split Clipping for Bounding Volume Hierarchies", 2007; the shares after Karras and Aila,
//! "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies", 2013), here for moving triangles.
//!
//! Long triangles fill little of their boxes; their parts fill more. If triangles cross planes because they *move*,
//! splitting does not pay, so only references whose motion is small compared with their length are split.

use super::binning::HALF;
use super::reference::{Packed, Reference};
use super::visits::mean_half_area;
use crate::geometry::{Ends, LinearBox3, ULP};
use crate::parallel::{self, CHUNK};
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};
use crate::tuning::presplit::{LEAST_AREA, MAX_MOTION_RATIO, MIN_SAVING};
use glam::Vec3;

/// The greatest number of sub-references of one reference.
const BINS: usize = 8;

/// Evenly spaced planes across a reference.
#[derive(Clone, Copy)]
struct Planes {
    axis: usize,
    low: f32,
    width: f32,
}

impl Planes {
    /// Planes between `parts` parts of the longest axis; `None` if that is too short, or the motion too fast.
    fn across(bounds: &LinearBox3, parts: usize) -> Option<Planes> {
        let middle = bounds.at(0.5);
        let extent = middle.max - middle.min;
        let axis = extent.max_position();
        let (b, e) = (&bounds.begin, &bounds.end);
        let motion = (e.min[axis] - b.min[axis]).abs().max((e.max[axis] - b.max[axis]).abs());
        let width = extent[axis] / parts as f32;
        let magnitude = middle.min[axis].abs().max(middle.max[axis].abs());
        (width > 4.0 * ULP * magnitude && motion <= MAX_MOTION_RATIO * extent[axis]).then_some(Planes {
            axis,
            low: middle.min[axis],
            width,
        })
    }

    /// The plane below part `k`.
    #[cfg(test)]
    fn plane(self, k: usize) -> f32 {
        self.low + self.width * k as f32
    }
}

/// Splits references into sub-references, up to `budget` times the present number, where that saves most area. The first part
/// replaces the reference, the others are appended.
///
/// In `m` parts a diagonal needle has an `m`-th of its area, so the `m`-th part saves `1 / (m (m - 1))` of it.
/// References are split as long as a part saves at least a threshold; it is raised until the budget suffices.
pub(crate) fn presplit(references: &mut Vec<Reference>, ends: impl Fn(u32) -> Option<Ends> + Sync, budget: f32) {
    let n = references.len();
    let (gains, least) = gains(references, &ends);
    let least = raised(&gains, least, (n as f64 * f64::from(budget)) as usize - n);
    let mut tasks: Vec<_> = references.chunks_mut(CHUNK).zip(&gains).collect();
    let more = parallel::each(&mut tasks, |(references, gains)| {
        dispatch(SimdLevel::best(), Presplit { references, gains, ends: &ends, least })
    });
    references.reserve(more.iter().map(Vec::len).sum());
    more.iter().for_each(|more| references.extend_from_slice(more));
}

/// Splits references: their first sub-references replace them, the others are returned.
struct Presplit<'a, E> {
    references: &'a mut [Reference],
    gains: &'a [Gain],
    ends: &'a E,
    least: f32,
}

impl<E: Fn(u32) -> Option<Ends>> Kernel for Presplit<'_, E> {
    type Output = Vec<Reference>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<Reference> {
        let Presplit { references, gains, ends, least } = self;
        let mut more = Vec::with_capacity(gains.iter().map(|gain| split_count(gain.saved, least) - 1).sum());
        for gain in gains {
            let m = split_count(gain.saved, least);
            if m == 1 {
                continue;
            }
            let r = &mut references[gain.at as usize];
            let Some(planes) = Planes::across(&r.bounds(), m) else { continue };
            let Some(ends) = ends(r.id()) else { continue };
            let mut boxes = [Packed::EMPTY; BINS];
            let pad = ClipBetweenPlanes::pad(&ends);
            ClipBetweenPlanes { ends: &ends, whole: r.packed(), planes, pad, parts: &mut boxes[..m] }.run(s);
            let id = r.id();
            let mut made = boxes[..m].iter().filter(|part| !part.is_empty());
            if let Some(first) = made.next() {
                *r = Reference::of_lanes(s, s.load(&first.0), id);
            }
            for part in made {
                more.push(Reference::of_lanes(s, s.load(&part.0), id));
            }
        }
        more
    }
}

/// The saving of splitting a reference into very many sub-references.
struct Gain {
    /// Its index in its chunk.
    at: u32,
    saved: f32,
}

/// The savings in each chunk, for references where they may be enough for a second part, and the least saving of a
/// part.
fn gains(references: &[Reference], ends: &(impl Fn(u32) -> Option<Ends> + Sync)) -> (Vec<Vec<Gain>>, f32) {
    let area = |r: &Reference| f64::from(mean_half_area(&r.bounds()));
    let areas = parallel::chunks(references.len(), |range| references[range].iter().map(area).sum::<f64>());
    let total = areas.into_iter().fold(0.0, |a, b| a + b);
    let least = (f64::from(MIN_SAVING) * total / references.len().max(1) as f64) as f32;
    // A positive threshold, even if no reference has an area.
    let enough = required_saving(2, least).max(f32::MIN_POSITIVE);
    let gains = parallel::chunks(references.len(), |range| {
        let mut gains = Vec::with_capacity(range.len());
        for (at, r) in (0..).zip(&references[range]) {
            let bounds = r.bounds();
            let area = mean_half_area(&bounds);
            // The triangle itself is fetched only if its box is large enough.
            if area >= enough
                && Planes::across(&bounds, BINS).is_some()
                && let Some(ends) = ends(r.id())
            {
                let saved = area - LEAST_AREA * ends.area();
                if saved >= enough {
                    gains.push(Gain { at, saved });
                }
            }
        }
        gains
    });
    (gains, least)
}

/// The total saving at which an `m`-th part pays, if a part must save `least`.
fn required_saving(m: usize, least: f32) -> f32 {
    (m * (m - 1)) as f32 * least
}

/// The number of parts for a total saving.
fn split_count(gain: f32, least: f32) -> usize {
    (2..=BINS).take_while(|&m| gain >= required_saving(m, least)).count() + 1
}

/// The smallest threshold, at least `least`, for which at most `most` parts are added.
///
/// Savings are counted in classes, the upper bits of a float, which are 3 percent wide; thresholds above `least` do not
/// distinguish savings within a class.
fn raised(gains: &[Vec<Gain>], least: f32, most: usize) -> f32 {
    const BITS: u32 = 18;
    let class = |x: f32| (x.to_bits() >> BITS) as usize;
    let mut above = vec![0usize; class(f32::INFINITY) + 1];
    for gain in gains.iter().flatten() {
        above[class(gain.saved)] += 1;
    }
    for c in (1..above.len()).rev() {
        above[c - 1] += above[c];
    }
    let made = |least: f32| (2..=BINS).map(|m| above[class(required_saving(m, least))]).sum::<usize>();
    let mut raised = least;
    while made(raised) > most {
        raised = f32::from_bits((class(raised) as u32 + 1) << BITS);
    }
    raised
}

/// Clips a moving triangle at successive planes: linear bounds of the parts between them.
///
/// Proof that the bounds hold each part at every time. The part between two planes is a convex polygon; its corners are
/// corners of the triangle, or points where an edge meets a plane.
/// - A corner moves on a line, so it is in the bins between the two it begins and ends in; all of them include it at
///   both ends.
/// - Let an edge p(t) q(t) meet a plane at p + u (q - p). The distances of p and q to the plane are linear in t, so u
///   is a quotient of two linear functions, monotone while the edge meets the plane. It begins to meet it at the
///   beginning of the interval or when p (u = 0) or q (u = 1) enters the plane, and likewise ends; so u stays between
///   the least and the greatest of those values. For a fixed u the point moves on a line, and at any time the points
///   are linear in u: including the extreme points at both ends of the interval includes all in between. Of these, p
///   and q are corners, and one that enters the plane is in both adjacent bins already.
///
/// The points are computed with three roundings at sizes of at most twice the largest coordinate (8 ULP of it cover
/// them), and the kernel's corners deviate from the lines by `slack`.
struct ClipBetweenPlanes<'a> {
    ends: &'a Ends,
    /// Bounds of the triangle, or of the part of it that is to be split.
    whole: &'a Packed,
    planes: Planes,
    /// The padding of the parts: [`ClipBetweenPlanes::pad`].
    pad: f32,
    /// The bounds of each part; empty for a part that the triangle does not reach.
    parts: &'a mut [Packed],
}

impl ClipBetweenPlanes<'_> {
    /// The padding of the parts of a triangle: the rounding error of the computed points, and the slack of the corners.
    #[inline(always)]
    fn pad(ends: &Ends) -> f32 {
        let mut greatest = Vec3::ZERO;
        for (begin, end) in ends.begin.iter().zip(&ends.end) {
            greatest = greatest.max(begin.abs()).max(end.abs());
        }
        ends.slack + 8.0 * ULP * greatest.max_element()
    }
}

impl Kernel for ClipBetweenPlanes<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let ClipBetweenPlanes { ends, whole, planes, pad, parts } = self;
        let (axis, last) = (planes.axis, parts.len().clamp(1, BINS) - 1);
        // The planes above the parts, in both halves of the lanes.
        let above = s.splat(planes.low) + s.splat(planes.width) * s.load(&ABOVE);
        let (zero, nothing, never) = (s.splat(0.0), s.splat(f32::INFINITY), s.splat(f32::NAN));
        let mut corners = [nothing; 3];
        // For each part: 0 if it includes the corner, otherwise NaN, which a minimum ignores.
        let mut held = [[0.0; LANES]; 3];
        // For each plane above a part: where the edge meets it at the beginning and at the end, or NaN.
        let mut met = [[0.0; LANES]; 3];
        for i in 0..3 {
            let j = (i + 1) % 3;
            corners[i] = s.load(&Packed::point(ends.begin[i], ends.end[i]).0);
            let (p0, p1) = (ends.begin[i][axis], ends.end[i][axis]);
            let (q0, q1) = (ends.begin[j][axis], ends.end[j][axis]);
            let reaches = s.le(above, s.splat(p0.max(p1))) << 1 | 1;
            let begins = s.le(s.splat(p0.min(p1)), above) | 1 << last;
            s.store(s.select(reaches & begins, zero, never), &mut held[i]);
            let p = s.select(HALF, s.splat(p0), s.splat(p1)) - above;
            let q = s.select(HALF, s.splat(q0), s.splat(q1)) - above;
            // If the distances are equal and the edge meets the plane at all, both are 0: it is met at the corner.
            let at = s.select(s.eq(p, q), zero, p / (p - q));
            let at = s.max(s.min(at, s.splat(1.0)), zero);
            let apart = s.le(s.min(p, q), zero) & s.le(zero, s.max(p, q));
            s.store(s.select(apart, at, never), &mut met[i]);
        }
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        // Outward is down in every lane. Each face is the whole's where that is tighter on average.
        let pad = s.splat(pad);
        let (whole, other) = (s.load(&whole.0), s.load_u(&OTHER_END));
        let mean = whole + s.permute(whole, other);
        let mut below = nothing;
        for (k, part) in parts.iter_mut().enumerate().take(BINS) {
            let (mut own, mut above) = (below, nothing);
            for i in 0..3 {
                own = s.min(corners[i] + s.splat(held[i][k]), own);
                if k < last {
                    above = s.min(corners[i] + edges[i] * s.splat(met[i][k]), above);
                    above = s.min(corners[i] + edges[i] * s.splat(met[i][k + BINS]), above);
                }
            }
            let own = s.min(own, above) - pad;
            let looser = s.lt(own + s.permute(own, other), mean);
            s.store(s.select(looser, whole, own), &mut part.0);
            below = above;
        }
    }
}

/// The number of parts below the plane in each lane.
const ABOVE: Lanes<f32> = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];

/// The lane of the same face at the other end of the interval.
const OTHER_END: Lanes<u32> = [3, 4, 5, 0, 1, 2, 6, 7, 11, 12, 13, 8, 9, 10, 14, 15];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::primitive::{PrimitiveSet, TriangleMesh, Triangles};
    use crate::random::Random;
    use crate::time::time_slice;

    /// The parts of a triangle between planes, computed by one of the instruction sets.
    fn parts_of(planes: Planes, bounds: &LinearBox3, ends: &Ends, pad: f32, round: usize) -> [LinearBox3; BINS] {
        let (whole, mut parts) = (Packed::new(bounds), [Packed::EMPTY; BINS]);
        let level = SimdLevel::available()[round % SimdLevel::available().len()];
        dispatch(level, ClipBetweenPlanes { ends, whole: &whole, planes, pad, parts: &mut parts });
        parts.map(|part| part.bounds())
    }

    #[test]
    fn needles_are_split_within_the_budget_and_the_longest_most() {
        let mut random = Random(3);
        let mut needles: Vec<Ends> = Vec::new();
        for i in 0..1000 {
            let length = if i % 10 == 0 { 0.9 } else { 0.1 };
            let (at, along, thick) = (random.vec() * 0.1, random.vec() * length, random.vec() * 1e-3);
            let begin = [at, at + along, at + thick];
            needles.push(Ends { begin, end: begin, slack: 0.0 });
        }
        let again = |i: u32| Ends { begin: needles[i as usize].begin, end: needles[i as usize].end, slack: 0.0 };
        let references: Vec<Reference> = (0..1000u32)
            .map(|i| {
                let b = needles[i as usize].begin.into_iter().fold(Box3::EMPTY, Box3::include);
                Reference::new(LinearBox3 { begin: b, end: b }, i)
            })
            .collect();
        for (budget, least) in [(1.0, 1000), (1.2, 1120), (3.0, 1300)] {
            let mut parts = references.clone();
            presplit(&mut parts, |i| Some(again(i)), budget);
            assert!(parts.len() as f32 <= 1000.0 * budget && parts.len() >= least, "{budget}: {}", parts.len());
            let of = |long: bool| parts.iter().filter(|r| (r.id() % 10 == 0) == long).count();
            assert!(budget == 1.0 || of(true) > 2 * 100 && of(false) < 2 * 900);
            assert!(parts.iter().all(|r| {
                let (part, whole) = (r.bounds().begin, references[r.id() as usize].bounds().begin);
                part.min.cmpge(whole.min).all() && part.max.cmple(whole.max).all()
            }));
        }
        // References without area gain nothing.
        let line = |i: u32| {
            let at = Vec3::new(Random(5 + u64::from(i)).signed(), 0.0, 0.0);
            Ends { begin: [at, at + 0.1 * Vec3::X, at], end: [at, at + 0.1 * Vec3::X, at], slack: 0.0 }
        };
        let boxed = |i: u32| line(i).begin.into_iter().fold(Box3::EMPTY, Box3::include);
        let mut lines: Vec<Reference> =
            (0..100).map(|i| Reference::new(LinearBox3 { begin: boxed(i), end: boxed(i) }, i)).collect();
        presplit(&mut lines, |i| Some(line(i)), 3.0);
        assert_eq!(lines.len(), 100);
        let mut uncut = references.clone();
        presplit(&mut uncut, |_| None, 3.0);
        assert_eq!(uncut.len(), 1000);
        presplit(&mut Vec::new(), |_| None, 3.0);
    }

    #[test]
    fn every_point_of_a_moving_triangle_is_in_a_part_of_its_bin() {
        let mut random = Random(17);
        for round in 0..3000 {
            let motion = [0.0, 0.02, 0.3, 2.0][round % 4];
            let mut point = |scale: f32| random.vec() * scale;
            let begin = [point(0.6), point(0.6), point(0.6)];
            let end = begin.map(|p| (p + point(motion)).clamp(Vec3::NEG_ONE, Vec3::ONE));
            let corners = Ends { begin, end, slack: 0.0 };
            let bounds = LinearBox3 {
                begin: begin.into_iter().fold(Box3::EMPTY, Box3::include),
                end: end.into_iter().fold(Box3::EMPTY, Box3::include),
            };
            let middle = bounds.at(0.5);
            let axis = round % 3;
            let width = (middle.max[axis] - middle.min[axis]) / BINS as f32;
            if width <= 4.0 * ULP {
                continue;
            }
            let planes = Planes { axis, low: middle.min[axis], width };
            let parts = parts_of(planes, &bounds, &corners, ClipBetweenPlanes::pad(&corners), round / 4);
            for step in 0..=8 {
                let t = step as f32 / 8.0;
                let now: [Vec3; 3] = core::array::from_fn(|i| begin[i] + (end[i] - begin[i]) * t);
                for i in 0..=12 {
                    for j in 0..=12 - i {
                        let (u, v) = (i as f32 / 12.0, j as f32 / 12.0);
                        let p = now[0] * (1.0 - u - v) + now[1] * u + now[2] * v;
                        let held = parts.iter().enumerate().any(|(k, part)| {
                            let b = part.at(t).pad(4.0 * ULP);
                            let x = p[planes.axis];
                            let inside = k == 0 || x >= planes.plane(k) - 4.0 * ULP;
                            let inside = inside && (k + 1 == BINS || x <= planes.plane(k + 1) + 4.0 * ULP);
                            inside && p.cmpge(b.min).all() && p.cmple(b.max).all()
                        });
                        assert!(held, "round {round}, t {t}, {p}");
                    }
                }
            }
        }
    }

    /// Counts points of the edges of moving triangles beside the planes, in f64, that are in no part.
    fn points_lost(pad_of: impl Fn(&Ends) -> f32) -> usize {
        let (mut random, mut lost) = (Random(29), 0);
        for round in 0..4000 {
            let motion = [0.0, 0.02, 0.3][round % 3];
            let mut point = |scale: f32| random.vec() * scale;
            let begin = [point(0.7), point(0.7), point(0.7)];
            let end = begin.map(|p| p + point(motion));
            let ends = Ends { begin, end, slack: 0.0 };
            let hull = |corners: [Vec3; 3]| corners.into_iter().fold(Box3::EMPTY, Box3::include);
            let bounds = LinearBox3 { begin: hull(begin), end: hull(end) };
            let Some(planes) = Planes::across(&bounds, BINS) else { continue };
            let parts = parts_of(planes, &bounds, &ends, pad_of(&ends), round);
            let axis = planes.axis;
            for (t, at) in [(0.0, begin), (1.0, end)] {
                for i in 0..3 {
                    let (p, q) = (at[i].as_dvec3(), at[(i + 1) % 3].as_dvec3());
                    for k in 1..BINS {
                        let u = (f64::from(planes.plane(k)) - p[axis]) / (q[axis] - p[axis]);
                        for beside in [-1e-8, 0.0, 1e-8] {
                            let u = u + beside;
                            if !(0.0..=1.0).contains(&u) {
                                continue;
                            }
                            let x = p + (q - p) * u;
                            let holds = |part: &LinearBox3| {
                                let b = if t == 0.0 { part.begin } else { part.end };
                                (x.cmpge(b.min.as_dvec3()) & x.cmple(b.max.as_dvec3())).all()
                            };
                            lost += usize::from(!parts.iter().any(holds));
                        }
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn the_padding_of_parts_is_enough_and_needed() {
        assert_eq!(points_lost(ClipBetweenPlanes::pad), 0);
        assert!(points_lost(|_| 0.0) > 100);
    }

    /// Counts corners, as the kernel computes them at times of a slice, that are in no part. They move far in other segments,
    /// into which the slice reaches.
    fn corners_lost(pad_of: impl Fn(&Ends) -> f32) -> usize {
        let (mut random, mut lost) = (Random(31), 0);
        for round in 0..600 {
            let keys = [3, 9, 100][round % 3];
            let segment = (random.unit() * (keys - 1) as f32) as usize;
            let near = [(); 3].map(|()| random.vec() * 0.9);
            let mut at = |key: usize| {
                let here = (segment..segment + 2).contains(&key);
                near.map(|p| if here { p + random.vec() * 0.01 } else { random.vec() }).to_vec()
            };
            let mesh = TriangleMesh::new(vec![[0, 1, 2]], (0..keys).map(&mut at).collect::<Vec<_>>());
            let (set, over) = (Triangles::new(&[mesh]).unwrap(), time_slice(segment, keys - 1));
            let (bounds, ends) = (set.bounds(0, over), PrimitiveSet::ends(&set, 0, over).unwrap());
            let Some(planes) = Planes::across(&bounds, BINS) else { continue };
            let parts = parts_of(planes, &bounds, &ends, pad_of(&ends), round);
            for step in 0..=64 {
                let t = (over.begin() + over.duration() * (step as f32 / 64.0)).min(over.end());
                let w = f64::from(t - over.begin()) / over.fine_duration();
                let face = |a: Vec3, b: Vec3| a.as_dvec3().lerp(b.as_dvec3(), w);
                lost += set
                    .corners(0, t)
                    .into_iter()
                    .map(Vec3::as_dvec3)
                    .filter(|p| {
                        let holds = |part: &LinearBox3| {
                            let (LinearBox3 { begin, end }, p) = (part, *p);
                            (p.cmpge(face(begin.min, end.min)) & p.cmple(face(begin.max, end.max))).all()
                        };
                        !parts.iter().any(holds)
                    })
                    .count();
            }
        }
        lost
    }

    #[test]
    fn parts_hold_corners_that_leave_their_line_and_would_not_without_its_slack() {
        assert_eq!(corners_lost(ClipBetweenPlanes::pad), 0);
        assert!(corners_lost(|ends| ClipBetweenPlanes::pad(ends) - ends.slack) > 100);
    }
}
