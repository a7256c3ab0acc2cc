//! The points of a group of leaves, whose encounters are looked for together, and boxes swept as they see them.

use super::coordinate::SweptCoordinate;
use super::criteria::Criteria;
use super::window::Segment;
use crate::point::layout::over_interval::{BlockTree, BoxTree, PathRows, active_lanes, greater, lesser};
use crate::point::layout::view::rows;
use crate::point::lists::candidates::BoxVector;
use crate::simd::{Kernel, LANES, Lanes, Simd};

/// 2^-24.
const ROUNDING: f64 = 1.0 / 16_777_216.0;

/// How much wider than what is compared boxes are made, in units of the magnitude of coordinates: see [`super`].
pub(super) const SLACK: f64 = 64.0 * ROUNDING;

/// The phases of two times in a tree's segment. They are widened by what a time near a key, rounded to f32, may lie on
/// the wrong side of it, also beyond the keys: the range of times is the same for all trees that are compared.
pub(super) fn phases<T: BoxTree>(tree: &T, times: [f32; 2]) -> [f64; 2] {
    let slice = tree.slice();
    let segment = Segment::new(slice.keys, slice.segment);
    let [begin, end] = times.map(f64::from);
    [segment.unlimited_phase(begin - ROUNDING), segment.unlimited_phase(end + ROUNDING)]
}

/// The share of a range of phases that lies before a time.
pub(super) fn early<T: BoxTree>(tree: &T, [first, last]: [f64; 2], time: f32) -> f64 {
    let slice = tree.slice();
    let phase = Segment::new(slice.keys, slice.segment).phase(time.into());
    if last > first { (phase - first) / (last - first) } else { 0.0 }
}

/// What positions are relative to: a place, and a displacement during the range of times, which is taken off everything.
#[derive(Clone, Copy, Default)]
pub(super) struct Frame {
    /// Zero for f32, except of images.
    center: [f64; 3],
    drift: [f64; 3],
}

impl Frame {
    /// The frame in which things are where their images are in this one.
    #[inline(always)]
    pub(super) fn of_image(self, shift: [f64; 3]) -> Frame {
        let [x, y, z] = self.center;
        Frame { center: [x - shift[0], y - shift[1], z - shift[2]], ..self }
    }
}

/// The motion of sixteen points during a range of times relative to the group's [`Frame`], in rows. Without a
/// point, the start is infinite.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct RelativePaths {
    pub(super) start: [Lanes<f32>; 3],
    pub(super) displacement: [Lanes<f32>; 3],
}

impl RelativePaths {
    /// The motion of points between two phases of their segment.
    #[inline(always)]
    pub(super) fn new<C: SweptCoordinate>(points: &PathRows<C>, phases: [f64; 2], frame: &Frame) -> RelativePaths {
        let mut paths = RelativePaths { start: [[f32::INFINITY; LANES]; 3], displacement: [[0.0; LANES]; 3] };
        for axis in 0..3 {
            let (center, drift) = (frame.center[axis], frame.drift[axis]);
            for lane in 0..LANES {
                let open: f64 = points.open[axis][lane].into();
                let displacement = points.close[axis][lane].into() - open;
                let (first, last) = (open + displacement * phases[0], open + displacement * phases[1]);
                let from = (first - center) as f32;
                let to = ((last - center) - drift) as f32;
                let exists = points.id[lane] != u32::MAX;
                paths.start[axis][lane] = if exists { from } else { f32::INFINITY };
                paths.displacement[axis][lane] = if exists { to - from } else { 0.0 };
            }
        }
        paths
    }

    /// The largest magnitude of a coordinate.
    pub(super) fn magnitude(&self) -> f64 {
        let mut most = 0.0;
        for axis in 0..3 {
            for (&from, &displacement) in self.start[axis].iter().zip(&self.displacement[axis]) {
                let ends = from.abs().max((from + displacement).abs());
                most = if ends < f32::INFINITY && ends > most { ends } else { most };
            }
        }
        most.into()
    }
}

/// Sixteen points whose encounters are looked for.
#[derive(Clone, Debug)]
pub(super) struct Block<C> {
    pub(super) points: PathRows<C>,
    pub(super) paths: RelativePaths,
    /// The box around their paths.
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    magnitude: f64,
}

impl<C: SweptCoordinate> Block<C> {
    #[inline(always)]
    fn new(points: PathRows<C>, phases: [f64; 2], frame: &Frame) -> Block<C> {
        let (paths, drift) = (RelativePaths::new(&points, phases, frame), frame.drift);
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut magnitude = drift.iter().fold(0.0f64, |most, x| greater(most, x.abs()));
        for axis in 0..3 {
            for lane in (0..LANES).filter(|&lane| points.id[lane] != u32::MAX) {
                let from = paths.start[axis][lane];
                for x in [from, from + paths.displacement[axis][lane]] {
                    (lo[axis], hi[axis]) = (lo[axis].min(x), hi[axis].max(x));
                    // Drift and rounding come on top of what it is.
                    magnitude = greater(magnitude, f64::from(x.abs()) + drift[axis].abs());
                }
            }
        }
        Block { points, paths, lo, hi, magnitude }
    }

    /// The box around the path of a point.
    fn path_box(&self, lane: usize) -> ([f32; 3], [f32; 3]) {
        let ends = |axis: usize| {
            let from = self.paths.start[axis][lane];
            (from, from + self.paths.displacement[axis][lane])
        };
        let lo = core::array::from_fn(|axis| ends(axis).0.min(ends(axis).1));
        (lo, core::array::from_fn(|axis| ends(axis).0.max(ends(axis).1)))
    }
}

/// The median of the means of lanes, of those that have something; zero if none has. Unlike the mean of all, it is that of most
/// points where a few are much faster.
fn median_of_means(sum: Lanes<f64>, count: Lanes<f64>) -> f64 {
    let (mut means, mut lanes) = ([0.0; LANES], 0);
    for (sum, count) in sum.into_iter().zip(count).filter(|&(_, count)| count > 0.0) {
        means[lanes] = sum / count;
        lanes += 1;
    }
    let means = &mut means[..lanes];
    means.sort_unstable_by(f64::total_cmp);
    means.get(lanes / 2).copied().unwrap_or(0.0)
}

/// The blocks below a bottom node, and the displacement of most of their points, which is subtracted from all positions.
#[derive(Default)]
pub(super) struct SweptGroup<C> {
    pub(super) blocks: Vec<Block<C>>,
    /// The times between which boxes are swept.
    pub(super) times: [f32; 2],
    /// The same as phases of the points' segment.
    phases: [f64; 2],
    /// The share of the range of phases that lies before the first time.
    pub(super) early: f64,
    pub(super) frame: Frame,
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    pub(super) magnitude: f64,
    /// Its share of the slack.
    pub(super) slack: f64,
}

/// Takes the points below bottom node `node` that are active during a range of times within the tree's own. The slack is wider
/// by [`SweptCoordinate::excess`].
pub(super) struct TakeGroup<'a, T: BlockTree> {
    pub(super) group: &'a mut SweptGroup<T::Coordinate>,
    pub(super) tree: &'a T,
    pub(super) node: usize,
    pub(super) times: [f32; 2],
    pub(super) excess: f64,
}

impl<C: SweptCoordinate, T: BlockTree<Coordinate = C>> Kernel for TakeGroup<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let TakeGroup { group, tree, node, times, excess } = self;
        let phases = phases(tree, times);
        let (first, stride) = tree.shape().children(0, node);
        let active = active_lanes(tree, node, times);
        let lanes = (0..LANES).filter(|lane| active >> lane & 1 != 0);
        let numbers = lanes.flat_map(|lane| first + lane * stride..first + (lane + 1) * stride);
        let (mut sum, mut count) = ([[0.0; LANES]; 3], [0.0; LANES]);
        for block in numbers.clone() {
            let points = tree.rows(block);
            for lane in 0..LANES {
                let exists = points.id[lane] != u32::MAX;
                count[lane] += if exists { 1.0 } else { 0.0 };
                for (axis, sum) in sum.iter_mut().enumerate() {
                    let displacement = C::displacement(points.open[axis][lane], points.close[axis][lane]);
                    sum[lane] += if exists { displacement } else { 0.0 };
                }
            }
        }
        let drift = sum.map(|sum| median_of_means(sum, count) * (phases[1] - phases[0]));
        group.frame = Frame { center: tree.center(node, phases[0]), drift };
        (group.times, group.phases, group.early) = (times, phases, early(tree, phases, times[0]));
        group.blocks.clear();
        (group.lo, group.hi, group.magnitude) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0.0);
        for number in numbers {
            let block = Block::new(tree.rows(number), phases, &group.frame);
            for axis in 0..3 {
                (group.lo[axis], group.hi[axis]) =
                    (group.lo[axis].min(block.lo[axis]), group.hi[axis].max(block.hi[axis]));
            }
            group.magnitude = greater(group.magnitude, block.magnitude);
            group.blocks.push(block);
        }
        group.slack = group.magnitude * SLACK + excess;
    }
}

impl<C: SweptCoordinate> SweptGroup<C> {
    /// Whether the points are scattered, as [`crate::point::lists::group::Group::is_scattered`] has it, with the boxes around paths
    /// in place of points. `reach` is the largest radius of points that are listed.
    pub(super) fn is_scattered(&self, criteria: &Criteria<'_>, reach: f32) -> bool {
        let volume = |lo: [f32; 3], hi: [f32; 3], radius: f64| -> f64 {
            (0..3).map(|axis| f64::from(hi[axis]) - f64::from(lo[axis]) + 2.0 * radius).product()
        };
        let (mut count, mut boxes, mut most) = (0, 0.0, 0.0);
        for block in &self.blocks {
            for lane in (0..LANES).filter(|&lane| block.points.id[lane] != u32::MAX) {
                let (lo, hi) = block.path_box(lane);
                let radius = criteria.longest(criteria.radii.of(block.points.id[lane]), reach);
                most = greater(most, radius);
                (count, boxes) = (count + 1, boxes + volume(lo, hi, radius));
            }
        }
        count > 1 && volume(self.lo, self.hi, most) > 2.0 * boxes
    }

    /// Whether most points are so near to each other that, at the slack of the group, they pass the test in f32 whether they meet
    /// or not: in most blocks, by volume, each another one. A few that are far from the others make it so: what is measured from a
    /// place is as coarse as the farthest is far. `reach` is as above.
    pub(super) fn is_coarse(&self, criteria: &Criteria<'_>, reach: f32) -> bool {
        let dense = |block: &&Block<C>| {
            let width = |axis: usize| f64::from(block.hi[axis]) - f64::from(block.lo[axis]);
            let near: f64 = (0..3).map(|axis| (self.slack / width(axis)).min(1.0)).product();
            near * LANES as f64 >= 1.0
        };
        self.slack > criteria.longest(criteria.own, reach)
            && 2 * self.blocks.iter().filter(dense).count() > self.blocks.len()
    }

    /// Becomes a group of one point, of a block of another group; `false` where that has none in the lane. Everything is measured
    /// from the point and relative to its motion. The slack is wider by [`SweptCoordinate::excess`]: one for all, and that of a
    /// point.
    pub(super) fn take_one(
        &mut self,
        of: &SweptGroup<C>,
        (block, lane): (usize, usize),
        excess: f64,
        own_excess: impl Fn(&PathRows<C>) -> f64,
    ) -> bool {
        let mut points = of.blocks[block].points;
        if points.id[lane] == u32::MAX {
            return false;
        }
        for other in (0..LANES).filter(|&other| other != lane) {
            points.id[other] = u32::MAX;
        }
        let displacement = points.open.iter().zip(&points.close).map(|(a, b)| C::displacement(a[lane], b[lane]));
        for (axis, displacement) in displacement.enumerate() {
            let first: f64 = points.open[axis][lane].into() + displacement * of.phases[0];
            self.frame.center[axis] = C::center(first);
            self.frame.drift[axis] = displacement * (of.phases[1] - of.phases[0]);
        }
        (self.times, self.phases, self.early) = (of.times, of.phases, of.early);
        let alone = Block::new(points, of.phases, &self.frame);
        (self.lo, self.hi, self.magnitude) = (alone.lo, alone.hi, alone.magnitude);
        self.slack = self.magnitude * SLACK + excess + own_excess(&alone.points);
        self.blocks.clear();
        self.blocks.push(alone);
        true
    }

    /// The boxes of a node, swept between two phases, in the group's frame or an image of it, and the magnitudes of what is in
    /// them. Each is wider by the excess of what is in it.
    #[inline(always)]
    pub(super) fn swept<S: Simd, T: BoxTree>(
        &self,
        s: S,
        tree: &T,
        frame: &Frame,
        phases: [f64; 2],
        (node, excess): (usize, &Lanes<f32>),
    ) -> (BoxVector<S>, Lanes<f64>) {
        let [begin, end] = [tree.faces(node, &[phases[0]; LANES]), tree.faces(node, &[phases[1]; LANES])];
        let (mut lo, mut hi, mut magnitude) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3], [0.0; LANES]);
        for axis in 0..3 {
            let (center, drift) = (frame.center[axis], frame.drift[axis]);
            for lane in 0..LANES {
                let (begin, end) =
                    ([begin[0][axis][lane], begin[1][axis][lane]], [end[0][axis][lane], end[1][axis][lane]]);
                let first = [begin[0] - center, begin[1] - center];
                let last = [end[0] - center, end[1] - center];
                let most = greater(greater(first[0].abs(), first[1].abs()), greater(last[0].abs(), last[1].abs()));
                // Faces and positions may be much smaller than at a key; see `super` for why that needs nothing more.
                let mut slack = most * SLACK + self.slack;
                if C::OF_MAGNITUDE > 0.0 {
                    slack += f64::from(excess[lane]);
                }
                magnitude[lane] = greater(magnitude[lane], most);
                lo[axis][lane] = (lesser(first[0], last[0] - drift) - slack) as f32;
                hi[axis][lane] = (greater(first[1], last[1] - drift) + slack) as f32;
            }
        }
        let (lo, hi) = (rows(s, &lo), rows(s, &hi));
        (BoxVector { lo, hi, reach: s.splat(0.0), candidate: s.splat_u(0) }, magnitude)
    }

    /// The box around all of a tree, swept, in the group's frame; infinite and reversed if nothing exists then.
    #[inline(always)]
    pub(super) fn swept_root<S: Simd, T: BoxTree>(&self, s: S, tree: &T, excess: &Lanes<f32>) -> ([f32; 3], [f32; 3]) {
        let root = tree.shape().root().1;
        let (boxes, _) = self.swept(s, tree, &self.frame, phases(tree, self.times), (root, excess));
        let active = active_lanes(tree, root, self.times);
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let (mut lower, mut upper) = ([0.0; LANES], [0.0; LANES]);
        for axis in 0..3 {
            s.store(boxes.lo[axis], &mut lower);
            s.store(boxes.hi[axis], &mut upper);
            for lane in (0..LANES).filter(|lane| active >> lane & 1 != 0) {
                (lo[axis], hi[axis]) = (lo[axis].min(lower[lane]), hi[axis].max(upper[lane]));
            }
        }
        (lo, hi)
    }
}
