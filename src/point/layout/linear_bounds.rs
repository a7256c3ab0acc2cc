//! Boxes that move linearly, padded so that rounding never puts a point outside.
//!
//! A face of a moving box is a line over the phase s in [0, 1] between two keys. For a lower face a
//! slope is chosen first and rounded to f32; then the line is lowered until it is below every point
//! (or child face) at both ends of that one's own range. Both are linear, so it is below in between too.
//! Two slopes are tried and the tighter line at mid-range is taken: the mean of what is inside, and the
//! slope between the extremes at both ends.
//!
//! **Padding.** Let u = 2^-24. A point that moves from a to b is computed as `base + (b − a)·s` with |s| ≤ 1/2: the
//! difference is rounded by at most |b − a|u and then halved at least, the product by |b − a|u/2, the sum, which lies
//! between a and b, by max(|a|, |b|)u: together e = (|b − a| + max(|a|, |b|))u ([`LinearBox::of_points`]). A face is computed
//! as `a + b·s` with s in [0, 1]: the product is rounded by |b|u, the sum by (|a| + |b|)u: together f = (|a| + 2|b|)u.
//! A lower face stays below its points by e of each and below that by its own f; around other faces, by its own f
//! only: it is below their exact lines.
//!
//! Where all points of a leaf have the same phases, which is the rule, the build places them in f32 too, as `a + (b − a)·s`: the
//! difference, s and the product are rounded by |b − a|u at most, the sum by max(|a|, |b|)u. With e, that is (2|b − a| + max(|a|,
//! |b|))·2u, of which the largest in the leaf counts ([`LinearBox::throughout`]).
//!
//! All bounds are raised by 2^-10 of themselves, which covers the rounding of the bounds and of f64 in the build, and by 2^-148 for
//! products that underflow. They hold per axis, and depend on the contents of the box: a distant point pads the boxes that hold it
//! and no others.

use super::linear_face::{
    Face, OwnRangesFit, SharedRangeFit, TINY, UNIT, VECTORS, least, load_row, magnitude_d, negated, sum,
};
use super::view::magnitude;
use crate::point::leaf_order::selection::least_lane;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch, greatest_of_each};

/// A box that moves linearly over a range of phases, and its active interval.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct LinearBox {
    pub(super) lo: [Face; 3],
    pub(super) hi: [Face; 3],
    /// First and last phase for which the faces hold.
    range: [f64; 2],
    /// Begin and end bound in time.
    pub(in crate::point) times: [f32; 2],
}

/// Trajectories of sixteen points between two keys, in rows. A lane without a point repeats another one.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct TrajectoryRows {
    pub(in crate::point) open: [Lanes<f32>; 3],
    pub(in crate::point) close: [Lanes<f32>; 3],
    /// First and last phase of each.
    pub(in crate::point) range: [Lanes<f64>; 2],
    /// Begin and end bound in time.
    pub(in crate::point) times: [Lanes<f32>; 2],
    /// Whether all have the same phases.
    pub(in crate::point) whole: bool,
}

impl TrajectoryRows {
    /// Sets the phases and times of a lane.
    #[inline(always)]
    pub(in crate::point) fn set_times(&mut self, lane: usize, range: [f64; 2], times: [f32; 2]) {
        for end in 0..2 {
            self.range[end][lane] = range[end];
            self.times[end][lane] = times[end];
        }
    }

    /// Repeats the last of the lanes that are `used` in the rest.
    #[inline(always)]
    pub(in crate::point) fn complete(&mut self, used: usize) {
        for lane in used..LANES {
            for row in self.open.iter_mut().chain(&mut self.close).chain(&mut self.times) {
                row[lane] = row[used - 1];
            }
            for row in &mut self.range {
                row[lane] = row[used - 1];
            }
        }
    }

    /// Whether all have the same phases.
    #[inline(always)]
    pub(in crate::point) fn same_phases(&self) -> bool {
        let mut same = true;
        for row in &self.range {
            for phase in row {
                same &= *phase == row[0];
            }
        }
        same
    }
}

/// Multiples of the paddings that are applied: 1, except in tests that show that less loses points.
#[derive(Clone, Copy)]
struct Padding {
    point: f64,
    face: f64,
}

const FULL: Padding = Padding { point: 1.0, face: 1.0 };

impl LinearBox {
    /// Around nothing.
    pub(in crate::point) const EMPTY: LinearBox = {
        let face = Face { at_zero: 0.0, slope: 0.0 };
        LinearBox { lo: [face; 3], hi: [face; 3], range: [0.0; 2], times: [0.0; 2] }
    };

    /// The box around points.
    #[inline(always)]
    pub(in crate::point) fn of_points<S: Simd>(s: S, trajectories: &TrajectoryRows) -> LinearBox {
        s.call(BoundPoints { trajectories, padding: FULL })
    }

    #[inline(always)]
    fn padded<S: Simd>(s: S, trajectories: &TrajectoryRows, padding: Padding) -> LinearBox {
        let TrajectoryRows { open, close, range, times, whole } = trajectories;
        if *whole {
            return LinearBox::throughout(s, trajectories, padding);
        }
        let mut spans = Spans { range: *range, times: *times, ..Spans::EMPTY };
        let (unit, tiny) = (s.splat_d(UNIT * padding.point), s.splat_d(TINY * padding.point));
        for axis in 0..3 {
            for four in 0..VECTORS {
                let open = s.widen_four(&open[axis].as_chunks().0[four]);
                let close = s.widen_four(&close[axis].as_chunks().0[four]);
                let motion = close - open;
                let most = s.max_d(magnitude_d(s, open), magnitude_d(s, close));
                let error = unit * (magnitude_d(s, motion) + most) + tiny;
                for (end, phases) in range.iter().enumerate() {
                    let at = open + motion * s.load_d(&phases.as_chunks().0[four]);
                    spans.lo[axis][end].as_chunks_mut().0[four] = s.lanes_d(at - error);
                    spans.hi[axis][end].as_chunks_mut().0[four] = s.lanes_d(at + error);
                }
            }
        }
        spans.linear_box(s, padding.face)
    }

    /// The box around points that all have the same phases: only the extremes at both ends and the mean slope matter, and they are
    /// computed in f32.
    #[inline(always)]
    fn throughout<S: Simd>(s: S, trajectories: &TrajectoryRows, padding: Padding) -> LinearBox {
        let TrajectoryRows { open, close, range, times, .. } = trajectories;
        let (range, zero) = ([range[0][0], range[1][0]], s.splat(0.0));
        let phases = [s.splat(range[0] as f32), s.splat(range[1] as f32)];
        // Of each axis the lowest at both ends, the highest there, and the bound of the rounding, all as greatest lanes.
        let (mut greatest, mut slope) = ([zero; LANES], [0.0; 4]);
        for axis in 0..3 {
            let (from, to) = (s.load(&open[axis]), s.load(&close[axis]));
            let motion = to - from;
            let (far, fast) = (s.max(magnitude(s, from), magnitude(s, to)), magnitude(s, motion));
            let (begin, end) = (from + motion * phases[0], from + motion * phases[1]);
            (greatest[axis], greatest[4 + axis]) = (zero - begin, zero - end);
            (greatest[8 + axis], greatest[12 + axis]) = (begin, end);
            greatest[4 * axis + 3] = fast + fast + far;
            slope[axis] = f64::from(sum_of_lanes(s, motion)) / LANES as f64;
        }
        let mut lanes = [0.0; LANES];
        s.store(greatest_of_each(s, greatest), &mut lanes);
        let [low_begin, low_end, high_begin, high_end] = lanes.as_chunks().0 else { unreachable!("sixteen lanes") };
        let bound = [f64::from(lanes[3]), f64::from(lanes[7]), f64::from(lanes[11]), 0.0];
        let unit = s.splat_d(2.0 * padding.point * UNIT);
        let error = s.load_d(&bound) * unit + s.splat_d(2.0 * padding.point * TINY);
        let least = |greatest: &[f32; 4]| s.splat_d(0.0) - s.widen_four(greatest) - error;
        let slope = s.load_d(&slope);
        let lo = SharedRangeFit { least: [least(low_begin), least(low_end)], range, pad: padding.face };
        let hi = SharedRangeFit { least: [least(high_begin), least(high_end)], range, pad: padding.face };
        let (lo, hi) = (lo.faces(s, slope), above(hi.faces(s, s.splat_d(0.0) - slope)));
        LinearBox { lo, hi, range, times: extreme_times(s, times) }
    }

    /// The box around one to sixteen boxes.
    pub(in crate::point) fn around(boxes: &[LinearBox]) -> LinearBox {
        dispatch(SimdLevel::best(), BoundBoxes(boxes))
    }

    /// The box around one to sixteen boxes, in a kernel.
    #[inline(always)]
    pub(in crate::point) fn of_boxes<S: Simd>(s: S, boxes: &[LinearBox]) -> LinearBox {
        s.call(BoundBoxes(boxes))
    }
}

/// See [`LinearBox::of_points`].
struct BoundPoints<'a> {
    trajectories: &'a TrajectoryRows,
    padding: Padding,
}

impl Kernel for BoundPoints<'_> {
    type Output = LinearBox;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> LinearBox {
        LinearBox::padded(s, self.trajectories, self.padding)
    }
}

/// See [`LinearBox::of_boxes`].
struct BoundBoxes<'a>(&'a [LinearBox]);

impl Kernel for BoundBoxes<'_> {
    type Output = LinearBox;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> LinearBox {
        let BoundBoxes(boxes) = self;
        let mut spans = Spans::EMPTY;
        // Lanes without a box repeat the last one.
        for lane in 0..LANES {
            let linear_box = &boxes[lane.min(boxes.len() - 1)];
            for end in 0..2 {
                spans.range[end][lane] = linear_box.range[end];
                spans.times[end][lane] = linear_box.times[end];
                for axis in 0..3 {
                    spans.lo[axis][end][lane] = linear_box.lo[axis].at(linear_box.range[end]);
                    spans.hi[axis][end][lane] = linear_box.hi[axis].at(linear_box.range[end]);
                }
            }
        }
        spans.whole = true;
        for linear_box in boxes {
            spans.whole &= linear_box.range == boxes[0].range;
        }
        spans.linear_box(s, FULL.face)
    }
}

/// Sixteen spans in rows: limits of the lower and upper faces at both ends of ranges of phases. A lane without one
/// repeats another.
struct Spans {
    lo: [[Lanes<f64>; 2]; 3],
    hi: [[Lanes<f64>; 2]; 3],
    range: [Lanes<f64>; 2],
    times: [Lanes<f32>; 2],
    /// Whether all have the same range.
    whole: bool,
}

impl Spans {
    const EMPTY: Spans = Spans {
        lo: [[[0.0; LANES]; 2]; 3],
        hi: [[[0.0; LANES]; 2]; 3],
        range: [[0.0; LANES]; 2],
        times: [[0.0; LANES]; 2],
        whole: false,
    };

    #[inline(always)]
    fn linear_box<S: Simd>(&self, s: S, pad: f64) -> LinearBox {
        let (begins, ends) = (load_row(s, &self.range[0]), load_row(s, &self.range[1]));
        let range = [least(s, begins), -least(s, negated(s, ends))];
        let mut linear_box = LinearBox { range, times: extreme_times(s, &self.times), ..LinearBox::EMPTY };
        if self.whole {
            linear_box.lo = SharedRangeFit::of_spans(s, &self.lo, false, range, pad);
            linear_box.hi = above(SharedRangeFit::of_spans(s, &self.hi, true, range, pad));
            return linear_box;
        }
        let around = OwnRangesFit { begins, ends, duration: sum(s, ends, begins), pad };
        for axis in 0..3 {
            let [at_begin, at_end] = &self.lo[axis];
            linear_box.lo[axis] = around.below(s, load_row(s, at_begin), load_row(s, at_end));
            let [at_begin, at_end] = &self.hi[axis];
            let below = around.below(s, negated(s, load_row(s, at_begin)), negated(s, load_row(s, at_end)));
            linear_box.hi[axis] = -below;
        }
        linear_box
    }
}

/// The sum of all lanes.
#[inline(always)]
fn sum_of_lanes<S: Simd>(s: S, a: S::F) -> f32 {
    let a = a + s.swap_lanes::<8>(a);
    let a = a + s.swap_lanes::<4>(a);
    let a = a + s.swap_lanes::<2>(a);
    s.lane(a + s.swap_lanes::<1>(a), 0)
}

/// The faces above, given those below what is negated.
#[inline(always)]
fn above(faces: [Face; 3]) -> [Face; 3] {
    let [x, y, z] = faces;
    [-x, -y, -z]
}

/// The first begin and the last end.
#[inline(always)]
fn extreme_times<S: Simd>(s: S, [begins, ends]: &[Lanes<f32>; 2]) -> [f32; 2] {
    [least_lane(s, s.load(begins)), -least_lane(s, s.splat(0.0) - s.load(ends))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::KeyTime;
    use crate::random::Random;
    use glam::Vec3;

    /// Trajectories far from zero, tiny, fast or slow, depending on the round; in some rounds with one distant point.
    fn trajectories(round: usize, random: &mut Random) -> Vec<[Vec3; 2]> {
        let offset = [0.0, 1000.0, -3.0e7, 1e-20, 1e-42][round % 5];
        let size = [1.0, 1e-3, 1e3, 1e-22, 1e-43][round % 5];
        let speed = [0.0, 1e-4, 1.0, 50.0][round / 5 % 4] * size;
        let mut random_vec = |by: f32| random.vec() * by;
        let mut trajectories: Vec<[Vec3; 2]> = (0..64)
            .map(|_| {
                let a = random_vec(size) + offset;
                [a, a + random_vec(speed)]
            })
            .collect();
        if round.is_multiple_of(7) {
            trajectories[13] = [random_vec(1e9 * size), random_vec(1e9 * size)];
        }
        trajectories
    }

    /// A trajectory from point to point, and its phases.
    type Trajectory = ([[f32; 3]; 2], [f64; 2]);

    /// One to sixteen trajectories in rows.
    fn in_rows(trajectories: &[Trajectory]) -> TrajectoryRows {
        let trajectory = |lane: usize| &trajectories[lane.min(trajectories.len() - 1)];
        TrajectoryRows {
            open: core::array::from_fn(|axis| core::array::from_fn(|lane| trajectory(lane).0[0][axis])),
            close: core::array::from_fn(|axis| core::array::from_fn(|lane| trajectory(lane).0[1][axis])),
            range: core::array::from_fn(|end| core::array::from_fn(|lane| trajectory(lane).1[end])),
            times: [[0.0; LANES], [2.0; LANES]],
            whole: trajectories.iter().all(|other| other.1 == trajectories[0].1),
        }
    }

    fn linear_box(trajectories: &[Trajectory]) -> LinearBox {
        dispatch(SimdLevel::best(), BoundPoints { trajectories: &in_rows(trajectories), padding: FULL })
    }

    #[test]
    fn hulls_do_not_depend_on_the_instruction_set() {
        let mut random = Random(7);
        for round in 0..60 {
            let trajectories = trajectories(round, &mut random);
            let begin = |i: usize| if round % 2 == 0 { 0.125 * (i % 4) as f64 } else { 0.25 };
            let trajectory = |(i, trajectory): (usize, &[Vec3; 2])| (trajectory.map(|p| p.to_array()), [begin(i), 1.0]);
            let trajectories =
                in_rows(&trajectories.iter().enumerate().map(trajectory).take(1 + round % LANES).collect::<Vec<_>>());
            let faces = SimdLevel::available().into_iter().map(|level| {
                let linear_box = dispatch(level, BoundPoints { trajectories: &trajectories, padding: FULL });
                [linear_box.lo, linear_box.hi].map(|faces| faces.map(|f| [f.at_zero.to_bits(), f.slope.to_bits()]))
            });
            let faces: Vec<_> = faces.collect();
            assert!(faces.iter().all(|other| *other == faces[0]), "round {round}");
        }
    }

    /// Faces of three levels of boxes and points, both as queries compute them.
    #[test]
    fn no_rounding_lets_a_point_out() {
        let mut random = Random(3);
        for round in 0..300 {
            let trajectories = trajectories(round, &mut random);
            let range = |i: usize| match round % 3 {
                0 => [0.0, 1.0],
                // A phase in between is rounded as well.
                1 => [1.0 / 3.0, 6.0 / 7.0],
                _ => [0.25 * (i % 3) as f64, 1.0],
            };
            let trajectory = |(i, trajectory): (usize, &[Vec3; 2])| (trajectory.map(|p| p.to_array()), range(i));
            let spans: Vec<Trajectory> = trajectories.iter().enumerate().map(trajectory).collect();
            let leaves: Vec<LinearBox> = spans.chunks(8).map(linear_box).collect();
            let nodes: Vec<LinearBox> = leaves.chunks(4).map(LinearBox::around).collect();
            let root = LinearBox::around(&nodes);
            let ends = range(0).map(|phase| phase as f32);
            for time in (0..=40).map(|step| step as f32 / 40.0).chain(ends) {
                let at = KeyTime::new(time, 2);
                let phase = if at.from_end { at.s + 1.0 } else { at.s };
                for (i, trajectory) in trajectories.iter().enumerate() {
                    let [begin, end] = range(i);
                    if !(begin..=end).contains(&f64::from(phase)) {
                        continue;
                    }
                    let p = at.position(trajectory[0], trajectory[1]);
                    for linear_box in [&leaves[i / 8], &nodes[i / 32], &root] {
                        for axis in 0..3 {
                            let face = |f: Face| f.at_zero + f.slope * phase;
                            let (lo, hi) = (face(linear_box.lo[axis]), face(linear_box.hi[axis]));
                            assert!(lo <= p[axis] && p[axis] <= hi, "round {round}, point {i}: {lo} {p} {hi}");
                        }
                    }
                }
            }
        }
    }

    /// How often a point is computed outside of a box that touches it at one end of its range of phases. The other points
    /// of the box give the face a slope that is far from that of the point. Either the point is fast and passes zero
    /// there, and the others are static; or it is static near zero, and they are fast.
    fn lost_where_faces_touch(fast: bool, padding: Padding) -> usize {
        let (mut random, mut lost) = (Random(3), 0);
        for _ in 0..2000 {
            let [r, w, o] = [(); 3].map(|()| 0.5 + 0.45 * random.signed());
            let (trajectory, range) =
                if fast { ([-w * r, w * (1.0 - r)], [r, 1.0]) } else { ([1e-3 * w; 2], [0.0, r]) };
            let other = if fast { [3.0; 2] } else { [0.5 + o, 0.5 + o + w] };
            let span = |trajectory: [f32; 2], range: [f32; 2]| (trajectory.map(|x| [x; 3]), range.map(f64::from));
            let mut spans = [span(other, [0.0, 1.0]); LANES];
            spans[0] = span(trajectory, range);
            let face = dispatch(SimdLevel::best(), BoundPoints { trajectories: &in_rows(&spans), padding }).lo[0];
            let [a, b] = trajectory;
            let p = if r < 0.5 { a + (b - a) * r } else { b + (b - a) * (r - 1.0) };
            lost += usize::from(face.at_zero + face.slope * r > p);
        }
        lost
    }

    #[test]
    fn each_padding_is_needed() {
        for (fast, less) in [(true, Padding { point: 0.0, ..FULL }), (false, Padding { face: 0.0, ..FULL })] {
            assert_eq!(lost_where_faces_touch(fast, FULL), 0);
            assert!(lost_where_faces_touch(fast, less) > 20, "a padding that no point needs; fast {fast}");
        }
    }

    /// A point a million sizes away, in the same leaf or not, pads no axis along which it lies near.
    #[test]
    fn padding_follows_what_is_in_the_box() {
        let mut random = Random(5);
        let mut random_vec = || [random.signed(), random.signed(), random.signed()];
        let mut spans: Vec<Trajectory> = (0..16).map(|_| ([random_vec(), random_vec()], [0.0, 1.0])).collect();
        let width = |linear_box: &LinearBox, axis: usize| linear_box.hi[axis].at(0.5) - linear_box.lo[axis].at(0.5);
        let before = linear_box(&spans);
        spans[3].0 = [[1e6, 0.1, 0.2], [-1e6, 0.2, 0.1]];
        let after = linear_box(&spans);
        for axis in 1..3 {
            assert!(width(&after, axis) < width(&before, axis) + 1e-6, "axis {axis}");
        }
    }

    #[test]
    fn coherent_motion_keeps_hulls_tight() {
        let spans: Vec<Trajectory> = (0..16)
            .map(|i| {
                let x = i as f32 / 16.0;
                ([[x; 3], [x + 5.0; 3]], [0.0, 1.0])
            })
            .collect();
        let linear_box = linear_box(&spans);
        for s in [0.0, 0.5, 1.0] {
            let width = linear_box.hi[0].at(s) - linear_box.lo[0].at(s);
            assert!((0.9375..0.938).contains(&width), "{width} at {s}");
        }
    }
}
