//! The active interval of each block, by which closest-point queries skip what does not exist at their time. Without it, where few
//! of many primitives exist, every leaf block might be nearer than these.

use super::leaf::source::WideSource;
use super::wide_node::ChildRef;
use super::wide_tree::{BlockIntervals, WideTree};
use crate::geometry::TimeInterval;

impl BlockIntervals {
    /// The intervals of a tree over a set, whose leaf blocks hold the primitives `ids`.
    pub(super) fn of<'a, S: WideSource>(
        tree: &'a WideTree,
        set: &S,
        ids: impl Fn(ChildRef) -> Option<&'a [u32]>,
    ) -> BlockIntervals {
        if set.always_active() {
            return BlockIntervals::default();
        }
        let of_leaf = |leaf| {
            let active = ids(leaf).unwrap_or_default().iter().map(|&id| set.active(id));
            active.reduce(TimeInterval::hull)
        };
        let unite = |one: Option<TimeInterval>, other: Option<TimeInterval>| match (one, other) {
            (Some(one), Some(other)) => Some(one.hull(other)),
            _ => one.or(other),
        };
        let by_line =
            tree.unions(None, of_leaf, unite).into_iter().map(|active| active.unwrap_or(TimeInterval::FULL)).collect();
        BlockIntervals { by_line }
    }
}
