//! Counting what time slices leave out because it does not exist in them.

use crate::layout::leaf::source::WideSource;
use crate::layout::wide_node::{ChildRef, Kind};
use crate::layout::wide_tree::WideTree;

/// Primitives below temporal splits, each counted once for each time slice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::layout) struct InSlices {
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
    pub(in crate::layout) fn in_slices<S: WideSource>(&self, set: &S, seen: &mut Vec<u32>) -> InSlices {
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
                _ => stack.extend(self.children(at)),
            }
        }
        all
    }

    /// Counts what the slices of one time node hold.
    fn in_slices_of(&self, time_node: ChildRef, seen: &mut [u32]) -> InSlices {
        let ids_below =
            |slice| self.leaves_below(slice).into_iter().map(|leaf| self.ids(leaf).unwrap_or(&[])).collect();
        let slices: Vec<Vec<&[u32]>> = self.children(time_node).map(ids_below).collect();
        for (i, ids) in slices.iter().enumerate() {
            ids.iter().copied().flatten().for_each(|&id| seen[id as usize] |= 1 << i);
        }
        let mut all = InSlices::default();
        for &id in slices.iter().flatten().copied().flatten() {
            // Each primitive is counted where it is found first.
            let held = core::mem::take(&mut seen[id as usize]).count_ones() as usize;
            if held > 0 {
                all = all.add(InSlices { all: slices.len(), left_out: slices.len() - held });
            }
        }
        all
    }
}
