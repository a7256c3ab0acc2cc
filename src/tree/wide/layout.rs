//! How nodes and leaf blocks lie in the arena. All begin on a cache line.
//!
//! | block | words |
//! |---|---|
//! | moving node | rows of 16: lower x y z, upper x y z, velocities of the same six, children |
//! | still node | rows of 16: lower x y z, upper x y z, children |
//! | time node | number of equal time ranges, then one child each |
//! | moving leaf of n | rows of n: corners (v0 x y z, v1 .., v2 ..) at the begin, the same at the end, ids; one word: segments of the motion |
//! | still leaf of n | rows of n: corners, ids |
//! | list leaf of n | n ids |

use crate::simd::LANES;

/// Rows of a node with moving boxes, and of one with still boxes; the last row holds the children.
pub(crate) const NODE_ROWS: usize = 13;
pub(crate) const STILL_NODE_ROWS: usize = 7;

/// Rows before the ids in a leaf block.
pub(crate) const CORNER_ROWS: usize = 9;

/// What a reference to a child points at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Nothing,
    Node,
    StillNode,
    Time,
    Leaf,
    StillLeaf,
    ListLeaf,
}

impl Kind {
    /// The shape of the leaf block, if it is one.
    pub fn leaf_shape(self) -> Option<LeafShape> {
        match self {
            Kind::Leaf => Some(LeafShape::Moving),
            Kind::StillLeaf => Some(LeafShape::Still),
            Kind::ListLeaf => Some(LeafShape::List),
            Kind::Nothing | Kind::Node | Kind::StillNode | Kind::Time => None,
        }
    }
}

/// A reference to a child: 25 bits of cache line, 4 bits of leaf length, 3 bits of kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ChildRef(pub u32);

/// Bits that number cache lines: an arena holds at most 2 GiB.
const LINE_BITS: u32 = 25;

impl ChildRef {
    pub const NOTHING: ChildRef = ChildRef(0);

    /// A reference to a block at word `at`, which must begin a line; nothing where that is beyond what 25
    /// bits can number.
    pub fn new(kind: Kind, at: usize, len: usize) -> Option<ChildRef> {
        debug_assert!(at.is_multiple_of(LANES) && (1..=LANES).contains(&len));
        let line = u32::try_from(at / LANES).ok().filter(|&l| l < 1 << LINE_BITS)?;
        Some(ChildRef(line << 7 | (len as u32 - 1) << 3 | kind as u32))
    }

    /// The same block after it was moved by so many words (whole lines); nothing where that is beyond what can be
    /// numbered.
    pub fn moved(self, by: usize) -> Option<ChildRef> {
        let line = u32::try_from(by / LANES).ok()?.checked_add(self.0 >> 7).filter(|&l| l < 1 << LINE_BITS)?;
        Some(ChildRef(line << 7 | self.0 & 127))
    }

    /// The first word of the block.
    #[inline(always)]
    pub fn at(self) -> usize {
        (self.0 >> 7) as usize * LANES
    }

    /// Number of primitives of a leaf block.
    #[inline(always)]
    pub fn len(self) -> usize {
        (self.0 >> 3 & 15) as usize + 1
    }

    #[inline(always)]
    pub fn kind(self) -> Kind {
        match self.0 & 7 {
            1 => Kind::Node,
            2 => Kind::StillNode,
            3 => Kind::Time,
            4 => Kind::Leaf,
            5 => Kind::StillLeaf,
            6 => Kind::ListLeaf,
            _ => Kind::Nothing,
        }
    }
}

/// How the primitives of a leaf block are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LeafShape {
    /// Corners of moving triangles at both ends of a segment.
    Moving,
    /// Corners of triangles that stand still.
    Still,
    /// Ids alone.
    List,
}

impl LeafShape {
    /// The kind of a reference to such a leaf.
    pub fn kind(self) -> Kind {
        match self {
            LeafShape::Moving => Kind::Leaf,
            LeafShape::Still => Kind::StillLeaf,
            LeafShape::List => Kind::ListLeaf,
        }
    }

    /// Word of the ids of a leaf of `len`, counted from its begin.
    #[inline(always)]
    pub fn ids(self, len: usize) -> usize {
        match self {
            LeafShape::Moving => 2 * CORNER_ROWS * len,
            LeafShape::Still => CORNER_ROWS * len,
            LeafShape::List => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_keep_what_they_are_given_and_refuse_what_does_not_fit() {
        for kind in [Kind::Node, Kind::StillNode, Kind::Time, Kind::Leaf, Kind::StillLeaf, Kind::ListLeaf] {
            for (at, len) in [(0, 1), (16, 16), (((1 << 25) - 1) * 16, 7)] {
                let r = ChildRef::new(kind, at, len).unwrap();
                assert_eq!((r.kind(), r.at(), r.len()), (kind, at, len));
            }
        }
        assert_eq!(ChildRef::new(Kind::Leaf, (1 << 25) * 16, 1), None);
        assert_eq!(ChildRef::NOTHING.kind(), Kind::Nothing);
    }
}
