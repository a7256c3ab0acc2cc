//! Loading a tree against building it: interleaved, on one thread, medians.
//!
//! Trees are saved to and loaded from a file in the temporary folder, which is in the page cache after the first time.
//! `cargo bench --bench files > files.md`; `--help` lists the options.

use clap::Parser;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, MovingPoint, PointArrays, PointParams, PointStructure, PointTree, RayTree};
use mbkd_evidence::options;
use mbkd_evidence::timing::{median, timed};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::error::Error;
use std::path::Path;

#[derive(Parser)]
#[command(about = "Measures loading trees against building them")]
struct Args {
    /// Triangles of each scene, and points of each set.
    #[arg(long, default_value_t = 1_000_000)]
    size: usize,
    /// Rounds.
    #[arg(long, default_value_t = 5)]
    runs: usize,
    /// Only rows whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

/// A result with any error.
type Tried<T> = Result<T, Box<dyn Error>>;

/// A row: how its tree is built, saved and loaded.
struct Row<'a, T> {
    build: &'a dyn Fn() -> Tried<T>,
    save: &'a dyn Fn(&T, &Path) -> Tried<()>,
    load: &'a dyn Fn(&Path) -> Tried<T>,
}

fn main() -> Tried<()> {
    let args: Args = options();
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    println!("| tree | MB | build, ms | save, ms | load, ms | build / load |\n|---|---|---|---|---|---|");
    let policies = [("wide", BuildParams::default()), ("k-d", BuildParams::paper())];
    for (policy, params) in &policies {
        for name in ["hall", "coherent", "tornado", "hairball"] {
            let title = format!("{name}, {policy}");
            let recipe = scene::find(name).ok_or("a scene of the catalogue")?;
            // The paper's build of a million triangles takes minutes.
            let size = if *policy == "k-d" { args.size / 10 } else { args.size };
            if title.contains(&args.only) {
                let meshes = (recipe.make)(size).meshes;
                let build = || Ok(RayTree::build(&meshes, params)?);
                let save = |tree: &RayTree, path: &Path| Ok(tree.save(path)?);
                let row = Row { build: &build, save: &save, load: &|path| Ok(RayTree::load(path)?) };
                measure(&args, &format!("{title}, {size} triangles"), &row)?;
            }
        }
    }
    let mut random = Random(1);
    let still: Vec<Vec3> = (0..args.size).map(|_| random.vec()).collect();
    let moving: Vec<MovingPoint> = still.iter().map(|&at| MovingPoint::new(at, at + random.vec() * 0.01)).collect();
    let wide: Vec<DVec3> = still.iter().map(|at| at.as_dvec3() + 0.1).collect();
    let points = |name: &str, build: &dyn Fn() -> Tried<PointTree>| {
        let title = format!("{name}, {} points", args.size);
        if !title.contains(&args.only) {
            return Ok(());
        }
        let save = |tree: &PointTree, path: &Path| Ok(tree.save(path)?);
        measure(&args, &title, &Row { build, save: &save, load: &|path| Ok(PointTree::load(path)?) })
    };
    let of = |structure| PointParams { structure, ..PointParams::default() };
    points("still", &|| Ok(PointTree::build(&still, &PointParams::default())?))?;
    points("moving boxes", &|| Ok(PointTree::build(&moving, &of(PointStructure::Linear))?))?;
    points("moving, chosen", &|| Ok(PointTree::build(&moving, &PointParams::default())?))?;
    points("k-d", &|| Ok(PointTree::build(&moving, &of(PointStructure::Kd))?))?;
    points("still in f64", &|| {
        let set = PointArrays { keys: &[&wide], active: &[], ids: &[] };
        Ok(PointTree::build(&set, &PointParams::default())?)
    })
}

fn measure<T>(args: &Args, name: &str, row: &Row<'_, T>) -> Tried<()> {
    let path = std::env::temp_dir().join(format!("mbkd-bench-{}", std::process::id()));
    let mut times = [const { Vec::new() }; 3];
    let mut bytes = 0;
    for _ in 0..args.runs {
        let (tree, built) = timed(row.build);
        let tree = tree?;
        let (done, saved) = timed(|| (row.save)(&tree, &path));
        done?;
        // The built tree is still alive, so the load cannot reuse its memory.
        let (again, loaded) = timed(|| (row.load)(&path));
        for (times, time) in times.iter_mut().zip([built, saved, loaded]) {
            times.push(time);
        }
        bytes = std::fs::metadata(&path)?.len();
        drop((tree, again?));
    }
    std::fs::remove_file(&path)?;
    let [build, save, load] = times.map(median);
    println!(
        "| {name} | {:.0} | {:.0} | {:.1} | {:.1} | {:.1} |",
        bytes as f64 * 1e-6,
        build * 1e3,
        save * 1e3,
        load * 1e3,
        build / load,
    );
    Ok(())
}
