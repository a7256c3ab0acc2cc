//! Refits of trees whose long triangles were split before the build: they stay split wherever they move.

use crate::common::{Random, difference, mapped};
use crate::scene;
use mbkd::baseline::BruteForce;
use mbkd::glam::{Mat3, Vec3};
use mbkd::{BuildParams, Counters, Division, Keys, Policy, Ray, RayTree, TimeInterval, TriangleMesh, WideParams};

fn now_ray(camera: &scene::Camera, random: &mut Random) -> Ray {
    camera.ray(random.unit(), random.unit(), 1.0, random.unit())
}

/// Thin triangles in all directions, as long as the cube is wide in which they lie, with some keys on bent paths; and small ones
/// between them.
fn needles(count: usize, keys: usize, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let mut at: Vec<Vec<Vec3>> = vec![Vec::new(); keys];
    for i in 0..count {
        let size = if i % 3 == 0 { 0.02 } else { 1.0 };
        let (a, along, thick) = (random.vec(), random.vec() * size, random.vec() * 4e-3);
        for key in &mut at {
            let by = random.vec() * if keys > 1 { 0.02 } else { 0.0 };
            key.extend([a + by, a + along + by, a + 0.5 * along + thick + by]);
        }
    }
    TriangleMesh::new((0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), at)
}

/// A ray through a point of a triangle, often one on an edge.
fn aimed(mesh: &TriangleMesh, random: &mut Random) -> Ray {
    let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
    let triangle = mesh.indices[(random.unit() * mesh.indices.len() as f32) as usize % mesh.indices.len()];
    let time = random.unit();
    let at = time * (keys.len() - 1) as f32;
    let (key, w) = (at as usize, at.fract());
    let next = (key + 1).min(keys.len() - 1);
    let [a, b, c] = triangle.map(|vertex| keys[key][vertex as usize].lerp(keys[next][vertex as usize], w));
    let (u, on_edge) = (random.unit(), random.unit() < 0.5);
    let v = if on_edge { 0.0 } else { (1.0 - u) * random.unit() };
    let target = a * (1.0 - u - v) + b * u + c * v;
    let dir = random.vec();
    Ray::new(target - dir * 2.0, dir).at_time(time)
}

fn steps(tree: &RayTree, rays: &[Ray]) -> f64 {
    let mut counters = Counters::default();
    for ray in rays {
        tree.closest_hit_observed(ray, &mut counters);
    }
    (counters.steps() + counters.primitive_tests) as f64
}

#[test]
fn refitted_trees_of_split_triangles_find_every_hit_and_stay_good() {
    for (keys, precise) in [(1, false), (2, false), (4, false), (2, true)] {
        for division in [Division::Automatic, Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(2)] {
            let what = format!("{keys} keys, precise {precise}, {division:?}");
            let wide = WideParams { division, ..WideParams::default() };
            let as_asked = |mesh: &TriangleMesh| {
                if !precise {
                    return mesh.clone();
                }
                let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
                let keys: Vec<Vec<_>> = keys.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect();
                TriangleMesh::new(mesh.indices.clone(), keys).precise()
            };
            let mut random = Random(7);
            let first = needles(900, keys, 3);
            let mut tree = RayTree::build(&[as_asked(&first)], &BuildParams::wide(wide)).unwrap();
            let turn = Mat3::from_rotation_z(0.4);
            let mut jitter = Random(11);
            let motions: [&mut dyn FnMut(Vec3) -> Vec3; 4] = [
                &mut |p| p + 0.01,
                &mut |p| p + jitter.vec() * 0.03,
                &mut |p| turn * p + Vec3::new(0.3, 0.0, 5.0),
                &mut |p| p * Vec3::new(3.0, 0.5, -1.0),
            ];
            for (motion, to) in motions.into_iter().enumerate() {
                let now = mapped(&first, to);
                let given = [as_asked(&now)];
                let refit = tree.refit(&given).unwrap();
                assert_eq!(tree.validate(), Ok(()), "{what}");
                let oracle = BruteForce::new(&given).unwrap();
                let rays: Vec<Ray> = (0..200).map(|_| aimed(&now, &mut random)).collect();
                for ray in &rays {
                    assert_eq!(difference(&tree, &oracle, ray), None, "{what}, motion {motion}");
                }
                // What turns, or is stretched along the axes, is where a new tree divides it otherwise.
                let most = [1.15, 1.5, 1.6, 1.6][motion];
                let fresh = RayTree::build(&given, &BuildParams::wide(wide)).unwrap();
                let worse = steps(&tree, &rays) / steps(&fresh, &rays);
                assert!(worse < most, "{what}, motion {motion}: {worse} times the work of a new tree, {refit:?}");
            }
        }
    }
}

#[test]
fn parts_are_found_where_triangles_exist_whose_intervals_end_where_slices_do() {
    let ends = [(0.0, 0.25), (0.25, 0.5), (0.1, 0.75), (0.5, 1.0), (0.0, 1.0), (0.25, 0.75)];
    let active = |mesh: TriangleMesh, i: usize| mesh.with_active(TimeInterval::new(ends[i].0, ends[i].1).unwrap());
    for (division, keys) in
        [(Division::SharedLeaves(4), 2), (Division::SharedLeaves(4), 3), (Division::SeparateTrees(4), 2)]
    {
        let meshes: Vec<TriangleMesh> = (0..ends.len()).map(|i| active(needles(200, keys, i as u64), i)).collect();
        let wide = WideParams { division, ..WideParams::default() };
        let mut tree = RayTree::build(&meshes, &BuildParams::wide(wide)).unwrap();
        assert!(tree.statistics().references > 1300, "{}", tree.statistics().references);
        let mut random = Random(5);
        for by in [0.01, 3.0] {
            let now: Vec<TriangleMesh> = meshes.iter().map(|mesh| mapped(mesh, |p| p * 1.1 + by)).collect();
            tree.refit(&now).unwrap();
            let oracle = BruteForce::new(&now).unwrap();
            for i in 0..1500 {
                let ray = aimed(&now[i % now.len()], &mut random);
                assert_eq!(difference(&tree, &oracle, &ray), None, "{division:?}, {keys} keys");
            }
        }
    }
}

#[test]
fn needles_of_a_scene_stay_split() {
    let needles = scene::find("needles").unwrap();
    let first = (needles.make)(5000);
    let mut tree = RayTree::build(&first.meshes, &BuildParams::default()).unwrap();
    assert!(tree.statistics().references > 6000, "cut into {} references", tree.statistics().references);
    let refit = tree.refit(&first.meshes).unwrap();
    assert_eq!((refit.nodes, refit.leaves, refit.skipped, refit.cost), (0, 0, 0, 1.0));
    let mut random = Random(2);
    let now: Vec<TriangleMesh> = first.meshes.iter().map(|mesh| mapped(mesh, |p| p + random.vec() * 1e-4)).collect();
    let refit = tree.refit(&now).unwrap();
    assert!(refit.cost < 1.12, "{refit:?}");
    let oracle = BruteForce::new(&now).unwrap();
    let rays: Vec<Ray> = (0..200).map(|_| now_ray(&first.camera, &mut random)).collect();
    for ray in &rays {
        assert_eq!(difference(&tree, &oracle, ray), None);
    }
    // Without splits rays do more work, and so they would if the boxes of parts were those of whole triangles.
    let params = BuildParams { policy: Policy::Wide(WideParams { max_references: 1.0, ..WideParams::default() }) };
    let whole = RayTree::build(&now, &params).unwrap();
    assert!(steps(&tree, &rays) < 0.9 * steps(&whole, &rays));
}
