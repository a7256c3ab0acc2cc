//! Meshes and shapes that exist for a part of the shutter: trees leave them out of the time slices in which they do not exist,
//! and the answers stay those of brute force.

use crate::common::{Random, bits, closed_sphere, difference, divided, mapped, random_ray, saved, soup};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Counters, Division, Instance, InstanceTree, Intersection, LazyParams, LinearBounds,
    MovingSphere, Primitive, Ray, RayTree, RefitError, Shape, TimeInterval, TriangleMesh, WideParams,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// All kinds of trees with temporal splits, with and without pre-splitting, and a lazy one.
fn params() -> Vec<BuildParams> {
    use Division::*;
    let divisions = [
        Automatic,
        SharedLeaves(2),
        SharedLeaves(3),
        SharedLeaves(16),
        SeparateTrees(2),
        SeparateTrees(5),
        SeparateTrees(16),
    ];
    let mut params: Vec<BuildParams> = divisions.map(divided).into();
    for division in [SharedLeaves(4), SeparateTrees(4)] {
        params.push(BuildParams::wide(WideParams { max_references: 4.0, division, ..WideParams::default() }));
    }
    params.push(BuildParams::lazy(LazyParams { subtree: 50, ..LazyParams::default() }));
    params
}

/// An interval of about this length, often between multiples of a sixteenth, where time slices begin.
fn interval(length: f32, random: &mut Random) -> TimeInterval {
    let begin = random.unit() * (1.0 - length);
    let begin = if random.below(2) == 0 { (begin * 16.0).round() / 16.0 } else { begin };
    let end = (begin + length).min(1.0);
    let end = if random.below(2) == 0 { (end * 16.0).round() / 16.0 } else { end };
    TimeInterval::new(begin, end).unwrap_or(TimeInterval::new(0.5, 0.5f32.next_up()).unwrap())
}

/// Small meshes of all kinds of leaf blocks at places of their own, each for about a part of the shutter.
fn meshes(count: usize, length: f32, seed: u64) -> Vec<TriangleMesh> {
    let mut random = Random(seed);
    let mesh = |i: usize| {
        let mesh = match i % 5 {
            0 => soup(30, 1, 0.1, 0.0, seed + i as u64),
            1 => soup(30, 2, 0.1, 0.2, seed + i as u64),
            2 => closed_sphere(4, 1, 0.1, seed + i as u64),
            3 => closed_sphere(4, 5, 0.1, seed + i as u64),
            _ => soup(20, 2, 0.5, 0.2, seed + i as u64),
        };
        moved(&mesh, random.vec()).with_active(interval(length, &mut random))
    };
    (0..count).map(mesh).collect()
}

/// A smaller mesh elsewhere.
fn moved(mesh: &TriangleMesh, by: Vec3) -> TriangleMesh {
    mapped(mesh, |p| p * 0.3 + by)
}

fn shapes(count: usize) -> Vec<Shape> {
    let mut random = Random(5);
    let mut ball = |keys: usize| {
        let from = random.vec().as_dvec3();
        let keys = (0..keys).map(|key| (from + DVec3::X * key as f64 * 0.1, 0.05)).collect();
        MovingSphere::new(keys).with_active(interval(0.2, &mut random)).into()
    };
    (0..count).map(|i| ball(1 + i % 3)).collect()
}

/// Rays at random times, at both ends of each active interval, and where time slices begin.
fn rays(meshes: &[TriangleMesh], count: usize) -> Vec<Ray> {
    let mut random = Random(7);
    let mut times: Vec<f32> = meshes.iter().flat_map(|mesh| [mesh.active.begin(), mesh.active.end()]).collect();
    times.extend((0..=80).map(|i| i as f32 / 80.0));
    let near = |t: f32| [t.next_down(), t, t.next_up()].map(|t| t.clamp(0.0, 1.0));
    let times: Vec<f32> = times.into_iter().flat_map(near).collect();
    let mut ray = |i: usize| {
        let ray = random_ray(&mut random, 1.2);
        if i.is_multiple_of(2) { ray } else { ray.at_time(times[random.below(times.len())]) }
    };
    (0..count).map(&mut ray).collect()
}

#[test]
fn every_division_equals_brute_force_at_all_times() {
    for (count, length, balls) in [(40, 0.2, 0), (40, 0.05, 30), (12, 0.5, 9), (1, 0.3, 0), (0, 0.1, 40), (25, 0.9, 1)]
    {
        let meshes = meshes(count, length, 3);
        let oracle = BruteForce::of_scene(&meshes, shapes(balls)).unwrap();
        let whole = RayTree::of_scene(&meshes, shapes(balls), &divided(Division::Whole)).unwrap();
        let rays = rays(&meshes, 600);
        let mut hits = 0;
        for params in params() {
            let tree = RayTree::of_scene(&meshes, shapes(balls), &params).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{params:?}");
            for ray in &rays {
                assert_eq!(difference(&tree, &oracle, ray), None, "{params:?}");
                hits += usize::from(tree.any_hit(ray));
                let query = ClosestPointQuery::new(ray.origin, ray.time);
                assert_eq!(tree.closest_point(&query), oracle.closest_point(&query), "{params:?} {query:?}");
            }
            // Corners at all times, also when the mesh does not exist; trees agree on how motion goes on then.
            for (i, mesh) in meshes.iter().enumerate() {
                for (triangle, time) in
                    (0..mesh.len() as u32).step_by(5).zip([0.0, 0.3, 0.5, 0.77, 1.0].into_iter().cycle())
                {
                    let of = |tree: &RayTree| tree.triangle(i as u32, triangle, time);
                    assert_eq!(of(&tree), of(&whole), "{params:?} {i} {triangle} {time}");
                }
            }
        }
        assert!(hits > 0 || count == 1, "{count} meshes, {balls} spheres");
    }
}

#[test]
fn trees_from_files_answer_alike() {
    let meshes = meshes(30, 0.2, 4);
    for params in params() {
        let Ok(tree) = RayTree::build(&meshes, &params) else { panic!("a tree") };
        let Ok(bytes) = saved(&tree) else { continue };
        let read = RayTree::read_from(&mut bytes.as_slice()).unwrap();
        assert_eq!(read.validate(), Ok(()), "{params:?}");
        for ray in rays(&meshes, 300) {
            assert_eq!(read.closest_hit(&ray).map(bits), tree.closest_hit(&ray).map(bits), "{params:?}");
        }
    }
}

/// A hundred rocks of a thousand triangles, each for a fifth of the shutter.
fn rocks(life: f32) -> Vec<TriangleMesh> {
    let (mut random, rock) = (Random(1), closed_sphere(10, 1, 0.03, 1));
    let rock = |_| {
        let begin = random.unit() * (1.0 - life);
        moved(&rock, 3.0 * random.vec()).with_active(TimeInterval::new(begin, (begin + life).min(1.0)).unwrap())
    };
    (0..100).map(rock).collect()
}

#[test]
fn rays_hardly_meet_what_does_not_exist() {
    let rays: Vec<Ray> = {
        let mut random = Random(2);
        (0..1000).map(|_| random_ray(&mut random, 3.0)).collect()
    };
    let work = |life: f32, division: Division| {
        let tree = RayTree::build(&rocks(life), &divided(division));
        let (tree, mut counters) = (tree.unwrap(), Counters::default());
        for ray in &rays {
            tree.closest_hit_observed(ray, &mut counters);
        }
        (counters.steps() as f64, tree.statistics().bytes as f64)
    };
    let (whole, whole_bytes) = work(0.2, Division::Whole);
    let (steps, bytes) = work(0.2, Division::Automatic);
    // A fifth of the rocks exists at any time, a little more in any slice.
    assert!(steps < 0.4 * whole, "{steps} of {whole}");
    // Each of sixteen separate trees of all rocks would have as many bytes as the whole.
    let (_, separate) = work(0.2, Division::SeparateTrees(16));
    assert!(
        bytes < 5.0 * whole_bytes && separate < 5.0 * whole_bytes,
        "{bytes} and {separate} instead of {whole_bytes}"
    );
    // Without a mesh that comes or goes, nothing of this is paid for.
    let counts = |division| work(1.0, division);
    assert_eq!(counts(Division::Automatic), counts(Division::Whole));
}

/// Meshes of 17 keys for an eighth of the shutter, which has two of 16 segments, or three.
#[test]
fn trees_hold_the_keys_that_meshes_need_while_they_exist() {
    let mut random = Random(3);
    let meshes: Vec<TriangleMesh> = (0..40)
        .map(|i| moved(&closed_sphere(8, 17, 0.1, i), 3.0 * random.vec()))
        .map(|mesh| mesh.with_active(TimeInterval::new(0.5, 0.625).unwrap()))
        .collect();
    let always: Vec<TriangleMesh> = meshes.iter().map(|mesh| mesh.clone().with_active(TimeInterval::FULL)).collect();
    let bytes = |meshes: &[TriangleMesh], division| {
        let tree = RayTree::build(meshes, &divided(division)).unwrap();
        assert_eq!(tree.validate(), Ok(()));
        tree.statistics().bytes as f64
    };
    for division in
        [Division::Whole, Division::SharedLeaves(4), Division::SeparateTrees(4), Division::SeparateTrees(16)]
    {
        // Three keys of 17; the rest is ids and nodes.
        let (held, all) = (bytes(&meshes, division), bytes(&always, division));
        assert!(held < 0.34 * all, "{division:?}: {held} of {all}");
    }
}

/// The second of four segments has all times at which the mesh exists.
#[test]
fn motion_goes_on_in_the_nearest_segment_in_which_a_mesh_exists() {
    let at = |key: usize| [0.0, 1.0, 4.0, 9.0, 16.0][key];
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let keys: Vec<Vec<Vec3>> = (0..5).map(|key| corners.map(|p| p + Vec3::Z * at(key)).to_vec()).collect();
    let short = TimeInterval::new(0.25, 0.5).unwrap();
    let meshes = [TriangleMesh::new(vec![[0, 1, 2]], keys).with_active(short), soup(60, 5, 0.1, 0.2, 1)];
    for params in params().into_iter().chain([BuildParams::paper()]) {
        let tree = RayTree::build(&meshes, &params).unwrap();
        for (time, z) in [(0.25, 1.0), (0.375, 2.5), (0.4375, 3.25), (0.5, 4.0), (0.75, 7.0), (1.0, 10.0), (0.0, -2.0)]
        {
            let expected = corners.map(|p| (p + Vec3::Z * z).as_dvec3());
            assert_eq!(tree.triangle(0, 0, time), expected, "{params:?} at {time}");
        }
    }
}

/// Five meshes far from each other: one exists always, each of the others in a quarter of the shutter of its own.
fn in_quarters(keys: usize) -> Vec<TriangleMesh> {
    let at = |i: usize| moved(&closed_sphere(4, keys, 0.1, i as u64), Vec3::X * 10.0 * i as f32);
    let quarter = |i: usize| {
        let begin = 0.25 * i as f32;
        at(i).with_active(TimeInterval::new(begin + 0.05, begin + 0.2).unwrap())
    };
    (0..4).map(quarter).chain([at(4)]).collect()
}

#[test]
fn statistics_say_what_time_slices_leave_out() {
    let build = |meshes: &[TriangleMesh], params: &BuildParams| RayTree::build(meshes, params).unwrap();
    let left_out = |keys, division| build(&in_quarters(keys), &divided(division)).statistics().left_out;
    use Division::*;
    // Each of four meshes is missing in three of four slices, and in six or seven of eight, of all five.
    for keys in [1, 2, 5] {
        assert_eq!(left_out(keys, SharedLeaves(4)), 12.0 / 20.0);
        assert_eq!(left_out(keys, SeparateTrees(4)), 12.0 / 20.0);
        assert_eq!(left_out(keys, SeparateTrees(2)), 4.0 / 10.0);
        assert_eq!(left_out(keys, SharedLeaves(8)), 24.0 / 40.0);
        assert_eq!(left_out(keys, Whole), 0.0);
    }
    // A mesh that exists in one quarter exactly is in one slice of four.
    let exact: Vec<TriangleMesh> = (0..4)
        .map(|i| TimeInterval::new(0.25 * i as f32, 0.25 * (i + 1) as f32).unwrap())
        .zip(in_quarters(2))
        .map(|(active, mesh)| mesh.with_active(active))
        .collect();
    for division in [SharedLeaves(4), SeparateTrees(4)] {
        assert_eq!(build(&exact, &divided(division)).statistics().left_out, 12.0 / 16.0);
    }
    // What exists all the time is in all slices.
    let always: Vec<TriangleMesh> =
        in_quarters(2).into_iter().map(|mesh| mesh.with_active(TimeInterval::FULL)).collect();
    assert_eq!(build(&always, &divided(SharedLeaves(4))).statistics().left_out, 0.0);

    let tree = build(&in_quarters(2), &divided(SeparateTrees(4)));
    let bytes = saved(&tree).unwrap();
    assert_eq!(RayTree::read_from(&mut bytes.as_slice()).unwrap().statistics(), tree.statistics());

    // Two subtrees for each mesh, at least, of which each divides the shutter by itself.
    let wide = WideParams { division: SeparateTrees(4), ..WideParams::default() };
    let lazy = build(&in_quarters(2), &BuildParams::lazy(LazyParams { subtree: 50, wide }));
    assert_eq!(lazy.statistics().left_out, 0.0);
    let along = Ray::new(Vec3::new(-5.0, 0.0, 0.0), Vec3::X);
    (0..100).for_each(|i| assert!(lazy.closest_hit(&along.at_time(i as f32 / 100.0)).is_some()));
    let above = Ray::new(Vec3::new(-5.0, 0.05, 0.0), Vec3::X);
    (0..100).for_each(|i| assert!(lazy.closest_hit(&above.at_time(i as f32 / 100.0)).is_some()));
    assert!(lazy.statistics().left_out > 0.5, "{:?}", lazy.statistics());
}

#[test]
fn refits_keep_to_the_intervals_of_the_build_where_something_was_left_out() {
    let first = meshes(30, 0.3, 6);
    let shorter = |mesh: &TriangleMesh| {
        let active = mesh.active;
        let end = 0.5 * (active.begin() + active.end());
        TriangleMesh { active: TimeInterval::new(active.begin(), end).unwrap_or(active), ..mesh.clone() }
    };
    for params in params().into_iter().take(9) {
        let mut tree = RayTree::build(&first, &params).unwrap();
        for (frame, by) in [0.0, 0.2, -3.0].into_iter().enumerate() {
            let now: Vec<TriangleMesh> = first
                .iter()
                .enumerate()
                .map(|(i, mesh)| if (i + frame) % 2 == 0 { mesh.clone() } else { shorter(mesh) })
                .map(|mesh| mapped(&mesh, |p| p + by))
                .collect();
            tree.refit(&now).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{params:?}");
            let oracle = BruteForce::new(&now).unwrap();
            for ray in rays(&now, 300) {
                let ray = Ray { origin: ray.origin + f64::from(by), ..ray };
                assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}, frame {frame}");
            }
        }
        // One that exists for longer: refused if the tree left it out, and then the tree is as before.
        let mut longer = first.clone();
        longer[7].active = TimeInterval::FULL;
        let before: Vec<_> = rays(&first, 100).iter().map(|ray| tree.closest_hit(ray)).collect();
        match tree.refit(&longer) {
            Err(error) => {
                assert_eq!(error, RefitError::Active { mesh: 7 }, "{params:?}");
                assert!(error.to_string().contains("mesh 7"));
                let after: Vec<_> = rays(&first, 100).iter().map(|ray| tree.closest_hit(ray)).collect();
                assert_eq!(after, before);
                assert_eq!(tree.refit(&longer[..3]), Err(RefitError::Count { expected: 30, found: 3 }));
            }
            Ok(_) => {
                let oracle = BruteForce::new(&longer).unwrap();
                rays(&longer, 300).iter().for_each(|ray| assert_eq!(difference(&tree, &oracle, ray), None));
            }
        }
    }
    let all: Vec<TriangleMesh> = first.iter().map(|mesh| mesh.clone().with_active(TimeInterval::FULL)).collect();
    let refit = |division| RayTree::build(&first, &divided(division)).unwrap().refit(&all).map(drop);
    // Undivided trees left out the keys of a mesh of more than two.
    assert_eq!(refit(Division::Whole), Err(RefitError::Active { mesh: 3 }));
    let straight = |of: &[TriangleMesh]| -> Vec<TriangleMesh> {
        let few = |mesh: &&TriangleMesh| mesh.keys.len() <= 2;
        of.iter().filter(few).cloned().collect()
    };
    RayTree::build(&straight(&first), &divided(Division::Whole)).unwrap().refit(&straight(&all)).unwrap();
    assert_eq!(refit(Division::SharedLeaves(16)), Err(RefitError::Active { mesh: 0 }));
    assert_eq!(refit(Division::SeparateTrees(16)), Err(RefitError::Active { mesh: 0 }));
}

/// Each leaf block has triangles of all meshes, so each is in all slices, but its boxes hold only what exists there.
#[test]
fn what_a_box_does_not_hold_cannot_come_back_by_a_refit_either() {
    let params = divided(Division::SharedLeaves(4));
    let always = soup(200, 1, 0.1, 0.0, 1);
    let grown = |active| TriangleMesh { active, ..soup(200, 1, 1.5, 0.0, 1) };
    let first = TimeInterval::new(0.0, 0.1).unwrap();
    let mut tree = RayTree::build(&[always.clone(), grown(first)], &params).unwrap();
    assert_eq!(tree.refit(&[always.clone(), grown(TimeInterval::FULL)]), Err(RefitError::Active { mesh: 1 }));
    // What exists in each slice may exist for longer.
    let nearly = TimeInterval::new(0.1, 0.9).unwrap();
    let mut tree = RayTree::build(&[always.clone(), grown(nearly)], &params).unwrap();
    let all = [always, grown(TimeInterval::FULL)];
    tree.refit(&all).unwrap();
    let oracle = BruteForce::new(&all).unwrap();
    for ray in rays(&all, 300) {
        assert_eq!(difference(&tree, &oracle, &ray), None);
    }
}

#[test]
fn spheres_of_many_keys_take_only_those_of_their_active_interval() {
    let balls = |active: TimeInterval| -> Vec<MovingSphere> {
        let mut random = Random(5);
        let ball = |_| {
            let mut at = random.vec().as_dvec3();
            let mut key = |_| {
                at += random.vec().as_dvec3() * 0.02;
                (at, 0.05)
            };
            MovingSphere::new((0..65).map(&mut key).collect()).with_active(active)
        };
        (0..600).map(ball).collect()
    };
    let short = TimeInterval::new(0.3, 0.4).unwrap();
    for division in [Division::Whole, Division::SharedLeaves(2), Division::SeparateTrees(2)] {
        let build = |active: TimeInterval| RayTree::of_scene(&[], balls(active), &divided(division)).unwrap();
        let (mut tree, whole) = (build(short), build(TimeInterval::FULL));
        let (bytes, of_whole) = (tree.statistics().bytes, whole.statistics().bytes);
        assert!(bytes * 4 < of_whole, "{bytes} of {of_whole} bytes, {division:?}");
        let shorter = TimeInterval::new(0.32, 0.35).unwrap();
        for active in [short, shorter] {
            tree.refit_with_shapes(&[], balls(active)).unwrap();
            let (brute, mut random) = (BruteForce::of_scene(&[], balls(active)).unwrap(), Random(6));
            let (mut hits, mut before) = (0, 0);
            for _ in 0..2000 {
                let ray = random_ray(&mut random, 1.0).at_time(0.25 + 0.2 * random.unit());
                assert_eq!(difference(&tree, &brute, &ray), None, "{division:?}, {active:?}");
                hits += usize::from(tree.any_hit(&ray));
                before += usize::from(tree.any_hit(&ray.at_time(active.begin().next_down())));
            }
            assert!(hits > 50 && before == 0, "{hits} hits, {before} before");
        }
        let longer = TimeInterval::new(0.3, 0.5).unwrap();
        assert_eq!(tree.refit_with_shapes(&[], balls(longer)), Err(RefitError::ActiveShape { shape: 0 }));
    }
}

#[test]
fn spheres_that_a_tree_left_out_cannot_come_back_by_a_refit() {
    let balls = |life: f32| -> Vec<MovingSphere> {
        let ball = |i: i32| MovingSphere::fixed(DVec3::X * f64::from(i), 0.4);
        let active = |i: i32| TimeInterval::new(i as f32 / 100.0, i as f32 / 100.0 + life).unwrap();
        (0..80).map(|i| ball(i).with_active(active(i))).collect()
    };
    let params = divided(Division::SeparateTrees(8));
    let mut tree = RayTree::of_scene(&[], balls(0.1), &params).unwrap();
    tree.refit_with_shapes(&[], balls(0.05)).unwrap();
    assert_eq!(tree.refit_with_shapes(&[], balls(0.2)), Err(RefitError::ActiveShape { shape: 0 }));
    let shapes = |life: f32| balls(life).into_iter().map(Shape::from).collect::<Vec<_>>();
    let mesh = [soup(10, 1, 0.1, 0.0, 1)];
    let mut tree = RayTree::of_scene(&mesh, shapes(0.1), &params).unwrap();
    tree.refit_with_shapes(&mesh, shapes(0.1)).unwrap();
    assert_eq!(tree.refit_with_shapes(&mesh, shapes(0.2)), Err(RefitError::ActiveShape { shape: 0 }));
    tree.refit(&mesh).unwrap();
}

#[test]
fn instances_that_come_and_go_equal_those_that_are_tested_one_by_one() {
    let tree = Arc::new(RayTree::build(&[closed_sphere(6, 2, 0.05, 3)], &BuildParams::default()).unwrap());
    let mut random = Random(11);
    let place = |random: &mut Random| DAffine3::from_translation(random.vec().as_dvec3() * 8.0);
    let instances: Vec<Instance> = (0..200)
        .map(|_| Instance::new(Arc::clone(&tree), place(&mut random)).with_active(interval(0.1, &mut random)))
        .collect();
    let all = InstanceTree::build(instances.clone(), &WideParams::default()).unwrap();
    // Each exists in one or two sixteenths of the shutter, or three.
    let params = WideParams { division: Division::SeparateTrees(16), ..WideParams::default() };
    let left_out = InstanceTree::build(instances.clone(), &params).unwrap().statistics().outermost.left_out;
    assert!((0.8..0.95).contains(&left_out), "{left_out}");
    let each: Vec<InstanceTree> = instances
        .into_iter()
        .map(|instance| InstanceTree::build(vec![instance], &WideParams::default()).unwrap())
        .collect();
    let mut hits = 0;
    for _ in 0..600 {
        let ray = random_ray(&mut random, 8.0);
        let expected = each.iter().filter_map(|one| one.closest_hit(&ray)).map(|hit| hit.hit.t).reduce(f32::min);
        assert_eq!(all.closest_hit(&ray).map(|hit| hit.hit.t), expected);
        hits += usize::from(expected.is_some());
    }
    assert!(hits > 20, "{hits}");
}

#[test]
fn a_tree_asks_each_primitive_once_for_its_interval() {
    /// A ball that counts how often it is asked.
    struct Asked(MovingSphere, Arc<AtomicU32>);
    impl Primitive for Asked {
        fn bounds(&self, over: TimeInterval) -> LinearBounds {
            self.0.bounds(over)
        }
        fn intersect(&self, ray: &Ray) -> Option<Intersection> {
            self.0.intersect(ray)
        }
        fn active(&self) -> TimeInterval {
            self.1.fetch_add(1, Relaxed);
            TimeInterval::new(0.0, 0.5).unwrap()
        }
    }
    let asked = Arc::new(AtomicU32::new(0));
    let shape = |x: f64| vec![Shape::custom(Asked(MovingSphere::fixed(DVec3::X * x, 1.0), asked.clone()))];
    let calls = || asked.swap(0, Relaxed);
    let mesh = |seed| [soup(20, 2, 0.1, 0.1, seed)];
    let mut tree = RayTree::of_scene(&mesh(1), shape(0.0), &BuildParams::default()).unwrap();
    assert_eq!(calls(), 1);
    let moved = mesh(1).map(|mesh| TriangleMesh { active: TimeInterval::new(0.0, 0.7).unwrap(), ..mesh });
    tree.refit(&moved).unwrap();
    assert_eq!(calls(), 0, "the ball is the same");
    tree.refit_with_shapes(&moved, shape(1.0)).unwrap();
    assert_eq!(calls(), 1);
    let hits = [0.25, 0.75].map(|time| tree.any_hit(&Ray::new(Vec3::new(1.9, 0.0, 9.0), Vec3::NEG_Z).at_time(time)));
    assert_eq!(hits, [true, false]);
}

/// Hundreds of meshes that each exist for half of the shutter, and closest points shortly after it opens, when few of them do:
/// nearly every leaf block was visited.
#[test]
fn closest_points_pass_by_what_does_not_exist() {
    let mut random = Random(41);
    let mut flock: Vec<TriangleMesh> = (0..400)
        .map(|_| {
            let (place, begin) = (random.vec(), random.unit() * 0.5);
            let key = |random: &mut Random| (0..48).map(|_| place + random.vec() * 0.02).collect::<Vec<_>>();
            let keys = vec![key(&mut random), key(&mut random)];
            let active = TimeInterval::new(begin, begin + 0.5).unwrap();
            TriangleMesh::new((0..16).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), keys).with_active(active)
        })
        .collect();
    // Some are there all the time that is asked for.
    flock[0].active = TimeInterval::new(0.0, 0.5).unwrap();
    let lazy = BuildParams::lazy(LazyParams { subtree: 200, ..LazyParams::default() });
    let mut trees = [BuildParams::default(), lazy].map(|params| RayTree::build(&flock, &params).unwrap());
    let brute = BruteForce::new(&flock).unwrap();
    let mut steps = |tree: &RayTree, brute: &BruteForce, time: f32| {
        let mut work = Counters::default();
        for _ in 0..100 {
            let query = ClosestPointQuery::new(random.vec(), time);
            assert_eq!(tree.closest_point_observed(&query, &mut work), brute.closest_point(&query));
        }
        work.steps() / 100
    };
    for tree in &trees {
        let found = steps(tree, &brute, 0.01);
        assert!(found < 50, "{found} steps, {}", tree.statistics());
    }
    // A refit to other intervals finds out what exists when.
    let middle = TimeInterval::new(0.49, 0.5).unwrap();
    flock[1..].iter_mut().for_each(|mesh| mesh.active = if mesh.active.contains(0.49) { middle } else { mesh.active });
    trees[0].refit(&flock).unwrap();
    let found = steps(&trees[0], &BruteForce::new(&flock).unwrap(), 0.45);
    assert!(found < 50, "{found} steps, {}", trees[0].statistics());
}
