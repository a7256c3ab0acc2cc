//! The binary tree of object splits.
//!
//! References are partitioned at one of the planes between bins of their mid-time centroids (Wald, "On fast
//! Construction of SAH-based Bounding Volume Hierarchies", 2007). The surface area of a moving box is its exact mean
//! over the interval. Below a depth that sane input never reaches, nodes are halved by count, so that the depth is
//! bounded for any input.

use super::binning::{Table, find_split, summary};
use super::partition::partition;
use super::reference::Reference;
use super::visits::{SurfaceDensity, mean_half_area};
use crate::geometry::{Box3, LinearBox3};
use crate::parallel;
use crate::progress::Progress;
use crate::simd::{concat, huge_vec};
use crate::tuning::wide::{LARGE_LEAF, MANY_BOXES, MIN_OVERLAP};
use core::ops::RangeInclusive;

/// A node of the binary tree, in preorder: the left child follows its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BinaryNode {
    /// Linear bounds of all references below.
    pub bounds: LinearBox3,
    /// The first reference below, in the order that the build leaves.
    pub first: u32,
    /// Number of references below.
    pub count: u32,
    /// Distance to the right child; 0 for a leaf.
    pub right: u32,
    /// Whether any reference below moves.
    pub moving: bool,
}

impl BinaryNode {
    /// A node over this many references, with no flags set yet.
    fn new(task: &Task, count: usize) -> BinaryNode {
        BinaryNode { bounds: task.bounds, first: task.first, count: count as u32, right: 0, moving: false }
    }
}

/// A finished binary tree; node 0 is the root. Empty without references.
pub(crate) type BinaryTree = Vec<BinaryNode>;

/// Separates primitives that cannot share a leaf block: all primitives of a leaf have the same kind.
pub(crate) type LeafKind<'a> = dyn Fn(u32) -> u32 + Sync + 'a;

/// Below this depth references are halved by count.
const SAH_DEPTH: u32 = 44;

/// Subtrees of at most this many references (or more if the tree is large for the number of threads) are built by one
/// thread.
const PARALLEL: usize = 4096;
const SUBTREES: usize = 32;

/// Smaller subtrees do not report their progress. Not fitted: building one takes about a millisecond.
const REPORTED: usize = 4096;

/// Builds over references, which are reordered. Nodes of at most `leaf.start` references become leaves, and those of at
/// most `leaf.end` if they overlap so much that splitting hardly pays (see [`MIN_OVERLAP`]). With a `density`, which
/// predicts how often boxes are visited, the largest of such nodes are split further (see [`LARGE_LEAF`]). Leaves hold
/// references of one kind. Once `progress` is cancelled, large nodes become leaves, whatever they hold.
pub(crate) fn build_binary(
    references: &mut [Reference],
    leaf: RangeInclusive<usize>,
    kinds: Option<&LeafKind<'_>>,
    density: Option<SurfaceDensity>,
    progress: &Progress,
) -> BinaryTree {
    let n = references.len();
    if n == 0 {
        return BinaryTree::new();
    }
    let (bounds, centres) = summary(references);
    let alone = match parallel::threads() {
        1 => usize::MAX,
        threads => PARALLEL.max(n / (SUBTREES * threads)),
    };
    // A single reference far away makes the root box large, but not the sum over references.
    let (small, bent) = (*leaf.start().max(&1), kinds.is_some());
    let large = density.map(|density| (density, large_visits(density, &bounds, references, small, bent)));
    let builder = Builder { leaf: small, overlapping_leaf: *leaf.end(), large, alone, kinds, progress };
    let task = Task { first: 0, depth: 0, overlapping: false, bounds, centres, share: 1.0 };
    let mut subtrees = builder.subtrees(references, task);
    match subtrees.len() {
        1 => subtrees.remove(0),
        _ => concat(&subtrees),
    }
}

/// The number of visits, as an area, above which a leaf counts as large; of few references every leaf is visited by many rays, so
/// it must be visited more often than `leaf` references are by themselves. The boxes of bent motion are large for its bends, which
/// time slices may divide, so they do not tell how many primitives rays meet.
fn large_visits(
    density: SurfaceDensity,
    bounds: &LinearBox3,
    references: &[Reference],
    leaf: usize,
    bent: bool,
) -> f32 {
    let all = density.visits_of_all(references);
    let entering = density.visits(bounds).min(all);
    if bent {
        return LARGE_LEAF * entering;
    }
    (LARGE_LEAF * entering.max(all / MANY_BOXES)).max(all * leaf as f32 / references.len() as f32)
}

/// Capacity for the nodes over this many references: leaves are about half full, and with one reference each there are
/// 2 n - 1 nodes.
fn most_nodes(references: usize, leaf: usize) -> usize {
    4 * references / (leaf.max(1) + 1) + 1
}

struct Builder<'a> {
    leaf: usize,
    overlapping_leaf: usize,
    /// The number of visits above which a leaf counts as large, and the density that predicts them; `None` if no leaf
    /// does.
    large: Option<(SurfaceDensity, f32)>,
    /// Subtrees of at most this many references are built by one thread. Does not change the tree.
    alone: usize,
    /// The kinds, if leaves may only hold references of one kind.
    kinds: Option<&'a LeafKind<'a>>,
    progress: &'a Progress<'a>,
}

/// A subtree to be built.
#[derive(Clone, Copy)]
struct Task {
    /// The index of its first reference.
    first: u32,
    depth: u32,
    /// Whether the split that made it gained little.
    overlapping: bool,
    bounds: LinearBox3,
    /// The box of the references' centres.
    centres: Box3,
    /// The fraction of the whole work, for progress.
    share: f64,
}

impl Builder<'_> {
    /// A node and the subtrees below it, to be concatenated.
    fn subtrees(&self, references: &mut [Reference], task: Task) -> Vec<BinaryTree> {
        let n = references.len();
        if n <= self.alone.max(self.leaf) {
            let mut nodes = huge_vec(most_nodes(n, self.leaf));
            Table::lend(|table| self.subtree(references, task, &mut nodes, table));
            return vec![nodes];
        }
        if self.progress.cancelled() {
            return vec![vec![BinaryNode::new(&task, n)]];
        }
        let (low, high, middle) = Table::lend(|table| self.divide(references, &task, table));
        let (low, high) = self.shared(&task, n, (low, high), middle);
        let (low_references, high_references) = references.split_at_mut(middle);
        let (left, right) =
            parallel::both(|| self.subtrees(low_references, low), || self.subtrees(high_references, high));
        let mut node = BinaryNode::new(&task, n);
        node.right = 1 + left.iter().map(Vec::len).sum::<usize>() as u32;
        node.moving = left[0][0].moving | right[0][0].moving;
        let mut subtrees = vec![vec![node]];
        subtrees.extend(left);
        subtrees.extend(right);
        subtrees
    }

    /// Builds a subtree on this thread. Returns whether any reference in it moves.
    fn subtree(&self, references: &mut [Reference], task: Task, nodes: &mut BinaryTree, table: &mut Table) -> bool {
        let (at, n) = (nodes.len(), references.len());
        nodes.push(BinaryNode::new(&task, n));
        let reports = n > REPORTED;
        if reports && self.progress.cancelled() {
            return false;
        }
        let few = n <= self.leaf || task.overlapping && n <= self.overlapping_leaf;
        let sides = if few && (n == 1 || !self.is_large(&task.bounds)) {
            let middle = self.kinds.and_then(|kind| by_kind(references, kind));
            middle.map(|middle| self.split_at(references, &task, middle))
        } else {
            Some(self.divide(references, &task, table))
        };
        let Some((low, high, middle)) = sides else {
            let moving = references.iter().any(Reference::moving);
            nodes[at].moving = moving;
            return moving;
        };
        let (low, high) = if reports { self.shared(&task, n, (low, high), middle) } else { (low, high) };
        let (low_references, high_references) = references.split_at_mut(middle);
        let left = self.subtree(low_references, low, nodes, table);
        nodes[at].right = (nodes.len() - at) as u32;
        let right = self.subtree(high_references, high, nodes, table);
        nodes[at].moving = left | right;
        left | right
    }

    /// Reports that a node of `n` references is divided, and gives its children their shares of the remaining work: dividing takes
    /// as long on each level. Children that do not report count as finished.
    fn shared(&self, task: &Task, n: usize, sides: (Task, Task), middle: usize) -> (Task, Task) {
        let levels = (n as f64 / self.leaf as f64).log2().max(0.0) + 1.0;
        let below = task.share * (1.0 - 1.0 / levels);
        let (mut reported, mut sides) = (task.share - below, [(sides.0, middle), (sides.1, n - middle)]);
        for (side, count) in &mut sides {
            side.share = below * *count as f64 / n as f64;
            if *count <= REPORTED {
                reported += side.share;
            }
        }
        self.progress.finished(reported);
        (sides[0].0, sides[1].0)
    }

    /// Whether a node of few references is among the largest: over a floor and walls, or over a wall and the objects
    /// before it. Which of its references share a leaf block is then decided by the collapse.
    fn is_large(&self, bounds: &LinearBox3) -> bool {
        self.large.is_some_and(|(density, large)| density.visits(bounds) > large)
    }

    /// Partitions the references of a node; returns both sides and the number on the low side.
    fn divide(&self, references: &mut [Reference], task: &Task, table: &mut Table) -> (Task, Task, usize) {
        let side = |begin: usize, overlapping: bool, bounds: LinearBox3, centres: Box3| Task {
            first: task.first + begin as u32,
            depth: task.depth + 1,
            overlapping,
            bounds,
            centres,
            share: 0.0,
        };
        // Two references can be partitioned in one way only.
        if references.len() > 2
            && task.depth < SAH_DEPTH
            && let Some(split) = find_split(references, task.centres, task.overlapping, table)
        {
            let [low, high] = partition(references, &split);
            let areas = mean_half_area(&split.low) + mean_half_area(&split.high);
            let overlapping = areas >= MIN_OVERLAP * mean_half_area(&task.bounds);
            let (low, high) = (side(0, overlapping, split.low, low), side(split.middle, overlapping, split.high, high));
            return (low, high, split.middle);
        }
        self.split_at(references, task, references.len() / 2)
    }

    /// Splits references at an index without reordering them.
    fn split_at(&self, references: &[Reference], task: &Task, middle: usize) -> (Task, Task, usize) {
        let of = |begin: usize, references: &[Reference]| {
            let (bounds, centres) = summary(references);
            let first = task.first + begin as u32;
            Task { first, depth: task.depth + 1, overlapping: false, bounds, centres, share: 0.0 }
        };
        (of(0, &references[..middle]), of(middle, &references[middle..]), middle)
    }
}

/// Sorts a few references by kind and returns where the first kind ends; `None` if there is only one kind.
fn by_kind(references: &mut [Reference], kind: &LeafKind<'_>) -> Option<usize> {
    let first = kind(references.first()?.id());
    if references.iter().all(|r| kind(r.id()) == first) {
        return None;
    }
    // A stable sort, so that the tree does not depend on the algorithm.
    references.sort_by_key(|r| kind(r.id()));
    let least = kind(references[0].id());
    Some(references.partition_point(|r| kind(r.id()) == least))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::Vec3;

    /// A floor and four walls of two triangles each, and small objects.
    fn room() -> Vec<Reference> {
        let mut references = Vec::new();
        let mut add = |min: Vec3, max: Vec3| {
            let b = Box3 { min, max };
            references.push(Reference::new(LinearBox3 { begin: b, end: b }, references.len() as u32));
        };
        for _ in 0..2 {
            add(Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0));
            add(Vec3::ZERO, Vec3::new(1.0, 0.5, 0.0));
            add(Vec3::ZERO, Vec3::new(0.0, 0.5, 1.0));
            add(Vec3::Z, Vec3::new(1.0, 0.5, 1.0));
            add(Vec3::X, Vec3::new(1.0, 0.5, 1.0));
        }
        let mut random = Random(21);
        for _ in 0..2000 {
            let at = Vec3::new(random.unit(), 0.1, random.unit());
            add(at, at + 0.01);
        }
        references
    }

    #[test]
    fn only_the_largest_leaves_are_split_further() {
        let built = |density: Option<SurfaceDensity>| {
            let mut references = room();
            let nodes = build_binary(&mut references, 8..=16, None, density, &Progress::new(None));
            let leaves: Vec<BinaryNode> = nodes.into_iter().filter(|node| node.right == 0).collect();
            assert_eq!(leaves.iter().map(|leaf| leaf.count).sum::<u32>(), 2010);
            leaves
        };
        let density = SurfaceDensity(8.0);
        let visits = |leaf: &BinaryNode| density.visits(&leaf.bounds);
        let (before, after) = (built(None), built(Some(density)));
        let largest = |leaves: &[BinaryNode]| leaves.iter().map(visits).fold(0.0, f32::max);
        // A leaf of a wall and the floor is as large as the room; the largest single object is the floor.
        assert!(largest(&before) > 2.0 && largest(&after) <= 1.0, "{} {}", largest(&before), largest(&after));
        assert!(after.len() > before.len() && after.len() <= before.len() + 20, "{} {}", before.len(), after.len());
        // No leaf of several references is visited by more than its share of the rays.
        let references = room();
        let most = large_visits(density, &summary(&references).0, &references, 8, false);
        let large = |leaves: &[BinaryNode]| leaves.iter().any(|l| l.count > 1 && visits(l) > most);
        assert!(large(&before) && !large(&after));
    }

    #[test]
    fn leaves_of_few_references_alike_are_not_split_further() {
        // Tiles of a floor.
        let tile = |id: u32| {
            let at = Vec3::new((id % 16) as f32, 0.0, (id / 16) as f32);
            let b = Box3 { min: at, max: at + Vec3::new(1.1, 0.0, 1.1) };
            Reference::new(LinearBox3 { begin: b, end: b }, id)
        };
        let references: Vec<Reference> = (0..128).map(tile).collect();
        let leaves = |density: Option<SurfaceDensity>| {
            let nodes = build_binary(&mut references.clone(), 8..=16, None, density, &Progress::new(None));
            nodes.iter().filter(|node| node.right == 0).count()
        };
        // Each is visited by a sixteenth of the rays.
        assert_eq!(leaves(Some(SurfaceDensity(8.0))), leaves(None));
    }
}
