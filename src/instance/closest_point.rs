//! The closest point in a tree of instances.
//!
//! The picture: the boxes of instances are traversed nearest first. Of an instance that is near enough, the placed tree
//! is searched by its own search, which maps the query point into that tree's space to cull boxes, but measures
//! distances in the space of the query: the corners of a triangle are mapped there in f64. So scales may differ per
//! axis, and distances of different instances can be compared. Each search ends at the best distance of those before
//! it. [`Placement`] derives how far the inner search must reach.

use super::hit::{InstancePath, InstancePoint};
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Placement;
use crate::layout::{ChildRef, WideTree};
use crate::primitive::PrimitiveSet;
use crate::ray::{
    ClosestPointQuery, Filter, Guards, LeafSearch, NearestFirst, Observer, PlacedQuery, QueryInTree, answer_each,
};
use crate::simd::{Simd, dispatch};

impl InstanceTree {
    /// The closest point in any instance at a time of the shutter, if it is no farther than the query's greatest
    /// distance; of several at the same distance (as an f32) the one with the lowest path, and of these the lowest
    /// (mesh, primitive). The query is in the coordinates of this tree, and so is the answer.
    ///
    /// Distances from triangles are those of their images at that time: corners are mapped in f64
    /// ([`InstanceTree::vertices`]), under any matrix. Spheres and custom primitives are queried in their own space,
    /// and the distance is that of the image of the point they return. This is the closest point of the image if the
    /// matrix preserves angles (rotation and uniform scale); under other matrices it is a point of the image, but
    /// perhaps not the closest.
    ///
    /// Returns `None` for queries that are out of range, as [`RayTree::closest_point`](crate::RayTree::closest_point).
    /// Takes O(log n) for points near a surface; a tree that is placed with very different scales along its axes is
    /// searched farther than needed, by the quotient of the scales.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, ClosestPointQuery, Instance, InstanceTree, Pose, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// // One that rises by 2, and one three times as large, at x = 10.
    /// let up = [0.0, 2.0].map(|z| Pose { translation: DVec3::Z * z, ..Pose::IDENTITY });
    /// let large = Pose { scale: DVec3::splat(3.0), translation: DVec3::X * 10.0, ..Pose::IDENTITY };
    /// let tree = InstanceTree::build(
    ///     vec![Instance::new(of.clone(), up.to_vec()), Instance::new(of, large)],
    ///     &WideParams::default(),
    /// )?;
    /// let found = tree.closest_point(&ClosestPointQuery::new(Vec3::new(0.25, 0.25, 3.0), 0.5)).unwrap();
    /// assert_eq!((&found.path[..], found.near.distance, found.near.point), (&[0][..], 2.0, DVec3::new(0.25, 0.25, 1.0)));
    /// let found = tree.closest_point(&ClosestPointQuery::new(Vec3::new(11.5, 0.75, -1.0), 0.5).within(5.0)).unwrap();
    /// assert_eq!((&found.path[..], found.near.distance, found.near.u, found.near.v), (&[1][..], 1.0, 0.5, 0.25));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_point(&self, query: &ClosestPointQuery) -> Option<InstancePoint> {
        self.nearest(*query, Guards::none())
    }

    /// [`InstanceTree::closest_point`] among the points for which `accept` returns true, in instances whose
    /// [mask](super::Instance::with_mask) shares a bit with `mask`, on meshes and shapes whose masks do. `accept` must be pure: it
    /// is called for some of the points only.
    pub fn closest_point_filtered(
        &self,
        query: &ClosestPointQuery,
        mask: u32,
        accept: impl Fn(&InstancePoint) -> bool,
    ) -> Option<InstancePoint> {
        self.nearest(*query, Guards::filtered(mask, &accept))
    }

    /// [`InstanceTree::closest_point`] in instances whose [mask](super::Instance::with_mask) shares a bit with `mask`, on meshes
    /// and shapes whose masks do.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, ClosestPointQuery, Instance, InstanceTree, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z)).with_mask(z as u32);
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let query = ClosestPointQuery::new(Vec3::ZERO, 0.0);
    /// assert_eq!([0b01, 0b10].map(|mask| tree.closest_point_masked(&query, mask).unwrap().path[0]), [0, 1]);
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn closest_point_masked(&self, query: &ClosestPointQuery, mask: u32) -> Option<InstancePoint> {
        self.nearest(*query, Guards::masked(mask))
    }

    /// [`InstanceTree::closest_point`], reporting each step to `observer`, as [`InstanceTree::closest_hit_observed`]
    /// does.
    pub fn closest_point_observed(
        &self,
        query: &ClosestPointQuery,
        observer: &mut impl Observer,
    ) -> Option<InstancePoint> {
        self.nearest(*query, Guards::observed(observer))
    }

    /// [`InstanceTree::closest_point`] for many queries, in parallel. `answers` is cleared and gets one answer per query, in
    /// order.
    pub fn closest_points(&self, queries: &[ClosestPointQuery], answers: &mut Vec<Option<InstancePoint>>) {
        answer_each(queries, answers, |_, query| self.closest_point(query));
    }

    /// [`InstanceTree::closest_point_masked`] for many queries, in parallel. `answers` is cleared and gets one answer per query, in
    /// order.
    pub fn closest_points_masked(
        &self,
        queries: &[ClosestPointQuery],
        mask: u32,
        answers: &mut Vec<Option<InstancePoint>>,
    ) {
        answer_each(queries, answers, |_, query| self.closest_point_masked(query, mask));
    }

    /// [`InstanceTree::closest_point_filtered`] for many queries, in parallel. `answers` is cleared and gets one answer
    /// per query, in order. `accept` gets the index of the query in `queries` with each point; it must be pure, and is
    /// called from any thread.
    pub fn closest_points_filtered(
        &self,
        queries: &[ClosestPointQuery],
        mask: u32,
        accept: impl Fn(usize, &InstancePoint) -> bool + Sync,
        answers: &mut Vec<Option<InstancePoint>>,
    ) {
        answer_each(queries, answers, |i, query| self.closest_point_filtered(query, mask, |near| accept(i, near)));
    }

    fn nearest(&self, query: ClosestPointQuery, mut guards: Guards<'_, InstancePoint>) -> Option<InstancePoint> {
        self.nearest_from(&query.into(), InstancePath::default(), &mut guards)
    }

    /// The closest point in this tree where it is placed itself; its path continues `path`.
    fn nearest_from(
        &self,
        query: &PlacedQuery,
        path: InstancePath,
        guards: &mut Guards<'_, InstancePoint>,
    ) -> Option<InstancePoint> {
        let in_tree = QueryInTree::new(query, self.placements.frame())?;
        let mut leaves = InInstances { of: self, query: *query, path, guards, best: None };
        dispatch(self.simd, NearestFirst { tree: &self.wide, query: &in_tree, leaves: &mut leaves });
        leaves.best
    }
}

impl InstanceOf {
    fn nearest(
        &self,
        query: &PlacedQuery,
        path: InstancePath,
        guards: &mut Guards<'_, InstancePoint>,
    ) -> Option<InstancePoint> {
        match self {
            InstanceOf::Instances(tree) => tree.nearest_from(query, path, guards),
            InstanceOf::Tree(tree) => {
                let placed = |&near: &_| InstancePoint { path, near };
                guards.inside(placed, |guards| tree.closest_point_guarded(query, guards)).map(|near| placed(&near))
            }
        }
    }
}

/// Leaves of one instance each.
struct InInstances<'a, 'b> {
    of: &'a InstanceTree,
    /// The query, with the distance of the best answer as its greatest distance.
    query: PlacedQuery,
    path: InstancePath,
    guards: &'a mut Guards<'b, InstancePoint>,
    best: Option<InstancePoint>,
}

impl LeafSearch for InInstances<'_, '_> {
    #[inline]
    fn limit(&self) -> f32 {
        self.query.query.max_distance
    }

    #[inline]
    fn hides(&self, block: ChildRef) -> bool {
        let WideTree { masks, intervals, .. } = &self.of.wide;
        masks.hide(block, self.guards.visible.mask()) || intervals.exclude(block, self.query.query.time)
    }

    #[inline]
    fn node(&mut self) {
        self.guards.observer.node();
    }

    #[inline]
    fn leaf<S: Simd>(&mut self, _: S, leaf: ChildRef) {
        self.guards.observer.leaf();
        for &id in &self.of.wide.arena.ints()[leaf.at()..leaf.at() + leaf.len()] {
            self.query_instance(id);
        }
    }
}

impl InInstances<'_, '_> {
    /// Searches the tree that an instance places.
    fn query_instance(&mut self, id: u32) {
        let PlacedQuery { query, placed } = self.query;
        let set = &self.of.placements;
        let one = &set.placed[id as usize];
        if !(one.active.contains(query.time) && self.guards.visible.sees(|| one.mask)) {
            return;
        }
        let matrix = set.motions.matrix(&one.motion, f64::from(query.time));
        let placed = Some(Placement::then(placed.as_ref(), matrix));
        let tree = &self.of.trees[one.tree as usize];
        let Some(found) = tree.nearest(&PlacedQuery { query, placed }, self.path.then(id), self.guards) else { return };
        let order = |found: &InstancePoint| (found.near.distance, found.path);
        if self.best.is_none_or(|best| order(&found) < order(&best)) {
            self.best = Some(found);
            self.query.query.max_distance = found.near.distance;
        }
    }
}
