//! Lists over an interval against comparing all pairs, of points in f32 and in f64.

use crate::set::{AS_GIVEN, CLUSTERS, Set, check, clouds, size};
use crate::support::{Cloud, Random, STRUCTURES, build, cloud};
use mbkd::{
    Encounter, EncounterLists, ListError, MovingPoint, NeighborLists, PointArrays, PointParams, PointStructure,
    PointTree, Precision, Radii, RadiusOf, SimdLevel, TimeInterval,
    glam::{DVec3, Vec3},
};

pub fn meet_all(set: &Set, interval: TimeInterval, radius: f32) -> Vec<Vec<Encounter>> {
    set.meet_all(interval, &AS_GIVEN, |_, _| radius)
}

#[test]
fn swept_lists_equal_comparing_all_pairs() {
    for (kind, cloud, mut rng) in clouds(100) {
        let size = size(&cloud);
        compare(&Set::from(&cloud), &STRUCTURES, &[size * 0.2, 0.0, size * 1e-3], &mut rng, &kind);
    }
    let (mut rng, mut met) = (Random(41), 0);
    for (size, apart, speed, far) in CLUSTERS {
        for (keys, partly_active) in [(1, true), (2, false), (2, true), (4, true)] {
            let set = Set::clusters(120, keys, (size, apart, speed), partly_active, &mut rng).far_away(far);
            let structures: Vec<_> = set.structures().chain([PointStructure::TimeSlices(8)]).collect();
            let radii = [size * 0.2, 0.0, size * 1e-2, apart].map(|radius| radius as f32);
            let about = format!("{size} {apart} {speed} {far}, {keys} keys");
            met += compare(&set, &structures, &radii, &mut rng, &about);
        }
    }
    assert!(met > 100_000, "{met}");
}

/// Compares the lists of several intervals, on all instruction sets, and counts encounters.
fn compare(set: &Set, structures: &[PointStructure], radii: &[f32], rng: &mut Random, about: &str) -> usize {
    let all = structures.iter().flat_map(|s| SimdLevel::available().into_iter().map(move |simd| (*s, simd)));
    let trees: Vec<_> = all.map(|(s, simd)| (set.tree(s, simd), format!("{s:?}, {simd}"))).collect();
    let (a, b) = (rng.unit() * 0.9, rng.unit() * 1e-3);
    let intervals = [(0.0, 1.0), (0.25, 0.5), (a, a + 0.1), (a, a + b), (1.0f32.next_down(), 1.0)];
    let mut met = 0;
    for (begin, end) in intervals.into_iter().filter(|(begin, end)| begin < end) {
        let interval = TimeInterval::new(begin, end).unwrap();
        for &radius in radii {
            let expected = meet_all(set, interval, radius);
            met += expected.iter().map(Vec::len).sum::<usize>();
            for (tree, what) in &trees {
                let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                check(&found, &expected, &format!("{about}, {what}, {begin}..{end}, radius {radius}"));
            }
        }
    }
    met
}

/// How far two points may be from each other, from the radii of both.
type OfPair = fn(f32, f32) -> f32;

/// Radii of their own, and each pair once.
#[test]
fn swept_lists_with_radii_of_their_own_equal_comparing_all_pairs() {
    let mut met = 0;
    for (kind, cloud, mut rng) in clouds(100) {
        let (set, small) = (Set::from(&cloud), size(&cloud) * 0.05);
        // A few are large, and some are nothing but points.
        let radii: Vec<f32> =
            (0..cloud.len()).map(|i| small * [0.0, rng.unit(), 1.0, 4.0][[1, 1, 2, 1, 0, 1, 1, 3][i % 8]]).collect();
        let own = &radii[..];
        let of: [(Radii, OfPair); 3] = [
            (Radii::Own(own), |own, _| own),
            (Radii::Larger { own, others: own }, f32::max),
            (Radii::Sum { own, others: own }, |own, other| own + other),
        ];
        for structure in STRUCTURES {
            for (simd, precision) in SimdLevel::available().into_iter().flat_map(|simd| {
                let double = (structure != PointStructure::Kd).then_some((simd, Precision::Double));
                [(simd, Precision::Single)].into_iter().chain(double)
            }) {
                let tree = Set { single: precision == Precision::Single, ..set.clone() }.tree(structure, simd);
                for (begin, end) in [(0.0, 1.0), (0.3, 0.55)] {
                    let interval = TimeInterval::new(begin, end).unwrap();
                    for ((radii, of_pair), once) in of.into_iter().flat_map(|of| [(of, false), (of, true)]) {
                        let mut expected = set.meet_all(interval, &AS_GIVEN, |i, j| of_pair(own[i], own[j]));
                        if once {
                            expected.iter_mut().zip(0..).for_each(|(row, i)| row.retain(|e| e.id > i));
                        }
                        met += expected.iter().map(Vec::len).sum::<usize>();
                        let query = tree.neighbor_lists_swept(interval, radii);
                        let found = if once { query.pairs_once() } else { query }.collect().unwrap();
                        let what = format!("{kind}, {structure:?}, {simd}, {precision:?}, {begin}..{end}, once {once}");
                        check(&found, &expected, &what);
                    }
                }
            }
        }
        let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
        let swept = |radii: Radii| tree.neighbor_lists_swept(TimeInterval::FULL, radii).collect().map(|_| ());
        // (The last point may not exist in all kinds of sets.)
        if cloud.active[99] == TimeInterval::FULL {
            let few = &own[..99];
            assert_eq!(swept(Radii::Own(few)), Err(ListError::MissingRadius { of: RadiusOf::Point(99) }));
            let listed = Radii::Sum { own, others: few };
            assert_eq!(swept(listed), Err(ListError::MissingRadius { of: RadiusOf::Listed(99) }));
        }
        let mut bad = radii.clone();
        bad[17] = -1.0;
        let others = Radii::Larger { own, others: &bad };
        assert_eq!(swept(others), Err(ListError::Radius { of: Some(RadiusOf::Listed(17)) }));
        assert_eq!(swept(Radii::Own(&bad)), Err(ListError::Radius { of: Some(RadiusOf::Point(17)) }));
    }
    assert!(met > 100_000, "{met}");
}

/// Pairs that touch at a key where the interval ends: in the segment before, rounding puts them beside where they are at the key.
/// Whether another point begins to exist there makes no difference.
#[test]
fn encounters_at_a_key_that_ends_the_interval_are_found() {
    let interval = |end| TimeInterval::new(0.25, end).unwrap();
    let far = DVec3::new(70.3, 50.1, 0.7);
    let keys = [[0.1, -0.2], [0.5, 0.5], [9.0, -9.0]].map(|x| vec![DVec3::X * x[0], DVec3::X * x[1], far]);
    let keys: Vec<&[DVec3]> = keys.iter().map(Vec::as_slice).collect();
    for third in [0.0, 0.4, 0.5] {
        let active = [TimeInterval::FULL, TimeInterval::FULL, TimeInterval::new(third, 1.0).unwrap()];
        for structure in [PointStructure::Linear, PointStructure::Automatic, PointStructure::TimeSlices(4)] {
            let set = PointArrays { keys: &keys, active: &active, ids: &[] };
            let tree = PointTree::build(&set, &PointParams { structure, ..PointParams::default() }).unwrap();
            let lists = tree.neighbor_lists_swept(interval(0.5), 0.0).pairs_once().in_order().collect().unwrap();
            let of_first: Vec<_> = lists.row(0).iter().map(|e| (e.id, e.enter, e.leave, e.distance_squared)).collect();
            assert_eq!(of_first, [(1, 0.5, 0.5, 0.0)], "{structure:?}, third from {third}");
        }
    }
    let at_key = Vec3::new(0.877_929_7, -0.001_890_677_8, 0.423_911_96);
    let keys = [
        [Vec3::new(-1206016.5, -1_101_859.8, 231423.7), Vec3::new(805910.94, -1020014.6, 722939.0)],
        [at_key; 2],
        [Vec3::new(-979232.0, 526036.8, -1084065.3), Vec3::new(151844.67, -680145.4, 707445.4)],
    ];
    let keys: Vec<&[Vec3]> = keys.iter().map(|key| &key[..]).collect();
    let tree = PointTree::build(&PointArrays { keys: &keys, active: &[], ids: &[] }, &PointParams::default()).unwrap();
    for end in [0.5, 0.6] {
        let lists = tree.neighbor_lists_swept(interval(end), 0.0).collect().unwrap();
        assert_eq!(lists.encounters().len(), 2, "until {end}");
    }
}

/// Whatever the structure, points need no radius if they cease to exist where the interval begins.
#[test]
fn points_that_do_not_exist_in_the_interval_need_no_radius() {
    let [first, second] = [(0.0, 0.5), (0.5, 1.0)].map(|(begin, end)| TimeInterval::new(begin, end).unwrap());
    let point = |i: u32| MovingPoint::new(Vec3::X * i as f32, Vec3::Y * i as f32);
    let points: Vec<_> = (0..40).map(|i| point(i).with_active(if i < 30 { second } else { first })).collect();
    let radii = [0.5; 30];
    for structure in STRUCTURES {
        let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
        let lists = |interval| tree.neighbor_lists_swept(interval, Radii::Own(&radii)).collect().map(|_| ());
        assert_eq!(lists(second), Ok(()), "{structure:?}");
        assert_eq!(lists(first), Err(ListError::MissingRadius { of: RadiusOf::Point(30) }), "{structure:?}");
    }
}

/// More points near a leaf than are gathered at once; some rows are compared with all pairs, and the lists are computed
/// again in memory that held others.
#[test]
fn lists_longer_than_one_gather() {
    let mut lists = EncounterLists::new();
    for (kind, radius) in [("random", 9.0), ("fast few", 0.6), ("short intervals", 0.9)] {
        let cloud = cloud(kind, 2500, &mut Random(11));
        let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
        let interval = TimeInterval::new(0.1, 0.8).unwrap();
        tree.neighbor_lists_swept(interval, radius).run(&mut lists).unwrap();
        let (set, mut longest) = (Set::from(&cloud), 0);
        for i in (0..cloud.len()).step_by(50) {
            let expected = set.meet_others(i, interval, &AS_GIVEN, |_| radius);
            let found = lists.iter().find(|(id, _)| *id == i as u32);
            let mut found = found.map_or(Vec::new(), |(_, row)| row.to_vec());
            found.sort_unstable_by_key(|e| e.id);
            assert_eq!(found, expected, "{kind}, point {i}");
            longest = longest.max(found.len());
        }
        assert!(kind != "random" || longest == 2499, "{longest}");
    }
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    empty.neighbor_lists_swept(TimeInterval::FULL, 1.0).run(&mut lists).unwrap();
    assert_eq!((lists.len(), lists.encounters().len()), (0, 0));
}

#[test]
fn larger_sets_swept_on_all_numbers_of_threads() {
    let kinds = ["random", "coherent", "fast few", "wild speeds", "short intervals"];
    let mut sets: Vec<_> =
        kinds.into_iter().map(|kind| (Set::from(&cloud(kind, 1100, &mut Random(5))), 0.2, kind)).collect();
    let mut rng = Random(43);
    let mut clusters = |partly| Set::clusters(1100, 2, (1.0, 0.0, 0.4), partly, &mut rng);
    sets.extend([
        (clusters(false), 0.2, "clusters"),
        (clusters(false).far_away(1e9), 0.2, "clusters far away"),
        (clusters(true).far_away(1e9), 0.2, "clusters far away, partly active"),
        (clusters(false), 9.0, "clusters, a radius of all"),
    ]);
    let interval = TimeInterval::new(0.2, 0.7).unwrap();
    for (set, radius, what) in sets {
        let expected = meet_all(&set, interval, radius);
        for structure in set.structures() {
            let tree = set.tree(structure, SimdLevel::best());
            let found = [1, 3].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| tree.neighbor_lists_swept(interval, radius).collect()).unwrap()
            });
            assert_eq!(found[0], found[1], "{what}, {structure:?}");
            check(&found[0], &expected, &format!("{what}, {structure:?}"));
        }
    }
}

/// Sets with work for several threads in several rounds, in memory that held other lists.
#[test]
fn lists_of_many_points_are_the_same_on_two_threads_as_on_one() {
    let [one, two] = [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    let interval = TimeInterval::new(0.2, 0.7).unwrap();
    let (mut swept, mut lists) =
        ([EncounterLists::new(), EncounterLists::new()], [NeighborLists::new(), NeighborLists::new()]);
    for count in [30_000, 12_345, 20_000] {
        let tree = build(&cloud("random", count, &mut Random(count as u64)), PointStructure::Linear, SimdLevel::best());
        for ((pool, swept), lists) in [&one, &two].into_iter().zip(&mut swept).zip(&mut lists) {
            pool.install(|| tree.neighbor_lists_swept(interval, 0.06).run(swept)).unwrap();
            pool.install(|| tree.neighbor_lists(0.2, 0.06).run(lists)).unwrap();
        }
        assert!(swept[0].encounters().len() > 2 * count && swept[0].len() == count);
        let rows: Vec<_> =
            swept[0].points().iter().copied().enumerate().map(|(row, id)| (id, swept[0].row(row))).collect();
        assert!(swept[0].iter().eq(rows) && swept[0].offsets().last() == Some(&swept[0].encounters().len()));
        assert!(swept[0].bytes() >= size_of_val(swept[0].encounters()) + size_of_val(swept[0].offsets()));
        assert_eq!(swept[0], swept[1], "{count} points");
        assert!(lists[0].neighbors() > count / 2);
        assert_eq!(
            (lists[0].points(), lists[0].offsets(), lists[0].ids()),
            (lists[1].points(), lists[1].offsets(), lists[1].ids()),
            "{count} points"
        );
    }
}

/// Limits, the order of ids, and sorted lists, of one tree, of time slices, and of ids that repeat, on any number of threads.
#[test]
fn refined_lists_hold_the_same_encounters() {
    let mut rng = Random(54);
    let count = 4000;
    // A clump of fifty, all others have few neighbours.
    let first: Vec<Vec3> =
        (0..count).map(|i| if i % 70 == 3 && i < 3500 { Vec3::splat(3.0) } else { rng.vec() }).collect();
    let second: Vec<Vec3> = first.iter().map(|p| *p + rng.vec() * 0.05).collect();
    let ids: Vec<u32> = (0..count as u32).map(|i| i / 2).collect();
    for (structure, ids) in
        [(PointStructure::Linear, &[][..]), (PointStructure::TimeSlices(4), &[]), (PointStructure::TimeSlices(4), &ids)]
    {
        let set = PointArrays { keys: &[&first[..], &second], active: &[], ids };
        let tree = PointTree::build(&set, &PointParams { structure, ..PointParams::default() }).unwrap();
        let query = tree.neighbor_lists_swept(TimeInterval::FULL, 0.2);
        let mut expected = vec![Vec::new(); count];
        for (id, list) in query.collect().unwrap().iter() {
            expected[id as usize] = list.to_vec();
            expected[id as usize].sort_by_key(|encounter| encounter.id);
        }
        let most = expected.iter().map(Vec::len).max().unwrap();
        let crowded = |most: usize| expected.iter().position(|list| list.len() > most).unwrap() as u32;
        let mut lists = EncounterLists::new();
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            for query in [query, query.max_neighbors(most)] {
                pool.install(|| query.in_order().sorted().run(&mut lists)).unwrap();
                assert!(lists.points().iter().copied().eq(0..count as u32));
                assert!(lists.iter().all(|(id, list)| expected[id as usize] == list), "{structure:?}");
            }
            for most in [most - 1, most / 2, 0] {
                let error = pool.install(|| query.max_neighbors(most).in_order().run(&mut lists)).unwrap_err();
                assert_eq!(error, ListError::TooManyNeighbors { id: crowded(most) }, "{structure:?}, {most}");
                assert!(lists.is_empty() && lists.encounters().is_empty());
            }
        }
    }
    let set = PointArrays { keys: &[&first[..2], &second[..2]], active: &[], ids: &[0, 7] };
    let tree = PointTree::build(&set, &PointParams::default()).unwrap();
    let error = tree.neighbor_lists_swept(TimeInterval::FULL, 9.0).in_order().collect().unwrap_err();
    assert_eq!(error, ListError::Ids { id: 7 });
}

/// Active intervals and parts of the shutter include their begin and exclude their end: two points of which one begins when
/// the other ends have no encounter then, those that begin together do, also at splits of the shutter, at keys, and at the
/// end of the query.
#[test]
fn intervals_that_touch_at_splits_of_the_shutter() {
    let mut rng = Random(77);
    let mut cloud = cloud("random", 160, &mut rng);
    for (i, active) in cloud.active.iter_mut().enumerate() {
        let (begin, end) = [(0.0, 0.5), (0.5, 1.0), (0.25, 0.5), (0.5, 0.625), (0.0, 1.0), (0.375, 0.875)][i % 6];
        *active = TimeInterval::new(begin, end).unwrap();
    }
    // Some are static, so that there may be layers; a few are fast.
    for i in (0..160).filter(|i| i % 6 == 4) {
        cloud.keys[1][i] = if i % 4 == 0 { cloud.keys[0][i] } else { cloud.keys[1][i] * 4.0 };
    }
    let third = |(a, b): (&Vec3, &Vec3)| if a == b { *a } else { *a * 0.5 + *b * 0.4 };
    let mut three_keys = cloud.clone();
    three_keys.keys.push(cloud.keys[0].iter().zip(&cloud.keys[1]).map(third).collect());
    let mut five_keys = three_keys.clone();
    five_keys.keys.push(cloud.keys[1].clone());
    five_keys.keys.push(cloud.keys[0].clone());
    let mut sets = [cloud, three_keys, five_keys].map(|cloud| Set::from(&cloud)).to_vec();
    for keys in [2, 3, 5] {
        let mut set = Set::clusters(160, keys, (1.0, 0.0, 0.5), false, &mut rng).far_away(1e6);
        set.active.clone_from(&sets[0].active);
        for i in (0..160).filter(|i| i % 6 == 4) {
            let at = set.keys[0][i];
            set.keys.iter_mut().for_each(|key| key[i] = at);
        }
        sets.push(set);
    }
    for set in sets {
        let structures = set.structures().chain([2, 8].map(PointStructure::TimeSlices));
        let trees: Vec<_> = structures.map(|structure| (structure, set.tree(structure, SimdLevel::best()))).collect();
        let mut touching = 0;
        for (begin, end) in [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0), (0.25, 0.5), (0.5, 0.75), (0.4, 0.6), (0.625, 0.875)] {
            let interval = TimeInterval::new(begin, end).unwrap();
            for radius in [0.3, 9.0] {
                let expected = meet_all(&set, interval, radius);
                touching += expected.iter().flatten().filter(|e| e.enter == 0.5 && e.leave == 0.5).count();
                for (structure, tree) in &trees {
                    let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                    let (keys, single) = (set.keys.len(), set.single);
                    let what = format!("{keys} keys, {single}, {structure:?}, {begin}..{end}, radius {radius}");
                    check(&found, &expected, &what);
                }
            }
        }
        assert!(touching > 1000, "{touching}");
    }
}

/// Of three, six and ten segments some keys are no f32 numbers. An interval that ends or begins with the float next to such a key
/// extends into the next segment, or begins in the previous one, by less than one f32 step of time.
#[test]
fn intervals_that_end_next_to_keys_that_are_no_floats() {
    let mut rng = Random(78);
    for (keys, single) in [4, 7, 11].into_iter().flat_map(|keys| [(keys, true), (keys, false)]) {
        // So fast that a step of time changes the distance.
        let set = Set { single, ..Set::clusters(60, keys, (1.0, 0.0, 1e3), false, &mut rng) }.far_away(0.0);
        let trees: Vec<_> = set.structures().map(|s| (s, set.tree(s, SimdLevel::best()))).collect();
        for key in 1..keys - 1 {
            let near = key as f32 / (keys - 1) as f32;
            for time in [near.next_down(), near, near.next_up()] {
                for (begin, end) in [(time * 0.9, time), (time, time + 0.1 * (1.0 - time)), (time, time.next_up())] {
                    let interval = TimeInterval::new(begin, end).unwrap();
                    for radius in [2e3, 5e4] {
                        let expected = meet_all(&set, interval, radius);
                        for (structure, tree) in &trees {
                            let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                            let what = format!("{keys} keys, {single}, {structure:?}, {begin}..{end}, {radius}");
                            check(&found, &expected, &what);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_pair_that_just_touches_the_radius_and_points_in_the_same_place() {
    // Two pass at a distance of exactly one; two are always in the same place.
    let points = [
        MovingPoint::new(Vec3::new(-2.0, 1.0, 0.0), Vec3::new(2.0, 1.0, 0.0)),
        MovingPoint::fixed(Vec3::ZERO),
        MovingPoint::fixed(Vec3::ZERO),
    ];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let row = |radius: f32, interval: TimeInterval| {
        let lists = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
        let mut row = lists.iter().find(|(id, _)| *id == 1).unwrap().1.to_vec();
        row.sort_unstable_by_key(|e| e.id);
        row
    };
    let touch = Encounter { id: 0, enter: 0.5, leave: 0.5, closest: 0.5, distance_squared: 1.0 };
    let always = Encounter { id: 2, enter: 0.0, leave: 1.0, closest: 0.0, distance_squared: 0.0 };
    assert_eq!(row(1.0, TimeInterval::FULL), [touch, always]);
    assert_eq!(row(1.0f32.next_down(), TimeInterval::FULL), [always]);
    assert_eq!(row(0.0, TimeInterval::FULL), [always]);
    assert_eq!(row(1.0, TimeInterval::new(0.0, 0.5).unwrap())[0], touch);
    assert_eq!(row(1.0, TimeInterval::new(0.0, 0.5f32.next_down()).unwrap()).len(), 1);
}

/// Active intervals that begin and end at a key, at which paths have a bend: only the motion on the one side of the key counts, and
/// the closest time may be the end of an interval, at which no encounter begins.
#[test]
fn closest_times_of_active_intervals_that_begin_and_end_at_a_key() {
    let intervals = [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0), (0.0, 0.5), (0.5, 1.0), (0.0, 0.5)];
    // Distances from the first point at the keys.
    let apart = [[0.0; 3], [2.0, 1.0, 0.25], [0.25, 1.0, 2.0], [3.0, 1.5, 0.0], [0.0, 1.0, 0.5], [1.0, 1.0, 0.5]];
    let direction = |i: usize| [Vec3::X, Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z, Vec3::NEG_Z][i];
    let keys = [0, 1, 2].map(|key| (0..6).map(|i| direction(i) * apart[i][key]).collect());
    let active = intervals.map(|(begin, end)| TimeInterval::new(begin, end).unwrap());
    let cloud = Cloud { keys: keys.to_vec(), active: active.to_vec() };
    let encounter =
        |id, enter, leave, closest, distance_squared| Encounter { id, enter, leave, closest, distance_squared };
    let expected = [
        // Approaching until it ends; from its begin on receding; within the radius at its end only; nearest at the very end;
        // always as near.
        encounter(1, 0.25, 0.5, 0.5, 1.0),
        encounter(2, 0.5, 0.75, 0.5, 1.0),
        encounter(4, 0.5, 1.0, 1.0, 0.25),
        encounter(5, 0.0, 0.5, 0.0, 1.0),
    ];
    for structure in STRUCTURES.into_iter().chain([PointStructure::TimeSlices(2)]) {
        let tree = build(&cloud, structure, SimdLevel::best());
        let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 1.5).collect().unwrap();
        let mut row = lists.iter().find(|(id, _)| *id == 0).unwrap().1.to_vec();
        row.sort_unstable_by_key(|e| e.id);
        assert_eq!(row, expected, "{structure:?}");
        // The closest approach to the first point: of this one it is at the end, where no encounter begins.
        let end = tree.closest_approach_filtered(Vec3::ZERO, Vec3::ZERO, TimeInterval::FULL, |id| id == 3).unwrap();
        assert_eq!((end.time, end.distance), (0.5, 1.5), "{structure:?}");
    }
}

/// One that comes as near again, and one that stays as near.
#[test]
fn the_closest_time_is_the_first_of_several() {
    let keys = [3.0, 1.0, 3.0, 1.0, 2.0].map(|apart| vec![Vec3::ZERO, Vec3::X * apart, Vec3::Y]);
    let cloud = Cloud { keys: keys.to_vec(), active: Vec::new() };
    for structure in STRUCTURES.into_iter().chain([2, 3, 8].map(PointStructure::TimeSlices)) {
        let tree = build(&cloud, structure, SimdLevel::best());
        for once in [false, true] {
            let query = tree.neighbor_lists_swept(TimeInterval::FULL, 1.5);
            let lists = if once { query.pairs_once() } else { query }.sorted().collect().unwrap();
            let row = lists.iter().find(|(id, _)| *id == 0).unwrap().1;
            let met: Vec<_> = row.iter().map(|e| (e.id, e.closest, e.distance_squared)).collect();
            assert_eq!(met, [(1, 0.25, 1.0), (2, 0.0, 1.0)], "{structure:?}, {once}");
        }
    }
}

#[test]
fn bad_queries_get_errors_and_empty_sets_empty_lists() {
    let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    for bad in [-1.0, f32::NAN] {
        let radius = Err(ListError::Radius { of: None });
        assert_eq!(tree.neighbor_lists_swept(TimeInterval::FULL, bad).collect().map(|_| ()), radius.clone());
        tree.neighbor_lists(0.0, 9.0).run(&mut lists).unwrap();
        assert_eq!(tree.neighbor_lists_with_skin(0.0, bad, 1.0, 1.0, &mut lists).map(|_| ()), radius);
        assert!(lists.is_empty());
        assert_eq!(tree.neighbor_lists_with_skin(0.0, 1.0, bad, 1.0, &mut lists), Err(ListError::Skin));
        assert!(!ListError::Skin.to_string().is_empty());
    }
    for (time, until) in [(-0.1, 1.0), (f32::NAN, 1.0), (1.5, 1.6)] {
        assert_eq!(tree.neighbor_lists_with_skin(time, 1.0, 1.0, until, &mut lists), Err(ListError::Time));
        assert_eq!(tree.neighbor_lists(time, 2.0).certified_until(1.0, until), Err(ListError::Time));
    }
    for (time, until) in [(0.5, 0.4), (0.5, 1.1), (0.0, f32::NAN)] {
        assert_eq!(tree.neighbor_lists_with_skin(time, 1.0, 1.0, until, &mut lists), Err(ListError::Until));
        assert_eq!(tree.neighbor_lists(time, 2.0).certified_until(1.0, until), Err(ListError::Until));
    }
    let texts = [ListError::Time, ListError::Until].map(|error| error.to_string().contains("until"));
    assert_eq!(texts, [false, true], "each is about its own time");
    for radius in [f32::INFINITY, 1e30] {
        let lists = tree.neighbor_lists_swept(TimeInterval::FULL, radius).collect().unwrap();
        assert_eq!(lists.encounters().len(), 2);
    }
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    assert!(empty.neighbor_lists_swept(TimeInterval::FULL, 1.0).collect().unwrap().is_empty());
    assert_eq!(empty.neighbor_lists_with_skin(0.25, 1.0, 1.0, 0.75, &mut lists), Ok(0.75));
    // Nothing moves, so lists hold wherever the points are; a point that moves a little takes that away far from zero.
    let far = [MovingPoint::fixed(Vec3::X * 1e6), MovingPoint::fixed(Vec3::X * (1e6 + 3.0))];
    let tree = PointTree::build(&far, &PointParams::default()).unwrap();
    assert_eq!(tree.neighbor_lists_with_skin(0.25, 1.5, 1.0, 0.75, &mut lists), Ok(0.75));
    let moving = [far[0], MovingPoint::new(Vec3::X * (1e6 + 2.75), Vec3::X * (1e6 + 3.75))];
    let tree = PointTree::build(&moving, &PointParams::default()).unwrap();
    assert_eq!(tree.neighbor_lists_with_skin(0.25, 1.5, 1.0, 0.75, &mut lists), Ok(0.25));
}

/// Two crowds, each at one place, that come as near as the radius and no nearer: whether boxes and points are met is a matter of
/// rounding, of f32 near zero and of f64 far away, where the radius has few bits.
#[test]
fn crowds_that_just_touch_the_radius_are_met() {
    const CROWD: usize = 256;
    let mut rng = Random(61);
    for (single, far, size, speed) in [
        (true, 1e3, 1.0, 1.0),
        (true, 0.0, 1.0, 1.0),
        (true, 1e3, 1.0, 1e3),
        (true, 1.0, 1.0, 1e4),
        (false, 0.0, 1.0, 1.0),
        (false, 1e9, 1e-3, 1e-3),
        (false, 1e9, 1e-5, 1.0),
        (false, 1e9, 1e-4, 1e9),
        (false, 1e12, 1.0, 1e3),
        (false, 1.0, 1e-9, 1e-3),
    ] {
        for round in 0..12 {
            let offset = rng.dvec() * far;
            let mut trajectory = || {
                let (at, by) = (offset + rng.dvec() * size, rng.dvec() * speed);
                [at - by * 0.5, at + by * 0.5]
            };
            let trajectories = [trajectory(), trajectory()];
            let crowds = |count: usize| {
                let key = |key: usize| trajectories.iter().flat_map(|keys| vec![keys[key]; count]).collect();
                Set::new(vec![key(0), key(1)], single)
            };
            let (pair, crowd) = (crowds(1), crowds(CROWD));
            let interval = TimeInterval::new(0.25 * rng.unit(), 0.75 + 0.25 * rng.unit()).unwrap();
            let touch = |radius: f32| !meet_all(&pair, interval, radius)[0].is_empty();
            // The least radius at which the two meet: near the distance as rounded to f32.
            let apart = meet_all(&pair, interval, f32::MAX)[0][0].distance_squared.sqrt();
            let mut radius = apart * (1.0 - 1e-6);
            while !touch(radius) {
                radius = radius.next_up();
            }
            for structure in [PointStructure::Linear, PointStructure::TimeSlices(3)] {
                let tree = crowd.tree(structure, SimdLevel::best());
                let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                let what = format!("{far} {size} {speed}, single {single}, round {round}, {structure:?}");
                for (id, row) in found.iter() {
                    assert_eq!(row.len(), 2 * CROWD - 1, "{what}: point {id}, radius {radius}");
                }
                assert_eq!(found.iter().count(), 2 * CROWD, "{what}");
            }
        }
    }
}

/// Points with the same id have one list together, with one encounter for each other id, whatever the structure.
#[test]
fn points_with_the_same_id_have_one_list() {
    let mut met_twice = 0;
    for (kind, cloud, _) in clouds(90) {
        let ids: Vec<u32> = (0..90).map(|i| i * 7 % 40).collect();
        let radius = 0.3 * size(&cloud);
        let mut expected = vec![Vec::<Encounter>::new(); 40];
        for (row, &id) in meet_all(&Set::from(&cloud), TimeInterval::FULL, radius).into_iter().zip(&ids) {
            let others = row.into_iter().map(|e| Encounter { id: ids[e.id as usize], ..e });
            for new in others.filter(|other| other.id != id) {
                let list = &mut expected[id as usize];
                let Some(known) = list.iter_mut().find(|known| known.id == new.id) else {
                    list.push(new);
                    continue;
                };
                let order = |e: &Encounter| (e.distance_squared.to_bits(), e.closest.to_bits());
                let nearest = if order(&new) < order(known) { new } else { *known };
                *known = Encounter { enter: known.enter.min(new.enter), leave: known.leave.max(new.leave), ..nearest };
                met_twice += 1;
            }
        }
        expected.iter_mut().for_each(|list| list.sort_unstable_by_key(|e| e.id));
        let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
        for structure in STRUCTURES {
            let params = PointParams { structure, max_references: 3.0, ..PointParams::default() };
            let tree =
                PointTree::build(&PointArrays { keys: &keys, active: &cloud.active, ids: &ids }, &params).unwrap();
            let swept = tree.neighbor_lists_swept(TimeInterval::FULL, radius);
            check(&swept.collect().unwrap(), &expected, &format!("{kind}, {structure:?}"));
            // The ids of another set are not those of this one.
            let among = swept.among(&tree).collect().unwrap();
            for (id, row) in among.iter() {
                let mut others: Vec<u32> = row.iter().map(|e| e.id).collect();
                others.sort_unstable();
                let known: Vec<u32> = expected[id as usize].iter().map(|e| e.id).collect();
                assert!(others.windows(2).all(|two| two[0] < two[1]) && others.contains(&id), "{kind}, {structure:?}");
                others.retain(|&other| other != id);
                assert_eq!(others, known, "{kind}, {structure:?}, among itself, {id}");
            }
        }
    }
    assert!(met_twice > 1000, "{met_twice}");
}
