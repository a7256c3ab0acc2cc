//! Helpers of several test files: random numbers, triangle soups, critical rays, and the comparison with
//! brute force.
#![allow(dead_code)] // each test file uses its part

#[path = "../support/blob.rs"]
mod blob;

pub use crate::scene::Random;
pub use blob::Blob;
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Division, Hit, KdParams, Keys, LazyParams, Ray, RayTree, TriangleMesh, WideParams};

/// Every policy under test, and the paper's policy in all its variants.
pub fn variants() -> Vec<BuildParams> {
    vec![
        BuildParams::default(),
        BuildParams::kd(KdParams::default()),
        BuildParams::paper(),
        BuildParams::kd(KdParams {
            time_weighted: false,
            propagated_vote: false,
            plane_time: 0.0,
            ..KdParams::paper()
        }),
        BuildParams::kd(KdParams { propagated_vote: false, plane_time: 1.0, max_references: 2.0, ..KdParams::paper() }),
        BuildParams::kd(KdParams::classic()),
        BuildParams::lazy(LazyParams { subtree: 5, ..LazyParams::default() }),
    ]
}

/// The default with this division of the shutter.
pub fn divided(division: Division) -> BuildParams {
    BuildParams::wide(WideParams { division, ..WideParams::default() })
}

/// Loose triangles of about `size`, each moving independently by up to `motion`, at `keys` keys.
pub fn soup(n: usize, keys: usize, size: f32, motion: f32, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let mut positions = vec![Vec::new(); keys];
    for _ in 0..n {
        let mut center = random.vec();
        let corners = [random.vec() * size, random.vec() * size, random.vec() * size];
        for key in &mut positions {
            key.extend(corners.map(|c| center + c + random.vec() * 0.1 * motion));
            center += random.vec() * motion;
        }
    }
    let indices = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh::new(indices, positions)
}

/// A mesh in f32 with each of its positions mapped.
pub fn mapped(mesh: &TriangleMesh, mut map: impl FnMut(Vec3) -> Vec3) -> TriangleMesh {
    let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
    let keys: Vec<Vec<Vec3>> = keys.iter().map(|key| key.iter().map(|&p| map(p)).collect()).collect();
    TriangleMesh { keys: keys.into(), ..mesh.clone() }
}

/// The keys of a mesh in f32, with each position mapped to one in f64.
pub fn mapped_to_f64(mesh: &TriangleMesh, mut map: impl FnMut(DVec3) -> DVec3) -> Vec<Vec<DVec3>> {
    let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
    keys.iter().map(|key| key.iter().map(|p| map(p.as_dvec3())).collect()).collect()
}

/// The bytes of a tree's file.
pub fn saved(tree: &RayTree) -> Result<Vec<u8>, mbkd::FileError> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).map(|()| bytes)
}

/// A ray from around the scene (half-size `reach` about the origin) to somewhere in it.
pub fn random_ray(random: &mut Random, reach: f32) -> Ray {
    let origin = random.vec() * reach * 2.0;
    let target = random.vec() * reach;
    Ray::new(origin, target - origin).at_time(random.unit())
}

/// All hits as a sorted list.
pub fn all_hits(tree: &RayTree, ray: &Ray) -> Vec<Hit> {
    let mut hits = Vec::new();
    let flow = tree.all_hits(ray, |hit| {
        hits.push(hit);
        ControlFlow::Continue(())
    });
    assert!(flow.is_continue());
    hits.sort_by_key(|hit| (hit.mesh, hit.primitive));
    hits
}

/// A tree for each of the [`variants`].
pub fn trees(build: impl Fn(&BuildParams) -> RayTree) -> Vec<(BuildParams, RayTree)> {
    variants().into_iter().map(|params| (params, build(&params))).collect()
}

/// Compares the answers of all trees to a ray with brute force, which is computed once.
pub fn assert_equal(trees: &[(BuildParams, RayTree)], oracle: &BruteForce, ray: &Ray) {
    let expected = oracle.all_hits(ray);
    for (params, tree) in trees {
        assert_eq!(difference_from(tree, &expected, ray), None, "{params:?}");
    }
}

/// The difference between the tree's answers to a ray and brute force, if any.
pub fn difference(tree: &RayTree, oracle: &BruteForce, ray: &Ray) -> Option<String> {
    difference_from(tree, &oracle.all_hits(ray), ray)
}

/// The difference between the tree's answers to a ray and the list of all hits, in order of (mesh, primitive).
fn difference_from(tree: &RayTree, oracle: &[Hit], ray: &Ray) -> Option<String> {
    let closest = oracle.iter().copied().reduce(|a, b| if b.t < a.t { b } else { a });
    let same = |a: &Option<Hit>, b: &Option<Hit>| a.map(bits) == b.map(bits);
    let got = tree.closest_hit(ray);
    if !same(&got, &closest) {
        return Some(format!("closest hit of {ray:?}: {got:?} instead of {closest:?}"));
    }
    if tree.any_hit(ray) == oracle.is_empty() {
        return Some(format!("any hit of {ray:?}: {} with {} hits", oracle.is_empty(), oracle.len()));
    }
    let all = all_hits(tree, ray);
    if all.iter().copied().map(bits).ne(oracle.iter().copied().map(bits)) {
        return Some(format!("all hits of {ray:?}: {all:?} instead of {oracle:?}"));
    }
    None
}

/// A hit for exact comparison.
pub fn bits(hit: Hit) -> [u32; 5] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.mesh, hit.primitive]
}

/// A world position on a grid.
pub fn grid(x: i8, y: i8, z: i8) -> Vec3 {
    Vec3::new(f32::from(x), f32::from(y), f32::from(z))
}

/// A closed surface: a sphere of 2 * n * n quads' halves, its vertices displaced by `wobble` at each of `keys` keys.
pub fn closed_sphere(n: usize, keys: usize, wobble: f32, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let rings = n + 1;
    let around = 2 * n;
    // Poles once, rings of vertices between.
    let mut base = vec![Vec3::Z, Vec3::NEG_Z];
    for ring in 1..rings - 1 {
        let polar = core::f32::consts::PI * ring as f32 / (rings - 1) as f32;
        for i in 0..around {
            let turn = core::f32::consts::TAU * i as f32 / around as f32;
            base.push(Vec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()));
        }
    }
    let positions: Vec<Vec<Vec3>> =
        (0..keys).map(|_| base.iter().map(|p| *p + random.vec() * wobble).collect()).collect();
    let vertex = |ring: usize, i: usize| match ring {
        0 => 0,
        r if r == rings - 1 => 1,
        r => (2 + (r - 1) * around + i % around) as u32,
    };
    let mut indices = Vec::new();
    for ring in 0..rings - 1 {
        for i in 0..around {
            let (a, b) = (vertex(ring, i), vertex(ring, i + 1));
            let (c, d) = (vertex(ring + 1, i), vertex(ring + 1, i + 1));
            if ring > 0 {
                indices.push([a, c, b]);
            }
            if ring < rings - 2 {
                indices.push([b, c, d]);
            }
        }
    }
    TriangleMesh::new(indices, positions)
}
