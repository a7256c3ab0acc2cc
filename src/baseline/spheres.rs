//! A linear pass over bounding spheres of primitives.

use crate::geometry::{Box3, ULP};
use crate::ray::TreeRay;
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};

/// Centres and radii of a block of spheres.
#[derive(Clone, Default)]
struct Block {
    x: Lanes<f32>,
    y: Lanes<f32>,
    z: Lanes<f32>,
    radius: Lanes<f32>,
}

/// Spheres around the swept boxes of primitives, in tree space.
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
            let lane = spheres.len % LANES;
            if lane == 0 {
                spheres.blocks.push(Block::default());
            }
            if let Some(block) = spheres.blocks.last_mut() {
                let centre = b.min * 0.5 + b.max * 0.5;
                (block.x[lane], block.y[lane], block.z[lane]) = (centre.x, centre.y, centre.z);
                let rounding = 4.0 * ULP * b.min.abs().max(b.max.abs()).max_element();
                block.radius[lane] = 0.5625 * (b.max - b.min).length() + rounding;
            }
            spheres.len += 1;
        }
        spheres
    }
}

impl Spheres {
    /// Calls `visit` with the indices of all spheres that the ray's line may intersect, in order.
    ///
    /// The distance of a centre from the line is off by a few 2^-24 of its distance from the origin. A thousandth of that, the
    /// ray's own slack, and radii larger than necessary by an eighth and 4 ULP, cover all rounding here and in the tests
    /// of primitives.
    pub fn near(&self, ray: &TreeRay, visit: impl FnMut(u32)) {
        dispatch(SimdLevel::best(), Near { spheres: self, ray, visit });
    }
}

/// The test of one ray against all spheres, to be dispatched to an instruction set.
struct Near<'a, V> {
    spheres: &'a Spheres,
    ray: &'a TreeRay<'a>,
    visit: V,
}

impl<V: FnMut(u32)> Kernel for Near<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Near { spheres, ray, mut visit } = self;
        let [ox, oy, oz, _] = ray.origin;
        let d = ray.original.dir.as_dvec3().normalize().as_vec3();
        let (ox, oy, oz) = (s.splat(ox), s.splat(oy), s.splat(oz));
        let (dx, dy, dz) = (s.splat(d.x), s.splat(d.y), s.splat(d.z));
        let (part, least) = (s.splat(1e-3), s.splat(ray.slack + f32::MIN_POSITIVE));
        let size = s.splat_u(0x7fff_ffff);
        for (i, block) in spheres.blocks.iter().enumerate() {
            let (x, y, z) = (s.load(&block.x) - ox, s.load(&block.y) - oy, s.load(&block.z) - oz);
            let (a, b, c) = (y * dz - z * dy, z * dx - x * dz, x * dy - y * dx);
            let far_x = s.from_bits(s.to_bits(x) & size);
            let far_y = s.from_bits(s.to_bits(y) & size);
            let far_z = s.from_bits(s.to_bits(z) & size);
            let reach = s.load(&block.radius) + part * (far_x + far_y + far_z) + least;
            // In this form squares that overflow or underflow are not far.
            let far = s.lt(reach * reach, a * a + b * b + c * c);
            let count = LANES.min(spheres.len - i * LANES);
            let mut near = !far & ((1u32 << count) - 1) as Mask;
            while near != 0 {
                visit((i * LANES) as u32 + near.trailing_zeros());
                near &= near - 1;
            }
        }
    }
}
