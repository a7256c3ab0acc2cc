//! Encounters: pairs of moving points that come within a radius of each other, evaluated four at a time.

use super::coordinate::SweptCoordinate;
use super::images::Images;
use crate::geometry::TimeInterval;
use crate::point::layout::over_interval::{PathRows, PointPath, greater, lesser};
use crate::point::lists::candidates::Within;
use crate::point::lists::radii::{Allowance, Margin, Radii, radius_of, squared_up};
use crate::simd::{LANES, Lanes, Mask, Simd};

/// A time at which two points are as close as they come, and when they are within the radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// The other point.
    pub id: u32,
    /// The first time within the radius.
    pub enter: f32,
    /// The last time within the radius. Between keys the two stay within the radius from the first to the last; over
    /// several keys, in several images in a periodic box, or if one of them does not exist for a while, they may part in between.
    pub leave: f32,
    /// When they are nearest; the first such time. Over several keys it is the earliest of those with the least `distance_squared`;
    /// where paths cross more than once, rounding in f64 decides which of the crossings has that. If they are still approaching
    /// each other when one of them ceases to exist, the end of its active interval.
    pub closest: f32,
    /// The squared distance then.
    pub distance_squared: f32,
}

impl Encounter {
    /// What memory holds that is not in use.
    pub(super) const NONE: Encounter =
        Encounter { id: u32::MAX, enter: 0.0, leave: 0.0, closest: 0.0, distance_squared: 0.0 };

    /// Both encounters of the same points as one.
    pub(super) fn and(self, other: Encounter) -> Encounter {
        let key = |e: &Encounter| (e.distance_squared.to_bits(), e.closest.to_bits());
        let nearest = if key(&other) < key(&self) { other } else { self };
        Encounter { enter: self.enter.min(other.enter), leave: self.leave.max(other.leave), ..nearest }
    }
}

/// What is done with encounters.
pub(super) trait EncounterVisitor {
    /// Whether pairs that lists at the first time contain are excluded.
    const EXCLUDES_LISTED: bool;
    /// Whether the encounters of a point count.
    #[inline(always)]
    fn wants(&self, _id: u32) -> bool {
        true
    }
    /// Comes to a point.
    fn begin(&mut self, own: &PointPath);
    /// The encounters of that point with four others.
    fn visit<C: SweptCoordinate>(&mut self, own: &PointPath, others: &FourPoints<C>, encounters: &EncounterLanes);
    /// Ends a point that the same others may have come up for several times, in different images.
    #[inline(always)]
    fn end_of_several_images(&mut self) {}
}

/// The criteria of an encounter, the same for all points of a group.
#[derive(Clone, Copy)]
pub(super) struct Criteria<'a> {
    pub(super) radii: Radii<'a>,
    /// How much farther than their radius pairs may be.
    pub(super) allowance: Allowance,
    /// The greatest radius of one of the points, if pairs have radii of their own.
    pub(super) own: f32,
    /// Whether each pair is reported to the point with the lower id only.
    pub(super) pairs_once: bool,
    /// Whether the others are another set, whose ids have nothing to do with these.
    pub(super) other_set: bool,
    /// The group's first time.
    pub(super) first_time: f32,
    /// Whether some points do not exist throughout the shutter.
    pub(super) has_active_intervals: bool,
    pub(super) images: Images,
}

impl Criteria<'_> {
    /// How near boxes have to be to a point with this radius, or to several with such.
    #[inline(always)]
    pub(super) fn within(&self, own: f32) -> Within<'_> {
        match self.radii {
            Radii::Equal(radius) => Within::Squared(squared_up(self.allowance.added_to(radius))),
            _ => Within::Radius(&self.radii, own, Margin::of_rounding(0.0).beyond(self.allowance)),
        }
    }

    /// How far two points may be from each other that have at most these radii, where pairs have radii of their own.
    #[inline(always)]
    pub(super) fn longest(&self, own: f32, other: f32) -> f64 {
        let radius = if let Radii::Equal(radius) = self.radii { radius } else { self.radii.of_pair(own, other) };
        self.allowance.added_to(radius)
    }

    /// The greatest radius of points with these ids, unless all have the same.
    #[inline(always)]
    pub(super) fn greatest(&self, ids: &Lanes<u32>) -> f32 {
        let (Radii::Own(own) | Radii::Larger { own, .. } | Radii::Sum { own, .. }) = self.radii else { return 0.0 };
        let mut most = 0.0;
        for &id in ids {
            most = f32::max(most, radius_of(own, id));
        }
        most
    }

    /// The squared distance within which a point meets any other whose radius does not count.
    #[inline(always)]
    fn square(&self, own: u32) -> f64 {
        let radius = self.allowance.added_to(self.radii.of(own));
        radius * radius
    }

    /// The squared distances within which a point meets four others, whose radii are among `others`.
    #[inline(always)]
    fn squares<S: Simd>(&self, s: S, own: u32, others: &[f32], [a, b, c, d]: [u32; WIDTH]) -> S::D {
        let own = self.radii.of(own);
        let [a, b, c, d] = [radius_of(others, a), radius_of(others, b), radius_of(others, c), radius_of(others, d)];
        let radii = self.radii;
        let radii = [radii.of_pair(own, a), radii.of_pair(own, b), radii.of_pair(own, c), radii.of_pair(own, d)];
        let radii = self.allowance.added_to_four(s, &radii);
        radii * radii
    }
}

/// A segment between keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    /// Number of segments.
    count: f64,
    number: f64,
}

impl Segment {
    /// The segment with this number between so many keys.
    pub(super) fn new(keys: usize, number: usize) -> Segment {
        Segment { count: (keys.max(2) - 1) as f64, number: number as f64 }
    }

    /// The times of its keys.
    fn ends(&self) -> [f64; 2] {
        [self.number / self.count, (self.number + 1.0) / self.count]
    }

    /// Whether they have more than a key in common.
    pub(super) fn overlaps(&self, other: &Segment) -> bool {
        let (own, other) = (self.ends(), other.ends());
        own[0].max(other[0]) < own[1].min(other[1])
    }

    /// Where in the segment a time lies, in [0, 1].
    #[inline(always)]
    pub(super) fn phase(&self, time: f64) -> f64 {
        lesser(greater(self.unlimited_phase(time), 0.0), 1.0)
    }

    /// The same along the line through both keys.
    #[inline(always)]
    pub(super) fn unlimited_phase(&self, time: f64) -> f64 {
        time * self.count - self.number
    }

    /// The phases of four times.
    #[inline(always)]
    fn phases<S: Simd>(&self, s: S, times: S::D) -> S::D {
        let phases = times * s.splat_d(self.count) - s.splat_d(self.number);
        s.min_d(s.max_d(phases, s.splat_d(0.0)), s.splat_d(1.0))
    }
}

/// The times during which points are compared: within a segment between keys of either set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// The segments of the points whose encounters are looked for, and of the others.
    segments: [Segment; 2],
    /// First and last time.
    times: [f64; 2],
    /// Encounters that begin from the first of these times to before the second are reported.
    reported: [f64; 2],
    /// A key of one of the sets with which the window ends, if the two have others: a point that begins there counts behind it
    /// only.
    key: f64,
    /// By how much the other points are moved to an image of them.
    pub(super) shift: [f64; 3],
}

/// Points that are evaluated side by side.
pub(super) const WIDTH: usize = 4;

impl Window {
    /// The times of `[begin, end]` that are in both segments.
    pub(super) fn of_segments(segments: [Segment; 2], times: [f64; 2]) -> Window {
        let within = |[begin, end]: [f64; 2], [first, last]: [f64; 2]| [begin.max(first), end.min(last)];
        let times = segments.iter().map(Segment::ends).fold(times, within);
        let key = segments.iter().map(|segment| segment.ends()[1]).fold(1.0, f64::min);
        let key = if key < 1.0 && segments[0] != segments[1] { key } else { f64::INFINITY };
        Window { segments, times, reported: [f64::NEG_INFINITY, f64::INFINITY], key, shift: [0.0; 3] }
    }

    /// The same times, but only encounters that begin in the time slices of both points are reported. A slice contains
    /// its begin and not its end.
    pub(super) fn reported_by(self, [own, other]: [[f64; 2]; 2]) -> Window {
        Window { reported: [own[0].max(other[0]), own[1].min(other[1])], ..self }
    }

    /// The same with an image of the other points.
    pub(super) fn at_image(self, shift: [f64; 3]) -> Window {
        Window { shift, ..self }
    }

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
            let ids = [four.points[0].id, four.points[1].id, four.points[2].id, four.points[3].id];
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

/// The encounters of a point with four others.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncounterLanes {
    enter: [f32; WIDTH],
    leave: [f32; WIDTH],
    closest: [f32; WIDTH],
    distance_squared: [f32; WIDTH],
    /// Lanes with an encounter.
    valid: Mask,
}

impl EncounterLanes {
    /// Writes the encounters one behind the other; their number.
    #[inline(always)]
    pub(super) fn write<C>(&self, others: &FourPoints<C>, to: &mut [Encounter; WIDTH]) -> usize {
        let mut count = 0;
        for lane in 0..WIDTH {
            to[count % WIDTH] = Encounter {
                id: others.points[lane].id,
                enter: self.enter[lane],
                leave: self.leave[lane],
                closest: self.closest[lane],
                distance_squared: self.distance_squared[lane],
            };
            count += usize::from(self.valid >> lane & 1);
        }
        count
    }

    /// When each of the others that is met comes within the radius: lanes and times.
    #[inline(always)]
    pub(super) fn entering(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        (0..WIDTH).filter(|&lane| self.valid >> lane & 1 != 0).map(|lane| (lane, self.enter[lane]))
    }
}

/// A point that may be met, between two keys.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct PointKeys<C> {
    /// Where it is at both keys.
    keys: [C; 6],
    id: u32,
}

/// Points that may be met.
#[derive(Default)]
pub(super) struct CandidatePoints<C> {
    points: Vec<PointKeys<C>>,
    /// Begin and end bound of their active intervals; empty if all points exist throughout.
    active: Vec<[f32; 2]>,
}

impl<C: SweptCoordinate> CandidatePoints<C> {
    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.active.clear();
    }

    /// Appends sixteen points; unless `has_active_intervals`, they exist throughout.
    #[inline(always)]
    pub(super) fn push(&mut self, points: &PathRows<C>, has_active_intervals: bool) {
        let PathRows { open: [x, y, z], close: [u, v, w], begin, end, id } = points;
        let keys = |i: usize| PointKeys { keys: [x[i], y[i], z[i], u[i], v[i], w[i]], id: id[i] };
        let all: [PointKeys<C>; LANES] = core::array::from_fn(keys);
        self.points.extend_from_slice(&all);
        if has_active_intervals {
            self.active.extend((0..LANES).map(|i| [begin[i], end[i]]));
        }
    }

    /// Four of them.
    #[inline(always)]
    fn four(&self, at: [u32; WIDTH]) -> FourPoints<'_, C> {
        let [a, b, c, d] = at;
        let point = |i: u32| &self.points[i as usize];
        FourPoints { points: [point(a), point(b), point(c), point(d)], others: self, at }
    }
}

/// Four candidate points.
pub(super) struct FourPoints<'a, C> {
    points: [&'a PointKeys<C>; WIDTH],
    others: &'a CandidatePoints<C>,
    at: [u32; WIDTH],
}

impl<C: SweptCoordinate> FourPoints<'_, C> {
    /// Where they are at both keys.
    #[inline(always)]
    fn ends<S: Simd>(&self, s: S) -> [[S::D; 3]; 2] {
        let [a, b, c, d] = &self.points;
        let (a, b, c, d) = (&a.keys, &b.keys, &c.keys, &d.keys);
        let [x, y, z, u] = s.transpose_d([
            C::load_four(s, &[a[0], a[1], a[2], a[3]]),
            C::load_four(s, &[b[0], b[1], b[2], b[3]]),
            C::load_four(s, &[c[0], c[1], c[2], c[3]]),
            C::load_four(s, &[d[0], d[1], d[2], d[3]]),
        ]);
        let [_, _, v, w] = s.transpose_d([
            C::load_four(s, &[a[2], a[3], a[4], a[5]]),
            C::load_four(s, &[b[2], b[3], b[4], b[5]]),
            C::load_four(s, &[c[2], c[3], c[4], c[5]]),
            C::load_four(s, &[d[2], d[3], d[4], d[5]]),
        ]);
        [[x, y, z], [u, v, w]]
    }

    /// Begins and end bounds of their active intervals.
    #[inline(always)]
    fn active(&self) -> [[f32; WIDTH]; 2] {
        let (mut begins, mut ends) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (lane, &i) in self.at.iter().enumerate() {
            [begins[lane], ends[lane]] = self.others.active[i as usize];
        }
        [begins, ends]
    }

    /// One of the points.
    pub(super) fn point_path(&self, lane: usize) -> PointPath {
        let PointKeys { keys: [x, y, z, u, v, w], id } = *self.points[lane];
        let active = self.others.active.get(self.at[lane] as usize);
        let active = active.and_then(|&[begin, end]| TimeInterval::half_open(begin, end)).unwrap_or(TimeInterval::FULL);
        PointPath { id, open: [x, y, z].map(C::into), close: [u, v, w].map(C::into), active }
    }
}

#[inline(always)]
fn dot<S: Simd>(a: [S::D; 3], b: [S::D; 3]) -> S::D {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}
