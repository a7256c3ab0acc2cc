//! Custom traversals of any tree.
//!
//! The picture: the tree, at one time, offers boxes. The visitor decides which of them to enter and in which order,
//! sees the contents of leaves, and ends the traversal when it is done. Trees differ in what a node is ([`Hierarchy`]);
//! all look the same to a visitor.

use crate::geometry::Aabb;
use core::ops::ControlFlow;

/// A custom traversal: see [`RayTree::traverse`](crate::RayTree::traverse) and
/// [`PointTree::traverse`](crate::PointTree::traverse), which have examples.
///
/// `T` is the type of the items in leaves: [`TreePrimitive`](crate::TreePrimitive) or [`TreePoint`](crate::TreePoint).
pub trait Visitor<T> {
    /// Whether to enter a box, and its priority: of the children of a node those with smaller numbers are visited
    /// first. `None` skips the box with all its contents.
    ///
    /// The box, in world coordinates, holds its contents as they are at the time of the traversal. An item of a leaf
    /// may stick out of the leaf's box if other leaves hold the rest of it.
    fn enter(&mut self, bounds: &Aabb) -> Option<f32>;

    /// Whether a box that [`Visitor::enter`] gave this priority is still wanted. Called just before the box is visited,
    /// since a nearest-neighbor search may have found something nearer by then. The default is always.
    fn wants(&self, priority: f32) -> bool {
        let _ = priority;
        true
    }

    /// Visits an item of a leaf; `Break` ends the traversal. An item may be visited in several leaves.
    fn visit(&mut self, item: T) -> ControlFlow<()>;
}

/// A tree at a time, as seen by [`traverse`].
pub(crate) trait Hierarchy {
    /// A node or a leaf, with all that is needed to expand it.
    type Node: Copy;
    /// The type of the items in leaves.
    type Item;
    /// Appends the roots of the tree.
    fn roots(&self, roots: &mut Vec<Self::Node>);
    /// Appends the children of a node with their boxes, or the items of a leaf.
    fn expand(&self, node: Self::Node, children: &mut Vec<(Aabb, Self::Node)>, items: &mut Vec<Self::Item>);
}

/// Traverses a tree with a visitor. Returns the visitor's last return value.
pub(crate) fn traverse<H: Hierarchy>(tree: &H, visitor: &mut impl Visitor<H::Item>) -> ControlFlow<()> {
    let mut roots = Vec::new();
    tree.roots(&mut roots);
    let mut stack: Vec<(f32, H::Node)> = roots.into_iter().map(|root| (f32::NEG_INFINITY, root)).collect();
    let (mut children, mut items) = (Vec::new(), Vec::new());
    while let Some((priority, node)) = stack.pop() {
        if !visitor.wants(priority) {
            continue;
        }
        tree.expand(node, &mut children, &mut items);
        for item in items.drain(..) {
            visitor.visit(item)?;
        }
        let begin = stack.len();
        stack.extend(children.drain(..).filter_map(|(bounds, child)| Some((visitor.enter(&bounds)?, child))));
        stack[begin..].sort_by(|a, b| b.0.total_cmp(&a.0));
    }
    ControlFlow::Continue(())
}
