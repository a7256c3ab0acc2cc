//! The cost of many keys: bytes, build time and rays for the same motion given with more keys.
//!
//! The trees of a row answer the same rays in alternation, on one thread; medians. Figures are relative to the tree of
//! two keys. For bent motion, two keys are another motion: compare with care. "whole" is the same tree without time
//! slices.
//!
//! `cargo bench --bench keys > keys.md`; `--help` lists the options. For figures to publish give it an idle core.

use clap::Parser;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildError, BuildParams, Counters, Division, Keys, MovingSphere, Ray, RayTree, TriangleMesh, WideParams};
use mbkd_evidence::options;
use mbkd_evidence::timing::{median, on_one_thread, timed};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::hint::black_box;

#[derive(Parser)]
#[command(about = "Measures trees of the same motion at different numbers of keys")]
struct Args {
    /// Share of each scene's usual number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Rays in each round.
    #[arg(long, default_value_t = 40_000)]
    rays: usize,
    /// Rounds.
    #[arg(long, default_value_t = 7)]
    runs: usize,
    /// Only scenes whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

/// What a tree is built of, and where rays come from.
struct Content {
    meshes: Vec<TriangleMesh>,
    spheres: Vec<MovingSphere>,
    camera: scene::Camera,
}

impl From<scene::Scene> for Content {
    fn from(of: scene::Scene) -> Content {
        Content { meshes: of.meshes, spheres: Vec::new(), camera: of.camera }
    }
}

/// A scene at several numbers of keys, the first of them 2.
struct Row {
    name: &'static str,
    keys: &'static [usize],
    make: fn(f32, usize) -> Content,
}

const ROWS: [Row; 8] = [
    Row {
        name: "hall, straight motion, 300 000",
        keys: &[2, 9, 65],
        make: |scale, keys| with_each(scene::hall((300_000.0 * scale) as usize), |mesh| sampled(mesh, keys)),
    },
    Row {
        name: "debris, straight motion, 200 000",
        keys: &[2, 9, 65],
        make: |scale, keys| with_each(debris((200_000.0 * scale) as usize), |mesh| sampled(mesh, keys)),
    },
    Row {
        name: "debris in f64, straight motion, 200 000",
        keys: &[2, 9, 65],
        make: |scale, keys| with_each(debris((200_000.0 * scale) as usize), |mesh| sampled_in_f64(mesh, keys)),
    },
    Row {
        name: "debris, straight but for the middle key, 50 000",
        keys: &[2, 3, 9],
        make: |scale, keys| with_each(debris((50_000.0 * scale) as usize), |mesh| late_in_the_middle(mesh, keys)),
    },
    Row {
        name: "spheres, straight motion, 50 000",
        keys: &[2, 9, 65],
        make: |scale, keys| spheres((50_000.0 * scale) as usize, keys, |t| t),
    },
    Row {
        name: "spheres, to and fro, 50 000",
        keys: &[2, 9, 65],
        make: |scale, keys| spheres((50_000.0 * scale) as usize, keys, |t| (6.0 * t).sin()),
    },
    Row {
        name: "turning rock, 60 000",
        keys: &[2, 5, 17, 65],
        make: |scale, keys| scene::turning((60_000.0 * scale) as usize, keys).into(),
    },
    Row {
        name: "hall, walking figure, 300 000",
        keys: &[2, 17],
        make: |scale, keys| scene::walking((300_000.0 * scale) as usize, keys).into(),
    },
];

fn debris(triangles: usize) -> scene::Scene {
    (scene::find("debris").expect("a scene of the catalogue").make)(triangles)
}

fn with_each(mut of: scene::Scene, change: impl Fn(&TriangleMesh) -> TriangleMesh) -> Content {
    of.meshes.iter_mut().for_each(|mesh| *mesh = change(mesh));
    of.into()
}

/// Spheres in a cube, each of which goes its own way as a function of time says.
fn spheres(count: usize, keys: usize, way: fn(f64) -> f64) -> Content {
    let mut random = Random(5);
    let mut number = || f64::from(2.0 * random.unit() - 1.0);
    let mut sphere = |_| {
        let [at, along] = [1.0, 0.1].map(|size| size * DVec3::new(number(), number(), number()));
        let radius = 0.02 + 0.01 * number();
        MovingSphere::new((0..keys).map(|key| (at + along * way(key as f64 / (keys - 1) as f64), radius)).collect())
    };
    let camera = scene::Camera::fixed(scene::View::new(Vec3::new(3.0, 2.0, 4.0), Vec3::ZERO, 0.6));
    Content { meshes: Vec::new(), spheres: (0..count).map(&mut sphere).collect(), camera }
}

/// The linear motion of a mesh at more keys; static meshes are unchanged.
fn sampled(mesh: &TriangleMesh, keys: usize) -> TriangleMesh {
    let Keys::F32(at) = &mesh.keys else { return mesh.clone() };
    let [a, b] = &at[..] else { return mesh.clone() };
    let at = |key: usize| a.iter().zip(b).map(|(a, b)| a.lerp(*b, key as f32 / (keys - 1) as f32)).collect();
    TriangleMesh { keys: (0..keys).map(at).collect::<Vec<Vec<Vec3>>>().into(), ..mesh.clone() }
}

/// The same, but at the middle key half as far on the way.
fn late_in_the_middle(mesh: &TriangleMesh, keys: usize) -> TriangleMesh {
    let mut mesh = sampled(mesh, keys);
    if let Keys::F32(at) = &mut mesh.keys
        && at.len() > 2
    {
        let first = at[0].clone();
        at[keys / 2].iter_mut().zip(&first).for_each(|(p, first)| *p = p.lerp(*first, 0.5));
    }
    mesh
}

/// The linear motion at more keys in f64, which is kept.
fn sampled_in_f64(mesh: &TriangleMesh, keys: usize) -> TriangleMesh {
    let Keys::F32(at) = &mesh.keys else { return mesh.clone() };
    let [a, b] = [at.first(), at.last()].map(|key| key.expect("a key"));
    let at = |key: usize| {
        let w = key as f64 / (keys - 1) as f64;
        a.iter().zip(b).map(|(a, b)| a.as_dvec3() + (b.as_dvec3() - a.as_dvec3()) * w).collect()
    };
    TriangleMesh { keys: (0..keys).map(at).collect::<Vec<Vec<DVec3>>>().into(), ..mesh.clone() }.precise()
}

struct Tree {
    keys: usize,
    whole: bool,
    content: Content,
    tree: RayTree,
    build: Vec<f64>,
    rays: Vec<f64>,
}

impl Tree {
    fn build(of: &Content, whole: bool) -> Result<(RayTree, f64), BuildError> {
        let shapes = of.spheres.clone();
        let division = if whole { Division::Whole } else { Division::Automatic };
        let params = BuildParams::wide(WideParams { division, ..WideParams::default() });
        let (tree, seconds) = timed(|| RayTree::of_scene(&of.meshes, shapes, &params));
        Ok((tree?, seconds))
    }
}

fn main() -> Result<(), BuildError> {
    let args: Args = options();
    println!(
        "| scene | keys | kept | static | time nodes | bytes per primitive | of the vertices | build, ms | ns per ray | blocks per ray \
         | build / 2 keys | rays / 2 keys |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for row in ROWS.iter().filter(|row| row.name.contains(&args.only)) {
        on_one_thread(|| measure(&args, row))?;
    }
    Ok(())
}

fn measure(args: &Args, row: &Row) -> Result<(), BuildError> {
    let camera = (row.make)(args.scale, 2).camera;
    let mut trees = Vec::new();
    for &keys in row.keys {
        for whole in [false, true] {
            let content = (row.make)(args.scale, keys);
            let tree = Tree::build(&content, whole)?.0;
            trees.push(Tree { keys, whole, content, tree, build: vec![], rays: vec![] });
        }
    }
    let mut random = Random(1);
    let rays: Vec<Ray> = (0..args.rays).map(|_| camera.ray(random.unit(), random.unit(), 1.0, random.unit())).collect();
    for _ in 0..args.runs {
        for of in &mut trees {
            of.build.push(Tree::build(&of.content, of.whole)?.1);
        }
        for of in &mut trees {
            for round in 0..2 {
                let ((), seconds) = timed(|| rays.iter().for_each(|ray| _ = black_box(of.tree.closest_hit(ray))));
                // The first one warms the caches.
                if round == 1 {
                    of.rays.push(seconds / rays.len() as f64);
                }
            }
        }
    }
    let ratio = |a: &[f64], b: &[f64]| median(a.iter().zip(b).map(|(a, b)| a / b));
    for of in &trees {
        let mut counters = Counters::default();
        rays.iter().for_each(|ray| _ = of.tree.closest_hit_observed(ray, &mut counters));
        let s = of.tree.statistics();
        // Spheres have none.
        let vertices = (s.kept_positions.max(1) * size_of::<Vec3>()) as f64;
        println!(
            "| {}{} | {} | {:.0} % | {:.0} % | {} | {:.0} | {:.2} | {:.1} | {:.0} | {:.2} | {:.2} | {:.2} |",
            row.name,
            if of.whole { ", whole" } else { "" },
            of.keys,
            100.0 * s.kept_positions as f64 / s.positions.max(1) as f64,
            100.0 * s.static_references as f64 / s.references as f64,
            s.time_nodes,
            s.bytes as f64 / s.primitives as f64,
            if s.kept_positions > 0 { s.bytes as f64 / vertices } else { 0.0 },
            median(of.build.iter().copied()) * 1e3,
            median(of.rays.iter().copied()) * 1e9,
            (counters.nodes + counters.leaves) as f64 / rays.len() as f64,
            ratio(&of.build, &trees[0].build),
            ratio(&of.rays, &trees[0].rays),
        );
    }
    Ok(())
}
