//! Binned SAH: where to part references, and the parting itself, in sixteen lanes.
//!
//! The inner loops of a build. A reference is one register; a bin is another, united with it by one
//! minimum. Nothing is fused, so every instruction set makes the same tree.

use super::reference::{Packed, Reference};
use crate::motion::{Box3, LinearBox3};
use crate::simd::{Kernel, Simd};
use glam::{BVec4A, Vec4};

/// Most bins per axis.
pub(super) const BINS: usize = 32;

/// Bins per axis for `n` references: more than a few per reference tell nothing new, and sweeping them costs.
fn bins_for(n: usize) -> usize {
    match n {
        0..=4 => 4,
        5..=16 => 8,
        17..=256 => 16,
        _ => BINS,
    }
}

/// Maps a centre to a bin on each axis; monotone in each coordinate.
#[derive(Clone, Copy)]
pub(super) struct Binning {
    low: Vec4,
    scale: Vec4,
    last: f32,
}

/// Adding it rounds a small float to the nearest integer, which is then in its low bits.
const ROUND: f32 = 8_388_608.0;

impl Binning {
    fn new(centres: Box3, bins: usize) -> Binning {
        // A scale that is not finite means a flat axis (or one so thin that it counts as flat).
        let scale = |extent: f32| {
            let scale = bins as f32 / extent;
            if scale.is_finite() { scale } else { 0.0 }
        };
        let extent = centres.max - centres.min;
        Binning {
            low: centres.min.extend(0.0),
            scale: Vec4::new(scale(extent.x), scale(extent.y), scale(extent.z), 0.0),
            last: (bins - 1) as f32,
        }
    }

    /// [`ROUND`] plus the bin, on each axis.
    #[inline(always)]
    fn rounded(&self, centre: Vec4) -> Vec4 {
        let at = (centre - self.low) * self.scale - Vec4::splat(0.5);
        at.max(Vec4::ZERO).min(Vec4::splat(self.last)) + Vec4::splat(ROUND)
    }
}

/// The bins of one node; kept from node to node.
pub(super) struct Table {
    bounds: [[Packed; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

impl Table {
    pub fn new() -> Box<Table> {
        Box::new(Table { bounds: [[Packed::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] })
    }
}

/// A partition of references by the bins of their centres.
pub(super) struct Split {
    axis: usize,
    binning: Binning,
    /// First bin of the high side.
    plane: usize,
    pub low: LinearBox3,
    pub high: LinearBox3,
}

/// Finds where binned SAH parts the references most cheaply; nothing where all centres coincide.
pub(super) struct FindSplit<'a> {
    pub references: &'a [Reference],
    /// The box of their centres, as [`Reference::centre`] has them.
    pub centres: Box3,
    pub table: &'a mut Table,
}

impl Kernel for FindSplit<'_> {
    type Output = Option<Split>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<Split> {
        let FindSplit { references, centres, table } = self;
        let bins = bins_for(references.len());
        let binning = Binning::new(centres, bins);
        for axis in 0..3 {
            table.bounds[axis][..bins].fill(Packed::EMPTY);
            table.counts[axis][..bins].fill(0);
        }
        for r in references {
            let at = binning.rounded(r.centre()).to_array();
            let lanes = s.load(&r.0.0);
            for ((at, row), counts) in at.into_iter().zip(&mut table.bounds).zip(&mut table.counts) {
                let bin = at.to_bits() as usize % BINS;
                let bounds = &mut row[bin].0;
                s.store(s.min(s.load(bounds), lanes), bounds);
                counts[bin] += 1;
            }
        }
        let mut best = (f32::INFINITY, 0, 0);
        for axis in 0..3 {
            if binning.scale[axis] > 0.0 {
                let (cost, plane) = sweep(s, &table.bounds[axis][..bins], &table.counts[axis][..bins]);
                if cost < best.0 {
                    best = (cost, axis, plane);
                }
            }
        }
        let (cost, axis, plane) = best;
        if cost == f32::INFINITY {
            return None;
        }
        let (low, high) = table.bounds[axis][..bins].split_at(plane);
        Some(Split { axis, binning, plane, low: union(s, low), high: union(s, high) })
    }
}

/// What holds all of some bins. (Not a closure: those are compiled without the instruction set.)
#[inline(always)]
fn union<S: Simd>(s: S, bins: &[Packed]) -> LinearBox3 {
    let mut sum = s.splat(f32::INFINITY);
    for bin in bins {
        sum = s.min(sum, s.load(&bin.0));
    }
    let mut packed = Packed::EMPTY;
    s.store(sum, &mut packed.0);
    packed.bounds()
}

/// The cheapest plane of one axis: its cost (six times area times count) and the first bin above it.
#[inline(always)]
fn sweep<S: Simd>(s: S, bins: &[Packed], counts: &[u32]) -> (f32, usize) {
    let mut above = [(Vec4::ZERO, 0u32); BINS];
    let mut packed = Packed::EMPTY;
    let (mut sum, mut count) = (s.splat(f32::INFINITY), 0);
    for i in (1..bins.len().min(BINS)).rev() {
        sum = s.min(sum, s.load(&bins[i].0));
        s.store(sum, &mut packed.0);
        count += counts[i];
        above[i] = (packed.area_terms() * count as f32, count);
    }
    let mut best = (f32::INFINITY, 0);
    (sum, count) = (s.splat(f32::INFINITY), 0);
    for i in 1..bins.len().min(BINS) {
        sum = s.min(sum, s.load(&bins[i - 1].0));
        s.store(sum, &mut packed.0);
        count += counts[i - 1];
        if count == 0 || above[i].1 == 0 {
            continue;
        }
        let terms = packed.area_terms() * count as f32 + above[i].0;
        let cost = terms.x + terms.y + terms.z;
        if cost < best.0 {
            best = (cost, i);
        }
    }
    best
}

/// Both sides of a parting: how many are low, and the boxes of the centres.
pub(super) struct Parted {
    pub middle: usize,
    pub low: Box3,
    pub high: Box3,
}

/// Moves the low side of a split to the front; the order depends on nothing but the input.
pub(super) struct Partition<'a> {
    pub references: &'a mut [Reference],
    pub split: &'a Split,
}

impl Kernel for Partition<'_> {
    type Output = Parted;

    /// Every reference is exchanged with the first high one, whether it is low or not: without branches that
    /// nobody could predict.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Parted {
        let Partition { references, split } = self;
        let mut planes = [f32::NEG_INFINITY; 4];
        planes[split.axis] = ROUND + split.plane as f32;
        let planes = Vec4::from_array(planes);
        let (infinity, nothing) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let (mut low_min, mut low_max, mut high_min, mut high_max) = (infinity, nothing, infinity, nothing);
        let mut middle = 0;
        for i in 0..references.len() {
            let r = references[i];
            let centre = r.centre();
            let low = split.binning.rounded(centre).cmplt(planes).any();
            let mask = BVec4A::splat(low);
            low_min = low_min.min(Vec4::select(mask, centre, infinity));
            low_max = low_max.max(Vec4::select(mask, centre, nothing));
            high_min = high_min.min(Vec4::select(mask, infinity, centre));
            high_max = high_max.max(Vec4::select(mask, nothing, centre));
            references[i] = references[middle];
            references[middle] = r;
            middle += usize::from(low);
        }
        let boxed = |min: Vec4, max: Vec4| Box3 { min: min.truncate(), max: max.truncate() };
        Parted { middle, low: boxed(low_min, low_max), high: boxed(high_min, high_max) }
    }
}

/// Bounds of references and the box of their centres.
pub(super) struct Summary<'a>(pub &'a [Reference]);

impl Kernel for Summary<'_> {
    type Output = (LinearBox3, Box3);

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> (LinearBox3, Box3) {
        let mut bounds = s.splat(f32::INFINITY);
        let (mut min, mut max) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        for r in self.0 {
            bounds = s.min(bounds, s.load(&r.0.0));
            min = min.min(r.centre());
            max = max.max(r.centre());
        }
        let mut packed = Packed::EMPTY;
        s.store(bounds, &mut packed.0);
        (packed.bounds(), Box3 { min: min.truncate(), max: max.truncate() })
    }
}
