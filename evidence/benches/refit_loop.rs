//! Throw-away.
#[path = "embree/clock.rs"]
mod clock;
use mbkd::{BuildParams, RayTree};
use mbkd_scenes as scene;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let n: usize = a[1].parse().unwrap();
    let keys: usize = a[2].parse().unwrap();
    let rounds: usize = a[3].parse().unwrap();
    let hall = a.get(4).is_some_and(|x| x == "hall");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let frames: Vec<_> = (0..2)
        .map(|i| {
            let mut s = scene::walking_from(if hall { n } else { 6 * n }, keys, 0.5 * i as f32 - 30.0);
            if !hall {
                s.meshes.drain(..5);
            }
            s.meshes
        })
        .collect();
    pool.install(|| {
        let mut tree = RayTree::build(&frames[0], &BuildParams::default()).unwrap();
        tree.refit(&frames[0]).unwrap();
        let mut t = Vec::new();
        let mut b = Vec::new();
        for i in 1..=rounds {
            let s = clock::seconds();
            let r = tree.refit(&frames[i % 2]).unwrap();
            t.push(clock::seconds() - s);
            if rounds < 100 && i % 5 == 0 {
                let s = clock::seconds();
                let o = RayTree::build(&frames[i % 2], &BuildParams::default()).unwrap();
                b.push(clock::seconds() - s);
                drop(o);
            }
            if i == rounds {
                println!("{r:?}");
            }
        }
        t.sort_by(f64::total_cmp);
        b.sort_by(f64::total_cmp);
        println!(
            "refit median {:.3} min {:.3} ms; build median {:.3} ms; ratio {:.2}",
            t[t.len() / 2] * 1e3,
            t[0] * 1e3,
            b.get(b.len() / 2).unwrap_or(&0.) * 1e3,
            b.get(b.len() / 2).unwrap_or(&0.) / t[t.len() / 2]
        );
    });
}
