//! Accuracy of trees: small objects in large scenes, outliers, far origins, ranges, all magnitudes.

use crate::common::{Random, closed_sphere, difference, mapped, random_ray, soup, variants};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Aabb, BuildParams, ClosestPointQuery, Counters, Hit, KdParams, MovingSphere, Ray, RayTree, TreePrimitive,
    TriangleMesh, Visitor,
};

/// A large triangle at height `y`.
fn ground(size: f32, y: f32) -> TriangleMesh {
    let at = |x: f32, z: f32| Vec3::new(x * size, y, z * size);
    TriangleMesh::fixed(vec![[0, 1, 2]], vec![at(-1.0, -1.0), at(1.0, -1.0), at(0.0, 1.0)])
}

#[test]
fn a_small_thing_in_a_large_scene_is_hit_as_if_it_were_alone() {
    for at in [Vec3::ZERO, Vec3::new(0.3, -0.7, 0.11)] {
        let ball = mapped(&closed_sphere(16, 2, 0.1, 5), |p| p * 0.01 + at);
        let alone = RayTree::build(std::slice::from_ref(&ball), &BuildParams::default()).unwrap();
        let mut random = Random(1);
        let rays: Vec<Ray> = (0..2000)
            .map(|_| {
                let from = random.vec() * 0.02;
                Ray::new(at + from, random.vec() * 0.005 - from).at_time(random.unit()).between(0.0, 2.0)
            })
            .collect();
        let expected: Vec<Option<Hit>> = rays.iter().map(|ray| alone.closest_hit(ray)).collect();
        assert!(expected.iter().flatten().count() > 1900);
        for size in [1e4, 1e6, 1e7] {
            let meshes = [ball.clone(), ground(size, -3.0)];
            for params in variants() {
                let tree = RayTree::build(&meshes, &params).unwrap();
                for (ray, expected) in rays.iter().zip(&expected) {
                    let got = tree.closest_hit(ray);
                    if at == Vec3::ZERO {
                        assert_eq!(got, *expected, "{size} {params:?} {ray:?}");
                    } else {
                        // Alone its coordinates are small; here they have the rounding of what the caller gave.
                        let (t, other) = (got.map_or(-1.0, |hit| hit.t), expected.map_or(-1.0, |hit| hit.t));
                        let allowed = 8.0 * f32::EPSILON / ray.dir.length();
                        assert!((t - other).abs() <= allowed, "{size} {params:?} {ray:?}: {got:?} {expected:?}");
                    }
                }
            }
        }
    }
}

/// Visits the primitives whose boxes hold a point.
struct AtPoint<'a> {
    point: DVec3,
    counters: &'a mut Counters,
}

impl Visitor<TreePrimitive> for AtPoint<'_> {
    fn enter(&mut self, b: &Aabb) -> Option<f32> {
        self.counters.nodes += 1;
        b.contains(self.point).then_some(0.0)
    }

    fn visit(&mut self, _: TreePrimitive) -> ControlFlow<()> {
        self.counters.primitive_tests += 1;
        ControlFlow::Continue(())
    }
}

/// Nodes visited (of visitors: boxes) and triangles tested by queries in the unit cube, per query: rays, nearest points, and
/// visitors.
fn work(tree: &RayTree) -> [(f64, f64); 3] {
    const QUERIES: usize = 2000;
    let per_query = |query: &dyn Fn(&mut Random, &mut Counters)| {
        let (mut random, mut counters) = (Random(3), Counters::default());
        (0..QUERIES).for_each(|_| query(&mut random, &mut counters));
        (counters.nodes as f64 / QUERIES as f64, counters.primitive_tests as f64 / QUERIES as f64)
    };
    let ray = |random: &mut Random, counters: &mut Counters| {
        tree.closest_hit_observed(&random_ray(random, 1.0), counters);
    };
    let nearest = |random: &mut Random, counters: &mut Counters| {
        tree.closest_point_observed(&ClosestPointQuery::new(random.vec(), random.unit()), counters);
    };
    let visitor = |random: &mut Random, counters: &mut Counters| {
        let mut at = AtPoint { point: random.vec().as_dvec3(), counters };
        assert!(tree.traverse(random.unit(), &mut at).is_continue());
    };
    [per_query(&ray), per_query(&nearest), per_query(&visitor)]
}

#[test]
fn one_vertex_far_away_makes_no_other_box_larger() {
    // A k-d tree needs some more planes, with two boxes each, to separate the cell of the cube from empty space.
    let trees =
        [(BuildParams::default(), 2.0), (BuildParams::paper(), 24.0), (BuildParams::kd(KdParams::classic()), 24.0)];
    for (keys, (params, more)) in [1, 2, 3].into_iter().flat_map(|keys| trees.map(|tree| (keys, tree))) {
        let cube = soup(3000, keys, 0.02, 0.02, 7);
        let alone = work(&RayTree::build(std::slice::from_ref(&cube), &params).unwrap());
        for far in [1e6, 1e12] {
            let outlier = ground(1e-3, far);
            let meshes = [cube.clone(), outlier];
            let beside = work(&RayTree::build(&meshes, &params).unwrap());
            for ((nodes, tests), (now, tests_now)) in alone.into_iter().zip(beside) {
                assert!(
                    now < 1.2 * nodes + more && tests_now < 1.2 * tests + 2.0,
                    "{keys} keys, {far}: {beside:?} beside {alone:?}, {params:?}"
                );
            }
        }
    }
}

/// Rays at a unit sphere from `distance` away, and the same rays beginning near it. Origins and directions are exact.
fn from_afar(random: &mut Random, distance: f64) -> (Ray, Ray) {
    let dir = loop {
        let dir = (random.vec() * 8.0).round();
        if dir != Vec3::ZERO {
            break dir;
        }
    };
    let target = (random.vec() * 32.0).round().as_dvec3() / 64.0;
    let begin = |by: f64| Ray::new(target - dir.as_dvec3() * by, dir).at_time(0.25);
    (begin(distance), begin(2.0))
}

#[test]
fn rays_from_far_away_take_the_steps_of_near_ones_and_miss_nothing() {
    let mesh = closed_sphere(24, 2, 0.02, 3);
    let tree = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::default()).unwrap();
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    let balls = vec![MovingSphere::fixed(DVec3::ZERO, 1.0)];
    let ball = RayTree::of_scene(&[], balls.clone(), &BuildParams::default()).unwrap();
    let kd = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::paper()).unwrap();
    for power in [7, 14, 20, 26] {
        let distance = f64::from(1 << power);
        let mut random = Random(power);
        let (mut far_count, mut near_count) = (Counters::default(), Counters::default());
        for i in 0..500 {
            let (far, near) = from_afar(&mut random, distance);
            let far_hit = tree.closest_hit_observed(&far, &mut far_count).expect("a hit from far away");
            let near_hit = tree.closest_hit_observed(&near, &mut near_count).expect("a hit from near by");
            assert_eq!(Some(far_hit), kd.closest_hit(&far));
            if i % 10 == 0 {
                assert_eq!(difference(&tree, &oracle, &far), None);
            }
            // Half an f32 step there, plus the error of the origin.
            let t = f64::from(near_hit.t) + (distance - 2.0);
            let allowed = distance * f64::from(f32::EPSILON) * 0.5 + 1e-6 + distance * 1e-14;
            assert!((f64::from(far_hit.t) - t).abs() <= allowed, "{distance}: {} instead of {t}", far_hit.t);
            // From behind, with a negative range, and not at all.
            let behind = Ray { dir: -far.dir, ..far };
            assert_eq!(tree.closest_hit(&behind), None);
            let line = tree.closest_hit(&behind.between(f32::NEG_INFINITY, 0.0)).expect("a hit behind");
            assert!((f64::from(line.t) + distance).abs() < 3.0 + 2.0 * allowed, "{}", line.t);
            assert!(ball.any_hit(&far) && ball.any_hit(&behind.between(f32::NEG_INFINITY, 0.0)));
        }
        // From farther away `t` is too coarse to distinguish the near side from the far one, so both are visited.
        let (nodes, leaves) = if power <= 20 { (1.5, 1.5) } else { (3.0, 3.0) };
        assert!(far_count.nodes as f64 <= nodes * near_count.nodes as f64, "{power}: {far_count:?} {near_count:?}");
        assert!(far_count.leaves as f64 <= leaves * near_count.leaves as f64, "{power}: {far_count:?} {near_count:?}");
    }
}

#[test]
fn the_range_holds_for_the_t_that_is_returned() {
    let mesh = soup(400, 2, 0.4, 0.3, 4);
    let params = variants();
    let trees: Vec<RayTree> =
        params.iter().map(|params| RayTree::build(std::slice::from_ref(&mesh), params).unwrap()).collect();
    let mut random = Random(9);
    let mut hits = 0;
    for i in 0..2000 {
        let ray = random_ray(&mut random, 1.5);
        let ray = Ray { dir: ray.dir * [1.0, 1e-30, 1e30, 3e-41][i % 4], ..ray };
        let ray = if i % 3 == 0 {
            Ray { origin: ray.origin - ray.dir.normalize_or_zero().as_dvec3() * 1e5, ..ray }
        } else {
            ray
        };
        for tree in &trees {
            let Some(hit) = tree.closest_hit(&ray) else { continue };
            hits += 1;
            assert!(hit.t.is_finite() && hit.t >= 0.0);
            assert_eq!(tree.closest_hit(&ray.between(hit.t, hit.t)), Some(hit), "{ray:?}");
            let before = ray.between(0.0, hit.t.next_down());
            assert!(hit.t == 0.0 || !tree.any_hit(&before), "{ray:?}");
            let after = tree.closest_hit(&ray.between(hit.t.next_up(), f32::INFINITY));
            assert!(after.is_none_or(|next| next.t > hit.t), "{ray:?}");
        }
    }
    assert!(hits > 2000, "{hits}");
}

/// In a scene this small the distances of hits are denormal, and those that f32 can tell apart are far from each other.
#[test]
fn the_range_begins_where_it_says_in_a_scene_of_the_least_numbers() {
    let least = f32::from_bits(1);
    let (mut random, mut hits, mut misses) = (Random(26), 0, 0);
    for _ in 0..20 {
        let mesh = mapped(&soup(2, 2, 1.0, 0.3, random.below(1000) as u64), |p| (p * 10.0).round() * least);
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        for params in variants() {
            let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
            for _ in 0..400 {
                let from = random.vec().as_dvec3() * 30.0;
                let toward = random.vec() * 5.0 - from.as_vec3();
                let dir = if random.below(2) == 0 { toward } else { toward.normalize() };
                let t_min = f32::from_bits(random.below(50) as u32);
                let ray = Ray::new(from * f64::from(least), dir).at_time(random.unit()).between(t_min, f32::INFINITY);
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?} {ray:?}");
                *if oracle.any_hit(&ray) { &mut hits } else { &mut misses } += 1;
            }
        }
    }
    assert!(hits > 1000 && misses > 1000, "{hits} {misses}");
}

#[test]
fn neither_minus_zero_nor_infinity_is_an_answer() {
    let mesh = ground(1.0, 0.0);
    let ball = || vec![MovingSphere::fixed(DVec3::ZERO, 1.0)];
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    for params in variants() {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        let on = Ray::new(Vec3::ZERO, Vec3::NEG_Y);
        for ray in [on, Ray { dir: Vec3::Y, ..on }] {
            let hit = tree.closest_hit(&ray).expect("a hit where the ray begins");
            assert_eq!(hit.t.to_bits(), 0);
            assert_eq!(tree.closest_hit(&ray.between(1e-45, 1.0)), None);
            assert_eq!(tree.closest_hit(&ray.between(-1.0, -1e-45)), None);
            assert_eq!(tree.closest_hit(&ray.between(-1.0, -0.0)).unwrap().t.to_bits(), 0);
        }
        // The distance overflows in f32.
        let slow = Ray::new(Vec3::Y, Vec3::NEG_Y * 1e-45);
        assert_eq!((tree.closest_hit(&slow), tree.any_hit(&slow), oracle.closest_hit(&slow)), (None, false, None));
        let line = |ray: Ray| ray.between(f32::NEG_INFINITY, f32::INFINITY);
        let back = line(Ray { dir: -slow.dir, ..slow });
        assert_eq!((tree.closest_hit(&back), tree.any_hit(&back), oracle.closest_hit(&back)), (None, false, None));
        let back = line(Ray::new(Vec3::Y * 1e-10, Vec3::Y * 1e-45));
        assert!(tree.closest_hit(&back).unwrap().t < -1e34);
        let slow = Ray::new(Vec3::Y * 1e-10, Vec3::NEG_Y * 1e-45);
        assert!(tree.closest_hit(&slow).unwrap().t.is_finite());
        let balls = RayTree::of_scene(&[], ball(), &params).unwrap();
        let slow = Ray::new(Vec3::Y * 3.0, Vec3::NEG_Y * 1e-45);
        assert_eq!((balls.closest_hit(&slow), balls.any_hit(&slow)), (None, false));
    }
}

#[test]
fn any_magnitude_gives_the_answers_of_the_unit_cube() {
    let mesh = soup(300, 2, 0.3, 0.3, 6);
    let unit = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    for power in [-100, -60, 0, 60, 97] {
        let scale = 2f32.powi(power);
        let scaled = mapped(&mesh, |p| p * scale);
        // Alone, and next to a much larger or smaller object.
        let beside = if power <= 0 { scale * 2f32.powi(60) } else { scale * 2f32.powi(-90) };
        let other = TriangleMesh::fixed(vec![[0, 1, 2]], [Vec3::X, Vec3::Y, Vec3::ONE].map(|p| p * beside).to_vec());
        for meshes in [vec![scaled.clone()], vec![scaled, other]] {
            let oracle = BruteForce::new(&meshes).unwrap();
            for params in variants() {
                let tree = RayTree::build(&meshes, &params).unwrap();
                let (mut random, mut hits) = (Random(5), 0);
                for i in 0..300 {
                    let ray = random_ray(&mut random, 1.0);
                    let large = Ray { origin: ray.origin * f64::from(scale), ..ray }.between(0.0, 8.0 * scale);
                    if i % 10 == 0 {
                        assert_eq!(difference(&tree, &oracle, &large), None, "{params:?} at 2^{power}");
                    }
                    let expected = unit.closest_hit(&ray.between(0.0, 8.0));
                    let got = tree.closest_hit(&large).filter(|hit| hit.mesh == 0);
                    assert_eq!(
                        got.map(|hit| (hit.primitive, hit.t / scale)),
                        expected.map(|hit| (hit.primitive, hit.t))
                    );
                    hits += usize::from(got.is_some());
                }
                assert!(hits > 100);
            }
        }
    }
}

/// Directions so long that hits all around have a `t` of zero or a few denormal numbers, also those a little behind the origin.
#[test]
fn where_t_is_denormal_trees_find_what_brute_force_finds() {
    let mut random = Random(23);
    let mut at_zero = 0;
    for (size, offset) in [(1e-10, 1e-4), (1e-20, 0.0), (1e-30, 0.0)] {
        let offset = Vec3::splat(offset);
        let meshes = [mapped(&soup(200, 2, 0.3, 0.1, 3), |p| p * size + offset)];
        let oracle = BruteForce::new(&meshes).unwrap();
        let trees: Vec<RayTree> = variants().iter().map(|params| RayTree::build(&meshes, params).unwrap()).collect();
        for i in 0..300 {
            let origin = offset + random.vec() * size * 0.5;
            let length = [1e18, 1e25, 1e30, 3e38][i % 4];
            let (begin, end) = [(0.0, f32::INFINITY), (1e-45, 3e-45), (-1e-44, 0.0), (0.0, 1.0)][i / 4 % 4];
            let dir = random.vec() * length;
            let ray = Ray::new(origin, dir).at_time(random.unit()).between(begin, end);
            at_zero += oracle.all_hits(&ray).iter().filter(|hit| hit.t == 0.0).count();
            for (tree, params) in trees.iter().zip(variants()) {
                assert_eq!(difference(tree, &oracle, &ray), None, "{params:?}");
            }
        }
    }
    assert!(at_zero > 300, "{at_zero}");
}
