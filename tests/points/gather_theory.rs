//! Bias and variance of gathers against a known solution: a sheet of photons whose density moves along x.
//!
//! Photons are a Poisson process with the density f(x, t) = 1 + b (x − v t)² per area and time, the same for all z. A
//! gather with kernels k_s and k_t then has the mean ∫ k_s k_t f / (A D) and the variance φ ∫ k_s² k_t² f / (A D)²,
//! where φ is the flux of a photon. For a box at mid-shutter the mean is f + b (r² / 4 + v² w² / 3): the bias grows with
//! the squares of radius and window, the variance falls with r² w.

use crate::support::Random;
use mbkd::glam::Vec3;
use mbkd::point::{GatherParams, GatherQuery, Kernel, NeighborBuffer, Photon, PhotonMap};

const BEND: f64 = 0.8;
const SPEED: f64 = 1.5;
/// Length along z: queries that are far enough apart are independent.
const LENGTH: f32 = 300.0;
/// Photons per unit of f.
const PER_UNIT: f64 = 400.0;

fn density(x: f64, t: f64) -> f64 {
    1.0 + BEND * (x - SPEED * t) * (x - SPEED * t)
}

/// The sheet for x from -0.5 to 1, by rejection.
fn sheet(rng: &mut Random) -> Vec<Photon<f32>> {
    let (most, volume) = (density(-0.5, 1.0), 1.5 * f64::from(LENGTH));
    let tries = (most * volume * PER_UNIT) as usize;
    let mut photons = Vec::new();
    for _ in 0..tries {
        let (x, z, t) = (1.5 * rng.unit() - 0.5, LENGTH * rng.unit(), rng.unit());
        if f64::from(rng.unit()) * most < density(x.into(), t.into()) {
            photons.push(Photon::at_time(Vec3::new(x, 0.0, z), Vec3::Y, (1.0 / PER_UNIT) as f32, t));
        }
    }
    photons
}

/// The theoretical mean and variance, by summing over the kernels.
fn theory(x: f64, t: f64, r: f64, w: f64, [space, clock]: [Kernel; 2]) -> (f64, f64) {
    let n = 60;
    let cell = |i: i32| (f64::from(2 * i + 1) / f64::from(n)) - 1.0;
    let (mut mean, mut square) = (0.0, 0.0);
    let mut in_time: Vec<(f64, f64)> = Vec::new();
    for i in 0..n {
        let s = t + w * cell(i);
        if (0.0..=1.0).contains(&s) {
            in_time.push((s, f64::from(clock.weight((cell(i) * cell(i)) as f32))));
        }
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let x2 = cell(i) * cell(i) + cell(j) * cell(j);
        if x2 <= 1.0 {
            let weight = f64::from(space.weight(x2 as f32));
            for &(s, in_time) in &in_time {
                let f = density(x + r * cell(i), s);
                mean += weight * in_time * f;
                square += weight * weight * in_time * in_time * f;
            }
        }
    }
    let element = (2.0 * r / f64::from(n)).powi(2) * (2.0 * w / f64::from(n));
    let whole = space.over_disc(r) * clock.over_time(t, w, 0.0, 1.0);
    (mean * element / whole, square * element / (whole * whole) / PER_UNIT)
}

#[test]
fn bias_and_variance_are_those_of_theory() {
    let map = PhotonMap::build(&sheet(&mut Random(3)), &GatherParams::default()).unwrap();
    let mut scratch = NeighborBuffer::new();
    let cases = [(0.2, 0.5, 0.3, 0.1), (0.2, 0.5, 0.15, 0.3), (0.4, 0.0, 0.3, 0.2), (0.1, 0.95, 0.2, 0.1)];
    for (case, (x, t, r, w)) in cases.into_iter().enumerate() {
        for kernels in Kernel::ALL.map(|k| [k, k]).into_iter().chain([[Kernel::Box, Kernel::Gaussian]]) {
            let (mean, variance) = theory(x, t, r, w, kernels);
            if case == 0 && kernels == [Kernel::Box; 2] {
                let plain = density(x, t) + BEND * (r * r / 4.0 + SPEED * SPEED * w * w / 3.0);
                assert!((plain - mean).abs() < 2e-3, "{plain} {mean}");
            }
            let count = (f64::from(LENGTH) / (2.0 * r)) as usize - 2;
            let at = |i: usize| Vec3::new(x as f32, 0.0, ((i as f64 + 1.5) * 2.0 * r) as f32);
            let answers: Vec<f64> = (0..count)
                .map(|i| {
                    let query = GatherQuery::new(at(i), Vec3::Y, t as f32).radius(r as f32).window(w as f32);
                    f64::from(map.gather(&query.kernels(kernels[0], kernels[1]), &mut scratch).unwrap().density)
                })
                .collect();
            let n = answers.len() as f64;
            let found = answers.iter().sum::<f64>() / n;
            let spread = answers.iter().map(|a| (a - found) * (a - found)).sum::<f64>() / (n - 1.0);
            let error = (variance / n).sqrt();
            let what = format!("x {x}, t {t}, r {r}, w {w}, {kernels:?}, {n} gathers");
            // Half a percent for the sums of `theory`, whose cells are cut off at the edge of the disc.
            assert!((found - mean).abs() < 4.0 * error + 0.005 * mean, "{what}: mean {found}, theory {mean} ± {error}");
            // The spread of a variance is about √(2 / n) of it, a little more for a Poisson process.
            let loose = 4.5 * (2.0 / n).sqrt() + 0.02;
            assert!((spread / variance - 1.0).abs() < loose, "{what}: variance {spread}, theory {variance}");
        }
    }
}

/// Photons all over a box: of a radius and of the k nearest.
#[test]
fn densities_in_a_volume_are_unbiased_where_they_are_constant() {
    let mut rng = Random(12);
    let photons: Vec<_> = (0..100_000)
        .map(|_| {
            let at = Vec3::new(2.0 * rng.unit(), 2.0 * rng.unit(), 25.0 * rng.unit());
            Photon::at_time(at, Vec3::Y, 1.0f32 / 1000.0, rng.unit())
        })
        .collect();
    let map = PhotonMap::build(&photons, &GatherParams::default()).unwrap();
    let mut scratch = NeighborBuffer::new();
    for kernel in Kernel::ALL {
        for k in [None, Some(15)] {
            let answers: Vec<f64> = (0..250)
                .map(|i| {
                    let at = Vec3::new(1.0, 1.0, 0.7 + 0.094 * i as f32);
                    let query = GatherQuery::new(at, Vec3::Y, 0.5).radius(0.5).window(0.1).in_volume();
                    let query = k.map_or(query, |k| query.nearest(k));
                    f64::from(map.gather(&query.kernels(kernel, Kernel::Box), &mut scratch).unwrap().density)
                })
                .collect();
            let n = answers.len() as f64;
            let mean = answers.iter().sum::<f64>() / n;
            let error = (answers.iter().map(|a| (a - mean) * (a - mean)).sum::<f64>() / n / (n - 1.0)).sqrt();
            // Gathers overlap: those of a radius share most of their photons with their neighbours.
            assert!((mean - 1.0).abs() < 8.0 * error && error < 0.03, "{kernel:?}, {k:?}: {mean} ± {error}");
        }
    }
}

#[test]
fn k_nearest_are_unbiased_where_the_density_is_constant() {
    let mut rng = Random(11);
    let photons: Vec<_> = (0..200_000)
        .map(|_| {
            let at = Vec3::new(4.0 * rng.unit(), 0.0, 50.0 * rng.unit());
            Photon::at_time(at, Vec3::Y, 1.0f32 / 1000.0, rng.unit())
        })
        .collect();
    let map = PhotonMap::build(&photons, &GatherParams::default()).unwrap();
    let mut scratch = NeighborBuffer::new();
    for (k, window) in [(4, 0.1), (10, 0.05), (40, 0.1)] {
        for kernel in Kernel::ALL {
            let answers: Vec<f64> = (0..500)
                .map(|i| {
                    let at = Vec3::new(1.3 + 1.4 * (i % 2) as f32, 0.0, 1.0 + 0.19 * (i / 2) as f32);
                    let query = GatherQuery::new(at, Vec3::Y, 0.5).nearest(k).window(window);
                    let answer = map.gather(&query.kernels(kernel, Kernel::Box), &mut scratch).unwrap();
                    assert!(answer.reached && answer.count == k);
                    f64::from(answer.density)
                })
                .collect();
            let n = answers.len() as f64;
            let mean = answers.iter().sum::<f64>() / n;
            let error = (answers.iter().map(|a| (a - mean) * (a - mean)).sum::<f64>() / n / (n - 1.0)).sqrt();
            // Neighbouring gathers overlap a little, which the error estimate ignores.
            assert!((mean - 1.0).abs() < 6.0 * error, "k {k}, {kernel:?}: {mean} ± {error}");
        }
    }
}
