//! Gathers in periodic boxes: every answer equals brute force over all images of the query's position.

use crate::gather_case::GatherCase;
use crate::periodic_queries::{Lengths, images, lengths, place};
use crate::support::Random;
use mbkd::glam::{DVec3, Vec3};
use mbkd::point::{GatherError, GatherParams, Kernel, NeighborBuffer, Photon, PhotonMap, PhotonTime};
use mbkd::{PeriodError, TimeInterval};

const WINDOW: f32 = 0.3;

/// Photons of all kinds in a box of about a size, some of them in one place.
fn photons(count: usize, size: f32, random: &mut Random) -> Vec<Photon<f32>> {
    let mut one = |i: usize| {
        let time = random.unit();
        let time = match random.bits() % 3 {
            0 => PhotonTime::At(time),
            1 => PhotonTime::During(TimeInterval::new(0.7 * time, 0.7 * time + 0.3).unwrap()),
            _ => PhotonTime::Carried { time, velocity: random.vec() * size },
        };
        let position = if i.is_multiple_of(5) { Vec3::splat(0.25 * size) } else { random.vec() * size };
        Photon { position, normal: random.vec().normalize_or(Vec3::X), flux: random.unit() + 0.1, time }
    };
    (0..count).map(&mut one).collect()
}

/// Where a photon is at a time.
fn position(photon: &Photon<f32>, t: f32) -> Vec3 {
    let PhotonTime::Carried { time, velocity } = photon.time else { return photon.position };
    let (open, close) = (photon.position - velocity * time, photon.position + velocity * (1.0 - time));
    if t < 0.5 { open + (close - open) * t } else { close + (close - open) * (t - 1.0) }
}

/// All photons that pass the tests of a query, each where it is nearest, in order of (distance, index).
fn near(case: &GatherCase, photons: &[Photon<f32>], images: &[DVec3]) -> Vec<(f32, u32)> {
    let mut near = Vec::new();
    for image in images {
        let of_image = GatherCase { at: image.as_vec3(), k: None, radius: case.radius.min(1e17), ..*case };
        let (_, found) = of_image.brute(photons);
        near.extend(found.into_iter().map(|(id, _)| {
            let d = position(&photons[id as usize], case.time) - of_image.at;
            ((d.x * d.x + d.y * d.y) + d.z * d.z, id)
        }));
    }
    near.sort_by_key(|&(distance, id)| (id, distance.to_bits()));
    near.dedup_by_key(|&mut (_, id)| id);
    near.sort_by_key(|&(distance, id)| (distance.to_bits(), id));
    near
}

/// The radius of the disc, its square, and the photons and their weights.
fn estimate(case: &GatherCase, photons: &[Photon<f32>], mut near: Vec<(f32, u32)>) -> (f32, Vec<(u32, f32)>) {
    let k = case.k.unwrap_or(usize::MAX);
    let rim = match near.get(k) {
        Some(next) => Some(next.0),
        None if case.radius == f32::INFINITY => near.pop().map(|last| last.0),
        None => None,
    };
    near.truncate(k);
    let (radius, square) = rim.map_or((case.radius, case.radius * case.radius), |square| (square.sqrt(), square));
    let [space, clock] = case.kernels;
    let duration = clock.over_time(case.time.into(), case.window.into(), 0.0, 1.0) as f32;
    let weigh = |&(distance, id): &(f32, u32)| {
        let in_time = match photons[id as usize].time {
            PhotonTime::At(time) | PhotonTime::Carried { time, .. } => {
                let x = (time - case.time) / case.window;
                clock.weight(x * x) * (1.0 / duration)
            }
            PhotonTime::During(active) => 1.0 / active.duration(),
        };
        (id, space.weight(distance / square) * in_time * case.per_extent(radius))
    };
    (radius, near.iter().map(weigh).collect())
}

#[test]
fn gathers_are_those_of_the_nearest_images() {
    let (mut found, mut across) = (0, 0);
    for seed in 0..66u64 {
        let random = &mut Random(seed);
        let (count, size) = ([150, 40, 3][seed as usize % 3], [1.0, 1e-3, 1e4][seed as usize / 3 % 3]);
        let photons = photons(count, size, random);
        let params = GatherParams { window: WINDOW, ..GatherParams::default() };
        let map = PhotonMap::build(&photons, &params).unwrap();
        let lengths: Lengths = lengths(random, size);
        let periodic = map.periodic(lengths).unwrap();
        let (mut buffer, mut queries, mut answers) = (NeighborBuffer::new(), Vec::new(), Vec::new());
        for _ in 0..20 {
            let k = [None, Some(1), Some(7), Some(30), Some(1000)][random.bits() as usize % 5];
            let radius = [f32::INFINITY, 0.2, 0.6, 3.0][random.bits() as usize % 4] * size;
            let shortest = lengths.into_iter().flatten().fold(f64::INFINITY, f64::min);
            // From farther out, images that no photon is nearest to could pass as well.
            let thickness = random.bits().is_multiple_of(3).then(|| size * random.unit());
            let thickness = thickness.filter(|_| f64::from(radius) < 0.49 * shortest);
            let case = GatherCase {
                at: place(random, size, 0.0),
                normal: random.vec().normalize_or(Vec3::Z),
                time: if random.bits().is_multiple_of(4) { (random.bits() % 3) as f32 / 2.0 } else { random.unit() },
                k: k.or((radius == f32::INFINITY).then_some(4)),
                radius,
                window: [WINDOW, 0.3 * WINDOW][random.bits() as usize % 2],
                cosine: random.bits().is_multiple_of(3).then(|| random.signed()),
                thickness,
                kernels: [0, 2].map(|shift| Kernel::ALL[random.bits() as usize >> shift & 3]),
                odd_only: random.bits().is_multiple_of(4),
                in_volume: random.bits().is_multiple_of(4),
            };
            // Photons that are carried go as far as two sizes from zero.
            let around = (DVec3::splat(-2.1 * f64::from(size)), DVec3::splat(2.1 * f64::from(size)));
            let near = near(&case, &photons, &images(case.at.as_dvec3(), lengths, around));
            let (radius, weights) = estimate(&case, &photons, near);
            let answer = periodic.gather(&case.query(), &mut buffer);
            let what = format!("seed {seed}, {lengths:?}, {case:?}");
            if !weights.is_empty() && case.per_extent(radius) == f32::INFINITY {
                assert_eq!(answer, Err(GatherError::NoArea), "{what}");
                continue;
            }
            let answer = answer.unwrap();
            let density = weights.iter().fold(0.0, |sum, &(id, weight)| sum + photons[id as usize].flux * weight);
            let bits = (answer.density.to_bits(), answer.radius.to_bits(), answer.count);
            assert_eq!(bits, (density.to_bits(), radius.to_bits(), weights.len()), "{what}");
            assert_eq!(answer.reached, case.k.is_some_and(|k| weights.len() >= k), "{what}");
            let mut each = Vec::new();
            periodic.gather_each(&case.query(), &mut buffer, |id, weight| each.push((id, weight))).unwrap();
            assert_eq!(each, weights, "{what}");
            found += usize::from(answer.count > 0);
            across += usize::from(map.gather(&case.query(), &mut buffer).is_ok_and(|open| open != answer));
            queries.push(case.query());
            answers.push(answer);
        }
        assert_eq!(periodic.gather_batch(&queries).unwrap(), answers, "seed {seed}");
    }
    assert!(found > 550 && across > 550, "{found} gathers found something, {across} of them across faces");
}

#[test]
fn what_is_no_length_is_an_error_and_a_map_without_photons_is_dark() {
    let photon = |x: f32| Photon::at_time(Vec3::X * x, Vec3::Z, 1.0f32, 0.5);
    let map = PhotonMap::build(&[photon(0.0), photon(40.0)], &GatherParams::default()).unwrap();
    assert_eq!(map.periodic([Some(1.0), None, None]).unwrap_err(), PeriodError::Extent { axis: 0 });
    assert_eq!(map.periodic([None, Some(0.0), None]).unwrap_err(), PeriodError::Length { axis: 1 });
    let query = mbkd::point::GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).nearest(3);
    let map = PhotonMap::<f32>::build(&[], &GatherParams::default()).unwrap();
    let dark = map.periodic([Some(1.0); 3]).unwrap().gather(&query, &mut NeighborBuffer::new()).unwrap();
    assert_eq!((dark.count, dark.density), (0, 0.0));
    let error = map.periodic([Some(1.0); 3]).unwrap().gather_batch(&[query, query.window(-1.0)]).unwrap_err();
    assert_eq!(error, GatherError::At { index: 1, error: Box::new(GatherError::Window) });
}
