//! Random scenes of meshes, spheres and shapes of the caller's, how they move from frame to frame, and build parameters.

use crate::blob::Blob;
use crate::random::{Places, Random};
use mbkd::glam::{DQuat, DVec3};
use mbkd::{
    BuildError, BuildParams, Division, KdParams, Keys, LazyParams, MovingSphere, Shape, TimeInterval, TriangleMesh,
    WideParams,
};

/// Meshes, and spheres of which some are hidden in shapes of the caller's.
#[derive(Clone, Debug)]
pub struct Scene {
    pub meshes: Vec<TriangleMesh>,
    pub balls: Vec<(MovingSphere, bool)>,
    pub places: Places,
}

/// Positions at keys, in f64.
pub type Positions = Vec<Vec<DVec3>>;

fn positions(keys: &Keys) -> Positions {
    match keys {
        Keys::F32(keys) => keys.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect(),
        Keys::F64(keys) | Keys::Precise(keys) => keys.clone(),
    }
}

/// The same positions in the precision of others.
fn like(keys: &Keys, positions: Positions) -> Keys {
    match keys {
        Keys::F32(_) => in_f32(positions),
        Keys::F64(_) => Keys::F64(positions),
        Keys::Precise(_) => Keys::Precise(positions),
    }
}

fn in_f32(positions: Positions) -> Keys {
    Keys::F32(positions.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect())
}

/// Triangles, and where their corners are before they move.
fn shape(random: &mut Random, places: &Places, n: usize) -> (Vec<[u32; 3]>, Vec<DVec3>) {
    let size = random.pick(&[0.02, 0.1, 0.1, 0.5, 1.0, 1e-4]);
    let soup = |n: usize| (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    match random.below(7) {
        // A sheet whose triangles share vertices.
        0 => {
            let side = ((n / 2) as f64).sqrt().ceil() as u32 + 1;
            let (corner, bumps) = (places.place(random), random.pick(&[0.0, 0.0, 0.1]));
            let [u, v] = random.pick(&[[DVec3::X, DVec3::Y], [DVec3::Z, DVec3::X], [DVec3::ONE, DVec3::Y]]);
            let at = |i: u32| u * f64::from(i % side) + v * f64::from(i / side);
            let step = places.scale * 2.0 / f64::from(side);
            let grid = (0..side * side).map(|i| corner + at(i) * step + places.by(random) * bumps * size).collect();
            let quad = |i: u32| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]];
            let quads = (0..side * (side - 1)).filter(|i| i % side + 1 < side);
            (quads.flat_map(quad).take(n).collect(), grid)
        }
        // Any three of a few vertices, often degenerate or the same.
        1 => {
            let vertices = 1 + random.below(2 + n / 2);
            let corner = |random: &mut Random| random.below(vertices) as u32;
            let triangles = (0..n).map(|_| [corner(random), corner(random), corner(random)]).collect();
            (triangles, (0..vertices).map(|_| places.place(random)).collect())
        }
        // Needles.
        2 => {
            let needle = |_| {
                let (a, b) = (places.place(random), places.place(random));
                [a, b, b + random.vec() * places.scale * 1e-3]
            };
            (soup(n), (0..n).flat_map(needle).collect())
        }
        _ => {
            let loose = |_| {
                let (center, wide) = (places.place(random), places.scale * size);
                [0; 3].map(|_| center + random.vec() * wide)
            };
            (soup(n), (0..n).flat_map(loose).collect())
        }
    }
}

/// More keys of which all or most are on the lines between those given; `most` of them at most.
pub fn refined(random: &mut Random, keys: Positions, most: usize, scale: f64) -> Positions {
    let parts = random.pick(&[2, 3, 4, 8, 64, 1000]);
    let segments = (keys.len() - 1).max(1);
    if segments * parts > most {
        return keys;
    }
    let at = |key: usize| &keys[key.min(keys.len() - 1)];
    let between = |i: usize| {
        let (key, w) = (i / parts, (i % parts) as f64 / parts as f64);
        at(key).iter().zip(at(key + 1)).map(|(a, b)| *a * (1.0 - w) + *b * w).collect::<Vec<DVec3>>()
    };
    let mut all: Positions = (0..=segments * parts).map(between).collect();
    // One that is off the line.
    if random.one_in(2) {
        let (key, far) = (random.below(all.len()), scale * random.pick(&[1e-8, 1e-6, 0.1]));
        let point = random.below(all[key].len());
        if let Some(p) = all[key].get_mut(point) {
            *p += random.vec() * far;
        }
    }
    all
}

/// Positions at keys: still, straight, in flight, turning, trembling, or at the same places at several keys.
fn motion(random: &mut Random, places: &Places, start: &[DVec3], keys: usize) -> Positions {
    let (style, far) = (random.below(7), places.scale * random.pick(&[1e-6, 0.01, 0.1, 0.5, 2.0, 30.0]));
    let (axis, shift, once) = (random.vec().normalize_or(DVec3::Z), random.vec() * far, random.below(keys));
    // Triangles of a soup keep their shape with this.
    let ways: Vec<DVec3> = start.iter().map(|_| random.vec() * far).collect();
    let phase = |key: usize| key as f64 / (keys.max(2) - 1) as f64;
    let mut at = |key: usize, i: usize| match style {
        0 => start[i],
        1 => start[i] + shift * phase(key),
        2 => start[i] + ways[i / 3] * phase(key),
        3 => places.offset + DQuat::from_axis_angle(axis, 3.0 * phase(key)) * (start[i] - places.offset),
        4 => start[i] + random.vec() * far,
        5 if key == once => start[i] + ways[i / 3],
        5 => start[i],
        _ => places.place(random),
    };
    (0..keys).map(|key| (0..start.len()).map(|i| at(key, i)).collect()).collect()
}

fn mesh(random: &mut Random, places: &Places, n: usize) -> TriangleMesh {
    let keys = random.pick(&[1, 1, 2, 2, 2, 3, 5, 9, 17, 65]);
    let (indices, start) = shape(random, places, n.min(40_000 / keys));
    let mut keys = motion(random, places, &start, keys);
    if random.one_in(6) {
        keys = refined(random, keys, 40_000 / (start.len() + 1), places.scale);
    }
    if random.one_in(6) {
        // A vertex that no triangle has, far away.
        let most = DVec3::splat(9e29);
        let unused = (random.vec() * places.scale * random.power(0, 15)).clamp(-most, most);
        keys.iter_mut().for_each(|key| key.push(unused));
    }
    let mesh = match random.below(6) {
        0 => TriangleMesh::new(indices, Keys::F64(keys)),
        1 => TriangleMesh::new(indices, Keys::Precise(keys)),
        _ => TriangleMesh::new(indices, in_f32(keys)),
    };
    let active = if random.one_in(4) { random.interval() } else { TimeInterval::FULL };
    let mesh = mesh.with_active(active).with_mask(mask(random));
    if random.one_in(5) { mesh.keep_keys() } else { mesh }
}

fn mask(random: &mut Random) -> u32 {
    random.pick(&[u32::MAX, u32::MAX, 0b01, 0b10, 0b110, 0])
}

/// A sphere, with all bits or with any `masks`.
fn ball(random: &mut Random, places: &Places, masks: bool) -> MovingSphere {
    let keys = random.pick(&[1, 1, 2, 2, 3, 9, 17]);
    let bends = random.pick(&[1, 2, keys]);
    let (at, by) = (places.place(random), random.vec() * places.scale * random.pick(&[0.0, 0.1, 2.0]));
    let radius = places.scale * random.pick(&[0.0, 1e-3, 0.05, 0.05, 0.3, 2.0, -0.1]);
    let swell = random.pick(&[0.0, 0.0, 1.0, -2.0]);
    let mut key = |i: usize| {
        let bent = if bends == keys { random.vec() * places.scale * 0.1 } else { DVec3::ZERO };
        (at + by * i as f64 / keys as f64 + bent, radius + radius * swell * (i * bends / keys % 3) as f64)
    };
    let keys: Vec<_> = (0..keys).map(&mut key).collect();
    let active = if random.one_in(5) { random.interval() } else { TimeInterval::FULL };
    let ball = MovingSphere::new(keys).with_active(active);
    if masks { ball.with_mask(mask(random)) } else { ball }
}

impl Scene {
    /// At most so many primitives in all, with coordinates up to a power of ten.
    pub fn random(random: &mut Random, most: usize, power: i32) -> Scene {
        let places = Places::random(random, power);
        let meshes = random.pick(&[0, 1, 1, 1, 2, 2, 3, 5, 12]);
        let most = random.count(most);
        let smaller = random.pick(&[0, 0, 0, 0, 3, 30, 58]);
        let own = |random: &mut Random| Places { scale: places.scale * random.power(-smaller, 0), ..places };
        let meshes = (0..meshes).map(|_| {
            let n = random.below(most + 1) / random.pick(&[1, 2, 8]);
            let own = own(random);
            mesh(random, &own, n)
        });
        let meshes = meshes.collect::<Vec<_>>();
        let balls = if meshes.is_empty() || random.one_in(2) { random.below(most.min(2000) + 1) } else { 0 };
        let (hidden, masks) = (random.pick(&[1, 3, usize::MAX]), random.one_in(2));
        let balls = (0..balls).map(|_| {
            let own = own(random);
            (ball(random, &own, masks), random.one_in(hidden))
        });
        let balls = balls.collect();
        Scene { meshes, balls, places }
    }

    pub fn len(&self) -> usize {
        self.balls.len() + self.meshes.iter().map(TriangleMesh::len).sum::<usize>()
    }

    /// The meshes and indices of all primitives that exist at a time, in order.
    pub fn exist_at(&self, time: f32) -> Vec<(u32, u32)> {
        let meshes = (0u32..).zip(&self.meshes).filter(|(_, mesh)| mesh.active.contains(time));
        let triangles = meshes.flat_map(|(i, mesh)| (0..mesh.len() as u32).map(move |triangle| (i, triangle)));
        let balls = (0u32..).zip(&self.balls).filter(|(_, (ball, _))| ball.active.contains(time));
        triangles.chain(balls.map(|(i, _)| (self.meshes.len() as u32, i))).collect()
    }

    pub fn shapes(&self) -> Vec<Shape> {
        let shape = |(ball, own): &(MovingSphere, bool)| {
            if *own { Shape::custom(Blob::hidden(ball.clone())) } else { Shape::from(ball.clone()) }
        };
        self.balls.iter().map(shape).collect()
    }

    /// Whether some shape has a type that a file cannot hold.
    pub fn has_custom_shapes(&self) -> bool {
        self.balls.iter().any(|(_, own)| *own)
    }

    /// A point on some primitive at a time: a corner, on an edge, inside, or the center of a sphere.
    pub fn target(&self, random: &mut Random, time: f32) -> DVec3 {
        let filled: Vec<&TriangleMesh> = self.meshes.iter().filter(|mesh| !mesh.is_empty()).collect();
        if filled.is_empty() || (!self.balls.is_empty() && random.one_in(4)) {
            let ball = self.balls.get(random.below(self.balls.len()));
            return ball.map_or(DVec3::ZERO, |(ball, _)| ball.at(time.clamp(0.0, 1.0)).0);
        }
        let mesh = random.pick(&filled);
        let segments = (mesh.keys.len() - 1) as f32;
        let along = if time.is_nan() { 0.0 } else { time.clamp(0.0, 1.0) * segments };
        let (key, phase) = (along as usize, f64::from(along.fract()));
        let at = |i: u32, key: usize| match &mesh.keys {
            Keys::F32(keys) => keys[key][i as usize].as_dvec3(),
            Keys::F64(keys) | Keys::Precise(keys) => keys[key][i as usize],
        };
        let corner = |i: u32| at(i, key) + (at(i, (key + 1).min(mesh.keys.len() - 1)) - at(i, key)) * phase;
        let [a, b, c] = mesh.indices[random.below(mesh.len())].map(corner);
        let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
        match random.below(6) {
            0 => a,
            1 => (a + b) * 0.5,
            2 => a + (b - a) * u,
            _ => a + (b - a) * (u * (1.0 - v)) + (c - a) * v,
        }
    }

    /// The next frame, and which meshes differ.
    pub fn moved(&self, random: &mut Random) -> (Scene, Vec<usize>) {
        let (mut next, mut differ) = (self.clone(), Vec::new());
        let share = random.pick(&[1, 1, 2, 4]);
        let (far, all) = (self.places.scale * random.pick(&[1e-3, 0.1, 1.0]), random.one_in(6));
        let away = if all { random.vec() * self.places.scale * random.pick(&[3.0, 100.0]) } else { DVec3::ZERO };
        for (i, mesh) in next.meshes.iter_mut().enumerate() {
            if !all && !random.one_in(share) {
                continue;
            }
            differ.push(i);
            let mut to = positions(&mesh.keys);
            match random.below(6) {
                // As it is, or of one piece.
                0 => to.iter_mut().flatten().for_each(|p| *p += away),
                1 => to = motion(random, &self.places, &to[0], to.len()),
                2 => to.iter_mut().flatten().for_each(|p| *p = self.places.offset + away),
                3 => to.truncate(1),
                4 => to.reverse(),
                _ => to.iter_mut().flatten().for_each(|p| *p += random.vec() * far + away),
            }
            mesh.keys = like(&mesh.keys, to);
            if random.one_in(4) {
                mesh.active = if random.one_in(2) { random.interval() } else { TimeInterval::FULL };
            }
            if random.one_in(4) {
                mesh.mask = random.pick(&[u32::MAX, 1, 2, 0]);
            }
        }
        (next, differ)
    }

    /// Other spheres in the same number.
    pub fn with_other_balls(mut self, random: &mut Random) -> Scene {
        let (places, masks) = (self.places, random.one_in(2));
        self.balls.iter_mut().for_each(|(of, _)| *of = ball(random, &places, masks));
        self
    }
}

/// Parameters of wide trees.
pub fn wide(random: &mut Random) -> WideParams {
    let parts = 2 + random.below(15);
    WideParams {
        max_references: random.pick(&[1.0, 1.58, 1.58, 3.0, 8.0]),
        bytes_per_primitive: random.pick(&[1024.0, 1024.0, 1024.0, 128.0, 300.0, 1e6]),
        division: match random.below(6) {
            0 => Division::Whole,
            1 => Division::SharedLeaves(parts),
            2 => Division::SeparateTrees(parts),
            _ => Division::Automatic,
        },
    }
}

/// Parameters of any kind of tree.
pub fn params(random: &mut Random) -> BuildParams {
    match random.below(5) {
        0 => BuildParams::lazy(LazyParams {
            wide: wide(random),
            subtree: random.pick(&[1, 2, 5, 16, 17, 64, 300, 2048, 65536]),
        }),
        1 => BuildParams::kd(KdParams {
            intervals: !random.one_in(4),
            plane_time: random.pick(&[0.0, 0.5, 1.0, 0.1, 0.9]),
            time_weighted: random.one_in(2),
            propagated_vote: random.one_in(2),
            moving_planes: random.one_in(2),
            empty_factor: random.pick(&[0.8, 1.0, 0.1]),
            max_depth: random.pick(&[None, None, Some(0), Some(3), Some(60)]),
            max_references: random.pick(&[1.0, 2.0, 8.0, 8.0, 100.0]),
            ..KdParams::default()
        }),
        _ => BuildParams::wide(wide(random)),
    }
}

/// Whether valid parameters and a valid scene may give this error.
pub fn is_documented(error: &BuildError) -> bool {
    matches!(error, BuildError::OverBudget { .. } | BuildError::TooManyReferences)
}
