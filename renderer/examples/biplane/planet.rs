//! A small planet below the plane, and clouds behind it.
//!
//! Both consist of equal sectors and rotate by one sector during the clip, so that it loops.

use super::glb::{Parts, Writer, of};
use super::paint::Paint;
use super::solids::{ALONG_Z, ball, lathe, rod, turned};
use mbkd::glam::{Mat3, Vec3};
use mbkd_renderer::sampling::cos_sin;
use mbkd_scenes::Shape;

/// Sectors of the planet.
pub const SECTORS: usize = 8;
/// Radius of the planet.
pub const RADIUS: f32 = 5.0;
/// Middle of the planet; the plane flies above it.
pub const CENTRE: Vec3 = Vec3::new(-0.6, -6.35, 0.0);

/// Fields per sector, with alternating colours.
const FIELDS: usize = 4;
/// Edges of the strips of the ground, in degrees towards the viewer; the one in the middle is the road.
const STRIPS: [f32; 14] = [-78.0, -58.0, -40.0, -26.0, -17.0, -9.0, -1.2, 1.2, 9.0, 17.0, 26.0, 40.0, 58.0, 78.0];

const CLOUDS: usize = 12;

/// Adds the planet and the clouds.
pub fn add(file: &mut Writer) {
    let planet = file.node("planet", None, CENTRE);
    // About z: below the plane, the ground moves backward.
    file.spin(&[planet], Vec3::Z, 2, |time| time / SECTORS as f32);
    let (land, sails) = (file.mesh("land", land()), file.mesh("sails", sails()));
    let mut wheels = Vec::new();
    for sector in 0..SECTORS {
        let node = file.node(&format!("sector {sector}"), Some(planet), Vec3::ZERO);
        file.turn(node, Vec3::Z, sector as f32 / SECTORS as f32);
        file.show(node, land, None);
        let mill = Spot::at(MILL);
        let wheel = file.node(&format!("sails {sector}"), Some(node), mill.point(0.0, 0.78, 0.24));
        file.show(wheel, sails, None);
        wheels.push(wheel);
    }
    // A quarter turn takes each sail to the position of another.
    file.spin(&wheels, Vec3::Z, 9, |time| -1.25 * time);

    let sky = file.node("clouds", None, CENTRE);
    file.spin(&[sky], Vec3::Z, 2, |time| time / CLOUDS as f32);
    let cloud = file.mesh("cloud", cloud());
    for k in 0..CLOUDS {
        let node = file.node(&format!("cloud {k}"), Some(sky), Vec3::ZERO);
        file.turn(node, Vec3::Z, k as f32 / CLOUDS as f32);
        file.show(node, cloud, None);
    }
}

/// A position on the planet, in degrees ahead of the middle of a sector and towards the viewer.
type Degrees = (f32, f32);

const MILL: Degrees = (7.0, -14.0);

/// A position, and the directions ahead, up and sideways there.
struct Spot {
    at: Vec3,
    axes: Mat3,
}

impl Spot {
    fn at((ahead, side): Degrees) -> Spot {
        let ((ca, sa), (cb, sb)) = (cos_sin(ahead / 360.0), cos_sin(side / 360.0));
        let up = Vec3::new(sa * cb, ca * cb, sb);
        let forward = Vec3::new(ca, -sa, 0.0);
        Spot { at: up * RADIUS, axes: Mat3::from_cols(forward, up, forward.cross(up)) }
    }

    fn point(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.at + self.axes * Vec3::new(x, y, z)
    }

    /// A solid of revolution that stands here.
    fn lathe(&self, shape: &mut Shape, profile: &[[f32; 2]], around: usize) {
        lathe(shape, self.at, self.axes, profile, around);
    }
}

/// The contents of one sector.
fn land() -> Parts {
    let mut parts = Parts::new();
    let p = &mut parts;
    let half = 180.0 / SECTORS as f32;
    // Fields in stripes, and a road with gaps along the middle.
    for ahead in 0..2 * FIELDS {
        let edge = |k: usize| half * (k as f32 / FIELDS as f32 - 1.0);
        for (k, side) in STRIPS.windows(2).enumerate() {
            let is_road = 2 * (k + 1) == STRIPS.len() && ahead % 2 == 0;
            let field = if ahead / 2 % 2 == 0 { Paint::Grass } else { Paint::Meadow };
            let shape = of(p, if is_road { Paint::Road } else { field });
            let corner = |ahead: usize, side: f32| Spot::at((edge(ahead), side)).at;
            let [a, b, c, d] = [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(i, k)| corner(ahead + i, side[k]));
            shape.triangle([a, b, c]);
            shape.triangle([a, c, d]);
        }
    }

    // The mill.
    let mill = Spot::at(MILL);
    mill.lathe(of(p, Paint::Plaster), &[[0.0, 0.25], [0.66, 0.15]], 10);
    mill.lathe(of(p, Paint::Roof), &[[0.66, 0.2], [0.72, 0.19], [0.92, 0.02]], 10);
    rod(of(p, Paint::Wood), mill.point(0.0, 0.78, 0.0), mill.point(0.0, 0.78, 0.26), 0.03);
    window(p, &mill, Vec3::new(0.0, 0.32, 0.2));

    // Cottages.
    for (place, turn) in [((-9.0, -19.0), 0.03), ((-14.0, -10.5), 0.09), ((17.5, -9.0), 0.13)] {
        let spot = Spot::at(place);
        let spot = Spot { axes: turned(spot.axes, turn), ..spot };
        let walls =
            |x: f32, y: f32, z: f32| Mat3::from_cols(spot.axes.x_axis * x, spot.axes.y_axis * y, spot.axes.z_axis * z);
        of(p, Paint::Plaster).cuboid(spot.point(0.0, 0.1, 0.0), walls(0.22, 0.12, 0.15));
        roof(of(p, Paint::Roof), &spot);
        of(p, Paint::Roof).cuboid(spot.point(0.12, 0.36, -0.03), walls(0.03, 0.1, 0.03));
        for x in [-0.11, 0.09] {
            window(p, &spot, Vec3::new(x, 0.12, 0.152));
        }
    }

    // Trees, and bushes nearer than the road.
    for (ahead, side, size) in
        [(-19.0, -15.0, 0.36), (-5.0, -11.0, 0.3), (-3.0, -22.0, 0.42), (12.5, -20.0, 0.4), (21.0, -17.0, 0.34)]
    {
        let spot = Spot::at((ahead, side));
        spot.lathe(of(p, Paint::Wood), &[[-0.05, 0.12 * size], [0.7 * size, 0.1 * size]], 6);
        let crown = Mat3::from_diagonal(Vec3::splat(0.5 * size));
        ball(of(p, Paint::Leaf), spot.point(0.0, 1.0 * size, 0.0), crown, 5);
        ball(of(p, Paint::Leaf), spot.point(0.28 * size, 0.8 * size, 0.1), crown * 0.7, 4);
    }
    for (ahead, side, size) in [
        (-21.5, -8.0, 0.4),
        (1.0, -8.0, 0.44),
        (2.5, -10.0, 0.34),
        (14.5, -13.0, 0.5),
        (-16.0, 9.0, 0.3),
        (9.0, 8.0, 0.36),
        (11.0, 10.5, 0.28),
    ] {
        let profile = [[-0.05, 0.07], [0.25, 0.42], [0.62, 0.16], [0.6, 0.33], [0.98, 0.09], [0.95, 0.24], [1.4, 0.01]];
        Spot::at((ahead, side)).lathe(of(p, Paint::Fir), &profile.map(|[y, r]| [y * size, r * size]), 6);
    }
    for (ahead, side, size) in
        [(-8.0, 7.5, 0.12), (-6.4, 9.0, 0.09), (3.0, 12.0, 0.13), (18.0, 7.0, 0.11), (20.0, 10.0, 0.14)]
    {
        ball(
            of(p, Paint::Leaf),
            Spot::at((ahead, side)).point(0.0, 0.3 * size, 0.0),
            Mat3::from_diagonal(Vec3::splat(size)),
            4,
        );
    }
    parts
}

/// A lit window.
fn window(parts: &mut Parts, spot: &Spot, at: Vec3) {
    let half = Mat3::from_cols(spot.axes.x_axis * 0.035, spot.axes.y_axis * 0.045, spot.axes.z_axis * 0.012);
    of(parts, Paint::Window).cuboid(spot.point(at.x, at.y, at.z), half);
}

/// A roof with a ridge.
fn roof(shape: &mut Shape, spot: &Spot) {
    let (x, z, low, high) = (0.26, 0.2, 0.2, 0.42);
    let [a, b, c, d] = [(-x, z), (x, z), (x, -z), (-x, -z)].map(|(x, z)| spot.point(x, low, z));
    let [left, right] = [-x, x].map(|x| spot.point(0.85 * x, high, 0.0));
    for corners in [
        [a, b, right],
        [a, right, left],
        [c, d, left],
        [c, left, right],
        [b, c, right],
        [d, a, left],
        [a, d, c],
        [a, c, b],
    ] {
        shape.triangle(corners);
    }
}

/// Four sails of a mill, about z.
fn sails() -> Parts {
    let mut parts = Parts::new();
    for k in 0..4 {
        let (c, s) = cos_sin(k as f32 / 4.0 + 0.06);
        let (out, across) = (Vec3::new(c, s, 0.0), Vec3::new(-s, c, 0.0));
        rod(of(&mut parts, Paint::Wood), Vec3::ZERO, out * 0.52, 0.018);
        let half = Mat3::from_cols(out * 0.19, across * 0.055, Vec3::Z * 0.006);
        of(&mut parts, Paint::Cream).cuboid(out * 0.31 + across * 0.06, half);
    }
    lathe(of(&mut parts, Paint::Wood), Vec3::ZERO, ALONG_Z, &[[-0.03, 0.05], [0.04, 0.04]], 8);
    parts
}

/// A cloud above the planet and behind the plane.
fn cloud() -> Parts {
    let mut parts = Parts::new();
    for (x, y, z, size) in [
        (0.0, 0.0, 0.0, 0.42),
        (0.45, -0.08, 0.1, 0.3),
        (-0.42, -0.1, 0.05, 0.32),
        (0.18, 0.2, -0.1, 0.3),
        (0.8, -0.16, 0.0, 0.2),
    ] {
        let at = Vec3::new(x, RADIUS + 1.75 + y, z - 2.6);
        ball(of(&mut parts, Paint::Cloud), at, Mat3::from_diagonal(Vec3::new(size, 0.75 * size, size)), 6);
    }
    parts
}
