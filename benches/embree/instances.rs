//! A scene placed many times, each instance moving: ours and Embree's motion-blurred instances, with the same rays in
//! alternation.
//!
//! Instances fill a cube so densely that a ray meets the boxes of several, by matrices (both sides interpolate entries)
//! and by scale, rotation and translation (both sides rotate uniformly). The placed scene is measured both moving and
//! static.

use crate::ffi::{Embree, EmbreeRay, EmbreeScene, Mesh, Quality};
use crate::options::{Mode, Options};
use mbkd::glam::{DQuat, DVec3, Vec3};
use mbkd::{BuildParams, Instance, InstanceTree, Pose, Ray, RayTree, Transform, TriangleMesh, WideParams};
use mbkd_evidence::triangles::{positions, scene_size};
use mbkd_evidence::turns::{Checksum, in_turns};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use std::time::Instant;

/// Prints a table: a row for each scene, motion and mode.
pub fn measure(options: &Options, embree: &Embree, count: u32) -> Result<(), String> {
    println!("| placed | motion | Embree's mode | closest | any | differ | build | memory |");
    println!("|---|---|---|---|---|---|---|---|");
    for name in &options.scenes {
        let scene = crate::scene(options, name)?;
        let still: Vec<TriangleMesh> = scene.meshes.iter().map(first_key).collect();
        for (what, meshes) in [("still", &still), ("moving", &scene.meshes)] {
            for motion in ["none", "matrices", "rotations"] {
                for &mode in &options.modes {
                    let row = one(options, embree, count, meshes, motion, mode)?;
                    println!("| {name}, {what} | {motion} | {mode:?} | {row} |");
                }
            }
        }
    }
    println!(
        "Ratios: rays, Embree's time / ours; share of rays with another answer; build and memory, ours / Embree's."
    );
    Ok(())
}

fn first_key(mesh: &TriangleMesh) -> TriangleMesh {
    TriangleMesh::fixed(mesh.indices.clone(), positions(mesh)[0].to_vec())
}

fn vec(random: &mut StdRng) -> DVec3 {
    DVec3::new(random.random(), random.random(), random.random()) * 2.0 - 1.0
}

/// The transform of an instance at both ends of the shutter.
fn transform(random: &mut StdRng, motion: &str, scale: f64) -> Transform {
    let axis = vec(random).normalize_or(DVec3::X);
    let rotation = DQuat::from_axis_angle(axis, random.random_range(0.0..6.0));
    let begin = Pose { scale: DVec3::splat(scale), rotation, translation: vec(random) };
    let turn = DQuat::from_axis_angle(vec(random).normalize_or(DVec3::X), 0.5);
    let end = Pose { rotation: turn * rotation, translation: begin.translation + vec(random) * scale, ..begin };
    match motion {
        "none" => begin.into(),
        "matrices" => vec![begin.matrix(), end.matrix()].into(),
        _ => vec![begin, end].into(),
    }
}

fn one(
    options: &Options,
    embree: &Embree,
    count: u32,
    meshes: &[TriangleMesh],
    motion: &str,
    mode: Mode,
) -> Result<String, String> {
    let mut random = StdRng::seed_from_u64(1);
    // All boxes together fill the cube about once.
    let scale = 2.0 / f64::from(count).cbrt() / f64::from(scene_size(meshes)) * 1.7;
    let transforms: Vec<Transform> = (0..count).map(|_| transform(&mut random, motion, scale)).collect();
    let tree = RayTree::build(meshes, &BuildParams::default()).map_err(|e| e.to_string())?;
    let tree = Arc::new(tree);
    let place = |transform: &Transform| Instance::new(tree.clone(), transform.clone());
    let start = Instant::now();
    let ours = InstanceTree::build(transforms.iter().map(place).collect(), &WideParams::default());
    let ours = ours.map_err(|e| e.to_string())?;
    let our_build = start.elapsed().as_secs_f64();

    let device = embree.device("threads=1")?;
    let inner = device.scene(mode == Mode::Robust, Quality::Medium)?;
    for (id, mesh) in meshes.iter().enumerate() {
        inner.attach(id as u32, &Mesh { indices: &mesh.indices, steps: positions(mesh) })?;
    }
    inner.commit()?;
    let before = device.bytes();
    let theirs = device.scene(mode == Mode::Robust, Quality::Medium)?;
    let start = Instant::now();
    for (id, transform) in transforms.iter().enumerate() {
        theirs.attach_instance(id as u32, &inner, transform)?;
    }
    theirs.commit()?;
    let their_build = start.elapsed().as_secs_f64();
    let bytes = (device.bytes() - before) as f64;

    let rays: Vec<Ray> = (0..options.side * options.side).map(|_| ray(&mut random)).collect();
    let native: Vec<EmbreeRay> = rays.iter().map(EmbreeRay::from).collect();
    let our_closest = || Checksum::of(&rays, |sum, ray| sum.closest(ours.closest_hit(ray).map(|found| found.hit)));
    let their_closest = || Checksum::of(&native, |sum, ray| sum.closest(theirs.closest_hit(ray)));
    let closest = in_turns(options.runs, Some(&our_closest), Some(&their_closest));
    let our_any = || Checksum::of(&rays, |sum, ray| sum.any(ours.any_hit(ray)));
    let their_any = || Checksum::of(&native, |sum, ray| sum.any(theirs.any_hit(ray)));
    let any = in_turns(options.runs, Some(&our_any), Some(&their_any));
    Ok(format!(
        "{:.2} | {:.2} | {:.4} % | {:.2} | {:.2}",
        closest.ratio,
        any.ratio,
        100.0 * differ(&ours, &theirs, &rays, &native),
        our_build / their_build,
        ours.statistics().instance_bytes as f64 / bytes
    ))
}

/// A ray from around the cube to a point in it.
fn ray(random: &mut StdRng) -> Ray {
    let (origin, target) = (vec(random) * 3.0, vec(random));
    let (origin, target): (Vec3, Vec3) = (origin.as_vec3(), target.as_vec3());
    Ray::new(origin, target - origin).at_time(random.random())
}

/// The share of rays that hit another primitive, or at a distance that differs by more than a thousandth.
fn differ(ours: &InstanceTree, theirs: &EmbreeScene<'_>, rays: &[Ray], native: &[EmbreeRay]) -> f64 {
    let same = |(ray, native): (&Ray, &EmbreeRay)| match (ours.closest_hit(ray), theirs.closest_hit(native)) {
        (None, None) => true,
        (Some(a), Some(b)) => a.hit.primitive == b.primitive && (a.hit.t - b.t).abs() <= 1e-3 * b.t.abs(),
        _ => false,
    };
    let differ = rays.iter().zip(native).filter(|&pair| !same(pair)).count();
    differ as f64 / rays.len() as f64
}
