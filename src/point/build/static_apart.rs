//! Which points of a set are static, and whether they have a tree of their own.
//!
//! Where few points move, their tree is small, and the static points take the memory and the visits that they would take without
//! them. Where many move, a search visits two trees, which takes a quarter to two thirds more nodes and blocks than one tree in
//! which all points are nearly at rest. Then it is only done if motion makes the boxes of all points together clearly larger.

use super::excess::{Excess, leaves_by_position};
use super::sample::{Sample, Sampler};
use super::slice_points::SlicePoints;
use super::source::Source;
use super::time_slices::middle_slice;
use crate::simd::SimdLevel;
use crate::tuning::points::{MAX_TOGETHER, MIN_STATIC_SHARE, MOSTLY_STATIC, SAMPLE, SAMPLES};

/// The static points of a set, and the others.
pub(in crate::point) struct Partition {
    len: usize,
    /// Whether each point is static; empty if all are known to be.
    is_static: Vec<bool>,
    pub(in crate::point) static_count: usize,
}

impl Partition {
    pub(in crate::point) fn of(source: &Source) -> Partition {
        let len = source.len;
        if source.all_static() {
            return Partition { len, is_static: Vec::new(), static_count: len };
        }
        let is_static = source.static_points();
        let static_count = is_static.iter().filter(|&&is_static| is_static).count();
        Partition { len, is_static, static_count }
    }

    fn is_static(&self, point: usize) -> bool {
        self.is_static.get(point).is_none_or(|&is_static| is_static)
    }

    /// The static points, ascending.
    pub(in crate::point) fn static_points(&self) -> impl Iterator<Item = usize> {
        (0..self.len).filter(|&point| self.is_static(point))
    }

    /// Why the static points have a layer of their own.
    pub(in crate::point) fn why(&self) -> String {
        format!("{} of {} points are static", self.static_count, self.len)
    }

    /// All other points, ascending.
    pub(in crate::point) fn moving_points(&self) -> Vec<u32> {
        (0..self.len as u32).filter(|&point| !self.is_static(point as usize)).collect()
    }
}

/// Whether the static points of a set, so many of all, are better put into a tree of their own.
pub(in crate::point) fn static_apart(source: &Source, static_points: usize, simd: SimdLevel) -> bool {
    let share = static_points as f64 / source.len as f64;
    if share < MIN_STATIC_SHARE {
        return false;
    }
    if share >= MOSTLY_STATIC || !source.all_persist() {
        return true;
    }
    let all: Vec<u32> = (0..source.len as u32).collect();
    let leaves = if source.len <= SAMPLES * SAMPLE[0] {
        // Samples would hold all points.
        let slice = middle_slice(source.keys);
        vec![leaves_by_position(&SlicePoints::<false>::new(source, &all, &slice), &slice)]
    } else {
        Sampler::new(source, &all, simd).samples(1, true).iter().map(Sample::leaves).collect()
    };
    let sizes = leaves.iter().map(|leaves| Excess::of_segment(leaves, simd).largest());
    sizes.sum::<f64>() > MAX_TOGETHER * leaves.len() as f64
}
