//! Closest approach in space that repeats along some axes.
//!
//! A search runs as searches with images of the query's path, the nearest image first. An image begins at an image of the path's
//! begin ([`Images`](super::images::Images)) and goes the same way. Which ones come near enough is the same question as for a place
//! at rest, if the box around all points is enlarged by the way.
//!
//! **Rounding.** Both ends of an image may be rounded to f32, by 2^-24 of their coordinates. Along periodic axes each lies within a
//! period and twice the displacement of the box around all points, so its coordinate is at most that of the enlarged box four
//! times, and a period: the slack of an image's distance, 2^-22 of the box and the period, is as much. Along other axes an image
//! may lie far away, and is then rounded by 2^-24 of its distance. [`equally_near`] is farther by 2^-22 of the distance, which is
//! more than that and half an ulp of the answer.

use super::approach::{Approach, equally_near};
use super::periodic::PeriodicPoints;
use crate::geometry::TimeInterval;
use crate::primitive::Position;

impl PeriodicPoints<'_> {
    /// The point that comes nearest to a query that moves on a straight line from `from` at the begin of `interval` to `to` at its
    /// end, and when: [`PointTree::closest_approach`](crate::PointTree::closest_approach), with distances to the nearest images.
    ///
    /// `from` may be in any period, and `to` is where the query goes from there, perhaps through faces of the box. Points may pass
    /// through faces as well, as their keys say. Answers equal brute force over the images of the query: each begins at an image of
    /// `from`, as computed in f64, and is moved by `to - from`. Finds nothing for paths longer than sixteen periods along an axis,
    /// and where the image nearest to the points lies beyond [`MAX_POINT_COORDINATE`](crate::MAX_POINT_COORDINATE). Cost: that of
    /// one search in open space for each image that comes as near as the answer: one inside of the box, two at a face.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let through_the_face = MovingPoint::new(Vec3::new(0.2, 0.5, 0.5), Vec3::new(-0.2, 0.5, 0.5));
    /// let points = [through_the_face, MovingPoint::fixed(Vec3::new(0.5, 0.5, 0.9))];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let (from, to) = (Vec3::new(0.9, 0.5, 0.6), Vec3::new(1.1, 0.5, 0.6));
    /// // They meet in the face: at x = 0 and x = 1.
    /// let meeting = tree.periodic([Some(1.0); 3])?.closest_approach(from, to, TimeInterval::FULL).unwrap();
    /// assert_eq!(meeting.id, 0);
    /// assert!((meeting.time - 0.5).abs() < 1e-6 && (meeting.distance - 0.1).abs() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn closest_approach<Q: Position>(&self, from: Q, to: Q, interval: TimeInterval) -> Option<Approach> {
        self.closest_approach_filtered(from, to, interval, |_| true)
    }

    /// The same among the points whose id the predicate returns true for. It must be pure.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = [Vec3::new(0.1, 0.5, 0.5), Vec3::new(0.7, 0.5, 0.5)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let (periodic, all) = (tree.periodic([Some(1.0); 3])?, TimeInterval::FULL);
    /// // Without itself. A particle may meet its own images, too, which have its id.
    /// let other = periodic.closest_approach_filtered(points[0], points[0], all, |id| id != 0).unwrap();
    /// assert!(other.id == 1 && (other.distance - 0.4).abs() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn closest_approach_filtered<Q: Position>(
        &self,
        from: Q,
        to: Q,
        interval: TimeInterval,
        keep: impl Fn(u32) -> bool,
    ) -> Option<Approach> {
        let (from, to) = (from.wide(), to.wide());
        let displacement = to - from;
        if !displacement.is_finite() {
            return None;
        }
        let images = self.images.of_path(displacement)?;
        let mut best: Option<Approach> = None;
        images.in_order(from, f32::MAX, &mut Vec::new(), |begin, _| {
            // The displacement may be rounded: the caller's path remains as it is.
            let end = if begin == from { to } else { begin + displacement };
            let most = |best: &Approach| equally_near(best.distance.into());
            let near =
                self.tree.approach_within([begin, end], interval, best.as_ref().map_or(f64::INFINITY, most), &keep);
            best = near.into_iter().chain(best).min_by_key(Approach::key);
            // Where the nearest image finds nothing, no other one is searched.
            Some(best.as_ref().map_or(-1.0, |best| (most(best).powi(2) as f32).next_up()))
        });
        best
    }
}
