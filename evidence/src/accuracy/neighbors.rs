//! Neighbours of a query, compared with exact distances.

use super::DOUBT;
use super::cases::PointCase;
use super::crossings::{Crossings, crossings};
use super::special_time;
use super::tally::OrderTally;
use crate::oracle::{ExactDistance, Given, Moving, ulp32};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Neighbor, NeighborQuery, PointArrays, PointError, PointParams, PointStructure, PointTree, TimeInterval};
use mbkd_scenes::Random;

/// Points of a set.
const POINTS: usize = 200;

/// The compared structures, by name: for f64 points (`wide`) all but the one that splits references.
pub fn structures(wide: bool) -> Vec<(&'static str, PointStructure)> {
    let mut all = vec![
        ("automatic", PointStructure::Automatic),
        ("linear", PointStructure::Linear),
        ("time slices", PointStructure::TimeSlices(3)),
        ("k-d", PointStructure::Kd),
    ];
    all.retain(|(_, s)| !(wide && matches!(s, PointStructure::Kd)));
    all
}

/// A set of points as given by the caller.
pub(super) struct Points {
    /// By key and point.
    pub(super) keys: Vec<Vec<DVec3>>,
    pub(super) active: Vec<TimeInterval>,
    pub(super) given: Given,
}

impl Points {
    pub(super) fn new(case: &PointCase, random: &mut Random) -> Points {
        let base = DVec3::splat(case.offset * case.scale);
        let mut keys = vec![Vec::new(); case.keys];
        let mut active = Vec::new();
        for i in 0..POINTS {
            let cluster = case.clusters.map_or(DVec3::ZERO, |away| DVec3::X * (away * f64::from(i as u32 % 2)));
            let outlier = match case.outlier {
                Some(away) if i == 0 => DVec3::new(away, -away, 0.5 * away),
                _ => DVec3::ZERO,
            };
            let (at, displacement) = (random.dvec() + cluster + outlier, random.dvec() * case.speed);
            for (k, key) in keys.iter_mut().enumerate() {
                let passed = k as f64 / (case.keys.max(2) - 1) as f64;
                let aside = if case.keys > 2 { random.dvec() * (0.3 * case.speed) } else { DVec3::ZERO };
                let p = base + (at + displacement * passed + aside) * case.scale;
                key.push(if case.wide { p } else { p.as_vec3().as_dvec3() });
            }
            let short = case.keys > 1 && random.below(4) == 0;
            let begin = random.unit_f64() as f32 * 0.6;
            let part = TimeInterval::new(begin, begin + 0.3).expect("a part of the shutter");
            active.push(if short { part } else { TimeInterval::FULL });
        }
        Points { keys, active, given: if case.wide { Given::F64 } else { Given::F32 } }
    }

    pub(super) fn trees(&self, structures: &[PointStructure]) -> Result<Vec<PointTree>, PointError> {
        let build = |&structure: &PointStructure| {
            let params = PointParams { structure, ..PointParams::default() };
            if self.given == Given::F64 {
                let keys: Vec<&[DVec3]> = self.keys.iter().map(|key| &key[..]).collect();
                PointTree::build(&PointArrays { keys: &keys, active: &self.active, ids: &[] }, &params)
            } else {
                let keys: Vec<Vec<Vec3>> =
                    self.keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
                let keys: Vec<&[Vec3]> = keys.iter().map(|key| &key[..]).collect();
                PointTree::build(&PointArrays { keys: &keys, active: &self.active, ids: &[] }, &params)
            }
        };
        structures.iter().map(build).collect()
    }

    fn at(&self, point: usize, time: f32) -> Moving {
        Moving::new(time, self.keys.len(), self.given, |k| self.keys[k][point])
    }

    /// When points cross planes of the trees, if queries are to be at such times.
    pub(super) fn crossings(case: &PointCase, trees: &[PointTree], random: &mut Random) -> Option<Crossings> {
        case.at_crossings.then(|| crossings(trees, POINTS, random))
    }

    /// A query near some point at a time.
    pub(super) fn query(&self, case: &PointCase, time: f32, random: &mut Random) -> DVec3 {
        let point = random.below(POINTS);
        self.query_near(point, case, time, random)
    }

    /// A query of a tree in the precision of the set.
    fn query_of<'t>(&self, tree: &'t PointTree, query: DVec3, time: f32) -> NeighborQuery<'t> {
        if self.given == Given::F64 { tree.query(query, time) } else { tree.query(query.as_vec3(), time) }
    }

    /// A query near a point at a time.
    fn query_near(&self, point: usize, case: &PointCase, time: f32, random: &mut Random) -> DVec3 {
        let near = self.at(point, time).near;
        let aside = random.dvec() * case.scale * [0.0, 1e-4, 0.1, 1.0, 30.0][random.below(5)];
        if self.given == Given::F64 { near + aside } else { (near + aside).as_vec3().as_dvec3() }
    }
}

/// Exact distances of all points that are active, nearest first.
struct Exact(Vec<(u32, ExactDistance)>);

impl Exact {
    fn new(set: &Points, query: DVec3, time: f32) -> Exact {
        let active = (0..POINTS).filter(|&i| set.active[i].contains(time));
        let mut all: Vec<_> =
            active.map(|i| (i as u32, ExactDistance::new(query, set.given, &set.at(i, time)))).collect();
        all.sort_by(|a, b| a.1.squared.cmp(&b.1.squared));
        Exact(all)
    }

    fn of(&self, id: u32) -> Option<&ExactDistance> {
        self.0.iter().find(|(i, _)| *i == id).map(|(_, d)| d)
    }

    /// The number of points that are certainly within a squared radius, and of those that may be.
    fn within(&self, squared: f64) -> (usize, usize) {
        let count = |sign: f64| {
            let inside = |d: &ExactDistance| d.near <= squared + sign * DOUBT * (d.unit() + ulp32(squared));
            self.0.iter().filter(|(_, d)| inside(d)).count()
        };
        (count(-1.0), count(1.0))
    }

    /// Whether a point is certainly not within a squared radius.
    fn is_outside(&self, id: u32, squared: f64) -> bool {
        self.of(id).is_none_or(|d| d.near > squared + DOUBT * (d.unit() + ulp32(squared)))
    }

    /// How much farther, in units, the answers are than the exact ones at their ranks times `stretch`.
    fn worst_order(&self, found: &[Neighbor], stretch: f64) -> f64 {
        let excess = |(place, n): (usize, &Neighbor)| {
            let (Some(found), Some((_, exact))) = (self.of(n.id), self.0.get(place)) else { return f64::INFINITY };
            if stretch == 1.0 {
                (&found.squared - &exact.squared).to_f64() / (found.unit() + exact.unit())
            } else {
                (found.near - exact.near * stretch) / (found.unit() + exact.unit() * stretch)
            }
        };
        found.iter().enumerate().map(excess).fold(0.0, f64::max)
    }
}

/// Compares trees, one per structure, with the exact answers to `count` queries. `tamper` may change the answers before
/// they are checked, to test that errors are noticed.
///
/// # Errors
/// If a tree cannot be built.
pub fn compare_neighbors(
    case: &PointCase,
    structures: &[PointStructure],
    count: usize,
    random: &mut Random,
    tamper: impl Fn(&mut Vec<Neighbor>),
) -> Result<Vec<OrderTally>, PointError> {
    let set = Points::new(case, random);
    let trees = set.trees(structures)?;
    let mut tallies = vec![OrderTally::default(); trees.len()];
    let crossings = Points::crossings(case, &trees, random);
    for _ in 0..count {
        let (time, query) = match &crossings {
            Some(crossings) => {
                let (time, point) = crossings.beside(random);
                (time, set.query_near(point, case, time, random))
            }
            None => {
                let time = special_time(random, case.keys);
                (time, set.query(case, time, random))
            }
        };
        let exact = Exact::new(&set, query, time);
        let k = [1, 4, 20, POINTS][random.below(4)];
        let radius = exact
            .0
            .get(random.below(40))
            .map_or(0.0, |(_, d)| (d.near.sqrt() * (0.9 + 0.2 * random.unit_f64())) as f32);
        let epsilon = [0.1, 1.0, 10.0, 1e20, f32::INFINITY][random.below(5)];
        for (tree, tally) in trees.iter().zip(&mut tallies) {
            compare(set.query_of(tree, query, time), &exact, (k, radius, epsilon), tally, &tamper);
        }
    }
    Ok(tallies)
}

/// Compares the runs of a query, for `k` neighbours, within a radius, and with an allowed error, with the exact answers.
fn compare(
    query: NeighborQuery<'_>,
    exact: &Exact,
    (k, radius, epsilon): (usize, f32, f32),
    tally: &mut OrderTally,
    tamper: &impl Fn(&mut Vec<Neighbor>),
) {
    tally.queries += 1;
    let mut found = query.nearest_n(k);
    tamper(&mut found);
    tally.wrong_count += usize::from(found.len() != k.min(exact.0.len()));
    order(exact, &found, tally);
    for n in &found {
        if let Some(d) = exact.of(n.id) {
            tally.distance.add(d.error_of(n.distance_squared), d.near, d.doubt);
        }
    }
    tally.wrong_count += usize::from(query.nearest() != query.nearest_n(1).first().copied());

    // Within a radius: all of them, and the nearest of them.
    let squared = f64::from(radius) * f64::from(radius);
    let (least, most) = exact.within(squared);
    let within = query.radius(radius).collect();
    let mut found: Vec<u32> = within.iter().map(|n| n.id).collect();
    found.sort_unstable();
    found.dedup();
    let wrong = !(least..=most).contains(&found.len())
        || found.len() != within.len()
        || found.iter().any(|&id| exact.is_outside(id, squared));
    tally.wrong_count += usize::from(wrong);
    let both = query.radius(radius).nearest_n(k);
    tally.wrong_count += usize::from(both.len() < k.min(least) || both.len() > k.min(most));
    order(exact, &both, tally);

    // Approximate queries, with and without a radius.
    let stretch = (1.0 + f64::from(epsilon)).powi(2);
    for radius in [f32::INFINITY, radius] {
        let found = query.radius(radius).approximate(epsilon).nearest_n(k);
        let squared = f64::from(radius) * f64::from(radius);
        let promised = if radius == f32::INFINITY { exact.0.len() } else { exact.within(squared / stretch).0 };
        let broken = found.len() < k.min(promised)
            || exact.worst_order(&found, stretch) > DOUBT
            || found.iter().any(|n| exact.is_outside(n.id, squared));
        tally.broken_promises += usize::from(broken);
    }
}

fn order(exact: &Exact, found: &[Neighbor], tally: &mut OrderTally) {
    let mut ids: Vec<u32> = found.iter().map(|n| n.id).collect();
    ids.sort_unstable();
    ids.dedup();
    tally.wrong_count += usize::from(ids.len() != found.len());
    let worst = exact.worst_order(found, 1.0);
    tally.worst_order = tally.worst_order.max(worst);
    tally.wrong_order += usize::from(worst > DOUBT);
}
