//! Binned SAH: choosing the split of a node's references, in sixteen lanes.
//!
//! These are the inner loops of a build. A reference is one register; a bin is another, united with a reference by one
//! minimum. Nothing is fused, so every instruction set makes the same tree.

use super::reference::{Packed, Reference};
use crate::geometry::{Box3, LinearBox3};
use crate::parallel;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};
use core::cell::Cell;
use glam::Vec4;

/// The greatest number of bins per axis.
pub(super) const BINS: usize = 32;

/// Bins per axis for `n` references, a multiple of [`AT_ONCE`]: more bins than a few per reference do not improve the
/// split, and sweeping them takes time.
fn bins_for(n: usize) -> usize {
    match n {
        0..=16 => 8,
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

/// Adding this constant rounds a small float to the nearest integer, which is then in its low bits; -0.5 becomes 0.
const ROUND: f32 = 12_582_912.0;

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

    /// Treats all axes but the widest as flat.
    fn keep_widest(&mut self, centres: Box3) {
        let axis = (centres.max - centres.min).max_position();
        for other in (0..3).filter(|&other| other != axis) {
            self.scale[other] = 0.0;
        }
    }

    /// The bin on each axis, plus [`ROUND`].
    #[inline(always)]
    fn rounded(&self, centre: Vec4) -> Vec4 {
        let at = (centre - self.low) * self.scale - Vec4::splat(0.5);
        at.min(Vec4::splat(self.last)) + Vec4::splat(ROUND)
    }
}

/// The bins of one node on one axis.
struct Bins {
    bounds: [Packed; BINS],
    counts: [u32; BINS],
}

impl Bins {
    const EMPTY: Bins = Bins { bounds: [Packed::EMPTY; BINS], counts: [0; BINS] };

    fn clear(&mut self, bins: usize) {
        self.bounds[..bins].fill(Packed::EMPTY);
        self.counts[..bins].fill(0);
    }

    /// Adds a reference to its bin; `at` is the bin plus [`ROUND`].
    #[inline(always)]
    fn put<S: Simd>(&mut self, s: S, lanes: S::F, at: f32) {
        let bin = at.to_bits() as usize % BINS;
        let bounds = &mut self.bounds[bin].0;
        s.store(s.min(s.load(bounds), lanes), bounds);
        self.counts[bin] += 1;
    }

    /// Adds the bins of the next chunk of references. Of equal bounds (zeros of either sign) the last one is kept, as
    /// in [`Bins::put`].
    fn add(&mut self, others: &Bins) {
        for (bin, other) in self.bounds.iter_mut().zip(&others.bounds) {
            for (bound, other) in bin.0.iter_mut().zip(other.0) {
                *bound = if *bound < other { *bound } else { other };
            }
        }
        for (count, other) in self.counts.iter_mut().zip(&others.counts) {
            *count += other;
        }
    }
}

/// The bins of one node on all axes; reused from node to node.
pub(super) struct Table {
    axes: [Bins; 3],
    /// The unions of all bins on either side of each plane.
    unions: [Unions; 3],
}

/// For each plane of an axis, the unions of all bins below and above it.
struct Unions {
    below: [Packed; BINS],
    above: [Packed; BINS],
}

thread_local! {
    /// The table that the last build on this thread has left: small trees are built in less time than some tables are made.
    static SPARE: Cell<Option<Box<Table>>> = const { Cell::new(None) };
}

impl Table {
    fn new() -> Box<Table> {
        let unions = [const { Unions { below: [Packed::EMPTY; BINS], above: [Packed::EMPTY; BINS] } }; 3];
        Box::new(Table { axes: [Bins::EMPTY; 3], unions })
    }

    /// Calls `f` with a table of any content.
    pub fn lend<T>(f: impl FnOnce(&mut Table) -> T) -> T {
        let mut table = SPARE.take().unwrap_or_else(Table::new);
        let result = f(&mut table);
        SPARE.set(Some(table));
        result
    }
}

/// The number of places in a node from which references are taken in turn. Neighbours are often in the same bin, and would wait for
/// each other there.
const TURNS: usize = 4;

/// References at each of these places whose bins are computed before they are counted: bins go through memory, since extracting
/// lanes from registers is slow.
const BLOCK: usize = 8;

/// Adds references to the bins of a table, on all axes that are not flat.
struct Count<'a> {
    references: &'a [Reference],
    /// The references are added in chunks of this size.
    chunk: usize,
    binning: Binning,
    bins: usize,
    axes: &'a mut [Bins; 3],
}

impl Kernel for Count<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Count { references, chunk, binning, bins, axes } = self;
        let (mut used, mut n) = ([0, 1, 2], 0);
        for (axis, table) in axes.iter_mut().enumerate() {
            if binning.scale[axis] > 0.0 {
                table.clear(bins);
                used[n] = axis;
                n += 1;
            }
        }
        for references in references.chunks(chunk) {
            match n {
                3 => count::<S, 3>(s, references, binning, [0, 1, 2], axes),
                2 => count::<S, 2>(s, references, binning, [used[0], used[1]], axes),
                1 => count::<S, 1>(s, references, binning, [used[0]], axes),
                _ => {}
            }
        }
    }
}

/// Adds references to the bins of some axes, in an order that depends on their number only.
#[inline(always)]
fn count<S: Simd, const N: usize>(
    s: S,
    references: &[Reference],
    binning: Binning,
    axes: [usize; N],
    table: &mut [Bins; 3],
) {
    let share = references.len() / TURNS;
    let (shares, rest) = references.split_at(TURNS * share);
    let mut places = [[[0.0; 4]; TURNS]; BLOCK];
    for first in (0..share).step_by(BLOCK) {
        let block = first..share.min(first + BLOCK);
        for turn in 0..TURNS {
            for (r, at) in shares[turn * share..][block.clone()].iter().zip(&mut places) {
                at[turn] = binning.rounded(r.centre()).to_array();
            }
        }
        for (i, at) in block.zip(&places) {
            for turn in 0..TURNS {
                put(s, &shares[turn * share + i], at[turn], axes, table);
            }
        }
    }
    for r in rest {
        put(s, r, binning.rounded(r.centre()).to_array(), axes, table);
    }
}

/// Adds a reference to its bins; `at` has the bin on each axis plus [`ROUND`].
#[inline(always)]
fn put<S: Simd, const N: usize>(s: S, r: &Reference, at: [f32; 4], axes: [usize; N], table: &mut [Bins; 3]) {
    let lanes = s.load(&r.0.0);
    for axis in axes {
        table[axis % 3].put(s, lanes, at[axis % 3]);
    }
}

/// Nodes with at least this many references are counted and partitioned by several threads.
pub(super) const PARALLEL: usize = 1 << 15;

/// Crowded nodes with at most this many references are split across their widest axis.
const SMALL: usize = 64;

/// The number of chunks in which several threads count a node.
const CHUNKS: usize = 32;

/// A partition of references by the bins of their centres.
pub(super) struct Split {
    pub axis: usize,
    binning: Binning,
    /// The first bin of the high side.
    plane: usize,
    pub low: LinearBox3,
    pub high: LinearBox3,
    /// The number of references on the low side.
    pub middle: usize,
    /// References per counted chunk, and the number on the low side in each; no chunks if one thread counted.
    pub chunk: usize,
    pub lows: Vec<usize>,
}

impl Split {
    /// The classifier of references into sides.
    pub fn sides(&self) -> Sides {
        let Binning { low, scale, last } = self.binning;
        let plane = ROUND + self.plane as f32;
        Sides { lane: Reference::CENTRE[self.axis], low: low[self.axis], scale: scale[self.axis], last, plane }
    }
}

/// The constants that classify references, by value: loops that store references would reload them through a pointer
/// each time.
#[derive(Clone, Copy)]
pub(super) struct Sides {
    lane: usize,
    low: f32,
    scale: f32,
    last: f32,
    plane: f32,
}

impl Sides {
    /// Whether a reference is on the low side: the same computation as [`Binning::rounded`].
    #[inline(always)]
    pub fn is_low(&self, r: &Reference) -> bool {
        let at = (r.0.0[self.lane % LANES] - self.low) * self.scale - 0.5;
        at.min(self.last) + ROUND < self.plane
    }
}

/// Finds the split of least cost by binned SAH; `None` if all centres coincide. `centres` is the box of the centres, in
/// the units of [`Reference::centre`]. In small `overlapping` nodes only planes across the widest axis are tried: there no
/// split gains much.
pub(super) fn find_split(
    references: &[Reference],
    centres: Box3,
    overlapping: bool,
    table: &mut Table,
) -> Option<Split> {
    let (simd, bins) = (SimdLevel::best(), bins_for(references.len()));
    let mut binning = Binning::new(centres, bins);
    if overlapping && references.len() <= SMALL {
        binning.keep_widest(centres);
    }
    // One thread counts large nodes in the same chunks, so the result does not depend on the threads.
    let chunk = if references.len() < PARALLEL { PARALLEL } else { references.len().div_ceil(CHUNKS) };
    let mut chunks = Vec::new();
    if references.len() < PARALLEL || parallel::threads() == 1 {
        dispatch(simd, Count { references, chunk, binning, bins, axes: &mut table.axes });
    } else {
        // Minima and sums are merged in order.
        chunks = parallel::map(references.len().div_ceil(chunk), |i| {
            let mut axes = Box::new([Bins::EMPTY; 3]);
            let references = &references[i * chunk..references.len().min((i + 1) * chunk)];
            dispatch(simd, Count { references, chunk, binning, bins, axes: &mut axes });
            axes
        });
        for (axis, sum) in table.axes.iter_mut().enumerate() {
            sum.clear(bins);
            chunks.iter().for_each(|axes| sum.add(&axes[axis]));
        }
    }
    let split = dispatch(simd, Choose { binning, bins, count: references.len() as u32, table })?;
    let below = |axes: &[Bins; 3]| axes[split.axis].counts[..split.plane].iter().sum::<u32>() as usize;
    let lows = chunks.iter().map(|axes| below(axes)).collect();
    Some(Split { middle: below(&table.axes), chunk, lows, ..split })
}

/// Chooses the plane of least cost between filled bins.
struct Choose<'a> {
    binning: Binning,
    bins: usize,
    /// The number of references.
    count: u32,
    table: &'a mut Table,
}

impl Kernel for Choose<'_> {
    type Output = Option<Split>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<Split> {
        let Choose { binning, bins, count, table } = self;
        let Table { axes, unions } = table;
        let (mut costs, mut planes) = (s.splat(f32::INFINITY), s.splat_u(0));
        for (axis, (Bins { bounds, counts }, unions)) in axes.iter().zip(&mut *unions).enumerate() {
            if binning.scale[axis] > 0.0 {
                let bounds = &bounds[..bins];
                gather_above(s, bounds, &mut unions.above);
                let mut below = (s.splat(f32::INFINITY), 0);
                for first in (0..bins).step_by(AT_ONCE) {
                    let cost = sweep(s, (bounds, counts), unions, first, &mut below, count);
                    let better = s.lt(cost, costs);
                    costs = s.select(better, cost, costs);
                    planes = s.select_u(better, s.splat_u((axis * BINS + first) as u32), planes);
                }
            }
        }
        // Costs are not negative, so their bits are in the same order; of equal costs the first plane wins.
        let least = f32::from_bits(s.reduce_min_u(s.to_bits(costs)));
        if least == f32::INFINITY {
            return None;
        }
        let place = s.select_u(s.eq(costs, s.splat(least)), s.add_u(planes, s.load_u(&PLANES)), s.splat_u(u32::MAX));
        let place = s.reduce_min_u(place) as usize;
        let (axis, plane) = (place / BINS, place % BINS);
        let Unions { below, above } = &unions[axis];
        let (low, high) = (below[plane].bounds(), above[plane].bounds());
        Some(Split { axis, binning, plane, low, high, middle: 0, chunk: 0, lows: Vec::new() })
    }
}

/// Lanes 0 to 7, two of which are unused.
pub(super) const HALF: u16 = 0x00ff;
pub(super) const EXTENTS: u16 = 0x3f3f;

/// For the extents at the beginning and at the end, d0 and d1, in each half: the lanes of (y z x) of d0 and of d1, and
/// the same exchanged.
pub(super) const TURNED: Lanes<u32> = [1, 2, 0, 4, 5, 3, 6, 7, 9, 10, 8, 12, 13, 11, 14, 15];
pub(super) const CROSSED: Lanes<u32> = [4, 5, 3, 1, 2, 0, 6, 7, 12, 13, 11, 9, 10, 8, 14, 15];

/// Planes whose costs are computed together: one in each lane of a half.
const AT_ONCE: usize = LANES / 2;
const PLANES: Lanes<u32> = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];

/// For each bin the union of it and all bins above.
#[inline(always)]
fn gather_above<S: Simd>(s: S, bins: &[Packed], above: &mut [Packed; BINS]) {
    let mut sum = s.splat(f32::INFINITY);
    for (bin, above) in bins.iter().zip(above).rev() {
        sum = s.min(sum, s.load(&bin.0));
        s.store(sum, &mut above.0);
    }
}

/// The costs (six times area times count) of the planes below the bins from `first` on, in the lanes of each half;
/// infinite if one side is empty. `below` holds all bins below the first plane, and on return those below the next
/// planes; those below each plane are stored.
///
/// The side below a plane is in the low half of the lanes, the side above in the high half. Six times the mean half
/// area is, with h(d) = xy + yz + zx, h(d0) + h(d1) + h(d0 + d1) (see [`super::visits::mean_half_area`]), which is d0 .
/// rot(2 d0 + d1) + d1 . rot(2 d1 + d0), where rot (x, y, z) = (y, z, x): six products in six lanes. The sums over
/// lanes of eight planes are formed together, and end up in one lane per plane.
#[inline(always)]
fn sweep<S: Simd>(
    s: S,
    (bins, counts): (&[Packed], &[u32; BINS]),
    unions: &mut Unions,
    first: usize,
    below: &mut (S::F, u32),
    all: u32,
) -> S::F {
    let (zero, turned, crossed) = (s.splat(0.0), s.load_u(&TURNED), s.load_u(&CROSSED));
    let mut areas = [zero; AT_ONCE];
    let mut counts_below = [0.0; LANES];
    for (j, area) in areas.iter_mut().enumerate() {
        let (low, high) = (below.0, s.load(&unions.above[(first + j) % BINS].0));
        s.store(low, &mut unions.below[(first + j) % BINS].0);
        let negated = s.select(HALF, low, high) + s.swap_lanes::<8>(s.select(HALF, high, low));
        let d = s.select(EXTENTS, s.max(zero - negated, zero), zero);
        let (own, other) = (s.permute(d, turned), s.permute(d, crossed));
        *area = d * (own + other + own);
        counts_below[j] = below.1 as f32;
        counts_below[j + AT_ONCE] = below.1 as f32;
        below.0 = s.min(low, s.load(&bins[first + j].0));
        below.1 += counts[(first + j) % BINS];
    }
    let [a, b, c, d, e, f, g, h] = areas;
    let (a, b, c, d) = (paired4(s, a, e), paired4(s, b, f), paired4(s, c, g), paired4(s, d, h));
    let areas = paired1(s, paired2(s, a, c), paired2(s, b, d));
    let counts = s.load(&counts_below);
    let counts = s.select(HALF, counts, s.splat(all as f32) - counts);
    let some = s.lt(zero, counts);
    let costs = areas * counts;
    let costs = costs + s.swap_lanes::<8>(costs);
    s.select(some & some >> 8 & HALF, costs, s.splat(f32::INFINITY))
}

/// Sums of lanes four apart: of `a` where bit 2 of the lane is 0, elsewhere of `b`.
#[inline(always)]
fn paired4<S: Simd>(s: S, a: S::F, b: S::F) -> S::F {
    s.select(0x0f0f, a, b) + s.swap_lanes::<4>(s.select(0x0f0f, b, a))
}

/// As [`paired4`], for lanes two apart.
#[inline(always)]
fn paired2<S: Simd>(s: S, a: S::F, b: S::F) -> S::F {
    s.select(0x3333, a, b) + s.swap_lanes::<2>(s.select(0x3333, b, a))
}

/// As [`paired4`], for lanes one apart.
#[inline(always)]
fn paired1<S: Simd>(s: S, a: S::F, b: S::F) -> S::F {
    s.select(0x5555, a, b) + s.swap_lanes::<1>(s.select(0x5555, b, a))
}

/// Bounds of references and the box of their centres.
pub(super) fn summary(references: &[Reference]) -> (LinearBox3, Box3) {
    let simd = SimdLevel::best();
    let parts = parallel::chunks(references.len(), |of| dispatch(simd, Summary(&references[of])));
    let nothing = (LinearBox3::EMPTY, Box3::EMPTY);
    parts.into_iter().reduce(|a, b| (a.0.union(b.0), a.1.union(b.1))).unwrap_or(nothing)
}

/// [`summary`] on one thread.
struct Summary<'a>(&'a [Reference]);

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
