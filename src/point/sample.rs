//! Compact samples that represent a whole set of points.
//!
//! A tree over a time slice is ordered by the positions of points in the middle of the slice. So a structure is
//! tried on some thousand points that are close together at that time: their leaves are those of the whole set. There
//! are a few such samples, in different regions and time slices.
//!
//! A sample is located by a subset of all points, drawn evenly: repeatedly split at the median of the widest axis, the
//! subset yields a box that holds the wanted share of all points. One pass over all points then finds those inside.

use super::build::{middle_segment, time_slices, time_slices_of};
use super::fast_points::Fast;
use super::moving_reference::{MovingReference, TimeSlice};
use super::select::select;
use super::source::Source;
use super::spread::spread;
use super::widest_axis::widest_axis;
use crate::simd::{Item, Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};
use crate::tuning::points::{SAMPLE, SAMPLED, SAMPLES};

/// Takes samples of some points of a set, between the keys in the middle.
pub(super) struct Sampler<'a> {
    source: &'a Source,
    points: &'a [u32],
    simd: SimdLevel,
    /// Positions of a subset of the points at both keys.
    drawn: Vec<[[f32; 3]; 2]>,
    /// The wanted number of points in a sample.
    wanted: f32,
    /// What was found so far.
    found: Vec<Found>,
}

/// The points of samples for trees over `per_segment` time slices of a segment.
struct Found {
    per_segment: usize,
    slices: [TimeSlice; SAMPLES],
    inside: [Vec<u32>; SAMPLES],
}

/// Numbers of time slices for which one pass over the points finds the samples, each twice the one before.
const AT_ONCE: usize = 4;

/// Cells for which points are tested at once.
const CELLS: usize = SAMPLES * AT_ONCE;

const _: () = assert!(CELLS <= LANES);

/// Points that are close together in the middle of a time slice.
pub(super) struct Sample {
    pub(super) references: Vec<MovingReference>,
    pub(super) slice: TimeSlice,
    /// Number of points of the set per point of the sample.
    pub(super) scale: f64,
    /// The longest side of a leaf of usual size; 0 unless fast points are marked.
    pub(super) leaf_size: f32,
}

/// The largest number of points that are drawn to locate samples.
const DRAWN: usize = 1 << 12;

impl<'a> Sampler<'a> {
    /// A sampler of at least one point.
    pub(super) fn new(source: &'a Source, points: &'a [u32], simd: SimdLevel) -> Sampler<'a> {
        let count = (points.len() / 16).clamp(1, DRAWN);
        let drawn = || (0..count).map(|i| points[spread(i, points.len())] as usize);
        let durations: f32 = drawn().map(|point| source.active(point).duration()).sum();
        let [least, most] = SAMPLE;
        // Only some of the short active intervals intersect a time slice.
        let wanted = (points.len() / SAMPLED).clamp(least, most) as f32 / (durations / count as f32).max(0.125);
        let keys = middle_keys(source);
        let drawn = drawn().map(|point| keys.map(|key| source.at(point, key))).collect();
        Sampler { source, points, simd, drawn, wanted, found: Vec::new() }
    }

    /// Samples for trees over `per_segment` time slices of a segment between two keys. Fast points are marked if `marked`.
    pub(super) fn samples(&mut self, per_segment: usize, marked: bool) -> Vec<Sample> {
        if !self.found.iter().any(|found| found.per_segment == per_segment) {
            self.find(per_segment);
        }
        let (source, points) = (self.source, self.points);
        let found = self.found.iter().find(|found| found.per_segment == per_segment).expect("it was found");
        let whole = time_slices(source.keys, 1)[middle_segment(source.keys)];
        let sample = |(slice, inside): (&TimeSlice, &Vec<u32>)| {
            let mut references = source.references(&whole, inside.iter().map(|&i| i as usize), |i| i as u32);
            let mut leaf_size = 0.0;
            if marked {
                let fast = Fast::of(&references[..], &whole, slice.middle_phase());
                fast.numbers.iter().for_each(|number| references[*number as usize].fast = true);
                leaf_size = fast.leaf_size;
            }
            let scale = points.len() as f64 / inside.len().max(1) as f64;
            Sample { references, slice: *slice, scale, leaf_size }
        };
        found.slices.iter().zip(&found.inside).map(sample).collect()
    }

    /// Finds the points of samples for so many time slices, and for the next finer ones.
    fn find(&mut self, per_segment: usize) {
        let (source, points) = (self.source, self.points);
        let segment = middle_segment(source.keys);
        let first = self.found.len();
        let mut cells = Cells::NOWHERE;
        for (lanes, per_segment) in (0..AT_ONCE).map(|i| (i * SAMPLES, per_segment << i)) {
            let finer: Vec<TimeSlice> = time_slices_of(segment, source.keys, per_segment).collect();
            let slices: [TimeSlice; SAMPLES] = core::array::from_fn(|i| finer[spread(i, finer.len())]);
            self.narrow(&mut cells, lanes, &slices.map(|slice| slice.middle_phase() as f32));
            self.found.push(Found { per_segment, slices, inside: Default::default() });
        }
        // If many points coincide, some of them suffice.
        let most = 2 * self.wanted as usize;
        let inside: Vec<&mut Vec<u32>> = self.found[first..].iter_mut().flat_map(|found| &mut found.inside).collect();
        dispatch(self.simd, Scan { source, points, cells: &cells, inside, most });
    }

    /// Shrinks each cell of a group, whose first lane is given, to one of those that result from dividing space into cells
    /// with the wanted number of points at its phase.
    fn narrow(&self, cells: &mut Cells, first: usize, phases: &[f32; SAMPLES]) {
        let runs = (self.points.len() as f32 / self.wanted).round().max(1.0) as usize;
        for (i, &phase) in phases.iter().enumerate() {
            cells.phases[first + i] = phase;
            if phases[..i].contains(&phase) {
                continue;
            }
            // Cells at the same time are found together.
            let same = (i..SAMPLES).filter(|&other| phases[other] == phase);
            let mut wanted: Vec<(usize, usize)> =
                same.map(|cell| (first + cell, (2 * cell + 1) * runs / (2 * SAMPLES))).collect();
            for (cell, _) in &wanted {
                cells.open(*cell);
            }
            let item = |[open, close]: &[[f32; 3]; 2]| Item {
                at: core::array::from_fn(|axis| open[axis] + (close[axis] - open[axis]) * phase),
                index: 0,
            };
            let mut items: Vec<Item> = self.drawn.iter().map(item).collect();
            divide(&mut items, &mut wanted, runs, cells);
        }
    }
}

/// Divides space into `runs` cells of equally many items, as far as there are wanted ones: pairs of a lane and the number of
/// its cell, in ascending order.
fn divide(items: &mut [Item], wanted: &mut [(usize, usize)], runs: usize, cells: &mut Cells) {
    if wanted.is_empty() || runs <= 1 || items.len() <= 1 {
        return;
    }
    let left = runs.div_ceil(2);
    let axis = widest_axis(items.len(), |i| items[i].at);
    let cut = (items.len() * left / runs).clamp(1, items.len() - 1);
    select(items, cut, axis);
    let border = items[cut].at[axis];
    let (low, high) = items.split_at_mut(cut);
    let (before, behind) = wanted.split_at_mut(wanted.partition_point(|(_, number)| *number < left));
    before.iter().for_each(|(lane, _)| cells.hi[axis][*lane] = border);
    for (lane, number) in &mut *behind {
        cells.lo[axis][*lane] = border;
        *number -= left;
    }
    divide(low, before, left, cells);
    divide(high, behind, runs - left, cells);
}

/// The keys of the segment that represents all.
fn middle_keys(source: &Source) -> [usize; 2] {
    let segment = middle_segment(source.keys);
    [segment, (segment + 1).min(source.keys - 1)]
}

/// Boxes, one in each lane, and the phases at which points are in them.
struct Cells {
    phases: Lanes<f32>,
    /// Lower and upper faces per axis.
    lo: [Lanes<f32>; 3],
    hi: [Lanes<f32>; 3],
}

impl Cells {
    const NOWHERE: Cells =
        Cells { phases: [0.0; LANES], lo: [[f32::INFINITY; LANES]; 3], hi: [[f32::NEG_INFINITY; LANES]; 3] };

    /// Makes a box everything.
    fn open(&mut self, lane: usize) {
        for axis in 0..3 {
            (self.lo[axis][lane], self.hi[axis][lane]) = (f32::NEG_INFINITY, f32::INFINITY);
        }
    }
}

/// Finds the points in each cell, at most so many.
struct Scan<'a> {
    source: &'a Source,
    points: &'a [u32],
    cells: &'a Cells,
    inside: Vec<&'a mut Vec<u32>>,
    most: usize,
}

impl Kernel for Scan<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Scan { source, points, cells, mut inside, most } = self;
        let [earlier, later] = middle_keys(source);
        let phases = s.load(&cells.phases);
        let (lo, hi) = (&cells.lo, &cells.hi);
        let lo = [s.load(&lo[0]), s.load(&lo[1]), s.load(&lo[2])];
        let hi = [s.load(&hi[0]), s.load(&hi[1]), s.load(&hi[2])];
        for &point in points {
            let (open, close) = (source.at(point as usize, earlier), source.at(point as usize, later));
            let mut holding = Mask::MAX;
            for axis in 0..3 {
                let at = s.splat(open[axis]) + s.splat(close[axis] - open[axis]) * phases;
                // Adjacent boxes share the points on their border.
                holding &= s.le(lo[axis], at) & s.le(at, hi[axis]);
            }
            while holding != 0 {
                let inside = &mut inside[holding.trailing_zeros() as usize];
                if inside.len() < most {
                    inside.push(point);
                }
                holding &= holding - 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MovingPoint;
    use crate::geometry::TimeInterval;
    use crate::random::Random;
    use glam::Vec3;

    #[test]
    fn samples_are_compact_and_of_the_wanted_size() {
        let mut random = Random(11);
        let intervals = [TimeInterval::FULL, TimeInterval::new(0.25, 0.5).unwrap()];
        for (n, active) in [(1, 0), (300, 0), (5000, 0), (200_000, 0), (50_000, 1)] {
            let points: Vec<MovingPoint> =
                (0..n).map(|_| MovingPoint::new(random.vec(), random.vec()).active(intervals[active])).collect();
            let source = Source::read(&points[..], false).unwrap();
            let all: Vec<u32> = (0..n as u32).collect();
            let mut sampler = Sampler::new(&source, &all, SimdLevel::best());
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
        let source = Source::read(&points[..], false).unwrap();
        let all: Vec<u32> = (0..points.len() as u32).collect();
        let mut sampler = Sampler::new(&source, &all, SimdLevel::best());
        assert!(sampler.samples(2, true).iter().all(|s| s.references.len() == 2 * sampler.wanted as usize));
    }
}
