//! Vertices that no triangle has change nothing but the memory of a mesh.

use super::common::{Random, bits, mapped_to_f64, soup, variants};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, ClosestPointQuery, Hit, LazyParams, Ray, RayTree, TriangleMesh, WideParams};

/// A mesh of one of the kinds of keys, with `unused` vertices behind its own.
fn mesh_of(like: &TriangleMesh, mut keys: Vec<Vec<DVec3>>, unused: &[DVec3], kind: usize) -> TriangleMesh {
    keys.iter_mut().for_each(|key| key.extend(unused));
    match kind {
        0 => {
            let narrow = |key: &Vec<DVec3>| key.iter().map(|p| p.as_vec3()).collect();
            TriangleMesh::new(like.indices.to_vec(), keys.iter().map(narrow).collect::<Vec<Vec<Vec3>>>())
        }
        1 => TriangleMesh::new(like.indices.to_vec(), keys),
        _ => TriangleMesh::new(like.indices.to_vec(), keys).precise(),
    }
}

#[test]
fn scenes_are_the_same_with_and_without_unused_vertices() {
    let mut random = Random(45);
    let mut policies = variants();
    policies.push(BuildParams::lazy(LazyParams::default()));
    policies.push(BuildParams::wide(WideParams::default()));
    let mut found = 0;
    for round in 0..72 {
        let (kind, count) = (round % 3, [1, 20, 300][round / 3 % 3]);
        let size = [1.0, 1e-18, 1e6][round % 5 % 3];
        let far = [1e3, 1e9, 1e29][round / 9 % 3];
        let at = DVec3::new(0.3, -1.0, 0.7) * size * [0.0, 5.0][round / 2 % 2];
        let unused = [DVec3::splat(far), DVec3::new(-far, 0.0, 3.0)];
        let keys = [1, 2, 5][round / 4 % 3];
        let frames = [0, 1].map(|seed| soup(count, keys, 0.4, 0.2, 2 * round as u64 + seed));
        let [with, without] = [&unused[..], &[]].map(|unused| {
            frames.each_ref().map(|frame| vec![mesh_of(frame, mapped_to_f64(frame, |p| p * size + at), unused, kind)])
        });
        let params = &policies[round % policies.len()];
        let mut trees = [&with, &without].map(|meshes| RayTree::build(&meshes[0], params).unwrap());
        for frame in 0..2 {
            if frame == 1 {
                // Another frame of the same triangles, where trees can be refitted.
                let refits = [0, 1].map(|i| trees[i].refit(&[&with, &without][i][1]));
                assert_eq!(refits[0], refits[1]);
                if refits[0].is_err() {
                    continue;
                }
            }
            let [a, b] = &trees;
            assert_eq!(a.bounds(), b.bounds(), "round {round}");
            for _ in 0..60 {
                let to = at + random.vec().as_dvec3() * size;
                let origin = at + random.vec().as_dvec3() * size * 3.0;
                let ray = Ray::new(origin, ((to - origin) / size).as_vec3()).at_time(random.unit());
                let [of_a, of_b]: [Option<Hit>; 2] = [a, b].map(|tree| tree.closest_hit(&ray));
                assert_eq!(of_a.map(bits), of_b.map(bits), "round {round}, {ray:?}");
                let [near_a, near_b] = [a, b].map(|tree| tree.closest_point(&ClosestPointQuery::new(origin, ray.time)));
                assert_eq!(near_a, near_b, "round {round}, {origin}");
                found += usize::from(of_a.is_some());
            }
        }
    }
    assert!(found > 500, "{found}");
}

#[test]
fn meshes_without_triangles_do_not_count() {
    let triangle = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    let cloud = TriangleMesh::fixed(vec![], vec![Vec3::splat(1e20), Vec3::NEG_X]);
    let alone = RayTree::build(std::slice::from_ref(&triangle), &BuildParams::default()).unwrap();
    let both = RayTree::build(&[cloud.clone(), triangle], &BuildParams::default()).unwrap();
    assert_eq!(both.bounds(), alone.bounds());
    let ray = Ray::new(Vec3::new(0.2, 0.3, 1.0), Vec3::NEG_Z);
    assert_eq!(both.closest_hit(&ray).map(|hit| (hit.mesh, hit.t)), Some((1, 1.0)));
    assert_eq!(RayTree::build(&[cloud], &BuildParams::default()).unwrap().bounds(), None);
}
