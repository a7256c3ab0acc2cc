//! The tank: its shape with an obstacle, the column of water that collapses, and the particles of its walls.

use mbkd::glam::Vec3;
use mbkd_renderer::fluid::Tank;

/// A tank two metres long with a column of water at its left end and an obstacle in its path; metres, y up.
pub fn dam() -> (Tank, [Vec3; 2]) {
    let inside = [Vec3::ZERO, Vec3::new(2.0, 0.95, 0.56)];
    let obstacle = [Vec3::new(1.22, 0.0, 0.2), Vec3::new(1.38, 0.2, 0.36)];
    (Tank { inside, solids: vec![obstacle] }, [Vec3::ZERO, Vec3::new(0.6, 0.6, 0.56)])
}

/// A tank around particles that were read from a file, with half their height as headroom.
pub fn around(particles: &[Vec3], spacing: f32) -> Tank {
    let low = particles.iter().fold(Vec3::INFINITY, |low, p| low.min(*p)) - 0.5 * spacing;
    let high = particles.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p)) + 0.5 * spacing;
    Tank { inside: [low, high + Vec3::Y * (0.5 * (high.y - low.y))], solids: Vec::new() }
}

/// About `count` particles on a lattice that fills a box, and their spacing.
pub fn lattice([low, high]: [Vec3; 2], count: usize) -> (Vec<Vec3>, f32) {
    let size = high - low;
    let wanted = (size.x * size.y * size.z / count as f32).cbrt();
    // A whole number of layers in depth; the other sides take the nearest number.
    let spacing = size.z / (size.z / wanted).round().max(1.0);
    let [nx, ny, nz] = (size / spacing).to_array().map(|n| n.round().max(1.0) as usize);
    let place = |i: usize| Vec3::new((i % nx) as f32, (i / nx % ny) as f32, (i / nx / ny) as f32);
    ((0..nx * ny * nz).map(|i| low + (place(i) + 0.5) * spacing).collect(), spacing)
}

/// A particle of a wall, and its volume in cubes of the spacing.
pub type Brick = (Vec3, f32);

/// Layers of a wall: as many as the kernel reaches into it.
const LAYERS: i32 = 2;

/// Particles that continue the lattice of the fluid into the walls of a tank and into the obstacles in it.
pub fn walls(tank: &Tank, spacing: f32) -> Vec<Brick> {
    let [low, high] = tank.inside;
    // Higher than the drawn tank, for splashes.
    let high = high + Vec3::Y * (0.6 * (high.y - low.y));
    let mut bricks = lay([low, high], spacing, [-LAYERS, LAYERS], |[x, y, z], [nx, ny, nz]| {
        let outside = |i: i32, n: i32| i < 0 || i >= n;
        y < ny && (outside(x, nx) || y < 0 || outside(z, nz))
    });
    for &solid in &tank.solids {
        bricks.extend(lay(solid, spacing, [0, 0], |place, sides| {
            (0..3).any(|axis| place[axis] < LAYERS || place[axis] >= sides[axis] - LAYERS)
        }));
    }
    bricks
}

/// The lattice points in and around a box, with so many layers around it, that `wanted` selects.
fn lay(
    [low, high]: [Vec3; 2],
    spacing: f32,
    [before, behind]: [i32; 2],
    wanted: impl Fn([i32; 3], [i32; 3]) -> bool,
) -> Vec<Brick> {
    let sides = ((high - low) / spacing).to_array().map(|n| n.round().max(1.0) as i32);
    let step = (high - low) / Vec3::from_array(sides.map(|n| n as f32));
    let volume = (step / spacing).element_product();
    let mut bricks = Vec::new();
    for x in before..sides[0] + behind {
        for y in before..sides[1] + behind {
            for z in before..sides[2] + behind {
                if wanted([x, y, z], sides) {
                    let place = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
                    bricks.push((low + step * place, volume));
                }
            }
        }
    }
    bricks
}
