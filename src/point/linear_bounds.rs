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
//! only: it is below their exact lines. Both bounds are raised by 2^-10 of themselves, which covers the f64 rounding of
//! the build, and by 2^-148 for products that underflow. They hold per axis, and depend on the contents of the box: a
//! distant point pads the boxes that hold it and no others.

use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch};

/// Rows of sixteen boxes whose faces are `a + b·s`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct LinearBoxes {
    pub(super) lo: [Lanes<f32>; 3],
    pub(super) lo_slope: [Lanes<f32>; 3],
    pub(super) hi: [Lanes<f32>; 3],
    pub(super) hi_slope: [Lanes<f32>; 3],
}

impl LinearBoxes {
    /// Sixteen absent boxes.
    pub(super) const NONE: LinearBoxes = LinearBoxes {
        lo: [[f32::INFINITY; LANES]; 3],
        lo_slope: [[0.0; LANES]; 3],
        hi: [[f32::NEG_INFINITY; LANES]; 3],
        hi_slope: [[0.0; LANES]; 3],
    };

    /// Lower and upper faces, each lane at a phase of its own.
    #[inline(always)]
    pub(super) fn faces(&self, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, (at, slope)) in faces.iter_mut().zip([(&self.lo, &self.lo_slope), (&self.hi, &self.hi_slope)]) {
            for axis in 0..3 {
                for lane in 0..LANES {
                    faces[axis][lane] = f64::from(at[axis][lane]) + f64::from(slope[axis][lane]) * phase[lane];
                }
            }
        }
        faces
    }

    /// Sets one lane.
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, linear_box: &LinearBox) {
        for axis in 0..3 {
            self.lo[axis][lane] = linear_box.lo[axis].at_zero;
            self.lo_slope[axis][lane] = linear_box.lo[axis].slope;
            self.hi[axis][lane] = linear_box.hi[axis].at_zero;
            self.hi_slope[axis][lane] = linear_box.hi[axis].slope;
        }
    }
}

/// A face: `at_zero + slope·s`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Face {
    at_zero: f32,
    slope: f32,
}

impl Face {
    #[inline(always)]
    fn at(self, s: f64) -> f64 {
        f64::from(self.at_zero) + f64::from(self.slope) * s
    }
}

/// A box that moves linearly over a range of phases, and its active interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinearBox {
    lo: [Face; 3],
    hi: [Face; 3],
    /// First and last phase for which the faces hold.
    range: [f64; 2],
    /// Begin and end bound in time.
    pub(super) times: [f32; 2],
}

/// Trajectories of sixteen points between two keys, in rows. A lane without a point repeats another one.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrajectoryRows {
    pub(super) open: [Lanes<f32>; 3],
    pub(super) close: [Lanes<f32>; 3],
    /// First and last phase of each.
    pub(super) range: [Lanes<f64>; 2],
    /// Begin and end bound in time.
    pub(super) times: [Lanes<f32>; 2],
    /// Whether all have the same phases.
    pub(super) whole: bool,
}

impl TrajectoryRows {
    /// Sets the phases and times of a lane.
    #[inline(always)]
    pub(super) fn set_times(&mut self, lane: usize, range: [f64; 2], times: [f32; 2]) {
        for end in 0..2 {
            self.range[end][lane] = range[end];
            self.times[end][lane] = times[end];
        }
    }

    /// Repeats the last of the lanes that are `used` in the rest.
    #[inline(always)]
    pub(super) fn complete(&mut self, used: usize) {
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
    pub(super) fn same_phases(&self) -> bool {
        let mut same = true;
        for row in &self.range {
            for phase in row {
                same &= *phase == row[0];
            }
        }
        same
    }
}

/// Bound of the relative rounding of one operation, with room for f64 rounding in the build.
pub(super) const UNIT: f64 = (1.0 + 1.0 / 1024.0) / 16_777_216.0;

/// Bound of what underflow adds: twice the least f32.
const TINY: f64 = 2.0 * f32::from_bits(1) as f64;

/// Multiples of the paddings that are applied: 1, except in tests that show that less loses points.
#[derive(Clone, Copy)]
struct Padding {
    point: f64,
    face: f64,
}

const FULL: Padding = Padding { point: 1.0, face: 1.0 };

impl LinearBox {
    /// Around nothing.
    pub(super) const EMPTY: LinearBox = {
        let face = Face { at_zero: 0.0, slope: 0.0 };
        LinearBox { lo: [face; 3], hi: [face; 3], range: [0.0; 2], times: [0.0; 2] }
    };

    /// The box around points.
    #[inline(always)]
    pub(super) fn of_points<S: Simd>(s: S, trajectories: &TrajectoryRows) -> LinearBox {
        LinearBox::padded(s, trajectories, FULL)
    }

    #[inline(always)]
    fn padded<S: Simd>(s: S, trajectories: &TrajectoryRows, padding: Padding) -> LinearBox {
        let TrajectoryRows { open, close, range, times, whole } = trajectories;
        let mut spans = Spans { range: *range, times: *times, whole: *whole, ..Spans::EMPTY };
        let (unit, tiny) = (s.splat_d(UNIT * padding.point), s.splat_d(TINY * padding.point));
        for axis in 0..3 {
            for four in 0..VECTORS {
                let open = s.widen_four(&open[axis].as_chunks().0[four]);
                let close = s.widen_four(&close[axis].as_chunks().0[four]);
                let motion = close - open;
                let error = unit * (magnitude(s, motion) + s.max_d(magnitude(s, open), magnitude(s, close))) + tiny;
                for (end, phases) in range.iter().enumerate() {
                    let at = open + motion * s.load_d(&phases.as_chunks().0[four]);
                    spans.lo[axis][end].as_chunks_mut().0[four] = s.lanes_d(at - error);
                    spans.hi[axis][end].as_chunks_mut().0[four] = s.lanes_d(at + error);
                }
            }
        }
        spans.linear_box(s, padding.face)
    }

    /// The box around one to sixteen boxes.
    pub(super) fn around(boxes: &[LinearBox]) -> LinearBox {
        dispatch(SimdLevel::best(), BoundBoxes(boxes))
    }

    /// The box around one to sixteen boxes, in a kernel.
    #[inline(always)]
    pub(super) fn of_boxes<S: Simd>(s: S, boxes: &[LinearBox]) -> LinearBox {
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

struct BoundBoxes<'a>(&'a [LinearBox]);

impl Kernel for BoundBoxes<'_> {
    type Output = LinearBox;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> LinearBox {
        LinearBox::of_boxes(s, self.0)
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

/// Number of vectors of four f64 in a row.
const VECTORS: usize = LANES / 4;

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
        let mut linear_box = LinearBox { range, times: self.times(), ..LinearBox::EMPTY };
        if self.whole {
            linear_box.lo = FacesFit::below(s, &self.lo, false, range, pad);
            linear_box.hi = FacesFit::below(s, &self.hi, true, range, pad);
            for face in &mut linear_box.hi {
                *face = Face { at_zero: -face.at_zero, slope: -face.slope };
            }
            return linear_box;
        }
        let around = FaceFit { begins, ends, duration: sum(s, ends, begins), pad };
        for axis in 0..3 {
            let [at_begin, at_end] = &self.lo[axis];
            linear_box.lo[axis] = around.below(s, load_row(s, at_begin), load_row(s, at_end));
            let [at_begin, at_end] = &self.hi[axis];
            let above = around.below(s, negated(s, load_row(s, at_begin)), negated(s, load_row(s, at_end)));
            linear_box.hi[axis] = Face { at_zero: -above.at_zero, slope: -above.slope };
        }
        linear_box
    }

    #[inline(always)]
    fn times(&self) -> [f32; 2] {
        let mut times = [f32::INFINITY, f32::NEG_INFINITY];
        for lane in 0..LANES {
            times = [times[0].min(self.times[0][lane]), times[1].max(self.times[1][lane])];
        }
        times
    }
}

/// Sixteen f64.
type Row<S> = [<S as Simd>::D; VECTORS];

#[inline(always)]
fn load_row<S: Simd>(s: S, row: &Lanes<f64>) -> Row<S> {
    let row = row.as_chunks().0;
    [s.load_d(&row[0]), s.load_d(&row[1]), s.load_d(&row[2]), s.load_d(&row[3])]
}

#[inline(always)]
fn negated<S: Simd>(s: S, [a, b, c, d]: Row<S>) -> Row<S> {
    let zero = s.splat_d(0.0);
    [zero - a, zero - b, zero - c, zero - d]
}

#[inline(always)]
fn magnitude<S: Simd>(s: S, a: S::D) -> S::D {
    s.max_d(a, s.splat_d(0.0) - a)
}

/// The least of sixteen.
#[inline(always)]
fn least<S: Simd>(s: S, [a, b, c, d]: Row<S>) -> f64 {
    let [a, b, c, d] = s.lanes_d(s.min_d(s.min_d(a, b), s.min_d(c, d)));
    let [ab, cd] = [if a < b { a } else { b }, if c < d { c } else { d }];
    if ab < cd { ab } else { cd }
}

/// The sum of sixteen differences.
#[inline(always)]
fn sum<S: Simd>(s: S, [a, b, c, d]: Row<S>, [e, f, g, h]: Row<S>) -> f64 {
    let [a, b, c, d] = s.lanes_d(((a - e) + (b - f)) + ((c - g) + (d - h)));
    (a + b) + (c + d)
}

/// Lines along the three axes, in the first three lanes, below sixteen that all have the same range of phases.
///
/// The lowest of those at both ends are all that matters, because rounding keeps the order: subtracting the same number from
/// each and taking the least is taking the least and subtracting.
struct FacesFit<S: Simd> {
    /// The lowest at both ends.
    least: [S::D; 2],
    /// First and last phase.
    range: [f64; 2],
    /// The multiple of the padding.
    pad: f64,
}

impl<S: Simd> FacesFit<S> {
    /// Lines that are computed below all the given ones, which are negated if `above`.
    #[inline(always)]
    fn below(s: S, spans: &[[Lanes<f64>; 2]; 3], above: bool, range: [f64; 2], pad: f64) -> [Face; 3] {
        let zero = s.splat_d(0.0);
        let (mut at_begin, mut at_end, mut rise) = ([zero; 4], [zero; 4], [zero; 4]);
        for axis in 0..3 {
            let (mut begin, mut end) = (load_row(s, &spans[axis][0]), load_row(s, &spans[axis][1]));
            if above {
                (begin, end) = (negated(s, begin), negated(s, end));
            }
            at_begin[axis] = s.min_d(s.min_d(begin[0], begin[1]), s.min_d(begin[2], begin[3]));
            at_end[axis] = s.min_d(s.min_d(end[0], end[1]), s.min_d(end[2], end[3]));
            rise[axis] = ((end[0] - begin[0]) + (end[1] - begin[1])) + ((end[2] - begin[2]) + (end[3] - begin[3]));
        }
        let least = [least_of_each(s, at_begin), least_of_each(s, at_end)];
        let [a, b, c, d] = s.transpose_d(rise);
        let rise = (a + b) + (c + d);
        let length = range[1] - range[0];
        let fit = FacesFit { least, range, pad };
        if length <= 0.0 {
            return fit.lowered(s, zero);
        }
        let mean = fit.lowered(s, rise / s.splat_d(LANES as f64 * length));
        let chord = fit.lowered(s, (least[1] - least[0]) / s.splat_d(length));
        let middle = 0.5 * (range[0] + range[1]);
        let mut faces = mean;
        for axis in 0..3 {
            if chord[axis].at(middle) > mean[axis].at(middle) {
                faces[axis] = chord[axis];
            }
        }
        faces
    }

    /// The highest lines of about these slopes that are computed below all the given ones.
    #[inline(always)]
    fn lowered(&self, s: S, slope: S::D) -> [Face; 3] {
        let slopes = s.narrow(slope);
        let slope = s.widen_four(&slopes);
        let [begin, end] = self.range;
        let least = s.min_d(self.least[0] - slope * s.splat_d(begin), self.least[1] - slope * s.splat_d(end));
        let error = s.splat_d(UNIT) * (magnitude(s, least) + s.splat_d(2.0) * magnitude(s, slope)) + s.splat_d(TINY);
        let exact = least - error * s.splat_d(self.pad);
        let (near, exact) = (s.narrow(exact), s.lanes_d(exact));
        let mut faces = [Face::default(); 3];
        for axis in 0..3 {
            faces[axis] = Face { at_zero: stepped_down(near[axis], exact[axis]), slope: slopes[axis] };
        }
        faces
    }
}

/// The least lane of each vector.
#[inline(always)]
fn least_of_each<S: Simd>(s: S, rows: Row<S>) -> S::D {
    let [a, b, c, d] = s.transpose_d(rows);
    s.min_d(s.min_d(a, b), s.min_d(c, d))
}

/// The inputs that the faces of a box have in common, around spans whose phases differ.
struct FaceFit<S: Simd> {
    /// First and last phase of each span.
    begins: Row<S>,
    ends: Row<S>,
    /// The sum of the lengths of the ranges.
    duration: f64,
    /// The multiple of the padding.
    pad: f64,
}

impl<S: Simd> FaceFit<S> {
    /// The highest line with the mean slope that is computed below all the given ones.
    #[inline(always)]
    fn below(&self, s: S, at_begin: Row<S>, at_end: Row<S>) -> Face {
        let rise = sum(s, at_end, at_begin);
        let slope = (if self.duration > 0.0 { rise / self.duration } else { 0.0 }) as f32;
        let wide = f64::from(slope);
        let (by, mut all) = (s.splat_d(wide), at_begin);
        for four in 0..VECTORS {
            let begin = at_begin[four] - by * self.begins[four];
            all[four] = s.min_d(begin, at_end[four] - by * self.ends[four]);
        }
        let least = least(s, all);
        let error = UNIT * (least.abs() + 2.0 * wide.abs()) + TINY;
        Face { at_zero: rounded_down(least - error * self.pad), slope }
    }
}

/// The greatest f32 at or below a number that is not below all.
#[inline(always)]
pub(super) fn rounded_down(x: f64) -> f32 {
    stepped_down(x as f32, x)
}

/// The same if the nearest f32 is known. Without a branch, because every other one is above.
#[inline(always)]
fn stepped_down(near: f32, x: f64) -> f32 {
    let (bits, step) = (near.to_bits(), u32::from(f64::from(near) > x));
    // Numbers of either sign, and zero, which is followed by the least negative one.
    f32::from_bits(if near > 0.0 { bits - step } else { (bits | step << 31) + step })
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

    fn linear_box(trajectories: &[Trajectory]) -> LinearBox {
        dispatch(SimdLevel::best(), BoundPoints { trajectories: &in_rows(trajectories), padding: FULL })
    }

    #[test]
    fn numbers_are_rounded_down() {
        for near in [0.0, -0.0, 1.0, -1.0, 1.5e-45, -1.5e-45, f32::MIN_POSITIVE, -3e38, 3e38, 2.0, f32::MAX] {
            let wide = f64::from(near);
            assert_eq!(rounded_down(wide), near);
            let below = wide - (wide.abs() * 1e-12).max(1e-60);
            assert_eq!(rounded_down(below), near.next_down());
            let above = wide + (wide.abs() * 1e-12).max(1e-60);
            assert_eq!(rounded_down(above), near);
        }
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
            let range = |i: usize| if round % 3 == 0 { [0.0, 1.0] } else { [0.25 * (i % 3) as f64, 1.0] };
            let trajectory = |(i, trajectory): (usize, &[Vec3; 2])| (trajectory.map(|p| p.to_array()), range(i));
            let spans: Vec<Trajectory> = trajectories.iter().enumerate().map(trajectory).collect();
            let leaves: Vec<LinearBox> = spans.chunks(8).map(linear_box).collect();
            let nodes: Vec<LinearBox> = leaves.chunks(4).map(LinearBox::around).collect();
            let root = LinearBox::around(&nodes);
            for step in 0..=40 {
                let at = KeyTime::new(step as f32 / 40.0, 2);
                let phase = if at.from_end { at.s + 1.0 } else { at.s };
                for (i, trajectory) in trajectories.iter().enumerate() {
                    if f64::from(phase) < range(i)[0] {
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
