//! Compact samples that represent a whole set of points.
//!
//! A tree over a time slice is ordered by the positions of points in the middle of the slice. So a structure is
//! tried on some thousand points that are close together at that time: their leaves are those of the whole set. There
//! are a few such samples, in different regions and time slices.
//!
//! A sample is located by a subset of all points, drawn evenly: repeatedly split at the median of the widest axis, the
//! subset yields a box that holds the wanted share of all points. One pass over all points then finds those inside.

use super::build::{middle_segment, time_slices, time_slices_of};
use super::fast_points::mark_fast;
use super::moving_reference::{MovingReference, TimeSlice};
use super::select::select;
use super::source::Source;
use super::widest_axis::widest_axis;
use crate::simd::Item;
use crate::tuning::points::{SAMPLE, SAMPLED, SAMPLES};

/// Takes samples of some points of a set, between the keys in the middle.
pub(super) struct Sampler<'a> {
    source: &'a Source,
    points: &'a [u32],
    /// A subset of the points.
    drawn: Vec<u32>,
    /// The wanted number of points in a sample.
    wanted: f32,
}

/// Points that are close together in the middle of a time slice.
pub(super) struct Sample {
    pub(super) references: Vec<MovingReference>,
    pub(super) slice: TimeSlice,
    /// Number of points of the set per point of the sample.
    pub(super) scale: f64,
}

/// The largest number of points that are drawn to locate samples.
const DRAWN: usize = 1 << 12;

/// The step of a low-discrepancy sequence: the fractional part of the golden ratio, times 2^64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The `i`-th number of a sequence below `count` that is spread evenly.
pub(super) fn spread(i: usize, count: usize) -> usize {
    let fraction = (i as u64).wrapping_mul(GOLDEN).wrapping_add(1 << 63);
    ((u128::from(fraction) * count as u128) >> 64) as usize
}

impl<'a> Sampler<'a> {
    /// A sampler of at least one point.
    pub(super) fn new(source: &'a Source, points: &'a [u32]) -> Sampler<'a> {
        let count = (points.len() / 16).clamp(1, DRAWN);
        let drawn: Vec<u32> = (0..count).map(|i| points[spread(i, points.len())]).collect();
        let durations: f32 = drawn.iter().map(|&i| source.active(i as usize).duration()).sum();
        let [least, most] = SAMPLE;
        // Only some of the short active intervals intersect a time slice.
        let wanted = (points.len() / SAMPLED).clamp(least, most) as f32 / (durations / drawn.len() as f32).max(0.125);
        Sampler { source, points, drawn, wanted }
    }

    /// Samples for trees over `per_segment` time slices of a segment between two keys. Fast points are marked if `marked`.
    pub(super) fn samples(&self, per_segment: usize, marked: bool) -> Vec<Sample> {
        let (source, points) = (self.source, self.points);
        let [segment, later] = self.segment();
        let whole = time_slices(source.keys, 1)[segment];
        let finer: Vec<TimeSlice> = time_slices_of(segment, source.keys, per_segment).collect();
        let slices: [TimeSlice; SAMPLES] = core::array::from_fn(|i| finer[spread(i, finer.len())]);
        let mut cells = Cells { phases: slices.map(|slice| slice.middle_phase() as f32), ..Cells::EVERYWHERE };
        (0..SAMPLES).for_each(|i| self.narrow(&mut cells, i));
        let mut inside: [Vec<u32>; SAMPLES] = Default::default();
        for &point in points {
            let holding = cells.holding(source.at(point as usize, segment), source.at(point as usize, later));
            if holding != [false; SAMPLES] {
                for (inside, _) in inside.iter_mut().zip(holding).filter(|(_, holds)| *holds) {
                    // If many points coincide, some of them suffice.
                    if inside.len() < 2 * self.wanted as usize {
                        inside.push(point);
                    }
                }
            }
        }
        let sample = |(slice, inside): (TimeSlice, Vec<u32>)| {
            let mut references = source.references(&whole, inside.iter().map(|&i| i as usize), |i| i as u32);
            if marked {
                mark_fast(&mut references, &whole, slice.middle_phase());
            }
            let scale = points.len() as f64 / inside.len().max(1) as f64;
            Sample { references, slice, scale }
        };
        slices.into_iter().zip(inside).map(sample).collect()
    }

    /// The segment that represents all, and its later key.
    fn segment(&self) -> [usize; 2] {
        let segment = middle_segment(self.source.keys);
        [segment, (segment + 1).min(self.source.keys - 1)]
    }

    /// Shrinks a cell to one of those that result from dividing space into cells with the wanted number of points.
    fn narrow(&self, cells: &mut Cells, cell: usize) {
        let [segment, later] = self.segment();
        let item = |&index: &u32| {
            let [open, close] = [segment, later].map(|key| self.source.at(index as usize, key));
            Item { at: core::array::from_fn(|axis| cells.coordinates(axis, open, close)[cell]), index }
        };
        let mut items: Vec<Item> = self.drawn.iter().map(item).collect();
        let mut runs = (self.points.len() as f32 / self.wanted).round().max(1.0) as usize;
        let (mut items, mut wanted) = (&mut items[..], (2 * cell + 1) * runs / (2 * SAMPLES));
        while runs > 1 && items.len() > 1 {
            let left = runs.div_ceil(2);
            let axis = widest_axis(items.len(), |i| items[i].at);
            let cut = (items.len() * left / runs).clamp(1, items.len() - 1);
            select(items, cut, axis);
            let border = items[cut].at[axis];
            let (low, high) = items.split_at_mut(cut);
            if wanted < left {
                (items, runs, cells.hi[axis][cell]) = (low, left, border);
            } else {
                (items, runs, wanted, cells.lo[axis][cell]) = (high, runs - left, wanted - left, border);
            }
        }
    }
}

/// Boxes, and the phases at which points are in them.
struct Cells {
    phases: [f32; SAMPLES],
    /// Lower and upper faces per axis.
    lo: [[f32; SAMPLES]; 3],
    hi: [[f32; SAMPLES]; 3],
}

impl Cells {
    const EVERYWHERE: Cells =
        Cells { phases: [0.0; SAMPLES], lo: [[f32::NEG_INFINITY; SAMPLES]; 3], hi: [[f32::INFINITY; SAMPLES]; 3] };

    /// The approximate coordinates of a point at the phases.
    #[inline(always)]
    fn coordinates(&self, axis: usize, open: [f32; 3], close: [f32; 3]) -> [f32; SAMPLES] {
        self.phases.map(|phase| open[axis] + (close[axis] - open[axis]) * phase)
    }

    /// Which boxes hold a point. Adjacent boxes share the points on their border.
    #[inline(always)]
    fn holding(&self, open: [f32; 3], close: [f32; 3]) -> [bool; SAMPLES] {
        let mut holding = [true; SAMPLES];
        for axis in 0..3 {
            let at = self.coordinates(axis, open, close);
            for (cell, holds) in holding.iter_mut().enumerate() {
                *holds &= (self.lo[axis][cell] <= at[cell]) & (at[cell] <= self.hi[axis][cell]);
            }
        }
        holding
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
            let sampler = Sampler::new(&source, &all);
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
        let sampler = Sampler::new(&source, &all);
        assert!(sampler.samples(2, true).iter().all(|s| s.references.len() == 2 * sampler.wanted as usize));
    }
}
