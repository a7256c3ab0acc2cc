//! Where a tree was when it was built, and what rays that meet this place cost since then.
//!
//! The cost of a refitted tree is that of rays that meet its root's box ([`super::refit_tree`]). If a part of the scene flies
//! off, the box grows, and hardly any of those rays meets what is left, though it may be held by much larger boxes than before.
//! So where the extent has grown, the cost is computed for the rays that meet the former box as well: with the parts of all boxes
//! that lie in it.

use crate::bvh::{leaf_cost, mean_half_area, motion_factor};
use crate::geometry::{Aabb, Box3, LinearBounds, LinearBox3, TimeInterval};
use crate::layout::node_boxes::read_box;
use crate::layout::wide_node::{ChildRef, Kind};
use crate::layout::wide_tree::WideTree;
use crate::parallel;
use crate::simd::LANES;
use crate::time::time_slice;
use crate::tuning::wide::NODE_COST;
use glam::DVec3;

/// The bounds of a tree when it was built, in world space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BuiltPlace {
    swept: Aabb,
    /// The mean area over the shutter, relative to that of `swept`.
    share: f64,
}

/// By how much the area of the bounds grows before the former place is looked at.
const GROWN: f64 = 1.05;

impl BuiltPlace {
    /// The place of a tree with these bounds.
    pub fn new(bounds: &LinearBounds) -> BuiltPlace {
        let swept = bounds.swept();
        let [begin, end] = [bounds.begin, bounds.end].map(|b| b.max - b.min);
        let mean = (half_area(begin) + half_area(end) + half_area(begin + end)) / 6.0;
        BuiltPlace { swept, share: mean / half_area(swept.max - swept.min) }
    }

    /// Whether bounds have grown since then.
    pub fn is_outgrown(&self, bounds: &LinearBounds) -> bool {
        let [before, now] = [self.swept, bounds.swept()].map(|b| half_area(b.max - b.min));
        self.share.is_finite() && now > GROWN * before
    }

    /// Its bounds.
    pub fn bounds(&self) -> Aabb {
        self.swept
    }

    /// The cost of a tree per area of this place, from that per area of the root when it was built.
    pub fn cost(&self, per_root: f64) -> f64 {
        per_root * self.share
    }
}

/// In f64, since squares of world coordinates may exceed f32.
fn half_area(size: DVec3) -> f64 {
    size.x * size.y + size.y * size.z + size.z * size.x
}

impl WideTree {
    /// The cost of a ray that meets a region: the sum over nodes and leaf blocks of the cost of a visit times the area of the part
    /// of their bounds that lies in the region, per area of the region. Visits the nodes that reach into it. Zero for a region that
    /// is so small beside the scene that f32 has no area for it.
    pub fn cost_within(&self, region: Box3) -> f64 {
        let area = mean_half_area(&LinearBox3 { begin: region, end: region });
        if !area.is_normal() {
            return 0.0;
        }
        self.clipped_cost(self.root, TimeInterval::FULL, &region, true) / f64::from(area)
    }

    /// The sum of cost times area of a subtree. The recursion is as deep as the tree.
    fn clipped_cost(&self, at: ChildRef, over: TimeInterval, region: &Box3, at_root: bool) -> f64 {
        let children: Vec<ChildRef> = self.slots(at).iter().map(|&child| ChildRef(child)).collect();
        if at.kind() == Kind::Time {
            let slice = |i: usize| self.clipped_cost(children[i], time_slice(i, children.len()), region, false);
            return (0..children.len()).map(slice).sum::<f64>() / children.len().max(1) as f64;
        }
        if at.kind().is_leaf() {
            return 0.0;
        }
        let block = &self.arena.ints()[at.at()..];
        let of_lane = |lane: usize| {
            let whole = read_box(block, at.kind(), lane, over);
            let inside = clipped(whole, region);
            let area = f64::from(mean_half_area(&inside));
            let child = children[lane];
            let below = if area <= 0.0 {
                0.0
            } else if child.kind().is_leaf() {
                let count = self.ids(child).map_or(0, <[u32]>::len);
                f64::from(leaf_cost(count) * motion_factor(inside.begin != inside.end)) * area
            } else {
                self.clipped_cost(child, over, region, false)
            };
            (whole, below)
        };
        let mut lanes: Vec<usize> = (0..LANES).filter(|&lane| children[lane] != ChildRef::NOTHING).collect();
        let found = match at_root {
            true => parallel::each(&mut lanes, |lane| of_lane(*lane)),
            false => lanes.into_iter().map(of_lane).collect(),
        };
        let (mut all, mut cost) = (LinearBox3::EMPTY, 0.0);
        for (whole, below) in found {
            (all, cost) = (all.union(whole), cost + below);
        }
        let visit = NODE_COST * motion_factor(at.kind() == Kind::Node);
        cost + f64::from(visit) * f64::from(mean_half_area(&clipped(all, region)))
    }
}

/// The part of a box in a region at both of its ends.
fn clipped(b: LinearBox3, region: &Box3) -> LinearBox3 {
    let clip = |b: Box3| {
        let inside = b.intersection(*region);
        if inside.is_empty() { Box3::EMPTY } else { inside }
    };
    LinearBox3 { begin: clip(b.begin), end: clip(b.end) }
}
