//! Points given in f64: every answer equals brute force over all points in f64, rounding the squared distance once.

use crate::support::Rng;
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{
    Aabb, ListError, Neighbor, NeighborCsr, PointArrays, PointError, PointLayerKind, PointParams, PointStructure,
    PointTree, Radii, SimdLevel, TimeInterval, TreePoint, Visitor,
};

struct Cloud {
    keys: Vec<Vec<DVec3>>,
    active: Vec<TimeInterval>,
}

fn vec(rng: &mut Rng) -> DVec3 {
    // More bits than f32 has.
    rng.vec().as_dvec3() + rng.vec().as_dvec3() * 1e-9
}

impl Cloud {
    /// Two clusters of this size, at this distance.
    fn new(
        count: usize,
        keys: usize,
        (size, apart, speed): (f64, f64, f64),
        partly_active: bool,
        rng: &mut Rng,
    ) -> Cloud {
        let mut cloud = Cloud { keys: vec![Vec::new(); keys], active: Vec::new() };
        for i in 0..count {
            let mut at = vec(rng) * size + DVec3::new(0.7, 1.0, -0.3) * (apart * (i % 2) as f64);
            for key in &mut cloud.keys {
                key.push(at);
                at += vec(rng) * speed + DVec3::X * (3.0 * speed);
            }
            let begin = rng.unit() * 0.8;
            let part = TimeInterval::new(begin, begin + 0.2).unwrap();
            cloud.active.push(if partly_active && i % 3 == 0 { part } else { TimeInterval::FULL });
        }
        cloud
    }

    fn tree(&self, structure: PointStructure, simd: SimdLevel) -> Result<PointTree, PointError> {
        let keys: Vec<&[DVec3]> = self.keys.iter().map(|key| &key[..]).collect();
        let params = PointParams { structure, simd, ..PointParams::default() };
        PointTree::build(&PointArrays { keys: &keys, active: &self.active, ids: &[] }, &params)
    }

    fn at(&self, point: usize, time: f32) -> DVec3 {
        let segments = (self.keys.len() - 1).max(1);
        // The product is exact.
        let along = f64::from(time) * segments as f64;
        let segment = (along as usize).min(segments - 1);
        let (a, b) = (self.keys[segment][point], self.keys[(segment + 1).min(self.keys.len() - 1)][point]);
        let phase = along - segment as f64;
        if phase < 0.5 { a + (b - a) * phase } else { b + (b - a) * (phase - 1.0) }
    }

    /// All points that exist, nearest first.
    fn all(&self, q: DVec3, time: f32) -> Vec<Neighbor> {
        let active = (0..self.active.len()).filter(|&i| self.active[i].contains(time));
        let neighbor = |i: usize| {
            let d = self.at(i, time) - q;
            let distance_squared = ((d.x * d.x + d.y * d.y) + d.z * d.z) as f32;
            Neighbor { id: i as u32, distance_squared }
        };
        let mut all: Vec<Neighbor> = active.map(neighbor).collect();
        all.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
        all
    }
}

/// Compares every form of query at one point.
fn compare(cloud: &Cloud, tree: &PointTree, q: DVec3, time: f32, about: &str) {
    let all = cloud.all(q, time);
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
    assert_eq!(tree.nearest_n_batch(&[(q, time)], 4).get(0), &all[..4.min(all.len())]);
}

const STRUCTURES: [PointStructure; 3] =
    [PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(3)];

#[test]
fn every_query_equals_brute_force() {
    let mut rng = Rng(17);
    for (size, apart, speed) in
        [(1.0, 1e7, 0.0), (1e-3, 1e7, 1e-4), (1.0, 0.0, 2.0), (1e-3, 1e7, 1e3), (1e-20, 1e-3, 0.0)]
    {
        for (keys, partly_active) in [(1, false), (2, false), (2, true), (4, true)] {
            let cloud = Cloud::new(700, keys, (size, apart, speed), partly_active, &mut rng);
            for structure in STRUCTURES {
                for simd in SimdLevel::available() {
                    let tree = cloud.tree(structure, simd).unwrap();
                    for round in 0..6 {
                        let time = [0.0, 1.0, 0.25, 1.0 / 3.0, rng.unit(), rng.unit()][round];
                        let near = cloud.at(round * 131, time);
                        let q = near + vec(&mut rng) * size * [0.0, 1e-2, 1.0, 10.0, 1e6, 1.0][round];
                        let about =
                            format!("{size} {apart} {speed}, {keys} keys, {structure:?}, {simd}, {q} at {time}");
                        compare(&cloud, &tree, q, time, &about);
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
    let mut rng = Rng(31);
    let cloud = Cloud::new(900, 2, (1.0, 1e5, 0.2), false, &mut rng);
    let sampled = |keys: usize, by: f64| -> Cloud {
        let at = |key: usize, i: usize| {
            let (a, b) = (cloud.keys[0][i], cloud.keys[1][i]);
            let off = if key == 1 && i == 500 { by } else { 0.0 };
            if key + 1 == keys { b } else { a + (b - a) * (key as f64 / (keys - 1) as f64) + off }
        };
        let keys = (0..keys).map(|key| (0..cloud.keys[0].len()).map(|i| at(key, i)).collect());
        Cloud { keys: keys.collect(), active: cloud.active.clone() }
    };
    for structure in STRUCTURES {
        let of = |cloud: &Cloud| cloud.tree(structure, SimdLevel::best()).unwrap();
        let two = of(&cloud);
        for keys in [3, 9, 65] {
            let tree = of(&sampled(keys, 0.0));
            assert_eq!(tree.statistics().layers, two.statistics().layers, "{keys} keys, {structure:?}");
            for _ in 0..100 {
                let (q, time) = (cloud.keys[0][rng.bits() as usize % 900], rng.unit());
                let [a, b] = [&two, &tree].map(|tree| tree.nearest_n(q, time, 5));
                assert_eq!(a, b, "{keys} keys, {structure:?}");
            }
            assert_ne!(of(&sampled(keys, 1e-9)).statistics().layers, two.statistics().layers);
        }
    }
}

#[test]
fn times_a_rounding_beside_keys_are_exact() {
    let mut rng = Rng(29);
    for keys in [4, 200] {
        let cloud = Cloud::new(40, keys, (1.0, 0.0, 2.0), false, &mut rng);
        let tree = cloud.tree(PointStructure::Automatic, SimdLevel::best()).unwrap();
        let rounded = (1..keys - 1).flat_map(|key| {
            let time = (key as f64 / (keys - 1) as f64) as f32;
            [time.next_down(), time, time.next_up()]
        });
        for time in rounded {
            let q = cloud.at(7, time) + vec(&mut rng);
            compare(&cloud, &tree, q, time, &format!("{keys} keys, {q} at {time}"));
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

/// Lists as ids and bits of squared distances.
type Lists = Vec<Vec<(u32, u32)>>;

/// The squared distances of all points of one cloud from those of another at a time, rounded once; `None` if one of
/// both does not exist then.
fn compare_all(own: &Cloud, among: &Cloud, time: f32) -> Vec<Vec<Option<f32>>> {
    let places = |cloud: &Cloud| -> Vec<Option<DVec3>> {
        let place = |i: usize| cloud.active[i].contains(time).then(|| cloud.at(i, time));
        (0..cloud.active.len()).map(place).collect()
    };
    let (own, among) = (places(own), places(among));
    let squared = |q: Option<DVec3>, p: &Option<DVec3>| {
        let d = (*p)? - q?;
        Some(((d.x * d.x + d.y * d.y) + d.z * d.z) as f32)
    };
    own.iter().map(|q| among.iter().map(|p| squared(*q, p)).collect()).collect()
}

/// The filtered lists within the radii, by id.
fn within(all: &[Vec<Option<f32>>], radii: &[f32], keep: impl Fn(u32, u32) -> bool) -> Lists {
    let list = |(i, (row, radius)): (u32, (&Vec<Option<f32>>, &f32))| {
        let near = (0..).zip(row).filter_map(|(j, squared)| Some((j, (*squared)?)));
        let near = near.filter(|&(j, squared)| squared <= radius * radius && keep(i, j));
        near.map(|(j, squared)| (j, squared.to_bits())).collect()
    };
    (0..).zip(all.iter().zip(radii)).map(list).collect()
}

fn found(lists: &NeighborCsr) -> Lists {
    let entry = |n: usize| (lists.ids()[n], lists.distances_squared()[n].to_bits());
    lists.offsets().windows(2).map(|ends| (ends[0]..ends[1]).map(entry).collect()).collect()
}

/// The lists at a time by comparing all pairs.
struct Expected {
    time: f32,
    all: Vec<Vec<Option<f32>>>,
    /// Within the same radius of all points: of the others, of those with a higher id, of another set.
    equal: [Lists; 3],
}

impl Expected {
    fn new(cloud: &Cloud, other: &Cloud, radii: &[f32], time: f32) -> Expected {
        let (all, all_others) = (compare_all(cloud, cloud, time), compare_all(cloud, other, time));
        let others = within(&all, radii, |i, j| i != j);
        assert!(others.iter().any(|list| list.len() > 3));
        let equal = [others, within(&all, radii, |i, j| i < j), within(&all_others, radii, |_, _| true)];
        Expected { time, all, equal }
    }
}

#[test]
fn lists_equal_comparing_all_pairs() {
    let mut rng = Rng(23);
    let mut lists = NeighborCsr::new();
    for (size, apart, speed) in [(1.0, 1e7, 0.0), (1e-3, 1e7, 1e-4), (1.0, 0.0, 2.0), (1e-20, 1e-3, 0.0)] {
        for (keys, partly_active) in [(1, false), (2, true), (4, false)] {
            let cloud = Cloud::new(600, keys, (size, apart, speed), partly_active, &mut rng);
            let other = Cloud::new(100, keys, (size, apart, speed), partly_active, &mut rng);
            let radius = (0.4 * size) as f32;
            let equal = vec![radius; 600];
            let expected = |time| Expected::new(&cloud, &other, &equal, time);
            let ends = [expected(0.0), expected(1.0)];
            for simd in SimdLevel::available() {
                for structure in STRUCTURES {
                    let [tree, others] = [&cloud, &other].map(|cloud| cloud.tree(structure, simd).unwrap());
                    for expected in ends.iter().chain([&expected(rng.unit())]) {
                        let time = expected.time;
                        let about = format!("{size} {apart} {speed}, {keys} keys, {structure:?}, {simd}, at {time}");
                        let own: Vec<f32> = equal.iter().map(|r| r * 2.0 * rng.unit()).collect();
                        let query = tree.neighbor_lists(time, radius).with_distances().sorted().rows_by_id();
                        let [of_others, higher, of_another] = &expected.equal;
                        query.run(&mut lists).unwrap();
                        assert_eq!(found(&lists), *of_others, "{about}");
                        query.pairs_once().run(&mut lists).unwrap();
                        assert_eq!(found(&lists), *higher, "{about}");
                        query.among(&others).run(&mut lists).unwrap();
                        assert_eq!(found(&lists), *of_another, "{about}");
                        let query = tree.neighbor_lists(time, Radii::Own(&own)).with_distances().sorted().rows_by_id();
                        query.run(&mut lists).unwrap();
                        assert_eq!(found(&lists), within(&expected.all, &own, |i, j| i != j), "{about}");
                    }
                }
            }
        }
    }
}

#[test]
fn lists_do_not_depend_on_the_number_of_threads() {
    let cloud = Cloud::new(5000, 2, (1.0, 1e7, 0.1), true, &mut Rng(31));
    let tree = cloud.tree(PointStructure::Automatic, SimdLevel::best()).unwrap();
    let lists = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut lists = NeighborCsr::new();
        pool.install(|| tree.neighbor_lists(0.3, 0.2).with_distances().run(&mut lists)).unwrap();
        (lists.points().to_vec(), found(&lists))
    };
    let alone = lists(1);
    assert!(alone.1.iter().map(Vec::len).sum::<usize>() > 5000);
    for threads in [2, 3, 8] {
        assert_eq!(lists(threads), alone, "{threads} threads");
    }
}

#[test]
fn queries_that_f64_points_do_not_support_are_rejected() {
    let cloud = Cloud::new(100, 2, (1.0, 1e7, 1.0), false, &mut Rng(1));
    let error = cloud.tree(PointStructure::Mbkd, SimdLevel::best()).unwrap_err();
    assert!(matches!(error, PointError::Parameter { name: "structure", .. }), "{error}");
    let tree = cloud.tree(PointStructure::Automatic, SimdLevel::best()).unwrap();
    let mut lists = NeighborCsr::new();
    let query = tree.neighbor_lists(0.0, 1.0);
    assert_eq!(query.periodic([Some(9.0), None, None]).run(&mut lists), Err(ListError::Double));
    assert_eq!(query.with_displacements().run(&mut lists), Err(ListError::Double));
    let larger = Radii::Larger { own: &[1.0; 100], others: &[1.0; 100] };
    assert_eq!(tree.neighbor_lists(0.0, larger).run(&mut lists), Err(ListError::Double));
    let sum = Radii::Sum { own: &[1.0; 100], others: &[1.0; 100] };
    assert_eq!(tree.neighbor_lists(0.0, sum).run(&mut lists), Err(ListError::Double));
    let own = Radii::Own(&[1.0; 99]);
    assert_eq!(tree.neighbor_lists(0.0, own).run(&mut lists), Err(ListError::MissingRadius { id: 99 }));
    let single = PointTree::build(&[[0.0f32; 3]], &PointParams::default()).unwrap();
    assert_eq!(query.among(&single).run(&mut lists), Err(ListError::Double));
    assert_eq!(single.neighbor_lists(0.0, 1.0).among(&tree).run(&mut lists), Err(ListError::Double));
    assert_eq!(tree.within_lists(&[[0.0f64; 3]], 0.0, 1.0).run(&mut lists), Err(ListError::Double));
    assert_eq!(tree.neighbor_lists_with_skin(0.0, 1.0, 0.1, 1.0, &mut lists), Err(ListError::Double));
    assert!(matches!(tree.neighbor_lists_swept(TimeInterval::FULL, 1.0), Err(ListError::Double)));
    // Rounded to f32, all of it works.
    let keys: Vec<&[DVec3]> = cloud.keys.iter().map(|key| &key[..]).collect();
    let set = PointArrays { keys: &keys, active: &[], ids: &[] };
    let params = PointParams { structure: PointStructure::Mbkd, round_to_f32: true, ..PointParams::default() };
    let tree = PointTree::build(&set, &params).unwrap();
    assert_eq!(tree.neighbor_lists(0.0, 1.0).run(&mut NeighborCsr::new()), Ok(()));
}

#[test]
fn f32_numbers_given_in_f64_are_f32_points() {
    let mut rng = Rng(9);
    let points: Vec<[f32; 3]> = (0..5000).map(|_| rng.vec().to_array()).collect();
    let wide: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let [a, b] = [
        PointTree::build(&points, &PointParams::default()).unwrap(),
        PointTree::build(&wide, &PointParams::default()).unwrap(),
    ];
    assert_eq!((a.statistics(), a.origin()), (b.statistics(), b.origin()));
    let more: Vec<[f64; 3]> = wide.iter().map(|p| p.map(|x| x + 1e-12)).collect();
    let precise = PointTree::build(&more, &PointParams::default()).unwrap();
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
    visitors_see(&Cloud::new(700, 2, (1e-3, 1e7, 1.0), true, &mut Rng(4)), &[0.0, 0.4, 1.0]);
    // Eleven segments, at the floats next to their keys.
    let beside = |key: i16| f32::from(key) / 11.0;
    let times: Vec<f32> =
        (1..11).flat_map(|key| [beside(key).next_down(), beside(key), beside(key).next_up()]).collect();
    visitors_see(&Cloud::new(700, 12, (1e-3, 1e7, 1.0), true, &mut Rng(4)), &times);
}

fn visitors_see(cloud: &Cloud, times: &[f32]) {
    for structure in STRUCTURES {
        let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
        for &time in times {
            let mut all = Everything { depth: Vec::new(), found: Vec::new() };
            assert!(tree.traverse(time, &mut all).is_continue());
            let mut ids: Vec<u32> = all.found.iter().map(|p| p.id).collect();
            ids.sort_unstable();
            let active: Vec<u32> = (0..700).filter(|&i| cloud.active[i as usize].contains(time)).collect();
            assert_eq!(ids, active);
            for p in &all.found {
                assert_eq!(p.position, cloud.at(p.id as usize, time));
            }
        }
    }
}
