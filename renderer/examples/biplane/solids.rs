//! The solids that the parts are made of: solids of revolution, balls, rods, and wings.

use mbkd::glam::{Mat3, Vec3};
use mbkd_renderer::sampling::cos_sin;
use mbkd_scenes::Shape;
use mbkd_scenes::frame;

/// Axes of a solid of revolution whose own y, its axis, points along x.
pub const ALONG_X: Mat3 = Mat3::from_cols(Vec3::NEG_Y, Vec3::X, Vec3::Z);
/// The same along z.
pub const ALONG_Z: Mat3 = Mat3::from_cols(Vec3::X, Vec3::Z, Vec3::NEG_Y);

/// Axes rotated about their own y by an angle in turns.
pub fn turned(axes: Mat3, turns: f32) -> Mat3 {
    let (c, s) = cos_sin(turns);
    axes * Mat3::from_cols(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c))
}

/// A solid of revolution about the y of `axes`: a circle of `around` points for each height and radius of the profile,
/// closed at both ends.
pub fn lathe(shape: &mut Shape, at: Vec3, axes: Mat3, profile: &[[f32; 2]], around: usize) {
    let ends = [profile[0][0], profile[profile.len() - 1][0]];
    revolve(shape, (at, axes), profile, ends, around);
}

/// A ball of radius 1 along each of the axes, with so many rings between its poles.
pub fn ball(shape: &mut Shape, at: Vec3, axes: Mat3, rings: usize) {
    let ring = |ring: usize| {
        let (c, s) = cos_sin(0.5 * (ring + 1) as f32 / (rings + 1) as f32);
        [-c, s]
    };
    revolve(shape, (at, axes), &(0..rings).map(ring).collect::<Vec<_>>(), [-1.0, 1.0], 2 * rings);
}

/// Circles about the y of the axes, closed by tips at these heights.
fn revolve(shape: &mut Shape, (at, axes): (Vec3, Mat3), profile: &[[f32; 2]], tips: [f32; 2], around: usize) {
    let point = |ring: usize, k: usize| {
        let ([height, radius], (c, s)) = (profile[ring], cos_sin(k as f32 / around as f32));
        at + axes * Vec3::new(s * radius, height, c * radius)
    };
    let [start, end] = tips.map(|height| Some(at + axes * (Vec3::Y * height)));
    shape.tube(start, profile.len(), around, point, end);
}

/// A round rod between two points.
pub fn rod(shape: &mut Shape, from: Vec3, to: Vec3, radius: f32) {
    let along = (to - from).normalize_or(Vec3::Y);
    let (u, v) = frame(along);
    lathe(shape, from, Mat3::from_cols(v, along, u), &[[0.0, radius], [(to - from).length(), radius]], 6);
}

/// A wing: along z, its chord along x.
pub struct Wing {
    /// Its middle.
    pub at: Vec3,
    /// The directions of its x, y and z.
    pub axes: Mat3,
    /// From the middle to a tip.
    pub half_span: f32,
    /// From edge to edge.
    pub chord: f32,
    /// The greatest thickness.
    pub thickness: f32,
    /// How far the tips are above the middle.
    pub rise: f32,
}

impl Wing {
    /// The part between two positions along the span: the middle is 0, the tips are -1 and 1, and steps near the tips
    /// are short.
    pub fn cut(&self, shape: &mut Shape, from: f32, to: f32) {
        const RINGS: usize = 5;
        const AROUND: usize = 10;
        let place = |p: Vec3| self.at + self.axes * p;
        let middle = |t: f32| Vec3::new(0.0, self.rise * t.abs(), self.half_span * t);
        let along = |ring: usize| {
            let s = from + (to - from) * ring as f32 / (RINGS - 1) as f32;
            s * (1.5 - 0.5 * s * s)
        };
        let point = |ring: usize, k: usize| {
            let (t, (c, s)) = (along(ring), cos_sin(k as f32 / AROUND as f32));
            // The last ring at a tip is small, but not a point, so that no triangle is degenerate.
            let full = (1.0 - t * t * t * t * t * t).max(0.01).sqrt();
            let section = Vec3::new(c * self.chord, s * self.thickness * (0.7 + 0.3 * c), 0.0);
            place(middle(t) + section * (0.5 * full))
        };
        shape.tube(Some(place(middle(along(0)))), RINGS, AROUND, point, Some(place(middle(along(RINGS - 1)))));
    }
}
