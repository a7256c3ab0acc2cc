//! Errors of requests for neighbour lists.

use crate::point::queries::periodic::PeriodError;
use core::fmt;

/// Whose radius an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadiusOf {
    /// A point that a list is made for, by its id: a radius of `own` in [`Radii`](crate::Radii).
    Point(u32),
    /// A point that may be listed, by its id: a radius of `others` in [`Radii`](crate::Radii).
    Listed(u32),
    /// A query of [`PointTree::within_lists`](crate::PointTree::within_lists), by its index.
    Query(u32),
}

impl fmt::Display for RadiusOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RadiusOf::Point(id) => write!(f, "point {id}"),
            RadiusOf::Listed(id) => write!(f, "listed point {id}"),
            RadiusOf::Query(query) => write!(f, "query {query}"),
        }
    }
}

/// Why neighbour lists could not be made. Nothing here panics on bad input: it returns this.
///
/// ```
/// use mbkd::{ListError, NeighborLists, PointParams, PointTree};
/// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default())?;
/// let error = tree.neighbor_lists(0.0, -1.0).run(&mut NeighborLists::new()).unwrap_err();
/// assert_eq!(error, ListError::Radius { of: None });
/// println!("{error}");
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ListError {
    /// A radius is negative or NaN.
    Radius {
        /// Whose radius it is; none where all have the same.
        of: Option<RadiusOf>,
    },
    /// The skin is negative or NaN: lists do not hold what is farther apart than their radius.
    Skin,
    /// The radii within which lists shall hold every pair are not of the same kind as those of the lists.
    RadiiDiffer,
    /// There are fewer radii than ids of the points that exist at the time or during the interval, or than queries.
    MissingRadius {
        /// The first that has none.
        of: RadiusOf,
    },
    /// The time is outside the shutter [0, 1] or NaN.
    Time,
    /// The time until which lists with a skin shall hold is outside the shutter or NaN, or before the time that they are made for.
    Until,
    /// A period is not above zero, or not finite, or not a normal number of f32 (about 1.2e-38 to 3.4e38).
    Period {
        /// The axis.
        axis: usize,
    },
    /// A coordinate is more than a million periods from zero (of points in f64, from the tree's origin), where f32 does not resolve
    /// positions in a period. The faces of the tree's boxes around moving points count too: they may reach up to three times as far
    /// as the points, and of points in f64 farther by 1e-22 and 2^-49 of the greatest coordinate along any axis. For lists over an
    /// interval, or until when lists hold, also one that is more than 2^48 periods from zero itself: there not even f64 resolves
    /// them.
    FarFromPeriod {
        /// The axis.
        axis: usize,
    },
    /// For lists over an interval, or until when lists hold: the box around all points over the shutter is longer than sixteen
    /// periods. Move points by whole periods into one box, with all their keys.
    Extent {
        /// The axis.
        axis: usize,
    },
    /// A query is not finite or its coordinates are too large.
    Query {
        /// Its index.
        query: usize,
    },
    /// There are more queries than ids.
    TooManyQueries,
    /// A point or a query has more neighbours than [`ListQuery::max_neighbors`](crate::ListQuery::max_neighbors) allows.
    TooManyNeighbors {
        /// The lowest id of such a point, or index of such a query.
        id: u32,
    },
    /// The two trees keep positions in f32 relative to different origins, as trees do of f64 positions that are rounded.
    Origins,
    /// One of the two trees keeps its positions in f64 and the other in f32.
    Double,
    /// Lists were requested in the order of ids, but among the points that exist at the time or during the interval, one has an id
    /// that is not less than the number of all points, or two have the same id.
    Ids {
        /// Such an id.
        id: u32,
    },
}

impl fmt::Display for ListError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ListError::Radius { of: Some(of) } => write!(f, "the radius of {of} is negative or NaN"),
            ListError::Radius { of: None } => f.write_str("the radius is negative or NaN"),
            ListError::Skin => f.write_str(
                "the skin is negative or NaN: lists must be made with at least the radii within which they shall hold",
            ),
            ListError::RadiiDiffer => f.write_str("lists and what they shall hold need radii of the same kind: equal, own, larger or sum"),
            ListError::MissingRadius { of: of @ RadiusOf::Query(_) } => {
                write!(f, "there is no radius for {of}; give one for each query")
            }
            ListError::MissingRadius { of } => write!(f, "there is no radius for {of}; give one for each id"),
            ListError::Time => f.write_str("the time is not in [0, 1]: the first key is at 0, the last at 1"),
            ListError::Until => {
                f.write_str("the time until which lists shall hold must be at most 1, and not before the time that they are made for")
            }
            ListError::Period { axis } => write!(f, "the period of axis {axis} must be above zero, and neither denormal nor infinite in f32"),
            ListError::FarFromPeriod { axis } => {
                write!(f, "points are more than a million periods from zero along axis {axis}; move them into the box")
            }
            ListError::Extent { axis } => PeriodError::Extent { axis: *axis }.fmt(f),
            ListError::Query { query } => write!(f, "query {query} is not finite or its coordinates are too large"),
            ListError::TooManyQueries => {
                f.write_str("there are more queries than ids; divide them into several requests")
            }
            ListError::TooManyNeighbors { id } => write!(f, "point {id} has more neighbours than `max_neighbors` allows: raise it, or take a smaller radius"),
            ListError::Origins => f.write_str(
                "the two trees have positions in f32 relative to different origins; build both with `Precision::Double`, or from f32 positions",
            ),
            ListError::Double => f.write_str(
                "one of the two trees keeps positions in f64 and the other in f32; choose the same precision where they are built",
            ),
            ListError::Ids { id } => {
                write!(f, "id {id} is not the index of a point; ask for the lists in the order of the tree")
            }
        }
    }
}

impl core::error::Error for ListError {}
