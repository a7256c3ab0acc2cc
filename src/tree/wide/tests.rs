//! The wide layout against brute force over the same triangle test. (Whole queries are tested with
//! [`RayTree`](crate::RayTree) in `tests/`.)

use crate::simd::SimdLevel;
use crate::{BuildParams, Policy, Ray, RayTree, TriangleMesh};
use glam::Vec3;

fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
}

fn point(state: &mut u64) -> Vec3 {
    Vec3::new(random(state), random(state), random(state))
}

fn soup(n: usize, keys: usize, size: f32, motion: f32, state: &mut u64) -> TriangleMesh {
    let mut positions = vec![Vec::new(); keys];
    for _ in 0..n {
        let at = point(state);
        let corners = [at, at + point(state) * size, at + point(state) * size];
        for key in positions.iter_mut() {
            let by = point(state) * motion;
            key.extend(corners.map(|c| c + by));
        }
    }
    TriangleMesh::new((0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions)
}

#[test]
fn closest_hits_equal_brute_force_on_every_level() {
    let mut state = 42;
    let meshes = [
        soup(700, 1, 0.1, 0.0, &mut state),
        soup(700, 2, 0.1, 0.3, &mut state),
        soup(300, 4, 0.1, 0.2, &mut state),
        soup(300, 2, 1.0, 0.01, &mut state),
    ];
    for some in [&meshes[..1], &meshes[1..2], &meshes[2..3], &meshes[..]] {
        for level in SimdLevel::available() {
            let params = BuildParams::default().with_policy(Policy::Wide);
            let tree = RayTree::build(some, &params).unwrap().with_simd(level);
            let mut hits = 0;
            for _ in 0..1500 {
                let (origin, dir) = (point(&mut state) * 2.0, point(&mut state));
                let time = (random(&mut state) * 1.2).clamp(-1.0, 1.0) * 0.5 + 0.5;
                let ray = Ray::new(origin, dir).at_time(time);
                let expected = tree.brute_force().closest_hit(&ray);
                hits += usize::from(expected.is_some());
                assert_eq!(tree.closest_hit(&ray), expected, "{level}, {ray:?}");
            }
            assert!(hits > 20, "{hits}");
        }
    }
}
