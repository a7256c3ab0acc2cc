//! A temporal split with shared leaves: one hierarchy per time slice over the same leaf blocks.

use super::draft::Draft;
use super::existence::meet;
use super::time_slice::{TimeSlice, time_slice};
use crate::bvh::{BinaryNode, BinaryTree, Collapse, Reference, SurfaceDensity, build_binary, leaf_cost};
use crate::geometry::{Box3, LinearBox3, TimeInterval, ULP};
use crate::parallel;
use crate::primitive::{Intervals, PrimitiveSet};
use crate::progress::Progress;
use crate::simd::{LANES, fill, huge_vec, huge_vec_of};

/// The hierarchies and their shared leaf blocks.
pub(crate) struct SharedLeaves {
    /// The binary nodes that are leaf blocks.
    pub clusters: Vec<BinaryNode>,
    pub trees: Vec<Slice>,
}

/// The hierarchy of one time slice.
pub(crate) struct Slice {
    pub over: TimeInterval,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    /// The cluster at each index of the binary tree's order.
    pub order: Vec<u32>,
}

impl SharedLeaves {
    /// Rebuilds the nodes above the leaf blocks of a draft's subtree for some of `count` equal time slices of the shutter, in
    /// order. Of no use once `progress` is cancelled.
    pub fn build<S: PrimitiveSet>(
        set: &S,
        draft: &Draft,
        of: u32,
        count: usize,
        slices: &[usize],
        progress: &Progress,
    ) -> SharedLeaves {
        let clusters = draft.collapse.leaves(&draft.binary, of);
        // The boxes at the beginning of each slice, where they are needed.
        let needed = |i: usize| i > 0 && (slices.contains(&i) || slices.contains(&(i - 1)));
        let of_bounds = progress.subtask(BOUNDS);
        let of_bounds = of_bounds.in_units((0..count).filter(|&i| needed(i)).count());
        let boundary = |i: usize| {
            if !needed(i) || progress.cancelled() {
                return Some(Vec::new());
            }
            let boxes = boundary(set, draft, &clusters, i, count)?;
            of_bounds.finished(1.0);
            Some(boxes)
        };
        let boundaries: Option<Vec<Vec<Box3>>> = (0..count).map(boundary).collect();
        let of_count: Vec<TimeSlice> = slices.iter().map(|&index| TimeSlice { index, of: count }).collect();
        let over: Vec<TimeInterval> = of_count.iter().map(|slice| slice.interval()).collect();
        let in_slices =
            if boundaries.is_none() { bounds_in(set, draft, &clusters, &of_count, &of_bounds) } else { Vec::new() };
        drop(of_bounds);
        if progress.cancelled() {
            return SharedLeaves { clusters, trees: Vec::new() };
        }
        let share = progress.rest(1.0);
        let trees = parallel::map(slices.len(), |nth| {
            let (slice, over) = (slices[nth], over[nth]);
            let bounds = |i: usize| match &boundaries {
                Some(boundaries) => LinearBox3 {
                    begin: if slice == 0 { clusters[i].bounds.begin } else { boundaries[slice][i] },
                    end: if slice + 1 == count { clusters[i].bounds.end } else { boundaries[slice + 1][i] },
                },
                None => in_slices[i * slices.len() + nth],
            };
            Slice::build(&clusters, over, draft.density, bounds, &share.subtask(1.0 / slices.len() as f64))
        });
        SharedLeaves { clusters, trees }
    }

    /// Expected cost of a ray.
    pub fn cost(&self) -> f32 {
        self.trees.iter().map(|t| t.collapse.total()).sum::<f32>() / self.trees.len() as f32
    }
}

/// The share of the bounds of leaf blocks, about.
const BOUNDS: f64 = 0.3;

/// The share of object splits in a hierarchy over leaf blocks, about.
const SPLITTING: f64 = 0.8;

/// Leaf blocks whose bounds are computed by one thread.
const BLOCKS: usize = 256;

/// The bounds of the leaf blocks over each of some time slices, block by block.
fn bounds_in<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    clusters: &[BinaryNode],
    slices: &[TimeSlice],
    progress: &Progress,
) -> Vec<LinearBox3> {
    let over: Vec<TimeInterval> = slices.iter().map(|slice| slice.interval()).collect();
    let times: Vec<TimeInterval> = slices.iter().map(|slice| slice.query_times()).collect();
    let mut all = huge_vec_of(LinearBox3::EMPTY, clusters.len() * over.len());
    let mut parts: Vec<_> = clusters.chunks(BLOCKS).zip(all.chunks_mut(BLOCKS * over.len())).collect();
    let needed = over.iter().copied().reduce(TimeInterval::hull).unwrap_or(TimeInterval::FULL);
    let progress = progress.in_units(clusters.len());
    parallel::each(&mut parts, |(clusters, bounds)| {
        if progress.cancelled() {
            return;
        }
        let mut intervals = Intervals::new(&over);
        for (i, (cluster, bounds)) in clusters.iter().zip(bounds.chunks_mut(over.len())).enumerate() {
            draft.prefetch(set, clusters, i, needed);
            include_slice_bounds(set, draft.references(cluster), draft, (&mut intervals, &times), bounds);
        }
        progress.finished(clusters.len() as f64);
    });
    all
}

/// The boxes of the leaf blocks at the beginning of time slice `i`; `None` if a block's motion between such times is
/// not linear.
///
/// Corners move on lines up to their slack, so linear interpolation between the boxes at both ends of a slice bounds
/// them at all its times. The slice before ends slightly later than this one begins: the boxes hold the corners at both
/// times.
fn boundary<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    clusters: &[BinaryNode],
    i: usize,
    count: usize,
) -> Option<Vec<Box3>> {
    let over = time_slice(i, count).intersect(time_slice(i - 1, count))?;
    if draft.presplit
        || set.bent()
        || !set.always_active()
        || set.corner_bounds(draft.references.first()?.id(), over).is_none()
    {
        return None;
    }
    let mut boxes = huge_vec(clusters.len());
    fill(&mut boxes, clusters.len(), |i| {
        draft.prefetch(set, clusters, i, over);
        draft.references(&clusters[i]).iter().fold(Box3::EMPTY, |b, r| {
            let Some(bounds) = set.corner_bounds(r.id(), over) else { return b };
            b.union(bounds.union().swept().pad(bounds.slack))
        })
    });
    Some(boxes)
}

impl Slice {
    fn build(
        clusters: &[BinaryNode],
        over: TimeInterval,
        density: SurfaceDensity,
        bounds: impl Fn(usize) -> LinearBox3 + Sync,
        progress: &Progress,
    ) -> Slice {
        let n = clusters.len();
        let mut blocks = huge_vec(n);
        fill(&mut blocks, n, |i| Reference::new(bounds(i), i as u32));
        // Blocks of which nothing exists in the slice.
        blocks.retain(|block| !block.is_empty());
        if blocks.is_empty() {
            // No hierarchy is empty.
            blocks.push(Reference::new(clusters[0].bounds, 0));
        }
        let binary = build_binary(&mut blocks, 1..=1, None, None, &progress.subtask(SPLITTING));
        let cost = |node: &BinaryNode| {
            (node.count == 1).then(|| {
                let block = &clusters[blocks[node.first as usize].id() as usize];
                leaf_cost(block.count as usize)
            })
        };
        let collapse = Collapse::new(&binary, density, cost, &progress.rest(1.0));
        Slice { over, binary, collapse, order: blocks.iter().map(Reference::id).collect() }
    }
}

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
