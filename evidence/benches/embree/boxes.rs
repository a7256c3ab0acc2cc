//! Moving boxes as the caller's own primitives: ours, and Embree's user geometry, with the same function for a ray and a box.

use crate::ffi::{Embree, EmbreeRay, Quality, UserShapes};
use crate::options::{Isa, Options};
use crate::sum;
use crate::timing::{in_turns, median};
use mbkd::glam::Vec3;
use mbkd::{Aabb, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, SimdLevel, TimeInterval};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::time::Instant;

/// Boxes in a cube of size one.
struct Kind {
    name: &'static str,
    /// The share of the cube that they fill, overlapping or not.
    fill: f32,
    keys: u32,
    /// How far each moves at most, along an axis.
    motion: f32,
}

const KINDS: [Kind; 5] = [
    Kind { name: "still", fill: 0.25, keys: 1, motion: 0.0 },
    Kind { name: "still, sparse", fill: 0.01, keys: 1, motion: 0.0 },
    Kind { name: "still, overlapping", fill: 4.0, keys: 1, motion: 0.0 },
    Kind { name: "moving", fill: 0.25, keys: 2, motion: 0.02 },
    Kind { name: "fast", fill: 0.25, keys: 2, motion: 0.2 },
];

/// More than the rounding of a hit.
const PADDING: f32 = 1e-5;

/// A box that moves.
#[derive(Clone, Copy)]
struct MovingBox {
    center: Vec3,
    motion: Vec3,
    half: Vec3,
}

impl MovingBox {
    fn corners(&self, time: f32) -> [Vec3; 2] {
        let center = self.center + self.motion * time;
        [center - self.half, center + self.half]
    }

    fn padded(&self, time: f32) -> [Vec3; 2] {
        let [min, max] = self.corners(time);
        [min - PADDING, max + PADDING]
    }

    /// Where a ray first meets the surface within a range.
    #[inline(always)]
    fn hit(&self, origin: Vec3, dir: Vec3, time: f32, [begin, end]: [f32; 2]) -> Option<f32> {
        let inverse = dir.recip();
        let [a, b] = self.corners(time).map(|corner| (corner - origin) * inverse);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        let at = if enter >= begin { enter } else { leave };
        (enter <= leave && begin <= at && at <= end).then_some(at)
    }
}

impl Primitive for MovingBox {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        let at = |time| {
            let [min, max] = self.padded(time).map(|corner| corner.as_dvec3());
            Aabb { min, max }
        };
        LinearBounds { begin: at(over.begin()), end: at(over.end()) }
    }

    #[inline]
    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        let t = self.hit(ray.origin.as_vec3(), ray.dir, ray.time, [ray.t_min, ray.t_max])?;
        Some(Intersection { t, u: 0.0, v: 0.0 })
    }
}

/// Prints a table: a row for each kind of boxes.
pub fn measure(options: &Options, embree: &Embree, count: usize) -> Result<(), String> {
    println!("| {count} boxes | from outside | from inside | any hit | differ | build | memory |");
    println!("|---|---|---|---|---|---|---|");
    for kind in &KINDS {
        for &isa in &options.isa {
            println!("| {}, {isa:?} | {} |", kind.name, one(options, embree, count, kind, isa)?);
        }
    }
    println!(
        "Ratios: rays, Embree's time / ours; rays that hit another box; build and memory of the tree, ours / Embree's."
    );
    Ok(())
}

fn vec(random: &mut StdRng, range: std::ops::Range<f32>) -> Vec3 {
    Vec3::from([0; 3].map(|_| random.random_range(range.clone())))
}

fn one(options: &Options, embree: &Embree, count: usize, kind: &Kind, isa: Isa) -> Result<String, String> {
    let mut random = StdRng::seed_from_u64(1);
    let half = (kind.fill / count as f32).cbrt() / 2.0;
    let mut moving_box = |_| MovingBox {
        center: vec(&mut random, 0.0..1.0),
        motion: if kind.keys == 1 { Vec3::ZERO } else { vec(&mut random, -1.0..1.0) * kind.motion },
        half: vec(&mut random, 0.5..1.5) * half,
    };
    let shapes: Vec<MovingBox> = (0..count).map(&mut moving_box).collect();
    let user = UserShapes {
        shapes: shapes.clone(),
        time_steps: kind.keys,
        bounds: |shape: &MovingBox, step: u32| shape.padded(step as f32),
        hit: |shape: &MovingBox, ray: &EmbreeRay| {
            shape.hit(ray.origin.into(), ray.dir.into(), ray.time, [ray.tnear, ray.tfar])
        },
    };
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
    let level = |name: &str| SimdLevel::available().into_iter().find(|level| level.name() == name);
    let (level, config) = match isa {
        Isa::Native => (SimdLevel::best(), "threads=1"),
        Isa::Avx2 => (level("avx2").ok_or("this CPU has no AVX2")?, "threads=1,isa=avx2"),
    };
    let device = embree.device(config)?;
    let (mut our_times, mut their_times) = (Vec::new(), Vec::new());
    let (mut tree, mut theirs) = (None, None);
    for _ in 0..options.build_runs {
        let shapes = shapes.clone();
        let start = Instant::now();
        let built = alone.install(|| RayTree::of_primitives(shapes, &BuildParams::default()));
        our_times.push(start.elapsed().as_secs_f64());
        tree = Some(built.map_err(|e| e.to_string())?.with_simd(level));
        drop(theirs.take());
        let start = Instant::now();
        let scene = device.scene(true, Quality::Medium)?;
        scene.attach_user(0, &user)?;
        scene.commit()?;
        their_times.push(start.elapsed().as_secs_f64());
        theirs = Some(scene);
    }
    let (tree, theirs) = (tree.ok_or("no builds")?, theirs.ok_or("no builds")?);

    let rays = options.side * options.side;
    let mut ray = |from: std::ops::Range<f32>| {
        let (origin, target) = (vec(&mut random, from), vec(&mut random, 0.0..1.0));
        Ray::new(origin, target - origin).at_time(random.random())
    };
    let from_outside: Vec<Ray> = (0..rays).map(|_| ray(-1.0..2.0)).collect();
    let from_inside: Vec<Ray> = (0..rays).map(|_| ray(0.0..1.0)).collect();
    let short: Vec<Ray> = from_inside.iter().map(|ray| ray.between(0.0, 0.1 / ray.dir.length())).collect();
    let native = |rays: &[Ray]| -> Vec<EmbreeRay> { rays.iter().map(EmbreeRay::from).collect() };
    let closest = |rays: &[Ray]| {
        let native = native(rays);
        let ours = || sum(rays, |sum, ray| sum.closest(tree.closest_hit(ray)));
        let other = || sum(&native, |sum, ray| sum.closest(theirs.closest_hit(ray)));
        in_turns(options.runs, Some(&ours), Some(&other)).ratio
    };
    let native = native(&short);
    let ours = || sum(&short, |sum, ray| sum.any(tree.any_hit(ray)));
    let other = || sum(&native, |sum, ray| sum.any(theirs.any_hit(ray)));
    let differs = |ray: &&Ray| {
        let (ours, theirs) = (tree.closest_hit(ray), theirs.closest_hit(&EmbreeRay::from(*ray)));
        ours.map(|hit| hit.primitive) != theirs.map(|hit| hit.primitive)
    };
    Ok(format!(
        "{:.2} | {:.2} | {:.2} | {} of {rays} | {:.2} | {:.2}",
        closest(&from_outside),
        closest(&from_inside),
        in_turns(options.runs, Some(&ours), Some(&other)).ratio,
        from_outside.iter().filter(differs).count(),
        median(our_times.into_iter()) / median(their_times.into_iter()),
        tree.statistics().bytes as f64 / device.bytes() as f64
    ))
}
