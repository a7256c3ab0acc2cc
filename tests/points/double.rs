//! Points given in f64: every answer equals brute force over all points in f64, rounding the squared distance once.

use crate::set::{DOUBLE_STRUCTURES, Set};
use crate::support::Random;
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{
    Aabb, ListError, Neighbor, NeighborLists, PointArrays, PointError, PointLayerKind, PointParams, PointStructure,
    PointTree, Precision, Radii, RadiusOf, SimdLevel, TimeInterval, TreePoint, Visitor,
};

/// All points that exist, nearest first.
pub fn all(set: &Set, q: DVec3, time: f32) -> Vec<Neighbor> {
    let active = (0..set.len()).filter(|&i| set.active[i].contains(time));
    let neighbor = |i: usize| {
        let d = set.at(i, time) - q;
        let distance_squared = ((d.x * d.x + d.y * d.y) + d.z * d.z) as f32;
        Neighbor { id: i as u32, distance_squared }
    };
    let mut all: Vec<Neighbor> = active.map(neighbor).collect();
    all.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
    all
}

/// Compares every form of query at one point.
fn compare(set: &Set, tree: &PointTree, q: DVec3, time: f32, about: &str) {
    let all = all(set, q, time);
    for k in [1, 3, 16, 40] {
        let nearest = &all[..k.min(all.len())];
        assert_eq!(tree.nearest_n(q, time, k), nearest, "{about}, {k} nearest");
        let even: Vec<Neighbor> = all.iter().copied().filter(|n| n.id % 2 == 0).take(k).collect();
        assert_eq!(tree.query(q, time).filter(|id| id % 2 == 0).nearest_n(k), even, "{about}, {k} even ones");
    }
    assert_eq!(tree.nearest(q, time), all.first().copied(), "{about}");
    let radius = all.get(all.len() / 50).map_or(1.0, |n| n.distance_squared.sqrt());
    let within: Vec<Neighbor> = all.iter().copied().filter(|n| n.distance_squared <= radius * radius).collect();
    let query = tree.query(q, time).radius(radius);
    assert_eq!(query.collect_sorted(), within, "{about}, within {radius}");
    assert_eq!(query.count(), within.len());
    assert_eq!(tree.nearest_n_within(q, time, 5, radius), within[..5.min(within.len())], "{about}");
    let sorted = |mut found: Vec<Neighbor>| {
        found.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        found
    };
    assert_eq!(sorted(query.iter().collect()), within);
    let mut visited = Vec::new();
    assert!(
        query
            .for_each(|n| {
                visited.push(n);
                ControlFlow::Continue(())
            })
            .is_continue()
    );
    assert_eq!(sorted(visited), within);
    let near = query.approximate(0.5).nearest_n(8);
    for (found, exact) in near.iter().zip(&within) {
        assert!(found.distance_squared <= exact.distance_squared * 2.25 * 1.000_001, "{about}");
    }
    assert_eq!(near.len(), within.len().min(8));
    assert_eq!(tree.nearest_n_batch(&[(q, time)], 4).row(0), &all[..4.min(all.len())]);
}

#[test]
fn every_query_equals_brute_force() {
    let mut rng = Random(17);
    for (size, apart, speed) in
        [(1.0, 1e7, 0.0), (1e-3, 1e7, 1e-4), (1.0, 0.0, 2.0), (1e-3, 1e7, 1e3), (1e-20, 1e-3, 0.0)]
    {
        for (keys, partly_active) in [(1, false), (2, false), (2, true), (4, true)] {
            let set = Set::clusters(700, keys, (size, apart, speed), partly_active, &mut rng);
            for structure in DOUBLE_STRUCTURES {
                for simd in SimdLevel::available() {
                    let tree = set.tree(structure, simd);
                    for round in 0..6 {
                        let time = [0.0, 1.0, 0.25, 1.0 / 3.0, rng.unit(), rng.unit()][round];
                        let near = set.at(round * 131, time);
                        let q = near + rng.dvec() * size * [0.0, 1e-2, 1.0, 10.0, 1e6, 1.0][round];
                        let about =
                            format!("{size} {apart} {speed}, {keys} keys, {structure:?}, {simd}, {q} at {time}");
                        compare(&set, &tree, q, time, &about);
                    }
                }
            }
        }
    }
}

/// The product of such a time and the number of segments is rounded to the number of a key in f32, from either side.
/// Sets whose points move on straight lines equal those of two keys, up to the rounding of f64.
#[test]
fn keys_of_linear_motion_cost_nothing() {
    let mut rng = Random(31);
    let set = Set::clusters(900, 2, (1.0, 1e5, 0.2), false, &mut rng);
    let sampled = |keys: usize, by: f64| -> Set {
        let at = |key: usize, i: usize| {
            let (a, b) = (set.keys[0][i], set.keys[1][i]);
            let off = if key == 1 && i == 500 { by } else { 0.0 };
            if key + 1 == keys { b } else { a + (b - a) * (key as f64 / (keys - 1) as f64) + off }
        };
        let keys = (0..keys).map(|key| (0..set.keys[0].len()).map(|i| at(key, i)).collect());
        Set::new(keys.collect(), false)
    };
    for structure in DOUBLE_STRUCTURES {
        let of = |set: &Set| set.tree(structure, SimdLevel::best());
        let two = of(&set);
        for keys in [3, 9, 65] {
            let tree = of(&sampled(keys, 0.0));
            assert_eq!(tree.statistics().layers, two.statistics().layers, "{keys} keys, {structure:?}");
            for _ in 0..100 {
                let (q, time) = (set.keys[0][rng.below(900)], rng.unit());
                let [a, b] = [&two, &tree].map(|tree| tree.nearest_n(q, time, 5));
                assert_eq!(a, b, "{keys} keys, {structure:?}");
            }
            assert_ne!(of(&sampled(keys, 1e-9)).statistics().layers, two.statistics().layers);
        }
    }
}

#[test]
fn times_a_rounding_beside_keys_are_exact() {
    let mut rng = Random(29);
    for keys in [4, 200] {
        let set = Set::clusters(40, keys, (1.0, 0.0, 2.0), false, &mut rng);
        let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
        let rounded = (1..keys - 1).flat_map(|key| {
            let time = (key as f64 / (keys - 1) as f64) as f32;
            [time.next_down(), time, time.next_up()]
        });
        for time in rounded {
            let q = set.at(7, time) + rng.dvec();
            compare(&set, &tree, q, time, &format!("{keys} keys, {q} at {time}"));
        }
    }
}

/// A millimetre apart, ten thousand kilometres from each other: every point finds its own neighbours.
#[test]
fn clusters_far_apart_keep_their_spacing() {
    let points: Vec<DVec3> = (0..1000)
        .map(|i| {
            DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100 % 5)) * 1e-3
                + DVec3::X * (1e7 * f64::from(i / 500))
        })
        .collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    for (i, p) in points.iter().enumerate() {
        let found = tree.query(*p, 0.0).filter(|id| id != i as u32).nearest().unwrap();
        assert!((f64::from(found.distance_squared).sqrt() - 1e-3).abs() < 1e-8, "{i}: {found:?}");
    }
    let work = tree.query(points[7], 0.0).work(4);
    assert!(work.blocks < 20, "{work:?}");
}

#[test]
fn queries_that_f64_points_do_not_support_are_rejected() {
    let set = Set::clusters(100, 2, (1.0, 1e7, 1.0), false, &mut Random(1));
    let keys: Vec<&[DVec3]> = set.keys.iter().map(|key| &key[..]).collect();
    let points = PointArrays { keys: &keys, active: &[], ids: &[] };
    let params = PointParams { structure: PointStructure::Kd, ..PointParams::default() };
    let error = PointTree::build(&points, &params).unwrap_err();
    assert!(matches!(error, PointError::Parameter { name: "structure", .. }), "{error}");
    let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
    let mut lists = NeighborLists::new();
    let query = tree.neighbor_lists(0.0, 1.0);
    let own = Radii::Own(&[1.0; 99]);
    assert_eq!(
        tree.neighbor_lists(0.0, own).run(&mut lists),
        Err(ListError::MissingRadius { of: RadiusOf::Point(99) })
    );
    let single = PointTree::build(&[[0.0f32; 3]], &PointParams::default()).unwrap();
    assert_eq!(query.among(&single).run(&mut lists), Err(ListError::Double));
    assert_eq!(single.neighbor_lists(0.0, 1.0).among(&tree).run(&mut lists), Err(ListError::Double));
    assert_eq!(tree.neighbor_lists_with_skin(0.0, 1.0, -0.1, 1.0, &mut lists), Err(ListError::Skin));
    assert_eq!(tree.neighbor_lists_with_skin(0.0, f32::NAN, 0.1, 1.0, &mut lists), Err(ListError::Radius { of: None }));
    assert_eq!(tree.neighbor_lists_with_skin(0.5, 1.0, 0.1, 0.4, &mut lists), Err(ListError::Until));
    let swept = tree.neighbor_lists_swept(TimeInterval::FULL, -1.0).collect();
    assert_eq!(swept, Err(ListError::Radius { of: None }));
    // Rounded to f32, all of it works.
    let tree = PointTree::build(&points, &PointParams { precision: Precision::Single, ..params }).unwrap();
    assert_eq!(tree.neighbor_lists(0.0, 1.0).run(&mut NeighborLists::new()), Ok(()));
}

#[test]
fn f32_numbers_given_in_f64_are_f32_points() {
    let mut rng = Random(9);
    let points: Vec<[f32; 3]> = (0..5000).map(|_| rng.vec().to_array()).collect();
    let wide: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let [a, b] = [
        PointTree::build(&points, &PointParams::default()).unwrap(),
        PointTree::build(&wide, &PointParams::default()).unwrap(),
    ];
    assert_eq!((a.statistics(), a.origin()), (b.statistics(), b.origin()));
    let more: Vec<[f64; 3]> = wide.iter().map(|p| p.map(|x| x + 1e-12)).collect();
    let precise = PointTree::build(&more, &PointParams::default()).unwrap();
    let in_f64 = PointParams { precision: Precision::Double, ..PointParams::default() };
    for forced in [PointTree::build(&points, &in_f64).unwrap(), PointTree::build(&wide, &in_f64).unwrap()] {
        assert_eq!(forced.statistics().bytes(), precise.statistics().bytes());
        let q = DVec3::from_array(wide[7]) + DVec3::new(1e-9, -2e-9, 3e-9);
        let [near, rounded] = [&forced, &a].map(|tree| tree.nearest(q, 0.0).unwrap());
        assert_eq!((near.id, near.distance_squared), (7, q.distance_squared(DVec3::from_array(wide[7])) as f32));
        assert_eq!((rounded.id, rounded.distance_squared), (7, 0.0));
    }
    assert_eq!(precise.statistics().layers[0].kind, PointLayerKind::Static);
    assert!(precise.statistics().bytes() > a.statistics().bytes());
}

/// Tests whether boxes hold their contents.
struct Everything {
    depth: Vec<Aabb>,
    found: Vec<TreePoint>,
}

impl Visitor<TreePoint> for Everything {
    fn enter(&mut self, b: &Aabb) -> Option<f32> {
        self.depth.push(*b);
        Some(0.0)
    }
    fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
        assert!(self.depth.iter().any(|b| b.contains(point.position)), "{point:?} is in no box");
        self.found.push(point);
        ControlFlow::Continue(())
    }
}

#[test]
fn visitors_see_positions_in_f64() {
    visitors_see(&Set::clusters(700, 2, (1e-3, 1e7, 1.0), true, &mut Random(4)), &[0.0, 0.4, 1.0]);
    // Eleven segments, at the floats next to their keys.
    let beside = |key: i16| f32::from(key) / 11.0;
    let times: Vec<f32> =
        (1..11).flat_map(|key| [beside(key).next_down(), beside(key), beside(key).next_up()]).collect();
    visitors_see(&Set::clusters(700, 12, (1e-3, 1e7, 1.0), true, &mut Random(4)), &times);
}

fn visitors_see(set: &Set, times: &[f32]) {
    for structure in DOUBLE_STRUCTURES {
        let tree = set.tree(structure, SimdLevel::best());
        for &time in times {
            let mut all = Everything { depth: Vec::new(), found: Vec::new() };
            assert!(tree.traverse(time, &mut all).is_continue());
            let mut ids: Vec<u32> = all.found.iter().map(|p| p.id).collect();
            ids.sort_unstable();
            let active: Vec<u32> = (0..700).filter(|&i| set.active[i as usize].contains(time)).collect();
            assert_eq!(ids, active);
            for p in &all.found {
                assert_eq!(p.position, set.at(p.id as usize, time));
            }
        }
    }
}
