//! Bounding spheres of primitives, one after the other.

use crate::geometry::Box3;
use crate::ray::TreeRay;
use glam::Vec3A;

/// So many spheres are looked at together, written so that the compiler uses vector instructions.
const BLOCK: usize = 16;

/// Centres and radii of a block of spheres.
#[derive(Clone, Default)]
struct Block {
    x: [f32; BLOCK],
    y: [f32; BLOCK],
    z: [f32; BLOCK],
    radius: [f32; BLOCK],
}

/// Spheres around everything that primitives ever occupy, in tree space.
#[derive(Default)]
pub(super) struct Spheres {
    blocks: Vec<Block>,
    len: usize,
}

impl FromIterator<Box3> for Spheres {
    /// Spheres around boxes.
    fn from_iter<I: IntoIterator<Item = Box3>>(boxes: I) -> Spheres {
        let mut spheres = Spheres::default();
        for b in boxes {
            let lane = spheres.len % BLOCK;
            if lane == 0 {
                spheres.blocks.push(Block::default());
            }
            if let Some(block) = spheres.blocks.last_mut() {
                let centre = b.min * 0.5 + b.max * 0.5;
                (block.x[lane], block.y[lane], block.z[lane]) = (centre.x, centre.y, centre.z);
                block.radius[lane] = (b.max - b.min).length();
            }
            spheres.len += 1;
        }
        spheres
    }
}

impl Spheres {
    /// Calls `visit` with the numbers of all that the ray's line may meet, in order.
    ///
    /// The distance of a centre from the line is off by a few 2^-24 of its distance from the origin. A thousandth of that, and
    /// radii twice as large as need be, leave room for all rounding here and in the tests of primitives.
    pub fn near(&self, ray: &TreeRay, mut visit: impl FnMut(u32)) {
        let dir = ray.world.dir.as_dvec3().normalize();
        let (o, d) = (Vec3A::from(ray.origin), Vec3A::from(dir.as_vec3()));
        let least = ray.slack + f32::MIN_POSITIVE;
        for (i, block) in self.blocks.iter().enumerate() {
            let mut far = [false; BLOCK];
            for (lane, far) in far.iter_mut().enumerate() {
                let (x, y, z) = (block.x[lane] - o.x, block.y[lane] - o.y, block.z[lane] - o.z);
                let (a, b, c) = (y * d.z - z * d.y, z * d.x - x * d.z, x * d.y - y * d.x);
                let reach = block.radius[lane] + 1e-3 * (x.abs() + y.abs() + z.abs()) + least;
                // In this form squares that overflow or underflow are not far.
                *far = a * a + b * b + c * c > reach * reach;
            }
            if far == [true; BLOCK] {
                continue;
            }
            let count = BLOCK.min(self.len - i * BLOCK);
            for lane in (0..count).filter(|&lane| !far[lane]) {
                visit((i * BLOCK + lane) as u32);
            }
        }
    }
}
