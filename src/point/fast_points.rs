//! Detecting points that move far relative to their neighbours.

use super::bottom_order::{MOST, Rows, SPARE};
use super::divide::extremes;
use super::moving_reference::{References, TimeSlice, take_positions};
use super::order::order_rows;
use super::point_rows::PointRows;
use crate::progress::Progress;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};
use crate::tuning::points::FAST;

/// The numbers of the references that move far during a time slice, relative to their neighbours at a phase of it.
pub(super) fn fast_numbers<R: References + ?Sized>(references: &R, slice: &TimeSlice, phase: f64) -> Vec<u32> {
    let count = references.len();
    let (mut memory, mut more) = (PointRows::memory(count), PointRows::memory(count));
    let mut from = PointRows::in_blocks(&mut memory, count);
    take_positions(from.borrow(), references, phase);
    let mut rows = PointRows::in_blocks(&mut more, count);
    order_rows(from, &mut rows, LANES, &Progress::new(None));
    let simd = SimdLevel::best();
    let sizes = dispatch(simd, OrderLeaves { rows: &mut rows, count });
    let Some(half) = sizes.len().checked_sub(1).map(|last| last / 2) else { return Vec::new() };
    let (_, &mut median, _) = sizes.clone().select_nth_unstable_by(half, f32::total_cmp);
    let numbers = &rows.index[..count];
    dispatch(simd, Compare { references, slice, numbers, sizes: &sizes, median })
}

/// Puts references in order below bottom nodes as well; returns the longest side of each leaf.
struct OrderLeaves<'a, 'b> {
    rows: &'a mut PointRows<'b>,
    count: usize,
}

impl Kernel for OrderLeaves<'_, '_> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<f32> {
        let OrderLeaves { rows: all, count } = self;
        let (mut rows, mut spare) = (Rows::<MOST>::EMPTY, Rows::<SPARE>::EMPTY);
        let mut sizes = Vec::with_capacity(count.div_ceil(LANES));
        for begin in (0..count).step_by(LANES * LANES) {
            let below = (count - begin).min(LANES * LANES);
            rows.take(all, begin, below);
            rows.order(s, below, LANES, &mut spare);
            all.index[begin..begin + below].copy_from_slice(&rows.index[..below]);
            for leaf in 0..below.div_ceil(LANES) {
                let mut size = 0.0;
                for row in &rows.at {
                    let (least, most) = extremes(s, &row.as_chunks().0[leaf..=leaf]);
                    size = if most - least > size { most - least } else { size };
                }
                sizes.push(size);
            }
        }
        sizes
    }
}

/// Finds references that move far, among those of all leaves.
struct Compare<'a, R: ?Sized> {
    references: &'a R,
    slice: &'a TimeSlice,
    /// Those of one leaf behind those of the other.
    numbers: &'a [u32],
    sizes: &'a [f32],
    median: f32,
}

impl<R: References + ?Sized> Kernel for Compare<'_, R> {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<u32> {
        let Compare { references, slice, numbers, sizes, median } = self;
        let mut fast = Vec::new();
        let whole = slice.range([slice.interval.begin(), slice.interval.end_bound()]);
        for (number, (leaf, size)) in numbers.chunks(LANES).zip(sizes).enumerate() {
            for &later in numbers.iter().skip((number + 8) * LANES).take(LANES) {
                references.prefetch(later);
            }
            let least = f64::from(size.min(median));
            // Behind all others.
            let mut displacement = [[f64::INFINITY; LANES]; 3];
            let mut range = [whole; LANES];
            for (lane, &number) in leaf.iter().enumerate() {
                let m = references.reference(number);
                for (axis, row) in displacement.iter_mut().enumerate() {
                    row[lane] = f64::from(m.close[axis]) - f64::from(m.open[axis]);
                }
                if m.interval != slice.interval {
                    range[lane] = m.range(slice);
                }
            }
            let mut usual = [0.0; 3];
            for axis in 0..3 {
                usual[axis] = middle(s, &displacement[axis], leaf.len() / 2);
            }
            for (lane, &number) in leaf.iter().enumerate() {
                let mut far = 0.0;
                for axis in 0..3 {
                    far = f64::max(far, (displacement[axis][lane] - usual[axis]).abs());
                }
                let [begin, end] = range[lane];
                if far * (end - begin) > FAST * least {
                    fast.push(number);
                }
            }
        }
        fast
    }
}

/// The number that so many of sixteen are before in ascending order.
#[inline(always)]
fn middle<S: Simd>(s: S, row: &Lanes<f64>, number: usize) -> f64 {
    for &x in row {
        let (mut not_below, mut not_above) = (0, 0);
        for four in row.as_chunks().0 {
            let (four, x) = (s.load_d(four), s.splat_d(x));
            not_below += s.le_d(x, four).count_ones() as usize;
            not_above += s.le_d(four, x).count_ones() as usize;
        }
        if LANES - not_below <= number && number < not_above {
            return x;
        }
    }
    unreachable!("one of the numbers is in the middle")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_middle_is_that_of_the_sorted_numbers() {
        struct Middle<'a>(&'a Lanes<f64>, usize);
        impl Kernel for Middle<'_> {
            type Output = f64;
            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> f64 {
                middle(s, self.0, self.1)
            }
        }
        let mut random = Random(3);
        for round in 0..200 {
            let count = 1 + round % LANES;
            let mut row = [f64::INFINITY; LANES];
            // Some of them equal.
            row[..count].iter_mut().for_each(|x| *x = f64::from((random.signed() * 8.0).floor()));
            let mut sorted = row;
            sorted.sort_by(f64::total_cmp);
            for level in SimdLevel::available() {
                assert_eq!(dispatch(level, Middle(&row, count / 2)), sorted[count / 2]);
            }
        }
    }
}
