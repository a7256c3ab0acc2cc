//! Spheres: ours and Embree's sphere points, with the same rays in alternation.

use crate::ffi::{Embree, EmbreeRay, EmbreeScene, Quality};
use crate::options::{Isa, Options};
use crate::sum;
use crate::timing::{in_turns, median};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildError, BuildParams, MovingSphere, Ray, RayTree, Shape, SimdLevel};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::time::Instant;

/// Spheres in a cube of size one.
struct Kind {
    name: &'static str,
    /// The share of the cube that they fill, overlapping or not.
    fill: f64,
    keys: usize,
    /// How far each moves at most, along an axis.
    motion: f32,
}

const KINDS: [Kind; 7] = [
    Kind { name: "still", fill: 0.25, keys: 1, motion: 0.0 },
    Kind { name: "still, sparse", fill: 0.01, keys: 1, motion: 0.0 },
    Kind { name: "still, overlapping", fill: 4.0, keys: 1, motion: 0.0 },
    Kind { name: "moving", fill: 0.25, keys: 2, motion: 0.02 },
    Kind { name: "moving, sparse", fill: 0.01, keys: 2, motion: 0.02 },
    Kind { name: "fast", fill: 0.25, keys: 2, motion: 0.2 },
    Kind { name: "9 keys", fill: 0.25, keys: 9, motion: 0.02 },
];

/// Prints a table: a row for each kind of spheres.
pub fn measure(options: &Options, embree: &Embree, count: usize) -> Result<(), String> {
    println!("| {count} spheres | from outside | from inside | any hit | differ | build | memory |");
    println!("|---|---|---|---|---|---|---|");
    for kind in &KINDS {
        for &isa in &options.isa {
            println!("| {}, {isa:?} | {} |", kind.name, one(options, embree, count, kind, isa)?);
        }
    }
    println!(
        "Ratios: rays, Embree's time / ours; share of rays that hit another sphere; build and memory, ours / Embree's."
    );
    Ok(())
}

/// Center and radius of each sphere at each key.
fn spheres(random: &mut StdRng, count: usize, kind: &Kind) -> Vec<Vec<[f32; 4]>> {
    let radius = (kind.fill / count as f64 / 4.19).cbrt() as f32;
    let step = kind.motion / (kind.keys.max(2) - 1) as f32;
    let mut keys = vec![Vec::with_capacity(count); kind.keys];
    for _ in 0..count {
        let (mut at, radius) = (vec(random, 0.0..1.0), radius * random.random_range(0.5..1.5));
        for key in &mut keys {
            key.push([at.x, at.y, at.z, radius]);
            at += vec(random, -1.0..1.0) * step;
        }
    }
    keys
}

fn vec(random: &mut StdRng, range: std::ops::Range<f32>) -> Vec3 {
    Vec3::from([0; 3].map(|_| random.random_range(range.clone())))
}

fn one(options: &Options, embree: &Embree, count: usize, kind: &Kind, isa: Isa) -> Result<String, String> {
    let mut random = StdRng::seed_from_u64(1);
    let keys = spheres(&mut random, count, kind);
    let shape = |i: usize| {
        let key = |key: &Vec<[f32; 4]>| {
            let [x, y, z, radius] = key[i].map(f64::from);
            (DVec3::new(x, y, z), radius)
        };
        Shape::from(MovingSphere::new(keys.iter().map(key).collect()))
    };
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
    let level = |name: &str| SimdLevel::available().into_iter().find(|level| level.name() == name);
    let (level, config) = match isa {
        Isa::Native => (SimdLevel::best(), "threads=1"),
        Isa::Avx2 => (level("avx2").ok_or("this CPU has no AVX2")?, "threads=1,isa=avx2"),
    };
    let device = embree.device(config)?;
    let build_ours = || {
        let shapes: Vec<Shape> = (0..count).map(shape).collect();
        let start = Instant::now();
        let tree = alone.install(|| RayTree::of_scene(&[], shapes, &BuildParams::default()));
        Ok((start.elapsed().as_secs_f64(), tree.map_err(|e: BuildError| e.to_string())?.with_simd(level)))
    };
    let build_theirs = || {
        let start = Instant::now();
        let scene = device.scene(true, Quality::Medium)?;
        scene.attach_spheres(0, &keys)?;
        scene.commit()?;
        Ok((start.elapsed().as_secs_f64(), scene))
    };
    let (our_build, tree) = last_of(options.build_runs, build_ours)?;
    let (their_build, theirs) = last_of(options.build_runs, build_theirs)?;

    let rays = options.side * options.side;
    let from_outside: Vec<Ray> = (0..rays).map(|_| ray(&mut random, -1.0..2.0)).collect();
    let from_inside: Vec<Ray> = (0..rays).map(|_| ray(&mut random, 0.0..1.0)).collect();
    let short: Vec<Ray> = from_inside.iter().map(|ray| ray.between(0.0, 0.1 / ray.dir.length())).collect();
    let closest = |rays: &[Ray]| {
        let native: Vec<EmbreeRay> = rays.iter().map(EmbreeRay::from).collect();
        let ours = || sum(rays, |sum, ray| sum.closest(tree.closest_hit(ray)));
        let other = || sum(&native, |sum, ray| sum.closest(theirs.closest_hit(ray)));
        in_turns(options.runs, Some(&ours), Some(&other)).ratio
    };
    let native: Vec<EmbreeRay> = short.iter().map(EmbreeRay::from).collect();
    let ours = || sum(&short, |sum, ray| sum.any(tree.any_hit(ray)));
    let other = || sum(&native, |sum, ray| sum.any(theirs.any_hit(ray)));
    Ok(format!(
        "{:.2} | {:.2} | {:.2} | {:.4} % | {:.2} | {:.2}",
        closest(&from_outside),
        closest(&from_inside),
        in_turns(options.runs, Some(&ours), Some(&other)).ratio,
        100.0 * differ(&tree, &theirs, &from_outside),
        our_build / their_build,
        (tree.statistics().bytes + tree.statistics().primitive_bytes) as f64 / device.bytes() as f64
    ))
}

/// Builds several times; returns the median time and the last result.
fn last_of<T>(runs: u32, build: impl Fn() -> Result<(f64, T), String>) -> Result<(f64, T), String> {
    let (first, mut last) = build()?;
    let mut times = vec![first];
    for _ in 1..runs {
        let (time, next) = build()?;
        times.push(time);
        last = next;
    }
    Ok((median(times.into_iter()), last))
}

/// A ray from somewhere in a range along each axis to somewhere in the cube.
fn ray(random: &mut StdRng, from: std::ops::Range<f32>) -> Ray {
    let (origin, target) = (vec(random, from), vec(random, 0.0..1.0));
    Ray::new(origin, target - origin).at_time(random.random())
}

/// The share of rays that hit another sphere.
fn differ(ours: &RayTree, theirs: &EmbreeScene<'_>, rays: &[Ray]) -> f64 {
    let same = |ray: &&Ray| {
        let (ours, theirs) = (ours.closest_hit(ray), theirs.closest_hit(&EmbreeRay::from(*ray)));
        ours.map(|hit| hit.primitive) == theirs.map(|hit| hit.primitive)
    };
    1.0 - rays.iter().filter(same).count() as f64 / rays.len() as f64
}
