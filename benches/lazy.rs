//! The saving of a lazy tree if a picture shows a small part of a scene.
//!
//! For each scene a picture is chosen whose rays test about the wanted share of the triangles: a window in the middle
//! of the scene's own picture, shrunk until that holds. A whole build, and a lazy build with the rays of the picture,
//! alternate on one thread. The time for on-demand builds is that of the first pass of rays minus that of a second pass
//! through the same tree.
//!
//! `cargo bench --bench lazy > lazy.md`; `--help` lists the options. For figures to publish give it an idle core.

use clap::Parser;
use core::ops::ControlFlow;
use mbkd::{Aabb, BuildParams, Division, LazyParams, Ray, RayTree, TreePrimitive, Visitor};
use mbkd_evidence::options;
use mbkd_evidence::timing::{median, on_one_thread, timed};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::collections::HashSet;
use std::error::Error;
use std::hint::black_box;

#[derive(Parser)]
#[command(about = "Measures lazy builds against whole ones")]
struct Args {
    /// Share of each scene's usual number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Number of rays of a picture.
    #[arg(long, default_value_t = 262_144)]
    rays: usize,
    /// Largest share of the triangles that the rays may test.
    #[arg(long, default_value_t = 0.05)]
    share: f64,
    /// Largest number of primitives in a subtree.
    #[arg(long, default_value_t = LazyParams::default().subtree)]
    subtree: usize,
    /// Do not divide the shutter in subtrees.
    #[arg(long)]
    whole: bool,
    /// Number of repetitions.
    #[arg(long, default_value_t = 7)]
    rounds: usize,
    /// Only scenes whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let args: Args = options();
    println!(
        "| scene | triangles | tested | in subtrees built | subtrees | build, ms | lazy build / build | and what rays built | at first, \
         build and rays / build and rays | rays / rays of the whole tree |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for recipe in scene::CATALOGUE.iter().filter(|recipe| recipe.name.contains(&args.only)) {
        on_one_thread(|| measure(&args, recipe))?;
    }
    Ok(())
}

fn measure(args: &Args, recipe: &scene::Recipe) -> Result<(), Box<dyn Error + Send + Sync>> {
    let scene = (recipe.make)((recipe.full as f32 * args.scale) as usize);
    let mut lazy = LazyParams { subtree: args.subtree, ..LazyParams::default() };
    if args.whole {
        lazy.wide.division = Division::Whole;
    }
    let lazy = BuildParams::lazy(lazy);
    let build = |params: &BuildParams| timed(|| RayTree::build(&scene.meshes, params));
    let whole = build(&BuildParams::default()).0?;
    let (rays, tested) = picture(&whole, &scene.camera, args);
    let [mut builds, mut of_build, mut with_subtrees, mut with_rays, mut of_rays] = [const { Vec::new() }; 5];
    let mut built = whole.statistics();
    let mut share = 0.0;
    for _ in 0..args.rounds {
        let (whole, whole_time) = build(&BuildParams::default());
        let (lazy, lazy_time) = build(&lazy);
        let (whole, lazy) = (whole?, lazy?);
        let ((), first) = timed(|| run_query(&lazy, &rays));
        let ((), of_whole) = timed(|| run_query(&whole, &rays));
        let ((), again) = timed(|| run_query(&lazy, &rays));
        builds.push(whole_time);
        of_build.push(lazy_time / whole_time);
        with_subtrees.push((lazy_time + first - again) / whole_time);
        with_rays.push((lazy_time + first) / (whole_time + of_whole));
        of_rays.push(again / of_whole);
        built = lazy.statistics();
        share = (built.references as f64 * (1.0 - built.duplicates)) / built.primitives as f64;
    }
    println!(
        "| {} | {} | {:.1} % | {:.1} % | {} of {} | {:.1} | {:.3} | {:.3} | {:.3} | {:.2} |",
        recipe.name,
        built.primitives,
        100.0 * tested,
        100.0 * share,
        built.built_subtrees,
        built.subtrees,
        median(builds) * 1e3,
        median(of_build),
        median(with_subtrees),
        median(with_rays),
        median(of_rays),
    );
    Ok(())
}

fn run_query(tree: &RayTree, rays: &[Ray]) {
    rays.iter().for_each(|ray| _ = black_box(tree.closest_hit(ray)));
}

/// The rays of the largest window that tests at most the wanted share of the triangles, and the share that it tests.
fn picture(tree: &RayTree, camera: &scene::Camera, args: &Args) -> (Vec<Ray>, f64) {
    let (mut least, mut most, mut best) = (0.0f32, 1.0, None);
    for step in 0..7 {
        // The whole picture first.
        let window = if step == 0 { 1.0 } else { 0.5 * (least + most) };
        let rays = rays(camera, window, args.rays);
        let share = tested(tree, &rays);
        if share <= args.share || best.is_none() {
            best = Some((rays, share));
            least = window;
        }
        if share <= args.share && step == 0 {
            break;
        }
        if share > args.share {
            (least, most) = (if step == 0 { 0.0 } else { least }, window);
        }
    }
    best.unwrap_or_default()
}

/// Rays through a window of this width in the middle of a picture, each at its own time, row by row.
fn rays(camera: &scene::Camera, window: f32, count: usize) -> Vec<Ray> {
    let side = (count as f32).sqrt() as usize;
    let mut random = Random(1);
    let place = |i: usize, by: f32| 0.5 + ((i as f32 + by) / side as f32 - 0.5) * window;
    let pixels = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    pixels.map(|(x, y)| camera.ray(place(x, random.unit()), place(y, random.unit()), 1.0, random.unit())).collect()
}

/// The share of the triangles in leaf blocks that rays visit before their hits.
fn tested(tree: &RayTree, rays: &[Ray]) -> f64 {
    let mut seen = HashSet::new();
    for ray in rays {
        let end = tree.closest_hit(ray).map_or(f32::INFINITY, |hit| hit.t);
        _ = tree.traverse(ray.time, &mut RayVisitor { ray: *ray, end: f64::from(end), seen: &mut seen });
    }
    seen.len() as f64 / tree.statistics().primitives as f64
}

/// The path of a ray up to its hit.
struct RayVisitor<'a> {
    ray: Ray,
    end: f64,
    seen: &'a mut HashSet<TreePrimitive>,
}

impl Visitor<TreePrimitive> for RayVisitor<'_> {
    fn enter(&mut self, bounds: &Aabb) -> Option<f32> {
        let dir = self.ray.dir.as_dvec3();
        let (a, b) = ((bounds.min - self.ray.origin) / dir, (bounds.max - self.ray.origin) / dir);
        let (enter, leave) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(self.end));
        (enter <= leave).then_some(enter as f32)
    }

    fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
        self.seen.insert(item);
        ControlFlow::Continue(())
    }
}
