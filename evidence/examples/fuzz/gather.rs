//! Photon maps against comparing all photons, sums included; neighbours in space and time; visible points whose radii change.

use crate::clouds::{Cloud, params};
use crate::compare::Outcome;
use crate::gather_case::GatherCase;
use crate::random::Random;
use mbkd::TimeInterval;
use mbkd::glam::Vec3;
use mbkd::point::{
    GatherError, GatherParams, Gathered, Kernel, NeighborBuffer, Photon, PhotonMap, PhotonTime, VisiblePoint,
    VisiblePoints,
};

fn squared(d: Vec3) -> f32 {
    (d.x * d.x + d.y * d.y) + d.z * d.z
}

/// A query of photons, sometimes where one of them is.
pub fn any_case(random: &mut Random, photons: &[Photon<f32>], window: f32) -> GatherCase {
    let mut at = || photons.get(random.below(photons.len())).map_or(Vec3::ZERO, |p| p.position);
    let (here, there) = (at(), at());
    let scale = here.distance(there);
    let radius = (scale * random.pick(&[0.2, 1.0, 3.0])).min(1e18);
    let bounded = radius > 1e-15 && random.one_in(2);
    let radius = if bounded { radius } else { f32::INFINITY };
    let k = random.pick(&[None, Some(1), Some(5), Some(17), Some(1000)]);
    let between = here + (there - here) * random.signed() as f32;
    GatherCase {
        at: if random.one_in(3) { here } else { between.clamp(Vec3::splat(-1e18), Vec3::splat(1e18)) },
        normal: random.vec().as_vec3().normalize_or(Vec3::Z),
        time: random.time(),
        k: if bounded { k } else { k.or(Some(8)) },
        radius,
        window: window * random.pick(&[1.0, 0.5, 0.1]),
        cosine: random.one_in(3).then(|| random.signed() as f32),
        thickness: random.one_in(3).then(|| scale * random.unit()),
        kernels: [0; 2].map(|_| random.pick(&Kernel::ALL)),
        odd_only: random.one_in(4),
        in_volume: random.one_in(4),
    }
}

/// Photons at the places of a cloud: stamped, existing for a while, carried along, or all of these.
pub fn photons(random: &mut Random, cloud: &Cloud, clock: usize) -> Vec<Photon<f32>> {
    let one = |i: usize| {
        let (time, kind) = (random.time(), if clock < 3 { clock } else { random.below(3) });
        let velocity = (cloud.key(cloud.segments(), i) - cloud.key(0, i)).as_vec3();
        let time = match kind {
            0 => PhotonTime::At(time),
            1 => {
                let begin = 0.9 * time;
                PhotonTime::During(
                    TimeInterval::new(begin, begin + 0.02 + 0.08 * random.unit()).unwrap_or(TimeInterval::FULL),
                )
            }
            _ => PhotonTime::Carried { time, velocity },
        };
        let normal = random.vec().as_vec3().normalize_or(Vec3::X);
        Photon { position: cloud.key(0, i).as_vec3(), normal, flux: random.unit() + 0.1, time }
    };
    (0..cloud.len()).map(one).collect()
}

fn bits(g: &Gathered<f32>) -> [u64; 5] {
    let words = [g.density, g.radius, g.duration].map(|x| u64::from(x.to_bits()));
    [words[0], words[1], words[2], g.count as u64, u64::from(g.reached)]
}

pub fn case(random: &mut Random) -> Outcome {
    let cloud = Cloud::random(random, 2000, false);
    let clock = random.below(4);
    let photons = photons(random, &cloud, clock);
    let window = random.pick(&[0.3, 0.05, 0.01, 2.0]);
    let point = params(random);
    let params =
        GatherParams { window, neighbors: random.pick(&[1, 50, 5000]), structure: point.structure, simd: point.simd };
    let what = format!("{} photons, clock {clock}, {params:?}", photons.len());
    let map = PhotonMap::build(&photons, &params).map_err(|error| format!("{what}: {error}"))?;
    let mut scratch = NeighborBuffer::new();
    let (mut queries, mut expected) = (Vec::new(), Vec::new());
    for _ in 0..12 {
        let case = any_case(random, &photons, window);
        let (all, weights) = case.brute(&photons);
        let answer = map.gather(&case.query(), &mut scratch);
        if all.count > 0 && case.per_extent(all.radius) == f32::INFINITY {
            same!(answer.as_ref().err(), Some(&GatherError::NoArea), "{what}: {case:?}");
            continue;
        }
        same!(answer.as_ref().map(bits), Ok(bits(&all)), "{what}: {case:?}: {answer:?} for {all:?}");
        let mut each = Vec::new();
        let visited = map.gather_each(&case.query(), &mut scratch, |id, weight| each.push((id, weight.to_bits())));
        ensure!(visited.is_ok(), "{what}: {case:?}: {visited:?}");
        let weights: Vec<_> = weights.iter().map(|&(id, weight)| (id, weight.to_bits())).collect();
        same_lists!(each, weights, "{what}: {case:?}: weights");
        queries.push(case.query());
        expected.push(bits(&all));
    }
    let batch = map.gather_batch(&queries).map_err(|error| format!("{what}: batch: {error}"))?;
    same_lists!(batch.iter().map(bits).collect::<Vec<_>>(), expected, "{what}: batch");
    if clock == 0 {
        let (q, k) = (any_case(random, &photons, window), random.below(80));
        let speed = random.pick(&[0.0, 0.1, 1.0, 30.0, 1e18]);
        let metric = |photon: &Photon<f32>| match photon.time {
            PhotonTime::At(time) => squared(photon.position - q.at) + ((time - q.time).abs() * speed).powi(2),
            _ => f32::NAN,
        };
        let mut all: Vec<(f32, u32)> = photons.iter().map(metric).zip(0..).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(k);
        let near = map.nearest_in_space_time(q.at, q.time, speed, k, &mut scratch);
        let near = near.map_err(|error| format!("{what}: {error}"))?;
        let near: Vec<_> = near.iter().map(|n| (n.distance_squared, n.id)).collect();
        same_lists!(near, all, "{what}: {k} in space and time from {q:?}, {speed}");
    }
    visible(random, &photons, &cloud, &params, &what)
}

fn visible(random: &mut Random, photons: &[Photon<f32>], cloud: &Cloud, params: &GatherParams, what: &str) -> Outcome {
    let scale = cloud.places.scale as f32;
    let radius = |random: &mut Random| scale * random.unit() * random.pick(&[0.0, 0.03, 0.3, 1.0]);
    let seen = |p: &Photon<f32>| VisiblePoint { position: p.position, time: random.time(), radius: radius(random) };
    let mut seen: Vec<VisiblePoint> = photons.iter().map(seen).collect();
    let mut points = VisiblePoints::build(&seen, params).map_err(|error| format!("{what}: {error}"))?;
    let mut scratch = NeighborBuffer::new();
    for _ in 0..2 {
        let near = |random: &mut Random| {
            let at = photons.get(random.below(photons.len())).map_or(Vec3::ZERO, |p| p.position);
            at + random.vec().as_vec3() * scale * random.pick(&[0.0, 0.1])
        };
        let arrivals: Vec<(Vec3, f32)> = (0..20).map(|_| (near(random), random.time())).collect();
        let window = random.pick(&[0.05, 0.5, f32::INFINITY]);
        let mut counts = vec![0u32; seen.len()];
        for &(at, time) in &arrivals {
            let mut expected = Vec::new();
            for (id, p) in (0u32..).zip(&seen) {
                let d = squared(p.position - at);
                if d <= p.radius * p.radius && (p.time - time).abs() <= window {
                    expected.push((id, d.to_bits()));
                    counts[id as usize] += 1;
                }
            }
            let mut found = Vec::new();
            let result = points.for_each(at, time, window, &mut scratch, |id, d| found.push((id, d.to_bits())));
            same!(result, Ok(()), "{what}: visible from {at} at {time} within {window}");
            found.sort_unstable();
            same_lists!(found, expected, "{what}: visible from {at} at {time} within {window}");
        }
        let mut scattered = vec![0u32; seen.len()];
        let result = points.scatter(&arrivals, |p| *p, window, &mut scattered, |count, _, _| *count += 1);
        same!(result, Ok(()), "{what}: scatter");
        same_lists!(scattered, counts, "{what}: scattered within {window}");
        seen.iter_mut().for_each(|p| p.radius = radius(random));
        let radii: Vec<f32> = seen.iter().map(|p| p.radius).collect();
        same!(points.set_radii(&radii), Ok(()), "{what}: radii");
    }
    Ok(())
}
