//! Blocks of points on their ways, and the walk of a group of them through a tree.

use super::encounter::{Window, at};
use crate::point::lists::gather::{BoxRows, BoxVector, Picks};
use crate::point::moving_tree::{MovingTree, MovingView};
use crate::point::over_interval::{Boxed, Flight};
use crate::point::snapshot::{View, rows, squared};
use crate::point::static_tree::StaticTree;
use crate::simd::{LANES, Lanes, Mask, Simd};
use glam::Vec3;

/// 2^-24.
const ROUNDING: f64 = 1.0 / 16_777_216.0;

/// A tree with the faces of its boxes at both ends of a range of times.
pub(super) trait Swept: Boxed + Sync {
    /// The tree at a time, with the faces of all boxes, whether what is in them counts then or not.
    type View<'a>: View
    where
        Self: 'a;
    fn view(&self, time: f32) -> Self::View<'_>;
}

impl Swept for StaticTree {
    type View<'a> = &'a StaticTree;
    fn view(&self, _time: f32) -> &StaticTree {
        self
    }
}

impl Swept for MovingTree {
    type View<'a> = MovingView<'a, false>;
    fn view(&self, time: f32) -> MovingView<'_, false> {
        self.at(time)
    }
}

/// Sixteen points on their ways, and where they are at both ends of a range of times, drift taken off; the first
/// coordinate is infinite where there is none.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) flights: Vec<Option<Flight>>,
    ends: [[Lanes<f32>; 3]; 2],
    lo: [f32; 3],
    hi: [f32; 3],
    magnitude: f64,
}

impl Block {
    /// The points of a block of a tree between two phases of their segment.
    fn new<T: Boxed>(tree: &T, block: usize, phases: [f64; 2], drift: [f64; 3]) -> Block {
        let mut ends = [[[f32::INFINITY; LANES]; 3]; 2];
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut magnitude = drift.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let flights: Vec<Option<Flight>> = (0..LANES).map(|lane| tree.flight(block, lane)).collect();
        for (lane, flight) in flights.iter().enumerate() {
            let Some(flight) = flight else { continue };
            for axis in 0..3 {
                let place = [at(flight, axis, phases[0]), at(flight, axis, phases[1])];
                magnitude = magnitude.max(place[0].abs()).max(place[1].abs());
                for (end, x) in ends.iter_mut().zip([place[0], place[1] - drift[axis]]) {
                    let x = x as f32;
                    end[axis][lane] = x;
                    (lo[axis], hi[axis]) = (lo[axis].min(x), hi[axis].max(x));
                }
            }
        }
        Block { flights, ends, lo, hi, magnitude }
    }
}

/// The blocks behind a bottom node, and what is common to their motion.
pub(super) struct Group {
    pub(super) blocks: Vec<Block>,
    /// Times between which boxes are swept.
    times: [f32; 2],
    drift: [f32; 3],
    lo: [f32; 3],
    hi: [f32; 3],
    magnitude: f64,
}

impl Group {
    /// The points behind bottom node `node` during a range of times within the tree's own.
    pub(super) fn new<T: Boxed>(tree: &T, node: usize, times: [f32; 2]) -> Group {
        let (keys, segment, _) = tree.part();
        let window = Window { keys, segment, times: times.map(f64::from) };
        let phases = window.times.map(|time| window.phase(time));
        let (first, stride) = tree.behind(0, node);
        let present = tree.times(node)[0].map(|begin| begin < f64::INFINITY);
        let numbers = (0..LANES).filter(|&lane| present[lane]).flat_map(|lane| {
            let begin = first + lane * stride;
            begin..begin + stride
        });
        let numbers: Vec<usize> = numbers.collect();
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for flight in numbers.iter().flat_map(|&block| (0..LANES).filter_map(move |lane| tree.flight(block, lane))) {
            for (axis, sum) in sum.iter_mut().enumerate() {
                *sum += at(&flight, axis, phases[1]) - at(&flight, axis, phases[0]);
            }
            count += 1.0;
        }
        let drift = if count > 0.0 { sum.map(|x| (x / count) as f32) } else { [0.0; 3] };
        let block = |&number: &usize| Block::new(tree, number, phases, drift.map(f64::from));
        let blocks: Vec<Block> = numbers.iter().map(block).collect();
        let mut group = Group {
            blocks: Vec::new(),
            times,
            drift,
            lo: [f32::INFINITY; 3],
            hi: [f32::NEG_INFINITY; 3],
            magnitude: 0.0,
        };
        for block in &blocks {
            for axis in 0..3 {
                group.lo[axis] = group.lo[axis].min(block.lo[axis]);
                group.hi[axis] = group.hi[axis].max(block.hi[axis]);
            }
            group.magnitude = group.magnitude.max(block.magnitude);
        }
        group.blocks = blocks;
        group
    }

    /// The boxes of a node, swept, with the group's drift taken off.
    #[inline(always)]
    fn swept<S: Simd, V: View>(&self, s: S, [early, late]: &[V; 2], node: usize) -> (BoxVector<S>, Mask) {
        let (mut lo, mut hi) = early.faces(s, &early.target(s, Vec3::ZERO), node);
        let (late_lo, late_hi) = late.faces(s, &late.target(s, Vec3::ZERO), node);
        let present = s.lt(lo[0], s.splat(f32::INFINITY));
        for axis in 0..3 {
            let drift = s.splat(self.drift[axis]);
            let zero = s.splat(0.0);
            let most = s.max(
                s.max(s.max(lo[axis], zero - lo[axis]), s.max(hi[axis], zero - hi[axis])),
                s.max(s.max(late_lo[axis], zero - late_lo[axis]), s.max(late_hi[axis], zero - late_hi[axis])),
            );
            let slack = (most + s.splat(self.magnitude as f32)) * s.splat((64.0 * ROUNDING) as f32);
            lo[axis] = s.min(lo[axis], late_lo[axis] - drift) - slack;
            hi[axis] = s.max(hi[axis], late_hi[axis] - drift) + slack;
        }
        (BoxVector { lo, hi, reach: s.splat(0.0), candidate: s.splat_u(0) }, present)
    }
}

/// What a group can meet.
#[derive(Default)]
pub(super) struct Partners {
    boxes: BoxRows,
    blocks: Vec<(Block, Window)>,
}

impl Partners {
    pub(super) fn clear(&mut self) {
        self.boxes.clear();
        self.blocks.clear();
    }

    /// Adds the blocks of a tree that the group can meet during `window`, as near as `bound`, a squared distance.
    #[inline(always)]
    pub(super) fn add<S: Simd, T: Swept>(&mut self, s: S, tree: &T, group: &Group, window: Window, bound: f32) {
        let views = group.times.map(|time| tree.view(time));
        let phases = {
            // Positions over what the group's times and the segment have in common.
            let whole = Window::of_segment(window.keys, window.segment, group.times.map(f64::from));
            whole.times.map(|time| whole.phase(time))
        };
        // Where nothing moves, any phases will do.
        let drift = group.drift.map(f64::from);
        let mut open = vec![tree.top()];
        while let Some((level, node)) = open.pop() {
            let (boxes, present) = group.swept(s, &views, node);
            let mut near = boxes.near(s, group.lo, group.hi, bound) & present;
            let (first, stride) = tree.behind(level, node);
            if level > 0 {
                while near != 0 {
                    open.push((level - 1, first + near.trailing_zeros() as usize));
                    near &= near - 1;
                }
                continue;
            }
            for part in 0..stride {
                let mut number = [0; LANES];
                for lane in (0..LANES).filter(|lane| near >> lane & 1 != 0) {
                    number[lane] = self.blocks.len() as u32;
                    let block = Block::new(tree, first + lane * stride + part, phases, drift);
                    self.blocks.push((block, window));
                }
                self.boxes.push(s, &BoxVector { candidate: s.load_u(&number), ..boxes }, near);
            }
        }
    }

    /// Calls `meet` for each point that may come within `radius` of the point in `lane` of a block of the group, and
    /// possibly for some that do not.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        s: S,
        (group, block, lane): (&Group, &Block, usize),
        radius: f64,
        picks: &mut Picks,
        mut meet: impl FnMut(&Flight, &Window),
    ) {
        let [from, to] = block.ends.map(|rows| rows.map(|row| row[lane]));
        let lo = core::array::from_fn(|axis| from[axis].min(to[axis]));
        let hi = core::array::from_fn(|axis| from[axis].max(to[axis]));
        let bound = (radius * radius).min(f32::MAX.into()) as f32;
        for &pick in picks.near(s, &self.boxes, (lo, hi), bound) {
            let (partner, window) = &self.blocks[pick as usize];
            let slack = 64.0 * ROUNDING * (partner.magnitude + group.magnitude);
            let square = (radius + slack) * (radius + slack) * (1.0 + 1e-6) + 1e-35;
            let bound = square.min(f32::MAX.into()) as f32;
            let mut hits = passing(s, partner, from, to, bound);
            while hits != 0 {
                let lane = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                if let Some(flight) = &partner.flights[lane] {
                    meet(flight, window);
                }
            }
        }
    }
}

/// Points of a block that come as near as `bound` to one that goes from `from` to `to`.
#[inline(always)]
fn passing<S: Simd>(s: S, block: &Block, from: [f32; 3], to: [f32; 3], bound: f32) -> Mask {
    let (first, last) = (rows(s, &block.ends[0]), rows(s, &block.ends[1]));
    let (x, y, z) = (first[0] - s.splat(from[0]), first[1] - s.splat(from[1]), first[2] - s.splat(from[2]));
    let u = (last[0] - s.splat(to[0])) - x;
    let v = (last[1] - s.splat(to[1])) - y;
    let w = (last[2] - s.splat(to[2])) - z;
    let speed = s.max(squared::<S>(u, v, w), s.splat(f32::MIN_POSITIVE));
    let approach = s.splat(0.0) - ((x * u + y * v) + z * w);
    let time = s.max(s.min(approach / speed, s.splat(1.0)), s.splat(0.0));
    s.le(squared::<S>(x + u * time, y + v * time, z + w * time), s.splat(bound))
}
