//! Meshes with many keys: merging of keys, and answers against brute force.

use super::common::{Random, closed_sphere, difference, divided, mapped, soup, variants};
use crate::scene;
use mbkd::baseline::{BruteForce, TriangleTests};
use mbkd::glam::{DVec3, Quat, Vec3};
use mbkd::{
    BuildError, BuildParams, ClosestPointQuery, Counters, Division, KdParams, Keys, Ray, RayTree, Statistics,
    TriangleMesh, WideParams,
};

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

/// Critical times: keys, times next to them, and random ones.
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
    let oracle = BruteForce::new(meshes).unwrap();
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

/// Static meshes, linear motion, and motion with two numbers of keys, in one place.
fn mixed(seed: u64) -> Vec<TriangleMesh> {
    let mut sphere = closed_sphere(6, 1, 0.2, seed);
    sphere.mask = 2;
    vec![
        sphere,
        closed_sphere(7, 2, 0.3, seed + 1),
        closed_sphere(8, 4, 0.2, seed + 2),
        soup(60, 65, 0.3, 0.05, seed + 3),
        TriangleMesh::new(vec![], vec![Vec::<Vec3>::new(); 5]),
        closed_sphere(6, 65, 0.02, seed + 4),
    ]
}

#[test]
fn bent_motion_equals_brute_force_however_the_shutter_is_divided() {
    let divisions = [
        Division::Automatic,
        Division::Whole,
        Division::SharedLeaves(3),
        Division::SharedLeaves(16),
        Division::SeparateTrees(3),
        Division::SeparateTrees(4),
        Division::SeparateTrees(16),
    ];
    for (i, division) in divisions.into_iter().enumerate() {
        let params = divided(division);
        equals_brute_force(&mixed(i as u64), &params, 300);
        for keys in [3, 5, 17, 257] {
            equals_brute_force(&[closed_sphere(6, keys, 0.1, i as u64)], &params, 100);
            equals_brute_force(&[soup(80, keys, 0.3, 2.0 / keys as f32, i as u64)], &params, 100);
        }
    }
    for params in [BuildParams::paper(), BuildParams::kd(KdParams::default()), BuildParams::kd(KdParams::classic())] {
        equals_brute_force(&mixed(9), &params, 100);
    }
}

#[test]
fn motion_that_ends_where_it_began_is_motion() {
    let mut there = closed_sphere(8, 9, 0.5, 6);
    if let Keys::F32(at) = &mut there.keys {
        at[8] = at[0].clone();
    }
    for division in [Division::Automatic, Division::Whole, Division::SharedLeaves(4), Division::SeparateTrees(4)] {
        equals_brute_force(&[there.clone()], &divided(division), 300);
    }
}

/// A triangle between large keys may be tiny in between; rounding is relative to the keys.
#[test]
fn triangles_that_pass_through_a_point_are_hit_in_every_tree() {
    let soup = soup(200, 1, 0.5, 0.0, 41);
    let Keys::F32(at) = &soup.keys else { panic!("f32") };
    let there = at[0].iter().map(|&p| -p).collect();
    let mesh = TriangleMesh { keys: vec![at[0].clone(), there].into(), ..soup };
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    let tests = TriangleTests::new(std::slice::from_ref(&mesh)).unwrap();
    let (mut random, mut hits) = (Random(42), 0);
    let rays: Vec<Ray> = (0..600)
        .map(|i| {
            let time = 0.5 + [-1.0, 1.0][i % 2] * 0.5f32.powi(24 - i as i32 / 2 % 8);
            let target = tests.corners(random.below(tests.len()) as u32, time)[0];
            let origin = target + random.vec() * [1e-4, 1e-6, 1.0][i % 3];
            Ray::new(origin, target - origin).at_time(time)
        })
        .collect();
    for params in variants() {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        for ray in &rays {
            assert_eq!(difference(&tree, &oracle, ray), None, "{params:?}");
            hits += usize::from(oracle.any_hit(ray));
        }
    }
    assert!(hits > 1000, "{hits}");
}

#[test]
fn corners_and_closest_points_are_those_of_brute_force() {
    let meshes = mixed(30);
    for division in [Division::Automatic, Division::SeparateTrees(4), Division::SharedLeaves(3)] {
        let (tree, oracle) = (RayTree::build(&meshes, &divided(division)).unwrap(), BruteForce::new(&meshes).unwrap());
        let kd = RayTree::build(&meshes, &BuildParams::paper()).unwrap();
        let mut random = Random(8);
        for _ in 0..200 {
            let time = times(65, &mut random);
            let point = random.vec().as_dvec3() * 1.5;
            let query = ClosestPointQuery { point, time, max_distance: f32::MAX };
            assert_eq!(
                tree.closest_point(&ClosestPointQuery::new(point, time).within(f32::MAX)),
                oracle.closest_point(&query)
            );
            let mesh = [0, 1, 2, 3, 5][random.below(5)];
            let primitive = random.below(meshes[mesh as usize].len()) as u32;
            assert_eq!(tree.triangle(mesh, primitive, time), kd.triangle(mesh, primitive, time));
        }
    }
}

#[test]
fn leaf_blocks_hold_all_keys_once() {
    let rock = (scene::turning(8000, 65)).meshes;
    let tree = equals_brute_force(&rock, &BuildParams::default(), 60);
    let statistics = tree.statistics();
    let vertices = statistics.kept_positions * size_of::<Vec3>();
    assert!(statistics.bytes < vertices * 3, "{} bytes, {vertices} of the vertices", statistics.bytes);
    assert_eq!(statistics.positions, statistics.kept_positions);
    // One tree for each of the 64 segments was 36 times as large.
    let two = RayTree::build(&scene::turning(8000, 2).meshes, &BuildParams::default()).unwrap().statistics();
    println!("{statistics:?}\n{two:?}");
}

#[test]
fn rays_that_miss_a_bent_figure_do_the_same_as_beside_a_straight_one() {
    let (two, many) = (scene::walking(30_000, 2), scene::walking(30_000, 17));
    let build = |scene: &scene::Scene| RayTree::build(&scene.meshes, &BuildParams::default()).unwrap();
    let (a, b) = (build(&two), build(&many));
    let figure = two.meshes.len() as u32 - 2;
    let mut random = Random(4);
    let (mut hit, mut missed) = ([0, 0], [0, 0]);
    for _ in 0..20_000 {
        let ray = two.camera.ray(random.unit(), random.unit(), 1.0, random.unit());
        let mut counters = [Counters::default(); 2];
        let at = a.closest_hit_observed(&ray, &mut counters[0]);
        b.closest_hit_observed(&ray, &mut counters[1]);
        let sum = if at.is_some_and(|hit| hit.mesh >= figure) { &mut hit } else { &mut missed };
        for (sum, counters) in sum.iter_mut().zip(counters) {
            *sum += counters.nodes + counters.leaves;
        }
    }
    println!("hit {hit:?} missed {missed:?}\n{:?}\n{:?}", a.statistics(), b.statistics());
    assert!(missed[1].abs_diff(missed[0]) * 10 < missed[0], "{missed:?}");
    assert!(hit[1] * 2 <= hit[0] * 3, "{hit:?}");
}

/// Blades around an axis that turn once. Halves of the shutter gain nothing: in each of them a triangle passes the same places.
#[test]
fn a_full_turn_costs_rays_little_more_than_a_quarter() {
    let fan = |turns: f32, keys: usize| {
        let corner = |i: usize| {
            let (blade, triangle, corner) = (i / 1800, i % 1800 / 3, i % 3);
            let along = 0.2 + triangle as f32 / 720.0 + if corner == 1 { 0.01 } else { 0.0 };
            let across = (triangle % 4) as f32 * 0.05 + if corner == 2 { 0.05 } else { 0.0 };
            Quat::from_rotation_z(blade as f32 * 1.25) * Vec3::new(along, across, across)
        };
        let turned =
            |key: usize| Quat::from_rotation_z(turns * core::f32::consts::TAU * key as f32 / (keys - 1) as f32);
        let at = |key: usize| (0..9000).map(|i| turned(key) * corner(i)).collect::<Vec<_>>();
        TriangleMesh::new(
            (0..3000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            (0..keys).map(at).collect::<Vec<_>>(),
        )
    };
    let work = |mesh: TriangleMesh| {
        let tree = RayTree::build(&[mesh], &BuildParams::default()).unwrap();
        let (mut random, mut counters) = (Random(3), Counters::default());
        for _ in 0..1000 {
            let from = DVec3::new(random.signed().into(), random.signed().into(), 3.0);
            let ray = Ray::new(from, random.vec() * 0.1 + Vec3::NEG_Z).at_time(random.unit());
            let _ = tree.closest_hit_observed(&ray, &mut counters);
        }
        counters.nodes + counters.leaves
    };
    let (quarter, once) = (work(fan(0.25, 5)), work(fan(1.0, 17)));
    assert!(once <= 2 * quarter, "{once} nodes and leaf blocks instead of {quarter}");
}

#[test]
fn the_budget_holds_or_is_an_error() {
    for (i, mesh) in
        [soup(3000, 9, 0.2, 0.3, 3), soup(3000, 2, 0.05, 2.0, 4), closed_sphere(30, 33, 0.1, 5)].iter().enumerate()
    {
        for bytes_per_primitive in [128.0, 200.0, 1024.0] {
            let params = BuildParams::wide(WideParams { bytes_per_primitive, ..WideParams::default() });
            let keys = mesh.keys.len().max(2) - 2;
            let allowed = (bytes_per_primitive as usize + 36 * keys) * mesh.len() + 8192;
            match RayTree::build(std::slice::from_ref(mesh), &params) {
                Ok(tree) => assert!(tree.statistics().bytes <= allowed, "{i} {bytes_per_primitive}"),
                Err(error) => {
                    assert!(matches!(error, BuildError::OverBudget { .. }) && bytes_per_primitive < 200.0, "{error}")
                }
            }
        }
    }
}

trait Vertices {
    fn keys_vertices(&self) -> usize;
}

impl Vertices for TriangleMesh {
    fn keys_vertices(&self) -> usize {
        match &self.keys {
            Keys::F32(at) => at[0].len(),
            Keys::F64(at) | Keys::Precise(at) => at[0].len(),
        }
    }
}

/// A few fast triangles beside many slow ones are a region with a temporal split of its own, unless they are so few that they might
/// be a leaf block: of different numbers of keys, they cannot be one.
#[test]
fn few_fast_triangles_of_different_numbers_of_keys_beside_many_others() {
    for seed in 0..8 {
        for few in [2, 6, 20] {
            let slow = soup(1100, 2, 0.01, 1e-3, seed);
            let fast = |keys: usize| mapped(&soup(few, keys, 0.2, 3.0, seed + keys as u64), |p| p + Vec3::X * 20.0);
            let meshes = [slow, fast(2), fast(5)];
            let tree = equals_brute_force(&meshes, &BuildParams::default(), 200);
            assert_eq!(tree.statistics().primitives, 1100 + 2 * few);
        }
    }
}
