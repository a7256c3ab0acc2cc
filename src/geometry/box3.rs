//! Boxes in tree space, as the builders use them.

use super::interval::TimeInterval;
use glam::Vec3;

/// Half the spacing of f32 numbers just above 1: the unit all rounding bounds of this crate count in.
pub(crate) const ULP: f32 = f32::EPSILON * 0.5;

/// The square of this length, 2^-60, is a normal number by far: those of much smaller ones are rounded by more than their own bits.
pub(crate) const LEAST_SQUARED: f32 = 1.0 / (1u64 << 60) as f32;

/// How far, per axis, an accepted hit may lie from its primitive as the kernel interpolates it, plus the error of the
/// slab test that finds it: in ULP of the primitive's largest coordinate and of the origin's, whatever the
/// unit. The first part is in the boxes of a tree, the second in each ray.
///
/// With slopes of at most 1, counted in ULP of the sum of both coordinates, which bounds every translated corner:
///
/// | | |
/// |---|---|
/// | the watertight test: a corner's translation, x and depth | 2 |
/// | the slope, itself rounded twice, times the depth, rounded, and the difference, of twice the size | 5 |
/// | the depth that the distance is a mean of, seen along the axis and across | 2 |
/// | the distance, rounded to f32 | 1 |
/// | directions smaller than 2^-24 taken as that | 1 |
/// | the slab test: the reciprocal, two products, two sums (one of them fused or not) | 6 |
/// | custom primitives see the origin unrounded | 1 |
///
/// These are 18; two more cover that boxes are padded by a rounded number.
pub(crate) const KERNEL_ULPS: f32 = 20.0;

/// An axis-aligned box in tree space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    pub min: Vec3,
    pub max: Vec3,
}

impl Box3 {
    pub const EMPTY: Box3 = Box3 { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    #[inline]
    pub fn union(self, other: Box3) -> Box3 {
        Box3 { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub fn intersection(self, other: Box3) -> Box3 {
        Box3 { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    #[inline]
    pub fn include(self, p: Vec3) -> Box3 {
        Box3 { min: self.min.min(p), max: self.max.max(p) }
    }

    #[inline]
    pub fn pad(self, by: f32) -> Box3 {
        Box3 { min: self.min - by, max: self.max + by }
    }

    /// The largest magnitude of a coordinate of a point in it.
    #[inline]
    pub fn magnitude(self) -> f32 {
        (-self.min).max(self.max).max_element()
    }

    #[inline]
    pub fn is_empty(self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Whether the point lies in it, faces included.
    #[inline]
    pub fn holds(self, p: Vec3) -> bool {
        (p.cmpge(self.min) & p.cmple(self.max)).all()
    }

    /// Half the surface area; 0 for an empty box.
    #[inline]
    pub fn half_area(self) -> f32 {
        let d = (self.max - self.min).max(Vec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A box at the begin and one at the end of a time interval, linear in between (tree space).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LinearBox3 {
    pub begin: Box3,
    pub end: Box3,
}

impl LinearBox3 {
    pub const EMPTY: LinearBox3 = LinearBox3 { begin: Box3::EMPTY, end: Box3::EMPTY };

    #[inline]
    pub fn union(self, other: LinearBox3) -> LinearBox3 {
        LinearBox3 { begin: self.begin.union(other.begin), end: self.end.union(other.end) }
    }

    /// Bounds of the intersection: of each pair of faces the one that is tighter on average. (The pointwise tighter of two
    /// lines is not a line.) Empty boxes stay empty.
    pub fn tighter(self, other: LinearBox3) -> LinearBox3 {
        let mut out = self;
        for axis in 0..3 {
            if other.begin.min[axis] + other.end.min[axis] > self.begin.min[axis] + self.end.min[axis] {
                (out.begin.min[axis], out.end.min[axis]) = (other.begin.min[axis], other.end.min[axis]);
            }
            if other.begin.max[axis] + other.end.max[axis] < self.begin.max[axis] + self.end.max[axis] {
                (out.begin.max[axis], out.end.max[axis]) = (other.begin.max[axis], other.end.max[axis]);
            }
        }
        out
    }

    /// The box that the motion sweeps between begin and end.
    #[inline]
    pub fn swept(self) -> Box3 {
        self.begin.union(self.end)
    }

    /// The box at the fraction `w` of the interval, not rounded outward: for costs, not for answers.
    #[inline]
    pub fn at(self, w: f32) -> Box3 {
        Box3 {
            min: self.begin.min + (self.end.min - self.begin.min) * w,
            max: self.begin.max + (self.end.max - self.begin.max) * w,
        }
    }

    /// Lower and upper bound along one axis, as lines over `interval`.
    #[inline]
    pub fn along(self, axis: usize, interval: TimeInterval) -> AxisExtent {
        let line = |begin: f32, end: f32| Line { begin: f64::from(begin), end: f64::from(end) };
        AxisExtent {
            interval,
            lower: line(self.begin.min[axis], self.end.min[axis]),
            upper: line(self.begin.max[axis], self.end.max[axis]),
        }
    }
}

/// A coordinate that changes linearly from the begin to the end of a time interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Line {
    pub begin: f64,
    pub end: f64,
}

/// The extent of an object along one axis during a time interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AxisExtent {
    pub interval: TimeInterval,
    pub lower: Line,
    pub upper: Line,
}
