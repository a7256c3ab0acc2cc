//! Compact samples that represent a whole set of points.
//!
//! A tree over a time slice is ordered by the positions of points in the middle of the slice. So a structure is
//! tried on some thousand points that are close together at that time: their leaves are those of the whole set. There
//! are a few such samples, in different regions and time slices.
//!
//! A sample is located by a subset of all points, drawn evenly: repeatedly split at the median of the widest axis, the
//! subset yields a box that holds the wanted share of all points. One pass over all points then finds those inside.

use super::excess::leaves_of;
use super::slice_points::references;
use super::source::Source;
use super::time_slices::{middle_slice, time_slices_of};
use crate::geometry::TimeInterval;
use crate::point::leaf_order::fast_points::Fast;
use crate::point::leaf_order::motion_groups::Displaced;
use crate::point::leaf_order::moving_reference::MovingReference;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::leaf_order::spread::spread;
use crate::point::leaf_order::widest_axis::widest_axis;
use crate::simd::{Item, Kernel, LANES, Mask, MovingPointBlock, Simd, SimdLevel, dispatch, lanes_at};
use crate::tuning::points::{SAMPLE, SAMPLED, SAMPLES};
use core::cmp::Ordering;
use glam::DVec3;

/// Takes samples of some points of a set, between the keys in the middle.
pub(in crate::point) struct Sampler<'a> {
    source: &'a Source,
    points: &'a [u32],
    simd: SimdLevel,
    /// Positions of a subset of the points at both keys.
    drawn: Vec<[[f32; 3]; 2]>,
    /// The wanted number of points in a sample.
    wanted: f32,
}

/// Points that are close together in the middle of a time slice.
pub(in crate::point) struct Sample {
    pub(in crate::point) references: Vec<MovingReference>,
    pub(in crate::point) slice: SegmentSlice,
    /// Number of points of the set per point of the sample.
    pub(in crate::point) scale: f64,
    /// The longest side of a leaf of usual size; 0 unless fast points are marked.
    pub(in crate::point) leaf_size: f32,
    /// Numbers of the references, those of one leaf behind those of the other, if fast points are marked.
    pub(in crate::point) order: Vec<u32>,
}

impl Sample {
    /// Its points as they are in the middle of the time slice, without those that do not exist then.
    pub(in crate::point) fn at_rest(&self) -> Sample {
        let middle = self.slice.middle();
        let exist = self.references.iter().filter(|m| m.active.contains(middle));
        let at_rest = |m: &MovingReference| MovingReference { active: TimeInterval::FULL, ..m.at_rest(&self.slice) };
        Sample { references: exist.map(at_rest).collect(), order: Vec::new(), ..*self }
    }

    /// The same points, the fast ones where they are in the middle of the time slice.
    pub(in crate::point) fn with_fast_at_rest(&self) -> Sample {
        let at_rest = |m: &MovingReference| if m.fast { m.at_rest(&self.slice) } else { *m };
        Sample { references: self.references.iter().map(at_rest).collect(), order: Vec::new(), ..*self }
    }

    /// A point in the middle of the time slice, and its displacement between the keys.
    pub(in crate::point) fn displaced(&self, number: usize) -> Displaced {
        let (m, double) = (&self.references[number], |x: [f32; 3]| DVec3::from_array(x.map(f64::from)));
        Displaced { at: double(m.position(self.slice.middle_phase())), by: double(m.close) - double(m.open) }
    }

    /// Its leaves, if fast points are marked.
    pub(in crate::point) fn leaves(&self) -> Vec<MovingPointBlock> {
        leaves_of(&self.references[..], &self.order)
    }

    /// The points of some of the leaves, if fast points are marked.
    pub(in crate::point) fn some_leaves(&self) -> Vec<Displaced> {
        let leaves = self.order.chunks_exact(LANES).step_by(LEAVES_PER);
        leaves.flatten().map(|&number| self.displaced(number as usize)).collect()
    }
}

/// One leaf of so many is looked at.
const LEAVES_PER: usize = 4;

/// The largest number of points that are drawn to locate samples.
const DRAWN: usize = 1 << 12;

impl<'a> Sampler<'a> {
    /// A sampler of at least one point.
    pub(in crate::point) fn new(source: &'a Source, points: &'a [u32], simd: SimdLevel) -> Sampler<'a> {
        let count = (points.len() / 16).clamp(1, DRAWN);
        let drawn = || (0..count).map(|i| points[spread(i, points.len())] as usize);
        let durations: f32 = drawn().map(|point| source.active(point).duration()).sum();
        let [least, most] = SAMPLE;
        // Only some of the short active intervals intersect a time slice.
        let wanted = (points.len() / SAMPLED).clamp(least, most) as f32 / (durations / count as f32).max(0.125);
        let keys = middle_slice(source.keys).ends();
        let drawn = drawn().map(|point| keys.map(|key| source.at(point, key))).collect();
        Sampler { source, points, simd, drawn, wanted }
    }

    /// Samples for trees over `per_segment` time slices of a segment between two keys. Fast points are marked if `marked`.
    pub(in crate::point) fn samples(&self, per_segment: usize, marked: bool) -> Vec<Sample> {
        let (source, points) = (self.source, self.points);
        let whole = middle_slice(source.keys);
        let finer: Vec<SegmentSlice> = time_slices_of(whole.segment, source.keys, per_segment).collect();
        let slices: [SegmentSlice; SAMPLES] = core::array::from_fn(|i| finer[spread(i, finer.len())]);
        let cells = self.cells(&slices.map(|slice| slice.middle_phase() as f32));
        let mut inside: [Vec<u32>; SAMPLES] = Default::default();
        // If many points coincide, some of them suffice.
        let most = 2 * self.wanted as usize;
        dispatch(self.simd, Scan { source, points, cells: &cells, inside: &mut inside, most });
        let sample = |(slice, inside): (&SegmentSlice, &Vec<u32>)| {
            let mut references = references(source, inside, &whole);
            let (mut leaf_size, mut order) = (0.0, Vec::new());
            if marked {
                let fast = Fast::of(&references[..], &whole, slice.middle_phase());
                fast.numbers.iter().for_each(|number| references[*number as usize].fast = true);
                (leaf_size, order) = (fast.leaf_size, fast.order);
            }
            let scale = points.len() as f64 / inside.len().max(1) as f64;
            Sample { references, slice: *slice, scale, leaf_size, order }
        };
        slices.iter().zip(&inside).map(sample).collect()
    }

    /// For each phase one of the cells that result from dividing space into cells with the wanted number of points at that phase.
    fn cells(&self, phases: &[f32; SAMPLES]) -> [Cell; SAMPLES] {
        let everything = |phase| Cell { phase, lo: [f32::NEG_INFINITY; 3], hi: [f32::INFINITY; 3] };
        let mut cells = phases.map(everything);
        let runs = (self.points.len() as f32 / self.wanted).round().max(1.0) as usize;
        for (i, &phase) in phases.iter().enumerate() {
            if phases[..i].contains(&phase) {
                continue;
            }
            // Cells at the same time are found together.
            let same = (i..SAMPLES).filter(|&other| phases[other] == phase);
            let mut wanted: Vec<(usize, usize)> =
                same.map(|cell| (cell, (2 * cell + 1) * runs / (2 * SAMPLES))).collect();
            let item = |[open, close]: &[[f32; 3]; 2]| Item {
                at: core::array::from_fn(|axis| open[axis] + (close[axis] - open[axis]) * phase),
                index: 0,
            };
            let mut items: Vec<Item> = self.drawn.iter().map(item).collect();
            divide(&mut items, &mut wanted, runs, &mut cells);
        }
        cells
    }
}

/// Divides space into `runs` cells of equally many items, as far as there are wanted ones: pairs of an index and the number of
/// that cell, in ascending order.
fn divide(items: &mut [Item], wanted: &mut [(usize, usize)], runs: usize, cells: &mut [Cell]) {
    if wanted.is_empty() || runs <= 1 || items.len() <= 1 {
        return;
    }
    let left = runs.div_ceil(2);
    let axis = widest_axis(items.len(), |i| items[i].at);
    let cut = (items.len() * left / runs).clamp(1, items.len() - 1);
    items.select_nth_unstable_by(cut, |a, b| a.at[axis].partial_cmp(&b.at[axis]).unwrap_or(Ordering::Equal));
    let border = items[cut].at[axis];
    let (low, high) = items.split_at_mut(cut);
    let (before, behind) = wanted.split_at_mut(wanted.partition_point(|(_, number)| *number < left));
    before.iter().for_each(|(cell, _)| cells[*cell].hi[axis] = border);
    for (cell, number) in &mut *behind {
        cells[*cell].lo[axis] = border;
        *number -= left;
    }
    divide(low, before, left, cells);
    divide(high, behind, runs - left, cells);
}

/// A box, and the phase at which points are in it.
#[derive(Clone, Copy)]
struct Cell {
    phase: f32,
    lo: [f32; 3],
    hi: [f32; 3],
}

/// Points whose positions are brought into rows at once.
const TILE: usize = 8 * LANES;

/// Finds the points in each cell, at most so many.
struct Scan<'a> {
    source: &'a Source,
    points: &'a [u32],
    cells: &'a [Cell; SAMPLES],
    inside: &'a mut [Vec<u32>; SAMPLES],
    most: usize,
}

impl Kernel for Scan<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Scan { source, points, cells, inside, most } = self;
        let [earlier, later] = middle_slice(source.keys).ends();
        let (mut open, mut close) = ([[0.0; TILE]; 3], [[0.0; TILE]; 3]);
        for points in points.chunks(TILE) {
            for (i, &point) in points.iter().enumerate() {
                let (from, to) = (source.at(point as usize, earlier), source.at(point as usize, later));
                for axis in 0..3 {
                    (open[axis][i], close[axis][i]) = (from[axis], to[axis]);
                }
            }
            for (begin, points) in points.chunks(LANES).enumerate() {
                let exist = Mask::MAX >> (LANES - points.len());
                let (mut at, mut phase) = ([s.splat(0.0); 3], f32::NAN);
                for (cell, inside) in cells.iter().zip(inside.iter_mut()) {
                    // Some or all cells are at the same time.
                    if cell.phase != phase {
                        phase = cell.phase;
                        for axis in 0..3 {
                            let from = s.load(lanes_at(&open[axis], begin * LANES));
                            let to = s.load(lanes_at(&close[axis], begin * LANES));
                            at[axis] = from + (to - from) * s.splat(phase);
                        }
                    }
                    cell.take(s, &at, exist, points, most, inside);
                }
            }
        }
    }
}

impl Cell {
    /// Adds those of sixteen points that exist and are inside, up to `most` in all.
    #[inline(always)]
    fn take<S: Simd>(&self, s: S, at: &[S::F; 3], exist: Mask, numbers: &[u32], most: usize, inside: &mut Vec<u32>) {
        let mut holding = exist;
        for (axis, &at) in at.iter().enumerate() {
            // Adjacent boxes share the points on their border.
            holding &= s.le(s.splat(self.lo[axis]), at) & s.le(at, s.splat(self.hi[axis]));
        }
        while holding != 0 {
            if inside.len() < most {
                inside.push(numbers[holding.trailing_zeros() as usize]);
            }
            holding &= holding - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::{MovingPoint, Precision};
    use glam::Vec3;

    #[test]
    fn samples_are_compact_and_of_the_wanted_size() {
        let mut random = Random(11);
        let intervals = [TimeInterval::FULL, TimeInterval::new(0.25, 0.5).unwrap()];
        for (n, active) in [(1, 0), (300, 0), (5000, 0), (200_000, 0), (50_000, 1)] {
            let points: Vec<MovingPoint> =
                (0..n).map(|_| MovingPoint::new(random.vec(), random.vec()).with_active(intervals[active])).collect();
            let source = Source::read(&points[..], Precision::Automatic).unwrap();
            let all: Vec<u32> = (0..n as u32).collect();
            let sampler = Sampler::new(&source, &all, SimdLevel::best());
            for slices in [1, 8] {
                for sample in sampler.samples(slices, false) {
                    let count = sample.references.len() as f32;
                    assert!(count >= (0.5 * sampler.wanted).min(n as f32), "{count} of {n}, not {}", sampler.wanted);
                    assert!(count <= 2.0 * sampler.wanted, "{count} of {n}, not {}", sampler.wanted);
                    assert!((sample.scale - n as f64 / f64::from(count)).abs() < 1e-6);
                    // As compact as a cube of as many, or nearly.
                    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
                    let phase = sample.slice.middle_phase();
                    for reference in &sample.references {
                        let at = Vec3::from_array([0, 1, 2].map(|axis| reference.at(axis, phase) as f32));
                        (lo, hi) = (lo.min(at), hi.max(at));
                    }
                    let wanted = (count / n as f32).cbrt() * 2.0;
                    assert!((hi - lo).max_element() <= 2.5 * wanted, "{} instead of {wanted}", hi - lo);
                }
            }
        }
    }

    #[test]
    fn points_in_one_place_are_sampled_too() {
        let points = vec![MovingPoint::new(Vec3::ONE, Vec3::X); 100_000];
        let source = Source::read(&points[..], Precision::Automatic).unwrap();
        let all: Vec<u32> = (0..points.len() as u32).collect();
        let sampler = Sampler::new(&source, &all, SimdLevel::best());
        assert!(sampler.samples(2, true).iter().all(|s| s.references.len() == 2 * sampler.wanted as usize));
    }
}
