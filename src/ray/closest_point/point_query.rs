//! A closest-point query: as the caller gives it, and prepared in tree space, where it computes distances from boxes
//! and triangles.
//!
//! The `closest_point` module proves that no closest point is lost.

use super::stretch::Stretch;
use super::triangle_bound::FARTHEST;
use crate::geometry::{Frame, OnTriangle, Placement, ULP, closest_on_triangle};
use crate::layout::ChildRef;
use crate::limits::MAX_COORDINATE;
use crate::primitive::Primitive;
use crate::simd::{LANES, Mask, Simd};
use crate::traverse::{Faces, NodeBlock, children_of};
use glam::{DVec3, Vec3};

/// A query of [`RayTree::closest_points`](crate::RayTree::closest_points): the closest point to `point` at `time`
/// within `max_distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPointQuery {
    /// The point, in world coordinates.
    pub point: DVec3,
    /// The time, in the shutter `[0, 1]`.
    pub time: f32,
    /// Points farther away are ignored; may be infinite.
    pub max_distance: f32,
}

impl ClosestPointQuery {
    /// A query at a point (`Vec3` or `DVec3`) and a time, without a greatest distance.
    pub fn new(point: impl Into<DVec3>, time: f32) -> ClosestPointQuery {
        ClosestPointQuery { point: point.into(), time, max_distance: f32::INFINITY }
    }

    /// The same query for points no farther than `max_distance`.
    pub fn within(self, max_distance: f32) -> ClosestPointQuery {
        ClosestPointQuery { max_distance, ..self }
    }

    /// Whether all fields are in range: see [`RayTree::closest_point`](crate::RayTree::closest_point). (Comparisons in
    /// this form also reject NaN.)
    fn is_valid(&self) -> bool {
        self.point.abs().cmple(DVec3::splat(MAX_COORDINATE)).all()
            && (0.0..=1.0).contains(&self.time)
            && self.max_distance >= 0.0
    }
}

/// A query of a tree that may be placed in an outer space (as an instance); the query point and all distances are in
/// that space.
#[derive(Clone, Copy)]
pub(crate) struct PlacedQuery {
    pub query: ClosestPointQuery,
    /// The placement of the tree; `None` if the tree's own space is the outer space.
    pub placed: Option<Placement>,
}

impl From<ClosestPointQuery> for PlacedQuery {
    fn from(query: ClosestPointQuery) -> PlacedQuery {
        PlacedQuery { query, placed: None }
    }
}

/// The closest point of one primitive.
#[derive(Clone, Copy)]
pub(crate) struct Candidate {
    pub distance: f32,
    pub point: DVec3,
    pub u: f32,
    pub v: f32,
}

/// The weights of the second and the third corner. Zero is added so that none is -0: leaf blocks have zeros of corners with either
/// sign.
#[inline(always)]
fn weights(found: OnTriangle) -> [f32; 2] {
    [found.u as f32 + 0.0, found.v as f32 + 0.0]
}

/// A query in the outer space, and in tree space.
pub(crate) struct QueryInTree<'a> {
    pub(in crate::ray) point: DVec3,
    pub(in crate::ray) time: f32,
    pub(in crate::ray) max_distance: f32,
    frame: &'a Frame,
    pub(in crate::ray) placed: Option<&'a Placement>,
    /// The query point in the tree's own space.
    pub(in crate::ray) own: DVec3,
    /// The greatest distance in tree space per unit of distance in the outer space.
    scale_bound: f64,
    /// By how much more distances count along other axes than `scale_bound` says.
    pub(super) stretch: Stretch,
    /// By how much computed outer distances may be smaller than this bound assumes.
    deviation: f64,
    /// The query point in tree space.
    pub(in crate::ray) inside: DVec3,
    /// The f32 numbers on either side of `inside`.
    low: Vec3,
    high: Vec3,
}

impl<'a> QueryInTree<'a> {
    /// Returns `None` for a query that is out of range.
    #[inline(always)]
    pub fn new(PlacedQuery { query, placed }: &'a PlacedQuery, frame: &'a Frame) -> Option<QueryInTree<'a>> {
        if !query.is_valid() {
            return None;
        }
        let (own, scale_bound, stretch, deviation) = match placed {
            None => (query.point, frame.scale, Stretch::NONE, 0.0),
            Some(placed) => {
                let preimage = placed.preimage(query.point, frame.bounds);
                let (stretch, least) = Stretch::new(&preimage);
                (preimage.point, frame.scale / least, stretch, preimage.deviation)
            }
        };
        let inside = (own - frame.origin) * frame.scale;
        // The difference is rounded in f64, and the conversion is to the nearest f32: the neighbouring floats enclose
        // both errors.
        let nearest = inside.as_vec3();
        let (low, high) = (nearest.map(f32::next_down), nearest.map(f32::next_up));
        let &ClosestPointQuery { point, time, max_distance } = query;
        Some(QueryInTree {
            point,
            time,
            max_distance,
            frame,
            placed: placed.as_ref(),
            own,
            scale_bound,
            stretch,
            deviation,
            inside,
            low,
            high,
        })
    }

    /// The closest point of a triangle with these corners in tree space.
    #[inline(always)]
    pub(in crate::ray) fn on_triangle(&self, corners: [DVec3; 3]) -> Candidate {
        if let Some(placed) = self.placed {
            return self.on_placed_triangle(placed, corners);
        }
        let found = closest_on_triangle(self.inside, corners);
        let [u, v] = weights(found);
        Candidate {
            distance: (found.distance_squared.sqrt() / self.frame.scale) as f32,
            point: found.point / self.frame.scale + self.frame.origin,
            u,
            v,
        }
    }

    /// The same for a placed tree: the closest point of the triangle's image.
    #[inline(never)]
    fn on_placed_triangle(&self, placed: &Placement, corners: [DVec3; 3]) -> Candidate {
        let corners = corners.map(|p| placed.matrix.transform_point3(self.frame.fine_to_world(p)));
        let found = closest_on_triangle(self.point, corners);
        let [u, v] = weights(found);
        Candidate { distance: found.distance_squared.sqrt() as f32, point: found.point, u, v }
    }

    /// The closest point of a shape.
    pub(in crate::ray) fn on_shape(&self, shape: &dyn Primitive) -> Option<Candidate> {
        let found = shape.closest_point(self.own, self.time)?;
        let point = self.placed.map_or(found.point, |placed| placed.matrix.transform_point3(found.point));
        let distance = (point - self.point).length() as f32;
        (!distance.is_nan()).then_some(Candidate { distance, point, u: found.u, v: found.v })
    }

    /// The greatest distance in tree space of a point whose outer distance rounds to at most `limit`.
    #[inline(always)]
    pub(in crate::ray) fn reach(&self, limit: f32) -> f64 {
        (f64::from(limit.next_up()) + self.deviation) * self.scale_bound
    }

    /// The square of a distance in tree space, as [`QueryInTree::distances`] counts it, given its parts along the axes.
    #[inline(always)]
    pub(in crate::ray) fn square(&self, along: DVec3) -> f64 {
        (along * Vec3::from_array(self.stretch.factors()).as_dvec3()).length_squared()
    }

    /// Whether the query point is close enough for bounds of distances from triangles and spheres.
    #[inline(always)]
    pub(in crate::ray) fn is_close(&self) -> bool {
        self.high.max(-self.low).max_element() * self.stretch.most() < FARTHEST
    }

    /// The boxes of a node that are within reach, and their squared distances; see [`QueryInTree::distances`].
    #[inline(always)]
    pub(in crate::ray) fn enter<S: Simd, const ROWS: usize>(&self, s: S, block: &NodeBlock, cull: f32) -> (Mask, S::F) {
        let distances = self.distances_of::<S, ROWS>(s, block);
        let absent = s.splat_u(ChildRef::NOTHING.0);
        let present = s.lt_u(s.to_bits(s.load(children_of::<ROWS>(block))), absent);
        (s.le(distances, s.splat(cull)) & present, distances)
    }

    /// Squared distances from boxes; see [`QueryInTree::distances`].
    #[inline(always)]
    pub(in crate::ray) fn distances_of<S: Simd, const ROWS: usize>(&self, s: S, boxes: &impl Faces) -> S::F {
        let time = s.splat(self.time);
        let (mut lower, mut upper) = ([time; 3], [time; 3]);
        for axis in 0..3 {
            lower[axis] = boxes.face::<S, ROWS>(s, 2 * axis * LANES, time);
            upper[axis] = boxes.face::<S, ROWS>(s, (2 * axis + 1) * LANES, time);
        }
        self.distances(s, lower, upper)
    }

    /// A squared distance: a box whose distance computed in f32 is above it has no point within `limit`.
    #[inline(always)]
    pub(in crate::ray) fn cull(&self, limit: f32) -> f32 {
        QueryInTree::squared(self.reach(limit))
    }

    /// A squared distance: a box whose distance computed in f32 is above it is farther away than `reach`.
    #[inline(always)]
    pub(in crate::ray) fn squared(reach: f64) -> f32 {
        (reach * reach * (1.0 + f64::from(8.0 * ULP))) as f32 + f32::MIN_POSITIVE
    }

    /// Squared distances from sixteen boxes, never too large by more than [`QueryInTree::cull`] allows for.
    #[inline(always)]
    pub(in crate::ray) fn distances<S: Simd>(&self, s: S, lower: [S::F; 3], upper: [S::F; 3]) -> S::F {
        let (mut below, mut above) = (lower, upper);
        for axis in 0..3 {
            below[axis] = lower[axis] - s.splat(self.high[axis]);
            above[axis] = s.splat(self.low[axis]) - upper[axis];
        }
        let [x, y, z] = self.stretch.gaps(s, below, above);
        let zero = s.splat(0.0);
        let (x, y, z) = (s.max(x, zero), s.max(y, zero), s.max(z, zero));
        x * x + y * y + z * z
    }
}
