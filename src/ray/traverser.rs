//! What a traversal of the wide layout has at hand.

use crate::simd::Arena;

/// What does not change during a query.
pub(super) struct Scene<'a, G, F> {
    pub arena: &'a Arena,
    pub set: &'a G,
    pub filter: &'a F,
}
