//! From how far away rays are too coarse in f32 for the leaf blocks of a tree.

use super::wide_node::{ChildRef, Kind};
use super::wide_tree::WideTree;
use crate::geometry::{KERNEL_ULPS, ULP};

/// The time at which boxes are looked at.
const MIDDLE: f32 = 0.5;

/// The slack of a ray may be this part of a leaf block's size, so that it meets at most a quarter more of them.
const PART_OF_SIZE: f32 = 1.0 / 16.0;

/// Boxes are padded by the rounding of their own coordinates. From so many times as far away a ray's slack is hardly larger.
const TIMES_AWAY: f32 = 4.0;

/// Primitives that are finer may be tested by every ray from far away.
const FEW: usize = 128;

/// The size of a scene is about 1, and from so far away origins are moved to it.
const MOST: f32 = 64.0;

/// A distance that is always near.
const LEAST: f32 = 1.0 / (1 << 30) as f32;

impl WideTree {
    /// A distance from the origin of tree space: of rays that begin within it, the slack is small beside nearly all leaf blocks, or
    /// beside the padding of their boxes. A power of two, and infinite beyond `MOST`.
    pub(super) fn fine_within(&self) -> f32 {
        // Primitives by the exponents of such distances.
        let (mut counts, mut stack) = ([0usize; 256], vec![self.root]);
        while let Some(at) = stack.pop() {
            match at.kind() {
                _ if at == ChildRef::NOTHING => {}
                Kind::Time => stack.push(self.child_at(at, MIDDLE)),
                Kind::Node | Kind::StaticNode => {
                    for (lane, child) in self.lanes(at) {
                        if !child.kind().is_leaf() {
                            stack.push(child);
                            continue;
                        }
                        let of = self.lane_box(at, lane, MIDDLE);
                        let size = of.half_area().max(0.0).sqrt();
                        let within = (size * (PART_OF_SIZE / (KERNEL_ULPS * ULP))).max(TIMES_AWAY * of.magnitude());
                        counts[(within.to_bits() >> 23) as usize & 0xff] += child.len();
                    }
                }
                _ => {}
            }
        }
        let mut finer = 0;
        for (exponent, count) in counts.into_iter().enumerate() {
            finer += count;
            if finer > FEW {
                let within = f32::from_bits((exponent as u32) << 23);
                return if within < MOST { within.max(LEAST) } else { f32::INFINITY };
            }
        }
        f32::INFINITY
    }
}
