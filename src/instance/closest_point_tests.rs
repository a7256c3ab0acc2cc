//! Closest points over instances equal testing every primitive of every instance, bit for bit.

use super::{Instance, InstanceOf, InstancePath, InstancePoint, InstanceTree, Pose, Transform};
use crate::baseline::BruteForce;
use crate::geometry::{Placement, TimeInterval};
use crate::params::{BuildParams, Division, KdParams, LazyParams, WideParams};
use crate::primitive::{MovingSphere, Shape, TriangleMesh};
use crate::random::Random;
use crate::ray::{ClosestPoint, ClosestPointQuery, Counters, PlacedQuery, RayTree, Visible};
use crate::simd::SimdLevel;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use std::sync::Arc;

/// A time, often exactly that of a key.
fn time(random: &mut Random) -> f32 {
    if below(random, 4) == 0 { below(random, 5) as f32 / 4.0 } else { random.unit() }
}

fn below(random: &mut Random, n: usize) -> usize {
    ((random.bits() >> 33) % n as u64) as usize
}

/// The contents of an instance, for brute force.
#[derive(Clone)]
enum Brute {
    Tree(Arc<BruteForce>),
    Instances(Arc<All>),
}

/// A tree of instances, and the same for brute force.
struct All {
    tree: Arc<InstanceTree>,
    brute: Vec<(Brute, u32, TimeInterval)>,
}

impl All {
    fn new(instances: Vec<(Instance, Brute)>) -> All {
        let brute = instances.iter().map(|(i, brute)| (brute.clone(), i.mask, i.active)).collect();
        let all = instances.into_iter().map(|(instance, _)| instance).collect();
        All { tree: Arc::new(InstanceTree::build(all, &WideParams::default()).unwrap()), brute }
    }

    fn nearest(
        &self,
        query: &PlacedQuery,
        path: InstancePath,
        mask: u32,
        accept: &dyn Fn(&InstancePoint) -> bool,
    ) -> Option<InstancePoint> {
        let mut best: Option<InstancePoint> = None;
        for (i, (brute, own, active)) in self.brute.iter().enumerate() {
            let time = query.query.time;
            if own & mask == 0 || !active.contains(time) {
                continue;
            }
            let matrix = self.tree.matrix(&[i as u32], time).unwrap();
            let inner = PlacedQuery { placed: Some(Placement::then(query.placed.as_ref(), matrix)), ..*query };
            let path = path.then(i as u32);
            let found = match brute {
                Brute::Tree(of) => {
                    let accept = |&near: &ClosestPoint| accept(&InstancePoint { path, near });
                    let near = of.closest_point_placed(&inner, &Visible { mask, accept: Some(accept) });
                    near.map(|near| InstancePoint { path, near })
                }
                Brute::Instances(all) => all.nearest(&inner, path, mask, accept),
            };
            // The first of several at the same distance.
            if let Some(found) = found
                && best.is_none_or(|best| found.near.distance < best.near.distance)
            {
                best = Some(found);
            }
        }
        best
    }

    /// Compares queries near the instances, and counts those that find something.
    fn compare(&self, random: &mut Random, reach: f64, queries: usize) {
        let mut found = 0;
        for i in 0..queries {
            let far = if i % 16 == 0 { 1e5 } else { 1.0 };
            let query = ClosestPointQuery::new(random.dvec() * reach * far, time(random));
            let query = if i % 3 == 0 { query.within((random.signed_f64().abs() * reach) as f32) } else { query };
            let all = |mask, accept: &dyn Fn(&InstancePoint) -> bool| {
                self.nearest(&query.into(), InstancePath::default(), mask, accept)
            };
            let near = self.tree.closest_point(&query);
            assert_eq!(near, all(u32::MAX, &|_| true), "{query:?}");
            let odd = |p: &InstancePoint| (p.near.primitive + p.path[0]) % 2 == 1;
            let mask = 1 << below(random, 3);
            assert_eq!(self.tree.closest_point_filtered(&query, mask, odd), all(mask, &odd), "{query:?} {mask}");
            assert_eq!(self.tree.closest_point_masked(&query, mask), all(mask, &|_| true), "{query:?} {mask}");
            found += usize::from(near.is_some());
        }
        assert!(found * 2 > queries, "only {found} of {queries} find something");
    }
}

fn soup(n: usize, keys: usize, random: &mut Random) -> TriangleMesh {
    let mut positions = vec![Vec::new(); keys];
    for _ in 0..n {
        let (at, corners) = (random.dvec(), [(); 3].map(|_| random.dvec() * 0.2));
        for key in &mut positions {
            let by = random.dvec() * 0.3;
            // Some on a grid, so that there are ties.
            key.extend(corners.map(|c| {
                if n.is_multiple_of(2) {
                    (at + c + by).as_vec3()
                } else {
                    ((at + by) * 2.0).round().as_vec3() + c.as_vec3()
                }
            }));
        }
    }
    TriangleMesh::new((0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions)
}

/// Trees of every layout.
fn prototypes(random: &mut Random) -> Vec<(InstanceOf, Brute)> {
    let params = [
        BuildParams::default(),
        BuildParams::wide(WideParams { division: Division::SeparateTrees(3), ..WideParams::default() }),
        BuildParams::kd(KdParams::default()),
        BuildParams::kd(KdParams::classic()),
        BuildParams::lazy(LazyParams { subtree: 9, ..LazyParams::default() }),
    ];
    let prototype = |(i, params): (usize, BuildParams)| {
        let meshes = [soup(40 + i, 1 + i, random).with_mask(0b011), soup(31, 2, random).with_mask(0b110)];
        let ball = |x: f64| MovingSphere::new(vec![(DVec3::X * x, 0.3), (DVec3::Y, 0.1)]).into();
        let shapes: Vec<Shape> = vec![ball(1.0), ball(-1.0)];
        let tree = RayTree::of_scene(&meshes, shapes, &params).unwrap();
        let shapes: Vec<Shape> = vec![ball(1.0), ball(-1.0)];
        let brute = BruteForce::of_scene(&meshes, shapes).unwrap();
        (InstanceOf::Tree(Arc::new(tree)), Brute::Tree(Arc::new(brute)))
    };
    params.into_iter().enumerate().map(prototype).collect()
}

/// Instances that rotate, scale per axis, or are sheared; some with an active interval.
fn instances(random: &mut Random, of: &[(InstanceOf, Brute)], n: usize, orders: f64) -> Vec<(Instance, Brute)> {
    let mut one = |i: usize| {
        let (tree, brute) = of[below(random, of.len())].clone();
        let signs = random.dvec().signum();
        let mut pose = |_| Pose {
            scale: signs * DVec3::from([(); 3].map(|()| 10f64.powf(orders * random.signed_f64()))),
            rotation: DQuat::from_axis_angle(random.dvec().normalize(), 3.0 * random.signed_f64()),
            translation: random.dvec() * 6.0,
        };
        let poses: Vec<Pose> = (0..[1, 2, 3, 5][i % 4]).map(&mut pose).collect();
        let transform: Transform = match i % 3 {
            0 => {
                let mut matrix = poses[0].matrix();
                let moved = |by: DVec3| DAffine3 { translation: matrix.translation + by, ..matrix };
                let there = moved(random.dvec());
                matrix.matrix3 *= DMat3::from_cols(DVec3::X, DVec3::new(random.signed_f64(), 1.0, 0.0), DVec3::Z);
                vec![DAffine3 { matrix3: matrix.matrix3, ..there }, matrix].into()
            }
            _ => poses.into(),
        };
        let active = if i % 5 == 4 { TimeInterval::new(0.25, 0.5).unwrap() } else { TimeInterval::FULL };
        let mask = if i % 4 == 3 { 0b100 } else { u32::MAX };
        (Instance::new(tree, transform).with_mask(mask).with_active(active), brute)
    };
    (0..n).map(&mut one).collect()
}

#[test]
fn closest_points_over_instances_equal_brute_force() {
    let mut random = Random(1);
    let of = prototypes(&mut random);
    for (n, orders) in [(1, 0.0), (12, 0.3), (40, 0.7), (40, 2.0)] {
        let all = All::new(instances(&mut random, &of, n, orders));
        all.compare(&mut random, 8.0, 250);
    }
}

#[test]
fn nested_instances_on_every_instruction_set() {
    for level in SimdLevel::available() {
        let mut random = Random(2);
        let of = prototypes(&mut random);
        let mut inner = All::new(instances(&mut random, &of, 5, 0.3));
        for levels in 2..=super::MAX_NESTING {
            inner.tree = Arc::new(Arc::into_inner(inner.tree).unwrap().with_simd(level));
            inner.compare(&mut random, 10.0, 60);
            let group = (InstanceOf::Instances(inner.tree.clone()), Brute::Instances(Arc::new(inner)));
            let among = [group.clone(), group, of[levels % of.len()].clone()];
            inner = All::new(instances(&mut random, &among, 4, 0.2));
        }
        inner.compare(&mut random, 20.0, 60);
    }
}

#[test]
fn ties_go_to_the_lowest_path() {
    let mesh = [TriangleMesh::fixed(vec![[0, 1, 2]; 3], vec![Vec3::ZERO, Vec3::X, Vec3::Y])];
    let of = Arc::new(RayTree::build(&mesh, &BuildParams::default()).unwrap());
    let same = (0..50).map(|_| Instance::new(of.clone(), Pose::IDENTITY)).collect();
    let tree = InstanceTree::build(same, &WideParams::default()).unwrap();
    let found = tree.closest_point(&ClosestPointQuery::new(Vec3::new(0.1, 0.1, 1.0), 0.5).within(1.0)).unwrap();
    assert_eq!((&found.path[..], found.near.primitive, found.near.distance), (&[0][..], 0, 1.0));
    assert_eq!(
        tree.closest_point(&ClosestPointQuery::new(Vec3::new(0.1, 0.1, 1.0), 0.5).within(1f32.next_down())),
        None
    );
}

#[test]
fn few_instances_are_searched_and_batches_answer_in_order() {
    let mut random = Random(7);
    let of = Arc::new(RayTree::build(&[soup(2000, 2, &mut random)], &BuildParams::default()).unwrap());
    let row = |i: usize| Instance::new(of.clone(), Pose { translation: DVec3::X * 4.0 * i as f64, ..Pose::IDENTITY });
    let tree = InstanceTree::build((0..500).map(row).collect(), &WideParams::default()).unwrap();
    let query =
        |_| ClosestPointQuery::new(random.dvec() + DVec3::X * 4.0 * below(&mut random, 500) as f64, time(&mut random));
    let mut queries: Vec<ClosestPointQuery> = (0..600).map(query).collect();
    queries[5].point.x = f64::NAN;
    let mut counters = Counters::default();
    let (mut answers, mut filtered) = (vec![None; 2], Vec::new());
    let accept = |i: usize, p: &InstancePoint| p.near.primitive as usize % 3 != i % 3;
    tree.closest_points(&queries, &mut answers);
    tree.closest_points_filtered(&queries, 1, accept, &mut filtered);
    let mut masked = Vec::new();
    tree.closest_points_masked(&queries, 1, &mut masked);
    for (i, query) in queries.iter().enumerate() {
        assert_eq!(answers[i], tree.closest_point_observed(query, &mut counters));
        assert_eq!(filtered[i], tree.closest_point_filtered(query, 1, |p| accept(i, p)));
        assert_eq!(masked[i], tree.closest_point_masked(query, 1));
        assert_eq!(answers[i].is_none(), i == 5);
    }
    // Of a million triangles.
    assert!(counters.primitive_tests < 600 * 60, "{counters:?}");
}

/// Distances along the axes count as the scales of these axes say: a tree that is flattened is not searched as one that is as small
/// in all directions.
#[test]
fn stretched_instances_are_searched_like_others() {
    let mut random = Random(17);
    for params in [BuildParams::default(), BuildParams::kd(KdParams::default())] {
        let of = Arc::new(RayTree::build(&[soup(4000, 2, &mut random)], &params).unwrap());
        let mut tests_of = |scale: DVec3| {
            let rotation = DQuat::from_axis_angle(random.dvec().normalize(), 1.0);
            let flat = Instance::new(of.clone(), Pose { scale, rotation, translation: DVec3::X });
            let inner = Arc::new(InstanceTree::build(vec![flat], &WideParams::default()).unwrap());
            let tree = Instance::new(inner, Pose { scale: DVec3::splat(0.1), ..Pose::IDENTITY });
            let tree = InstanceTree::build(vec![tree], &WideParams::default()).unwrap();
            let mut counters = Counters::default();
            for _ in 0..200 {
                let at = DVec3::X + rotation * (random.dvec() * 3.0 * scale);
                tree.closest_point_observed(&ClosestPointQuery::new(at * 0.1, time(&mut random)), &mut counters);
            }
            counters.primitive_tests
        };
        let even = tests_of(DVec3::ONE);
        for scale in [DVec3::new(1.0, 1.0, 0.5), DVec3::new(0.2, 1.0, 1.0), DVec3::new(1.0, 0.01, 3.0)] {
            let stretched = tests_of(scale);
            assert!(stretched < 4 * even, "{scale}: {stretched} tests instead of {even}");
        }
    }
}

/// So do lengths under a shear: in every direction as long as their images.
#[test]
fn sheared_instances_are_searched_like_others() {
    let mut random = Random(18);
    let of = Arc::new(RayTree::build(&[soup(4000, 2, &mut random)], &BuildParams::default()).unwrap());
    let mut tests_of = |matrix3: DMat3| {
        let rotation = DQuat::from_axis_angle(random.dvec().normalize(), 1.0);
        let placed =
            Instance::new(of.clone(), DAffine3 { matrix3: DMat3::from_quat(rotation) * matrix3, ..DAffine3::IDENTITY });
        // A rotation between a scale and another scale is a shear as well.
        let inner = Arc::new(InstanceTree::build(vec![placed], &WideParams::default()).unwrap());
        let tree = Instance::new(inner, Pose { scale: DVec3::new(0.1, 0.1, 0.05), ..Pose::IDENTITY });
        let tree = InstanceTree::build(vec![tree], &WideParams::default()).unwrap();
        let mut counters = Counters::default();
        for _ in 0..200 {
            let time = time(&mut random);
            let at = tree.matrix(&[0, 0], time).unwrap().transform_point3(random.dvec() * 3.0);
            tree.closest_point_observed(&ClosestPointQuery::new(at, time), &mut counters);
        }
        counters.primitive_tests
    };
    let even = tests_of(DMat3::IDENTITY);
    for shear in [0.5, 3.0, 20.0] {
        let sheared =
            tests_of(DMat3::from_cols(DVec3::X, DVec3::new(shear, 1.0, 0.0), DVec3::new(0.0, -0.3 * shear, 1.0)));
        assert!(sheared < 4 * even, "{shear}: {sheared} tests instead of {even}");
    }
}
