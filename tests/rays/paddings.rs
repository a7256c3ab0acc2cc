//! Inputs at which the rounding, or a motion between keys, decides that a padding covers. Each test fails if its padding is left
//! out.

use crate::common::Random;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Instance, InstanceTree, KdParams, MovingSphere, Pose, Ray, RayTree, Shape,
    TriangleMesh, WideParams,
};
use std::sync::Arc;

/// In [-1, 1), with all bits of an f64.
fn signed(random: &mut Random) -> f64 {
    (random.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn dvec(random: &mut Random) -> DVec3 {
    DVec3::from_array(core::array::from_fn(|_| signed(random)))
}

/// The corner of a cube with this number.
fn corner(i: usize) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| (i >> axis & 1) as f64))
}

fn cube() -> TriangleMesh {
    let (mut faces, corners) = (Vec::new(), (0..8).map(|i| corner(i).as_vec3()).collect());
    for [x, y, z] in [[1, 2, 4], [2, 4, 1], [4, 1, 2]] {
        for side in [0, z] {
            faces.extend([[side, side + x, side + y], [side + x, side + x + y, side + y]]);
        }
    }
    TriangleMesh::fixed(faces, corners)
}

/// Rays that graze the outermost corner of a cube while it turns: its box is larger than those at the keys.
#[test]
fn corners_of_turning_instances_are_hit() {
    let tree = Arc::new(RayTree::build(&[cube()], &BuildParams::default()).unwrap());
    let oracle = BruteForce::new(&[cube()]).unwrap();
    let (mut random, mut hits) = (Random(5), 0);
    for round in 0..200 {
        let axis = dvec(&mut random).normalize();
        let turned = |i: i32| Pose { rotation: DQuat::from_axis_angle(axis, f64::from(i) * 1.3), ..Pose::IDENTITY };
        let one = Instance::new(tree.clone(), (0..2 + round % 3).map(turned).collect::<Vec<_>>());
        let placed = InstanceTree::build(vec![one.clone(), one], &WideParams::default()).unwrap();
        for _ in 0..100 {
            let time = random.unit();
            let matrix = placed.matrix(&[0], time).unwrap();
            let out = DVec3::AXES[random.below(3)] * if random.below(2) == 0 { 1.0 } else { -1.0 };
            let corners = (0..8).map(|i| matrix.transform_point3(corner(i)));
            let outermost = corners.max_by(|a, b| a.dot(out).total_cmp(&b.dot(out))).unwrap();
            let dir = dvec(&mut random);
            let dir = (dir - out * dir.dot(out)).as_vec3();
            let ray = Ray::new(outermost - out * 1e-5 - dir.as_dvec3() * 2.0, dir).at_time(time);
            let Some(local) = placed.local_ray(0, &ray) else { continue };
            let (expected, found) = (oracle.closest_hit(&local), placed.closest_hit(&ray).map(|found| found.hit));
            assert_eq!(found, expected, "round {round}: {ray:?}");
            hits += usize::from(expected.is_some());
        }
    }
    assert!(hits > 5000, "{hits}");
}

/// Instances of a tree that is modelled far from zero, which are flattened along two oblique axes: the inverse of the matrix is
/// rounded by more than f64 is, the less its determinant is.
#[test]
fn thin_instances_of_far_trees_are_hit() {
    let (mut random, mut hits) = (Random(13), 0);
    for round in 0..240 {
        let (far, thin) = ([1e8, 1e9, 1e11][round % 3], [1e-4, 3e-5][round / 3 % 2]);
        let middle = DVec3::new(1.1, 1.2, 1.3) * far;
        let middles: Vec<DVec3> = (0..40).map(|_| middle + dvec(&mut random)).collect();
        let corners = middles.iter().flat_map(|&middle| [middle; 3]);
        let vertices: Vec<DVec3> = corners.map(|p| p + dvec(&mut random) * 0.3).collect();
        let mesh = TriangleMesh::new((0..40).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), vec![vertices]);
        let tree = Arc::new(RayTree::build(&[mesh.precise()], &BuildParams::default()).unwrap());
        let mut turn = |most: f64| DMat3::from_axis_angle(dvec(&mut random).normalize(), most * signed(&mut random));
        let flat = turn(3.0) * DMat3::from_diagonal(DVec3::new(1.0, thin, thin)) * turn(3.0);
        let placed = |matrix3: DMat3| DAffine3 { matrix3, translation: -(matrix3 * middle) };
        let keys = if round % 2 == 0 { vec![placed(flat)] } else { vec![placed(flat), placed(turn(0.3) * flat)] };
        let beside = DAffine3::from_translation(DVec3::X * 3.0 - middle);
        let all = vec![Instance::new(tree.clone(), keys), Instance::new(tree.clone(), beside)];
        let all = InstanceTree::build(all, &WideParams::default()).unwrap();
        for _ in 0..100 {
            // At the middle of a triangle, as rays are mapped.
            let time = random.unit();
            let inside = tree.triangle(0, random.below(40) as u32, 0.0).iter().sum::<DVec3>() / 3.0;
            let matrix = all.matrix(&[0], time).unwrap();
            let mut target = matrix.transform_point3(inside);
            for _ in 0..3 {
                let local = all.local_ray(0, &Ray::new(target, Vec3::X).at_time(time)).unwrap();
                target += matrix.transform_vector3(inside - local.origin);
            }
            let origin = target + dvec(&mut random) * 3.0;
            let ray = Ray::new(origin, (target - origin).as_vec3()).at_time(time);
            let of = |instance: u32| Some((tree.closest_hit(&all.local_ray(instance, &ray)?)?, instance));
            let expected = [0, 1].into_iter().filter_map(of).min_by(|(a, _), (b, _)| a.t.total_cmp(&b.t));
            let found = all.closest_hit(&ray).map(|found| (found.hit, found.path[0]));
            assert_eq!(found, expected, "round {round}: {ray:?}");
            hits += usize::from(expected.is_some_and(|(_, instance)| instance == 0));
        }
    }
    assert!(hits > 5000, "{hits}");
}

/// Sheared instances in a tree that is placed itself, seen from far away: the ray is rounded in the spaces of both.
#[test]
fn sheared_instances_of_placed_trees_are_hit_from_far_away() {
    let tree = Arc::new(RayTree::build(&[cube()], &BuildParams::default()).unwrap());
    let oracle = BruteForce::new(&[cube()]).unwrap();
    let (mut random, mut hits, away) = (Random(5), 0, 1e5);
    for round in 0..400 {
        let shear = DVec3::new(signed(&mut random) * 3000.0, 1.0, 0.0);
        let matrix3 = DMat3::from_cols(DVec3::X, shear, dvec(&mut random) + DVec3::Z * 2.0);
        let instance = Instance::new(tree.clone(), DAffine3 { matrix3, translation: dvec(&mut random) });
        let inner = InstanceTree::build(vec![instance.clone(), instance], &WideParams::default()).unwrap();
        let (inner, rotation) = (Arc::new(inner), DQuat::from_rotation_z(0.3));
        let one = Instance::new(inner.clone(), DAffine3::from_quat(rotation));
        let outer = InstanceTree::build(vec![one.clone(), one], &WideParams::default()).unwrap();
        let all = outer.matrix(&[0, 0], 0.0).unwrap();
        for _ in 0..400 {
            // About as far beside a corner as the direction is rounded by.
            let beside = signed(&mut random) * shear.x * away / f64::from(1 << 24);
            let target = all.transform_point3(corner(random.below(8))) + rotation * DVec3::X * beside;
            let origin = target + dvec(&mut random) * away;
            let ray = Ray::new(origin, (target - origin).as_vec3());
            let Some(local) = outer.local_ray(0, &ray).and_then(|local| inner.local_ray(0, &local)) else { continue };
            let (expected, found) = (oracle.closest_hit(&local), outer.closest_hit(&ray).map(|found| found.hit));
            assert_eq!(found, expected, "round {round}: {ray:?}");
            hits += usize::from(expected.is_some());
        }
    }
    assert!(hits > 10_000, "{hits}");
}

/// Queries at corners of triangles that are placed by sheared matrices: what the query is rounded by in the placed tree counts.
#[test]
fn closest_points_under_sheared_matrices_are_the_same_in_all_layouts() {
    let mut random = Random(11);
    for round in 0..200 {
        let whole = |random: &mut Random| (dvec(random) * 4.0).round().as_vec3();
        let triangle = |random: &mut Random| {
            let p = whole(random);
            [p, p + whole(random) * 0.25, p + whole(random) * 0.25]
        };
        let vertices: Vec<Vec3> = (0..100).flat_map(|_| triangle(&mut random)).collect();
        let indices = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = [TriangleMesh::fixed(indices, vertices.clone())];
        let shear = DVec3::new(10f64.powi(round % 5), 1.0, 0.0);
        let matrix3 = DMat3::from_cols(DVec3::X, shear, dvec(&mut random) + DVec3::Z * 2.0);
        let matrix = DAffine3 { matrix3, translation: dvec(&mut random) * 100.0 };
        let [kd, wide] = [BuildParams::kd(KdParams::default()), BuildParams::default()].map(|params| {
            let tree = Arc::new(RayTree::build(&mesh, &params).unwrap());
            InstanceTree::build(vec![Instance::new(tree, matrix)], &WideParams::default()).unwrap()
        });
        for at in vertices.iter().step_by(3) {
            let query = ClosestPointQuery::new(matrix.transform_point3(at.as_dvec3()), 0.0);
            assert_eq!(kd.closest_point(&query), wide.closest_point(&query), "round {round}");
        }
    }
}

/// Spheres that are equally near to a query, which f32 cannot tell from each other.
#[test]
fn the_nearest_of_spheres_that_touch_one_around_the_query_is_that_of_brute_force() {
    let mut random = Random(9);
    for round in 0..300 {
        let (at, distance) = (dvec(&mut random) * [1.0, 100.0][round % 2], 0.1 + signed(&mut random).abs());
        let sphere = |random: &mut Random| {
            let (dir, radius) = (dvec(random).normalize(), 0.1 + signed(random).abs());
            // The query is outside of it, or inside.
            let outside = random.below(2) == 0 || radius < distance;
            MovingSphere::fixed(at + dir * if outside { distance + radius } else { radius - distance }, radius)
        };
        let spheres: Vec<MovingSphere> = (0..16).map(|_| sphere(&mut random)).collect();
        let shapes = || spheres.iter().cloned().map(Shape::from).collect();
        let oracle = BruteForce::of_scene(&[], shapes()).unwrap();
        let tree = RayTree::of_scene(&[], shapes(), &BuildParams::default()).unwrap();
        let query = ClosestPointQuery::new(at, 0.0);
        assert_eq!(tree.closest_point(&query), oracle.closest_point(&query), "round {round}");
    }
}
