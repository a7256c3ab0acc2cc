//! Closest points on moving triangles: our queries, and Embree's point queries with a callback in f32, in alternation.

use crate::configs;
use crate::ffi::{Embree, EmbreeScene, PointQuery};
use crate::options::{Isa, Mode, Options};
use crate::ours::Ours;
use glam::Vec3;
use mbkd::{ClosestPointQuery, TriangleMesh, glam};
use mbkd_evidence::triangles::{bounds, corners, positions};
use mbkd_evidence::turns::{Checksum, in_turns};
use mbkd_scenes::Scene;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::borrow::Cow;

/// Distances of query points near a surface, at most, and the greatest distance of such queries that have one; relative to the
/// scene's size.
const OFFSET: f32 = 0.01;
const WITHIN: f32 = 0.02;

/// The distances of far points, in sizes of the scene.
const FAR: std::ops::Range<f32> = 2.0..5.0;

/// Allowance for the rounding of Embree's side, in units of f32's relative precision, of the coordinates and of the distance.
const ULPS: f32 = 64.0;

/// Prints a table: a row for each scene and instruction set, with the ratios for each kind of query points.
pub fn measure(options: &Options, embree: &Embree) -> Result<(), String> {
    println!("| closest points | near a surface | near, within 0.02 | in the box | far away | differ |");
    println!("|---|---:|---:|---:|---:|---:|");
    for name in &options.scenes {
        let scene = crate::scene(options, name)?;
        for &isa in &options.isa {
            println!("| {name}, {isa:?} | {} |", one(options, embree, &scene, isa)?);
        }
    }
    println!("Embree's time with its best configuration / ours; queries whose distances differ by more than rounding.");
    Ok(())
}

fn one(options: &Options, embree: &Embree, scene: &Scene, isa: Isa) -> Result<String, String> {
    let ours = Ours::alone(&scene.meshes, isa)?;
    let meshes = Meshes(scene.meshes.iter().map(|mesh| (mesh.indices.as_slice(), positions(mesh))).collect());
    let queries = queries(&scene.meshes, options.side * options.side);
    let mut best = [f64::INFINITY; 4];
    let (mut differ, mut number) = (0, 0);
    // The configurations of the fast mode include those of the robust one.
    for (at, config) in configs::all(&scene.meshes, Mode::Fast).into_iter().enumerate() {
        if !options.wants(&config.name()) {
            continue;
        }
        eprintln!("  {}: closest points, {isa:?}, {}", scene.name, config.name());
        let device = embree.device(&config.settings(1, (isa == Isa::Avx2).then_some("avx2")))?;
        let theirs = config.scene(&device, &scene.meshes, Mode::Fast)?;
        theirs.commit()?;
        for (queries, best) in queries.iter().zip(&mut best) {
            let native: Vec<PointQuery> = queries.iter().map(native).collect();
            let answer_ours = || {
                let mut sum = Checksum::default();
                for query in queries {
                    if let Some(near) = ours.closest_point(query) {
                        sum.found([near.mesh, near.primitive], f64::from(near.distance) + near.point.x);
                    }
                }
                sum
            };
            let answer_theirs = || {
                let mut sum = Checksum::default();
                for query in &native {
                    if let Some(near) = meshes.closest_point(&theirs, query) {
                        sum.found(near.id, f64::from(near.distance + near.point.x));
                    }
                }
                sum
            };
            *best = best.min(in_turns(options.runs, Some(&answer_ours), Some(&answer_theirs)).ratio);
            if at == 0 {
                let distances = |(query, native): (&ClosestPointQuery, &PointQuery)| {
                    let theirs = meshes.closest_point(&theirs, native).map(|near| near.distance);
                    (query.point, ours.closest_point(query).map(|near| near.distance), theirs)
                };
                number += queries.len();
                differ += queries.iter().zip(&native).map(distances).filter(|answers| !agree(answers, &meshes)).count();
            }
        }
    }
    let [near, within, inside, far] = best;
    Ok(format!("{near:.2} | {within:.2} | {inside:.2} | {far:.2} | {differ} of {number}"))
}

/// Whether two distances from a point are the same up to rounding, or one is missing and the other within rounding of the greatest
/// distance.
fn agree((point, ours, theirs): &(glam::DVec3, Option<f32>, Option<f32>), meshes: &Meshes<'_>) -> bool {
    let size = meshes.largest() + point.abs().max_element() as f32;
    let within = |a: f32, b: f32| (a - b).abs() <= ULPS * 0.5 * f32::EPSILON * (size + a);
    match (*ours, *theirs) {
        (Some(a), Some(b)) => within(a, b),
        (None, None) => true,
        (Some(_), None) | (None, Some(_)) => false,
    }
}

/// The four kinds of queries, each at a time of its own.
fn queries(meshes: &[TriangleMesh], count: u32) -> [Vec<ClosestPointQuery>; 4] {
    let mut random = StdRng::seed_from_u64(11);
    let (min, max) = bounds(meshes);
    let (middle, size) = ((min + max) * 0.5, (max - min).length());
    let triangles: Vec<[u32; 2]> =
        (0..).zip(meshes).flat_map(|(i, mesh)| (0..mesh.len() as u32).map(move |triangle| [i, triangle])).collect();
    let mut near = Vec::new();
    for _ in 0..count {
        let [mesh, triangle] = triangles[random.random_range(0..triangles.len())];
        let time = random.random();
        let [a, b, c] = corners(meshes, mesh, triangle, time);
        let [u, v] = [random.random::<f64>(), random.random::<f64>()];
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let surface = (a + (b - a) * u + (c - a) * v).as_vec3();
        near.push(ClosestPointQuery::new(surface + vec(&mut random) * (OFFSET * size), time));
    }
    let within = near.iter().map(|query| query.within(WITHIN * size)).collect();
    let inside = (0..count)
        .map(|_| ClosestPointQuery::new(middle + (max - min) * 0.5 * vec(&mut random), random.random()))
        .collect();
    let far = (0..count)
        .map(|_| {
            let away = vec(&mut random).normalize_or(Vec3::X) * (size * random.random_range(FAR));
            ClosestPointQuery::new(middle + away, random.random())
        })
        .collect();
    [near, within, inside, far]
}

fn vec(random: &mut StdRng) -> Vec3 {
    Vec3::from([0; 3].map(|_| random.random_range(-1.0..1.0)))
}

fn native(query: &ClosestPointQuery) -> PointQuery {
    PointQuery { point: query.point.as_vec3().to_array(), time: query.time, radius: query.max_distance }
}

/// The triangles and keys of the meshes, from which the callback interpolates.
struct Meshes<'a>(Vec<Mesh<'a>>);

/// Indices and keys.
type Mesh<'a> = (&'a [[u32; 3]], Vec<Cow<'a, [Vec3]>>);

/// Embree's answer.
struct Near {
    distance: f32,
    /// Mesh and triangle.
    id: [u32; 2],
    point: Vec3,
}

impl Meshes<'_> {
    /// The largest coordinate.
    fn largest(&self) -> f32 {
        let keys = self.0.iter().flat_map(|(_, keys)| keys);
        keys.flat_map(|key| key.iter()).fold(0.0, |most, p| p.abs().max_element().max(most))
    }

    /// The closest point that Embree finds with the callback of its tutorial.
    #[inline]
    fn closest_point(&self, scene: &EmbreeScene<'_>, query: &PointQuery) -> Option<Near> {
        let mut best = None;
        let from = Vec3::from_array(query.point);
        scene.visit_near(query, |query, mesh, triangle| {
            let point = closest_on_triangle(from, self.corners(mesh, triangle, query.time));
            let distance = (point - from).length();
            (distance < query.radius).then(|| {
                best = Some(Near { distance, id: [mesh, triangle], point });
                distance
            })
        });
        best
    }

    /// The corners of a triangle at a time.
    #[inline(always)]
    fn corners(&self, mesh: u32, triangle: u32, time: f32) -> [Vec3; 3] {
        let (indices, keys) = &self.0[mesh as usize];
        let vertices = indices[triangle as usize].map(|vertex| vertex as usize);
        let segments = keys.len() - 1;
        if segments == 0 {
            return vertices.map(|vertex| keys[0][vertex]);
        }
        let at = time * segments as f32;
        let first = (at as usize).min(segments - 1);
        let (from, to) = (&keys[first], &keys[first + 1]);
        vertices.map(|vertex| from[vertex].lerp(to[vertex], at - first as f32))
    }
}

/// Ericson, *Real-Time Collision Detection*, section 5.1.5.
#[inline(always)]
fn closest_on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let denominator = 1.0 / (va + vb + vc);
    a + ab * (vb * denominator) + ac * (vc * denominator)
}
