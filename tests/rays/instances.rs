//! Trees of instances against brute force with the rays transformed into the spaces of the instances.

use super::common::{Random, bits, soup, variants};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Counters, Division, Instance, InstanceError, InstanceHit, InstanceOf, InstanceTree,
    MAX_NESTING, MovingSphere, Pose, Ray, RayTree, Shape, SimdLevel, TimeInterval, Transform, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// A placed tree, and brute force over its primitives.
#[derive(Clone)]
enum Brute {
    Tree(Arc<BruteForce>),
    Instances(Arc<Placed>),
}

/// A tree of instances with the data that brute force needs.
struct Placed {
    tree: Arc<InstanceTree>,
    instances: Vec<(Brute, u32, TimeInterval)>,
}

type Found = (Vec<u32>, [u32; 5]);

fn name(hit: InstanceHit) -> Found {
    (hit.path.to_vec(), bits(hit.hit))
}

impl Placed {
    fn new(instances: Vec<(Instance, Brute)>, params: &WideParams) -> Placed {
        let of = instances.iter().map(|(i, brute)| (brute.clone(), i.mask, i.active)).collect();
        let tree = InstanceTree::build(instances.into_iter().map(|(i, _)| i).collect(), params).unwrap();
        tree.validate().unwrap();
        Placed { tree: Arc::new(tree), instances: of }
    }

    /// All hits, or with a mask the nearest of each instance that it lets through.
    fn hits(&self, ray: &Ray, mask: Option<u32>) -> Vec<Found> {
        let mut all = Vec::new();
        for (i, (of, own, active)) in self.instances.iter().enumerate() {
            if !active.contains(ray.time) || mask.is_some_and(|mask| mask & own == 0) {
                continue;
            }
            let Some(local) = self.tree.local_ray(i as u32, ray) else { continue };
            match (of, mask) {
                (Brute::Tree(of), None) => {
                    all.extend(of.all_hits(&local).into_iter().map(|h| (vec![i as u32], bits(h))))
                }
                (Brute::Tree(of), Some(mask)) => {
                    all.extend(of.closest_hit_filtered(&local, mask, |_| true).map(|h| (vec![i as u32], bits(h))));
                }
                (Brute::Instances(of), mask) => {
                    let below = of.hits(&local, mask).into_iter();
                    all.extend(below.map(|(path, hit)| ([vec![i as u32], path].concat(), hit)));
                }
            }
        }
        all
    }

    /// The nearest of some hits; of several the first path and the lowest primitive.
    fn closest(hits: &[Found]) -> Option<Found> {
        let order = |hit: &Found| (f32::from_bits(hit.1[0]), hit.0.clone(), hit.1[3], hit.1[4]);
        hits.iter().min_by(|a, b| order(a).partial_cmp(&order(b)).unwrap()).cloned()
    }

    /// Compares all queries, and returns whether there is a hit.
    fn check(&self, ray: &Ray, mask: u32) -> bool {
        let mut expected = self.hits(ray, None);
        expected.sort();
        let nearest = Placed::closest(&expected);
        assert_eq!(self.tree.closest_hit(ray).map(name), nearest, "{ray:?}");
        assert_eq!(self.tree.any_hit(ray), nearest.is_some(), "{ray:?}");
        let mut all = Vec::new();
        let flow = self.tree.all_hits(ray, |hit| {
            all.push(name(hit));
            ControlFlow::Continue(())
        });
        all.sort();
        assert!(flow.is_continue());
        assert_eq!(all, expected, "{ray:?}");
        let masked = self.hits(ray, Some(mask));
        let found = self.tree.closest_hit_filtered(ray, mask, |_| true).map(name);
        assert_eq!(found, Placed::closest(&masked), "{ray:?} {mask:b}");
        assert_eq!(self.tree.any_hit_filtered(ray, mask, |_| true), found.is_some());
        assert_eq!(self.tree.closest_hit_masked(ray, mask).map(name), found);
        assert_eq!(self.tree.any_hit_masked(ray, mask), found.is_some());
        let mut all = [Vec::new(), Vec::new()];
        let [by_mask, by_filter] = &mut all;
        let into = |all: &mut Vec<Found>, hit| {
            all.push(name(hit));
            ControlFlow::Continue(())
        };
        let _ = self.tree.all_hits_masked(ray, mask, |hit| into(by_mask, hit));
        let _ = self.tree.all_hits_filtered(ray, mask, |_| true, |hit| into(by_filter, hit));
        all.iter_mut().for_each(|hits| hits.sort());
        assert_eq!(all[0], all[1], "{ray:?} {mask:b}");
        assert_eq!(Placed::closest(&all[0]), found, "{ray:?} {mask:b}");
        nearest.is_some()
    }
}

/// Trees of loose triangles and a sphere about the origin, of half size 1, in all layouts, with brute force.
fn prototypes() -> Vec<(InstanceOf, Brute)> {
    let mut all = Vec::new();
    for (i, params) in variants().into_iter().take(3).enumerate() {
        for keys in [1, 2, 5] {
            let meshes = [soup(60, keys, 0.3, 0.1, 7 + i as u64), soup(9, 1, 0.5, 0.0, 8).with_mask(0b10)];
            let ball = || vec![Shape::from(MovingSphere::fixed(DVec3::new(0.2, 0.5, -0.1), 0.3))];
            let tree = RayTree::of_scene(&meshes, ball(), &params).unwrap();
            let brute = Brute::Tree(Arc::new(BruteForce::of_scene(&meshes, ball()).unwrap()));
            all.push((InstanceOf::Tree(Arc::new(tree)), brute));
        }
    }
    all
}

fn dvec(random: &mut Random) -> DVec3 {
    random.vec().as_dvec3()
}

fn pose(random: &mut Random, scale: f64, apart: f64) -> Pose {
    let axis = dvec(random).try_normalize().unwrap_or(DVec3::X);
    Pose {
        scale: (dvec(random) * 0.6 + 1.0) * scale,
        rotation: DQuat::from_axis_angle(axis, f64::from(random.signed()) * 3.1),
        translation: dvec(random) * apart,
    }
}

/// Static, moving on lines, and on arcs; upright, mirrored and sheared.
fn transform(random: &mut Random, scale: f64, apart: f64) -> Transform {
    let first = pose(random, scale, apart);
    match random.below(5) {
        0 => first.into(),
        1 => {
            let mirrored = first.matrix() * DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0));
            let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.7, 1.0, 0.2), DVec3::Z);
            Transform::from(mirrored * DAffine3::from_mat3(shear))
        }
        2 => {
            let keys = (0..2 + random.below(3)).map(|_| {
                let mut key = first.matrix();
                key.matrix3.x_axis += key.matrix3.y_axis * f64::from(random.signed());
                key.translation += dvec(random) * scale;
                key
            });
            keys.collect::<Vec<_>>().into()
        }
        _ => {
            let keys = 2 + random.below(3);
            let mut poses: Vec<Pose> = (0..keys).map(|_| pose(random, scale, scale)).collect();
            poses.iter_mut().for_each(|key| key.translation += first.translation);
            poses.into()
        }
    }
}

/// Turning, the same scale along all axes: what trees of instances can be placed by at any depth.
fn similarity(random: &mut Random) -> Transform {
    let mut key = || Pose { scale: DVec3::splat(0.3 + 0.3 * f64::from(random.unit())), ..pose(random, 1.0, 1.0) };
    vec![key(), key()].into()
}

fn instances(random: &mut Random, of: &[(InstanceOf, Brute)], n: usize, orders: f64) -> Vec<(Instance, Brute)> {
    let some = |random: &mut Random| {
        let (tree, brute) = of[random.below(of.len())].clone();
        let scale = 0.3 * 10f64.powf(-orders * f64::from(random.unit()));
        let mut instance = Instance::new(tree, transform(random, scale, 1.0)).with_mask(1 << random.below(3));
        if random.below(4) == 0 {
            let begin = random.unit() * 0.5;
            instance = instance.with_active(TimeInterval::new(begin, begin + 0.5).unwrap());
        }
        (instance, brute)
    };
    (0..n).map(|_| some(random)).collect()
}

/// A ray at something in an instance, from nearby or far away.
fn ray(random: &mut Random, tree: &InstanceTree) -> Ray {
    let (mut path, mut of, time) = (Vec::new(), tree, random.unit());
    loop {
        path.push(random.below(of.len()) as u32);
        match of.placed(path[path.len() - 1]).unwrap() {
            InstanceOf::Instances(inner) => of = inner,
            InstanceOf::Tree(_) => break,
        }
    }
    let target = tree.matrix(&path, time).unwrap().transform_point3(dvec(random));
    let origin = target + dvec(random) * 10f64.powf(f64::from(random.signed()) * 3.0);
    let ray = Ray::new(origin, ((target - origin) * 10f64.powf(f64::from(random.signed()))).as_vec3()).at_time(time);
    match random.below(6) {
        0 => ray.between(-3.0, 0.7),
        1 => ray.between(0.1, 1.0),
        _ => ray,
    }
}

fn compare(placed: &Placed, random: &mut Random, rays: usize) {
    let mut hits = 0;
    for _ in 0..rays {
        let ray = ray(random, &placed.tree);
        hits += usize::from(placed.check(&ray, 1 << random.below(3) | 0b10));
    }
    assert!(hits * 15 > rays, "only {hits} of {rays} rays hit");
}

#[test]
fn instances_of_all_layouts_equal_brute_force() {
    let of = prototypes();
    let mut random = Random(1);
    for (n, orders, division) in [
        (1, 0.0, Division::Automatic),
        (12, 0.5, Division::Whole),
        (60, 1.0, Division::SharedLeaves(4)),
        (60, 1.0, Division::SeparateTrees(3)),
        (150, 5.0, Division::Automatic),
    ] {
        let params = WideParams { division, ..WideParams::default() };
        let placed = Placed::new(instances(&mut random, &of, n, orders), &params);
        compare(&placed, &mut random, 400);
    }
}

#[test]
fn nested_instances_equal_brute_force_on_every_instruction_set() {
    for level in SimdLevel::available() {
        let mut random = Random(2);
        let mut of = prototypes();
        for (tree, _) in &mut of {
            if let InstanceOf::Tree(inner) = tree {
                let inner = Arc::into_inner(core::mem::replace(
                    inner,
                    Arc::new(RayTree::build(&[], &BuildParams::default()).unwrap()),
                ));
                *tree = InstanceOf::Tree(Arc::new(inner.unwrap().with_simd(level)));
            }
        }
        let mut deepest = Placed::new(instances(&mut random, &of, 8, 0.5), &WideParams::default());
        for beside in of.iter().take(MAX_NESTING - 1) {
            let tree = Arc::into_inner(deepest.tree).unwrap().with_simd(level);
            deepest.tree = Arc::new(tree);
            compare(&deepest, &mut random, 150);
            // With trees of triangles among trees of instances.
            let inner = (InstanceOf::Instances(deepest.tree.clone()), Brute::Instances(Arc::new(deepest)));
            let among = [inner.clone(), inner, beside.clone()];
            let mut outer = instances(&mut random, &among, 6, 0.5);
            outer.iter_mut().for_each(|(instance, _)| instance.transform = similarity(&mut random));
            deepest = Placed::new(outer, &WideParams::default());
        }
        compare(&deepest, &mut random, 150);
        let too_deep =
            InstanceTree::build(vec![Instance::new(deepest.tree.clone(), Pose::IDENTITY)], &WideParams::default());
        assert_eq!(too_deep.unwrap_err(), InstanceError::TooDeep { instance: 0 });
    }
}

#[test]
fn instances_that_turn_fast_are_where_they_are_at_every_time() {
    // A long blade that makes most of a turn between keys, and more than a turn in all.
    let blade = vec![Vec3::new(0.0, -0.01, 0.0), Vec3::new(9.0, 0.0, 0.1), Vec3::new(9.0, 0.01, -0.1)];
    let mesh = [TriangleMesh::fixed(vec![[0, 1, 2]], blade)];
    let of = InstanceOf::Tree(Arc::new(RayTree::build(&mesh, &BuildParams::default()).unwrap()));
    let brute = Brute::Tree(Arc::new(BruteForce::new(&mesh).unwrap()));
    let key = |i: usize| Pose { rotation: DQuat::from_rotation_z(2.8 * i as f64), ..Pose::IDENTITY };
    for keys in 2..6 {
        let wheel: Vec<Pose> = (0..keys).map(key).collect();
        for division in [Division::Whole, Division::SeparateTrees(8), Division::SharedLeaves(5)] {
            let instance = Instance::new(of.clone(), wheel.clone());
            let params = WideParams { division, ..WideParams::default() };
            let placed = Placed::new(vec![(instance, brute.clone())], &params);
            let mut hits = 0;
            for i in 0..=1000 {
                let time = i as f32 / 1000.0;
                let angle = 2.8 * (keys - 1) as f64 * f64::from(time);
                let tip = DVec3::new(angle.cos(), angle.sin(), 0.0) * 8.9995;
                let ray = Ray::new(tip + DVec3::Z * 3.0, Vec3::NEG_Z).at_time(time);
                hits += usize::from(placed.check(&ray, 1));
            }
            assert!(hits > 900, "{hits}");
        }
    }
}

#[test]
fn ties_go_to_the_first_instance_and_its_lowest_primitive() {
    let triangle = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let mesh = [TriangleMesh::fixed(vec![[0, 1, 2]; 3], triangle)];
    let of = InstanceOf::Tree(Arc::new(RayTree::build(&mesh, &BuildParams::default()).unwrap()));
    let brute = Brute::Tree(Arc::new(BruteForce::new(&mesh).unwrap()));
    let same = |n: usize| (0..n).map(|_| (Instance::new(of.clone(), Pose::IDENTITY), brute.clone())).collect();
    let placed = Placed::new(same(40), &WideParams::default());
    let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z);
    assert!(placed.check(&ray, 1));
    assert_eq!(placed.tree.closest_hit(&ray).unwrap().path[..], [0]);
    assert_eq!(placed.hits(&ray, None).len(), 120);
}

#[test]
fn batches_filters_and_early_ends() {
    let mut random = Random(4);
    let placed = Placed::new(instances(&mut random, &prototypes(), 50, 0.5), &WideParams::default());
    let tree = &placed.tree;
    let rays: Vec<Ray> =
        (0..700).map(|i| if i % 50 == 3 { Ray::new(Vec3::NAN, Vec3::X) } else { ray(&mut random, tree) }).collect();
    let (mut hits, mut any) = (vec![None; 3], vec![true]);
    tree.closest_hits(&rays, &mut hits);
    tree.any_hits(&rays, &mut any);
    assert_eq!((hits.len(), any.len()), (700, 700));
    let accept = |i: usize, hit: &InstanceHit| hit.path[0] as usize % 3 != i % 3;
    let (mut filtered, mut filtered_any) = (vec![None; 3], vec![true]);
    tree.closest_hits_filtered(&rays, 0b10, accept, &mut filtered);
    tree.any_hits_filtered(&rays, 0b10, accept, &mut filtered_any);
    for (i, (ray, hit)) in rays.iter().zip(&filtered).enumerate() {
        let single = tree.closest_hit_filtered(ray, 0b10, |hit| accept(i, hit));
        assert_eq!((hit.map(name), filtered_any[i]), (single.map(name), single.is_some()));
    }
    assert!(filtered.iter().flatten().count() > 10 && filtered.len() == 700);
    tree.closest_hits_masked(&rays, 0b10, &mut filtered);
    tree.any_hits_masked(&rays, 0b10, &mut filtered_any);
    for (i, (ray, hit)) in rays.iter().zip(&filtered).enumerate() {
        let single = tree.closest_hit_masked(ray, 0b10);
        assert_eq!((hit.map(name), filtered_any[i]), (single.map(name), single.is_some()));
    }
    for ((ray, hit), any) in rays.iter().zip(hits).zip(any) {
        assert_eq!(hit.map(name), tree.closest_hit(ray).map(name));
        assert_eq!(any, hit.is_some());
        let Some(first) = hit else { continue };
        // Everything but that.
        let other = |hit: &InstanceHit| name(*hit) != name(first);
        let mut rest = placed.hits(ray, None);
        rest.retain(|hit| *hit != name(first));
        assert_eq!(tree.closest_hit_filtered(ray, u32::MAX, other).map(name), Placed::closest(&rest));
        assert_eq!(tree.any_hit_filtered(ray, u32::MAX, other), !rest.is_empty());
        let mut seen = 0;
        let flow = tree.all_hits(ray, |_| {
            seen += 1;
            ControlFlow::Break(())
        });
        assert_eq!((flow, seen), (ControlFlow::Break(()), 1));
        let mut filtered = 0;
        let _ = tree.all_hits_filtered(ray, u32::MAX, other, |_| {
            filtered += 1;
            ControlFlow::Continue(())
        });
        assert_eq!(filtered, rest.len());
    }
}

#[test]
fn what_is_hit_lies_where_the_instance_places_it() {
    let mut random = Random(5);
    let inner = Placed::new(instances(&mut random, &prototypes(), 20, 0.5), &WideParams::default());
    let group = (InstanceOf::Instances(inner.tree.clone()), Brute::Instances(Arc::new(inner)));
    let placed = Placed::new(instances(&mut random, &[group], 5, 0.3), &WideParams::default());
    let tree = &placed.tree;
    let mut triangles = 0;
    for _ in 0..500 {
        let ray = ray(&mut random, tree);
        let Some(found) = tree.closest_hit(&ray) else { continue };
        let [a, b, c] = tree.vertices(&found, ray.time);
        if a.is_nan() {
            assert_eq!((found.hit.mesh, tree.triangle_normal(&found, ray.time)), (2, Vec3::ZERO));
            continue;
        }
        triangles += 1;
        let there = a + (b - a) * f64::from(found.hit.u) + (c - a) * f64::from(found.hit.v);
        let (size, far) = ((b - a).length().max((c - a).length()), (ray.origin - a).length());
        let by = (ray.point(found.hit.t) - there).length();
        assert!(by < 1e-4 * size + 3e-5 * far, "{by} of {size} from {far}");
        let normal = tree.triangle_normal(&found, ray.time).as_dvec3();
        assert!(normal.dot((b - a).normalize()).abs() < 1e-5 && (normal.length() - 1.0).abs() < 1e-5);
        // On the same side as in its own space.
        let matrix = tree.matrix(&found.path, ray.time).unwrap();
        let inner = tree.tree(&found.path).unwrap().triangle_normal(&found.hit, ray.time).as_dvec3();
        assert!(normal.dot(matrix.transform_vector3(inner)) > 0.0);
    }
    assert!(triangles > 100, "{triangles}");
    let nowhere = tree.closest_hit(&Ray::new(Vec3::splat(100.0), Vec3::X));
    assert_eq!(nowhere, None);
    assert!(tree.matrix(&[0], 1.5).is_none() && tree.matrix(&[77], 0.5).is_none() && tree.matrix(&[], 0.5).is_none());
    assert!(tree.tree(&[0]).is_none() && tree.local_ray(99, &Ray::new(Vec3::ZERO, Vec3::X)).is_none());
}

#[test]
fn near_instances_end_the_search_in_far_ones() {
    let mesh = [soup(3000, 2, 0.1, 0.05, 3)];
    let of = Arc::new(RayTree::build(&mesh, &BuildParams::default()).unwrap());
    let row = |n: usize| {
        // Rotated, so that a ray that passes one of them does not pass all.
        let at =
            |i: usize| DAffine3::from_rotation_translation(DQuat::from_rotation_z(i as f64), DVec3::Z * 2.0 * i as f64);
        let instance = |i: usize| Instance::new(of.clone(), at(i));
        InstanceTree::build((0..n).map(instance).collect(), &WideParams::default()).unwrap()
    };
    let (few, many) = (row(2), row(200));
    let (mut of_few, mut of_many) = (Counters::default(), Counters::default());
    let mut random = Random(6);
    for _ in 0..200 {
        let ray =
            Ray::new(Vec3::new(0.7 * random.signed(), 0.7 * random.signed(), -3.0), Vec3::Z).at_time(random.unit());
        few.closest_hit_observed(&ray, &mut of_few);
        many.closest_hit_observed(&ray, &mut of_many);
        assert_eq!(many.any_hit_observed(&ray, &mut Counters::default()), many.any_hit(&ray));
    }
    let share = of_many.primitive_tests as f64 / of_few.primitive_tests as f64;
    assert!(share < 1.3, "{share}: {of_many:?} {of_few:?}");
}

#[test]
fn rays_that_pass_by_what_is_placed_do_not_enter_it() {
    // A thin rod along a diagonal: the box around it in the world is a cube, the rod's own fills a hundredth of it.
    let rod = vec![Vec3::new(-1.0, -0.01, 0.0), Vec3::new(1.0, 0.0, 0.01), Vec3::new(1.0, 0.01, -0.01)];
    let of = Arc::new(RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], rod)], &BuildParams::default()).unwrap());
    let diagonal = Pose {
        rotation: DQuat::from_rotation_arc(DVec3::X, DVec3::ONE.normalize()),
        scale: DVec3::splat(3f64.sqrt()),
        translation: DVec3::ZERO,
    };
    let moved = Pose { translation: DVec3::splat(1e-3), ..diagonal };
    for keys in [vec![diagonal], vec![diagonal, moved]] {
        let tree = InstanceTree::build(vec![Instance::new(of.clone(), keys); 2], &WideParams::default()).unwrap();
        let (mut random, mut seen) = (Random(8), Counters::default());
        for _ in 0..1000 {
            let target = Vec3::new(random.signed(), random.signed(), random.signed());
            let origin = Vec3::new(0.3, 0.2, -5.0);
            tree.closest_hit_observed(&Ray::new(origin, target - origin), &mut seen);
        }
        // Most rays enter both instances, and few hit the rod.
        assert!(seen.leaves > 1000 && seen.primitive_tests < 200, "{seen:?}");
    }
}

#[test]
fn ten_thousand_instances_take_little_beyond_what_is_placed() {
    // 100 000 triangles in the issue; a tenth of them here, since their number does not matter.
    let of = Arc::new(RayTree::build(&[soup(10_000, 2, 0.02, 0.01, 5)], &BuildParams::default()).unwrap());
    let mut random = Random(7);
    let instances = (0..10_000)
        .map(|_| {
            let poses: Vec<Pose> = (0..3).map(|_| pose(&mut random, 0.01, 1.0)).collect();
            Instance::new(of.clone(), poses)
        })
        .collect();
    let statistics = InstanceTree::build(instances, &WideParams::default()).unwrap().statistics();
    assert_eq!((statistics.instances, statistics.primitives, statistics.trees), (10_000, 100_000_000, 1));
    let own = of.statistics();
    assert_eq!(statistics.tree_bytes, own.bytes + own.primitive_bytes);
    assert!(statistics.instance_bytes < 40 << 20, "{}", statistics.instance_bytes);
    let outermost = statistics.outermost;
    assert_eq!(outermost.references, outermost.leaves, "one instance in each leaf");
}

#[test]
fn numbers_of_nested_primitives_saturate() {
    let of = RayTree::build(&[soup(2000, 1, 0.1, 0.0, 5)], &BuildParams::default()).unwrap();
    let mut of = InstanceOf::from(Arc::new(of));
    let mut tree = None;
    for _ in 0..MAX_NESTING {
        let place = |i| Instance::new(of.clone(), Pose { translation: DVec3::X * f64::from(i), ..Pose::IDENTITY });
        let next = Arc::new(InstanceTree::build((0..10_000).map(place).collect(), &WideParams::default()).unwrap());
        of = next.clone().into();
        tree = Some(next);
    }
    let statistics = tree.unwrap().statistics();
    // 2e19 primitives are more than u64 can count.
    assert_eq!((statistics.instances, statistics.primitives), (10_001_000_100_010_000, u64::MAX));
}

#[test]
fn bad_instances_are_refused_with_their_number() {
    let of = Arc::new(RayTree::build(&[soup(5, 1, 0.1, 0.0, 5)], &BuildParams::default()).unwrap());
    let error = |transform: Transform| {
        let fine = Instance::new(of.clone(), Pose::IDENTITY);
        InstanceTree::build(vec![fine, Instance::new(of.clone(), transform)], &WideParams::default()).unwrap_err()
    };
    let one = Pose::IDENTITY;
    let scaled = |scale: DVec3| Pose { scale, ..one };
    let turned = |rotation: DQuat| Pose { rotation, ..one };
    let moved = |translation: DVec3| Pose { translation, ..one };
    let (i, flat) = (1, DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z));
    assert_eq!(error(Transform::Poses(vec![])), InstanceError::NoKeys { instance: i });
    assert_eq!(error(Transform::Matrices(vec![])), InstanceError::NoKeys { instance: i });
    assert_eq!(error(moved(DVec3::NAN).into()), InstanceError::NonFinite { instance: i, key: 0 });
    assert_eq!(error(vec![one, scaled(DVec3::INFINITY)].into()), InstanceError::NonFinite { instance: i, key: 1 });
    assert_eq!(error(DAffine3::from_scale(DVec3::NAN).into()), InstanceError::NonFinite { instance: i, key: 0 });
    let zero = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    for bad in [zero, DQuat::from_xyzw(0.0, 0.0, 0.0, 1.1), DQuat::from_xyzw(1.0, 1.0, 1.0, 1.0)] {
        assert_eq!(error(vec![one, turned(bad)].into()), InstanceError::NotUnit { instance: i, key: 1 });
    }
    assert_eq!(error(scaled(DVec3::new(1.0, 0.0, 1.0)).into()), InstanceError::Singular { instance: i, key: 0 });
    assert_eq!(error(DAffine3::from_mat3(flat).into()), InstanceError::Singular { instance: i, key: 0 });
    assert_eq!(error(vec![one, scaled(-DVec3::ONE)].into()), InstanceError::SingularBetween { instance: i, key: 0 });
    let through = vec![DAffine3::IDENTITY, DAffine3::IDENTITY, DAffine3::from_scale(-DVec3::ONE)];
    assert_eq!(error(through.into()), InstanceError::SingularBetween { instance: i, key: 1 });
    assert_eq!(error(moved(DVec3::splat(1e31)).into()), InstanceError::TooLarge { instance: i });
    // With squares, and with determinants, beyond f64.
    for large in [1e31, 1e104, 1e155, 1e307].map(DVec3::splat) {
        let (pose, matrix) = (scaled(large), DAffine3::from_scale(large));
        let transforms: [Transform; 4] = [
            pose.into(),
            vec![one, pose].into(),
            matrix.into(),
            vec![matrix, DAffine3::from_scale(0.5 * large)].into(),
        ];
        for transform in transforms {
            assert_eq!(error(transform), InstanceError::TooLarge { instance: i }, "{large}");
        }
    }
    let sheared = DMat3::from_cols(DVec3::X, DVec3::new(1e7, 1.0, 0.0), DVec3::Z);
    assert_eq!(error(DAffine3::from_mat3(sheared).into()), InstanceError::Distorted { instance: i });
    let params = WideParams { max_references: 0.0, ..WideParams::default() };
    assert!(matches!(InstanceTree::build(vec![], &params), Err(InstanceError::Build(_))));
    for error in [
        InstanceError::TooDeep { instance: 3 },
        InstanceError::Distorted { instance: 3 },
        error(moved(DVec3::NAN).into()),
    ] {
        assert!(error.to_string().starts_with("instance"), "{error}");
    }
}

#[test]
fn an_object_may_shrink_to_a_millionth() {
    let of = Arc::new(RayTree::build(&[soup(200, 1, 0.5, 0.0, 5)], &BuildParams::default()).unwrap());
    let shrink = vec![DAffine3::IDENTITY, DAffine3::from_scale(DVec3::splat(1e-6))];
    let tree = InstanceTree::build(vec![Instance::new(of.clone(), shrink)], &WideParams::default()).unwrap();
    let mut hits = 0;
    for i in 0..200 {
        let time = i as f32 / 200.0;
        let ray = Ray::new(Vec3::new(0.3, 0.2, 4.0), Vec3::new(-0.075, -0.05, -1.0)).at_time(time);
        let local = tree.local_ray(0, &ray).unwrap();
        assert_eq!(tree.closest_hit(&ray).map(|hit| hit.hit), of.closest_hit(&local));
        hits += usize::from(of.closest_hit(&local).is_some());
    }
    assert!(hits > 20, "{hits}");
}

/// No direction in the space of the instance is in range, whatever f64 makes of the inverse; as points they are there.
#[test]
fn instances_of_the_least_scales_are_points_that_no_ray_hits() {
    let of = Arc::new(RayTree::build(&[soup(5, 1, 0.1, 0.0, 5)], &BuildParams::default()).unwrap());
    for small in [1e-40, 1e-104, 1e-155, 1e-300].map(DVec3::splat) {
        let pose = Pose { scale: small, translation: DVec3::X, ..Pose::IDENTITY };
        let larger = Pose { scale: 2.0 * small, ..pose };
        let matrices = [pose, larger].map(|pose| pose.matrix());
        let transforms: [Transform; 4] =
            [pose.into(), vec![pose, larger].into(), matrices[0].into(), matrices.to_vec().into()];
        for transform in transforms {
            let tree = InstanceTree::build(vec![Instance::new(of.clone(), transform)], &WideParams::default()).unwrap();
            let ray = Ray::new(Vec3::ZERO, Vec3::X);
            assert!(tree.local_ray(0, &ray).is_none() && !tree.any_hit(&ray), "{small}");
            let near = tree.closest_point(&ClosestPointQuery::new(Vec3::ZERO, 0.5)).unwrap().near;
            assert!(near.distance == 1.0 && near.point.distance(DVec3::X) < 1e-39, "{small}: {near:?}");
        }
    }
}

#[test]
fn nothing_and_instances_of_nothing_are_never_hit() {
    let nothing = InstanceTree::build(vec![], &WideParams::default()).unwrap();
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    assert!(nothing.is_empty() && nothing.bounds().is_none() && nothing.closest_hit(&ray).is_none());
    let empty = Arc::new(RayTree::build(&[], &BuildParams::default()).unwrap());
    let group =
        Arc::new(InstanceTree::build(vec![Instance::new(empty, Pose::IDENTITY)], &WideParams::default()).unwrap());
    let tree = InstanceTree::build(
        vec![Instance::new(Arc::new(nothing), Pose::IDENTITY), Instance::new(group, Pose::IDENTITY)],
        &WideParams::default(),
    );
    let tree = tree.unwrap();
    assert!(!tree.any_hit(&ray) && tree.len() == 2 && tree.statistics().primitives == 0);
}

#[test]
fn bounds_hold_what_exists_and_nothing_else() {
    let of = |meshes: &[TriangleMesh]| Arc::new(RayTree::build(meshes, &BuildParams::default()).unwrap());
    let (empty, unit) = (of(&[]), of(&[TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y])]));
    assert!(empty.bounds().is_none());
    assert!(unit.bounds().unwrap().max.abs_diff_eq(DVec3::new(1.0, 1.0, 0.0), 1e-5));
    let at = |x: f64| DAffine3::from_translation(DVec3::X * x);
    let far = Instance::new(empty.clone(), DAffine3::from_scale(DVec3::splat(1e20)));
    let group = Arc::new(InstanceTree::build(vec![far.clone()], &WideParams::default()).unwrap());
    assert!(group.bounds().is_none());
    // One that leaves at a tenth of the shutter, and would go far away.
    let leaves =
        Instance::new(unit.clone(), vec![at(0.0), at(100.0)]).with_active(TimeInterval::new(0.0, 0.1).unwrap());
    let all = vec![far, Instance::new(group, at(1e6)), Instance::new(unit, at(-2.0)), leaves];
    let tree = InstanceTree::build(all, &WideParams::default()).unwrap();
    let bounds = tree.bounds().unwrap();
    assert!(bounds.contains(DVec3::new(-2.0, 0.0, 0.0)) && bounds.contains(DVec3::new(11.0, 0.0, 0.0)));
    assert!(bounds.max.x < 11.0 + 1000.0 && bounds.min.x > -2.0 - 1000.0, "{bounds:?}");
    let hit = tree.closest_hit(&Ray::new(Vec3::new(-1.8, 0.2, 5.0), Vec3::NEG_Z)).unwrap();
    assert_eq!((&hit.path[..], hit.hit.t), (&[2][..], 5.0));
}
