//! The evaluation of pairs in f64, four at a time: whether, when and how near they meet during a window.

use super::candidate_points::{CandidatePoints, FourPoints, WIDTH};
use super::coordinate::SweptCoordinate;
use super::criteria::Criteria;
use super::encounter::{EncounterLanes, EncounterVisitor};
use super::window::Window;
use crate::geometry::TimeInterval;
use crate::point::layout::over_interval::{PointPath, greater, lesser};
use crate::simd::{Mask, Simd};

impl Window {
    /// Shows a visitor the encounters of a point with the `count` others whose numbers are in `hits`, which holds at least
    /// three more numbers. If `IMAGES`, the others are moved to the window's image.
    ///
    /// Relative to the point, another moves along `first + w·displacement`, w in [0, 1]: its squared distance is a parabola. Every
    /// step is symmetric, so both points see the same if they have the same radius for each other. Times are where the parabola is
    /// at its lowest and where it crosses the squared radius.
    #[inline(always)]
    pub(super) fn encounters<S: Simd, V: EncounterVisitor, C: SweptCoordinate, const IMAGES: bool>(
        &self,
        s: S,
        own: &PointPath,
        others: &CandidatePoints<C>,
        (hits, count): (&[u32], usize),
        criteria: &Criteria<'_>,
        visitor: &mut V,
    ) {
        let active = TimeInterval::FULL;
        let mut overlap = Overlap::of(s, self, own, [[active.begin(); WIDTH], [active.end_bound(); WIDTH]]);
        let (others_radii, square) = (criteria.radii.others(), s.splat_d(criteria.square(own.id)));
        let shift = [s.splat_d(self.shift[0]), s.splat_d(self.shift[1]), s.splat_d(self.shift[2])];
        // The point itself, or all with ids up to its own; of another set none.
        let (first, span) = match (criteria.pairs_once, criteria.other_set) {
            (true, _) => (0, own.id),
            (false, false) => (own.id, 0),
            // The id of no point.
            (false, true) => (u32::MAX, 0),
        };
        for at in (0..count).step_by(WIDTH) {
            let four = others.four([hits[at], hits[at + 1], hits[at + 2], hits[at + 3]]);
            if criteria.has_active_intervals {
                overlap = Overlap::of(s, self, own, four.active());
            }
            let ids = four.ids();
            let squares = others_radii.map_or(square, |radii| criteria.squares(s, own.id, radii, ids));
            let mut encounters = overlap.encounters_with::<C, IMAGES>(s, &four, shift, squares);
            if count - at < WIDTH {
                encounters.valid &= (1 << (count - at)) - 1;
            }
            for (lane, id) in ids.into_iter().enumerate() {
                encounters.valid &= !(Mask::from(id.wrapping_sub(first) <= span) << lane);
            }
            visitor.visit(own, &four, &encounters);
        }
    }
}

/// The times during which a point and four others all exist, and the positions of the point then.
struct Overlap<S: Simd> {
    /// Begin, and end, which may lie before it.
    times: [S::D; 2],
    /// Those of the others.
    phases: [S::D; 2],
    /// Where the point is at begin and end.
    own: [[S::D; 3]; 2],
    /// Encounters that begin from the first of these times to before the second are reported.
    reported: [S::D; 2],
}

impl<S: Simd> Overlap<S> {
    #[inline(always)]
    fn of(s: S, window: &Window, own: &PointPath, [begins, ends]: [[f32; WIDTH]; 2]) -> Overlap<S> {
        let (own_begin, own_end) = (f64::from(own.active.begin()), f64::from(own.active.end_bound()));
        let begin = s.max_d(s.splat_d(greater(window.times[0], own_begin)), s.widen_four(&begins));
        // Active intervals that reach the end of the shutter have an end beyond it.
        let last = lesser(lesser(window.times[1], 1.0), own_end);
        let ends = s.widen_four(&ends);
        let times = [begin, s.min_d(s.splat_d(last), ends)];
        // At the end of its active interval, a point does not exist any more.
        let [from, until] = window.reported;
        let mut reported = [s.splat_d(from), s.min_d(s.splat_d(lesser(until, own_end)), ends)];
        if window.key < f64::INFINITY {
            reported[1] = s.select_le(s.splat_d(window.key), begin, s.splat_d(f64::NEG_INFINITY), reported[1]);
        }
        let [of_own, of_others] = window.segments;
        let phases = [of_others.phases(s, times[0]), of_others.phases(s, times[1])];
        let own_phases =
            if of_own == of_others { phases } else { [of_own.phases(s, times[0]), of_own.phases(s, times[1])] };
        Overlap { times, phases, own: [own_at(s, own, own_phases[0]), own_at(s, own, own_phases[1])], reported }
    }

    /// Positions of others relative to the point at begin or end; if `IMAGES`, moved to an image.
    #[inline(always)]
    fn relative<const IMAGES: bool>(&self, end: usize, [open, close]: [[S::D; 3]; 2], shift: [S::D; 3]) -> [S::D; 3] {
        let (phase, own) = (self.phases[end], self.own[end]);
        let x = (open[0] + (close[0] - open[0]) * phase) - own[0];
        let y = (open[1] + (close[1] - open[1]) * phase) - own[1];
        let z = (open[2] + (close[2] - open[2]) * phase) - own[2];
        if IMAGES { [x + shift[0], y + shift[1], z + shift[2]] } else { [x, y, z] }
    }

    /// The encounters with four others.
    #[inline(always)]
    fn encounters_with<C: SweptCoordinate, const IMAGES: bool>(
        &self,
        s: S,
        others: &FourPoints<C>,
        shift: [S::D; 3],
        square: S::D,
    ) -> EncounterLanes {
        let ends = others.ends(s);
        let first = self.relative::<IMAGES>(0, ends, shift);
        let last = self.relative::<IMAGES>(1, ends, shift);
        let displacement = [last[0] - first[0], last[1] - first[1], last[2] - first[2]];
        let (zero, one) = (s.splat_d(0.0), s.splat_d(1.0));
        let (speed, approach) = (dot::<S>(displacement, displacement), zero - dot::<S>(first, displacement));
        // Without relative motion it is 0 / 0, of which the greater of it and 0 makes 0.
        let w = s.min_d(s.max_d(approach / speed, zero), one);
        let nearest = [first[0] + displacement[0] * w, first[1] + displacement[1] * w, first[2] + displacement[2] * w];
        let outside = dot::<S>(first, first) - square;
        let root = s.sqrt_d(s.max_d(approach * approach - speed * outside, zero));
        // The smaller root without cancellation; `approach` is above zero where the pair begins outside. Few pairs both begin
        // and end outside, so one division serves for entering or leaving.
        let sum = approach + root;
        let quotient = s.select_le(outside, zero, sum, outside) / s.select_le(outside, zero, speed, sum);
        let last_square = dot::<S>(last, last);
        let inside = s.le_d(outside, zero) | s.le_d(last_square, square);
        let to_leave = if inside == (1 << WIDTH) - 1 { quotient } else { sum / speed };
        let entering = s.min_d(s.max_d(quotient, zero), w);
        let leaving = s.min_d(s.max_d(to_leave, w), one);
        let enter = s.select_le(outside, zero, zero, entering);
        let leave = s.select_le(last_square, square, one, leaving);
        let distance = dot::<S>(nearest, nearest);
        let [begin, end] = self.times;
        let duration = end - begin;
        let enter = begin + duration * enter;
        let [from, until] = self.reported;
        let reported = s.le_d(from, enter) & !s.le_d(until, enter);
        EncounterLanes {
            enter: s.narrow(enter),
            leave: s.narrow(begin + duration * leave),
            closest: s.narrow(begin + duration * w),
            distance_squared: s.narrow(distance),
            valid: s.le_d(begin, end) & s.le_d(distance, square) & reported,
        }
    }
}

/// Where a point is at each of four phases.
#[inline(always)]
fn own_at<S: Simd>(s: S, own: &PointPath, phases: S::D) -> [S::D; 3] {
    let displacement = [own.close[0] - own.open[0], own.close[1] - own.open[1], own.close[2] - own.open[2]];
    [
        s.splat_d(own.open[0]) + s.splat_d(displacement[0]) * phases,
        s.splat_d(own.open[1]) + s.splat_d(displacement[1]) * phases,
        s.splat_d(own.open[2]) + s.splat_d(displacement[2]) * phases,
    ]
}

#[inline(always)]
fn dot<S: Simd>(a: [S::D; 3], b: [S::D; 3]) -> S::D {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}
