//! Lists over an interval and lists with a skin of points in f64 against comparing all pairs.

use crate::double::{Cloud, STRUCTURES, vec};
use crate::encounter::Pair;
use crate::lists_swept::check;
use crate::support::Random;
use mbkd::glam::DVec3;
use mbkd::{Encounter, EncounterLists, NeighborLists, PointStructure, PointTree, SimdLevel, TimeInterval};

/// The encounter of two points, by comparing them.
fn meet(cloud: &Cloud, (i, j): (usize, usize), times: [f64; 2], square: f64) -> Option<Encounter> {
    let key = |k: usize, number: usize| cloud.keys[number.min(cloud.keys.len() - 1)][[i, j][k]];
    let pair = Pair {
        id: j as u32,
        segments: [cloud.keys.len().max(2) - 1; 2],
        keys: &key,
        active: [i, j].map(|k| cloud.active[k]),
        images: &[DVec3::ZERO],
    };
    pair.meet(times, square)
}

fn meet_all(cloud: &Cloud, interval: TimeInterval, radius: f32) -> Vec<Vec<Encounter>> {
    let times = [interval.begin(), interval.end()].map(f64::from);
    let square = f64::from(radius) * f64::from(radius);
    let count = cloud.active.len();
    let row = |i| (0..count).filter(|&j| j != i).filter_map(|j| meet(cloud, (i, j), times, square)).collect();
    (0..count).map(row).collect()
}

/// The squared distance of two points at a time, as lists compute it.
fn squared(cloud: &Cloud, (i, j): (usize, usize), time: f32) -> f32 {
    let d = cloud.at(j, time) - cloud.at(i, time);
    ((d.x * d.x + d.y * d.y) + d.z * d.z) as f32
}

/// Moves all points far away, where coordinates keep fewer of their bits.
fn far_away(mut cloud: Cloud, by: f64) -> Cloud {
    for at in cloud.keys.iter_mut().flatten() {
        *at += DVec3::new(1.0, -0.7, 0.3) * by;
    }
    cloud
}

/// Sizes of clusters, how far they are apart, speeds, and how far away all of it is.
const SETS: [(f64, f64, f64, f64); 8] = [
    (1.0, 1e7, 0.3, 0.0),
    (1e-3, 1e7, 1e-4, 0.0),
    (1e-2, 0.0, 3e-3, 1e9),
    (1e-2, 0.0, 3.0, 1e9),
    (1.0, 0.0, 2.0, 0.0),
    (1e-3, 1e7, 1e3, 0.0),
    (1e-20, 1e-3, 1e-20, 0.0),
    (1e-25, 1e-22, 1e-24, 0.0),
];

#[test]
fn swept_lists_equal_comparing_all_pairs() {
    let mut rng = Random(41);
    let mut met = 0;
    for (size, apart, speed, far) in SETS {
        for (keys, partly_active) in [(1, true), (2, false), (2, true), (4, true)] {
            let cloud = far_away(Cloud::new(120, keys, (size, apart, speed), partly_active, &mut rng), far);
            let structures = STRUCTURES.into_iter().chain([PointStructure::TimeSlices(8)]);
            let trees: Vec<_> = structures
                .flat_map(|s| SimdLevel::available().into_iter().map(move |simd| (s, simd)))
                .map(|(s, simd)| (cloud.tree(s, simd).unwrap(), format!("{s:?}, {simd}")))
                .collect();
            let (a, b) = (rng.unit() * 0.9, rng.unit() * 1e-3);
            let intervals = [(0.0, 1.0), (0.25, 0.5), (a, a + 0.1), (a, a + b), (1.0f32.next_down(), 1.0)];
            for (begin, end) in intervals.into_iter().filter(|(begin, end)| begin < end) {
                let interval = TimeInterval::new(begin, end).unwrap();
                for radius in [size * 0.2, 0.0, size * 1e-2, apart] {
                    let radius = radius as f32;
                    let expected = meet_all(&cloud, interval, radius);
                    met += expected.iter().map(Vec::len).sum::<usize>();
                    for (tree, what) in &trees {
                        let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                        let about = format!("{size} {apart} {speed} {far}, {keys} keys, {begin}..{end}, {radius}");
                        check(&found, &expected, &format!("{what}, {about}"));
                    }
                }
            }
        }
    }
    assert!(met > 100_000, "{met}");
}

#[test]
fn larger_sets_swept_on_all_numbers_of_threads() {
    let mut rng = Random(43);
    let interval = TimeInterval::new(0.2, 0.7).unwrap();
    for (far, radius, partly_active) in [(0.0, 0.2f32, false), (1e9, 0.2, false), (1e9, 0.2, true), (0.0, 9.0, false)] {
        let cloud = far_away(Cloud::new(1100, 2, (1.0, 0.0, 0.4), partly_active, &mut rng), far);
        let expected = meet_all(&cloud, interval, radius);
        for structure in STRUCTURES {
            let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
            let found = [1, 3].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| tree.neighbor_lists_swept(interval, radius).collect()).unwrap()
            });
            assert_eq!(found[0], found[1], "{far}, {structure:?}");
            check(&found[0], &expected, &format!("{far}, {radius}, {structure:?}"));
        }
    }
}

/// Of three, six and ten segments some keys are no f32 numbers: intervals that begin or end beside them.
#[test]
fn intervals_that_end_next_to_keys_that_are_no_floats() {
    let mut rng = Random(78);
    for keys in [4, 7, 11] {
        let cloud = Cloud::new(60, keys, (1.0, 0.0, 1e3), false, &mut rng);
        for structure in STRUCTURES {
            let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
            for key in 1..keys - 1 {
                let near = key as f32 / (keys - 1) as f32;
                for time in [near.next_down(), near, near.next_up()] {
                    let after = 0.1 * (1.0 - time);
                    for (begin, end) in [(time * 0.9, time), (time, time + after), (time, time.next_up())] {
                        let interval = TimeInterval::new(begin, end).unwrap();
                        for radius in [2e3, 5e4] {
                            let expected = meet_all(&cloud, interval, radius);
                            let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                            check(&found, &expected, &format!("{keys} keys, {structure:?}, {begin}..{end}, {radius}"));
                        }
                    }
                }
            }
        }
    }
}

/// Active intervals that touch at splits of the shutter and at keys.
#[test]
fn intervals_that_touch_at_splits_of_the_shutter() {
    let mut rng = Random(77);
    let mut touching = 0;
    for keys in [2, 3, 5] {
        let mut cloud = far_away(Cloud::new(160, keys, (1.0, 0.0, 0.5), false, &mut rng), 1e6);
        for (i, active) in cloud.active.iter_mut().enumerate() {
            let (begin, end) = [(0.0, 0.5), (0.5, 1.0), (0.25, 0.5), (0.5, 0.625), (0.0, 1.0), (0.375, 0.875)][i % 6];
            *active = TimeInterval::new(begin, end).unwrap();
        }
        // Some are static.
        for i in (0..160).filter(|i| i % 6 == 4) {
            let at = cloud.keys[0][i];
            cloud.keys.iter_mut().for_each(|key| key[i] = at);
        }
        let structures = STRUCTURES.into_iter().chain([2, 8].map(PointStructure::TimeSlices));
        let trees: Vec<_> = structures.map(|s| (s, cloud.tree(s, SimdLevel::best()).unwrap())).collect();
        for (begin, end) in [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0), (0.25, 0.5), (0.5, 0.75), (0.4, 0.6), (0.625, 0.875)] {
            let interval = TimeInterval::new(begin, end).unwrap();
            for radius in [0.3, 9.0] {
                let expected = meet_all(&cloud, interval, radius);
                touching += expected.iter().flatten().filter(|e| e.enter == 0.5 && e.leave == 0.5).count();
                for (structure, tree) in &trees {
                    let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
                    check(&found, &expected, &format!("{keys} keys, {structure:?}, {begin}..{end}, radius {radius}"));
                }
            }
        }
    }
    assert!(touching > 1000, "{touching}");
}

/// Two crowds, each at one place, that come as near as the radius and no nearer: whether boxes and points are met is a matter of
/// rounding, of f32 near zero and of f64 far away, where the radius has few bits.
#[test]
fn crowds_that_just_touch_the_radius_are_met() {
    const CROWD: usize = 256;
    let mut rng = Random(61);
    for round in 0..60 {
        let (far, size, speed) = [
            (0.0, 1.0, 1.0),
            (1e9, 1e-3, 1e-3),
            (1e9, 1e-5, 1.0),
            (1e9, 1e-4, 1e9),
            (1e12, 1.0, 1e3),
            (1.0, 1e-9, 1e-3),
        ][round % 6];
        let offset = vec(&mut rng) * far;
        let mut trajectory = || {
            let (at, by) = (offset + vec(&mut rng) * size, vec(&mut rng) * speed);
            [at - by * 0.5, at + by * 0.5]
        };
        let trajectories = [trajectory(), trajectory()];
        let crowds = |count: usize| {
            let key = |key: usize| trajectories.iter().flat_map(|keys| vec![keys[key]; count]).collect();
            Cloud { keys: vec![key(0), key(1)], active: vec![TimeInterval::FULL; 2 * count] }
        };
        let (pair, cloud) = (crowds(1), crowds(CROWD));
        let interval = TimeInterval::new(0.25 * rng.unit(), 0.75 + 0.25 * rng.unit()).unwrap();
        let touch = |radius: f32| !meet_all(&pair, interval, radius)[0].is_empty();
        let apart = meet_all(&pair, interval, f32::MAX)[0][0].distance_squared.sqrt();
        let mut radius = apart * (1.0 - 1e-6);
        while !touch(radius) {
            radius = radius.next_up();
        }
        for structure in [PointStructure::Linear, PointStructure::TimeSlices(3)] {
            let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
            let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
            for (id, row) in found.iter() {
                assert_eq!(row.len(), 2 * CROWD - 1, "round {round}, {structure:?}: point {id}, radius {radius}");
            }
            assert_eq!(found.iter().count(), 2 * CROWD);
        }
    }
}

/// Until the time that is certified no pair is missing; and not much later one is.
#[test]
fn lists_with_a_skin_hold_until_the_time_that_is_certified() {
    let mut rng = Random(47);
    let (mut cut_short, mut complete, mut lists) = (0, 0, NeighborLists::new());
    for (size, apart, speed, far) in SETS.into_iter().filter(|set| set.0 > 1e-10) {
        for (keys, partly_active) in [(1, true), (2, false), (2, true), (4, false), (12, false)] {
            let cloud = far_away(Cloud::new(90, keys, (size, apart, speed), partly_active, &mut rng), far);
            let (count, segments) = (cloud.active.len(), keys.max(2) - 1);
            // Of the motion between two keys, and of coordinates in f64.
            let rounding = 8.0 * speed / 4e6 + (segments + 1) as f64 * (far + apart + 12.0 * speed) * 1e-14;
            for structure in STRUCTURES.into_iter().chain([PointStructure::TimeSlices(8)]) {
                let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
                for (time, until, skin) in [
                    (0.0, 1.0, 0.05),
                    (rng.unit() * 0.5, 0.8, 0.2),
                    (0.5, 0.5 + 1e-3, 1e-3),
                    (0.3, 1.0, 0.0),
                    (0.5, 0.5, 0.1),
                ] {
                    let (radius, skin) = ((0.1 * size) as f32, (skin * size) as f32);
                    let what = format!(
                        "{size} {apart} {speed} {far}, {keys} keys, {structure:?}, {time}..{until}, {radius}, skin {skin}"
                    );
                    let good = tree.neighbor_lists_with_skin(time, radius, skin, until, &mut lists).unwrap();
                    assert!((time..=until).contains(&good), "{what}: {good}");
                    let mut listed = vec![vec![false; count]; count];
                    for (id, row) in lists.iter() {
                        row.iter().for_each(|&other| listed[id as usize][other as usize] = true);
                    }
                    let mut events =
                        vec![time, good.next_down(), time + (good - time) * 0.5, time + (good - time) * rng.unit()];
                    let next_key = ((f64::from(time) * segments as f64).floor() + 1.0) / segments as f64;
                    let times = [f64::from(time), f64::from(until).min(next_key)];
                    let (mut first, mut at_the_earliest) = (f64::INFINITY, f64::INFINITY);
                    for (i, row) in listed.iter().enumerate() {
                        for j in (0..i).filter(|&j| !row[j]) {
                            let mut enter = |radius: f64| {
                                let met = meet(&cloud, (i, j), times, radius * radius);
                                let near = met.map(|e| [e.enter.next_down(), e.enter, e.enter.next_up()]);
                                events.extend(near.into_iter().flatten());
                                met.map_or(f64::INFINITY, |e| e.enter.into())
                            };
                            first = first.min(enter(radius.into()));
                            at_the_earliest = at_the_earliest.min(enter(f64::from(radius) * (1.0 + 1e-6) + rounding));
                        }
                    }
                    assert!(f64::from(good) <= first, "{what}: {good}, but a pair is missing from {first}");
                    let earliest = at_the_earliest.min(times[1]) - 1e-7;
                    assert!(f64::from(good) >= earliest, "{what}: {good}, though nothing is missing before {earliest}");
                    if f64::from(good) < times[1] - 1e-5 {
                        cut_short += 1
                    } else {
                        complete += 1
                    }
                    for t in events.into_iter().filter(|&t| time <= t && t < good) {
                        for i in (0..count).filter(|&i| cloud.active[i].contains(t)) {
                            for j in (0..i).filter(|&j| cloud.active[j].contains(t) && !listed[i][j]) {
                                let near = squared(&cloud, (i, j), t) <= radius * radius;
                                assert!(!near, "{what}: {i} and {j} at {t}, before {good}");
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(cut_short > 20 && complete > 20, "both cases: {cut_short}, {complete}");
}

/// A pair just outside of the lists: as f32 has them, relative to the middle and with what they have in common taken off, the two
/// may seem to be in.
#[test]
fn a_pair_just_beyond_the_skin_is_not_taken_for_a_listed_one() {
    let mut rng = Random(62);
    let (mut meetings, mut lists) = (0, NeighborLists::new());
    for round in 0..600 {
        let (far, speed) = [(1e9, 0.1), (0.0, 0.1), (1e3, 10.0), (1e6, 1e-3)][round % 4];
        let at = vec(&mut rng) * far;
        let direction = vec(&mut rng).normalize_or(DVec3::X);
        // Others far from both make the group and its margin large.
        let more = vec(&mut rng) * 30.0;
        let from = vec![at, at + direction, at + more];
        let to = vec![at + vec(&mut rng) * speed, at, at + more];
        let cloud = Cloud { keys: vec![from, to], active: vec![TimeInterval::FULL; 3] };
        let (time, radius) = (0.25 * rng.unit(), 0.3f32);
        let squared = squared(&cloud, (0, 1), time);
        let mut skin = squared.sqrt() * (1.0 + 1e-6) - radius;
        while (radius + skin) * (radius + skin) >= squared {
            skin = skin.next_down();
        }
        let tree = cloud.tree(PointStructure::Automatic, SimdLevel::best()).unwrap();
        let good = tree.neighbor_lists_with_skin(time, radius, skin, 1.0, &mut lists).unwrap();
        assert!(lists.iter().all(|(id, row)| id > 1 || row.iter().all(|&other| other > 1)), "round {round}");
        let times = [f64::from(time), 1.0];
        let met = meet(&cloud, (0, 1), times, f64::from(radius) * f64::from(radius));
        let enter = met.map_or(1.0, |e| e.enter);
        assert!(good <= enter, "round {round}: {good}, but they meet at {enter}");
        meetings += usize::from(met.is_some());
    }
    assert!(meetings > 400, "{meetings}");
}

/// A point that begins to exist at the first float that is not before a key, or at the one before that.
#[test]
fn certificates_end_before_points_that_begin_to_exist_beside_a_key() {
    let mut rng = Random(63);
    let mut lists = NeighborLists::new();
    for keys in 4..60usize {
        for key in 1..keys - 1 {
            let exact = key as f64 / (keys - 1) as f64;
            let mut not_before = exact as f32;
            while f64::from(not_before) * ((keys - 1) as f64) < key as f64 {
                not_before = not_before.next_up();
            }
            for begin in [not_before, not_before.next_down()] {
                let mut place = || (0..keys).map(|_| vec(&mut rng) * 0.1).collect::<Vec<DVec3>>();
                let ways = [place(), place()];
                let active = vec![TimeInterval::FULL, TimeInterval::new(begin, 1.0).unwrap()];
                let cloud = Cloud { keys: (0..keys).map(|key| vec![ways[0][key], ways[1][key]]).collect(), active };
                for structure in [PointStructure::Linear, PointStructure::TimeSlices(3)] {
                    let tree = cloud.tree(structure, SimdLevel::best()).unwrap();
                    let time = not_before - 0.5 / (keys - 1) as f32;
                    let good = tree.neighbor_lists_with_skin(time, 1.0, 0.1, 1.0, &mut lists).unwrap();
                    assert_eq!((lists.neighbors(), good), (0, begin), "{keys} keys, {structure:?}, beside key {key}");
                }
            }
        }
    }
}

/// Points at rest in f64 have lists that hold for ever, and meet those that they are near of throughout.
#[test]
fn points_at_rest() {
    let mut rng = Random(3);
    let points: Vec<DVec3> = (0..300).map(|_| vec(&mut rng) + DVec3::X * 1e9).collect();
    let tree = PointTree::build(&points, &mbkd::PointParams::default()).unwrap();
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
