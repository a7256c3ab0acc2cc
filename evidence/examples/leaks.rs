//! The long watertight run: rays from inside a closed moving mesh, aimed at its edges and vertices at random times.
//! Every one must hit. `cargo run --release --example leaks -- --rays 100000000`

use clap::Parser;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Hit, Policy, Ray, RayTree, TriangleMesh};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Parser)]
#[command(about = "Shoots rays from inside a closed moving mesh at its edges and vertices; none may escape")]
struct Args {
    /// Number of rays.
    #[arg(long, default_value_t = 1_000_000)]
    rays: u64,
    /// Rings of the sphere; it has four times their square triangles. With fewer than 8, origins could lie outside.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u16).range(8..=2000))]
    rings: u16,
    /// Keys of the motion.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    keys: u16,
    /// First seed; a leak is reported with the seed of its block.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The paper's k-d tree instead of the default.
    #[arg(long)]
    kd: bool,
}

/// Rays per block, the unit of parallel work.
const BLOCK: u64 = 50_000;

/// splitmix64
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// A sphere of triangles whose vertices wander.
fn closed_sphere(rings: usize, keys: usize, random: &mut Random) -> TriangleMesh {
    let around = 2 * rings;
    let mut base = vec![Vec3::Z, Vec3::NEG_Z];
    for ring in 1..rings {
        let polar = core::f32::consts::PI * ring as f32 / rings as f32;
        for i in 0..around {
            let turn = core::f32::consts::TAU * i as f32 / around as f32;
            base.push(Vec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()));
        }
    }
    let wobble = 1.0 / rings as f32;
    let positions: Vec<Vec<Vec3>> =
        (0..keys).map(|_| base.iter().map(|p| *p + random.vec() * wobble).collect()).collect();
    let vertex = |ring: usize, i: usize| match ring {
        0 => 0,
        r if r == rings => 1,
        r => (2 + (r - 1) * around + i % around) as u32,
    };
    let mut indices = Vec::new();
    for ring in 0..rings {
        for i in 0..around {
            let (a, b) = (vertex(ring, i), vertex(ring, i + 1));
            let (c, d) = (vertex(ring + 1, i), vertex(ring + 1, i + 1));
            if ring > 0 {
                indices.push([a, c, b]);
            }
            if ring + 1 < rings {
                indices.push([b, c, d]);
            }
        }
    }
    TriangleMesh::new(indices, positions)
}

/// Shoots one block; the rays that escaped.
fn block(tree: &RayTree, triangles: usize, seed: u64, rays: u64) -> Vec<Ray> {
    let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let mut leaks = Vec::new();
    for _ in 0..rays {
        let primitive = (random.next() % triangles as u64) as u32;
        let time = random.unit();
        let [a, b, _] = tree.vertices(&Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive }, time);
        let along = if random.next().is_multiple_of(2) { 0.0 } else { f64::from(random.unit()) };
        let origin: DVec3 = random.vec().as_dvec3() * 0.3;
        let ray = Ray::new(origin, (a + (b - a) * along - origin).as_vec3()).at_time(time);
        if !tree.any_hit(&ray) {
            leaks.push(ray);
        }
    }
    leaks
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = Args::parse();
    let mesh = closed_sphere(args.rings.into(), args.keys.into(), &mut Random(args.seed));
    let triangles = mesh.len();
    let params = BuildParams::default();
    let params = if args.kd { params.with_policy(Policy::Mbkd) } else { params };
    let tree = RayTree::build(&[mesh], &params)?;
    println!("{triangles} triangles, {} keys, {} rays", args.keys, args.rays);
    let (done, blocks) = (AtomicU64::new(0), args.rays.div_ceil(BLOCK));
    let leaks: Vec<Ray> = (0..blocks)
        .into_par_iter()
        .flat_map_iter(|i| {
            let rays = BLOCK.min(args.rays - i * BLOCK);
            let leaks = block(&tree, triangles, args.seed + i, rays);
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            if blocks >= 100 && done * 10 / blocks > (done - 1) * 10 / blocks {
                eprintln!("{} %", done * 100 / blocks);
            }
            leaks
        })
        .collect();
    for ray in leaks.iter().take(10) {
        println!("leak: {ray:?}");
    }
    println!("{} of {} rays leaked", leaks.len(), args.rays);
    if leaks.is_empty() { Ok(()) } else { Err("the mesh leaks".into()) }
}
