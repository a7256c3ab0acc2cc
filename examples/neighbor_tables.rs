//! quick
use kiddo::{KdTree, SquaredEuclidean};
use kiddo::leaf_strategy::FlatVec;
use kiddo::stem_strategy::Eytzinger;
use mbkd::{NeighborBuffer, PointParams, PointTree};
use std::num::NonZero;
use std::time::Instant;

type Kd32 = kiddo::ImmutableKdTree<f32, 3>;
type KdFlat = KdTree<f32, u32, Eytzinger, FlatVec<f32, u32, 3, 32>, 3, 32>;

fn rng(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}
fn spread(x: f32) -> u64 { let mut v = (x * 1024.0) as u64; v = (v | v << 16) & 0x30000ff; v = (v | v << 8) & 0x300f00f; v = (v | v << 4) & 0x30c30c3; (v | v << 2) & 0x9249249 }
fn time(mut f: impl FnMut(), n: usize) -> f64 { let t = Instant::now(); f(); t.elapsed().as_nanos() as f64 / n as f64 }
fn med(mut v: Vec<f64>) -> f64 { v.sort_by(f64::total_cmp); v[v.len() / 2] }
fn main() {
    let n: usize = std::env::args().nth(1).map_or(1_000_000, |a| a.parse().unwrap());
    let mut s = 1;
    let p: Vec<[f32; 3]> = (0..n).map(|_| [rng(&mut s), rng(&mut s), rng(&mut s)]).collect();
    let mut q: Vec<[f32; 3]> = (0..100_000).map(|_| [rng(&mut s), rng(&mut s), rng(&mut s)]).collect();
    if std::env::args().nth(2).as_deref() != Some("random") {
        q.sort_by_key(|q| spread(q[0]) | spread(q[1]) << 1 | spread(q[2]) << 2);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
    let params = PointParams::default();
    let b: Vec<(f64, f64)> = (0..5).map(|_| (time(|| { PointTree::build(&p[..], &params).unwrap(); }, 1) / 1e6, time(|| { Kd32::new_from_slice(&p).unwrap(); }, 1) / 1e6)).collect();
    println!("build ours {:.1} ms kiddo {:.1} ms", med(b.iter().map(|x| x.0).collect()), med(b.iter().map(|x| x.1).collect()));
    let tree = PointTree::build(&p[..], &params).unwrap();
    println!("{} B/pt", tree.bytes() as f64 / n as f64);
    let kd = Kd32::new_from_slice(&p).unwrap();
    let flat = KdFlat::new_from_slice(&p).unwrap();
    let mut buffer = NeighborBuffer::default();
    let r = (40.0 / n as f64 * 3.0 / 4.0 / std::f64::consts::PI).cbrt() as f32;
    let m = q.len();
    let ks: Vec<usize> = std::env::var("K").map_or(vec![1, 8, 32, 64, 0], |k| vec![k.parse().unwrap()]);
    for k in ks {
        let (mut a, mut c, mut d) = (vec![], vec![], vec![]);
        let mut sums = [0.0f64; 3];
        for _ in 0..5 {
            sums = [0.0; 3];
            a.push(time(|| for q in &q {
                sums[0] += match k {
                    1 => tree.query(*q, 0.0).nearest().unwrap().distance_squared as f64,
                    0 => tree.query(*q, 0.0).radius(r).collect_into(&mut buffer).len() as f64,
                    _ => tree.query(*q, 0.0).nearest_n_into(k, &mut buffer)[k - 1].distance_squared as f64,
                }
            }, m));
            c.push(time(|| for q in &q {
                sums[1] += match k {
                    1 => kd.query(q).nearest_one::<SquaredEuclidean<f32>>().execute().distance as f64,
                    0 => kd.query(q).within::<SquaredEuclidean<f32>>(r * r).unsorted().execute().len() as f64,
                    _ => kd.query(q).nearest_n::<SquaredEuclidean<f32>>(NonZero::new(k).unwrap()).execute()[k - 1].distance as f64,
                }
            }, m));
            d.push(time(|| for q in &q {
                sums[2] += match k {
                    1 => flat.query(q).nearest_one::<SquaredEuclidean<f32>>().execute().distance as f64,
                    0 => flat.query(q).within::<SquaredEuclidean<f32>>(r * r).unsorted().execute().len() as f64,
                    _ => flat.query(q).nearest_n::<SquaredEuclidean<f32>>(NonZero::new(k).unwrap()).execute()[k - 1].distance as f64,
                }
            }, m));
        }
        let (a, c, d) = (med(a), med(c), med(d));
        println!("k {k}: ours {a:.0} kiddo {c:.0} flat {d:.0}  ratio {:.2} sums {sums:?}", c.min(d) / a);
    }
    });
}
