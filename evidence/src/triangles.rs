//! The program's own geometry of a triangle, in f64: its corners at a time, its normal, and how far inside or outside
//! of it a ray passes. The referee where the two sides disagree.

use glam::{DVec3, Vec3};
use mbkd::{Hit, Keys, Ray, TriangleMesh, glam};
use std::borrow::Cow;

/// The three corners at a time.
pub fn corners(meshes: &[TriangleMesh], mesh: u32, triangle: u32, time: f32) -> [DVec3; 3] {
    let mesh = &meshes[mesh as usize];
    let segments = mesh.keys.len() - 1;
    let at = f64::from(time) * segments as f64;
    let first = (at as usize).min(segments.saturating_sub(1));
    let s = at - first as f64;
    mesh.indices[triangle as usize].map(|vertex| {
        let a = position(&mesh.keys, first, vertex);
        let b = position(&mesh.keys, (first + 1).min(segments), vertex);
        a + (b - a) * s
    })
}

fn position(keys: &Keys, key: usize, vertex: u32) -> DVec3 {
    match keys {
        Keys::F32(keys) => keys[key][vertex as usize].as_dvec3(),
        Keys::F64(keys) | Keys::Precise(keys) => keys[key][vertex as usize],
    }
}

/// The normal of a hit triangle at the ray's time, of length one, on the side of the ray's origin.
pub fn facing_normal(meshes: &[TriangleMesh], ray: &Ray, hit: &Hit) -> Vec3 {
    let [a, b, c] = corners(meshes, hit.mesh, hit.primitive, ray.time);
    let normal = (b - a).cross(c - a).normalize_or(-ray.dir.as_dvec3().normalize()).as_vec3();
    if normal.dot(ray.dir) > 0.0 { -normal } else { normal }
}

/// The position of a ray relative to one triangle.
pub struct Passage {
    /// Distance, in space, from the ray to the nearest edge as seen along the ray; negative outside.
    pub margin: f64,
    /// Where the ray crosses the triangle's plane.
    pub t: f64,
}

/// The passage of a ray by a triangle. If the triangle is edge-on the margin is tiny or negative, never large.
pub fn pass(ray: &Ray, corners: [DVec3; 3]) -> Passage {
    let dir = ray.dir.as_dvec3().normalize();
    let (across, up) = dir.any_orthonormal_pair();
    let flat = corners.map(|p| glam::DVec2::new((p - ray.origin).dot(across), (p - ray.origin).dot(up)));
    let area = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
    let mut margin = f64::INFINITY;
    for i in 0..3 {
        let (a, b) = (flat[i], flat[(i + 1) % 3]);
        let edge = b - a;
        let along = (-a.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let distance = if edge.length_squared() > 0.0 { (a + edge * along).length() } else { a.length() };
        let inside = area.signum() * edge.perp_dot(-a) > 0.0;
        margin = margin.min(if inside { distance } else { -distance });
    }
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let t = normal.dot(corners[0] - ray.origin) / normal.dot(ray.dir.as_dvec3());
    Passage { margin, t }
}

/// Positions at each key in single precision, as Embree takes them.
pub fn positions(mesh: &TriangleMesh) -> Vec<Cow<'_, [Vec3]>> {
    match &mesh.keys {
        Keys::F32(keys) => keys.iter().map(|key| Cow::Borrowed(key.as_slice())).collect(),
        Keys::F64(keys) | Keys::Precise(keys) => {
            keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect()
        }
    }
}

/// The swept box.
pub fn bounds(meshes: &[TriangleMesh]) -> (Vec3, Vec3) {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for key in meshes.iter().flat_map(positions) {
        (min, max) = key.iter().fold((min, max), |(min, max), &p| (min.min(p), max.max(p)));
    }
    (min, max)
}

/// Length of the diagonal of the swept box.
pub fn scene_size(meshes: &[TriangleMesh]) -> f32 {
    let (min, max) = bounds(meshes);
    (max - min).length()
}
