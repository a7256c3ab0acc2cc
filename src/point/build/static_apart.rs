//! Whether static points have a tree of their own.
//!
//! Where few points move, their tree is small, and the static points take the memory and the visits that they would take without
//! them. Where many move, a search visits two trees, which takes a quarter to two thirds more nodes and blocks than one tree in
//! which all points are nearly at rest. Then it is only done if motion makes the boxes of all points together clearly larger.

use super::excess::{Excess, excess, leaves_of};
use super::sample::Sampler;
use super::slice_points::SlicePoints;
use super::source::Source;
use super::time_slices::middle_slice;
use crate::point::leaf_order::fast_points::order_at;
use crate::point::leaf_order::moving_reference::References;
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
    let sizes: Vec<Excess> = if source.len <= SAMPLES * SAMPLE[0] {
        // Samples would hold all points.
        let slice = middle_slice(source.keys);
        let references = SlicePoints::<false>::new(source, &all, &slice);
        let order = order_at(&references, slice.middle_phase());
        vec![size(&references, &order, simd)]
    } else {
        let samples = Sampler::new(source, &all, simd).samples(1, None, true);
        samples.iter().map(|sample| size(&sample.references[..], &sample.order, simd)).collect()
    };
    sizes.iter().map(Excess::largest).sum::<f64>() > MAX_TOGETHER * sizes.len() as f64
}

/// How much larger the boxes of references in an order are for their motion.
fn size<R: References + ?Sized>(references: &R, order: &[u32], simd: SimdLevel) -> Excess {
    excess(&leaves_of(references, order), 0.5, &[1], simd)[0]
}
