//! Counts and sizes of a tree of instances.

use super::tree::{InstanceOf, InstanceTree};
use crate::layout::{Bytes, Statistics, counted};
use crate::primitive::PrimitiveSet;
use std::collections::HashMap;

/// Counts and sizes of an [`InstanceTree`]. Printed with `{}`, they are one line.
///
/// ```
/// use mbkd::{BuildParams, Instance, InstanceTree, Pose, RayTree, TriangleMesh, WideParams, glam::Vec3};
/// use std::sync::Arc;
/// let card = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
/// let card = Arc::new(RayTree::build(&[card], &BuildParams::default())?);
/// let all = (0..2).map(|_| Instance::new(card.clone(), vec![Pose::IDENTITY])).collect();
/// let printed = InstanceTree::build(all, &WideParams::default())?.statistics().to_string();
/// assert!(printed.starts_with("2 instances of 1 tree, 2 primitives placed; "));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceStatistics {
    /// Instances at all levels together, counted once per placement, hidden ones included.
    pub instances: u64,
    /// Primitives, counted once per placement that is not hidden.
    pub primitives: u64,
    /// Distinct trees of primitives.
    pub trees: usize,
    /// Bytes of those trees and their primitives.
    pub tree_bytes: usize,
    /// Bytes of everything else: instances, their transforms, the trees over them.
    pub instance_bytes: usize,
    /// The outermost tree, whose primitives are the instances that are not hidden.
    pub outermost: Statistics,
}

impl core::fmt::Display for InstanceStatistics {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let InstanceStatistics { instances, primitives, trees, tree_bytes, instance_bytes, .. } = *self;
        write!(f, "{} of {}, ", counted(instances, "instance", "instances"), counted(trees as u64, "tree", "trees"))?;
        write!(f, "{} placed; ", counted(primitives, "primitive", "primitives"))?;
        write!(f, "{} for the trees, {} for the instances", Bytes(tree_bytes), Bytes(instance_bytes))
    }
}

/// Instances and primitives of a tree, each counted once per placement.
#[derive(Clone, Copy)]
struct Contents {
    instances: u64,
    primitives: u64,
}

/// Adds up the statistics of trees. Each distinct tree is visited once, however often it is placed.
struct Census {
    /// The contents of the trees visited so far, by address.
    known: HashMap<usize, Contents>,
    trees: usize,
    tree_bytes: usize,
    instance_bytes: usize,
}

impl Census {
    fn visit(&mut self, of: &InstanceOf) -> Contents {
        if let Some(&known) = self.known.get(&of.address()) {
            return known;
        }
        let placed = match of {
            InstanceOf::Tree(tree) => {
                let statistics = tree.statistics();
                self.trees += 1;
                self.tree_bytes += statistics.bytes + statistics.primitive_bytes;
                Contents { instances: 0, primitives: statistics.primitives as u64 }
            }
            InstanceOf::Instances(tree) => self.visit_instances(tree, tree.wide.statistics(&tree.placements)),
        };
        self.known.insert(of.address(), placed);
        placed
    }

    /// Visits a tree of instances, whose own nodes and instances have these statistics.
    fn visit_instances(&mut self, tree: &InstanceTree, own: Statistics) -> Contents {
        self.instance_bytes += own.bytes + own.primitive_bytes + tree.trees.capacity() * size_of::<InstanceOf>();
        let mut placed = vec![0u64; tree.trees.len()];
        for one in &tree.placements.placed {
            placed[one.tree as usize] += 1;
        }
        let mut shown = placed.clone();
        for &id in tree.placements.hidden() {
            shown[tree.placements.placed[id as usize].tree as usize] -= 1;
        }
        let mut all = Contents { instances: 0, primitives: 0 };
        for ((of, placed), shown) in tree.trees.iter().zip(placed).zip(shown) {
            let below = self.visit(of);
            let instances = placed.saturating_mul(below.instances.saturating_add(1));
            all.instances = all.instances.saturating_add(instances);
            all.primitives = all.primitives.saturating_add(shown.saturating_mul(below.primitives));
        }
        all
    }
}

impl InstanceTree {
    /// The sizes and counts of the tree. Visits every distinct tree once, and every instance in it.
    pub fn statistics(&self) -> InstanceStatistics {
        let own = self.wide.statistics(&self.placements);
        let mut census = Census { known: HashMap::new(), trees: 0, tree_bytes: 0, instance_bytes: 0 };
        let Contents { instances, primitives } = census.visit_instances(self, own);
        InstanceStatistics {
            instances,
            primitives,
            trees: census.trees,
            tree_bytes: census.tree_bytes,
            instance_bytes: census.instance_bytes,
            outermost: Statistics { left_out: self.wide.left_out(&self.placements), ..own },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instance::{Instance, Pose};
    use crate::params::{BuildParams, WideParams};
    use crate::primitive::TriangleMesh;
    use crate::ray::RayTree;
    use glam::Vec3;
    use std::sync::Arc;

    /// A census that visited trees once per path would visit eight billion here, and not end.
    #[test]
    fn every_tree_is_visited_once_however_many_paths_lead_to_it() {
        const EACH: usize = 300;
        let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
        let tree = || Arc::new(RayTree::build(core::slice::from_ref(&mesh), &BuildParams::default()).expect("a tree"));
        let mut level: Vec<InstanceOf> = (0..EACH).map(|_| tree().into()).collect();
        let over = |level: &[InstanceOf]| {
            let all = level.iter().map(|of| Instance::new(of.clone(), Pose::IDENTITY)).collect();
            InstanceTree::build(all, &WideParams::default()).expect("a tree")
        };
        for _ in 0..3 {
            level = (0..EACH).map(|_| Arc::new(over(&level)).into()).collect();
        }
        let statistics = over(&level).statistics();
        let each = EACH as u64;
        assert_eq!(statistics.primitives, each.pow(4));
        assert_eq!(statistics.instances, each + each.pow(2) + each.pow(3) + each.pow(4));
        assert_eq!(statistics.trees, EACH);
    }
}
