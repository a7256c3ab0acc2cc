//! Rays against moving spheres.

use super::DOUBT;
use super::cases::RayCase;
use super::rays::{all_hits, check_queries};
use super::special_time;
use super::tally::RayTally;
use crate::oracle::{ExactRay, Given, meet_sphere};
use mbkd::glam::DVec3;
use mbkd::{BuildError, BuildParams, MovingSphere, Ray, RayTree};
use mbkd_scenes::Random;

/// Spheres of a scene.
const SPHERES: usize = 30;

fn spheres(case: &RayCase, random: &mut Random) -> Vec<MovingSphere> {
    let center = DVec3::splat(case.offset * case.scale);
    let mut all = Vec::new();
    for _ in 0..SPHERES {
        let (at, displacement, radius) = (random.dvec(), random.dvec() * case.speed, 0.05 + 0.2 * random.unit_f64());
        let key = |k: usize| {
            let passed = k as f64 / (case.keys.max(2) - 1) as f64;
            let aside = random.dvec() * (0.05 * case.speed);
            let place = center + (at + displacement * passed + aside) * case.scale;
            (place, radius * case.scale * (1.0 + 0.3 * random.signed_f64()))
        };
        all.push(MovingSphere::new((0..case.keys).map(key).collect()));
    }
    if let Some(half) = case.ground {
        all.push(MovingSphere::fixed(center - DVec3::Z * (half + 1.5 * case.scale), half));
    }
    if let Some(away) = case.outlier {
        all.push(MovingSphere::fixed(center + DVec3::new(away, away, -away) * case.scale, case.scale));
    }
    all
}

fn ray(case: &RayCase, spheres: &[MovingSphere], random: &mut Random) -> Ray {
    let time = special_time(random, case.keys);
    let (center, radius) = spheres[random.below(SPHERES)].at(time);
    // At the middle, around the rim, or just inside of it.
    let aim = random.dvec().normalize_or_zero() * radius;
    let target = center + aim * [0.0, 0.5, 0.999, 1.0][random.below(4)];
    if case.away > 100.0 {
        let dir = (random.dvec() * 4.0).round() + DVec3::Z * 5.0;
        return Ray::new(target - dir * (case.away * case.scale), dir.as_vec3()).at_time(time);
    }
    let origin = target + random.dvec() * (case.away * case.scale);
    Ray::new(origin, ((target - origin) / case.scale).as_vec3()).at_time(time)
}

/// Compares trees of spheres, one per set of parameters, with the exact answers to `count` rays.
///
/// # Errors
/// If a tree cannot be built.
pub fn compare_spheres(
    case: &RayCase,
    params: &[BuildParams],
    count: usize,
    random: &mut Random,
) -> Result<Vec<RayTally>, BuildError> {
    let spheres = spheres(case, random);
    let build = |p: &BuildParams| RayTree::of_scene(&[], spheres.clone(), p);
    let trees = params.iter().map(build).collect::<Result<Vec<_>, _>>()?;
    let mut tallies = vec![RayTally::default(); trees.len()];
    for _ in 0..count {
        let ray = ray(case, &spheres, random);
        let exact_ray = ExactRay::new(&ray, Given::F64);
        let exact: Vec<_> = spheres.iter().map(|s| meet_sphere(&exact_ray, s)).collect();
        for (tree, tally) in trees.iter().zip(&mut tallies) {
            tally.rays += 1;
            let hits = all_hits(tree, &ray);
            check_queries(tree, &ray, &hits, tally);
            for (i, met) in exact.iter().enumerate() {
                tally.hits += usize::from(met.hit);
                let hit = hits.iter().find(|h| h.primitive == i as u32);
                if met.hit != hit.is_some() {
                    tally.worst_verdict = tally.worst_verdict.max(met.margin);
                    if met.margin > DOUBT {
                        tally.false_misses += usize::from(met.hit);
                        tally.false_hits += usize::from(!met.hit);
                    }
                }
                if let (Some(hit), Some([t, _])) = (hit, &met.t) {
                    tally.t.add(t.error_of(hit.t), t.to_f64(), met.t_doubt);
                }
            }
        }
    }
    Ok(tallies)
}
