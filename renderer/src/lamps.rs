//! Surfaces that shine: which of their triangles a ray looks for.
//!
//! Triangles are chosen by their power, which is mean emission times mean area over the shutter. Where a picture is all dark on a
//! triangle as far as a few points tell, no ray looks for it: light from there is found by paths alone, and the mean is the same.
//!
//! A lamp can be found in two ways, by a ray that looks for it and by a path that happens to go there. Both are made, and what each
//! finds counts by [`weight`]: rays that look find small lamps, paths find large near ones, and the mean is that of either.

use crate::materials::Surface;
use mbkd::glam::{DVec3, Vec2, Vec3};
use mbkd::{Hit, Keys, TriangleMesh};

/// Points of a triangle at which its emission is looked up, along each of two sides.
const POINTS: u32 = 8;

/// The shining triangles of a stage.
#[derive(Default)]
pub struct Lamps {
    /// For each mesh, where its triangles begin in `sums`; none if it does not shine.
    begins: Vec<Option<usize>>,
    /// The mesh and the number of each triangle of shining meshes.
    triangles: Vec<(u32, u32)>,
    /// The sum of the powers of all triangles up to each, with it.
    sums: Vec<f64>,
}

impl Lamps {
    /// Those among these meshes with these surfaces.
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

    /// Whether there is none to look for.
    pub fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }

    /// The mesh and the number of the triangle that a number in [0, 1) chooses; none where there are no lamps.
    pub fn chosen(&self, number: f32) -> Option<(u32, u32)> {
        let mark = f64::from(number) * self.sums.last()?;
        self.triangles.get(self.sums.partition_point(|&sum| sum <= mark)).copied()
    }

    /// How likely a triangle is chosen.
    pub fn chance(&self, mesh: u32, triangle: u32) -> f64 {
        let Some(&Some(begin)) = self.begins.get(mesh as usize) else { return 0.0 };
        let at = begin + triangle as usize;
        let before = at.checked_sub(1).map_or(0.0, |before| self.sums[before]);
        (self.sums[at] - before) / self.sums[self.sums.len() - 1]
    }
}

/// A place on a lamp, as it is seen from a point.
pub struct Sight {
    /// Direction, of length 1.
    pub dir: Vec3,
    /// How far.
    pub distance: f64,
    /// How likely it is looked for, per steradian.
    pub density: f32,
}

impl Sight {
    /// Of a place on the triangle with these corners, which is chosen with this chance, all of its places alike.
    pub fn new(from: DVec3, place: DVec3, [a, b, c]: [DVec3; 3], chance: f64) -> Sight {
        let way = place - from;
        let distance = way.length();
        let dir = way / distance;
        // Twice the area that the eye sees.
        let seen = (b - a).cross(c - a).dot(dir).abs();
        let density = if chance > 0.0 { 2.0 * chance * distance * distance / seen } else { 0.0 };
        Sight { dir: dir.as_vec3(), distance, density: density as f32 }
    }
}

/// How much what was found in one way counts that could have been found in another, by the densities of both: the power heuristic
/// (Veach and Guibas, "Optimally combining sampling techniques for Monte Carlo rendering", 1995).
pub fn weight(own: f32, other: f32) -> f32 {
    let ratio = other / own.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + ratio * ratio)
}

/// The weights of the second and third corner of a triangle for a point of the unit square, equal areas for equal areas (Heitz, "A
/// low-distortion map between triangle and square", 2019).
pub fn spread(Vec2 { x, y }: Vec2) -> [f32; 2] {
    if y > x { [0.5 * x, y - 0.5 * x] } else { [x - 0.5 * y, 0.5 * y] }
}

/// The mean emission of a triangle, over the colours, as far as a few points tell.
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
