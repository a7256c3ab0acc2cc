//! The binary tree of object splits.
//!
//! References are parted at one of 31 planes per axis between bins of their mid-time centroids (Wald, "On
//! fast Construction of SAH-based Bounding Volume Hierarchies", 2007). The surface area of a moving box
//! is its exact mean over the interval. Below a depth that sane input never reaches, halves by count
//! take over, so that the depth is bounded whatever the input is.

use super::spatial::{Ends, apply_cut, find_cut};
use crate::motion::{Box3, LinearBox3};
use crate::simd::{LANES, huge_vec};
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

/// References below which a subtree is built by one thread. Above it, finished subtrees are copied together,
/// so it also grows with the whole.
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
        let (bounds, ..) = summary(&slots[..n]);
        let least_overlap = LEAST_OVERLAP * mean_half_area(&bounds);
        #[cfg(feature = "rayon")]
        let alone = match rayon::current_num_threads() {
            1 => usize::MAX,
            threads => PARALLEL.max(n / (8 * threads)),
        };
        let builder = Builder {
            leaf: leaf.max(1),
            least_overlap,
            ends,
            #[cfg(feature = "rayon")]
            alone,
        };
        builder.subtree(slots, n, 0, 0, &mut nodes);
    }
    nodes
}

/// Spatial splits are looked for where the two sides of the object split share more than this part of the
/// root's area.
const LEAST_OVERLAP: f32 = 1e-5;

struct Builder<'a, E> {
    leaf: usize,
    least_overlap: f32,
    ends: &'a E,
    /// Up to this many references a subtree is built by one thread. It never changes the tree.
    #[cfg(feature = "rayon")]
    alone: usize,
}

impl<E: Fn(u32) -> Option<Ends> + Sync> Builder<'_, E> {
    fn subtree(&self, slots: &mut [Reference], n: usize, first: u32, depth: u32, nodes: &mut BinaryTree) {
        let at = nodes.len();
        let (bounds, centres, moving) = summary(&slots[..n]);
        nodes.push(BinaryNode { bounds, first, count: n as u32, right: 0, moving });
        if n <= self.leaf {
            return;
        }
        // What may become one leaf block stays together: no room in between, no cuts.
        let slots = if n <= LANES { &mut slots[..n] } else { slots };
        let (low_n, high_n, room) = self.divide(slots, n, &bounds, centres, depth);
        let (low, high) = slots.split_at_mut(room);
        let high_first = first + room as u32;
        #[cfg(feature = "rayon")]
        if n > self.alone {
            let (left, right) = rayon::join(
                || {
                    let mut nodes = Vec::new();
                    self.subtree(low, low_n, first, depth + 1, &mut nodes);
                    nodes
                },
                || {
                    let mut nodes = Vec::new();
                    self.subtree(high, high_n, high_first, depth + 1, &mut nodes);
                    nodes
                },
            );
            nodes[at].right = 1 + left.len() as u32;
            nodes.extend(left);
            nodes.extend(right);
            return;
        }
        self.subtree(low, low_n, first, depth + 1, nodes);
        nodes[at].right = (nodes.len() - at) as u32;
        self.subtree(high, high_n, high_first, depth + 1, nodes);
    }

    /// Parts the first `n` slots; returns how many references are on each side, and the slot where the
    /// high side begins.
    fn divide(
        &self,
        slots: &mut [Reference],
        n: usize,
        bounds: &LinearBox3,
        centres: Box3,
        depth: u32,
    ) -> (usize, usize, usize) {
        let spare = slots.len() - n;
        let best = if depth < SAH_DEPTH { find_split(&slots[..n], centres) } else { None };
        let Some(best) = best else {
            let middle = n / 2;
            return (middle, n - middle, spread(slots, middle, n));
        };
        if spare > 0 && best.overlap() > self.least_overlap {
            let cut = find_cut(&slots[..n], bounds, self.ends, best.cost, spare);
            if let Some(cut) = cut {
                let (low, high) = apply_cut(&slots[..n], &cut, self.ends);
                // A part that turned out empty leaves its side smaller than counted, never larger.
                if !low.is_empty() && !high.is_empty() && low.len() + high.len() <= slots.len() {
                    slots[..low.len()].copy_from_slice(&low);
                    slots[low.len()..low.len() + high.len()].copy_from_slice(&high);
                    let room = spread(slots, low.len(), low.len() + high.len());
                    return (low.len(), high.len(), room);
                }
            }
        }
        let middle = partition(&mut slots[..n], |r| best.binning.bin(centre(&r.bounds)[best.axis]) < best.plane);
        (middle, n - middle, spread(slots, middle, n))
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

fn summary(references: &[Reference]) -> (LinearBox3, Box3, bool) {
    let mut bounds = Packed::EMPTY;
    let mut centres = Box3::EMPTY;
    let mut moving = false;
    for r in references {
        bounds.include(&Packed::new(&r.bounds));
        centres = centres.include(centre(&r.bounds));
        moving |= r.moving;
    }
    (bounds.bounds(), centres, moving)
}

/// Linear bounds with the upper faces negated, so that a union is twelve minima in a row.
#[derive(Clone, Copy)]
struct Packed([f32; 12]);

impl Packed {
    const EMPTY: Packed = Packed([f32::INFINITY; 12]);

    #[inline(always)]
    fn new(b: &LinearBox3) -> Packed {
        let (low0, low1) = (b.begin.min, b.end.min);
        let (high0, high1) = (-b.begin.max, -b.end.max);
        Packed([low0.x, low0.y, low0.z, high0.x, high0.y, high0.z, low1.x, low1.y, low1.z, high1.x, high1.y, high1.z])
    }

    #[inline(always)]
    fn include(&mut self, other: &Packed) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a = if *b < *a { *b } else { *a };
        }
    }

    #[inline(always)]
    fn bounds(&self) -> LinearBox3 {
        let p = &self.0;
        let at = |i: usize| Vec3::new(p[i], p[i + 1], p[i + 2]);
        LinearBox3 { begin: Box3 { min: at(0), max: -at(3) }, end: Box3 { min: at(6), max: -at(9) } }
    }
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Packed,
    count: u32,
}

impl Bin {
    const EMPTY: Bin = Bin { bounds: Packed::EMPTY, count: 0 };

    fn add(&mut self, other: &Bin) {
        self.bounds.include(&other.bounds);
        self.count += other.count;
    }

    /// Mean half area times count.
    fn cost(&self) -> f32 {
        if self.count > 0 { mean_half_area(&self.bounds.bounds()) * self.count as f32 } else { 0.0 }
    }
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

/// A partition of references by the bins of their centres.
struct Split {
    /// Area times count, summed over both sides.
    cost: f32,
    axis: usize,
    binning: Binning,
    /// First bin of the high side.
    plane: usize,
    low: LinearBox3,
    high: LinearBox3,
}

impl Split {
    /// Mean half area of what both sides share, estimated from both ends.
    fn overlap(&self) -> f32 {
        0.5 * (self.low.begin.intersection(self.high.begin).half_area()
            + self.low.end.intersection(self.high.end).half_area())
    }
}

/// Where binned SAH parts the references most cheaply; nothing where all centres coincide.
fn find_split(references: &[Reference], centres: Box3) -> Option<Split> {
    let bins = if references.len() < FEW { FEW_BINS } else { BINS };
    let extent = centres.max - centres.min;
    let binning = [0, 1, 2].map(|axis| {
        let scale = bins as f32 / extent[axis];
        // A scale that is not finite means a flat axis (or one so thin that it counts as flat).
        Binning { low: centres.min[axis], scale: if scale.is_finite() { scale } else { 0.0 }, last: bins - 1 }
    });
    let mut table = [[Bin::EMPTY; BINS]; 3];
    for r in references {
        let (c, one) = (centre(&r.bounds), Bin { bounds: Packed::new(&r.bounds), count: 1 });
        for axis in 0..3 {
            table[axis][binning[axis].bin(c[axis])].add(&one);
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        if binning[axis].scale == 0.0 {
            continue;
        }
        let row = &table[axis][..bins];
        let mut above = [(0.0, 0); BINS];
        let mut sum = Bin::EMPTY;
        for i in (1..bins).rev() {
            sum.add(&row[i]);
            above[i] = (sum.cost(), sum.count);
        }
        sum = Bin::EMPTY;
        for i in 1..bins {
            sum.add(&row[i - 1]);
            if sum.count == 0 || above[i].1 == 0 {
                continue;
            }
            let cost = sum.cost() + above[i].0;
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    let (cost, axis, plane) = best;
    if cost == f32::INFINITY {
        return None;
    }
    let side = |row: &[Bin]| {
        let mut sum = Bin::EMPTY;
        row.iter().for_each(|bin| sum.add(bin));
        sum.bounds.bounds()
    };
    let (low, high) = table[axis][..bins].split_at(plane);
    Some(Split { cost, axis, binning: binning[axis], plane, low: side(low), high: side(high) })
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
