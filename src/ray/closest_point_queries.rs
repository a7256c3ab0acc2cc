//! The public closest-point queries of [`RayTree`].

use super::batch_order::answer_each;
use super::closest_point::closest_search::ClosestPoint;
use super::closest_point::point_query::{ClosestPointQuery, PlacedQuery};
use super::guards::Guards;
use super::observer::Observer;
use super::ray_tree::RayTree;

impl RayTree {
    /// The closest point on any primitive of the tree to a point at a time of the shutter, if it is no farther than the query's
    /// greatest distance. The answer has its distance, its position and its primitive. Ties at the same distance (as
    /// an f32) go to the lowest (mesh, primitive).
    ///
    /// Triangles are surfaces; degenerate ones are points and segments. [`MovingSphere`](crate::MovingSphere)s are
    /// surfaces too: from inside, the closest point is on the sphere's surface. Custom primitives are searched if they
    /// implement [`Primitive::closest_point`](crate::Primitive::closest_point). So distances have no sign; docs/rays.md tells
    /// inside from outside.
    ///
    /// Answers are exact in the sense of [`BruteForce::closest_point`](crate::baseline::BruteForce::closest_point): the
    /// same bits as from testing every primitive. The distance from a triangle is computed in f64, where it is
    /// never too small, and too large by less than 2e-8 of the triangle's longest edge; then it is rounded to the nearest f32.
    ///
    /// Returns `None` for a point that is NaN, infinite or beyond
    /// [`MAX_COORDINATE`](crate::MAX_COORDINATE), a time outside `[0, 1]`, and a greatest distance that is negative or NaN.
    ///
    /// The time is O(log n) for points near the surface. From a great distance (1e7 scene sizes) all distances are equal as f32
    /// numbers, and every primitive is tested. The method is that of Ericson, *Real-Time Collision Detection*,
    /// section 5.1.5.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
    /// let open = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let close = open.iter().map(|p| p + Vec3::Z).collect();
    /// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
    /// let near = tree.closest_point(&ClosestPointQuery::new(Vec3::new(0.25, 0.5, 3.0), 0.5)).unwrap();
    /// assert_eq!((near.distance, near.point), (2.5, DVec3::new(0.25, 0.5, 0.5)));
    /// assert_eq!((near.mesh, near.primitive, near.u, near.v), (0, 0, 0.25, 0.5));
    /// assert_eq!(tree.closest_point(&ClosestPointQuery::new(Vec3::new(0.25, 0.5, 3.0), 0.5).within(2.0)), None);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_point(&self, query: &ClosestPointQuery) -> Option<ClosestPoint> {
        self.target().closest_point(&(*query).into())
    }

    /// [`RayTree::closest_point`] among the points for which `accept` returns true, on meshes and shapes whose
    /// mask shares a bit with `mask`, as in [`RayTree::closest_hit_filtered`]. `accept` must be pure. It is not called for every
    /// point.
    ///
    /// Blocks of the tree in which `mask` hides everything are skipped (in the k-d layout, only primitives are). `accept` cannot
    /// skip any: where it rejects all of the nearest hundred thousand triangles, each of their closest points is computed. So
    /// prefer masks where they can express it.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0, 3.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let query = ClosestPointQuery::new(Vec3::ZERO, 0.0);
    /// let other_than_first = tree.closest_point_filtered(&query, u32::MAX, |near| near.mesh != 0);
    /// assert_eq!(other_than_first.map(|near| near.distance), Some(2.0));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_point_filtered(
        &self,
        query: &ClosestPointQuery,
        mask: u32,
        accept: impl Fn(&ClosestPoint) -> bool,
    ) -> Option<ClosestPoint> {
        self.closest_point_guarded(&(*query).into(), Guards::filtered(mask, &accept))
    }

    /// [`RayTree::closest_point`] on meshes and shapes whose mask shares a bit with `mask`, as [`RayTree::closest_point_filtered`]
    /// without a filter.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let query = ClosestPointQuery::new(Vec3::ZERO, 0.0);
    /// assert_eq!([0b01, 0b10].map(|mask| tree.closest_point_masked(&query, mask).unwrap().distance), [1.0, 2.0]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_point_masked(&self, query: &ClosestPointQuery, mask: u32) -> Option<ClosestPoint> {
        self.closest_point_guarded(&(*query).into(), Guards::masked(mask))
    }

    /// [`RayTree::closest_point`], reporting each step to `observer`.
    pub fn closest_point_observed(
        &self,
        query: &ClosestPointQuery,
        observer: &mut impl Observer,
    ) -> Option<ClosestPoint> {
        self.closest_point_guarded(&(*query).into(), Guards::observed(observer))
    }

    /// [`RayTree::closest_point`] for many queries, in parallel. `answers` is cleared and gets one answer per query, in
    /// order.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let queries = [1.0, 3.0].map(|z| ClosestPointQuery::new(Vec3::Z * z, 0.0).within(2.0));
    /// let mut answers = Vec::new();
    /// tree.closest_points(&queries, &mut answers);
    /// assert_eq!(answers.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_points(&self, queries: &[ClosestPointQuery], answers: &mut Vec<Option<ClosestPoint>>) {
        answer_each(queries, answers, |_, query| self.closest_point(query));
    }

    /// The closest point of a tree that may be placed in another space ([`PlacedQuery`]), with guards.
    pub(crate) fn closest_point_guarded(
        &self,
        query: &PlacedQuery,
        guards: Guards<'_, ClosestPoint>,
    ) -> Option<ClosestPoint> {
        if self.can_do_without(&guards) {
            return self.target().closest_point(query);
        }
        self.target().closest_point_guarded(query, guards)
    }
}
