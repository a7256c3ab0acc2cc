//! Photon gathering against the same estimates with a kiddo tree and with handwritten hash grids, interleaved in one
//! run, on one thread: `cargo bench --bench gather`.
//!
//! The gather: k = 50 within a radius that holds about 150 photons of the time window, with a million photons with time
//! stamps on the walls of a room. With kiddo, all photons within the radius are visited and filtered by time, and the
//! k + 1 nearest are selected. The hash grid is that of SmallVCM (Davidovič and Georgiev): cells of twice the radius,
//! photons sorted into them by counting, eight cells per query; it has no k, and is compared at a fixed radius. All
//! methods get the photons in an order in which neighbours are close in memory.
//!
//! The inverse gather: a million visible points whose radii differ by a factor of ten, a million photons per pass,
//! radii shrinking between passes. The grid is that of pbrt's SPPM: points in every cell that their box overlaps,
//! rebuilt for each pass, but with the points themselves in the cells instead of lists of them; ours refits its tree to
//! the new radii.

use clap::Parser;
use kiddo::SquaredEuclidean;
use mbkd::glam::{IVec3, Vec3};
use mbkd::point::{
    GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap, PhotonTime, VisiblePoint, VisiblePoints,
};
use mbkd_evidence::options;
use mbkd_evidence::point_sets::morton;
use mbkd_evidence::timing::{self, on_one_thread, wall_seconds};
use mbkd_scenes::Random;
use std::cell::Cell;
use std::hint::black_box;
use std::time::Instant;

/// A point on the walls of the unit cube, and the normal there.
fn wall(random: &mut Random) -> (Vec3, Vec3) {
    let (axis, far) = ((6.0 * random.unit()) as usize / 2, random.unit() < 0.5);
    let mut at = Vec3::new(random.unit(), random.unit(), random.unit());
    let mut normal = Vec3::ZERO;
    at[axis] = if far { 1.0 } else { 0.0 };
    normal[axis] = if far { -1.0 } else { 1.0 };
    (at, normal)
}

/// Runs both sides in turns; returns the median time of each, in nanoseconds per item, and its last checksum.
fn race(rounds: usize, items: usize, ours: impl FnMut() -> f64, theirs: impl FnMut() -> f64) -> [(f64, f64); 2] {
    let sums = [Cell::new(0.0), Cell::new(0.0)];
    let mut turns: [Box<dyn FnMut()>; 2] = [turn(ours, &sums[0]), turn(theirs, &sums[1])];
    let times = timing::race(wall_seconds, rounds, &mut turns);
    [0, 1].map(|side| (times[side].median * 1e9 / items as f64, sums[side].get()))
}

fn turn<'a>(mut run: impl FnMut() -> f64 + 'a, sum: &'a Cell<f64>) -> Box<dyn FnMut() + 'a> {
    Box::new(move || sum.set(black_box(run())))
}

#[derive(Parser)]
#[command(about = "Photon gathers against kiddo and hash grids, in tables")]
struct Args {
    /// Number of photons.
    #[arg(long, default_value_t = 1_000_000, value_parser = at_least_one)]
    photons: usize,
    /// Queries per repetition.
    #[arg(long, default_value_t = 50_000, value_parser = at_least_one)]
    queries: usize,
    /// Repetitions; the median is reported.
    #[arg(long, default_value_t = 5, value_parser = at_least_one)]
    repeat: usize,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| "a whole number, at least 1".to_string())
}

fn main() {
    let args: Args = options();
    let (photons, queries, rounds) = (args.photons, args.queries, args.repeat);
    on_one_thread(|| {
        gathers(photons, queries, rounds);
        inverse(photons, rounds);
    });
}

fn stamp(photon: &Photon<Vec3>) -> f32 {
    match photon.time {
        PhotonTime::At(time) => time,
        _ => unreachable!("all photons have a stamp"),
    }
}

fn gathers(count: usize, queries: usize, rounds: usize) {
    let mut rng = Random(1);
    let mut photons: Vec<Photon<Vec3>> = (0..count)
        .map(|_| {
            let (at, normal) = wall(&mut rng);
            Photon::at_time(at, normal, Vec3::new(rng.unit(), rng.unit(), rng.unit()), rng.unit())
        })
        .collect();
    // In an order in which neighbouring photons are close in memory: kiddo's search looks up their times by index.
    photons.sort_by_cached_key(|photon| morton(photon.position));
    let begin = Instant::now();
    let map = PhotonMap::build(&photons, &GatherParams::default()).expect("photons are fine");
    let ours = begin.elapsed();
    let places: Vec<[f32; 3]> = photons.iter().map(|p| p.position.to_array()).collect();
    let begin = Instant::now();
    let tree = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&places).expect("photons are fine");
    println!("build: ours {:.0} ms, kiddo {:.0} ms", ours.as_secs_f64() * 1e3, begin.elapsed().as_secs_f64() * 1e3);
    println!("ours {:.1} bytes per photon with 12 of flux", map.bytes() as f64 / count as f64);

    for (order, coherent) in [("along the walls", true), ("in random order", false)] {
        let mut at: Vec<(Vec3, Vec3, f32)> = (0..queries)
            .map(|_| {
                let (at, normal) = wall(&mut rng);
                (at, normal, rng.unit())
            })
            .collect();
        if coherent {
            let cell = |x: f32| (x * 40.0) as u32;
            at.sort_by_key(|(p, ..)| (cell(p.x), cell(p.y), cell(p.z)));
        }
        for window in [0.01f32, 0.025, 0.05] {
            let radius = (150.0 / (std::f32::consts::PI * count as f32 / 6.0 * 2.0 * window)).sqrt();
            k_nearest(&map, &photons, &tree, &at, (radius, window), rounds, order);
            fixed_radius(&map, &photons, &at, (radius * 0.58, window), rounds, order);
        }
    }
}

type Queries = [(Vec3, Vec3, f32)];

fn k_nearest(
    map: &PhotonMap<Vec3>,
    photons: &[Photon<Vec3>],
    tree: &kiddo::ImmutableKdTree<f32, 3>,
    at: &Queries,
    (radius, window): (f32, f32),
    rounds: usize,
    order: &str,
) {
    let k = 50;
    let mut scratch = NeighborBuffer::new();
    let ours = || {
        let mut sum = 0.0;
        for &(at, normal, time) in at {
            let query = GatherQuery::new(at, normal, time).nearest(k).radius(radius).window(window);
            sum += f64::from(map.gather(&query, &mut scratch).expect("a good query").density.x);
        }
        sum
    };
    let mut near: Vec<(f32, u32)> = Vec::new();
    let theirs = || {
        let mut sum = 0.0;
        for &(at, _, time) in at {
            near.clear();
            let place = at.to_array();
            tree.query(&place).within::<SquaredEuclidean<f32>>(radius * radius).unsorted().visit(|found| {
                let id = found.item;
                if (stamp(&photons[id as usize]) - time).abs() <= window {
                    near.push((found.distance, id));
                }
            });
            let mut squared = radius * radius;
            if near.len() > k {
                let (_, rim, _) = near.select_nth_unstable_by(k, |a, b| a.0.total_cmp(&b.0));
                squared = rim.0;
                near.truncate(k);
            }
            let flux: Vec3 = near.iter().map(|&(_, id)| photons[id as usize].flux).sum();
            let seconds = (time + window).min(1.0) - (time - window).max(0.0);
            sum += f64::from(flux.x / (std::f32::consts::PI * squared * seconds));
        }
        sum
    };
    let [ours, theirs] = race(rounds, at.len(), ours, theirs);
    assert!((ours.1 / theirs.1 - 1.0).abs() < 1e-3, "sums differ: {} {}", ours.1, theirs.1);
    let (ours, theirs) = (ours.0, theirs.0);
    let name = format!("k = {k}, half window {window}, {order}");
    println!("{name}: {ours:.0} ns, kiddo {theirs:.0} = {:.2} (target 3)", theirs / ours);
}

/// Photons sorted into the cells of a table by counting, as in SmallVCM.
struct HashGrid {
    ends: Vec<u32>,
    order: Vec<u32>,
    positions: Vec<Vec3>,
    stamps: Vec<f32>,
    flux: Vec<Vec3>,
    inverse: f32,
}

impl HashGrid {
    fn new(photons: &[Photon<Vec3>], radius: f32) -> HashGrid {
        let mut grid = HashGrid {
            ends: vec![0; photons.len().next_power_of_two() + 1],
            order: vec![0; photons.len()],
            positions: Vec::new(),
            stamps: Vec::new(),
            flux: Vec::new(),
            inverse: 1.0 / (2.0 * radius),
        };
        let cells: Vec<u32> = photons.iter().map(|p| grid.cell((p.position * grid.inverse).floor())).collect();
        for &cell in &cells {
            grid.ends[cell as usize + 1] += 1;
        }
        for i in 1..grid.ends.len() {
            grid.ends[i] += grid.ends[i - 1];
        }
        let mut next = grid.ends.clone();
        for (i, &cell) in (0u32..).zip(&cells) {
            grid.order[next[cell as usize] as usize] = i;
            next[cell as usize] += 1;
        }
        // The data that a query reads, in the order in which it is read.
        grid.positions = grid.order.iter().map(|&i| photons[i as usize].position).collect();
        grid.stamps = grid.order.iter().map(|&i| stamp(&photons[i as usize])).collect();
        grid.flux = grid.order.iter().map(|&i| photons[i as usize].flux).collect();
        grid
    }

    fn cell(&self, c: Vec3) -> u32 {
        let [x, y, z] = [c.x as i32 as u32, c.y as i32 as u32, c.z as i32 as u32];
        let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        hash & (self.ends.len() as u32 - 2)
    }

    fn gather(&self, at: Vec3, time: f32, radius: f32, window: f32) -> Vec3 {
        let place = at * self.inverse;
        let base = (place - 0.5).floor();
        let mut cells = [0; 8];
        let mut count = 0;
        for i in 0..8 {
            let corner = Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
            let cell = self.cell(base + corner);
            if !cells[..count].contains(&cell) {
                cells[count] = cell;
                count += 1;
            }
        }
        let mut flux = Vec3::ZERO;
        for &cell in &cells[..count] {
            for i in self.ends[cell as usize] as usize..self.ends[cell as usize + 1] as usize {
                let near = self.positions[i].distance_squared(at) <= radius * radius;
                if near && (self.stamps[i] - time).abs() <= window {
                    flux += self.flux[i];
                }
            }
        }
        let seconds = (time + window).min(1.0) - (time - window).max(0.0);
        flux / (std::f32::consts::PI * radius * radius * seconds)
    }
}

fn fixed_radius(
    map: &PhotonMap<Vec3>,
    photons: &[Photon<Vec3>],
    at: &Queries,
    (radius, window): (f32, f32),
    rounds: usize,
    order: &str,
) {
    let grid = HashGrid::new(photons, radius);
    let mut scratch = NeighborBuffer::new();
    let ours = || {
        let mut sum = 0.0;
        for &(at, normal, time) in at {
            let query = GatherQuery::new(at, normal, time).radius(radius).window(window);
            sum += f64::from(map.gather(&query, &mut scratch).expect("a good query").density.x);
        }
        sum
    };
    let theirs = || at.iter().map(|&(at, _, time)| f64::from(grid.gather(at, time, radius, window).x)).sum();
    let [ours, theirs] = race(rounds, at.len(), ours, theirs);
    assert!((ours.1 / theirs.1 - 1.0).abs() < 1e-3, "sums differ: {} {}", ours.1, theirs.1);
    let (ours, theirs) = (ours.0, theirs.0);
    let name = format!("radius {radius:.4}, half window {window}, {order}");
    println!("{name}: {ours:.0} ns, hash grid {theirs:.0} = {:.2} (target 1.5)", theirs / ours);
}

/// Visible points in all cells that their boxes overlap, as in pbrt's SPPM; copied into their cells, so that a photon
/// reads them sequentially.
struct PointGrid {
    ends: Vec<u32>,
    entries: Vec<(VisiblePoint, u32)>,
    inverse: f32,
    cells: i32,
}

impl PointGrid {
    fn new(points: &[VisiblePoint]) -> PointGrid {
        let most = points.iter().map(|p| p.radius).fold(0.0, f32::max);
        let cells = (1.0 / most).floor().max(1.0);
        let mut grid = PointGrid {
            ends: vec![0; points.len().next_power_of_two() + 1],
            entries: vec![],
            inverse: cells,
            cells: cells as i32,
        };
        for point in points {
            grid.touched(point, |ends, cell| ends[cell + 1] += 1);
        }
        for i in 1..grid.ends.len() {
            grid.ends[i] += grid.ends[i - 1];
        }
        let mut entries = vec![(points[0], 0); *grid.ends.last().expect("there is a last") as usize];
        let mut next = grid.ends.clone();
        for (i, point) in (0u32..).zip(points) {
            grid.touched(point, |_, cell| {
                entries[next[cell] as usize] = (*point, i);
                next[cell] += 1;
            });
        }
        grid.entries = entries;
        grid
    }

    fn touched(&mut self, point: &VisiblePoint, mut each: impl FnMut(&mut [u32], usize)) {
        let place = |p: Vec3| (p * self.inverse).floor().as_ivec3().clamp(IVec3::ZERO, IVec3::splat(self.cells));
        let (lo, hi) = (place(point.position - point.radius), place(point.position + point.radius));
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                for x in lo.x..=hi.x {
                    let cell = self.cell([x, y, z]);
                    each(&mut self.ends, cell);
                }
            }
        }
    }

    fn cell(&self, c: [i32; 3]) -> usize {
        let [x, y, z] = c.map(|x| x as u32);
        let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        (hash & (self.ends.len() as u32 - 2)) as usize
    }
}

fn inverse(count: usize, rounds: usize) {
    let mut rng = Random(2);
    let base = 1.5 / (count as f32 / 6.0).sqrt();
    let points: Vec<VisiblePoint> = (0..count)
        .map(|_| VisiblePoint { position: wall(&mut rng).0, time: rng.unit(), radius: base * 10f32.powf(rng.unit()) })
        .collect();
    let mut photons: Vec<(Vec3, f32)> = (0..count).map(|_| (wall(&mut rng).0, rng.unit())).collect();
    // In an order that suits the grid; ours computes one itself.
    photons.sort_by_cached_key(|photon| morton(photon.0));
    let window = 0.05;
    let begin = Instant::now();
    let mut tree = VisiblePoints::build(&points, &GatherParams::default()).expect("points are fine");
    let build = begin.elapsed().as_secs_f64();
    let mut radii: Vec<f32> = points.iter().map(|p| p.radius).collect();
    let begin = Instant::now();
    tree.set_radii(&radii).expect("radii are fine");
    let fit = begin.elapsed().as_secs_f64();
    println!(
        "visible points: build {:.0} ms, refit {:.1} ms = {:.1} times as fast",
        build * 1e3,
        fit * 1e3,
        build / fit
    );
    let shrunk = |pass: usize| 0.97f32.powi(pass as i32);
    let (mut ours_pass, mut theirs_pass) = (0, 0);
    let mut counts = vec![0u32; count];
    let ours = || {
        radii.iter_mut().zip(&points).for_each(|(radius, p)| *radius = p.radius * shrunk(ours_pass));
        ours_pass += 1;
        counts.fill(0);
        tree.set_radii(&radii).expect("radii are fine");
        tree.scatter(&photons, |p| *p, window, &mut counts, |count, _, _| *count += 1).expect("photons are fine");
        counts.iter().map(|&c| f64::from(c)).sum()
    };
    let mut their_points = points.clone();
    let mut their_counts = vec![0u32; count];
    let theirs = || {
        their_points.iter_mut().zip(&points).for_each(|(to, p)| to.radius = p.radius * shrunk(theirs_pass));
        theirs_pass += 1;
        their_counts.fill(0);
        let grid = PointGrid::new(&their_points);
        for &(at, time) in &photons {
            let cell = grid.cell((at * grid.inverse).floor().as_ivec3().to_array());
            for &(point, i) in &grid.entries[grid.ends[cell] as usize..grid.ends[cell + 1] as usize] {
                let near = point.position.distance_squared(at) <= point.radius * point.radius;
                their_counts[i as usize] += u32::from(near && (point.time - time).abs() <= window);
            }
        }
        their_counts.iter().map(|&c| f64::from(c)).sum()
    };
    let [ours, theirs] = race(rounds, count, ours, theirs);
    assert!((ours.1 / theirs.1 - 1.0).abs() < 1e-4, "hits differ: {} {}", ours.1, theirs.1);
    let hits = ours.1 / count as f64;
    let (ours, theirs) = (ours.0, theirs.0);
    println!(
        "inverse gather, {hits:.1} points per photon: {ours:.0} ns per photon and pass, grid {theirs:.0} = {:.2} (target 1.5)",
        theirs / ours
    );
}
