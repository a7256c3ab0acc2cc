//! Ordering f64 points for a complete tree.
//!
//! An order may be found by rounded coordinates, because boxes are made around what is in them. So a range is ordered in f32,
//! relative to its middle ([`super::rounded_order`]). Parts of it whose leaves are too small for that are ordered relative to
//! their own middles. Where points are so close together, relative to the range, that rounding decides on which part they are in,
//! the range is divided once in f64, by position, and its halves are tried again.

use super::rounded_order::{PointsToOrder, order_in_f32};
use crate::parallel;
use crate::point::leaf_order::complete_tree::{left_part, subtree, subtrees_of};
use crate::point::leaf_order::widest_axis::widest_axis;
use crate::progress::Progress;

/// Ranges shorter than this are not divided among threads.
const SHARE: usize = 1 << 14;

/// Orders the numbers of points so that leaf i holds the i-th run of `leaf` of them, by motion as well if that is said. Once
/// `progress` is cancelled, ranges are left unordered.
pub(in crate::point) fn order<P: PointsToOrder>(
    numbers: &mut [u32],
    leaf: usize,
    points: &P,
    by_motion: bool,
    progress: &Progress,
) {
    let progress = progress.in_units(2 * numbers.len());
    order_range(numbers, leaf, (points, by_motion), &progress);
}

/// Orders a range that begins where a subtree does. A point counts 1 for `progress` when it is
/// in its part, and 1 when that is ordered.
fn order_range<P: PointsToOrder>(
    numbers: &mut [u32],
    leaf: usize,
    (points, by_motion): (&P, bool),
    progress: &Progress,
) {
    let count = numbers.len();
    if progress.cancelled() {
        return;
    }
    let Some(block) = subtrees_of(count, subtree(count, leaf), leaf) else {
        return progress.finished(count as f64);
    };
    let again = |part: &mut [u32]| order_range(part, leaf, (points, by_motion), progress);
    if order_in_f32(numbers, leaf, (points, by_motion), progress, again) {
        return;
    }
    let (left, axis) = (left_part(count, block), widest_axis(count, |i| points.at(numbers[i]).to_array()));
    select(numbers, left, |number| points.at(number)[axis]);
    let (low, high) = numbers.split_at_mut(left);
    let mut low = || order_range(low, leaf, (points, by_motion), progress);
    let mut high = || order_range(high, leaf, (points, by_motion), progress);
    if left < SHARE {
        low();
        high();
    } else {
        parallel::both(low, high);
    }
}

/// Brings the `count` points with the lowest keys to the front.
fn select(numbers: &mut [u32], count: usize, key: impl Fn(u32) -> f64) {
    let mut keys: Vec<(f64, u32)> = numbers.iter().map(|&number| (key(number), number)).collect();
    keys.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    numbers.iter_mut().zip(keys).for_each(|(to, (_, number))| *to = number);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::LANES;
    use glam::DVec3;

    struct Set<'a>(&'a [DVec3]);

    impl PointsToOrder for Set<'_> {
        fn at(&self, number: u32) -> DVec3 {
            self.0[number as usize]
        }
        fn displacement(&self, _: u32) -> DVec3 {
            DVec3::ZERO
        }
    }

    /// Orders points, and returns the mean size of the leaves along their widest axis.
    fn leaf_size(points: &[DVec3], leaf: usize) -> f64 {
        let mut numbers: Vec<u32> = (0..points.len() as u32).collect();
        let at = |number: u32| points[number as usize];
        order(&mut numbers, leaf, &Set(points), false, &Progress::new(None));
        let mut seen = numbers.clone();
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..points.len() as u32));
        let size = |leaf: &[u32]| {
            let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let (lo, hi) = leaf.iter().fold(none, |(lo, hi), &i| (lo.min(at(i)), hi.max(at(i))));
            (hi - lo).max_element()
        };
        let sizes = numbers.chunks(leaf).map(size);
        sizes.sum::<f64>() / points.len().div_ceil(leaf).max(1) as f64
    }

    /// Clusters so far apart that each is one place in f32 relative to the whole set have leaves as small as others.
    #[test]
    fn leaves_are_small_where_clusters_are_far_apart() {
        let mut random = Random(3);
        for leaf in [LANES, 2 * LANES] {
            let mut size = |apart: f64| {
                let mut point = |i: usize| {
                    let at = DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64());
                    at + DVec3::new(1.0, -2.0, 3.0) * ((i % 4) as f64 * apart)
                };
                // As many in each as a part has, or two.
                leaf_size(&(0..4 * 8192).map(&mut point).collect::<Vec<_>>(), leaf)
            };
            let (near, far) = (size(10.0), size(1e12));
            assert!(far < 1.05 * near, "{far} instead of {near}");
        }
    }

    /// Ranges that can be ordered in f32 and others in one set: clusters of all sizes, and places with many points.
    #[test]
    fn every_point_stays_whatever_the_set() {
        let mut random = Random(4);
        for count in [0, 1, 16, 17, 300, 4097, 20_000] {
            for leaf in [LANES, 2 * LANES] {
                let mut point = |i: usize| {
                    let size = 10f64.powi((i * i % 11) as i32 * 4 - 20);
                    let at = DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64());
                    (at * if i.is_multiple_of(3) { 1.0 } else { 1e3 }).floor() * size
                };
                leaf_size(&(0..count).map(&mut point).collect::<Vec<_>>(), leaf);
            }
        }
    }
}
