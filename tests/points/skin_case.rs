//! Lists with a skin, and until when they hold by comparing all pairs at all times at which they change.

use crate::set::{AS_GIVEN, Set};
use crate::support::Random;
use mbkd::{NeighborLists, PointStructure, Radii, SimdLevel};

/// How the radii of two points make that of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OfPair {
    /// The first one, which all points have.
    Equal,
    Own,
    Larger,
    Sum,
}

impl OfPair {
    pub fn radii<'a>(self, [own, others]: [&'a [f32]; 2]) -> Radii<'a> {
        match self {
            OfPair::Equal => Radii::Equal(own[0]),
            OfPair::Own => Radii::Own(own),
            OfPair::Larger => Radii::Larger { own, others },
            OfPair::Sum => Radii::Sum { own, others },
        }
    }

    fn radius(self, [own, others]: [&[f32]; 2], (i, j): (usize, usize)) -> f32 {
        match self {
            OfPair::Equal => own[0],
            OfPair::Own => own[i],
            OfPair::Larger => own[i].max(others[j]),
            OfPair::Sum => own[i] + others[j],
        }
    }
}

/// A request for lists that shall hold for a while: of points among those of another set, or among themselves.
pub struct SkinCase<'a> {
    pub sets: [&'a Set; 2],
    pub among: bool,
    pub pairs_once: bool,
    pub of_pair: OfPair,
    /// Radii within which lists shall hold all pairs, of both sets.
    pub needed: [&'a [f32]; 2],
    /// Radii that they are made with.
    pub listed: [&'a [f32]; 2],
    pub periods: [Option<f64>; 3],
    /// By how much pairs may seem to be nearer than they are, and lists may hold shorter than they do.
    pub rounding: [f64; 2],
}

/// How many lists held until a pair was missing, and how many to the end; and of which pairs the first was that of an image.
#[derive(Default, Debug)]
pub struct Held {
    pub cut_short: usize,
    pub complete: usize,
    pub across: usize,
}

impl SkinCase<'_> {
    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let (among, once) = (self.among, self.pairs_once);
        let all = (0..self.sets[0].len()).flat_map(|i| (0..self.sets[1].len()).map(move |j| (i, j)));
        all.filter(move |&(i, j)| if once { i < j } else { among || i != j })
    }

    fn needed(&self, pair: (usize, usize)) -> f32 {
        self.of_pair.radius(self.needed, pair)
    }

    /// Whether a pair is within a radius at a time, as lists have it.
    fn within(&self, (i, j): (usize, usize), time: f32, radius: f32) -> bool {
        let both = self.sets[0].active[i].contains(time) && self.sets[1].active[j].contains(time);
        both && self.sets[0].squared((i, self.sets[1], j), self.periods, time) <= radius * radius
    }

    /// The end of the segments in which a time is, or `until` if that is earlier.
    fn end(&self, [time, until]: [f32; 2]) -> f64 {
        let next_key = |set: &Set| ((f64::from(time) * set.segments() as f64).floor() + 1.0) / set.segments() as f64;
        self.sets.map(next_key).into_iter().fold(f64::from(until), f64::min)
    }

    /// Lists of each structure: they hold all pairs until the time that is certified, and not much later one is missing.
    pub fn check(
        &self,
        structures: &[[PointStructure; 2]],
        [time, until]: [f32; 2],
        rng: &mut Random,
        what: &str,
        held: &mut Held,
    ) {
        let listed = |pair: (usize, usize)| self.within(pair, time, self.of_pair.radius(self.listed, pair));
        let missing: Vec<_> = self.pairs().filter(|&pair| !listed(pair)).collect();
        // Each pair once, if it is the same from both sides.
        let symmetric = !self.among && self.of_pair != OfPair::Own;
        let considered: Vec<_> = missing.iter().copied().filter(|(i, j)| !symmetric || i < j).collect();
        let end = self.end([time, until]);
        let mut meetings = Vec::new();
        let mut first = |wider: f64, images: &[_]| {
            let enter = |&(i, j): &(usize, usize)| {
                let radius = f64::from(self.needed((i, j))) + wider;
                let of = (i, self.sets[1], j);
                Some(self.sets[0].meet(of, images, [f64::from(time), end], radius * radius)?.enter)
            };
            let enters: Vec<f32> = considered.iter().filter_map(enter).collect();
            meetings.extend(enters.iter().flat_map(|enter| [enter.next_down(), *enter, enter.next_up()]));
            enters.into_iter().fold(f64::INFINITY, |first, enter| first.min(enter.into()))
        };
        let images = self.sets[0].images_among(self.sets[1], self.periods);
        let (earliest, first_missing, as_given) =
            (first(self.rounding[0], &images), first(0.0, &images), first(0.0, &AS_GIVEN));
        for structures in structures {
            let what = format!("{what}, {structures:?}, {time}..{until}");
            let good = self.certified(*structures, [time, until], &missing, &what);
            assert!(f64::from(good) <= first_missing, "{what}: {good}, but a pair is missing from {first_missing}");
            let earliest = earliest.min(end) - self.rounding[1];
            assert!(f64::from(good) >= earliest, "{what}: {good}, though nothing is missing before {earliest}");
            held.across += usize::from(first_missing < as_given);
            *(if f64::from(good) < end - 1e-5 { &mut held.cut_short } else { &mut held.complete }) += 1;
            let between = [time, good.next_down(), 0.5 * (time + good), time + (good - time) * rng.unit()];
            for t in between.iter().chain(&meetings).copied().filter(|&t| time <= t && t < good) {
                for &pair in &considered {
                    let radius = self.needed(pair);
                    let underflow = radius > 0.0 && radius * radius == 0.0;
                    assert!(!self.within(pair, t, radius) || underflow, "{what}: {pair:?} at {t}, before {good}");
                }
            }
        }
    }

    /// The time that is certified, of lists that lack these pairs and no others.
    fn certified(
        &self,
        structures: [PointStructure; 2],
        [time, until]: [f32; 2],
        missing: &[(usize, usize)],
        what: &str,
    ) -> f32 {
        let [tree, among] = [0, 1].map(|i| self.sets[i].tree(structures[i], SimdLevel::best()));
        let mut query = tree.neighbor_lists(time, self.of_pair.radii(self.listed)).periodic(self.periods);
        if self.among {
            query = query.among(&among);
        }
        if self.pairs_once {
            query = query.pairs_once();
        }
        let lists = query.collect().unwrap();
        let count = self.sets[1].len();
        let mut holds = vec![false; self.sets[0].len() * count];
        for (id, row) in lists.iter() {
            row.iter().for_each(|&other| holds[id as usize * count + other as usize] = true);
        }
        let lacks: Vec<_> = self.pairs().filter(|&(i, j)| !holds[i * count + j]).collect();
        assert_eq!(lacks, missing, "{what}");
        assert_eq!(lists.neighbors() + missing.len(), self.pairs().count(), "{what}");
        let good = query.certified_until(self.of_pair.radii(self.needed), until).unwrap();
        assert!((time..=until).contains(&good), "{what}: {good}");
        good
    }
}

/// The same lists and time from the one call for equal radii.
pub fn check_with_skin(set: &Set, structure: PointStructure, [time, until]: [f32; 2], [radius, skin]: [f32; 2]) {
    let tree = set.tree(structure, SimdLevel::best());
    let query = tree.neighbor_lists(time, radius + skin);
    let mut lists = NeighborLists::new();
    let good = tree.neighbor_lists_with_skin(time, radius, skin, until, &mut lists);
    assert_eq!(good, query.certified_until(radius, until), "{structure:?}, {time}..{until}, {radius}, {skin}");
    assert!(lists.iter().eq(query.collect().unwrap().iter()), "{structure:?}, {time}..{until}, {radius}, {skin}");
}
