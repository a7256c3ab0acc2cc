//! Spheres, of which rays are tested against many at a time, equal brute force over single ones.

use crate::common::{Blob, Random, difference, divided, saved, variants};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Counters, Division, Instance, InstanceOf, InstanceTree, LazyParams, MovingSphere,
    Pose, Ray, RayTree, Shape, SimdLevel, Statistics, TimeInterval, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// What the spheres of a set are like.
#[derive(Clone, Copy, Debug)]
struct Kind {
    count: usize,
    /// The numbers of keys, one after the other.
    keys: &'static [usize],
    size: f64,
    motion: f64,
    /// The size of space, and where its middle is.
    scale: f64,
    origin: f64,
}

const PLAIN: Kind = Kind { count: 200, keys: &[2], size: 0.1, motion: 0.2, scale: 1.0, origin: 0.0 };

const KINDS: [Kind; 12] = [
    PLAIN,
    Kind { count: 1, ..PLAIN },
    Kind { count: 17, keys: &[1], ..PLAIN },
    Kind { count: 600, keys: &[1, 2], motion: 1.0, ..PLAIN },
    Kind { count: 300, keys: &[9], ..PLAIN },
    Kind { keys: &[0, 1, 2, 3, 65], ..PLAIN },
    Kind { size: 1e-6, motion: 1e-5, ..PLAIN },
    Kind { size: 3.0, ..PLAIN },
    Kind { scale: 1e20, ..PLAIN },
    Kind { scale: 1e-20, ..PLAIN },
    Kind { origin: 1e7, ..PLAIN },
    Kind { keys: &[200], motion: 3.0, ..PLAIN },
];

fn spheres(kind: Kind, seed: u64) -> Vec<MovingSphere> {
    let mut random = Random(seed);
    let Kind { count, keys, size, motion, scale, origin } = kind;
    let sphere = |i: usize| {
        let mut center = random.vec().as_dvec3();
        let size = if i % 7 == 6 { 0.0 } else { size };
        let mut key = || {
            center += random.vec().as_dvec3() * motion;
            // A negative radius counts as its absolute value.
            (center * scale + origin, size * scale * f64::from(random.signed()))
        };
        let keys = (0..keys[i % keys.len()]).map(|_| key()).collect();
        let active = if i % 5 == 1 { TimeInterval::new(0.3, 0.6).unwrap() } else { TimeInterval::FULL };
        MovingSphere::new(keys).with_active(active)
    };
    (0..count).map(sphere).collect()
}

/// Rays through the scene from near, far and inside of spheres; some along tangents.
fn rays(kind: Kind, balls: &[MovingSphere], count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    let ray = |i: usize| {
        let time = if i.is_multiple_of(9) { (i % 3) as f32 * 0.5 } else { random.unit() };
        let ball = &balls[random.below(balls.len())];
        let (center, radius) = ball.at(time);
        let far = [1.5, 1.5, 40.0, 1e4][i % 4] * kind.scale;
        let mut origin = DVec3::splat(kind.origin) + random.vec().as_dvec3() * far;
        if i % 5 == 4 {
            origin = center + random.vec().as_dvec3() * radius.max(1e-3 * kind.scale);
        }
        let aside = (center - origin).cross(random.vec().as_dvec3()).normalize_or_zero() * radius;
        let to = center + aside * [1.0, 0.0, 0.5, 1.0 - 1e-7][i % 4];
        let dir = (to - origin).normalize_or(DVec3::X) * [1.0, 1e-3, 7.0][i % 3];
        let ray = Ray::new(origin, dir.as_vec3()).at_time(time);
        if i % 6 == 5 { ray.between(0.0, (far * 0.7) as f32) } else { ray }
    };
    (0..count).map(ray).collect()
}

fn params() -> Vec<BuildParams> {
    let divided = [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(4)].map(divided);
    variants().into_iter().chain(divided).collect()
}

#[test]
fn all_answers_equal_brute_force() {
    let (mut hits, mut from_files) = (0, 0);
    for (i, kind) in KINDS.into_iter().enumerate() {
        let balls = spheres(kind, 5 + i as u64);
        let shapes = || balls.iter().cloned().map(Shape::from).collect::<Vec<_>>();
        let oracle = BruteForce::of_scene(&[], shapes()).unwrap();
        let rays = rays(kind, &balls, 150, 30 + i as u64);
        hits += rays.iter().filter(|ray| oracle.any_hit(ray)).count();
        for params in params() {
            let mut tree = RayTree::of_scene(&[], shapes(), &params).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{kind:?}, {params:?}");
            for level in SimdLevel::available() {
                tree = tree.with_simd(level);
                for ray in &rays {
                    assert_eq!(difference(&tree, &oracle, ray), None, "{kind:?}, {params:?}, {level}");
                }
            }
            let mut found = Vec::new();
            tree.closest_hits(&rays, &mut found);
            for (ray, found) in rays.iter().zip(&found) {
                assert_eq!(*found, oracle.closest_hit(ray), "{kind:?}, {params:?}");
            }
            if let Ok(bytes) = saved(&tree) {
                let again = RayTree::read_from(&mut bytes.as_slice()).unwrap();
                assert!(rays.iter().all(|ray| again.closest_hit(ray) == oracle.closest_hit(ray)), "{kind:?}");
                from_files += 1;
            }
        }
    }
    assert!(hits > 800 && from_files > 100, "{hits} hits, {from_files} files");
}

#[test]
fn closest_points_equal_brute_force() {
    for (i, kind) in KINDS.into_iter().enumerate() {
        let balls = spheres(kind, 50 + i as u64);
        let shapes = || balls.iter().cloned().map(Shape::from).collect::<Vec<_>>();
        let oracle = BruteForce::of_scene(&[], shapes()).unwrap();
        for params in params() {
            let mut tree = RayTree::of_scene(&[], shapes(), &params).unwrap();
            for level in SimdLevel::available() {
                let mut random = Random(8);
                tree = tree.with_simd(level);
                for j in 0..60 {
                    let away = [1.5, 0.2, 30.0][j % 3] * kind.scale;
                    let point = DVec3::splat(kind.origin) + random.vec().as_dvec3() * away;
                    let within = if j % 4 == 3 { (0.3 * kind.scale) as f32 } else { f32::INFINITY };
                    let query = ClosestPointQuery::new(point, random.unit()).within(within);
                    let found = tree.closest_point(&query);
                    assert_eq!(found, oracle.closest_point(&query), "{kind:?}, {params:?}, {level}");
                }
            }
        }
    }
}

/// The same way from the first key to the last, with this many keys on a line.
fn straightened(ball: &MovingSphere, keys: usize) -> MovingSphere {
    let (Some(&first), Some(&last)) = (ball.keys.first(), ball.keys.last()) else { return ball.clone() };
    let at = |key: usize| {
        let w = key as f64 / (keys - 1) as f64;
        (first.0 + (last.0 - first.0) * w, first.1.abs() + (last.1.abs() - first.1.abs()) * w)
    };
    let path = (0..keys - 1).map(at).chain([(last.0, last.1.abs())]);
    MovingSphere::new(path.collect()).with_active(ball.active)
}

#[test]
fn straight_motion_costs_the_same_with_any_number_of_keys() {
    let balls = spheres(PLAIN, 3);
    for params in params() {
        let of = |keys: usize| {
            let shapes = balls.iter().map(|ball| straightened(ball, keys)).collect();
            RayTree::of_scene(&[], shapes, &params).unwrap()
        };
        for keys in [3, 9, 65] {
            let (two, many) = (of(2), of(keys));
            let untimed = |s: Statistics| Statistics { duplication_time: 0.0, propagation_time: 0.0, ..s };
            assert_eq!(untimed(many.statistics()), untimed(two.statistics()), "{keys} keys, {params:?}");
            for ray in rays(PLAIN, &balls, 300, 9) {
                let (mut a, mut b) = (Counters::default(), Counters::default());
                assert_eq!(two.closest_hit_observed(&ray, &mut a), many.closest_hit_observed(&ray, &mut b));
                assert_eq!(a, b);
            }
        }
    }
}

#[test]
fn spheres_with_few_keys_do_not_take_those_of_their_neighbours() {
    let of = |keys: &'static [usize]| {
        let balls = spheres(Kind { count: 2000, keys, ..PLAIN }, 8);
        RayTree::of_scene(&[], balls, &divided(Division::Whole)).unwrap().statistics().bytes
    };
    // One in ten moves on a curve.
    let (mixed, [still, bent]) = (of(&[1, 1, 1, 1, 1, 65, 1, 1, 1, 1]), [of(&[1]), of(&[65])]);
    assert!(mixed < still * 9 / 10 + bent / 10 * 2, "{mixed} bytes, {still} at rest, {bent} on curves");
}

/// Frame by frame, spheres move, gain and lose keys, and become other shapes.
#[test]
fn refitted_trees_equal_brute_force_whatever_becomes_of_spheres() {
    let frames = [PLAIN, PLAIN, Kind { keys: &[1], ..PLAIN }, PLAIN, Kind { keys: &[1, 2, 9], ..PLAIN }, PLAIN];
    for params in [Division::Automatic, Division::SharedLeaves(3), Division::SeparateTrees(2)] {
        let params = BuildParams::wide(WideParams { division: params, ..WideParams::default() });
        for first in [PLAIN, Kind { keys: &[9], ..PLAIN }] {
            let mut tree = RayTree::of_scene(&[], spheres(first, 1), &params).unwrap();
            for (frame, kind) in frames.into_iter().chain([first]).enumerate() {
                let mut balls = spheres(kind, 2 + frame as u64);
                // Some need fewer keys than they have.
                for ball in balls.iter_mut().skip(frame).step_by(3).filter(|ball| ball.keys.len() > 2) {
                    *ball = straightened(ball, ball.keys.len());
                }
                tree.refit_with_shapes(&[], balls.clone()).unwrap();
                let oracle = BruteForce::of_scene(&[], balls.clone()).unwrap();
                for ray in rays(kind, &balls, 150, frame as u64) {
                    assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}, frame {frame}");
                }
            }
        }
    }
}

/// Primitives that say that they are spheres are as fast: they are in blocks of up to sixteen.
#[test]
fn spheres_of_the_callers_equal_brute_force_and_are_tested_together() {
    for (kind, division) in [
        (PLAIN, Division::Whole),
        (Kind { keys: &[1], ..PLAIN }, Division::Whole),
        (Kind { keys: &[9], ..PLAIN }, Division::SeparateTrees(4)),
    ] {
        let balls = spheres(Kind { count: 5000, size: 0.03, motion: 0.05, ..kind }, 3);
        let own = || {
            balls.iter().cloned().zip(1..).map(|(ball, mask)| Blob { mask, ..Blob::named(ball) }).collect::<Vec<_>>()
        };
        let params = divided(division);
        let tree = RayTree::of_scene(&[], own(), &params).unwrap();
        let oracle = BruteForce::of_scene(&[], own()).unwrap();
        let mut counters = Counters::default();
        let mut hits = 0;
        for ray in rays(PLAIN, &balls, 1000, 4) {
            let expected = oracle.closest_hit(&ray);
            let found = tree.closest_hit_observed(&ray, &mut counters);
            assert_eq!(found, expected, "{kind:?}");
            if let Some(hit) = found {
                assert_eq!(tree.shape(hit.primitive).unwrap().mask(), hit.primitive + 1);
                hits += 1;
            }
        }
        let Counters { leaves, primitive_tests, .. } = counters;
        assert!(leaves < 16 * 1000 && primitive_tests > 5 * leaves, "{kind:?}: {counters:?}");
        assert!(hits > 500, "{hits}");
    }
}

/// The least budget suffices for spheres of any kind: their keys come on top of it.
#[test]
fn trees_of_spheres_keep_the_least_budget() {
    let mut most = 0.0f64;
    // Blocks hold spheres of one number of keys; these lie among each other.
    let mixed = [&[1, 2, 3, 5][..], &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]].map(|keys| Kind { keys, ..PLAIN });
    for (i, kind) in KINDS.into_iter().chain(mixed).enumerate() {
        for (count, size, motion) in [(200, 0.05, 0.3), (5000, 1e-4, 0.01), (5000, 0.05, 2.0)] {
            let balls = spheres(Kind { count, size, motion, ..kind }, i as u64);
            let keys: usize = balls.iter().map(|ball| ball.keys.len()).sum();
            let shapes = balls.into_iter().map(Shape::from).collect();
            let params = BuildParams::wide(WideParams { bytes_per_primitive: 128.0, ..WideParams::default() });
            let tree = RayTree::of_scene(&[], shapes, &params).unwrap();
            let allowed = 128 * count + 50 * keys + 8192;
            assert!(tree.statistics().bytes <= allowed, "{kind:?}");
            most = most.max(tree.statistics().bytes as f64 / allowed as f64);
        }
    }
    assert!(most > 0.5, "{most}");
}

#[test]
fn spheres_in_instances_and_lazy_trees_equal_brute_force() {
    let kind = Kind { count: 400, keys: &[1, 2, 5], ..PLAIN };
    let balls = spheres(kind, 9);
    let shapes = || balls.iter().cloned().map(Shape::from).collect::<Vec<_>>();
    let oracle = BruteForce::of_scene(&[], shapes()).unwrap();
    let lazy = BuildParams::lazy(LazyParams { subtree: 40, ..LazyParams::default() });
    let tree = RayTree::of_scene(&[], shapes(), &lazy).unwrap();
    let rays = rays(kind, &balls, 400, 10);
    for ray in &rays {
        assert_eq!(difference(&tree, &oracle, ray), None);
    }
    // At rest and not turned, an instance has the answers of its tree.
    let placed = Arc::new(RayTree::of_scene(&[], shapes(), &BuildParams::default()).unwrap());
    let instances = InstanceTree::build(vec![Instance::new(placed, Pose::IDENTITY)], &WideParams::default()).unwrap();
    for ray in &rays {
        assert_eq!(instances.closest_hit(ray).map(|hit| hit.hit), oracle.closest_hit(ray));
    }
    assert!(rays.iter().filter(|ray| oracle.any_hit(ray)).count() > 100);
}

/// Spheres whose squares are not normal numbers in f32, beside a scene of the size 1.
#[test]
fn spheres_far_smaller_than_the_scene_equal_brute_force() {
    let far = [TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::X, Vec3::X + Vec3::Y, Vec3::X + Vec3::Z])];
    let mut random = Random(31);
    let mut hits = 0;
    for size in [1e-17f32, 1e-19, 1e-20, 1e-22, 1e-24, 1e-30] {
        for _ in 0..20 {
            let mut place = || (random.vec() * size).as_dvec3();
            let balls: Vec<_> = (0..8).map(|_| MovingSphere::fixed(place(), f64::from(size) * 0.5)).collect();
            let shapes = || balls.iter().cloned().map(Shape::from).collect();
            let oracle = BruteForce::of_scene(&far, shapes()).unwrap();
            let mut tree = RayTree::of_scene(&far, shapes(), &BuildParams::default()).unwrap();
            for level in SimdLevel::available() {
                tree = tree.with_simd(level);
                for i in 0..20 {
                    let (origin, target) = (random.vec() * size, random.vec() * size);
                    let direction = (target - origin) * if i % 2 == 0 { 1.0 } else { 1.0 / size };
                    let ray = Ray::new(origin, direction);
                    hits += oracle.all_hits(&ray).len();
                    assert_eq!(difference(&tree, &oracle, &ray), None, "{size}, {level}");
                    let query = ClosestPointQuery::new(origin.as_dvec3() * 2.0, 0.0);
                    assert_eq!(tree.closest_point(&query), oracle.closest_point(&query), "{size}, {level}");
                }
            }
        }
    }
    assert!(hits > 1000, "{hits}");
}

/// Rays are rounded at each level of instances, and so is the one by which the point of a hit is found: those that graze a sphere
/// find it too.
#[test]
fn points_of_grazing_hits_are_known_at_other_times() {
    let (mut random, mut hits) = (Random(61), 0);
    let pose = |random: &mut Random| Pose {
        scale: DVec3::splat(f64::from(0.5 + random.unit())),
        rotation: DQuat::from_axis_angle(random.vec().as_dvec3().normalize(), f64::from(random.signed())),
        translation: random.vec().as_dvec3() * 3.0,
    };
    for _ in 0..400 {
        let sphere = MovingSphere::new(vec![(random.vec().as_dvec3(), 0.7), (random.vec().as_dvec3(), 1.2)]);
        let tree = RayTree::of_scene(&[], vec![sphere.clone()], &BuildParams::default()).unwrap();
        let mut placed = |of: InstanceOf| {
            let keys = vec![pose(&mut random), pose(&mut random)];
            InstanceTree::build(vec![Instance::new(of, keys)], &WideParams::default()).unwrap()
        };
        let inner = placed(Arc::new(tree).into());
        let tree = placed(Arc::new(inner).into());
        for _ in 0..20 {
            let time = random.unit();
            let (matrix, (centre, radius)) = (tree.matrix(&[0, 0], time).unwrap(), sphere.at(time));
            let radius = radius * matrix.matrix3.x_axis.length();
            let dir = random.vec();
            let along = dir.as_dvec3().normalize();
            let aside = along.cross(random.vec().as_dvec3()).normalize() * radius;
            let edge = matrix.transform_point3(centre) + aside * (1.0 - 1e-8 * f64::from(random.unit()));
            let ray = Ray::new(edge - along * 5.0, dir).at_time(time);
            if let Some(hit) = tree.closest_hit(&ray) {
                hits += 1;
                // Half of a chord so near the edge, for a ray that was rounded twice.
                let same = tree.point_at(&ray, &hit, time).expect("a point of the sphere");
                assert!((same - edge).length() < 5e-3 * radius, "{same} {edge}");
            }
        }
    }
    assert!(hits > 2000, "{hits}");
}

/// `t` is rounded by more than the radius there.
#[test]
fn normals_of_hits_from_far_away_are_not_rounded_as_distances_are() {
    let mut random = Random(77);
    for distance in [10.0, 1e5, 1e8] {
        for _ in 0..200 {
            let (center, radius) = (random.vec().as_dvec3(), f64::from(0.2 + random.unit()));
            let dir = random.vec().normalize();
            let along = dir.as_dvec3().normalize();
            let aside = along.cross(random.vec().as_dvec3()).normalize() * (0.9 * f64::from(random.unit()));
            // The unit normal where the ray enters.
            let normal = aside - along * (1.0 - aside.length_squared()).sqrt();
            let ray = Ray::new(center + aside * radius - dir.as_dvec3() * distance, dir);
            let sphere = MovingSphere::fixed(center, radius);
            let tree = RayTree::of_scene(&[], vec![sphere], &BuildParams::default()).unwrap();
            let hit = tree.closest_hit(&ray).unwrap();
            // The origin is an f64: at 1e8, less than 1e-7 beside the line.
            let found = [hit.u, hit.v].map(f64::from);
            let error = (found[0] - normal.x).abs().max((found[1] - normal.y).abs());
            assert!(error < 1e-6, "{error:e} from {distance:e} away");
            let whole = tree.surface_normal(&ray, &hit);
            assert!((whole.as_dvec3() - normal).abs().max_element() < 1e-6);
        }
    }
}

/// Centers at -0 are +0 in a leaf block or not, which hits do not show.
#[test]
fn signs_of_zeros_do_not_reach_the_hits() {
    let mut random = Random(41);
    let zero = |random: &mut Random| [0.0, -0.0][random.below(2)];
    let bits = |hit: Option<mbkd::Hit>| hit.map(|hit| [hit.t, hit.u, hit.v].map(f32::to_bits));
    for _ in 0..40 {
        let ball = |random: &mut Random, i: usize| {
            let from = DVec3::new(3.0 * i as f64, zero(random), zero(random));
            let to = from + DVec3::X * random.below(2) as f64;
            MovingSphere::new(if random.below(2) == 0 { vec![(from, 1.0)] } else { vec![(from, 1.0), (to, 1.0)] })
        };
        let balls: Vec<MovingSphere> = (0..8).map(|i| ball(&mut random, i)).collect();
        let oracle = BruteForce::of_scene(&[], balls.clone()).unwrap();
        for params in variants() {
            let tree = RayTree::of_scene(&[], balls.clone(), &params).unwrap();
            for _ in 0..40 {
                let origin = DVec3::new(-2.0 + 3.0 * random.below(8) as f64, zero(&mut random), zero(&mut random));
                let dir = Vec3::new(1.0, zero(&mut random) as f32, zero(&mut random) as f32);
                let ray = Ray::new(origin, dir).at_time([0.25, 0.75][random.below(2)]);
                assert_eq!(bits(tree.closest_hit(&ray)), bits(oracle.closest_hit(&ray)), "{ray:?} {params:?}");
            }
        }
    }
}
