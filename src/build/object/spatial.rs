//! Spatial splits: a reference that straddles a plane becomes two, each bounded by its own part (Stich,
//! Friedrich and Dietrich, "Spatial Splits in Bounding Volume Hierarchies", 2009), here of triangles that move.
//!
//! Long or uneven triangles fill little of their boxes; their parts fill more. Where things cross planes
//! because they *move*, cutting does not pay, so only references are cut whose motion is small beside their
//! length.

use super::binned::mean_half_area;
use super::reference::Reference;
use crate::motion::{LinearBox3, ULP};
use glam::Vec3;

/// A triangle's corners at the begin and the end of the build's interval, linear in between up to `slack`.
pub(crate) struct Ends {
    pub begin: [Vec3; 3],
    pub end: [Vec3; 3],
    pub slack: f32,
}

/// Candidate planes per axis, plus one.
pub(super) const BINS: usize = 8;

/// A cut is taken where it costs at most this times the best object split: a strict comparison refuses
/// nearly all cuts that pay further down.
const WILLING: f32 = 1.1;

/// Only references whose motion is at most this part of their length are cut.
const STEADY: f32 = 0.6;

/// Evenly spaced planes across a node.
#[derive(Clone, Copy)]
pub(super) struct Planes {
    pub axis: usize,
    low: f32,
    width: f32,
    scale: f32,
}

impl Planes {
    /// A single plane: bin 0 below, bin 1 above.
    fn single(axis: usize, plane: f32) -> Planes {
        Planes { axis, low: plane, width: 0.0, scale: 0.0 }
    }

    fn new(bounds: &LinearBox3, axis: usize) -> Option<Planes> {
        let low = 0.5 * (bounds.begin.min[axis] + bounds.end.min[axis]);
        let high = 0.5 * (bounds.begin.max[axis] + bounds.end.max[axis]);
        let width = (high - low) / BINS as f32;
        let scale = BINS as f32 / (high - low);
        (width > 4.0 * ULP && scale.is_finite()).then_some(Planes { axis, low, width, scale })
    }

    /// The bin of a coordinate.
    fn bin(self, x: f32) -> usize {
        (((x - self.low) * self.scale) as usize).min(BINS - 1)
    }

    /// The plane below bin `k`.
    fn plane(self, k: usize) -> f32 {
        self.low + self.width * k as f32
    }

    /// First and last bin of a reference; one and the same where it must not be cut.
    fn span(self, bounds: &LinearBox3) -> (usize, usize) {
        let (b, e, a) = (&bounds.begin, &bounds.end, self.axis);
        let motion = (e.min[a] - b.min[a]).abs().max((e.max[a] - b.max[a]).abs());
        let (low, high) = (0.5 * (b.min[a] + e.min[a]), 0.5 * (b.max[a] + e.max[a]));
        if motion > STEADY * (high - low) {
            let k = self.bin(0.5 * (low + high));
            return (k, k);
        }
        (self.bin(b.min[a].min(e.min[a])), self.bin(b.max[a].max(e.max[a])))
    }
}

/// A plane worth cutting at.
pub(super) struct Cut {
    pub planes: Planes,
    /// The first bin of the high side.
    pub bin: usize,
    pub low: usize,
    pub high: usize,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: LinearBox3,
    entries: usize,
    exits: usize,
}

/// The best plane, if it costs little enough beside the best object split (`object`: area times count summed
/// over both sides) and duplicates at most `spare` references.
pub(super) fn find_cut(
    references: &[Reference],
    bounds: &LinearBox3,
    ends: &impl Fn(u32) -> Option<Ends>,
    object: f32,
    spare: usize,
) -> Option<Cut> {
    let n = references.len();
    let mut best: Option<(f32, Cut)> = None;
    // Cutting all that straddles is the dearest part of a build: only the longest axis is tried.
    let extent = bounds.at(0.5);
    let longest = (extent.max - extent.min).max_position();
    if let Some(planes) = Planes::new(bounds, longest) {
        let mut bins = [Bin { bounds: LinearBox3::EMPTY, entries: 0, exits: 0 }; BINS];
        for r in references {
            let b = r.bounds();
            let (first, last) = planes.span(&b);
            let corners = if first < last { ends(r.id()) } else { None };
            match corners {
                Some(corners) => {
                    bins[first].entries += 1;
                    bins[last].exits += 1;
                    let mut parts = [LinearBox3::EMPTY; BINS];
                    chop(&corners, &b, planes, first, last, &mut parts);
                    for (bin, part) in bins[first..=last].iter_mut().zip(&parts[first..=last]) {
                        bin.bounds = bin.bounds.union(*part);
                    }
                }
                None => {
                    let a = planes.axis;
                    let middle = 0.25 * ((b.begin.min[a] + b.end.max[a]) + (b.begin.max[a] + b.end.min[a]));
                    let bin = &mut bins[planes.bin(middle)];
                    bin.entries += 1;
                    bin.exits += 1;
                    bin.bounds = bin.bounds.union(b);
                }
            }
        }
        let mut above = [(0.0, 0); BINS];
        let (mut sum, mut count) = (LinearBox3::EMPTY, 0);
        for k in (1..BINS).rev() {
            sum = sum.union(bins[k].bounds);
            count += bins[k].exits;
            above[k] = (mean_half_area(&sum) * count as f32, count);
        }
        (sum, count) = (LinearBox3::EMPTY, 0);
        for k in 1..BINS {
            sum = sum.union(bins[k - 1].bounds);
            count += bins[k - 1].entries;
            let (high_cost, high) = above[k];
            let duplicates = (count + high).saturating_sub(n);
            // Both sides must shrink, or the same cut would be found again.
            if duplicates == 0 || duplicates > spare || count >= n || high >= n || count == 0 || high == 0 {
                continue;
            }
            let cost = mean_half_area(&sum) * count as f32 + high_cost;
            if cost <= object * WILLING && best.as_ref().is_none_or(|b| cost < b.0) {
                best = Some((cost, Cut { planes, bin: k, low: count, high }));
            }
        }
    }
    best.map(|b| b.1)
}

/// Parts the references at a cut; both sides come in the order of the input.
pub(super) fn apply_cut(
    references: &[Reference],
    cut: &Cut,
    ends: &impl Fn(u32) -> Option<Ends>,
) -> (Vec<Reference>, Vec<Reference>) {
    let (mut low, mut high) = (Vec::with_capacity(cut.low), Vec::with_capacity(cut.high));
    let single = Planes::single(cut.planes.axis, cut.planes.plane(cut.bin));
    for r in references {
        let bounds = r.bounds();
        let (first, last) = cut.planes.span(&bounds);
        if last < cut.bin {
            low.push(*r);
        } else if first >= cut.bin {
            high.push(*r);
        } else if let Some(corners) = ends(r.id()) {
            let mut parts = [LinearBox3::EMPTY; BINS];
            chop(&corners, &bounds, single, 0, 1, &mut parts);
            for (bounds, side) in parts[..2].iter().zip([&mut low, &mut high]) {
                if !(bounds.begin.is_empty() && bounds.end.is_empty()) {
                    side.push(Reference::new(*bounds, r.id()));
                }
            }
        } else if 2 * cut.bin > first + last {
            low.push(*r);
        } else {
            high.push(*r);
        }
    }
    (low, high)
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
    let mut add = |bin: usize, begin: Vec3, end: Vec3| {
        let part = &mut parts[bin];
        part.begin = part.begin.include(begin);
        part.end = part.end.include(end);
    };
    for i in 0..3 {
        let (p, q) = (corners.begin[i], corners.end[i]);
        let (low, high) = (p[a].min(q[a]), p[a].max(q[a]));
        for k in first..=last {
            let above = k == first || high >= planes.plane(k);
            let below = k == last || low <= planes.plane(k + 1);
            if above && below {
                add(k, p, q);
            }
        }
        let j = (i + 1) % 3;
        let (p2, q2) = (corners.begin[j], corners.end[j]);
        for k in first + 1..=last {
            let plane = planes.plane(k);
            let (p_begin, p_end) = (p[a] - plane, q[a] - plane);
            let (q_begin, q_end) = (p2[a] - plane, q2[a] - plane);
            let meets = |x: f32, y: f32| (x <= 0.0 && y >= 0.0) || (x >= 0.0 && y <= 0.0);
            let at = |x: f32, y: f32| if x == y { 0.0 } else { (x / (x - y)).clamp(0.0, 1.0) };
            let places = [
                meets(p_begin, q_begin).then(|| at(p_begin, q_begin)),
                meets(p_end, q_end).then(|| at(p_end, q_end)),
                meets(p_begin, p_end).then_some(0.0),
                meets(q_begin, q_end).then_some(1.0),
            ];
            for u in places.into_iter().flatten() {
                let (begin, end) = (p + (p2 - p) * u, q + (q2 - q) * u);
                add(k - 1, begin, end);
                add(k, begin, end);
            }
        }
    }
    for part in &mut parts[first..=last] {
        if !part.begin.is_empty() {
            let pad = corners.slack + 8.0 * ULP;
            *part = LinearBox3 { begin: part.begin.pad(pad), end: part.end.pad(pad) }.tighter(*whole);
        }
    }
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
            let Some(planes) = Planes::new(&bounds, round % 3) else { continue };
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
