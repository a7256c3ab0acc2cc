//! Watertightness of closed moving meshes: a ray that begins inside must hit, in any direction.
//!
//! There are two kinds of meshes. **Balls** with moving vertices: origins are used only if every face is seen from its
//! inner side with a margin, so that each ray leaves through exactly one point. **Rooms** with a built-in corner, which
//! rotate and grow: there, planes and edges of walls extend into the room, and rays run along them.

use super::special_time;
use mbkd::glam::{DMat3, DVec3, Vec3};
use mbkd::{Hit, Ray, RayTree, TriangleMesh};
use mbkd_scenes::Random;
use std::collections::HashMap;

/// The targets of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatertightKind {
    /// A corner.
    Vertex,
    /// A point of an edge.
    Edge,
    /// Any direction.
    Anywhere,
    /// Along a wall, in its plane (rooms).
    Plane,
    /// Along edges of a wall (rooms).
    AlongEdge,
}

/// A ray that left the mesh without a hit.
#[derive(Clone, Copy, Debug)]
pub struct Leak {
    /// The ray.
    pub ray: Ray,
    /// Its target.
    pub kind: WatertightKind,
}

/// A closed moving mesh, and other meshes of its scene.
pub struct ClosedMesh {
    /// For messages.
    pub name: String,
    /// The closed mesh is the first.
    pub meshes: Vec<TriangleMesh>,
    /// Positions at the keys, as given.
    keys: Vec<Vec<DVec3>>,
    shape: Shape,
    scale: f64,
}

enum Shape {
    Ball,
    /// The affine maps of the keys.
    Room(Vec<(DMat3, DVec3)>),
}

/// The least distance of an origin from all faces, in sizes.
const ROOM_TO_SPARE: f64 = 0.02;

/// The precision in which vertices are given.
#[derive(Clone, Copy, PartialEq)]
enum In {
    F32,
    F64,
    /// As f64, and stored so ([`TriangleMesh::precise`]).
    Kept,
}

/// The meshes of the long run.
pub fn closed_meshes(seed: u64) -> Vec<ClosedMesh> {
    let mut random = Random(seed);
    let mut all = Vec::new();
    let mut ball = |name: &str, rings, keys, at: (f64, f64), given| {
        all.push(closed_ball(name, rings, keys, at, given, &mut random));
    };
    ball("ball, 1 key", 12, 1, (1.0, 0.0), In::F32);
    ball("ball, 2 keys", 12, 2, (1.0, 0.0), In::F32);
    ball("ball, 3 keys", 24, 3, (1.0, 0.0), In::F32);
    ball("ball, 17 keys", 10, 17, (1.0, 0.0), In::F32);
    ball("ball, 257 keys", 6, 257, (1.0, 0.0), In::F32);
    ball("octahedron", 2, 2, (1.0, 0.0), In::F32);
    ball("ball of size 1e-12", 10, 2, (1e-12, 0.0), In::F32);
    ball("ball of size 1e12", 10, 2, (1e12, 0.0), In::F32);
    ball("ball 1000 sizes away", 10, 3, (1.0, 1e3), In::F32);
    ball("ball 1e6 sizes away, f64", 10, 2, (1.0, 1e6), In::F64);
    ball("ball of 0.01 beside a ground of 1e4", 12, 2, (0.01, 0.0), In::F32);
    ball("ball of 0.01 beside a ground of 1e7", 12, 2, (0.01, 0.0), In::F32);
    let first = all.len() - 2;
    for (closed, half) in all[first..].iter_mut().zip([1e4f32, 1e7]) {
        let corner = |x: f32, y: f32| Vec3::new(x * half, y * half, -0.05);
        let ground = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        closed.meshes.push(TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], ground));
    }
    all.push(room("room, 1 key", 1, &mut random));
    all.push(room("room, 2 keys", 2, &mut random));
    all.push(room("room, 5 keys", 5, &mut random));
    let mut kept = |name, keys, at| all.push(closed_ball(name, 10, keys, at, In::Kept, &mut random));
    kept("ball 1e6 sizes away, kept in f64", 2, (1.0, 1e6));
    kept("ball of 0.001 1e7 away from another, kept in f64", 3, (1e-3, 1e10));
    if let Some(closed) = all.last_mut() {
        let at_zero = vec![vec![DVec3::ZERO, DVec3::X * 1e-3, DVec3::Y * 1e-3]];
        closed.meshes.push(TriangleMesh::new(vec![[0, 1, 2]], at_zero).precise());
    }
    all
}

fn mesh_of(indices: Vec<[u32; 3]>, keys: &mut Vec<Vec<DVec3>>, given: In) -> TriangleMesh {
    match given {
        In::F32 => {}
        In::F64 => return TriangleMesh::new(indices, keys.clone()),
        In::Kept => return TriangleMesh::new(indices, keys.clone()).precise(),
    }
    let rounded: Vec<Vec<Vec3>> = keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
    *keys = rounded.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect();
    TriangleMesh::new(indices, rounded)
}

fn closed_ball(name: &str, rings: usize, keys: usize, at: (f64, f64), given: In, random: &mut Random) -> ClosedMesh {
    let (scale, offset) = at;
    let center = DVec3::splat(scale * offset);
    let around = 2 * rings;
    let mut base = vec![DVec3::Z, DVec3::NEG_Z];
    for ring in 1..rings {
        let polar = core::f64::consts::PI * ring as f64 / rings as f64;
        for i in 0..around {
            let turn = core::f64::consts::TAU * i as f64 / around as f64;
            base.push(DVec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()));
        }
    }
    // Small enough that the thin triangles at the poles do not fold over, in addition to a motion of the whole.
    let wobble = 0.1 / (rings * rings) as f64;
    let key = |_| {
        let (displacement, stretch) = (random.dvec() * 0.3, 1.0 + random.dvec() * 0.2);
        base.iter().map(|p| center + ((*p + random.dvec() * wobble) * stretch + displacement) * scale).collect()
    };
    let mut keys: Vec<Vec<DVec3>> = (0..keys).map(key).collect();
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
    let mesh = mesh_of(indices, &mut keys, given);
    ClosedMesh { name: name.into(), meshes: vec![mesh], keys, shape: Shape::Ball, scale }
}

/// Cells of a room along each axis; a quarter of them is filled.
const CELLS: i32 = 4;

/// The room [-1, 1]³ without x > 0, y > 0, of square tiles, rotated and stretched at each key.
fn room(name: &str, keys: usize, random: &mut Random) -> ClosedMesh {
    let inside = |c: [i32; 3]| c.iter().all(|c| (0..CELLS).contains(c)) && !(c[0] >= CELLS / 2 && c[1] >= CELLS / 2);
    let (mut base, mut numbers, mut indices) = (Vec::new(), HashMap::new(), Vec::new());
    let mut number = |corner: [i32; 3]| {
        *numbers.entry(corner).or_insert_with(|| {
            base.push(DVec3::from_array(corner.map(|c| f64::from(c) * 2.0 / f64::from(CELLS) - 1.0)));
            base.len() as u32 - 1
        })
    };
    for cell in 0..CELLS.pow(3) {
        let cell = [cell % CELLS, cell / CELLS % CELLS, cell / CELLS / CELLS];
        for (axis, sign) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
            let mut beyond = cell;
            beyond[axis] += sign;
            if !inside(cell) || inside(beyond) {
                continue;
            }
            let corner = |u: i32, v: i32| {
                let mut corner = cell;
                corner[axis] += i32::from(sign > 0);
                corner[(axis + 1) % 3] += u;
                corner[(axis + 2) % 3] += v;
                corner
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)].map(&mut number);
            indices.extend([[a, b, c], [a, c, d]]);
        }
    }
    let map = |key: usize| {
        if key == 0 {
            // Unchanged, so that planes and edges are met exactly.
            return (DMat3::IDENTITY, DVec3::ZERO);
        }
        let axis = random.dvec().normalize_or(DVec3::Z);
        (DMat3::from_axis_angle(axis, 0.3 * random.unit_f64()) * (1.0 + 0.2 * random.signed_f64()), random.dvec() * 0.2)
    };
    let maps: Vec<(DMat3, DVec3)> = (0..keys).map(map).collect();
    let mut keys = maps.iter().map(|(m, v)| base.iter().map(|p| *m * *p + *v).collect()).collect();
    let mesh = mesh_of(indices, &mut keys, In::F32);
    let shape = Shape::Room(maps);
    ClosedMesh { name: name.into(), meshes: vec![mesh], keys, shape, scale: 1.0 }
}

/// The value between two keys, in f64.
fn between<T: Copy>(keys: &[T], time: f32, mix: impl Fn(T, T, f64) -> T) -> T {
    if keys.len() < 2 {
        return keys[0];
    }
    let at = f64::from(time) * (keys.len() - 1) as f64;
    let segment = (at as usize).min(keys.len() - 2);
    mix(keys[segment], keys[segment + 1], at - segment as f64)
}

impl ClosedMesh {
    /// All vertices at a time.
    fn vertices(&self, time: f32) -> Vec<DVec3> {
        let vertex = |v: usize| {
            if self.keys.len() < 2 {
                return self.keys[0][v];
            }
            let at = f64::from(time) * (self.keys.len() - 1) as f64;
            let segment = (at as usize).min(self.keys.len() - 2);
            let (a, b) = (self.keys[segment][v], self.keys[segment + 1][v]);
            a + (b - a) * (at - segment as f64)
        };
        (0..self.keys[0].len()).map(vertex).collect()
    }

    /// Whether every face shows its inner side to a point, with a margin.
    fn sees_all_faces(&self, vertices: &[DVec3], point: DVec3) -> bool {
        self.meshes[0].indices.iter().all(|indices| {
            let [a, b, c] = indices.map(|v| vertices[v as usize] - point);
            let normal = (b - a).cross(c - a);
            a.dot(normal) > ROOM_TO_SPARE * self.scale * normal.length()
        })
    }

    /// Rays at one time from one origin; fewer or none if the origin is unsuitable.
    fn rays(&self, random: &mut Random, count: usize) -> Vec<(Ray, WatertightKind)> {
        let time = special_time(random, self.keys.len());
        let vertices = self.vertices(time);
        let mut rays = Vec::with_capacity(count);
        match &self.shape {
            Shape::Ball => {
                let middle = (vertices[0] + vertices[1]) * 0.5;
                let origin = middle + random.dvec() * (0.25 * self.scale);
                if !self.sees_all_faces(&vertices, origin) {
                    return rays;
                }
                for _ in 0..count {
                    rays.push(self.ray_at_something(origin, time, &vertices, random));
                }
            }
            Shape::Room(maps) => {
                let mix = |a: (DMat3, DVec3), b: (DMat3, DVec3), w: f64| {
                    (a.0 * (1.0 - w) + b.0 * w, a.1 * (1.0 - w) + b.1 * w)
                };
                let (m, v) = between(maps, time, mix);
                let place = |p: DVec3| m * p + v;
                for i in 0..count {
                    // In the part of the room from which every ray sees walls only, away from all of them.
                    let p = random.dvec() * 0.3 - DVec3::new(0.5, 0.5, 0.0);
                    if i % 2 == 0 {
                        rays.push(self.ray_at_something(place(p), time, &vertices, random));
                        continue;
                    }
                    // In the plane x = 0 of the built-in corner, or that of y = 0.
                    let edge = f64::from(random.below(3) as i32 - 1) * 0.5;
                    let (along, kind) = if random.below(2) == 0 {
                        (DVec3::Y, WatertightKind::AlongEdge)
                    } else {
                        (DVec3::new(0.0, 1.0, random.signed_f64() * 0.5), WatertightKind::Plane)
                    };
                    let (mut p, mut d) = (DVec3::new(0.0, p.y, edge), along);
                    if random.below(2) == 0 {
                        (p, d) = (DVec3::new(p.y, p.x, p.z), DVec3::new(d.y, d.x, d.z));
                    }
                    rays.push((Ray::new(place(p), (m * d).as_vec3()).at_time(time), kind));
                }
            }
        }
        rays
    }

    fn ray_at_something(
        &self,
        origin: DVec3,
        time: f32,
        vertices: &[DVec3],
        random: &mut Random,
    ) -> (Ray, WatertightKind) {
        let [a, b, c] = self.meshes[0].indices[random.below(self.meshes[0].indices.len())];
        let [a, b, c] = [a, b, c].map(|v| vertices[v as usize]);
        let (kind, target) = match random.below(8) {
            0..=2 => (WatertightKind::Vertex, a),
            3 | 4 => (WatertightKind::Edge, a + (b - a) * random.unit_f64()),
            5 | 6 => (WatertightKind::Edge, b + (c - b) * random.unit_f64()),
            _ => (WatertightKind::Anywhere, origin + random.dvec() * self.scale),
        };
        (Ray::new(origin, ((target - origin) / self.scale).as_vec3()).at_time(time), kind)
    }
}

/// Traces about `count` rays from inside, the same for each of some trees; returns their number, and for each tree
/// those without a hit.
pub fn shoot(closed: &ClosedMesh, trees: &[RayTree], count: usize, seed: u64) -> (usize, Vec<Vec<Leak>>) {
    /// Rays per origin.
    const TOGETHER: usize = 64;
    let mut random = Random(seed);
    let (mut shot, mut leaks) = (0, vec![Vec::new(); trees.len()]);
    for _ in 0..count.div_ceil(TOGETHER) {
        for (ray, kind) in closed.rays(&mut random, TOGETHER) {
            shot += 1;
            if ray.dir == Vec3::ZERO {
                continue;
            }
            let escapes = |hit: Option<Hit>| hit.is_none_or(|hit| hit.mesh != 0);
            for (tree, leaks) in trees.iter().zip(&mut leaks) {
                if escapes(tree.closest_hit(&ray)) || !tree.any_hit(&ray) {
                    leaks.push(Leak { ray, kind });
                }
            }
        }
    }
    (shot, leaks)
}
