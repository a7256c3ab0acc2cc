//! The nearest point in a tree equals brute force over the same kernel, bit for bit: every layout, division of the
//! shutter, instruction set and kind of primitive.

use crate::brute_force::Brick;
use crate::common::{Random, closed_sphere, divided, grid, soup, variants};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPoint, ClosestPointQuery, Counters, Division, KdParams, MovingSphere, Primitive, RayTree,
    SimdLevel, TimeInterval, TriangleMesh, WideParams, check_primitive,
};
use proptest::prelude::*;

/// All policies, and divisions of the shutter that no automatic choice would make of small sets.
fn all_variants() -> Vec<BuildParams> {
    let divided = [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(2)].map(divided);
    variants().into_iter().chain(divided).collect()
}

fn bits(found: Option<ClosestPoint>) -> Option<([u64; 3], [u32; 5])> {
    found.map(|f| {
        let point = f.point.to_array().map(f64::to_bits);
        (point, [f.distance.to_bits(), f.u.to_bits(), f.v.to_bits(), f.mesh, f.primitive])
    })
}

/// Compares one query on every instruction set.
fn agree(trees: &[RayTree], oracle: &BruteForce, query: ClosestPointQuery) {
    let expected = oracle.closest_point(&query);
    for tree in trees {
        let found = tree.closest_point(&query);
        assert_eq!(bits(found), bits(expected), "{tree:?} {query:?}: {found:?} instead of {expected:?}");
    }
}

/// A tree for each variant and instruction set.
fn trees(meshes: &[TriangleMesh]) -> Vec<RayTree> {
    let build = |params: &BuildParams| RayTree::build(meshes, params).unwrap();
    let mut trees: Vec<RayTree> = all_variants().iter().map(build).collect();
    for level in SimdLevel::available() {
        trees.push(build(&BuildParams::default()).with_simd(level));
    }
    trees
}

/// Queries among objects around the origin of half-size `reach`, some of them far away or with a greatest distance.
fn random_query(random: &mut Random, reach: f32) -> ClosestPointQuery {
    let near = random.vec() * reach;
    let point = if random.below(8) == 0 { near * 1e6 } else { near };
    let query = ClosestPointQuery::new(point, random.unit());
    if random.below(3) == 0 { query.within(random.unit() * reach) } else { query }
}

fn grid_mesh() -> impl Strategy<Value = TriangleMesh> {
    let point = (-3i8..=3, -3i8..=3, -3i8..=3).prop_map(|(x, y, z)| grid(x, y, z));
    (1usize..5, 1usize..12, prop::bool::ANY).prop_flat_map(move |(keys, vertices, always)| {
        let indices = prop::collection::vec((0..vertices as u32, 0..vertices as u32, 0..vertices as u32), 0..20);
        let positions = prop::collection::vec(prop::collection::vec(point.clone(), vertices), keys);
        (indices, positions).prop_map(move |(indices, positions)| {
            let active = if always { TimeInterval::FULL } else { TimeInterval::new(0.25, 0.75).unwrap() };
            TriangleMesh::new(indices.into_iter().map(|(a, b, c)| [a, b, c]).collect(), positions).with_active(active)
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    /// Flat, touching and coincident triangles, with ties everywhere.
    #[test]
    fn soups_on_a_grid(meshes in prop::collection::vec(grid_mesh(), 1..4), seed: u64) {
        let (oracle, trees) = (BruteForce::new(&meshes).unwrap(), trees(&meshes));
        let mut random = Random(seed);
        for _ in 0..20 {
            let mut whole = || f64::from(random.signed() * 5.0).round() / 2.0;
            let point = DVec3::new(whole(), whole(), whole());
            let query = ClosestPointQuery::new(point, (random.unit() * 8.0).round() / 8.0);
            agree(&trees, &oracle, if random.below(2) == 0 { query } else { query.within(1.0) });
        }
    }

    #[test]
    fn loose_soups(seed: u64, n in 1usize..300, keys in 1usize..5, size in 0.001f32..1.0, motion in 0.0f32..2.0) {
        let mesh = soup(n, keys, size, motion, seed);
        let (oracle, trees) = (BruteForce::new(std::slice::from_ref(&mesh)).unwrap(), trees(&[mesh]));
        let mut random = Random(seed ^ 1);
        for _ in 0..30 {
            agree(&trees, &oracle, random_query(&mut random, 2.0));
        }
    }
}

#[test]
fn long_triangles_that_are_cut_and_large_trees() {
    let mut random = Random(4);
    let mut needles = soup(3000, 2, 0.01, 0.1, 9);
    if let mbkd::Keys::F32(keys) = &mut needles.keys {
        let by: Vec<Vec3> = (0..keys[0].len() / 3).map(|_| random.vec()).collect();
        for key in keys {
            for (corners, by) in key.chunks_exact_mut(3).zip(&by) {
                corners[1] += *by;
            }
        }
    }
    let meshes = [needles, closed_sphere(40, 3, 0.01, 5), soup(2000, 1, 0.1, 0.0, 6)];
    let oracle = BruteForce::new(&meshes).unwrap();
    let trees: Vec<RayTree> = [
        BuildParams::wide(WideParams { max_references: 4.0, ..WideParams::default() }),
        divided(Division::SharedLeaves(4)),
        BuildParams::kd(KdParams::default()),
    ]
    .iter()
    .map(|params| RayTree::build(&meshes, params).unwrap())
    .collect();
    for _ in 0..400 {
        agree(&trees, &oracle, random_query(&mut random, 1.5));
    }
    // Far fewer triangles are tested than there are.
    let mut work = Counters::default();
    for _ in 0..100 {
        trees[0].closest_point_observed(&ClosestPointQuery::new(random.vec(), random.unit()), &mut work);
    }
    assert!(work.primitive_tests < 100 * 100 && work.nodes > 100, "{work:?}");
}

/// Leaf blocks rule out most triangles in f32: about one is decided in f64 for each leaf that has a nearer one.
#[test]
fn few_triangles_are_decided_in_f64() {
    let mut random = Random(7);
    for (meshes, near, anywhere) in [
        (vec![closed_sphere(60, 2, 0.01, 5)], 2.0, 6.0),
        (vec![soup(4000, 2, 0.05, 0.1, 6)], 2.0, 2.5),
        (vec![soup(4000, 1, 0.05, 0.0, 6)], 2.0, 2.5),
    ] {
        let tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
        let triangles = meshes[0].len();
        let mut tests = |point: &mut dyn FnMut(&mut Random, f32) -> Vec3| {
            let mut work = Counters::default();
            for _ in 0..1000 {
                let time = random.unit();
                let query = ClosestPointQuery::new(point(&mut random, time), time);
                tree.closest_point_observed(&query, &mut work);
            }
            work.primitive_tests as f64 / 1000.0
        };
        let at_surface = tests(&mut |random, time| {
            let primitive = random.below(triangles) as u32;
            let [a, b, c] = tree.vertices(&mbkd::Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive }, time);
            ((a + b + c) / 3.0).as_vec3() + random.vec() * 0.02
        });
        let at_any = tests(&mut |random, _| random.vec());
        assert!(at_surface < near && at_any < anywhere, "{at_surface} {at_any} tests per query");
    }
}

/// Squares of such distances overflow in f32, and all distances are the same, so the lowest id wins.
#[test]
fn from_very_far_away_ties_go_to_the_lowest_id() {
    let mut random = Random(5);
    let meshes = [soup(200, 2, 0.1, 0.1, 3), closed_sphere(12, 1, 0.0, 4)];
    let (triangles, trees) = (BruteForce::new(&meshes).unwrap(), trees(&meshes));
    let balls: Vec<MovingSphere> =
        (0..200).map(|_| MovingSphere::fixed(random.vec().as_dvec3() * 4.0, f64::from(random.unit()))).collect();
    let spheres = BruteForce::of_scene(&[], balls.clone()).unwrap();
    let of_spheres: Vec<_> = SimdLevel::available()
        .into_iter()
        .map(|level| RayTree::of_scene(&[], balls.clone(), &BuildParams::default()).unwrap().with_simd(level))
        .collect();
    for exponent in 4..30 {
        for _ in 0..3 {
            let point = random.vec().as_dvec3() * 10f64.powi(exponent);
            let query = ClosestPointQuery::new(point, random.unit());
            agree(&trees, &triangles, query);
            agree(&of_spheres, &spheres, query);
        }
    }
}

#[test]
fn points_on_the_surface_are_at_distance_zero() {
    let mesh = soup(400, 2, 0.3, 0.5, 12);
    let tree = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::default()).unwrap();
    let mut random = Random(2);
    for i in 0..500 {
        let at_key = i % 3 == 0;
        let time = if at_key { random.below(2) as f32 } else { random.unit() };
        let hit = mbkd::Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive: random.below(400) as u32 };
        let [a, b, c] = tree.vertices(&hit, time);
        // Between keys corners are as rays meet them, and those of closest points are rounded to f32, at which the distance is zero
        // (`corners_are_at_distance_zero_at_all_times` in src/ray).
        let within = if at_key { 0.0 } else { 3e-7 };
        let corner = tree.closest_point(&ClosestPointQuery::new(a, time).within(within)).unwrap();
        assert!((corner.point - a).length() <= f64::from(within) && corner.distance <= within);
        let middle = tree.closest_point(&ClosestPointQuery::new((a + b + c) / 3.0, time).within(1e-6)).unwrap();
        assert!(middle.distance < 1e-7, "{middle:?}");
    }
}

#[test]
fn spheres_and_custom_primitives() {
    let mut random = Random(17);
    let balls: Vec<MovingSphere> = (0..300)
        .map(|i| {
            let key = |random: &mut Random| ((random.vec() * 4.0).as_dvec3().round(), f64::from(random.unit()));
            let ball = MovingSphere::new((0..1 + i % 3).map(|_| key(&mut random)).collect());
            if i % 5 == 0 { ball.with_active(TimeInterval::new(0.25, 0.75).unwrap()) } else { ball }
        })
        .chain([MovingSphere::new(vec![]), MovingSphere::fixed(DVec3::ONE, 0.0)])
        .collect();
    let bricks: Vec<Brick> = (0..300)
        .map(|_| {
            let low = (random.vec() * 4.0).round().as_dvec3();
            Brick::new(low, f64::from(random.signed()) * 3.0)
        })
        .collect();
    balls.iter().take(30).for_each(|ball| check_primitive(ball, 300).unwrap());
    bricks.iter().take(30).for_each(|brick| check_primitive(brick, 300).unwrap());
    fn compare<P: Primitive + Clone + 'static>(primitives: &[P], random: &mut Random) {
        let oracle = BruteForce::of_scene(&[], primitives.to_vec()).unwrap();
        let build = |params| RayTree::of_scene(&[], primitives.to_vec(), params).unwrap();
        let trees: Vec<_> = all_variants().iter().map(build).collect();
        for _ in 0..300 {
            agree(&trees, &oracle, random_query(random, 6.0));
        }
    }
    compare(&balls, &mut random);
    compare(&bricks, &mut random);
    let ball = RayTree::of_scene(&[], vec![MovingSphere::fixed(DVec3::X, 2.0)], &BuildParams::default()).unwrap();
    let distance = |at: DVec3| ball.closest_point(&ClosestPointQuery::new(at, 0.0)).unwrap().distance;
    assert_eq!((distance(DVec3::X * 4.0), distance(DVec3::ZERO), distance(DVec3::X)), (1.0, 1.0, 2.0));
}

#[test]
fn queries_out_of_range_find_nothing() {
    for params in [BuildParams::default(), BuildParams::kd(KdParams::default())] {
        let mesh = soup(50, 2, 0.5, 0.5, 1);
        let tree = RayTree::build(&[mesh], &params).unwrap();
        let query = |x: f64, time: f32, most: f32| {
            tree.closest_point(&ClosestPointQuery::new(DVec3::new(x, 0.0, 0.0), time).within(most))
        };
        for (x, time, most) in [
            (f64::NAN, 0.5, 1.0),
            (f64::INFINITY, 0.5, f32::INFINITY),
            (1e31, 0.5, f32::INFINITY),
            (0.0, -0.1, 9.0),
            (0.0, 1.1, 9.0),
            (0.0, f32::NAN, 9.0),
            (0.0, 0.5, -1.0),
            (0.0, 0.5, f32::NAN),
            (5.0, 0.5, 1.0),
        ] {
            assert_eq!(query(x, time, most), None, "{x} {time} {most}");
        }
        let far = query(1e30, 0.5, f32::INFINITY).unwrap();
        assert!((far.distance - 1e30).abs() < 1e24);
        assert!(query(0.0, 0.5, f32::INFINITY).is_some() && query(0.0, 1.0, f32::MAX).is_some());
        let nothing = RayTree::build(&[], &params).unwrap();
        assert_eq!(nothing.closest_point(&ClosestPointQuery::new(Vec3::ZERO, 0.5)), None);
    }
}

#[test]
fn masks_filters_and_batches() {
    let meshes: Vec<TriangleMesh> = (0..4).map(|i| soup(150, 2, 0.3, 0.5, 50 + i).with_mask(1 << i)).collect();
    let oracle = BruteForce::new(&meshes).unwrap();
    let mut random = Random(3);
    let queries: Vec<ClosestPointQuery> = (0..700).map(|_| random_query(&mut random, 1.5)).collect();
    for params in all_variants() {
        let tree = RayTree::build(&meshes, &params).unwrap();
        let mut answers = vec![None; 3];
        tree.closest_points(&queries, &mut answers);
        assert_eq!(answers.len(), queries.len());
        for (i, (query, answer)) in (0..).zip(queries.iter().zip(answers)) {
            assert_eq!(bits(answer), bits(tree.closest_point(query)));
            let odd = |p: &ClosestPoint| p.primitive % 2 == 1;
            let found = tree.closest_point_filtered(query, i % 16, odd);
            assert_eq!(bits(found), bits(oracle.closest_point_filtered(query, i % 16, odd)));
            let seen = oracle.closest_point_filtered(query, i % 16, |_| true);
            assert_eq!(bits(tree.closest_point_masked(query, i % 16)), bits(seen));
        }
        let accept = |i: usize, p: &ClosestPoint| p.primitive as usize % 5 != i % 5;
        let mut filtered = vec![None; 9];
        tree.closest_points_filtered(&queries, 0b110, accept, &mut filtered);
        assert_eq!(filtered.len(), queries.len());
        for (i, (query, answer)) in queries.iter().zip(filtered).enumerate() {
            assert_eq!(bits(answer), bits(tree.closest_point_filtered(query, 0b110, |p| accept(i, p))));
        }
        let mut masked = vec![None; 9];
        tree.closest_points_masked(&queries, 0b110, &mut masked);
        assert_eq!(masked.len(), queries.len());
        for (query, answer) in queries.iter().zip(masked) {
            assert_eq!(bits(answer), bits(tree.closest_point_masked(query, 0b110)));
        }
    }
}

/// Keys at -0 are +0 in between or not, as a layout interpolates them, which answers do not show.
#[test]
fn signs_of_zeros_do_not_reach_the_answers() {
    let mut random = Random(23);
    for _ in 0..300 {
        let mut corner = || Vec3::from([0; 3].map(|_| [0.0, -0.0, -0.0, 0.7, -0.3][random.below(5)]));
        let first: Vec<Vec3> = (0..9).map(|_| corner()).collect();
        let last: Vec<Vec3> = first.iter().enumerate().map(|(i, &p)| if i % 3 == 0 { corner() } else { p }).collect();
        let mesh = TriangleMesh::new(vec![[0, 1, 2], [3, 4, 5], [6, 7, 8], [1, 4, 7]], vec![first.clone(), last]);
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        let trees: Vec<RayTree> =
            variants().iter().map(|params| RayTree::build(std::slice::from_ref(&mesh), params).unwrap()).collect();
        // Above edges, where a weight is zero.
        for _ in 0..60 {
            let [a, b] = [0; 2].map(|_| first[random.below(9)]);
            let point = a + (b - a) * random.unit() + Vec3::AXES[random.below(3)] * random.signed();
            agree(&trees, &oracle, ClosestPointQuery::new(point, 0.75));
        }
    }
}
