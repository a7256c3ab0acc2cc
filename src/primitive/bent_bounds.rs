//! Linear bounds of triangles whose motion has more than two keys.
//!
//! Every vertex stays in a tube: the line between its places at both ends of the interval, moved down and up per axis until it
//! has all keys between on one side. A face of the box is the line through the least (greatest) of the three tubes at either end.
//!
//! Proof. Between keys a vertex moves linearly, so its distance from its line is greatest at a key or an end of the interval; what
//! is moved by the least and the greatest distance there bounds it at all times. The least of several lines is concave
//! in time, so the line through its values at both ends lies below them all in between. (Of upper faces likewise.)
//!
//! Rounding, in ULP of the largest coordinate M at the keys that are looked at. A computed vertex of the kernel and the computed place at an
//! end of the interval stray from the exact ones by [`Triangles::slack`] each. A distance from the line is computed with a
//! difference (2), its product with a fraction that is rounded itself (1 + 2), a sum (3: the line may leave M by that of others) and
//! a difference (4): 12. The tube's end is a sum (3). So twice the slack and 16 ULP are kept.

use super::triangles::Triangles;
use crate::geometry::{Box3, KeyTime, LinearBox3, TimeInterval, ULP};
use glam::Vec3;

impl Triangles {
    /// Bounds over an interval; `keys` is the number of keys, more than two.
    pub(super) fn bent_bounds(&self, id: u32, keys: usize, over: TimeInterval) -> LinearBox3 {
        let window = Window::new(over, keys);
        let mut bounds = LinearBox3::EMPTY;
        let mut magnitude = Vec3::ZERO;
        for vertex in self.vertices(id) {
            let (tube, size) = window.tube(self.keys_of_vertex(vertex, keys));
            bounds = bounds.union(tube);
            magnitude = magnitude.max(size);
        }
        let magnitude = magnitude.max_element();
        let pad = 2.0 * Triangles::slack(keys, magnitude) + 16.0 * ULP * magnitude;
        let mut bounds = LinearBox3 { begin: bounds.begin.pad(pad), end: bounds.end.pad(pad) };
        if bounds.begin == bounds.end {
            // What comes back to where it began moves all the same, and dividing the shutter may pay.
            bounds.end.max.x = bounds.end.max.x.next_up();
        }
        bounds
    }
}

/// The keys at and around which a vertex is during an interval.
struct Window {
    begin: KeyTime,
    end: KeyTime,
    /// The interval in segments.
    first: f64,
    per_segment: f64,
}

impl Window {
    fn new(over: TimeInterval, keys: usize) -> Window {
        let segments = (keys - 1) as f64;
        let (first, last) = (f64::from(over.begin()) * segments, f64::from(over.end()) * segments);
        let per_segment = if last > first { 1.0 / (last - first) } else { 0.0 };
        Window { begin: KeyTime::new(over.begin(), keys), end: KeyTime::new(over.end(), keys), first, per_segment }
    }

    /// Where a vertex is held between both ends, and the largest coordinates at the keys.
    fn tube(&self, keys: &[Vec3]) -> (LinearBox3, Vec3) {
        let (low, high) = (self.begin.segment, self.end.segment + 1);
        let begin = self.begin.position(keys[low], keys[low + 1]);
        let end = self.end.position(keys[high - 1], keys[high]);
        let way = end - begin;
        let (mut below, mut above) = (Vec3::ZERO, Vec3::ZERO);
        // The segments next to these too: the times of queries are rounded.
        let (around, until) = (low.saturating_sub(1), (high + 1).min(keys.len() - 1));
        let mut size = Vec3::ZERO;
        for (key, &place) in keys[around..=until].iter().enumerate() {
            size = size.max(place.abs());
            let w = ((around + key) as f64 - self.first) * self.per_segment;
            if 0.0 < w && w < 1.0 {
                let off = place - (begin + way * w as f32);
                below = below.min(off);
                above = above.max(off);
            }
        }
        let at = |place: Vec3| Box3 { min: place + below, max: place + above };
        (LinearBox3 { begin: at(begin), end: at(end) }, size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{PrimitiveSet, TriangleMesh};

    fn next(state: &mut u64) -> f32 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 40) as f32 / (1 << 24) as f32
    }

    /// Corners that leave the bounds at times of their interval, among them keys and times beside them, when a part of
    /// the padding is taken away.
    fn lost(part: f32) -> usize {
        let (mut state, mut lost) = (19, 0);
        for keys in [3usize, 4, 9, 65, 200] {
            for _ in 0..60 {
                let mut point = |around: Vec3| {
                    around + Vec3::new(next(&mut state), next(&mut state), next(&mut state)) * 0.05 - Vec3::splat(0.025)
                };
                let mut places = vec![[Vec3::ZERO, Vec3::X, Vec3::Y].map(&mut point).to_vec()];
                for _ in 1..keys {
                    let last = places[places.len() - 1].clone();
                    places.push(last.into_iter().map(&mut point).collect());
                }
                let set = Triangles::new(&[TriangleMesh::new(vec![[0, 1, 2]], places)]).unwrap();
                let (a, b) = (next(&mut state), next(&mut state));
                let over = match next(&mut state) {
                    x if x < 0.3 => TimeInterval::FULL,
                    _ => TimeInterval::half_open(a.min(b), a.max(b) + 1e-3).unwrap(),
                };
                let bounds = set.bounds(0, over);
                let window = Window::new(over, keys);
                let size = set.vertices(0).map(|v| window.tube(set.keys_of_vertex(v, keys)).1.max_element());
                let size = size.into_iter().fold(0.0, f32::max);
                let off = f64::from(part * (2.0 * Triangles::slack(keys, size) + 16.0 * ULP * size));
                for i in 0..200 {
                    let key = (i / 3 % keys) as f32 / (keys - 1) as f32;
                    let t = match i % 3 {
                        0 => key,
                        1 => [key.next_up(), key.next_down()][i / 3 % 2],
                        _ => over.begin() + over.duration() * next(&mut state),
                    };
                    if !(over.begin()..=over.end()).contains(&t) {
                        continue;
                    }
                    let w =
                        (f64::from(t) - f64::from(over.begin())) / (f64::from(over.end()) - f64::from(over.begin()));
                    for p in set.corners(0, t) {
                        let low = bounds.begin.min.as_dvec3().lerp(bounds.end.min.as_dvec3(), w) + off;
                        let high = bounds.begin.max.as_dvec3().lerp(bounds.end.max.as_dvec3(), w) - off;
                        lost += usize::from(p.as_dvec3().cmplt(low).any() || p.as_dvec3().cmpgt(high).any());
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn bent_motion_is_held_at_all_times_and_would_not_be_without_padding() {
        assert_eq!(lost(0.0), 0);
        assert!(lost(1.0) > 100, "a padding that nothing needs");
    }

    #[test]
    fn bounds_are_no_larger_than_they_must_be() {
        // A vertex that swings to one side and back.
        let at = |x: f32| vec![Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.0, 0.0), Vec3::new(x, 0.0, 1.0)];
        let mesh = TriangleMesh::new(vec![[0, 1, 2]], vec![at(0.0), at(0.25), at(0.0)]);
        let bounds = Triangles::new(&[mesh]).unwrap().bounds(0, TimeInterval::FULL);
        assert!(bounds.begin.min.x > -1e-5 && bounds.begin.max.x < 0.25001 && bounds.end.max.x < 0.25001);
        assert!(bounds.begin != bounds.end, "it moves");
    }
}
