//! Bad and hostile input: a typed error with the cause and the place, or a documented harmless answer.

use crate::common::{Random, difference, divided, grid, mapped_to_f64, random_ray, soup, variants};
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicU32, Ordering};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Aabb, BuildError, BuildParams, Division, Intersection, KdParams, LinearBounds, MovingSphere, Policy, Primitive,
    Ray, RayTree, Shape, TimeInterval, TriangleMesh, WideParams,
};

fn build(mesh: TriangleMesh) -> Result<RayTree, BuildError> {
    RayTree::build(&[TriangleMesh::fixed(vec![], vec![]), mesh], &BuildParams::default())
}

fn corners() -> Vec<Vec3> {
    vec![Vec3::ZERO, Vec3::X, Vec3::Y]
}

#[test]
fn wrong_meshes_are_named() {
    let one = || vec![[0, 1, 2]];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut positions = corners();
        positions[2].z = bad;
        let mesh = TriangleMesh::new(one(), vec![corners(), positions]);
        assert_eq!(build(mesh).unwrap_err(), BuildError::NonFinite { mesh: 1, key: 1, vertex: 2 });
    }
    let error = build(TriangleMesh::fixed(vec![[0, 1, 2], [0, 1, 3]], corners())).unwrap_err();
    assert_eq!(error, BuildError::IndexOutOfRange { mesh: 1, triangle: 1, index: 3, vertices: 3 });
    assert!(error.to_string().contains("triangle 1 names vertex 3"));
    let error = build(TriangleMesh::new(one(), vec![corners(), vec![Vec3::ZERO; 2]])).unwrap_err();
    assert_eq!(error, BuildError::KeyLength { mesh: 1, key: 1, expected: 3, found: 2 });
    let error = build(TriangleMesh::new(one(), Vec::<Vec<Vec3>>::new())).unwrap_err();
    assert_eq!(error, BuildError::NoKeys { mesh: 1 });
    let far = vec![vec![DVec3::ZERO, DVec3::X, DVec3::Y * 2e30]];
    assert_eq!(build(TriangleMesh::new(one(), far)).unwrap_err(), BuildError::TooLarge { mesh: 1, key: 0, vertex: 2 });
    for (begin, end) in [(0.7, 0.3), (0.5, 0.5), (f32::NAN, 1.0), (-0.5, 0.5), (0.5, 1.5)] {
        assert!(TimeInterval::new(begin, end).is_err());
    }
}

#[test]
fn nothing_and_next_to_nothing() {
    let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
    for params in variants() {
        for meshes in [vec![], vec![TriangleMesh::fixed(vec![], vec![])]] {
            let tree = RayTree::build(&meshes, &params).unwrap();
            assert_eq!(tree.validate(), Ok(()));
            assert_eq!((tree.closest_hit(&ray), tree.any_hit(&ray)), (None, false));
            assert_eq!(tree.statistics().references_per_primitive(), 0.0);
        }
        let none = RayTree::of_scene(&[], Vec::<MovingSphere>::new(), &params).unwrap();
        assert_eq!(none.closest_hit(&ray), None);
        let meshes = [TriangleMesh::fixed(vec![[0, 1, 2]], corners())];
        let (tree, oracle) = (RayTree::build(&meshes, &params).unwrap(), BruteForce::new(&meshes).unwrap());
        assert_eq!(tree.closest_hit(&ray).unwrap().t, 1.0);
        assert_eq!(difference(&tree, &oracle, &ray), None);
    }
}

#[test]
fn rays_that_mean_nothing_hit_nothing() {
    let good = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
    let nan = f32::NAN;
    let bad = [
        Ray { dir: Vec3::ZERO, ..good },
        Ray { dir: -Vec3::ZERO, ..good },
        Ray { dir: Vec3::new(0.0, nan, 1.0), ..good },
        Ray { dir: Vec3::new(0.0, 0.0, f32::INFINITY), ..good },
        Ray { origin: DVec3::new(f64::NAN, 0.0, 0.0), ..good },
        Ray { origin: DVec3::new(0.0, f64::INFINITY, 0.0), ..good },
        Ray { origin: DVec3::new(0.0, 0.0, -1e200), ..good },
        good.between(3.0, 2.0),
        good.between(nan, 2.0),
        good.between(0.0, nan),
        good.at_time(-0.0001),
        good.at_time(1.0001),
        good.at_time(nan),
        good.at_time(f32::INFINITY),
    ];
    let mesh = TriangleMesh::new(vec![[0, 1, 2]], vec![corners(), corners()]);
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    for params in variants() {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        assert!(tree.any_hit(&good));
        for ray in &bad {
            assert_eq!((tree.closest_hit(ray), tree.any_hit(ray)), (None, false), "{ray:?}");
            assert_eq!(tree.all_hits(ray, |_| ControlFlow::Break(())), ControlFlow::Continue(()));
            assert_eq!(oracle.closest_hit(ray), None);
        }
        // Odd, but meaningful: these must answer like brute force.
        for ray in [
            Ray { dir: Vec3::new(0.0, -0.0, 1e-42), ..good },
            Ray { dir: Vec3::new(-0.0, 0.0, 3e38), ..good },
            good.between(f32::NEG_INFINITY, f32::INFINITY),
            good.between(f32::INFINITY, f32::INFINITY),
            good.between(1.0, 1.0),
            Ray { origin: DVec3::new(0.2, 0.2, -1e9), ..good },
        ] {
            assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
        }
    }
}

#[test]
fn hits_of_another_tree_have_no_corners() {
    let tree = build(TriangleMesh::fixed(vec![[0, 1, 2]], corners())).unwrap();
    for (mesh, primitive) in [(0, 0), (1, 1), (2, 0), (u32::MAX, u32::MAX)] {
        let hit = mbkd::Hit { t: 0.0, u: 0.0, v: 0.0, mesh, primitive };
        assert!(tree.vertices(&hit, 0.5)[0].is_nan() && tree.triangle_normal(&hit, 0.5) == Vec3::ZERO);
    }
}

/// Checks that the tree of a scene is valid and a few rays agree with brute force.
fn survives(mesh: TriangleMesh, reach: f32) {
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    for params in variants() {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        let s = tree.statistics();
        let most = match params.policy {
            // With early split clipping, and with several trees for parts of the shutter.
            Policy::Wide(_) | Policy::Lazy(_) => 8.0,
            Policy::Kd(kd) => kd.max_references,
            _ => unreachable!("{params:?}"),
        };
        assert!(s.references <= (mesh.len() as f32 * most) as usize && s.depth <= 60, "{s:?}");
        let mut random = Random(4);
        for _ in 0..30 {
            assert_eq!(difference(&tree, &oracle, &random_ray(&mut random, reach)), None, "{params:?}");
        }
    }
}

#[test]
fn thousands_at_one_place() {
    let n = 5000;
    let same = |positions: Vec<Vec<Vec3>>| TriangleMesh::new(vec![[0, 1, 2]; n], positions);
    survives(same(vec![corners()]), 1.0);
    survives(same(vec![corners(), corners().iter().map(|p| p + Vec3::ONE * 3.0).collect()]), 3.0);
    survives(same(vec![vec![Vec3::ONE; 3]]), 1.0);
    survives(same(vec![vec![Vec3::ONE; 3], vec![Vec3::X; 3]]), 1.0);
    survives(same(vec![vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0]]), 2.0);
}

#[test]
fn everything_crosses_everything() {
    // Long triangles through one point, and small ones that fly across the whole scene.
    survives(soup(2000, 1, 50.0, 0.0, 3), 60.0);
    survives(soup(2000, 2, 0.05, 40.0, 4), 40.0);
    survives(soup(500, 9, 0.05, 10.0, 5), 20.0);
}

#[test]
fn flat_scenes() {
    for axis in 0..3 {
        let mut random = Random(axis as u64);
        let flatten = |mut p: Vec3| {
            p[axis] = 0.0;
            p
        };
        let positions: Vec<Vec<Vec3>> = (0..2).map(|_| (0..900).map(|_| flatten(random.vec())).collect()).collect();
        survives(TriangleMesh::new((0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions), 1.0);
    }
    // A tiled floor: every ray in a plane of tile edges.
    let vertices: Vec<Vec3> = (0..=20).flat_map(|y| (0..=20).map(move |x| grid(x, y, 0))).collect();
    let mut indices = Vec::new();
    for y in 0..20 {
        for x in 0..20 {
            let a = y * 21 + x;
            indices.extend([[a, a + 1, a + 21], [a + 1, a + 22, a + 21]]);
        }
    }
    let meshes = [TriangleMesh::fixed(indices, vertices)];
    let oracle = BruteForce::new(&meshes).unwrap();
    for params in variants() {
        let tree = RayTree::build(&meshes, &params).unwrap();
        for x in 0..=20i8 {
            for y in 0..=20i8 {
                let from = grid(x, y, 5);
                for dir in [Vec3::NEG_Z, Vec3::new(-0.0, 0.0, -2.0), Vec3::new(0.0, 1.0, -5.0), Vec3::X] {
                    assert_eq!(difference(&tree, &oracle, &Ray::new(from, dir)), None, "{params:?}");
                    assert_eq!(difference(&tree, &oracle, &Ray::new(grid(x, y, 0), dir)), None, "{params:?}");
                }
            }
        }
    }
}

#[test]
fn huge_tiny_and_far_away() {
    for (scale, away) in [(1e-30, 0.0), (1e-12, 1.0), (1e6, 1e12), (1e28, 0.0), (1.0, 1e9)] {
        let mesh = soup(200, 2, 0.3, 0.5, 2);
        let keys = mapped_to_f64(&mesh, |p| p * scale + DVec3::splat(away));
        let mesh = TriangleMesh::new(mesh.indices.clone(), keys);
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        for params in variants() {
            let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
            assert_eq!(tree.validate(), Ok(()));
            let (mut random, mut hits) = (Random(5), 0);
            for _ in 0..300 {
                let ray = random_ray(&mut random, 1.0);
                let ray = Ray { origin: ray.origin * scale + DVec3::splat(away), ..ray };
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?} at scale {scale}");
                hits += u32::from(tree.any_hit(&ray));
            }
            assert!(hits > 50 || scale < 1e-9, "{hits} hits at scale {scale}, {away}");
        }
    }
}

/// Beside something of size 1 these are denormal numbers, whose boxes cannot be padded.
#[test]
fn next_to_nothing_beside_the_rest_is_in_its_boxes() {
    for seed in 0..60 {
        let mut random = Random(seed);
        let mut key = || -> Vec<Vec3> { (0..6).map(|_| random.vec() * 1e-40).collect() };
        let tiny = TriangleMesh::new(vec![[0, 1, 2], [3, 4, 5]], vec![key(), key(), key()]);
        let meshes = [tiny, TriangleMesh::fixed(vec![[0, 1, 2]], corners())];
        let oracle = BruteForce::new(&meshes).unwrap();
        for division in [Division::Whole, Division::SharedLeaves(8), Division::SeparateTrees(8)] {
            let tree = RayTree::build(&meshes, &divided(division)).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{division:?}, seed {seed}");
            let mut random = Random(seed);
            for _ in 0..10 {
                let ray = random_ray(&mut random, 1.0);
                let ray = Ray { dir: -ray.origin.as_vec3(), ..ray };
                assert_eq!(difference(&tree, &oracle, &ray), None, "{division:?}, seed {seed}");
            }
        }
    }
}

#[test]
fn origins_far_outside() {
    let mesh = soup(500, 2, 0.5, 0.5, 8);
    let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
    for params in variants() {
        let tree = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        let mut random = Random(6);
        for distance in [1e2f32, 1e4, 1e6, 1e8, 3e9] {
            for _ in 0..100 {
                let origin = random.vec() * distance;
                let ray = Ray::new(origin, random.vec() - origin).at_time(random.unit());
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}");
            }
        }
    }
}

/// A primitive that breaks its contract: its bounds depend on the correct ones and on the number of calls.
struct Broken {
    bounds: fn(TimeInterval, u32) -> LinearBounds,
    active: fn(u32) -> TimeInterval,
    calls: AtomicU32,
}

impl Broken {
    fn new(bounds: fn(TimeInterval, u32) -> LinearBounds) -> Broken {
        Broken { bounds, active: |_| TimeInterval::FULL, calls: AtomicU32::new(0) }
    }

    fn calls(&self) -> u32 {
        self.calls.fetch_add(1, Ordering::Relaxed)
    }
}

impl Primitive for Broken {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        (self.bounds)(over, self.calls())
    }
    fn intersect(&self, _: &Ray) -> Option<Intersection> {
        Some(Intersection { t: f32::NAN, u: f32::NAN, v: 0.0 })
    }
    fn active(&self) -> TimeInterval {
        (self.active)(self.calls())
    }
}

/// A box that moves by 5 during the shutter, and its bounds over a part of that.
fn riser(over: TimeInterval) -> LinearBounds {
    let at = |t: f32| Aabb { min: DVec3::splat(5.0 * f64::from(t)), max: DVec3::splat(5.0 * f64::from(t) + 1.0) };
    LinearBounds { begin: at(over.begin()), end: at(over.end()) }
}

/// Sixty good spheres, so that planes and nodes are needed, and broken ones among them.
enum Mixed {
    Good(MovingSphere),
    Bad(Broken),
}

impl Primitive for Mixed {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        match self {
            Mixed::Good(good) => good.bounds(over),
            Mixed::Bad(bad) => bad.bounds(over),
        }
    }
    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        match self {
            Mixed::Good(good) => good.intersect(ray),
            Mixed::Bad(bad) => bad.intersect(ray),
        }
    }
    fn active(&self) -> TimeInterval {
        match self {
            Mixed::Good(good) => good.active(),
            Mixed::Bad(bad) => bad.active(),
        }
    }
}

fn spheres() -> Vec<MovingSphere> {
    let mut random = Random(12);
    let mut place = || (random.vec().as_dvec3() * 4.0, 0.3);
    (0..60).map(|_| MovingSphere::new(vec![place(), place()])).collect()
}

/// The spheres with a broken primitive before each.
fn mixed(bad: impl Fn() -> Broken) -> Vec<Mixed> {
    spheres().into_iter().flat_map(|good| [Mixed::Bad(bad()), Mixed::Good(good)]).collect()
}

fn assert_spheres_are_hit(tree: &RayTree) {
    let oracle = BruteForce::of_scene(&[], spheres()).unwrap();
    let (mut random, mut hits) = (Random(13), 0);
    for _ in 0..200 {
        let ray = random_ray(&mut random, 8.0);
        let expected = oracle.closest_hit(&ray).map(|hit| (hit.primitive * 2 + 1, hit.t));
        assert_eq!(tree.closest_hit(&ray).map(|hit| (hit.primitive, hit.t)), expected);
        hits += u32::from(expected.is_some());
    }
    assert!(hits > 20, "{hits}");
}

#[test]
fn bounds_that_are_no_boxes_are_refused() {
    let nan = |_, _| LinearBounds::fixed(Aabb { min: DVec3::NAN, max: DVec3::NAN });
    let inverted = |_, _| LinearBounds::fixed(Aabb::EMPTY);
    let infinite = |_, _| LinearBounds::fixed(Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY });
    let too_large = |_, _| LinearBounds::fixed(Aabb { min: DVec3::ZERO, max: DVec3::splat(2e30) });
    // Valid at the first call, over the whole shutter, and invalid later: over parts of it, or over any interval.
    let nan_later = |over, call: u32| {
        if call > 1 { LinearBounds::fixed(Aabb { min: DVec3::NAN, ..Aabb::EMPTY }) } else { riser(over) }
    };
    let inverted_later = |over, call: u32| if call > 1 { LinearBounds::fixed(Aabb::EMPTY) } else { riser(over) };
    let infinite_parts = |over, _| {
        let infinite = Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        if over == TimeInterval::FULL { riser(over) } else { LinearBounds { end: infinite, ..riser(over) } }
    };
    for params in variants() {
        for bad in [nan, inverted, infinite, too_large] {
            let error = RayTree::of_scene(&[], vec![Broken::new(bad)], &params).unwrap_err();
            assert_eq!(error, BuildError::BadBounds { primitive: 0 });
        }
        for bad in [nan_later, inverted_later] {
            let shapes = [Mixed::Good(MovingSphere::fixed(DVec3::ZERO, 1.0))];
            let shapes = shapes.into_iter().chain(mixed(|| Broken::new(bad))).collect();
            let error = RayTree::of_scene(&[], shapes, &params).unwrap_err();
            assert_eq!(error, BuildError::BadBounds { primitive: 1 }, "{params:?}");
        }
        // Not every build calls for bounds over parts.
        match RayTree::of_scene(&[], mixed(|| Broken::new(infinite_parts)), &params) {
            Ok(tree) => assert_spheres_are_hit(&tree),
            Err(error) => assert!(matches!(error, BuildError::BadBounds { primitive } if primitive % 2 == 0)),
        }
    }
}

#[test]
fn primitives_that_contradict_themselves_do_no_harm_to_others() {
    // Elsewhere at every call; far outside of its first bounds; larger over a part of the shutter than over the whole.
    let jumping = |_, call: u32| {
        let mut random = Random(u64::from(call) * 7919 + 1);
        let mut place = |size: f64| {
            let p = random.vec().as_dvec3() * 5.0;
            Aabb { min: p, max: p + size }
        };
        LinearBounds { begin: place(0.5), end: place(2.0) }
    };
    let leaving = |over, call: u32| match call {
        0 | 1 => riser(over),
        _ => LinearBounds::fixed(Aabb { min: DVec3::splat(-1e30), max: DVec3::splat(1e30) }),
    };
    let elsewhere = |over, call: u32| match call {
        0 | 1 => LinearBounds::fixed(Aabb { min: DVec3::ZERO, max: DVec3::splat(1e-9) }),
        _ => LinearBounds { begin: Aabb { min: DVec3::splat(9.0), max: DVec3::splat(1e29) }, end: riser(over).end },
    };
    let growing = |over: TimeInterval, _| LinearBounds::fixed(riser(over).begin.pad(f64::from(1.0 - over.duration())));
    for params in variants() {
        for bad in [jumping, leaving, elsewhere, growing] {
            for active in [|_| TimeInterval::FULL, |call: u32| flicker(call)] {
                let tree = RayTree::of_scene(&[], mixed(|| Broken { active, ..Broken::new(bad) }), &params).unwrap();
                assert_spheres_are_hit(&tree);
                let _ = tree.validate();
                // Alone they make a scene that is wrong from the start.
                let alone = (0..50).map(|_| Broken { active, ..Broken::new(bad) }).collect();
                let tree = RayTree::of_scene(&[], alone, &params).unwrap();
                assert_eq!(tree.closest_hit(&Ray::new(Vec3::splat(-1.0), Vec3::ONE)), None);
            }
        }
    }
}

/// Another part of the shutter at every call.
fn flicker(call: u32) -> TimeInterval {
    let begin = (call % 7) as f32 / 8.0;
    TimeInterval::new(begin, begin + 0.125).unwrap()
}

/// A sphere at every other call of [`Primitive::as_sphere`].
struct SometimesSphere {
    sphere: MovingSphere,
    /// What it claims to be every other time.
    other: Option<MovingSphere>,
    calls: AtomicU32,
}

impl Primitive for SometimesSphere {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.sphere.bounds(over)
    }
    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        self.sphere.intersect(ray)
    }
    fn as_sphere(&self) -> Option<&MovingSphere> {
        let first = self.calls.fetch_add(1, Ordering::Relaxed).is_multiple_of(2);
        if first { Some(&self.sphere) } else { self.other.as_ref() }
    }
}

#[test]
fn primitives_that_are_spheres_at_times_are_hit_all_the_same() {
    // As another sphere it has more keys, none, or is no sphere.
    for (count, keys, others) in [
        (2, 3, None),
        (3, 2, None),
        (40, 1, None),
        (1000, 3, None),
        (40, 3, Some(5)),
        (1000, 3, Some(5)),
        (40, 2, Some(0)),
    ] {
        let one = |i: usize| {
            let at = |key: usize| (DVec3::new(3.0 * i as f64, (key * key) as f64, 0.0), 1.0);
            let [sphere, other] =
                [Some(keys), others].map(|keys| keys.map(|keys| MovingSphere::new((0..keys).map(at).collect())));
            SometimesSphere { sphere: sphere.unwrap(), other, calls: AtomicU32::new(i as u32) }
        };
        for params in variants() {
            let tree = RayTree::of_scene(&[], (0..count).map(one).collect(), &params).unwrap();
            for i in 0..count {
                let hit = tree.closest_hit(&Ray::new(Vec3::new(3.0 * i as f32, 0.0, 5.0), Vec3::NEG_Z)).unwrap();
                assert_eq!((hit.primitive, hit.t), (i as u32, 4.0));
            }
        }
    }
}

#[test]
fn bad_parameters_are_named() {
    let kd = BuildParams::kd(KdParams { max_references: f32::NAN, ..KdParams::default() });
    let wide = BuildParams::wide(WideParams { max_references: f32::NAN, ..WideParams::default() });
    for params in [kd, wide] {
        // Before the meshes are read.
        let bad_mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![]);
        let error = RayTree::build(&[bad_mesh], &params).unwrap_err();
        assert!(matches!(error, BuildError::Parameter { name: "max_references", .. }), "{error}");
    }
}

#[test]
fn progress_and_cancelling() {
    let mesh = soup(20_000, 2, 0.05, 0.05, 1);
    for params in variants() {
        let told = std::sync::Mutex::new(Vec::new());
        let watch = |fraction: f32| {
            told.lock().unwrap().push(fraction);
            ControlFlow::Continue(())
        };
        let assert_complete = || {
            let told = core::mem::take(&mut *told.lock().unwrap());
            let (last, before) = told.split_last().unwrap();
            assert!(*last == 1.0 && before.iter().all(|done| *done > 0.0 && *done < 1.0), "{params:?}: {told:?}");
            assert!(before.iter().any(|done| *done > 0.3), "{params:?}: {told:?}");
        };
        let tree = RayTree::build_with_progress(std::slice::from_ref(&mesh), &params, &watch).unwrap();
        assert_complete();
        let statistics = tree.statistics();
        // A lazy tree has none before there are queries.
        assert!(statistics.references >= mesh.len() || statistics.subtrees > 0);
        let stop = |_| ControlFlow::Break(());
        let error = RayTree::build_with_progress(std::slice::from_ref(&mesh), &params, &stop).unwrap_err();
        assert_eq!(error, BuildError::Cancelled);

        let balls =
            |i: usize| MovingSphere::new(vec![(DVec3::splat(i as f64), 0.7), (DVec3::splat(i as f64 + 0.5), 0.4)]);
        let shapes = || (0..3000).map(|i| balls(i).into()).collect::<Vec<Shape>>();
        let meshes = std::slice::from_ref(&mesh);
        for meshes in [meshes, &[]] {
            let tree = RayTree::of_scene_with_progress(meshes, shapes(), &params, &watch).unwrap();
            assert_complete();
            assert_eq!(tree.shape_count(), 3000);
            let error = RayTree::of_scene_with_progress(meshes, shapes(), &params, &stop).unwrap_err();
            assert_eq!(error, BuildError::Cancelled);
        }
        let balls = || (0..3000).map(balls).collect::<Vec<_>>();
        let tree = RayTree::of_scene_with_progress(&[], balls(), &params, &watch).unwrap();
        assert_complete();
        assert_eq!(tree.shape_count(), 3000);
        let error = RayTree::of_scene_with_progress(&[], balls(), &params, &stop).unwrap_err();
        assert_eq!(error, BuildError::Cancelled);
    }
}
