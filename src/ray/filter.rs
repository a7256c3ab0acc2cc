//! Filters: which primitives and hits a query takes into account.

use super::Hit;

/// A hit with the index of its ray in the task of a batch, which is 0 for a single ray.
pub(crate) type Offer = (usize, Hit);

/// Selects the primitives that a query tests and the hits that it accepts; both predicates must be pure.
pub(crate) trait Filter<T = Offer> {
    /// Primitives take part whose visibility masks share a bit with this one; all of them if there is none.
    fn mask(&self) -> Option<u32>;
    /// Whether a primitive with this visibility mask takes part; the mask is looked up only if the filter depends on
    /// it.
    #[inline(always)]
    fn sees(&self, mask: impl FnOnce() -> u32) -> bool {
        self.mask().is_none_or(|wanted| wanted & mask() != 0)
    }
    /// Whether a hit is accepted.
    fn accepts(&self, hit: impl FnOnce() -> T) -> bool;
    /// Whether all hits are accepted.
    fn accepts_all(&self) -> bool;
}

/// No filter: compiles to nothing.
pub(crate) struct Everything;

impl<T> Filter<T> for Everything {
    #[inline(always)]
    fn mask(&self) -> Option<u32> {
        None
    }
    #[inline(always)]
    fn accepts(&self, _: impl FnOnce() -> T) -> bool {
        true
    }
    #[inline(always)]
    fn accepts_all(&self) -> bool {
        true
    }
}

/// A mask and the caller's filter predicate.
#[derive(Clone, Copy)]
pub(crate) struct Visible<F> {
    pub mask: u32,
    /// `None` accepts every hit.
    pub accept: Option<F>,
}

impl<T, F: Fn(&T) -> bool> Filter<T> for Visible<F> {
    #[inline(always)]
    fn mask(&self) -> Option<u32> {
        Some(self.mask)
    }
    #[inline(always)]
    fn accepts(&self, hit: impl FnOnce() -> T) -> bool {
        self.accept.as_ref().is_none_or(|accept| accept(&hit()))
    }
    #[inline(always)]
    fn accepts_all(&self) -> bool {
        self.accept.is_none()
    }
}

/// [`Visible`] with a predicate of any type.
pub(crate) type Seen<'a, T> = Visible<&'a dyn Fn(&T) -> bool>;

/// An optional filter.
impl<T, F: Filter<T>> Filter<T> for Option<F> {
    #[inline(always)]
    fn mask(&self) -> Option<u32> {
        self.as_ref().and_then(|filter| filter.mask())
    }
    #[inline(always)]
    fn accepts(&self, hit: impl FnOnce() -> T) -> bool {
        self.as_ref().is_none_or(|filter| filter.accepts(hit))
    }
    #[inline(always)]
    fn accepts_all(&self) -> bool {
        self.as_ref().is_none_or(Filter::accepts_all)
    }
}
