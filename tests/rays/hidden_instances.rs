//! Instances with a scale of zero at all keys: trees answer as without them, but for indices.

use super::common::{Random, bits, soup};
use core::ops::ControlFlow;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Counters, Instance, InstanceError, InstanceHit, InstanceOf, InstanceTree, Pose,
    Ray, RayTree, TimeInterval, Transform, WideParams,
};
use std::sync::Arc;

/// What hides an instance: one key and several, matrices and poses, at a place and moving, far away too.
fn hiding(random: &mut Random) -> Transform {
    let place = |random: &mut Random| random.vec().as_dvec3() * 10f64.powi(random.below(8) as i32);
    let keys = 1 + random.below(3);
    let places: Vec<DVec3> = (0..keys).map(|_| place(random)).collect();
    let zero = DMat3::from_diagonal(DVec3::new(0.0, -0.0, 0.0));
    let turned = DQuat::from_rotation_x(f64::from(random.signed()));
    match random.below(2) {
        0 => places.iter().map(|&translation| DAffine3 { matrix3: zero, translation }).collect::<Vec<_>>().into(),
        _ => places
            .iter()
            .map(|&translation| Pose { scale: DVec3::new(0.0, -0.0, 0.0), rotation: turned, translation })
            .collect::<Vec<_>>()
            .into(),
    }
}

/// Moving instances of some trees, with masks and active intervals.
fn seen(random: &mut Random, of: &[InstanceOf], n: usize) -> Vec<Instance> {
    let mut pose = || Pose {
        scale: DVec3::splat(f64::from(random.unit()) + 0.5),
        rotation: DQuat::from_axis_angle(random.vec().as_dvec3().normalize(), 1.0),
        translation: random.vec().as_dvec3() * 4.0,
    };
    let mut all = Vec::new();
    for i in 0..n {
        let keys: Vec<Pose> = (0..1 + i % 3).map(|_| pose()).collect();
        let active = if i % 5 == 0 { TimeInterval::new(0.0, 0.5).unwrap() } else { TimeInterval::FULL };
        all.push(Instance::new(of[i % of.len()].clone(), keys).with_mask(1 << (i % 3)).with_active(active));
    }
    all
}

fn build(instances: Vec<Instance>) -> InstanceTree {
    let tree = InstanceTree::build(instances, &WideParams::default()).unwrap();
    tree.validate().unwrap();
    tree
}

fn leaf(seed: u64) -> Arc<RayTree> {
    Arc::new(RayTree::build(&[soup(60, 2, 0.5, 0.3, seed)], &BuildParams::default()).unwrap())
}

/// A ray through the scene.
fn ray(random: &mut Random) -> Ray {
    let (from, to) = (random.vec() * 12.0, random.vec() * 3.0);
    Ray::new(from, to - from).at_time(random.unit())
}

/// Hits with the index of the first level mapped by `number`, sorted.
fn all_hits(tree: &InstanceTree, ray: &Ray, number: impl Fn(u32) -> u32) -> Vec<(Vec<u32>, [u32; 5])> {
    let mut hits = Vec::new();
    let _ = tree.all_hits(ray, |hit| {
        hits.push(renumbered(hit, &number));
        ControlFlow::Continue(())
    });
    hits.sort();
    hits
}

fn renumbered(hit: InstanceHit, number: impl Fn(u32) -> u32) -> (Vec<u32>, [u32; 5]) {
    let mut path = hit.path.to_vec();
    path[0] = number(path[0]);
    (path, bits(hit.hit))
}

/// Compares a tree with the one that lacks its hidden instances; `numbers` has the index in it of each of the others. Returns how
/// many rays and closest points found something.
fn compare(with: &InstanceTree, without: &InstanceTree, numbers: &[u32], random: &mut Random) -> [usize; 2] {
    let number = |id: u32| numbers[id as usize];
    let mut found = [0; 2];
    for _ in 0..600 {
        let ray = ray(random);
        let expected = without.closest_hit(&ray).map(|hit| renumbered(hit, number));
        assert_eq!(with.closest_hit(&ray).map(|hit| renumbered(hit, |id| id)), expected);
        assert_eq!(with.any_hit(&ray), expected.is_some());
        assert_eq!(all_hits(with, &ray, |id| id), all_hits(without, &ray, number));
        let masked = without.closest_hit_masked(&ray, 0b10).map(|hit| renumbered(hit, number));
        assert_eq!(with.closest_hit_masked(&ray, 0b10).map(|hit| renumbered(hit, |id| id)), masked);
        assert_eq!(with.any_hit_masked(&ray, 0b10), masked.is_some());
        found[0] += usize::from(expected.is_some());
        let query = ClosestPointQuery::new(random.vec() * 6.0, random.unit());
        let [with, without] = [with, without].map(|tree| tree.closest_point(&query));
        let expected = without.map(|point| (number(point.path[0]), point.path[1..].to_vec(), point.near));
        assert_eq!(with.map(|point| (point.path[0], point.path[1..].to_vec(), point.near)), expected);
        found[1] += usize::from(expected.is_some());
    }
    found
}

/// Puts hidden instances between others; returns all with the indices of the others.
fn mixed(random: &mut Random, of: &[InstanceOf], others: &[Instance]) -> (Vec<Instance>, Vec<u32>) {
    let (mut all, mut numbers) = (Vec::new(), Vec::new());
    for other in others {
        for _ in 0..random.below(3) {
            let tree = of[random.below(of.len())].clone();
            all.push(
                Instance::new(tree, hiding(random)).with_mask(!0).with_active(TimeInterval::new(0.2, 0.3).unwrap()),
            );
        }
        numbers.push(all.len() as u32);
        all.push(other.clone());
    }
    all.push(Instance::new(of[0].clone(), hiding(random)));
    (all, numbers)
}

#[test]
fn hidden_instances_beside_seen_ones_change_indices_only() {
    let mut random = Random(71);
    for n in [1, 3, 40, 300] {
        let mut of = vec![InstanceOf::from(leaf(1)), InstanceOf::from(leaf(2))];
        // A group with hidden instances of its own.
        let inner = seen(&mut random, &of, 4);
        let (inner, _) = mixed(&mut random, &of, &inner);
        of.push(InstanceOf::from(Arc::new(build(inner))));
        let others = seen(&mut random, &of, n);
        let (all, numbers) = mixed(&mut random, &of, &others);
        let hidden = all.len() - n;
        assert!(hidden > 0);
        let (with, without) = (build(all), build(others));
        let [hits, points] = compare(&with, &without, &numbers, &mut random);
        assert!(hits > if n < 40 { 10 } else { 300 } && points > 200, "{hits} hits and {points} points with {n}");
        assert_eq!(with.bounds(), without.bounds());
        assert_eq!(with.len(), without.len() + hidden);
        let [a, b] = [&with, &without].map(InstanceTree::statistics);
        assert_eq!((a.primitives, a.trees), (b.primitives, if n == 1 { a.trees } else { b.trees }));
        assert!(a.instances >= b.instances + hidden as u64, "{a} and {b}");
        assert_eq!(a.outermost.primitives, n);
        assert_eq!(
            (a.outermost.references, a.outermost.leaves, a.outermost.nodes, a.outermost.duplicates),
            (b.outermost.references, b.outermost.leaves, b.outermost.nodes, b.outermost.duplicates)
        );
    }
}

#[test]
fn hidden_instances_keep_their_place_and_map_no_ray_inward() {
    let at = |x: f64| DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::X * x };
    let of = leaf(3);
    for (transform, middle) in [
        (Transform::from(at(1.0)), 1.0),
        (vec![at(1.0), at(3.0)].into(), 2.0),
        (
            vec![1.0, 3.0]
                .into_iter()
                .map(|x| Pose { scale: DVec3::ZERO, translation: DVec3::X * x, ..Pose::IDENTITY })
                .collect::<Vec<_>>()
                .into(),
            2.0,
        ),
    ] {
        let tree = build(vec![Instance::new(of.clone(), transform), Instance::new(of.clone(), Pose::IDENTITY)]);
        assert_eq!(tree.matrix(&[0], 0.5), Some(at(middle)));
        assert!(tree.tree(&[0]).is_some() && matches!(tree.placed(0), Some(InstanceOf::Tree(_))));
        let ray = Ray::new(Vec3::new(middle as f32, 0.0, 5.0), Vec3::NEG_Z).at_time(0.5);
        assert!(tree.local_ray(0, &ray).is_none() && tree.local_ray(1, &ray).is_some());
        // A hit of the other instance, as if of this one.
        let mut random = Random(5);
        let (ray, mut hit) = loop {
            let ray = self::ray(&mut random);
            if let Some(hit) = tree.closest_hit(&ray) {
                break (ray, hit);
            }
        };
        assert_eq!(hit.path[0], 1);
        hit.path = build(vec![Instance::new(of.clone(), Pose::IDENTITY)]).closest_hit(&ray).unwrap().path;
        let next = tree.secondary_ray(&ray, &hit, Vec3::Z);
        assert!(next.origin.is_finite() && tree.triangle_normal(&hit, 0.5) == Vec3::ZERO);
    }
}

#[test]
fn a_tree_of_hidden_instances_only_is_one_of_nothing() {
    let mut random = Random(9);
    let of = InstanceOf::from(leaf(4));
    let mut all: Vec<Instance> = (0..20).map(|_| Instance::new(of.clone(), hiding(&mut random))).collect();
    // Beyond the limits of the positions of others.
    all.push(Instance::new(of.clone(), DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::splat(1e40) }));
    let group = Arc::new(build(all));
    assert!(group.bounds().is_none() && group.len() == 21 && !group.is_empty());
    let statistics = group.statistics();
    assert_eq!((statistics.instances, statistics.primitives, statistics.trees), (21, 0, 1));
    assert_eq!((statistics.outermost.primitives, statistics.outermost.leaves), (0, 0));
    let outer =
        build(vec![Instance::new(group.clone(), Pose::IDENTITY), Instance::new(group.clone(), hiding(&mut random))]);
    assert!(outer.bounds().is_none());
    let statistics = outer.statistics();
    assert_eq!((statistics.instances, statistics.primitives), (44, 0));
    for _ in 0..100 {
        let ray = ray(&mut random);
        let mut counters = Counters::default();
        assert!(group.closest_hit_observed(&ray, &mut counters).is_none() && !outer.any_hit(&ray));
        assert_eq!(counters.leaves, 0, "no instance is visited");
        let query = ClosestPointQuery::new(ray.origin.as_vec3(), ray.time);
        assert!(group.closest_point(&query).is_none() && outer.closest_point(&query).is_none());
    }
}

/// However far away they are, and in whatever active interval.
#[test]
fn instances_of_nothing_do_not_count() {
    let nothing = InstanceOf::from(Arc::new(RayTree::build(&[], &BuildParams::default()).unwrap()));
    let no_instances = InstanceOf::from(Arc::new(build(Vec::new())));
    let one = Instance::new(leaf(4), Pose::IDENTITY);
    let alone = build(vec![one.clone()]);
    for of in [nothing, no_instances] {
        for far in [1e3, 1e20, 1e300] {
            let away = Pose { translation: DVec3::new(far, -far, 0.0), ..Pose::IDENTITY };
            let away = Instance::new(of.clone(), away).with_active(TimeInterval::new(0.5, 0.6).unwrap());
            let with = build(vec![one.clone(), away]);
            assert_eq!(with.bounds(), alone.bounds(), "{far:e}");
            let mut random = Random(4);
            for _ in 0..200 {
                let ray = ray(&mut random);
                let counted = |tree: &InstanceTree| {
                    let mut counters = Counters::default();
                    (tree.closest_hit_observed(&ray, &mut counters), counters)
                };
                assert_eq!(counted(&with), counted(&alone));
            }
        }
    }
}

#[test]
fn what_is_zero_at_some_times_or_along_some_axes_is_refused_with_advice() {
    let of = leaf(5);
    let error = |transform: Transform| {
        let hidden = Instance::new(of.clone(), Pose { scale: DVec3::ZERO, ..Pose::IDENTITY });
        let all = vec![hidden, Instance::new(of.clone(), transform)];
        InstanceTree::build(all, &WideParams::default()).unwrap_err()
    };
    let scaled = |x: f64, y: f64, z: f64| Pose { scale: DVec3::new(x, y, z), ..Pose::IDENTITY };
    let (zero, one) = (scaled(0.0, 0.0, 0.0), Pose::IDENTITY);
    let singular = |key| InstanceError::Singular { instance: 1, key };
    for (keys, expected) in [
        (vec![zero, one], singular(0)),
        (vec![one, zero], singular(1)),
        (vec![one, zero, one], singular(1)),
        (vec![scaled(0.0, 0.0, 1.0)], singular(0)),
        (vec![one, scaled(-1.0, 1.0, 1.0)], InstanceError::SingularBetween { instance: 1, key: 0 }),
    ] {
        assert_eq!(error(keys.clone().into()), expected);
        assert_eq!(error(keys.iter().map(Pose::matrix).collect::<Vec<_>>().into()), expected);
    }
    assert!(singular(0).to_string().contains("1e-6 instead of 0"));
    let half = DQuat::from_rotation_z(core::f64::consts::PI);
    let turned = [one, Pose { rotation: half, ..one }];
    let between = error(turned.map(|pose| pose.matrix()).to_vec().into());
    assert_eq!(between, InstanceError::SingularBetween { instance: 1, key: 0 });
    assert!(between.to_string().contains("poses (scale, rotation, translation) instead of matrices"));
    // What the messages advise is accepted.
    let middle = Pose { rotation: DQuat::from_rotation_z(1.5), ..one };
    let begin = TimeInterval::new(0.0, 0.5).unwrap();
    let end = TimeInterval::new(0.5, 1.0).unwrap();
    build(vec![
        Instance::new(of.clone(), vec![scaled(1e-6, 1e-6, 1e-6), one]),
        Instance::new(of.clone(), scaled(1.0, 1e-6, 1.0)),
        Instance::new(of.clone(), vec![turned[0], middle, turned[1]]),
        Instance::new(of.clone(), one).with_active(begin),
        Instance::new(of.clone(), scaled(-1.0, 1.0, 1.0)).with_active(end),
    ]);
    // Numbers of hidden instances are checked, too.
    let nan = Pose { translation: DVec3::NAN, ..zero };
    assert_eq!(error(vec![zero, nan].into()), InstanceError::NonFinite { instance: 1, key: 1 });
    let long = Pose { rotation: DQuat::from_xyzw(1.0, 1.0, 0.0, 0.0), ..zero };
    assert_eq!(error(long.into()), InstanceError::NotUnit { instance: 1, key: 0 });
    // Errors name instances by the caller's numbers.
    let far = Pose { translation: DVec3::splat(1e31), ..one };
    assert_eq!(error(far.into()), InstanceError::TooLarge { instance: 1 });
}
