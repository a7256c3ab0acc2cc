//! Queries in space that repeats along some axes: periodic boxes.
//!
//! A query runs as queries of its images among the points themselves, the nearest image first. Most queries have one image, as
//! their neighbours are nearer than the faces of the box.

use super::buffer::NeighborBuffer;
use super::compiled;
use super::images::{FARTHEST, Image, Images, MOST_EXTENT};
use super::query::NeighborQuery;
use crate::geometry::Aabb;
use crate::point::neighbor::Neighbor;
use crate::point::search::{Keep, KeepAll, KeepIf};
use crate::point::tree::PointTree;
use crate::primitive::Position;
use core::fmt;
use glam::DVec3;

/// Why space cannot repeat with some lengths ([`PointTree::periodic`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PeriodError {
    /// A length is not above zero, or not finite.
    Length {
        /// The axis.
        axis: usize,
    },
    /// The box around all points over the shutter is longer than sixteen periods. Move points by whole periods into one box, with
    /// all their keys.
    Extent {
        /// The axis.
        axis: usize,
    },
    /// Points are more than 2^40 periods from zero, where images of a place would be rounded too much.
    FarFromPeriod {
        /// The axis.
        axis: usize,
    },
}

impl fmt::Display for PeriodError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PeriodError::Length { axis } => write!(f, "the period of axis {axis} must be above zero and finite"),
            PeriodError::Extent { axis } => {
                write!(
                    f,
                    "points, at all keys, are more than {MOST_EXTENT} periods apart along axis {axis}: move them into one box, or \
                     divide a step in which some go farther"
                )
            }
            PeriodError::FarFromPeriod { axis } => {
                write!(f, "points are more than 2^40 periods from zero along axis {axis}; move them into the box")
            }
        }
    }
}

impl core::error::Error for PeriodError {}

/// The points of a tree in space that repeats along some axes; made by [`PointTree::periodic`].
#[derive(Clone, Copy, Debug)]
pub struct PeriodicPoints<'a> {
    pub(super) tree: &'a PointTree,
    pub(super) images: Images,
}

impl PointTree {
    /// The points in space that repeats along some axes, with these lengths: a periodic box. Points may lie anywhere, also outside
    /// of a box that begins at zero; the same space results for any place of the box.
    ///
    /// For neighbour lists of all points: [`ListQuery::periodic`](crate::ListQuery::periodic).
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.1f32, 0.5, 0.5], [0.7, 0.5, 0.5]], &PointParams::default())?;
    /// let periodic = tree.periodic([Some(1.0); 3])?;
    /// // Across the face: the first point is 0.15 away, the second 0.25.
    /// let near = periodic.query([0.95f32, 0.5, 0.5], 0.0).radius(0.2).nearest_n(8);
    /// assert_eq!(near.iter().map(|n| n.id).collect::<Vec<_>>(), [0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A length that is not above zero or not finite; points that are more than sixteen periods apart, or 2^40 from zero.
    pub fn periodic<L: Into<f64>>(&self, lengths: [Option<L>; 3]) -> Result<PeriodicPoints<'_>, PeriodError> {
        let images = images_in_box(lengths.map(|length| length.map(Into::into)), self.bounds())?;
        Ok(PeriodicPoints { tree: self, images })
    }
}

/// The images of places in space that repeats with some lengths, among points within a box around them.
///
/// # Errors
/// As [`PointTree::periodic`].
pub(in crate::point) fn images_in_box(lengths: [Option<f64>; 3], bounds: Option<Aabb>) -> Result<Images, PeriodError> {
    let bounds = bounds.unwrap_or(Aabb { min: DVec3::ZERO, max: DVec3::ZERO });
    for (axis, length) in lengths.iter().enumerate() {
        let Some(length) = *length else { continue };
        // Also false for NaN.
        if !(length > 0.0 && length.is_finite()) {
            return Err(PeriodError::Length { axis });
        }
        let (low, high) = (bounds.min[axis], bounds.max[axis]);
        if high - low > MOST_EXTENT * length {
            return Err(PeriodError::Extent { axis });
        }
        if low.abs().max(high.abs()) > FARTHEST * length {
            return Err(PeriodError::FarFromPeriod { axis });
        }
    }
    Ok(Images::new(lengths.map(|length| length.unwrap_or(0.0)), bounds))
}

impl<'a> PeriodicPoints<'a> {
    /// A query at a place and a time in the shutter. The place may be in any period.
    #[inline(always)]
    pub fn query(&self, at: impl Position, time: f32) -> PeriodicQuery<'a> {
        PeriodicQuery { query: self.tree.query(at, time), tree: self.tree, images: self.images }
    }
}

/// A neighbour query in space that repeats: set its options, then run it, as a [`NeighborQuery`].
///
/// Points are as far away as the nearest image of the query's place, and each is found once. The place is moved by whole periods in
/// f64, and each image is rounded as the place of any query is. Every run equals brute force over all images.
///
/// Ids tell which points are the same: where several images are searched farther away than half a period, of points with one id the
/// nearest counts.
///
/// Cost: that of one query where the faces of the box around all points are farther away than the neighbours, otherwise that of a
/// query for each image within reach of a point. Where ids repeat, searches for the nearest few that reach farther than half a
/// period ask for more points until there are so many ids among them: for all points, if there are fewer ids.
#[derive(Clone, Copy)]
#[must_use = "a query does nothing until one of its runs is called"]
pub struct PeriodicQuery<'a, K = KeepAll> {
    query: NeighborQuery<'a, K>,
    tree: &'a PointTree,
    images: Images,
}

impl<K> fmt::Debug for PeriodicQuery<'_, K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PeriodicQuery").field("query", &self.query).field("images", &self.images).finish()
    }
}

impl<'a> PeriodicQuery<'a> {
    /// [`NeighborQuery::filter`].
    #[inline(always)]
    pub fn filter<F: Fn(u32) -> bool>(self, predicate: F) -> PeriodicQuery<'a, KeepIf<F>> {
        PeriodicQuery { query: self.query.filter(predicate), tree: self.tree, images: self.images }
    }
}

impl<K: Keep> PeriodicQuery<'_, K> {
    /// [`NeighborQuery::radius`].
    #[inline(always)]
    pub fn radius(self, radius: f32) -> Self {
        PeriodicQuery { query: self.query.radius(radius), tree: self.tree, images: self.images }
    }

    /// [`NeighborQuery::approximate`]. Searches for several neighbours that reach farther than half a period are exact.
    #[inline(always)]
    pub fn approximate(self, epsilon: f32) -> Self {
        PeriodicQuery { query: self.query.approximate(epsilon), tree: self.tree, images: self.images }
    }

    /// The nearest point. Ties go to the lowest id.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.1f32, 0.5, 0.5], [0.7, 0.5, 0.5]], &PointParams::default())?;
    /// let nearest = tree.periodic([Some(1.0); 3])?.query([0.95f32, 0.5, 0.5], 0.0).nearest();
    /// assert_eq!(nearest.map(|n| n.id), Some(0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn nearest(self) -> Option<Neighbor> {
        let (mut best, mut buffer): (Option<Neighbor>, _) = (None, NeighborBuffer::take());
        self.in_order(&mut buffer.images, |image| {
            if let Some(near) = image.nearest()
                && best.is_none_or(|best| order(&near) < order(&best))
            {
                best = Some(near);
            }
            best.map(|best| best.distance_squared)
        });
        buffer.give_back();
        best
    }

    /// The `k` nearest points in order of (distance, id); all if there are fewer.
    pub fn nearest_n(self, k: usize) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.nearest_n_into(k, &mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    pub fn nearest_n_into(self, k: usize, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        let NeighborBuffer { candidates, found, images, of_image } = buffer;
        found.clear();
        if k == 0 {
            return found;
        }
        // How many points each image is asked for, and whether two images may have found the same ones.
        let (mut query, mut points, mut repeats) = (self, k, false);
        loop {
            found.clear();
            // Up to which distance all points have been found.
            let (mut complete, mut first) = (f32::INFINITY, true);
            query.in_order(images, |image| {
                of_image.clear();
                image.run(|query| compiled::nearest_n(query, points, candidates, of_image));
                if let Some(last) = of_image.get(points - 1) {
                    complete = complete.min(last.distance_squared);
                }
                let only = core::mem::take(&mut first);
                repeats |= !only && query.images.may_repeat(image.query.bound);
                if only {
                    core::mem::swap(found, of_image);
                } else {
                    found.append(of_image);
                }
                if repeats {
                    keep_nearest(found);
                }
                if repeats || !only {
                    sort(found);
                    found.truncate(k);
                }
                found.get(k - 1).map(|last| last.distance_squared)
            });
            // Several points with one id may have been found instead of others. At that distance, points with lower ids may be
            // missing.
            let last = found.get(k - 1).map_or(f32::INFINITY, |last| last.distance_squared);
            let enough = query.tree.distinct || last < complete || complete == f32::INFINITY;
            // In an approximate search, two images may give the same farther point instead of two nearer ones.
            if !repeats || enough && !query.query.is_approximate() {
                return found;
            }
            points = if enough { points } else { points.saturating_mul(2) };
            query = query.approximate(0.0);
        }
    }

    /// All points within the radius, in no particular order.
    pub fn collect(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.collect_into(&mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    pub fn collect_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        let NeighborBuffer { candidates, found, images, of_image } = buffer;
        found.clear();
        let bound = self.query.query.bound;
        self.all(images);
        for image in &*images {
            of_image.clear();
            let image = self.query.moved(image.place, bound);
            image.run(|query| compiled::collect(query, candidates, of_image));
            found.append(of_image);
        }
        if images.len() > 1 && self.images.may_repeat(bound) {
            keep_nearest(found);
        }
        found
    }

    /// All points within the radius, in order of (distance, id).
    pub fn collect_sorted(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.collect_sorted_into(&mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    pub fn collect_sorted_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        self.collect_into(buffer);
        sort(&mut buffer.found);
        &buffer.found
    }

    /// The number of points within the radius.
    pub fn count(self) -> usize {
        let (mut buffer, bound) = (NeighborBuffer::take(), self.query.query.bound);
        self.all(&mut buffer.images);
        let count = if buffer.images.len() > 1 && self.images.may_repeat(bound) {
            self.collect_into(&mut buffer).len()
        } else {
            buffer.images.iter().map(|image| self.query.moved(image.place, bound).count()).sum()
        };
        buffer.give_back();
        count
    }

    /// The images from which a point may be within the radius.
    fn all(&self, images: &mut Vec<Image>) {
        images.clear();
        if self.query.finds_something() {
            let home = self.images.home(self.query.query.given);
            self.images.within(home, self.query.query.bound.into(), images);
        }
    }

    /// Shows the images from which a point may be near enough to `search`, nearest first. It returns the squared distance up to
    /// which points still count, if that is known.
    #[inline(always)]
    fn in_order(&self, images: &mut Vec<Image>, mut search: impl FnMut(NeighborQuery<'_, &K>) -> Option<f32>) {
        if self.query.finds_something() {
            let (place, bound) = (self.query.query.given, self.query.query.bound);
            self.images.in_order(place, bound, images, |place, bound| search(self.query.moved(place, bound)));
        }
    }
}

/// What neighbours are sorted by. The bits of squares order like the squares.
#[inline(always)]
fn order(near: &Neighbor) -> (u32, u32) {
    (near.distance_squared.to_bits(), near.id)
}

fn sort(found: &mut [Neighbor]) {
    found.sort_unstable_by_key(order);
}

/// Keeps each point once, where it is nearest.
fn keep_nearest(found: &mut Vec<Neighbor>) {
    found.sort_unstable_by_key(|near| (near.id, near.distance_squared.to_bits()));
    found.dedup_by_key(|near| near.id);
}
