//! Sizes and counts of a finished tree.

use super::leaf::source::WideSource;
use super::wide_tree::{Counts, WideTree};
use crate::kd::{BuildTimes, KdReference, KdTree, KdView};
use crate::primitive::PrimitiveSet;
use core::fmt;

/// Sizes and counts of a finished tree ([`RayTree::statistics`](crate::RayTree::statistics)). Printed with `{}`, they are one line
/// that says what the tree skips.
///
/// A field that names a kind of tree is 0 for others. Wide trees include those of instances, and lazy trees count as wide.
///
/// ```
/// use mbkd::{BuildParams, RayTree, TriangleMesh, glam::Vec3};
/// let key = |t: f32| vec![Vec3::ZERO, Vec3::X + t, Vec3::Y];
/// let straight = TriangleMesh::new(vec![[0, 1, 2]], vec![key(0.0), key(0.5), key(1.0)]);
/// let fixed = TriangleMesh::fixed(vec![[0, 1, 2]], key(0.3));
/// let tree = RayTree::build(&[straight, fixed], &BuildParams::default())?;
/// let printed = tree.statistics().to_string();
/// assert!(printed.starts_with("2 primitives, 1.00 references each; 0 nodes and 1 leaf, depth 0; 75 % of the vertex positions"));
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Primitives in the tree.
    pub primitives: usize,
    /// Inner nodes.
    pub nodes: usize,
    /// Leaves, empty ones included.
    pub leaves: usize,
    /// Leaves without references (k-d trees).
    pub empty_leaves: usize,
    /// Depth of the deepest leaf; the root has depth 0.
    pub depth: u32,
    /// References in the leaves.
    pub references: usize,
    /// Share of the references that are duplicates: references beyond the first of each primitive, divided by
    /// all references.
    pub duplicates: f64,
    /// Share of the references whose time interval is a part of their primitive's, of all references (k-d trees).
    pub timed: f64,
    /// Share of the build time spent in duplication: distributing the Normal references of a node to its children (k-d trees).
    pub duplication_time: f64,
    /// Share of the build time spent in propagation: distributing the BP references (k-d trees).
    pub propagation_time: f64,
    /// Vertex positions of all meshes, over all keys, as given to the build.
    pub positions: usize,
    /// Those of them that are stored: keys on the straight line between others are removed, and so are keys of static
    /// vertices.
    pub kept_positions: usize,
    /// References to static triangles, in leaf blocks without motion (wide trees).
    pub static_references: usize,
    /// Temporal splits: nodes that select a child by the time of the query (wide trees).
    pub time_nodes: usize,
    /// Share of the primitives below temporal splits, each counted once for each time slice, that the slice leaves out since they
    /// do not exist in it (wide trees). 0 if everything exists all the time.
    pub left_out: f64,
    /// Subtrees that are built when a query first enters them ([`Policy::Lazy`](crate::Policy::Lazy)).
    pub subtrees: usize,
    /// Those of them that are built. Nodes, leaves, references and bytes are those of built subtrees and of the coarse
    /// tree.
    pub built_subtrees: usize,
    /// Expected cost of a ray, relative to that of the tree as it was built: 1, and usually more after a refit
    /// ([`Refit::cost`](crate::Refit::cost)).
    pub cost: f64,
    /// Bytes allocated for the tree.
    pub bytes: usize,
    /// Bytes allocated for the primitives, with the tables that say where the tree has them. What shapes have allocated themselves,
    /// as spheres have their keys, is not counted.
    pub primitive_bytes: usize,
}

impl Statistics {
    /// References per primitive; 0 for an empty tree.
    pub fn references_per_primitive(&self) -> f64 {
        if self.primitives == 0 { 0.0 } else { self.references as f64 / self.primitives as f64 }
    }

    pub(crate) fn with_times(self, times: BuildTimes) -> Statistics {
        Statistics {
            duplication_time: times.share(times.duplication),
            propagation_time: times.share(times.propagation),
            ..self
        }
    }
}

impl fmt::Display for Statistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let share = |part: usize, all: usize| percent(part as f64 / all.max(1) as f64);
        let primitives = counted(self.primitives as u64, "primitive", "primitives");
        write!(f, "{primitives}, {:.2} references each", self.references_per_primitive())?;
        if self.static_references > 0 {
            write!(f, ", {} of them static", share(self.static_references, self.references))?;
        }
        if self.timed > 0.0 {
            write!(f, ", {} for a part of the time", percent(self.timed))?;
        }
        let (nodes, leaves) =
            (counted(self.nodes as u64, "node", "nodes"), counted(self.leaves as u64, "leaf", "leaves"));
        write!(f, "; {nodes} and {leaves}, depth {}", self.depth)?;
        if self.time_nodes > 0 {
            write!(f, "; {}", counted(self.time_nodes as u64, "temporal split", "temporal splits"))?;
        }
        if self.left_out > 0.0 {
            write!(f, ", {} left out", percent(self.left_out))?;
        }
        if self.kept_positions < self.positions {
            write!(f, "; {} of the vertex positions kept", share(self.kept_positions, self.positions))?;
        }
        if self.subtrees > 0 {
            write!(f, "; {} of {} subtrees built", self.built_subtrees, self.subtrees)?;
        }
        // Cost is 1 unless the tree was refitted.
        if self.cost != 1.0 {
            write!(f, "; cost {:.2} of that when built", self.cost)?;
        }
        write!(f, "; {} and {} of primitives", Bytes(self.bytes), Bytes(self.primitive_bytes))
    }
}

/// A number and a noun.
pub(crate) fn counted(n: u64, one: &str, more: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { more })
}

/// A number of bytes, printed with three digits or so.
pub(crate) struct Bytes(pub usize);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 as f64 {
            bytes if bytes < 1e4 => write!(f, "{bytes:.0} bytes"),
            bytes if bytes < 1e6 => write!(f, "{:.0} kB", bytes / 1e3),
            bytes if bytes < 1e9 => write!(f, "{:.1} MB", bytes / 1e6),
            bytes => write!(f, "{:.2} GB", bytes / 1e9),
        }
    }
}

impl WideTree {
    /// The statistics of the tree, but for what time slices leave out ([`WideTree::left_out`]).
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let Counts { depth, nodes, leaves, references, time_nodes, static_references, .. } = self.counts;
        let primitives = set.len() - set.hidden().len();
        let duplicates = references - primitives.min(references);
        Statistics {
            primitives,
            nodes,
            leaves,
            depth,
            references,
            duplicates: duplicates as f64 / references.max(1) as f64,
            positions: set.positions()[0],
            kept_positions: set.positions()[1],
            static_references,
            time_nodes,
            cost: 1.0,
            bytes: self.arena.bytes(),
            primitive_bytes: set.bytes()
                + self.blocks.capacity() * size_of::<u32>()
                + self.masks.bytes()
                + self.intervals.bytes(),
            ..Statistics::default()
        }
    }
}

impl KdTree {
    /// Counts nodes and references.
    pub fn statistics(&self, set: &impl PrimitiveSet) -> Statistics {
        let (mut leaves, mut empty_leaves) = (0, 0);
        for node in &self.nodes {
            if let KdView::Leaf { count, .. } = node.view() {
                leaves += 1;
                empty_leaves += usize::from(count == 0);
            }
        }
        let timed = self.references.iter().filter(|r| **r != KdReference::new(r.id, set.active(r.id))).count();
        let references = self.references.len();
        let share = |n: usize| n as f64 / references.max(1) as f64;
        Statistics {
            primitives: set.len(),
            nodes: self.nodes.len() - leaves,
            leaves,
            empty_leaves,
            depth: self.depth,
            references,
            duplicates: share(references - set.len().min(references)),
            timed: share(timed),
            positions: set.positions()[0],
            kept_positions: set.positions()[1],
            cost: 1.0,
            bytes: self.bytes(),
            primitive_bytes: set.bytes(),
            ..Statistics::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_tree_skips_is_printed() {
        let all = Statistics {
            primitives: 100,
            nodes: 3,
            leaves: 20,
            depth: 2,
            references: 150,
            timed: 0.25,
            positions: 10,
            kept_positions: 1,
            static_references: 75,
            time_nodes: 1,
            left_out: 0.4,
            subtrees: 9,
            built_subtrees: 2,
            cost: 1.07,
            bytes: 12_345,
            primitive_bytes: 9_999,
            ..Statistics::default()
        };
        let expected = "100 primitives, 1.50 references each, 50 % of them static, 25 % for a part of the time; 3 nodes and 20 leaves, \
            depth 2; 1 temporal split, 40 % left out; 10 % of the vertex positions kept; 2 of 9 subtrees built; cost 1.07 of that \
            when built; 12 kB and 9999 bytes of primitives";
        assert_eq!(all.to_string(), expected);
        let sizes = [0, 9_999, 10_000, 123_456_789, 4_000_000_000].map(|bytes| Bytes(bytes).to_string());
        assert_eq!(sizes, ["0 bytes", "9999 bytes", "10 kB", "123.5 MB", "4.00 GB"]);
    }
}
