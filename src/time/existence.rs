//! What of a set exists in which time slices. What does not exist in a slice is left out of its hierarchy.
//!
//! A query visits the hierarchy of the slice that contains its time. So a primitive whose active interval has no such time is not
//! there for any query that looks. (The intervals of boxes are wider: what exists in one half exactly would meet the interval of
//! the other.) Active intervals lie in the shutter, so every primitive is in the hierarchy of some slice, from where the corners of
//! its triangle can be read.

use super::time_slice::TimeSlice;
use crate::bvh::Reference;
use crate::geometry::TimeInterval;
use crate::primitive::PrimitiveSet;
use std::borrow::Cow;

/// Whether a primitive moves, or exists for a part of the shutter.
fn changes<S: PrimitiveSet>(set: &S, id: u32) -> bool {
    let bounds = set.bounds(id, TimeInterval::FULL);
    bounds.begin != bounds.end || comes_or_goes(set, id)
}

/// Whether a primitive exists for a part of the shutter only.
fn comes_or_goes<S: PrimitiveSet>(set: &S, id: u32) -> bool {
    !set.always_active() && set.active(id) != TimeInterval::FULL
}

/// Whether any of some primitives changes during the shutter, so that time slices may differ.
pub(crate) fn any_changes<S: PrimitiveSet>(set: &S, ids: &[u32]) -> bool {
    ids.iter().any(|&id| changes(set, id))
}

/// Whether the primitive of any of some references exists for a part of the shutter only.
pub(super) fn any_comes_or_goes<S: PrimitiveSet>(set: &S, references: &[Reference]) -> bool {
    !set.always_active() && references.iter().any(|r| comes_or_goes(set, r.id()))
}

/// The primitives that a separate tree for a time slice holds: those that exist in it, and one if none does, since no tree is
/// empty.
pub(crate) fn held_in<'a, S: PrimitiveSet>(set: &S, ids: &'a [u32], slice: TimeSlice) -> Cow<'a, [u32]> {
    if set.always_active() {
        return Cow::Borrowed(ids);
    }
    let times = slice.query_times();
    let mut held: Vec<u32> = Vec::with_capacity(ids.len());
    held.extend(ids.iter().filter(|&&id| meet(set.active(id), times)));
    if held.is_empty() {
        held.extend(ids.first());
    }
    Cow::Owned(held)
}

/// Whether something with an active interval exists at any of some times.
pub(super) fn meet(active: TimeInterval, times: TimeInterval) -> bool {
    active.intersect(times).is_some()
}

/// The query times of each of equal time slices.
fn times_of_slices(count: usize) -> Vec<TimeInterval> {
    (0..count).map(|index| TimeSlice { index, of: count }.query_times()).collect()
}

/// Whether any of some primitives does not exist in some of equal time slices.
pub(crate) fn any_is_left_out<S: PrimitiveSet>(set: &S, mut ids: impl Iterator<Item = u32>, count: usize) -> bool {
    let slices = times_of_slices(count);
    let is_left_out = |id: u32| comes_or_goes(set, id) && !slices.iter().all(|&times| meet(set.active(id), times));
    !set.always_active() && ids.any(is_left_out)
}

/// The largest number of primitives by which a share is estimated.
const COUNTED: usize = 4096;

/// The mean share of equal time slices in which a primitive exists, estimated by evenly spaced ones.
pub(crate) fn share_of_slices<S: PrimitiveSet>(set: &S, ids: impl ExactSizeIterator<Item = u32>, count: usize) -> f32 {
    if set.always_active() || ids.len() == 0 {
        return 1.0;
    }
    let (step, slices) = (ids.len().div_ceil(COUNTED), times_of_slices(count));
    let (mut all, mut existing) = (0, 0);
    for active in ids.step_by(step).map(|id| set.active(id)) {
        all += count;
        existing += slices.iter().filter(|&&times| meet(active, times)).count();
    }
    existing as f32 / all as f32
}

/// Those of equal time slices in which the primitive of any of some references exists.
pub(super) fn slices_with<S: PrimitiveSet>(set: &S, references: &[Reference], count: usize) -> Vec<usize> {
    if set.always_active() {
        return (0..count).collect();
    }
    let slices = times_of_slices(count);
    let mut missing: Vec<usize> = (0..count).collect();
    for active in references.iter().map(|r| set.active(r.id())) {
        missing.retain(|&index| !meet(active, slices[index]));
        if missing.is_empty() {
            break;
        }
    }
    (0..count).filter(|index| !missing.contains(index)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{TriangleMesh, Triangles};
    use glam::Vec3;

    #[test]
    fn separate_trees_hold_what_exists_whatever_the_number_of_keys() {
        let zigzag = |keys: i32| {
            let at = |key: i32| Vec3::Z * (key % 2) as f32;
            let key = |key: i32| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + at(key)).to_vec();
            let active = TimeInterval::new(0.3, 0.45).expect("an interval");
            TriangleMesh::new(vec![[0, 1, 2]], (0..keys).map(key).collect::<Vec<_>>()).with_active(active)
        };
        let set = Triangles::new(&[zigzag(1), zigzag(2), zigzag(5)]).expect("valid meshes");
        let ids = [0, 1, 2];
        for count in [2, 4] {
            assert_eq!(share_of_slices(&set, ids.into_iter(), count), 1.0 / count as f32);
            let held = |index: usize| held_in(&set, &ids, TimeSlice { index, of: count }).len();
            // One in each slice in which nothing exists.
            assert_eq!((0..count).map(held).sum::<usize>(), 3 + (count - 1));
        }
    }
}
