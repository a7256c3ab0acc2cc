//! Closest and any hits with a mask that hides every other mesh.

use crate::configs;
use crate::ffi::{Embree, EmbreeRay};
use crate::options::{Isa, Mode, Options};
use crate::ours::Ours;
use mbkd::{Keys, Ray, TriangleMesh};
use mbkd_evidence::scene_rays::generate;
use mbkd_evidence::turns::{Checksum, in_turns};
use mbkd_scenes::Scene;
use std::collections::HashMap;

/// The least number of meshes that a scene is divided into.
const PIECES: usize = 64;

const SEEN: u32 = 1;
const HIDDEN: u32 = 2;

/// Prints a table: a row for each scene and instruction set.
pub fn measure(options: &Options, embree: &Embree) -> Result<(), String> {
    println!("| masks | closest, camera | closest, bounce | any, AO | differ |");
    println!("|---|---:|---:|---:|---:|");
    for name in &options.scenes {
        let mut scene = crate::scene(options, name)?;
        let size = scene.triangles().div_ceil(PIECES);
        scene.meshes = scene.meshes.iter().flat_map(|mesh| pieces(mesh, size)).collect();
        for (i, mesh) in scene.meshes.iter_mut().enumerate() {
            mesh.mask = if i % 2 == 0 { SEEN } else { HIDDEN };
        }
        for &isa in &options.isa {
            println!("| {name}, {isa:?} | {} |", one(options, embree, &scene, isa)?);
        }
    }
    println!("Embree's time with its best robust configuration / ours; camera rays that hit another triangle.");
    Ok(())
}

fn one(options: &Options, embree: &Embree, scene: &Scene, isa: Isa) -> Result<String, String> {
    let ours = Ours::alone(&scene.meshes, isa)?;
    let tree = ours.tree();
    let rays = generate(&scene.meshes, &scene.camera, options.side, |ray| tree.closest_hit(ray));
    let native = |rays: &[Ray]| rays.iter().map(|ray| EmbreeRay::masked(ray, SEEN)).collect::<Vec<_>>();
    let [primary, bounce, ao] = [&rays.primary, &rays.bounce, &rays.ao].map(|rays| native(rays));
    let (mut best, mut differ) = ([f64::INFINITY; 3], 0);
    for (at, config) in configs::all(&scene.meshes, Mode::Robust).into_iter().enumerate() {
        if !options.wants(&config.name()) {
            continue;
        }
        eprintln!("  {}: masks, {isa:?}, {}", scene.name, config.name());
        let device = embree.device(&config.settings(1, (isa == Isa::Avx2).then_some("avx2")))?;
        let theirs = config.scene(&device, &scene.meshes, Mode::Robust)?;
        for (id, mesh) in (0..).zip(&scene.meshes) {
            theirs.set_mask(id, mesh.mask)?;
        }
        theirs.commit()?;
        for (i, (rays, native)) in [(&rays.primary, &primary), (&rays.bounce, &bounce)].into_iter().enumerate() {
            let one = || Checksum::of(rays, |sum, ray| sum.closest(tree.closest_hit_masked(ray, SEEN)));
            let other = || Checksum::of(native, |sum, ray| sum.closest(theirs.closest_hit(ray)));
            best[i] = best[i].min(in_turns(options.runs, Some(&one), Some(&other)).ratio);
        }
        let one = || Checksum::of(&rays.ao, |sum, ray| sum.any(tree.any_hit_masked(ray, SEEN)));
        let other = || Checksum::of(&ao, |sum, ray| sum.any(theirs.any_hit(ray)));
        best[2] = best[2].min(in_turns(options.runs, Some(&one), Some(&other)).ratio);
        if at == 0 {
            let differs = |(ray, native): &(&Ray, &EmbreeRay)| {
                let hits = [tree.closest_hit_masked(ray, SEEN), theirs.closest_hit(native)];
                let [one, other] = hits.map(|hit| hit.map(|hit| (hit.mesh, hit.primitive)));
                one != other
            };
            differ = rays.primary.iter().zip(&primary).filter(differs).count();
        }
    }
    let [closest, bounce, any] = best;
    Ok(format!("{closest:.2} | {bounce:.2} | {any:.2} | {differ} of {}", rays.primary.len()))
}

/// The mesh in parts of so many triangles, each with the vertices that it uses.
fn pieces(mesh: &TriangleMesh, size: usize) -> impl Iterator<Item = TriangleMesh> + '_ {
    mesh.indices.chunks(size).map(|indices| {
        let mut numbers = HashMap::new();
        let mut vertices = Vec::new();
        let mut number = |vertex: u32| {
            *numbers.entry(vertex).or_insert_with(|| {
                vertices.push(vertex as usize);
                vertices.len() as u32 - 1
            })
        };
        let indices = indices.iter().map(|corners| corners.map(&mut number)).collect();
        fn pick<T: Copy>(keys: &[Vec<T>], vertices: &[usize]) -> Vec<Vec<T>> {
            keys.iter().map(|key| vertices.iter().map(|&vertex| key[vertex]).collect()).collect()
        }
        let keys = match &mesh.keys {
            Keys::F32(keys) => Keys::F32(pick(keys, &vertices)),
            Keys::F64(keys) => Keys::F64(pick(keys, &vertices)),
            Keys::Precise(keys) => Keys::Precise(pick(keys, &vertices)),
        };
        TriangleMesh { indices, keys, ..mesh.clone() }
    })
}
