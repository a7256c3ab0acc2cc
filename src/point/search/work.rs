//! The work of a query, where it is counted.

/// Counted work of a query. The unit type counts nothing and compiles to nothing.
pub(in crate::point) trait Observe {
    /// A node's sixteen boxes were tested.
    #[inline(always)]
    fn node(&mut self) {}
    /// A block's sixteen points were tested.
    #[inline(always)]
    fn block(&mut self) {}
}

impl Observe for () {}

/// Work of a query in nodes and blocks.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct NeighborWork {
    /// Nodes visited: sixteen boxes each, or one plane in a k-d tree.
    pub nodes: u64,
    /// Blocks tested: sixteen points each.
    pub blocks: u64,
}

impl Observe for NeighborWork {
    #[inline(always)]
    fn node(&mut self) {
        self.nodes += 1;
    }
    #[inline(always)]
    fn block(&mut self) {
        self.blocks += 1;
    }
}
