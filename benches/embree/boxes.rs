//! Moving boxes as custom primitives: ours, and Embree's user geometry, with the same function for a ray and a box.

use crate::cube::{self, Kind, last_of, vec};
use crate::ffi::{Embree, EmbreeRay, Quality, UserShapes};
use crate::options::{Isa, Options};
use mbkd::glam::Vec3;
use mbkd::{Aabb, BuildError, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, TimeInterval};
use mbkd_evidence::timing::on_one_thread;
use std::time::Instant;

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
    cube::table(options, &format!("{count} boxes"), &KINDS, |kind, isa| one(options, embree, count, kind, isa))
}

fn one(options: &Options, embree: &Embree, count: usize, kind: &Kind, isa: Isa) -> Result<String, String> {
    let mut random = cube::random();
    let half = (kind.fill / count as f64).cbrt() as f32 / 2.0;
    let mut moving_box = |_| MovingBox {
        center: vec(&mut random, 0.0..1.0),
        motion: if kind.keys == 1 { Vec3::ZERO } else { vec(&mut random, -1.0..1.0) * kind.motion },
        half: vec(&mut random, 0.5..1.5) * half,
    };
    let shapes: Vec<MovingBox> = (0..count).map(&mut moving_box).collect();
    let user = UserShapes {
        shapes: shapes.clone(),
        time_steps: kind.keys as u32,
        bounds: |shape: &MovingBox, step: u32| shape.padded(step as f32),
        hit: |shape: &MovingBox, ray: &EmbreeRay| {
            shape.hit(ray.origin.into(), ray.dir.into(), ray.time, [ray.tnear, ray.tfar])
        },
    };
    let (level, config) = cube::level_and_config(isa)?;
    let device = embree.device(config)?;
    let build_ours = || {
        let shapes = shapes.clone();
        let start = Instant::now();
        let tree = on_one_thread(|| RayTree::of_scene(&[], shapes, &BuildParams::default()));
        Ok((start.elapsed().as_secs_f64(), tree.map_err(|e: BuildError| e.to_string())?.with_simd(level)))
    };
    let build_theirs = || {
        let start = Instant::now();
        let scene = device.scene(true, Quality::Medium)?;
        scene.attach_user(0, &user)?;
        scene.commit()?;
        Ok((start.elapsed().as_secs_f64(), scene))
    };
    let ours = last_of(options.build_runs, build_ours)?;
    let theirs = last_of(options.build_runs, build_theirs)?;
    let bytes = ours.1.statistics().bytes;
    Ok(cube::row(options, &mut random, ours, theirs, (bytes, &device)))
}
