//! Whether static points have a tree of their own.
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
