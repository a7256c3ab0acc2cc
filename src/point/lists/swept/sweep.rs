//! The search for all encounters of a set with itself during an interval.

use super::encounter::{Question, Visitor, Window};
use super::flights::{Group, Partners};
use super::near::Near;
use crate::parallel;
use crate::point::moving_tree::MovingTree;
use crate::point::over_interval::{Boxed, InRows};
use crate::point::partition::Layer;
use crate::point::static_tree::StaticTree;
use crate::point::tree::PointTree;
use crate::simd::{Kernel, LANES, Lanes, Simd, dispatch};

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

    /// Whether some points do not live throughout.
    fn mortal(&self) -> bool {
        match self.tree {
            Tree::Still(tree) => tree.mortal(),
            Tree::Moving(tree) => tree.mortal(),
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
    pub(super) once: bool,
    /// Whether some points do not live throughout.
    mortal: bool,
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
        let mortal = parts.iter().any(Part::mortal);
        Sweep { tree, parts, groups, times: times.map(f64::from), radius: radius.into(), known: None, once, mortal }
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

    /// Has visitors that pass over pairs pass over those that lists at the first time with this radius hold for certain. Positions are rounded both there
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

    /// Shows all points and their encounters to visitors, one for each share of the points, whose order is always the
    /// same.
    pub(super) fn run<V: Visitor + Send>(&self, start: impl Fn() -> V + Sync) -> Vec<V> {
        parallel::map(self.groups.len().div_ceil(SHARE), |share| {
            let groups = &self.groups[share * SHARE..self.groups.len().min((share + 1) * SHARE)];
            let mut visitor = start();
            dispatch(self.tree.simd, Share { sweep: self, groups, visitor: &mut visitor });
            visitor
        })
    }

    /// Shows them all to one visitor, in the same order.
    pub(super) fn run_alone<V: Visitor>(&self, visitor: &mut V) {
        dispatch(self.tree.simd, Share { sweep: self, groups: &self.groups, visitor });
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
struct Share<'a, V> {
    sweep: &'a Sweep<'a>,
    groups: &'a [(usize, usize)],
    visitor: &'a mut V,
}

impl<V: Visitor> Kernel for Share<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (mut group, mut partners, mut near) = (Group::default(), Partners::default(), Near::default());
        let Share { sweep, groups, visitor } = self;
        for &(number, node) in groups {
            let part = &sweep.parts[number];
            match part.tree {
                Tree::Still(tree) => group.take(tree, node, part.times),
                Tree::Moving(tree) => group.take(tree, node, part.times),
            }
            let first_time = part.times[0];
            // What is looked at from a later time on is not where it was at the first.
            let known = sweep.known.filter(|_| f64::from(first_time) == sweep.times[0]);
            let question = Question { radius: sweep.radius, first_time, mortal: sweep.mortal };
            partners.clear();
            for other in &sweep.parts {
                let Some(window) = sweep.window(part, other) else { continue };
                match other.tree {
                    Tree::Still(tree) => partners.add(s, tree, &group, window, (&question, known)),
                    Tree::Moving(tree) => partners.add(s, tree, &group, window, (&question, known)),
                }
            }
            for block in &group.blocks {
                near.visit(s, (block, &partners), &question, visitor);
            }
        }
    }
}
