//! Cutting references before the build: a long triangle becomes several references, each bounded by its own
//! part (Ernst and Greiner, "Early Split Clipping for Bounding Volume Hierarchies", 2007; the shares after
//! Karras and Aila, "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies", 2013), here of
//! triangles that move.
//!
//! Long triangles fill little of their boxes; their parts fill more. Where things cross planes because they
//! *move*, cutting does not pay, so only references are cut whose motion is small beside their length.

use super::binned::mean_half_area;
use super::reference::Reference;
use crate::motion::{LinearBox3, ULP};
use crate::parallel;
use glam::Vec3;

/// A triangle's corners at the begin and the end of the build's interval, linear in between up to `slack`.
pub(crate) struct Ends {
    pub begin: [Vec3; 3],
    pub end: [Vec3; 3],
    pub slack: f32,
}

impl Ends {
    /// The area at the begin.
    pub fn area(&self) -> f32 {
        let [a, b, c] = self.begin;
        0.5 * (b - a).cross(c - a).length()
    }
}

/// Most parts of one reference.
const BINS: usize = 8;

/// References per task.
const CHUNK: usize = 4096;

/// Only references whose motion is at most this part of their length are cut.
const STEADY: f32 = 0.6;

/// A part must save at least this times the area of an average reference: it costs memory and a test.
const PRICE: f32 = 0.2;

/// The area that is left when nothing can be gained, in areas of the triangle: about that of a triangle in
/// random position.
const FULL: f32 = 4.0;

/// Evenly spaced planes across a reference.
#[derive(Clone, Copy)]
struct Planes {
    axis: usize,
    low: f32,
    width: f32,
}

impl Planes {
    /// Planes between `parts` parts of the longest axis; none where that is too short, or too fast.
    fn across(bounds: &LinearBox3, parts: usize) -> Option<Planes> {
        let middle = bounds.at(0.5);
        let extent = middle.max - middle.min;
        let axis = extent.max_position();
        let (b, e) = (&bounds.begin, &bounds.end);
        let motion = (e.min[axis] - b.min[axis]).abs().max((e.max[axis] - b.max[axis]).abs());
        let width = extent[axis] / parts as f32;
        (width > 4.0 * ULP && motion <= STEADY * extent[axis]).then_some(Planes { axis, low: middle.min[axis], width })
    }

    /// The plane below part `k`.
    fn plane(self, k: usize) -> f32 {
        self.low + self.width * k as f32
    }
}

/// Cuts references into parts, at most `budget` times as many as there are now, where that saves most area. The
/// first part takes the reference's place, the others follow behind all.
///
/// In `m` parts a diagonal needle has an `m`-th of its area, so the `m`-th part saves `1 / (m (m - 1))` of it.
/// References are cut as long as a part saves at least some area; it is raised until the budget suffices.
pub(crate) fn cut(references: &mut Vec<Reference>, ends: impl Fn(u32) -> Option<Ends> + Sync, budget: f32) {
    let n = references.len();
    let mut areas = Vec::new();
    parallel::fill(&mut areas, n, |i| mean_half_area(&references[i].bounds()));
    let total = areas.iter().map(|&area| f64::from(area)).sum::<f64>();
    let mut least = (f64::from(PRICE) * total / n.max(1) as f64) as f32;
    let worth = |i: usize| {
        // A gain is at most the area, and nothing is cut for less than twice the least.
        let steady = areas[i] >= 2.0 * least && Planes::across(&references[i].bounds(), BINS).is_some();
        let own = if steady { ends(references[i].id())?.area() } else { return None };
        let gain = areas[i] - FULL * own;
        (gain > 0.0 && gain >= 2.0 * least).then_some((i as u32, gain))
    };
    let gains = parallel::map(n.div_ceil(CHUNK), |task| {
        (task * CHUNK..n.min((task + 1) * CHUNK)).filter_map(worth).collect::<Vec<(u32, f32)>>()
    });
    let gains = gains.concat();
    // The greatest m for which m (m - 1) <= gain / least.
    let parts = |gain: f32, least: f32| match gain < 2.0 * least {
        true => 1,
        false => ((0.25 + gain / least).sqrt() + 0.5).min(BINS as f32) as usize,
    };
    let more = (n as f64 * f64::from(budget)) as usize - n;
    // What some of them say is nearly right; all of them keep the budget.
    for (step, by) in [(8, 1.05), (1, 1.02)] {
        let made = |least| gains.iter().step_by(step).map(|&(_, gain)| step * (parts(gain, least) - 1)).sum::<usize>();
        while made(least) > more {
            least = least * by + f32::MIN_POSITIVE;
        }
    }
    let tasks = parallel::map(gains.len().div_ceil(CHUNK), |task| {
        let mut out = Vec::new();
        for &(i, gain) in &gains[task * CHUNK..gains.len().min((task + 1) * CHUNK)] {
            let (r, m) = (&references[i as usize], parts(gain, least));
            let bounds = r.bounds();
            let (Some(planes), Some(ends)) = (Planes::across(&bounds, m).filter(|_| m > 1), ends(r.id())) else {
                continue;
            };
            let mut cut = [LinearBox3::EMPTY; BINS];
            chop(&ends, &bounds, planes, 0, m - 1, &mut cut);
            let held = cut[..m].iter().filter(|part| !(part.begin.is_empty() && part.end.is_empty()));
            out.extend(held.map(|part| (i, *part)));
        }
        out
    });
    let mut last = u32::MAX;
    for (i, part) in tasks.into_iter().flatten() {
        let part = Reference::new(part, references[i as usize].id());
        if i == last {
            references.push(part);
        } else {
            references[i as usize] = part;
        }
        last = i;
    }
}

/// Linear bounds of the parts of a moving triangle between successive planes, for bins `first..=last`.
///
/// Proof that each part is held at every time. The part between two planes is a convex polygon; its corners
/// are corners of the triangle, or points where an edge meets a plane.
/// - A corner moves on a line, so it is in the bins between the two it begins and ends in; all of them
///   include it at both ends.
/// - Let an edge p(t) q(t) meet a plane at p + u (q - p). The distances of p and q to the plane are linear in t, so
///   u is a quotient of two linear functions, monotone while the edge meets the plane. It begins to
///   meet it at the begin of the interval or when p (u = 0) or q (u = 1) comes into the plane, and likewise
///   ends; so u stays between the least and the greatest of those values. For a fixed u the point moves on a
///   line, and at any time the points are linear in u: including the extreme points at both ends of the
///   interval includes all in between.
///
/// The points are computed with three roundings at sizes of at most 2 (8 ULP cover them), and the kernel's
/// corners stray from the lines by `slack`.
fn chop(corners: &Ends, whole: &LinearBox3, planes: Planes, first: usize, last: usize, parts: &mut [LinearBox3; BINS]) {
    let a = planes.axis;
    for i in 0..3 {
        let (p, q) = (corners.begin[i], corners.end[i]);
        let (low, high) = (p[a].min(q[a]), p[a].max(q[a]));
        for (k, part) in parts.iter_mut().enumerate().take(last + 1).skip(first) {
            let above = k == first || high >= planes.plane(k);
            let below = k == last || low <= planes.plane(k + 1);
            if above && below {
                include(part, p, q);
            }
        }
        let j = (i + 1) % 3;
        let (p2, q2) = (corners.begin[j], corners.end[j]);
        let (low, high) = (low.min(p2[a]).min(q2[a]), high.max(p2[a]).max(q2[a]));
        for k in first + 1..=last {
            let plane = planes.plane(k);
            if plane < low || plane > high {
                continue;
            }
            let (p_begin, p_end) = (p[a] - plane, q[a] - plane);
            let (q_begin, q_end) = (p2[a] - plane, q2[a] - plane);
            let mut met = LinearBox3::EMPTY;
            let mut meet = |u: f32| include(&mut met, p + (p2 - p) * u, q + (q2 - q) * u);
            if apart(p_begin, q_begin) {
                meet(crossing(p_begin, q_begin));
            }
            if apart(p_end, q_end) {
                meet(crossing(p_end, q_end));
            }
            if apart(p_begin, p_end) {
                meet(0.0);
            }
            if apart(q_begin, q_end) {
                meet(1.0);
            }
            parts[k - 1] = parts[k - 1].union(met);
            parts[k] = parts[k].union(met);
        }
    }
    for part in &mut parts[first..=last] {
        if !part.begin.is_empty() {
            let pad = corners.slack + 8.0 * ULP;
            *part = LinearBox3 { begin: part.begin.pad(pad), end: part.end.pad(pad) }.tighter(*whole);
        }
    }
}

#[inline(always)]
fn include(part: &mut LinearBox3, begin: Vec3, end: Vec3) {
    part.begin = part.begin.include(begin);
    part.end = part.end.include(end);
}

/// Whether two distances are on different sides of a plane, or on it.
#[inline(always)]
fn apart(x: f32, y: f32) -> bool {
    (x <= 0.0 && y >= 0.0) || (x >= 0.0 && y <= 0.0)
}

/// Where a line between two such distances meets the plane.
#[inline(always)]
fn crossing(x: f32, y: f32) -> f32 {
    if x == y { 0.0 } else { (x / (x - y)).clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Box3;

    fn random(state: &mut u64) -> f32 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn needles_are_cut_within_the_budget_and_the_longest_most() {
        let mut state = 3;
        let mut needles: Vec<Ends> = Vec::new();
        for i in 0..1000 {
            let mut point = || Vec3::new(random(&mut state), random(&mut state), random(&mut state));
            let length = if i % 10 == 0 { 0.9 } else { 0.1 };
            let (at, along, thick) = (point() * 0.1, point() * length, point() * 1e-3);
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
            cut(&mut parts, |i| Some(again(i)), budget);
            assert!(parts.len() as f32 <= 1000.0 * budget && parts.len() >= least, "{budget}: {}", parts.len());
            let of = |long: bool| parts.iter().filter(|r| (r.id() % 10 == 0) == long).count();
            assert!(budget == 1.0 || of(true) > 2 * 100 && of(false) < 2 * 900);
            assert!(parts.iter().all(|r| {
                let (part, whole) = (r.bounds().begin, references[r.id() as usize].bounds().begin);
                part.min.cmpge(whole.min).all() && part.max.cmple(whole.max).all()
            }));
        }
        let mut uncut = references.clone();
        cut(&mut uncut, |_| None, 3.0);
        assert_eq!(uncut.len(), 1000);
        cut(&mut Vec::new(), |_| None, 3.0);
    }

    #[test]
    fn every_point_of_a_moving_triangle_is_in_a_part_of_its_bin() {
        let mut state = 17;
        for round in 0..3000 {
            let motion = [0.0, 0.02, 0.3, 2.0][round % 4];
            let mut point = |scale: f32| Vec3::new(random(&mut state), random(&mut state), random(&mut state)) * scale;
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
            let mut parts = [LinearBox3::EMPTY; BINS];
            chop(&corners, &bounds, planes, 0, BINS - 1, &mut parts);
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
}
