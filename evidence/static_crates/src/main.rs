//! mbkd against Rust crates without motion blur, on scenes that stand still: `bvh` and `obvhs`.
//!
//! For readers who come from them. The scenes are frozen at mid-shutter, so nothing moves on either side; rays,
//! their order and the clock are those of the Embree program (`benches/embree`). Each crate is asked the way its
//! documentation shows, with the triangle test it brings, and all sides deliver t, id and barycentrics.
//! Both crates choose instructions at compile time: `RUSTFLAGS="-C target-cpu=native"` shows them at their best,
//! mbkd finds the CPU's by itself.
//!
//! `cargo run --release --package mbkd-static-crates -- --help` lists what can be chosen.

use bvh::aabb::{Aabb, Bounded, IntersectsAabb};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use clap::Parser;
use glam::{Vec3, Vec3A};
use mbkd::{BuildParams, Hit, Ray, RayTree, TriangleMesh, glam};
use mbkd_evidence::scene_rays::{Kind, generate};
use mbkd_evidence::timing::{on_one_thread, timed};
use mbkd_evidence::triangles::corners;
use mbkd_evidence::turns::{Checksum, in_turns};
use mbkd_scenes::Scene;
use nalgebra::{Point3, Vector3};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::rt_triangle::RtTriangle;
use std::cell::Cell;
use std::process::ExitCode;
use std::time::Duration;

#[derive(Parser)]
#[command(name = "static_crates", bin_name = "cargo run --release --package mbkd-static-crates --")]
/// Times mbkd's ray queries against the crates `bvh` and `obvhs` on scenes frozen at mid-shutter.
struct Options {
    /// Scenes of the catalogue.
    #[arg(long, value_delimiter = ',', default_value = "camera,coherent")]
    scenes: Vec<String>,
    /// Share of each scene's full number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Width and height of the picture in pixels.
    #[arg(long, default_value_t = 256)]
    side: u32,
    /// Timed rounds.
    #[arg(long, default_value_t = 5)]
    runs: u32,
}

/// A peer: a tree that answers single rays.
trait Peer {
    fn closest_hit(&self, ray: &Ray) -> Option<Hit>;
    fn any_hit(&self, ray: &Ray) -> bool;
}

impl Peer for RayTree {
    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        RayTree::closest_hit(self, ray)
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        RayTree::any_hit(self, ray)
    }
}

/// A triangle as `bvh` wants it, with its box kept for cutting a traversal short.
struct BvhTriangle {
    corners: [Point3<f32>; 3],
    bounds: Aabb<f32, 3>,
    id: u32,
    node: usize,
}

impl Bounded<f32, 3> for BvhTriangle {
    fn aabb(&self) -> Aabb<f32, 3> {
        self.bounds
    }
}

impl BHShape<f32, 3> for BvhTriangle {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

struct BvhPeer {
    triangles: Vec<BvhTriangle>,
    tree: Bvh<f32, 3>,
}

impl BvhPeer {
    fn build(corners: &[[Vec3; 3]]) -> BvhPeer {
        let triangle = |(id, corners): (usize, &[Vec3; 3])| {
            let corners = corners.map(|p| Point3::new(p.x, p.y, p.z));
            let bounds = corners.iter().fold(Aabb::empty(), |bounds, p| bounds.grow(p));
            BvhTriangle { corners, bounds, id: id as u32, node: 0 }
        };
        let mut triangles: Vec<BvhTriangle> = corners.iter().enumerate().map(triangle).collect();
        let tree = Bvh::build(&mut triangles);
        BvhPeer { triangles, tree }
    }
}

/// A ray that ends where the nearest hit so far is: what `bvh` offers for culling by distance.
struct Shortened {
    ray: bvh::ray::Ray<f32, 3>,
    end: Cell<f32>,
}

impl Shortened {
    fn new(ray: &Ray) -> Shortened {
        let (o, d) = (ray.origin.as_vec3(), ray.dir);
        let ray_of_bvh = bvh::ray::Ray::new(Point3::new(o.x, o.y, o.z), Vector3::new(d.x, d.y, d.z));
        Shortened { ray: ray_of_bvh, end: Cell::new(ray.t_max) }
    }
}

impl IntersectsAabb<f32, 3> for Shortened {
    fn intersects_aabb(&self, aabb: &Aabb<f32, 3>) -> bool {
        self.ray.intersection_slice_for_aabb(aabb).is_some_and(|(near, _)| near <= self.end.get())
    }
}

impl Peer for BvhPeer {
    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let query = Shortened::new(ray);
        let mut best = None;
        for triangle in self.tree.traverse_iterator(&query, &self.triangles) {
            let [a, b, c] = &triangle.corners;
            let at = query.ray.intersects_triangle(a, b, c);
            if at.distance <= query.end.get() && at.distance < f32::INFINITY {
                query.end.set(at.distance);
                best = Some(Hit { t: at.distance, u: at.u, v: at.v, mesh: 0, primitive: triangle.id });
            }
        }
        best
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        let query = Shortened::new(ray);
        self.tree.traverse_iterator(&query, &self.triangles).any(|triangle| {
            let [a, b, c] = &triangle.corners;
            let distance = query.ray.intersects_triangle(a, b, c).distance;
            distance <= query.end.get() && distance < f32::INFINITY
        })
    }
}

/// `obvhs` with its eight-wide compressed tree and triangles in the tree's order, as its examples do for speed.
struct ObvhsPeer {
    triangles: Vec<RtTriangle>,
    tree: CwBvh,
}

impl ObvhsPeer {
    fn build(corners: &[[Vec3; 3]]) -> ObvhsPeer {
        let triangles: Vec<obvhs::triangle::Triangle> = corners
            .iter()
            .map(|&[a, b, c]| obvhs::triangle::Triangle { v0: a.into(), v1: b.into(), v2: c.into() })
            .collect();
        let tree = build_cwbvh_from_tris(&triangles, BvhBuildParams::slow_build(), &mut Duration::default());
        let triangles = tree.primitive_indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect();
        ObvhsPeer { triangles, tree }
    }

    fn ray(ray: &Ray) -> obvhs::ray::Ray {
        obvhs::ray::Ray::new(Vec3A::from(ray.origin.as_vec3()), ray.dir.into(), ray.t_min, ray.t_max)
    }
}

impl Peer for ObvhsPeer {
    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let ray = ObvhsPeer::ray(ray);
        let mut hit = obvhs::ray::RayHit::none();
        let found = self.tree.ray_traverse(ray, &mut hit, |ray, at| self.triangles[at].intersect(ray));
        found.then(|| {
            let at = hit.primitive_id as usize;
            let uv = self.triangles[at].compute_barycentric(&ray);
            Hit { t: hit.t, u: uv.x, v: uv.y, mesh: 0, primitive: self.tree.primitive_indices[at] }
        })
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        !self.tree.ray_traverse_miss(ObvhsPeer::ray(ray), |ray, at| self.triangles[at].intersect(ray))
    }
}

/// The scene at mid-shutter as one still mesh.
fn freeze(scene: &Scene) -> (TriangleMesh, Vec<[Vec3; 3]>) {
    let all = scene.meshes.iter().enumerate().flat_map(|(m, mesh)| (0..mesh.len()).map(move |k| (m as u32, k as u32)));
    let corners: Vec<[Vec3; 3]> = all.map(|(m, k)| corners(&scene.meshes, m, k, 0.5).map(|p| p.as_vec3())).collect();
    let indices = (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    (TriangleMesh::fixed(indices, corners.concat()), corners)
}

fn answer_all<P: Peer>(peer: &P, kind: Kind, rays: &[Ray]) -> Checksum {
    match kind {
        Kind::Ao => Checksum::of(rays, |sum, ray| sum.any(peer.any_hit(ray))),
        _ => Checksum::of(rays, |sum, ray| sum.closest(peer.closest_hit(ray))),
    }
}

fn main() -> ExitCode {
    let options = Options::parse();
    println!("One thread; Mrays/s, medians of {} rounds in turns.\n", options.runs);
    println!("| scene | rays | number | mbkd | obvhs | bvh | mbkd / obvhs | mbkd / bvh |");
    println!("|---|---|---:|---:|---:|---:|---:|---:|");
    let mut builds = Vec::new();
    for name in &options.scenes {
        let Some(recipe) = mbkd_scenes::find(name) else {
            eprintln!("error: no scene is called {name:?}");
            return ExitCode::FAILURE;
        };
        let scene = (recipe.make)((recipe.full as f32 * options.scale) as usize);
        let (mesh, corners) = freeze(&scene);
        let meshes = [mesh];
        let (ours, a) =
            timed(|| on_one_thread(|| RayTree::build(&meshes, &BuildParams::default()).expect("a fine mesh")));
        let (obvhs, b) = timed(|| ObvhsPeer::build(&corners));
        let (bvh, c) = timed(|| BvhPeer::build(&corners));
        builds.push(format!("| {name} | {} | {a:.2} | {b:.2} | {c:.2} |", corners.len()));
        let rays = generate(&meshes, &scene.camera, options.side, |ray| ours.closest_hit(ray));
        for kind in [Kind::Primary, Kind::Bounce, Kind::Ao] {
            row(name, kind, rays.of(kind), options.runs, &ours, &obvhs, &bvh);
        }
    }
    println!("\n| scene | triangles | mbkd, build s | obvhs (slow_build) s | bvh s |\n|---|---:|---:|---:|---:|");
    builds.iter().for_each(|line| println!("{line}"));
    ExitCode::SUCCESS
}

fn row(scene: &str, kind: Kind, rays: &[Ray], runs: u32, ours: &RayTree, obvhs: &ObvhsPeer, bvh: &BvhPeer) {
    let sums = [answer_all(ours, kind, rays), answer_all(obvhs, kind, rays), answer_all(bvh, kind, rays)];
    let (we, they, others) =
        (|| answer_all(ours, kind, rays), || answer_all(obvhs, kind, rays), || answer_all(bvh, kind, rays));
    let first = in_turns(runs, Some(&we), Some(&they));
    let second = in_turns(runs, Some(&we), Some(&others));
    let speed = |seconds: f64| rays.len() as f64 / seconds * 1e-6;
    println!(
        "| {scene} | {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
        kind.name(),
        rays.len(),
        speed(first.ours),
        speed(first.theirs),
        speed(second.theirs),
        first.ratio,
        second.ratio
    );
    let hits = sums.map(|sum| sum.hits);
    if hits.iter().any(|&h| h != hits[0]) {
        eprintln!("  {scene}, {}: hits {hits:?} of mbkd, obvhs, bvh (neither peer is watertight)", kind.name());
    }
}
