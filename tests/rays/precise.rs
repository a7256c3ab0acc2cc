//! Meshes with f64 positions: every answer is that of brute force over them, and hits that f32 would lose are found.

use crate::common::{Random, difference, divided, saved, soup, variants};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Counters, Division, Instance, InstanceTree, KdParams, MovingSphere, Ray, RayTree,
    RefitError, Shape, SimdLevel, TimeInterval, Transform, TriangleMesh, WideParams,
};
use std::sync::Arc;

fn vec(random: &mut Random) -> DVec3 {
    random.vec().as_dvec3() + random.vec().as_dvec3() * 2f64.powi(-24)
}

/// Triangles of one size around some positions, with a number of keys, as an f64 mesh.
fn around(places: &[DVec3], n: usize, size: f64, keys: usize, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let mut positions = vec![Vec::new(); keys];
    for i in 0..n {
        let mut at = places[i % places.len()] + vec(&mut random) * size * 10.0;
        let corners = [vec(&mut random) * size, vec(&mut random) * size, vec(&mut random) * size];
        for key in &mut positions {
            key.extend(corners.map(|corner| at + corner + vec(&mut random) * 0.1 * size));
            at += vec(&mut random) * size;
        }
    }
    TriangleMesh::new((0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions)
}

/// Two machines of 1 mm parts, 1e7 m apart.
const MACHINES: [DVec3; 2] = [DVec3::ZERO, DVec3::new(1e7, 2.0, -3e6)];

/// A position in geocentric coordinates.
const CITY: DVec3 = DVec3::new(4.5e5, 5.4e6, 210.0);

/// Scenes, and the sizes of their triangles.
fn scenes() -> Vec<(&'static str, f64, Vec<TriangleMesh>)> {
    let some_time = TimeInterval::new(0.2, 0.8).unwrap();
    let long = |mesh: TriangleMesh| {
        let bar =
            |i: f64| [CITY + DVec3::Y * i, CITY + DVec3::new(60.0, i, 40.0), CITY + DVec3::new(60.0, i + 0.1, 40.0)];
        let bars: Vec<DVec3> = (0..200).flat_map(|i| bar(0.3 * f64::from(i))).collect();
        let bars = TriangleMesh::new((0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), vec![bars]);
        vec![mesh, bars.precise()]
    };
    vec![
        ("machines", 1e-3, vec![around(&MACHINES, 400, 1e-3, 1, 1).precise()]),
        ("moving machines", 1e-3, vec![around(&MACHINES, 300, 1e-3, 2, 2).precise()]),
        ("bent machines", 1e-3, vec![around(&MACHINES, 200, 1e-3, 5, 3).precise()]),
        ("city", 2.0, long(around(&[CITY], 600, 2.0, 2, 4).precise())),
        ("with spheres", 0.05, vec![around(&[DVec3::ZERO], 300, 0.05, 2, 11).precise(), soup(100, 2, 0.1, 0.2, 12)]),
        (
            "all kinds",
            0.05,
            vec![
                soup(100, 2, 0.1, 0.2, 5),
                around(&[DVec3::ZERO], 150, 0.05, 1, 6).precise().with_active(some_time),
                soup(100, 1, 0.1, 0.0, 7).with_mask(0b10),
                around(&[DVec3::ZERO], 150, 0.05, 3, 8).precise().with_mask(0b100),
                around(&[DVec3::ZERO], 100, 0.05, 2, 9),
                TriangleMesh::new(Vec::new(), vec![Vec::<DVec3>::new()]).precise(),
                soup(50, 4, 0.1, 0.2, 10),
            ],
        ),
    ]
}

fn shapes(name: &str) -> Vec<Shape> {
    let ball = |i: i32| MovingSphere::new(vec![(DVec3::splat(0.01 * f64::from(i)), 0.02), (DVec3::X, 0.1)]).into();
    if ["all kinds", "with spheres"].contains(&name) { (0..20).map(ball).collect() } else { Vec::new() }
}

fn params() -> Vec<BuildParams> {
    let divided = [Division::SharedLeaves(3), Division::SeparateTrees(2)].map(divided);
    let cut = BuildParams::wide(WideParams { max_references: 2.0, ..WideParams::default() });
    variants().into_iter().chain(divided).chain([cut]).collect()
}

/// A position on a triangle of a scene at a time, or next to it.
fn target(tree: &RayTree, meshes: &[TriangleMesh], random: &mut Random, time: f32) -> DVec3 {
    let mesh = loop {
        let mesh = random.below(meshes.len());
        if !meshes[mesh].is_empty() {
            break mesh;
        }
    };
    let [a, b, c] = tree.triangle(mesh as u32, random.below(meshes[mesh].len()) as u32, time);
    let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
    match random.below(4) {
        0 => a,
        1 => a + (b - a) * u,
        2 => a + vec(random) * (b - a).length(),
        _ => a + (b - a) * u * (1.0 - v) + (c - a) * u * v,
    }
}

/// A ray at such a position, from near or far.
fn ray(tree: &RayTree, meshes: &[TriangleMesh], random: &mut Random, size: f64) -> Ray {
    let time = [0.0, 0.5, 1.0, random.unit()][random.below(4)];
    let target = target(tree, meshes, random, time);
    let dir = random.vec();
    let away = size * [1.0, 5.0, 1e3, 1e9][random.below(4)];
    let ray = Ray::new(target - dir.as_dvec3() * away, dir).at_time(time);
    if random.below(8) == 0 { ray.between((0.9 * away) as f32, (1.1 * away) as f32) } else { ray }
}

#[test]
fn rays_equal_brute_force_and_find_what_they_are_aimed_at() {
    for (name, size, meshes) in scenes() {
        let oracle = BruteForce::of_scene(&meshes, shapes(name)).unwrap();
        for params in params() {
            let mut tree = RayTree::of_scene(&meshes, shapes(name), &params).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{name}, {params:?}");
            let (mut random, mut hits, mut rays) = (Random(7), 0, Vec::new());
            for level in SimdLevel::available() {
                tree = tree.with_simd(level);
                for _ in 0..100 {
                    let ray = ray(&tree, &meshes, &mut random, size);
                    assert_eq!(difference(&tree, &oracle, &ray), None, "{name}, {params:?}, {level}");
                    let some = |hit: &mbkd::Hit| !hit.primitive.is_multiple_of(3);
                    let found = tree.closest_hit_filtered(&ray, 0b101, some);
                    assert_eq!(found, oracle.closest_hit_filtered(&ray, 0b101, some), "{name}, {params:?}");
                    hits += usize::from(tree.any_hit(&ray));
                    rays.push(ray);
                }
            }
            assert!(hits > rays.len() / 4, "{name}: {hits} hits");
            let mut batch = Vec::new();
            tree.closest_hits(&rays, &mut batch);
            assert!(batch.into_iter().eq(rays.iter().map(|ray| tree.closest_hit(ray))), "{name}, {params:?}");
            assert_eq!(tree.validate(), Ok(()), "{name}, {params:?}: parts that rays built");
        }
    }
}

#[test]
fn nearest_points_equal_brute_force_and_are_where_they_should_be() {
    for (name, size, meshes) in scenes() {
        let oracle = BruteForce::of_scene(&meshes, shapes(name)).unwrap();
        for params in params() {
            let mut tree = RayTree::of_scene(&meshes, shapes(name), &params).unwrap();
            let mut random = Random(8);
            for level in SimdLevel::available() {
                tree = tree.with_simd(level);
                for _ in 0..60 {
                    let time = random.unit();
                    let on_it = target(&tree, &meshes, &mut random, time);
                    let query = ClosestPointQuery::new(on_it + vec(&mut random) * size * random.unit() as f64, time);
                    let found = tree.closest_point(&ClosestPointQuery::new(query.point, query.time));
                    assert_eq!(found, oracle.closest_point(&query), "{name}, {params:?}, {level}");
                    let found = found.unwrap();
                    let off = ((found.point - query.point).length() - f64::from(found.distance)).abs();
                    // Half an ulp of f64 in the coordinates of the point, and of f32 in the distance.
                    let allowed = found.point.length() * f64::EPSILON + f64::from(found.distance) * 1e-7;
                    assert!(off <= 2.0 * allowed, "{name}: {off}");
                }
            }
        }
    }
}

/// Rays at triangles of a millimetre, and the number of wrong answers: a miss, or a hit at the wrong place.
fn wrong(kept: bool) -> usize {
    let mesh = around(&MACHINES, 400, 1e-3, 2, 2);
    let exact = RayTree::build(&[mesh.clone().precise()], &BuildParams::default()).unwrap();
    let mesh = if kept { mesh.precise() } else { mesh };
    let tree = RayTree::build(&[mesh], &BuildParams::default()).unwrap();
    let mut random = Random(12);
    let (mut wrong, count) = (0, 1000);
    for i in 0..count {
        let time = random.unit();
        let [a, b, c] = exact.triangle(0, i % 400, time);
        // A way of whole f64 numbers: the triangle's middle is met after a thousandth of the direction's length.
        let middle = (a + b + c) / 3.0;
        let dir = (random.vec() + Vec3::splat(0.01)).normalize();
        let ray = Ray::new(middle - dir.as_dvec3() * 1e-3, dir).at_time(time).between(0.999e-3, 1.001e-3);
        let mut found = false;
        let _ = tree.all_hits(&ray, |hit| {
            found |= hit.primitive == i % 400;
            std::ops::ControlFlow::Continue(())
        });
        wrong += usize::from(!found);
    }
    wrong
}

#[test]
fn machines_far_apart_are_hit_where_f32_loses_them() {
    assert_eq!(wrong(true), 0);
    // Half of them around zero, half of them 1e7 m away: relative to the middle of both, all are on a grid of half a metre.
    assert!(wrong(false) > 900, "{}", wrong(false));
}

#[test]
fn corners_are_those_that_were_given() {
    for (name, _, meshes) in scenes() {
        for params in params() {
            let tree = RayTree::of_scene(&meshes, shapes(name), &params).unwrap();
            for (m, mesh) in meshes.iter().enumerate() {
                let mbkd::Keys::Precise(keys) = &mesh.keys else { continue };
                for (t, indices) in mesh.indices.iter().enumerate() {
                    for (key, positions) in keys.iter().enumerate() {
                        let time = key as f32 / (keys.len().max(2) - 1) as f32;
                        let expected = indices.map(|v| positions[v as usize]);
                        let found = tree.triangle(m as u32, t as u32, time);
                        let off = found.iter().zip(expected).map(|(a, b)| (*a - b).length()).fold(0.0, f64::max);
                        assert!(off == 0.0, "{name}, {params:?}: {found:?} {expected:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn files_keep_every_bit() {
    for (name, size, meshes) in scenes() {
        for params in [BuildParams::default(), BuildParams::paper(), BuildParams::kd(KdParams::classic())] {
            let tree = RayTree::of_scene(&meshes, shapes(name), &params).unwrap();
            let bytes = saved(&tree).unwrap();
            let again = RayTree::read_from(&mut bytes.as_slice()).unwrap();
            assert!(bytes == saved(&again).unwrap(), "{name}, {params:?}");
            assert_eq!(again.validate(), Ok(()));
            let mut random = Random(5);
            for _ in 0..300 {
                let ray = ray(&tree, &meshes, &mut random, size);
                assert_eq!(again.closest_hit(&ray), tree.closest_hit(&ray), "{name}, {params:?}");
                let near = |tree: &RayTree| tree.closest_point(&ClosestPointQuery::new(ray.origin, ray.time));
                assert_eq!(near(&again), near(&tree), "{name}, {params:?}");
            }
        }
    }
}

#[test]
fn refits_follow_to_the_last_bit() {
    let frame = |places: &[DVec3], seed: u64| {
        vec![
            around(places, 200, 1e-3, 2, seed).precise(),
            soup(60, 2, 0.1, 0.2, seed),
            around(&[DVec3::ZERO], 100, 1e-3, 1, seed + 50).precise(),
        ]
    };
    let first = frame(&MACHINES, 1);
    for params in params() {
        let mut tree = RayTree::build(&first, &params).unwrap();
        if let Err(error) = tree.refit(&first) {
            assert!(matches!(error, RefitError::Policy | RefitError::Lazy));
            continue;
        }
        for step in 2..4 {
            let meshes = frame(&[DVec3::X * step as f64, MACHINES[1]], step);
            tree.refit(&meshes).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{params:?}");
            let oracle = BruteForce::new(&meshes).unwrap();
            let (mut random, mut hits) = (Random(step), 0);
            for _ in 0..300 {
                let ray = ray(&tree, &meshes, &mut random, 1e-3);
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
                hits += usize::from(tree.any_hit(&ray));
            }
            assert!(hits > 70, "{hits}");
        }
        let mut other = first.clone();
        other[0].keys = around(&MACHINES, 200, 1e-3, 2, 1).keys;
        assert_eq!(tree.refit(&other), Err(RefitError::Precision { mesh: 0 }));
        let three = around(&MACHINES, 200, 1e-3, 3, 1).precise();
        other[0] = three;
        assert_eq!(tree.refit(&other), Err(RefitError::Keys { mesh: 0, expected: 2, found: 3 }));
    }
}

/// Counted work: one tree over both machines looks at all parts of one that are within the f32 spacing of where it is;
/// one tree for each, placed in a tree of instances, does not.
#[test]
fn a_tree_for_each_machine_answers_alike_with_little_work() {
    let meshes = MACHINES.map(|place| around(&[place], 2000, 1e-3, 1, 4).precise());
    let one = RayTree::build(&meshes, &BuildParams::default()).unwrap();
    let place = |mesh: &TriangleMesh| {
        let tree = Arc::new(RayTree::build(core::slice::from_ref(mesh), &BuildParams::default()).unwrap());
        Instance::new(tree, DAffine3::IDENTITY)
    };
    let apart = InstanceTree::build(meshes.iter().map(place).collect(), &WideParams::default()).unwrap();
    let mut random = Random(6);
    let (mut work, mut less) = (Counters::default(), Counters::default());
    for _ in 0..400 {
        // At the middle of a part, from nearby.
        let [a, b, c] = one.triangle(random.below(2) as u32, random.below(2000) as u32, 0.0);
        let dir = (random.vec() + Vec3::splat(0.01)).normalize();
        let ray = Ray::new((a + b + c) / 3.0 - dir.as_dvec3() * 0.01, dir);
        let hit = one.closest_hit_observed(&ray, &mut work).unwrap();
        let found = apart.closest_hit_observed(&ray, &mut less).unwrap();
        assert_eq!((found.path[0], found.hit.primitive), (hit.mesh, hit.primitive), "{ray:?}");
        // Spaces with other middles round places far away differently, by what f64 has there.
        assert!((found.hit.t - hit.t).abs() <= 1e-6 * hit.t + 4e-9, "{found:?} {hit:?}");
    }
    assert!(work.primitive_tests > 20 * less.primitive_tests, "{work:?} {less:?}");
}

/// Coordinates that f32 rounds to zero in tree space are inside the boxes, too.
#[test]
fn boxes_hold_meshes_that_vanish_beside_others() {
    let around = |size: f64, keys: usize, seed: u64| around(&[DVec3::ZERO], 20, size, keys, seed).precise();
    let tiny = around(1e-48, 2, 9);
    for meshes in [vec![around(1.0, 2, 10), tiny.clone(), around(1e-41, 1, 11)], vec![tiny]] {
        let tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
        assert_eq!(tree.validate(), Ok(()));
    }
}

/// A mesh in f32 keeps every bit anyway: that it asks changes nothing, not a byte of its tree.
#[test]
fn meshes_in_f32_are_what_they_were() {
    let meshes = [soup(500, 1, 0.1, 0.0, 1), soup(500, 2, 0.1, 0.2, 2), soup(200, 4, 0.1, 0.2, 3)];
    for params in params() {
        let Ok(bytes) = saved(&RayTree::build(&meshes, &params).unwrap()) else { continue };
        let precise = meshes.clone().map(TriangleMesh::precise);
        assert!(saved(&RayTree::build(&precise, &params).unwrap()).unwrap() == bytes, "{params:?}");
    }
}

/// Corners in leaf blocks are rounded at their keys and in between, so the boxes of flat triangles there are beside the triangles.
#[test]
fn points_on_flat_triangles_that_move_are_at_distance_zero() {
    let mut random = Random(31);
    let mut missed = 0;
    for round in 0..400 {
        let keys = 2 + round % 3;
        let mut positions = vec![Vec::new(); keys];
        for _ in 0..64 {
            let axis = random.below(3);
            let at = random.vec().as_dvec3();
            for key in &mut positions {
                let by = random.vec().as_dvec3()[axis] * 0.999_999;
                key.extend([DVec3::ZERO, DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]].map(|corner| {
                    let mut p = at + 0.1 * corner;
                    p[axis] = by;
                    p
                }));
            }
        }
        let indices = (0..64).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = TriangleMesh::new(indices, positions).precise();
        let tree = RayTree::build(&[mesh], &BuildParams::default()).unwrap();
        for triangle in 0..64 {
            let time = random.unit();
            let [a, b, c] = tree.triangle(0, triangle, time);
            let query = ClosestPointQuery::new(a + 0.25 * (b - a) + 0.25 * (c - a), time).within(1e-14);
            missed += usize::from(tree.closest_point(&query).is_none());
        }
    }
    assert_eq!(missed, 0, "of 25600");
}

/// A tree so far from its own zero that f64 rounds by more than f32 does in the scene, and instances that turn it about there and
/// bring it back: the translation cancels what the matrix makes of the distance, which is far beyond the box that the instance has.
#[test]
fn instances_bring_back_what_is_far_from_its_own_zero() {
    let mut hits = 0;
    for far in [1e6, 1e11, 2e12, 1e13, 1e14] {
        let own = DVec3::new(far, far, 0.0);
        let corners = [DVec3::new(0.5, -0.5, -1.0), DVec3::new(0.5, -0.5, 1.0), DVec3::new(-0.5, 0.5, 0.0)];
        let mesh = TriangleMesh::new(vec![[0, 1, 2]], vec![corners.map(|p| own + p).to_vec()]).precise();
        let tree = Arc::new(RayTree::build(core::slice::from_ref(&mesh), &BuildParams::default()).unwrap());
        let oracle = BruteForce::new(&[mesh]).unwrap();
        let place = |angle: f64, scale: f64| {
            let turned = DAffine3::from_rotation_z(angle) * DAffine3::from_scale(DVec3::splat(scale));
            DAffine3 { translation: -turned.transform_vector3(own), ..turned }
        };
        let moving = |scale: f64| vec![place(0.7, 1.0), place(0.75, scale)];
        for transform in
            [Transform::from(place(core::f64::consts::FRAC_PI_4, 1.0)), moving(1.5).into(), moving(1e-3).into()]
        {
            let all =
                InstanceTree::build(vec![Instance::new(tree.clone(), transform); 2], &WideParams::default()).unwrap();
            for i in 0..4000 {
                let from = DVec3::new(f64::from(i) / 4000.0 * 1.5 - 0.75, -3.0, 0.0);
                let ray = Ray::new(from, Vec3::Y).at_time(if i % 2 == 0 { 0.0 } else { 0.4 });
                let expected = oracle.closest_hit(&all.local_ray(0, &ray).unwrap());
                assert_eq!(all.closest_hit(&ray).map(|hit| hit.hit), expected, "{far:e}");
                hits += usize::from(expected.is_some());
            }
        }
    }
    assert!(hits > 20_000, "{hits}");
}
