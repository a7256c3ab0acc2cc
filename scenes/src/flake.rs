//! The recursive sphere flake (Haines, "A Proposal for Standard Graphics Environments", 1987) in motion:
//! every sphere carries nine of a third its size, and each crown of nine turns about its parent.
//!
//! A sphere's motion combines the rotations of all its ancestors, so small spheres move far along curls.

use super::turn::{cos_sin, frame, rotation};
use super::{Camera, View};
use glam::{Mat3, Vec3};

/// A sphere of the flake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlakeSphere {
    /// Its centre at three keys spaced evenly over the shutter.
    pub centers: [Vec3; 3],
    /// Its radius, the same throughout.
    pub radius: f32,
    /// Its level; 0 is the root.
    pub level: u32,
}

/// Turns of a crown about its parent during the shutter.
const SPIN: f32 = 0.011;

/// The first `spheres` spheres of the flake, large ones first; 66 430 are the full six levels.
///
/// ```
/// let (spheres, _camera) = mbkd_scenes::flake(10);
/// assert_eq!(spheres.iter().filter(|s| s.level == 1).count(), 9);
/// ```
pub fn flake(spheres: usize) -> (Vec<FlakeSphere>, Camera) {
    let root = Ball { level: 0, radius: 1.0, at: [(Vec3::ZERO, tilt(Vec3::new(-0.25, 0.9, 0.35).normalize())); 3] };
    let mut balls = vec![root];
    // Breadth first: any prefix of the list is a flake.
    let mut parent = 0;
    while balls.len() < spheres {
        let ball = balls[parent];
        balls.extend((0..9).map(|child| ball.child(child)));
        parent += 1;
    }
    balls.truncate(spheres.max(1));
    let spheres =
        balls.iter().map(|b| FlakeSphere { centers: b.at.map(|(centre, _)| centre), radius: b.radius, level: b.level });
    (spheres.collect(), Camera::fixed(View::new(Vec3::new(0.0, 1.5, 5.4), Vec3::new(0.0, 0.05, 0.0), 0.72)))
}

/// A sphere with its frame at each key; the third axis points away from the parent.
#[derive(Clone, Copy)]
struct Ball {
    level: u32,
    radius: f32,
    at: [(Vec3, Mat3); 3],
}

impl Ball {
    /// Six children around the equator, three above.
    fn child(&self, child: usize) -> Ball {
        let (around, up) =
            if child < 6 { (child as f32 / 6.0, 0.0) } else { ((child - 6) as f32 / 3.0 + 1.0 / 12.0, 0.155) };
        let (c, s) = cos_sin(around);
        let (flat, high) = cos_sin(up);
        let out = Vec3::new(c * flat, s * flat, high);
        let radius = self.radius / 3.0;
        let mut key = 0.0;
        let at = self.at.map(|(centre, axes)| {
            let axes = axes * rotation(Vec3::Z, SPIN * key);
            key += 0.5;
            (centre + axes * out * (self.radius + radius), axes * tilt(out))
        });
        Ball { level: self.level + 1, radius, at }
    }
}

/// The frame whose third axis is `n`.
fn tilt(n: Vec3) -> Mat3 {
    let (u, v) = frame(n);
    Mat3::from_cols(u, v, n)
}
