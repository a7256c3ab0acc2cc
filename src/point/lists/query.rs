//! Neighbour lists as callers ask for them.

use super::csr::NeighborCsr;
use super::error::ListError;
use super::row::Listing;
use super::run;
use super::torus::Torus;
use crate::point::PointTree;

/// How far neighbours may be.
///
/// The squared distance is compared with the squared radius, both computed in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radii<'a> {
    /// The same for all points.
    Equal(f32),
    /// Each point lists what is within its own radius; its neighbour may not list it. One radius for each id.
    Own(&'a [f32]),
    /// Two points are neighbours where either is within the radius of the other: within the larger of the two.
    Larger {
        /// Radii by id of the points that lists are made for.
        own: &'a [f32],
        /// Radii by id of the points that are listed: the same again where a set is asked for its own neighbours.
        others: &'a [f32],
    },
}

impl From<f32> for Radii<'_> {
    fn from(radius: f32) -> Self {
        Radii::Equal(radius)
    }
}

/// A question for neighbour lists in preparation; made by [`PointTree::neighbor_lists`].
#[derive(Clone, Copy)]
#[must_use = "a query does nothing until `run` is called"]
pub struct ListQuery<'a> {
    pub(super) tree: &'a PointTree,
    pub(super) among: &'a PointTree,
    pub(super) time: f32,
    pub(super) periods: [Option<f32>; 3],
    pub(super) listing: Listing<'a>,
    pub(super) by_id: bool,
}

impl PointTree {
    /// For every point that exists at `time` all others within a radius, or within [`Radii`] of their own: the
    /// neighbour lists of particle methods.
    ///
    /// Unless refined, the lists hold ids only, in no particular order, each pair from both sides; points with the
    /// same id are the same point. Every list is what comparing all points gives, with the arithmetic of
    /// [`PointTree::query`], for any structure, number of threads and instruction set; the order within lists does
    /// not depend on the latter two either.
    ///
    /// Cost: one walk through the tree for sixteen neighbouring leaves, then about one vector operation on sixteen
    /// candidates for two to three neighbours found.
    ///
    /// ```
    /// use mbkd::{MovingPoint, NeighborCsr, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::X), MovingPoint::fixed(Vec3::X * 2.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut lists = NeighborCsr::new();
    /// tree.neighbor_lists(0.0, 1.5).run(&mut lists)?;
    /// assert_eq!(lists.neighbors(), 0);
    /// tree.neighbor_lists(0.75, 1.5).with_distances().run(&mut lists)?;
    /// assert_eq!(lists.distances_squared(), [1.5625; 2]);
    /// // In a box of length 2 along x, the second point is at the first one's place when the shutter opens.
    /// tree.neighbor_lists(0.0, 1.5).periodic([Some(2.0), None, None]).pairs_once().run(&mut lists)?;
    /// assert_eq!(lists.neighbors(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn neighbor_lists<'a>(&'a self, time: f32, radii: impl Into<Radii<'a>>) -> ListQuery<'a> {
        let listing = Listing {
            radii: radii.into(),
            torus: Torus::default(),
            once: false,
            other_set: false,
            distances: false,
            displacements: false,
            sorted: false,
        };
        ListQuery { tree: self, among: self, time, periods: [None; 3], listing, by_id: false }
    }
}

impl<'a> ListQuery<'a> {
    /// Each pair in one list only: that of the lower id. (Among another set, only neighbours with greater ids.)
    pub fn pairs_once(mut self) -> Self {
        self.listing.once = true;
        self
    }

    /// Lists the points of another tree instead, all of them: fluid among boundary particles, say.
    pub fn among(mut self, other: &'a PointTree) -> Self {
        self.among = other;
        self.listing.other_set = true;
        self
    }

    /// Makes axes periodic with these lengths: points are as far apart as their nearest images.
    ///
    /// Positions may lie anywhere, also several periods away. Each neighbour is listed once, at its nearest image; with
    /// a radius of more than half a period, further images would lie within it too, and are not listed.
    pub fn periodic(mut self, lengths: [Option<f32>; 3]) -> Self {
        self.periods = lengths;
        self
    }

    /// Also gives squared distances.
    pub fn with_distances(mut self) -> Self {
        self.listing.distances = true;
        self
    }

    /// Also gives the way from the point to each neighbour.
    pub fn with_displacements(mut self) -> Self {
        self.listing.displacements = true;
        self
    }

    /// Sorts each list by id.
    pub fn sorted(mut self) -> Self {
        self.listing.sorted = true;
        self
    }

    /// Puts the lists in the order of ids, which must be 0, 1, 2, … in any order, as they are unless given: list i is
    /// that of point i, empty where it does not exist at the time.
    ///
    /// Otherwise lists are in the order of the tree, in which they are made. Costs a copy of all lists from one place
    /// in memory to another.
    pub fn rows_by_id(mut self) -> Self {
        self.by_id = true;
        self
    }

    /// Makes the lists, in place of what `lists` held. After an error it holds no lists.
    pub fn run(mut self, lists: &mut NeighborCsr) -> Result<(), ListError> {
        lists.offsets.clear();
        lists.points.clear();
        self.check()?;
        self.listing.torus = Torus::new(self.periods);
        run::run(&self, lists)
    }

    /// What can be said before looking at points.
    fn check(&self) -> Result<(), ListError> {
        if !(0.0..=1.0).contains(&self.time) {
            return Err(ListError::Time);
        }
        if self.tree.origin() != self.among.origin() && !self.tree.is_empty() && !self.among.is_empty() {
            return Err(ListError::Origins);
        }
        let bad = |axis: &usize| self.periods[*axis].is_some_and(|length| !(length.is_normal() && length > 0.0));
        if let Some(axis) = (0..3).find(bad) {
            return Err(ListError::Period { axis });
        }
        let bad = |radius: f32| radius.is_nan() || radius < 0.0;
        let bad_at = |radii: &[f32]| radii.iter().position(|&radius| bad(radius)).map(|id| id as u32);
        match self.listing.radii {
            Radii::Equal(radius) if bad(radius) => Err(ListError::Radius { id: None }),
            Radii::Equal(_) => Ok(()),
            Radii::Own(own) => bad_at(own).map_or(Ok(()), |id| Err(ListError::Radius { id: Some(id) })),
            Radii::Larger { own, others } => {
                let bad = bad_at(own).or_else(|| bad_at(others));
                bad.map_or(Ok(()), |id| Err(ListError::Radius { id: Some(id) }))
            }
        }
    }
}
