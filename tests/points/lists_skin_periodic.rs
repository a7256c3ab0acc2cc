//! Lists with a skin in periodic boxes against comparing all pairs in all images: they hold as long as they say.

use crate::lists_swept_periodic::{KINDS, Set, periods_along};
use crate::support::Random;
use mbkd::{
    ListError, MovingPoint, PointParams, PointTree, Radii, SimdLevel,
    glam::{DVec3, Vec3},
};

/// Checks until when lists hold, which is at most `end`: not after the first time at which a pair is missing, and not before the
/// earliest that rounding explains. Returns whether it is before the end.
pub fn is_cut_short(good: f32, end: f64, [earliest, first]: [f64; 2], what: &str) -> bool {
    let good = f64::from(good);
    assert!(good <= first, "{what}: {good}, but a pair is missing from {first}");
    let earliest = earliest.min(end) - 2e-6;
    assert!(good >= earliest, "{what}: {good}, not {earliest}");
    good < end - 1e-5
}

impl Set {
    /// The position of a point at a time, as queries compute it.
    fn at(&self, i: usize, time: f32) -> DVec3 {
        let segments = (self.keys.len() - 1).max(1);
        let key = |number: usize| self.keys[number.min(self.keys.len() - 1)][i];
        if self.single {
            let along = time * segments as f32;
            let segment = (along as usize).min(segments - 1);
            let (a, b, s) = (key(segment).as_vec3(), key(segment + 1).as_vec3(), along - segment as f32);
            let place = if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) };
            return place.as_dvec3();
        }
        let along = f64::from(time) * segments as f64;
        let segment = (along as usize).min(segments - 1);
        let (a, b, s) = (key(segment), key(segment + 1), along - segment as f64);
        if s < 0.5 { a + (b - a) * s } else { b + (b - a) * (s - 1.0) }
    }

    /// The squared distance of the nearest images of a point and one of another set, as lists at a time compute it.
    pub fn squared(&self, (i, other, j): (usize, &Set, usize), periods: [Option<f64>; 3], time: f32) -> f32 {
        let (a, b) = (self.at(i, time), other.at(j, time));
        if self.single {
            let d = b.as_vec3() - a.as_vec3();
            let near = [0, 1, 2].map(|axis| match periods[axis].map(|length| length as f32) {
                Some(length) => d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length,
                None => d[axis],
            });
            return (near[0] * near[0] + near[1] * near[1]) + near[2] * near[2];
        }
        let d = b - a;
        let near = [0, 1, 2].map(|axis| match periods[axis] {
            Some(length) => d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length,
            None => d[axis],
        });
        ((near[0] * near[0] + near[1] * near[1]) + near[2] * near[2]) as f32
    }
}

/// At all times before the returned one the lists contain all pairs, and the returned time is about the last one for which that
/// holds.
#[test]
fn lists_with_a_skin_hold_until_the_time_that_is_certified() {
    let (mut cut_short, mut complete, mut across) = (0, 0, 0);
    for (number, kind) in KINDS.into_iter().enumerate() {
        for (turn, (count, keys)) in [(24, 2), (40, 3)].into_iter().enumerate() {
            for single in [true, false] {
                let mut rng = Random(700 + 10 * number as u64 + turn as u64);
                let set = Set::of_kind(kind, count, keys, single, &mut rng);
                let periods = periods_along([[true; 3], [true, false, true]][(turn + number) % 2]);
                let images = set.images(periods);
                for (time, until, skin) in
                    [(0.0, 1.0, 0.03), (rng.unit() * 0.5, 0.8, 0.2), (0.3, 1.0, 0.0), (0.5, 0.501, 1e-3)]
                {
                    let radius = [0.05, 0.2, 0.5][(turn + number) % 3];
                    let what = format!("{kind}, {count} points, single {single}, {time}..{until}, skin {skin}");
                    let listed = |i: usize, j: usize| {
                        let both = set.active[i].contains(time) && set.active[j].contains(time);
                        both && set.squared((i, &set, j), periods, time) <= (radius + skin) * (radius + skin)
                    };
                    let pairs = (0..count).flat_map(|i| (0..i).map(move |j| (i, j)));
                    let missing: Vec<_> = pairs.filter(|&(i, j)| !listed(i, j)).collect();
                    let segments = (keys - 1) as f64;
                    let next_key = ((f64::from(time) * segments).floor() + 1.0) / segments;
                    let times = [f64::from(time), f64::from(until).min(next_key)];
                    let first = |radius: f64, images: &[DVec3]| {
                        let enter = |&(i, j): &(usize, usize)| set.meet((i, &set, j), images, times, radius * radius);
                        missing.iter().filter_map(enter).fold(f64::INFINITY, |t, met| t.min(met.enter.into()))
                    };
                    let (first, at_the_earliest, as_given) = (
                        first(radius.into(), &images),
                        first(f64::from(radius) + 1e-4, &images),
                        first(radius.into(), &[DVec3::ZERO]),
                    );
                    for structure in set.structures() {
                        let what = format!("{what}, {structure:?}");
                        let tree = set.tree(structure, SimdLevel::best());
                        let query = tree.neighbor_lists(time, radius + skin).periodic(periods);
                        assert_eq!(query.collect().unwrap().neighbors(), count * (count - 1) - 2 * missing.len());
                        let good = query.certified_until(radius, until).unwrap();
                        assert!((time..=until).contains(&good), "{what}: {good}");
                        let short = is_cut_short(good, times[1], [at_the_earliest, first], &what);
                        *(if short { &mut cut_short } else { &mut complete }) += 1;
                        across += usize::from(first < as_given);
                        let events = [time, good.next_down(), time + (good - time) * rng.unit()];
                        for t in events.into_iter().filter(|&t| time <= t && t < good) {
                            for &(i, j) in
                                missing.iter().filter(|(i, j)| [*i, *j].iter().all(|&k| set.active[k].contains(t)))
                            {
                                let squared = set.squared((i, &set, j), periods, t);
                                assert!(squared > radius * radius, "{what}: {i} and {j} at {t}, before {good}");
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(cut_short > 50 && complete > 20 && across > 50, "{cut_short}, {complete}, {across}");
}

/// Points half a period apart along an axis, as near to either image as f32 tells, with lists that just hold them or just do not.
#[test]
fn pairs_at_half_a_period_are_listed_or_not_as_lists_have_it() {
    let (mut rng, mut listed, mut not) = (Random(9), 0, 0);
    for round in 0..4000 {
        let length = 0.5 + rng.unit();
        let away = (rng.bits() % [1, 9, 900_000][round % 3]) as f32 * length;
        let place = Vec3::new(away + length * rng.unit(), 0.1 * rng.unit(), 0.0);
        let other = place + Vec3::new(0.5 * length * (1.0 + rng.signed() * 1e-6), 0.1 * rng.unit(), 0.0);
        // Towards each other across either face.
        let way = Vec3::X * length * if round % 2 == 0 { 0.4 } else { -0.4 };
        let points = [MovingPoint::fixed(place), MovingPoint::new(other, other + way)];
        let set = Set::of_points(&points);
        let periods = [Some(f64::from(length)), None, None];
        let squared = set.squared((0, &set, 1), periods, 0.0);
        let mut around = squared.sqrt() * (1.0 + rng.signed() * 4e-7);
        for _ in 0..4 {
            let tree = PointTree::build(&points, &PointParams::default()).unwrap();
            let query = tree.neighbor_lists(0.0, around).periodic(periods);
            let holds = query.collect().unwrap().neighbors() > 0;
            let radius = 0.3 * length;
            let until = query.certified_until(radius, 1.0).unwrap();
            if holds {
                listed += 1;
                assert_eq!(until, 1.0, "round {round}, {around}");
            } else {
                not += 1;
                // As far as f32 has them apart.
                for time in [until.next_down(), until * 0.9, until * 0.5].into_iter().filter(|&time| time >= 0.0) {
                    assert!(
                        set.squared((0, &set, 1), periods, time) > radius * radius,
                        "round {round}, {until}, {time}"
                    );
                }
                assert!(until < 1.0);
            }
            around = if holds { around.next_down() } else { around.next_up() };
        }
    }
    assert!(listed > 1000 && not > 1000, "{listed}, {not}");
}

#[test]
fn bad_requests_are_errors() {
    let points = [MovingPoint::new(Vec3::ZERO, Vec3::X * 20.0), MovingPoint::fixed(Vec3::Y)];
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    let query = tree.neighbor_lists(0.25, 1.0);
    let boxed = |length: f64| query.periodic([Some(length), None, None]).certified_until(0.5, 1.0);
    assert_eq!(boxed(0.0), Err(ListError::Period { axis: 0 }));
    assert_eq!(boxed(1.0), Err(ListError::Extent { axis: 0 }));
    assert_eq!(boxed(1e-6), Err(ListError::FarFromPeriod { axis: 0 }));
    assert!(boxed(1.5).is_ok());
    assert_eq!(query.certified_until(1.5, 1.0), Err(ListError::Skin));
    for bad in [-1.0, f32::NAN] {
        assert_eq!(query.certified_until(bad, 1.0), Err(ListError::Radius { of: None }));
        assert_eq!(query.certified_until(0.5, bad), Err(ListError::Until));
        assert_eq!(tree.neighbor_lists(bad, 1.0).certified_until(0.5, 1.0), Err(ListError::Time));
    }
    assert_eq!(query.certified_until(0.5, 0.2), Err(ListError::Until));
    assert_eq!(query.certified_until(0.5, 1.1), Err(ListError::Until));
    assert_eq!(tree.neighbor_lists(0.25, Radii::Own(&[1.0; 2])).certified_until(0.5, 1.0), Err(ListError::RadiiDiffer));
    let all = tree.neighbor_lists(0.25, f32::INFINITY).periodic([Some(2.0), None, None]);
    assert_eq!(all.certified_until(f32::INFINITY, 1.0), Ok(1.0));
    assert_eq!(empty.neighbor_lists(0.25, 1.0).periodic([Some(1.0); 3]).certified_until(0.5, 0.75), Ok(0.75));
}
