//! Kinds of sets whose points exist for a part of the shutter.

use crate::kind::{Kind, life};
use mbkd::MovingPoint;
use mbkd::glam::Vec3;
use mbkd_scenes::Random;

pub const KINDS: [Kind; 26] = [
    Kind { name: "births", point: |r, _| at_rest(r).with_active(life(r.unit(), 1.0)) },
    Kind { name: "deaths", point: |r, _| at_rest(r).with_active(life(0.0, r.unit())) },
    Kind { name: "lives of .01", point: |r, _| at_rest(r).with_active(life(0.99 * r.unit(), 0.01)) },
    Kind { name: "lives of .1", point: |r, _| at_rest(r).with_active(life(0.9 * r.unit(), 0.1)) },
    Kind { name: "lives of .3", point: |r, _| at_rest(r).with_active(life(1.3 * r.unit() - 0.3, 0.3)) },
    Kind { name: "lives of all lengths", point: |r, _| at_rest(r).with_active(life(r.unit(), r.unit())) },
    Kind { name: "halves", point: |r, _| at_rest(r).with_active(life(0.5 * (2.0 * r.unit()).floor(), 0.5)) },
    Kind { name: "births, random 2x", point: |r, d| random(r, 2.0 * d).with_active(life(r.unit(), 1.0)) },
    Kind { name: "births, 1% fast", point: |r, d| some_fast(r, d, 0.01).with_active(life(r.unit(), 1.0)) },
    Kind { name: "lives of .1, 3% fast", point: |r, d| some_fast(r, d, 0.03).with_active(life(0.9 * r.unit(), 0.1)) },
    Kind { name: "lives of .1, random 5x", point: |r, d| random(r, 5.0 * d).with_active(life(0.9 * r.unit(), 0.1)) },
    Kind { name: "lives of .1, random 50x", point: |r, d| random(r, 50.0 * d).with_active(life(0.9 * r.unit(), 0.1)) },
    Kind { name: "lives of .9, 1% fast", point: |r, d| some_fast(r, d, 0.01).with_active(life(0.1 * r.unit(), 0.9)) },
    Kind { name: "lives of .9, random 5x", point: |r, d| random(r, 5.0 * d).with_active(life(0.1 * r.unit(), 0.9)) },
    Kind { name: "static and fast", point: |r, d| static_and_fast(r, d) },
    Kind { name: "emitter", point: |r, _| from_place(r, 1.0, Vec3::ZERO) },
    Kind { name: "fountain", point: |r, _| from_place(r, 0.3, Vec3::Z * 2.0) },
    Kind { name: "burst", point: |r, _| burst(r) },
    Kind { name: "clusters in turn", point: |r, _| clusters_in_turn(r) },
    Kind { name: "two streams, lives of .3", point: |r, _| streams(r).with_active(life(1.3 * r.unit() - 0.3, 0.3)) },
    Kind { name: "rain", point: |r, _| rain(r) },
    Kind { name: "coherent, lives of .1", point: |r, _| coherent(r).with_active(life(0.9 * r.unit(), 0.1)) },
    Kind { name: "all in the first fifth", point: |r, _| at_rest(r).with_active(life(0.19 * r.unit(), 0.01)) },
    Kind {
        name: "births in the last third",
        point: |r, d| random(r, 2.0 * d).with_active(life(0.67 + 0.3 * r.unit(), 1.0)),
    },
    Kind {
        name: "two short periods",
        point: |r, _| at_rest(r).with_active(life(0.2 + 0.5 * (2.0 * r.unit()).floor(), 0.1)),
    },
    Kind { name: "a wave of lives", point: |r, _| wave(r) },
];

fn at_rest(random: &mut Random) -> MovingPoint {
    let place = random.in_cube();
    MovingPoint::new(place, place)
}

fn random(random: &mut Random, far: f32) -> MovingPoint {
    let place = random.in_cube();
    MovingPoint::new(place, place + random.vec() * far)
}

/// A share of the points moves by 20 spacings, the others by a tenth of one.
fn some_fast(random: &mut Random, spacing: f32, share: f32) -> MovingPoint {
    let spacings = if random.unit() < share { 20.0 } else { 0.1 };
    self::random(random, spacings * spacing)
}

fn static_and_fast(random: &mut Random, spacing: f32) -> MovingPoint {
    if random.unit() < 0.5 {
        return at_rest(random).with_active(life(random.unit(), 1.0));
    }
    self::random(random, 20.0 * spacing).with_active(life(random.unit(), 0.2))
}

/// From a place at the beginning of a life, in any direction about a given one.
fn from_place(random: &mut Random, duration: f32, way: Vec3) -> MovingPoint {
    let (birth, velocity) = (random.unit() * 0.99, way + random.direction() * random.unit());
    let begin = Vec3::splat(0.5) - velocity * birth;
    MovingPoint::new(begin, begin + velocity).with_active(life(birth, duration))
}

/// All points fly apart from a place, soon one after the other.
fn burst(random: &mut Random) -> MovingPoint {
    let (birth, velocity) = (0.3 + 0.05 * random.unit(), random.direction() * random.unit());
    let begin = random.in_cube() * 0.01 - velocity * birth;
    MovingPoint::new(begin, begin + velocity).with_active(life(birth, 1.0))
}

fn clusters_in_turn(random: &mut Random) -> MovingPoint {
    let number = random.below(20);
    let mut own = Random(number as u64);
    let (place, way) = (own.in_cube() + random.vec() * 0.05, own.vec() * 0.1);
    MovingPoint::new(place, place + way).with_active(life(number as f32 / 20.0, 0.05))
}

fn streams(random: &mut Random) -> MovingPoint {
    let (place, way) = (random.in_cube(), if random.unit() < 0.5 { 0.2 } else { -0.2 });
    MovingPoint::new(place, place + Vec3::X * way)
}

fn rain(random: &mut Random) -> MovingPoint {
    let (birth, speed) = (random.unit() * 1.2 - 0.2, 4.0 + random.unit());
    let top = Vec3::new(random.unit(), random.unit(), 1.0);
    let begin = top + Vec3::Z * speed * birth;
    MovingPoint::new(begin, begin - Vec3::Z * speed).with_active(life(birth, (birth + 0.2).min(0.2)))
}

fn coherent(random: &mut Random) -> MovingPoint {
    let place = random.in_cube();
    MovingPoint::new(place, place + Vec3::new(place.y - 0.5, 0.5 - place.x, 0.3 * place.z))
}

/// Lives that begin at each place when a front passes it.
fn wave(random: &mut Random) -> MovingPoint {
    let place = random.in_cube();
    MovingPoint::new(place, place).with_active(life(0.9 * place.x, 0.1))
}
