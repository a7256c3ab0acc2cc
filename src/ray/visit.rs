//! Custom traversals of a [`RayTree`].

use super::layout::Layout;
use super::ray_tree::RayTree;
use super::traversal::kd_traversal::KERNEL_ROUNDING;
use crate::geometry::{Aabb, Box3, ULP};
use crate::kd::{KdTree, KdView};
use crate::layout::{ChildRef, Kind, LazyTree, WideTree};
use crate::primitive::{PrimitiveSet, Scene};
use crate::traverse::{Hierarchy, Visitor, traverse};
use core::ops::ControlFlow;

/// A primitive in a leaf of a [`RayTree`], as passed to a [`Visitor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TreePrimitive {
    /// The mesh, as an index into the meshes that the tree was built of; the number of meshes for one of the other shapes of a
    /// scene, so 0 for a tree of shapes only.
    pub mesh: u32,
    /// The triangle within its mesh, or the primitive's index.
    pub primitive: u32,
}

/// The primitives of a leaf that are active at the time.
fn primitives<'a>(
    scene: &'a Scene,
    time: f32,
    ids: impl Iterator<Item = u32> + 'a,
) -> impl Iterator<Item = TreePrimitive> + 'a {
    ids.filter(move |&id| scene.exists_at(id, time)).map(|id| {
        let (mesh, primitive) = scene.mesh_and_primitive(id);
        TreePrimitive { mesh, primitive }
    })
}

/// The wide layout at a time.
struct WideAt<'a> {
    tree: &'a WideTree,
    scene: &'a Scene,
    time: f32,
}

impl Hierarchy for WideAt<'_> {
    type Node = ChildRef;
    type Item = TreePrimitive;

    fn roots(&self, roots: &mut Vec<ChildRef>) {
        roots.extend(Some(self.tree.root).filter(|&root| root != ChildRef::NOTHING));
    }

    fn expand(&self, node: ChildRef, children: &mut Vec<(Aabb, ChildRef)>, items: &mut Vec<TreePrimitive>) {
        let mut at = node;
        while at.kind() == Kind::Time {
            at = self.tree.child_at(at, self.time);
        }
        if let Some(ids) = self.tree.ids(at) {
            items.extend(primitives(self.scene, self.time, ids.iter().copied()));
        }
        let frame = self.scene.frame();
        let lanes = self.tree.lanes(at);
        children
            .extend(lanes.map(|(lane, child)| (frame.box_to_world(self.tree.lane_box(at, lane, self.time)), child)));
    }
}

/// A lazy tree at a time. A node is one of the coarse tree, or of the subtree whose number it carries.
struct LazyAt<'a> {
    tree: &'a LazyTree,
    scene: &'a Scene,
    time: f32,
}

impl Hierarchy for LazyAt<'_> {
    type Node = (Option<u32>, ChildRef);
    type Item = TreePrimitive;

    fn roots(&self, roots: &mut Vec<Self::Node>) {
        let root = Some(self.tree.top.root).filter(|&root| root != ChildRef::NOTHING);
        roots.extend(root.map(|root| (None, root)));
    }

    fn expand(
        &self,
        (mut of, mut node): Self::Node,
        children: &mut Vec<(Aabb, Self::Node)>,
        items: &mut Vec<TreePrimitive>,
    ) {
        let LazyAt { tree, scene, time } = *self;
        if of.is_none() && node.kind().is_leaf() {
            let subtree = tree.below(node);
            (of, node) = (Some(subtree), tree.subtree(scene, subtree).root);
        }
        let tree = of.map_or(&tree.top, |subtree| tree.subtree(scene, subtree));
        let mut below = Vec::new();
        WideAt { tree, scene, time }.expand(node, &mut below, items);
        children.extend(below.into_iter().map(|(bounds, child)| (bounds, (of, child))));
    }
}

/// The k-d layout at a time. Its nodes have no boxes; cells bounded by the planes take their place.
struct KdAt<'a> {
    tree: &'a KdTree,
    scene: &'a Scene,
    time: f32,
    /// The padding of cells beside the part that grows with their own size: more than the rounding of f64 in the scene.
    slack: f32,
}

impl Hierarchy for KdAt<'_> {
    type Node = (u32, Box3);
    type Item = TreePrimitive;

    fn roots(&self, roots: &mut Vec<(u32, Box3)>) {
        roots.extend((!self.tree.nodes.is_empty()).then_some((0, self.tree.root)));
    }

    fn expand(
        &self,
        (node, cell): (u32, Box3),
        children: &mut Vec<(Aabb, (u32, Box3))>,
        items: &mut Vec<TreePrimitive>,
    ) {
        match self.tree.nodes[node as usize].view() {
            KdView::Inner { plane, right } => {
                let [below, above] = plane.halves(cell, self.time);
                for (child, cell) in [(node + 1, below), (right, above)] {
                    // The far side of a plane that has left the cell is empty but for rounding.
                    let bounds = Box3 { min: cell.min.min(cell.max), max: cell.max.max(cell.min) };
                    let bounds = bounds.pad(self.slack + 16.0 * ULP * bounds.magnitude());
                    children.push((self.scene.frame().box_to_world(bounds), (child, cell)));
                }
            }
            KdView::Leaf { first, count } => {
                let references = &self.tree.references[first as usize..][..count as usize];
                let ids = references.iter().filter(|r| r.is_active_at(self.time)).map(|r| r.id);
                items.extend(primitives(self.scene, self.time, ids));
            }
        }
    }
}

impl RayTree {
    /// Traverses the tree as it is at a time of the shutter with a custom [`Visitor`], for queries that this crate does
    /// not provide. Returns the visitor's last return value; at a time outside `[0, 1]` nothing is visited.
    ///
    /// A primitive may be visited in several leaves. Boxes hold their contents at that time, including the rounding of
    /// queries; those of the k-d policies are cells, which share their faces. A visitor is shown sixteen boxes per
    /// node, one after the other: this is for occasional queries rather than for millions of them.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{Aabb, BuildParams, RayTree, TreePrimitive, TriangleMesh, Visitor, glam::{DVec3, Vec3}};
    ///
    /// /// Finds all triangles with a corner in a region.
    /// struct Region<'a> {
    ///     tree: &'a RayTree,
    ///     time: f32,
    ///     region: Aabb,
    ///     found: Vec<TreePrimitive>,
    /// }
    /// impl Visitor<TreePrimitive> for Region<'_> {
    ///     fn enter(&mut self, b: &Aabb) -> Option<f32> {
    ///         let apart = b.min.cmpgt(self.region.max).any() || self.region.min.cmpgt(b.max).any();
    ///         (!apart).then_some(0.0) // in any order
    ///     }
    ///     fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
    ///         let corners = self.tree.triangle(item.mesh, item.primitive, self.time);
    ///         if corners.iter().any(|&corner| self.region.contains(corner)) {
    ///             self.found.push(item);
    ///         }
    ///         ControlFlow::Continue(())
    ///     }
    /// }
    ///
    /// let open = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let close = open.iter().map(|p| p + Vec3::Z * 10.0).collect();
    /// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
    /// for (time, expected) in [(0.0, 0), (0.5, 1)] {
    ///     let region = Aabb { min: DVec3::new(-2.0, -2.0, 4.0), max: DVec3::new(2.0, 2.0, 6.0) };
    ///     let mut query = Region { tree: &tree, time, region, found: Vec::new() };
    ///     assert!(tree.traverse(time, &mut query).is_continue());
    ///     assert_eq!(query.found.len(), expected);
    /// }
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn traverse(&self, time: f32, visitor: &mut impl Visitor<TreePrimitive>) -> ControlFlow<()> {
        if !(0.0..=1.0).contains(&time) {
            return ControlFlow::Continue(());
        }
        let scene = &self.scene;
        match &self.layout {
            Layout::Wide(tree) => traverse(&WideAt { tree, scene, time }, visitor),
            Layout::Lazy(tree) => traverse(&LazyAt { tree, scene, time }, visitor),
            Layout::Kd(tree) => {
                let slack = KERNEL_ROUNDING * tree.root.magnitude();
                traverse(&KdAt { tree, scene, time, slack }, visitor)
            }
        }
    }
}
