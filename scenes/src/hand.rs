//! A hand that closes: a forearm, a palm and five fingers, each joint bending at its own pace.
//!
//! Smooth articulated motion: coherent along a finger, different between fingers, and curved in time, so
//! it has five keys.

use super::shape::{Shape, animate};
use super::turn::cos_sin;
use super::{Camera, Look, Scene, View};
use glam::Vec3;

/// The hand, with about this many triangles.
///
/// ```
/// let scene = mbkd_scenes::hand(12_000);
/// assert_eq!(scene.meshes[0].keys.len(), 5);
/// ```
pub fn hand(triangles: usize) -> Scene {
    // Six tubes, each with twice as many rings as points around: 4 n^2 triangles.
    let around = ((triangles as f32 / 24.0).sqrt() as usize).max(5);
    Scene {
        name: "hand".into(),
        meshes: vec![animate(5, |time| pose(around, time))],
        looks: vec![Look::plain(Vec3::new(0.72, 0.46, 0.34))],
        camera: Camera::fixed(View::new(Vec3::new(1.1, 1.35, 3.3), Vec3::new(0.03, 0.38, 0.18), 0.74)),
    }
}

/// A finger: where it begins, along what, how long and thick it is, and how far its joints are bent.
struct Finger {
    base: Vec3,
    along: Vec3,
    /// The way it bends, at right angles to `along`.
    inward: Vec3,
    length: f32,
    radius: f32,
    /// Turns per joint.
    bend: f32,
}

fn pose(around: usize, time: f32) -> Shape {
    let mut shape = Shape::default();
    palm(&mut shape, around);
    // Fingers close one after the other, the little one first.
    for (i, (x, y, length, radius)) in
        [(-0.33, 0.50, 0.78, 0.115), (-0.11, 0.56, 0.90, 0.12), (0.11, 0.53, 0.84, 0.115), (0.31, 0.44, 0.64, 0.098)]
            .into_iter()
            .enumerate()
    {
        let i = i as f32;
        let along = Vec3::new(0.34 * x, 1.0, 0.0).normalize();
        let bend = 0.055 + 0.016 * i + (0.024 + 0.008 * i) * time;
        finger(
            &mut shape,
            around,
            &Finger { base: Vec3::new(x, y, 0.0), along, inward: Vec3::Z, length, radius, bend },
        );
    }
    let along = Vec3::new(-0.72, 0.62, 0.31).normalize();
    let inward = (Vec3::new(0.55, 0.2, 0.8) - along * along.dot(Vec3::new(0.55, 0.2, 0.8))).normalize();
    let base = Vec3::new(-0.26, -0.22, 0.06);
    let thumb = Finger { base, along, inward, length: 0.86, radius: 0.14, bend: 0.01 + 0.02 * time };
    finger(&mut shape, around, &thumb);
    shape
}

/// Forearm, wrist and palm: one tube of flattened rings, closed at the knuckles.
fn palm(shape: &mut Shape, around: usize) {
    // Height, half width, half thickness.
    let profile = [
        (-1.70, 0.29, 0.25),
        (-1.20, 0.27, 0.22),
        (-0.75, 0.23, 0.17),
        (-0.52, 0.26, 0.17),
        (-0.25, 0.39, 0.20),
        (0.10, 0.45, 0.18),
        (0.40, 0.46, 0.15),
        (0.55, 0.41, 0.125),
        (0.62, 0.28, 0.08),
    ];
    let rings = 2 * around;
    let ring_at = |ring: usize| spline(&profile, ring as f32 / (rings - 1) as f32);
    let point = |ring: usize, k: usize| {
        let (height, width, thick) = ring_at(ring);
        let (c, s) = cos_sin(k as f32 / around as f32);
        // A rounded rectangle rather than an ellipse.
        let full = 1.0 / (c * c * c * c + s * s * s * s).sqrt().sqrt();
        let round = 1.0 + 0.6 * (full - 1.0);
        Vec3::new(c * width * round, height, -s * thick * round)
    };
    shape.tube(Some(Vec3::new(0.0, -1.7, 0.0)), rings, around, point, Some(Vec3::new(0.0, 0.64, 0.0)));
}

/// Three bones whose joints bend within a short stretch each, with a knuckle there and a round tip.
fn finger(shape: &mut Shape, around: usize, f: &Finger) {
    let rings = 2 * around;
    let side = f.along.cross(f.inward);
    let at_ring = |ring: usize| ring as f32 / rings as f32;
    let bent = |s: f32| {
        let joint = |at: f32| smooth((s - at) * 7.0 + 0.5);
        f.bend * (joint(0.06) + 1.25 * joint(0.45) + joint(0.73))
    };
    // The middle of each ring: the direction summed up along the finger.
    let step = f.length / rings as f32;
    let mut middle = f.base - f.along * (1.2 * f.radius);
    let mut rows = Vec::with_capacity(rings + 1);
    for ring in 0..=rings {
        let s = at_ring(ring);
        let (c, sn) = cos_sin(bent(s));
        let along = f.along * c + f.inward * sn;
        let out = f.inward * c - f.along * sn;
        rows.push((middle, out, s));
        middle += along * (step * 1.12);
    }
    let point = |ring: usize, k: usize| {
        let (middle, out, s) = rows[ring];
        let (c, sn) = cos_sin(k as f32 / around as f32);
        let knuckle = |at: f32| 1.0 - smooth(((s - at) * 9.0).abs());
        let tip = ((s - 0.86) / 0.14).max(0.0);
        let round = (1.0 - tip * tip).max(0.02).sqrt();
        let radius = f.radius * (1.08 - 0.3 * s + 0.07 * (knuckle(0.45) + knuckle(0.73))) * round;
        middle + (side * c - out * sn * 0.92) * radius
    };
    shape.tube(Some(rows[0].0), rings, around, point, Some(rows[rings].0));
}

/// 0 below 0, 1 above 1, smooth between.
fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// A Catmull-Rom spline through the rows of a table.
fn spline(table: &[(f32, f32, f32)], s: f32) -> (f32, f32, f32) {
    let last = table.len() - 1;
    let at = s * last as f32;
    let i = (at as usize).min(last - 1);
    let x = at - i as f32;
    let row = |k: usize| Vec3::from(table[k]);
    let (a, b, c, d) = (row(i.saturating_sub(1)), row(i), row(i + 1), row((i + 2).min(last)));
    let p = b + ((c - a) + ((a * 2.0 - b * 5.0 + c * 4.0 - d) + (b * 3.0 - a - c * 3.0 + d) * x) * x) * (0.5 * x);
    (p.x, p.y, p.z)
}
