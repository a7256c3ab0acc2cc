//! Which trees are compared with which, and when.
//!
//! Where the shutter is divided, each part has a tree of its own, and points that are near each other for long are so in
//! several parts. Two trees are compared during the times that both answer for. A pair is told of where its encounter
//! begins: in the part of the one point and the part of the other that hold this time. The begin is computed from the two
//! points alone, so it is the same wherever the pair comes up, and just one comparison tells of it.
//!
//! **Why none is lost.** Let an encounter begin at the computed time x, which both lives hold. Each point has a reference in
//! the part of its layer that holds x, so these parts are compared at x. The part that begins where the times looked at end is
//! looked at only if a life begins there, in any layer, or if it is a key whose exact time lies before: all other points are in
//! the part before, too, which tells of all later encounters if it is the last. The exact begin differs from x by at most 2^-25 of the
//! time that both exist: it comes from the root of a difference of f64 products. So at x the two are within the radius or farther by no more
//! than 2^-25 of their relative motion, one of the 64 units of slack in [`super`]. At keys, whose times f32 rounds, the
//! first and the last part of a segment tell of all that is beyond them, and ranges of times are widened by more than that.

use crate::point::moving_reference;
use crate::point::moving_tree::MovingTree;
use crate::point::over_interval::{Boxed, InRows};
use crate::point::partition::Layer;
use crate::point::static_tree::StaticTree;
use crate::simd::{LANES, Lanes};
use core::ops::Range;

/// A tree for a part of the shutter.
#[derive(Clone, Copy)]
pub(super) enum Tree<'a> {
    Still(&'a StaticTree),
    Moving(&'a MovingTree),
}

/// A tree and the times that it is looked at.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) tree: Tree<'a>,
    pub(super) times: [f32; 2],
    /// Encounters that begin from the first of these times to before the second are those of the part.
    pub(super) owns: [f64; 2],
}

/// What begins at any time.
const ALWAYS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// A part whose points are compared with those of others, all during the same times.
pub(super) struct Pairing {
    pub(super) own: usize,
    pub(super) others: Vec<usize>,
    pub(super) times: [f32; 2],
}

impl Part<'_> {
    /// Number of keys and segment where anything moves.
    pub(super) fn segment(&self) -> Option<(usize, usize)> {
        match self.tree {
            Tree::Still(_) => None,
            Tree::Moving(tree) => Some((tree.part().keys, tree.part().segment)),
        }
    }

    /// The largest magnitude of a coordinate at either key of the segment, or somewhat more.
    pub(super) fn magnitude(&self) -> f64 {
        match self.tree {
            Tree::Still(tree) => magnitude(tree),
            Tree::Moving(tree) => magnitude(tree),
        }
    }

    /// Whether some points do not live throughout.
    pub(super) fn mortal(&self) -> bool {
        match self.tree {
            Tree::Still(tree) => tree.mortal(),
            Tree::Moving(tree) => tree.mortal(),
        }
    }

    /// Whether some points do not count throughout.
    pub(super) fn timed(&self) -> bool {
        matches!(self.tree, Tree::Moving(tree) if tree.timed())
    }

    /// Whether the part of the shutter holds a time, or the segment between keys that ends with it does.
    fn holds(&self, time: f32) -> bool {
        match self.tree {
            Tree::Still(_) => true,
            Tree::Moving(tree) => tree.part().interval.contains(time) || beside_key(tree.part(), time),
        }
    }

    /// The bottom nodes.
    pub(super) fn bottom_nodes(&self) -> Vec<usize> {
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

/// Whether a life begins just where a part of the shutter does.
pub(super) fn begins_with_a_part(layers: &[Layer], time: f32) -> bool {
    let begins = |tree: &MovingTree| tree.part().interval.begin() == time && tree.leaves.begins_at(time);
    layers.iter().any(|layer| matches!(layer, Layer::Moving(trees) if trees.iter().any(begins)))
}

/// Whether a time that f32 rounds to the begin or the end of a part, which is a key, lies within the segment in truth: the part
/// begins after the key, or ends before it.
fn beside_key(part: &moving_reference::Part, time: f32) -> bool {
    let begins = part.phases[0] == 0.0 && time == part.interval.begin();
    let ends = part.phases[1] == 1.0 && time == part.interval.end();
    let along = f64::from(time) * (part.keys.max(2) - 1) as f64 - part.segment as f64;
    (begins || ends) && 0.0 < along && along < 1.0
}

/// The parts of a layer that are looked at between two times, in one segment between keys where that is given; the last of
/// the times counts in the part that it begins only where a life does too, see [`begins_with_a_part`], or the exact key lies before
/// it, and the first in the part that it ends only where the exact key lies behind it.
pub(super) fn parts_of<'a>(layer: &'a Layer, times: [f32; 2], begins: bool, segment: Option<usize>) -> Vec<Part<'a>> {
    let trees = match layer {
        Layer::Still(tree) => return vec![Part { tree: Tree::Still(tree), times, owns: ALWAYS }],
        // See `PointTree::boxed`.
        Layer::Planes(_) => return Vec::new(),
        Layer::Moving(trees) => trees.iter().filter(|tree| segment.is_none_or(|s| s == tree.part().segment)),
    };
    let part = |tree: &'a MovingTree| {
        let interval = tree.part().interval;
        let owns = [interval.begin(), interval.end_bound()].map(f64::from);
        let both = [times[0].max(interval.begin()), times[1].min(interval.end())];
        let last = both[0] == times[1] && times[0] < times[1];
        let more_than_an_end = times[0] < interval.end_bound() && (begins || !last);
        let looked_at = both[0] <= both[1] && (more_than_an_end || beside_key(tree.part(), both[0]));
        looked_at.then_some(Part { tree: Tree::Moving(tree), times: both, owns })
    };
    let mut parts: Vec<Part> = trees.filter_map(part).collect();
    // Times at keys are rounded, and the part beside may not be looked at.
    for of_segment in parts.chunk_by_mut(|a, b| a.segment() == b.segment()) {
        let last = of_segment.len() - 1;
        of_segment[0].owns[0] = ALWAYS[0];
        of_segment[last].owns[1] = ALWAYS[1];
    }
    parts
}

/// Which parts are compared when; each layer has a range of them, in the order of time.
pub(super) fn pairings(parts: &[Part], layers: &[Range<usize>], times: [f32; 2]) -> Vec<Pairing> {
    let mut pairings: Vec<Pairing> = Vec::new();
    for (own, part) in parts.iter().enumerate() {
        let begin = pairings.len();
        for layer in layers {
            let before = parts[layer.clone()].partition_point(|other| other.times[1] < part.times[0]);
            for (number, other) in parts.iter().enumerate().take(layer.end).skip(layer.start + before) {
                let both = [part.times[0].max(other.times[0]), part.times[1].min(other.times[1])];
                if both[0] > both[1] {
                    break;
                }
                // A part does not hold its end.
                if both[0] == both[1] && both[0] < times[1] && !(part.holds(both[0]) && other.holds(both[0])) {
                    continue;
                }
                if matches!((part.segment(), other.segment()), (Some(a), Some(b)) if a != b) {
                    continue;
                }
                match pairings[begin..].iter_mut().find(|pairing| pairing.times == both) {
                    Some(pairing) => pairing.others.push(number),
                    None => pairings.push(Pairing { own, others: vec![number], times: both }),
                }
            }
        }
    }
    pairings
}
