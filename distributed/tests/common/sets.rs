//! Sets of particles: pseudo-random, the same on every rank.

use mbkd_distributed::Particle;
use mbkd_scenes::Random;

/// A set in a box of size 1 or periodic space.
pub struct Set {
    pub name: &'static str,
    /// In no order.
    pub particles: Vec<Particle>,
    pub periods: [Option<f32>; 3],
    pub radius: f32,
}

fn near(random: &mut Random, at: [f32; 3], size: f32) -> [f32; 3] {
    at.map(|x| x + size * (random.unit() - 0.5))
}

/// A particle with a number that says nothing about where it is; some are above 32 bits.
fn numbered(i: usize, open: [f32; 3], close: [f32; 3]) -> Particle {
    Particle { id: (i as u64 * 7_919 % 10_007) << 24 | 5, open, close }
}

/// Sets that ask different things of the partition.
pub fn sets() -> Vec<Set> {
    let mut random = Random(1);
    let mut sets = Vec::new();
    let (open, torus) = ([None; 3], [Some(1.0); 3]);
    for (name, periods, radius) in
        [("uniform", open, 0.15), ("uniform, periodic", torus, 0.15), ("uniform, beyond half a period", torus, 0.6)]
    {
        let mut one = |i| {
            let at = random.in_cube().to_array();
            numbered(i, at, near(&mut random, at, 0.05))
        };
        sets.push(Set { name, particles: (0..300).map(&mut one).collect(), periods, radius });
    }
    for (name, periods) in [("clusters", open), ("clusters, periodic along x and z", [Some(1.0), None, Some(1.0)])] {
        let centres: Vec<_> = (0..6).map(|_| random.in_cube().to_array()).collect();
        let mut one = |i: usize| {
            let at = near(&mut random, centres[i * i % 6], 0.08);
            // Half of them stand still.
            numbered(i, at, if i.is_multiple_of(2) { at } else { near(&mut random, at, 0.1) })
        };
        sets.push(Set { name, particles: (0..300).map(&mut one).collect(), periods, radius: 0.03 });
    }
    for (name, periods) in [("drift", open), ("drift, periodic along x", [Some(1.0), None, None])] {
        let mut one = |i: usize| {
            // Two streams that cross the whole box, some against each other, from one period below.
            let at = random.in_cube().to_array();
            let way = if i.is_multiple_of(5) { -0.9 } else { 0.7 };
            let close = near(&mut random, [at[0] + way, at[1] + 0.1, at[2]], 0.02);
            numbered(i, [at[0] - 1.0, at[1], at[2]], [close[0] - 1.0, close[1], close[2]])
        };
        sets.push(Set { name, particles: (0..300).map(&mut one).collect(), periods, radius: 0.1 });
    }
    // All in one place go to one rank, so that others have none; ties are settled by number.
    let heap = (0..40).map(|i| numbered(i, [0.25; 3], [0.25; 3])).collect();
    sets.push(Set { name: "heap", particles: heap, periods: open, radius: 0.0 });
    // Ties, also across the faces.
    let corner = |i: usize| [i / 16, i / 4 % 4, i % 4].map(|x| x as f32 / 4.0);
    for (name, periods, radius) in [
        ("grid, periodic", torus, 0.25),
        ("grid, periodic, of unlimited reach", torus, f32::INFINITY),
        ("grid of unlimited reach", open, f32::INFINITY),
    ] {
        let particles = (0..64).map(|i| numbered(i, corner(i), corner(i))).collect();
        sets.push(Set { name, particles, periods, radius });
    }
    let two = [0, 1].map(|i| numbered(i, [0.9 * i as f32; 3], [1.0 - 0.9 * i as f32; 3])).to_vec();
    sets.push(Set { name: "two particles", particles: two, periods: [None, Some(1.0), None], radius: 0.5 });
    sets.push(Set { name: "no particles", particles: Vec::new(), periods: torus, radius: 0.1 });
    sets
}
