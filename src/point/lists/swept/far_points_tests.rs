//! Points that are far from all others: what they cost the lists of these.

use super::candidate_points::FourPoints;
use super::coordinate::SweptCoordinate;
use super::encounter::{EncounterLanes, EncounterVisitor};
use super::sweep::Sweep;
use crate::point::layout::over_interval::PointPath;
use crate::primitive::{PointArrays, Position};
use crate::random::Random;
use crate::{PointParams, PointTree};
use glam::{DVec3, Vec3};

/// Counts the encounters that are reported to it, and the evaluations of four pairs.
#[derive(Default)]
struct Counted(usize, usize);

impl EncounterVisitor for Counted {
    const EXCLUDES_LISTED: bool = false;
    fn begin(&mut self, _own: &PointPath) {}
    fn visit<C: SweptCoordinate>(&mut self, _own: &PointPath, _others: &FourPoints<C>, encounters: &EncounterLanes) {
        self.0 += encounters.entering().count();
        self.1 += 1;
    }
}

/// How many encounters a set has, and how many evaluations of four pairs they take.
fn evaluated<P: Position, C: SweptCoordinate>(set: &[[DVec3; 2]], position: impl Fn(DVec3) -> P) -> [usize; 2] {
    let (open, close): (Vec<P>, Vec<P>) = set.iter().map(|&[at, by]| (position(at), position(at + by))).unzip();
    let points = PointArrays { keys: &[&open[..], &close], active: &[], ids: &[] };
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let reported = Sweep::<C>::new((&tree, None), [0.2, 0.3], 0.1.into(), [None; 2]).run(Counted::default);
    reported.iter().fold([0, 0], |[found, fours], of| [found + of.0, fours + of.1])
}

/// Three points that are far from thousands of others, and from those of their own groups: each pair near them was evaluated in
/// f64, for all groups.
#[test]
fn points_far_from_the_others_cost_little() {
    let mut random = Random(9);
    let mut place = |by: f64| DVec3::from_array(core::array::from_fn(|_| f64::from(random.signed()) * by));
    let set: Vec<[DVec3; 2]> = (0..4000).map(|_| [place(1.0), place(0.01)]).collect();
    let single = |set: &[[DVec3; 2]]| evaluated::<Vec3, f32>(set, DVec3::as_vec3);
    let double = |set: &[[DVec3; 2]]| evaluated::<DVec3, f64>(set, |p| p);
    let check = |far: f64, evaluated: &dyn Fn(&[[DVec3; 2]]) -> [usize; 2]| {
        let mut spread = set.clone();
        [70, 1900, 3100].into_iter().for_each(|i| spread[i][0] *= far);
        let ([found, fours], [of_all, fours_of_all]) = (evaluated(&spread), evaluated(&set));
        let what = format!("{far:e}: {found} of {of_all} found, {fours} instead of {fours_of_all} evaluations");
        assert!(found <= of_all && found + 50 > of_all, "{what}");
        assert!(fours < 4 * fours_of_all + 20 * set.len(), "{what}");
    };
    check(1e6, &single);
    check(1e6, &double);
    check(1e12, &double);
    check(1e16, &double);
}

/// Three points that are far from all others and fast: in f32 each pair of their groups was evaluated in f64, in f64 each pair of
/// the set.
#[test]
fn fast_points_cost_little() {
    let mut random = Random(10);
    let mut place = |by: f64| DVec3::from_array(core::array::from_fn(|_| f64::from(random.signed()) * by));
    let set: Vec<[DVec3; 2]> = (0..4000).map(|_| [place(1.0), place(0.01)]).collect();
    let single = |set: &[[DVec3; 2]]| evaluated::<Vec3, f32>(set, DVec3::as_vec3);
    let double = |set: &[[DVec3; 2]]| evaluated::<DVec3, f64>(set, |p| p);
    let check = |fast: f64, evaluated: &dyn Fn(&[[DVec3; 2]]) -> [usize; 2]| {
        let mut spread = set.clone();
        for i in [70, 1900, 3100] {
            spread[i] = [set[i][0] * fast, set[i][1] * 100.0 * fast];
        }
        let ([found, fours], [of_all, fours_of_all]) = (evaluated(&spread), evaluated(&set));
        let what = format!("{fast:e}: {found} of {of_all} found, {fours} instead of {fours_of_all} evaluations");
        assert!(found <= of_all && found + 50 > of_all, "{what}");
        assert!(fours < 4 * fours_of_all + 20 * set.len(), "{what}");
    };
    check(1e6, &single);
    check(1e6, &double);
    check(1e8, &double);
}

/// While a point with two keys passes half of its displacement, one with three keys passes all of its own, which is as long.
#[test]
fn equal_displacements_between_different_keys_are_relative_motion() {
    let tree = |keys: &[&[DVec3]]| {
        PointTree::build(&PointArrays { keys, active: &[], ids: &[] }, &PointParams::default()).unwrap()
    };
    let [start, bend] = [DVec3::splat(0.1), DVec3::new(1.1, 0.1 + 1e-6, 0.1)];
    let slow = tree(&[&[start], &[start + DVec3::X]]);
    let fast = tree(&[&[start], &[bend], &[start + 2.0 * DVec3::X]]);
    let motion = |own, among| Sweep::<f64>::new((own, among), [0.0, 1.0], 0.1.into(), [None; 2]).motion;
    assert!(motion(&slow, Some(&fast)) >= 0.5 && motion(&fast, Some(&slow)) >= 0.5);
    assert!(motion(&slow, None) == 0.0 && motion(&fast, None) < 1e-5);
}
