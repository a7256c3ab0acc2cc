//! Neighbour lists of points in f64, with all options: every list equals comparing all pairs in f64.

use crate::list_case::ListCase;
use crate::set::{DOUBLE_STRUCTURES, Set};
use crate::support::Random;
use mbkd::glam::DVec3;
use mbkd::{ListError, NeighborLists, PointParams, PointStructure, PointTree, Precision, Radii, SimdLevel};

/// Sizes of clusters, how far they are apart, and speeds.
const SETS: [(f64, f64, f64); 5] =
    [(1.0, 1e7, 0.0), (1e-3, 1e7, 1e-4), (1.0, 0.0, 2.0), (1e-20, 1e-3, 0.0), (1e-25, 1e-22, 1e-24)];

#[test]
fn lists_equal_comparing_all_pairs() {
    let mut rng = Random(23);
    let mut lists = NeighborLists::new();
    for (number, set) in SETS.into_iter().enumerate() {
        let size = set.0;
        for (keys, partly_active) in [(1, false), (2, true), (4, false)] {
            let sets = [500, 100].map(|count| Set::clusters(count, keys, set, partly_active, &mut rng));
            let radius = (0.4 * size) as f32;
            let mut radii = |count| -> Vec<f32> { (0..count).map(|_| radius * 2.0 * rng.unit()).collect() };
            let (own, others) = (radii(500), radii(100));
            let times = [0.0, 1.0, rng.unit()];
            let all = DOUBLE_STRUCTURES
                .into_iter()
                .flat_map(|s| SimdLevel::available().into_iter().map(move |simd| (s, simd)));
            let trees: Vec<_> =
                all.map(|(s, simd)| (sets.each_ref().map(|c| c.tree(s, simd)), format!("{s:?}, {simd}"))).collect();
            for time in times {
                let plain = ListCase::plain(time, radius);
                let period = Some(size * 1.37);
                // Many periods from zero, and the clusters in one.
                let periodic = if set.1 > 1e6 * size { [None, None, None] } else { [period, None, period] };
                let mut cases = vec![
                    plain.clone(),
                    ListCase { once: true, ..plain.clone() },
                    ListCase { other: true, ..plain.clone() },
                    ListCase { radii: Radii::Own(&own), ..plain.clone() },
                    ListCase { radii: Radii::Larger { own: &own, others: &own }, once: true, ..plain.clone() },
                    ListCase { radii: Radii::Sum { own: &own, others: &others }, other: true, ..plain.clone() },
                    ListCase { periods: periodic, ..plain.clone() },
                    ListCase { periods: periodic, radii: Radii::Own(&own), other: true, ..plain.clone() },
                    ListCase { periods: periodic, radii: Radii::Sum { own: &own, others: &own }, ..plain.clone() },
                    ListCase { radii: Radii::Equal(f32::INFINITY), ..plain.clone() },
                ];
                if number == 0 {
                    cases.push(ListCase { periods: [Some(1e7 + 0.3), None, Some(3e6 + 0.1)], ..plain.clone() });
                }
                for (case, request) in cases.iter().enumerate() {
                    let expected = request.expected([&sets[0], &sets[1]]);
                    for ([tree, among], what) in &trees {
                        let about = format!("{what}, {set:?}, {keys} keys, case {case}");
                        request.check(&expected, [tree, among], &sets[0], &mut lists, &about);
                    }
                }
            }
        }
    }
}

/// Pairs at the radius up to roundings of f64 and of f32, where a box that is rounded inward would lose some.
#[test]
fn neighbours_at_the_radius_are_not_lost() {
    let mut rng = Random(5);
    let mut lists = NeighborLists::new();
    for (radius, far) in [(0.25f32, 0.0), (1e-3, 1e6), (3e-7, 1.0), (1e-21, 1e-20), (7.0, 1e9)] {
        let r = f64::from(radius);
        let mut points = Vec::new();
        for _ in 0..150 {
            let at = rng.vec().as_dvec3() * (3.0 * r) + DVec3::new(1.0, -0.7, 0.3) * far;
            let way = rng.vec().as_dvec3().normalize();
            // Along an axis, where the distance is that of a face, and in any direction.
            let way = if points.len() % 4 == 0 { way } else { DVec3::X };
            let off = [0.0, 1e-16, -1e-16, 6e-8, -6e-8, 2.9e-8][points.len() / 2 % 6];
            points.extend([at, at + way * (r * (1.0 + off))]);
        }
        let set = Set::new(vec![points], false);
        let case = ListCase::plain(0.0, radius);
        let expected = case.expected([&set; 2]);
        for simd in SimdLevel::available() {
            let tree = set.tree(PointStructure::Automatic, simd);
            case.check(&expected, [&tree; 2], &set, &mut lists, &format!("{radius} {far} {simd}"));
        }
    }
}

/// Lists around positions equal single queries, also where all positions are f32 numbers.
#[test]
fn lists_of_positions_equal_single_queries() {
    let mut rng = Random(41);
    for (what, active) in [(SETS[0], false), (SETS[2], true)] {
        let set = Set::clusters(1500, 3, what, active, &mut rng);
        let mut queries: Vec<DVec3> = (0..600).map(|i| set.at(i, 0.4) + rng.vec().as_dvec3() * 0.1).collect();
        queries.extend([DVec3::ZERO, DVec3::splat(1e18), DVec3::NEG_ONE]);
        let rounded: Vec<[f32; 3]> = queries.iter().map(|q| q.as_vec3().to_array()).collect();
        let own: Vec<f32> = queries.iter().map(|_| rng.unit()).collect();
        for simd in SimdLevel::available() {
            let tree = set.tree(PointStructure::Automatic, simd);
            let mut lists = NeighborLists::new();
            for radii in [Radii::Equal(0.3), Radii::Own(&own)] {
                let compare = |lists: &NeighborLists, query: &dyn Fn(usize) -> DVec3| {
                    for i in 0..queries.len() {
                        let radius = if let Radii::Own(own) = radii { own[i] } else { 0.3 };
                        let range = lists.range(i);
                        let entry = |n: usize| (lists.ids()[n], lists.distances_squared()[n].to_bits());
                        let mut found: Vec<(u32, u32)> = range.map(entry).collect();
                        let single = tree.within(query(i), 0.4, radius);
                        let mut single: Vec<_> = single.iter().map(|n| (n.id, n.distance_squared.to_bits())).collect();
                        found.sort_unstable();
                        single.sort_unstable();
                        assert_eq!(found, single, "{what:?}, {simd}, query {i}");
                    }
                };
                tree.within_lists(&queries, 0.4, radii).with_distances().in_order().run(&mut lists).unwrap();
                assert!(lists.neighbors() > 600, "{}", lists.neighbors());
                compare(&lists, &|i| queries[i]);
                tree.within_lists(&rounded, 0.4, radii).with_distances().in_order().run(&mut lists).unwrap();
                compare(&lists, &|i| DVec3::from_array(rounded[i].map(f64::from)));
            }
        }
    }
    let tree = Set::clusters(100, 1, SETS[0], false, &mut rng).tree(PointStructure::Automatic, SimdLevel::best());
    let mut lists = NeighborLists::new();
    let bad = tree.within_lists(&[DVec3::ONE, DVec3::splat(3e18)], 0.0, 1.0).run(&mut lists);
    assert_eq!(bad, Err(ListError::Query { query: 1 }));
    assert_eq!(tree.within_lists(&[] as &[DVec3], 0.0, 1.0).run(&mut lists), Ok(()));
}

/// One memory for lists of sets in f32, f64 and f32.
#[test]
fn memory_serves_both_kinds_of_sets() {
    let set = Set::clusters(3000, 2, (1.0, 0.0, 0.1), false, &mut Random(3));
    let single: Vec<[f32; 3]> = set.keys[0].iter().map(|p| p.as_vec3().to_array()).collect();
    let trees = [
        PointTree::build(&single, &Default::default()).unwrap(),
        set.tree(PointStructure::Automatic, SimdLevel::best()),
    ];
    let mut lists = NeighborLists::new();
    for number in [0, 1, 0, 1] {
        trees[number].neighbor_lists(0.0, 0.3).run(&mut lists).unwrap();
        let mut alone = NeighborLists::new();
        trees[number].neighbor_lists(0.0, 0.3).run(&mut alone).unwrap();
        assert_eq!((lists.ids(), lists.offsets()), (alone.ids(), alone.offsets()));
    }
}

/// A period that f32 has not: points are at their nearest images by the period as it was given.
#[test]
fn periods_are_not_rounded() {
    let length = 0.1;
    let points = [DVec3::new(0.01, 0.02, 0.03), DVec3::new(0.01 + 9999.0 * length, 0.02, 0.03)];
    let tree = PointTree::build(&points, &Default::default()).unwrap();
    let mut lists = NeighborLists::new();
    tree.neighbor_lists(0.0, 1e-9).periodic([Some(length), None, None]).run(&mut lists).unwrap();
    assert_eq!(lists.neighbors(), 2);
    tree.neighbor_lists(0.0, 1e-9).periodic([Some(0.1f32), None, None]).run(&mut lists).unwrap();
    assert_eq!(lists.neighbors(), 0);
    let far = tree.neighbor_lists(0.0, 1e-9).periodic([Some(1e-5), None, None]).run(&mut lists);
    assert_eq!(far, Err(ListError::FarFromPeriod { axis: 0 }));
}

/// Differences whose squares are denormal in f32, or zero.
#[test]
fn pairs_whose_squared_distances_underflow_are_listed() {
    let (mut rng, mut lists, mut pairs) = (Random(85), NeighborLists::new(), 0);
    for round in 0..2000 {
        let points: Vec<DVec3> = (0..20).map(|_| rng.vec().as_dvec3() * 1e-22).collect();
        let params = PointParams { precision: Precision::Double, ..PointParams::default() };
        let tree = PointTree::build(&points, &params).unwrap();
        let radius = 1e-23 + 6e-23 * rng.unit();
        tree.neighbor_lists(0.0, radius).sorted().in_order().run(&mut lists).unwrap();
        for (i, list) in lists.iter() {
            let squared = |j: u32| {
                let d = points[j as usize] - points[i as usize];
                ((d.x * d.x + d.y * d.y) + d.z * d.z) as f32
            };
            let expected: Vec<u32> = (0..20).filter(|&j| j != i && squared(j) <= radius * radius).collect();
            assert_eq!(list, expected, "round {round}, point {i}");
            pairs += expected.len();
        }
    }
    assert!(pairs > 100, "{pairs}");
}
