//! Counting what time slices leave out because it does not exist in them.

use super::leaf_block::WideSource;
use super::wide_node::{ChildRef, Kind};
use super::wide_tree::WideTree;

/// Primitives below temporal splits, each counted once for each time slice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct InSlices {
    pub all: usize,
    /// Those of which a slice has no reference.
    pub left_out: usize,
}

impl InSlices {
    /// The share that is left out; 0 without temporal splits.
    pub fn share(self) -> f64 {
        self.left_out as f64 / self.all.max(1) as f64
    }

    pub fn add(self, other: InSlices) -> InSlices {
        InSlices { all: self.all + other.all, left_out: self.left_out + other.left_out }
    }
}

impl WideTree {
    /// [`Statistics::left_out`](crate::Statistics::left_out), for which all leaf blocks are visited if anything comes or goes.
    pub fn left_out<S: WideSource>(&self, set: &S) -> f64 {
        self.in_slices(set, &mut Vec::new()).share()
    }

    /// Counts what time slices hold, without reading the tree if nothing comes or goes. `seen` has a zero for each primitive of the
    /// set, before and after.
    pub(super) fn in_slices<S: WideSource>(&self, set: &S, seen: &mut Vec<u32>) -> InSlices {
        let mut all = InSlices::default();
        if set.always_active() || self.counts.time_nodes == 0 {
            return all;
        }
        seen.resize(set.len(), 0);
        let mut stack = vec![self.root];
        while let Some(at) = stack.pop() {
            match at.kind() {
                Kind::Time => all = all.add(self.in_slices_of(at, seen)),
                kind if kind.is_leaf() => {}
                _ => stack.extend(self.children(at).iter().map(|&c| ChildRef(c)).filter(|&c| c != ChildRef::NOTHING)),
            }
        }
        all
    }

    /// Counts what the slices of one time node hold.
    fn in_slices_of(&self, time_node: ChildRef, seen: &mut [u32]) -> InSlices {
        let (mut all, slices) = (InSlices::default(), self.children(time_node));
        for (i, &slice) in slices.iter().enumerate() {
            self.for_each_below(ChildRef(slice), &mut |id| seen[id as usize] |= 1 << i);
        }
        for &slice in slices {
            self.for_each_below(ChildRef(slice), &mut |id| {
                // Each primitive is counted where it is found first.
                let held = core::mem::take(&mut seen[id as usize]).count_ones() as usize;
                if held > 0 {
                    all = all.add(InSlices { all: slices.len(), left_out: slices.len() - held });
                }
            });
        }
        all
    }

    /// Calls a function with the id of each reference below a node, or in a leaf block.
    fn for_each_below(&self, root: ChildRef, call: &mut impl FnMut(u32)) {
        let mut stack = vec![root];
        while let Some(at) = stack.pop() {
            if at.kind().is_leaf() {
                self.ids(at).unwrap_or(&[]).iter().for_each(|&id| call(id));
            } else {
                stack.extend(self.children(at).iter().map(|&c| ChildRef(c)).filter(|&c| c != ChildRef::NOTHING));
            }
        }
    }
}
