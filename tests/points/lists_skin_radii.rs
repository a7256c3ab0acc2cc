//! Lists with a skin whose pairs have radii of their own against comparing all pairs: they hold as long as they say.

use crate::set::{KINDS, Set, periods_along};
use crate::skin_case::{Held, OfPair, SkinCase};
use crate::support::Random;
use mbkd::{ListError, MovingPoint, PointParams, PointTree, Radii, RadiusOf, glam::Vec3};

/// Radii within which lists shall hold all pairs, and those that they are made with.
struct Skins {
    needed: Vec<f32>,
    listed: Vec<f32>,
}

impl Skins {
    fn of(count: usize, radius: f32, skin: f32, rng: &mut Random) -> Skins {
        let mut number = |from: f32| from + (1.0 - from) * rng.unit();
        let needed: Vec<f32> = (0..count).map(|i| if i % 7 == 0 { 0.0 } else { radius * number(0.3) }).collect();
        let listed = needed.iter().map(|needed| needed + skin * number(0.5)).collect();
        Skins { needed, listed }
    }
}

#[test]
fn lists_of_points_with_radii_of_their_own_hold_until_the_time_that_is_certified() {
    let mut held = Held::default();
    for (number, name) in KINDS.into_iter().enumerate() {
        for (turn, among) in [false, true, false, true].into_iter().enumerate() {
            for single in [true, false] {
                let mut rng = Random(300 + 10 * number as u64 + turn as u64);
                let counts = [[24, 24], [30, 20]][usize::from(among)];
                let keys = [[2, 2], [2, 3], [3, 3], [3, 2]][turn];
                let of = |i: usize, rng: &mut Random| Set::of_kind(name, counts[i], keys[i], single, rng);
                let own = of(0, &mut rng);
                let other = among.then(|| of(1, &mut rng));
                let (radius, skin) = ([0.06, 0.2, 0.4][(turn + number) % 3], [0.03, 0.2, 1e-3][number % 3]);
                let skins = counts.map(|count| Skins::of(count, radius, skin, &mut rng));
                let periods = if turn < 2 { [None; 3] } else { periods_along([true, number % 2 == 0, true]) };
                let structures: Vec<_> = own.structures().map(|structure| [structure; 2]).collect();
                for of_pair in [OfPair::Own, OfPair::Larger, OfPair::Sum] {
                    for pairs_once in [false, true] {
                        let of_both = [&skins[0], &skins[usize::from(among)]];
                        let case = SkinCase {
                            sets: [&own, other.as_ref().unwrap_or(&own)],
                            among,
                            pairs_once,
                            of_pair,
                            needed: of_both.map(|skins| &skins.needed[..]),
                            listed: of_both.map(|skins| &skins.listed[..]),
                            periods,
                            rounding: [1e-4, 2e-6],
                        };
                        let what = format!("{name}, among {among}, single {single}, {of_pair:?}, once {pairs_once}");
                        let times = [[0.0, 1.0], [rng.unit() * 0.5, 0.8], [0.3, 0.31]][(turn + number) % 3];
                        case.check(&structures, times, &mut rng, &what, &mut held);
                    }
                }
            }
        }
    }
    assert!(held.cut_short > 100 && held.complete > 50, "{held:?}");
}

/// With equal radii in each of the forms, the time is the same but for the rounding of radii.
#[test]
fn radii_that_are_all_equal_certify_what_one_radius_does() {
    let mut rng = Random(77);
    let points: Vec<MovingPoint> = (0..200).map(|_| MovingPoint::new(rng.vec(), rng.vec())).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let [needed, listed, half_needed, half_listed] = [0.2, 0.3, 0.1, 0.15].map(|radius: f32| [radius; 200]);
    let one = tree.neighbor_lists(0.0, 0.3).certified_until(0.2, 1.0).unwrap();
    for (kind, needed, listed) in
        [(OfPair::Own, needed, listed), (OfPair::Larger, needed, listed), (OfPair::Sum, half_needed, half_listed)]
    {
        let query = tree.neighbor_lists(0.0, kind.radii([&listed; 2]));
        let until = query.certified_until(kind.radii([&needed; 2]), 1.0).unwrap();
        assert!((until - one).abs() < 1e-6, "{kind:?}: {until}, not {one}");
    }
    assert!(one < 0.9);
}

#[test]
fn bad_radii_are_errors() {
    let [moving, still] = [Vec3::X, Vec3::ZERO]
        .map(|by| [MovingPoint::new(Vec3::ZERO, by), MovingPoint::fixed(Vec3::Y * 2.0)])
        .map(|points| PointTree::build(&points, &PointParams::default()).unwrap());
    let (short, long) = ([1.0, 1.0], [1.0, 1.5]);
    for tree in [&moving, &still] {
        let own = tree.neighbor_lists(0.0, Radii::Own(&short));
        assert_eq!(own.certified_until(Radii::Own(&short), 1.0), Ok(1.0));
        assert_eq!(own.certified_until(Radii::Own(&long), 1.0), Err(ListError::Skin));
        assert_eq!(own.certified_until(1.0, 1.0), Err(ListError::RadiiDiffer));
        assert_eq!(tree.neighbor_lists(0.0, 1.0).certified_until(Radii::Own(&short), 1.0), Err(ListError::RadiiDiffer));
        let bad = Err(ListError::Radius { of: Some(RadiusOf::Point(1)) });
        assert_eq!(own.certified_until(Radii::Own(&[1.0, f32::NAN]), 1.0), bad);
        let missing = Err(ListError::MissingRadius { of: RadiusOf::Point(1) });
        assert_eq!(own.certified_until(Radii::Own(&[1.0]), 1.0), missing);
        assert_eq!(tree.neighbor_lists(0.0, Radii::Own(&[1.0])).certified_until(Radii::Own(&short), 1.0), missing);
        for (others, error) in
            [(&long, ListError::Skin), (&[0.5, -1.0], ListError::Radius { of: Some(RadiusOf::Listed(1)) })]
        {
            let sum = tree.neighbor_lists(0.0, Radii::Sum { own: &short, others: &short });
            assert_eq!(sum.certified_until(Radii::Sum { own: &short, others }, 1.0), Err(error));
        }
    }
}
