//! What callers choose about the build of a point tree: its structure, and the numbers that positions are kept in.

use super::error::PointError;
use crate::limits::MAX_POINT_TIME_SLICES;
use crate::simd::SimdLevel;

/// The structure of the tree for moving points. Answers do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[non_exhaustive]
pub enum PointStructure {
    /// The structure of least cost. The cost is estimated by small builds and by counting the work of queries.
    #[default]
    Automatic,
    /// Linear boxes over the whole shutter, without splits: best for coherent or small motion.
    Linear,
    /// Linear boxes in this many trees (1 to 1024), one per time slice: best for long incoherent motion. With more than two
    /// keys each segment between keys has so many, at most 16384 in all (or one for each segment).
    TimeSlices(usize),
    /// The k-d tree of the paper. A point that crosses a plane is stored on both sides, on each with the time it spends there. An
    /// error for positions kept in f64.
    Kd,
}

impl PointStructure {
    /// The number of time slices that is asked for; `None` if the choice is automatic, or there are none.
    pub(super) fn requested_slices(self) -> Option<usize> {
        match self {
            PointStructure::Automatic | PointStructure::Kd => None,
            PointStructure::Linear => Some(1),
            PointStructure::TimeSlices(slices) => Some(slices),
        }
    }
}

/// The numbers that a tree keeps positions in.
///
/// ```
/// use mbkd::{NeighborLists, PointParams, PointTree, Precision};
/// let in_f64 = PointParams { precision: Precision::Double, ..PointParams::default() };
/// // All of the wall's coordinates are f32 numbers, those of the fluid are not.
/// let wall = PointTree::build(&[[-1.0f64, 0.0, 0.0], [1.0, 0.0, 0.0]], &in_f64)?;
/// let fluid = PointTree::build(&[[0.1f64, 0.0, 0.0], [1.1, 0.0, 0.0]], &in_f64)?;
/// let mut lists = NeighborLists::new();
/// fluid.neighbor_lists(0.0, 0.5).among(&wall).in_order().run(&mut lists)?;
/// assert_eq!((lists.offsets(), lists.ids()), (&[0, 0, 1][..], &[1][..]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Precision {
    /// f32 positions in f32. f64 positions in f64, unless all coordinates are f32 numbers and lie on both sides of zero, or at it,
    /// along each axis: then in f32, and query points are rounded to f32 too. So one more point may change how the others are
    /// searched; ask for one of the others if that matters.
    #[default]
    Automatic,
    /// f32. Positions given in f64 are rounded relative to the middle of the set, by up to 2^-25 of its size, unless they are f32
    /// numbers as above.
    Single,
    /// f64, whatever they are given in: differences and squared distances are computed in f64, and the latter rounded to f32 in the
    /// end. Takes about twice the memory and 1 to 1.9 times the time.
    Double,
}

/// The parameters of the build of a point tree.
///
/// ```
/// use mbkd::{PointParams, PointStructure};
/// let params = PointParams { structure: PointStructure::TimeSlices(4), ..PointParams::default() };
/// # let _ = params;
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PointParams {
    /// The structure for moving points. Default: automatic. If all points of a set are static, it always has the static
    /// structure.
    pub structure: PointStructure,
    /// The greatest number of references per point for each segment between two keys, in the k-d tree and over time slices; from 1
    /// to 1024, default 8. Points with n keys may so have n - 1 times as many, since each segment has a tree of its own. A
    /// reference takes 32 to 48 bytes. Time slices that are requested explicitly are not limited.
    pub max_references: f32,
    /// The numbers that positions are kept in. Default: those that they need.
    /// [`PointTree::precision`](crate::PointTree::precision) tells which a tree has.
    pub precision: Precision,
    /// The instruction set of queries. Answers do not depend on it. Default: the widest of this CPU.
    pub simd: SimdLevel,
}

impl Default for PointParams {
    fn default() -> Self {
        PointParams {
            structure: PointStructure::Automatic,
            max_references: 8.0,
            precision: Precision::Automatic,
            simd: SimdLevel::best(),
        }
    }
}

impl PointParams {
    /// Checks that every field is in its range.
    ///
    /// ```
    /// use mbkd::{PointError, PointParams};
    /// let wrong = PointParams { max_references: 0.5, ..PointParams::default() };
    /// assert!(matches!(wrong.validate(), Err(PointError::Parameter { name: "max_references", .. })));
    /// ```
    ///
    /// # Errors
    /// [`PointError::Parameter`] with the name of the first field that is not.
    pub fn validate(&self) -> Result<(), PointError> {
        if !(self.max_references >= 1.0 && self.max_references <= 1024.0) {
            return Err(PointError::Parameter { name: "max_references", expected: "from 1 to 1024" });
        }
        match self.structure {
            PointStructure::TimeSlices(n) if n == 0 || n > MAX_POINT_TIME_SLICES => {
                Err(PointError::Parameter { name: "structure", expected: "1 to 1024 time slices, if it is TimeSlices" })
            }
            _ => Ok(()),
        }
    }
}
