//! Predicates on ids: which points may be answers.

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
pub struct KeepIf<F>(pub(in crate::point) F);

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
pub(in crate::point) type KeptLanes<'a> = &'a dyn Fn(&Lanes<u32>, Mask) -> Mask;

/// A caller's predicate behind one `dyn` call for each block with a point that is near enough: the searches need not be
/// compiled for it.
#[derive(Clone, Copy)]
pub(in crate::point) struct KeepLanes<'a>(pub(in crate::point) KeptLanes<'a>);

impl KeepLanes<'static> {
    /// Accepts everything.
    pub(in crate::point) const ALL: KeepLanes<'static> = KeepLanes(&|_, mask| mask);
}

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

/// A caller's predicate, if there is one: for searches that are compiled once for both.
#[derive(Clone, Copy)]
pub(in crate::point) struct Allowed<'a>(pub(in crate::point) Option<KeptLanes<'a>>);

impl Keep for Allowed<'_> {
    const FILTERS: bool = true;
    fn keep(&self, id: u32) -> bool {
        self.kept(&[id; LANES], 1) != 0
    }
    #[inline(always)]
    fn kept(&self, ids: &Lanes<u32>, mask: Mask) -> Mask {
        match self.0 {
            Some(kept) if mask != 0 => kept(ids, mask),
            _ => mask,
        }
    }
}
