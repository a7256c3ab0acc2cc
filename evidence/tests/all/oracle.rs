//! The oracle itself: hand-computed cases, exact identities, and perturbations that it must notice.

use mbkd::glam::{DVec3, Vec3};
use mbkd::{MovingSphere, Ray, TimeInterval};
use mbkd_evidence::oracle::*;

fn still(p: DVec3) -> Moving {
    Moving::new(0.0, 1, Given::F32, |_| p)
}

fn meet(ray: &Ray, corners: [DVec3; 3]) -> Meeting {
    let corners = corners.map(still);
    let [a, b, c] = &corners;
    meet_triangle(&ExactRay::new(ray, Given::F32), [a, b, c])
}

/// A right triangle in the plane z = 1/3 as f32 has it.
fn triangle() -> [DVec3; 3] {
    let z = f64::from(1.0f32 / 3.0);
    [DVec3::new(0.0, 0.0, z), DVec3::new(1.0, 0.0, z), DVec3::new(0.0, 1.0, z)]
}

#[test]
fn sums_and_products_lose_nothing() {
    let (large, small) = (Dyadic::new(1e300), Dyadic::new(-1e-300));
    let sum = &large + &small;
    assert_eq!(&sum - &large, small);
    assert_eq!((&large * &small).to_f64(), -1.0);
    assert!(sum < large && large.cmp(&sum).is_gt());
    for x in [0.0, -0.0, 1.0, -7.25, 0.1, 5e-324, f64::MIN_POSITIVE, f64::MAX, 3e-310] {
        assert_eq!(Dyadic::new(x).to_f64(), x, "{x:e} there and back");
    }
    let third = Ratio::new(Dyadic::new(1.0), Dyadic::new(-3.0)).unwrap();
    assert_eq!(third.to_f64(), -1.0 / 3.0);
    assert!(third.cmp_float(-1.0 / 3.0).is_ne(), "a third is no float");
    let error = third.error_of(-1.0 / 3.0);
    assert!(error.abs() < 2e-17 && error != 0.0);
    assert_eq!(Ratio::new(Dyadic::new(1.0), Dyadic::zero()), None);
}

#[test]
fn square_roots_are_enclosed() {
    for x in [2.0f64, 0.1, 1e-300, 3e17, 4.0] {
        let exact = Dyadic::new(x);
        let (below, above) = exact.sqrt_between(200);
        assert!(below.squared() <= exact && exact < above.squared());
        assert!(((&above - &below).to_f64() / below.to_f64()) < 1e-59);
        assert!((below.to_f64() / x.sqrt() - 1.0).abs() < 1e-15);
    }
    assert_eq!(Dyadic::new(4.0).sqrt_between(100).0, Dyadic::new(2.0));
}

#[test]
fn spacing_of_floats() {
    for x in [1.0f32, 1.5, 3.99, 1e-3, 1e30, 1e-38, 1e-40, f32::MIN_POSITIVE] {
        assert_eq!(ulp32(x.into()), f64::from(x.next_up()) - f64::from(x), "{x:e}");
    }
    assert_eq!(ulp32(0.0), f64::from(f32::from_bits(1)));
}

#[test]
fn positions_between_keys() {
    let key = |i: usize| DVec3::new(i as f64, 0.1f32.into(), (i * i) as f64);
    // Time 0.3f32 among 11 keys is not the third key.
    let at = Moving::new(0.3, 11, Given::F32, key);
    let third = f64::from(0.3f32) * 10.0; // exact in f64
    assert_eq!(at.position.0[0], Dyadic::new(third));
    assert_eq!(at.position.0[1], Dyadic::new(0.1f32));
    assert_eq!(at.position.0[2].to_f64(), 9.0 + (third - 3.0) * 7.0);
    assert_eq!(Moving::new(1.0, 11, Given::F32, key).near, key(10));
    assert_eq!(Moving::new(0.0, 11, Given::F32, key).near, key(0));
    // The doubt: half an ulp of where it is, and what it moves in half an ulp of time.
    let doubt = at.doubt.x / HALF_ULP_F32;
    assert!((doubt - (third + third)).abs() < 1e-3, "{doubt}");
}

#[test]
fn a_ray_meets_a_triangle() {
    let ray = Ray::new(Vec3::new(0.25, 0.5, -1.0), Vec3::Z * 2.0);
    let met = meet(&ray, triangle());
    assert!(met.hit && met.margin > 1e5);
    let z = &Dyadic::new(1.0f32 / 3.0) + &Dyadic::new(1.0);
    assert_eq!(met.t, Ratio::new(z, Dyadic::new(2.0)));
    let [u, v] = met.weights.unwrap();
    assert_eq!((u, v), (Ratio::of(Dyadic::new(0.25)), Ratio::of(Dyadic::new(0.5))));
    // t = (1 + z) / 2: the origin is off by 2^-24, the plane by z 2^-24, the direction by 2 t 2^-24.
    let expected = (1.0 + 1.0 / 3.0 + 4.0 / 3.0) / 2.0 * HALF_ULP_F32;
    assert!((met.t_doubt / expected - 1.0).abs() < 1e-6);
    // Beside it, before it, after it, parallel to it.
    assert!(!meet(&Ray::new(Vec3::new(0.75, 0.5, -1.0), Vec3::Z), triangle()).hit);
    assert!(!meet(&ray.between(0.0, 0.5), triangle()).hit);
    assert!(!meet(&ray.between(0.75, 9.0), triangle()).hit);
    let flat = meet(&Ray::new(Vec3::new(-1.0, 0.25, 1.0 / 3.0), Vec3::X), triangle());
    assert!(!flat.hit && flat.t.is_none());
}

#[test]
fn edges_and_corners_belong_to_the_triangle() {
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.0, 0.25), (0.75, 0.0)] {
        let met = meet(&Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z), triangle());
        assert!(met.hit, "({x}, {y})");
        assert_eq!(met.margin, 0.0);
    }
    // The least step outside is outside, and no verdict that floats could be blamed for.
    let met = meet(&Ray::new(Vec3::new(0.5, 0.5f32.next_up(), 2.0), Vec3::NEG_Z), triangle());
    assert!(!met.hit && met.margin > 0.0 && met.margin < 2.0, "{}", met.margin);
}

#[test]
fn moving_triangles_are_met_where_they_are() {
    // Rises by 1 and grows by 2 per shutter.
    let corner = |x: f64, y: f64| {
        Moving::new(0.5, 2, Given::F32, |k| DVec3::new(x, y, 0.0) * (1 + 2 * k) as f64 + DVec3::Z * k as f64)
    };
    let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)];
    let [a, b, c] = &corners;
    let ray = ExactRay::new(&Ray::new(Vec3::new(1.0, 0.5, 4.0), Vec3::NEG_Z).at_time(0.5), Given::F32);
    let met = meet_triangle(&ray, [a, b, c]);
    assert_eq!(met.t, Some(Ratio::of(Dyadic::new(3.5))));
    assert_eq!(met.weights.unwrap()[0], Ratio::of(Dyadic::new(0.5)));
    assert!(side(&Moving::new(0.0, 1, Given::F32, |_| DVec3::Z), [a, b, c]) == 1);
    assert!(side(&Moving::new(0.0, 1, Given::F32, |_| DVec3::Z * 0.5), [a, b, c]) == 0);
    assert!(side(&Moving::new(0.0, 1, Given::F32, |_| DVec3::Z * 0.25), [a, b, c]) == -1);
}

#[test]
fn the_quick_certificate_never_contradicts() {
    let mut dismissed = 0;
    for i in 0..4000 {
        let at = |k: u32| ((i as f32 * 0.618 + k as f32 * 0.7548) % 1.0) * 2.0 - 1.0;
        let corners = [0, 3, 6].map(|k| DVec3::new(at(k).into(), at(k + 1).into(), at(k + 2).into()) * 1e3 + 1e6);
        let corners = corners.map(|p| p.as_vec3().as_dvec3()).map(still);
        let origin = Vec3::new(at(9), at(10), at(11)) * 2e3 + 1e6;
        let ray = ExactRay::new(&Ray::new(origin, Vec3::new(at(12), at(13), at(14))), Given::F32);
        let [a, b, c] = &corners;
        if clearly_missed(&ray, [a, b, c].map(|m| (m.near, m.doubt)), 8.0) {
            let met = meet_triangle(&ray, [a, b, c]);
            assert!(!met.hit && met.margin > 7.9, "{met:?}");
            dismissed += 1;
        }
    }
    assert!(dismissed > 2000, "{dismissed}");
}

#[test]
fn spheres() {
    let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::new(0.0, 0.0, 4.0), -3.0)]);
    let hit = |ray: Ray| meet_sphere(&ExactRay::new(&ray, Given::F64), &ball);
    // Centre 2, radius 2 at half time.
    let ray = Ray::new(DVec3::new(0.0, 1.0, -6.0), Vec3::Z).at_time(0.5);
    let met = hit(ray);
    let exact = 8.0 - 3f64.sqrt();
    let [low, high] = met.t.unwrap();
    assert!(met.hit && low < high && high.error_of(low.to_f64()).abs() < 1e-14);
    assert!((low.to_f64() - exact).abs() < 1e-15 && met.margin > 1e6);
    assert!(!hit(Ray::new(DVec3::new(0.0, 2.0, -6.0), Vec3::Z).at_time(0.5)).hit, "tangents do not count");
    assert!(hit(Ray::new(DVec3::new(0.0, 2f64.next_down(), -6.0), Vec3::Z).at_time(0.5)).hit);
    assert_eq!(hit(ray.between(7.0, 100.0)).t.unwrap()[0].to_f64(), 8.0 + 3f64.sqrt());
    assert!(!hit(ray.between(10.0, 100.0)).hit);
}

#[test]
fn crossing_times_are_exact() {
    let (a, b) = (DVec3::new(-1.0, 0.0, 5.0), DVec3::new(2.0, 0.0, 6.0));
    let third = Ratio::new(Dyadic::new(1.0), Dyadic::new(3.0));
    assert_eq!(crossing_times(a, b, 0, [0.0, 0.0]), third);
    assert_eq!(crossing_times(a, b, 2, [0.0, 0.0]), None);
    // A plane that goes along: from 4 to 7 while the vertex goes from 5 to 6.
    assert_eq!(crossing_times(a, b, 2, [4.0, 7.0]), Ratio::new(Dyadic::new(1.0), Dyadic::new(2.0)));
    let at = |t: f32| Moving::new(t, 2, Given::F32, |k| if k == 0 { a } else { b });
    let t = third.unwrap().to_f64() as f32;
    let sides = [t.next_down(), t, t.next_up()].map(|t| side_of_axis_plane(&at(t), 0, [0.0, 0.0], &Dyadic::new(t)));
    assert_eq!((sides[0], sides[2]), (-1, 1));
    assert_ne!(sides[1], 0, "no float is a third");
}

#[test]
fn distances() {
    let point = Moving::new(0.25, 2, Given::F32, |k| DVec3::new(4.0 * k as f64, 3.0, 0.0));
    let d = ExactDistance::new(DVec3::new(5.0, 0.0, 0.0), Given::F32, &point);
    assert_eq!(d.squared, Dyadic::new(25.0));
    assert_eq!(d.error_of(25.0f32.next_up()), ulp32(25.0));
    // 2 |dx| (5 + 1 + 1) + 2 |dy| 3, in half ulps: the query, the point, its time.
    let expected = (8.0 * 7.0 + 6.0 * 3.0) * HALF_ULP_F32 + (7.0 * 7.0 + 3.0 * 3.0) * HALF_ULP_F32.powi(2);
    assert!((d.doubt / expected - 1.0).abs() < 1e-12, "{}", d.doubt / HALF_ULP_F32);
    // What lies in one place is apart by all of its doubt.
    let still = Moving::new(0.5, 1, Given::F32, |_| DVec3::X);
    let d = ExactDistance::new(DVec3::X, Given::F32, &still);
    assert_eq!((d.near, d.doubt), (0.0, (2.0 * HALF_ULP_F32).powi(2)));
}

#[test]
fn closest_approaches() {
    let full = TimeInterval::FULL;
    let find = |from: DVec3, to: DVec3, times: TimeInterval, keys: &[DVec3]| {
        approach((from, to), times, Given::F32, keys.len(), full, |k| keys[k]).unwrap()
    };
    // The point flies along x at height 3, the query stands.
    let found = find(DVec3::ZERO, DVec3::ZERO, full, &[DVec3::new(-1.0, 3.0, 0.0), DVec3::new(2.0, 3.0, 0.0)]);
    assert_eq!(found.time, Ratio::new(Dyadic::new(1.0), Dyadic::new(3.0)).unwrap());
    assert_eq!(found.squared, Ratio::of(Dyadic::new(9.0)));
    // The same with the query going the other way: they pass at a fifth.
    let found = find(DVec3::ZERO, DVec3::NEG_X * 2.0, full, &[DVec3::new(-1.0, 3.0, 0.0), DVec3::new(2.0, 3.0, 0.0)]);
    assert_eq!(found.time, Ratio::new(Dyadic::new(1.0), Dyadic::new(5.0)).unwrap());
    // Three keys, there and back; the first of two equal moments, and the nearest end of a part of the shutter.
    let there_and_back = [DVec3::X, DVec3::NEG_X, DVec3::X];
    let found = find(DVec3::ZERO, DVec3::ZERO, full, &there_and_back);
    assert_eq!((found.time.to_f64(), found.squared.sign()), (0.25, 0));
    let part = TimeInterval::new(0.375, 0.625).unwrap();
    let found = find(DVec3::ZERO, DVec3::ZERO, part, &there_and_back);
    assert_eq!((found.time.to_f64(), found.squared.to_f64()), (0.375, 0.25));
    let later = TimeInterval::new(0.75, 1.0).unwrap();
    let earlier = TimeInterval::new(0.0, 0.5).unwrap();
    assert!(approach((DVec3::ZERO, DVec3::X), earlier, Given::F32, 1, later, |_| DVec3::ZERO).is_none());
}
