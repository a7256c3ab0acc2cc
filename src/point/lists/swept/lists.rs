//! All encounters of a set with itself during an interval.

use super::encounter::{Encounter, Others, Window};
use super::flights::{Group, Memory, Partners};
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::lists::error::ListError;
use crate::point::moving_tree::MovingTree;
use crate::point::over_interval::{Boxed, Flight};
use crate::point::partition::Layer;
use crate::point::static_tree::StaticTree;
use crate::point::tree::PointTree;
use crate::simd::{Kernel, LANES, Lanes, Simd, dispatch};

/// Who comes within a radius of whom during an interval, and when: a list for each point.
///
/// ```
/// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
/// let points = [MovingPoint::new(Vec3::NEG_X, Vec3::X), MovingPoint::fixed(Vec3::Y * 0.3)];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.5)?;
/// let (_, row) = lists.iter().find(|(id, _)| *id == 0).unwrap();
/// assert_eq!((row.len(), row[0].id, row[0].closest), (1, 1, 0.5));
/// assert!((row[0].enter - 0.3).abs() < 1e-6 && (row[0].leave - 0.7).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncounterLists {
    /// Begin of each list, and the end of the last.
    offsets: Vec<usize>,
    points: Vec<u32>,
    encounters: Vec<Encounter>,
}

impl EncounterLists {
    /// Number of lists: one for each point that exists at any time of the interval, and possibly some that do not.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The id of the point that each list belongs to.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// All encounters, list after list.
    pub fn encounters(&self) -> &[Encounter] {
        &self.encounters
    }

    /// The lists, each with the id of its point.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, &[Encounter])> {
        let rows = self.offsets.windows(2).map(|ends| &self.encounters[ends[0]..ends[1]]);
        self.points.iter().copied().zip(rows)
    }
}

impl PointTree {
    /// For every point all others that come within `radius` at some time of the interval, both ends included, with
    /// the times: what a step of a simulation needs in which nothing may pass unseen.
    ///
    /// Decided in f64 for exact linear motion between the f32 positions at the keys; lives count with both ends. The
    /// lists do not depend on the structure, the number of threads or the instruction set, apart from the order of
    /// lists and within them, which is that of the tree. Points with the same id are the same point.
    ///
    /// Cost: a little more than lists at a time while points move less than their spacing relative to their
    /// neighbours; motion that all have in common costs nothing.
    pub fn neighbor_lists_swept(&self, interval: TimeInterval, radius: f32) -> Result<EncounterLists, ListError> {
        if !self.precise.is_empty() {
            return Err(ListError::Double);
        }
        if radius.is_nan() || radius < 0.0 {
            return Err(ListError::Radius { id: None });
        }
        let boxed = self.boxed();
        let sweep = Sweep::new(boxed.as_ref().unwrap_or(self), [interval.begin(), interval.end()], radius, None);
        let shares = sweep.run(Rows::default, |rows, own, meeting| match meeting {
            None => rows.begin(own.id),
            Some((.., encounter)) => rows.encounters.push(encounter),
        });
        let mut lists = EncounterLists { offsets: vec![0], ..EncounterLists::default() };
        for rows in shares {
            lists.append(&rows);
        }
        Ok(if sweep.once { lists } else { lists.merged() })
    }
}

/// Lists in the making.
#[derive(Default)]
struct Rows {
    points: Vec<u32>,
    begins: Vec<usize>,
    encounters: Vec<Encounter>,
}

impl Rows {
    fn begin(&mut self, id: u32) {
        self.points.push(id);
        self.begins.push(self.encounters.len());
    }
}

impl EncounterLists {
    fn append(&mut self, rows: &Rows) {
        let base = self.encounters.len();
        self.points.extend_from_slice(&rows.points);
        let ends =
            rows.begins.iter().skip(1).copied().chain((!rows.begins.is_empty()).then_some(rows.encounters.len()));
        self.offsets.extend(ends.map(|end| base + end));
        self.encounters.extend_from_slice(&rows.encounters);
    }

    /// One list for each point, one encounter for each pair, in the order of ids.
    fn merged(self) -> EncounterLists {
        let mut points = self.points.clone();
        points.sort_unstable();
        points.dedup();
        let mut all: Vec<(u32, Encounter)> =
            self.iter().flat_map(|(id, row)| row.iter().map(move |&encounter| (id, encounter))).collect();
        all.sort_unstable_by_key(|(own, e)| (*own, e.id));
        let mut merged = EncounterLists { offsets: vec![0], points, encounters: Vec::with_capacity(all.len()) };
        let mut all = all.into_iter().peekable();
        for &point in &merged.points {
            let begin = merged.encounters.len();
            while let Some((_, next)) = all.next_if(|(own, _)| *own == point) {
                match merged.encounters[begin..].last_mut() {
                    Some(last) if last.id == next.id => *last = last.and(next),
                    _ => merged.encounters.push(next),
                }
            }
            merged.offsets.push(merged.encounters.len());
        }
        merged
    }
}

/// A tree for a part of the shutter.
#[derive(Clone, Copy)]
enum Tree<'a> {
    Still(&'a StaticTree),
    Moving(&'a MovingTree),
}

/// A tree and the times that it is looked at.
#[derive(Clone, Copy)]
struct Part<'a> {
    tree: Tree<'a>,
    times: [f32; 2],
}

impl Part<'_> {
    /// Number of keys and segment where anything moves.
    fn segment(&self) -> Option<(usize, usize)> {
        match self.tree {
            Tree::Still(_) => None,
            Tree::Moving(tree) => Some((tree.part().keys, tree.part().segment)),
        }
    }

    /// The largest magnitude of a coordinate at either key of the segment, or somewhat more.
    fn magnitude(&self) -> f64 {
        match self.tree {
            Tree::Still(tree) => magnitude(tree),
            Tree::Moving(tree) => magnitude(tree),
        }
    }

    /// The bottom nodes.
    fn bottom_nodes(&self) -> Vec<usize> {
        match self.tree {
            Tree::Still(tree) => bottom_nodes(tree),
            Tree::Moving(tree) => bottom_nodes(tree),
        }
    }
}

fn bottom_nodes<T: Boxed>(tree: &T) -> Vec<usize> {
    let (top, root) = tree.top();
    let mut nodes = vec![root];
    for level in (1..=top).rev() {
        let children = |&node: &usize| {
            let first = tree.behind(level, node).0;
            let begins = tree.times(node)[0];
            (0..LANES).filter(move |&lane| begins[lane] < f64::INFINITY).map(move |lane| first + lane)
        };
        nodes = nodes.iter().flat_map(children).collect();
    }
    nodes
}

fn magnitude<T: Boxed>(tree: &T) -> f64 {
    let root = tree.top().1;
    let begins = tree.times(root)[0];
    let keys = [0.0, 1.0].map(|phase| tree.faces(root, &[phase; LANES]));
    let rows = keys.iter().flatten().flatten();
    let there = |row: &Lanes<f64>| {
        let lanes = (0..LANES).filter(|&lane| begins[lane] < f64::INFINITY);
        lanes.fold(0.0f64, |most, lane| most.max(row[lane].abs()))
    };
    rows.map(there).fold(0.0, f64::max)
}

/// A search for all encounters of a set with itself.
pub(super) struct Sweep<'a> {
    tree: &'a PointTree,
    parts: Vec<Part<'a>>,
    /// Part and bottom node of each group.
    groups: Vec<(usize, usize)>,
    times: [f64; 2],
    radius: f64,
    /// Pairs that are nearer than this at the first time are passed over.
    known: Option<f64>,
    /// Whether each point and each encounter comes up once.
    once: bool,
}

/// Groups that one thread does in a row.
const SHARE: usize = 8;

impl<'a> Sweep<'a> {
    /// Between two times of the shutter; where a segment between keys is given, in that one only.
    pub(super) fn new(tree: &'a PointTree, times: [f32; 2], radius: f32, segment: Option<usize>) -> Sweep<'a> {
        let (mut parts, mut once) = (Vec::new(), true);
        for layer in &tree.layers {
            let before = parts.len();
            match layer {
                Layer::Still(tree) => parts.push(Part { tree: Tree::Still(tree), times }),
                // See `PointTree::boxed`.
                Layer::Planes(_) => {}
                Layer::Moving(trees) => {
                    for tree in trees.iter().filter(|tree| segment.is_none_or(|s| s == tree.part().segment)) {
                        let interval = tree.part().interval;
                        let times = [times[0].max(interval.begin()), times[1].min(interval.end())];
                        if times[0] <= times[1] {
                            parts.push(Part { tree: Tree::Moving(tree), times });
                            once &= !tree.timed();
                        }
                    }
                }
            }
            once &= parts.len() <= before + 1;
        }
        let nodes = |(number, part): (usize, &Part)| part.bottom_nodes().into_iter().map(move |node| (number, node));
        let groups = parts.iter().enumerate().flat_map(nodes).collect();
        Sweep { tree, parts, groups, times: times.map(f64::from), radius: radius.into(), known: None, once }
    }

    /// Widens the radius by what the positions, distances and bounds of queries at a time, which are computed in f32,
    /// may differ from exact ones.
    ///
    /// With u = 2^-24, M the largest coordinate and n segments between keys, the place between the keys is rounded by
    /// nu, which moves a point by 2Mnu; interpolation adds 4Mu, the difference of two points 2Mu; the square and its
    /// comparison with the rounded square of the radius are wrong by 4u of themselves. Along three axes, and for both
    /// points, that is below (4n + 10)·1.8Mu + 4ur.
    pub(super) fn allow_for_rounding(mut self) -> Sweep<'a> {
        self.radius += self.rounding(self.radius);
        self
    }

    /// Passes over pairs that lists at the first time with this radius hold for certain. Positions are rounded both there
    /// and here, so what is allowed for rounding counts twice.
    pub(super) fn pass_over_lists_of(mut self, radius: f32) -> Sweep<'a> {
        let radius = f64::from(radius);
        self.known = Some(radius - 2.0 * self.rounding(radius));
        self
    }

    /// See [`Sweep::allow_for_rounding`].
    fn rounding(&self, radius: f64) -> f64 {
        let segments = self.parts.iter().filter_map(Part::segment).map(|(keys, _)| keys.max(2) - 1).max().unwrap_or(1);
        let magnitude = self.parts.iter().map(Part::magnitude).fold(0.0, f64::max);
        ((8 * segments + 20) as f64 * magnitude + 8.0 * radius) / 16_777_216.0 + 1e-18
    }

    /// Calls `visit` for each point, and after it for each of its encounters, with memory of its own for each share of
    /// the points; that of all shares, in an order that is always the same.
    pub(super) fn run<R: Send>(
        &self,
        start: impl Fn() -> R + Sync,
        visit: impl Fn(&mut R, &Flight, Option<(&Others, usize, Encounter)>) + Sync,
    ) -> Vec<R> {
        parallel::map(self.groups.len().div_ceil(SHARE), |share| {
            let groups = &self.groups[share * SHARE..self.groups.len().min((share + 1) * SHARE)];
            let mut result = start();
            dispatch(self.tree.simd, Share { sweep: self, groups, result: &mut result, visit: &visit });
            result
        })
    }

    /// The times at which points of two parts are looked at; `None` where they lie in different segments or parts of
    /// the shutter.
    fn window(&self, a: &Part, b: &Part) -> Option<Window> {
        let (keys, segment) = match (a.segment(), b.segment()) {
            (Some(a), Some(b)) if a != b => return None,
            (Some(both), _) | (_, Some(both)) => both,
            (None, None) => (1, 0),
        };
        let apart = a.times[1] < b.times[0] || b.times[1] < a.times[0];
        (!apart).then(|| Window::of_segment(keys, segment, self.times))
    }
}

/// A share of the groups.
struct Share<'a, R, F> {
    sweep: &'a Sweep<'a>,
    groups: &'a [(usize, usize)],
    result: &'a mut R,
    visit: &'a F,
}

impl<R, F: Fn(&mut R, &Flight, Option<(&Others, usize, Encounter)>)> Kernel for Share<'_, R, F> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (mut partners, mut memory) = (Partners::default(), Memory::default());
        let Share { sweep, groups, result, visit } = self;
        for &(number, node) in groups {
            let part = &sweep.parts[number];
            let group = match part.tree {
                Tree::Still(tree) => Group::new(tree, node, part.times),
                Tree::Moving(tree) => Group::new(tree, node, part.times),
            };
            let first_time = part.times[0];
            // What is looked at from a later time on is not where it was at the first.
            let known = sweep.known.filter(|_| f64::from(first_time) == sweep.times[0]);
            partners.clear();
            for other in &sweep.parts {
                let Some(window) = sweep.window(part, other) else { continue };
                match other.tree {
                    Tree::Still(tree) => partners.add(s, tree, &group, window, (sweep.radius, known)),
                    Tree::Moving(tree) => partners.add(s, tree, &group, window, (sweep.radius, known)),
                }
            }
            for block in &group.blocks {
                for lane in 0..LANES {
                    let Some(own) = &block.flight(lane) else { continue };
                    visit(result, own, None);
                    partners.meet(
                        s,
                        (block, lane, own),
                        (sweep.radius, first_time),
                        &mut memory,
                        |others, i, encounter| {
                            visit(result, own, Some((others, i, encounter)));
                        },
                    );
                }
            }
        }
    }
}
