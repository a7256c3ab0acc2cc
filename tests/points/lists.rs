//! Neighbour lists against comparing all pairs of points.

use crate::list_case::ListCase;
use crate::set::Set;
use crate::support::{Cloud, KINDS, Random, STRUCTURES, build, cloud};
use mbkd::{
    EncounterLists, ListError, ListQuery, MAX_POINT_COORDINATE, MovingPoint, NeighborLists, PointArrays, PointParams,
    PointStructure, PointTree, Precision, Radii, RadiusOf, SimdLevel, TimeInterval, glam::Vec3,
};

fn radii(count: usize, spacing: f32, rng: &mut Random) -> Vec<f32> {
    (0..count).map(|_| spacing * 10f32.powf(rng.unit() - 0.5)).collect()
}

#[test]
fn lists_equal_comparing_all_pairs() {
    for (number, kind) in KINDS.into_iter().enumerate() {
        let mut rng = Random(100 + number as u64);
        let sets = [200, 60].map(|count| Set::from(&cloud(kind, count, &mut rng)));
        let all = STRUCTURES.into_iter().flat_map(|s| SimdLevel::available().into_iter().map(move |simd| (s, simd)));
        let trees: Vec<_> =
            all.map(|(s, simd)| (sets.each_ref().map(|set| set.tree(s, simd)), format!("{s:?}, {simd}"))).collect();
        let mut lists = NeighborLists::new();
        for time in [0.0, 1.0, rng.unit()] {
            let sizes = (0..sets[0].len()).map(|i| sets[0].at(i, time).abs().max_element());
            let size = sizes.fold(1e-40, f64::max);
            let spacing = (size * 0.3) as f32;
            let (own, others) = (radii(200, spacing, &mut rng), radii(60, spacing, &mut rng));
            let plain = ListCase::plain(time, spacing);
            let larger = Radii::Larger { own: &own, others: &own };
            let both = Radii::Larger { own: &own, others: &others };
            let sum = Radii::Sum { own: &own, others: &own };
            let mut cases = vec![
                plain.clone(),
                ListCase { once: true, ..ListCase::plain(time, 0.0) },
                ListCase { radii: Radii::Own(&own), ..plain.clone() },
                ListCase { radii: larger, once: true, ..plain.clone() },
                ListCase { other: true, ..plain.clone() },
                ListCase { other: true, radii: both, ..plain.clone() },
                ListCase { radii: sum, once: true, ..plain.clone() },
                ListCase { other: true, radii: Radii::Sum { own: &own, others: &others }, ..plain.clone() },
            ];
            if size > 1e-30 {
                // From a period beyond the set to one that is many times smaller than the set.
                let lengths = [2.5 * size, 1.7 * size, 0.9 * size, 0.2 * size];
                let [a, b, c] = [0, 1, 2].map(|_| lengths[rng.below(4)]);
                let all = [Some(a), Some(b), Some(c)];
                cases.push(ListCase { periods: [Some(a), None, None], ..plain.clone() });
                cases.push(ListCase { periods: all, radii: larger, once: true, ..plain.clone() });
                cases.push(ListCase { periods: [None, Some(a), Some(b)], other: true, ..plain.clone() });
                cases.push(ListCase { periods: all, radii: sum, ..plain.clone() });
            }
            for case in &cases {
                let expected = case.expected([&sets[0], &sets[1]]);
                for ([tree, other], what) in &trees {
                    let what = format!("{kind}, {what}, time {time}");
                    case.check(&expected, [tree, other], &sets[0], &mut lists, &what);
                }
            }
        }
    }
}

#[test]
fn larger_sets_and_all_numbers_of_threads() {
    let mut rng = Random(7);
    let kinds = ["uniform", "random", "short intervals"];
    let mut sets = kinds.map(|kind| (kind, Set::from(&cloud(kind, 3_000, &mut rng)))).to_vec();
    sets.push(("clusters", Set::clusters(3_000, 2, (1.0, 1e3, 0.1), true, &mut rng)));
    for (kind, set) in sets {
        let time = rng.unit();
        let own = radii(set.len(), 0.1, &mut rng);
        let cases = [
            ListCase::plain(time, 0.2),
            ListCase { periods: [Some(2.0); 3], ..ListCase::plain(time, 0.2) },
            ListCase { radii: Radii::Larger { own: &own, others: &own }, ..ListCase::plain(time, 0.0) },
            ListCase { radii: Radii::Sum { own: &own, others: &own }, ..ListCase::plain(time, 0.0) },
        ];
        let structures = set.structures().filter(|s| [PointStructure::Automatic, PointStructure::Kd].contains(s));
        let trees: Vec<_> = structures.map(|s| set.tree(s, SimdLevel::best())).collect();
        for case in &cases {
            let expected = case.expected([&set; 2]);
            for tree in &trees {
                let mut one = NeighborLists::new();
                case.check(&expected, [tree; 2], &set, &mut one, kind);
                for threads in [1, 2, 3, 8] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    let mut lists = NeighborLists::new();
                    pool.install(|| case.query(tree, tree).with_displacements().run(&mut lists)).unwrap();
                    case.query(tree, tree).with_displacements().run(&mut one).unwrap();
                    assert_eq!(lists.points(), one.points());
                    assert_eq!(lists.offsets(), one.offsets());
                    assert_eq!(lists.ids(), one.ids());
                    assert_eq!(lists.displacements(), one.displacements());
                    assert!(lists.distances_squared().is_empty());
                }
            }
        }
    }
}

/// Every instruction set gives the lists in the same order, not only the same sets.
#[test]
fn order_within_lists_is_the_same_on_every_instruction_set() {
    let cloud = cloud("random", 3_000, &mut Random(3));
    let mut expected: Option<NeighborLists> = None;
    for simd in SimdLevel::available() {
        let tree = build(&cloud, PointStructure::TimeSlices(2), simd);
        let mut lists = NeighborLists::new();
        tree.neighbor_lists(0.3, 0.3).run(&mut lists).unwrap();
        let expected = expected.get_or_insert_with(|| lists.clone());
        assert_eq!((lists.offsets(), lists.ids()), (expected.offsets(), expected.ids()), "{simd}");
    }
}

#[test]
fn points_of_a_lattice_exactly_at_the_radius_count() {
    let n = 12;
    let at = |i: i32| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32);
    let cloud = Cloud::still((0..n * n * n).map(at).collect());
    let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
    let mut lists = NeighborLists::new();
    let period = Some(n as f32);
    tree.neighbor_lists(0.5, 2.0).periodic([period; 3]).run(&mut lists).unwrap();
    // Whole points in a ball of radius 2 without its middle: 6 + 12 + 8 + 6.
    assert!(lists.iter().all(|(_, row)| row.len() == 32));
    tree.neighbor_lists(0.5, 2.0f32.next_down()).periodic([period; 3]).run(&mut lists).unwrap();
    assert!(lists.iter().all(|(_, row)| row.len() == 26));
    let (case, set) = (ListCase::plain(0.5, 2.0), Set::from(&cloud));
    case.check(&case.expected([&set; 2]), [&tree; 2], &set, &mut lists, "lattice");
}

#[test]
fn a_point_that_leaves_the_box_stays_the_neighbor_of_its_images() {
    // One leaves the box of length 1 to the right, the other stays near the left side.
    let points = [
        MovingPoint::new(Vec3::new(0.5, 0.5, 0.5), Vec3::new(1.5, 0.5, 0.5)),
        MovingPoint::fixed(Vec3::new(0.1, 0.5, 0.5)),
    ];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    let mut near = |time: f32| {
        tree.neighbor_lists(time, 0.25).periodic([Some(1.0); 3]).with_displacements().run(&mut lists).unwrap();
        let [x, ..] = lists.displacements();
        let first = lists.points().iter().position(|&id| id == 0).unwrap();
        lists.row(first).first().map(|_| x[lists.offsets()[first]])
    };
    assert_eq!(near(0.0), None);
    assert!((near(0.5).unwrap() - 0.1).abs() < 1e-6, "across the boundary");
    assert!(near(0.6).unwrap().abs() < 1e-6, "in the same place, a period apart");
    assert_eq!(near(1.0), None);
}

#[test]
fn a_radius_beyond_the_box_lists_everything_once() {
    let set = Set::from(&cloud("uniform", 500, &mut Random(9)));
    let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
    let mut lists = NeighborLists::new();
    for radius in [0.6, 3.0, 1e30, f32::INFINITY] {
        let case = ListCase { periods: [Some(1.0), Some(0.7), Some(2.0)], ..ListCase::plain(0.0, radius) };
        case.check(&case.expected([&set; 2]), [&tree; 2], &set, &mut lists, "radius beyond the box");
    }
    tree.neighbor_lists(0.0, f32::INFINITY).periodic([Some(1.0); 3]).run(&mut lists).unwrap();
    assert!(lists.iter().all(|(_, row)| row.len() == 499));
}

#[test]
fn empty_sets_and_single_points_have_empty_lists() {
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    let one = PointTree::build(&[Vec3::ONE], &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    assert_eq!((lists.len(), lists.neighbors(), lists.offsets()), (0, 0, &[0usize][..]));
    for (tree, among, rows, found) in
        [(&empty, &empty, 0, 0), (&empty, &one, 0, 0), (&one, &empty, 1, 0), (&one, &one, 1, 1)]
    {
        tree.neighbor_lists(0.0, 1.0).among(among).in_order().run(&mut lists).unwrap();
        assert_eq!((lists.len(), lists.neighbors(), lists.offsets().len()), (rows, found, rows + 1));
    }
    one.neighbor_lists(0.0, 1.0).run(&mut lists).unwrap();
    assert_eq!((lists.len(), lists.neighbors()), (1, 0), "a point is not its own neighbour");
}

#[test]
fn bad_queries_get_errors() {
    let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    tree.neighbor_lists(0.0, 9.0).run(&mut lists).unwrap();
    let mut error = |query: ListQuery| {
        let error = query.run(&mut lists).unwrap_err();
        assert!(lists.is_empty() && lists.neighbors() == 0 && !error.to_string().is_empty());
        error
    };
    for time in [-0.1, 1.1, f32::NAN, f32::INFINITY] {
        assert_eq!(error(tree.neighbor_lists(time, 1.0)), ListError::Time);
    }
    for radius in [-1.0, f32::NAN, f32::NEG_INFINITY] {
        assert_eq!(error(tree.neighbor_lists(0.0, radius)), ListError::Radius { of: None });
        let (bad, good) = ([1.0, radius], [1.0, 1.0]);
        let [expected, of_listed] =
            [RadiusOf::Point(1), RadiusOf::Listed(1)].map(|of| ListError::Radius { of: Some(of) });
        assert_eq!(error(tree.neighbor_lists(0.0, Radii::Own(&bad))), expected);
        assert_eq!(error(tree.neighbor_lists(0.0, Radii::Larger { own: &bad, others: &good })), expected);
        assert_eq!(error(tree.neighbor_lists(0.0, Radii::Larger { own: &good, others: &bad })), of_listed);
        assert_eq!(error(tree.neighbor_lists(0.0, Radii::Sum { own: &good, others: &bad })), of_listed);
    }
    assert_eq!(
        error(tree.neighbor_lists(0.0, Radii::Own(&[1.0]))),
        ListError::MissingRadius { of: RadiusOf::Point(1) }
    );
    assert_eq!(error(tree.neighbor_lists(0.0, Radii::Own(&[]))), ListError::MissingRadius { of: RadiusOf::Point(0) });
    let larger = Radii::Larger { own: &[1.0, 1.0], others: &[1.0] };
    assert_eq!(error(tree.neighbor_lists(0.0, larger)), ListError::MissingRadius { of: RadiusOf::Listed(1) });
    let sum = Radii::Sum { own: &[1.0], others: &[1.0, 1.0] };
    assert_eq!(error(tree.neighbor_lists(0.0, sum)), ListError::MissingRadius { of: RadiusOf::Point(1) });
    for length in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-40] {
        let query = tree.neighbor_lists(0.0, 1.0).periodic([None, Some(length), None]);
        assert_eq!(error(query), ListError::Period { axis: 1 });
    }
    let query = tree.neighbor_lists(0.0, 1.0).periodic([None, None, Some(1e-7)]);
    assert_eq!(error(query), ListError::FarFromPeriod { axis: 2 });
    let set = PointArrays { keys: &[&[[0.0f32; 3], [1.0; 3]]], active: &[], ids: &[5, 1] };
    let named = PointTree::build(&set, &PointParams::default()).unwrap();
    assert_eq!(error(named.neighbor_lists(0.0, 1.0).in_order()), ListError::Ids { id: 5 });
    let rounded = PointParams { precision: Precision::Single, ..PointParams::default() };
    let wide = PointTree::build(&[[5.0f64; 3], [6.0; 3]], &rounded).unwrap();
    assert_eq!(error(tree.neighbor_lists(0.0, 1.0).among(&wide)), ListError::Origins);
}

#[test]
fn buffers_are_reused() {
    let cloud = cloud("uniform", 5_000, &mut Random(1));
    let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
    let mut lists = NeighborLists::new();
    tree.neighbor_lists(0.0, 0.2).with_distances().in_order().run(&mut lists).unwrap();
    tree.neighbor_lists(0.0, 0.2).with_distances().in_order().run(&mut lists).unwrap();
    let (bytes, address) = (lists.bytes(), [lists.ids().as_ptr(), lists.points().as_ptr()]);
    for radius in [0.1, 0.2, 0.0, 0.2] {
        // Twice, because rows by id are swapped with the others.
        for _ in 0..2 {
            tree.neighbor_lists(0.0, radius).with_distances().in_order().run(&mut lists).unwrap();
        }
        assert_eq!((lists.bytes(), [lists.ids().as_ptr(), lists.points().as_ptr()]), (bytes, address));
    }
}

/// A large set whose bottom nodes hold tight clusters far apart.
#[test]
fn lists_of_tight_clusters_in_a_large_set() {
    let mut rng = Random(11);
    let place = |i: usize| Vec3::new((i % 11) as f32, (i / 11 % 11) as f32, (i / 121) as f32);
    let points: Vec<Vec3> = (0..300_000).map(|i| place(i / 200) + rng.vec() * 1e-3).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    tree.neighbor_lists(0.0, 5e-4).in_order().run(&mut lists).unwrap();
    for i in (0..points.len()).step_by(37) {
        assert_eq!(lists.row(i).len() + 1, tree.query(points[i], 0.0).radius(5e-4).count(), "point {i}");
    }
}

#[test]
fn lists_longer_than_allowed_are_an_error_on_any_number_of_threads() {
    // A clump of forty among others that have at most six neighbours.
    let grid = |i: usize| Vec3::new((i % 17) as f32, (i / 17 % 17) as f32, (i / 289) as f32);
    let mut points: Vec<Vec3> = (0..4913).map(grid).collect();
    points.iter_mut().skip(3000).step_by(40).take(40).for_each(|p| *p = Vec3::splat(-9.0));
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut run = |most| pool.install(|| tree.neighbor_lists(0.0, 1.0).max_neighbors(most).run(&mut lists));
        assert_eq!(run(39), Ok(()));
        assert_eq!(run(38), Err(ListError::TooManyNeighbors { id: 3000 }));
        assert_eq!(run(5), Err(ListError::TooManyNeighbors { id: 307 }));
        assert_eq!(run(38), Err(ListError::TooManyNeighbors { id: 3000 }));
        assert_eq!(run(39), Ok(()));
        assert_eq!(lists.len(), points.len());
    }
    // Each pair in one list only: the last ones of the clump have few.
    tree.neighbor_lists(0.0, 1.0).pairs_once().max_neighbors(39).run(&mut lists).unwrap();
    let once = tree.neighbor_lists(0.0, 1.0).pairs_once().max_neighbors(38).run(&mut lists);
    assert_eq!((once, lists.len()), (Err(ListError::TooManyNeighbors { id: 3000 }), 0));
}

/// Where the first lists of a tree are a thousand times as long as the others, room is not made for as many everywhere.
#[test]
fn memory_of_lists_is_in_proportion_to_what_they_hold() {
    let mut rng = Random(8);
    // A clump in the corner where trees begin, or end.
    let mut place = |i: usize| if i < 700 { Vec3::splat(-0.999) } else { rng.vec() };
    let points: Vec<Vec3> = (0..30_000).map(&mut place).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for corner in [Vec3::ONE, Vec3::NEG_ONE] {
        let points: Vec<Vec3> = points.iter().map(|p| *p * corner).collect();
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let (mut lists, mut swept) = (NeighborLists::new(), EncounterLists::new());
        pool.install(|| tree.neighbor_lists(0.0, 0.01).run(&mut lists)).unwrap();
        pool.install(|| tree.neighbor_lists_swept(TimeInterval::FULL, 0.01).run(&mut swept)).unwrap();
        assert!(lists.neighbors() > 700 * 699 && swept.encounters().len() == lists.neighbors());
        let (held, of_swept) = (4 * lists.neighbors(), size_of_val(swept.encounters()));
        assert!(lists.bytes() < 10 * held, "{} of {held}", lists.bytes());
        assert!(swept.bytes() < 10 * of_swept, "{} of {of_swept}", swept.bytes());
    }
}

#[test]
fn bulk_queries_equal_single_ones() {
    for kind in ["uniform", "surface", "lattice", "random", "short intervals", "huge"] {
        let mut rng = Random(77);
        let cloud = cloud(kind, 2_000, &mut rng);
        let size = cloud.keys.iter().flatten().fold(0.0f32, |most, p| most.max(p.abs().max_element()));
        let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
        // Some of them are outside of the set, none beyond the largest coordinate.
        let most = Vec3::splat(MAX_POINT_COORDINATE as f32);
        let queries: Vec<Vec3> = (0..700).map(|_| (rng.vec() * size * 1.2).clamp(-most, most)).collect();
        let own: Vec<f32> = queries.iter().map(|_| 0.2 * size * rng.unit()).collect();
        let mut lists = NeighborLists::new();
        for (time, radius) in [(0.0, 0.3 * size), (rng.unit(), 0.1 * size), (1.0, 0.0), (0.5, f32::NAN)] {
            // NaN stands for radii of their own.
            let radii = if radius.is_nan() { Radii::Own(&own) } else { Radii::Equal(radius) };
            let of = |query: usize| if radius.is_nan() { own[query] } else { radius };
            tree.within_lists(&queries, time, radii).with_distances().run(&mut lists).unwrap();
            assert_eq!(lists.len(), queries.len());
            let mut seen = vec![false; queries.len()];
            for (row, (query, ids)) in lists.iter().enumerate() {
                assert!(!std::mem::replace(&mut seen[query as usize], true), "query {query} twice");
                let distances = &lists.distances_squared()[lists.range(row)];
                let mut row: Vec<(u32, u32)> =
                    ids.iter().zip(distances).map(|(&id, distance)| (id, distance.to_bits())).collect();
                row.sort_unstable();
                let one = tree.within(queries[query as usize], time, of(query as usize));
                let mut one: Vec<(u32, u32)> = one.iter().map(|n| (n.id, n.distance_squared.to_bits())).collect();
                one.sort_unstable();
                assert_eq!(row, one, "{kind}, query {query} at {time}");
            }
            let found = lists.neighbors();
            tree.within_lists(&queries, time, radii).in_order().run(&mut lists).unwrap();
            assert!(lists.points().iter().copied().eq(0..queries.len() as u32));
            assert_eq!((lists.neighbors(), lists.distances_squared().len()), (found, 0));
            let first = tree.count_within(queries[0], time, of(0));
            assert_eq!(lists.row(0).len(), first);
        }
        let mut bad = |queries: &[Vec3], time, radius| tree.within_lists(queries, time, radius).run(&mut lists);
        assert_eq!(bad(&[Vec3::ZERO, Vec3::NAN], 0.0, 1.0), Err(ListError::Query { query: 1 }));
        assert_eq!(bad(&[Vec3::splat(2e18)], 0.0, 1.0), Err(ListError::Query { query: 0 }));
        assert_eq!(bad(&queries, 0.0, -1.0), Err(ListError::Radius { of: None }));
        assert_eq!(bad(&queries, 2.0, 1.0), Err(ListError::Time));
        let few = tree.within_lists(&queries, 0.0, Radii::Own(&own[1..])).run(&mut lists);
        assert_eq!(few, Err(ListError::MissingRadius { of: RadiusOf::Query(699) }));
        let text = few.unwrap_err().to_string();
        assert!(text.contains("query 699"), "{text}");
        tree.within_lists(&[] as &[Vec3], 0.0, 1.0).run(&mut lists).unwrap();
        assert!(lists.is_empty());
    }
    // Positions in f64 far from zero.
    let points: Vec<[f64; 3]> = (0..100).map(|i| [1e9 + f64::from(i) * 0.25, 3.0, -1e9]).collect();
    let params = PointParams { precision: Precision::Single, ..PointParams::default() };
    let tree = PointTree::build(&points, &params).unwrap();
    let mut lists = NeighborLists::new();
    tree.within_lists(&points, 0.0, 0.3).run(&mut lists).unwrap();
    assert!(lists.iter().all(|(query, row)| row.len() == if query == 0 || query == 99 { 2 } else { 3 }));
}

#[test]
fn queries_in_bulk_take_all_refinements_of_lists() {
    let mut rng = Random(78);
    let [points, queries] = [900, 300].map(|count| (0..count).map(|_| rng.vec()).collect::<Vec<Vec3>>());
    let [tree, of_queries] = [&points, &queries].map(|at| PointTree::build(at, &PointParams::default()).unwrap());
    let (mut found, mut expected, periods) =
        (NeighborLists::new(), NeighborLists::new(), [Some(2.0f32), None, Some(2.0)]);
    let query = tree.within_lists(&queries, 0.3, 0.4).in_order().sorted().with_displacements().periodic(periods);
    query.run(&mut found).unwrap();
    let lists = of_queries.neighbor_lists(0.3, 0.4).among(&tree).in_order().sorted().with_displacements();
    lists.periodic(periods).run(&mut expected).unwrap();
    assert_eq!((found.offsets(), found.ids()), (expected.offsets(), expected.ids()));
    assert_eq!(found.displacements(), expected.displacements());
    let most = (0..found.len()).map(|row| found.row(row).len()).max().unwrap();
    query.max_neighbors(most).run(&mut found).unwrap();
    let first = (0..found.len()).find(|&row| found.row(row).len() == most).unwrap();
    let error = query.max_neighbors(most - 1).run(&mut found).unwrap_err();
    assert_eq!(error, ListError::TooManyNeighbors { id: first as u32 });
}

/// Only points that exist at the time need a radius, whatever else the tree of its time slice holds.
#[test]
fn missing_radii_do_not_depend_on_the_structure() {
    let part = TimeInterval::new(0.0, 0.25).unwrap();
    let at = |x: f32| MovingPoint::new(Vec3::X * x, Vec3::X * x + Vec3::Y);
    let points = [at(0.0), at(1.0), at(2.0).with_active(part)];
    let mut lists = NeighborLists::new();
    for precision in [Precision::Single, Precision::Double] {
        // Points in f64 have no trees with planes.
        let planes = |structure: &PointStructure| precision == Precision::Double && *structure == PointStructure::Kd;
        for structure in STRUCTURES.into_iter().filter(|structure| !planes(structure)) {
            let tree =
                PointTree::build(&points, &PointParams { structure, precision, ..PointParams::default() }).unwrap();
            for radii in [Radii::Own(&[1.5, 1.5]), Radii::Sum { own: &[0.7; 2], others: &[0.8; 2] }] {
                let mut at = |time| tree.neighbor_lists(time, radii).run(&mut lists);
                assert_eq!(at(0.1), Err(ListError::MissingRadius { of: RadiusOf::Point(2) }), "{structure:?}");
                assert_eq!(at(0.9), Ok(()), "{structure:?}");
                assert_eq!(lists.neighbors(), 2);
            }
        }
    }
}
