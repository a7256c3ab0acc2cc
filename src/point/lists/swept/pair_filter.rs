//! The filter in f32: which pairs of points may come within the radius, and so are evaluated in f64.
//!
//! As for lists at a time: the points that can come near any of a block's are gathered one behind the other, and each of
//! the block's points is compared with these, sixteen at a time.

use super::candidates::{CandidateBlock, SweptCandidates};
use super::coordinate::SweptCoordinate;
use super::criteria::Criteria;
use super::encounter::EncounterVisitor;
use super::group::{Block, RelativePaths};
use crate::point::layout::view::{rows, squared};
use crate::point::lists::candidates::{Selection, write};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, lanes_at, lanes_at_mut};

/// Points that are gathered at most at once.
const MOST: usize = 2048;

/// With room for what is stored behind the last.
type Row = [f32; MOST + 2 * LANES];

/// Points that can come near any of a block, in rows. (Of fixed length, so that they are all found from one address.)
#[derive(Clone)]
#[repr(align(64))]
struct CandidateRows {
    start: [Row; 3],
    displacement: [Row; 3],
    bound: Row,
    excluded_within: Row,
    /// The index of each point among the candidates' points.
    index: [u32; MOST + 2 * LANES],
}

/// Memory for the encounters of a block.
pub(super) struct PairFilter {
    selected: Selection,
    rows: Box<CandidateRows>,
    /// Indices of the candidates' points that come near a point.
    hits: Vec<u32>,
}

impl Default for PairFilter {
    fn default() -> PairFilter {
        let row = [0.0; MOST + 2 * LANES];
        let rows = CandidateRows {
            start: [row; 3],
            displacement: [row; 3],
            bound: row,
            excluded_within: row,
            index: [0; MOST + 2 * LANES],
        };
        PairFilter { selected: Selection::default(), rows: Box::new(rows), hits: Vec::new() }
    }
}

/// Lane numbers.
const LANE: Lanes<u32> = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Passes all encounters of the points of a block to a visitor.
pub(super) struct ShowBlock<'a, V, C> {
    pub(super) block: &'a Block<C>,
    pub(super) candidates: &'a SweptCandidates<C>,
    pub(super) criteria: &'a Criteria<'a>,
    pub(super) filter: &'a mut PairFilter,
    pub(super) visitor: &'a mut V,
}

impl<V: EncounterVisitor, C: SweptCoordinate> Kernel for ShowBlock<'_, V, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let ShowBlock { block, candidates, criteria, filter: PairFilter { selected, rows, hits }, visitor } = self;
        let greatest = criteria.greatest(&block.points.id);
        let all = selected.near(s, &candidates.boxes, (block.lo, block.hi), criteria.within(greatest));
        let (shared, rest) =
            rows.gather::<S, V>(s, &candidates.blocks, all, (block.lo, block.hi), (criteria, greatest));
        let shared = rest.is_empty().then_some(shared);
        for lane in 0..LANES {
            let Some(own) = block.points.point_path(lane) else { continue };
            if !visitor.wants(own.id) {
                continue;
            }
            visitor.begin(&own);
            let RelativePaths { start, displacement } = &block.paths;
            let from = [start[0][lane], start[1][lane], start[2][lane]];
            let displacement = [displacement[0][lane], displacement[1][lane], displacement[2][lane]];
            // What did not exist at the first time was not near anything then.
            let exclude = V::EXCLUDES_LISTED && own.active.contains(criteria.first_time);
            let mut count = 0;
            if let Some(points) = shared {
                count = rows.pairs_within::<S, V>(s, (from, displacement), exclude, points, (hits, count));
            } else {
                // Too many for all points of the block together: some go far, or the radius is large. Each for itself.
                let to = [from[0] + displacement[0], from[1] + displacement[1], from[2] + displacement[2]];
                let lo = [from[0].min(to[0]), from[1].min(to[1]), from[2].min(to[2])];
                let hi = [from[0].max(to[0]), from[1].max(to[1]), from[2].max(to[2])];
                let radius = criteria.radii.of(own.id);
                let mut rest = selected.near(s, &candidates.boxes, (lo, hi), criteria.within(radius));
                while !rest.is_empty() {
                    let points;
                    (points, rest) = rows.gather::<S, V>(s, &candidates.blocks, rest, (lo, hi), (criteria, radius));
                    count = rows.pairs_within::<S, V>(s, (from, displacement), exclude, points, (hits, count));
                }
            }
            let (mut begin, mut image, mut several) = (0, None, false);
            for &(window, end) in &candidates.windows {
                let before = hits[begin..count].partition_point(|&index| (index as usize) < end * LANES);
                if before == 0 {
                    continue;
                }
                several |= image.is_some_and(|image| image != window.shift);
                image = Some(window.shift);
                let hits = (&hits[begin..], before);
                if window.shift == [0.0; 3] {
                    window.encounters::<S, V, C, false>(s, &own, &candidates.others, hits, criteria, visitor);
                } else {
                    window.encounters::<S, V, C, true>(s, &own, &candidates.others, hits, criteria, visitor);
                }
                begin += before;
            }
            if several {
                visitor.end_of_several_images();
            }
        }
    }
}

impl CandidateRows {
    /// Gathers the points of selected blocks that come near a box around points with at most this radius, as many as there is room
    /// for; returns their number, and the blocks that are left.
    #[inline(always)]
    fn gather<'a, S: Simd, V: EncounterVisitor>(
        &mut self,
        s: S,
        candidates: &[CandidateBlock],
        selected: &'a [u32],
        (lo, hi): ([f32; 3], [f32; 3]),
        (criteria, own): (&Criteria<'_>, f32),
    ) -> (usize, &'a [u32]) {
        let CandidateRows {
            start: [to_x, to_y, to_z],
            displacement: [to_u, to_v, to_w],
            bound: to_bound,
            excluded_within: to_known,
            index: to_index,
        } = self;
        let lo = [s.splat(lo[0]), s.splat(lo[1]), s.splat(lo[2])];
        let hi = [s.splat(hi[0]), s.splat(hi[1]), s.splat(hi[2])];
        let (mut end, mut done) = (0, 0);
        while let Some(&block) = selected.get(done)
            && end < MOST
        {
            done += 1;
            let candidate = &candidates[block as usize];
            let CandidateBlock { paths, excluded_within, .. } = candidate;
            let bound = candidate.bound(criteria, own);
            let ([x, y, z], [u, v, w]) = (rows(s, &paths.start), rows(s, &paths.displacement));
            let (a, b, c) = (gap(s, x, u, lo[0], hi[0]), gap(s, y, v, lo[1], hi[1]), gap(s, z, w, lo[2], hi[2]));
            let near = s.le(squared::<S>(a, b, c), s.splat(bound));
            write(s, to_x, end, x, near);
            write(s, to_y, end, y, near);
            write(s, to_z, end, z, near);
            write(s, to_u, end, u, near);
            write(s, to_v, end, v, near);
            write(s, to_w, end, w, near);
            write(s, to_bound, end, s.splat(bound), Mask::MAX);
            if V::EXCLUDES_LISTED {
                write(s, to_known, end, s.load(excluded_within), near);
            }
            let indices = s.add_u(s.load_u(&LANE), s.splat_u(block * LANES as u32));
            s.store_compressed_u(indices, near, lanes_at_mut(to_index, end));
            end += near.count_ones() as usize;
        }
        to_x[end..end + LANES].fill(f32::INFINITY);
        (end, &selected[done..])
    }

    /// Appends to the first `end` hits which of the gathered points come as near as their bounds to one that goes from a
    /// place by a displacement, without those that are to be excluded; the new number of hits, behind which there is room for more.
    #[inline(always)]
    fn pairs_within<S: Simd, V: EncounterVisitor>(
        &self,
        s: S,
        (from, displacement): ([f32; 3], [f32; 3]),
        exclude: bool,
        points: usize,
        (hits, mut end): (&mut Vec<u32>, usize),
    ) -> usize {
        let CandidateRows { start: [xs, ys, zs], displacement: [us, vs, ws], bound, excluded_within, index } = self;
        if hits.len() < end + points + 2 * LANES {
            hits.resize(2 * (end + points) + 2 * LANES, 0);
        }
        let hits = &mut hits[..];
        let from = [s.splat(from[0]), s.splat(from[1]), s.splat(from[2])];
        let displacement = [s.splat(displacement[0]), s.splat(displacement[1]), s.splat(displacement[2])];
        let (zero, one, least) = (s.splat(0.0), s.splat(1.0), s.splat(f32::MIN_POSITIVE));
        let nothing_known = if exclude { 0 } else { Mask::MAX };
        for at in (0..points.min(MOST + LANES)).step_by(LANES) {
            let x = s.load(lanes_at(xs, at)) - from[0];
            let y = s.load(lanes_at(ys, at)) - from[1];
            let z = s.load(lanes_at(zs, at)) - from[2];
            // The other way round, so that the nearest approach is at `d·w / w·w`.
            let u = displacement[0] - s.load(lanes_at(us, at));
            let v = displacement[1] - s.load(lanes_at(vs, at));
            let w = displacement[2] - s.load(lanes_at(ws, at));
            let speed = s.max(dot(s, [u, v, w], [u, v, w]), least);
            let time = s.max(s.min(dot(s, [x, y, z], [u, v, w]) / speed, one), zero);
            let (a, b, c) = (x - u * time, y - v * time, z - w * time);
            let mut near = s.le(dot(s, [a, b, c], [a, b, c]), s.load(lanes_at(bound, at)));
            if V::EXCLUDES_LISTED {
                let listed = s.le(squared::<S>(x, y, z), s.load(lanes_at(excluded_within, at)));
                near &= !listed | nothing_known;
            }
            s.store_compressed_u(s.load_u(lanes_at(index, at)), near, lanes_at_mut(hits, end));
            end += near.count_ones() as usize;
        }
        // What is behind them is read too.
        let last = if end > 0 { hits[end - 1] } else { 0 };
        hits[end..end + LANES].fill(last);
        end
    }
}

/// How far linear motion stays from `[lo, hi]` along an axis.
#[inline(always)]
fn gap<S: Simd>(s: S, from: S::F, displacement: S::F, lo: S::F, hi: S::F) -> S::F {
    let to = from + displacement;
    s.max_with_zero(s.min(from, to) - hi, lo - s.max(from, to))
}

/// For culling only.
#[inline(always)]
fn dot<S: Simd>(s: S, [x, y, z]: [S::F; 3], [u, v, w]: [S::F; 3]) -> S::F {
    s.mul_add(z, w, s.mul_add(y, v, x * u))
}
