//! How accurate answers are: the goals, asserted on moderate numbers. The tables come from
//! `cargo run --release --example accuracy`.

use mbkd::{Keys, PointStructure, RayTree, TriangleMesh};
use mbkd_evidence::accuracy::*;
use mbkd_scenes::Random;
use rayon::prelude::*;

/// The most ulp that distances of well-conditioned problems may be off by.
const ULPS: f64 = 4.0;

/// The most units (see the module `accuracy`) that any answer may be off by.
const UNITS: f64 = 3.0;

/// Rays per case.
const RAYS: usize = 160;

fn tallies(case: &RayCase) -> Vec<(&'static str, RayTally)> {
    let scene = SceneUnderTest::new(case, 5);
    let trees: Vec<RayTree> = policies().iter().map(|(_, p)| RayTree::build(&scene.meshes, p).unwrap()).collect();
    let tallies = compare_rays(&scene, &trees, RAYS, &mut Random(77), |_| ());
    policies().into_iter().map(|(name, _)| name).zip(tallies).collect()
}

fn check_rays(name: &(&str, String), policy: &str, tally: &RayTally) {
    let about = format!("{name:?}, {policy}: {tally:?}").chars().take(300).collect::<String>();
    assert!(tally.is_right(), "{about}");
    for errors in [&tally.t, &tally.weights] {
        assert!(errors.worst_units() <= UNITS, "{} units: {about}", errors.worst_units());
    }
    assert!(tally.t.worst_ulps() <= ULPS, "{} ulp: {about}", tally.t.worst_ulps());
}

/// All cases of some families; every policy.
fn triangles(families: &[&str]) {
    let cases: Vec<RayCase> =
        ray_cases().into_iter().filter(|c| families.contains(&c.name.0) && c.is_promised()).collect();
    assert!(cases.len() >= families.len());
    let (mut hits, mut well) = (0, 0.0);
    for case in &cases {
        for (policy, tally) in tallies(case) {
            check_rays(&case.name, policy, &tally);
            hits += tally.hits;
            well += tally.t.well() * tally.t.len() as f64;
        }
    }
    // The check has something to check.
    assert!(hits > 100 * cases.len(), "{hits} hits");
    assert!(well > 0.02 * hits as f64, "{well} well-conditioned ones of {hits}");
}

#[test]
fn triangles_of_any_scale_and_place() {
    triangles(&["scale", "offset", "f64, offset"]);
}

#[test]
fn triangles_kept_in_f64() {
    triangles(&["f64 kept, offset", "f64 kept, clusters apart", "f64 kept, keys"]);
}

/// Nearest points of all cases of some families; every policy.
fn closest_points(families: &[&str]) {
    let cases: Vec<RayCase> = closest_point_cases().into_iter().filter(|c| families.contains(&c.name.0)).collect();
    assert!(cases.len() >= families.len());
    for case in &cases {
        let scene = SceneUnderTest::new(case, 5);
        let trees: Vec<RayTree> = policies().iter().map(|(_, p)| RayTree::build(&scene.meshes, p).unwrap()).collect();
        let tallies = compare_closest_points(&scene, &trees, 40, &mut Random(21), |_| ());
        for (tally, (policy, _)) in tallies.iter().zip(policies()) {
            let about = format!("{:?}, {policy}: {tally:?}", case.name).chars().take(250).collect::<String>();
            assert!(tally.is_right(), "{about}");
            assert!(tally.distance.len() > 30, "{about}");
            assert!(tally.distance.worst_units() <= UNITS, "{} units: {about}", tally.distance.worst_units());
            assert!(tally.distance.worst_ulps() <= ULPS, "{} ulp: {about}", tally.distance.worst_ulps());
        }
    }
}

#[test]
fn nearest_points_on_triangles_kept_in_f64() {
    closest_points(&["f64 kept, offset", "f64 kept, clusters apart", "f64 kept, keys"]);
}

#[test]
fn nearest_points_on_triangles() {
    closest_points(&["scale", "offset", "one outlier", "speed", "keys", "f64, offset"]);
}

#[test]
fn tampering_with_nearest_points_is_noticed() {
    let case = closest_point_cases().into_iter().find(|c| c.name == ("f64 kept, offset", "1e6".into())).unwrap();
    let scene = SceneUnderTest::new(&case, 5);
    let trees = [RayTree::build(&scene.meshes, &policies()[0].1).unwrap()];
    let run = |tamper: &dyn Fn(&mut Option<mbkd::ClosestPoint>)| {
        compare_closest_points(&scene, &trees, 60, &mut Random(21), tamper).remove(0)
    };
    assert!(run(&|_| ()).is_right());
    let lost = run(&|found| *found = None);
    assert!(lost.wrong_count > 30, "{}", lost.wrong_count);
    let far = run(&|found| found.iter_mut().for_each(|near| near.distance *= 1.000_001));
    assert!(far.distance.worst_ulps() > ULPS && far.distance.worst_ulps() < 20.0, "{}", far.distance.worst_ulps());
    let other = run(&|found| found.iter_mut().for_each(|near| near.primitive = (near.primitive + 1) % 80));
    assert!(other.wrong_order > 30, "{}", other.wrong_order);
    let aside = run(&|found| found.iter_mut().for_each(|near| near.point.x += 1e-3));
    assert!(aside.broken_promises > 30, "{}", aside.broken_promises);
}

/// The same triangles are not what they were given as if f64 is not kept, and the check notices.
#[test]
fn triangles_rounded_to_f32_are_not_those_in_f64() {
    let case = ray_cases().into_iter().find(|c| c.name == ("f64 kept, clusters apart", "1e7".into())).unwrap();
    let scene = SceneUnderTest::new(&case, 5);
    let rounded = scene.meshes.iter().map(|mesh| match &mesh.keys {
        Keys::Precise(keys) => TriangleMesh::new(mesh.indices.clone(), keys.clone()),
        _ => unreachable!("kept in f64"),
    });
    let trees = [RayTree::build(&rounded.collect::<Vec<_>>(), &policies()[0].1).unwrap()];
    let tally = compare_rays(&scene, &trees, RAYS, &mut Random(77), |_| ()).remove(0);
    assert!(tally.false_misses > 50, "{}", tally.false_misses);
}

#[test]
fn triangles_of_any_shape_and_motion() {
    triangles(&["aspect", "speed", "keys"]);
}

/// At the times at which references begin and end in k-d trees, and up to three floats beside.
#[test]
fn times_at_which_planes_are_crossed() {
    let families = ["crossing times, speed", "crossing times, keys"];
    triangles(&families);
    closest_points(&families);
    points(&families, false);
    points(&families, true);
}

#[test]
fn small_triangles_and_large_ones_beside_them() {
    triangles(&["one outlier", "beside a ground"]);
}

#[test]
fn rays_from_far_away() {
    triangles(&["far origins"]);
}

#[test]
fn directions_of_any_length() {
    triangles(&["direction length"]);
}

#[test]
fn spheres() {
    let params: Vec<_> = policies().into_iter().map(|(_, p)| p).collect();
    let mut hits = 0;
    for case in sphere_cases() {
        let tallies = compare_spheres(&case, &params, RAYS, &mut Random(3)).unwrap();
        for (tally, (policy, _)) in tallies.iter().zip(policies()) {
            check_rays(&case.name, policy, tally);
            hits += tally.hits;
        }
    }
    assert!(hits > 5000, "{hits}");
}

/// All cases of some families; every structure.
fn points(families: &[&str], approaches: bool) {
    let cases: Vec<PointCase> = point_cases().into_iter().filter(|c| families.contains(&c.name.0)).collect();
    assert!(cases.len() >= families.len());
    for case in &cases {
        let list: Vec<PointStructure> = structures(case.wide).into_iter().map(|(_, s)| s).collect();
        let mut random = Random(11);
        let tallies = if approaches {
            compare_approaches(case, &list, 8, &mut random)
        } else {
            compare_neighbors(case, &list, 50, &mut random, |_| ())
        };
        for (tally, (structure, _)) in tallies.unwrap().iter().zip(structures(case.wide)) {
            let about = format!("{:?}, {structure}: {tally:?}", case.name).chars().take(200).collect::<String>();
            assert!(tally.is_right(), "{about}");
            assert!(tally.distance.len() >= tally.queries, "{about}");
            assert!(tally.distance.worst_units() <= UNITS, "{} units: {about}", tally.distance.worst_units());
            assert!(tally.distance.worst_ulps() <= ULPS, "{} ulp: {about}", tally.distance.worst_ulps());
            assert!(tally.time.worst_units() <= UNITS, "{} units of time: {about}", tally.time.worst_units());
        }
    }
}

/// The families whose positions are f32.
const F32: [&str; 6] = ["scale", "offset", "clusters apart", "one outlier", "speed", "keys"];

#[test]
fn neighbors_in_f32() {
    points(&["scale", "offset"], false);
}

#[test]
fn neighbors_and_approaches_in_f64() {
    let families = ["f64, offset", "f64, clusters apart", "f64, still, clusters apart"];
    points(&families, false);
    points(&families, true);
}

#[test]
fn approaches_in_f32() {
    points(&F32, true);
}

/// Distances of closest approach are those of the input as it stands, however far and fast points are.
#[test]
fn approaches_of_far_and_fast_points_are_exact() {
    let list: Vec<PointStructure> = structures(false).into_iter().map(|(_, s)| s).collect();
    let plain = point_cases().into_iter().find(|case| case.name.0 == "keys" && case.keys == 2).unwrap();
    for (scale, speed, offset) in [
        (1.0, 0.0, 0.0),
        (1.0, 1e3, 0.0),
        (1.0, 1e6, 0.0),
        (1.0, 1e6, 1e6),
        (1.0, 1e12, 1e3),
        (1.0, 1e3, 1e12),
        (1e-25, 0.1, 0.0),
        (1e-25, 1e6, 10.0),
    ] {
        for keys in [2, 5] {
            let case = PointCase { scale, speed, offset, keys, ..plain.clone() };
            let mut random = Random(5);
            for (tally, (structure, _)) in
                compare_approaches(&case, &list, 12, &mut random).unwrap().iter().zip(structures(false))
            {
                let about = format!("scale {scale}, speed {speed}, offset {offset}, {keys} keys, {structure}");
                assert!(tally.as_given.len() >= tally.queries, "{about}");
                assert!(tally.as_given.worst_ulps() <= 0.501, "{about}: {} ulp", tally.as_given.worst_ulps());
                assert!(tally.worst_as_given <= 1.001, "{about}: farther by {} ulp", tally.worst_as_given);
            }
        }
    }
}

/// A million rays; with a fault of one triangle they get out.
#[test]
fn closed_meshes_do_not_leak() {
    const RAYS: usize = 1_000_000;
    let meshes = closed_meshes(1);
    let each = RAYS.div_ceil(meshes.len() * policies().len());
    // The rays of a mesh, shot at the trees of all policies.
    // Each mesh a task of its own: two of them, side by side, take most of the time.
    let shots = meshes.par_iter().with_max_len(1).map(|closed| {
        let (names, params): (Vec<_>, Vec<_>) = policies().into_iter().unzip();
        let trees: Vec<RayTree> = params.iter().map(|p| RayTree::build(&closed.meshes, p).unwrap()).collect();
        let (rays, leaks) = shoot(closed, &trees, each, 9);
        for (policy, leaks) in names.iter().zip(&leaks) {
            assert!(leaks.is_empty(), "{}, {policy}: {} leaks, such as {:?}", closed.name, leaks.len(), leaks[0]);
        }
        assert!(rays > each / 2, "{}: {rays} rays", closed.name);
        rays * trees.len()
    });
    let shot: usize = shots.sum();
    assert!(shot >= RAYS * 9 / 10, "{shot}");
}

#[test]
fn a_hole_leaks() {
    for mut closed in closed_meshes(1) {
        let leaks = |closed: &ClosedMesh, rays: usize| {
            let tree = RayTree::build(&closed.meshes, &policies()[0].1).unwrap();
            shoot(closed, &[tree], rays, 4).1[0].len()
        };
        let whole = leaks(&closed, 2000);
        let middle = closed.meshes[0].len() / 2;
        let indices = &mut closed.meshes[0].indices;
        indices.remove(middle);
        assert!(leaks(&closed, 20_000) > 2 * whole, "{}: a hole of a triangle went unnoticed", closed.name);
    }
}

#[test]
fn tampering_with_hits_is_noticed() {
    let case = &ray_cases()[2];
    let scene = SceneUnderTest::new(case, 5);
    let trees = [RayTree::build(&scene.meshes, &policies()[0].1).unwrap()];
    let run =
        |tamper: &dyn Fn(&mut Vec<mbkd::Hit>)| compare_rays(&scene, &trees, RAYS, &mut Random(77), tamper).remove(0);
    let fine = run(&|_| ());
    assert!(fine.is_right() && fine.t.worst_ulps() <= ULPS);
    let lost = run(&|hits| hits.truncate(hits.len().saturating_sub(1)));
    assert!(lost.false_misses > 50, "{}", lost.false_misses);
    let far = run(&|hits| hits.iter_mut().for_each(|h| h.t = f32::from_bits(h.t.to_bits() + 8)));
    assert!(far.t.worst_ulps() > ULPS && far.t.worst_ulps() < 20.0, "{}", far.t.worst_ulps());
    let turned = run(&|hits| hits.iter_mut().for_each(|h| (h.u, h.v) = (h.v, h.u)));
    assert!(turned.weights.worst_units() > 1e3);
    let other = run(&|hits| hits.iter_mut().for_each(|h| h.primitive = (h.primitive + 1) % 80));
    assert!(other.false_hits > 50 && other.false_misses > 50);
}

#[test]
fn tampering_with_neighbors_is_noticed() {
    let case = &point_cases()[2];
    let run = |tamper: &dyn Fn(&mut Vec<mbkd::Neighbor>)| {
        compare_neighbors(case, &[PointStructure::Linear], 50, &mut Random(11), tamper).unwrap().remove(0)
    };
    let lost = run(&|found| *found = found[1..].to_vec());
    assert!(lost.wrong_order > 10 && lost.wrong_count > 10);
    let turned = run(&|found| found.reverse());
    assert!(turned.wrong_order > 10 && turned.wrong_count == 0);
    let far = run(&|found| found.iter_mut().for_each(|n| n.distance_squared *= 1.000_001));
    assert!(far.distance.worst_ulps() > ULPS && far.distance.worst_ulps() < 20.0);
}
