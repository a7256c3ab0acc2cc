//! Every query in every structure on every instruction set against comparing all points.

use crate::support::{Cloud, KINDS, Random, cloud};
use core::ops::ControlFlow;
use mbkd::{
    MovingPoint, Neighbor, NeighborBuffer, PointArrays, PointLayerKind, PointLayerStatistics, PointParams,
    PointStructure, PointTree, SimdLevel, TimeInterval, glam::Vec3,
};

const STRUCTURES: [PointStructure; 5] = [
    PointStructure::Automatic,
    PointStructure::Linear,
    PointStructure::TimeSlices(1),
    PointStructure::TimeSlices(3),
    PointStructure::Kd,
];

fn build(cloud: &Cloud, structure: PointStructure, simd: SimdLevel) -> PointTree {
    let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
    let params = PointParams { structure, simd, max_references: 3.0, ..PointParams::default() };
    PointTree::build(&PointArrays { keys: &keys, active: &cloud.active, ids: &[] }, &params).unwrap()
}

fn ids(found: &[Neighbor]) -> Vec<Neighbor> {
    let mut all = found.to_vec();
    all.sort_by_key(|n| (n.distance_squared.to_bits(), n.id));
    all
}

/// Compares all queries at one point and time.
fn check(tree: &PointTree, cloud: &Cloud, q: Vec3, time: f32, buffer: &mut NeighborBuffer, what: &str) {
    let all = cloud.sorted(q, time);
    assert_eq!(tree.nearest(q, time), all.first().copied(), "{what}: nearest");
    for k in [0, 1, 2, 8, 31, 64, 300, all.len(), all.len() + 5] {
        let found = tree.query(q, time).nearest_n_into(k, buffer);
        assert_eq!(found, &all[..k.min(all.len())], "{what}: k = {k}");
    }
    let some = |i: usize| all.get(i).map_or(1.0, |n| n.distance());
    for radius in [0.0, some(0), some(5), some(40), some(all.len() / 2), f32::INFINITY] {
        let inside = all.partition_point(|n| n.distance_squared <= radius * radius);
        let inside = &all[..inside];
        assert_eq!(ids(tree.query(q, time).radius(radius).collect_into(buffer)), inside, "{what}: radius {radius}");
        assert_eq!(tree.query(q, time).radius(radius).collect_sorted_into(buffer), inside, "{what}: radius {radius}");
        assert_eq!(tree.count_within(q, time, radius), inside.len(), "{what}: count in {radius}");
        let iterated: Vec<Neighbor> = tree.query(q, time).radius(radius).iter().collect();
        assert_eq!(ids(&iterated), inside, "{what}: iterated in {radius}");
        assert_eq!(tree.nearest_n_within(q, time, 9, radius), &inside[..inside.len().min(9)], "{what}: 9 in {radius}");
        let mut seen = 0;
        let flow = tree.query(q, time).radius(radius).for_each(|_| {
            seen += 1;
            if seen == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert_eq!((seen, flow.is_break()), (inside.len().min(3), inside.len() >= 3), "{what}: visited in {radius}");
    }
    let odd = |id: u32| id % 3 == 1;
    let some: Vec<Neighbor> = all.iter().copied().filter(|n| odd(n.id)).collect();
    assert_eq!(tree.query(q, time).filter(odd).nearest(), some.first().copied(), "{what}: filtered nearest");
    for k in [1, 10, 100] {
        let found = tree.query(q, time).filter(odd).nearest_n_into(k, buffer);
        assert_eq!(found, &some[..k.min(some.len())], "{what}: filtered, k = {k}");
    }
    let exact: Vec<Neighbor> = all.iter().copied().take(10).collect();
    for (n, e) in tree.query(q, time).approximate(0.5).nearest_n(10).iter().zip(&exact) {
        assert!(n.distance() <= e.distance() * 1.5, "{what}: approximate {n:?} for {e:?}");
    }
}

fn times(cloud: &Cloud, rng: &mut Random) -> Vec<f32> {
    let mut times = vec![0.0, 1.0, 0.5, 0.5f32.next_down(), 1.0 / 3.0, rng.unit()];
    let active = cloud.active[rng.below(cloud.len())];
    times.extend([active.begin(), active.end(), active.end().next_down()]);
    times
}

#[test]
fn every_query_equals_comparing_all_points() {
    let seed = 0x5eed;
    for kind in KINDS {
        let mut rng = Random(seed);
        let cloud = cloud(kind, 700, &mut rng);
        for structure in STRUCTURES {
            for simd in SimdLevel::available() {
                let tree = build(&cloud, structure, simd);
                let mut buffer = NeighborBuffer::new();
                for time in times(&cloud, &mut rng) {
                    let scale = cloud.at(0, time).abs().max_element();
                    let member = cloud.at(rng.below(cloud.len()), time);
                    for q in [member, rng.vec() * scale, Vec3::splat(2.5 * scale.max(1e-38))] {
                        let what = format!("seed {seed:#x}, {kind}, {structure:?}, {simd}, time {time}, q {q}");
                        if q.abs().max_element() <= 1e18 {
                            check(&tree, &cloud, q, time, &mut buffer, &what);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn larger_sets_reach_every_level_of_the_tree() {
    let seed = 77;
    for kind in [
        "uniform",
        "surface",
        "random",
        "coherent",
        "fast few",
        "fast cluster",
        "flows",
        "short intervals",
        "wild speeds",
    ] {
        let mut rng = Random(seed);
        let cloud = cloud(kind, 30_000, &mut rng);
        for structure in STRUCTURES {
            let tree = build(&cloud, structure, SimdLevel::best());
            for _ in 0..12 {
                let time = rng.unit();
                let q = cloud.at(rng.below(cloud.len()), time) + rng.vec() * 0.05;
                let all = cloud.sorted(q, time);
                let what = format!("seed {seed}, {kind}, {structure:?}, time {time}, q {q}");
                assert_eq!(tree.nearest(q, time), all.first().copied(), "{what}");
                for k in [3, 8, 50, 200] {
                    assert_eq!(tree.nearest_n(q, time, k), &all[..k.min(all.len())], "{what}, k = {k}");
                }
                let radius = all.get(100).map_or(0.1, |n| n.distance());
                let inside = all.partition_point(|n| n.distance_squared <= radius * radius);
                assert_eq!(tree.query(q, time).radius(radius).collect_sorted(), &all[..inside], "{what}");
            }
        }
    }
}

/// Which sets of the test above have fast points in a layer of their own. Those of "fast cluster" are among each other when
/// samples are taken, so the automatic choice does not see that they would be better apart, and divides the shutter.
#[test]
fn automatic_layers_of_sets_with_fast_points() {
    for (kind, layers) in [("fast few", 2), ("fast cluster", 1)] {
        let tree = build(&cloud(kind, 30_000, &mut Random(77)), PointStructure::Automatic, SimdLevel::best());
        let statistics = tree.statistics();
        let moving = |kind: PointLayerKind| matches!(kind, PointLayerKind::Linear { .. });
        let found = statistics.layers.iter().filter(|layer| moving(layer.kind)).count();
        assert_eq!(found, layers, "{kind}: {statistics}");
    }
}

/// Slices of fast points only take little memory, so a budget that is too small for slices of all points may suffice.
#[test]
fn fast_points_are_divided_in_time_within_a_small_budget() {
    let cloud = cloud("fast few", 30_000, &mut Random(77));
    for (max_references, layers) in [(1.0, 1), (1.5, 2)] {
        let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
        let points = PointArrays { keys: &keys, active: &cloud.active, ids: &[] };
        let tree = PointTree::build(&points, &PointParams { max_references, ..PointParams::default() }).unwrap();
        let statistics = tree.statistics();
        assert_eq!(statistics.layers.len(), layers, "{statistics}");
        let references: usize = statistics.layers.iter().map(|layer| layer.references).sum();
        assert!(references as f32 <= max_references * 30_000.0, "{statistics}");
        let slices = |kind| if let PointLayerKind::Linear { time_slices } = kind { time_slices } else { 0 };
        assert_eq!(slices(statistics.layers[layers - 1].kind) > 1, layers == 2, "{statistics}");
    }
}

/// Two flows through each other, which part by 19 spacings: a linear tree divides them. Counted, so exact; without a division by
/// motion a search visits more than seven times as many as among static points.
#[test]
fn searches_in_flows_through_each_other_visit_less_than_three_times_the_blocks_of_static_points() {
    for way in [2, 3] {
        let mut rng = Random(8);
        let spacing = 2.0 / 60_000f32.cbrt();
        let points: Vec<MovingPoint> = (0..60_000)
            .map(|i| {
                let (p, by) = (rng.vec(), Vec3::X * 9.5 * spacing * if i % way == 0 { 1.0 } else { -1.0 });
                MovingPoint::new(p - by, p + by)
            })
            .collect();
        let cloud = Cloud::moving(&points);
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let still = (0..points.len()).map(|i| cloud.at(i, 0.5)).collect();
        let still = build(&Cloud::still(still), PointStructure::Automatic, SimdLevel::best());
        let [mut own, mut work] = [0; 2];
        for i in 0..300 {
            let time = rng.unit();
            let q = cloud.at(i * 199, time) + rng.vec() * 0.3 * spacing;
            work += tree.query(q, time).work(8).blocks;
            own += still.query(q, time).work(8).blocks;
        }
        assert!(work < 3 * own, "{work} blocks, {own} of static points");
    }
}

#[test]
fn small_sets_of_every_size() {
    let mut rng = Random(3);
    for count in (0..70).chain([255, 256, 257, 511, 513, 4096, 4097]) {
        let points: Vec<Vec3> = (0..count).map(|_| rng.vec()).collect();
        let still = Cloud::still(points.clone());
        let mut moving = still.clone();
        moving.keys.push(points.iter().map(|p| *p * 0.5).collect());
        for cloud in [still, moving] {
            for structure in STRUCTURES {
                let tree = build(&cloud, structure, SimdLevel::best());
                assert_eq!((tree.len(), tree.is_empty()), (count, count == 0));
                let (q, time) = (rng.vec(), rng.unit());
                let all = cloud.sorted(q, time);
                let what = format!("{count} points, {structure:?}");
                assert_eq!(tree.nearest(q, time), all.first().copied(), "{what}");
                assert_eq!(tree.nearest_n(q, time, 20), &all[..all.len().min(20)], "{what}");
                assert_eq!(tree.within(q, time, f32::INFINITY).len(), count, "{what}");
            }
        }
    }
}

#[test]
fn many_keys_are_interpolated_exactly() {
    let mut rng = Random(11);
    for keys in [1, 2, 3, 4, 7, 25] {
        let count = 400;
        let start: Vec<Vec3> = (0..count).map(|_| rng.vec()).collect();
        let step = |p: &Vec3, rng: &mut Random| *p + rng.vec() * 0.2;
        let mut all = vec![start];
        while all.len() < keys {
            let next = all.last().unwrap().iter().map(|p| step(p, &mut rng)).collect();
            all.push(next);
        }
        let mut cloud = Cloud { keys: all, active: vec![TimeInterval::FULL; count] };
        for active in [false, true] {
            if active {
                for active in &mut cloud.active {
                    let begin = rng.unit() * 0.7;
                    *active = TimeInterval::new(begin, begin + 0.3 * (1.0 - rng.unit())).unwrap();
                }
            }
            for structure in STRUCTURES {
                let tree = build(&cloud, structure, SimdLevel::best());
                let mut at: Vec<f32> = (0..keys).map(|k| k as f32 / (keys.max(2) - 1) as f32).collect();
                at.extend(at.clone().iter().flat_map(|t| [t.next_down().max(0.0), t.next_up().min(1.0)]));
                at.extend((0..20).map(|_| rng.unit()));
                at.extend(cloud.active.iter().take(10).flat_map(|a| [a.begin(), a.end()]));
                for time in at {
                    let q = rng.vec();
                    let found = tree.nearest_n(q, time, 12);
                    let all = cloud.sorted(q, time);
                    assert_eq!(
                        found,
                        &all[..all.len().min(12)],
                        "{keys} keys, active {active}, {structure:?}, time {time}"
                    );
                }
            }
        }
    }
}

/// Linear motion sampled at many keys has the answers of two keys, bit for bit, and their cost; other motion, and motion
/// given in f64, keeps all keys.
#[test]
fn keys_of_linear_motion_cost_nothing() {
    let mut rng = Random(23);
    let open: Vec<Vec3> = (0..3000).map(|_| rng.vec()).collect();
    let close: Vec<Vec3> = open.iter().map(|p| *p + rng.vec() * 0.2).collect();
    let sampled = |keys: usize, off: f32| -> Vec<Vec<Vec3>> {
        let at = |key: usize, i: usize| {
            let p = open[i].lerp(close[i], key as f32 / (keys - 1) as f32);
            if key == 1 && i == 1234 { p * (1.0 + off) } else { p }
        };
        (0..keys)
            .map(|key| (0..open.len()).map(|i| if key + 1 == keys { close[i] } else { at(key, i) }).collect())
            .collect()
    };
    for structure in STRUCTURES {
        let of = |keys: Vec<Vec<Vec3>>| {
            build(&Cloud { active: vec![TimeInterval::FULL; keys[0].len()], keys }, structure, SimdLevel::best())
        };
        let two = of(vec![open.clone(), close.clone()]);
        for keys in [3, 9, 65] {
            let tree = of(sampled(keys, 0.0));
            assert_eq!(tree.statistics().layers, two.statistics().layers, "{keys} keys, {structure:?}");
            for _ in 0..300 {
                let (q, time) = (rng.vec(), rng.unit());
                assert_eq!(
                    tree.nearest_n(q, time, 5),
                    two.nearest_n(q, time, 5),
                    "{keys} keys, {structure:?}, {q} at {time}"
                );
            }
            let bent = of(sampled(keys, 1e-3));
            assert!(bent.statistics().layers.iter().all(|layer| layer.keys == keys), "{structure:?}");
        }
        // The motion of three keys, sampled at nine.
        let path = [open.clone(), close.clone(), open.iter().map(|p| *p - 0.1).collect()];
        let nine = (0..9).map(|key: usize| {
            let (from, w) = ((key / 4).min(1), (key - 4 * (key / 4).min(1)) as f32 / 4.0);
            path[from].iter().zip(&path[from + 1]).map(|(p, q)| if w == 1.0 { *q } else { p.lerp(*q, w) }).collect()
        });
        let layers = of(nine.collect()).statistics().layers.clone();
        assert!(layers.iter().all(|layer| layer.keys == 3), "{layers:?}");
    }
}

#[test]
fn every_point_is_in_exactly_one_place_at_every_crossing() {
    let mut rng = Random(21);
    let count = 3000;
    let points: Vec<_> = (0..count).map(|_| MovingPoint::new(rng.vec(), rng.vec())).collect();
    for structure in [PointStructure::Kd] {
        let params = PointParams { structure, max_references: 16.0, ..PointParams::default() };
        let tree = PointTree::build(&points, &params).unwrap();
        assert!(tree.statistics().references_per_point() > 1.3, "nothing was cut: {}", tree.statistics());
        for i in 0..1000 {
            // Crossing times are floats like these; the count would be off by one at any of them.
            let time = if i < 3 { i as f32 * 0.5 } else { rng.unit() };
            assert_eq!(tree.count_within([0.0f32; 3], time, f32::INFINITY), count, "{structure:?} at {time}");
        }
    }
}

/// Once k points at the same distance are known, others there count by their ids. Ids are in random order, and the crowds fill many
/// leaves: the lowest ids may come last.
#[test]
fn of_crowds_in_few_places_the_lowest_ids_are_nearest() {
    let mut rng = Random(77);
    for places in [1, 4] {
        let crowd = |rng: &mut Random| Vec3::splat((rng.bits() % places) as f32) * 0.25;
        let points: Vec<Vec3> =
            (0..3000).map(|_| if rng.bits().is_multiple_of(4) { rng.vec() } else { crowd(&mut rng) }).collect();
        let cloud = Cloud::still(points);
        let mut buffer = NeighborBuffer::default();
        for structure in STRUCTURES {
            for simd in SimdLevel::available() {
                let tree = build(&cloud, structure, simd);
                for q in [Vec3::ZERO, Vec3::splat(0.26), rng.vec(), Vec3::splat(9.0)] {
                    check(&tree, &cloud, q, 0.5, &mut buffer, &format!("{places} places, {structure:?}, {simd}"));
                }
            }
        }
    }
}

#[test]
fn a_million_points_in_one_place() {
    let points = vec![Vec3::ONE; 1_000_000];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let found = tree.nearest_n(Vec3::ZERO, 0.0, 20);
    assert_eq!(found.iter().map(|n| n.id).collect::<Vec<_>>(), (0..20).collect::<Vec<_>>());
    assert_eq!(tree.nearest(Vec3::ONE, 1.0), Some(Neighbor { id: 0, distance_squared: 0.0 }));
    assert_eq!(tree.count_within(Vec3::ONE, 0.5, 0.0), 1_000_000);
}

/// Enough points for five levels of nodes, the last of which are not full.
#[test]
fn a_search_without_a_bound_finds_every_point_of_a_large_set() {
    let count = 1_100_000;
    let mut rng = Random(5);
    let points: Vec<Vec3> = (0..count).map(|_| Vec3::new(rng.unit(), rng.unit(), rng.unit())).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    for q in [Vec3::splat(0.5), Vec3::splat(-3.0), Vec3::new(0.9, 0.9, 7.0)] {
        assert_eq!(tree.count_within(q, 0.5, f32::INFINITY), count);
        assert_eq!(tree.count_within(q, 0.5, 20.0), count);
        let distance = |p: &Vec3| {
            let d = *p - q;
            (d.x * d.x + d.y * d.y) + d.z * d.z
        };
        let nearest = points.iter().map(distance).fold(f32::INFINITY, f32::min);
        assert_eq!(tree.nearest(q, 0.5).map(|n| n.distance_squared), Some(nearest));
    }
    let all = tree.nearest_n(Vec3::splat(0.5), 0.5, count + 1);
    assert_eq!(all.len(), count);
}

#[test]
fn static_sets_have_the_static_structure() {
    let mut rng = Random(5);
    let cloud = cloud("uniform", 1000, &mut rng);
    for structure in STRUCTURES {
        let statistics = build(&cloud, structure, SimdLevel::best()).statistics().clone();
        assert_eq!((statistics.layers.len(), statistics.layers[0].kind), (1, PointLayerKind::Static), "{statistics}");
        assert_eq!(statistics.references_per_point(), 1.0);
    }
}

/// Unless so many move, by so little, that one tree is better.
#[test]
fn static_points_take_the_bytes_and_nodes_that_they_take_without_points_that_move() {
    const ALL: usize = 5000;
    let layers =
        |points: &[MovingPoint]| PointTree::build(points, &PointParams::default()).unwrap().statistics().layers.clone();
    // The spacing is .12.
    for (moving, far, apart) in [
        (1, 0.12, true),
        (100, 0.12, true),
        (500, 0.12, true),
        (100, 3.0, true),
        (2000, 3.0, true),
        (2000, 0.12, false),
    ] {
        let mut rng = Random(43);
        let mut point = |i: usize| {
            let p = rng.vec();
            if i < moving { MovingPoint::new(p, p + rng.vec() * far) } else { MovingPoint::fixed(p) }
        };
        let points: Vec<MovingPoint> = (0..ALL).map(&mut point).collect();
        let (together, alone) = (layers(&points), layers(&points[moving..]));
        let what = format!("{moving} move by {far}: {together:?}");
        assert_eq!(together[0].kind == PointLayerKind::Static, apart, "{what}");
        let size = |of: &PointLayerStatistics| (of.points, of.references, of.nodes, of.bytes);
        assert!(!apart || size(&together[0]) == size(&alone[0]), "{what}, {alone:?}");
    }
}

/// Static points are in leaves of 32, where a search for eight visits the nearest leaf first; moving ones in leaves of 16,
/// where it estimates a threshold.
#[test]
fn an_estimate_does_not_count_points_of_another_layer() {
    let mut rng = Random(31);
    let mut point = |i: u32| {
        let p = rng.vec();
        if i < 6000 { MovingPoint::fixed(p) } else { MovingPoint::new(p, p + rng.vec()) }
    };
    let points: Vec<MovingPoint> = (0..9000).map(&mut point).collect();
    for simd in SimdLevel::available() {
        let tree = PointTree::build(&points, &PointParams { simd, ..PointParams::default() }).unwrap();
        assert_eq!(tree.statistics().layers.len(), 2);
        let keep = |id: u32| id >= 6000 || id % 1500 == 7;
        for _ in 0..300 {
            let (q, time) = (rng.vec(), rng.unit());
            let all = tree.query(q, time).filter(keep).radius(f32::INFINITY).collect_sorted();
            for k in [8, 10, 11, 40] {
                assert_eq!(
                    tree.query(q, time).filter(keep).nearest_n(k),
                    &all[..k],
                    "{simd}, q {q}, time {time}, k {k}"
                );
            }
        }
    }
}
