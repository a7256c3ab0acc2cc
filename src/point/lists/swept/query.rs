//! The public interface of lists over an interval.

use super::coordinate::SweptCoordinate;
use super::encounter_lists::EncounterLists;
use super::images::Images;
use super::make;
use super::sweep::Sweep;
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::lists::error::ListError;
use crate::point::lists::list_request::check_sets;
use crate::point::lists::radii::Radii;
use crate::point::tree::PointTree;

/// A request for the encounters of all points in preparation; made by [`PointTree::neighbor_lists_swept`].
#[derive(Clone, Copy, Debug)]
#[must_use = "a query does nothing until `run` or `collect` is called"]
pub struct SweptQuery<'a> {
    tree: &'a PointTree,
    among: Option<&'a PointTree>,
    interval: TimeInterval,
    radii: Radii<'a>,
    periods: [Option<f64>; 3],
    once: bool,
    most: usize,
    sorted: bool,
    by_id: bool,
}

impl PointTree {
    /// For every point all others that come within a radius, or within [`Radii`] of their own, at some time of the interval, both
    /// ends included, with the times: what a step of a simulation needs in which nothing may pass unseen. With [`Radii::Sum`] these
    /// are the contacts of spheres.
    ///
    /// Decided in f64 for exact linear motion between the positions at the keys, in f32 or f64. Points meet while both exist: not
    /// if one begins to exist where the other ends, as [`TimeInterval::contains`] has it. So an encounter begins before both active
    /// intervals end; if the two are still approaching each other at the end, [`Encounter::closest`] and [`Encounter::leave`] are
    /// the end itself, the limit of the times at which both exist. At a key, a point that begins or ends there counts only on its
    /// own side. This also holds for the float next to a key that is no float (5/6, say). An interval that ends just below such a
    /// key does not contain points that begin at it. (A [`closest_approach`](PointTree::closest_approach) may also be at the end
    /// alone.) Positions are computed from the earlier key, so at the end of the shutter they are off by rounding from those at the
    /// last key, which [`neighbor_lists`](PointTree::neighbor_lists) has.
    ///
    /// The encounters do not depend on the structure, the number of threads or the instruction set. Unless refined, the order of
    /// lists, and of the encounters within them, is that of the tree, or that of ids where it consists of several; a point that
    /// does not exist in the interval may have an empty list or none. Points with the same id are one point in several
    /// places: they are no neighbours of each other, have one list together, and are in another's list once.
    ///
    /// Cost: several times that of lists at a time, even of points that do not move, as each encounter is computed in f64, while
    /// points move less than their spacing relative to their neighbours. Motion that all have in common adds little. Of radii
    /// of their own the greatest of sixteen neighbouring points decides what is looked at for them, and of the listed
    /// points the greatest in each leaf.
    ///
    /// ```
    /// use mbkd::{EncounterLists, MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let mut lists = EncounterLists::new(); // memory that is used again in the next step
    /// for step in 0..3 {
    ///     let points = [MovingPoint::new(Vec3::X * step as f32, Vec3::ZERO), MovingPoint::fixed(Vec3::Y * 0.3)];
    ///     let tree = PointTree::build(&points, &PointParams::default())?;
    ///     tree.neighbor_lists_swept(TimeInterval::FULL, 0.5).run(&mut lists)?;
    ///     assert_eq!(lists.encounters().len(), 2);
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// [`Encounter::closest`]: super::Encounter::closest
    /// [`Encounter::leave`]: super::Encounter::leave
    pub fn neighbor_lists_swept<'a>(&'a self, interval: TimeInterval, radii: impl Into<Radii<'a>>) -> SweptQuery<'a> {
        let radii = radii.into();
        SweptQuery {
            tree: self,
            among: None,
            interval,
            radii,
            periods: [None; 3],
            once: false,
            most: usize::MAX,
            sorted: false,
            by_id: false,
        }
    }
}

impl<'a> SweptQuery<'a> {
    /// Each pair in one list only: that of the lower id. (Among another set, only neighbours with greater ids.) With radii of their
    /// own ([`Radii::Own`]) the radius of the lower id alone decides.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, Radii, TimeInterval, glam::Vec3};
    /// // Two balls that roll towards each other, and their radii.
    /// let balls = [MovingPoint::new(Vec3::NEG_X * 2.0, Vec3::ZERO), MovingPoint::new(Vec3::X * 2.0, Vec3::ZERO)];
    /// let radii = [0.75, 0.25];
    /// let tree = PointTree::build(&balls, &PointParams::default())?;
    /// let touching = Radii::Sum { own: &radii, others: &radii };
    /// let contacts = tree.neighbor_lists_swept(TimeInterval::FULL, touching).pairs_once().in_order().collect()?;
    /// assert_eq!((contacts.encounters().len(), contacts.row(0)[0].enter), (1, 0.75));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn pairs_once(mut self) -> Self {
        self.once = true;
        self
    }

    /// Lists the points of another tree instead, all of them that come near: fluid among moving walls, say. The two may have
    /// different numbers of keys, and different structures. Points with the same id are not the same: their ids are those of two
    /// sets.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let balls = [MovingPoint::new(Vec3::Y * 2.0, Vec3::ZERO), MovingPoint::new(Vec3::Y * 4.0, Vec3::Y * 3.0)];
    /// let balls = PointTree::build(&balls, &PointParams::default())?;
    /// let wall = PointTree::build(&[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0]], &PointParams::default())?;
    /// let contacts = balls.neighbor_lists_swept(TimeInterval::FULL, 0.5).among(&wall).in_order().collect()?;
    /// assert_eq!((contacts.row(0).len(), contacts.row(0)[0].id, contacts.row(0)[0].enter), (1, 0, 0.75));
    /// assert!(contacts.row(1).is_empty());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn among(mut self, other: &'a PointTree) -> Self {
        self.among = Some(other);
        self
    }

    /// Makes axes periodic with these lengths: at every time, points are as far apart as their nearest images. Lengths are
    /// rounded to f32, unless positions are kept in f64.
    ///
    /// A pair has one encounter, whatever images it meets in: [`Encounter::enter`] is when the first of them comes within the
    /// radius, [`Encounter::leave`] when the last one leaves, and [`Encounter::closest`] when any is nearest; ties go to the
    /// earlier time. The two may part in between, where different images meet. A radius may be more than half a period; as in
    /// [`ListQuery::periodic`](crate::ListQuery::periodic), further images that lie within it make no further encounters. A point
    /// does not meet its own images.
    ///
    /// Relative to a point, another is at `(b - a) + k * L`, with a whole number k of periods along each axis and every step in
    /// f64. Lists equal a comparison of all pairs in all images.
    ///
    /// Positions may be anywhere, but with all their keys in a box not longer than sixteen periods. A point that leaves the box
    /// moves on outside of it during the shutter: its last key must not be moved back into the box without the first.
    ///
    /// Cost: among groups of points that reach no face of the box around all points as without periods; near faces that of copies.
    /// The number of images grows with the extent of the set over the shutter, in periods, along each axis, and with the radius up
    /// to the longest distance of nearest images.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// // In a box of length 1, the first point leaves across the face and meets the other one there.
    /// let points = [MovingPoint::new(Vec3::X * 0.7, Vec3::X * 1.3), MovingPoint::fixed(Vec3::new(0.1, 0.2, 0.0))];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let swept = tree.neighbor_lists_swept(TimeInterval::FULL, 0.25);
    /// assert_eq!(swept.collect()?.encounters().len(), 0);
    /// let lists = swept.periodic([Some(1.0), None, None]).in_order().collect()?;
    /// let [first] = lists.row(0) else { panic!("one encounter") };
    /// assert!(first.id == 1 && (first.closest - 2.0 / 3.0).abs() < 1e-6 && (first.enter - 0.25 / 0.6).abs() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// [`Encounter::enter`]: super::Encounter::enter
    /// [`Encounter::closest`]: super::Encounter::closest
    /// [`Encounter::leave`]: super::Encounter::leave
    pub fn periodic<L: Into<f64>>(mut self, lengths: [Option<L>; 3]) -> Self {
        self.periods = lengths.map(|length| length.map(Into::into));
        self
    }

    /// Sorts each list by id.
    pub fn sorted(mut self) -> Self {
        self.sorted = true;
        self
    }

    /// An error if a list has more neighbours than this ([`ListError::TooManyNeighbors`]): bounds the memory of lists where points
    /// clump, as [`ListQuery::max_neighbors`](crate::ListQuery::max_neighbors) does. (Where ids repeat, that of lists in
    /// preparation is not bounded.)
    ///
    /// ```
    /// use mbkd::{ListError, MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = vec![MovingPoint::new(Vec3::ZERO, Vec3::X); 1000];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 1.0).max_neighbors(200).collect();
    /// assert_eq!(lists, Err(ListError::TooManyNeighbors { id: 0 }));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn max_neighbors(mut self, most: usize) -> Self {
        self.most = most;
        self
    }

    /// Puts the lists in the order of ids, as [`ListQuery::in_order`](crate::ListQuery::in_order) does: list i is that of point i,
    /// empty if it meets nothing or does not exist. Costs a copy of all lists.
    pub fn in_order(mut self) -> Self {
        self.by_id = true;
        self
    }

    /// Makes the lists, in new memory. Step after step, [`SweptQuery::run`] saves allocating it.
    ///
    /// # Errors
    /// As [`SweptQuery::run`].
    pub fn collect(self) -> Result<EncounterLists, ListError> {
        let mut lists = EncounterLists::new();
        self.run(&mut lists)?;
        Ok(lists)
    }

    /// Makes the lists, in place of what `lists` held. After an error it holds none.
    ///
    /// # Errors
    /// - [`ListError::Radius`] for a radius that is negative or NaN, [`ListError::MissingRadius`] for a point without one.
    /// - [`ListError::TooManyNeighbors`] for a list that is too long ([`SweptQuery::max_neighbors`]).
    /// - [`ListError::Period`] for a period that is not above zero or not a normal f32, [`ListError::FarFromPeriod`] for points
    ///   more than a million periods from zero, [`ListError::Extent`] for points more than sixteen periods apart.
    /// - [`ListError::Origins`] and [`ListError::Double`] if the two trees keep their positions in different ways
    ///   ([`SweptQuery::among`]).
    /// - [`ListError::Ids`] if lists in the order of ids are requested, and ids are not 0, 1, 2, … ([`SweptQuery::in_order`]).
    pub fn run(self, lists: &mut EncounterLists) -> Result<(), ListError> {
        parallel::entered(self.tree.len(), || self.checked_run(lists))
    }

    fn checked_run(self, lists: &mut EncounterLists) -> Result<(), ListError> {
        let SweptQuery { tree, among, interval, sorted, by_id, .. } = self;
        lists.clear();
        self.radii.check()?;
        check_sets(tree, among.unwrap_or(tree))?;
        let times = [interval.begin(), interval.end()];
        let (boxed, boxed_among) = (tree.box_tree(times), among.and_then(|among| among.box_tree(times)));
        let sets = (boxed.as_ref().unwrap_or(tree), boxed_among.as_ref().or(among));
        let single = !tree.is_double() && among.is_none_or(|among| !among.is_double());
        let crowded = if single {
            self.unordered::<f32>(sets, times, lists)?
        } else {
            self.unordered::<f64>(sets, times, lists)?
        };
        if let Some(id) = crowded {
            lists.clear();
            return Err(ListError::TooManyNeighbors { id });
        }
        if by_id {
            lists.reorder(tree.len())?;
        }
        if sorted {
            lists.sort();
        }
        Ok(())
    }

    /// Makes the lists in the order of the tree; the lowest id of a point that has too many neighbours.
    fn unordered<C: SweptCoordinate>(
        &self,
        sets: (&PointTree, Option<&PointTree>),
        times: [f32; 2],
        lists: &mut EncounterLists,
    ) -> Result<Option<u32>, ListError> {
        let images = Images::new::<C>(self.periods, sets)?;
        let mut shortened = [Vec::new(), Vec::new()];
        let radii = images.shortened(self.radii, &mut shortened);
        let sweep = Sweep::<C>::new(sets, times, radii, [None; 2]).pairs_once(self.once).in_box(images);
        match sweep.lowest_without(radii) {
            Some(of) => Err(ListError::MissingRadius { of }),
            None => Ok(make::lists(lists, &sweep, self.most)),
        }
    }
}
