//! A request for neighbour lists, and its validation.

use super::error::ListError;
use super::periodic_box::{PeriodicBox, check_periods};
use super::radii::Radii;
use crate::point::tree::PointTree;

/// Which neighbours are listed, and which columns are requested.
#[derive(Clone, Copy, Debug)]
pub(super) struct Listing<'a> {
    pub(super) radii: Radii<'a>,
    /// Only neighbours with greater ids: each pair once.
    pub(super) once: bool,
    pub(super) distances: bool,
    pub(super) displacements: bool,
    pub(super) sorted: bool,
    /// The greatest number of neighbours of a point.
    pub(super) most: usize,
    /// What follows from the request, where lists are made: the periodic box; whether the candidates are another set, as otherwise
    /// a point is no neighbour of itself; and whether no two points have the same id.
    pub(super) periodic_box: PeriodicBox,
    pub(super) other_set: bool,
    pub(super) distinct: bool,
}

impl Listing<'_> {
    /// Which columns of floats are requested, in the order of [`Columns::floats`](super::columns::Columns::floats).
    pub(super) fn columns(&self) -> [bool; 4] {
        [self.distances, self.displacements, self.displacements, self.displacements]
    }
}

/// A request for neighbour lists.
#[derive(Clone, Copy, Debug)]
pub(super) struct ListRequest<'a> {
    pub(super) tree: &'a PointTree,
    /// Another set, whose points are listed.
    pub(super) among: Option<&'a PointTree>,
    pub(super) time: f32,
    pub(super) periods: [Option<f64>; 3],
    pub(super) listing: Listing<'a>,
    /// Whether lists are in the order of ids.
    pub(super) by_id: bool,
}

impl<'a> ListRequest<'a> {
    /// Validates what does not depend on the points.
    pub(super) fn check(&self) -> Result<(), ListError> {
        if !(0.0..=1.0).contains(&self.time) {
            return Err(ListError::Time);
        }
        check_sets(self.tree, self.others())?;
        check_periods(self.periods)?;
        self.listing.radii.check()
    }

    /// The set whose points are listed.
    pub(super) fn others(&self) -> &'a PointTree {
        self.among.unwrap_or(self.tree)
    }

    /// Whether positions are kept in f32.
    pub(super) fn in_single(&self) -> bool {
        !self.tree.is_double() && !self.others().is_double()
    }
}

/// An error if two trees do not keep their positions in the same way.
pub(super) fn check_sets(tree: &PointTree, among: &PointTree) -> Result<(), ListError> {
    let both = !tree.is_empty() && !among.is_empty();
    let [own, others] = [tree, among].map(PointTree::is_double);
    match () {
        _ if both && own != others => Err(ListError::Double),
        _ if both && !own && tree.origin() != among.origin() => Err(ListError::Origins),
        _ => Ok(()),
    }
}
