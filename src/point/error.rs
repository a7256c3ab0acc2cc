//! Errors of building a point tree.

use crate::limits::{MAX_COORDINATE, MAX_KEYS, MAX_POINT_COORDINATE};
use core::fmt;

/// Why a point tree could not be built. Bad input never panics; it returns this error.
///
/// ```
/// use mbkd::{PointError, PointParams, PointTree};
/// let error = PointTree::build(&[[0.0f32, 0.0, 0.0], [1.0, f32::NAN, 0.0]], &PointParams::default()).unwrap_err();
/// assert_eq!(error, PointError::NonFinite { point: 1, key: 0 });
/// println!("{error}");
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PointError {
    /// A coordinate is NaN or infinite.
    NonFinite {
        /// The point.
        point: usize,
        /// The key.
        key: usize,
    },
    /// A coordinate is farther from zero (for f64 input, from [`PointTree::origin`](crate::PointTree::origin)) than
    /// [`MAX_POINT_COORDINATE`], or farther from zero than [`MAX_COORDINATE`].
    TooLarge {
        /// The point.
        point: usize,
        /// The key.
        key: usize,
    },
    /// Arrays that belong together differ in length.
    Length {
        /// Which array.
        name: &'static str,
        /// Length of the first array.
        expected: usize,
        /// Length of this array.
        found: usize,
    },
    /// There are points but no positions: no key was given.
    NoKeys,
    /// More keys than a tree can distinguish.
    TooManyKeys {
        /// How many there were.
        found: usize,
    },
    /// An id is `u32::MAX`, which stands for "no point".
    ReservedId {
        /// The point.
        point: usize,
    },
    /// More points than 32-bit ids can name.
    TooManyPoints {
        /// How many there were.
        found: usize,
    },
    /// The callback of [`PointTree::build_with_progress`](crate::PointTree::build_with_progress) returned `Break`.
    Cancelled,
    /// A parameter is outside its range.
    Parameter {
        /// The field of [`PointParams`](crate::PointParams).
        name: &'static str,
        /// Its valid range.
        expected: &'static str,
    },
}

impl fmt::Display for PointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PointError::NonFinite { point, key } => {
                write!(f, "point {point} has a coordinate that is not finite at key {key}; remove or correct it")
            }
            PointError::TooLarge { point, key } => {
                let (near, far) = (MAX_POINT_COORDINATE, MAX_COORDINATE as f32);
                write!(
                    f,
                    "point {point} is farther than {near:e} from the origin, or than {far:e} from zero, at key {key}; \
                     scale the set down"
                )
            }
            PointError::Length { name, expected, found } => {
                write!(f, "`{name}` has {found} elements where {expected} are needed, one for each point")
            }
            PointError::NoKeys => f.write_str("no key was given; give the positions for at least one time"),
            PointError::TooManyKeys { found } => {
                write!(f, "{found} keys are more than {MAX_KEYS}; split the shutter")
            }
            PointError::ReservedId { point } => {
                write!(f, "the id of point {point} is {}, which is reserved; use smaller ids", u32::MAX)
            }
            PointError::TooManyPoints { found } => {
                write!(f, "{found} points are more than the {} that one tree can hold; split the set", u32::MAX - 1)
            }
            PointError::Cancelled => f.write_str("the build was cancelled by its progress callback"),
            PointError::Parameter { name, expected } => write!(f, "`{name}` must be {expected}"),
        }
    }
}

impl core::error::Error for PointError {}
