//! Lists with a skin against comparing all pairs, at all times at which they change: they hold as long as they say.

use crate::set::{AS_GIVEN, CLUSTERS, Set, clouds, size};
use crate::skin_case::{Held, OfPair, SkinCase, check_with_skin};
use crate::support::Random;
use mbkd::{
    EncounterLists, NeighborLists, PointArrays, PointParams, PointStructure, PointTree, Precision, SimdLevel,
    TimeInterval, certified_duration,
    glam::{DVec3, Vec3},
};

/// At all times before the returned one, the lists with a skin contain the lists at that time; and the returned time is
/// the last one with this property.
#[test]
fn lists_with_a_skin_hold_until_the_time_that_is_certified() {
    use PointStructure::{Automatic, Kd, Linear, TimeSlices};
    let mut held = Held::default();
    for (kind, cloud, mut rng) in clouds(90) {
        let size = f64::from(size(&cloud));
        let structures = [Automatic, Kd, TimeSlices(2), TimeSlices(8)];
        hold(&Set::from(&cloud), size, [size * 1e-5, 2e-6], structures, &mut rng, &kind, &mut held);
    }
    let single = held;
    assert!(single.cut_short > 20 && single.complete > 20, "{single:?}");
    let (mut rng, mut held) = (Random(47), Held::default());
    for (size, apart, speed, far) in CLUSTERS.into_iter().filter(|set| set.0 > 1e-10) {
        for (keys, partly_active) in [(1, true), (2, false), (2, true), (4, false), (12, false)] {
            let set = Set::clusters(90, keys, (size, apart, speed), partly_active, &mut rng).far_away(far);
            // Of the motion between two keys, and of coordinates in f64.
            let rounding = 8.0 * speed / 4e6 + (set.segments() + 1) as f64 * (far + apart + 12.0 * speed) * 1e-14;
            let structures = [Automatic, Linear, TimeSlices(3), TimeSlices(8)];
            let what = format!("{size} {apart} {speed} {far}, {keys} keys");
            hold(&set, size, [0.1e-6 * size + rounding, 1e-7], structures, &mut rng, &what, &mut held);
        }
    }
    assert!(held.cut_short > 20 && held.complete > 20, "{held:?}");
}

/// Lists of a set of this size.
fn hold(
    set: &Set,
    size: f64,
    rounding: [f64; 2],
    structures: [PointStructure; 4],
    rng: &mut Random,
    what: &str,
    held: &mut Held,
) {
    for (time, until, skin) in
        [(0.0, 1.0, 0.05), (rng.unit() * 0.5, 0.8, 0.2), (0.5, 0.5 + 1e-3, 1e-3), (0.3, 1.0, 0.0), (0.5, 0.5, 0.1)]
    {
        let (radius, skin) = ((0.1 * size) as f32, (skin * size) as f32);
        let (needed, listed) = ([radius], [radius + skin]);
        let case = SkinCase {
            sets: [set; 2],
            among: false,
            pairs_once: false,
            of_pair: OfPair::Equal,
            needed: [&needed; 2],
            listed: [&listed; 2],
            periods: [None; 3],
            rounding,
        };
        let what = format!("{what}, radius {radius}, skin {skin}");
        case.check(&structures.map(|structure| [structure; 2]), [time, until], rng, &what, held);
        structures.into_iter().for_each(|s| check_with_skin(set, s, [time, until], [radius, skin]));
    }
}

#[test]
fn a_bound_on_speeds_certifies_no_longer_than_it_takes() {
    let mut rng = Random(1);
    for _ in 0..1000 {
        let [radius, skin, speed] = [0, 1, 2].map(|_| 10f32.powf(rng.signed() * 3.0));
        let time = f64::from(certified_duration(radius, skin, speed));
        // Two points just outside of the lists, each as fast as any.
        let apart = f64::from(radius + skin) * (1.0 - 1e-7);
        assert!(apart - 2.0 * f64::from(speed) * time >= f64::from(radius) || time == 0.0);
        // Rounded down.
        let least = f64::from(radius + skin) * (1.0 - 2f64.powi(-21)) - f64::from(radius);
        assert!(2.0 * f64::from(speed) * time <= least.max(0.0) * (1.0 + 1e-12));
        assert!(
            time >= f64::from(skin) / (2.0 * f64::from(speed)) * 0.99 - f64::from(radius) * 1e-6 / f64::from(speed)
        );
    }
    assert_eq!(certified_duration(1.0, 1.0, 0.0), f32::INFINITY);
    // Lists of all pairs miss none.
    for (radius, skin) in [(1.0, f32::INFINITY), (f32::INFINITY, 0.0), (f32::MAX, f32::MAX)] {
        assert_eq!(certified_duration(radius, skin, 1.0), f32::INFINITY);
    }
    assert_eq!(certified_duration(1.0, 1.0, f32::INFINITY), 0.0);
    assert_eq!(certified_duration(1.0, f32::NAN, 1.0), 0.0);
    assert_eq!(certified_duration(-1.0, 1.0, 1.0), 0.0);
    // Where squares are denormal, lists of radius and skin lack pairs that are nearer.
    assert_eq!(certified_duration(4.61e-23, 7e-25, 1e-25), 0.0);
}

/// A pair just outside of the lists: as f32 has them, relative to the middle and with what they have in common taken off, the two
/// may seem to be in.
#[test]
fn a_pair_just_beyond_the_skin_is_not_taken_for_a_listed_one() {
    let mut rng = Random(62);
    let mut lists = NeighborLists::new();
    for (single, far, speed) in [
        (true, 1e3, 0.1),
        (true, 10.0, 0.1),
        (true, 1e4, 0.1),
        (true, 0.0, 0.1),
        (false, 1e9, 0.1),
        (false, 0.0, 0.1),
        (false, 1e3, 10.0),
        (false, 1e6, 1e-3),
    ] {
        let mut meetings = 0;
        for round in 0..150 {
            let at = rng.dvec() * far;
            let direction = rng.dvec().normalize_or(DVec3::X);
            // Others far from both make the group and its margin large.
            let more = rng.dvec() * 30.0;
            let mut keys = vec![vec![at, at + direction, at + more], vec![at + rng.dvec() * speed, at, at + more]];
            keys.iter_mut().for_each(|key| key.truncate(if single { 2 } else { 3 }));
            let set = Set::new(keys, single);
            let (time, radius) = (0.25 * rng.unit(), 0.3f32);
            let squared = set.squared((0, &set, 1), [None; 3], time);
            let mut skin = squared.sqrt() * (1.0 + 1e-6) - radius;
            while (radius + skin) * (radius + skin) >= squared {
                skin = skin.next_down();
            }
            let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
            let good = tree.neighbor_lists_with_skin(time, radius, skin, 1.0, &mut lists).unwrap();
            let what = format!("{far} {speed}, single {single}, round {round}");
            assert!(lists.iter().all(|(id, row)| id > 1 || row.iter().all(|&other| other > 1)), "{what}");
            let met = set.meet((0, &set, 1), &AS_GIVEN, [f64::from(time), 1.0], f64::from(radius).powi(2));
            let enter = met.map_or(1.0, |e| e.enter);
            assert!(good <= enter, "{what}: {good}, but they meet at {enter}");
            meetings += usize::from(met.is_some());
        }
        assert!(meetings > 140 || speed > 1.0, "{far} {speed}: {meetings}");
    }
}

/// A point that begins to exist at the first float that is not before a key, or at the one before that, which may be located at the
/// key already: it has no motion in the segment before, and a pair with it is missing from then on.
#[test]
fn certificates_end_before_points_that_begin_to_exist_beside_a_key() {
    let (mut rng, mut located) = (Random(63), 0);
    let mut lists = NeighborLists::new();
    for (keys, key) in (4..80usize).flat_map(|keys| (1..keys - 1).map(move |key| (keys, key))) {
        let segments = keys - 1;
        let nearest = (key as f64 / segments as f64) as f32;
        let mut not_before = nearest;
        while f64::from(not_before) * (segments as f64) < key as f64 {
            not_before = not_before.next_up();
        }
        let before = nearest.next_down();
        // In f32 it is at the key.
        let at_the_key = (before * segments as f32) as usize == key;
        located += usize::from(at_the_key);
        let of_single = at_the_key.then_some((true, before));
        for (single, begin) in [(false, not_before), (false, not_before.next_down())].into_iter().chain(of_single) {
            let mut place = || [0; 2].map(|_| rng.dvec() * 0.1).to_vec();
            let mut set = Set::new((0..keys).map(|_| place()).collect(), single);
            set.active[1] = TimeInterval::new(begin, 1.0).unwrap();
            for structure in set.structures() {
                let tree = set.tree(structure, SimdLevel::best());
                let time = nearest - 0.5 / segments as f32;
                let good = tree.neighbor_lists_with_skin(time, 1.0, 0.1, 1.0, &mut lists).unwrap();
                assert_eq!(
                    (lists.neighbors(), good),
                    (0, begin),
                    "{keys} keys, single {single}, {structure:?}, beside key {key}"
                );
            }
        }
    }
    assert!(located > 25, "{located}");
}

/// Most keys are no f32 numbers, and the float nearest to one may be before it: the next answer is beyond it all the same, so that
/// a loop which goes on to the answer comes to the end.
#[test]
fn lists_with_a_skin_go_on_at_keys_that_are_no_floats() {
    let (mut before, mut lists) = (0, NeighborLists::new());
    for keys in (3..400u16).step_by(7) {
        let at = |x: f32, key: u16| Vec3::new(x, if key.is_multiple_of(2) { 0.5 } else { -0.5 }, 0.0);
        let cloud: Vec<[Vec3; 2]> = (0..keys).map(|key| [at(0.0, key), at(100.0, key)]).collect();
        let rows: Vec<&[Vec3]> = cloud.iter().map(|key| &key[..]).collect();
        let points = PointArrays { keys: &rows, active: &[], ids: &[] };
        for precision in [Precision::Single, Precision::Double] {
            let params = PointParams { precision, ..PointParams::default() };
            let tree = PointTree::build(&points, &params).unwrap();
            for key in 1..keys - 1 {
                let near = f32::from(key) / f32::from(keys - 1);
                before += usize::from(f64::from(near) * f64::from(keys - 1) < f64::from(key));
                for time in [near.next_down(), near, near.next_up()] {
                    let next = tree.neighbor_lists_with_skin(time, 1.0, 0.5, 1.0, &mut lists).unwrap();
                    assert!(next > time, "{keys} keys, {precision:?}: {next} at {time}");
                }
            }
        }
    }
    assert!(before > 1000, "{before}");
}

/// Points at rest in f64 have lists that hold for ever, and meet those that they are near of throughout.
#[test]
fn points_at_rest() {
    let mut rng = Random(3);
    let points: Vec<DVec3> = (0..300).map(|_| rng.dvec() + DVec3::X * 1e9).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    assert_eq!(tree.neighbor_lists_with_skin(0.25, 0.2, 0.1, 0.75, &mut lists), Ok(0.75));
    let mut met = EncounterLists::new();
    tree.neighbor_lists_swept(TimeInterval::FULL, 0.3).run(&mut met).unwrap();
    assert!(met.encounters().len() > 300 && met.encounters().iter().all(|e| (e.enter, e.leave) == (0.0, 1.0)));
    let all = tree.neighbor_lists(0.0, 0.3).sorted().in_order();
    all.run(&mut lists).unwrap();
    let mut rows: Vec<(u32, Vec<u32>)> = met.iter().map(|(id, row)| (id, row.iter().map(|e| e.id).collect())).collect();
    rows.iter_mut().for_each(|row| row.1.sort_unstable());
    rows.sort_unstable();
    assert!(rows.iter().map(|row| (row.0, &row.1[..])).eq(lists.iter()));
}
