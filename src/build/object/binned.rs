//! The binary tree of object splits.
//!
//! References are parted at one of the planes between bins of their mid-time centroids (Wald, "On fast
//! Construction of SAH-based Bounding Volume Hierarchies", 2007). The surface area of a moving box
//! is its exact mean over the interval. Below a depth that sane input never reaches, halves by count
//! take over, so that the depth is bounded whatever the input is.

use super::bins::{FindSplit, Parted, Partition, Summary, Table};
use super::reference::Reference;
use super::spatial::{Ends, apply_cut, find_cut};
use crate::motion::{Box3, LinearBox3};
use crate::simd::{LANES, SimdLevel, dispatch, huge_vec};
use glam::Vec3;

/// A node of the binary tree, in preorder: the left child follows its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BinaryNode {
    /// Linear bounds of all below.
    pub bounds: LinearBox3,
    /// First reference below, in the order that the build leaves.
    pub first: u32,
    /// Number of references below.
    pub count: u32,
    /// Distance to the right child; 0 for a leaf.
    pub right: u32,
    /// Whether anything below moves.
    pub moving: bool,
}

/// A finished binary tree; node 0 is the root. Empty without references.
pub(crate) type BinaryTree = Vec<BinaryNode>;

/// Depth from which on references are halved by count.
const SAH_DEPTH: u32 = 44;

/// References below which a subtree is built by one thread. Above it, finished subtrees are copied together,
/// so it also grows with the whole.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 4096;

/// Mean over the interval of half the surface area of a linearly changing box.
///
/// With h(d) = xy + yz + zx the integrand is quadratic in time, so the mean is exact:
/// (h(d0) + h(d1) + h(d0 + d1)) / 6.
#[inline(always)]
pub(crate) fn mean_half_area(b: &LinearBox3) -> f32 {
    let h = |d: Vec3| d.x * d.y + d.y * d.z + d.z * d.x;
    let d0 = (b.begin.max - b.begin.min).max(Vec3::ZERO);
    let d1 = (b.end.max - b.end.min).max(Vec3::ZERO);
    (h(d0) + h(d1) + h(d0 + d1)) * (1.0 / 6.0)
}

/// Builds over the first `n` of `slots`, which are reordered. Nodes of at most `leaf` references are not
/// split on. The slots behind the first `n` are room for duplicates, shared out among subtrees by rule;
/// `ends` gives the corners of what may be cut.
pub(crate) fn build_binary(
    slots: &mut [Reference],
    n: usize,
    leaf: usize,
    ends: &(impl Fn(u32) -> Option<Ends> + Sync),
) -> BinaryTree {
    let mut nodes = huge_vec(2 * slots.len() / leaf.max(1) + 1);
    if n > 0 {
        let simd = SimdLevel::best();
        let (bounds, centres) = dispatch(simd, Summary(&slots[..n]));
        #[cfg(feature = "rayon")]
        let alone = match rayon::current_num_threads() {
            1 => usize::MAX,
            threads => PARALLEL.max(n / (8 * threads)),
        };
        let builder = Builder {
            simd,
            leaf: leaf.max(1),
            least_overlap: LEAST_OVERLAP * mean_half_area(&bounds),
            ends,
            #[cfg(feature = "rayon")]
            alone,
        };
        let root = Task { n, first: 0, depth: 0, bounds, centres };
        builder.subtree(slots, root, &mut nodes, &mut Table::new());
    }
    nodes
}

/// Reorders references by object splits until at most `most` neighbours stand around place `at`, and returns
/// them: a sample of what the tree over all will have in one place.
pub(crate) fn isolate(mut references: &mut [Reference], mut at: usize, most: usize) -> &mut [Reference] {
    let simd = SimdLevel::best();
    let mut table = Table::new();
    let (_, mut centres) = dispatch(simd, Summary(references));
    while references.len() > most.max(1) {
        let Some(split) = dispatch(simd, FindSplit { references, centres, table: &mut table }) else { break };
        let Parted { middle, low, high } = dispatch(simd, Partition { references, split: &split });
        let sides = references.split_at_mut(middle);
        (references, centres, at) = if at < middle { (sides.0, low, at) } else { (sides.1, high, at - middle) };
    }
    references
}

/// Spatial splits are looked for where the two sides of the object split share more than this part of the
/// root's area.
const LEAST_OVERLAP: f32 = 1e-5;

struct Builder<'a, E> {
    simd: SimdLevel,
    leaf: usize,
    least_overlap: f32,
    ends: &'a E,
    /// Up to this many references a subtree is built by one thread. It never changes the tree.
    #[cfg(feature = "rayon")]
    alone: usize,
}

/// A subtree to be built, over the first `n` slots it is given.
#[derive(Clone, Copy)]
struct Task {
    n: usize,
    /// Where its slots begin.
    first: u32,
    depth: u32,
    bounds: LinearBox3,
    /// The box of the references' centres.
    centres: Box3,
}

/// What the two sides of a node are.
struct Division {
    low: Side,
    high: Side,
    /// The slot where the high side begins.
    room: usize,
}

struct Side {
    n: usize,
    bounds: LinearBox3,
    centres: Box3,
}

impl<E: Fn(u32) -> Option<Ends> + Sync> Builder<'_, E> {
    /// Returns whether anything in the subtree moves.
    fn subtree(&self, slots: &mut [Reference], task: Task, nodes: &mut BinaryTree, table: &mut Table) -> bool {
        let at = nodes.len();
        let Task { n, first, depth, bounds, .. } = task;
        nodes.push(BinaryNode { bounds, first, count: n as u32, right: 0, moving: false });
        if n <= self.leaf {
            let moving = slots[..n].iter().any(Reference::moving);
            nodes[at].moving = moving;
            return moving;
        }
        // What may become one leaf block stays together: no room in between, no cuts.
        let slots = if n <= LANES { &mut slots[..n] } else { slots };
        let Division { low, high, room } = self.divide(slots, &task, table);
        let (low_slots, high_slots) = slots.split_at_mut(room);
        let child =
            |s: Side, first: u32| Task { n: s.n, first, depth: depth + 1, bounds: s.bounds, centres: s.centres };
        let (low, high) = (child(low, first), child(high, first + room as u32));
        let (left, right);
        #[cfg(feature = "rayon")]
        if n > self.alone {
            let mut apart = Vec::new();
            (left, right) = rayon::join(
                || self.subtree(low_slots, low, nodes, table),
                || self.subtree(high_slots, high, &mut apart, &mut Table::new()),
            );
            nodes[at].right = (nodes.len() - at) as u32;
            nodes[at].moving = left | right;
            nodes.extend(apart);
            return left | right;
        }
        left = self.subtree(low_slots, low, nodes, table);
        nodes[at].right = (nodes.len() - at) as u32;
        right = self.subtree(high_slots, high, nodes, table);
        nodes[at].moving = left | right;
        left | right
    }

    /// Parts the references of a node.
    fn divide(&self, slots: &mut [Reference], task: &Task, table: &mut Table) -> Division {
        let n = task.n;
        let spare = slots.len() - n;
        let best = if task.depth < SAH_DEPTH {
            dispatch(self.simd, FindSplit { references: &slots[..n], centres: task.centres, table })
        } else {
            None
        };
        let Some(best) = best else {
            return self.halve(slots, n / 2, n);
        };
        if spare > 0 && best.overlap() > self.least_overlap {
            let cut = find_cut(&slots[..n], &task.bounds, self.ends, best.cost, spare);
            if let Some(cut) = cut {
                let (low, high) = apply_cut(&slots[..n], &cut, self.ends);
                // A part that turned out empty leaves its side smaller than counted, never larger.
                if !low.is_empty() && !high.is_empty() && low.len() + high.len() <= slots.len() {
                    slots[..low.len()].copy_from_slice(&low);
                    slots[low.len()..low.len() + high.len()].copy_from_slice(&high);
                    return self.halve(slots, low.len(), low.len() + high.len());
                }
            }
        }
        let Parted { middle, low, high } = dispatch(self.simd, Partition { references: &mut slots[..n], split: &best });
        Division {
            low: Side { n: middle, bounds: best.low, centres: low },
            high: Side { n: n - middle, bounds: best.high, centres: high },
            room: spread(slots, middle, n),
        }
    }

    /// Parts `n` references at one of them.
    fn halve(&self, slots: &mut [Reference], middle: usize, n: usize) -> Division {
        let side = |references: &[Reference]| {
            let (bounds, centres) = dispatch(self.simd, Summary(references));
            Side { n: references.len(), bounds, centres }
        };
        let (low, high) = (side(&slots[..middle]), side(&slots[middle..n]));
        Division { low, high, room: spread(slots, middle, n) }
    }
}

/// Shares the unused slots out in proportion to the references, and moves the high side to its slots.
fn spread(slots: &mut [Reference], middle: usize, n: usize) -> usize {
    let spare = slots.len() - n;
    let room = middle + (spare as u64 * middle as u64 / n as u64) as usize;
    if room > middle {
        slots.copy_within(middle..n, room);
    }
    room
}
