//! Further forms of ray queries: closest and any hits with a filter, and all hits. Embree has a filter function for each mesh; for all hits it
//! adds each one up and rejects it.

use crate::configs;
use crate::ffi::{Embree, EmbreeRay, EmbreeScene};
use crate::options::{Isa, Mode, Options};
use crate::ours::{self, Ours};
use crate::rays::generate;
use crate::timing::{Checksum, in_turns};
use mbkd::{Hit, Ray};
use mbkd_scenes::Scene;
use std::cell::Cell;
use std::ops::ControlFlow;

/// Prints a table: a row for each scene and instruction set.
pub fn measure(options: &Options, embree: &Embree) -> Result<(), String> {
    println!(
        "| forms of queries | closest, cut out | any, cut out | all hits, camera | all hits, bounce | hits per ray | differ |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|");
    for name in &options.scenes {
        let recipe = mbkd_scenes::find(name).ok_or_else(|| crate::unknown_scene(name))?;
        let scene = (recipe.make)((recipe.full as f32 * options.scale) as usize);
        for &isa in &options.isa {
            println!("| {name}, {isa:?} | {} |", one(options, embree, &scene, isa)?);
        }
    }
    println!("Embree's time with its best robust configuration / ours; the share of all hits that only one side has.");
    Ok(())
}

/// A pattern cut out of each triangle.
fn cut_out(hit: &Hit) -> bool {
    ((hit.u * 4.0) as u32 + (hit.v * 4.0) as u32).is_multiple_of(2)
}

fn one(options: &Options, embree: &Embree, scene: &Scene, isa: Isa) -> Result<String, String> {
    let mut ours = Ours::build(&scene.meshes, &ours::pool(1)?)?;
    if isa == Isa::Avx2 {
        ours = ours.with_avx2()?;
    }
    let tree = ours.tree();
    let rays = generate(&scene.meshes, &scene.camera, options.side, |ray| tree.closest_hit(ray));
    let closest = [rays.primary.as_slice(), &rays.bounce].concat();
    let all = |rays: &[Ray]| {
        let mut sum = Checksum::default();
        for ray in rays {
            let _: ControlFlow<()> = tree.all_hits(ray, |hit| {
                sum.closest(Some(hit));
                ControlFlow::Continue(())
            });
        }
        sum
    };
    let hits = [all(&rays.primary), all(&rays.bounce)].map(|sum| sum.hits);
    let number = (rays.primary.len() + rays.bounce.len()) as f64;

    let seen = Cell::new(Checksum::default());
    let reject = |hit: &Hit| {
        let mut sum = seen.get();
        sum.closest(Some(*hit));
        seen.set(sum);
        false
    };
    let all_of = |scene: &EmbreeScene<'_>, rays: &[EmbreeRay]| {
        seen.set(Checksum::default());
        rays.iter().for_each(|ray| _ = scene.closest_hit(ray));
        seen.get()
    };
    let native = |rays: &[Ray]| rays.iter().map(EmbreeRay::from).collect::<Vec<_>>();
    let (mut best, mut differ) = ([f64::INFINITY; 4], 0.0);
    for (at, config) in configs::all(&scene.meshes, Mode::Robust).into_iter().enumerate() {
        if !options.wants(&config.name()) {
            continue;
        }
        eprintln!("  {}: forms of queries, {isa:?}, {}", scene.name, config.name());
        let device = embree.device(&config.settings(1, (isa == Isa::Avx2).then_some("avx2")))?;
        let theirs = config.filtered_scene(&device, &scene.meshes, Mode::Robust, &cut_out)?;
        theirs.commit()?;
        let of_closest = native(&closest);
        let one = || sum(&closest, |sum, ray| sum.closest(tree.closest_hit_filtered(ray, u32::MAX, cut_out)));
        let other = || sum(&of_closest, |sum, ray| sum.closest(theirs.closest_hit(ray)));
        best[0] = best[0].min(in_turns(options.runs, Some(&one), Some(&other)).ratio);
        let of_ao = native(&rays.ao);
        let one = || sum(&rays.ao, |sum, ray| sum.any(tree.any_hit_filtered(ray, u32::MAX, cut_out)));
        let other = || sum(&of_ao, |sum, ray| sum.any(theirs.any_hit(ray)));
        best[1] = best[1].min(in_turns(options.runs, Some(&one), Some(&other)).ratio);
        drop(theirs);
        let theirs = config.filtered_scene(&device, &scene.meshes, Mode::Robust, &reject)?;
        theirs.commit()?;
        for (i, rays) in [&rays.primary, &rays.bounce].into_iter().enumerate() {
            let native = native(rays);
            let (one, other) = (|| all(rays), || all_of(&theirs, &native));
            best[2 + i] = best[2 + i].min(in_turns(options.runs, Some(&one), Some(&other)).ratio);
            if at == 0 {
                differ += other().hits.abs_diff(hits[i]) as f64 / (hits[0] + hits[1]).max(1) as f64;
            }
        }
    }
    let [closest, any, camera, bounce] = best;
    let per_ray = (hits[0] + hits[1]) as f64 / number;
    Ok(format!("{closest:.2} | {any:.2} | {camera:.2} | {bounce:.2} | {per_ray:.2} | {:.4} %", 100.0 * differ))
}

fn sum<R>(rays: &[R], answer: impl Fn(&mut Checksum, &R)) -> Checksum {
    let mut sum = Checksum::default();
    rays.iter().for_each(|ray| answer(&mut sum, ray));
    sum
}
