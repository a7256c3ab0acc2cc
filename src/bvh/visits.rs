//! How often rays visit a box.
//!
//! Infinite lines meet a convex box in proportion to its surface: this is the surface area heuristic. But rays begin on
//! one surface and end on the next. Of segments of length `l`, evenly distributed over positions and directions,
//! `S l / 4` meet a box of surface `S` and volume `V` from outside (Cauchy), and `V` begin in it. So a room is visited
//! by every ray that begins in it, but its floor and walls are not, though they have about as much area: a leaf block
//! of all of them costs more than its area suggests. (Visits by rays that begin inside were first counted by Aila,
//! Karras and Laine, "On Quality Metrics of Bounding Volume Hierarchies", 2013, as the overlap of end points.)
//!
//! With half the surface `a = S / 2` that is `l / 2` times `a + 2 V / l`. Among surfaces of area `A` in a volume `W`
//! the mean length is `l = 2 W / A`, as over all directions a ray sees half of the area. This leaves `a + V A / W`.

use super::binning::{CROSSED, EXTENTS, HALF, TURNED};
use super::reference::{Packed, Reference};
use crate::geometry::{Box3, LinearBox3};
use crate::parallel;
use crate::simd::{Kernel, LANES, Simd, SimdLevel, dispatch};
use glam::Vec3;

/// Mean over the interval of half the surface area of a linearly changing box.
///
/// With h(d) = xy + yz + zx the integrand is quadratic in time, so the mean is exact: (h(d0) + h(d1) + h(d0 + d1)) / 6.
#[inline(always)]
pub(crate) fn mean_half_area(b: &LinearBox3) -> f32 {
    let h = |d: Vec3| d.x * d.y + d.y * d.z + d.z * d.x;
    let d0 = (b.begin.max - b.begin.min).max(Vec3::ZERO);
    let d1 = (b.end.max - b.end.min).max(Vec3::ZERO);
    (h(d0) + h(d1) + h(d0 + d1)) * (1.0 / 6.0)
}

/// The area of surfaces per volume, from which visits of boxes are predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SurfaceDensity(pub(super) f32);

impl SurfaceDensity {
    /// The density for rays that begin and end outside of all boxes.
    pub const NONE: SurfaceDensity = SurfaceDensity(0.0);

    /// The density of primitives whose boxes have `area_ratio` times their area (half the surface of a box counts).
    pub fn of(references: &[Reference], area_ratio: f64) -> SurfaceDensity {
        let simd = SimdLevel::best();
        let parts = parallel::chunks(references.len(), |of| dispatch(simd, Sums(&references[of])));
        let (area, all) = parts.into_iter().fold((0.0, LinearBox3::EMPTY), |a, b| (a.0 + b.area, a.1.union(b.all)));
        let density = (area / area_ratio / f64::from(volume(&all))) as f32;
        // A flat box has no volume.
        SurfaceDensity(if density.is_finite() { density } else { 0.0 })
    }

    /// How often the boxes of references are visited in total, as an area.
    pub fn visits_of_all(self, references: &[Reference]) -> f32 {
        let simd = SimdLevel::best();
        let parts = parallel::chunks(references.len(), |of| {
            let Sum { area, volume, .. } = dispatch(simd, Sums(&references[of]));
            area + f64::from(self.0) * volume
        });
        parts.into_iter().sum::<f64>() as f32
    }

    /// How often a box is visited, as an area.
    #[inline(always)]
    pub fn visits(self, bounds: &LinearBox3) -> f32 {
        mean_half_area(bounds) + self.0 * volume(bounds)
    }

    /// The same of a box that does not move.
    #[inline(always)]
    pub(super) fn visits_of_static(self, bounds: &Box3) -> f32 {
        let size = (bounds.max - bounds.min).max(Vec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x + self.0 * size.element_product()
    }
}

/// Of some references: the sums of their mean areas and of their volumes, and the bounds of all of them.
struct Sum {
    area: f64,
    volume: f64,
    all: LinearBox3,
}

/// Computes a [`Sum`].
struct Sums<'a>(&'a [Reference]);

/// References whose areas and volumes are added in f32.
const BLOCK: usize = 64;

impl Kernel for Sums<'_> {
    type Output = Sum;

    /// As in [`super::binning`], an area is six products in six lanes; here only one half of the lanes has them.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Sum {
        let (zero, turned, crossed) = (s.splat(0.0), s.load_u(&TURNED), s.load_u(&CROSSED));
        let (mut area, mut volume, mut all) = (0.0, 0.0, s.splat(f32::INFINITY));
        for references in self.0.chunks(BLOCK) {
            let (mut areas, mut volumes) = (zero, zero);
            for r in references {
                let lanes = s.load(&r.packed().0);
                all = s.min(all, lanes);
                let d = s.select(HALF & EXTENTS, s.max(zero - (lanes + s.swap_lanes::<8>(lanes)), zero), zero);
                let (own, other) = (s.permute(d, turned), s.permute(d, crossed));
                // Twice the extents in the middle of the interval; the first three lanes have the same product.
                let twice = own + other;
                areas = areas + d * (twice + own);
                let next = s.permute(twice, turned);
                volumes = volumes + twice * next * s.permute(next, turned);
            }
            let mut by_lane = [0.0; LANES];
            s.store(areas, &mut by_lane);
            area += by_lane.iter().map(|&area| f64::from(area)).sum::<f64>();
            volume += f64::from(s.lane(volumes, 0));
        }
        let mut packed = Packed::EMPTY;
        s.store(all, &mut packed.0);
        Sum { area: area / 6.0, volume: 0.125 * volume, all: packed.bounds() }
    }
}

/// The volume at the middle of the interval.
#[inline(always)]
fn volume(b: &LinearBox3) -> f32 {
    let twice = (b.begin.max - b.begin.min) + (b.end.max - b.end.min);
    0.125 * twice.max(Vec3::ZERO).element_product()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn fixed(min: Vec3, max: Vec3) -> LinearBox3 {
        LinearBox3 { begin: Box3 { min, max }, end: Box3 { min, max } }
    }

    /// Counts segments between random points of six walls in boxes inside.
    #[test]
    fn boxes_are_visited_by_as_many_segments_as_predicted() {
        let mut random = Random(7);
        // Many small plates, so that a ray may end anywhere: segments begin anywhere, and their lengths decay
        // exponentially.
        let density = 8.0f32;
        let mean_length = 2.0 / density;
        let boxes = [
            fixed(Vec3::splat(0.4), Vec3::splat(0.6)),
            fixed(Vec3::new(0.3, 0.5, 0.3), Vec3::new(0.7, 0.5, 0.7)),
            fixed(Vec3::new(0.3, 0.3, 0.4), Vec3::new(0.7, 0.7, 0.5)),
        ];
        let mut visited = [0.0f32; 3];
        for _ in 0..200_000 {
            let origin = Vec3::new(random.unit(), random.unit(), random.unit());
            let up = 2.0 * random.unit() - 1.0;
            let (sin, cos) = (core::f32::consts::TAU * random.unit()).sin_cos();
            let dir = Vec3::new((1.0 - up * up).sqrt() * cos, (1.0 - up * up).sqrt() * sin, up);
            let length = -mean_length * (1.0 - random.unit()).ln();
            for (visited, b) in visited.iter_mut().zip(&boxes) {
                let (a, c) = ((b.begin.min - origin) / dir, (b.begin.max - origin) / dir);
                let (enter, leave) = (a.min(c).max_element().max(0.0), a.max(c).min_element().min(length));
                *visited += f32::from(u8::from(enter <= leave));
            }
        }
        let expected = boxes.map(|b| SurfaceDensity(density).visits(&b));
        for i in 1..3 {
            let (counted, said) = (visited[i] / visited[0], expected[i] / expected[0]);
            assert!((counted / said - 1.0).abs() < 0.05, "{counted} instead of {said}");
        }
        let of_static = SurfaceDensity(density).visits_of_static(&boxes[2].begin);
        assert!((of_static / SurfaceDensity(density).visits(&boxes[2]) - 1.0).abs() < 1e-6);
        // By area alone the plate would be visited as often as the thick boxes around it.
        assert!(visited[1] < 0.8 * visited[0] * mean_half_area(&boxes[1]) / mean_half_area(&boxes[0]));
    }

    #[test]
    fn the_density_is_area_per_volume_and_none_where_there_is_no_volume() {
        let plates = [0.0, 0.5, 1.0].map(|y| fixed(Vec3::new(0.0, y, 0.0), Vec3::new(2.0, y, 3.0)));
        let references: Vec<Reference> = (0..).zip(plates).map(|(id, b)| Reference::new(b, id)).collect();
        assert_eq!(SurfaceDensity::of(&references, 2.0), SurfaceDensity(3.0 * 6.0 / 2.0 / 6.0));
        assert_eq!(SurfaceDensity::of(&references[..1], 2.0), SurfaceDensity::NONE);
        assert_eq!(SurfaceDensity::of(&[], 2.0), SurfaceDensity::NONE);
    }

    #[test]
    fn the_visits_of_all_references_are_the_sum_of_those_of_each() {
        let mut random = Random(9);
        let mut boxed = || {
            let at = random.vec();
            Box3 { min: at, max: at + Vec3::new(random.unit(), random.unit(), random.unit()) }
        };
        let references: Vec<Reference> =
            (0..1000).map(|id| Reference::new(LinearBox3 { begin: boxed(), end: boxed() }, id)).collect();
        let density = SurfaceDensity(3.0);
        let each: f32 = references.iter().map(|r| density.visits(&r.bounds())).sum();
        assert!((density.visits_of_all(&references) / each - 1.0).abs() < 1e-4);
    }
}
