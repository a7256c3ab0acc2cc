//! What meshes kept in f64 cost.
//!
//! First scenes moved to coordinates of the earth, 300 m large: the same triangles rounded to f32 relative to the middle and kept
//! in f64, closest hits in turn, one thread, medians. Then counted work: two machines of 1 mm parts farther and farther apart, in
//! one tree and in one tree for each, placed in a tree of instances.
//!
//! `cargo run --release --example precise_meshes`

use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{BuildParams, Counters, Instance, InstanceTree, Keys, Ray, RayTree, TriangleMesh, WideParams};
use mbkd_evidence::timing::{race, seconds};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::hint::black_box;
use std::sync::Arc;

type Failed = Box<dyn std::error::Error>;

/// Rounds, of which the median counts.
const ROUNDS: usize = 9;

/// Rays of a round.
const RAYS: usize = 20_000;

/// Where the scenes are.
const CITY: DVec3 = DVec3::new(4.5e5, 5.4e6, 210.0);

/// How large they become.
const SIZE: f64 = 300.0;

/// A mesh elsewhere, in f64.
fn moved(mesh: &TriangleMesh, scale: f64) -> TriangleMesh {
    let Keys::F32(keys) = &mesh.keys else { return mesh.clone() };
    let keys: Vec<Vec<DVec3>> =
        keys.iter().map(|key| key.iter().map(|p| CITY + p.as_dvec3() * scale).collect()).collect();
    TriangleMesh { keys: keys.into(), ..mesh.clone() }
}

fn counted(rays: &[Ray], tree: &RayTree) -> (f64, f64) {
    let mut counters = Counters::default();
    for ray in rays {
        tree.closest_hit_observed(ray, &mut counters);
    }
    let per_ray = |count: u64| count as f64 / rays.len() as f64;
    (per_ray(counters.nodes), per_ray(counters.primitive_tests))
}

fn speed(name: &str, triangles: usize) -> Result<(), Failed> {
    let scene = (scene::find(name).ok_or("no such scene")?.make)(triangles);
    let size = scene.meshes.iter().flat_map(|mesh| match &mesh.keys {
        Keys::F32(keys) => keys.iter().flatten().map(|p| p.abs().max_element()).collect(),
        _ => Vec::new(),
    });
    let scale = SIZE / f64::from(size.fold(0.0, f32::max));
    let meshes: Vec<TriangleMesh> = scene.meshes.iter().map(|mesh| moved(mesh, scale)).collect();
    let kept: Vec<TriangleMesh> = meshes.iter().map(|mesh| mesh.clone().precise()).collect();
    let params = BuildParams::default();
    let trees = [RayTree::build(&meshes, &params)?, RayTree::build(&kept, &params)?];
    let mut random = Random(3);
    let mut unit = || random.unit_f64() as f32;
    let camera = |ray: Ray| Ray { origin: CITY + ray.origin * scale, ..ray };
    let rays: Vec<Ray> = (0..RAYS).map(|_| camera(scene.camera.ray(unit(), unit(), 1.0, unit()))).collect();
    let query = |tree: &RayTree| rays.iter().for_each(|ray| _ = black_box(tree.closest_hit(ray)));
    let times = race(seconds, ROUNDS, &mut [&trees[0], &trees[1]].map(|tree| move || query(tree)));
    let [rounded, precise] = [0, 1].map(|i| times[i].median * 1e9 / RAYS as f64);
    let [(nodes, tests), (precise_nodes, precise_tests)] = [0, 1].map(|i| counted(&rays, &trees[i]));
    let [bytes, precise_bytes] = [0, 1].map(|i| {
        let statistics = trees[i].statistics();
        (statistics.bytes + statistics.primitive_bytes) / statistics.primitives
    });
    println!(
        "| {name} | {rounded:.0} | {precise:.0} | {:.2} | {nodes:.1}, {tests:.1} | {precise_nodes:.1}, {precise_tests:.1} \
         | {bytes} | {precise_bytes} |",
        precise / rounded
    );
    Ok(())
}

/// Parts of 1 mm within 10 cm of a place.
fn machine(place: DVec3) -> TriangleMesh {
    let mut random = Random(4);
    let mut positions = Vec::new();
    for _ in 0..10_000 {
        let at = place + random.dvec() * 0.1;
        positions.extend([random.dvec(), random.dvec(), random.dvec()].map(|corner| at + corner * 1e-3));
    }
    TriangleMesh::new((0..10_000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), vec![positions]).precise()
}

fn apart(distance: f64) -> Result<(), Failed> {
    let places = [DVec3::ZERO, DVec3::new(distance, 0.7 * distance, 0.3 * distance)];
    let meshes = places.map(machine);
    let one = RayTree::build(&meshes, &BuildParams::default())?;
    let place = |mesh: &TriangleMesh| -> Result<Instance, Failed> {
        let tree = RayTree::build(core::slice::from_ref(mesh), &BuildParams::default())?;
        Ok(Instance::new(Arc::new(tree), DAffine3::IDENTITY))
    };
    let placed = meshes.iter().map(place).collect::<Result<Vec<_>, _>>()?;
    let apart = InstanceTree::build(placed, &WideParams::default())?;
    let mut random = Random(5);
    for (name, place) in ["near zero", "far away"].into_iter().zip(places) {
        let (mut in_one, mut in_each) = (Counters::default(), Counters::default());
        let rays = 1000;
        for _ in 0..rays {
            let (origin, target) = (place + random.dvec(), place + random.dvec() * 0.1);
            let ray = Ray::new(origin, (target - origin).as_vec3().normalize_or(Vec3::X));
            one.closest_hit_observed(&ray, &mut in_one);
            apart.closest_hit_observed(&ray, &mut in_each);
        }
        let per_ray = |count: u64| count as f64 / f64::from(rays);
        println!(
            "| {distance:e} m, {name} | {:.1}, {:.1} | {:.1}, {:.1} |",
            per_ray(in_one.nodes),
            per_ray(in_one.primitive_tests),
            per_ray(in_each.nodes),
            per_ray(in_each.primitive_tests)
        );
    }
    Ok(())
}

fn main() -> Result<(), Failed> {
    println!(
        "| | rounded, ns | kept, ns | ratio | nodes, tests: rounded | kept | bytes per triangle: rounded | kept |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for name in ["hall", "coherent", "hairball", "tornado"] {
        speed(name, 60_000)?;
    }
    println!("\n| machines apart | nodes, tests: one tree | one tree for each |");
    println!("|---|---|---|");
    for distance in [1e2, 1e3, 1e4, 1e5, 1e6, 1e7] {
        apart(distance)?;
    }
    Ok(())
}
