//! The cost of a refit compared with a build, and the cost of rays afterwards.
//!
//! A tree is built of the first frame of an animation and refitted to every following one; at some of them another tree
//! is built, and both answer the same rays in alternation, on one thread; medians. Times are processor times.
//!
//! `cargo bench --bench refit > refit.md`; `--help` lists the options. For figures to publish give it an idle core.

use clap::Parser;
use mbkd::glam::Vec3;
use mbkd::{BuildParams, Counters, Keys, Ray, RayTree, TriangleMesh};
use mbkd_evidence::options;
use mbkd_evidence::timing::{median, on_one_thread, timed};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::error::Error;
use std::hint::black_box;

#[derive(Parser)]
#[command(about = "Measures refits against builds, and the quality of refitted trees")]
struct Args {
    /// Share of each animation's usual number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Rays in each round.
    #[arg(long, default_value_t = 40_000)]
    rays: usize,
    /// Frames.
    #[arg(long, default_value_t = 100)]
    frames: usize,
    /// A new tree is built after this many frames.
    #[arg(long, default_value_t = 20)]
    step: usize,
    /// Only animations whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

/// An animation.
struct Row {
    name: &'static str,
    /// The scene for a number of triangles and a frame.
    frame: fn(usize, usize) -> scene::Scene,
    triangles: usize,
    /// The index of the first moving mesh, given the number of all.
    moving: fn(usize) -> usize,
}

const ROWS: [Row; 8] = [
    Row { name: "hall, running figure", frame: |n, i| running(n, 2, i), triangles: 300_000, moving: |_| 5 },
    Row { name: "hall, running figure, 17 keys", frame: |n, i| running(n, 17, i), triangles: 300_000, moving: |_| 5 },
    Row { name: "running figure alone", frame: |n, i| alone(n, 2, i), triangles: 300_000, moving: |_| 0 },
    Row { name: "running figure alone, 17 keys", frame: |n, i| alone(n, 17, i), triangles: 100_000, moving: |_| 0 },
    Row {
        name: "turning rock, 17 keys",
        frame: |n, i| bent(scene::turning(n, 17), i),
        triangles: 60_000,
        moving: |_| 0,
    },
    Row { name: "tornado", frame: |n, i| bent(scene::tornado(n), i), triangles: 100_000, moving: |_| 0 },
    Row { name: "static hall, moving cube", frame: beside_cube, triangles: 1_000_000, moving: |meshes| meshes - 1 },
    Row { name: "cubes, one moves", frame: cubes, triangles: 600_000, moving: |meshes| meshes - 1 },
];

/// Frames half a shutter apart, from the figure's entrance.
fn running(triangles: usize, keys: usize, frame: usize) -> scene::Scene {
    scene::walking_from(triangles, keys, 0.5 * frame as f32 - 30.0)
}

fn alone(triangles: usize, keys: usize, frame: usize) -> scene::Scene {
    let mut scene = running(6 * triangles, keys, frame);
    scene.meshes.drain(..5);
    scene.camera = scene::Camera::fixed(scene::View::new(
        Vec3::new(-1.5, 1.2, 4.5 + 0.06 * frame as f32 - 3.6),
        Vec3::new(0.25, 0.9, 2.1 + 0.06 * frame as f32 - 3.6),
        0.8,
    ));
    scene
}

/// A scene of which everything moves, bent a little more from frame to frame.
fn bent(mut scene: scene::Scene, frame: usize) -> scene::Scene {
    let by = 0.001 * frame as f32;
    for mesh in &mut scene.meshes {
        if let Keys::F32(keys) = &mut mesh.keys {
            keys.iter_mut().flatten().for_each(|p| *p += by * Vec3::new(p.y.sin(), p.z.sin(), p.x.sin()));
        }
    }
    scene
}

/// A cube that moves by a hundredth of its size while the shutter is open.
fn cube(at: Vec3, size: f32) -> TriangleMesh {
    let corner = |i: usize| at + size * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    let open: Vec<Vec3> = (0..8).map(corner).collect();
    let close = open.iter().map(|p| p + Vec3::X * 0.01 * size).collect();
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    TriangleMesh::new(faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(), vec![open, close])
}

fn beside_cube(triangles: usize, frame: usize) -> scene::Scene {
    let mut scene = scene::camera(triangles);
    let view = scene.camera.view(0.0);
    let place = view.position.lerp(view.target, 0.5) + Vec3::X * 0.001 * frame as f32;
    scene.meshes.push(cube(place, 0.1));
    scene
}

/// Cubes of twelve triangles, each a mesh, of which the last one moves from frame to frame.
fn cubes(triangles: usize, frame: usize) -> scene::Scene {
    let mut scene = scene::camera(100);
    let (mut random, count) = (Random(3), triangles / 12);
    let mut place = || Vec3::new(random.unit(), random.unit(), random.unit()) * 10.0;
    scene.meshes = (0..count).map(|_| cube(place(), 0.05)).collect();
    scene.meshes[count - 1] = cube(Vec3::splat(5.0) + Vec3::X * 0.01 * frame as f32, 0.05);
    let eye = Vec3::new(5.0, 5.0, -8.0);
    scene.camera = scene::Camera::fixed(scene::View::new(eye, Vec3::splat(5.0), 0.8));
    scene
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let args: Args = options();
    println!(
        "| animation | triangles | build, ms | first refit | refit | of the moving meshes | build / refit | build / refit of the moving meshes | blocks written | cost \
         | blocks per ray / another tree's | rays / another tree's |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for row in ROWS.iter().filter(|row| row.name.contains(&args.only)) {
        on_one_thread(|| measure(&args, row))?;
    }
    Ok(())
}

fn measure(args: &Args, row: &Row) -> Result<(), Box<dyn Error + Send + Sync>> {
    let triangles = (row.triangles as f32 * args.scale) as usize;
    let build = |meshes: &[TriangleMesh]| RayTree::build(meshes, &BuildParams::default());
    let first = (row.frame)(triangles, 0);
    let moving: Vec<usize> = ((row.moving)(first.meshes.len())..first.meshes.len()).collect();
    let mut tree = build(&first.meshes)?;
    let [mut builds, mut whole, mut parts, mut rays_of_both, mut work] = [const { Vec::new() }; 5];
    let (first_refit, first_time) = timed(|| tree.refit(&first.meshes));
    first_refit?;
    let mut last = None;
    for i in 1..=args.frames {
        let now = (row.frame)(triangles, i);
        // Alternating, so that each has something to write.
        let (times, (refit, time)) = match i % 2 {
            0 => (&mut whole, timed(|| tree.refit(&now.meshes))),
            _ => (&mut parts, timed(|| tree.refit_moved(&now.meshes, &moving))),
        };
        times.push(time);
        last = Some(refit?);
        if i % args.step == 0 {
            let (other, time) = timed(|| build(&now.meshes));
            builds.push(time);
            let other = other?;
            let rays = rays(&now.camera, args.rays);
            for round in 0..4 {
                let ((), of_tree) = timed(|| run_query(&tree, &rays));
                let ((), of_other) = timed(|| run_query(&other, &rays));
                // The first round warms the caches.
                if round > 0 {
                    rays_of_both.push(of_tree / of_other);
                }
            }
            work.push(blocks(&tree, &rays) / blocks(&other, &rays));
        }
    }
    let statistics = tree.statistics();
    let all = statistics.nodes + statistics.leaves;
    let written = last.map_or(0, |refit| refit.nodes + refit.leaves);
    let [build, whole, parts] = [builds, whole, parts].map(median);
    println!(
        "| {} | {} | {:.1} | {:.1} | {:.3} | {:.3} | {:.1} | {:.1} | {:.2} % | {:.2} | {:.2} | {:.2} |",
        row.name,
        statistics.primitives,
        build * 1e3,
        first_time * 1e3,
        whole * 1e3,
        parts * 1e3,
        build / whole,
        build / parts,
        100.0 * written as f64 / all as f64,
        statistics.cost,
        median(work),
        median(rays_of_both),
    );
    Ok(())
}

fn rays(camera: &scene::Camera, count: usize) -> Vec<Ray> {
    let mut random = Random(1);
    (0..count).map(|_| camera.ray(random.unit(), random.unit(), 1.0, random.unit())).collect()
}

fn run_query(tree: &RayTree, rays: &[Ray]) {
    rays.iter().for_each(|ray| _ = black_box(tree.closest_hit(ray)));
}

/// Nodes and leaf blocks that rays visit.
fn blocks(tree: &RayTree, rays: &[Ray]) -> f64 {
    let mut counters = Counters::default();
    rays.iter().for_each(|ray| _ = tree.closest_hit_observed(ray, &mut counters));
    counters.steps() as f64
}
