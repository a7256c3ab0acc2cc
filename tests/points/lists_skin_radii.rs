//! Lists with a skin whose pairs have radii of their own against comparing all pairs: they hold as long as they say.

use crate::lists_skin_periodic::is_cut_short;
use crate::lists_swept_periodic::{KINDS, Set, periods_along};
use crate::support::Random;
use mbkd::{
    ListError, MovingPoint, NeighborLists, PointParams, PointStructure, PointTree, Radii, RadiusOf, SimdLevel,
    glam::Vec3,
};

/// How the radii of two points make that of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Own,
    Larger,
    Sum,
}

impl Kind {
    fn radii<'a>(self, [own, others]: [&'a [f32]; 2]) -> Radii<'a> {
        match self {
            Kind::Own => Radii::Own(own),
            Kind::Larger => Radii::Larger { own, others },
            Kind::Sum => Radii::Sum { own, others },
        }
    }

    fn of_pair(self, own: f32, other: f32) -> f32 {
        match self {
            Kind::Own => own,
            Kind::Larger => own.max(other),
            Kind::Sum => own + other,
        }
    }
}

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

/// Which pairs two sets of points have; among each other, or among themselves.
struct Case<'a> {
    sets: [&'a Set; 2],
    among: bool,
    pairs_once: bool,
    kind: Kind,
    skins: [&'a Skins; 2],
    periods: [Option<f64>; 3],
}

impl Case<'_> {
    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let (among, once) = (self.among, self.pairs_once);
        let all = (0..self.sets[0].len()).flat_map(|i| (0..self.sets[1].len()).map(move |j| (i, j)));
        all.filter(move |&(i, j)| if once { i < j } else { among || i != j })
    }

    fn needed(&self, (i, j): (usize, usize)) -> f32 {
        self.kind.of_pair(self.skins[0].needed[i], self.skins[1].needed[j])
    }

    /// Whether a pair is within a radius at a time, as lists have it.
    fn within(&self, (i, j): (usize, usize), time: f32, radius: f32) -> bool {
        let both = self.sets[0].active[i].contains(time) && self.sets[1].active[j].contains(time);
        both && self.sets[0].squared((i, self.sets[1], j), self.periods, time) <= radius * radius
    }

    /// Until when lists of this structure hold, and whether that is before the end.
    fn check(&self, structure: PointStructure, [time, until]: [f32; 2], rng: &mut Random, what: &str) -> bool {
        let what = format!("{what}, {structure:?}, {time}..{until}");
        let trees = self.sets.map(|set| set.tree(structure, SimdLevel::best()));
        let [needed, listed]: [fn(&Skins) -> &[f32]; 2] = [|skins| &skins.needed, |skins| &skins.listed];
        let [needed, listed] = [needed, listed].map(|of| self.kind.radii(self.skins.map(of)));
        let mut query = trees[0].neighbor_lists(time, listed).periodic(self.periods);
        if self.among {
            query = query.among(&trees[1]);
        }
        if self.pairs_once {
            query = query.pairs_once();
        }
        let mut lists = NeighborLists::new();
        query.run(&mut lists).unwrap();
        let count = self.sets[1].len();
        let mut holds = vec![false; self.sets[0].len() * count];
        for (id, row) in lists.iter() {
            row.iter().for_each(|&other| holds[id as usize * count + other as usize] = true);
        }
        let missing: Vec<_> = self.pairs().filter(|&(i, j)| !holds[i * count + j]).collect();
        for pair in self.pairs() {
            let listed = self.kind.of_pair(self.skins[0].listed[pair.0], self.skins[1].listed[pair.1]);
            assert_eq!(holds[pair.0 * count + pair.1], self.within(pair, time, listed), "{what}: {pair:?}");
        }
        let good = query.certified_until(needed, until).unwrap();
        assert!((time..=until).contains(&good), "{what}: {good}");
        let next_key = |set: &Set| {
            let segments = (set.keys.len() - 1) as f64;
            ((f64::from(time) * segments).floor() + 1.0) / segments
        };
        let end = self.sets.map(next_key).into_iter().fold(f64::from(until), f64::min);
        let images = self.sets[0].images_among(self.sets[1], self.periods);
        let first = |wider: f64| {
            let enter = |&(i, j): &(usize, usize)| {
                let radius = f64::from(self.needed((i, j))) + wider;
                let of = (i, self.sets[1], j);
                self.sets[0].meet(of, &images, [f64::from(time), end], radius * radius)
            };
            missing.iter().filter_map(enter).fold(f64::INFINITY, |first, met| first.min(met.enter.into()))
        };
        let cut_short = is_cut_short(good, end, [first(1e-4), first(0.0)], &what);
        for t in [time, good.next_down(), time + (good - time) * rng.unit()] {
            for &pair in missing.iter().filter(|_| time <= t && t < good) {
                assert!(!self.within(pair, t, self.needed(pair)), "{what}: {pair:?} at {t}, before {good}");
            }
        }
        cut_short
    }
}

#[test]
fn lists_of_points_with_radii_of_their_own_hold_until_the_time_that_is_certified() {
    let (mut cut_short, mut complete) = (0, 0);
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
                for kind in [Kind::Own, Kind::Larger, Kind::Sum] {
                    for pairs_once in [false, true] {
                        let case = Case {
                            sets: [&own, other.as_ref().unwrap_or(&own)],
                            among,
                            pairs_once,
                            kind,
                            skins: [&skins[0], &skins[usize::from(among)]],
                            periods,
                        };
                        let what = format!("{name}, among {among}, single {single}, {kind:?}, once {pairs_once}");
                        let times = [[0.0, 1.0], [rng.unit() * 0.5, 0.8], [0.3, 0.31]][(turn + number) % 3];
                        for structure in own.structures() {
                            let short = case.check(structure, times, &mut rng, &what);
                            *(if short { &mut cut_short } else { &mut complete }) += 1;
                        }
                    }
                }
            }
        }
    }
    assert!(cut_short > 100 && complete > 50, "{cut_short}, {complete}");
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
        [(Kind::Own, needed, listed), (Kind::Larger, needed, listed), (Kind::Sum, half_needed, half_listed)]
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
