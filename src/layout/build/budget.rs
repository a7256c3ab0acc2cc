//! How many bytes a wide tree may take, and what is tried if it takes more.

use crate::error::BuildError;
use crate::layout::leaf::source::WideSource;
use crate::layout::wide_node::MOST_ARENA_BYTES;
use crate::limits::{MAX_TIME_SLICES, MOST_REFERENCES};
use crate::params::{Division, WideParams};
use crate::primitive::SPHERE_KEY_BYTES;
use glam::Vec3;

/// Bytes that every tree may use in addition: the nodes of tiny trees are mostly empty.
const LEAST_BYTES: usize = 8192;

/// The allowed size of a tree: the bytes per primitive, and the positions at further keys.
pub(in crate::layout) fn allowed_bytes(params: &WideParams, primitives: usize, further_key_bytes: usize) -> usize {
    let bytes = f64::from(params.bytes_per_primitive) * primitives as f64;
    bytes as usize + further_key_bytes + LEAST_BYTES
}

/// The most bytes that a triangle takes in leaf blocks for keys beyond the second, and a sphere for all.
pub(in crate::layout) fn further_key_bytes<S: WideSource>(set: &S, id: u32) -> usize {
    match set.sphere(id) {
        Some(sphere) => sphere.keys.len() * SPHERE_KEY_BYTES,
        None => (set.leaf_kind(id) as usize).saturating_sub(2) * size_of::<[Vec3; 3]>(),
    }
}

/// A number of primitives that certainly fits one subtree of a lazy tree: each split into as many references as are allowed, with
/// as many separate trees as there can be, of 256 bytes and the keys each. Where one takes more, it is one that fits undivided.
///
/// # Errors
/// If one may not, which takes some forty million keys of a sphere.
pub(in crate::layout) fn most_in_subtree<S: WideSource>(set: &S) -> Result<usize, BuildError> {
    const REFERENCES: usize = MOST_REFERENCES * MAX_TIME_SLICES;
    let any = set.further_key_bytes() > 0;
    let most = if any { (0..set.len() as u32).map(|id| further_key_bytes(set, id)).max() } else { None };
    let fitting = MOST_ARENA_BYTES / (256 + most.unwrap_or(0));
    if fitting == 0 { Err(BuildError::TooLargeTree) } else { Ok((fitting / REFERENCES).max(1)) }
}

/// Builds that are tried before one with a tree for each kind of primitives, if trees are larger than allowed.
pub(in crate::layout) const ATTEMPTS: usize = 3;

/// The parameters after an attempt that took too much memory: the estimates of the choices were too low. From the third attempt on,
/// there are neither pre-splits nor temporal splits. `share` is the share of the tree's bytes that is allowed, if these are known.
pub(in crate::layout) fn with_less(
    wide: WideParams,
    share: Option<f32>,
    primitives: usize,
    attempt: usize,
) -> WideParams {
    if attempt > 0 {
        return WideParams { max_references: 1.0, division: Division::Whole, ..wide };
    }
    let most = match share {
        Some(share) => share * wide.bytes_per_primitive,
        None => 0.5 * wide.bytes_per_primitive.min(MOST_ARENA_BYTES as f32 / primitives as f32),
    };
    WideParams { bytes_per_primitive: 0.8 * most, ..wide }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_tree_that_is_too_large_less_is_allowed_and_at_last_nothing() {
        let given = WideParams { bytes_per_primitive: 1000.0, ..WideParams::default() };
        let half = with_less(given, Some(0.5), 100, 0);
        assert_eq!((half.bytes_per_primitive, half.division), (400.0, Division::Automatic));
        // Ten million primitives have 215 bytes each in an arena.
        let less = with_less(given, None, 10_000_000, 0);
        assert!((80.0..90.0).contains(&less.bytes_per_primitive), "{less:?}");
        assert_eq!(with_less(given, None, 100, 0).bytes_per_primitive, 400.0);
        for attempt in 1..ATTEMPTS {
            let last = with_less(given, None, 10_000_000, attempt);
            assert_eq!((last.max_references, last.division), (1.0, Division::Whole));
        }
    }
}
