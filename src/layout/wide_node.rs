//! The format of nodes and leaf blocks in the arena. All begin on a cache line.
//!
//! | block | words |
//! |---|---|
//! | moving node | rows of 16: lower x, upper x, lower y .. upper z, velocities of the same six, children |
//! | static node | rows of 16: lower x, upper x, lower y .. upper z, children |
//! | time node | number of equal time ranges, then one child each |
//! | moving leaf of n | rows of n: corners (v0 x y z, v1 .., v2 ..) at the beginning, the same at the end; sizes; n ids |
//! | static leaf of n | rows of n: corners; sizes; n ids |
//! | moving leaf of v shared vertices | rows of v: x y z at the beginning, the same at the end; rows of n: corners, ids |
//! | static leaf of v shared vertices | rows of v: x y z; rows of n: corners, ids |
//! | other leaf, of triangles | with more than two keys: see [`crate::layout::leaf::keyed`] |
//! | other leaf of n, of other primitives | n ids; positions of spheres: see [`crate::layout::leaf::spheres`] |
//!
//! In blocks with shared vertices, a word of the row of corners holds the numbers of the three vertices of a triangle
//! in its lowest bits, four each; the next four bits of the first word are n - 1, and its upper half holds the sizes.
//! In other blocks of triangles the sizes are a word of their own before the ids.
//!
//! Sizes are the exponents of two powers of two: no coordinate of a vertex is larger than the first, and no triangle is
//! larger than the second along an axis.

use crate::simd::{Arena, LANES};
use glam::{Vec3, Vec3A};

/// Rows of a node with moving boxes, and of a static one; the last row holds the children.
pub(crate) const NODE_ROWS: usize = 13;
pub(crate) const STATIC_NODE_ROWS: usize = 7;

/// Rows before the ids in a leaf block.
pub(crate) const CORNER_ROWS: usize = 9;

/// Rows of one key's positions in a leaf block with shared vertices.
pub(crate) const VERTEX_ROWS: usize = 3;

/// The kind of a block that a child reference points to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Sixteen children in moving boxes.
    Node,
    /// Sixteen children in static boxes.
    StaticNode,
    /// One child per time slice.
    Time,
    /// Corners of triangles that move linearly.
    Leaf,
    /// Corners of static triangles.
    StaticLeaf,
    /// Vertices that move linearly, and triangles between them.
    SharedLeaf,
    /// Static vertices, and triangles between them.
    SharedStaticLeaf,
    /// Any other leaf: triangles with more than two keys, or a list of ids. [`WideTree::lists`](super::wide_tree::WideTree::lists)
    /// tells which.
    OtherLeaf,
}

impl Kind {
    pub fn is_leaf(self) -> bool {
        !matches!(self, Kind::Node | Kind::StaticNode | Kind::Time)
    }

    /// Whether it is a node with boxes around its children.
    pub fn has_boxes(self) -> bool {
        matches!(self, Kind::Node | Kind::StaticNode)
    }

    /// Rows of coordinates at the begin of a leaf block of at most two keys; 0 for everything else.
    pub fn leaf_rows(self) -> usize {
        match self {
            Kind::Leaf => 2 * CORNER_ROWS,
            Kind::StaticLeaf => CORNER_ROWS,
            Kind::SharedLeaf => 2 * VERTEX_ROWS,
            Kind::SharedStaticLeaf => VERTEX_ROWS,
            Kind::Node | Kind::StaticNode | Kind::Time | Kind::OtherLeaf => 0,
        }
    }
}

/// Rows of a node; a time node counts as one.
pub(crate) fn node_rows(kind: Kind) -> usize {
    match kind {
        Kind::Node => NODE_ROWS,
        Kind::StaticNode => STATIC_NODE_ROWS,
        _ => 1,
    }
}

/// Number of triangles, from the first word of the corners of a block with shared vertices.
#[inline(always)]
pub(crate) fn shared_count(first_corners: u32) -> usize {
    (first_corners >> 12 & 15) as usize + 1
}

/// Accumulates the sizes of a block over its triangles.
#[derive(Default)]
pub(crate) struct Sizes {
    size: Vec3A,
    extent: Vec3A,
}

impl Sizes {
    #[inline(always)]
    pub fn include(&mut self, a: Vec3, b: Vec3, c: Vec3) {
        let (a, b, c) = (Vec3A::from(a), Vec3A::from(b), Vec3A::from(c));
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        self.size = self.size.max(low.abs()).max(high.abs());
        self.extent = self.extent.max(high - low);
    }

    /// Both sizes in the upper half of a word.
    pub fn word(self) -> u32 {
        Sizes::word_of(self.size.max_element(), self.extent.max_element())
    }

    /// The largest coordinate and the largest extent in the upper half of a word.
    pub fn word_of(size: f32, extent: f32) -> u32 {
        // The next power of two, which is above the rounding of the difference as well.
        let exponent = |x: f32| (x.to_bits() >> 23) + 1;
        exponent(size) << 24 | exponent(extent) << 16
    }
}

/// Upper bounds on the largest coordinate of the vertices, and on the largest extent of a triangle along an axis.
#[inline(always)]
pub(crate) fn block_sizes(word: u32) -> (f32, f32) {
    (f32::from_bits(word >> 24 << 23), f32::from_bits((word >> 16 & 255) << 23))
}

/// The reciprocal of the extent in a word, which is a power of two: at most 2^103, and 2^126 if the extent is 0.
#[inline(always)]
pub(crate) fn inverse_extent(word: u32) -> f32 {
    f32::from_bits(254u32.saturating_sub(word >> 16 & 255) << 23)
}

/// A reference to a child: 25 bits of cache line, 4 bits of leaf length, 3 bits of kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ChildRef(pub u32);

/// Bits of the index of a cache line: an arena holds at most 2 GiB.
const LINE_BITS: u32 = 25;
pub(crate) const MOST_ARENA_BYTES: usize = (4 * LANES) << LINE_BITS;

impl ChildRef {
    /// No child; never visited.
    pub const NOTHING: ChildRef = ChildRef(u32::MAX);

    /// A reference to a block at word `at`, which must be the beginning of a line; `None` if the line index needs more
    /// than 25 bits.
    pub fn new(kind: Kind, at: usize, len: usize) -> Option<ChildRef> {
        debug_assert!(at.is_multiple_of(LANES) && (1..=LANES).contains(&len));
        let line = u32::try_from(at / LANES).ok().filter(|&l| l < (1 << LINE_BITS) - 1)?;
        Some(ChildRef(line << 7 | (len as u32 - 1) << 3 | kind as u32))
    }

    /// The same block after it was moved by so many words (whole lines); `None` if the line index needs too many bits.
    pub fn moved(self, by: usize) -> Option<ChildRef> {
        let line = u32::try_from(by / LANES).ok()?.checked_add(self.0 >> 7).filter(|&l| l < (1 << LINE_BITS) - 1)?;
        Some(ChildRef(line << 7 | self.0 & 127))
    }

    /// The first word of the block.
    #[inline(always)]
    pub fn at(self) -> usize {
        (self.0 >> 7) as usize * LANES
    }

    /// Number of primitives of a leaf block, or of vertices of one with shared vertices.
    #[inline(always)]
    pub fn len(self) -> usize {
        (self.0 >> 3 & 15) as usize + 1
    }

    /// Number of cache lines of the block, except those of ids, which are rarely read.
    #[inline(always)]
    pub fn lines(self) -> usize {
        let rows = match self.kind() {
            Kind::Node => return NODE_ROWS,
            Kind::StaticNode => return STATIC_NODE_ROWS,
            Kind::Time => return 1,
            Kind::Leaf | Kind::OtherLeaf => 2 * CORNER_ROWS,
            Kind::StaticLeaf => CORNER_ROWS,
            Kind::SharedLeaf => 2 * VERTEX_ROWS + 1,
            Kind::SharedStaticLeaf => VERTEX_ROWS + 1,
        };
        (rows * self.len() + 1).div_ceil(LANES)
    }

    #[inline(always)]
    pub fn kind(self) -> Kind {
        match self.0 & 7 {
            0 => Kind::Node,
            1 => Kind::StaticNode,
            2 => Kind::Time,
            3 => Kind::Leaf,
            4 => Kind::StaticLeaf,
            5 => Kind::SharedLeaf,
            6 => Kind::SharedStaticLeaf,
            _ => Kind::OtherLeaf,
        }
    }
}

/// The row of a node's children.
pub(crate) fn children_mut(arena: &mut Arena, node: ChildRef) -> &mut [u32] {
    let row = node.at() + (node_rows(node.kind()) - 1) * LANES;
    &mut arena.ints_mut()[row..row + LANES]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_round_trip_and_reject_lines_out_of_range() {
        use Kind::*;
        for kind in [Node, StaticNode, Time, Leaf, StaticLeaf, SharedLeaf, SharedStaticLeaf, OtherLeaf] {
            for (at, len) in [(0, 1), (16, 16), (((1 << 25) - 2) * 16, 7)] {
                let r = ChildRef::new(kind, at, len).unwrap();
                assert_eq!((r.kind(), r.at(), r.len()), (kind, at, len));
                assert_ne!(r, ChildRef::NOTHING);
            }
        }
        assert_eq!(ChildRef::new(Leaf, ((1 << 25) - 1) * 16, 1), None);
    }
}
