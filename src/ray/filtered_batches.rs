//! Batches of queries with a mask, and with a filter or without.
//!
//! Each query is answered like the single query with its own filter, on any thread.

use super::batch_order::answer_each;
use super::closest_point::closest_search::ClosestPoint;
use super::closest_point::point_query::ClosestPointQuery;
use super::filter::Visible;
use super::hit::Hit;
use super::ray_tree::{InBatch, RayTree};
use crate::geometry::Ray;

impl RayTree {
    /// [`RayTree::closest_hit_masked`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let mut hits = Vec::new();
    /// tree.closest_hits_masked(&[Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z)], 0b10, &mut hits);
    /// assert_eq!(hits[0].map(|hit| (hit.mesh, hit.t)), Some((1, 2.0)));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hits_masked(&self, rays: &[Ray], mask: u32, hits: &mut Vec<Option<Hit>>) {
        self.closest_batch(rays, self.visible(mask), hits);
    }

    /// [`RayTree::any_hit_masked`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let glass = TriangleMesh::fixed(vec![[0, 1, 2]], corners).with_mask(0b01);
    /// let tree = RayTree::build(&[glass], &BuildParams::default())?;
    /// let mut shadows = Vec::new();
    /// tree.any_hits_masked(&[Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z)], 0b10, &mut shadows);
    /// assert_eq!(shadows, [false]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn any_hits_masked(&self, rays: &[Ray], mask: u32, hits: &mut Vec<bool>) {
        self.any_batch(rays, self.visible(mask), hits);
    }

    /// [`RayTree::closest_point_masked`] for many queries, in parallel. `answers` is cleared and gets one answer per query, in
    /// order.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)).with_mask(z as u32));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// let mut answers = Vec::new();
    /// tree.closest_points_masked(&[ClosestPointQuery::new(Vec3::ZERO, 0.0)], 0b10, &mut answers);
    /// assert_eq!(answers[0].map(|near| (near.mesh, near.distance)), Some((1, 2.0)));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_points_masked(
        &self,
        queries: &[ClosestPointQuery],
        mask: u32,
        answers: &mut Vec<Option<ClosestPoint>>,
    ) {
        answer_each(queries, answers, |_, query| self.closest_point_masked(query, mask));
    }

    /// [`RayTree::closest_hit_filtered`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order.
    ///
    /// `accept` gets the index of the ray in `rays` with each hit, so every ray can have a filter of its own. Like the
    /// filter of a single ray it must be pure; it is called from any thread.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)];
    /// let meshes = [1.0, 2.0].map(|z| TriangleMesh::fixed(vec![[0, 1, 2]], at(z)));
    /// let tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// // Rays that begin on one of the triangles and must not hit it again.
    /// let begin_on = [0, 1];
    /// let rays = [1.0, 2.0].map(|z| Ray::new(Vec3::new(0.2, 0.2, z), Vec3::Z));
    /// let mut hits = Vec::new();
    /// tree.closest_hits_filtered(&rays, u32::MAX, |i, hit| hit.mesh != begin_on[i], &mut hits);
    /// assert_eq!(hits[0].map(|hit| (hit.mesh, hit.t)), Some((1, 1.0)));
    /// assert_eq!(hits[1], None);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hits_filtered(
        &self,
        rays: &[Ray],
        mask: u32,
        accept: impl Fn(usize, &Hit) -> bool + Sync,
        hits: &mut Vec<Option<Hit>>,
    ) {
        self.closest_batch(rays, Some(Visible { mask, accept: Some(&accept) }), hits);
    }

    /// [`RayTree::any_hit_filtered`] for many rays, in parallel, with a filter as that of
    /// [`RayTree::closest_hits_filtered`]. `hits` is cleared and gets one answer per ray, in order.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let fence = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[fence], &BuildParams::default())?;
    /// let rays = [0.1, 0.4].map(|x| Ray::new(Vec3::new(x, 0.2, -1.0), Vec3::Z));
    /// let mut shadows = Vec::new();
    /// // The fence has a hole at small x.
    /// tree.any_hits_filtered(&rays, u32::MAX, |_, hit| hit.u > 0.25, &mut shadows);
    /// assert_eq!(shadows, [false, true]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn any_hits_filtered(
        &self,
        rays: &[Ray],
        mask: u32,
        accept: impl Fn(usize, &Hit) -> bool + Sync,
        hits: &mut Vec<bool>,
    ) {
        self.any_batch(rays, Some(Visible { mask, accept: Some(&accept) }), hits);
    }

    /// [`RayTree::closest_point_filtered`] for many queries, in parallel, with a filter that gets the index of the
    /// query, as that of [`RayTree::closest_hits_filtered`]. `answers` is cleared and gets one answer per query, in
    /// order.
    ///
    /// ```
    /// use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2], [3, 4, 5]], (0..6).map(|i| Vec3::X * i as f32).collect());
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// // From a point on each triangle, the closest point of the other.
    /// let queries = [0.0, 5.0].map(|x| ClosestPointQuery::new(Vec3::X * x, 0.0));
    /// let mut answers = Vec::new();
    /// tree.closest_points_filtered(&queries, u32::MAX, |i, near| near.primitive != i as u32, &mut answers);
    /// assert_eq!(answers.iter().map(|near| near.unwrap().distance).collect::<Vec<_>>(), [3.0, 3.0]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_points_filtered(
        &self,
        queries: &[ClosestPointQuery],
        mask: u32,
        accept: impl Fn(usize, &ClosestPoint) -> bool + Sync,
        answers: &mut Vec<Option<ClosestPoint>>,
    ) {
        answer_each(queries, answers, |i, query| self.closest_point_filtered(query, mask, |near| accept(i, near)));
    }

    /// What a batch with a mask sees; `None` if that is everything.
    fn visible(&self, mask: u32) -> InBatch<'static> {
        (!self.layout.hides_nothing_from(mask)).then_some(Visible { mask, accept: None })
    }
}
