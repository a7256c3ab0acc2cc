//! Further forms of ray queries: closest and any hits with a filter, and all hits. Embree has a filter function for each mesh; for
//! all hits it adds each one up and rejects it.

use crate::configs;
use crate::ffi::{Embree, EmbreeRay};
use crate::options::{Isa, Mode, Options};
use crate::ours::Ours;
use mbkd::{Hit, Ray, RayTree};
use mbkd_evidence::scene_rays::generate;
use mbkd_evidence::turns::{Checksum, in_turns};
use mbkd_scenes::Scene;
use std::cell::Cell;
use std::ops::ControlFlow;

/// The number of forms.
const FORMS: usize = 4;

/// Prints a table: a row for each scene and instruction set.
pub fn measure(options: &Options, embree: &Embree) -> Result<(), String> {
    println!(
        "| forms of queries | closest, cut out | any, cut out | all hits, camera | all hits, bounce | hits | more or fewer |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|");
    for name in &options.scenes {
        let scene = crate::scene(options, name)?;
        for &isa in &options.isa {
            println!("| {name}, {isa:?} | {} |", one(options, embree, &scene, isa)?);
        }
    }
    println!(
        "Embree's time with its best robust configuration / ours; our hits of all forms, and by how many the numbers differ."
    );
    Ok(())
}

/// A pattern cut out of each triangle.
fn cut_out(hit: &Hit) -> bool {
    ((hit.u * 4.0) as u32 + (hit.v * 4.0) as u32).is_multiple_of(2)
}

fn one(options: &Options, embree: &Embree, scene: &Scene, isa: Isa) -> Result<String, String> {
    let ours = Ours::alone(&scene.meshes, isa)?;
    let tree = ours.tree();
    let rays = generate(&scene.meshes, &scene.camera, options.side, |ray| tree.closest_hit(ray));
    let closest = [rays.primary.as_slice(), &rays.bounce].concat();
    let [of_closest, of_ao, of_primary, of_bounce] =
        [&closest, &rays.ao, &rays.primary, &rays.bounce].map(|rays| native(rays));
    let ours: [&dyn Fn() -> Checksum; FORMS] = [
        &|| Checksum::of(&closest, |sum, ray| sum.closest(tree.closest_hit_filtered(ray, u32::MAX, cut_out))),
        &|| Checksum::of(&rays.ao, |sum, ray| sum.any(tree.any_hit_filtered(ray, u32::MAX, cut_out))),
        &|| Checksum::of(&rays.primary, |sum, ray| add_all(tree, ray, sum)),
        &|| Checksum::of(&rays.bounce, |sum, ray| add_all(tree, ray, sum)),
    ];
    let number = |form: &dyn Fn() -> Checksum| form().hits;
    let hits = ours.map(number);
    let (mut best, mut differ) = ([f64::INFINITY; FORMS], 0);
    // Embree's filters of all hits add them up here.
    let seen = Cell::new(Checksum::default());
    let reject = |hit: &Hit| {
        let mut sum = seen.get();
        sum.closest(Some(*hit));
        seen.set(sum);
        false
    };
    for config in configs::all(&scene.meshes, Mode::Robust) {
        if !options.wants(&config.name()) {
            continue;
        }
        eprintln!("  {}: forms of queries, {isa:?}, {}", scene.name, config.name());
        let device = embree.device(&config.settings(1, (isa == Isa::Avx2).then_some("avx2")))?;
        let filtered = config.filtered_scene(&device, &scene.meshes, Mode::Robust, &cut_out)?;
        filtered.commit()?;
        let rejecting = config.filtered_scene(&device, &scene.meshes, Mode::Robust, &reject)?;
        rejecting.commit()?;
        let all = |rays: &[EmbreeRay]| {
            seen.set(Checksum::default());
            rays.iter().for_each(|ray| _ = rejecting.closest_hit(ray));
            seen.get()
        };
        let theirs: [&dyn Fn() -> Checksum; FORMS] = [
            &|| Checksum::of(&of_closest, |sum, ray| sum.closest(filtered.closest_hit(ray))),
            &|| Checksum::of(&of_ao, |sum, ray| sum.any(filtered.any_hit(ray))),
            &|| all(&of_primary),
            &|| all(&of_bounce),
        ];
        let found = theirs.map(number);
        differ = differ.max((0..FORMS).map(|form| found[form].abs_diff(hits[form])).sum());
        for form in 0..FORMS {
            let ratio = in_turns(options.runs, Some(ours[form]), Some(theirs[form])).ratio;
            best[form] = best[form].min(ratio);
        }
    }
    let ratios = best.map(|ratio| format!("{ratio:.2}")).join(" | ");
    Ok(format!("{ratios} | {} | {differ}", hits.iter().sum::<u64>()))
}

fn add_all(tree: &RayTree, ray: &Ray, sum: &mut Checksum) {
    let _ = tree.all_hits(ray, |hit| {
        sum.closest(Some(hit));
        ControlFlow::Continue(())
    });
}

fn native(rays: &[Ray]) -> Vec<EmbreeRay> {
    rays.iter().map(EmbreeRay::from).collect()
}
