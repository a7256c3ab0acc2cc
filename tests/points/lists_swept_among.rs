//! Lists over an interval and lists with a skin of one set among another, which may have other keys, against comparing all pairs.

use crate::set::{AS_GIVEN, Set, check, periods_along};
use crate::skin_case::{Held, OfPair, SkinCase};
use crate::support::Random;
use mbkd::{
    Encounter, EncounterLists, ListError, MovingPoint, PointParams, PointStructure, PointTree, Precision, Radii,
    RadiusOf, SimdLevel, TimeInterval, glam::Vec3,
};

const KINDS: [&str; 4] = ["in the box", "at the faces", "some at rest", "periods away"];

/// Numbers of keys of both sets. Some keys of four are no floats.
const KEYS: [[usize; 2]; 7] = [[2, 2], [2, 1], [1, 3], [3, 2], [2, 5], [4, 3], [3, 3]];

/// Both sets of a case. Some points begin to exist at keys, which may be keys of one of the sets only.
fn sets(number: usize, kind: &str, keys: [usize; 2], single: bool) -> [Set; 2] {
    let mut rng = Random(900 + number as u64);
    [(40, keys[0]), (30, keys[1])].map(|(count, keys)| {
        let mut set = Set::of_kind(kind, count, keys, single, &mut rng);
        if kind == "periods away" {
            set.active.iter_mut().step_by(6).for_each(|active| *active = TimeInterval::new(0.5, 0.75).unwrap());
        }
        set
    })
}

/// The structures of both.
fn structures(single: bool) -> Vec<[PointStructure; 2]> {
    use PointStructure::{Automatic, Kd, Linear, TimeSlices};
    let mut all = vec![[Automatic, Automatic], [Linear, TimeSlices(5)], [TimeSlices(3), Linear], [TimeSlices(2); 2]];
    if single {
        all.extend([[Kd, Automatic], [Linear, Kd]]);
    }
    all
}

#[test]
fn swept_lists_among_another_set_equal_comparing_all_pairs() {
    let (mut met, mut lists, mut number) = (0, EncounterLists::new(), 0);
    for kind in KINDS {
        for keys in KEYS {
            for single in [true, false] {
                number += 1;
                let [own, others] = sets(number, kind, keys, single);
                let periods = periods_along([[false; 3], [true; 3], [true, false, true]][number % 3]);
                let images = own.images_among(&others, periods);
                let (begin, end) = [(0.0, 1.0), (0.25, 0.6), (0.5, 0.75), (0.3, 1.0)][number % 4];
                let interval = TimeInterval::new(begin, end).unwrap();
                let times = [begin, end].map(f64::from);
                let radius = [0.1, 0.25, 0.7][number % 3];
                let mut rng = Random(number as u64);
                let mut some = |count: usize| -> Vec<f32> { (0..count).map(|_| radius * rng.unit()).collect() };
                let (of_own, of_others) = (some(own.len()), some(others.len()));
                let sum = Radii::Sum { own: &of_own, others: &of_others };
                let expected = |once: bool, radius: &dyn Fn(usize, usize) -> f32| -> Vec<Vec<Encounter>> {
                    let row = |i: usize| {
                        let of = (0..others.len()).filter(|&j| !once || j > i);
                        let square = |j: usize| f64::from(radius(i, j)).powi(2);
                        of.filter_map(|j| own.meet((i, &others, j), &images, times, square(j))).collect()
                    };
                    (0..own.len()).map(row).collect()
                };
                let (all, once) = (expected(false, &|_, _| radius), expected(true, &|_, _| radius));
                let touching = expected(false, &|i, j| of_own[i] + of_others[j]);
                met += all.iter().map(Vec::len).sum::<usize>();
                for structures in structures(single) {
                    let [tree, among] = [(&own, structures[0]), (&others, structures[1])]
                        .map(|(set, s)| set.tree(s, SimdLevel::best()));
                    let what = format!("{kind}, {keys:?}, {single}, {structures:?}, {begin}..{end}, {periods:?}");
                    let query = tree.neighbor_lists_swept(interval, radius).among(&among).periodic(periods);
                    query.run(&mut lists).unwrap();
                    check(&lists, &all, &what);
                    query.pairs_once().run(&mut lists).unwrap();
                    check(&lists, &once, &format!("{what}, once"));
                    let query = tree.neighbor_lists_swept(interval, sum).among(&among).periodic(periods);
                    let found = [1, 3].map(|threads| {
                        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                        pool.install(|| query.in_order().sorted().collect()).unwrap()
                    });
                    assert_eq!(found[0], found[1], "{what}");
                    check(&found[0], &touching, &format!("{what}, sums"));
                }
            }
        }
    }
    assert!(met > 10_000, "{met}");
}

#[test]
fn lists_with_a_skin_among_another_set_hold_until_the_time_that_is_certified() {
    let (mut held, mut number) = (Held::default(), 0);
    for kind in KINDS {
        for keys in KEYS {
            for single in [true, false] {
                number += 1;
                let [own, others] = sets(number, kind, keys, single);
                let (time, until, skin) = [(0.0, 1.0, 0.03), (0.4, 0.8, 0.2), (0.3, 1.0, 0.0)][number % 3];
                let radius = 0.08;
                let (needed, listed) = ([radius], [radius + skin]);
                let case = SkinCase {
                    sets: [&own, &others],
                    among: true,
                    pairs_once: false,
                    of_pair: OfPair::Equal,
                    needed: [&needed; 2],
                    listed: [&listed; 2],
                    periods: periods_along([[false; 3], [true; 3], [true, false, true]][number % 3]),
                    rounding: [1e-4, 2e-6],
                };
                let what = format!("{kind}, {keys:?}, {single}, {:?}", case.periods);
                let mut rng = Random(number as u64);
                case.check(&structures(single), [time, until], &mut rng, &what, &mut held);
            }
        }
    }
    assert!(held.cut_short > 50 && held.complete > 20, "{held:?}");
}

/// A set among itself: each point meets itself as well, which is no other one then.
#[test]
fn a_set_among_itself_meets_itself() {
    let set = Set::of_kind("some at rest", 80, 2, true, &mut Random(3));
    let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
    let query = tree.neighbor_lists_swept(TimeInterval::FULL, 0.2);
    let alone = query.in_order().sorted().collect().unwrap();
    let among = query.among(&tree).in_order().sorted().collect().unwrap();
    for (id, row) in alone.iter() {
        let itself = Encounter { id, enter: 0.0, leave: 1.0, closest: 0.0, distance_squared: 0.0 };
        let mut expected = [row, &[itself]].concat();
        expected.sort_unstable_by_key(|e| e.id);
        assert_eq!(among.row(id as usize), expected);
    }
    let once = query.among(&tree).pairs_once().in_order().sorted().collect().unwrap();
    assert_eq!(once, query.pairs_once().in_order().sorted().collect().unwrap());
}

/// Points in contact throughout, through keys of one set that are just before or behind slices of the other by rounding.
#[test]
fn contacts_last_through_keys_of_either_set() {
    let mut rng = Random(12);
    for keys in [[4, 2], [2, 4], [7, 4], [4, 11], [11, 7], [12, 8]] {
        for slices in [1, 2, 3, 7, 16] {
            let set = |keys: usize, rng: &mut Random| {
                let row = |rng: &mut Random| (0..40).map(|_| rng.vec().as_dvec3()).collect();
                Set::new((0..keys).map(|_| row(rng)).collect(), true)
            };
            let sets = keys.map(|keys| set(keys, &mut rng));
            let [tree, among] = [(0, 1), (1, slices)]
                .map(|(set, slices)| sets[set].tree(PointStructure::TimeSlices(slices), SimdLevel::best()));
            for (tree, among) in [(&tree, &among), (&among, &tree)] {
                // So far that nothing is ever farther.
                let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 9.0).among(among).collect().unwrap();
                assert_eq!(lists.encounters().len(), 1600, "{keys:?}, {slices}");
                for e in lists.encounters() {
                    assert_eq!((e.enter, e.leave), (0.0, 1.0), "{keys:?}, {slices}");
                }
            }
            let expected: Vec<Vec<Encounter>> = (0..40)
                .map(|i| {
                    (0..40)
                        .filter_map(|j| {
                            sets[0].meet((i, &sets[1], j), &AS_GIVEN, [0.0, 1.0], f64::from(0.9f32).powi(2))
                        })
                        .collect()
                })
                .collect();
            let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.9).among(&among).collect().unwrap();
            for (id, row) in lists.iter() {
                let mut row = row.to_vec();
                row.sort_unstable_by_key(|e| e.id);
                assert_eq!(row, expected[id as usize], "{keys:?}, {slices}, {id}");
            }
        }
    }
}

#[test]
fn sets_that_do_not_fit_are_errors() {
    let points = [MovingPoint::new(Vec3::ZERO, Vec3::X), MovingPoint::fixed(Vec3::Y)];
    let build = |precision: Precision| PointTree::build(&points, &PointParams { precision, ..PointParams::default() });
    let [single, double] = [Precision::Single, Precision::Double].map(|precision| build(precision).unwrap());
    let places = [[1e9, 0.0, 0.0], [1e9 + 0.1, 0.0, 0.0]];
    let rounded =
        PointTree::build(&places, &PointParams { precision: Precision::Single, ..PointParams::default() }).unwrap();
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    let swept = |tree: &PointTree, among: &PointTree, radii: Radii| {
        let query = tree.neighbor_lists_swept(TimeInterval::FULL, radii).among(among);
        query.collect().map(|lists| lists.encounters().len())
    };
    let until =
        |tree: &PointTree, among: &PointTree| tree.neighbor_lists(0.0, 0.5).among(among).certified_until(0.4, 1.0);
    let radius = Radii::Equal(0.5);
    assert_eq!(swept(&single, &double, radius), Err(ListError::Double));
    assert_eq!(swept(&double, &single, radius), Err(ListError::Double));
    assert_eq!(until(&single, &double), Err(ListError::Double));
    assert_eq!(swept(&single, &rounded, radius), Err(ListError::Origins));
    assert_eq!(until(&rounded, &single), Err(ListError::Origins));
    for tree in [&single, &double] {
        assert_eq!(swept(tree, &empty, radius), Ok(0));
        assert_eq!(swept(&empty, tree, radius), Ok(0));
        assert_eq!(until(tree, &empty), Ok(1.0));
        assert_eq!(until(&empty, tree), Ok(1.0));
        let boxed = empty.neighbor_lists_swept(TimeInterval::FULL, 0.5).among(tree).periodic([Some(0.01), None, None]);
        assert_eq!(boxed.collect(), Err(ListError::Extent { axis: 0 }));
    }
    let (two, one) = ([0.5; 2], [0.5]);
    let missing = swept(&single, &single, Radii::Sum { own: &two, others: &one });
    assert_eq!(missing, Err(ListError::MissingRadius { of: RadiusOf::Listed(1) }));
    let missing = swept(&single, &single, Radii::Larger { own: &one, others: &two });
    assert_eq!(missing, Err(ListError::MissingRadius { of: RadiusOf::Point(1) }));
    assert_eq!(swept(&single, &single, Radii::Own(&two)), Ok(2));
}
