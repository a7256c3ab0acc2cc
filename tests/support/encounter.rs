//! Encounters of two points by plain arithmetic.

use mbkd::{Encounter, TimeInterval, glam::DVec3};

/// Two points with evenly spaced keys.
pub struct Pair<'a> {
    /// Of the second one, for the encounter.
    pub id: u32,
    /// The segments between the keys of either.
    pub segments: [usize; 2],
    /// The position of one of them at a key.
    pub keys: &'a dyn Fn(usize, usize) -> DVec3,
    pub active: [TimeInterval; 2],
    /// By how much the second one is moved to each of its images.
    pub images: &'a [DVec3],
}

/// By how much points are moved to their images up to so many periods away.
pub fn images(periods: [Option<f64>; 3], most: i32) -> Vec<DVec3> {
    let along = |axis: usize| match periods[axis] {
        Some(length) => (-most..=most).map(|periods| f64::from(periods) * length).collect(),
        None => vec![0.0],
    };
    let [xs, ys, zs]: [Vec<f64>; 3] = [0, 1, 2].map(along);
    let of_x = |x: f64| {
        ys.iter().flat_map({
            let zs = &zs;
            move |&y| zs.iter().map(move |&z| DVec3::new(x, y, z))
        })
    };
    xs.iter().copied().flat_map(of_x).collect()
}

impl Pair<'_> {
    /// The encounter within an interval and the root of `square`, one image and segment between keys of either after the other,
    /// in f64.
    pub fn meet(&self, times: [f64; 2], square: f64) -> Option<Encounter> {
        let mut all: Option<Encounter> = None;
        let [of_own, of_other] = self.segments;
        // Segments of the other one that overlap, and one more on either side: where they touch, rounding decides.
        let overlapping = |own: usize| {
            let (first, behind) = (own * of_other / of_own, ((own + 1) * of_other).div_ceil(of_own));
            first.saturating_sub(1)..(behind + 1).min(of_other)
        };
        let both = (0..of_own).flat_map(|own| overlapping(own).map(move |other| [own, other]));
        let both: Vec<[usize; 2]> = both.collect();
        for (&image, &segment) in self.images.iter().flat_map(|image| both.iter().map(move |s| (image, s))) {
            let end = |k: usize, after: usize| (segment[k] + after) as f64 / self.segments[k] as f64;
            let ends = [end(0, 0).max(end(1, 0)), end(0, 1).min(end(1, 1))];
            if ends[0] >= ends[1] {
                continue;
            }
            let begin = self.active.iter().fold(times[0].max(ends[0]), |t, active| t.max(active.begin().into()));
            let end = self.active.iter().fold(times[1].min(ends[1]), |t, active| t.min(active.end().into()));
            // Where something begins at a key, only the motion after it counts.
            if begin > end || (begin >= ends[1] && ends[1] < 1.0) {
                continue;
            }
            let over =
                |time: f64| self.active.iter().any(|active| active.end() < 1.0 && time >= f64::from(active.end()));
            let place = |k: usize, time: f64| {
                let phase = (time * self.segments[k] as f64 - segment[k] as f64).clamp(0.0, 1.0);
                let [a, b] = [0, 1].map(|after| (self.keys)(k, segment[k] + after));
                a + (b - a) * phase
            };
            let dot = |a: DVec3, b: DVec3| (a.x * b.x + a.y * b.y) + a.z * b.z;
            let apart = |time: f64| (place(1, time) - place(0, time)) + image;
            let (first, last) = (apart(begin), apart(end));
            let displacement = last - first;
            let (speed, approach) = (dot(displacement, displacement), -dot(first, displacement));
            let w = if speed > 0.0 { (approach / speed).clamp(0.0, 1.0) } else { 0.0 };
            let nearest = first + displacement * w;
            let distance = dot(nearest, nearest);
            if distance > square {
                continue;
            }
            let outside = dot(first, first) - square;
            let root = (approach * approach - speed * outside).max(0.0).sqrt();
            let enter = if outside <= 0.0 { 0.0 } else { (outside / (approach + root)).clamp(0.0, w) };
            let leave = if dot(last, last) <= square { 1.0 } else { ((approach + root) / speed).clamp(w, 1.0) };
            let time = |w: f64| (begin + (end - begin) * w) as f32;
            if over(begin + (end - begin) * enter) {
                continue;
            }
            let (enter, leave, closest, distance_squared) = (time(enter), time(leave), time(w), distance as f32);
            let all = all.get_or_insert(Encounter { id: self.id, enter, leave, closest, distance_squared });
            if (distance_squared, closest) < (all.distance_squared, all.closest) {
                (all.distance_squared, all.closest) = (distance_squared, closest);
            }
            (all.enter, all.leave) = (all.enter.min(enter), all.leave.max(leave));
        }
        all
    }
}
