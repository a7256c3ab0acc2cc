//! Primitives in a cube of size one: their kinds, the rays, and a row of the table.

use crate::ffi::{Device, EmbreeRay, EmbreeScene};
use crate::options::{Isa, Options};
use mbkd::glam::Vec3;
use mbkd::{Ray, RayTree, SimdLevel};
use mbkd_evidence::timing::median;
use mbkd_evidence::turns::{Checksum, in_turns};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Primitives that are made alike.
pub struct Kind {
    pub name: &'static str,
    /// The share of the cube that they fill, overlapping or not.
    pub fill: f64,
    pub keys: usize,
    /// How far each moves at most, along an axis.
    pub motion: f32,
}

/// Prints a table: a row for each kind and instruction set.
pub fn table(
    options: &Options,
    title: &str,
    kinds: &[Kind],
    row: impl Fn(&Kind, Isa) -> Result<String, String>,
) -> Result<(), String> {
    println!("| {title} | from outside | from inside | any hit | differ | build | memory |");
    println!("|---|---|---|---|---|---|---|");
    for kind in kinds {
        for &isa in &options.isa {
            println!("| {}, {isa:?} | {} |", kind.name, row(kind, isa)?);
        }
    }
    println!("Ratios: rays, Embree's time / ours; rays that hit another primitive; build and memory, ours / Embree's.");
    Ok(())
}

pub fn random() -> StdRng {
    StdRng::seed_from_u64(1)
}

/// A vector whose components are in a range.
pub fn vec(random: &mut StdRng, range: std::ops::Range<f32>) -> Vec3 {
    Vec3::from([0; 3].map(|_| random.random_range(range.clone())))
}

/// Our instructions and the configuration of Embree's device, for one thread.
pub fn level_and_config(isa: Isa) -> Result<(SimdLevel, &'static str), String> {
    let avx2 = || SimdLevel::available().into_iter().find(|level| level.name() == "avx2");
    Ok(match isa {
        Isa::Native => (SimdLevel::best(), "threads=1"),
        Isa::Avx2 => (avx2().ok_or("this CPU has no AVX2")?, "threads=1,isa=avx2"),
    })
}

/// Builds several times; returns the median time and the last result.
pub fn last_of<T>(runs: u32, build: impl Fn() -> Result<(f64, T), String>) -> Result<(f64, T), String> {
    let (first, mut last) = build()?;
    let mut times = vec![first];
    for _ in 1..runs {
        let (time, next) = build()?;
        times.push(time);
        last = next;
    }
    Ok((median(times), last))
}

/// A row of the table but for its name. Each side is its time of building and its tree; `bytes` are ours.
pub fn row(
    options: &Options,
    random: &mut StdRng,
    (our_build, tree): (f64, RayTree),
    (their_build, theirs): (f64, EmbreeScene<'_>),
    (bytes, device): (usize, &Device<'_>),
) -> String {
    let rays = options.side * options.side;
    let from_outside: Vec<Ray> = (0..rays).map(|_| ray(random, -1.0..2.0)).collect();
    let from_inside: Vec<Ray> = (0..rays).map(|_| ray(random, 0.0..1.0)).collect();
    let short: Vec<Ray> = from_inside.iter().map(|ray| ray.between(0.0, 0.1 / ray.dir.length())).collect();
    let closest = |rays: &[Ray]| {
        let native: Vec<EmbreeRay> = rays.iter().map(EmbreeRay::from).collect();
        let ours = || Checksum::of(rays, |sum, ray| sum.closest(tree.closest_hit(ray)));
        let other = || Checksum::of(&native, |sum, ray| sum.closest(theirs.closest_hit(ray)));
        in_turns(options.runs, Some(&ours), Some(&other)).ratio
    };
    let native: Vec<EmbreeRay> = short.iter().map(EmbreeRay::from).collect();
    let ours = || Checksum::of(&short, |sum, ray| sum.any(tree.any_hit(ray)));
    let other = || Checksum::of(&native, |sum, ray| sum.any(theirs.any_hit(ray)));
    let differs = |ray: &&Ray| {
        let (ours, theirs) = (tree.closest_hit(ray), theirs.closest_hit(&EmbreeRay::from(*ray)));
        ours.map(|hit| hit.primitive) != theirs.map(|hit| hit.primitive)
    };
    format!(
        "{:.2} | {:.2} | {:.2} | {} of {rays} | {:.2} | {:.2}",
        closest(&from_outside),
        closest(&from_inside),
        in_turns(options.runs, Some(&ours), Some(&other)).ratio,
        from_outside.iter().filter(differs).count(),
        our_build / their_build,
        bytes as f64 / device.bytes() as f64
    )
}

/// A ray from somewhere in a range along each axis to somewhere in the cube.
fn ray(random: &mut StdRng, from: std::ops::Range<f32>) -> Ray {
    let (origin, target) = (vec(random, from), vec(random, 0.0..1.0));
    Ray::new(origin, target - origin).at_time(random.random())
}
