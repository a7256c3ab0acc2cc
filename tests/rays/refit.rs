//! Refitted trees against brute force over the new positions, frame by frame.

use crate::brute_force::Brick;
use crate::common::{Random, closed_sphere, difference, divided, mapped, random_ray, saved, soup};
use crate::scene;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildError, BuildParams, Counters, Division, KdParams, Keys, MovingSphere, Ray, RayTree, Refit, RefitError, Shape,
    TriangleMesh,
};
use std::ops::ControlFlow;

/// All divisions of the shutter.
fn params() -> Vec<BuildParams> {
    let divisions = [Division::Automatic, Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(2)];
    divisions.map(divided).into()
}

/// A mesh whose vertices went elsewhere: each its own way, and all of them.
fn moved(mesh: &TriangleMesh, jitter: f32, by: Vec3, grown: f32, random: &mut Random) -> TriangleMesh {
    mapped(mesh, |p| p * grown + by + random.vec() * jitter)
}

/// Checks that a tree is valid and answers like brute force over these meshes.
fn agrees(tree: &RayTree, meshes: &[TriangleMesh], rays: &[Ray], what: &str) {
    assert_eq!(tree.validate(), Ok(()), "{what}");
    let oracle = BruteForce::new(meshes).unwrap();
    for ray in rays {
        assert_eq!(difference(tree, &oracle, ray), None, "{what}");
    }
    // Corners come out of leaf blocks: those of all kinds are as another tree has them.
    let other = RayTree::build(meshes, &BuildParams::default()).unwrap();
    for (i, mesh) in meshes.iter().enumerate() {
        for triangle in (0..mesh.len() as u32).step_by(7) {
            let of = |tree: &RayTree| tree.triangle(i as u32, triangle, 0.3);
            assert_eq!(of(tree), of(&other), "{what}");
        }
    }
}

fn rays(count: usize, reach: f32, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..count).map(|_| random_ray(&mut random, reach)).collect()
}

/// Meshes of all kinds of leaf blocks: static and moving, with separate and shared vertices, of two keys and more.
fn meshes() -> Vec<TriangleMesh> {
    vec![
        soup(200, 1, 0.2, 0.0, 1),
        soup(200, 2, 0.2, 0.2, 2),
        soup(100, 4, 0.2, 0.2, 3),
        closed_sphere(9, 1, 0.02, 4),
        closed_sphere(9, 2, 0.05, 5),
        closed_sphere(9, 5, 0.05, 6),
        soup(3, 2, 0.3, 0.1, 7),
    ]
}

#[test]
fn all_kinds_of_blocks_and_divisions_are_refitted_and_equal_brute_force() {
    for params in params() {
        let mut random = Random(3);
        let mut now = meshes();
        let mut tree = RayTree::build(&now, &params).unwrap();
        for frame in 0..12 {
            let what = format!("{params:?}, frame {frame}");
            // Some meshes are unchanged; some frames grow beyond tree space, shrink, or leave the origin; some return.
            for (i, mesh) in now.iter_mut().enumerate() {
                let (by, grown) = match frame % 6 {
                    2 => (Vec3::X * 0.5, 1.7),
                    3 => (Vec3::splat(40.0), 1.0),
                    4 => (Vec3::splat(-40.0), 0.6),
                    _ => (random.vec() * 0.1, 1.0),
                };
                if (i + frame) % 3 != 0 || frame % 6 == 3 || frame % 6 == 4 {
                    *mesh = moved(mesh, 0.03, by, grown, &mut random);
                }
            }
            let refit = tree.refit(&now).unwrap();
            assert!(refit.leaves > 0 && refit.cost.is_finite() && refit.cost > 0.0, "{what}: {refit:?}");
            let reach = if frame % 6 == 3 { 42.0 } else { 1.5 };
            agrees(&tree, &now, &rays(150, reach, frame as u64), &what);
        }
    }
}

#[test]
fn a_hundred_frames_of_a_running_figure_equal_brute_force() {
    for keys in [2, 5] {
        let frame = |i: usize| scene::walking_from(12_000, keys, 0.5 * i as f32 - 30.0);
        let first = frame(0);
        let mut tree = RayTree::build(&first.meshes, &BuildParams::default()).unwrap();
        let figure = [first.meshes.len() - 2, first.meshes.len() - 1];
        let mut random = Random(11);
        for i in 1..=100 {
            let now = frame(i);
            // Alternately all meshes, and those that move.
            let refit = if i % 2 == 0 { tree.refit(&now.meshes) } else { tree.refit_moved(&now.meshes, &figure) };
            let refit = refit.unwrap();
            assert_eq!(refit.skipped > 0, i % 2 == 1, "frame {i}: {refit:?}");
            assert_eq!(tree.validate(), Ok(()), "frame {i}");
            let oracle = BruteForce::new(&now.meshes).unwrap();
            let feet = Vec3::new(0.25, 0.9, 2.1 + 0.12 * (0.5 * i as f32 - 30.0));
            for j in 0..24 {
                let time = random.unit();
                let ray = match j % 2 {
                    0 => now.camera.ray(random.unit(), random.unit(), 1.0, time),
                    _ => Ray::new(
                        now.camera.view(0.0).position,
                        feet + random.vec() * 0.6 - now.camera.view(0.0).position,
                    )
                    .at_time(time),
                };
                assert_eq!(difference(&tree, &oracle, &ray), None, "{keys} keys, frame {i}");
            }
        }
    }
}

#[test]
fn spheres_and_bricks_are_refitted() {
    let shapes = |frame: usize| -> Vec<Shape> {
        let mut random = Random(9);
        let off = DVec3::new(0.1, -0.05, 0.2) * frame as f64;
        let mut place = || random.vec().as_dvec3() + off;
        (0..60)
            .map(|i| match i % 6 {
                3 => Shape::custom(Brick::new(place(), 0.3)),
                // Some move in some frames only.
                4 if frame.is_multiple_of(2) => MovingSphere::fixed(place(), 0.1).into(),
                _ => MovingSphere::new(vec![(place(), 0.1), (place(), 0.05)]).into(),
            })
            .collect()
    };
    let balls = |frame: usize| -> Vec<MovingSphere> {
        let mut random = Random(5);
        let mut place = || random.vec().as_dvec3() + DVec3::X * 0.3 * frame as f64;
        (0..300).map(|_| MovingSphere::new(vec![(place(), 0.02), (place(), 0.05)])).collect()
    };
    for params in params() {
        let mut random = Random(6);
        let mut now = meshes();
        let mut tree = RayTree::of_scene(&now, shapes(0), &params).unwrap();
        let mut of_balls = RayTree::of_scene(&[], balls(0), &params).unwrap();
        for frame in 1..6 {
            let rays = rays(100, 1.5, frame as u64);
            now[2] = moved(&now[2], 0.05, Vec3::ZERO, 1.0, &mut random);
            tree.refit_with_shapes(&now, shapes(frame)).unwrap();
            now[4] = moved(&now[4], 0.05, Vec3::ZERO, 1.0, &mut random);
            // The shapes are unchanged.
            let refit = tree.refit_moved(&now, &[4]).unwrap();
            assert!(refit.leaves > 0 && refit.leaves < tree.statistics().leaves / 2, "{params:?}: {refit:?}");
            assert_eq!(tree.validate(), Ok(()));
            let oracle = BruteForce::of_scene(&now, shapes(frame)).unwrap();
            of_balls.refit_with_shapes(&[], balls(frame)).unwrap();
            assert_eq!(of_balls.validate(), Ok(()));
            let of_balls_oracle = BruteForce::of_scene(&[], balls(frame)).unwrap();
            for ray in &rays {
                assert_eq!(difference(&tree, &oracle, ray), None, "{params:?}, frame {frame}");
                assert_eq!(difference(&of_balls, &of_balls_oracle, ray), None, "{params:?}, frame {frame}");
            }
        }
        let refused = tree.refit_with_shapes(&now, shapes(0).split_off(1)).unwrap_err();
        assert_eq!(refused, RefitError::Shapes { expected: 60, found: 59 });
        assert_eq!(
            of_balls.refit_with_shapes(&[], Vec::<MovingSphere>::new()).unwrap_err(),
            RefitError::Shapes { expected: 300, found: 0 }
        );
    }
}

#[test]
fn static_blocks_are_not_written_and_blocks_known_to_be_static_not_visited() {
    let asset = closed_sphere(60, 1, 0.001, 1);
    let cube = |x: f32| {
        let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 0.1;
        let key = |x: f32| (0..8).map(|i| corner(i) + Vec3::new(x, 1.5, 0.0)).collect::<Vec<Vec3>>();
        let faces = [[0u32, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]];
        TriangleMesh::new(faces.to_vec(), vec![key(x), key(x + 0.1)])
    };
    let mut meshes = vec![asset, cube(0.0), soup(5, 1, 0.1, 0.0, 1)];
    let mut tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
    let mut again = RayTree::build(&meshes, &BuildParams::default()).unwrap();
    let before = tree.statistics();
    let blocks = before.nodes + before.leaves;
    for frame in 1..5 {
        meshes[1] = cube(0.2 * frame as f32);
        let told = tree.refit_moved(&meshes, &[1]).unwrap();
        let found = again.refit(&meshes).unwrap();
        // The leaf blocks of six triangles, and the nodes above.
        for refit in [told, found] {
            assert!((1..=6).contains(&refit.leaves) && refit.nodes <= 6 * before.depth as usize, "{refit:?}");
            assert_eq!(refit.nodes + refit.leaves + refit.kept + refit.skipped, blocks, "{refit:?}");
            assert_eq!(refit.cost, tree.statistics().cost);
        }
        assert!(told.skipped > blocks * 9 / 10, "{told:?} of {blocks}");
        assert_eq!((found.skipped, found.nodes, found.leaves), (0, told.nodes, told.leaves));
        agrees(&tree, &meshes, &rays(100, 1.5, frame), "told");
        agrees(&again, &meshes, &rays(100, 1.5, frame), "found");
    }
    // Only the meshes that are marked as moved are visited.
    meshes[2] = soup(5, 1, 0.1, 0.0, 8);
    let nothing = tree.refit_moved(&meshes, &[]).unwrap();
    // Only the nodes above the subtrees are visited.
    assert!(nothing.nodes + nothing.leaves == 0 && nothing.kept < blocks / 50, "{nothing:?} of {blocks}");
    assert!(tree.refit_moved(&meshes, &[2]).unwrap().leaves > 0);
    let beyond = meshes.len();
    assert_eq!(tree.refit_moved(&meshes, &[beyond]), Err(RefitError::NoMesh { mesh: beyond, meshes: beyond }));
    agrees(&tree, &meshes, &rays(100, 1.5, 9), "told later");
}

#[test]
fn cost_measures_the_quality_of_the_tree() {
    let first = vec![soup(4000, 2, 0.03, 0.02, 1)];
    let mut tree = RayTree::build(&first, &BuildParams::default()).unwrap();
    assert_eq!(tree.statistics().cost, 1.0);
    let mut random = Random(4);
    let flown = vec![moved(&first[0], 0.0, Vec3::new(30.0, -7.0, 0.5), 1.0, &mut random)];
    let refit = tree.refit(&flown).unwrap();
    assert!((refit.cost - 1.0).abs() < 1e-3 && !refit.is_worn(), "flown along: {refit:?}");
    let grown = vec![moved(&first[0], 0.0, Vec3::ZERO, 100.0, &mut random)];
    let refit = tree.refit(&grown).unwrap();
    assert!((refit.cost - 1.0).abs() < 1e-3, "grown: {refit:?}");
    let mixed = vec![soup(4000, 2, 0.03, 0.02, 99)];
    let refit = tree.refit(&mixed).unwrap();
    assert!(refit.cost > 5.0 && refit.is_worn(), "mixed up: {refit:?}");
    assert_eq!(tree.statistics().cost, refit.cost);
    // Back at the original positions, the cost is the original one.
    let refit: Refit = tree.refit(&first).unwrap();
    assert!((refit.cost - 1.0).abs() < 1e-4, "back: {refit:?}");
}

#[test]
fn incompatible_meshes_are_rejected_and_change_nothing() {
    let before = meshes();
    let mut tree = RayTree::build(&before, &BuildParams::default()).unwrap();
    let with = |i: usize, mesh: TriangleMesh| {
        let mut meshes = before.clone();
        meshes[i] = mesh;
        meshes
    };
    let at = |i: usize| match &before[i].keys {
        Keys::F32(keys) => keys.clone(),
        Keys::F64(_) | Keys::Precise(_) => panic!("f32"),
    };
    let mut turned = before[0].clone();
    turned.indices[17].swap(0, 1);
    let mut bad = at(1);
    bad[1][3].y = f32::NAN;
    let cases = [
        (before[1..].to_vec(), RefitError::Count { expected: 7, found: 6 }),
        (with(0, turned), RefitError::Topology { mesh: 0 }),
        (with(1, soup(199, 2, 0.2, 0.2, 2)), RefitError::Topology { mesh: 1 }),
        // Static meshes have no room for motion, moving ones none for more or other keys.
        (with(0, soup(200, 2, 0.2, 0.2, 2)), RefitError::Keys { mesh: 0, expected: 1, found: 2 }),
        (with(1, soup(200, 3, 0.2, 0.2, 2)), RefitError::Keys { mesh: 1, expected: 2, found: 3 }),
        (with(2, soup(100, 2, 0.2, 0.2, 2)), RefitError::Keys { mesh: 2, expected: 4, found: 2 }),
        (
            with(1, TriangleMesh { keys: bad.into(), ..before[1].clone() }),
            RefitError::Input(BuildError::NonFinite { mesh: 1, key: 1, vertex: 3 }),
        ),
    ];
    for (meshes, expected) in cases {
        assert_eq!(tree.refit(&meshes), Err(expected.clone()));
        assert!(!expected.to_string().is_empty());
    }
    agrees(&tree, &before, &rays(200, 1.5, 1), "unchanged");
    // A mesh that is static for a while fits, and moves again; linear motion may have more keys.
    let still = with(2, TriangleMesh { keys: vec![at(2)[0].clone()].into(), ..before[2].clone() });
    tree.refit(&still).unwrap();
    agrees(&tree, &still, &rays(200, 1.5, 2), "still");
    let two = at(1);
    let middle: Vec<Vec3> = two[0].iter().zip(&two[1]).map(|(a, b)| (*a + *b) * 0.5).collect();
    let three =
        with(1, TriangleMesh { keys: vec![two[0].clone(), middle, two[1].clone()].into(), ..before[1].clone() });
    tree.refit(&three).unwrap();
    agrees(&tree, &three, &rays(200, 1.5, 3), "three keys on lines");

    let mut planes = RayTree::build(&before, &BuildParams::kd(KdParams::default())).unwrap();
    assert_eq!(planes.refit(&before), Err(RefitError::Policy));
    let bytes = saved(&tree).unwrap();
    let mut read = RayTree::read_from(&mut bytes.as_slice()).unwrap();
    assert_eq!(read.refit(&before), Err(RefitError::FromFile));
    let mut nothing = RayTree::build(&[], &BuildParams::default()).unwrap();
    let refit = nothing.refit(&[]).unwrap();
    assert_eq!((refit.nodes, refit.leaves, refit.kept, refit.skipped, refit.cost), (0, 0, 0, 0, 1.0));
    let one = |z: f32| TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::X, Vec3::Y, Vec3::new(0.0, 0.0, z)]);
    let mut single = RayTree::build(&[one(1.0)], &BuildParams::default()).unwrap();
    single.refit(&[one(2.0)]).unwrap();
    agrees(&single, &[one(2.0)], &rays(200, 1.5, 3), "one triangle");
}

/// The keys of a mesh that is bent, straight or at rest, in these frames in turns.
#[test]
fn meshes_that_keep_all_keys_are_refitted_whatever_their_motion() {
    let bent = soup(200, 5, 0.2, 0.2, 3);
    let Keys::F32(keys) = &bent.keys else { panic!("f32") };
    let of =
        |choice: [usize; 5]| TriangleMesh { keys: choice.map(|key| keys[key].clone()).to_vec().into(), ..bent.clone() };
    let straight = |key: usize| keys[0].iter().zip(&keys[4]).map(|(a, b)| a.lerp(*b, key as f32 / 4.0)).collect();
    let straight = TriangleMesh { keys: (0..5).map(straight).collect::<Vec<Vec<Vec3>>>().into(), ..bent.clone() };
    let frames = [of([0, 0, 0, 0, 0]), straight, of([0, 1, 2, 3, 4]), of([4, 4, 4, 4, 4]), of([0, 0, 2, 2, 4])];
    let double = |mesh: &TriangleMesh| {
        let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
        let keys: Vec<Vec<DVec3>> = keys.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect();
        TriangleMesh { keys: keys.into(), ..mesh.clone() }
    };
    for (precise, params) in [false, true].into_iter().flat_map(|form| params().into_iter().map(move |of| (form, of))) {
        let as_asked = |mesh: &TriangleMesh| if precise { double(mesh).precise() } else { mesh.clone() };
        let frames = frames.each_ref().map(as_asked);
        let mut tree = RayTree::build(&[frames[0].clone().keep_keys()], &params).unwrap();
        let mut dropped = RayTree::build(&[frames[0].clone()], &params).unwrap();
        // In f64, what is straight in f32 is not.
        let found = if precise { 5 } else { 2 };
        assert_eq!(dropped.refit(&[frames[1].clone()]), Err(RefitError::Keys { mesh: 0, expected: 1, found }));
        for (i, frame) in frames.iter().enumerate() {
            let kept = [frame.clone().keep_keys()];
            tree.refit(&kept).unwrap();
            agrees(&tree, &kept, &rays(100, 1.5, i as u64), "all keys kept");
        }
        let other = TriangleMesh { keys: keys[..3].to_vec().into(), ..bent.clone() }.keep_keys();
        assert_eq!(tree.refit(&[as_asked(&other)]), Err(RefitError::Keys { mesh: 0, expected: 5, found: 3 }));
        // What stands still fits with any number of keys.
        for count in [1, 2, 9] {
            let still = TriangleMesh { keys: vec![keys[3].clone(); count].into(), ..bent.clone() }.keep_keys();
            let still = [as_asked(&still)];
            tree.refit(&still).unwrap();
            agrees(&tree, &still, &rays(100, 1.5, 7), "at rest");
        }
    }
}

#[test]
fn masks_and_active_intervals_are_updated() {
    use mbkd::TimeInterval;
    let mesh = soup(300, 2, 0.3, 0.1, 1);
    let mut tree = RayTree::build(std::slice::from_ref(&mesh), &BuildParams::default()).unwrap();
    let later = [mesh.with_mask(0b10).with_active(TimeInterval::new(0.5, 1.0).unwrap())];
    tree.refit(&later).unwrap();
    let oracle = BruteForce::new(&later).unwrap();
    for ray in rays(300, 1.5, 1) {
        assert_eq!(difference(&tree, &oracle, &ray), None);
        assert_eq!(tree.closest_hit_filtered(&ray, 0b01, |_| true), None);
    }
}

/// Many small balls in a cube, of which some move by a distance.
fn balls_of_which_some_move(share: usize, far: f32, grown: f32) -> [Vec<TriangleMesh>; 2] {
    let place = |i: usize| Vec3::new((i % 12) as f32, (i / 12 % 12) as f32, (i / 144) as f32) * 2.0;
    let ball = |at: Vec3| {
        let mut mesh = closed_sphere(5, 1, 0.0, 4);
        let Keys::F32(keys) = &mut mesh.keys else { panic!("f32") };
        keys[0].iter_mut().for_each(|p| *p = *p * 0.4 + at);
        mesh
    };
    let went = |i: usize| if i.is_multiple_of(share) { place(i) + Vec3::new(far, 0.3 * far, 0.0) } else { place(i) };
    [(0..1728).map(|i| ball(place(i))).collect(), (0..1728).map(|i| ball(went(i) * grown)).collect()]
}

/// Steps of rays through the cube where everything was at first.
fn steps_in_place(tree: &RayTree) -> f64 {
    let mut random = Random(8);
    let mut work = Counters::default();
    for _ in 0..2000 {
        // Chords between points of a sphere around the cube are lines of all directions, evenly distributed.
        let [from, to] = [0, 1].map(|_| {
            let (z, turn) = (random.signed(), random.unit() * core::f32::consts::TAU);
            (Vec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z) * 20.0 + 11.0
        });
        let all = tree
            .all_hits_observed(&Ray::new(from, to - from).between(0.0, 1.0), &mut work, |_| ControlFlow::Continue(()));
        assert!(all.is_continue());
    }
    (work.nodes + work.leaves) as f64
}

#[test]
fn the_cost_of_a_refit_tells_that_rays_in_place_take_longer_when_something_flies_off() {
    for (share, far, grown) in [(100, 50.0, 1.0), (100, 2000.0, 1.0), (20, 1e6, 1.0), (10, 30.0, 1.0)] {
        let [before, after] = balls_of_which_some_move(share, far, grown);
        let mut tree = RayTree::build(&before, &BuildParams::default()).unwrap();
        let fresh = steps_in_place(&tree);
        let refit = tree.refit(&after).unwrap();
        let worn = steps_in_place(&tree) / fresh;
        println!("{share} {far} {grown}: {refit:?}, {worn}");
        assert!(refit.cost > 1.0 + 0.5 * (worn - 1.0) && refit.cost < 2.5 * worn, "{share} {far}: {refit:?}, {worn}");
        // Back again, it is as good as new.
        let refit = tree.refit(&before).unwrap();
        assert!((refit.cost - 1.0).abs() < 1e-3, "{refit:?}");
    }
    // The cube is a point to f32 beside the way of the ball that leaves.
    let [before, after] = balls_of_which_some_move(1728, 1e28, 1.0);
    let mut tree = RayTree::build(&before, &BuildParams::default()).unwrap();
    assert!(tree.refit(&after).unwrap().cost.is_finite());
    // Balls spread apart are no reason for another tree, though the box grows.
    let [before, after] = balls_of_which_some_move(usize::MAX, 0.0, 3.0);
    let mut tree = RayTree::build(&before, &BuildParams::default()).unwrap();
    let refit = tree.refit(&after).unwrap();
    assert!(refit.cost < 1.1, "{refit:?}");
}
