//! The wide layout against brute force over the same triangle test.

use super::*;
use crate::motion::{PrimitiveSet, TriangleMesh, Triangles};
use crate::ray::{Closest, Collect, Count, Found, Listed, Ray, SetHit, TreeRay, Wide};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use glam::Vec3;

struct NoList;
impl Listed for NoList {
    fn intersect(&self, _: u32, _: &TreeRay, _: f32) -> Option<SetHit> {
        None
    }
}

struct Query<'a, C, K> {
    tree: &'a WideTree,
    ray: &'a TreeRay,
    collect: &'a mut C,
    count: &'a mut K,
}

impl<C: Collect, K: Count> Kernel for Query<'_, C, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        Wide { arena: &self.tree.arena, root: self.tree.root, listed: &NoList }.trace(
            s,
            self.ray,
            self.collect,
            self.count,
        );
    }
}

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

fn brute_force(set: &Triangles, ray: &TreeRay) -> Option<(f32, u32)> {
    let mut best = None;
    for id in 0..set.len() as u32 {
        if let Some(hit) = set.intersect(id, ray)
            && best.is_none_or(|(t, _)| hit.t < t)
        {
            best = Some((hit.t, id));
        }
    }
    best
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
        let set = Triangles::new(some).unwrap();
        let tree = WideTree::build(&set).unwrap();
        let mut hits = 0;
        for _ in 0..3000 {
            let (origin, dir) = (point(&mut state) * 2.0, point(&mut state));
            let time = (random(&mut state) * 1.2).clamp(-1.0, 1.0) * 0.5 + 0.5;
            let ray = TreeRay::new(&Ray::new(origin, dir).at_time(time), set.frame()).unwrap();
            let expected = brute_force(&set, &ray);
            hits += usize::from(expected.is_some());
            for level in SimdLevel::available() {
                let mut closest = Closest { t_max: ray.t_max, best: None, accept: |_: &Found| true };
                dispatch(level, Query { tree: &tree, ray: &ray, collect: &mut closest, count: &mut () });
                assert_eq!(closest.best.map(|f| (f.hit.t, f.id)), expected, "{level}, {origin} {dir} {time}");
            }
        }
        assert!(hits > 40, "{hits}");
    }
}
