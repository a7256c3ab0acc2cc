//! Builds and ray queries of every policy, for regressions. `cargo bench --bench rays`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use mbkd::{BuildParams, Counters, KdParams, Ray, RayTree};
use mbkd_scenes::{self as scene, Scene};
use std::hint::black_box;

/// Triangles per scene: few enough for a short benchmark, and enough for a tree to matter.
const TRIANGLES: usize = 50_000;
const SCENES: [&str; 3] = ["hall", "tornado", "hairball"];

fn policies() -> [(&'static str, BuildParams); 4] {
    [
        ("wide", BuildParams::default()),
        ("kd", BuildParams::kd(KdParams::default())),
        ("paper", BuildParams::paper()),
        ("classic", BuildParams::kd(KdParams::classic())),
    ]
}

fn scene_named(name: &str) -> Scene {
    let recipe = scene::find(name).unwrap_or(&scene::CATALOGUE[0]);
    (recipe.make)(TRIANGLES)
}

/// Camera rays in tiles of 8 by 8, each at its own time.
fn rays(scene: &Scene) -> Vec<Ray> {
    let side = 128;
    (0..side * side)
        .map(|i| {
            let (tile, inner) = (i / 64, i % 64);
            let x = (tile % (side / 8)) * 8 + inner % 8;
            let y = (tile / (side / 8)) * 8 + inner / 8;
            let at = |k: usize| (k as f32 + 0.5) / side as f32;
            scene.camera.ray(at(x), at(y), 1.0, (i as f32 * 0.618_034).fract())
        })
        .collect()
}

fn build(c: &mut Criterion) {
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    group.throughput(Throughput::Elements(TRIANGLES as u64));
    for name in SCENES {
        let scene = scene_named(name);
        for (policy, params) in policies() {
            group.bench_function(BenchmarkId::new(policy, name), |b| {
                b.iter(|| RayTree::build(black_box(&scene.meshes), &params));
            });
        }
    }
    group.finish();
}

fn queries(c: &mut Criterion) {
    for name in SCENES {
        let scene = scene_named(name);
        let rays = rays(&scene);
        let mut group = c.benchmark_group(name);
        group.sample_size(20);
        group.throughput(Throughput::Elements(rays.len() as u64));
        for (policy, params) in policies() {
            let Ok(tree) = RayTree::build(&scene.meshes, &params) else { continue };
            group.bench_function(BenchmarkId::new("closest", policy), |b| {
                b.iter(|| rays.iter().filter_map(|ray| tree.closest_hit(black_box(ray))).count());
            });
            // The observer `()` costs nothing; counters cost their counting.
            group.bench_function(BenchmarkId::new("closest observed by ()", policy), |b| {
                b.iter(|| rays.iter().filter_map(|ray| tree.closest_hit_observed(black_box(ray), &mut ())).count());
            });
            group.bench_function(BenchmarkId::new("closest observed by counters", policy), |b| {
                let mut counters = Counters::default();
                b.iter(|| rays.iter().filter_map(|ray| tree.closest_hit_observed(ray, &mut counters)).count());
                black_box(counters);
            });
            group.bench_function(BenchmarkId::new("any", policy), |b| {
                b.iter(|| rays.iter().filter(|ray| tree.any_hit(black_box(ray))).count());
            });
            let mut hits = Vec::new();
            group.bench_function(BenchmarkId::new("batch", policy), |b| {
                b.iter(|| tree.closest_hits(black_box(&rays), &mut hits));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, build, queries);
criterion_main!(benches);
