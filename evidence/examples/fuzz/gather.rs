//! Photon maps against comparing all photons, sums included; neighbours in space and time; visible points whose radii change.

use crate::clouds::{Cloud, params};
use crate::compare::Outcome;
use crate::random::Random;
use mbkd::TimeInterval;
use mbkd::glam::Vec3;
use mbkd::point::{
    GatherError, GatherParams, GatherQuery, GatherScratch, Gathered, Kernel, Photon, PhotonMap, PhotonTime,
    VisiblePoint, VisiblePoints,
};

/// A query with public fields.
#[derive(Clone, Copy, Debug)]
struct Gather {
    at: Vec3,
    normal: Vec3,
    time: f32,
    k: Option<usize>,
    radius: f32,
    window: f32,
    cosine: Option<f32>,
    thickness: Option<f32>,
    kernels: [Kernel; 2],
    odd_only: bool,
}

fn odd(id: u32) -> bool {
    id % 2 == 1
}

fn squared(d: Vec3) -> f32 {
    (d.x * d.x + d.y * d.y) + d.z * d.z
}

impl Gather {
    fn random(random: &mut Random, photons: &[Photon<f32>], window: f32) -> Gather {
        let mut at = || photons.get(random.below(photons.len())).map_or(Vec3::ZERO, |p| p.position);
        let (here, there) = (at(), at());
        let scale = here.distance(there);
        let radius = (scale * random.pick(&[0.2, 1.0, 3.0])).min(1e18);
        let bounded = radius > 1e-15 && random.one_in(2);
        let radius = if bounded { radius } else { f32::INFINITY };
        let k = random.pick(&[None, Some(1), Some(5), Some(17), Some(1000)]);
        let between = here + (there - here) * random.signed() as f32;
        Gather {
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
        }
    }

    fn query(&self) -> GatherQuery<'static> {
        let mut query = GatherQuery::new(self.at, self.normal, self.time).radius(self.radius).window(self.window);
        query = query.kernels(self.kernels[0], self.kernels[1]);
        query = self.k.map_or(query, |k| query.nearest(k));
        query = self.cosine.map_or(query, |cosine| query.cosine(cosine));
        query = self.thickness.map_or(query, |thickness| query.thickness(thickness));
        if self.odd_only { query.filter(&odd) } else { query }
    }

    /// The answer by comparing all photons, and the photons with their weights.
    fn of_all(&self, photons: &[Photon<f32>]) -> (Gathered<f32>, Vec<(u32, f32)>) {
        let mut near = Vec::new();
        for (id, photon) in (0u32..).zip(photons) {
            let (seen, at) = match photon.time {
                PhotonTime::At(stamp) => ((stamp - self.time).abs() <= self.window, photon.position),
                PhotonTime::During(active) => (active.contains(self.time), photon.position),
                PhotonTime::Carried { time, velocity } => {
                    let open = photon.position - velocity * time;
                    let (close, t) = (photon.position + velocity * (1.0 - time), self.time);
                    let at = if t < 0.5 { open + (close - open) * t } else { close + (close - open) * (t - 1.0) };
                    ((time - self.time).abs() <= self.window, if open == close { open } else { at })
                }
            };
            let d = at - self.at;
            let passes = self.cosine.is_none_or(|least| photon.normal.dot(self.normal) >= least)
                && self.thickness.is_none_or(|most| d.dot(self.normal).abs() <= most)
                && (!self.odd_only || odd(id));
            if seen && passes && squared(d) <= (self.radius * self.radius).min(f32::MAX) {
                near.push((squared(d), id));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let k = self.k.unwrap_or(usize::MAX);
        let rim = match near.get(k) {
            Some(next) => Some(next.0),
            None if self.radius == f32::INFINITY => near.pop().map(|last| last.0),
            None => None,
        };
        near.truncate(k);
        let own = (self.radius, (self.radius * self.radius).min(f32::MAX));
        let (radius, square) = rim.map_or(own, |rim| (rim.sqrt(), rim));
        let [space, clock] = self.kernels;
        let duration = clock.over_time(self.time.into(), self.window.into(), 0.0, 1.0) as f32;
        let per_area = (1.0 / space.over_disc(radius.into())) as f32;
        let weigh = |&(distance, id): &(f32, u32)| {
            let in_time = match photons[id as usize].time {
                PhotonTime::At(time) | PhotonTime::Carried { time, .. } => {
                    let x = (time - self.time) / self.window;
                    clock.weight(x * x) * (1.0 / duration)
                }
                PhotonTime::During(active) => 1.0 / active.duration(),
            };
            (id, space.weight(distance / square) * in_time * per_area)
        };
        let weights: Vec<_> = near.iter().map(weigh).collect();
        let density = weights.iter().fold(0.0, |sum, &(id, weight)| sum + photons[id as usize].flux * weight);
        let reached = self.k.is_some_and(|k| near.len() >= k);
        (Gathered { density, radius, window: self.window, duration, count: near.len(), reached }, weights)
    }
}

/// Photons at the places of a cloud: stamped, existing for a while, carried along, or all of these.
fn photons(random: &mut Random, cloud: &Cloud, clock: usize) -> Vec<Photon<f32>> {
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
    let mut scratch = GatherScratch::new();
    let (mut queries, mut expected) = (Vec::new(), Vec::new());
    for _ in 0..12 {
        let case = Gather::random(random, &photons, window);
        let (all, weights) = case.of_all(&photons);
        let answer = map.gather(&case.query(), &mut scratch);
        if all.count > 0 && (1.0 / case.kernels[0].over_disc(all.radius.into())) as f32 == f32::INFINITY {
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
        let (q, k) = (Gather::random(random, &photons, window), random.below(80));
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
    let mut scratch = GatherScratch::new();
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
