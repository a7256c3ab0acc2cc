//! Lists with a skin in periodic boxes against comparing all pairs in all images: they hold as long as they say.

use crate::set::{KINDS, Set, periods_along};
use crate::skin_case::{Held, OfPair, SkinCase};
use crate::support::Random;
use mbkd::{ListError, MovingPoint, PointParams, PointTree, Radii, glam::Vec3};

/// At all times before the returned one the lists contain all pairs, and the returned time is about the last one for which that
/// holds.
#[test]
fn lists_with_a_skin_hold_until_the_time_that_is_certified() {
    let mut held = Held::default();
    for (number, kind) in KINDS.into_iter().enumerate() {
        for (turn, (count, keys)) in [(24, 2), (40, 3)].into_iter().enumerate() {
            for single in [true, false] {
                let mut rng = Random(700 + 10 * number as u64 + turn as u64);
                let set = Set::of_kind(kind, count, keys, single, &mut rng);
                let structures: Vec<_> = set.structures().map(|structure| [structure; 2]).collect();
                for (time, until, skin) in
                    [(0.0, 1.0, 0.03), (rng.unit() * 0.5, 0.8, 0.2), (0.3, 1.0, 0.0), (0.5, 0.501, 1e-3)]
                {
                    let radius = [0.05, 0.2, 0.5][(turn + number) % 3];
                    let (needed, listed) = ([radius], [radius + skin]);
                    let case = SkinCase {
                        sets: [&set; 2],
                        among: false,
                        pairs_once: false,
                        of_pair: OfPair::Equal,
                        needed: [&needed; 2],
                        listed: [&listed; 2],
                        periods: periods_along([[true; 3], [true, false, true]][(turn + number) % 2]),
                        rounding: [1e-4, 2e-6],
                    };
                    let what = format!("{kind}, {count} points, single {single}, skin {skin}");
                    case.check(&structures, [time, until], &mut rng, &what, &mut held);
                }
            }
        }
    }
    assert!(held.cut_short > 50 && held.complete > 20 && held.across > 50, "{held:?}");
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
