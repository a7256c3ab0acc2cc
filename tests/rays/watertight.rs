//! Closed moving meshes do not leak: rays from inside, aimed at edges and vertices at random times, always hit.
//! The long run of the same is `cargo run --release --example accuracy -- --rays 1000000000`.

use crate::common::{Random, closed_sphere, variants};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Hit, Ray, RayTree};

/// Rays per mesh and variant; altogether a million.
const RAYS: usize = 1_000_000;

#[test]
fn a_million_rays_at_edges_and_vertices_from_inside() {
    let meshes =
        [(closed_sphere(12, 2, 0.15, 1), 0.0), (closed_sphere(24, 3, 0.1, 2), 0.0), (closed_sphere(8, 4, 0.2, 3), 5e4)];
    let variants = variants();
    let each = RAYS.div_ceil(meshes.len() * variants.len());
    let mut tested = 0;
    for (m, (mesh, away)) in meshes.iter().enumerate() {
        // One of them far from zero, where f32 is coarse.
        let mbkd::Keys::F32(keys) = &mesh.keys else { unreachable!() };
        let away = DVec3::splat(*away);
        let keys: Vec<Vec<DVec3>> = keys.iter().map(|key| key.iter().map(|p| p.as_dvec3() + away).collect()).collect();
        let mesh = mbkd::TriangleMesh::new(mesh.indices.clone(), keys);
        for (v, params) in variants.iter().enumerate() {
            let tree = RayTree::build(std::slice::from_ref(&mesh), params).unwrap();
            let mut random = Random((m * 100 + v) as u64);
            for i in 0..each {
                let triangle = random.below(mesh.len());
                let time = random.unit();
                let hit = Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive: triangle as u32 };
                let corners = tree.vertices(&hit, time);
                let w = f64::from(random.unit());
                let target = if i % 2 == 0 { corners[0] } else { corners[0] + (corners[1] - corners[0]) * w };
                let origin = away + random.vec().as_dvec3() * 0.2;
                let ray = Ray::new(origin, (target - origin).as_vec3()).at_time(time);
                assert!(tree.any_hit(&ray), "leak: mesh {m}, {params:?}, {ray:?}");
                tested += 1;
            }
        }
    }
    assert!(tested >= RAYS);
}

#[test]
fn leaks_through_a_hole_are_detected() {
    // The check can fail: one triangle is removed.
    let mut mesh = closed_sphere(12, 2, 0.1, 1);
    mesh.indices.remove(40);
    let tree = RayTree::build(&[mesh], &variants()[0]).unwrap();
    let mut random = Random(1);
    let leaks = (0..20_000).filter(|_| !tree.any_hit(&Ray::new(Vec3::ZERO, random.vec()).at_time(0.5))).count();
    assert!(leaks > 0);
}
