//! Bounds of a draft's references in time slices.

use super::draft::Draft;
use super::existence::meet;
use crate::bvh::Reference;
use crate::geometry::{Box3, LinearBox3, TimeInterval, ULP};
use crate::primitive::{Intervals, PrimitiveSet};
use crate::simd::LANES;

/// Extends bounds over each of some time slices by those of references of one kind that exist in it. The slices are given by the
/// intervals of their bounds, and by their query times.
pub(crate) fn include_slice_bounds<S: PrimitiveSet>(
    set: &S,
    references: &[Reference],
    draft: &Draft,
    (over, times): (&mut Intervals<'_>, &[TimeInterval]),
    bounds: &mut [LinearBox3],
) {
    if draft.presplit || !set.always_active() {
        for r in references {
            let active = set.active(r.id());
            // Shapes, and triangles with more than two keys, may move although they have the same box at both ends of the shutter.
            let is_triangle = || set.corner_bounds(r.id(), draft.over).is_some();
            let fixed = !draft.presplit && !r.moving() && set.leaf_kind(r.id()) == 0 && is_triangle();
            for ((&over, &times), bounds) in over.over.iter().zip(times).zip(&mut *bounds) {
                if meet(active, times) {
                    *bounds = bounds.union(if fixed { r.bounds() } else { slice_bounds(set, r, draft, over) });
                }
            }
        }
        return;
    }
    for some in references.chunks(LANES) {
        set.include_bounds(&Reference::ids(some)[..some.len()], over, bounds);
    }
}

/// Bounds of a draft's reference in a part of its time interval: the intersection of the primitive's own bounds in that
/// part and, if it was pre-split, of the reference's bounds.
pub(crate) fn slice_bounds<S: PrimitiveSet>(set: &S, r: &Reference, draft: &Draft, over: TimeInterval) -> LinearBox3 {
    let (own, bounds) = (set.bounds(r.id(), over), r.bounds());
    if !draft.presplit {
        return own;
    }
    if !r.moving() {
        return own.tighter(bounds);
    }
    let at = |t: f32| box_at(bounds, draft.over, t, BETWEEN_ULPS);
    own.tighter(LinearBox3 { begin: at(over.begin()), end: at(over.end()) })
}

/// The padding of boxes between those at both ends of an interval: 7 ULP, and one for rounding the box that it is added to.
const BETWEEN_ULPS: f32 = 8.0;

/// The box at a time of an interval, with a padding in ULP of its largest coordinate.
///
/// Three roundings at sizes of at most twice that coordinate, and the fraction of the interval is rounded twice: 7 ULP.
#[inline(always)]
fn box_at(bounds: LinearBox3, over: TimeInterval, t: f32, ulps: f32) -> Box3 {
    let w = ((t - over.begin()) / over.duration()).clamp(0.0, 1.0);
    bounds.at(w).pad(ulps * ULP * bounds.swept().magnitude())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Compared with the exact faces (the error of f64 is negligible here). With a padding of 0 half of the faces are
    /// inside.
    #[test]
    fn boxes_between_are_rounded_outward_and_would_not_be_without_padding() {
        let mut random = Random(3);
        let mut lost = [0, 0];
        for _ in 0..20_000 {
            let (a, b) = (random.vec(), random.vec());
            let bounds = LinearBox3 { begin: Box3 { min: a, max: a }, end: Box3 { min: b, max: b } };
            let begin = 0.4 + 0.4 * random.signed();
            let over = TimeInterval::new(begin, begin + 0.1).expect("a time slice");
            let t = over.begin() + over.duration() * (0.5 + 0.5 * random.signed());
            let w = (f64::from(t) - f64::from(over.begin())) / (f64::from(over.end()) - f64::from(over.begin()));
            let exact = a.as_dvec3().lerp(b.as_dvec3(), w.clamp(0.0, 1.0));
            for (lost, ulps) in lost.iter_mut().zip([BETWEEN_ULPS, 0.0]) {
                let found = box_at(bounds, over, t, ulps);
                let holds = found.min.as_dvec3().cmple(exact).all() && found.max.as_dvec3().cmpge(exact).all();
                *lost += usize::from(!holds);
            }
        }
        assert!(lost[0] == 0 && lost[1] > 5000, "{lost:?}");
    }
}
