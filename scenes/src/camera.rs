//! A pinhole camera that may move during the shutter.

use engine::Ray;
use glam::Vec3;

/// The pose of a camera at one key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye.
    pub position: Vec3,
    /// The point in the middle of the picture.
    pub target: Vec3,
    /// The up vector; it need not be at right angles to the line of sight.
    pub up: Vec3,
    /// Height of the picture at distance 1 from the eye: twice the tangent of half the vertical angle.
    pub height: f32,
}

impl View {
    /// A view with y up.
    pub fn new(position: Vec3, target: Vec3, height: f32) -> View {
        View { position, target, up: Vec3::Y, height }
    }

    /// The vector to the right edge of the picture at distance 1, that to its upper edge, and the line of
    /// sight, for a picture of `aspect` = width / height.
    ///
    /// ```
    /// use glam::Vec3;
    /// use mbkd_scenes::View;
    /// let view = View::new(Vec3::ZERO, Vec3::NEG_Z, 2.0);
    /// assert_eq!(view.axes(1.5), [Vec3::X * 1.5, Vec3::Y, Vec3::NEG_Z]);
    /// ```
    pub fn axes(&self, aspect: f32) -> [Vec3; 3] {
        let forward = (self.target - self.position).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(self.up).normalize_or(forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let half = 0.5 * self.height;
        [right * (half * aspect), up * half, forward]
    }
}

/// A camera: one static [`View`], or several spaced evenly over the shutter, linear between.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The views. Without any, the camera is at the origin and looks along -z.
    pub keys: Vec<View>,
}

impl Camera {
    /// A static camera.
    pub fn fixed(view: View) -> Camera {
        Camera { keys: vec![view] }
    }

    /// The view at a time in `[0, 1]`; times outside are taken as the nearer end.
    pub fn view(&self, time: f32) -> View {
        let Some(last) = self.keys.len().checked_sub(1) else {
            return View::new(Vec3::ZERO, Vec3::NEG_Z, 1.0);
        };
        let at = time.clamp(0.0, 1.0) * last as f32;
        let segment = (at as usize).min(last.saturating_sub(1));
        let (a, b, s) = (self.keys[segment], self.keys[(segment + 1).min(last)], at - segment as f32);
        View {
            position: a.position + (b.position - a.position) * s,
            target: a.target + (b.target - a.target) * s,
            up: a.up + (b.up - a.up) * s,
            height: a.height + (b.height - a.height) * s,
        }
    }

    /// The ray through a place of the picture at a time: `x` from 0 (left) to 1, `y` from 0 (top) to 1.
    ///
    /// ```
    /// use glam::Vec3;
    /// use mbkd_scenes::{Camera, View};
    /// let camera = Camera::fixed(View::new(Vec3::Z, Vec3::ZERO, 1.0));
    /// let ray = camera.ray(0.5, 0.5, 16.0 / 9.0, 0.25);
    /// assert_eq!((ray.dir, ray.time), (Vec3::NEG_Z, 0.25));
    /// ```
    pub fn ray(&self, x: f32, y: f32, aspect: f32, time: f32) -> Ray {
        let view = self.view(time);
        let [right, up, forward] = view.axes(aspect);
        let dir = forward + right * (2.0 * x - 1.0) + up * (1.0 - 2.0 * y);
        Ray::new(view.position, dir).at_time(time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_met_and_blended() {
        let view = |x: f32| View::new(Vec3::new(x, 0.0, 0.0), Vec3::NEG_Z, 1.0);
        let camera = Camera { keys: vec![view(0.0), view(1.0), view(5.0)] };
        for (time, x) in [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.5), (0.5, 1.0), (0.75, 3.0), (1.0, 5.0), (2.0, 5.0)] {
            assert_eq!(camera.view(time).position.x, x, "time {time}");
        }
        assert_eq!(Camera::fixed(view(3.0)).view(0.7), view(3.0));
    }
}
