//! Lists over an interval in periodic boxes against comparing all pairs in all images.

use crate::set::{KINDS, LENGTHS, Set, check, periods_along};
use crate::support::Random;
use mbkd::{
    Encounter, EncounterLists, ListError, MovingPoint, PointArrays, PointParams, PointStructure, PointTree, Precision,
    Radii, RadiusOf, SimdLevel, TimeInterval,
    glam::{DVec3, Vec3},
};

/// From small ones, with which most leaves have one image, to several periods.
const RADII: [f32; 5] = [0.07, 0.2, 0.34, 0.6, 3.0];

const AXES: [[bool; 3]; 4] = [[true; 3], [true, true, false], [false, true, false], [true, false, true]];

#[test]
fn swept_lists_equal_comparing_all_pairs_in_all_images() {
    let (mut met, mut lists) = (0, EncounterLists::new());
    for (number, kind) in KINDS.into_iter().enumerate() {
        for (turn, (count, keys)) in [(3, 2), (40, 2), (40, 3), (110, 2)].into_iter().enumerate() {
            for single in [true, false] {
                let mut rng = Random(100 * number as u64 + turn as u64);
                let set = Set::of_kind(kind, count, keys, single, &mut rng);
                let periods = periods_along(AXES[(turn + number) % AXES.len()]);
                // The larger the radius, the more images.
                let radius = RADII[(turn * 2 + number) % RADII.len()];
                let small: Vec<f32> = (0..count).map(|_| radius * rng.unit()).collect();
                let (begin, end) = [(0.0, 1.0), (0.25, 0.6), (0.7, 1.0)][(turn + number) % 3];
                let interval = TimeInterval::new(begin, end).unwrap();
                let all = set.images(periods);
                let expected = set.meet_all(interval, &all, |_, _| radius);
                let of_sum = set.meet_all(interval, &all, |i, j| small[i] + small[j]);
                met += expected.iter().map(Vec::len).sum::<usize>();
                for (structure, simd) in
                    set.structures().flat_map(|s| SimdLevel::available().into_iter().map(move |simd| (s, simd)))
                {
                    let tree = set.tree(structure, simd);
                    let what = format!("{kind}, {count} points, {keys} keys, single {single}, {structure:?}, {simd}");
                    let query = tree.neighbor_lists_swept(interval, radius).periodic(periods);
                    query.run(&mut lists).unwrap();
                    check(&lists, &expected, &format!("{what}, radius {radius}"));
                    let sum = Radii::Sum { own: &small, others: &small };
                    tree.neighbor_lists_swept(interval, sum).periodic(periods).run(&mut lists).unwrap();
                    check(&lists, &of_sum, &format!("{what}, sums"));
                }
            }
        }
    }
    assert!(met > 10_000, "{met}");
}

/// Enough points for several levels, most of which are near no face; some rows are compared with all pairs, on any number of
/// threads.
#[test]
fn larger_sets_on_all_numbers_of_threads() {
    let periods = LENGTHS.map(Some);
    let interval = TimeInterval::new(0.1, 0.9).unwrap();
    for (kind, keys, single) in
        [("in the box", 2, true), ("some at rest", 3, true), ("drifting", 2, false), ("periods away", 2, true)]
    {
        let set = Set::of_kind(kind, 3000, keys, single, &mut Random(8));
        let (all, radius) = (set.images(periods), 0.12);
        let expected = |i: usize| (i, set.meet_others(i, interval, &all, |_| radius));
        let expected: Vec<_> = (0..set.len()).step_by(211).map(expected).collect();
        for structure in set.structures() {
            let tree = set.tree(structure, SimdLevel::best());
            let query = tree.neighbor_lists_swept(interval, radius).periodic(periods);
            let [found, other] = [1, 3].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| query.collect()).unwrap()
            });
            assert_eq!(found, other, "{kind}, {structure:?}");
            let in_order = query.in_order().sorted().collect().unwrap();
            let once = query.pairs_once().in_order().sorted().collect().unwrap();
            for (i, expected) in &expected {
                let i = *i;
                assert_eq!(in_order.row(i), *expected, "{kind}, {structure:?}, point {i}");
                let greater: Vec<_> = expected.iter().copied().filter(|e| e.id as usize > i).collect();
                assert_eq!(once.row(i), greater, "{kind}, {structure:?}, point {i}");
            }
        }
    }
}

/// Lists do not change if points are moved by whole periods, with all their keys; and each pair is seen alike from both sides.
#[test]
fn moving_points_by_whole_periods_changes_nothing() {
    let mut rng = Random(31);
    for single in [true, false] {
        let mut set = Set::of_kind("some at rest", 300, 3, single, &mut rng);
        // So that moving them rounds nothing.
        let exact = |x: f64| (x * 65536.0).round() / 65536.0;
        set.keys.iter_mut().flatten().for_each(|p| *p = DVec3::new(exact(p.x), exact(p.y), exact(p.z)));
        let mut moved = set.clone();
        let periods = [1.0, 0.75, 1.5];
        for i in 0..set.len() {
            let by = DVec3::from_array(periods.map(|length| rng.below(5) as f64 * length));
            moved.keys.iter_mut().for_each(|key| key[i] += by);
        }
        for radius in [0.1, 0.3, 0.8] {
            let lists = [&set, &moved].map(|set| {
                let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
                let query = tree.neighbor_lists_swept(TimeInterval::FULL, radius).periodic(periods.map(Some));
                query.in_order().sorted().collect().unwrap()
            });
            assert_eq!(lists[0], lists[1], "{single}, {radius}");
            for (id, row) in lists[0].iter() {
                for met in row {
                    let back = lists[0].row(met.id as usize).iter().find(|e| e.id == id).unwrap();
                    assert_eq!(Encounter { id: met.id, ..*back }, *met);
                }
            }
        }
    }
}

/// A pair meets across either face in turn, and both at once where the radius is more than half a period.
#[test]
fn encounters_in_several_images_are_one() {
    // From a quarter of a period to the left of the other to a quarter to the right, and so on through two periods.
    let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * -0.5, Vec3::X * 1.5)];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let row = |begin: f32, end: f32, radius: f32| {
        let interval = TimeInterval::new(begin, end).unwrap();
        let lists = tree.neighbor_lists_swept(interval, radius).periodic([Some(1.0), None, None]).in_order().collect();
        lists.unwrap().row(0).iter().map(|e| (e.enter, e.leave, e.closest, e.distance_squared)).collect::<Vec<_>>()
    };
    assert_eq!(row(0.0, 1.0, 0.25), [(0.125, 0.875, 0.25, 0.0)]);
    assert_eq!(row(0.5, 1.0, 0.25), [(0.625, 0.875, 0.75, 0.0)]);
    assert_eq!(row(0.0, 1.0, 0.5), [(0.0, 1.0, 0.25, 0.0)]);
    // Nowhere are they farther apart than half a period.
    assert_eq!(row(0.0, 1.0, 40.0), [(0.0, 1.0, 0.25, 0.0)]);
    assert_eq!(row(0.4, 0.6, 0.125), []);
    // At most one neighbour, whatever the images.
    let limited = tree.neighbor_lists_swept(TimeInterval::FULL, 3.0).periodic([Some(1.0), None, None]);
    assert!(limited.max_neighbors(1).collect().is_ok());
    assert_eq!(limited.max_neighbors(0).collect(), Err(ListError::TooManyNeighbors { id: 0 }));
}

/// Where the radius is longer than all distances, nearest images are within it throughout; nearest when any is.
#[test]
fn radii_longer_than_all_distances() {
    let mut rng = Random(14);
    for (single, axes) in [(true, [true; 3]), (false, [true; 3]), (true, [true, false, true])] {
        let mut set = Set::of_kind("half a period apart", 5, 2, single, &mut rng);
        // As far apart as may be.
        let far = DVec3::from_array(LENGTHS) * 12.0;
        let moved = |at: DVec3| if single { (at + far).as_vec3().as_dvec3() } else { at + far };
        set.keys.iter_mut().for_each(|key| key[0] = moved(key[0]));
        let periods = periods_along(axes);
        let all = set.images(periods);
        let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
        let longest = [1.5, 3.0, 40.0, f32::INFINITY];
        for radius in longest {
            let expected = set.meet_all(TimeInterval::FULL, &all, |_, _| radius);
            let lists = tree.neighbor_lists_swept(TimeInterval::FULL, radius).periodic(periods).collect().unwrap();
            check(&lists, &expected, &format!("{single}, {axes:?}, {radius}"));
        }
        let own = [0.1, f32::INFINITY, 0.2, 1e30, 2.0];
        for (radii, radius) in [
            (Radii::Own(&own), (|i, _| i) as fn(f32, f32) -> f32),
            (Radii::Larger { own: &own, others: &own }, f32::max),
            (Radii::Sum { own: &own, others: &own }, |i, j| i + j),
        ] {
            let expected = set.meet_all(TimeInterval::FULL, &all, |i, j| radius(own[i], own[j]));
            let lists = tree.neighbor_lists_swept(TimeInterval::FULL, radii).periodic(periods).collect().unwrap();
            check(&lists, &expected, &format!("{single}, {axes:?}, {radii:?}"));
        }
    }
}

/// Where no point exists during the interval, not even the tree of a time slice has points.
#[test]
fn nothing_meets_where_nothing_exists() {
    let key = |x: f32| [Vec3::X * x, Vec3::new(x, 0.1, 0.0)];
    let (keys, active) = ([key(0.1), key(0.2), key(0.4), key(0.3)], [TimeInterval::new(0.1, 0.3).unwrap(); 2]);
    let keys: Vec<&[Vec3]> = keys.iter().map(|key| &key[..]).collect();
    for structure in
        [PointStructure::Kd, PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(2)]
    {
        let params = PointParams { structure, ..PointParams::default() };
        let tree = PointTree::build(&PointArrays { keys: &keys, active: &active, ids: &[] }, &params).unwrap();
        for (begin, met) in [(0.0, 2), (0.8, 0)] {
            let query = tree.neighbor_lists_swept(TimeInterval::new(begin, 1.0).unwrap(), 0.2);
            let lists = query.periodic([Some(1.0); 3]).collect();
            assert_eq!(lists.map(|lists| lists.encounters().len()), Ok(met), "{structure:?}, from {begin}");
        }
        assert_eq!(tree.neighbor_lists(0.8, 0.2).periodic([Some(1.0); 3]).certified_until(0.1, 1.0), Ok(1.0));
    }
}

/// What lists at any time of the interval contain, lists over the interval with a radius that is longer by rounding contain too.
#[test]
fn lists_at_a_time_are_among_those_over_the_interval() {
    for (number, kind) in KINDS.into_iter().enumerate() {
        for single in [true, false] {
            let set = Set::of_kind(kind, 200, 2, single, &mut Random(number as u64));
            let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
            let periods = periods_along(AXES[number % AXES.len()]);
            for radius in RADII {
                let swept = tree.neighbor_lists_swept(TimeInterval::FULL, radius * (1.0 + 1e-4)).periodic(periods);
                let swept = swept.in_order().sorted().collect().unwrap();
                for time in [0.0, 0.3, 0.99] {
                    let lists = tree.neighbor_lists(time, radius).periodic(periods).collect().unwrap();
                    for (id, row) in lists.iter() {
                        let met = swept.row(id as usize);
                        for other in row {
                            let met = met.binary_search_by_key(other, |e| e.id).map(|at| met[at]);
                            let during = met.is_ok_and(|e| e.enter <= time && time <= e.leave);
                            assert!(during, "{kind}, {radius}, {id} and {other} at {time}: {met:?}");
                        }
                    }
                }
            }
        }
    }
}

/// Points with the same id are no neighbours of each other, in no image.
#[test]
fn equal_ids_do_not_meet() {
    let set = Set::of_kind("in the box", 150, 2, false, &mut Random(5));
    let twice: Vec<Vec<DVec3>> = set.keys.iter().map(|key| key.repeat(2)).collect();
    let ids: Vec<u32> = (0..150).chain(0..150).collect();
    let keys: Vec<&[DVec3]> = twice.iter().map(Vec::as_slice).collect();
    let points = PointArrays { keys: &keys, active: &[], ids: &ids };
    let [once, twice] = [
        set.tree(PointStructure::Automatic, SimdLevel::best()),
        PointTree::build(&points, &PointParams::default()).unwrap(),
    ];
    for radius in RADII {
        let [once, twice] = [&once, &twice].map(|tree| {
            let query = tree.neighbor_lists_swept(TimeInterval::FULL, radius).periodic(LENGTHS.map(Some));
            query.sorted().collect().unwrap()
        });
        for (id, row) in twice.iter() {
            let of = once.iter().find(|(other, _)| *other == id).unwrap().1;
            let mut row = row.to_vec();
            row.dedup();
            assert_eq!(row, of, "{radius}, {id}");
        }
    }
}

#[test]
fn bad_boxes_are_errors() {
    let points = [MovingPoint::new(Vec3::ZERO, Vec3::X * 20.0), MovingPoint::fixed(Vec3::Y)];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    let swept = |tree: &PointTree, periods: [Option<f64>; 3]| {
        let query = tree.neighbor_lists_swept(TimeInterval::FULL, 0.5).periodic(periods);
        query.collect().map(|lists| lists.encounters().len())
    };
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-40, 1e39] {
        for tree in [&tree, &empty] {
            assert_eq!(swept(tree, [None, Some(bad), None]), Err(ListError::Period { axis: 1 }), "{bad}");
        }
    }
    assert_eq!(swept(&tree, [Some(1.0), None, None]), Err(ListError::Extent { axis: 0 }));
    assert_eq!(swept(&tree, [Some(1e-6), None, None]), Err(ListError::FarFromPeriod { axis: 0 }));
    assert_eq!(swept(&tree, [Some(1.5), Some(0.9), Some(1e30)]), Ok(2));
    assert_eq!(swept(&empty, [Some(1e-6); 3]), Ok(0));
    // Where numbers of f64 are a quarter of a period apart.
    let far = [DVec3::splat(1e15); 2];
    let far = PointTree::build(&far, &PointParams { precision: Precision::Double, ..PointParams::default() }).unwrap();
    assert_eq!(swept(&far, [None, Some(0.5), None]), Err(ListError::FarFromPeriod { axis: 1 }));
    let until = far.neighbor_lists(0.0, 0.5).periodic([None, Some(0.5), None]).certified_until(0.4, 1.0);
    assert_eq!(until, Err(ListError::FarFromPeriod { axis: 1 }));
    assert_eq!(swept(&far, [None, Some(8.0), None]), Ok(2));
    // A radius above half a period is none, nor an infinite one.
    let all = tree.neighbor_lists_swept(TimeInterval::FULL, f32::INFINITY).periodic([Some(1.5); 3]).collect();
    assert_eq!(all.unwrap().encounters().len(), 2);
    let missing = tree.neighbor_lists_swept(TimeInterval::FULL, Radii::Own(&[1.0])).periodic([Some(3.0); 3]).collect();
    assert_eq!(missing, Err(ListError::MissingRadius { of: RadiusOf::Point(1) }));
}
