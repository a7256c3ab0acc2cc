//! Gathers against comparing all photons, bit for bit; space-time neighbours and visible points likewise; bad input.

use crate::gather_case::GatherCase;
use crate::support::{KINDS, Random, cloud};
use mbkd::glam::Vec3;
use mbkd::point::{
    GatherError, GatherParams, GatherQuery, Gathered, Kernel, NeighborBuffer, Photon, PhotonMap, PhotonTime,
    VisiblePoint, VisiblePoints,
};
use mbkd::{PointStructure, SimdLevel, TimeInterval};
use proptest::prelude::*;

/// Photons at the places of a cloud. `clock`: 0 stamps, 1 intervals, 2 moving with a surface, 3 all of them.
fn photons(kind: &str, count: usize, clock: u32, rng: &mut Random) -> Vec<Photon<f32>> {
    let cloud = cloud(kind, count, rng);
    let one = |i: usize| {
        let time = if rng.bits().is_multiple_of(8) { (rng.bits() % 5) as f32 / 4.0 } else { rng.unit() };
        let velocity = cloud.keys[cloud.keys.len() - 1][i] - cloud.keys[0][i];
        let time = match if clock < 3 { clock } else { rng.below(3) as u32 } {
            0 => PhotonTime::At(time),
            1 => {
                let begin = 0.9 * time;
                PhotonTime::During(TimeInterval::new(begin, begin + 0.02 + 0.08 * rng.unit()).unwrap())
            }
            _ => PhotonTime::Carried { time, velocity },
        };
        Photon { position: cloud.at(i, 0.3), normal: rng.vec().normalize_or(Vec3::X), flux: rng.unit() + 0.1, time }
    };
    (0..cloud.len()).map(one).collect()
}

fn random_case(photons: &[Photon<f32>], window: f32, rng: &mut Random) -> GatherCase {
    let some = |rng: &mut Random| rng.below(photons.len().max(1));
    let at = |i: usize| photons.get(i).map_or(Vec3::ZERO, |p| p.position);
    let (here, there) = (at(some(rng)), at(some(rng)));
    let (scale, most) = (here.distance(there), Vec3::splat(1e18));
    let radius = [f32::INFINITY, scale * 0.2, scale, scale * 3.0][rng.below(4)].min(1e18);
    let radius = if radius.is_finite() && radius > 1e-15 { radius } else { f32::INFINITY };
    let k = [None, Some(1), Some(5), Some(17), Some(60), Some(1000)][rng.below(6)];
    GatherCase {
        at: if rng.bits().is_multiple_of(4) { here } else { (here + (there - here) * rng.signed()).clamp(-most, most) },
        normal: rng.vec().normalize_or(Vec3::Z),
        time: if rng.bits().is_multiple_of(4) { (rng.bits() % 5) as f32 / 4.0 } else { rng.unit() },
        k: k.or((radius == f32::INFINITY).then_some(8)),
        radius,
        window: [window, 0.1 * window, 0.5 * window][rng.below(3)],
        cosine: rng.bits().is_multiple_of(3).then(|| rng.signed()),
        thickness: rng.bits().is_multiple_of(3).then(|| scale * rng.unit()),
        kernels: [0, 2].map(|shift| Kernel::ALL[rng.bits() as usize >> shift & 3]),
        odd_only: rng.bits().is_multiple_of(4),
        in_volume: rng.bits().is_multiple_of(4),
    }
}

/// The error of an element of a slice.
fn of(index: usize, error: GatherError) -> GatherError {
    GatherError::At { index, error: Box::new(error) }
}

fn bits(g: &Gathered<f32>) -> (u32, u32, u32, usize, bool) {
    (g.density.to_bits(), g.radius.to_bits(), g.duration.to_bits(), g.count, g.reached)
}

/// Compares gathers with brute force. Returns how many found something.
fn compare(photons: &[Photon<f32>], params: &GatherParams, seed: u64, queries: usize, what: &str) -> usize {
    let map = PhotonMap::build(photons, params).unwrap();
    assert_eq!(map.len(), photons.len());
    let (mut rng, mut scratch, mut found) = (Random(seed), NeighborBuffer::new(), 0);
    for _ in 0..queries {
        let case = random_case(photons, params.window, &mut rng);
        let (expected, weights) = case.brute(photons);
        let answer = map.gather(&case.query(), &mut scratch);
        if expected.count > 0 && case.per_extent(expected.radius) == f32::INFINITY {
            assert_eq!(answer, Err(GatherError::NoArea), "{what}: {case:?}");
            continue;
        }
        assert_eq!(bits(&answer.unwrap()), bits(&expected), "{what}: {case:?}");
        let mut each = Vec::new();
        map.gather_each(&case.query(), &mut scratch, |id, weight| each.push((id, weight))).unwrap();
        assert_eq!(each, weights, "{what}: {case:?}");
        found += usize::from(expected.count > 0);
    }
    found
}

#[test]
fn gathers_are_those_of_brute_force_for_every_kind_of_photons() {
    let mut found = 0;
    for (seed, kind) in (0..).zip(KINDS) {
        for clock in 0..4 {
            let mut rng = Random(1000 * seed + u64::from(clock));
            let photons = photons(kind, [700, 40, 1500, 300][clock as usize], clock, &mut rng);
            // Photons that move with a surface must stay within the limit of coordinates.
            if kind == "huge" && clock >= 2 {
                continue;
            }
            let params = GatherParams { window: [0.3, 0.02, 2.0][seed as usize % 3], ..GatherParams::default() };
            found += compare(&photons, &params, seed, 40, &format!("{kind}, clock {clock}"));
        }
    }
    assert!(found > 1200, "only {found} gathers found something");
}

/// Beams that a mirror focuses: most photons are at the distance of the k-th, and the lowest indices count.
#[test]
fn crowds_of_photons_in_few_places_are_gathered_as_by_brute_force() {
    for places in [1, 3] {
        for clock in 0..4 {
            let mut rng = Random(places + u64::from(clock));
            let mut photons = photons("random", 2000, clock, &mut rng);
            let at: Vec<Vec3> = (0..places).map(|_| rng.vec()).collect();
            for (i, photon) in photons.iter_mut().enumerate().filter(|(i, _)| i % 4 != 0) {
                photon.position = at[i % at.len()];
            }
            let params = GatherParams { window: 0.5, ..GatherParams::default() };
            let found = compare(&photons, &params, 3, 60, &format!("{places} places, clock {clock}"));
            // Where all that are found are at the query's own place, the disc has no area.
            assert!(found > 20, "only {found} gathers found something");
        }
    }
}

#[test]
fn structures_and_instruction_sets_give_the_same_bits() {
    use PointStructure::{Automatic, Kd, Linear, TimeSlices};
    for kind in ["surface", "random", "lattice"] {
        for structure in [Automatic, Linear, TimeSlices(3), Kd] {
            for simd in SimdLevel::available() {
                let mut rng = Random(5);
                let photons = photons(kind, 600, 3, &mut rng);
                let params = GatherParams { window: 0.2, structure, simd, ..GatherParams::default() };
                compare(&photons, &params, 9, 40, &format!("{kind}, {structure:?}, {simd}"));
            }
        }
    }
}

#[test]
fn the_typical_window_and_number_change_no_answer() {
    let mut rng = Random(8);
    // With stamps, and of all kinds: a map for any window must test moving photons by the window of the query.
    let of_kinds = [photons("surface", 3000, 0, &mut rng), photons("random", 1000, 3, &mut rng)];
    for (window, neighbors, photons) in [
        (0.001, 1, &of_kinds[0]),
        (0.1, 50, &of_kinds[0]),
        (1e9, 5000, &of_kinds[0]),
        (f32::INFINITY, 1, &of_kinds[0]),
        (0.3, 1, &of_kinds[1]),
        (1e9, 50, &of_kinds[1]),
        (f32::INFINITY, 50, &of_kinds[1]),
    ] {
        let map = PhotonMap::build(photons, &GatherParams { window, neighbors, ..GatherParams::default() }).unwrap();
        let (mut rng, mut scratch) = (Random(9), NeighborBuffer::new());
        for _ in 0..60 {
            let case = random_case(photons, 0.3, &mut rng);
            let answer = map.gather(&case.query(), &mut scratch).unwrap();
            assert_eq!(bits(&answer), bits(&case.brute(photons).0), "{window}, {neighbors}: {case:?}");
        }
    }
}

#[test]
fn batches_are_single_gathers_for_any_number_of_threads() {
    let mut rng = Random(21);
    let photons = photons("surface", 4000, 3, &mut rng);
    let map = PhotonMap::build(&photons, &GatherParams { window: 0.2, ..GatherParams::default() }).unwrap();
    let queries: Vec<_> = (0..1500).map(|_| random_case(&photons, 0.2, &mut rng).query()).collect();
    let mut scratch = NeighborBuffer::new();
    let single: Vec<_> = queries.iter().map(|q| bits(&map.gather(q, &mut scratch).unwrap())).collect();
    let batch = || map.gather_batch(&queries).unwrap().iter().map(bits).collect::<Vec<_>>();
    assert!(batch() == single);
    #[cfg(feature = "rayon")]
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(batch) == single);
        let other = || PhotonMap::build(&photons, &GatherParams { window: 0.2, ..GatherParams::default() }).unwrap();
        let map = pool.install(other);
        assert!(queries.iter().zip(&single).all(|(q, one)| bits(&map.gather(q, &mut scratch).unwrap()) == *one));
    }
    let mut bad = queries.clone();
    bad[700] = bad[700].window(f32::NAN);
    assert_eq!(map.gather_batch(&bad).unwrap_err(), of(700, GatherError::Window));
    // Of the errors that are found only in answering, that of the first query, in whatever order they are answered.
    bad[700] = bad[700].window(2.0);
    bad[900] = bad[700];
    assert_eq!(map.gather_batch(&bad).unwrap_err(), of(700, GatherError::WindowTooWide { most: 0.2 }));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn any_gather_is_that_of_brute_force(seed: u64, kind in 0usize..KINDS.len(), count in 0usize..400, window in 0.001f32..1.5) {
        let mut rng = Random(seed);
        let photons = photons(KINDS[kind], count, 0, &mut rng);
        compare(&photons, &GatherParams { window, ..GatherParams::default() }, seed, 5, KINDS[kind]);
    }

    #[test]
    fn space_time_neighbours_are_those_of_brute_force(
        seed: u64, kind in 0usize..KINDS.len(), count in 0usize..600, k in 0usize..80, speed in 0usize..5,
    ) {
        let mut rng = Random(seed);
        let photons = photons(KINDS[kind], count, 0, &mut rng);
        let map = PhotonMap::build(&photons, &GatherParams::default()).unwrap();
        let speed = [0.0, 0.1, 1.0, 30.0, 1e18][speed];
        let case = random_case(&photons, 1.0, &mut rng);
        let metric = |photon: &Photon<f32>| {
            let PhotonTime::At(time) = photon.time else { unreachable!() };
            let (d, moved) = (photon.position - case.at, (time - case.time).abs() * speed);
            ((d.x * d.x + d.y * d.y) + d.z * d.z) + moved * moved
        };
        let mut all: Vec<(f32, u32)> = photons.iter().map(metric).zip(0..).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(k);
        let mut scratch = NeighborBuffer::new();
        let found = map.nearest_in_space_time(case.at, case.time, speed, k, &mut scratch).unwrap();
        let found: Vec<_> = found.iter().map(|n| (n.distance_squared, n.id)).collect();
        prop_assert_eq!(found, all);
    }

    #[test]
    fn photons_find_the_visible_points_of_brute_force(seed: u64, kind in 0usize..KINDS.len(), count in 0usize..500) {
        let mut rng = Random(seed);
        let places = photons(KINDS[kind], count.max(1), 0, &mut rng);
        let scale = places[0].position.distance(places[places.len() - 1].position).clamp(1e-30, 1e18);
        let mut seen: Vec<VisiblePoint> = places[..count]
            .iter()
            .map(|p| {
                let PhotonTime::At(time) = p.time else { unreachable!() };
                let radius = scale * 0.4 * [0.0, 0.03, 1.0][rng.below(3)] * rng.unit();
                VisiblePoint { position: p.position, time, radius }
            })
            .collect();
        for simd in SimdLevel::available() {
            let params = GatherParams { simd, ..GatherParams::default() };
            let mut points = VisiblePoints::build(&seen, &params).unwrap();
            let mut scratch = NeighborBuffer::new();
            for pass in 0..3 {
                for photon in places.iter().step_by(7) {
                    let at = photon.position + rng.vec() * scale * 0.1 * (pass as f32);
                    let (time, window) = (rng.unit(), [0.05, 0.5, f32::INFINITY][rng.below(3)]);
                    let mut expected: Vec<(u32, u32)> = (0..).zip(&seen).filter_map(|(id, p)| {
                        let d = p.position - at;
                        let squared = (d.x * d.x + d.y * d.y) + d.z * d.z;
                        let hit = squared <= p.radius * p.radius && (p.time - time).abs() <= window;
                        hit.then_some((id, squared.to_bits()))
                    }).collect();
                    let mut found = Vec::new();
                    points.for_each(at, time, window, &mut scratch, |id, d| found.push((id, d.to_bits()))).unwrap();
                    found.sort_unstable();
                    expected.sort_unstable();
                    prop_assert_eq!(found, expected);
                }
                // Radii shrink, and some grow.
                seen.iter_mut().for_each(|p| p.radius *= if rng.bits().is_multiple_of(9) { 2.0 } else { 0.6 });
                seen.iter_mut().for_each(|p| p.radius = p.radius.min(1e18));
                points.set_radii(&seen.iter().map(|p| p.radius).collect::<Vec<_>>()).unwrap();
            }
        }
    }
}

/// A photon whose distance is rounded down to the radius, or to nothing, counts, though it lies beyond the ball; and one at the
/// very end of the window.
#[test]
fn photons_that_are_within_the_radius_by_rounding_alone_are_found() {
    let (mut rng, mut beyond) = (Random(63), 0);
    let mut scratch = NeighborBuffer::new();
    for round in 0..4000 {
        let (x, radius) = match round % 4 {
            0 => (0.0, 0.0),
            1 => (rng.signed() * 100.0, rng.unit()),
            2 => (-0.3 - 0.15 * rng.unit(), 1.0 + 0.2 * rng.unit()),
            // Floats are denser at the end of the ball than at its radius.
            _ => (-1.9 + 0.9 * rng.unit(), 1.9 + 0.1 * rng.unit()),
        };
        let spot = VisiblePoint { position: Vec3::X * x, time: 0.5, radius };
        let tree = VisiblePoints::build(&[spot], &GatherParams::default()).unwrap();
        let mut p = if radius > 0.0 { (x + radius).next_down() } else { 1e-23 * rng.unit() };
        for _ in 0..if radius > 1.5 { 24 } else { 4 } {
            let d = x - p;
            let counts = d * d <= radius * radius;
            beyond += u32::from(counts && f64::from(p) - f64::from(x) > f64::from(radius));
            let mut found = false;
            tree.for_each(Vec3::X * p, 0.75, 0.25, &mut scratch, |_, _| found = true).unwrap();
            assert_eq!(found, counts, "round {round}: {p} from {x}, radius {radius}");
            p = p.next_up();
        }
    }
    assert!(beyond > 1000, "{beyond}");
}

#[test]
fn scattering_sums_in_one_order_for_any_number_of_threads() {
    let mut rng = Random(77);
    let seen: Vec<VisiblePoint> =
        (0..5000).map(|_| VisiblePoint { position: rng.vec(), time: rng.unit(), radius: 0.3 * rng.unit() }).collect();
    let photons: Vec<(Vec3, f32, f32)> = (0..20_000).map(|_| (rng.vec(), rng.unit(), rng.unit())).collect();
    let points = VisiblePoints::build(&seen, &GatherParams::default()).unwrap();
    let sums = || {
        let mut sums = vec![0.0f32; seen.len()];
        points.scatter(&photons, |p| (p.0, p.1), 0.1, &mut sums, |sum, p, d| *sum += p.2 * (1.0 - d)).unwrap();
        sums.iter().map(|sum| sum.to_bits()).collect::<Vec<_>>()
    };
    let expected = sums();
    assert!(expected.iter().any(|&sum| sum != 0));
    #[cfg(feature = "rayon")]
    for threads in [1, 2, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(sums) == expected, "{threads} threads");
    }
}

#[test]
fn bad_input_is_a_typed_error_or_a_documented_answer() {
    let photon = |x: f32, normal: Vec3, flux: f32, time| Photon { position: Vec3::X * x, normal, flux, time };
    let build = |photon: Photon<f32>| {
        let fine = Photon::at_time(Vec3::Y, Vec3::Z, 1.0, 0.5);
        PhotonMap::build(&[fine, photon], &GatherParams::default()).map(|_| ()).unwrap_err()
    };
    let at = PhotonTime::At;
    assert_eq!(build(photon(0.0, Vec3::Z, f32::NAN, at(0.5))), of(1, GatherError::Flux));
    assert_eq!(build(photon(0.0, Vec3::NAN, 1.0, at(0.5))), of(1, GatherError::PhotonNormal));
    for time in [-0.1, 1.1, f32::NAN] {
        assert_eq!(build(photon(0.0, Vec3::Z, 1.0, at(time))), of(1, GatherError::Time));
    }
    for x in [f32::NAN, 2e18] {
        assert_eq!(build(photon(x, Vec3::Z, 1.0, at(0.5))), of(1, GatherError::Position));
    }
    let carried = PhotonTime::Carried { time: 0.5, velocity: Vec3::splat(f32::INFINITY) };
    assert_eq!(build(photon(0.0, Vec3::Z, 1.0, carried)), of(1, GatherError::Position));
    for window in [0.0, -1.0, f32::NAN] {
        let params = GatherParams { window, ..GatherParams::default() };
        assert!(PhotonMap::<f32>::build(&[], &params).is_err());
    }

    let mut scratch = NeighborBuffer::new();
    let empty = PhotonMap::<f32>::build(&[], &GatherParams::default()).unwrap();
    let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).radius(1.0).window(0.1);
    let nothing = empty.gather(&query.nearest(5), &mut scratch).unwrap();
    assert_eq!((nothing.density, nothing.count, nothing.reached, nothing.radius), (0.0, 0, false, 1.0));
    assert!(empty.nearest_in_space_time(Vec3::ZERO, 0.5, 1.0, 3, &mut scratch).unwrap().is_empty());

    let photons = [0.0, 0.0, 1.0].map(|x| photon(x, Vec3::Z, 1.0, at(0.5)));
    let map = PhotonMap::build(&photons, &GatherParams::default()).unwrap();
    let mut error = |query: &GatherQuery| map.gather(query, &mut scratch).unwrap_err();
    let at = |position, time| GatherQuery::new(position, Vec3::Z, time).radius(1.0);
    assert_eq!(error(&at(Vec3::NAN, 0.5)), GatherError::Position);
    assert_eq!(error(&at(Vec3::ZERO, 1.5)), GatherError::Time);
    assert_eq!(error(&at(Vec3::ZERO, f32::NAN)), GatherError::Time);
    for window in [0.0, -1.0, f32::NAN] {
        assert_eq!(error(&query.window(window)), GatherError::Window);
    }
    // So short that the reciprocal of the duration is infinite.
    for (window, kernel) in [(1e-40, Kernel::Box), (1e-39, Kernel::Epanechnikov), (f32::from_bits(1), Kernel::Cone)] {
        assert_eq!(error(&query.window(window).kernels(Kernel::Box, kernel)), GatherError::Window);
    }
    for radius in [-1.0, f32::NAN, 1e20] {
        assert_eq!(error(&query.radius(radius)), GatherError::Radius);
    }
    assert_eq!(error(&query.nearest(0)), GatherError::NoNeighbors);
    assert_eq!(error(&query.radius(f32::INFINITY)), GatherError::Unbounded);
    assert_eq!(error(&query.cosine(f32::NAN)), GatherError::Cutoff);
    assert_eq!(error(&query.thickness(-1.0)), GatherError::Cutoff);
    let flat = GatherQuery::new(Vec3::ZERO, Vec3::ZERO, 0.5).radius(1.0);
    assert_eq!(error(&flat.cosine(0.5)), GatherError::Normal);
    assert_eq!(error(&query.radius(0.0)), GatherError::NoArea);
    assert_eq!(error(&query.nearest(1)), GatherError::NoArea);
    assert!(map.gather(&flat, &mut scratch).is_ok(), "a normal that nothing depends on is not looked at");
    assert_eq!(map.nearest_in_space_time(Vec3::ZERO, 0.5, -1.0, 3, &mut scratch), Err(GatherError::Speed));

    let carried = PhotonTime::Carried { time: 0.5, velocity: Vec3::X };
    let moving = [Photon { time: carried, ..photons[0] }];
    let map = PhotonMap::build(&moving, &GatherParams::default()).unwrap();
    let error = map.gather(&query.window(0.06), &mut scratch).unwrap_err();
    assert_eq!(error, GatherError::WindowTooWide { most: 0.05 });
    let late = |time| GatherQuery::new(Vec3::ZERO, Vec3::Z, time).radius(1.0);
    let found = map.gather(&late(0.46), &mut scratch).unwrap();
    assert_eq!((found.count, found.window), (1, 0.05), "without a window the widest that there is");
    assert_eq!(map.gather(&late(0.44), &mut scratch).unwrap().count, 0);
    assert_eq!(map.nearest_in_space_time(Vec3::ZERO, 0.5, 1.0, 3, &mut scratch), Err(GatherError::NotStamped));

    let point = VisiblePoint { position: Vec3::ZERO, time: 0.5, radius: 1.0 };
    let visible = |second| VisiblePoints::build(&[point, second], &GatherParams::default());
    assert_eq!(visible(VisiblePoint { radius: f32::NAN, ..point }).unwrap_err(), of(1, GatherError::Radius));
    assert_eq!(visible(VisiblePoint { time: 2.0, ..point }).unwrap_err(), of(1, GatherError::Time));
    let mut points = VisiblePoints::build(&[point], &GatherParams::default()).unwrap();
    assert_eq!(points.set_radii(&[]).unwrap_err(), GatherError::Length { expected: 1, found: 0 });
    assert_eq!(points.set_radii(&[-1.0]).unwrap_err(), of(0, GatherError::Radius));
    assert_eq!(of(3, GatherError::Time).to_string(), "element 3: a time must be in [0, 1], the shutter");
    let photons = [(Vec3::X, 0.5), (Vec3::NAN, 0.5)];
    let scattered = points.scatter(&photons, |p| *p, 0.1, &mut [0], |_, _, _| panic!("a deposit before an error"));
    assert_eq!(scattered, Err(of(1, GatherError::Position)));
    assert_eq!(
        points.scatter(&[(Vec3::X, 0.5)], |p| *p, 0.1, &mut [0; 2], |_, _, _| ()).unwrap_err().to_string(),
        "2 elements where 1 are needed, one for each visible point"
    );
}

/// Whether or not there are photons to which the structure matters.
#[test]
fn every_map_refuses_structures_out_of_range() {
    let params = GatherParams { structure: PointStructure::TimeSlices(0), ..GatherParams::default() };
    let stamped = Photon::at_time(Vec3::ZERO, Vec3::Z, 1.0f32, 0.5);
    let carried = Photon { time: PhotonTime::Carried { time: 0.5, velocity: Vec3::X }, ..stamped };
    for photons in [vec![], vec![stamped], vec![carried]] {
        let error = PhotonMap::build(&photons, &params).unwrap_err();
        assert!(matches!(error, GatherError::Parameter { name: "structure", .. }), "{error:?}");
    }
}
