//! What each form of a query costs beside the others, in one process and in turns: collecting, visiting and counting
//! within a radius, and batches beside loops over single queries.
//!
//! `cargo bench --bench query_forms`, with `RAYON_NUM_THREADS=1` for batches. Times are processor times; figures are medians
//! over rounds of the ratio to the first form of a row.

#[path = "embree/clock.rs"]
mod clock;

use mbkd::glam::Vec3;
use mbkd::{BuildParams, MovingPoint, NeighborBuffer, PointParams, PointTree, Ray, RayTree};
use std::hint::black_box;
use std::ops::ControlFlow;

/// Rounds, each of which runs all forms.
const ROUNDS: usize = 15;

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
}

/// Prints the time of the first form and how many times as fast the others are.
fn row(name: &str, queries: usize, forms: &mut [(&str, &mut dyn FnMut() -> usize)]) {
    let mut times = vec![Vec::new(); forms.len()];
    for round in 0..=ROUNDS {
        for (times, (_, run)) in times.iter_mut().zip(forms.iter_mut()) {
            let start = clock::seconds();
            black_box(run());
            if round > 0 {
                times.push(clock::seconds() - start);
            }
        }
    }
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let first = median(times[0].clone());
    print!("{name}: {} {:.0} ns", forms[0].0, first * 1e9 / queries as f64);
    for ((form, _), of) in forms.iter().zip(&times).skip(1) {
        let ratio = median(times[0].iter().zip(of).map(|(a, b)| a / b).collect());
        print!(", {form} {ratio:.2} times as fast");
    }
    println!();
}

fn within(n: usize) -> Result<(), Box<dyn std::error::Error>> {
    let mut random = Random(1);
    let spacing = (n as f32).cbrt().recip();
    let still: Vec<Vec3> = (0..n).map(|_| random.vec()).collect();
    let moving: Vec<MovingPoint> =
        still.iter().map(|&p| MovingPoint::new(p, p + (random.vec() - 0.5) * spacing)).collect();
    let mut queries: Vec<(Vec3, f32)> = (0..20_000).map(|_| (random.vec(), random.unit())).collect();
    queries.sort_by_key(|(p, _)| ((p.x * 16.0) as u32, (p.y * 16.0) as u32, (p.z * 64.0) as u32));
    let params = PointParams::default();
    for (what, tree) in [("still", PointTree::build(&still, &params)?), ("moving", PointTree::build(&moving, &params)?)]
    {
        for reach in [1.0, 2.1, 5.0] {
            let radius = reach * spacing;
            let mut buffer = NeighborBuffer::new();
            let at = |&(point, time): &(Vec3, f32)| tree.query(point, time).radius(radius);
            let found: usize = queries.iter().map(|q| at(q).count()).sum();
            let mut collect = || {
                let sum = |q| at(q).collect_into(&mut buffer).iter().map(|n| n.id as usize).sum::<usize>();
                queries.iter().map(sum).fold(0, usize::wrapping_add)
            };
            let mut visit = || {
                let mut sum = 0;
                for q in &queries {
                    let _ = at(q).for_each(|n| {
                        sum += n.id as usize;
                        ControlFlow::Continue(())
                    });
                }
                sum
            };
            let mut count = || queries.iter().map(|q| at(q).count()).sum();
            let mut half = || queries.iter().map(|q| at(q).filter(|id| id % 2 == 0).count()).sum();
            row(
                &format!("{n} {what} points, {:.1} within", found as f64 / queries.len() as f64),
                queries.len(),
                &mut [
                    ("collect", &mut collect),
                    ("for_each", &mut visit),
                    ("count", &mut count),
                    ("count with a filter", &mut half),
                ],
            );
        }
    }
    Ok(())
}

/// Batches of queries for points, as they come and scattered.
fn point_batches(n: usize) -> Result<(), Box<dyn std::error::Error>> {
    let mut random = Random(2);
    let points: Vec<Vec3> = (0..n).map(|_| random.vec()).collect();
    let tree = PointTree::build(&points, &PointParams::default())?;
    let scattered: Vec<(Vec3, f32)> = (0..100_000.min(n)).map(|_| (random.vec(), 0.0)).collect();
    let few: Vec<(Vec3, f32)> = scattered[..1000].to_vec();
    let mut rows = scattered.clone();
    rows.sort_by_key(|(p, _)| ((p.x * 32.0) as u32, (p.y * 32.0) as u32, (p.z * 256.0) as u32));
    for (order, queries) in [("in order", &rows), ("scattered", &scattered), ("few, scattered", &few)] {
        for k in [1, 8, 32] {
            let mut buffer = NeighborBuffer::new();
            let mut singly = || {
                let mut all = Vec::new();
                let mut ends = Vec::with_capacity(queries.len());
                for &(point, time) in queries {
                    all.extend_from_slice(tree.query(point, time).nearest_n_into(k, &mut buffer));
                    ends.push(all.len());
                }
                all.len() + ends.len()
            };
            let mut batch = || tree.nearest_n_batch(queries, k).len();
            row(
                &format!("{n} points, k = {k}, {order}"),
                queries.len(),
                &mut [("singly", &mut singly), ("batch", &mut batch)],
            );
        }
    }
    Ok(())
}

/// Batches of rays: of a camera, in tiles as they bounce, and scattered.
fn ray_batches(name: &str, scale: f32) -> Result<(), Box<dyn std::error::Error>> {
    let recipe = mbkd_scenes::find(name).ok_or("no such scene")?;
    let scene = (recipe.make)((recipe.full as f32 * scale) as usize);
    let tree = RayTree::build(&scene.meshes, &BuildParams::default())?;
    let mut random = Random(3);
    let side = 256;
    let camera: Vec<Ray> = (0..side * side)
        .map(|i| {
            let at = |i: usize| (i as f32 + 0.5) / side as f32;
            scene.camera.ray(at(i % side), at(i / side), 1.0, random.unit())
        })
        .collect();
    let bounce: Vec<Ray> = camera
        .iter()
        .filter_map(|ray| {
            let hit = tree.closest_hit(ray)?;
            let dir = (random.vec() - 0.5).normalize_or(Vec3::Z);
            Some(Ray { origin: ray.point(hit.t), dir, t_min: hit.t * 1e-4, ..*ray })
        })
        .collect();
    let mut scattered = bounce.clone();
    for i in (1..scattered.len()).rev() {
        scattered.swap(i, (random.unit() * i as f32) as usize);
    }
    let few = scattered[..scattered.len().min(1000)].to_vec();
    let bytes = tree.statistics().bytes >> 20;
    for (order, rays) in [("camera", &camera), ("bounce", &bounce), ("scattered", &scattered), ("few, scattered", &few)]
    {
        let (mut hits, mut any) = (Vec::new(), Vec::new());
        let mut closest_singly = || rays.iter().filter(|ray| tree.closest_hit(ray).is_some()).count();
        let mut closest = || {
            tree.closest_hits(rays, &mut hits);
            hits.len()
        };
        let mut any_singly = || rays.iter().filter(|ray| tree.any_hit(ray)).count();
        let mut anys = || {
            tree.any_hits(rays, &mut any);
            any.len()
        };
        let name = format!("{name} ({bytes} MiB), {order}");
        row(&format!("{name}, closest"), rays.len(), &mut [("singly", &mut closest_singly), ("batch", &mut closest)]);
        row(&format!("{name}, any"), rays.len(), &mut [("singly", &mut any_singly), ("batch", &mut anys)]);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wanted = |part: &str| {
        let mut names = std::env::args().skip(1).filter(|name| !name.starts_with('-')).peekable();
        names.peek().is_none() || names.any(|name| name == part)
    };
    if wanted("within") {
        within(100_000)?;
        within(1_000_000)?;
    }
    if wanted("points") {
        for n in [50_000, 200_000, 1_000_000, 4_000_000] {
            point_batches(n)?;
        }
    }
    if wanted("rays") {
        for (name, scale) in [("hall", 1.0), ("coherent", 1.0), ("tornado", 1.0), ("hairball", 1.0)] {
            ray_batches(name, scale)?;
        }
    }
    Ok(())
}
