//! Every query equals brute force over the same kernel, bit for bit: property tests with shrinking on
//! soups on a grid, where flat, touching and coincident triangles are the rule.

use crate::common::{Random, assert_equal, bits, difference, grid, random_ray, soup, trees, variants};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Aabb, BuildParams, Intersection, KdParams, LinearBounds, MovingSphere, Policy, Primitive, Ray, RayTree,
    SurfacePoint, TimeInterval, TriangleMesh, check_primitive,
};
use proptest::prelude::*;

/// A mesh on a small grid: corners coincide, triangles are flat, in planes, of no area.
fn grid_mesh() -> impl Strategy<Value = TriangleMesh> {
    let point = (-3i8..=3, -3i8..=3, -3i8..=3).prop_map(|(x, y, z)| grid(x, y, z));
    let active = prop_oneof![
        4 => Just(TimeInterval::FULL),
        1 => (0u8..8, 1u8..8).prop_map(|(a, d)| {
            let a = f32::from(a) / 8.0;
            TimeInterval::new(a, (a + f32::from(d) / 8.0).min(1.0)).unwrap()
        }),
    ];
    (1usize..5, 1usize..12).prop_flat_map(move |(keys, vertices)| {
        let indices = prop::collection::vec((0..vertices as u32, 0..vertices as u32, 0..vertices as u32), 0..20);
        let positions = prop::collection::vec(prop::collection::vec(point.clone(), vertices), keys);
        (indices, positions, active.clone()).prop_map(|(indices, positions, active)| {
            TriangleMesh::new(indices.into_iter().map(|(a, b, c)| [a, b, c]).collect(), positions).with_active(active)
        })
    })
}

/// Rays on the same grid, often along an axis, at critical times.
fn grid_ray() -> impl Strategy<Value = Ray> {
    let point = (-5i8..=5, -5i8..=5, -5i8..=5).prop_map(|(x, y, z)| grid(x, y, z));
    let half = prop_oneof![Just(0.0f32), Just(0.5)];
    let direction = prop_oneof![
        3 => (-4i8..=4, -4i8..=4, -4i8..=4).prop_map(|(x, y, z)| grid(x, y, z)),
        1 => (0usize..3, prop::bool::ANY).prop_map(|(axis, negative)| {
            let mut d = Vec3::ZERO;
            d[axis] = 1.0;
            // Negative zeros in the other components.
            if negative { -d } else { d }
        }),
    ];
    let time = prop_oneof![(0u8..=24).prop_map(|t| f32::from(t) / 24.0), 0.0f32..=1.0];
    let range =
        prop_oneof![3 => Just((0.0, f32::INFINITY)), 1 => (-2.0f32..2.0, 0.0f32..4.0).prop_map(|(a, d)| (a, a + d))];
    (point, half, direction, time, range).prop_map(|(origin, half, dir, time, (t_min, t_max))| {
        Ray::new(origin + half, dir).at_time(time).between(t_min, t_max)
    })
}

/// Every time in the shutter at which a corner of the mesh passes a whole coordinate, with its neighbours.
fn crossing_times(mesh: &TriangleMesh) -> Vec<f32> {
    let mbkd::Keys::F32(keys) = &mesh.keys else { return Vec::new() };
    let segments = (keys.len() - 1).max(1) as f32;
    let mut times = Vec::new();
    for (k, pair) in keys.windows(2).enumerate() {
        times.push(k as f32 / segments);
        for (a, b) in pair[0].iter().zip(&pair[1]) {
            for axis in 0..3 {
                if a[axis] != b[axis] {
                    for s in -3i8..=3 {
                        let w = (f32::from(s) - a[axis]) / (b[axis] - a[axis]);
                        let t = (k as f32 + w) / segments;
                        times.extend([t, t.next_up(), t.next_down()].into_iter().filter(|t| (0.0..=1.0).contains(t)));
                    }
                }
            }
        }
    }
    times.sort_by(f32::total_cmp);
    times.dedup();
    times
}

/// Splits eagerly, so that small scenes become deep trees.
fn eager(params: BuildParams) -> BuildParams {
    match params.policy {
        Policy::Kd(kd) => {
            BuildParams::kd(KdParams { intersection_cost: 50.0, max_references: kd.max_references.max(40.0), ..kd })
        }
        _ => params,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn soups_on_a_grid(meshes in prop::collection::vec(grid_mesh(), 1..4), rays in prop::collection::vec(grid_ray(), 24)) {
        let oracle = BruteForce::new(&meshes).unwrap();
        let trees = trees(|params| RayTree::build(&meshes, &eager(*params)).unwrap());
        for (params, tree) in &trees {
            prop_assert_eq!(tree.validate(), Ok(()), "{:?}", params);
        }
        for ray in &rays {
            assert_equal(&trees, &oracle, ray);
        }
    }

    #[test]
    fn at_every_crossing_time(mesh in grid_mesh(), ray in grid_ray()) {
        let times = crossing_times(&mesh);
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        let trees = trees(|params| RayTree::build(std::slice::from_ref(&mesh), &eager(*params)).unwrap());
        for &time in times.iter().chain(&[0.0, 1.0]) {
            assert_equal(&trees, &oracle, &ray.at_time(time));
        }
    }

    #[test]
    fn loose_soups(seed: u64, n in 1usize..300, keys in 1usize..5, size in 0.01f32..1.0, motion in 0.0f32..2.0) {
        let mesh = soup(n, keys, size, motion, seed);
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        let mut random = Random(seed ^ 1);
        let rays: Vec<Ray> = (0..40).map(|_| random_ray(&mut random, 2.0)).collect();
        let trees = trees(|params| RayTree::build(std::slice::from_ref(&mesh), params).unwrap());
        for (params, tree) in &trees {
            prop_assert_eq!(tree.validate(), Ok(()), "{:?}", params);
        }
        for ray in &rays {
            assert_equal(&trees, &oracle, ray);
        }
    }
}

/// Random spheres, some of them on a grid, some for a part of the shutter only.
fn spheres(n: usize, seed: u64) -> Vec<MovingSphere> {
    let mut random = Random(seed);
    (0..n)
        .map(|i| {
            let keys = 1 + random.below(4);
            let on_grid = i % 3 == 0;
            let place = |at: Vec3| if on_grid { (at * 4.0).round().as_dvec3() } else { (at * 4.0).as_dvec3() };
            let keys: Vec<(DVec3, f64)> =
                (0..keys).map(|_| (place(random.vec()), f64::from(random.unit()).max(0.05))).collect();
            let sphere = MovingSphere::new(keys);
            if i % 5 == 0 { sphere.with_active(TimeInterval::new(0.25, 0.75).unwrap()) } else { sphere }
        })
        .collect()
}

#[test]
fn moving_spheres() {
    let balls = spheres(400, 7);
    for ball in balls.iter().take(50) {
        check_primitive(ball, 300).unwrap();
    }
    let oracle = BruteForce::of_scene(&[], balls.clone()).unwrap();
    let trees = trees(|params| RayTree::of_scene(&[], balls.clone(), params).unwrap());
    let mut random = Random(8);
    for i in 0..20_000 {
        let mut ray = random_ray(&mut random, 4.0);
        if i % 4 == 0 {
            // Grazing: aimed at the rim of a sphere.
            let (center, radius) = balls[random.below(balls.len())].at(ray.time);
            let to = center - ray.origin;
            let aside = to.cross(random.vec().as_dvec3()).normalize_or_zero() * radius;
            ray.dir = (to + aside).as_vec3();
        }
        assert_equal(&trees, &oracle, &ray);
    }
    assert!(trees.iter().all(|(_, tree)| tree.shape_count() == balls.len()));
}

/// A custom primitive: an axis-aligned box that rises, hit on its near face.
#[derive(Clone)]
pub struct Brick {
    low: DVec3,
    high: DVec3,
    rise: f64,
}

impl Brick {
    /// A unit cube.
    pub fn new(low: DVec3, rise: f64) -> Brick {
        Brick { low, high: low + DVec3::ONE, rise }
    }

    fn at(&self, time: f32) -> Aabb {
        let up = DVec3::Z * self.rise * f64::from(time);
        Aabb { min: self.low + up, max: self.high + up }
    }
}

impl Primitive for Brick {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        LinearBounds { begin: self.at(over.begin()).pad(1e-7), end: self.at(over.end()).pad(1e-7) }
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        let (b, d) = (self.at(ray.time), ray.dir.as_dvec3());
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            if d[axis] == 0.0 {
                if ray.origin[axis] < b.min[axis] || ray.origin[axis] > b.max[axis] {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((b.min[axis] - ray.origin[axis]) / d[axis], (b.max[axis] - ray.origin[axis]) / d[axis]);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        let t = near as f32;
        (near <= far && ray.t_min <= t && t <= ray.t_max).then_some(Intersection { t, u: 0.0, v: 0.0 })
    }

    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        let Aabb { min, max } = self.at(time);
        Some(SurfacePoint { point: point.clamp(min, max), u: 0.25, v: 0.5 })
    }
}

#[test]
fn custom_primitives() {
    let mut random = Random(17);
    let bricks: Vec<Brick> = (0..300)
        .map(|_| {
            let low = (random.vec() * 4.0).round().as_dvec3();
            Brick::new(low, f64::from(random.signed()) * 3.0)
        })
        .collect();
    check_primitive(&bricks[0], 2000).unwrap();
    let oracle = BruteForce::of_scene(&[], bricks.clone()).unwrap();
    let trees = trees(|params| RayTree::of_scene(&[], bricks.clone(), params).unwrap());
    let mut random = Random(18);
    for _ in 0..5000 {
        assert_equal(&trees, &oracle, &random_ray(&mut random, 5.0));
    }
}

/// Compares queries with masks and a filter in all structures.
fn assert_equal_masked_and_filtered(meshes: &[TriangleMesh], accepts: fn(&mbkd::Hit) -> bool) {
    let oracle = BruteForce::new(meshes).unwrap();
    for params in variants() {
        let tree = RayTree::build(meshes, &params).unwrap();
        let mut random = Random(3);
        for i in 0..4000u32 {
            let ray = random_ray(&mut random, 1.5);
            let mask = i % 16;
            let expected = oracle.closest_hit_filtered(&ray, mask, accepts);
            assert_eq!(tree.closest_hit_filtered(&ray, mask, accepts), expected, "{params:?} {ray:?}");
            let seen = oracle.closest_hit_filtered(&ray, mask, |_| true);
            assert_eq!(tree.closest_hit_masked(&ray, mask), seen, "{params:?} {ray:?}");
            assert_eq!(tree.any_hit_masked(&ray, mask), seen.is_some(), "{params:?} {ray:?}");
            let mut all = [Vec::new(), Vec::new()];
            let [masked, filtered] = &mut all;
            let into = |all: &mut Vec<[u32; 5]>, hit| {
                all.push(bits(hit));
                core::ops::ControlFlow::Continue(())
            };
            let _ = tree.all_hits_masked(&ray, mask, |hit| into(masked, hit));
            let _ = tree.all_hits_filtered(&ray, mask, |_| true, |hit| into(filtered, hit));
            all.iter_mut().for_each(|hits| hits.sort());
            assert_eq!(all[0], all[1], "{params:?} {ray:?}");
            assert_eq!(all[0].is_empty(), seen.is_none(), "{params:?} {ray:?}");
            assert_eq!(tree.any_hit_filtered(&ray, mask, accepts), expected.is_some());
            let mut best = None::<mbkd::Hit>;
            let _ = tree.all_hits_filtered(&ray, mask, accepts, |hit| {
                if best.is_none_or(|b| (hit.t, hit.mesh, hit.primitive) < (b.t, b.mesh, b.primitive)) {
                    best = Some(hit);
                }
                core::ops::ControlFlow::Continue(())
            });
            assert_eq!(best, expected);
        }
    }
}

#[test]
fn masks_and_filters_equal_brute_force() {
    let meshes: Vec<TriangleMesh> = (0..4).map(|i| soup(150, 2, 0.3, 0.5, 50 + i).with_mask(1 << i)).collect();
    assert_equal_masked_and_filtered(&meshes, |hit| hit.primitive % 2 == 1);
}

#[test]
fn copies_of_a_mesh_in_one_place_equal_brute_force() {
    for keys in 1..=3 {
        let mesh = soup(8, keys, 1.0, 0.5, 70);
        let some = TimeInterval::new(0.25, 0.75).unwrap();
        let copy = |i: usize| {
            let active = if i.is_multiple_of(5) { some } else { TimeInterval::FULL };
            mesh.clone().with_mask(1 << (i % 4)).with_active(active)
        };
        let meshes: Vec<TriangleMesh> = (0..40).map(copy).collect();
        assert_equal_masked_and_filtered(&meshes, |hit| hit.mesh % 7 > 3);
        let (tree, oracle) =
            (RayTree::build(&meshes, &BuildParams::default()).unwrap(), BruteForce::new(&meshes).unwrap());
        let (mut random, mut hits) = (Random(9), 0);
        for _ in 0..4000 {
            let ray = random_ray(&mut random, 1.5);
            assert_eq!(difference(&tree, &oracle, &ray), None);
            hits += usize::from(tree.closest_hit(&ray).is_some());
        }
        assert!(hits > 400, "{hits}");
    }
}

#[test]
fn rays_that_begin_behind_their_origin() {
    let mut random = Random(31);
    let meshes = [soup(300, 2, 0.2, 0.3, 7), soup(300, 1, 0.2, 0.0, 8)];
    let oracle = BruteForce::new(&meshes).unwrap();
    for params in [BuildParams::default(), BuildParams::kd(KdParams::default())] {
        let tree = RayTree::build(&meshes, &params).unwrap();
        let mut behind = 0;
        for i in 0..4000 {
            let begin = [-0.0, -0.3, -3.0, -1e6, f32::MIN, f32::NEG_INFINITY][i % 6];
            let end = [f32::INFINITY, 0.5, 0.0, -0.0, -0.1, -2.0, f32::MIN][i % 7].max(begin);
            let ray = random_ray(&mut random, 0.5).between(begin, end);
            assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
            behind += usize::from(tree.closest_hit(&ray).is_some_and(|hit| hit.t < 0.0));
        }
        assert!(behind > 100, "{behind}");
    }
}

#[test]
fn all_hits_stops_when_told() {
    let mesh = soup(300, 2, 2.0, 0.1, 5);
    for params in [KdParams::default(), KdParams::classic()] {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::kd(params)).unwrap();
        let ray = Ray::new(Vec3::new(-5.0, 0.1, 0.1), Vec3::X);
        let mut seen = 0;
        let flow = tree.all_hits(&ray, |_| {
            seen += 1;
            if seen == 3 { core::ops::ControlFlow::Break(()) } else { core::ops::ControlFlow::Continue(()) }
        });
        assert!(flow.is_break() && seen == 3, "{seen}");
    }
}

/// Triangles that move within a line: between the keys their corners are in it only up to rounding, and a weight that is nothing
/// but rounding would put a hit anywhere on the line.
#[test]
fn triangles_in_a_line_are_hit_only_where_a_ray_meets_it() {
    let mut random = Random(32);
    for _ in 0..300 {
        // Without rounding, so that corners at the keys are exactly in a line.
        let line = Vec3::from([(); 3].map(|()| random.below(4) as f32));
        let mut on_line = || (0..3).map(|_| line * (random.below(4096) as f32 / 2048.0)).collect::<Vec<Vec3>>();
        let (mut open, mut close) = (on_line(), on_line());
        for i in 0..16 {
            let other = [Vec3::ZERO, Vec3::Y, Vec3::Z].map(|p| p + Vec3::X * (4.0 + i as f32));
            open.extend(other);
            close.extend(other);
        }
        let indices = (0..17).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let meshes = [TriangleMesh::new(indices, vec![open, close])];
        let oracle = BruteForce::new(&meshes).unwrap();
        for params in variants() {
            let tree = RayTree::build(&meshes, &params).unwrap();
            for i in 0..40 {
                let place = line.as_dvec3() * f64::from(random.unit() * 2.0);
                let direction = random.vec();
                let origin = if i % 2 == 0 { place } else { place - direction.as_dvec3() };
                let ray = Ray::new(origin, direction).at_time(random.unit()).between(0.01, f32::INFINITY);
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
            }
        }
    }
}
