//! mbkd against Embree's motion blur, in one process.
//!
//! The picture to have in mind: for each scene a list of rays is made once; then our tree and one Embree tree answer
//! all of them in alternation, and again with the next Embree configuration. Tables are written to standard output,
//! progress to standard error. `cargo bench --bench embree -- --help` lists the options;
//! `--scale 0.05 --side 128 --runs 3` is a quick look.

mod agree;
mod boxes;
mod builds;
mod closest_points;
mod configs;
mod cube;
mod ffi;
mod forms;
mod instances;
mod masks;
mod options;
mod ours;
mod report;
mod run;
mod spheres;

use ffi::Embree;
use mbkd_scenes::Scene;
use options::{Only, Options};
use run::Measured;
use std::process::ExitCode;

fn main() -> ExitCode {
    match measure(&mbkd_evidence::options()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(options: &Options) -> Result<(), String> {
    let embree = match (options.only, Embree::load(options.embree.as_deref())) {
        (Some(Only::Ours), _) => None,
        (_, Ok(embree)) => {
            println!("Embree: {}", embree.file);
            Some(embree)
        }
        (_, Err(why)) => {
            println!(
                "Embree is not available ({why}); measuring mbkd alone. On Debian: apt-get install libembree-dev libtbb-dev"
            );
            None
        }
    };
    if let Some(count) = options.instances {
        return instances::measure(
            options,
            embree.as_ref().ok_or("instances are measured against Embree only")?,
            count,
        );
    }
    if let Some(count) = options.spheres {
        return spheres::measure(options, embree.as_ref().ok_or("spheres are measured against Embree only")?, count);
    }
    if options.closest_points {
        return closest_points::measure(
            options,
            embree.as_ref().ok_or("closest points are measured against Embree only")?,
        );
    }
    if options.forms {
        return forms::measure(options, embree.as_ref().ok_or("forms of queries are measured against Embree only")?);
    }
    if options.masks {
        return masks::measure(options, embree.as_ref().ok_or("masks are measured against Embree only")?);
    }
    if let Some(count) = options.boxes {
        return boxes::measure(options, embree.as_ref().ok_or("boxes are measured against Embree only")?, count);
    }
    let mut measured = Measured::default();
    let mut builds = Vec::new();
    for name in &options.scenes {
        let scene = scene(options, name)?;
        println!("{name}: {} triangles", scene.triangles());
        run::measure(options, embree.as_ref(), &scene, &mut measured)?;
        builds.push(builds::measure(options, embree.as_ref(), &scene, 1)?);
        if options.parallel_build {
            builds.push(builds::measure(options, embree.as_ref(), &scene, 0)?);
        }
    }
    if embree.is_some() && measured.cells.is_empty() {
        return Err(format!("no Embree configuration has one of {:?} in its name", options.configs));
    }
    report::print(options, &measured, &builds);
    Ok(())
}

/// The scene of that name, at the scale that was asked for.
fn scene(options: &Options, name: &str) -> Result<Scene, String> {
    let known = || mbkd_scenes::CATALOGUE.iter().map(|recipe| recipe.name).collect::<Vec<_>>().join(", ");
    let recipe =
        mbkd_scenes::find(name).ok_or_else(|| format!("no scene is called {name:?}; there are {}", known()))?;
    Ok((recipe.make)((recipe.full as f32 * options.scale) as usize))
}
