//! The plane, its pilot, its propeller, and the banner that it tows.

use super::cloth::Cloth;
use super::glb::{Parts, Writer, of};
use super::paint::Paint;
use super::solids::{ALONG_X, ALONG_Z, Wing, ball, lathe, rod};
use gltf::json::{Index, Node};
use mbkd::glam::{Mat3, Vec3};
use mbkd_renderer::sampling::cos_sin;

/// Turns of the propeller during the clip.
pub const TURNS: f32 = 10.0;
/// The position of the propeller's hub.
pub const HUB: Vec3 = Vec3::new(0.86, 0.0, 0.0);
/// From the hub to the tip of a blade.
pub const BLADE: f32 = 0.62;

/// The text of the banner.
const BANNER: [&str; 11] = [
    ".............................",
    ".............................",
    ".........#......#.........#..",
    ".........#......#.........#..",
    "..####...####...#..#...####..",
    "..#.#.#..#...#..#.#...#...#..",
    "..#.#.#..#...#..##....#...#..",
    "..#.#.#..#...#..#.#...#...#..",
    "..#.#.#..####...#..#...####..",
    ".............................",
    ".............................",
];

/// Adds the plane, on nodes that sway.
pub fn add(file: &mut Writer) {
    let place = file.node("plane", None, Vec3::ZERO);
    let wave = |waves: f32| move |time: f32| cos_sin(waves * time).1;
    file.shift(place, 33, |time| Vec3::new(0.05 * wave(1.0)(time), 0.07 * wave(2.0)(time), 0.0));
    let rolls = file.node("rolls", Some(place), Vec3::ZERO);
    file.spin(&[rolls], Vec3::X, 33, |time| 0.018 * wave(1.0)(time));
    let plane = file.node("pitches", Some(rolls), Vec3::ZERO);
    file.spin(&[plane], Vec3::Z, 33, |time| 0.008 * wave(2.0)(time));

    let body = file.mesh("body", body());
    file.show(plane, body, None);

    let propeller = file.node("propeller", Some(plane), HUB);
    let blades = file.mesh("propeller", blades());
    file.show(propeller, blades, None);
    // A quarter turn from key to key: between two rotations the shorter arc is interpolated.
    file.spin(&[propeller], Vec3::X, 4 * TURNS as usize + 1, |time| TURNS * time);

    pilot(file, plane);
    banner(file, plane);
}

/// All rigidly connected parts.
fn body() -> Parts {
    let mut parts = Parts::new();
    hull(&mut parts);
    wings(&mut parts);
    tail(&mut parts);
    wheels(&mut parts);
    // The cockpit.
    let rim = Mat3::from_diagonal(Vec3::new(0.27, 0.08, 0.2));
    ball(of(&mut parts, Paint::Leather), Vec3::new(-0.33, 0.25, 0.0), rim, 7);
    let shield = Mat3::from_cols(Vec3::new(-0.06, 0.11, 0.0), Vec3::new(0.008, 0.004, 0.0), Vec3::Z * 0.13);
    of(&mut parts, Paint::Glass).cuboid(Vec3::new(-0.05, 0.4, 0.0), shield);
    parts
}

/// The fuselage, and the engine under its cowling.
fn hull(p: &mut Parts) {
    let x = |x: f32| Vec3::X * x;
    let fuselage = [
        [-1.22, 0.03],
        [-1.2, 0.06],
        [-1.0, 0.12],
        [-0.7, 0.2],
        [-0.4, 0.27],
        [-0.1, 0.32],
        [0.2, 0.345],
        [0.46, 0.35],
    ];
    lathe(of(p, Paint::Red), Vec3::ZERO, ALONG_X, &fuselage, 20);
    let cowling = [
        [0.42, 0.3],
        [0.42, 0.365],
        [0.5, 0.375],
        [0.64, 0.37],
        [0.72, 0.35],
        [0.76, 0.31],
        [0.74, 0.26],
        [0.66, 0.25],
    ];
    lathe(of(p, Paint::Steel), Vec3::ZERO, ALONG_X, &cowling, 20);
    lathe(of(p, Paint::Rubber), x(0.64), ALONG_X, &[[0.0, 0.26], [0.03, 0.26]], 16);
    lathe(of(p, Paint::Brass), x(0.64), ALONG_X, &[[0.0, 0.1], [0.08, 0.1], [0.14, 0.05], [0.24, 0.03]], 12);
    for cylinder in 0..7 {
        let (c, s) = cos_sin(cylinder as f32 / 7.0);
        rod(of(p, Paint::Brass), x(0.7), Vec3::new(0.7, 0.22 * c, 0.22 * s), 0.045);
    }
}

/// The upper of the two wings.
const UPPER: Wing = Wing {
    at: Vec3::new(0.26, 0.66, 0.0),
    axes: Mat3::IDENTITY,
    half_span: 1.3,
    chord: 0.6,
    thickness: 0.07,
    rise: 0.05,
};

/// Two wings with painted tips, struts between them, and lamps at the lower tips.
fn wings(p: &mut Parts) {
    let lower = Wing { at: Vec3::new(0.12, -0.2, 0.0), half_span: 1.15, chord: 0.55, rise: 0.1, ..UPPER };
    for wing in [UPPER, lower] {
        wing.cut(of(p, Paint::Cream), -0.6, 0.6);
        wing.cut(of(p, Paint::Red), -1.0, -0.6);
        wing.cut(of(p, Paint::Red), 0.6, 1.0);
    }
    for side in [-1.0, 1.0] {
        for shift in [-0.15, 0.15] {
            let foot = Vec3::new(0.12 + shift, -0.12, 0.86 * side);
            rod(of(p, Paint::Wood), foot, Vec3::new(0.26 + shift, 0.7, 0.9 * side), 0.02);
            rod(
                of(p, Paint::Wood),
                Vec3::new(0.24 + shift, 0.25, 0.16 * side),
                Vec3::new(0.26 + shift, 0.66, 0.3 * side),
                0.018,
            );
        }
        let lamp = if side > 0.0 { Paint::StarboardLamp } else { Paint::PortLamp };
        ball(of(p, lamp), Vec3::new(0.14, -0.1, 1.17 * side), Mat3::from_diagonal(Vec3::splat(0.04)), 4);
    }
}

/// The tail: a small wing and a fin.
fn tail(p: &mut Parts) {
    let tail =
        Wing { at: Vec3::new(-1.05, 0.06, 0.0), half_span: 0.52, chord: 0.34, thickness: 0.04, rise: 0.0, ..UPPER };
    tail.cut(of(p, Paint::Cream), -1.0, 1.0);
    let upright = Mat3::from_cols(Vec3::X, Vec3::NEG_Z, Vec3::Y);
    let fin = Wing {
        at: Vec3::new(-1.1, 0.1, 0.0),
        axes: upright,
        half_span: 0.45,
        chord: 0.38,
        thickness: 0.045,
        rise: 0.0,
    };
    fin.cut(of(p, Paint::Red), 0.0, 1.0);
}

/// Wheels on legs, with an axle.
fn wheels(p: &mut Parts) {
    for side in [-1.0, 1.0] {
        let hub = Vec3::new(0.3, -0.66, 0.36 * side);
        let tyre = [[-0.05, 0.11], [-0.045, 0.16], [0.0, 0.185], [0.045, 0.16], [0.05, 0.11]];
        lathe(of(p, Paint::Rubber), hub, ALONG_Z, &tyre, 18);
        lathe(of(p, Paint::Cream), hub, ALONG_Z, &[[-0.065, 0.03], [-0.058, 0.11], [0.058, 0.11], [0.065, 0.03]], 16);
        for foot in [0.1, 0.42] {
            rod(of(p, Paint::Steel), hub, Vec3::new(foot, -0.22, 0.2 * side), 0.022);
        }
    }
    rod(of(p, Paint::Steel), Vec3::new(0.3, -0.66, -0.36), Vec3::new(0.3, -0.66, 0.36), 0.022);
}

/// Three blades with bright tips, and the spinner. The first points up.
fn blades() -> Parts {
    let mut parts = Parts::new();
    for blade in 0..3 {
        let (c, s) = cos_sin(blade as f32 / 3.0);
        let (out, across) = (Vec3::new(0.0, c, s), Vec3::new(0.0, -s, c));
        // The chord is inclined to the disk, as in a screw.
        let axes = Mat3::from_cols(Vec3::X * 0.5 + across * 0.866, Vec3::X * 0.866 - across * 0.5, out);
        let blade = Wing { at: Vec3::ZERO, axes, half_span: BLADE, chord: 0.17, thickness: 0.04, rise: 0.0 };
        blade.cut(of(&mut parts, Paint::Wood), 0.0, 0.53);
        blade.cut(of(&mut parts, Paint::Cream), 0.53, 1.0);
    }
    let spinner = [[-0.03, 0.09], [0.02, 0.09], [0.08, 0.06], [0.11, 0.02]];
    lathe(of(&mut parts, Paint::Brass), Vec3::ZERO, ALONG_X, &spinner, 12);
    parts
}

/// A chick that looks around, in a scarf.
fn pilot(file: &mut Writer, plane: Index<Node>) {
    let mut parts = Parts::new();
    let p = &mut parts;
    let round = |radius: f32| Mat3::from_diagonal(Vec3::splat(radius));
    ball(of(p, Paint::Feather), Vec3::ZERO, round(0.24), 9);
    let beak = [[0.2, 0.085], [0.3, 0.045], [0.36, 0.01]];
    lathe(of(p, Paint::Beak), Vec3::Y * -0.03, ALONG_X, &beak, 10);
    // A cap over the back of the head, with goggles on its front.
    let back = Vec3::new(-0.55, 0.835, 0.0);
    let cap = Mat3::from_cols(back.cross(Vec3::Z), back, Vec3::Z);
    let dome: Vec<[f32; 2]> = (0..=4)
        .map(|ring| {
            let (c, s) = cos_sin(0.25 * ring as f32 / 4.2);
            [0.262 * s, 0.262 * c]
        })
        .collect();
    lathe(of(p, Paint::Leather), Vec3::ZERO, cap, &dome, 16);
    for side in [-1.0, 1.0] {
        ball(of(p, Paint::Glass), Vec3::new(0.2, 0.05, 0.115 * side), round(0.036), 4);
        let out = Vec3::new(0.72, 0.6, 0.35 * side).normalize();
        let goggle = Mat3::from_cols(Vec3::new(0.64, -0.768, 0.0), out, Vec3::new(0.64, -0.768, 0.0).cross(out));
        lathe(of(p, Paint::Brass), out * 0.235, goggle, &[[0.0, 0.075], [0.045, 0.075]], 12);
        lathe(of(p, Paint::Glass), out * 0.24, goggle, &[[0.0, 0.06], [0.05, 0.058], [0.055, 0.03]], 12);
        ball(
            of(p, Paint::Leather),
            Vec3::new(-0.04, -0.02, 0.235 * side),
            Mat3::from_diagonal(Vec3::new(0.07, 0.085, 0.03)),
            4,
        );
    }
    let neck = file.node("neck", Some(plane), Vec3::new(-0.33, 0.33, 0.0));
    let head = file.node("head", Some(neck), Vec3::Y * 0.21);
    file.spin(&[head], Vec3::Y, 33, |time| -0.07 - 0.05 * cos_sin(time).1);
    let mesh = file.mesh("head", parts);
    file.show(head, mesh, None);

    let mut collar = Parts::new();
    lathe(
        of(&mut collar, Paint::Silk),
        Vec3::ZERO,
        Mat3::IDENTITY,
        &[[-0.06, 0.13], [-0.03, 0.19], [0.03, 0.19], [0.06, 0.14]],
        16,
    );
    let mesh = file.mesh("collar", collar);
    file.show(neck, mesh, None);
    let knot = file.node("knot", Some(neck), Vec3::new(-0.17, 0.0, 0.04));
    let scarf = Cloth {
        pattern: &["............"; 2],
        cell: 0.065,
        paints: [Paint::Silk; 2],
        joints: 6,
        waves: 4.0,
        swing: 0.09,
    };
    scarf.hang(file, "scarf", knot);
}

/// A banner on a pole, towed by two lines.
fn banner(file: &mut Writer, plane: Index<Node>) {
    let pole = Vec3::new(-1.75, -0.02, 0.0);
    let half = Vec3::Y * 0.47;
    let mut parts = Parts::new();
    for end in [half, -half] {
        rod(of(&mut parts, Paint::Wood), Vec3::X * -1.2, pole + end, 0.01);
    }
    rod(of(&mut parts, Paint::Wood), pole - half, pole + half, 0.022);
    let lines = file.node("lines", Some(plane), Vec3::ZERO);
    let mesh = file.mesh("lines", parts);
    file.show(lines, mesh, None);
    let hoist = file.node("hoist", Some(plane), pole);
    let cloth =
        Cloth { pattern: &BANNER, cell: 0.08, paints: [Paint::Cream, Paint::Red], joints: 9, waves: 3.0, swing: 0.055 };
    cloth.hang(file, "banner", hoist);
}
