//! The faces of up to sixteen boxes at a time: those of a node, or those behind a list of shapes.

use super::NodeBlock;
use crate::layout::NODE_ROWS;
use crate::simd::{LANES, Rows, Simd, lanes_at};

/// Rows of boxes. Rows 2a and 2a + 1 are the lower and the upper faces along axis a; if there are [`NODE_ROWS`] in a node, the velocities of
/// all faces follow six rows later.
pub(crate) trait Faces {
    /// One row.
    fn row<S: Simd>(&self, s: S, row: usize) -> S::F;

    /// One face of each box at a time.
    #[inline(always)]
    fn face<S: Simd, const ROWS: usize>(&self, s: S, row: usize, time: S::F) -> S::F {
        let at = self.row(s, row);
        if ROWS == NODE_ROWS { s.mul_add(self.row(s, row + 6), time, at) } else { at }
    }
}

impl Faces for NodeBlock {
    #[inline(always)]
    fn row<S: Simd>(&self, s: S, row: usize) -> S::F {
        s.load(lanes_at(self, row * LANES))
    }
}

/// Without a row of children, and only as wide as there are boxes; the other lanes are zero.
impl Faces for Rows<'_> {
    #[inline(always)]
    fn row<S: Simd>(&self, s: S, row: usize) -> S::F {
        s.load_row(self, row)
    }
}
