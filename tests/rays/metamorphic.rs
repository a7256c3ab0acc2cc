//! Metamorphic relations: transformations that must not change answers.

use crate::common::{Random, all_hits, random_ray, soup, variants};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Keys, Ray, RayTree, TimeInterval, TriangleMesh};

fn keys(mesh: &TriangleMesh) -> Vec<Vec<Vec3>> {
    let Keys::F32(keys) = &mesh.keys else { unreachable!() };
    keys.clone()
}

fn rays(n: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..n).map(|_| random_ray(&mut random, 1.5)).collect()
}

#[test]
fn time_reversal() {
    // Times that are exact both ways, so that positions are too: interpolation is symmetric.
    let mesh = soup(400, 3, 0.3, 0.6, 1);
    let mut reversed = keys(&mesh);
    reversed.reverse();
    let reversed = TriangleMesh::new(mesh.indices.clone(), reversed);
    for params in variants() {
        let forward = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        let backward = RayTree::build(std::slice::from_ref(&reversed), &params).unwrap();
        for (i, ray) in rays(4000, 2).iter().enumerate() {
            let time = (i % 65) as f32 / 64.0;
            if time == 0.25 || time == 0.75 {
                continue; // half way between keys the base changes, and with it the rounding
            }
            let (a, b) = (forward.closest_hit(&ray.at_time(time)), backward.closest_hit(&ray.at_time(1.0 - time)));
            assert_eq!(a, b, "{params:?} {ray:?} at {time}");
        }
    }
}

#[test]
fn order_of_meshes() {
    let meshes: Vec<TriangleMesh> = (0..5).map(|i| soup(80, 1 + i, 0.3, 0.4, i as u64)).collect();
    let order = [3, 0, 4, 1, 2];
    let permuted: Vec<TriangleMesh> = order.iter().map(|&i| meshes[i].clone()).collect();
    for params in variants() {
        let (a, b) = (RayTree::build(&meshes, &params).unwrap(), RayTree::build(&permuted, &params).unwrap());
        for ray in rays(4000, 3) {
            let expected = all_hits(&a, &ray);
            let mut got = all_hits(&b, &ray);
            got.iter_mut().for_each(|hit| hit.mesh = order[hit.mesh as usize] as u32);
            got.sort_by_key(|hit| (hit.mesh, hit.primitive));
            assert_eq!(got, expected, "{params:?} {ray:?}");
        }
    }
}

#[test]
fn standing_still_at_many_keys_is_standing_still() {
    let still = soup(400, 1, 0.3, 0.0, 9);
    let base = keys(&still).remove(0);
    let many = TriangleMesh::new(still.indices.clone(), vec![base.clone(); 5]);
    for params in variants() {
        let a = RayTree::build(std::slice::from_ref(&still), &params).unwrap();
        let b = RayTree::build(std::slice::from_ref(&many), &params).unwrap();
        assert_eq!(a.statistics().references, b.statistics().references);
        assert_eq!(b.statistics().timed, 0.0);
        for ray in rays(2000, 4) {
            assert_eq!(a.closest_hit(&ray), b.closest_hit(&ray), "{params:?} {ray:?}");
            assert_eq!(a.closest_hit(&ray), a.closest_hit(&ray.at_time(0.5)));
        }
    }
}

#[test]
fn moving_along_with_the_ray() {
    // A rigid motion by whole numbers at whole eighths of the shutter changes nothing but the place.
    let still = soup(300, 1, 0.3, 0.0, 12);
    let open: Vec<Vec3> = keys(&still)[0].iter().map(|p| (p * 1024.0).round() / 1024.0).collect();
    let close: Vec<Vec3> = open.iter().map(|p| p + Vec3::new(8.0, -16.0, 0.0)).collect();
    let fixed = TriangleMesh::fixed(still.indices.clone(), open.clone());
    let moving = TriangleMesh::new(still.indices.clone(), vec![open, close]);
    for params in variants() {
        let a = RayTree::build(std::slice::from_ref(&fixed), &params).unwrap();
        let b = RayTree::build(std::slice::from_ref(&moving), &params).unwrap();
        for (i, ray) in rays(3000, 5).iter().enumerate() {
            let time = (i % 9) as f32 / 8.0;
            let moved = Ray { origin: ray.origin + DVec3::new(8.0, -16.0, 0.0) * f64::from(time), ..*ray };
            let (x, y) = (a.closest_hit(ray), b.closest_hit(&moved.at_time(time)));
            // The two trees have different frames, so distances agree up to rounding.
            match (x, y) {
                (Some(x), Some(y)) if x.primitive == y.primitive => assert!((x.t - y.t).abs() < 1e-4, "{x:?} {y:?}"),
                (x, y) => assert_eq!(x.is_some(), y.is_some(), "{params:?} {ray:?} at {time}"),
            }
        }
    }
}

#[test]
fn what_is_not_there_yet_is_not_hit() {
    let half = TimeInterval::new(0.25, 0.5).unwrap();
    let mesh = soup(300, 2, 0.4, 0.3, 6);
    let part = mesh.clone().with_active(half);
    for params in variants() {
        let whole = RayTree::build(std::slice::from_ref(&mesh), &params).unwrap();
        let some = RayTree::build(std::slice::from_ref(&part), &params).unwrap();
        for ray in rays(3000, 7) {
            for time in [ray.time, 0.25, 0.5, 0.5f32.next_down(), 0.25f32.next_down()] {
                let ray = ray.at_time(time);
                let expected = if half.contains(time) { whole.closest_hit(&ray) } else { None };
                assert_eq!(some.closest_hit(&ray), expected, "{params:?} {ray:?}");
            }
        }
    }
}
