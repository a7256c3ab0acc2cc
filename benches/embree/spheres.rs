//! Spheres: ours and Embree's sphere points, with the same rays in alternation.

use crate::cube::{self, Kind, last_of, vec};
use crate::ffi::{Embree, Quality};
use crate::options::{Isa, Options};
use mbkd::glam::DVec3;
use mbkd::{BuildError, BuildParams, MovingSphere, RayTree};
use mbkd_evidence::timing::on_one_thread;
use rand::RngExt;
use rand::rngs::StdRng;
use std::time::Instant;

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
    cube::table(options, &format!("{count} spheres"), &KINDS, |kind, isa| one(options, embree, count, kind, isa))
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

fn one(options: &Options, embree: &Embree, count: usize, kind: &Kind, isa: Isa) -> Result<String, String> {
    let mut random = cube::random();
    let keys = spheres(&mut random, count, kind);
    let sphere = |i: usize| {
        let key = |key: &Vec<[f32; 4]>| {
            let [x, y, z, radius] = key[i].map(f64::from);
            (DVec3::new(x, y, z), radius)
        };
        MovingSphere::new(keys.iter().map(key).collect())
    };
    let (level, config) = cube::level_and_config(isa)?;
    let device = embree.device(config)?;
    let build_ours = || {
        let spheres: Vec<MovingSphere> = (0..count).map(sphere).collect();
        let start = Instant::now();
        let tree = on_one_thread(|| RayTree::of_scene(&[], spheres, &BuildParams::default()));
        Ok((start.elapsed().as_secs_f64(), tree.map_err(|e: BuildError| e.to_string())?.with_simd(level)))
    };
    let build_theirs = || {
        let start = Instant::now();
        let scene = device.scene(true, Quality::Medium)?;
        scene.attach_spheres(0, &keys)?;
        scene.commit()?;
        Ok((start.elapsed().as_secs_f64(), scene))
    };
    let ours = last_of(options.build_runs, build_ours)?;
    let theirs = last_of(options.build_runs, build_theirs)?;
    let bytes = ours.1.statistics().bytes + ours.1.statistics().primitive_bytes;
    Ok(cube::row(options, &mut random, ours, theirs, (bytes, &device)))
}
