//! The faces of up to sixteen boxes at a time: those of a node, or those behind a list of shapes.

use super::NodeBlock;
use crate::layout::NODE_ROWS;
use crate::simd::{LANES, Rows, Simd, lanes_at};

/// Rows of boxes. Rows 2a and 2a + 1 are the lower and the upper faces along axis a; if there are [`NODE_ROWS`] in a node, the
/// velocities of all faces follow six rows later.
///
/// Rows are named by their first word in a node: of numbers, a ray would have to compute the words once more for each node.
pub(crate) trait Faces {
    /// The row that begins at this word of a node.
    fn row<S: Simd>(&self, s: S, word: usize) -> S::F;

    /// One face of each box at a time.
    #[inline(always)]
    fn face<S: Simd, const ROWS: usize>(&self, s: S, word: usize, time: S::F) -> S::F {
        let at = self.row(s, word);
        if ROWS == NODE_ROWS { s.mul_add(self.row(s, word + 6 * LANES), time, at) } else { at }
    }
}

impl Faces for NodeBlock {
    #[inline(always)]
    fn row<S: Simd>(&self, s: S, word: usize) -> S::F {
        s.load(lanes_at(self, word))
    }
}

/// Without a row of children, and only as wide as there are boxes; the other lanes are zero.
impl Faces for Rows<'_> {
    #[inline(always)]
    fn row<S: Simd>(&self, s: S, word: usize) -> S::F {
        s.load_row(self, word / LANES)
    }
}
