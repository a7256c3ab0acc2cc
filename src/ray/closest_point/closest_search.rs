//! The closest point on any primitive of a tree, at a time.
//!
//! The picture: boxes and triangles are visited in order of their distance from the query point, until every remaining
//! one is farther away than the best point found. Distances from boxes are in f32 and never too large. Distances of
//! answers are in f64 and rounded to f32 at the very end, so they are the same for every layout, instruction set and
//! number of threads.
//!
//! **Why no closest point is lost.** Let `p` be the point that a primitive answers with.
//! - Wide layout. `p` lies in the boxes above its primitive as they are computed at the query's time. For a triangle,
//!   its corners do, as for rays, and [`closest_on_triangle`](crate::geometry::closest_on_triangle) keeps `p` within
//!   the box of the corners. Sub-references of triangles have boxes that are wider than exact by 8 ULP, more than `p`
//!   is off the triangle. Custom primitives promise it. The query point `q` is replaced by the f32 numbers on either
//!   side of it (`low`, `high`), so along each axis `max(lower - high, low - upper, 0)`, before rounding, is at most
//!   `|p - q|`. Rounding it, its square and the sum of squares makes it too large by less than 4 ULP, and the square of
//!   a number near zero by less than the least normal number: [`QueryInTree::cull`] allows for both.
//! - Triangles of a leaf block are ruled out by lower bounds of their distances, with a margin for rounding
//!   (`ray/closest_point/triangle_bound.rs`).
//! - Placed trees (instances). Distances are those of images, measured from the query point in the outer space. The
//!   tree is searched from that point mapped into its own space, out to the greatest inner distance that
//!   [`Placement`](crate::geometry::Placement) derives for the outer one.
//! - K-d layout. The cell of `p` has a reference of the primitive: the build's classification rounds outward, and the
//!   bounds that it classifies hold `p` as they do above. Distances from planes are computed in f64, and reduced by
//!   more than their rounding error ([`PLANE_ROUNDING`]).
//!
//! A distance is rounded to f32 before it is compared, so a point that is farther than the best one by less than half
//! an ULP may tie with it and win by a lower id. Culling therefore begins one float above the best distance.

use super::nearest_first::{LeafSearch, NearestFirst};
use super::point_query::{Candidate, PlacedQuery, QueryInTree};
use super::triangle_bound::TriangleBound;
use crate::geometry::{KeyTime, LEAST_SQUARED, ULP};
use crate::kd::{KdTree, KdView};
use crate::layout::{
    Between, ChildRef, CornerLanes, ListBoxes, NODE_ROWS, SPHERE_ROWS, STATIC_NODE_ROWS, SphereLeaf, WideTree,
    block_sizes, sphere_row,
};
use crate::limits::DEPTH_LIMIT;
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::{Everything, Filter};
use crate::ray::observer::Observer;
use crate::simd::{LANES, Lanes, Rows, Simd, SimdLevel, StackMemory, dispatch, dispatch_or, first_lanes};
use glam::{DVec3, Vec3};

/// The closest point on any primitive of a [`RayTree`](crate::RayTree), as returned by
/// [`RayTree::closest_point`](crate::RayTree::closest_point).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// Distance from the query point, rounded to nearest.
    pub distance: f32,
    /// The point, in world coordinates.
    pub point: DVec3,
    /// Barycentric weight of the triangle's second vertex; on a [sphere](crate::MovingSphere) the x of the unit normal, on a custom
    /// primitive the value that it returned.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, where the first has `1 - u - v`; on a sphere the y of the unit normal, on
    /// a custom primitive the value that it returned.
    pub v: f32,
    /// The mesh, as an index into the meshes that the tree was built of; the number of meshes for one of the other shapes
    /// of a scene, so 0 for a tree of shapes only.
    pub mesh: u32,
    /// The triangle within its mesh, or the primitive's index.
    pub primitive: u32,
}

impl Scene {
    /// The closest point of a primitive at the query's time, at any distance.
    #[inline]
    fn closest_point(&self, id: u32, query: &QueryInTree) -> Option<Candidate> {
        match self.shape(id) {
            None => {
                let corners = self.triangles.precise_corners(id, query.time);
                let corners = corners.unwrap_or_else(|| self.triangles.corners(id, query.time).map(Vec3::as_dvec3));
                Some(query.on_triangle(corners))
            }
            Some(shape) => query.on_shape(self.shapes.get(shape)),
        }
    }
}

/// The best answer so far, and the filter that candidates have to pass.
pub(in crate::ray) struct Best<'a, F> {
    pub scene: &'a Scene,
    filter: &'a F,
    pub query: &'a QueryInTree<'a>,
    found: Option<(Candidate, u32)>,
    /// The greatest distance of a point that can still improve the answer.
    pub limit: f32,
}

impl<F: Filter<ClosestPoint>> Best<'_, F> {
    /// Takes the point of a primitive that the query [sees](Best::sees) if it is the closest so far.
    #[inline(always)]
    fn offer(&mut self, candidate: Candidate, id: u32) {
        let better = match self.found {
            Some((best, best_id)) => {
                candidate.distance < best.distance || (candidate.distance == best.distance && id < best_id)
            }
            None => candidate.distance <= self.limit,
        };
        if better && self.filter.accepts(|| self.answer(candidate, id)) {
            self.found = Some((candidate, id));
            self.limit = candidate.distance;
        }
    }

    /// Whether a primitive exists at the query's time and the query sees it. It is asked before the closest point is computed,
    /// which takes longer.
    #[inline(always)]
    fn sees(&self, id: u32) -> bool {
        self.scene.exists_at(id, self.query.time) && self.filter.sees(|| self.scene.mask(id))
    }

    /// Whether the mask of the query hides everything in a block, or nothing in it exists at the time.
    #[inline(always)]
    pub fn hides(&self, tree: &WideTree, block: ChildRef) -> bool {
        tree.masks.hide(block, self.filter.mask()) || tree.intervals.exclude(block, self.query.time)
    }

    fn answer(&self, Candidate { distance, point, u, v }: Candidate, id: u32) -> ClosestPoint {
        let (mesh, primitive) = self.scene.mesh_and_primitive(id);
        ClosestPoint { distance, point, u, v, mesh, primitive }
    }

    pub fn finish(self) -> Option<ClosestPoint> {
        self.found.map(|(candidate, id)| self.answer(candidate, id))
    }
}

/// Leaves of primitives: blocks of triangles, and lists of other primitives.
pub(in crate::ray) struct InPrimitives<'a, 'b, F, O> {
    pub tree: &'a WideTree,
    pub best: &'b mut Best<'a, F>,
    pub observer: &'b mut O,
}

impl<F: Filter<ClosestPoint>, O: Observer> LeafSearch for InPrimitives<'_, '_, F, O> {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.best.limit
    }

    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        self.best.hides(self.tree, block)
    }

    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn leaf<S: Simd>(&mut self, s: S, leaf: ChildRef) {
        self.observer.leaf();
        if !self.tree.is_list(leaf) {
            return self.triangles(s, leaf);
        }
        if let Some(spheres) = SphereLeaf::of(&self.tree.arena.ints()[leaf.at()..], leaf.len()) {
            return self.spheres(s, leaf, spheres);
        }
        if let Some(boxes) = ListBoxes::of(&self.tree.arena.ints()[leaf.at()..], leaf.len()) {
            return self.boxed(s, leaf, boxes);
        }
        for &id in &self.tree.arena.ints()[leaf.at()..][..leaf.len()] {
            if !self.best.sees(id) {
                continue;
            }
            self.observer.primitive_tests(1);
            if let Some(candidate) = self.best.scene.closest_point(id, self.best.query) {
                self.best.offer(candidate, id);
            }
        }
    }
}

impl<F: Filter<ClosestPoint>, O: Observer> InPrimitives<'_, '_, F, O> {
    /// Tests a block of triangles: those whose boxes and lower bounds are near enough, closest first.
    #[inline(always)]
    fn triangles<S: Simd>(&mut self, s: S, leaf: ChildRef) {
        let query = self.best.query;
        let CornerLanes { corners, count, ids, sizes } = CornerLanes::of(s, &self.tree.arena, leaf, query.time);
        let [a, b, c] = corners;
        // How far corners may be from those in the block, in tree space, if vertices are kept in f64 and rounded in blocks: along
        // each axis less than four ULP of the largest coordinate, one at the keys, and one each for difference, product and sum
        // between them. That is less than seven altogether.
        let kept = Some(&self.best.scene.triangles).filter(|triangles| triangles.any_precise());
        let error = if kept.is_some() { 7.5 * ULP * block_sizes(sizes).0 + f32::MIN_POSITIVE } else { 0.0 };
        let reach = |limit: f32| query.reach(limit) + f64::from(error * query.stretch.most());
        let (mut lower, mut upper) = (a, a);
        for axis in 0..3 {
            lower[axis] = s.min(a[axis], s.min(b[axis], c[axis]));
            upper[axis] = s.max(a[axis], s.max(b[axis], c[axis]));
        }
        let to_boxes = query.distances(s, lower, upper);
        let mut near = s.le(to_boxes, s.splat(QueryInTree::squared(reach(self.best.limit)))) & first_lanes(count);
        if near == 0 {
            return;
        }
        let mut bounds = s.splat(0.0);
        if query.is_close() {
            bounds =
                TriangleBound::new(query.inside.as_vec3(), block_sizes(sizes), error, query.stretch).of(s, corners);
            near &= s.le(bounds, s.splat(TriangleBound::beyond(query.reach(self.best.limit), &query.stretch)));
        }
        let mut lanes = [[[0.0; LANES]; 3]; 3];
        for corner in 0..3 {
            for axis in 0..3 {
                s.store(corners[corner][axis], &mut lanes[corner][axis]);
            }
        }
        while near != 0 {
            let least = s.reduce_min_u(s.select_u(near, s.to_bits(bounds), s.splat_u(u32::MAX)));
            let nearest = s.eq_u(s.to_bits(bounds), s.splat_u(least)) & near;
            let lane = nearest.trailing_zeros() as usize % LANES;
            near &= !(1 << lane);
            let id = self.tree.arena.ints()[ids + lane];
            if !self.best.sees(id) {
                continue;
            }
            self.observer.primitive_tests(1);
            let corners = kept.and_then(|triangles| triangles.precise_corners(id, query.time));
            self.best.offer(query.on_triangle(corners.unwrap_or_else(|| corners_in(&lanes, lane))), id);
            near &= s.le(bounds, s.splat(TriangleBound::beyond(query.reach(self.best.limit), &query.stretch)));
        }
    }
}

impl<F: Filter<ClosestPoint>, O: Observer> InPrimitives<'_, '_, F, O> {
    /// Tests listed shapes with boxes: those whose boxes are near enough, closest first.
    #[inline(always)]
    fn boxed<S: Simd>(&mut self, s: S, leaf: ChildRef, boxes: ListBoxes) {
        let (query, arena) = (self.best.query, &self.tree.arena);
        let (at, n) = (leaf.at(), leaf.len());
        let words = &arena.floats()[at..];
        let distances = match boxes.moving {
            true => query.distances_of::<S, NODE_ROWS>(s, &boxes.rows::<NODE_ROWS>(words, n)),
            false => query.distances_of::<S, STATIC_NODE_ROWS>(s, &boxes.rows::<STATIC_NODE_ROWS>(words, n)),
        };
        self.closest_first(s, leaf, distances, |limit| query.cull(limit));
    }

    /// Tests the shapes of a block by their own functions, closest first, as long as their distances, none of which is negative,
    /// are within `reach` of the limit.
    #[inline(always)]
    fn closest_first<S: Simd>(&mut self, s: S, leaf: ChildRef, distances: S::F, reach: impl Fn(f32) -> f32) {
        let ids = &self.tree.arena.ints()[leaf.at()..][..leaf.len()];
        // A comparison with NaN is false, so such a shape is kept.
        let mut near = !s.lt(s.splat(reach(self.best.limit)), distances) & first_lanes(leaf.len());
        while near != 0 {
            let least = s.reduce_min_u(s.select_u(near, s.to_bits(distances), s.splat_u(u32::MAX)));
            let nearest = s.eq_u(s.to_bits(distances), s.splat_u(least)) & near;
            let lane = nearest.trailing_zeros() as usize % LANES;
            near &= !(1 << lane);
            let id = ids[lane];
            if !self.best.sees(id) {
                continue;
            }
            self.observer.primitive_tests(1);
            if let Some(candidate) = self.best.scene.closest_point(id, self.best.query) {
                self.best.offer(candidate, id);
                near &= !s.lt(s.splat(reach(self.best.limit)), distances);
            }
        }
    }

    /// Tests a block of spheres: those whose surfaces are near enough, closest first.
    ///
    /// Distances in f32 are too large by less than the margin. Let `m` be the size of the block plus the largest coordinate of the
    /// query point, and `u` an ULP: each coordinate of a center relative to the point is off by 6um, which moves the distance by
    /// 11um; the roundings of squares, sum and root by 7um at most; the radius is off by 4um. To this comes the error that the
    /// block states, and that of squares which are not normal numbers ([`LEAST_SQUARED`]).
    #[inline(always)]
    fn spheres<S: Simd>(&mut self, s: S, leaf: ChildRef, spheres: SphereLeaf) {
        let (query, arena) = (self.best.query, &self.tree.arena);
        let (at, n) = (leaf.at(), leaf.len());
        let from = query.inside.as_vec3();
        let [x, y, z, radius] = match spheres.keys {
            1 => {
                let rows = Rows::new(&arena.floats()[at + spheres.rows(n, 0)..], n, SPHERE_ROWS);
                sphere_lanes::<S, false>(s, &rows, Between::NEVER, from)
            }
            keys => {
                let time = KeyTime::new(query.time, keys);
                let rows = Rows::new(&arena.floats()[at + spheres.rows(n, time.segment)..], n, 2 * SPHERE_ROWS);
                sphere_lanes::<S, true>(s, &rows, Between::new(time), from)
            }
        };
        let (size, error) = block_sizes(spheres.sizes);
        let margin = s.splat(24.0 * ULP * (size + from.abs().max_element()) + error + LEAST_SQUARED);
        let away = s.sqrt(x * x + y * y + z * z) - radius;
        // From very far away, squares overflow, and nothing is ruled out.
        let none = s.splat(0.0);
        let distances = if query.is_close() { s.max_with_zero(away - margin, none - away - margin) } else { none };
        self.closest_first(s, leaf, distances, |limit| (query.reach(limit) as f32).next_up());
    }
}

/// The centers of spheres at a time, relative to a point, and the radii.
#[inline(always)]
fn sphere_lanes<S: Simd, const MOVING: bool>(s: S, rows: &Rows, at: Between, from: Vec3) -> [S::F; 4] {
    [
        sphere_row::<S, MOVING>(s, rows, at, 0, from.x),
        sphere_row::<S, MOVING>(s, rows, at, 1, from.y),
        sphere_row::<S, MOVING>(s, rows, at, 2, from.z),
        sphere_row::<S, MOVING>(s, rows, at, SPHERE_ROWS - 1, 0.0),
    ]
}

#[inline(always)]
fn corners_in(lanes: &[[Lanes<f32>; 3]; 3], lane: usize) -> [DVec3; 3] {
    let [a, b, c] = lanes;
    [
        Vec3::new(a[0][lane], a[1][lane], a[2][lane]).as_dvec3(),
        Vec3::new(b[0][lane], b[1][lane], b[2][lane]).as_dvec3(),
        Vec3::new(c[0][lane], c[1][lane], c[2][lane]).as_dvec3(),
    ]
}

/// Bound on the rounding error of f64 distances from planes, relative to the largest coordinate of the scene: 64
/// roundings. (The error that grows with the distance of the query point is less than the allowance for squares.)
const PLANE_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// A cell of the k-d layout on the stack, with its distance along each axis.
#[derive(Clone, Copy)]
struct Cell {
    node: u32,
    gap: DVec3,
}

/// The search through the k-d layout, nearer cells first (Arya and Mount, "Algorithms for Fast Vector Quantization",
/// 1993: the distance to a cell differs from that to its parent along one axis only).
fn search_kd<F: Filter<ClosestPoint>>(tree: &KdTree, best: &mut Best<'_, F>, observer: &mut impl Observer) {
    if tree.nodes.is_empty() {
        return;
    }
    let (query, time) = (best.query, best.query.time);
    let (low, high) = (tree.root.min.as_dvec3(), tree.root.max.as_dvec3());
    let slack = PLANE_ROUNDING * low.abs().max(high.abs()).max_element();
    let gap = (low - query.inside).max(query.inside - high).max(DVec3::splat(slack)) - slack;
    let mut memory = StackMemory::<Cell, DEPTH_LIMIT>::new();
    let mut stack = memory.stack(DEPTH_LIMIT);
    let mut cell = Cell { node: 0, gap };
    loop {
        let reach = query.reach(best.limit);
        // Squares in f64 have a relative error of 2^-53 each; infinite where the reach is.
        if query.square(cell.gap) <= reach * reach * (1.0 + 1e-12) {
            match tree.nodes[cell.node as usize].view() {
                KdView::Inner { plane, right } => {
                    observer.node();
                    let to_plane = query.inside[plane.axis] - plane.at(time);
                    let (near, far) = if to_plane < 0.0 { (cell.node + 1, right) } else { (right, cell.node + 1) };
                    let mut gap = cell.gap;
                    gap[plane.axis] = gap[plane.axis].max(to_plane.abs() - slack);
                    stack.push(Cell { node: far, gap });
                    cell.node = near;
                    continue;
                }
                KdView::Leaf { first, count } => {
                    observer.leaf();
                    for reference in &tree.references[first as usize..][..count as usize] {
                        if !reference.is_active_at(time) {
                            observer.time_skip();
                            continue;
                        }
                        if !best.sees(reference.id) {
                            continue;
                        }
                        observer.primitive_tests(1);
                        if let Some(candidate) = best.scene.closest_point(reference.id, query) {
                            best.offer(candidate, reference.id);
                        }
                    }
                }
            }
        }
        match stack.pop() {
            Some(next) => cell = next,
            None => return,
        }
    }
}

/// The initial state of a search.
pub(in crate::ray) fn begin<'a, F>(scene: &'a Scene, query: &'a QueryInTree<'a>, filter: &'a F) -> Best<'a, F> {
    Best { scene, filter, query, found: None, limit: query.max_distance }
}

/// The closest point in the wide layout.
pub(in crate::ray) fn closest_point_in_wide(
    simd: SimdLevel,
    tree: &WideTree,
    scene: &Scene,
    query: &PlacedQuery,
    filter: &impl Filter<ClosestPoint>,
    observer: &mut impl Observer,
) -> Option<ClosestPoint> {
    let query = &QueryInTree::new(query, scene.frame())?;
    let mut best = begin(scene, query, filter);
    let mut leaves = InPrimitives { tree, best: &mut best, observer };
    dispatch(simd, NearestFirst { tree, query, leaves: &mut leaves });
    best.finish()
}

/// The closest point in the wide layout without a filter or an observer. `guarded` answers on an instruction set for
/// which this form is not compiled.
#[inline(always)]
pub(in crate::ray) fn plain_closest_point_in_wide(
    simd: SimdLevel,
    tree: &WideTree,
    scene: &Scene,
    query: &PlacedQuery,
    guarded: impl FnOnce() -> Option<ClosestPoint>,
) -> Option<ClosestPoint> {
    let query = &QueryInTree::new(query, scene.frame())?;
    let mut best = begin(scene, query, &Everything);
    let mut leaves = InPrimitives { tree, best: &mut best, observer: &mut () };
    let mut found = None;
    dispatch_or(simd, NearestFirst { tree, query, leaves: &mut leaves }, |_| found = Some(guarded()));
    found.unwrap_or_else(|| best.finish())
}

/// The closest point in the k-d layout.
pub(in crate::ray) fn closest_point_in_kd(
    tree: &KdTree,
    scene: &Scene,
    query: &PlacedQuery,
    filter: &impl Filter<ClosestPoint>,
    observer: &mut impl Observer,
) -> Option<ClosestPoint> {
    let query = QueryInTree::new(query, scene.frame())?;
    let mut best = begin(scene, &query, filter);
    search_kd(tree, &mut best, observer);
    best.finish()
}

/// The closest point by testing every primitive of a scene: the reference that all layouts must agree with.
pub(crate) fn closest_point_of_all(
    scene: &Scene,
    query: &PlacedQuery,
    filter: &impl Filter<ClosestPoint>,
) -> Option<ClosestPoint> {
    let query = QueryInTree::new(query, scene.frame())?;
    let mut best = begin(scene, &query, filter);
    for id in 0..scene.len() as u32 {
        if best.sees(id)
            && let Some(candidate) = scene.closest_point(id, &query)
        {
            best.offer(candidate, id);
        }
    }
    best.finish()
}
