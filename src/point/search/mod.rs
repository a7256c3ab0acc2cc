//! The searches, each written once for every tree that has a view at a time.
//!
//! [`k_nearest`] traverses best-first by [`walk`], [`nearest`] does so in a loop of its own; [`radius`] needs no order
//! and uses masks alone. None of them allocates; results go to buffers of the caller.

pub(super) mod candidates;
pub(super) mod counted_search;
pub(super) mod k_nearest;
mod keys;
pub(super) mod layers;
mod leaf_queue;
pub(super) mod nearest;
pub(super) mod planes;
pub(super) mod radius;
pub(super) mod sinks;
pub(super) mod sort;
mod threshold;
pub(super) mod walk;

use crate::simd::{LANES, Lanes, Mask};

/// A caller's predicate on ids, or none at all: [`KeepAll`] or [`KeepIf`].
///
/// Predicates must be pure: they may be called for the same id more than once, or never.
pub trait Keep {
    /// False if every id passes and the predicate need not be called.
    const FILTERS: bool;
    /// Whether this id may be an answer.
    fn keep(&self, id: u32) -> bool;
    /// The mask without the lanes whose ids are rejected.
    #[doc(hidden)]
    #[inline(always)]
    fn kept(&self, ids: &[u32; LANES], mask: Mask) -> Mask {
        if !Self::FILTERS {
            return mask;
        }
        let (mut rest, mut out) = (mask, 0);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            out |= Mask::from(self.keep(ids[lane])) << lane;
            rest &= rest - 1;
        }
        out
    }
}

/// Keeps every id and costs nothing.
#[derive(Clone, Copy, Debug)]
pub struct KeepAll;

impl Keep for KeepAll {
    const FILTERS: bool = false;
    #[inline(always)]
    fn keep(&self, _: u32) -> bool {
        true
    }
}

/// Keeps the ids that a closure returns true for.
#[derive(Clone, Copy, Debug)]
pub struct KeepIf<F>(pub(super) F);

impl<F: Fn(u32) -> bool> Keep for KeepIf<F> {
    const FILTERS: bool = true;
    #[inline(always)]
    fn keep(&self, id: u32) -> bool {
        (self.0)(id)
    }
}

impl<K: Keep> Keep for &K {
    const FILTERS: bool = K::FILTERS;
    #[inline(always)]
    fn keep(&self, id: u32) -> bool {
        (**self).keep(id)
    }
    #[inline(always)]
    fn kept(&self, ids: &[u32; LANES], mask: Mask) -> Mask {
        (**self).kept(ids, mask)
    }
}

/// [`Keep::kept`] of a caller's predicate.
pub(super) type KeptLanes<'a> = &'a dyn Fn(&Lanes<u32>, Mask) -> Mask;

/// A caller's predicate behind one `dyn` call for each block with a point that is near enough: the searches need not be
/// compiled for it.
#[derive(Clone, Copy)]
pub(super) struct KeepLanes<'a>(pub KeptLanes<'a>);

impl Keep for KeepLanes<'_> {
    const FILTERS: bool = true;
    fn keep(&self, id: u32) -> bool {
        self.kept(&[id; LANES], 1) != 0
    }
    #[inline(always)]
    fn kept(&self, ids: &Lanes<u32>, mask: Mask) -> Mask {
        if mask == 0 { 0 } else { (self.0)(ids, mask) }
    }
}

/// Counted work of a query. The unit type counts nothing and compiles to nothing.
pub(super) trait Observe {
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
