//! Refits that are told which meshes moved: the tree is that of a refit to all meshes, and what stays is not read.

use crate::brute_force::Brick;
use crate::common::{Random, closed_sphere, difference, divided, random_ray, saved, soup};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildError, BuildParams, Division, Keys, MovingSphere, Ray, RayTree, RefitError, Shape, TimeInterval, TriangleMesh,
};

/// The same mesh with every vertex moved by up to `by`.
fn moved(mesh: &TriangleMesh, by: f32, random: &mut Random) -> TriangleMesh {
    fn map<P: Copy>(keys: &[Vec<P>], mut f: impl FnMut(P) -> P) -> Vec<Vec<P>> {
        keys.iter().map(|key| key.iter().map(|&p| f(p)).collect()).collect()
    }
    let keys: Keys = match &mesh.keys {
        Keys::F32(keys) => map(keys, |p| p + random.vec() * by).into(),
        Keys::F64(keys) => map(keys, |p| p + (random.vec() * by).as_dvec3()).into(),
        Keys::Precise(keys) => Keys::Precise(map(keys, |p| p + (random.vec() * by).as_dvec3())),
    };
    TriangleMesh { keys, ..mesh.clone() }
}

/// A mesh in f64, with a vertex that no triangle uses.
fn in_f64(mesh: &TriangleMesh, precise: bool) -> TriangleMesh {
    let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
    let fine = |p: &Vec3| p.as_dvec3() * (1.0 + 1e-12);
    let keys: Vec<Vec<DVec3>> = keys.iter().map(|key| key.iter().map(fine).chain([DVec3::ZERO]).collect()).collect();
    let mesh = TriangleMesh::new(mesh.indices.clone(), keys);
    if precise { mesh.precise() } else { mesh }
}

/// Many small meshes that share leaf blocks, of all kinds, and a few larger ones. Every third exists for a part of the shutter.
fn meshes(seed: u64) -> Vec<TriangleMesh> {
    let mut meshes = vec![closed_sphere(12, 1, 0.02, 4), closed_sphere(9, 2, 0.05, 5), closed_sphere(9, 5, 0.05, 6)];
    for i in 0..40 {
        let keys = [1, 2, 2, 3, 5][i % 5];
        let small = soup(1 + i % 7, keys, 0.3, 0.2, seed + i as u64);
        meshes.push(match i % 4 {
            1 if i % 3 == 0 => in_f64(&small, true),
            2 if i % 3 == 0 => in_f64(&small, false),
            _ => small,
        });
    }
    for mesh in meshes.iter_mut().step_by(3) {
        mesh.active = TimeInterval::new(0.2, 0.6).unwrap();
    }
    meshes
}

fn shapes() -> Vec<Shape> {
    let mut random = Random(3);
    let mut ball = || Shape::from(MovingSphere::new(vec![(random.vec().as_dvec3(), 0.1), (DVec3::ZERO, 0.05)]));
    let mut shapes: Vec<Shape> = (0..20).map(|_| ball()).collect();
    shapes.push(Shape::custom(Brick::new(DVec3::X, 0.3)));
    shapes
}

#[test]
fn a_tree_that_is_told_what_moved_is_that_of_a_refit_to_all_meshes() {
    let divisions = [Division::Automatic, Division::Whole, Division::SharedLeaves(4), Division::SeparateTrees(3)];
    for (division, with_shapes) in divisions.into_iter().flat_map(|division| [(division, false), (division, true)]) {
        let params = divided(division);
        let given = || if with_shapes { shapes() } else { Vec::new() };
        let mut random = Random(7);
        let mut now = meshes(100);
        let mut told = RayTree::of_scene(&now, given(), &params).unwrap();
        let mut all = RayTree::of_scene(&now, given(), &params).unwrap();
        for frame in 0..12 {
            let what = format!("{division:?}, shapes: {with_shapes}, frame {frame}");
            let chosen: Vec<usize> = match frame % 4 {
                0 => vec![(random.unit() * now.len() as f32) as usize],
                1 => (0..now.len()).filter(|_| random.unit() < 0.1).collect(),
                2 => (3..now.len()).step_by(5).rev().collect(),
                // Not one, one twice, and nearly all.
                _ => (0..now.len() - 1).chain([0]).collect(),
            };
            for &i in &chosen {
                // In some frames one mesh leaves tree space, and comes back.
                let far = if frame == 5 && i == chosen[0] { 9.0 } else { 0.1 };
                now[i] = moved(&now[i], far, &mut random).with_mask(1 << (random.unit() * 9.0) as u32);
                if frame > 8 {
                    let [begin, end] = if i % 3 == 0 { [0.3, 0.5] } else { [0.1, 0.9] };
                    now[i].active = TimeInterval::new(begin, end).unwrap();
                }
            }
            let (refit, to_all) = match (told.refit_moved(&now, &chosen), all.refit(&now)) {
                (Ok(refit), Ok(to_all)) => (refit, to_all),
                (refit, to_all) => panic!("{what}: {refit:?}, {to_all:?}"),
            };
            // Shapes always count as changed by a refit to everything.
            let written = [refit, to_all].map(|refit| (refit.nodes, refit.leaves));
            assert!(written[0] == written[1] || with_shapes && written[0] <= written[1], "{what}: {written:?}");
            // Boxes are larger by their rounding once they are read from the tree.
            assert!((refit.cost / to_all.cost - 1.0).abs() < 1e-4, "{what}: {refit:?}, {to_all:?}");
            assert!(refit.nodes > 0 || chosen.is_empty(), "{what}");
            assert_eq!(told.validate(), Ok(()), "{what}");
            assert!(with_shapes || saved(&told).unwrap() == saved(&all).unwrap(), "{what}");
            let oracle = BruteForce::of_scene(&now, given()).unwrap();
            for _ in 0..60 {
                let ray = random_ray(&mut random, 1.5);
                assert_eq!(difference(&told, &oracle, &ray), None, "{what}");
                let masked = |tree: &RayTree| tree.closest_hit_filtered(&ray, 0b110, |_| true);
                assert_eq!(masked(&told), masked(&all), "{what}");
            }
            for mesh in 0..now.len() as u32 {
                assert_eq!(told.triangle(mesh, 0, 0.3), all.triangle(mesh, 0, 0.3), "{what}");
            }
        }
    }
}

/// Shapes may move as well, to other keys and beyond tree space too.
#[test]
fn shapes_move_with_the_meshes_that_are_named() {
    for division in [Division::Automatic, Division::SharedLeaves(4), Division::SeparateTrees(3)] {
        let params = divided(division);
        let mut random = Random(17);
        let mut now: Vec<TriangleMesh> = meshes(200).into_iter().chain([closed_sphere(60, 2, 0.02, 9)]).collect();
        let balls = |frame: usize| -> Vec<Shape> {
            let mut random = Random(3 + frame as u64);
            let far = if frame == 4 { 9.0 } else { 1.0 };
            let mut key = || (random.vec().as_dvec3() * far, 0.1);
            let keys = if frame == 6 { 3 } else { 2 };
            let mut ball = || Shape::from(MovingSphere::new((0..keys).map(|_| key()).collect()));
            (0..20).map(|_| ball()).chain([Shape::custom(Brick::new(DVec3::X * far, 0.3))]).collect()
        };
        let mut told = RayTree::of_scene(&now, balls(0), &params).unwrap();
        let mut all = RayTree::of_scene(&now, balls(0), &params).unwrap();
        for frame in 1..9 {
            let what = format!("{division:?}, frame {frame}");
            let chosen: Vec<usize> = (0..now.len() - 1).filter(|_| random.unit() < 0.05).collect();
            for &i in &chosen {
                now[i] = moved(&now[i], 0.1, &mut random);
            }
            let refit = told.refit_moved_with_shapes(&now, &chosen, balls(frame)).unwrap();
            let to_all = all.refit_with_shapes(&now, balls(frame)).unwrap();
            assert_eq!((refit.nodes, refit.leaves), (to_all.nodes, to_all.leaves), "{what}");
            // The sphere of 14 000 triangles is visited by the first refit, and where tree space changes.
            assert!(refit.skipped > 0 || [1, 4, 5].contains(&frame), "{what}: {refit:?}");
            assert_eq!(told.validate(), Ok(()), "{what}");
            let oracle = BruteForce::of_scene(&now, balls(frame)).unwrap();
            for _ in 0..60 {
                assert_eq!(difference(&told, &oracle, &random_ray(&mut random, 1.5)), None, "{what}");
            }
        }
        let none = now.len();
        let error = told.refit_moved_with_shapes(&now, &[none], balls(0)).unwrap_err();
        assert_eq!(error, RefitError::NoMesh { mesh: none, meshes: none });
    }
}

/// Large enough for nodes above the subtrees that are skipped, some of which have leaf blocks as children.
#[test]
fn a_refit_of_nothing_leaves_the_tree_as_it_is() {
    let now = [closed_sphere(60, 2, 0.2, 1), closed_sphere(60, 5, 0.2, 2)];
    for division in [Division::Whole, Division::SharedLeaves(8), Division::SharedLeaves(3), Division::SeparateTrees(3)]
    {
        let mut tree = RayTree::build(&now, &divided(division)).unwrap();
        let before = saved(&tree).unwrap();
        for moved in [&[][..], &[0], &[1], &[]] {
            let refit = tree.refit_moved(&now, moved).unwrap();
            assert_eq!((refit.nodes, refit.leaves), (0, 0), "{division:?}, {moved:?}");
            assert!((refit.cost - 1.0).abs() < 1e-6, "{division:?}, {moved:?}: {refit:?}");
            assert!(saved(&tree).unwrap() == before, "{division:?}, {moved:?}");
        }
    }
}

#[test]
fn what_stays_is_not_read_but_for_what_shares_a_leaf_block_with_what_moves() {
    let spoiled = |mesh: &TriangleMesh| {
        let keys = vec![vec![Vec3::NAN; mesh.len() * 3]; 2];
        TriangleMesh { keys: keys.into(), ..mesh.clone() }
    };
    // Apart from each other, so that they share no block.
    let far = |mesh: TriangleMesh, by: Vec3| {
        let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
        let keys: Vec<Vec<Vec3>> = keys.iter().map(|key| key.iter().map(|&p| p * 0.1 + by).collect()).collect();
        TriangleMesh { keys: keys.into(), ..mesh }
    };
    let mut now = vec![closed_sphere(40, 1, 0.01, 1), far(soup(16, 2, 0.3, 0.1, 2), Vec3::splat(3.0))];
    let mut tree = RayTree::build(&now, &BuildParams::default()).unwrap();
    tree.refit(&now).unwrap();
    let mut random = Random(5);
    now[1] = moved(&now[1], 0.01, &mut random);
    let refit = tree.refit_moved(&[spoiled(&now[0]), now[1].clone()], &[1]).unwrap();
    assert!(refit.leaves > 0 && refit.skipped > 0, "{refit:?}");
    let oracle = BruteForce::new(&now).unwrap();
    for _ in 0..200 {
        let ray = random_ray(&mut random, 3.0);
        assert_eq!(difference(&tree, &oracle, &ray), None);
    }

    // Two meshes in one leaf block.
    let apart = |seed: u64| far(soup(3, 2, 0.3, 0.1, seed), Vec3::splat(3.0));
    let pair = vec![apart(3), apart(4), closed_sphere(20, 1, 0.01, 1)];
    let mut tree = RayTree::build(&pair, &BuildParams::default()).unwrap();
    tree.refit(&pair).unwrap();
    let before = saved(&tree).unwrap();
    let no_vertices = TriangleMesh { keys: vec![Vec::<Vec3>::new()].into(), ..pair[0].clone() };
    let no_keys = TriangleMesh { keys: Vec::<Vec<Vec3>>::new().into(), ..pair[0].clone() };
    let cases = [
        (spoiled(&pair[0]), BuildError::NonFinite { mesh: 0, key: 0, vertex: 0 }),
        (no_vertices, BuildError::IndexOutOfRange { mesh: 0, triangle: 0, index: 0, vertices: 0 }),
        (no_keys, BuildError::NoKeys { mesh: 0 }),
    ];
    for (bad, error) in cases {
        let given = [bad, moved(&pair[1], 0.1, &mut random), pair[2].clone()];
        assert_eq!(tree.refit_moved(&given, &[1]), Err(RefitError::Input(error)));
        assert!(saved(&tree).unwrap() == before);
    }
}

#[test]
fn incompatible_meshes_are_rejected_and_change_nothing() {
    let now = meshes(100);
    let mut tree = RayTree::build(&now, &BuildParams::default()).unwrap();
    tree.refit(&now).unwrap();
    let before = saved(&tree).unwrap();
    let with = |i: usize, mesh: TriangleMesh| {
        let mut meshes = now.clone();
        meshes[i] = mesh;
        meshes
    };
    let mut turned = now[0].clone();
    turned.indices[17].swap(0, 1);
    let precise = now.iter().position(|mesh| matches!(mesh.keys, Keys::Precise(_))).unwrap();
    let coarse = TriangleMesh { keys: Keys::F64(vec![vec![DVec3::X; 40]]), ..now[precise].clone() };
    let cases = [
        (now[1..].to_vec(), 0, RefitError::Count { expected: now.len(), found: now.len() - 1 }),
        (with(0, turned), 0, RefitError::Topology { mesh: 0 }),
        // Also of a mesh that is said to stay.
        (with(9, soup(1, 1, 0.2, 0.2, 2)), 0, RefitError::Topology { mesh: 9 }),
        (with(1, closed_sphere(9, 3, 0.05, 5)), 1, RefitError::Keys { mesh: 1, expected: 2, found: 3 }),
        (with(precise, coarse), precise, RefitError::Precision { mesh: precise }),
        (
            with(1, TriangleMesh { keys: vec![vec![Vec3::INFINITY; 400]; 2].into(), ..now[1].clone() }),
            1,
            RefitError::Input(BuildError::NonFinite { mesh: 1, key: 0, vertex: 0 }),
        ),
    ];
    for (meshes, moved, error) in cases {
        assert_eq!(tree.refit_moved(&meshes, &[moved]), Err(error));
        assert!(saved(&tree).unwrap() == before);
    }
    assert_eq!(tree.refit_moved(&now, &[now.len()]), Err(RefitError::NoMesh { mesh: now.len(), meshes: now.len() }));

    // More vertices that no triangle uses change nothing.
    let Keys::Precise(keys) = &now[precise].keys else { panic!("precise") };
    let more: Vec<Vec<DVec3>> = keys.iter().map(|key| [key.as_slice(), &[DVec3::X; 9]].concat()).collect();
    let meshes = with(precise, TriangleMesh { keys: Keys::Precise(more), ..now[precise].clone() });
    let refit = tree.refit_moved(&meshes, &[precise]).unwrap();
    assert_eq!((refit.nodes, refit.leaves), (0, 0));
    let oracle = BruteForce::new(&meshes).unwrap();
    let mut random = Random(8);
    for _ in 0..200 {
        assert_eq!(difference(&tree, &oracle, &random_ray(&mut random, 1.5)), None);
    }
}

/// A mesh that exists throughout when the tree is built, and for a part of the shutter in the next frame.
#[test]
fn a_mesh_whose_interval_a_refit_makes_shorter_is_not_hit_outside_of_it() {
    let at =
        |x: f32| TriangleMesh::fixed(vec![[0, 1, 2]], [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::X * x).to_vec());
    let mut meshes: Vec<TriangleMesh> = (0..40).map(|i| at(2.0 * i as f32)).collect();
    let mut tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
    tree.refit(&meshes).unwrap();
    meshes[5] = meshes[5].clone().with_active(TimeInterval::new(0.2, 0.5).unwrap());
    tree.refit_moved(&meshes, &[5]).unwrap();
    for (time, expected) in [(0.1, false), (0.3, true), (0.8, false)] {
        let ray = Ray::new(Vec3::new(10.2, 0.2, 1.0), Vec3::NEG_Z).at_time(time);
        assert_eq!((tree.any_hit(&ray), tree.closest_hit(&ray).is_some()), (expected, expected), "at {time}");
    }
}
