//! Meshes with many keys: what merges away, and that answers stay those of brute force.

use super::common::{Random, closed_sphere, difference, soup};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Counters, KdParams, Keys, Ray, RayTree, Statistics, TriangleMesh};

/// A mesh with straight segments sampled at more keys, as a program would do it in f32.
fn sampled(mesh: &TriangleMesh, keys: usize) -> TriangleMesh {
    let Keys::F32(at) = &mesh.keys else { panic!("f32") };
    let segments = at.len() - 1;
    let step = (keys - 1) / segments;
    assert_eq!(step * segments, keys - 1);
    let position = |key: usize, v: usize| match (key / step, key % step) {
        (segment, 0) => at[segment][v],
        (segment, inner) => at[segment][v].lerp(at[segment + 1][v], inner as f32 / step as f32),
    };
    let positions: Vec<Vec<Vec3>> = (0..keys).map(|key| (0..at[0].len()).map(|v| position(key, v)).collect()).collect();
    TriangleMesh { keys: positions.into(), ..mesh.clone() }
}

/// Times at which something may go wrong: keys, times beside them, and any.
fn times(keys: usize, random: &mut Random) -> f32 {
    let key = random.below(keys) as f32 / (keys - 1).max(1) as f32;
    match random.below(4) {
        0 => key,
        1 => key.next_up().min(1.0),
        2 => key.next_down().max(0.0),
        _ => random.unit(),
    }
}

/// Rays at those times through a scene of about half-size 1, half of them aimed at vertices.
fn rays(meshes: &[TriangleMesh], count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..count)
        .map(|i| {
            let mesh = &meshes[random.below(meshes.len())];
            let Keys::F32(at) = &mesh.keys else { panic!("f32") };
            let key = random.below(at.len());
            let aimed = i % 2 == 0 && at[key].len() > 1;
            let time = if aimed { key as f32 / (at.len() - 1).max(1) as f32 } else { times(at.len(), &mut random) };
            let origin = random.vec() * 3.0;
            let target = if aimed { at[key][random.below(at[key].len())] } else { random.vec() };
            Ray::new(origin, target - origin).at_time(time)
        })
        .collect()
}

fn equals_brute_force(meshes: &[TriangleMesh], params: &BuildParams, count: usize) -> RayTree {
    let tree = RayTree::build(meshes, params).unwrap();
    let oracle = BruteForce::build(meshes).unwrap();
    for ray in rays(meshes, count, 5) {
        assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
    }
    tree.validate().unwrap();
    tree
}

#[test]
fn straight_motion_costs_the_same_with_any_number_of_keys() {
    for params in [BuildParams::default(), BuildParams::paper(), BuildParams::kd(KdParams::default())] {
        let straight = closed_sphere(12, 2, 0.3, 3);
        let still = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::X, Vec3::Y, Vec3::Z]);
        let with = |keys: usize| {
            let mut rest = still.clone();
            let Keys::F32(at) = &still.keys else { panic!("f32") };
            rest.keys = vec![at[0].clone(); keys].into();
            [rest, sampled(&straight, keys)]
        };
        let two = equals_brute_force(&with(2), &params, 200);
        for keys in [9, 65] {
            let many = equals_brute_force(&with(keys), &params, 200);
            let untimed =
                |s: Statistics| Statistics { positions: 0, duplication_time: 0.0, propagation_time: 0.0, ..s };
            assert_eq!(untimed(many.statistics()), untimed(two.statistics()));
            assert_eq!(many.statistics().positions, keys * (straight.keys_vertices() + 3));
            assert_eq!(many.statistics().kept_positions, 2 * straight.keys_vertices() + 3);
            for ray in rays(&with(2), 300, 9) {
                let (mut a, mut b) = (Counters::default(), Counters::default());
                assert_eq!(two.closest_hit_observed(&ray, &mut a), many.closest_hit_observed(&ray, &mut b));
                assert_eq!(a, b);
            }
        }
    }
}

#[test]
fn piecewise_straight_motion_keeps_its_bends_and_bent_motion_all_keys() {
    let kept = |mesh: TriangleMesh| {
        let vertices = mesh.keys_vertices();
        let tree = equals_brute_force(&[mesh], &BuildParams::default(), 100);
        tree.statistics().kept_positions / vertices
    };
    let bent = closed_sphere(8, 3, 0.3, 1);
    assert_eq!(kept(sampled(&bent, 17)), 3);
    assert_eq!(kept(sampled(&soup(50, 5, 0.3, 0.5, 2), 65)), 5);
    assert_eq!(kept(soup(50, 9, 0.3, 0.5, 2)), 9);
    // One vertex that stops halfway keeps the key for all.
    let mut stops = sampled(&closed_sphere(8, 2, 0.3, 1), 9);
    if let Keys::F32(at) = &mut stops.keys {
        for key in 5..9 {
            at[key][3] = at[4][3];
        }
    }
    assert_eq!(kept(stops), 3);
}

#[test]
fn straight_motion_in_f64_merges_as_well() {
    let Keys::F32(at) = closed_sphere(8, 2, 0.3, 4).keys else { panic!("f32") };
    let from = |v: usize, key: usize| at[key][v].as_dvec3() + DVec3::new(1e6, -3e5, 2e4);
    let wide: Vec<Vec<DVec3>> = (0..9)
        .map(|key| (0..at[0].len()).map(|v| from(v, 0).lerp(from(v, 1), f64::from(key) / 8.0)).collect())
        .collect();
    let mesh = TriangleMesh::new(vec![[0, 1, 2], [2, 3, 4]], wide);
    let tree = RayTree::build(&[mesh], &BuildParams::default()).unwrap();
    assert_eq!(tree.statistics().kept_positions, 2 * at[0].len());
}

trait Vertices {
    fn keys_vertices(&self) -> usize;
}

impl Vertices for TriangleMesh {
    fn keys_vertices(&self) -> usize {
        match &self.keys {
            Keys::F32(at) => at[0].len(),
            Keys::F64(at) => at[0].len(),
        }
    }
}
