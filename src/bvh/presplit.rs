//! Pre-splitting references before the build: a long triangle becomes several references, each bounded by its own part
//! (Ernst and Greiner, "Early Split Clipping for Bounding Volume Hierarchies", 2007; the shares after Karras and Aila,
//! "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies", 2013), here for moving triangles.
//!
//! Long triangles fill little of their boxes; their parts fill more. Planes across a triangle at the middle of the interval divide
//! it into parts that then move with it: each is bounded by the bounds of its own corners, however far it moves.

use super::reference::{Packed, Reference};
use super::visits::{SurfaceDensity, mean_half_area};
use crate::geometry::{CornerBounds, ULP};
use crate::parallel::{self, CHUNK};
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};
use crate::tuning::presplit::{LEAST_AREA, MIN_SAVING};
use glam::Vec3;

/// The greatest number of sub-references of one reference.
const BINS: usize = 8;

/// Evenly spaced planes across a triangle in the middle of the interval.
#[derive(Clone, Copy)]
struct Planes {
    axis: usize,
    low: f32,
    width: f32,
}

impl Planes {
    /// Planes between `parts` parts along the longest axis of a triangle with these corners; `None` if it is too short.
    #[inline(always)]
    fn across([a, b, c]: [Vec3; 3], parts: usize) -> Option<Planes> {
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let extent = max - min;
        let axis = extent.max_position();
        let width = extent[axis] / parts as f32;
        let magnitude = min[axis].abs().max(max[axis].abs());
        (width > 4.0 * ULP * magnitude).then_some(Planes { axis, low: min[axis], width })
    }
}

/// Splits references into sub-references, up to `budget` times the present number, where that saves most area. The first part
/// replaces the reference, the others are appended.
///
/// In `m` parts a diagonal needle has an `m`-th of its area, so the `m`-th part saves `1 / (m (m - 1))` of it.
/// References are split as long as a part saves at least a threshold; it is raised until the budget suffices.
pub(crate) fn presplit(
    references: &mut Vec<Reference>,
    corners: impl Fn(u32) -> Option<CornerBounds> + Sync,
    budget: f32,
) {
    let n = references.len();
    let (gains, least) = gains(references, &corners);
    let least = raised(&gains, least, (n as f64 * f64::from(budget)) as usize - n);
    let mut tasks: Vec<_> = references.chunks_mut(CHUNK).zip(&gains).collect();
    let more = parallel::each(&mut tasks, |(references, gains)| {
        dispatch(SimdLevel::best(), Presplit { references, gains, corners: &corners, least })
    });
    references.reserve(more.iter().map(Vec::len).sum());
    more.iter().for_each(|more| references.extend_from_slice(more));
}

/// Splits references: their first sub-references replace them, the others are returned.
struct Presplit<'a, C> {
    references: &'a mut [Reference],
    gains: &'a [Gain],
    corners: &'a C,
    least: f32,
}

impl<C: Fn(u32) -> Option<CornerBounds>> Kernel for Presplit<'_, C> {
    type Output = Vec<Reference>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<Reference> {
        let Presplit { references, gains, corners, least } = self;
        let mut more = Vec::with_capacity(gains.iter().map(|gain| split_count(gain.saved, least) - 1).sum());
        for gain in gains {
            let m = split_count(gain.saved, least);
            if m == 1 {
                continue;
            }
            let r = &mut references[gain.at as usize];
            let Some(corners) = corners(r.id()) else { continue };
            let middle = corners.middle();
            let Some(planes) = Planes::across(middle, m) else { continue };
            let mut boxes = [Packed::EMPTY; BINS];
            let parts = &mut boxes[..m];
            ClipBetweenPlanes {
                corners: &corners,
                middle,
                whole: r.packed(),
                planes,
                pad: corners.pad_of_means(),
                parts,
            }
            .run(s);
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
fn gains(references: &[Reference], corners: &(impl Fn(u32) -> Option<CornerBounds> + Sync)) -> (Vec<Vec<Gain>>, f32) {
    let total = SurfaceDensity::NONE.visits_of_all(references);
    // Not minus zero, which the sum of nothing is.
    let least = (MIN_SAVING * total / references.len().max(1) as f32).abs();
    // A positive threshold, even if no reference has an area.
    let enough = required_saving(2, least).max(f32::MIN_POSITIVE);
    let gains = parallel::chunks(references.len(), |range| {
        let mut gains = Vec::with_capacity(range.len());
        for (at, r) in (0..).zip(&references[range]) {
            let area = mean_half_area(&r.bounds());
            // The triangle itself is fetched only if its box is large enough.
            if area >= enough
                && let Some(corners) = corners(r.id())
                && Planes::across(corners.middle(), BINS).is_some()
            {
                // What no part falls below: the bounds of a corner, which are larger than it if its motion is bent.
                let [a, b, c] = &corners.corners;
                let corner = mean_half_area(a).max(mean_half_area(b)).max(mean_half_area(c));
                let saved = area - corner - LEAST_AREA * corners.area();
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

/// Divides a moving triangle at successive planes: linear bounds of the parts between them.
///
/// Proof that the bounds hold the triangle at every time. A plane meets two edges in the middle of the interval, at fractions u of
/// them, which are kept at all other times: its *chord* ends where these points of the edges move. The bounds of a part hold the
/// ends of the chords below and above it, and the corners in between.
/// - An end of a chord is a mean of two corners with fixed weights, so the same mean of their linear bounds holds it at all times,
///   and bounds that hold some points hold all points between these.
/// - Every point of the triangle lies on a chord that is obtained by moving the ends of one chord along the edges to those of the
///   next one, beginning at the lowest corner and ending at the highest: such a motion sweeps the whole triangle, also if fractions
///   are rounded, even if two chords cross. On its way it meets the chord's own ends and corners that lie between both planes only,
///   so it stays in the part's bounds. The comparisons that tell between which planes a corner lies are exact.
///
/// The points are computed with three roundings at sizes of at most twice the largest coordinate (8 ULP of it cover them), and
/// the corners of queries deviate from their bounds by `slack`.
struct ClipBetweenPlanes<'a> {
    corners: &'a CornerBounds,
    /// The corners in the middle of the interval.
    middle: [Vec3; 3],
    /// Bounds of the triangle.
    whole: &'a Packed,
    planes: Planes,
    /// The padding of the parts: [`CornerBounds::pad_of_means`].
    pad: f32,
    /// The bounds of each part; empty for a part that the triangle does not reach.
    parts: &'a mut [Packed],
}

impl Kernel for ClipBetweenPlanes<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let ClipBetweenPlanes { corners: CornerBounds { corners: bounds, .. }, middle, whole, planes, pad, parts } =
            self;
        let (axis, last) = (planes.axis, parts.len().clamp(1, BINS) - 1);
        // The planes above the parts.
        let above = s.splat(planes.low) + s.splat(planes.width) * s.load(&ABOVE);
        let (zero, nothing, never) = (s.splat(0.0), s.splat(f32::INFINITY), s.splat(f32::NAN));
        let mut corners = [nothing; 3];
        // For each part: 0 if it includes the corner, otherwise NaN, which a minimum ignores.
        let mut held = [[0.0; LANES]; 3];
        // For each plane above a part: the fraction of the edge where they meet, or NaN.
        let mut met = [[0.0; LANES]; 3];
        for i in 0..3 {
            let j = (i + 1) % 3;
            corners[i] = s.load(&Packed::new(&bounds[i]).0);
            let (p, q) = (s.splat(middle[i][axis]), s.splat(middle[j][axis]));
            let reaches = s.le(above, p) << 1 | 1;
            let begins = s.le(p, above) | 1 << last;
            s.store(s.select(reaches & begins, zero, never), &mut held[i]);
            let (p, q) = (p - above, q - above);
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
                }
            }
            let own = s.min(own, above) - pad;
            let looser = s.lt(own + s.permute(own, other), mean);
            s.store(s.select(looser, whole, own), &mut part.0);
            below = above;
        }
    }
}

/// The number of parts below the plane in each lane; no more than [`BINS`] are used.
const ABOVE: Lanes<f32> = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0];

/// The lane of the same face at the other end of the interval.
const OTHER_END: Lanes<u32> = [3, 4, 5, 0, 1, 2, 6, 7, 11, 12, 13, 8, 9, 10, 14, 15];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Box3, LinearBox3, TimeInterval};
    use crate::primitive::{PrimitiveSet, TriangleMesh, Triangles};
    use crate::random::Random;
    use crate::time::time_slice;

    impl Planes {
        /// The plane below part `k`.
        fn plane(self, k: usize) -> f32 {
            self.low + self.width * k as f32
        }
    }

    /// The parts of a triangle, computed by one of the instruction sets; `None` if it is too short.
    fn parts_of(bounds: &LinearBox3, corners: &CornerBounds, pad: f32, round: usize) -> Option<[LinearBox3; BINS]> {
        let (whole, middle, mut parts) = (Packed::new(bounds), corners.middle(), [Packed::EMPTY; BINS]);
        let planes = Planes::across(middle, BINS)?;
        let level = SimdLevel::available()[round % SimdLevel::available().len()];
        dispatch(level, ClipBetweenPlanes { corners, middle, whole: &whole, planes, pad, parts: &mut parts });
        Some(parts.map(|part| part.bounds()))
    }

    /// The part that holds what is at `x` along the axis in the middle of the interval.
    fn part_at(planes: Planes, x: f32) -> usize {
        (1..BINS).take_while(|&k| x > planes.plane(k)).count()
    }

    #[test]
    fn needles_are_split_within_the_budget_and_the_longest_most() {
        let mut random = Random(3);
        let mut needles: Vec<[Vec3; 3]> = Vec::new();
        for i in 0..1000 {
            let length = if i % 10 == 0 { 0.9 } else { 0.1 };
            let (at, along, thick) = (random.vec() * 0.1, random.vec() * length, random.vec() * 1e-3);
            needles.push([at, at + along, at + thick]);
        }
        let still = |at: [Vec3; 3]| Some(CornerBounds::of_lines(at, at, 0.0));
        let references: Vec<Reference> = (0..1000u32)
            .map(|i| {
                let b = needles[i as usize].into_iter().fold(Box3::EMPTY, Box3::include);
                Reference::new(LinearBox3 { begin: b, end: b }, i)
            })
            .collect();
        for (budget, least) in [(1.0, 1000), (1.2, 1120), (3.0, 1300)] {
            let mut parts = references.clone();
            presplit(&mut parts, |i| still(needles[i as usize]), budget);
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
            [at, at + 0.1 * Vec3::X, at]
        };
        let boxed = |i: u32| line(i).into_iter().fold(Box3::EMPTY, Box3::include);
        let mut lines: Vec<Reference> =
            (0..100).map(|i| Reference::new(LinearBox3 { begin: boxed(i), end: boxed(i) }, i)).collect();
        presplit(&mut lines, |i| still(line(i)), 3.0);
        assert_eq!(lines.len(), 100);
        let mut uncut = references.clone();
        presplit(&mut uncut, |_| None, 3.0);
        assert_eq!(uncut.len(), 1000);
        presplit(&mut Vec::new(), |_| None, 3.0);
    }

    #[test]
    fn every_point_of_a_moving_triangle_stays_in_the_part_that_holds_it_in_the_middle() {
        let mut random = Random(17);
        for round in 0..3000 {
            let (motion, keys) = ([0.0, 0.02, 0.3, 2.0][round % 4], [2, 3, 9][round % 3]);
            let mut point = |scale: f32| random.vec() * scale;
            let mut places = vec![vec![point(0.6), point(0.6), point(0.6)]];
            for _ in 1..keys {
                let last = places[places.len() - 1].iter();
                places.push(last.map(|&p| (p + point(motion)).clamp(Vec3::NEG_ONE, Vec3::ONE)).collect());
            }
            let set = Triangles::new(&[TriangleMesh::new(vec![[0, 1, 2]], places)]).unwrap();
            let (bounds, corners) =
                (set.bounds(0, TimeInterval::FULL), set.corner_bounds(0, TimeInterval::FULL).unwrap());
            let Some(parts) = parts_of(&bounds, &corners, corners.pad_of_means(), round / 4) else { continue };
            let (middle, planes) = (corners.middle(), Planes::across(corners.middle(), BINS).unwrap());
            for step in 0..=16 {
                let t = step as f32 / 16.0;
                let now = set.corners(0, t);
                for i in 0..=12 {
                    for j in 0..=12 - i {
                        let (u, v) = (i as f32 / 12.0, j as f32 / 12.0);
                        let of = |[a, b, c]: [Vec3; 3]| a * (1.0 - u - v) + b * u + c * v;
                        let (p, x) = (of(now), of(middle)[planes.axis]);
                        // Beside a plane it may be in the next part.
                        let parts = [-4.0, 4.0].map(|ulps| parts[part_at(planes, x + ulps * ULP)]);
                        let held = parts.iter().any(|part| {
                            let b = part.at(t).pad(4.0 * ULP);
                            p.cmpge(b.min).all() && p.cmple(b.max).all()
                        });
                        assert!(held, "round {round}, t {t}, {p}");
                    }
                }
            }
        }
    }

    /// Counts points of the edges of moving triangles, in f64, that leave the part that holds them in the middle of the interval.
    fn points_lost(pad_of: impl Fn(&CornerBounds) -> f32) -> usize {
        let (mut random, mut lost) = (Random(29), 0);
        for round in 0..4000 {
            let motion = [0.0, 0.02, 0.3, 3.0][round % 4];
            let mut point = |scale: f32| random.vec() * scale;
            let begin = [point(0.7), point(0.7), point(0.7)];
            let end = begin.map(|p| p + point(motion));
            let corners = CornerBounds::of_lines(begin, end, 0.0);
            let Some(parts) = parts_of(&corners.union(), &corners, pad_of(&corners), round / 4) else { continue };
            let (middle, planes) = (corners.middle(), Planes::across(corners.middle(), BINS).unwrap());
            for i in 0..3 {
                let edge = |at: [Vec3; 3], u: f64| at[i].as_dvec3().lerp(at[(i + 1) % 3].as_dvec3(), u);
                for k in 1..BINS {
                    let [p, q] = [middle[i], middle[(i + 1) % 3]].map(|p| f64::from(p[planes.axis]));
                    for beside in [-1e-8, 0.0, 1e-8] {
                        let u = (f64::from(planes.plane(k)) - p) / (q - p) + beside;
                        if !(0.0..=1.0).contains(&u) {
                            continue;
                        }
                        for (at, begins) in [(begin, true), (end, false)] {
                            let x = edge(at, u);
                            let holds = |part: &LinearBox3| {
                                let b = if begins { part.begin } else { part.end };
                                (x.cmpge(b.min.as_dvec3()) & x.cmple(b.max.as_dvec3())).all()
                            };
                            lost += usize::from(!parts[k - 1..=k].iter().any(holds));
                        }
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn the_padding_of_parts_is_enough_and_needed() {
        assert_eq!(points_lost(CornerBounds::pad_of_means), 0);
        assert!(points_lost(|_| 0.0) > 100);
    }

    /// Counts corners, as the kernel computes them at times of a slice, that are in no part. They move far between keys, of which
    /// the slice may have one more inside, and times are rounded the more the more keys there are.
    fn corners_lost(pad_of: impl Fn(&CornerBounds) -> f32) -> usize {
        let (mut random, mut lost) = (Random(31), 0);
        for round in 0..600 {
            let keys = [3, 100, 1000][round % 3];
            let segment = (random.unit() * (keys - 1) as f32) as usize;
            let mut at = |_| vec![random.vec(), random.vec(), random.vec()];
            let mesh = TriangleMesh::new(vec![[0, 1, 2]], (0..keys).map(&mut at).collect::<Vec<_>>());
            let (set, over) = (Triangles::new(&[mesh]).unwrap(), time_slice(segment, keys - 1));
            let (bounds, corners) = (set.bounds(0, over), set.corner_bounds(0, over).unwrap());
            let Some(parts) = parts_of(&bounds, &corners, pad_of(&corners), round) else { continue };
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
    fn parts_hold_corners_as_queries_compute_them_and_would_not_without_slack() {
        assert_eq!(corners_lost(CornerBounds::pad_of_means), 0);
        assert!(corners_lost(|corners| corners.pad_of_means() - corners.slack) > 100);
    }
}
