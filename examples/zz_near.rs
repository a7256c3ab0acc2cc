//! scratch
use mbkd::glam::Vec3;
use mbkd::{NeighborBuffer, PointParams, PointTree};
use std::hint::black_box;
use std::time::Instant;
struct Rng(u64);
impl Rng {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
    fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
    fn signed(&mut self) -> Vec3 {
        self.vec() * 2.0 - 1.0
    }
    fn surface(&mut self) -> Vec3 {
        let which = (self.unit() * 40.0) as u64;
        let mut of = Rng(which.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0xabcdef);
        of.unit();
        let (centre, radius) = (of.vec(), 0.01 + 0.2 * of.unit().powi(3));
        loop {
            let p = self.signed();
            if (0.01..1.0).contains(&p.length_squared()) {
                return centre + p.normalize() * radius;
            }
        }
    }
}
fn morton(p: Vec3) -> u64 {
    let spread = |x: f32| {
        let mut v = ((x + 1.0) * 300.0).clamp(0.0, 1023.0) as u64;
        v = (v | v << 16) & 0x0300_00ff;
        v = (v | v << 8) & 0x0300_f00f;
        v = (v | v << 4) & 0x030c_30c3;
        (v | v << 2) & 0x0924_9249
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}
fn main() {
    // args: n set order ks reps queries
    let a: Vec<String> = std::env::args().collect();
    let n: usize = a[1].parse().unwrap();
    let set = &a[2];
    let queries: usize = a.get(6).map_or(100_000, |s| s.parse().unwrap());
    let reps: usize = a.get(5).map_or(7, |s| s.parse().unwrap());
    let ks: Vec<usize> = a[4].split(',').map(|k| k.parse().unwrap()).collect();
    let mut rng = Rng(1);
    let mut point = || if set == "uniform" { rng.vec() } else { rng.surface() };
    let points: Vec<Vec3> = (0..n).map(|_| point()).collect();
    let mut at: Vec<Vec3> = (0..queries).map(|_| point()).collect();
    let start = Instant::now();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    print!("build {:.0} ms {:.2} B/pt ", start.elapsed().as_secs_f64() * 1e3, tree.stats().bytes() as f64 / n as f64);
    let mut sum = 0.0;
    let mut buffer = NeighborBuffer::new();
    for q in at.iter().take(300) {
        sum += tree.query(*q, 0.0).nearest_n_into(40, &mut buffer).last().map_or(0.0, |n| f64::from(n.distance()));
    }
    let radius = (sum / 300.0) as f32;
    for order in ["random", "morton"] {
        if a[3] != "both" && a[3] != order {
            continue;
        }
        if order == "morton" {
            at.sort_by_key(|q| morton(*q));
        }
        for &k in &ks {
            let mut times = vec![];
            for _ in 0..reps {
                let start = Instant::now();
                for q in &at {
                    match k {
                        0 => {
                            black_box(tree.query(*q, 0.0).radius(radius).collect_into(&mut buffer).len());
                        }
                        1 => {
                            black_box(tree.query(*q, 0.0).nearest().map_or(0, |n| n.id));
                        }
                        _ => {
                            black_box(tree.query(*q, 0.0).nearest_n_into(k, &mut buffer)[0].id);
                        }
                    }
                }
                times.push(start.elapsed().as_nanos() as f64 / at.len() as f64);
            }
            times.sort_by(f64::total_cmp);
            let mut work = mbkd::NeighborWork::default();
            if k > 0 {
                for q in at.iter().take(5000) {
                    let w = tree.query(*q, 0.0).work(k);
                    work.nodes += w.nodes;
                    work.blocks += w.blocks;
                }
            }
            print!(
                "| {order} {k}: {:.0} ({:.0}) [{:.2} n {:.2} b] ",
                times[0],
                times[times.len() / 2],
                work.nodes as f64 / 5000.0,
                work.blocks as f64 / 5000.0
            );
        }
    }
    println!();
}
