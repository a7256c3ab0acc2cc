//! Kinds of motion of points that exist throughout the shutter.

use crate::kind::{Kind, thermal};
use mbkd::MovingPoint;
use mbkd::glam::Vec3;
use mbkd_evidence::point_sets::on_surfaces;
use mbkd_scenes::Random;

pub const KINDS: [Kind; 43] = [
    Kind { name: "coherent", point: |r, _| by(r.in_cube(), |p| Vec3::new(p.y - 0.5, 0.5 - p.x, 0.3 * p.z) * 0.14) },
    Kind { name: "translation", point: |r, _| by(r.in_cube(), |_| Vec3::new(0.3, -0.2, 0.1)) },
    Kind { name: "explosion", point: |r, _| by(r.in_cube(), |p| p - 0.5) },
    Kind { name: "implosion", point: |r, _| by(r.in_cube(), |p| (0.5 - p) * 0.9) },
    Kind { name: "wave", point: |r, _| by(r.in_cube(), |p| Vec3::Y * (p.x * 12.0).sin() * 0.1) },
    Kind { name: "shear", point: |r, _| by(r.in_cube(), |p| Vec3::X * (p.z - 0.5)) },
    Kind { name: "fine shear", point: |r, _| by(r.in_cube(), |p| Vec3::X * (p.z * 40.0).sin() * 0.1) },
    Kind { name: "whirl", point: |r, _| by(r.in_cube(), |p| turned(p, 0.15 / (0.05 + (p - 0.5).length()))) },
    Kind { name: "vortices", point: |r, _| by(r.in_cube(), vortices) },
    Kind { name: "half a turn", point: |r, _| by(r.in_cube(), |p| Vec3::new(1.0 - 2.0 * p.x, 1.0 - 2.0 * p.y, 0.0)) },
    Kind { name: "points that meet in the middle", point: |r, _| by(r.in_cube(), |p| 1.0 - 2.0 * p) },
    Kind { name: "random 0.5x", point: |r, d| by(r.in_cube(), |_| r.vec() * 0.5 * d) },
    Kind { name: "random 1x", point: |r, d| by(r.in_cube(), |_| r.vec() * d) },
    Kind { name: "random 2x", point: |r, d| by(r.in_cube(), |_| r.vec() * 2.0 * d) },
    Kind { name: "random 5x", point: |r, d| by(r.in_cube(), |_| r.vec() * 5.0 * d) },
    Kind { name: "random 20x", point: |r, d| by(r.in_cube(), |_| r.vec() * 20.0 * d) },
    Kind { name: "random 30x", point: |r, d| by(r.in_cube(), |_| r.vec() * 30.0 * d) },
    Kind { name: "to any other place", point: |r, _| MovingPoint::new(r.in_cube(), r.in_cube()) },
    Kind { name: "two streams", point: |r, _| by(r.in_cube(), |_| Vec3::X * if r.unit() < 0.5 { 0.1 } else { -0.1 }) },
    Kind {
        name: "uneven streams",
        point: |r, _| by(r.in_cube(), |_| Vec3::X * if r.unit() < 0.2 { 0.2 } else { -0.05 }),
    },
    Kind { name: "eight streams", point: |r, _| by(r.in_cube(), |_| Random(r.below(8) as u64).vec() * 0.2) },
    Kind { name: "streams in a half", point: |r, _| streams_in_a_half(r) },
    Kind { name: "1% fast, rest slow", point: |r, d| some_fast(r, d, 0.01, 0.1) },
    Kind { name: "5% fast, rest slow", point: |r, d| some_fast(r, d, 0.05, 0.1) },
    Kind { name: "10% fast, rest slow", point: |r, d| some_fast(r, d, 0.1, 0.1) },
    Kind { name: "1% fast, rest static", point: |r, d| some_fast(r, d, 0.01, 0.0) },
    Kind { name: "5% fast, rest static", point: |r, d| some_fast(r, d, 0.05, 0.0) },
    Kind { name: "20% fast, rest static", point: |r, d| some_fast(r, d, 0.2, 0.0) },
    Kind { name: "40% fast, rest static", point: |r, d| some_moving(r, 0.4, 20.0 * d) },
    Kind { name: "40% by 1x, rest static", point: |r, d| some_moving(r, 0.4, d) },
    Kind { name: "20% by 1x, rest static", point: |r, d| some_moving(r, 0.2, d) },
    Kind { name: "5% by 1x, rest static", point: |r, d| some_moving(r, 0.05, d) },
    Kind { name: "40% stream, rest static", point: |r, _| some_stream(r, 0.4) },
    Kind { name: "6% across, rest slow", point: |r, d| across(r, d) },
    Kind { name: "on surfaces, random 0.5x", point: |r, d| by(on_surfaces(r), |_| r.vec() * 0.5 * d) },
    Kind { name: "swarm of 50 clusters", point: |r, _| cluster(r, 0.03, 0.15, 0.02) },
    Kind { name: "crossing clusters", point: |r, _| cluster(r, 0.15, 0.6, 0.0) },
    Kind { name: "a jet", point: |r, d| jet(r, d) },
    Kind { name: "speeds of all sizes", point: |r, d| by(r.in_cube(), |_| r.vec() * d * (r.unit() * 8.0 - 4.0).exp()) },
    Kind { name: "gas with a gradient", point: |r, d| by(r.in_cube().powf(2.0), |_| thermal(r) * 3.0 * d) },
    Kind { name: "gas, two temperatures", point: |r, d| by(r.in_cube(), |p| thermal(r) * d * temperature(p)) },
    Kind { name: "a splash", point: |r, d| splash(r, d) },
    Kind { name: "two planes that cross", point: |r, _| planes(r) },
];

/// A point at a place, and its displacement.
fn by(place: Vec3, displacement: impl FnOnce(Vec3) -> Vec3) -> MovingPoint {
    MovingPoint::new(place, place + displacement(place))
}

/// The displacement by a turn around the axis of the unit cube.
fn turned(place: Vec3, angle: f32) -> Vec3 {
    let (off, (sin, cos)) = (place - 0.5, angle.sin_cos());
    Vec3::new(off.x * cos - off.y * sin, off.x * sin + off.y * cos, off.z) - off
}

fn vortices(place: Vec3) -> Vec3 {
    let angle = place * 12.0;
    Vec3::new(angle.x.sin() * angle.y.cos(), -angle.x.cos() * angle.y.sin(), 0.0) * 0.1
}

fn streams_in_a_half(random: &mut Random) -> MovingPoint {
    let way = if random.unit() < 0.5 { Vec3::Y } else { Vec3::Z };
    by(random.in_cube(), |place| if place.x < 0.5 { way * 0.15 } else { Vec3::ZERO })
}

/// A share of the points moves by 20 spacings.
fn some_fast(random: &mut Random, spacing: f32, share: f32, slow: f32) -> MovingPoint {
    let spacings = if random.unit() < share { 20.0 } else { slow };
    by(random.in_cube(), |_| random.vec() * spacings * spacing)
}

fn some_moving(random: &mut Random, share: f32, far: f32) -> MovingPoint {
    let far = if random.unit() < share { far } else { 0.0 };
    by(random.in_cube(), |_| random.vec() * far)
}

fn some_stream(random: &mut Random, share: f32) -> MovingPoint {
    let way = if random.unit() < share { 0.1 } else { 0.0 };
    by(random.in_cube(), |_| Vec3::X * way)
}

fn across(random: &mut Random, spacing: f32) -> MovingPoint {
    if random.unit() < 0.06 {
        return MovingPoint::new(random.in_cube(), random.in_cube());
    }
    by(random.in_cube(), |_| random.vec() * 0.1 * spacing)
}

fn cluster(random: &mut Random, size: f32, far: f32, random_motion: f32) -> MovingPoint {
    let mut own = Random(random.below(50) as u64);
    let (middle, way) = (own.in_cube(), own.vec() * far);
    by(middle + random.vec() * size, |_| way + random.vec() * random_motion)
}

fn jet(random: &mut Random, spacing: f32) -> MovingPoint {
    if random.unit() < 0.03 {
        let off = random.vec() * 0.05;
        return by(Vec3::new(random.unit() * 0.5, 0.5 + off.y, 0.5 + off.z), |_| Vec3::X * (0.4 + off.x));
    }
    by(random.in_cube(), |_| random.vec() * 0.2 * spacing)
}

/// Cold and hot regions.
fn temperature(place: Vec3) -> f32 {
    if place.x < 0.3 { 8.0 } else { 0.3 }
}

/// Water whose surface is in waves, and drops above it.
fn splash(random: &mut Random, spacing: f32) -> MovingPoint {
    let place = random.in_cube();
    if random.unit() < 0.9 {
        return by(place * Vec3::new(1.0, 1.0, 0.3), |p| Vec3::Z * (p.x * 9.0).sin() * 0.05 * p.z);
    }
    let drop = Vec3::new(0.3 + 0.4 * place.x, 0.3 + 0.4 * place.y, 0.3 + 0.5 * place.z);
    by(drop, |p| (p - Vec3::new(0.5, 0.5, 0.2)) * 0.8 * random.unit() + random.vec() * 3.0 * spacing)
}

fn planes(random: &mut Random) -> MovingPoint {
    let at = random.in_cube();
    let (place, way) = if random.unit() < 0.5 {
        (Vec3::new(at.x, at.y, 0.4 + 0.001 * at.z), Vec3::Z * 0.2)
    } else {
        (Vec3::new(at.x, at.y, 0.6 + 0.001 * at.z), Vec3::Z * -0.2)
    };
    by(place, |_| way)
}
