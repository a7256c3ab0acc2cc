//! What a query may have beside its ray or point: a mask, a filter predicate, an observer.

use super::filter::{Filter, Seen, Visible};
use super::observer::Observer;

/// The optional parts of a query: a mask with the caller's filter predicate, which takes a `T`, and an observer.
///
/// They are tested at run time, so that one compiled form serves every combination.
pub(crate) struct Guards<'a, T> {
    pub visible: Option<Seen<'a, T>>,
    pub observer: Option<&'a mut dyn Observer>,
}

impl<'a, T> Guards<'a, T> {
    pub fn none() -> Guards<'a, T> {
        Guards { visible: None, observer: None }
    }

    pub fn filtered(mask: u32, accept: &'a dyn Fn(&T) -> bool) -> Guards<'a, T> {
        Guards { visible: Some(Visible { mask, accept: Some(accept) }), observer: None }
    }

    pub fn masked(mask: u32) -> Guards<'a, T> {
        Guards { visible: Some(Visible { mask, accept: None }), observer: None }
    }

    pub fn observed(observer: &'a mut dyn Observer) -> Guards<'a, T> {
        Guards { visible: None, observer: Some(observer) }
    }

    /// Whether there are none.
    #[inline(always)]
    pub fn are_none(&self) -> bool {
        self.visible.is_none() && self.observer.is_none()
    }

    /// Runs a query of a placed tree, whose answers `U` are the answers `T` that `placed` makes of them, with the same guards.
    pub fn inside<U, R>(&mut self, placed: impl Fn(&U) -> T, query: impl FnOnce(Guards<'_, U>) -> R) -> R {
        let visible = self.visible;
        let accept = |found: &U| visible.accepts(|| placed(found));
        let visible =
            visible.map(|Visible { mask, accept: given }| Visible { mask, accept: given.map(|_| &accept as _) });
        query(Guards { visible, observer: self.observer.as_mut().map(|observer| &mut **observer as _) })
    }
}
