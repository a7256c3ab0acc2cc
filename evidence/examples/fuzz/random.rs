//! Random numbers, times and places of cases, with many special values among them.

use mbkd::TimeInterval;
use mbkd::glam::{DVec3, Vec3};

/// The generator of all tests, with other numbers made of it.
pub struct Random(mbkd_scenes::Random);

impl Random {
    pub fn new(seed: u64) -> Random {
        // Neighbouring seeds are neighbours in the sequence otherwise.
        Random(mbkd_scenes::Random(mbkd_scenes::Random(seed ^ 0x6a09_e667_f3bc_c908).bits()))
    }

    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.0.unit()
    }

    /// In [-1, 1), of more bits than f32 has.
    pub fn signed(&mut self) -> f64 {
        self.0.signed_f64()
    }

    pub fn vec(&mut self) -> DVec3 {
        self.0.dvec()
    }

    pub fn below(&mut self, n: usize) -> usize {
        self.0.below(n.max(1))
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// A power of ten between two.
    pub fn power(&mut self, least: i32, most: i32) -> f64 {
        10f64.powi(least + self.below((most - least + 1) as usize) as i32)
    }

    /// How many things: mostly few, sometimes thousands.
    pub fn count(&mut self, most: usize) -> usize {
        let limit = self.pick(&[3, 20, 20, 100, 100, 400, 400, 1000, 1000, 4000, 20_000]);
        self.below(limit.min(most) + 1)
    }

    /// A time in the shutter: any, or at or beside a key or the end of a time slice.
    pub fn time(&mut self) -> f32 {
        let parts = self.pick(&[1, 2, 3, 4, 5, 8, 16, 64]);
        let at = self.below(parts + 1) as f32 / parts as f32;
        match self.below(8) {
            0..4 => self.unit(),
            4 => at.next_up().min(1.0),
            5 => at.next_down().max(0.0),
            _ => at,
        }
    }

    /// A time that is rarely outside the shutter.
    pub fn any_time(&mut self) -> f32 {
        let time = self.time();
        let outside = [-0.0, -1e-30, 1f32.next_up(), 2.0, f32::NAN, f32::INFINITY];
        if self.one_in(60) { self.pick(&outside) } else { time }
    }

    /// A part of the shutter, sometimes a single step of time.
    pub fn interval(&mut self) -> TimeInterval {
        let (a, b) = (self.time(), self.time());
        let b = if self.one_in(20) { a.next_up() } else { b };
        TimeInterval::new(a.min(b), a.max(b)).unwrap_or(TimeInterval::FULL)
    }
}

/// How the places of a case are distributed.
#[derive(Clone, Copy, Debug)]
pub struct Places {
    pub scale: f64,
    pub offset: DVec3,
    pub style: usize,
}

impl Places {
    /// Around the unit cube mostly; else at any scale within `most`, far away from zero, or both.
    pub fn random(random: &mut Random, most: i32) -> Places {
        let scale = if random.one_in(3) { random.power(-most.min(25), most) } else { 1.0 };
        let offset = match random.below(5) {
            0 => random.vec() * scale * random.power(0, 7),
            1 => DVec3::X * scale * random.power(0, 7),
            _ => DVec3::ZERO,
        };
        let limit = DVec3::splat(10f64.powi(most));
        Places { scale: scale * 0.9, offset: offset.clamp(-limit, limit) * 0.09, style: random.below(9) }
    }

    /// The offset of a place: any, on a lattice, in a plane, on a line, in clusters, or of any order of magnitude.
    pub fn by(&self, random: &mut Random) -> DVec3 {
        let p = random.vec();
        self.scale
            * match self.style {
                0 => (p * 3.0).round() / 3.0,
                1 => (p * 4.0).round() / 4.0,
                2 => DVec3::new(p.x, 0.25, p.z),
                3 => DVec3::X * p.x,
                4 => (p * 1.5).round() / 2.0 + random.vec() * 1e-3,
                // Everything from the size of the whole down to nearly nothing.
                5 => p * random.power(-30, 0),
                _ => p,
            }
    }

    pub fn place(&self, random: &mut Random) -> DVec3 {
        self.offset + self.by(random)
    }
}

/// A direction of any length, often with components that are zero or tiny.
pub fn direction(random: &mut Random, towards: DVec3) -> Vec3 {
    let mut d = match random.below(6) {
        0 => DVec3::AXES[random.below(3)] * random.pick(&[1.0, -1.0]) * towards.length().max(1e-30),
        1 => random.vec(),
        _ => towards,
    };
    let axis = random.below(3);
    d[axis] *= random.pick(&[1.0, 1.0, 1.0, 1.0, 0.0, -0.0, 1e-9, 1e-30]);
    let scaled = d * if random.one_in(3) { random.power(-12, 12) } else { 1.0 };
    scaled.as_vec3()
}
