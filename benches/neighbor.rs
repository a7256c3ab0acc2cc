//! Regression benchmarks of the neighbour queries: builds, and queries over static and moving points.

use criterion::{Criterion, criterion_group, criterion_main};
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborBuffer, PointParams, PointStructure, PointTree};
use mbkd_scenes::Random;
use std::hint::black_box;
use std::ops::ControlFlow;

const POINTS: usize = 100_000;
const QUERIES: usize = 1000;

fn neighbors(criterion: &mut Criterion) {
    let mut rng = Random(1);
    let still: Vec<Vec3> = (0..POINTS).map(|_| rng.in_cube()).collect();
    let spacing = 1.0 / (POINTS as f32).cbrt();
    let moving: Vec<MovingPoint> =
        still.iter().map(|p| MovingPoint::new(*p, *p + (rng.in_cube() - 0.5) * spacing)).collect();
    let queries: Vec<(Vec3, f32)> = (0..QUERIES).map(|_| (rng.in_cube(), rng.unit())).collect();
    let params = PointParams::default();
    let linear = PointParams { structure: PointStructure::Linear, ..PointParams::default() };

    let mut group = criterion.benchmark_group("neighbor");
    group.sample_size(20);
    group.bench_function("build/still", |b| b.iter(|| PointTree::build(black_box(&still), &params)));
    group.bench_function("build/moving", |b| b.iter(|| PointTree::build(black_box(&moving), &linear)));
    for (name, tree) in [("still", PointTree::build(&still, &params)), ("moving", PointTree::build(&moving, &linear))] {
        let tree = tree.expect("points are finite");
        let mut buffer = NeighborBuffer::new();
        for k in [1, 8, 64] {
            group.bench_function(format!("{name}/k={k}"), |b| {
                b.iter(|| {
                    for (q, t) in &queries {
                        black_box(tree.query(*q, *t).nearest_n_into(k, &mut buffer));
                    }
                });
            });
        }
        group.bench_function(format!("{name}/nearest"), |b| {
            b.iter(|| queries.iter().filter_map(|(q, t)| tree.nearest(*q, *t)).map(|n| n.id).max());
        });
        let within = |(q, t): &(Vec3, f32)| tree.query(*q, *t).radius(2.1 * spacing);
        // The sum of squared distances, by each form of a radius query.
        group.bench_function(format!("{name}/radius/collect"), |b| {
            b.iter(|| {
                let mut sum = 0.0;
                for query in &queries {
                    sum += within(query).collect_into(&mut buffer).iter().map(|n| n.distance_squared).sum::<f32>();
                }
                sum
            });
        });
        group.bench_function(format!("{name}/radius/for_each"), |b| {
            b.iter(|| {
                let mut sum = 0.0;
                for query in &queries {
                    let _ = within(query).for_each(|n| {
                        sum += n.distance_squared;
                        ControlFlow::Continue(())
                    });
                }
                sum
            });
        });
        group.bench_function(format!("{name}/radius/iter"), |b| {
            b.iter(|| queries.iter().flat_map(|query| within(query).iter()).map(|n| n.distance_squared).sum::<f32>());
        });
        group.bench_function(format!("{name}/radius/count"), |b| {
            b.iter(|| queries.iter().map(|query| within(query).count()).sum::<usize>());
        });
    }
    group.finish();
}

criterion_group!(benches, neighbors);
criterion_main!(benches);
