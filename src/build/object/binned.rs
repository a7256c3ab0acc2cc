//! The binary tree of object splits.
//!
//! References are parted at one of 31 planes per axis between bins of their mid-time centroids (Wald, "On
//! fast Construction of SAH-based Bounding Volume Hierarchies", 2007). The surface area of a moving box
//! is its exact mean over the interval. Below a depth that sane input never reaches, halves by count
//! take over, so that the depth is bounded whatever the input is.

use crate::motion::{Box3, LinearBox3};
use glam::Vec3;

/// One entry of a primitive in the tree being built: where it is during the build's time interval.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    /// Linear bounds over the interval.
    pub bounds: LinearBox3,
    /// The primitive, or what else the caller builds over.
    pub id: u32,
    /// Whether it moves within the interval.
    pub moving: bool,
}

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

/// Bins per axis, and where there are few references.
const BINS: usize = 32;
const FEW_BINS: usize = 16;
const FEW: usize = 64;

/// Depth from which on references are halved by count.
const SAH_DEPTH: u32 = 44;

/// References below which a subtree is built by one thread.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 8192;

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

/// Sum of the box corners at both ends: four times the mid-time centre.
#[inline(always)]
fn centre(b: &LinearBox3) -> Vec3 {
    (b.begin.min + b.end.max) + (b.begin.max + b.end.min)
}

/// Builds over `references`, which are reordered; `leaf` is the largest count that is not split on.
pub(crate) fn build_binary(references: &mut [Reference], leaf: usize) -> BinaryTree {
    let mut nodes = Vec::with_capacity(2 * references.len() / leaf.max(1) + 1);
    if !references.is_empty() {
        subtree(references, 0, leaf.max(1), 0, &mut nodes);
    }
    nodes
}

fn subtree(references: &mut [Reference], first: u32, leaf: usize, depth: u32, nodes: &mut BinaryTree) {
    let at = nodes.len();
    let (bounds, centres, moving) = summary(references);
    nodes.push(BinaryNode { bounds, first, count: references.len() as u32, right: 0, moving });
    if references.len() <= leaf {
        return;
    }
    let middle = if depth < SAH_DEPTH { split(references, centres) } else { halve(references) };
    let (low, high) = references.split_at_mut(middle);
    let high_first = first + middle as u32;
    #[cfg(feature = "rayon")]
    if low.len() + high.len() > PARALLEL {
        let (left, right) = rayon::join(
            || {
                let mut nodes = Vec::new();
                subtree(low, first, leaf, depth + 1, &mut nodes);
                nodes
            },
            || {
                let mut nodes = Vec::new();
                subtree(high, high_first, leaf, depth + 1, &mut nodes);
                nodes
            },
        );
        nodes[at].right = 1 + left.len() as u32;
        nodes.extend(left);
        nodes.extend(right);
        return;
    }
    subtree(low, first, leaf, depth + 1, nodes);
    nodes[at].right = (nodes.len() - at) as u32;
    subtree(high, high_first, leaf, depth + 1, nodes);
}

fn summary(references: &[Reference]) -> (LinearBox3, Box3, bool) {
    let mut bounds = LinearBox3::EMPTY;
    let mut centres = Box3::EMPTY;
    let mut moving = false;
    for r in references {
        bounds = bounds.union(r.bounds);
        centres = centres.include(centre(&r.bounds));
        moving |= r.moving;
    }
    (bounds, centres, moving)
}

/// Halves by count along the order that is there.
fn halve(references: &mut [Reference]) -> usize {
    references.len() / 2
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: LinearBox3,
    count: u32,
}

/// Maps a centre to a bin; monotone in the coordinate.
#[derive(Clone, Copy)]
struct Binning {
    low: f32,
    scale: f32,
    last: usize,
}

impl Binning {
    #[inline(always)]
    fn bin(self, x: f32) -> usize {
        (((x - self.low) * self.scale) as usize).min(self.last)
    }
}

/// Parts the references where binned SAH finds it cheapest and returns how many are on the low side;
/// halves by count where all centres coincide.
fn split(references: &mut [Reference], centres: Box3) -> usize {
    let bins = if references.len() < FEW { FEW_BINS } else { BINS };
    let extent = centres.max - centres.min;
    let binning = [0, 1, 2].map(|axis| {
        let scale = bins as f32 / extent[axis];
        // A scale that is not finite means a flat axis (or one so thin that it counts as flat).
        Binning { low: centres.min[axis], scale: if scale.is_finite() { scale } else { 0.0 }, last: bins - 1 }
    });
    let empty = Bin { bounds: LinearBox3::EMPTY, count: 0 };
    let mut table = [[empty; BINS]; 3];
    for r in references.iter() {
        let c = centre(&r.bounds);
        for axis in 0..3 {
            let bin = &mut table[axis][binning[axis].bin(c[axis])];
            bin.bounds = bin.bounds.union(r.bounds);
            bin.count += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        if binning[axis].scale == 0.0 {
            continue;
        }
        let row = &table[axis][..bins];
        let mut above = [(0.0, 0); BINS];
        let mut sum = empty;
        for i in (1..bins).rev() {
            sum = Bin { bounds: sum.bounds.union(row[i].bounds), count: sum.count + row[i].count };
            above[i] = (if sum.count > 0 { mean_half_area(&sum.bounds) * sum.count as f32 } else { 0.0 }, sum.count);
        }
        sum = empty;
        for i in 1..bins {
            sum = Bin { bounds: sum.bounds.union(row[i - 1].bounds), count: sum.count + row[i - 1].count };
            if sum.count == 0 || above[i].1 == 0 {
                continue;
            }
            let cost = mean_half_area(&sum.bounds) * sum.count as f32 + above[i].0;
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    let (cost, axis, plane) = best;
    if cost == f32::INFINITY {
        return halve(references);
    }
    let binning = binning[axis];
    partition(references, |r| binning.bin(centre(&r.bounds)[axis]) < plane)
}

/// Moves what satisfies `low` to the front; the order depends on nothing but the input.
fn partition(references: &mut [Reference], low: impl Fn(&Reference) -> bool) -> usize {
    let (mut i, mut j) = (0, references.len());
    loop {
        while i < j && low(&references[i]) {
            i += 1;
        }
        while i < j && !low(&references[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        references.swap(i, j - 1);
    }
}
