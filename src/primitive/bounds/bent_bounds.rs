//! Linear bounds of triangles whose motion has more than two keys.
//!
//! Every vertex stays in a tube: the line between its positions at both ends of the interval, shifted down and up per axis
//! until all keys between are on one side. A face of the box is the line through the least (greatest) of the three tubes at
//! either end.
//!
//! Proof. Between keys a vertex moves linearly, so its distance from its line is greatest at a key or an end of the interval;
//! the line shifted by the least and the greatest distance there bounds it at all times. The least of several lines is
//! concave in time, so the line through its values at both ends lies below them all in between. (Likewise for upper faces.)
//!
//! Rounding, in ULP of the largest coordinate M at the keys that are used. A vertex as computed by the kernel and the computed
//! position at an end of the interval differ from the exact ones by [`Triangles::slack`] each. A distance from the line is computed
//! with a difference (2), its product with a fraction that is rounded itself (1 + 2), a sum (3: the line may leave M by that of
//! others) and a difference (4): 12. The tube's end is a sum (3). So the padding is twice the slack and 16 ULP.

use crate::geometry::{Box3, CornerBounds, LinearBox3, TimeInterval, ULP};
use crate::primitive::key_window::Window;
use crate::primitive::triangles::triangle_set::Triangles;
use core::ops::Range;
use glam::{Vec3, Vec3A};

impl Triangles {
    /// Bounds over an interval; `keys` is the number of keys, more than two.
    pub(in crate::primitive) fn bent_bounds(&self, id: u32, keys: usize, over: TimeInterval) -> LinearBox3 {
        let CornerBounds { corners: [a, b, c], slack } = self.tubes_of_corners(id, keys, over);
        let bounds = a.union(b).union(c);
        let mut bounds = LinearBox3 { begin: bounds.begin.pad(slack), end: bounds.end.pad(slack) };
        if bounds.begin == bounds.end {
            // A motion that returns to its begin is a motion nevertheless, and dividing the shutter may pay.
            bounds.end.max.x = bounds.end.max.x.next_up();
        }
        bounds
    }

    /// The tubes of the corners, and their padding; `keys` is the number of keys, more than two.
    #[inline(always)]
    pub(in crate::primitive) fn tubes_of_corners(&self, id: u32, keys: usize, over: TimeInterval) -> CornerBounds {
        let [a, b, c] = self.vertices(id);
        let window = Window::new(over, keys);
        let corners = [self.keys_of_vertex(a, keys), self.keys_of_vertex(b, keys), self.keys_of_vertex(c, keys)];
        let (corners, magnitude) = tubes_of(&window, corners);
        CornerBounds { corners, slack: 2.0 * Triangles::slack(keys, magnitude) + TUBE_ULPS * ULP * magnitude }
    }
}

/// The padding beside twice the slack.
pub(in crate::primitive) const TUBE_ULPS: f32 = 16.0;

/// The tubes of three vertices over the interval of a window, and the largest coordinate at the keys around it.
#[inline(always)]
fn tubes_of(window: &Window, [a, b, c]: [&[Vec3]; 3]) -> ([LinearBox3; 3], f32) {
    let mut tubes = [Tube::new(window, a), Tube::new(window, b), Tube::new(window, c)];
    let of = |keys: &'_ [Vec3]| -> Range<usize> { window.inner.start..window.inner.end.min(keys.len()) };
    let inner = a[of(a)].iter().zip(&b[of(b)]).zip(&c[of(c)]);
    for (key, ((&a, &b), &c)) in (window.inner.start..).zip(inner) {
        let w = window.fraction(key);
        tubes[0].include(a, w);
        tubes[1].include(b, w);
        tubes[2].include(c, w);
    }
    // The keys between are included already.
    let mut size = tubes[0].size.max(tubes[1].size).max(tubes[2].size);
    for key in window.around.clone().filter(|key| !window.inner.contains(key)) {
        size = size.max(a[key].abs().max(b[key].abs()).max(c[key].abs()).into());
    }
    ([tubes[0].bounds(), tubes[1].bounds(), tubes[2].bounds()], size.max_element())
}

/// The bounds of a vertex: the line between its positions at both ends, shifted down and up.
struct Tube {
    begin: Vec3A,
    displacement: Vec3A,
    end: Vec3A,
    below: Vec3A,
    above: Vec3A,
    /// The largest coordinates that were included.
    size: Vec3A,
}

impl Tube {
    #[inline(always)]
    fn new(window: &Window, keys: &[Vec3]) -> Tube {
        let (low, high) = (window.begin.segment, window.end.segment);
        let begin = Vec3A::from(window.begin.position(keys[low], keys[low + 1]));
        let end = Vec3A::from(window.end.position(keys[high], keys[high + 1]));
        Tube { begin, displacement: end - begin, end, below: Vec3A::ZERO, above: Vec3A::ZERO, size: Vec3A::ZERO }
    }

    /// Includes the position at a key, at a fraction of the interval.
    #[inline(always)]
    fn include(&mut self, position: Vec3, w: f32) {
        let position = Vec3A::from(position);
        let offset = position - (self.begin + self.displacement * w);
        self.below = self.below.min(offset);
        self.above = self.above.max(offset);
        self.size = self.size.max(position.abs());
    }

    #[inline(always)]
    fn bounds(&self) -> LinearBox3 {
        let at = |center: Vec3A| Box3 { min: (center + self.below).into(), max: (center + self.above).into() };
        LinearBox3 { begin: at(self.begin), end: at(self.end) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{PrimitiveSet, TriangleMesh};
    use crate::random::Random;

    /// Counts corners outside of the bounds at times of their interval, including keys and times next to them, if a part of
    /// the padding is taken away.
    fn lost(part: f32) -> usize {
        let (mut random, mut lost) = (Random(19), 0);
        for keys in [3usize, 4, 9, 65, 200] {
            for _ in 0..60 {
                let mut point = |around: Vec3| {
                    around + Vec3::new(random.unit(), random.unit(), random.unit()) * 0.05 - Vec3::splat(0.025)
                };
                let mut places = vec![[Vec3::ZERO, Vec3::X, Vec3::Y].map(&mut point).to_vec()];
                for _ in 1..keys {
                    let last = places[places.len() - 1].clone();
                    places.push(last.into_iter().map(&mut point).collect());
                }
                let set = Triangles::new(&[TriangleMesh::new(vec![[0, 1, 2]], places)]).unwrap();
                let (a, b) = (random.unit(), random.unit());
                let over = match random.unit() {
                    x if x < 0.3 => TimeInterval::FULL,
                    _ => TimeInterval::half_open(a.min(b), a.max(b) + 1e-3).unwrap(),
                };
                let bounds = set.bounds(0, over);
                let window = Window::new(over, keys);
                let size = tubes_of(&window, set.vertices(0).map(|v| set.keys_of_vertex(v, keys))).1;
                let off = f64::from(part * (2.0 * Triangles::slack(keys, size) + 16.0 * ULP * size));
                for i in 0..200 {
                    let key = (i / 3 % keys) as f32 / (keys - 1) as f32;
                    let t = match i % 3 {
                        0 => key,
                        1 => [key.next_up(), key.next_down()][i / 3 % 2],
                        _ => over.begin() + over.duration() * random.unit(),
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
