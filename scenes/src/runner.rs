//! A running figure of limbs and joints, at any moment of its stride.
//!
//! Two bones a leg, two an arm, a trunk and a head; joint angles are sines of the stride's phase, roughly as
//! textbooks plot them for a jog. Feet touch the ground at y = 0, and the figure runs along +z.

use super::shape::Shape;
use super::turn::{cos_sin, rotation};
use glam::{Mat3, Vec3};

/// The part of the figure that a mesh holds, with its own material.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Part {
    /// Head, arms below the elbow and legs.
    Skin,
    /// Trunk, upper arms and thighs.
    Clothes,
}

/// The figure at a phase of its stride (one is two steps), 1.8 units tall, with limbs of `around` points around.
pub(super) fn runner(part: Part, phase: f32, around: usize) -> Shape {
    let mut shape = Shape::default();
    let mut limb = |of: Part, a: Vec3, b: Vec3, radii: (f32, f32), wide: f32| {
        if of == part {
            limb(&mut shape, a, b, radii, wide, around);
        }
    };
    let hip = Vec3::new(0.0, 0.93 + 0.035 * cos_sin(2.0 * phase + 0.1).0, 0.0);
    let lean = rotation(Vec3::X, 0.028);
    let twist = rotation(Vec3::Y, 0.025 * cos_sin(phase).1);
    let up = |x: f32, y: f32, z: f32| hip + lean * (twist * Vec3::new(x, y, z));
    limb(Part::Clothes, up(0.0, 0.02, 0.0), up(0.0, 0.36, 0.01), (0.115, 0.135), 1.3);
    limb(Part::Clothes, up(-0.14, 0.46, 0.0), up(0.14, 0.46, 0.0), (0.085, 0.085), 1.0);
    limb(Part::Skin, up(0.0, 0.48, 0.0), up(0.0, 0.60, 0.02), (0.052, 0.052), 1.0);
    limb(Part::Skin, up(0.0, 0.67, 0.035), up(0.0, 0.73, 0.03), (0.088, 0.1), 0.9);
    for (side, phase) in [(-1.0, phase), (1.0, phase + 0.5)] {
        leg(&mut limb, hip + Vec3::new(0.095 * side, -0.02, 0.0), phase);
        arm(&mut limb, up(0.2 * side, 0.46, 0.0), side, phase + 0.5);
    }
    shape
}

type Limb<'a> = dyn FnMut(Part, Vec3, Vec3, (f32, f32), f32) + 'a;

/// Straight down at angle 0, forward at a positive one, in turns.
fn hanging(angle: f32) -> Vec3 {
    let (c, s) = cos_sin(angle);
    Vec3::new(0.0, -c, s)
}

fn leg(limb: &mut Limb, hip: Vec3, phase: f32) {
    let thigh = 0.045 + 0.125 * cos_sin(phase).1;
    let fold = 0.05 + 0.2 * (0.5 + 0.5 * cos_sin(phase - 0.04).0);
    let point = 0.02 + 0.06 * (0.5 - 0.5 * cos_sin(phase + 0.2).1);
    let knee = hip + hanging(thigh) * 0.43;
    let ankle = knee + hanging(thigh - fold) * 0.42;
    let toes = ankle + hanging(thigh - fold + 0.25 - point) * 0.17;
    limb(Part::Clothes, hip, hip + (knee - hip) * 0.7, (0.098, 0.082), 1.0);
    limb(Part::Skin, hip + (knee - hip) * 0.5, knee, (0.07, 0.058), 1.0);
    limb(Part::Skin, knee, ankle, (0.062, 0.038), 1.0);
    limb(Part::Clothes, ankle - (toes - ankle) * 0.25, toes, (0.045, 0.035), 1.1);
}

fn arm(limb: &mut Limb, shoulder: Vec3, side: f32, phase: f32) {
    let upper = -0.035 + 0.11 * cos_sin(phase).1;
    let fold = 0.23 + 0.04 * cos_sin(phase).1;
    let outward = rotation(Vec3::Z, 0.035 * side);
    let elbow = shoulder + outward * hanging(upper) * 0.28;
    let inward = rotation(Vec3::Y, -0.05 * side);
    let hand = elbow + inward * hanging(upper + fold) * 0.25;
    limb(Part::Clothes, shoulder, shoulder + (elbow - shoulder) * 0.45, (0.06, 0.055), 1.0);
    limb(Part::Skin, shoulder, elbow, (0.05, 0.042), 1.0);
    limb(Part::Skin, elbow, hand, (0.044, 0.032), 1.0);
    limb(Part::Skin, hand, hand + (hand - elbow) * 0.28, (0.035, 0.03), 0.8);
}

/// A round-ended limb that swells a little in the middle, `wide` times as wide sideways as deep.
fn limb(shape: &mut Shape, a: Vec3, b: Vec3, (ra, rb): (f32, f32), wide: f32, around: usize) {
    let axis = (b - a).normalize_or(Vec3::Y);
    let reference = if axis.x.abs() < 0.9 { Vec3::X } else { Vec3::Y };
    let depth = axis.cross(reference).normalize();
    let frame = Mat3::from_cols(depth.cross(axis) * wide, -depth, axis);
    let length = (b - a).length();
    // A quarter of the rings on each round end, half between.
    let rings = around;
    let point = |ring: usize, k: usize| {
        let s = (ring + 1) as f32 / (rings + 1) as f32;
        let (along, radius) = if s < 0.25 {
            let (c, s) = cos_sin(s - 0.25);
            (s * ra, c * ra)
        } else if s <= 0.75 {
            let x = 2.0 * s - 0.5;
            (length * x, (ra + (rb - ra) * x) * (1.0 + 0.5 * (ra.min(rb)) * 4.0 * x * (1.0 - x)))
        } else {
            let (c, s) = cos_sin(s - 0.75);
            (length + s * rb, c * rb)
        };
        let (c, s) = cos_sin(k as f32 / around as f32);
        a + frame * Vec3::new(c * radius, s * radius, along)
    };
    shape.tube(Some(a - axis * ra), rings, around, point, Some(b + axis * rb));
}
