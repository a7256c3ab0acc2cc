//! Distances of sixteen boxes as integer keys that contain their lane.
//!
//! A key is the bits of a squared distance (order-preserving for floats that are not negative), the low four replaced by
//! the lane: the least of sixteen keys gives the nearest box and its lane. Replacing bits can raise a key by up to
//! fifteen ulps above the distance, so [`unpack`] masks them away; the rest never exceeds the distance.

use crate::point::layout::view::{Target, View};
use crate::simd::{LANES, Mask, Simd};

/// The bits of a key that hold the lane.
pub(super) const LANE_BITS: u32 = LANES as u32 - 1;

/// The lane indices.
const LANE: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Distances as keys.
#[inline(always)]
pub(super) fn keys<S: Simd>(s: S, distances: S::F) -> S::U {
    (s.to_bits(distances) & s.splat_u(!LANE_BITS)) | s.load_u(&LANE)
}

/// The lane of a key, and a lower bound of its distance.
#[inline(always)]
pub(super) fn unpack(key: u32) -> (usize, f32) {
    ((key & LANE_BITS) as usize, f32::from_bits(key & !LANE_BITS))
}

/// The smallest of several boxes that hold the point. The tightest box predicts its neighbours best; a box that is
/// large because it also holds a distant point predicts nothing.
#[inline(always)]
pub(super) fn smallest<S: Simd, V: View>(s: S, view: &V, target: &Target<S>, node: usize, boxes: Mask) -> u32 {
    let sizes = s.select(boxes, view.box_sizes(s, target, node), s.splat(f32::INFINITY));
    let lane = s.reduce_min_u(keys(s, sizes)) & LANE_BITS;
    // Sizes that overflow may give any lane.
    if boxes >> lane & 1 != 0 { lane } else { boxes.trailing_zeros() }
}
