//! Inputs at which the rounding decides that a padding covers. Each test fails if its padding is left out.

use crate::lists_swept::meet_all;
use crate::set::{AS_GIVEN, Set, check};
use crate::support::{Cloud, Random, STRUCTURES, build};
use mbkd::{Encounter, NeighborLists, PointStructure, PointTree, Radii, SimdLevel, TimeInterval, glam::Vec3};

fn meet(cloud: &Cloud, (i, j): (usize, usize), times: [f64; 2], square: f64) -> Option<Encounter> {
    let set = Set::from(cloud);
    set.meet((i, &set, j), &AS_GIVEN, times, square)
}

/// The least radius at which two points meet.
fn least_radius(cloud: &Cloud, (i, j): (usize, usize), interval: TimeInterval) -> f32 {
    let times = [interval.begin(), interval.end()].map(f64::from);
    let apart = meet(cloud, (i, j), times, f64::MAX).unwrap().distance_squared.sqrt();
    let mut radius = apart * (1.0 - 1e-6);
    while meet(cloud, (i, j), times, f64::from(radius) * f64::from(radius)).is_none() {
        radius = radius.next_up();
    }
    radius
}

/// Two crowds, each at one place, that come as near as the radius and no nearer: the one stands still near zero, the other passes
/// at a distance of ten thousand, where positions are rounded by a thousandth. (Boxes around points that move are padded in the
/// tree as well.)
#[test]
fn a_crowd_far_from_zero_meets_one_that_stands_still_there() {
    const CROWD: usize = 16;
    let mut rng = Random(64);
    for round in 0..1500 {
        let (at, by) = (rng.vec() * 1e4, rng.vec() * [1.0, 30.0, 1e-3][round % 3]);
        let trajectories = [[rng.vec() * 0.1; 2], [at - by * 0.5, at + by * 0.5]];
        let key = |key: usize| trajectories.iter().flat_map(|keys| vec![keys[key]; CROWD]).collect();
        let cloud = Cloud { keys: vec![key(0), key(1)], active: vec![TimeInterval::FULL; 2 * CROWD] };
        let interval = TimeInterval::new(0.25 * rng.unit(), 0.75 + 0.25 * rng.unit()).unwrap();
        let radius = least_radius(&cloud, (0, CROWD), interval);
        let tree = build(&cloud, PointStructure::Automatic, SimdLevel::best());
        for (id, row) in tree.neighbor_lists_swept(interval, radius).collect().unwrap().iter() {
            assert_eq!(row.len(), 2 * CROWD - 1, "round {round}: point {id}, radius {radius}");
        }
    }
}

/// Two points that are in the same place at every other key and far apart between these keys, most of which are no floats: the
/// float next to such a key is too late, or too early, to see them meet.
#[test]
fn encounters_at_keys_that_are_no_floats_are_met() {
    const KEYS: usize = 600;
    let mut rng = Random(65);
    let mut cloud = Cloud { keys: Vec::new(), active: vec![TimeInterval::FULL; 2] };
    for key in 0..KEYS {
        let (at, aside) = (rng.vec(), rng.vec());
        cloud.keys.push(vec![at, if key % 2 == 0 { at } else { at + aside }]);
    }
    for structure in [PointStructure::Linear, PointStructure::TimeSlices(2)] {
        let tree = build(&cloud, structure, SimdLevel::best());
        for key in (2..KEYS - 2).step_by(2) {
            let [begin, end] = [-0.7, 0.7].map(|by| (key as f32 + by) / (KEYS - 1) as f32);
            let interval = TimeInterval::new(begin, end).unwrap();
            let expected = meet_all(&Set::from(&cloud), interval, 1e-6);
            assert_eq!(expected[0].len(), 1);
            let found = tree.neighbor_lists_swept(interval, 1e-6).collect().unwrap();
            check(&found, &expected, &format!("{structure:?}, key {key}"));
        }
    }
}

/// Two crowds that stand still, so near each other that the squares of their distance and of the radius underflow. The terms of
/// the one are rounded up to the least f32 each, their sum is not.
#[test]
fn still_crowds_meet_where_squares_underflow() {
    const CROWD: usize = 32;
    let a = 1.001 * 2f32.powi(-75);
    let points = [Vec3::ZERO, Vec3::splat(a)].into_iter().flat_map(|p| [p; CROWD]).collect();
    let tree = build(&Cloud::still(points), PointStructure::Automatic, SimdLevel::best());
    let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 1.7321 * a).collect().unwrap();
    for (id, row) in lists.iter() {
        assert_eq!(row.len(), 2 * CROWD - 1, "point {id}");
    }
}

/// Two points that pass through each other, so slowly that the squares of their displacements underflow.
#[test]
fn tiny_points_are_met_where_squares_underflow() {
    for size in [1e-19, 1e-20, 1e-22] {
        let keys = vec![vec![Vec3::ZERO, Vec3::X * size], vec![Vec3::X * size, Vec3::ZERO]];
        let cloud = Cloud { keys, active: vec![TimeInterval::FULL; 2] };
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let found = tree.neighbor_lists_swept(TimeInterval::FULL, 1e-3 * size).collect().unwrap();
        check(&found, &meet_all(&Set::from(&cloud), TimeInterval::FULL, 1e-3 * size), &format!("size {size}"));
        assert_eq!(found.encounters().len(), 2);
    }
}

/// A point that is nearer by just a little more than the factor 1 + ε, in a box of its own. The box around the others holds the
/// query point and is visited first.
#[test]
fn the_factor_of_approximate_answers_is_rounded_up() {
    const CROWD: usize = 16;
    let mut rng = Random(70);
    for round in 0..2000 {
        let (epsilon, far) = (0.05 + rng.unit(), 1.0 + rng.unit());
        let allowed = |near: f32| {
            let [near, far] = [near, far].map(|x| f64::from(x * x).sqrt());
            far <= near * (1.0 + f64::from(epsilon))
        };
        let mut near = far / (1.0 + epsilon) * (1.0 + 1e-6);
        while allowed(near) {
            near = near.next_down();
        }
        let others = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().cycle().take(CROWD).map(|axis| axis * far);
        let points = others.chain([Vec3::X * -near; CROWD]).collect();
        let tree = build(&Cloud::still(points), PointStructure::Automatic, SimdLevel::best());
        let found = tree.query(Vec3::ZERO, 0.0).approximate(epsilon).nearest().unwrap();
        assert_eq!(found.distance_squared, near * near, "round {round}: {far}, epsilon {epsilon}");
    }
}

/// Makes lists of two points with a skin; until when they hold: the latest time of those for one radius and for the same radius
/// given for each point, which come about in different ways.
fn certified(tree: &PointTree, time: f32, radius: f32, skin: f32, lists: &mut NeighborLists) -> f32 {
    let equal = tree.neighbor_lists_with_skin(time, radius, skin, 1.0, lists).unwrap();
    let [needed, listed] = [radius, radius + skin].map(|radius| [radius; 2]);
    let [half_needed, half_listed] = [needed, listed].map(|radii| radii.map(|radius| 0.5 * radius));
    type Form = for<'a> fn(&'a [f32]) -> Radii<'a>;
    let forms: [(&[f32; 2], &[f32; 2], Form); 3] = [
        (&needed, &listed, |own| Radii::Own(own)),
        (&needed, &listed, |own| Radii::Larger { own, others: own }),
        (&half_needed, &half_listed, |own| Radii::Sum { own, others: own }),
    ];
    let until = |(needed, listed, form): (&[f32; 2], &[f32; 2], Form)| {
        tree.neighbor_lists(time, form(listed)).certified_until(form(needed), 1.0).unwrap()
    };
    forms.into_iter().map(until).fold(equal, f32::max)
}

/// A slow pair far from zero, which queries at some times find within the radius before it is there in truth.
#[test]
fn a_certificate_ends_before_rounding_takes_a_pair_for_near() {
    let (mut rng, mut lists, mut early) = (Random(66), NeighborLists::new(), 0);
    for round in 0..90 {
        let keys = [2, 3, 9][round % 3];
        let offset = rng.vec() * [1e3, 30.0, 1e5][round % 3];
        let step = offset.length() * [1e-6, 1e-5, 1e-4][round / 3 % 3];
        let (radius, direction) = (offset.length() * 1e-3, rng.vec().normalize_or(Vec3::X));
        let mut cloud = Cloud { keys: Vec::new(), active: vec![TimeInterval::FULL; 2] };
        for key in 0..keys {
            let (at, nearer) = (offset + rng.vec() * step, 2.0 * key as f32 / (keys - 1) as f32);
            cloud.keys.push(vec![at, at + direction * (radius + step * (1.0 - nearer))]);
        }
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let good = certified(&tree, 0.0, radius, 0.1 * step, &mut lists);
        if lists.neighbors() > 0 {
            continue;
        }
        let enter = meet(&cloud, (0, 1), [0.0, 1.0], f64::from(radius) * f64::from(radius)).map_or(1.0, |e| e.enter);
        for _ in 0..200 {
            let t = enter * (1.0 - 0.1 * rng.unit());
            let d = cloud.at(1, t) - cloud.at(0, t);
            if (d.x * d.x + d.y * d.y) + d.z * d.z <= radius * radius {
                assert!(t >= good, "round {round}: within the radius at {t}, before {good}");
                early += 1;
            }
        }
    }
    assert!(early > 100, "{early}");
}

/// A pair just outside of the lists that has a fast motion in common. Lists interpolate in f32 and are off by more than places
/// rounded once: as those have it, the pair may seem to be listed.
#[test]
fn a_pair_just_outside_the_lists_by_their_rounding_is_not_taken_for_a_listed_one() {
    let (mut rng, mut lists) = (Random(69), NeighborLists::new());
    for round in 0..600 {
        let (at, by, direction) = (rng.vec() * 1e3, rng.vec() * 3e3, rng.vec().normalize_or(Vec3::X));
        let keys = vec![vec![at - by, at - by + direction], vec![at + by, at + by + direction * 0.1]];
        let (cloud, time, radius) = (Cloud { keys, active: vec![TimeInterval::FULL; 2] }, 0.1 + 0.15 * rng.unit(), 0.3);
        let d = cloud.at(1, time) - cloud.at(0, time);
        let squared = (d.x * d.x + d.y * d.y) + d.z * d.z;
        let mut skin = squared.sqrt() * (1.0 + 1e-6) - radius;
        while (radius + skin) * (radius + skin) >= squared {
            skin = skin.next_down();
        }
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let good = certified(&tree, time, radius, skin, &mut lists);
        assert_eq!(lists.neighbors(), 0, "round {round}");
        let enter = meet(&cloud, (0, 1), [f64::from(time), 1.0], f64::from(radius) * f64::from(radius)).unwrap().enter;
        assert!(good <= enter, "round {round}: {good}, but they meet at {enter}");
    }
}

/// The same in a tree of a short time slice, whose boxes bound nothing at the keys, where coordinates and so their rounding are
/// largest: of a pair that the lists just leave out and that is nearer in truth, at a time at which both are near others.
#[test]
fn a_pair_just_outside_the_lists_of_a_time_slice_is_not_taken_for_a_listed_one() {
    let corner = |i: usize| Vec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { 2.0 } else { -2.0 }));
    let with = |pair: [f32; 2]| (0..8).map(corner).chain(pair.map(|x| Vec3::X * x)).collect::<Vec<_>>();
    let keys = vec![with([-900.0, -889.890_6]), with([898.0, 888.109_44])];
    let cloud = Cloud { keys, active: vec![TimeInterval::FULL; 10] };
    let tree = build(&cloud, PointStructure::TimeSlices(1024), SimdLevel::best());
    let (mut lists, radius, later) = (NeighborLists::new(), 0.1, 0.5008);
    let good = tree.neighbor_lists_with_skin(0.5, radius, 0.009424, 0.5009, &mut lists).unwrap();
    assert_eq!(lists.neighbors(), 0);
    tree.neighbor_lists(later, radius).run(&mut lists).unwrap();
    assert_eq!(lists.neighbors(), 2, "a pair within the radius");
    assert!(good <= later, "{good}");
}

/// A coordinate at a key: it grows by `w` in one segment and is zero at a phase of it.
fn passing_zero(segment: usize, phase: f32, w: f32, key: usize) -> f32 {
    if key <= segment { -w * phase } else { w * (1.0 - phase) }
}

/// A fast point that is farther out than all others when it begins to exist. Queries compute a phase that is earlier than the exact
/// one; the box has to hold the point then.
#[test]
fn a_fast_point_is_found_where_its_life_begins() {
    let mut rng = Random(67);
    for round in 0..900 {
        let segments = [21, 33, 41][round % 3];
        let segment = segments - 1 - rng.below(4);
        let begin = (segment as f32 + 0.1 + 0.8 * rng.unit()) / segments as f32;
        let (phase, w) = (begin * segments as f32 - segment as f32, 1.0 + rng.unit());
        let active = vec![TimeInterval::new(begin, 1.0).unwrap(), TimeInterval::FULL];
        let key = |key| [passing_zero(segment, phase, w, key), 3.0 + 1e-3 * rng.unit()].map(Vec3::splat).to_vec();
        let cloud = Cloud { keys: (0..=segments).map(key).collect(), active };
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let found = tree.within(cloud.at(0, begin), begin, 0.0);
        assert_eq!(found.len(), 1, "round {round}");
    }
}

/// The same over an interval: points touch a fast crowd at the exact phase at which it begins to exist, earlier than the one that
/// queries compute.
#[test]
fn a_fast_crowd_is_met_where_its_life_begins() {
    const SEGMENTS: usize = 700;
    let mut rng = Random(68);
    for round in 0..16 {
        let later = |t: f32| f64::from(t * SEGMENTS as f32) - f64::from(t) * SEGMENTS as f64;
        let begin = (0..).map(|_| 1.0 - 0.3 * rng.unit()).find(|t| later(*t) > 2.5e-5).unwrap();
        let segment = (f64::from(begin) * SEGMENTS as f64) as usize;
        let (phase, w, other) = (begin * SEGMENTS as f32 - segment as f32, 1.0 + rng.unit(), 1.0 + rng.unit());
        let late = TimeInterval::new(begin, 1.0).unwrap();
        let active = (0..32).map(|i| if i < 8 { late } else { TimeInterval::FULL }).collect();
        let mut at = |i, key| match i {
            0..8 => Vec3::X * passing_zero(segment, phase, w, key),
            8..16 => Vec3::X * other,
            _ => Vec3::new(-1.01, 1e-3 * rng.unit(), 0.0),
        };
        let keys = (0..=SEGMENTS).map(|key| (0..32).map(|i| at(i, key)).collect()).collect();
        let cloud = Cloud { keys, active };
        let interval = TimeInterval::new(begin, begin.next_up()).unwrap();
        let radius = least_radius(&cloud, (16, 0), interval);
        let tree = build(&cloud, PointStructure::Linear, SimdLevel::best());
        let found = tree.neighbor_lists_swept(interval, radius).collect().unwrap();
        check(&found, &meet_all(&Set::from(&cloud), interval, radius), &format!("round {round}"));
    }
}

/// Points whose distances differ by less than f32 tells: the lower id is the answer, though the other is nearer.
#[test]
fn closest_approaches_that_are_equal_as_rounded_go_to_the_lower_id() {
    let [near, far] = [Vec3::X, Vec3::new(1.0, 1e-5, 0.0)];
    for points in [[near, far], [far, near]] {
        for structure in STRUCTURES {
            let tree = build(&Cloud::still(points.to_vec()), structure, SimdLevel::best());
            let found = tree.closest_approach(Vec3::ZERO, Vec3::ZERO, TimeInterval::FULL).unwrap();
            assert_eq!((found.id, found.distance), (0, 1.0), "{points:?}, {structure:?}");
        }
    }
}

/// A motion by one along x that passes zero between a key, which is no float, and the float next to it: coordinates at the key
/// before, at the key, and at the key after. The time, the float and the key are given in segments.
fn passing_beside_a_key(time: f64, float: f64, key: f64) -> [f32; 3] {
    let (late, early) = ((key + 1.0 - time) as f32, (key - time) as f32);
    if float < key { [early - 1.0, early, early + 1.0] } else { [late - 2.0, late - 1.0, late] }
}

/// A crowd that passes the query just there, in a tree that ends or begins with the float; a crowd that stands still not quite as
/// near is found before.
#[test]
fn closest_approaches_beside_keys_that_are_no_floats_are_found() {
    const CROWD: usize = 16;
    const SEGMENTS: usize = 599;
    for key in (300..SEGMENTS - 1).step_by(3) {
        let exact = key as f64 / SEGMENTS as f64;
        let float = f64::from(exact as f32) * SEGMENTS as f64;
        let time = 0.5 * (float + key as f64);
        let near = passing_beside_a_key(time, float, key as f64);
        let at = |k: usize| if k + 1 < key { near[0] } else { near[(k + 1 - key).min(2)] };
        let apart = 0.1 * (time - key as f64).abs() as f32;
        let keys = (0..=SEGMENTS).map(|k| [[Vec3::Y * apart; CROWD], [Vec3::X * at(k); CROWD]].concat()).collect();
        let cloud = Cloud { keys, active: vec![TimeInterval::FULL; 2 * CROWD] };
        let interval = TimeInterval::new(exact as f32 - 1e-5, exact as f32 + 1e-5).unwrap();
        for structure in STRUCTURES {
            let found = build(&cloud, structure, SimdLevel::best());
            let found = found.closest_approach(Vec3::ZERO, Vec3::ZERO, interval).unwrap();
            assert_eq!(found.id, CROWD as u32, "key {key}, {structure:?}: {found:?}, the other at {apart}");
        }
    }
}

/// The same for a fast query, within two floats around the key, that passes points which move little.
#[test]
fn fast_queries_beside_keys_that_are_no_floats_find_what_they_pass() {
    const SEGMENTS: usize = 599;
    for key in (300..SEGMENTS - 1).step_by(3) {
        let exact = key as f64 / SEGMENTS as f64;
        let float = exact as f32;
        let time = exact + 0.25 * (f64::from(float) - exact);
        let times = [float.next_down(), float.next_up()];
        let [from, to] = times.map(|t| Vec3::X * ((f64::from(t) - time) * 2f64.powi(24)) as f32);
        let keys = (0..=SEGMENTS).map(|k| vec![Vec3::Y * k.abs_diff(key) as f32 * 1e-3; 32]).collect();
        let cloud = Cloud { keys, active: vec![TimeInterval::FULL; 32] };
        let interval = TimeInterval::new(times[0], times[1]).unwrap();
        for structure in STRUCTURES {
            let found = build(&cloud, structure, SimdLevel::best()).closest_approach(from, to, interval).unwrap();
            assert!(found.distance < 1e-5, "key {key}, {structure:?}: {found:?}");
        }
    }
}

/// A runner that crosses the plane through a crowd just before its life ends, nearer to that than half a float, and so is in no
/// leaf behind the plane: there the query stands. Another point is almost as near.
#[test]
fn a_runner_that_crosses_a_plane_when_it_ends_is_approached() {
    const CROWD: usize = 40;
    let mut rng = Random(71);
    for round in 0..100 {
        let speed = 1e3 * (1.0 + rng.unit());
        let plane = -speed * 2f32.powi(-27);
        let still = (0..2 * CROWD).map(|i| Vec3::new(if i < CROWD { -1.0 } else { plane }, 0.01 * rng.unit(), 0.0));
        let still: Vec<Vec3> = still.chain([Vec3::Y * 1e-6]).collect();
        let key = |at: f32| [&still[..], &[Vec3::X * at * speed]].concat();
        let active = [vec![TimeInterval::FULL; still.len()], vec![TimeInterval::new(0.0, 0.5).unwrap()]].concat();
        let cloud = Cloud { keys: vec![key(-0.5), key(0.5)], active };
        let interval = TimeInterval::new(0.25, 0.5).unwrap();
        for structure in STRUCTURES {
            let tree = build(&cloud, structure, SimdLevel::best());
            let found = tree.closest_approach(Vec3::ZERO, Vec3::ZERO, interval).unwrap();
            assert_eq!((found.id, found.distance), (2 * CROWD as u32 + 1, 0.0), "round {round}, {structure:?}");
        }
    }
}
