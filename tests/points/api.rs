//! Batches, closest approach, the forms of input, bad input, and counted work.

use crate::support::{Cloud, KINDS, Random, cloud};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Approach, MovingPoint, PointArrays, PointColumns, PointError, PointLayerKind, PointParams, PointSet,
    PointStructure, PointTree, SimdLevel, TimeInterval,
};

fn params(structure: PointStructure) -> PointParams {
    PointParams { structure, ..PointParams::default() }
}

fn tree_of(cloud: &Cloud, structure: PointStructure) -> PointTree {
    let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
    PointTree::build(&PointArrays { keys: &keys, active: &cloud.active, ids: &[] }, &params(structure)).unwrap()
}

const STRUCTURES: [PointStructure; 4] =
    [PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(3), PointStructure::Kd];

#[test]
fn batches_equal_single_queries_for_any_number_of_threads() {
    let mut rng = Random(8);
    let cloud = cloud("random", 5000, &mut rng);
    let tree = tree_of(&cloud, PointStructure::Automatic);
    let mut queries: Vec<(Vec3, f32)> = (0..3000).map(|_| (rng.vec(), rng.unit())).collect();
    queries[17] = (Vec3::NAN, 0.5);
    queries[18] = (Vec3::ZERO, 1.5);
    queries[19] = (Vec3::INFINITY, 0.5);
    let lists = || (tree.nearest_n_batch(&queries, 9), tree.within_batch(&queries, 0.1));
    let run = || (tree.nearest_batch(&queries), lists(), tree.count_batch(&queries, 0.1));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(run);
    let four = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap().install(run);
    assert_eq!(one, four);
    let (nearest, (lists, within), counts) = one;
    assert_eq!((lists.len(), within.len(), within.is_empty()), (queries.len(), queries.len(), false));
    for (i, (q, t)) in queries.iter().enumerate() {
        assert_eq!(nearest[i], tree.nearest(*q, *t));
        assert_eq!(lists.row(i), tree.nearest_n(*q, *t, 9));
        assert_eq!(within.row(i), tree.query(*q, *t).radius(0.1).collect_sorted());
        assert_eq!(counts[i], tree.count_within(*q, *t, 0.1));
    }
    assert!(nearest[17].is_none() && nearest[18].is_none() && lists.row(19).is_empty());
    assert_eq!(lists.iter().count(), queries.len());
    let empty: [(Vec3, f32); 0] = [];
    assert!(tree.nearest_n_batch(&empty, 3).is_empty() && tree.nearest_batch(&empty).is_empty());
    assert!(tree.count_batch(&empty, 1.0).is_empty());
}

#[test]
fn batches_with_options_are_single_queries_with_options() {
    for (kind, count) in [("random", 4000), ("short intervals", 1000)] {
        let mut rng = Random(9);
        let cloud = cloud(kind, count, &mut rng);
        // Every query has a predicate, a radius and an allowed error of its own.
        let accept = |query: usize, id: u32| id as usize % 3 != query % 3;
        let radius = |query: usize| [0.05, 0.2, f32::INFINITY][query / 3 % 3];
        let error = |query: usize| [0.0, 0.5][query / 9 % 2];
        let mut queries: Vec<(Vec3, f32)> = (0..1500).map(|_| (rng.vec(), rng.unit())).collect();
        queries[7] = (Vec3::NAN, 0.5);
        for structure in STRUCTURES {
            let tree = tree_of(&cloud, structure);
            let nearest = tree.nearest_batch_with(&queries, |i, query| query.filter(move |id| accept(i, id)));
            let lists = tree.nearest_n_batch_with(&queries, 6, |i, query| {
                query.radius(radius(i)).approximate(error(i)).filter(move |id| accept(i, id))
            });
            let rough = tree.nearest_n_batch_with(&queries, 6, |i, query| query.approximate(error(i)));
            let within = tree.within_batch_with(&queries, |i, query| {
                query.radius(radius(i)).radius(0.2).filter(move |id| accept(i, id))
            });
            let counts =
                tree.count_batch_with(&queries, |i, query| query.radius(radius(i)).filter(move |id| accept(i, id)));
            for (i, (q, t)) in queries.iter().enumerate() {
                let query = tree.query(*q, *t).filter(|id| accept(i, id));
                assert_eq!(nearest[i], query.nearest(), "{kind}, {structure:?}");
                assert_eq!(
                    rough.row(i),
                    tree.query(*q, *t).approximate(error(i)).nearest_n(6),
                    "{kind}, {structure:?}"
                );
                let query = query.radius(radius(i));
                assert_eq!(lists.row(i), query.approximate(error(i)).nearest_n(6), "{kind}, {structure:?}");
                assert_eq!(counts[i], query.count(), "{kind}, {structure:?}");
                assert_eq!(within.row(i), query.radius(0.2).collect_sorted(), "{kind}, {structure:?}");
            }
            assert!(
                nearest[7].is_none() && nearest.iter().flatten().count() > 1000 && within.iter().any(|l| l.len() > 1)
            );
        }
    }
}

/// The closest approach by brute force over all points, in f64, segment by segment.
fn approach(cloud: &Cloud, from: Vec3, to: Vec3, interval: TimeInterval) -> Option<(f64, u32)> {
    let segments = (cloud.keys.len() - 1).max(1);
    let mut best: Option<(f64, u32)> = None;
    for i in 0..cloud.len() {
        for segment in 0..segments {
            let ends = [segment as f64 / segments as f64, (segment + 1) as f64 / segments as f64];
            let active = cloud.active[i];
            let begin = f64::from(interval.begin()).max(ends[0]).max(active.begin().into());
            let end = f64::from(interval.end()).min(ends[1]).min(active.end().into());
            if begin > end {
                continue;
            }
            let key = |k: usize| cloud.keys[k.min(cloud.keys.len() - 1)][i].as_dvec3();
            let apart = |t: f64| {
                let p = key(segment) + (key(segment + 1) - key(segment)) * (t * segments as f64 - segment as f64);
                let whole = f64::from(interval.end()) - f64::from(interval.begin());
                p - from.as_dvec3().lerp(to.as_dvec3(), (t - f64::from(interval.begin())) / whole)
            };
            // Golden section search on a convex function: another method than the library's.
            let (mut a, mut b) = (begin, end);
            for _ in 0..80 {
                let (c, d) = (b - 0.618_033_988_749_895 * (b - a), a + 0.618_033_988_749_895 * (b - a));
                if apart(c).length_squared() <= apart(d).length_squared() { b = d } else { a = c }
            }
            let least = [begin, 0.5 * (a + b), end].map(|t| apart(t).length_squared());
            let least = least.into_iter().fold(f64::INFINITY, f64::min);
            if best.is_none_or(|(d, _)| least < d) {
                best = Some((least, i as u32));
            }
        }
    }
    best
}

#[test]
fn closest_approach_equals_brute_force() {
    for kind in KINDS {
        if matches!(kind, "huge" | "denormal") {
            continue; // the plain search above overflows or loses them
        }
        let mut rng = Random(31);
        let mut cloud = cloud(kind, 300, &mut rng);
        if kind == "random" {
            let third = cloud.keys[1].iter().map(|p| *p + rng.vec() * 0.3).collect();
            cloud.keys.push(third);
        }
        for _ in 0..6 {
            let begin = rng.unit() * 0.8;
            let interval = TimeInterval::new(begin, begin + 0.2 * (1.0 - rng.unit()) + 1e-3).unwrap();
            let (from, to) = (rng.vec(), rng.vec());
            let wanted = approach(&cloud, from, to, interval);
            let mut first: Option<Option<Approach>> = None;
            for structure in STRUCTURES {
                let found = tree_of(&cloud, structure).closest_approach(from, to, interval);
                assert_eq!(*first.get_or_insert(found), found, "{kind}, {structure:?}: structures differ");
                let what = format!("{kind}, {structure:?}, {from} to {to} in {interval:?}");
                match (found, wanted) {
                    (None, None) => {}
                    (Some(f), Some((d, _))) => {
                        let error = (f64::from(f.distance).powi(2) - d).abs();
                        assert!(error <= 1e-6 * (d + 1e-3), "{what}: {f:?} for {wanted:?}");
                        assert!(f.time >= interval.begin() && f.time <= interval.end(), "{what}");
                    }
                    _ => panic!("{what}: {found:?} for {wanted:?}"),
                }
            }
        }
    }
}

/// Two thirds of the points are static, and so are in a tree without keys if the structure is automatic, since some of the
/// others move far; near keys the
/// differences of their distances are below the resolution of f32.
#[test]
fn closest_approaches_of_static_points_do_not_depend_on_the_structure() {
    let mut rng = Random(9);
    let mut cloud = cloud("uniform", 200, &mut rng);
    for key in 0..3 {
        let by = rng.direction();
        let last = cloud.keys[key].iter().enumerate();
        let far = |i: usize| if i.is_multiple_of(12) { 20.0 } else { 1.0 };
        cloud.keys.push(last.map(|(i, p)| if i % 3 == 0 { *p + by * rng.unit() * far(i) } else { *p }).collect());
    }
    let trees = STRUCTURES.map(|structure| tree_of(&cloud, structure));
    let layers = trees.each_ref().map(|tree| tree.statistics().layers.len());
    assert!(layers.contains(&1) && layers.contains(&2), "{layers:?}");
    let mut at_keys = 0;
    for i in (1..200).filter(|i| i % 3 != 0) {
        for key in [0.25, 0.5, 0.75] {
            // Passes just before or after a key, or exactly through the point.
            let beside = rng.vec() * [0.0, 1.0][i % 2];
            let (time, velocity) = (key + rng.signed() * 1e-4, rng.vec());
            let [from, to] = [0.0, 1.0].map(|at: f32| cloud.keys[0][i] + beside + velocity * (at - time));
            let nearest = |tree: &PointTree, id: Option<u32>| {
                tree.closest_approach_filtered(from, to, TimeInterval::FULL, |other| id.is_none_or(|id| id == other))
                    .unwrap()
            };
            for id in [None, Some(i as u32)] {
                let found = trees.each_ref().map(|tree| nearest(tree, id));
                assert!(found.iter().all(|f| *f == found[0]), "point {i}, {from} to {to}: {found:?}");
                at_keys += usize::from(found[0].time == key);
            }
        }
    }
    assert!(at_keys > 0, "no approach was nearest at a key");
}

/// Hundreds of points go each of a few ways, some of them the same way in one segment between keys and apart in the other.
#[test]
fn closest_approaches_of_crowds_are_those_of_their_lowest_ids() {
    let mut rng = Random(12);
    for keys in 1..4 {
        let mut cloud = cloud("uniform", 2000, &mut rng);
        let ways: Vec<[Vec3; 3]> = (0..5).map(|_| [(); 3].map(|()| rng.vec())).collect();
        let way: Vec<usize> = (0..2000).map(|_| rng.below(5)).collect();
        let at = |i: usize, key: usize| match way[i] {
            // The second crowd begins like the first.
            1 if key < 2 => ways[0][key],
            way => ways[way][key],
        };
        cloud.keys = (0..keys).map(|key| (0..2000).map(|i| at(i, key)).collect()).collect();
        let lowest = |id: u32| way[..id as usize].iter().all(|&before| before != way[id as usize]);
        for structure in STRUCTURES {
            let tree = tree_of(&cloud, structure);
            for _ in 0..20 {
                let (from, to) = (rng.vec(), rng.vec());
                let found = tree.closest_approach(from, to, TimeInterval::FULL).unwrap();
                let expected = tree.closest_approach_filtered(from, to, TimeInterval::FULL, lowest).unwrap();
                assert_eq!(found, expected, "{keys} keys, {structure:?}, {from} to {to}");
            }
        }
    }
}

#[test]
fn closest_approach_with_predicate_and_invalid_paths() {
    let points = [MovingPoint::new(Vec3::X, -Vec3::X), MovingPoint::fixed(Vec3::Y)];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let all = TimeInterval::FULL;
    assert_eq!(tree.closest_approach(Vec3::ZERO, Vec3::ZERO, all).unwrap().time, 0.5);
    assert_eq!(tree.closest_approach_filtered(Vec3::ZERO, Vec3::ZERO, all, |id| id != 0).unwrap().id, 1);
    assert!(tree.closest_approach_filtered(Vec3::ZERO, Vec3::ZERO, all, |_| false).is_none());
    assert!(tree.closest_approach(Vec3::NAN, Vec3::ZERO, all).is_none());
    assert!(tree.closest_approach(Vec3::ZERO, Vec3::splat(1e30), all).is_none());
}

#[test]
fn every_form_of_input_gives_the_same_answers() {
    let mut rng = Random(4);
    let points: Vec<Vec3> = (0..1000).map(|_| rng.vec()).collect();
    let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    let wide: Vec<DVec3> = points.iter().map(|p| p.as_dvec3() + DVec3::splat(1e9)).collect();
    let wide_arrays: Vec<[f64; 3]> = wide.iter().map(|p| p.to_array()).collect();
    let column = |axis: usize| points.iter().map(|p| p[axis]).collect::<Vec<f32>>();
    let (x, y, z) = (column(0), column(1), column(2));
    let set = PointColumns { x: &x, y: &y, z: &z };
    let p = PointParams::default();
    let trees = [
        PointTree::build(&points, &p).unwrap(),
        PointTree::build(&points[..], &p).unwrap(),
        PointTree::build(&arrays, &p).unwrap(),
        PointTree::build(&set, &p).unwrap(),
        PointTree::build(&PointArrays { keys: &[&points[..]], active: &[], ids: &[] }, &p).unwrap(),
    ];
    let far = [PointTree::build(&wide, &p).unwrap(), PointTree::build(&wide_arrays, &p).unwrap()];
    assert!((far[0].origin() - DVec3::splat(1e9)).length() < 2.0);
    for _ in 0..50 {
        let q = rng.vec();
        let expected = trees[0].nearest_n(q, 0.0, 7);
        for tree in &trees {
            assert_eq!(tree.nearest_n(q, 0.0, 7), expected);
            assert_eq!(tree.nearest_n(q.as_dvec3(), 0.0, 7), expected, "an f64 query that is an f32 one");
        }
        for tree in &far {
            // 1e9 leaves 2^-23 in f64: distances agree to about that, and so do ids without near ties.
            let found = tree.nearest_n(q.as_dvec3() + DVec3::splat(1e9), 0.0, 7);
            for (f, e) in found.iter().zip(&expected) {
                assert!((f.distance() - e.distance()).abs() < 1e-6, "{f:?} {e:?}");
            }
        }
    }
    let ids: Vec<u32> = (0..1000).map(|i| 5000 - i).collect();
    let named = PointTree::build(&PointArrays { keys: &[&points[..]], active: &[], ids: &ids }, &p).unwrap();
    assert_eq!(named.nearest(points[10], 0.0).unwrap().id, 4990);
}

#[test]
fn bad_input_is_a_typed_error() {
    let p = PointParams::default();
    let build = |keys: &[&[Vec3]], active: &[TimeInterval], ids: &[u32]| {
        PointTree::build(&PointArrays { keys, active, ids }, &p).err()
    };
    let two = [Vec3::ZERO, Vec3::ONE];
    assert_eq!(build(&[&two], &[], &[]), None);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let broken = [Vec3::ZERO, Vec3::new(0.0, bad, 0.0)];
        assert_eq!(build(&[&two, &broken], &[], &[]), Some(PointError::NonFinite { point: 1, key: 1 }));
    }
    let far = [Vec3::ZERO, Vec3::splat(2e18)];
    assert_eq!(build(&[&far], &[], &[]), Some(PointError::TooLarge { point: 1, key: 0 }));
    let length = |name, found| Some(PointError::Length { name, expected: 2, found });
    assert_eq!(build(&[&two, &two[..1]], &[], &[]), length("keys", 1));
    assert_eq!(build(&[&two], &[TimeInterval::FULL], &[]), length("active", 1));
    assert_eq!(build(&[&two], &[], &[1, 2, 3]), length("ids", 3));
    assert_eq!(build(&[&two], &[], &[1, u32::MAX]), Some(PointError::ReservedId { point: 1 }));
    assert_eq!(build(&[], &[], &[]), None, "an empty set is no error");
    let columns = PointColumns { x: &[1.0], y: &[1.0], z: &[] };
    assert_eq!(PointTree::build(&columns, &p).err(), Some(PointError::Length { name: "z", expected: 1, found: 0 }));
    let keys: Vec<&[Vec3]> = vec![&two; 70_000];
    assert_eq!(build(&keys, &[], &[]), Some(PointError::TooManyKeys { found: 70_000 }));
    struct Endless;
    impl PointSet for Endless {
        const WIDE: bool = false;
        fn len(&self) -> usize {
            u32::MAX as usize
        }
        fn position(&self, _: usize, _: usize) -> DVec3 {
            DVec3::ZERO
        }
    }
    let found = u32::MAX as usize;
    assert_eq!(PointTree::build(&Endless, &p).err(), Some(PointError::TooManyPoints { found }));
    for structure in [PointStructure::TimeSlices(0), PointStructure::TimeSlices(5000)] {
        assert!(matches!(PointTree::build(&two, &params(structure)), Err(PointError::Parameter { .. })));
    }
    // So many slices in each of 29 segments.
    let there_and_back: Vec<&[Vec3]> =
        (0..30).map(|i| if i % 2 == 0 { &two[..] } else { &[Vec3::ONE, Vec3::X][..] }).collect();
    let set = PointArrays { keys: &there_and_back, active: &[], ids: &[] };
    for (slices, allowed) in [(1, true), (8, true), (1024, false)] {
        let tree = PointTree::build(&set, &params(PointStructure::TimeSlices(slices)));
        assert_eq!(tree.is_ok(), allowed, "{slices} slices");
        assert!(allowed || matches!(tree, Err(PointError::Parameter { name: "structure", .. })));
    }
    for max_references in [0.5, f32::NAN, f32::INFINITY] {
        let p = PointParams { max_references, ..PointParams::default() };
        assert!(matches!(PointTree::build(&two, &p), Err(PointError::Parameter { name: "max_references", .. })));
    }
    assert!(PointError::TooManyPoints { found }.to_string().contains("split the set"));
}

#[test]
fn bad_queries_find_nothing() {
    let still = PointTree::build(&[Vec3::ZERO, Vec3::ONE], &PointParams::default()).unwrap();
    let moving = [MovingPoint::new(Vec3::ZERO, Vec3::ONE), MovingPoint::new(Vec3::ONE, Vec3::ZERO)];
    let moving = PointTree::build(&moving, &PointParams::default()).unwrap();
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    for tree in [&still, &moving, &empty] {
        let bad = [
            (Vec3::NAN, 0.5),
            (Vec3::INFINITY, 0.5),
            (Vec3::splat(1e30), 0.5),
            (Vec3::ZERO, f32::NAN),
            (Vec3::ZERO, -0.1),
            (Vec3::ZERO, 1.1),
            (Vec3::ZERO, f32::INFINITY),
        ];
        for (q, t) in bad {
            assert_eq!(tree.nearest(q, t), None, "{q} {t}");
            assert!(tree.nearest_n(q, t, 5).is_empty() && tree.within(q, t, f32::INFINITY).is_empty());
            assert_eq!((tree.count_within(q, t, 9.0), tree.query(q, t).iter().count()), (0, 0));
        }
        for radius in [-1.0, -0.0f32.next_up(), f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(tree.count_within(Vec3::ZERO, 0.0, radius), 0, "radius {radius}");
            assert_eq!(tree.query(Vec3::ZERO, 0.0).radius(radius).nearest(), None);
        }
    }
    // A huge k returns all points, and allocates only for these.
    assert_eq!(still.nearest_n(Vec3::ZERO, 0.0, usize::MAX).len(), 2);
    // Where leaves wait for a threshold, too (with checks of overflow in builds for debugging).
    let many: Vec<Vec3> = (0..500).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
    let many = PointTree::build(&many, &PointParams::default()).unwrap();
    for k in [usize::MAX, usize::MAX / 2 + 1, usize::MAX / 3 + 1] {
        assert_eq!(many.nearest_n(Vec3::ZERO, 0.0, k).len(), 500);
    }
    assert_eq!(still.query(Vec3::ZERO, 0.0).approximate(f32::NAN).nearest().unwrap().id, 0);
    assert_eq!(still.query(Vec3::ZERO, 0.0).approximate(f32::INFINITY).nearest_n(2).len(), 2);
}

#[test]
fn trees_and_choices_do_not_depend_on_threads() {
    for kind in ["uniform", "fast few", "short intervals", "random"] {
        let cloud = cloud(kind, 60_000, &mut Random(2));
        let build = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tree = tree_of(&cloud, PointStructure::Automatic);
                let mut rng = Random(6);
                let work: Vec<_> = (0..200).map(|_| tree.query(rng.vec(), rng.unit()).work(8)).collect();
                (tree.statistics().clone(), work)
            })
        };
        assert_eq!(build(1), build(4), "{kind}");
    }
}

/// Counted work of 1000 searches for 8 neighbours: changes only when structures or searches change.
#[test]
fn counted_work_is_what_it_was() {
    let count = |kind: &str, structure: PointStructure, simd: SimdLevel| {
        let mut rng = Random(1234);
        let cloud = cloud(kind, 50_000, &mut rng);
        let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
        let params = PointParams { structure, simd, ..PointParams::default() };
        let set = PointArrays { keys: &keys, active: &cloud.active, ids: &[] };
        let tree = PointTree::build(&set, &params).unwrap();
        (0..1000).fold((0, 0), |(nodes, blocks), _| {
            let work = tree.query(rng.vec(), rng.unit()).work(8);
            (nodes + work.nodes, blocks + work.blocks)
        })
    };
    for simd in SimdLevel::available() {
        let counted = GOLDEN.map(|(kind, structure, _)| (kind, structure, count(kind, structure, simd)));
        assert_eq!(counted, GOLDEN, "{simd}");
    }
}

const GOLDEN: [(&str, PointStructure, (u64, u64)); 5] = [
    ("uniform", PointStructure::Automatic, (5323, 7854)),
    ("coherent", PointStructure::Linear, (6311, 8539)),
    ("random", PointStructure::TimeSlices(4), (5937, 8353)),
    ("fast few", PointStructure::Kd, (50658, 20912)),
    ("short intervals", PointStructure::Kd, (138217, 91251)),
];

#[test]
fn automatic_reports_its_choice_and_the_reason() {
    let kinds = |kind: &str| {
        let tree = tree_of(&cloud(kind, 40_000, &mut Random(9)), PointStructure::Automatic);
        println!("{kind}\n{}", tree.statistics());
        tree.statistics().clone()
    };
    let coherent = kinds("coherent");
    assert_eq!(coherent.layers[0].kind, PointLayerKind::Linear { time_slices: 1 });
    assert!(coherent.layers[0].why.contains("as large as those of points at rest"));
    let fast = kinds("fast few");
    assert!(fast.layers[0].why.contains("fast points apart"), "not tried: {fast}");
    assert!(fast.layers[0].why.contains("trial searches"));
    assert!(kinds("wild speeds").references_per_point() > 1.0);
}

/// Small sets are compared by trees of the whole set. No number of time slices that is built by force visits much less.
#[test]
fn automatic_finds_about_the_best_number_of_time_slices_of_small_sets() {
    let forced = [1, 2, 4, 8]
        .map(|slices| if slices == 1 { PointStructure::Linear } else { PointStructure::TimeSlices(slices) });
    for count in [1000, 4000, 12_000] {
        let spacing = 1.0 / (count as f32).cbrt();
        for spacings in [0.0, 1.0, 3.0, 10.0] {
            let mut rng = Random(5);
            let mut vector = || Vec3::new(rng.unit(), rng.unit(), rng.unit());
            let mut point = |_| {
                let p = vector();
                MovingPoint::new(p, p + Vec3::X + (vector() - 0.5) * 2.0 * spacings * spacing)
            };
            let points: Vec<MovingPoint> = (0..count).map(&mut point).collect();
            let visited = |structure: PointStructure| {
                let tree = PointTree::build(&points, &params(structure)).unwrap();
                let work = (0..500).map(|i| {
                    let (point, time) = (&points[i * 199 % count], (i * 89 % 500) as f32 / 500.0);
                    let work = tree.query(point.open + (point.close - point.open) * time, time).work(8);
                    (work.nodes * 5 + work.blocks * 2) as f64
                });
                (work.sum::<f64>(), tree.statistics().layers[0].why.clone())
            };
            let (chosen, why) = visited(PointStructure::Automatic);
            let least = forced.map(|structure| visited(structure).0).into_iter().fold(f64::INFINITY, f64::min);
            assert!(chosen < 1.12 * least, "{count} points, {spacings} spacings: {chosen}, not {least}: {why}");
            let tried = !why.contains("at rest");
            assert_eq!(tried, spacings > 0.0, "{count} points, {spacings} spacings: {why}");
        }
    }
}

/// Samples are taken between the keys in the middle, where no point may be active.
#[test]
fn automatic_if_few_or_no_points_are_active() {
    for (begin, end) in [(0.0, 0.3), (0.9, 1.0)] {
        for some in [false, true] {
            let mut cloud = cloud("random", 5000, &mut Random(12));
            let third = cloud.keys[0].iter().map(|p| *p * 0.5).collect();
            cloud.keys.push(third);
            for (i, active) in cloud.active.iter_mut().enumerate() {
                let all_the_time = some && cloud.keys[0][i].x > 0.5;
                *active = if all_the_time { TimeInterval::FULL } else { TimeInterval::new(begin, end).unwrap() };
            }
            let tree = tree_of(&cloud, PointStructure::Automatic);
            let why = &tree.statistics().layers[0].why;
            assert!(!why.contains("NaN") && !why.contains("inf"), "{why}");
            for (time, active) in [(0.1, begin == 0.0), (0.5, false), (0.95, begin == 0.9)] {
                assert_eq!(tree.query(Vec3::ZERO, time).count() == 5000, active, "{why}");
            }
        }
    }
}

/// Points that are compact in the middle of the shutter separate differently in each place: samples see their own place
/// only, and one tree looks good in all of them. In a whirl the leaves of all places overlap before and after, and clusters
/// cross each other's paths.
#[test]
fn automatic_accounts_for_points_from_far_away() {
    let count = 200_000;
    let mut rng = Random(31);
    let place = |rng: &mut Random| Vec3::new(rng.unit(), rng.unit(), rng.unit());
    let whirl = |rng: &mut Random, _: usize| {
        let p = place(rng);
        let from = p - 0.5;
        MovingPoint::new(p, p + Vec3::new(-from.y, from.x, 0.3) * 0.5 / (from.length() + 0.1))
    };
    let clusters: Vec<(Vec3, Vec3)> = (0..40).map(|_| (place(&mut rng), place(&mut rng) - 0.5)).collect();
    let crossing = |rng: &mut Random, i: usize| {
        let (at, displacement) = clusters[i % 40];
        let p = at + place(rng) * 0.04;
        MovingPoint::new(p, p + displacement)
    };
    let sets: [(&str, Vec<MovingPoint>); 2] = [
        ("whirl", (0..count).map(|i| whirl(&mut rng, i)).collect()),
        ("crossing clusters", (0..count).map(|i| crossing(&mut rng, i)).collect()),
    ];
    for (what, points) in sets {
        // The same in f64, around a position that f32 cannot represent.
        let wide = |p: Vec3| p.as_dvec3() + 1000.1;
        let keys = [points.iter().map(|p| wide(p.open)).collect(), points.iter().map(|p| wide(p.close)).collect()];
        let keys: [Vec<DVec3>; 2] = keys;
        let keys: [&[DVec3]; 2] = [&keys[0], &keys[1]];
        let visited = |structure: PointStructure, precise: bool| {
            let tree = match precise {
                true => PointTree::build(&PointArrays { keys: &keys, active: &[], ids: &[] }, &params(structure)),
                false => PointTree::build(&points, &params(structure)),
            };
            let tree = tree.unwrap();
            let work = (0..1000).map(|i| {
                let (point, time) = (&points[i * 199], (i * 89 % 1000) as f32 / 1000.0);
                let at = point.open + (point.close - point.open) * time;
                let work = if precise { tree.query(wide(at), time).work(8) } else { tree.query(at, time).work(8) };
                work.nodes + work.blocks
            });
            work.sum::<u64>()
        };
        for precise in [false, true] {
            let [one, chosen] = [PointStructure::Linear, PointStructure::Automatic].map(|s| visited(s, precise));
            assert!(chosen * 4 < one * 3, "{what}, f64 {precise}: {chosen} nodes and blocks, {one} in one linear tree");
        }
    }
}

/// Points that pass zero exactly, from 1e7 away on both sides, and a query beside zero: f64 is off by more than most of their
/// distances differ.
#[test]
fn closest_approaches_are_told_apart_that_f64_takes_for_equal() {
    let mut rng = Random(33);
    for round in 0..60 {
        let directions: Vec<Vec3> =
            (0..48).map(|_| (rng.vec() * 1e3).round()).filter(|direction| *direction != Vec3::ZERO).collect();
        let mut times = || (rng.unit() * 5e3 + 5e3).round();
        let points: Vec<MovingPoint> =
            directions.iter().map(|direction| MovingPoint::new(*direction * times(), *direction * -times())).collect();
        let q = rng.vec() * 1e-7;
        // From a line through zero, whose direction is known exactly.
        let distance =
            |direction: &Vec3| q.as_dvec3().cross(direction.as_dvec3()).length() / direction.as_dvec3().length();
        let least = directions.iter().map(distance).fold(f64::INFINITY, f64::min);
        for structure in STRUCTURES {
            let params = PointParams { structure, ..PointParams::default() };
            let tree = PointTree::build(&points, &params).unwrap();
            let found = tree.closest_approach(q, q, TimeInterval::FULL).unwrap();
            let off = (f64::from(found.distance) / least - 1.0).abs();
            assert!(off < 1e-7, "round {round}, {structure:?}: {found:?} instead of {least:e}");
        }
    }
}
