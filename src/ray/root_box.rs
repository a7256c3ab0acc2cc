//! The box around a whole tree during the shutter, for the rays of a batch that miss everything.
//!
//! **Proof that no ray is ruled out that enters a box of the root.** The least and the greatest face of all boxes at both ends of the
//! shutter bound every face at every time, as it is computed: a face is linear in time, and its rounding is monotone. The distances to
//! them are those of the slab test ([`super::slabs`]) whose product is rounded before the sum, and products and sums are monotone as
//! well. On instruction sets that fuse the two, a distance may differ by that one rounding, which the proof of the slab test counts.

use super::tree_ray::TreeRay;
use crate::layout::{Kind, NODE_ROWS, STATIC_NODE_ROWS, WideTree};
use crate::simd::{LANES, Simd, greatest_of_each, lanes_at};
use crate::traverse::NodeBlock;
use glam::Vec3A;

/// The box around all boxes of a root node at all times.
pub(super) struct RootBox {
    min: Vec3A,
    max: Vec3A,
}

impl RootBox {
    /// The box of a tree; without bounds if its root is no node.
    #[inline(always)]
    pub fn of<S: Simd>(s: S, tree: &WideTree) -> RootBox {
        match tree.root.kind() {
            Kind::Node => RootBox::of_node::<S, NODE_ROWS>(s, tree.arena.block(tree.root.at())),
            Kind::StaticNode => RootBox::of_node::<S, STATIC_NODE_ROWS>(s, tree.arena.block(tree.root.at())),
            _ => RootBox { min: Vec3A::NEG_INFINITY, max: Vec3A::INFINITY },
        }
    }

    #[inline(always)]
    fn of_node<S: Simd, const ROWS: usize>(s: S, block: &NodeBlock) -> RootBox {
        let zero = s.splat(0.0);
        // The upper faces, and the negated lower ones. Lanes without a box have faces that bound nothing.
        let mut greatest = [s.splat(f32::NEG_INFINITY); LANES];
        for axis in 0..3 {
            for side in 0..2 {
                let row = (2 * axis + side) * LANES;
                let begin = s.load(lanes_at(block, row));
                let end = if ROWS == NODE_ROWS { s.load(lanes_at(block, row + 6 * LANES)) + begin } else { begin };
                greatest[axis + 4 * side] = if side == 0 { s.max(zero - begin, zero - end) } else { s.max(begin, end) };
            }
        }
        let mut all = [0.0; LANES];
        s.store(greatest_of_each(s, greatest), &mut all);
        RootBox { min: -Vec3A::new(all[0], all[1], all[2]), max: Vec3A::new(all[4], all[5], all[6]) }
    }

    /// Whether a ray misses everything in the tree. Never for a ray that begins behind its origin.
    #[inline(always)]
    pub fn is_missed_by(&self, ray: &TreeRay) -> bool {
        let slabs = &ray.slabs;
        let (a, b) = (self.min * slabs.inverse, self.max * slabs.inverse);
        let enter = (a.min(b) + slabs.near_offset).max_element();
        let leave = (a.max(b) + slabs.far_offset).min_element();
        (slabs.behind() == 0.0) & (enter.max(slabs.begin) > leave.min(ray.end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Frame, KERNEL_ULPS, ULP};
    use crate::params::{BuildParams, WideParams};
    use crate::primitive::{PrimitiveSet, Scene, TriangleMesh};
    use crate::progress::Progress;
    use crate::random::Random;
    use crate::ray::{Ray, RayTree};
    use crate::simd::{Kernel, SimdLevel, dispatch};
    use glam::Vec3;

    struct Of<'a>(&'a WideTree);

    impl Kernel for Of<'_> {
        type Output = RootBox;

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> RootBox {
            RootBox::of(s, self.0)
        }
    }

    /// Triangles with a side each on an edge of the box around all, and inside of it otherwise.
    fn on_an_edge(random: &mut Random) -> Vec<Vec3> {
        let mut corners = Vec::new();
        for _ in 0..60 {
            let inside = random.vec();
            corners.extend([Vec3::new(-1.0, -1.0, random.signed()), Vec3::new(-1.0, -1.0, random.signed()), inside]);
        }
        corners
    }

    /// Of rays that hit triangles along an edge of the box, those that hit and those of them that are ruled out, if the padding of boxes
    /// and the slack of rays are multiplied by `part`.
    fn hit_and_lost(moving: bool, part: f32, level: SimdLevel) -> (usize, usize) {
        let mut random = Random(5);
        let begin = on_an_edge(&mut random);
        let indices: Vec<[u32; 3]> = (0..60).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let end: Vec<Vec3> = begin.iter().map(|&p| p + Vec3::X).collect();
        let mesh = match moving {
            true => TriangleMesh::new(indices, vec![begin.clone(), end]),
            false => TriangleMesh::fixed(indices, begin.clone()),
        };
        let tree = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::default()).expect("a tree");
        let set = Scene::new(&[mesh], Vec::new()).expect("a scene");
        let wide = WideTree::build(&set, &WideParams::default(), &Progress::new(None)).expect("a tree");
        let mut of = dispatch(level, Of(&wide));
        let size = of.min.abs().max(of.max.abs()).max_element();
        let inward = Vec3A::splat((1.0 - part) * 2.0 * KERNEL_ULPS * ULP * size);
        (of.min, of.max) = (of.min + inward, of.max - inward);
        let (mut hits, mut lost) = (0, 0);
        for _ in 0..20_000 {
            let i = (random.unit() * 60.0) as usize * 3;
            let target = begin[i].lerp(begin[i + 1], random.unit());
            let origin = target + random.vec() * 4.0;
            // The triangles are on the edge when the shutter opens.
            let ray = Ray::new(origin, target - origin);
            let mut placed = TreeRay::new(&ray, set.frame()).expect("a ray");
            placed.slabs = placed.slabs_with(placed.slack * part, 0.0);
            let hit = tree.closest_hit(&ray).is_some();
            hits += usize::from(hit);
            lost += usize::from(hit && of.is_missed_by(&placed));
        }
        (hits, lost)
    }

    #[test]
    fn no_ray_that_hits_is_ruled_out_and_some_would_be_without_padding_and_slack() {
        for level in SimdLevel::available() {
            for moving in [false, true] {
                let (hits, lost) = hit_and_lost(moving, 1.0, level);
                assert!(hits > 5_000 && lost == 0, "{level}, {moving}: {lost} of {hits}");
                let (_, lost) = hit_and_lost(moving, 0.0, level);
                assert!(lost > 20, "{level}, {moving}: {lost}");
            }
        }
    }

    #[test]
    fn rays_beside_the_box_are_ruled_out_and_rays_through_it_are_not() {
        let of = RootBox { min: Vec3A::splat(-1.0), max: Vec3A::ONE };
        let missed = |origin: Vec3, dir: Vec3, range: [f32; 2]| {
            let ray = Ray::new(origin, dir).between(range[0], range[1]);
            of.is_missed_by(&TreeRay::new(&ray, &Frame::WORLD).expect("a ray"))
        };
        let all = [0.0, f32::INFINITY];
        assert!(!missed(Vec3::new(0.5, 0.5, -5.0), Vec3::Z, all));
        assert!(!missed(Vec3::ZERO, Vec3::new(0.0, -0.0, 1.0), all));
        assert!(!missed(Vec3::new(1.0, 0.0, -5.0), Vec3::Z, all), "in the plane of a face");
        assert!(missed(Vec3::new(1.5, 0.5, -5.0), Vec3::Z, all), "beside");
        assert!(missed(Vec3::new(0.5, 0.5, -5.0), Vec3::NEG_Z, all), "behind");
        assert!(missed(Vec3::new(0.5, 0.5, -5.0), Vec3::Z, [0.0, 3.5]), "ends in front");
        assert!(missed(Vec3::new(0.5, 0.5, -5.0), Vec3::Z, [6.5, 9.0]), "begins beyond");
        assert!(!missed(Vec3::new(0.5, 0.5, 5.0), Vec3::Z, [-5.0, 0.0]), "begins behind its origin");
        assert!(
            !RootBox { min: Vec3A::NEG_INFINITY, max: Vec3A::INFINITY }
                .is_missed_by(&TreeRay::new(&Ray::new(Vec3::ZERO, Vec3::Z), &Frame::WORLD).expect("a ray"))
        );
    }
}
