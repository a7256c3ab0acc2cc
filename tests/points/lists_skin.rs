//! Lists with a skin against comparing all pairs, at all times at which they change: they hold as long as they say.

use crate::lists_swept::{clouds, meet, size};
use crate::support::{Cloud, Random, STRUCTURES, build};
use mbkd::{
    MovingPoint, NeighborLists, PointArrays, PointParams, PointStructure, PointTree, Precision, SimdLevel,
    TimeInterval, certified_duration, glam::Vec3,
};

/// At all times before the returned one, the lists with a skin contain the lists at that time; and the returned time is
/// the last one with this property.
#[test]
fn lists_with_a_skin_hold_until_the_time_that_is_certified() {
    let (mut cut_short, mut complete) = (0, 0);
    for (kind, cloud, mut rng) in clouds(90) {
        let size = size(&cloud);
        for structure in [
            PointStructure::Automatic,
            PointStructure::Kd,
            PointStructure::TimeSlices(2),
            PointStructure::TimeSlices(8),
        ] {
            let tree = build(&cloud, structure, SimdLevel::best());
            for (time, until, skin) in [
                (0.0, 1.0, 0.05),
                (rng.unit() * 0.5, 0.8, 0.2),
                (0.5, 0.5 + 1e-3, 1e-3),
                (0.3, 1.0, 0.0),
                (0.5, 0.5, 0.1),
            ] {
                let (radius, skin) = (0.1 * size, skin * size);
                let what = format!("{kind}, {structure:?}, {time}..{until}, radius {radius}, skin {skin}");
                let mut lists = NeighborLists::new();
                let good = tree.neighbor_lists_with_skin(time, radius, skin, until, &mut lists).unwrap();
                assert!((time..=until).contains(&good), "{what}: {good}");
                let mut listed = vec![vec![false; cloud.len()]; cloud.len()];
                for (id, row) in lists.iter() {
                    row.iter().for_each(|&other| listed[id as usize][other as usize] = true);
                }
                // When a missing pair comes within the radius, and within one that is larger by rounding.
                let (mut first, mut at_the_earliest) = (f64::INFINITY, f64::INFINITY);
                let mut events =
                    vec![time, good.next_down(), time + (good - time) * 0.5, time + (good - time) * rng.unit()];
                let segments = (cloud.keys.len().max(2) - 1) as f64;
                let next_key = ((f64::from(time) * segments).floor() + 1.0) / segments;
                let times = [f64::from(time), f64::from(until).min(next_key)];
                for (i, row) in listed.iter().enumerate() {
                    for j in (0..i).filter(|&j| !row[j]) {
                        let mut enter = |radius: f64| {
                            let met = meet(&cloud, (i, j), times, radius * radius);
                            let near = met.map(|e| [e.enter.next_down(), e.enter, e.enter.next_up()]);
                            events.extend(near.into_iter().flatten());
                            met.map_or(f64::INFINITY, |e| e.enter.into())
                        };
                        first = first.min(enter(radius.into()));
                        at_the_earliest = at_the_earliest.min(enter(f64::from(radius) + f64::from(size) * 1e-5));
                    }
                }
                assert!(f64::from(good) <= first, "{what}: {good}, but a pair is missing from {first}");
                let earliest = at_the_earliest.min(times[1]) - 2e-6;
                assert!(f64::from(good) >= earliest, "{what}: {good}, though nothing is missing before {earliest}");
                if f64::from(good) < times[1] - 1e-5 {
                    cut_short += 1
                } else {
                    complete += 1
                }
                for t in events.into_iter().filter(|&t| time <= t && t < good) {
                    for i in (0..cloud.len()).filter(|&i| cloud.active[i].contains(t)) {
                        for j in (0..i).filter(|&j| cloud.active[j].contains(t) && !listed[i][j]) {
                            let d = cloud.at(j, t) - cloud.at(i, t);
                            let distance = (d.x * d.x + d.y * d.y) + d.z * d.z;
                            assert!(
                                distance > radius * radius || radius * radius == 0.0,
                                "{what}: {i} and {j} at {t}, before {good}"
                            );
                        }
                    }
                }
            }
        }
    }
    assert!(cut_short > 20 && complete > 20, "both cases: {cut_short}, {complete}");
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

/// A pair just outside of the lists, far from zero: as f32 has them, with what they have in common taken off, the two may seem to
/// be in.
#[test]
fn a_pair_just_beyond_the_skin_is_not_taken_for_a_listed_one() {
    let mut rng = Random(62);
    for round in 0..400 {
        let at = rng.vec() * [1e3, 10.0, 1e4, 0.0][round % 4];
        let direction = rng.vec().normalize_or(Vec3::X);
        let points = [MovingPoint::new(at, at + rng.vec() * 0.1), MovingPoint::new(at + direction, at)];
        let (cloud, time, radius) = (Cloud::moving(&points), 0.25 * rng.unit(), 0.3);
        let d = cloud.at(1, time) - cloud.at(0, time);
        let squared = (d.x * d.x + d.y * d.y) + d.z * d.z;
        let mut skin = squared.sqrt() * (1.0 + 1e-6) - radius;
        while (radius + skin) * (radius + skin) >= squared {
            skin = skin.next_down();
        }
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let mut lists = NeighborLists::new();
        let good = tree.neighbor_lists_with_skin(time, radius, skin, 1.0, &mut lists).unwrap();
        assert_eq!(lists.neighbors(), 0, "round {round}");
        let enter = meet(&cloud, (0, 1), [f64::from(time), 1.0], f64::from(radius) * f64::from(radius)).unwrap().enter;
        assert!(good <= enter, "round {round}: {good}, but they meet at {enter}");
    }
}

/// The float before the f32 nearest to a key may be located at the key already. A point that begins to exist then has no motion in
/// the segment before, and a pair with it is missing from then on.
#[test]
fn certificates_end_before_points_that_begin_to_exist_beside_a_key() {
    let (mut rng, mut beside) = (Random(63), 0);
    for keys in 4..80usize {
        for key in 1..keys - 1 {
            let nearest = (key as f64 / (keys - 1) as f64) as f32;
            let before = nearest.next_down();
            if ((before * (keys - 1) as f32) as usize) < key {
                continue;
            }
            let mut place = || (0..keys).map(|_| rng.vec() * 0.1).collect::<Vec<Vec3>>();
            let ways = [place(), place()];
            let active = [TimeInterval::FULL, TimeInterval::new(before, 1.0).unwrap()];
            let at = |key: usize| ways.iter().map(|way| way[key]).collect();
            let cloud = Cloud { keys: (0..keys).map(at).collect(), active: active.to_vec() };
            for structure in STRUCTURES {
                let tree = build(&cloud, structure, SimdLevel::best());
                let mut lists = NeighborLists::new();
                let time = nearest - 0.5 / (keys - 1) as f32;
                let good = tree.neighbor_lists_with_skin(time, 1.0, 0.1, 1.0, &mut lists).unwrap();
                assert_eq!((lists.neighbors(), good), (0, before), "{keys} keys, {structure:?}, beside key {key}");
                beside += 1;
            }
        }
    }
    assert!(beside > 100, "{beside}");
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
