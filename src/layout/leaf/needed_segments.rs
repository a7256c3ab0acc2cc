//! The keys that a leaf block with many keys has to hold.

use crate::geometry::KeyTime;
use crate::primitive::PrimitiveSet;
use crate::time::TimeSlice;

/// The segments whose keys a block of some primitives with `keys` keys needs for queries in a time slice, the first and the last:
/// those in which one of the primitives exists.
pub(in crate::layout) fn needed_segments<S: PrimitiveSet + ?Sized>(
    set: &S,
    ids: &[u32],
    keys: usize,
    slice: TimeSlice,
) -> [usize; 2] {
    let [first, last] = slice.segments(keys);
    if set.always_active() {
        return [first, last];
    }
    let of_life = ids.iter().map(|&id| {
        let active = set.active(id);
        [active.begin(), active.last()].map(|t| KeyTime::new(t, keys).segment)
    });
    let [begin, end] = of_life.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or([first, last]);
    [begin.clamp(first, last), end.clamp(first, last)]
}
