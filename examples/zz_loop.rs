use mbkd::{BuildParams, Counters, Ray, RayTree, scene};
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let runs: usize = a[2].parse().unwrap();
    let threads: usize = a[3].parse().unwrap();
    let work = a.get(4).is_some_and(|w| w == "work");
    let mut params = BuildParams::default();
    if let Ok(w) = std::env::var("WR") {
        params.wide_references = w.parse().unwrap();
    }
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().unwrap();
    for name in a[1].split(',') {
        let s = scene::find(name).unwrap();
        let s = match std::env::var("N") {
            Ok(n) => (s.make)(n.parse().unwrap()),
            _ => (s.make)(s.full),
        };
        let mut times: Vec<f64> = Vec::new();
        let mut tree = None;
        for _ in 0..runs {
            tree = None;
            let t = Instant::now();
            tree = Some(RayTree::build(&s.meshes, &params).unwrap());
            times.push(t.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let tree = tree.unwrap();
        let st = tree.statistics();
        print!(
            "{name} n {} t{threads} min {:.2} med {:.2} ms  refs {:.3} nodes {} leaves {} bytes {:.2}+{:.2} MB",
            st.primitives,
            times[0],
            times[times.len() / 2],
            st.references_per_primitive(),
            st.nodes,
            st.leaves,
            st.bytes as f64 / 1e6,
            st.primitive_bytes as f64 / 1e6
        );
        if work {
            let mut x = 12345u64;
            let mut rnd = || {
                x = x.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (x >> 40) as f32 / (1u64 << 24) as f32
            };
            let (mut c, mut b, mut o) = (Counters::default(), Counters::default(), Counters::default());
            let n = 40000;
            let mut rays = vec![];
            for _ in 0..n {
                let ray = s.camera.ray(rnd(), rnd(), 1.0, rnd());
                if let Some(h) = tree.closest_hit_observed(&ray, &mut c) {
                    let mut nn = tree.normal(&h, ray.time);
                    if nn.dot(ray.dir) > 0.0 {
                        nn = -nn;
                    }
                    let p = ray.origin + (ray.dir * h.t).as_dvec3() + (nn * 1e-4).as_dvec3();
                    let d = loop {
                        let d = mbkd::glam::Vec3::new(rnd() * 2.0 - 1.0, rnd() * 2.0 - 1.0, rnd() * 2.0 - 1.0);
                        if d.length_squared() < 1.0 && d.length_squared() > 1e-3 {
                            break d.normalize();
                        }
                    };
                    rays.push(Ray::new(p, (d + nn * 1.001).normalize()).at_time(ray.time));
                }
            }
            let t = Instant::now();
            for r in &rays {
                tree.closest_hit_observed(r, &mut b);
            }
            let tb = t.elapsed().as_secs_f64();
            for r in &rays {
                tree.any_hit_observed(r, &mut o);
            }
            let f = |c: &Counters, n: usize| {
                let n = n as f64;
                format!(
                    "{:.3}n {:.3}l {:.2}t cost {:.3}",
                    c.nodes as f64 / n,
                    c.leaves as f64 / n,
                    c.primitive_tests as f64 / n,
                    (2.0 * c.nodes as f64 + c.leaves as f64 + 0.07 * c.primitive_tests as f64) / n
                )
            };
            print!(
                " | cam {} | bounce {} ({:.0} ns) | any {}",
                f(&c, n),
                f(&b, rays.len()),
                tb * 1e9 / rays.len() as f64,
                f(&o, rays.len())
            );
        }
        println!();
    }
}
