//! A spot of light that moves over a floor, photons of it, and ways to estimate how bright it is at a place and time.

use kiddo::SquaredEuclidean;
use mbkd::glam::{DVec2, Vec2, Vec3};
use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
use mbkd_scenes::Random;
use std::error::Error;
use std::f64::consts::PI;
use std::num::NonZero;

type Tree = kiddo::ImmutableKdTree<f32, 2>;

/// Radius of the spot; the floor is the unit square.
const SPOT: f64 = 0.1;
/// How far the spot moves while the shutter is open.
const WAY: f64 = 0.5;

/// A place on the floor and a time.
pub type Place = (Vec2, f32);

/// Where the middle of the spot is.
fn middle(time: f64) -> DVec2 {
    DVec2::new(0.25 + WAY * time, 0.5)
}

/// The true density of light: half of it falls evenly on the floor, half evenly into the spot.
pub fn density((at, time): Place) -> f64 {
    let inside = at.as_dvec2().distance(middle(time.into())) < SPOT;
    0.5 + if inside { 0.5 / (PI * SPOT * SPOT) } else { 0.0 }
}

/// Places in and around the spot, four radii wide.
pub fn places(count: usize, seed: u64) -> Vec<Place> {
    let mut random = Random(seed);
    let mut place = || {
        let time = random.unit_f64() as f32;
        let aside = DVec2::new(random.signed_f64(), random.signed_f64()) * (2.0 * SPOT);
        ((middle(time.into()) + aside).as_vec2(), time)
    };
    (0..count).map(|_| place()).collect()
}

/// A photon's place at a time.
fn photon(time: f64, random: &mut Random) -> Vec2 {
    if random.unit_f64() < 0.5 {
        return DVec2::new(random.unit_f64(), random.unit_f64()).as_vec2();
    }
    loop {
        let aside = DVec2::new(random.signed_f64(), random.signed_f64());
        if aside.length_squared() < 1.0 {
            return (middle(time) + aside * SPOT).as_vec2();
        }
    }
}

/// A way to estimate the density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The library's gather: the `k` nearest of the photons within half a window of the time.
    RayTime {
        /// Photons.
        k: usize,
        /// Which of the half windows.
        window: usize,
    },
    /// Each pass has one time, and an equal share of the photons; the pass with the nearest time answers.
    PerPass {
        /// Photons.
        k: usize,
        /// Which number of passes.
        passes: usize,
    },
    /// The `k` nearest photons of all times.
    Ignored {
        /// Photons.
        k: usize,
    },
    /// What `RayTime` does, with kiddo: photons within a radius, those of other times left out, the radius doubled until
    /// there are enough.
    Filtered {
        /// Photons.
        k: usize,
        /// Which of the half windows.
        window: usize,
    },
}

/// Half windows.
pub const WINDOWS: [f32; 5] = [0.005, 0.01, 0.02, 0.05, 0.1];
/// Numbers of passes.
pub const PASSES: [usize; 5] = [1, 4, 16, 64, 256];
/// Numbers of photons.
pub const COUNTS: [usize; 5] = [10, 25, 50, 100, 200];

/// Photons, in the structures of all methods.
pub struct Photons {
    count: usize,
    /// By window.
    maps: Vec<PhotonMap<f32>>,
    all: Tree,
    times: Vec<f32>,
    /// By number of passes.
    passes: Vec<Vec<Tree>>,
    scratch: NeighborBuffer,
    near: Vec<(f32, u32)>,
}

fn tree(places: &[Vec2]) -> Result<Tree, Box<dyn Error>> {
    let places: Vec<[f32; 2]> = places.iter().map(|p| p.to_array()).collect();
    Tree::new_from_slice(&places).map_err(|e| format!("kiddo could not be built: {e:?}").into())
}

impl Photons {
    /// `count` photons for the methods that know the times of photons, and as many for each number of passes.
    pub fn new(count: usize, seed: u64) -> Result<Photons, Box<dyn Error>> {
        let mut random = Random(seed);
        let mut photons: Vec<(Vec2, f32)> = (0..count)
            .map(|_| {
                let time = random.unit_f64() as f32;
                (photon(time.into(), &mut random), time)
            })
            .collect();
        // In an order in which near photons are near in memory: kiddo's search looks up their times by index.
        photons.sort_by_cached_key(|(at, _)| {
            let cell = (*at * 1023.0).clamp(Vec2::ZERO, Vec2::splat(1023.0)).as_uvec2().to_array();
            (0..20).fold(0u32, |code, bit| code | (cell[bit % 2] >> (bit / 2) & 1) << bit)
        });
        let flux = 1.0 / count as f32;
        let stamped: Vec<Photon<f32>> =
            photons.iter().map(|(at, time)| Photon::at_time(at.extend(0.0), Vec3::Z, flux, *time)).collect();
        let map = |window| PhotonMap::build(&stamped, &GatherParams { window, ..GatherParams::default() });
        let mut pass = |number: usize, of: usize| {
            let time = (number as f64 + 0.5) / of as f64;
            tree(&(0..count / of).map(|_| photon(time, &mut random)).collect::<Vec<_>>())
        };
        let mut passes = Vec::new();
        for of in PASSES {
            passes.push((0..of).map(|i| pass(i, of)).collect::<Result<Vec<Tree>, _>>()?);
        }
        Ok(Photons {
            count,
            maps: WINDOWS.into_iter().map(map).collect::<Result<_, _>>()?,
            all: tree(&photons.iter().map(|p| p.0).collect::<Vec<_>>())?,
            times: photons.iter().map(|p| p.1).collect(),
            passes,
            scratch: NeighborBuffer::new(),
            near: Vec::new(),
        })
    }

    /// The estimated density at a place and time.
    pub fn estimate(&mut self, method: Method, (at, time): Place) -> f64 {
        match method {
            Method::RayTime { k, window } => {
                let query = GatherQuery::new(at.extend(0.0), Vec3::Z, time).nearest(k).window(WINDOWS[window]);
                self.maps[window].gather(&query, &mut self.scratch).map_or(0.0, |gathered| gathered.density.into())
            }
            Method::PerPass { k, passes } => {
                let of = PASSES[passes];
                let tree = &self.passes[passes][((time * of as f32) as usize).min(of - 1)];
                nearest_density(tree, at, k) / (self.count / of) as f64
            }
            Method::Ignored { k } => nearest_density(&self.all, at, k) / self.count as f64,
            Method::Filtered { k, window } => self.filtered(at, time, k, WINDOWS[window]),
        }
    }

    fn filtered(&mut self, at: Vec2, time: f32, k: usize, window: f32) -> f64 {
        let seconds = f64::from((time + window).min(1.0) - (time - window).max(0.0));
        // A disc that holds twice as many where light is even.
        let mut square = (2.0 * (k + 1) as f64 / (PI * self.count as f64 * seconds)) as f32;
        let place = at.to_array();
        loop {
            self.near.clear();
            let (times, near) = (&self.times, &mut self.near);
            self.all.query(&place).within::<SquaredEuclidean<f32>>(square).unsorted().visit(|found| {
                if (times[found.item as usize] - time).abs() <= window {
                    near.push((found.distance, found.item));
                }
            });
            if near.len() > k {
                let (_, rim, _) = near.select_nth_unstable_by(k, |a, b| a.0.total_cmp(&b.0));
                return k as f64 / (PI * f64::from(rim.0) * seconds * self.count as f64);
            }
            square *= 4.0;
            // Wider than the floor: there are no more.
            if square > 8.0 {
                return 0.0;
            }
        }
    }
}

/// The density of the `k` nearest photons: their number over the disc up to the next one.
fn nearest_density(tree: &Tree, at: Vec2, k: usize) -> f64 {
    let count = NonZero::new(k + 1).unwrap_or(NonZero::<usize>::MIN);
    let found = tree.query(&at.to_array()).nearest_n::<SquaredEuclidean<f32>>(count).execute();
    found.last().map_or(0.0, |rim| (found.len() - 1) as f64 / (PI * f64::from(rim.distance)))
}
