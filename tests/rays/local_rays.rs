//! Rays at instances against those in the instances' own spaces: scales that multiply, and origins far away.

use crate::common::{Random, soup};
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{BuildParams, Instance, InstanceOf, InstanceTree, Pose, Ray, RayTree, WideParams};
use std::sync::Arc;

#[test]
fn poses_may_grow_at_all_levels_and_queries_equal_those_of_the_local_rays() {
    let mut random = Random(11);
    let leaf = Arc::new(RayTree::build(&[soup(60, 1, 0.5, 0.0, 5)], &BuildParams::default()).unwrap());
    let grow = |s: f64| vec![Pose { scale: DVec3::splat(s), ..Pose::IDENTITY }, Pose::IDENTITY];
    let mut tree = InstanceTree::build(vec![Instance::new(leaf, grow(1e-4))], &WideParams::default()).unwrap();
    for _ in 0..3 {
        tree = InstanceTree::build(vec![Instance::new(Arc::new(tree), grow(0.05))], &WideParams::default()).unwrap();
    }
    let mut hits = 0;
    for _ in 0..300 {
        let time = random.unit();
        let size = tree.matrix(&[0; 4], time).unwrap().matrix3.x_axis.x;
        let (from, to) = (random.vec(), random.vec());
        let origin = (4.0 * from).as_dvec3();
        let at = to.as_dvec3() * size;
        let ray = Ray::new(origin, (at - origin).as_vec3()).at_time(time);
        let InstanceOf::Instances(inner) = tree.placed(0).unwrap() else { panic!("nested") };
        let expected = inner.closest_hit(&tree.local_ray(0, &ray).unwrap());
        assert_eq!(tree.closest_hit(&ray).map(|hit| hit.hit), expected.map(|hit| hit.hit));
        hits += usize::from(expected.is_some());
    }
    assert!(hits > 20, "{hits}");
}

/// However far away a ray begins: what it hits is decided in the space of each instance.
#[test]
fn rays_from_any_distance_hit_what_their_local_rays_hit() {
    let mut random = Random(12);
    let leaf = Arc::new(RayTree::build(&[soup(60, 1, 0.5, 0.0, 5)], &BuildParams::default()).unwrap());
    let place = |of: InstanceOf, x: f64| Instance::new(of, DAffine3::from_translation(DVec3::X * x));
    let group = |of: &dyn Fn() -> InstanceOf| {
        let instances = (0..5).map(|i| place(of(), f64::from(i))).collect();
        Arc::new(InstanceTree::build(instances, &WideParams::default()).unwrap())
    };
    let flat = group(&|| leaf.clone().into());
    let nested = group(&|| flat.clone().into());
    let closest = |tree: &InstanceTree, ray: &Ray| {
        let hits = (0..5).filter_map(|i| {
            let local = tree.local_ray(i, ray)?;
            match tree.placed(i)? {
                InstanceOf::Tree(of) => of.closest_hit(&local).map(|hit| hit.t),
                InstanceOf::Instances(of) => of.closest_hit(&local).map(|found| found.hit.t),
            }
        });
        hits.min_by(f32::total_cmp)
    };
    let mut hits = 0;
    for power in (0..308).step_by(3) {
        for round in 0..24 {
            let away = 10f64.powi(power) * DVec3::AXES[round % 3];
            let dir = if round % 4 == 0 { Vec3::ONE } else { DVec3::AXES[round % 3].as_vec3() };
            let origin = random.vec().as_dvec3() * 0.5 + if round % 2 == 0 { away } else { -away };
            let ray = Ray::new(origin, if round % 2 == 0 { -dir } else { dir });
            let ray = if round % 8 < 3 { ray.between(f32::NEG_INFINITY, f32::INFINITY) } else { ray };
            for tree in [&flat, &nested] {
                let expected = closest(tree, &ray);
                assert_eq!(tree.closest_hit(&ray).map(|found| found.hit.t), expected, "{ray:?}");
                assert_eq!(tree.any_hit(&ray), expected.is_some(), "{ray:?}");
                hits += usize::from(expected.is_some());
            }
        }
    }
    assert!(hits > 50, "{hits}");
}
