//! The public interface of neighbour lists.

use super::error::ListError;
use super::list_request::{ListRequest, Listing};
use super::make;
use super::neighbor_lists::NeighborLists;
use super::periodic_box::PeriodicBox;
use super::radii::Radii;
use crate::parallel;
use crate::point::tree::PointTree;

/// A request for neighbour lists in preparation; made by [`PointTree::neighbor_lists`].
#[derive(Clone, Copy, Debug)]
#[must_use = "a query does nothing until `run` is called"]
pub struct ListQuery<'a> {
    pub(super) request: ListRequest<'a>,
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
    /// candidates for two to three neighbours found. Of [`PointStructure::Kd`](crate::PointStructure::Kd) the points
    /// that exist at the time are put into a tree of boxes first.
    ///
    /// ```
    /// use mbkd::{MovingPoint, NeighborLists, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::X), MovingPoint::fixed(Vec3::X * 2.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut lists = NeighborLists::new();
    /// tree.neighbor_lists(0.0, 1.5).run(&mut lists)?;
    /// assert_eq!(lists.neighbors(), 0);
    /// tree.neighbor_lists(0.75, 1.5).with_distances().run(&mut lists)?;
    /// assert_eq!(lists.distances_squared(), [1.5625; 2]);
    /// // In a box of length 2 along x, the second point is where the first one is when the shutter opens.
    /// tree.neighbor_lists(0.0, 1.5).periodic([Some(2.0), None, None]).pairs_once().run(&mut lists)?;
    /// assert_eq!(lists.neighbors(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn neighbor_lists<'a>(&'a self, time: f32, radii: impl Into<Radii<'a>>) -> ListQuery<'a> {
        let listing = Listing {
            radii: radii.into(),
            once: false,
            distances: false,
            displacements: false,
            sorted: false,
            most: usize::MAX,
            periodic_box: PeriodicBox::default(),
            other_set: false,
            distinct: false,
        };
        ListQuery { request: ListRequest { tree: self, among: None, time, periods: [None; 3], listing, by_id: false } }
    }
}

impl<'a> ListQuery<'a> {
    /// Each pair in one list only: that of the lower id. (Among another set, only neighbours with greater ids.) With radii of their
    /// own ([`Radii::Own`]), the radius of the lower id alone decides: a pair that only the other one reaches is in no list.
    /// [`Radii::Larger`] and [`Radii::Sum`] treat both alike.
    pub fn pairs_once(mut self) -> Self {
        self.request.listing.once = true;
        self
    }

    /// Lists the points of another tree instead, all of them: fluid among boundary particles, say.
    pub fn among(mut self, other: &'a PointTree) -> Self {
        self.request.among = Some(other);
        self
    }

    /// Makes axes periodic with these lengths: points are as far apart as their nearest images. Lengths are rounded to f32,
    /// unless positions are kept in f64.
    ///
    /// A difference d becomes `d - round(d * (1 / L)) * L`, each step rounded, with ties of `round` to even. Positions may lie
    /// anywhere, also several periods away. Each neighbour is listed once, at its nearest image; with
    /// a radius of more than half a period, further images would lie within it too, and are not listed.
    pub fn periodic<L: Into<f64>>(mut self, lengths: [Option<L>; 3]) -> Self {
        self.request.periods = lengths.map(|length| length.map(Into::into));
        self
    }

    /// Also gives squared distances.
    pub fn with_distances(mut self) -> Self {
        self.request.listing.distances = true;
        self
    }

    /// Also gives the displacement from the point to each neighbour.
    pub fn with_displacements(mut self) -> Self {
        self.request.listing.displacements = true;
        self
    }

    /// Sorts each list by id.
    pub fn sorted(mut self) -> Self {
        self.request.listing.sorted = true;
        self
    }

    /// An error if a list has more neighbours than this ([`ListError::TooManyNeighbors`]).
    ///
    /// It bounds the memory of lists: where points clump, as in a simulation that becomes unstable, there may be as many neighbours
    /// as pairs of points, and a program that runs out of memory is aborted. It saves time as well: once a list is too long, points
    /// near each other that all have greater ids are passed over, since only lower ones can change the error.
    ///
    /// ```
    /// use mbkd::{ListError, NeighborLists, PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3]; 1000], &PointParams::default())?;
    /// let lists = tree.neighbor_lists(0.0, 1.0).max_neighbors(200).run(&mut NeighborLists::new());
    /// assert_eq!(lists, Err(ListError::TooManyNeighbors { id: 0 }));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn max_neighbors(mut self, most: usize) -> Self {
        self.request.listing.most = most;
        self
    }

    /// Puts the lists in the order of ids. These must be 0, 1, 2, … in any order, as they are unless given. List i is that
    /// of point i, empty if it does not exist at the time. (Ids of points that do not exist then are not checked.)
    ///
    /// Otherwise lists are in the order of the tree, in which they are made. Costs a copy of all lists.
    pub fn in_order(mut self) -> Self {
        self.request.by_id = true;
        self
    }

    /// The same lists for the points of another tree.
    pub(super) fn of<'b>(self, tree: &'b PointTree) -> ListQuery<'b>
    where
        'a: 'b,
    {
        ListQuery { request: ListRequest { tree, ..self.request } }
    }

    /// Makes the lists, in new memory. Step after step, [`ListQuery::run`] saves allocating it.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
    /// assert_eq!(tree.neighbor_lists(0.0, 2.0).in_order().collect()?.row(0), [1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`ListQuery::run`].
    pub fn collect(self) -> Result<NeighborLists, ListError> {
        let mut lists = NeighborLists::new();
        self.run(&mut lists)?;
        Ok(lists)
    }

    /// Makes the lists, in place of what `lists` held. After an error it holds no lists.
    ///
    /// # Errors
    /// - [`ListError::Time`] outside [0, 1].
    /// - [`ListError::Radius`] for a radius that is negative or NaN, [`ListError::MissingRadius`] for a point without one.
    /// - [`ListError::Period`] for a period that is not above zero or not a normal f32, [`ListError::FarFromPeriod`] for points
    ///   more than a million periods from zero.
    /// - [`ListError::Origins`] and [`ListError::Double`] if the two trees keep their positions in different ways
    ///   ([`ListQuery::among`]).
    /// - [`ListError::Ids`] if lists in the order of ids are requested, and ids are not 0, 1, 2, … ([`ListQuery::in_order`]).
    /// - [`ListError::TooManyNeighbors`] for a list that is too long ([`ListQuery::max_neighbors`]).
    pub fn run(self, lists: &mut NeighborLists) -> Result<(), ListError> {
        parallel::entered(self.request.tree.len(), || self.checked_run(lists))
    }

    fn checked_run(mut self, lists: &mut NeighborLists) -> Result<(), ListError> {
        lists.clear();
        self.request.check()?;
        let ListRequest { tree, among, time, periods, ref mut listing, .. } = self.request;
        listing.periodic_box = PeriodicBox::new(periods);
        (listing.other_set, listing.distinct) = (among.is_some(), tree.distinct);
        let (boxed, boxed_among) = (tree.box_tree_at(time), among.and_then(|among| among.box_tree_at(time)));
        let (tree, among) = (boxed.as_ref().unwrap_or(tree), boxed_among.as_ref().or(among));
        make::lists(&ListRequest { tree, among, ..self.request }, lists)
    }
}
