//! What a query searches: the trees of a set, as they are at its time.
//!
//! A set may be divided among several trees. A search goes through them one after the other with the
//! same candidates and the same bound. (Trees of f64 points have kernels of their own, which are faster apart.)

use super::k_nearest::KNearest;
use super::nearest::Best;
use super::radius::Sink;
use super::{Keep, Observe};
use crate::simd::Simd;
use core::ops::ControlFlow;

/// The trees of a set at the time of a query, seen from its point.
pub(in crate::point) trait Trees: Copy {
    /// Traverses all trees, nearest boxes first.
    fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>);
    /// Searches all trees for the nearest point.
    fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>);
    /// Hands every point within the bound to the sink.
    fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()>;
}
