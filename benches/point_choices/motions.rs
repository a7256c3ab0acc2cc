//! Kinds of motion of points that exist throughout the shutter.

use crate::kind::{Kind, group, thermal};
use mbkd::MovingPoint;
use mbkd::glam::Vec3;
use mbkd_evidence::lcg::Lcg;

pub const KINDS: [Kind; 43] = [
    Kind { name: "coherent", point: |r, _| by(r.vec(), |p| Vec3::new(p.y - 0.5, 0.5 - p.x, 0.3 * p.z) * 0.14) },
    Kind { name: "translation", point: |r, _| by(r.vec(), |_| Vec3::new(0.3, -0.2, 0.1)) },
    Kind { name: "explosion", point: |r, _| by(r.vec(), |p| p - 0.5) },
    Kind { name: "implosion", point: |r, _| by(r.vec(), |p| (0.5 - p) * 0.9) },
    Kind { name: "wave", point: |r, _| by(r.vec(), |p| Vec3::Y * (p.x * 12.0).sin() * 0.1) },
    Kind { name: "shear", point: |r, _| by(r.vec(), |p| Vec3::X * (p.z - 0.5)) },
    Kind { name: "fine shear", point: |r, _| by(r.vec(), |p| Vec3::X * (p.z * 40.0).sin() * 0.1) },
    Kind { name: "whirl", point: |r, _| by(r.vec(), |p| turned(p, 0.15 / (0.05 + (p - 0.5).length()))) },
    Kind { name: "vortices", point: |r, _| by(r.vec(), vortices) },
    Kind { name: "half a turn", point: |r, _| by(r.vec(), |p| Vec3::new(1.0 - 2.0 * p.x, 1.0 - 2.0 * p.y, 0.0)) },
    Kind { name: "points that meet in the middle", point: |r, _| by(r.vec(), |p| 1.0 - 2.0 * p) },
    Kind { name: "random 0.5x", point: |r, d| by(r.vec(), |_| r.signed() * 0.5 * d) },
    Kind { name: "random 1x", point: |r, d| by(r.vec(), |_| r.signed() * d) },
    Kind { name: "random 2x", point: |r, d| by(r.vec(), |_| r.signed() * 2.0 * d) },
    Kind { name: "random 5x", point: |r, d| by(r.vec(), |_| r.signed() * 5.0 * d) },
    Kind { name: "random 20x", point: |r, d| by(r.vec(), |_| r.signed() * 20.0 * d) },
    Kind { name: "random 30x", point: |r, d| by(r.vec(), |_| r.signed() * 30.0 * d) },
    Kind { name: "to any other place", point: |r, _| MovingPoint::new(r.vec(), r.vec()) },
    Kind { name: "two streams", point: |r, _| by(r.vec(), |_| Vec3::X * if r.unit() < 0.5 { 0.1 } else { -0.1 }) },
    Kind { name: "uneven streams", point: |r, _| by(r.vec(), |_| Vec3::X * if r.unit() < 0.2 { 0.2 } else { -0.05 }) },
    Kind { name: "eight streams", point: |r, _| by(r.vec(), |_| group(r, 8).1.signed() * 0.2) },
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
    Kind { name: "on surfaces, random 0.5x", point: |r, d| by(r.surface(), |_| r.signed() * 0.5 * d) },
    Kind { name: "swarm of 50 clusters", point: |r, _| cluster(r, 0.03, 0.15, 0.02) },
    Kind { name: "crossing clusters", point: |r, _| cluster(r, 0.15, 0.6, 0.0) },
    Kind { name: "a jet", point: |r, d| jet(r, d) },
    Kind { name: "speeds of all sizes", point: |r, d| by(r.vec(), |_| r.signed() * d * (r.unit() * 8.0 - 4.0).exp()) },
    Kind { name: "gas with a gradient", point: |r, d| by(r.vec().powf(2.0), |_| thermal(r) * 3.0 * d) },
    Kind { name: "gas, two temperatures", point: |r, d| by(r.vec(), |p| thermal(r) * d * temperature(p)) },
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

fn streams_in_a_half(random: &mut Lcg) -> MovingPoint {
    let way = if random.unit() < 0.5 { Vec3::Y } else { Vec3::Z };
    by(random.vec(), |place| if place.x < 0.5 { way * 0.15 } else { Vec3::ZERO })
}

/// A share of the points moves by 20 spacings.
fn some_fast(random: &mut Lcg, spacing: f32, share: f32, slow: f32) -> MovingPoint {
    let spacings = if random.unit() < share { 20.0 } else { slow };
    by(random.vec(), |_| random.signed() * spacings * spacing)
}

fn some_moving(random: &mut Lcg, share: f32, far: f32) -> MovingPoint {
    let far = if random.unit() < share { far } else { 0.0 };
    by(random.vec(), |_| random.signed() * far)
}

fn some_stream(random: &mut Lcg, share: f32) -> MovingPoint {
    let way = if random.unit() < share { 0.1 } else { 0.0 };
    by(random.vec(), |_| Vec3::X * way)
}

fn across(random: &mut Lcg, spacing: f32) -> MovingPoint {
    if random.unit() < 0.06 {
        return MovingPoint::new(random.vec(), random.vec());
    }
    by(random.vec(), |_| random.signed() * 0.1 * spacing)
}

fn cluster(random: &mut Lcg, size: f32, far: f32, random_motion: f32) -> MovingPoint {
    let (_, mut own) = group(random, 50);
    let (middle, way) = (own.vec(), own.signed() * far);
    by(middle + random.signed() * size, |_| way + random.signed() * random_motion)
}

fn jet(random: &mut Lcg, spacing: f32) -> MovingPoint {
    if random.unit() < 0.03 {
        let off = random.signed() * 0.05;
        return by(Vec3::new(random.unit() * 0.5, 0.5 + off.y, 0.5 + off.z), |_| Vec3::X * (0.4 + off.x));
    }
    by(random.vec(), |_| random.signed() * 0.2 * spacing)
}

/// Cold and hot regions.
fn temperature(place: Vec3) -> f32 {
    if place.x < 0.3 { 8.0 } else { 0.3 }
}

/// Water whose surface is in waves, and drops above it.
fn splash(random: &mut Lcg, spacing: f32) -> MovingPoint {
    let place = random.vec();
    if random.unit() < 0.9 {
        return by(place * Vec3::new(1.0, 1.0, 0.3), |p| Vec3::Z * (p.x * 9.0).sin() * 0.05 * p.z);
    }
    let drop = Vec3::new(0.3 + 0.4 * place.x, 0.3 + 0.4 * place.y, 0.3 + 0.5 * place.z);
    by(drop, |p| (p - Vec3::new(0.5, 0.5, 0.2)) * 0.8 * random.unit() + random.signed() * 3.0 * spacing)
}

fn planes(random: &mut Lcg) -> MovingPoint {
    let at = random.vec();
    let (place, way) = if random.unit() < 0.5 {
        (Vec3::new(at.x, at.y, 0.4 + 0.001 * at.z), Vec3::Z * 0.2)
    } else {
        (Vec3::new(at.x, at.y, 0.6 + 0.001 * at.z), Vec3::Z * -0.2)
    };
    by(place, |_| way)
}
