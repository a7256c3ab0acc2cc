//! Traversals of the caller's own, through any tree.
//!
//! The picture: the tree at a time offers boxes; the visitor says which of them to go into and how soon, looks at what lies
//! in leaves, and says when it has seen enough. Trees differ in what a node is ([`Hierarchy`]), never in what a visitor sees.

use crate::geometry::Aabb;
use core::ops::ControlFlow;

/// What a traversal of the caller's own does: see [`RayTree::traverse`](crate::RayTree::traverse) and
/// [`PointTree::traverse`](crate::PointTree::traverse), which have examples.
///
/// `T` is what lies in leaves: [`TreePrimitive`](crate::TreePrimitive) or [`TreePoint`](crate::TreePoint).
pub trait Visitor<T> {
    /// Whether to go into a box, and how soon: of the children of a node those with lesser numbers are visited first.
    /// `None` leaves out all that is in it.
    ///
    /// The box, in world coordinates, holds all that it is around as it is at the time of the traversal; a part of
    /// what is in a leaf may stick out of the leaf's box if the rest of it is in other leaves.
    fn enter(&mut self, bounds: &Aabb) -> Option<f32>;

    /// Whether a box that [`Visitor::enter`] gave this number is still wanted, asked before it is visited: a search for the
    /// nearest has found something nearer by then, perhaps. The default is always.
    fn wants(&self, priority: f32) -> bool {
        let _ = priority;
        true
    }

    /// Looks at something in a leaf; `Break` ends the traversal. The same thing may be met in several leaves.
    fn visit(&mut self, item: T) -> ControlFlow<()>;
}

/// A tree at a time.
pub(crate) trait Hierarchy {
    /// A node or a leaf, with what has to be known to go on from there.
    type Node: Copy;
    /// What lies in leaves.
    type Item;
    /// Where to begin.
    fn roots(&self, roots: &mut Vec<Self::Node>);
    /// Appends the children of a node with the boxes around them, or what lies in a leaf.
    fn expand(&self, node: Self::Node, children: &mut Vec<(Aabb, Self::Node)>, items: &mut Vec<Self::Item>);
}

/// Leads a visitor through a tree. Returns what the visitor said last.
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
