//! Errors of photon maps and of gathers.

use crate::limits::MAX_POINT_COORDINATE;
use core::fmt;

/// Why a photon map could not be built, or a gather not be answered.
///
/// ```
/// use mbkd::glam::Vec3;
/// use mbkd::point::{GatherError, GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
/// let photons = [Photon::at_time(Vec3::ZERO, Vec3::Z, 1.0f32, 0.5)];
/// let map = PhotonMap::build(&photons, &GatherParams::default())?;
/// let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).radius(0.1).window(-0.2);
/// assert_eq!(map.gather(&query, &mut NeighborBuffer::new()).unwrap_err(), GatherError::Window);
/// # Ok::<(), GatherError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GatherError {
    /// The flux of a photon is not finite.
    Flux,
    /// The normal of a photon is not finite.
    PhotonNormal,
    /// There are too many photons or visible points for ids of 32 bits.
    TooMany {
        /// How many.
        found: usize,
    },
    /// A build parameter is out of its range.
    Parameter {
        /// The field of [`GatherParams`](crate::point::GatherParams).
        name: &'static str,
        /// Its valid range.
        expected: &'static str,
    },
    /// A position is not finite or too large: of a query, of a visible point, or of a photon, and of one that moves also where it
    /// is when the shutter opens and closes.
    Position,
    /// The normal of a query is used and is not a unit vector.
    Normal,
    /// The time of a query, of a visible point or of a photon is outside the shutter.
    Time,
    /// The window of a query is not greater than 0, or so short (some 10^-38 of the shutter) that photons in it have no finite
    /// weight, whether the photons that were found are weighted by it or not.
    Window,
    /// The window of a query is wider than the map was built for, and some photons move with their surface.
    WindowTooWide {
        /// [`GatherParams::window`](crate::point::GatherParams::window).
        most: f32,
    },
    /// A radius is negative, NaN or too large.
    Radius,
    /// A query for 0 photons.
    NoNeighbors,
    /// A query has neither a number of photons nor a finite radius.
    Unbounded,
    /// The cosine or the thickness of a query is NaN, or the thickness is negative.
    Cutoff,
    /// The photons of a query lie in a disc without area or a ball without volume: the k nearest ones all at the query point, or
    /// those within a radius of less than some 1e-19 (in a volume 1e-13).
    NoArea,
    /// The speed of a space-time metric is negative, not finite or too large.
    Speed,
    /// A space-time query of a map with photons that have no time stamp of their own.
    NotStamped,
    /// The build was cancelled by its `progress` ([`PhotonMap::build_with_progress`](crate::PhotonMap::build_with_progress)).
    Cancelled,
    /// Arrays that belong together differ in length.
    Length {
        /// Length of the first.
        expected: usize,
        /// Length of the other.
        found: usize,
    },
    /// An element of a slice is wrong: a visible point, a radius, a photon, or a query of a batch.
    At {
        /// Its index.
        index: usize,
        /// What is wrong with it.
        error: Box<GatherError>,
    },
}

impl GatherError {
    /// The error of an element of a slice.
    pub(super) fn at(self, index: usize) -> GatherError {
        GatherError::At { index, error: Box::new(self) }
    }
}

impl fmt::Display for GatherError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GatherError::Flux => f.write_str("the flux of a photon is not finite; remove it"),
            GatherError::PhotonNormal => f.write_str("the normal of a photon is not finite; remove it"),
            GatherError::TooMany { found } => write!(f, "{found} photons or points are too many for ids of 32 bits"),
            GatherError::Parameter { name, expected } => write!(f, "`{name}` must be {expected}"),
            GatherError::Position => {
                write!(f, "a position must be finite and at most {MAX_POINT_COORDINATE:e}")
            }
            GatherError::Normal => f.write_str("a query with a cutoff on normals or a thickness needs a unit normal"),
            GatherError::Time => f.write_str("a time must be in [0, 1], the shutter"),
            GatherError::Window => {
                f.write_str("the window of a query must be greater than 0, and not below some 1e-38")
            }
            GatherError::WindowTooWide { most } => {
                write!(
                    f,
                    "the window of a query is wider than {most}, for which the map was built: photons that are carried along \
                     have a widest window; build the map with a greater `GatherParams::window`"
                )
            }
            GatherError::Radius => {
                write!(
                    f,
                    "a radius must be at least 0 and at most {MAX_POINT_COORDINATE:e}; only that of a gather may be infinite"
                )
            }
            GatherError::NoNeighbors => f.write_str("a query for 0 photons has no density; ask for at least 1"),
            GatherError::Unbounded => f.write_str("give a query a number of photons, a radius or both"),
            GatherError::Cutoff => f.write_str("a cosine must not be NaN, and a thickness must be at least 0"),
            GatherError::NoArea => {
                f.write_str("the photons lie in a disc without area, or a ball without volume; give a larger radius")
            }
            GatherError::Speed => write!(f, "a speed must be from 0 to {MAX_POINT_COORDINATE:e}"),
            GatherError::NotStamped => f.write_str("space-time neighbours need photons with a time stamp only"),
            GatherError::Cancelled => f.write_str("the build was cancelled by its progress callback"),
            GatherError::Length { expected, found } => {
                write!(f, "{found} elements where {expected} are needed, one for each visible point")
            }
            GatherError::At { index, error } => write!(f, "element {index}: {error}"),
        }
    }
}

impl core::error::Error for GatherError {}
