//! Secondary rays do not hit the surface that they leave, and begin right at it.

use super::common::{Blob, Random, mapped_to_f64, soup};
use core::ops::ControlFlow;
use mbkd::glam::{DAffine3, DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, Hit, Instance, InstanceTree, Intersection, KdParams, LinearBounds, MovingSphere, Pose, Primitive, Ray,
    RayTree, Shape, TimeInterval, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// Times outside of the shutter.
const OUTSIDE: [f32; 3] = [-0.1, 1.1, f32::NAN];

/// A direction in one of the half spaces, rather often along the surface.
fn direction(random: &mut Random, normal: Vec3) -> Vec3 {
    let any = random.vec();
    let flat = any - normal * any.dot(normal);
    let away = normal * if random.unit() < 0.5 { 1.0 } else { -1.0 };
    flat.normalize_or_zero() + away * 10f32.powf(1.0 - 4.0 * random.unit())
}

/// A ray to a scene of some size, from up to so many powers of ten times as far away.
fn from_around(random: &mut Random, at: DVec3, size: f64, powers: f64) -> Ray {
    let far = 10f64.powf(powers * f64::from(random.unit()));
    let origin = at + random.vec().as_dvec3() * size * far;
    let to = at + random.vec().as_dvec3() * size;
    Ray::new(origin, (to - origin).as_vec3()).at_time(random.unit())
}

/// Whether a ray hits a primitive.
fn hits(tree: &RayTree, ray: &Ray, of: &Hit) -> bool {
    let mut found = false;
    let _ = tree.all_hits(ray, |hit| {
        found |= (hit.mesh, hit.primitive) == (of.mesh, of.primitive);
        ControlFlow::Continue(())
    });
    found
}

/// Moved and scaled copies of a mesh's keys.
fn placed(mesh: &TriangleMesh, by: f64, to: DVec3, kind: usize) -> TriangleMesh {
    let wide = mapped_to_f64(mesh, |p| p * by + to);
    let narrow: Vec<Vec<Vec3>> = wide.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
    match kind {
        0 => TriangleMesh::new(mesh.indices.to_vec(), narrow),
        1 => TriangleMesh::new(mesh.indices.to_vec(), wide),
        _ => TriangleMesh::new(mesh.indices.to_vec(), wide).precise(),
    }
}

#[test]
fn secondary_rays_do_not_hit_the_triangle_that_they_leave() {
    let mut random = Random(41);
    let (mut naive, mut all) = (0, 0);
    for round in 0..60 {
        let keys = [1, 2, 5][round % 3];
        let size = [1e-12, 1e-3, 1.0, 1e6][round % 4];
        let at = DVec3::new(0.3, -1.0, 0.7) * size * [0.0, 0.0, 30.0, 1e4][random.below(4)];
        let mesh = placed(&soup(300, keys, 0.4, 0.2, round as u64), size, at, random.below(3));
        let params = if round % 5 == 4 { BuildParams::kd(KdParams::default()) } else { BuildParams::default() };
        let tree = RayTree::build(&[mesh], &params).unwrap();
        for _ in 0..200 {
            let ray = from_around(&mut random, at, size, 4.0);
            let Some(hit) = tree.closest_hit(&ray) else { continue };
            let normal = tree.triangle_normal(&hit, ray.time);
            let dir = direction(&mut random, normal) * 10f32.powf(8.0 * random.unit() - 4.0);
            let leaving = tree.secondary_ray(&ray, &hit, dir);
            assert_eq!((leaving.dir, leaving.time, leaving.t_min, leaving.t_max), (dir, ray.time, 0.0, f32::INFINITY));
            assert!(!hits(&tree, &leaving, &hit), "round {round}: {ray:?}, {hit:?}, {leaving:?}");
            let [a, b, c] = tree.vertices(&hit, ray.time);
            let unit = (b - a).cross(c - a).normalize();
            let height = (leaving.origin - a).dot(unit);
            // Thin triangles may need more.
            let most = 1e-9 * size + 1e-13 * at.length();
            assert!(height.abs() < most, "{height} of {size}");
            assert!(height * unit.dot(dir.as_dvec3()) > 0.0);
            let seen = ray.point(hit.t);
            assert!((leaving.origin - seen).length() < 1e-6 * (size + (seen - ray.origin).length()) + most);
            naive += usize::from(hits(&tree, &Ray { origin: seen, ..leaving }, &hit));
            all += 1;
        }
    }
    println!("{naive} of {all} rays from the point of the hit hit it again");
    assert!(all > 3000 && naive > all / 4, "{naive} of {all} rays from the point of the hit hit it again");
}

/// Something far away, as a moon or a backdrop is, changes nothing near by.
#[test]
fn far_objects_do_not_move_secondary_rays_further() {
    let mut random = Random(44);
    let mut all = 0;
    for (round, far) in [1.0, 1e5, 1e11, 3e20].into_iter().cycle().take(24).enumerate() {
        let size = [1e-3, 1.0, 50.0][round % 3];
        let at = DVec3::new(0.2, -0.4, 0.3) * size * [0.0, 1.0, 10.0][round / 3 % 3];
        let mesh = placed(&soup(200, 1 + round % 3, 0.4, 0.2, round as u64), size, at, 2 * (round / 4 % 2));
        let beyond = |i: f64| (DVec3::new(1.0, i, 0.5) * far * size).as_vec3();
        let backdrop = TriangleMesh::fixed(vec![[0, 1, 2]], vec![beyond(0.1), beyond(0.2), beyond(-0.3)]);
        let moon = Shape::from(MovingSphere::fixed(DVec3::new(0.1, 0.2, -1.0) * far * size, 0.3 * far * size));
        let (meshes, shapes) = if round % 5 == 0 { (vec![mesh, backdrop], vec![]) } else { (vec![mesh], vec![moon]) };
        let tree = RayTree::of_scene(&meshes, shapes, &BuildParams::default()).unwrap();
        for _ in 0..200 {
            let ray = from_around(&mut random, at, size, 1.0);
            let Some(hit) = tree.closest_hit(&ray).filter(|hit| hit.mesh == 0) else { continue };
            let normal = tree.triangle_normal(&hit, ray.time);
            let leaving = tree.secondary_ray(&ray, &hit, direction(&mut random, normal));
            assert!(!hits(&tree, &leaving, &hit), "round {round}: {ray:?}, {hit:?}, {leaving:?}");
            let [a, b, c] = tree.vertices(&hit, ray.time);
            let height = (leaving.origin - a).dot((b - a).cross(c - a).normalize());
            assert!(height.abs() < 1e-9 * size + 1e-10 * at.length(), "{height} of {size} beside {far}");
            all += 1;
        }
    }
    assert!(all > 1000, "{all}");
}

#[test]
fn secondary_rays_leave_spheres_or_cross_them() {
    let mut random = Random(42);
    let (mut outward, mut inward) = (0, 0);
    for round in 0..40 {
        let size = [1e-9, 1.0, 1e5][round % 3];
        let at = DVec3::new(0.3, -1.0, 0.7) * size * [0.0, 30.0, 1e5][random.below(3)];
        let ball = |random: &mut Random| {
            let mut key = || (at + random.vec().as_dvec3() * size, size * f64::from(0.02 + 0.1 * random.unit()));
            let keys = vec![key(), key(), key()];
            Shape::from(MovingSphere::new(keys))
        };
        let shapes: Vec<Shape> = (0..40).map(|_| ball(&mut random)).collect();
        let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO; 3]);
        let tree = RayTree::of_scene(&[mesh], shapes, &BuildParams::default()).unwrap();
        for _ in 0..300 {
            let ray = from_around(&mut random, at, size, 7.0);
            let Some(hit) = tree.closest_hit(&ray) else { continue };
            let sphere = tree.shape(hit.primitive).and_then(Primitive::as_sphere).expect("a sphere");
            let (center, radius) = sphere.at(ray.time);
            let at_first = tree.secondary_ray(&ray, &hit, Vec3::X).origin;
            let normal = (at_first - center).normalize();
            let most = 1e-9 * radius + 1e-13 * at.length();
            assert!(((at_first - center).length() - radius).abs() < most);
            let dir = direction(&mut random, normal.as_vec3());
            let leaving = tree.secondary_ray(&ray, &hit, dir);
            let cosine = -dir.as_dvec3().normalize().dot(normal);
            if cosine < 0.0 {
                outward += 1;
                assert!(!hits(&tree, &leaving, &hit), "{ray:?}, {hit:?}, {leaving:?}");
            } else if cosine > 0.01 {
                inward += 1;
                let chord = 2.0 * radius * cosine;
                let mut found = Vec::new();
                let _ = tree.all_hits(&leaving, |other| {
                    found.extend((other.primitive == hit.primitive).then_some(other.t));
                    ControlFlow::Continue(())
                });
                let [t] = found[..] else { panic!("{found:?}") };
                let length = f64::from(t) * f64::from(dir.length());
                assert!((length - chord).abs() < 1e-5 * radius + 100.0 * most, "{length} instead of {chord}");
            }
        }
    }
    assert!(outward > 500 && inward > 400, "{outward}, {inward}");
}

/// Spheres are left as such in every tree, also behind a custom type that names its sphere; what hides its sphere is left as an
/// unknown surface.
#[test]
fn rays_leave_spheres_as_such_behind_custom_types_too() {
    /// Knows its normals, but not that it is a sphere.
    struct Sided(MovingSphere);
    impl Primitive for Sided {
        fn bounds(&self, over: TimeInterval) -> LinearBounds {
            self.0.bounds(over)
        }
        fn intersect(&self, ray: &Ray) -> Option<Intersection> {
            self.0.intersect(ray)
        }
        fn surface_normal(&self, ray: &Ray, hit: Intersection) -> Option<DVec3> {
            Some(3.0 * (ray.point(hit.t) - self.0.at(ray.time).0))
        }
    }
    let mut random = Random(44);
    let mut key = || (random.vec().as_dvec3(), 0.1 + 0.1 * f64::from(random.unit()));
    let balls: Vec<MovingSphere> = (0..40).map(|_| MovingSphere::new(vec![key(), key()])).collect();
    let params = BuildParams::default();
    let scene = |shape: fn(MovingSphere) -> Shape| {
        RayTree::of_scene(&[], balls.iter().cloned().map(shape).collect(), &params).unwrap()
    };
    let (spheres, named) = (scene(Shape::from), scene(|ball| Shape::custom(Blob::named(ball))));
    let unknown = scene(|ball| Shape::custom(Blob::hidden(ball)));
    let sided = scene(|ball| Shape::custom(Sided(ball)));
    let placed =
        Instance::new(Arc::new(scene(|ball| Shape::custom(Sided(ball)))), DAffine3::from_scale(DVec3::splat(2.0)));
    let placed = InstanceTree::build(vec![placed], &WideParams::default()).unwrap();
    let (mut all, mut apart) = (0, 0);
    for _ in 0..500 {
        let ray = from_around(&mut random, DVec3::ZERO, 1.0, 5.0);
        let Some(hit) = spheres.closest_hit(&ray) else { continue };
        let dir = random.vec();
        let exact = spheres.secondary_ray(&ray, &hit, dir);
        assert_eq!(named.secondary_ray(&ray, &hit, dir), exact);
        let rough = unknown.secondary_ray(&ray, &hit, dir);
        assert_eq!(unknown.surface_normal(&ray, &hit), Vec3::ZERO);
        let (normal, seen) = (spheres.surface_normal(&ray, &hit), ray.point(hit.t));
        assert_eq!(spheres.interaction(&ray, &hit).point(), spheres.point_at(&ray, &hit, ray.time).unwrap());
        assert!(OUTSIDE.iter().all(|&time| spheres.point_at(&ray, &hit, time).is_none()));
        assert_eq!(
            (unknown.interaction(&ray, &hit).point(), unknown.interaction(&ray, &hit).normal()),
            (seen, Vec3::ZERO)
        );
        let distance = (seen - ray.origin).length();
        // The point that the normal is taken at is as coarse as `t`.
        let (known, coarse) = (sided.surface_normal(&ray, &hit), 1e-5 + 3e-6 * distance);
        assert!(f64::from((known - normal).length()) < coarse);
        let lifted = sided.secondary_ray(&ray, &hit, dir).origin - seen;
        let side = known.as_dvec3() * f64::from(known.dot(dir)).signum();
        assert!(lifted.normalize().dot(side) > 0.999 && lifted.length() < 3e-7 * distance);
        let farther = Ray { origin: ray.origin * 2.0, dir: ray.dir * 2.0, ..ray };
        let found = placed.closest_hit(&farther).unwrap();
        assert!(f64::from((placed.surface_normal(&farther, &found) - normal).length()) < coarse);
        assert!((rough.origin - seen).length() < 3e-7 * distance);
        all += 1;
        apart += usize::from(rough.origin != exact.origin);
    }
    assert!(all > 100 && apart == all, "{apart} of {all}");
}

#[test]
fn secondary_rays_leave_instances_of_instances() {
    let mut random = Random(43);
    let (mut naive, mut all) = (0, 0);
    for round in 0..60 {
        let mesh = soup(200, 1 + round % 2, 0.4, 0.2, round as u64);
        let tree = Arc::new(RayTree::build(&[mesh], &BuildParams::default()).unwrap());
        let pose = |random: &mut Random| {
            let axis = random.vec().as_dvec3().normalize();
            Pose {
                rotation: DQuat::from_axis_angle(axis, 6.0 * f64::from(random.unit())),
                translation: 5.0 * random.vec().as_dvec3(),
                scale: 0.8 + 0.5 * random.vec().as_dvec3(),
            }
        };
        let mut some = |of: Instance| {
            (0..3)
                .map(|_| Instance { transform: vec![pose(&mut random), pose(&mut random)].into(), ..of.clone() })
                .collect()
        };
        let inner = InstanceTree::build(some(Instance::new(tree, DAffine3::IDENTITY)), &WideParams::default()).unwrap();
        let outer = some(Instance::new(Arc::new(inner), DAffine3::IDENTITY));
        let tree = InstanceTree::build(outer, &WideParams::default()).unwrap();
        let bounds = tree.bounds().unwrap();
        let at = |random: &mut Random| bounds.min + (0.5 + 0.5 * random.vec().as_dvec3()) * (bounds.max - bounds.min);
        for _ in 0..400 {
            let (from, to) = (at(&mut random), at(&mut random));
            let ray = Ray::new(from, (to - from).as_vec3()).at_time(random.unit());
            let Some(hit) = tree.closest_hit(&ray) else { continue };
            let normal = tree.triangle_normal(&hit, ray.time);
            let dir = direction(&mut random, normal);
            let again = |ray: &Ray| {
                let mut found = false;
                let _ = tree.all_hits(ray, |other| {
                    found |= other.path == hit.path && other.hit.primitive == hit.hit.primitive;
                    ControlFlow::Continue(())
                });
                found
            };
            let leaving = tree.secondary_ray(&ray, &hit, dir);
            assert!(!again(&leaving), "round {round}: {ray:?}, {hit:?}, {leaving:?}");
            let seen = ray.point(hit.hit.t);
            assert!((leaving.origin - seen).length() < 1e-5, "{} {seen}", leaving.origin);
            naive += usize::from(again(&Ray { origin: seen, ..leaving }));
            all += 1;
        }
    }
    println!("{naive} of {all} rays from the point of the hit hit it again");
    assert!(all > 300 && naive > all / 4, "{naive} of {all}");
}

#[test]
fn points_of_surfaces_are_found_again_at_other_times() {
    let mut random = Random(46);
    let (mut of_triangles, mut of_spheres) = (0, 0);
    for round in 0..20 {
        let mesh = soup(60, 1 + round % 3, 0.4, 0.3, round as u64);
        let ball = |random: &mut Random| {
            let mut key = || (random.vec().as_dvec3(), f64::from(0.1 + 0.1 * random.unit()));
            Shape::from(MovingSphere::new(vec![key(), key()]))
        };
        let shapes: Vec<Shape> = (0..20).map(|_| ball(&mut random)).collect();
        let inner = Arc::new(RayTree::of_scene(&[mesh], shapes, &BuildParams::default()).unwrap());
        let poses = [0.3, 1.4].map(|angle| Pose {
            rotation: DQuat::from_rotation_y(angle),
            translation: random.vec().as_dvec3(),
            scale: DVec3::splat(f64::from(0.5 + random.unit())),
        });
        let outer =
            InstanceTree::build(vec![Instance::new(inner.clone(), poses.to_vec())], &WideParams::default()).unwrap();
        for _ in 0..100 {
            let ray = from_around(&mut random, DVec3::ZERO, 1.0, 0.5);
            let then = random.unit();
            if let Some(hit) = inner.closest_hit(&ray) {
                let now = inner.point_at(&ray, &hit, ray.time).unwrap();
                let seen = ray.point(hit.t);
                assert!(now.distance(seen) < 1e-5 * (1.0 + ray.origin.length()), "{now} {seen}");
                let other = inner.point_at(&ray, &hit, then).unwrap();
                let surface = inner.interaction(&ray, &hit);
                assert_eq!((surface.point(), surface.normal()), (now, inner.surface_normal(&ray, &hit)));
                assert_eq!(surface.secondary_ray(Vec3::X), inner.secondary_ray(&ray, &hit, Vec3::X));
                assert!(OUTSIDE.iter().all(|&time| inner.point_at(&ray, &hit, time).is_none()));
                match inner.shape(hit.primitive).filter(|_| hit.mesh == 1).and_then(Primitive::as_sphere) {
                    Some(sphere) => {
                        let ([(a, r), (b, s)], of_spheres) = ([ray.time, then].map(|t| sphere.at(t)), &mut of_spheres);
                        assert!(((now - a) / r).distance((other - b) / s) < 1e-9);
                        let normal = inner.surface_normal(&ray, &hit).as_dvec3();
                        assert!(normal.distance((now - a) / r) < 1e-6, "{normal}");
                        *of_spheres += 1;
                    }
                    _ => {
                        let [a, b, c] = inner.vertices(&hit, then);
                        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
                        let at = a * (1.0 - u - v) + b * u + c * v;
                        assert!(other.distance(at) < 1e-12);
                        assert_eq!(inner.surface_normal(&ray, &hit), inner.triangle_normal(&hit, ray.time));
                        of_triangles += 1;
                    }
                }
            }
            if let Some(hit) = outer.closest_hit(&ray) {
                let now = outer.point_at(&ray, &hit, ray.time).unwrap();
                assert!(now.distance(ray.point(hit.hit.t)) < 1e-5 * (1.0 + ray.origin.length()));
                let surface = outer.interaction(&ray, &hit);
                assert_eq!((surface.point(), surface.normal()), (now, outer.surface_normal(&ray, &hit)));
                for dir in [surface.normal(), -surface.normal()] {
                    let leaving = surface.secondary_ray(dir);
                    let lift = (leaving.origin - surface.point()).dot(dir.as_dvec3());
                    assert!(lift > 0.0 && lift < 1e-8, "{lift}");
                    assert_eq!((leaving, leaving.time), (outer.secondary_ray(&ray, &hit, dir), ray.time));
                }
                // In the instance's space, too, the point is where the motion of the primitive takes it.
                let [from, to] = [ray.time, then].map(|t| outer.matrix(&hit.path, t).unwrap());
                let inward = from.inverse();
                let local = Ray {
                    origin: inward.transform_point3(ray.origin),
                    dir: (inward.matrix3 * ray.dir.as_dvec3()).as_vec3(),
                    ..ray
                };
                let inside = inner.point_at(&local, &hit.hit, then).unwrap();
                let other = outer.point_at(&ray, &hit, then).unwrap();
                assert!(OUTSIDE.iter().all(|&time| outer.point_at(&ray, &hit, time).is_none()));
                assert!(other.distance(to.transform_point3(inside)) < 1e-12);
                let (normal, of_placed) = (outer.surface_normal(&ray, &hit), inner.surface_normal(&local, &hit.hit));
                let expected = (from.matrix3 * of_placed.as_dvec3()).normalize().as_vec3();
                assert!(normal.distance(expected) < 1e-4, "{normal} {expected}");
            }
        }
        let ray = Ray::new(Vec3::ZERO, Vec3::X);
        // Shapes are the second mesh, with fewer primitives than the first.
        for (mesh, primitive) in [(7, 900), (7, 3), (2, 0), (0, 60), (1, 20)] {
            let none = Hit { t: 1.0, u: 0.1, v: 0.1, mesh, primitive };
            assert_eq!((inner.point_at(&ray, &none, 0.5), inner.surface_normal(&ray, &none)), (None, Vec3::ZERO));
            let unknown = inner.interaction(&ray, &none);
            assert_eq!((unknown.point(), unknown.normal()), (ray.point(none.t), Vec3::ZERO));
        }
    }
    assert!(of_triangles > 300 && of_spheres > 300, "{of_triangles} {of_spheres}");
}

/// The placed corners of a sliver far from zero do not determine its normal; the sliver itself and its matrix do.
#[test]
fn normals_of_instances_far_away_are_those_of_what_is_placed() {
    let sliver = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-8, 0.3e-8)];
    let wide = [Vec3::new(0.0, 5.0, 0.0), Vec3::new(4.0, 5.0, 0.0), Vec3::new(0.0, 9.0, 0.0)];
    let mesh = TriangleMesh::fixed(vec![[0, 1, 2], [3, 4, 5]], [sliver, wide].concat());
    let tree = Arc::new(RayTree::build(&[mesh], &BuildParams::default()).unwrap());
    let near = tree.triangle_normal(&Hit { t: 1.0, u: 0.1, v: 0.1, mesh: 0, primitive: 0 }, 0.0).as_dvec3();
    for far in [0.0, 1e6, 1e9] {
        for mirrored in [1.0, -1.0] {
            let scale = DVec3::new(1.0, 2.0 * mirrored, 0.5);
            let rotation = DQuat::from_rotation_x(0.7);
            let pose = Pose { rotation, scale, translation: DVec3::new(far, -far, 0.5 * far) };
            let placed = InstanceTree::build(vec![Instance::new(tree.clone(), pose)], &WideParams::default()).unwrap();
            let matrix = placed.matrix(&[0], 0.0).unwrap();
            let origin = matrix.transform_point3(DVec3::new(1.0, 6.0, 3.0));
            let mut hit = placed.closest_hit(&Ray::new(origin, (matrix.matrix3 * DVec3::NEG_Z).as_vec3())).unwrap();
            assert_eq!(hit.hit.primitive, 1);
            hit.hit.primitive = 0;
            let (normal, expected) =
                (placed.triangle_normal(&hit, 0.0), (rotation * (near / scale)).normalize().as_vec3());
            assert!(normal.distance(expected) < 1e-6, "{normal} {expected} at {far}");
        }
    }
}
