//! Emitting surfaces, and the choice of their triangles for shadow rays.
//!
//! Triangles are chosen by their power, which is mean emission times mean area over the shutter. If a texture is black
//! on a triangle at all sampled points, no shadow ray samples it: its light is found by paths alone, and the mean is
//! the same.
//!
//! A lamp can be found in two ways, by a shadow ray and by a path that happens to hit it. Both are used, and each
//! contribution is weighted by [`weight`] (multiple importance sampling): shadow rays find small lamps, paths find
//! large near ones, and the mean is that of either.

use crate::materials::Surface;
use mbkd::glam::{DVec3, Vec2, Vec3};
use mbkd::{Hit, Keys, TriangleMesh};

/// Points of a triangle at which its emission is looked up, along each of two sides.
const POINTS: u32 = 8;

/// The emitting triangles of a stage.
#[derive(Default)]
pub struct Lamps {
    /// For each mesh, the index of its first triangle in `sums`; `None` if it does not emit.
    begins: Vec<Option<usize>>,
    /// The mesh and the index of each triangle of emitting meshes.
    triangles: Vec<(u32, u32)>,
    /// Prefix sums of the powers of all triangles.
    sums: Vec<f64>,
}

impl Lamps {
    /// The emitting triangles of these meshes with these surfaces.
    pub fn new(meshes: &[TriangleMesh], surfaces: &[Surface]) -> Lamps {
        let (mut lamps, mut sum) = (Lamps::default(), 0.0);
        for (number, (mesh, surface)) in meshes.iter().zip(surfaces).enumerate() {
            let shines = surface.emission != Vec3::ZERO;
            lamps.begins.push(shines.then_some(lamps.sums.len()));
            for (triangle, &corners) in mesh.indices.iter().enumerate().filter(|_| shines) {
                let power = f64::from(brightness(surface, corners)) * mean_area(&mesh.keys, corners);
                sum += if power.is_finite() { power.max(0.0) } else { 0.0 };
                lamps.triangles.push((number as u32, triangle as u32));
                lamps.sums.push(sum);
            }
        }
        if sum > 0.0 { lamps } else { Lamps::default() }
    }

    /// Whether there is none to sample.
    pub fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }

    /// The mesh and the triangle that a number in [0, 1) selects; `None` without lamps.
    pub fn chosen(&self, number: f32) -> Option<(u32, u32)> {
        let mark = f64::from(number) * self.sums.last()?;
        self.triangles.get(self.sums.partition_point(|&sum| sum <= mark)).copied()
    }

    /// The probability of selecting a triangle.
    pub fn chance(&self, mesh: u32, triangle: u32) -> f64 {
        let Some(&Some(begin)) = self.begins.get(mesh as usize) else { return 0.0 };
        let at = begin + triangle as usize;
        let before = at.checked_sub(1).map_or(0.0, |before| self.sums[before]);
        (self.sums[at] - before) / self.sums[self.sums.len() - 1]
    }
}

/// A point on a lamp, as seen from a point.
pub struct Sight {
    /// Direction, of length 1.
    pub dir: Vec3,
    /// The distance.
    pub distance: f64,
    /// The density with which it is sampled, per steradian.
    pub density: f32,
}

impl Sight {
    /// A point on the triangle with these corners, which is selected with probability `chance` and sampled uniformly.
    pub fn new(from: DVec3, place: DVec3, [a, b, c]: [DVec3; 3], chance: f64) -> Sight {
        let way = place - from;
        let distance = way.length();
        let dir = way / distance;
        // Twice the projected area.
        let seen = (b - a).cross(c - a).dot(dir).abs();
        let density = if chance > 0.0 { 2.0 * chance * distance * distance / seen } else { 0.0 };
        Sight { dir: dir.as_vec3(), distance, density: density as f32 }
    }
}

/// The weight of a contribution found in one way that could have been found in another, given the densities of both:
/// the power heuristic (Veach and Guibas, "Optimally combining sampling techniques for Monte Carlo rendering", 1995).
pub fn weight(own: f32, other: f32) -> f32 {
    let ratio = other / own.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + ratio * ratio)
}

/// The weights of the second and third corner of a triangle for a point of the unit square, preserving areas (Heitz, "A
/// low-distortion map between triangle and square", 2019).
pub fn spread(Vec2 { x, y }: Vec2) -> [f32; 2] {
    if y > x { [0.5 * x, y - 0.5 * x] } else { [x - 0.5 * y, 0.5 * y] }
}

/// The mean emission of a triangle over the colour channels, estimated at a few points.
fn brightness(surface: &Surface, corners: [u32; 3]) -> f32 {
    let sum = |light: Vec3| light.x + light.y + light.z;
    if surface.emission_texture.is_none() {
        return sum(surface.emission);
    }
    let at = |i: u32| (i as f32 + 0.5) / POINTS as f32;
    let points = (0..POINTS * POINTS).map(|i| spread(Vec2::new(at(i % POINTS), at(i / POINTS))));
    let light = |[u, v]: [f32; 2]| surface.emission_at(&Hit { t: 0.0, u, v, mesh: 0, primitive: 0 }, corners);
    points.map(|point| sum(light(point))).sum::<f32>() / (POINTS * POINTS) as f32
}

/// The mean area of a triangle over the keys.
fn mean_area(keys: &Keys, corners: [u32; 3]) -> f64 {
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    match keys {
        Keys::F32(keys) => mean(keys.iter().map(|key| area(corners.map(|i| key[i as usize].as_dvec3())))),
        Keys::F64(keys) | Keys::Precise(keys) => mean(keys.iter().map(|key| area(corners.map(|i| key[i as usize])))),
    }
}

fn mean(areas: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = areas.len().max(1);
    areas.sum::<f64>() / count as f64
}
