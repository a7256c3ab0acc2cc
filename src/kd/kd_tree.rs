//! The paper's layout: an ordinary k-d tree whose leaves hold primitives with time intervals.
//!
//! Two flat arrays: nodes of 12 bytes in depth-first order (the left child of a node is the next one), and
//! leaf references of 12 bytes. A split plane may move; at any one time it is an ordinary plane.

use crate::file::record_fields;
use crate::geometry::{Box3, Plane, TimeInterval};
use crate::limits::MAX_NODES;

/// An inner node or a leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub(crate) struct KdNode {
    /// Inner: the plane's position (f32 bits). Leaf: its first reference.
    a: u32,
    /// Inner: the plane's velocity (f32 bits). Leaf: its number of references.
    b: u32,
    /// The low two bits are the axis, 3 for a leaf; above them, in an inner node, the right child.
    link: u32,
}

record_fields!(KdNode { a: u32, b: u32, link: u32 });

/// A node, decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum KdView {
    Inner { plane: Plane, right: u32 },
    Leaf { first: u32, count: u32 },
}

impl KdNode {
    pub fn inner(plane: Plane, right: u32) -> KdNode {
        debug_assert!((right as usize) < MAX_NODES && plane.axis < 3);
        KdNode { a: plane.position.to_bits(), b: plane.velocity.to_bits(), link: right << 2 | plane.axis as u32 }
    }

    pub fn leaf(first: u32, count: u32) -> KdNode {
        KdNode { a: first, b: count, link: 3 }
    }

    /// The node of a subtree that was appended to another one.
    pub fn shifted(self, nodes: u32, references: u32) -> KdNode {
        match self.view() {
            KdView::Leaf { first, count } => KdNode::leaf(first.wrapping_add(references), count),
            KdView::Inner { .. } => KdNode { link: self.link.wrapping_add(nodes << 2), ..self },
        }
    }

    #[inline(always)]
    pub fn view(self) -> KdView {
        let axis = (self.link & 3) as usize;
        if axis == 3 {
            KdView::Leaf { first: self.a, count: self.b }
        } else {
            let plane = Plane { axis, position: f32::from_bits(self.a), velocity: f32::from_bits(self.b) };
            KdView::Inner { plane, right: self.link >> 2 }
        }
    }
}

/// A primitive in a leaf and its active interval there: `begin <= t < end`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct KdReference {
    pub id: u32,
    pub begin: f32,
    /// Beyond 1 if the reference is active until the end of the shutter.
    pub end: f32,
}

record_fields!(KdReference { id: u32, begin: f32, end: f32 });

impl KdReference {
    pub fn new(id: u32, interval: TimeInterval) -> KdReference {
        KdReference { id, begin: interval.begin(), end: interval.end_bound() }
    }

    #[inline(always)]
    pub fn is_active_at(&self, t: f32) -> bool {
        self.begin <= t && t < self.end
    }
}

/// The finished tree. It contains only the ids of primitives.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct KdTree {
    /// The bounds of all primitives at all times.
    pub root: Box3,
    pub nodes: Vec<KdNode>,
    pub references: Vec<KdReference>,
    pub depth: u32,
}

impl KdTree {
    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * size_of::<KdReference>()
    }
}
