//! Blocks of points on their ways, and the walk of a group of them through a tree.

use super::encounter::{Encounter, Others, Window, at, greater, lesser};
use crate::geometry::TimeInterval;
use crate::point::lists::gather::{BoxRows, BoxVector, Picks};
use crate::point::over_interval::{Boxed, Flight};
use crate::point::snapshot::{rows, squared};
use crate::simd::{LANES, Lanes, Mask, Simd};

/// 2^-24.
const ROUNDING: f64 = 1.0 / 16_777_216.0;

/// How much wider than what is compared boxes are made, in units of the magnitude of coordinates: see [`super`].
const SLACK: f64 = 64.0 * ROUNDING;

/// The phases of two times in a tree's segment. They are widened by what a time near a key, rounded to f32, may lie on
/// the wrong side of it.
pub(super) fn phases<T: Boxed>(tree: &T, times: [f32; 2]) -> [f64; 2] {
    let (keys, segment, _) = tree.part();
    let window = Window { keys, segment, times: times.map(f64::from) };
    [window.phase(window.times[0] - ROUNDING), window.phase(window.times[1] + ROUNDING)]
}

/// Sixteen points on their ways, in rows, and where they are at both ends of a range of times, drift taken off; there
/// the first coordinate is infinite where there is none.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Block {
    ends: [[Lanes<f32>; 3]; 2],
    open: [Lanes<f32>; 3],
    close: [Lanes<f32>; 3],
    begin: Lanes<f32>,
    end: Lanes<f32>,
    id: Lanes<u32>,
    lo: [f32; 3],
    hi: [f32; 3],
    magnitude: f64,
}

impl Block {
    /// The points of a block of a tree between two phases of their segment.
    #[inline(always)]
    fn new<T: Boxed>(tree: &T, block: usize, phases: [f64; 2], drift: [f64; 3]) -> Block {
        let row = [0.0; LANES];
        let mut points = Block {
            ends: [[[f32::INFINITY; LANES]; 3]; 2],
            open: [row; 3],
            close: [row; 3],
            begin: row,
            end: row,
            id: [u32::MAX; LANES],
            lo: [f32::INFINITY; 3],
            hi: [f32::NEG_INFINITY; 3],
            magnitude: drift.iter().fold(0.0f64, |most, x| greater(most, x.abs())),
        };
        for lane in 0..LANES {
            let Some(flight) = tree.flight(block, lane) else { continue };
            for axis in 0..3 {
                // Trees of f32 positions only.
                points.open[axis][lane] = flight.open[axis] as f32;
                points.close[axis][lane] = flight.close[axis] as f32;
            }
            (points.begin[lane], points.end[lane]) = (flight.life.begin(), flight.life.end_bound());
            points.id[lane] = flight.id;
        }
        for (axis, drift) in drift.into_iter().enumerate() {
            let (mut lo, mut hi) = (row, row);
            let mut most = [0.0f64; LANES];
            for lane in 0..LANES {
                let there = points.id[lane] != u32::MAX;
                let open = f64::from(points.open[axis][lane]);
                let way = f64::from(points.close[axis][lane]) - open;
                let (first, last) = (open + way * phases[0], open + way * phases[1]);
                most[lane] = greater(first.abs(), last.abs());
                let [first, last] = [first as f32, (last - drift) as f32];
                points.ends[0][axis][lane] = if there { first } else { f32::INFINITY };
                points.ends[1][axis][lane] = if there { last } else { f32::INFINITY };
                lo[lane] = if !there {
                    f32::INFINITY
                } else if first < last {
                    first
                } else {
                    last
                };
                hi[lane] = if !there {
                    f32::NEG_INFINITY
                } else if first > last {
                    first
                } else {
                    last
                };
            }
            points.lo[axis] = lo.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
            points.hi[axis] = hi.into_iter().fold(f32::NEG_INFINITY, |a, b| if b > a { b } else { a });
            points.magnitude = most.into_iter().fold(points.magnitude, greater);
        }
        points
    }

    /// A point of the block.
    pub(super) fn flight(&self, lane: usize) -> Option<Flight> {
        let life = TimeInterval::half_open(self.begin[lane], self.end[lane])?;
        let [open, close] = [self.open, self.close].map(|rows| rows.map(|row| f64::from(row[lane])));
        (self.id[lane] != u32::MAX).then_some(Flight { id: self.id[lane], open, close, life })
    }

    /// Appends the lanes of a mask to others.
    #[inline(always)]
    fn append<S: Simd>(&self, s: S, hits: Mask, others: &mut Others) {
        let at = others.len;
        others.make_room(at + 2 * LANES);
        let Others { open, close, begin, end, id, len } = others;
        let rows = self.open.iter().chain(&self.close).chain([&self.begin, &self.end]);
        for (to, row) in open.iter_mut().chain(close).chain([begin, end]).zip(rows) {
            let to: &mut Lanes<f32> = (&mut to[at..at + LANES]).try_into().expect("sixteen");
            s.store(s.compress(s.load(row), hits), to);
        }
        let to: &mut Lanes<u32> = (&mut id[at..at + LANES]).try_into().expect("sixteen");
        s.store_u(s.compress_u(s.load_u(&self.id), hits), to);
        *len += hits.count_ones() as usize;
    }
}

/// The blocks behind a bottom node, and what is common to their motion.
pub(super) struct Group {
    pub(super) blocks: Vec<Block>,
    /// Times between which boxes are swept.
    times: [f32; 2],
    drift: [f64; 3],
    lo: [f32; 3],
    hi: [f32; 3],
    magnitude: f64,
}

impl Group {
    /// The points behind bottom node `node` that count during a range of times within the tree's own.
    #[inline(always)]
    pub(super) fn new<T: Boxed>(tree: &T, node: usize, times: [f32; 2]) -> Group {
        let phases = phases(tree, times);
        let (first, stride) = tree.behind(0, node);
        let counting = counting(tree, node, times);
        let lanes = (0..LANES).filter(|lane| counting >> lane & 1 != 0);
        let numbers = lanes.flat_map(|lane| first + lane * stride..first + (lane + 1) * stride);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for block in numbers.clone() {
            for flight in (0..LANES).filter_map(|lane| tree.flight(block, lane)) {
                for (axis, sum) in sum.iter_mut().enumerate() {
                    *sum += at(&flight, axis, phases[1]) - at(&flight, axis, phases[0]);
                }
                count += 1.0;
            }
        }
        let drift = if count > 0.0 { sum.map(|x| x / count) } else { [0.0; 3] };
        let blocks: Vec<Block> = numbers.map(|number| Block::new(tree, number, phases, drift)).collect();
        let (mut lo, mut hi, mut magnitude) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0.0f64);
        for block in &blocks {
            for axis in 0..3 {
                (lo[axis], hi[axis]) = (lo[axis].min(block.lo[axis]), hi[axis].max(block.hi[axis]));
            }
            magnitude = magnitude.max(block.magnitude);
        }
        Group { blocks, times, drift, lo, hi, magnitude }
    }

    /// The boxes of a node, swept between two phases, with the group's drift taken off.
    #[inline(always)]
    fn swept<S: Simd, T: Boxed>(&self, s: S, tree: &T, phases: [f64; 2], node: usize) -> BoxVector<S> {
        let ends = phases.map(|phase| tree.faces(node, &[phase; LANES]));
        let key = tree.faces(node, &[0.0; LANES]);
        let (mut lo, mut hi) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for axis in 0..3 {
            for lane in 0..LANES {
                let [first, last] = [0, 1].map(|end| [0, 1].map(|side| ends[end][side][axis][lane]));
                let most = greater(greater(first[0].abs(), first[1].abs()), greater(last[0].abs(), last[1].abs()));
                let at_key = greater(key[0][axis][lane].abs(), key[1][axis][lane].abs());
                // The faces themselves are computed in f64, from what may be much larger than they are.
                let slack = (most + self.magnitude) * SLACK + at_key * 1e-15;
                lo[axis][lane] = (lesser(first[0], last[0] - self.drift[axis]) - slack) as f32;
                hi[axis][lane] = (greater(first[1], last[1] - self.drift[axis]) + slack) as f32;
            }
        }
        let (lo, hi) = (rows(s, &lo), rows(s, &hi));
        BoxVector { lo, hi, reach: s.splat(0.0), candidate: s.splat_u(0) }
    }
}

/// Lanes of a node in which something counts at some time of a range, both ends included.
#[inline(always)]
fn counting<T: Boxed>(tree: &T, node: usize, times: [f32; 2]) -> Mask {
    let [begin, end] = tree.times(node);
    let [first, last] = times.map(f64::from);
    (0..LANES).fold(0, |mask, lane| mask | Mask::from(begin[lane] <= last && first <= end[lane]) << lane)
}

/// A block that a group can meet.
struct Partner {
    block: Block,
    window: Window,
    /// Squared distance up to which the test in f32 leaves a pair to that in f64.
    bound: f32,
    /// Squared distance at the first time up to which a pair is passed over; negative for none.
    known: f32,
}

/// What a group can meet.
#[derive(Default)]
pub(super) struct Partners {
    boxes: BoxRows,
    blocks: Vec<Partner>,
    open: Vec<(usize, usize)>,
}

impl Partners {
    pub(super) fn clear(&mut self) {
        self.boxes.clear();
        self.blocks.clear();
    }

    /// Adds the blocks of a tree that the group can come within `radius` of during `window`. Pairs nearer than `known` at the
    /// group's first time, at which both exist, are passed over.
    #[inline(always)]
    pub(super) fn add<S: Simd, T: Boxed>(
        &mut self,
        s: S,
        tree: &T,
        group: &Group,
        window: Window,
        (radius, known): (f64, Option<f64>),
    ) {
        let phases = phases(tree, group.times);
        let bound = squared_up(radius);
        self.open.clear();
        self.open.push(tree.top());
        while let Some((level, node)) = self.open.pop() {
            let boxes = group.swept(s, tree, phases, node);
            let mut near = boxes.near(s, group.lo, group.hi, bound) & counting(tree, node, group.times);
            let (first, stride) = tree.behind(level, node);
            if level > 0 {
                while near != 0 {
                    self.open.push((level - 1, first + near.trailing_zeros() as usize));
                    near &= near - 1;
                }
                continue;
            }
            for part in 0..stride {
                let mut number = [0; LANES];
                for lane in (0..LANES).filter(|lane| near >> lane & 1 != 0) {
                    number[lane] = self.blocks.len() as u32;
                    let block = Block::new(tree, first + lane * stride + part, phases, group.drift);
                    let slack = SLACK * (block.magnitude + group.magnitude);
                    let bound = squared_up((radius + slack) * (1.0 + 1e-6) + 1e-18);
                    let known = known.map_or(-1.0, |known| squared_down((known - slack) * (1.0 - 1e-6)));
                    self.blocks.push(Partner { block, window, bound, known });
                }
                self.boxes.push(s, &BoxVector { candidate: s.load_u(&number), ..boxes }, near);
            }
        }
    }

    /// Calls `found` for each encounter within `radius` of the point in `lane` of a block of the group.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        s: S,
        (block, lane, own): (&Block, usize, &Flight),
        (radius, first_time): (f64, f32),
        memory: &mut Memory,
        mut found: impl FnMut(&Others, usize, Encounter),
    ) {
        let [from, to] = [0, 1].map(|end| [0, 1, 2].map(|axis| block.ends[end][axis][lane]));
        let lo = core::array::from_fn(|axis| if from[axis] < to[axis] { from[axis] } else { to[axis] });
        let hi = core::array::from_fn(|axis| if from[axis] > to[axis] { from[axis] } else { to[axis] });
        let Memory { picks, others } = memory;
        others.len = 0;
        let square = radius * radius;
        let mut looked_at: Option<&Window> = None;
        for &pick in picks.near(s, &self.boxes, (lo, hi), squared_up(radius)) {
            let Partner { block, window, bound, known } = &self.blocks[pick as usize];
            let mut hits = passing(s, block, from, to, *bound) & !s.eq_u(s.load_u(&block.id), s.splat_u(own.id));
            if *known >= 0.0 && hits != 0 && own.life.contains(first_time) {
                hits &= !near_at(s, block, from, first_time, *known);
            }
            if hits == 0 {
                continue;
            }
            if let Some(before) = looked_at
                && before != window
            {
                before.encounters(own, others, square, |i, encounter| found(others, i, encounter));
                others.len = 0;
            }
            looked_at = Some(window);
            block.append(s, hits, others);
        }
        if let Some(window) = looked_at {
            window.encounters(own, others, square, |i, encounter| found(others, i, encounter));
        }
    }
}

/// Memory for the partners of a point.
#[derive(Default)]
pub(super) struct Memory {
    picks: Picks,
    others: Others,
}

/// The square of a radius, rounded up to a finite f32.
fn squared_up(radius: f64) -> f32 {
    ((radius * radius).min(f32::MAX.into()) as f32).next_up().min(f32::MAX)
}

/// The square of a distance, rounded down; negative where it is.
fn squared_down(distance: f64) -> f32 {
    if distance < 0.0 { -1.0 } else { ((distance * distance).min(f32::MAX.into()) as f32).next_down() }
}

/// Points of a block that exist at the first time and are within `bound` of `from` then.
#[inline(always)]
fn near_at<S: Simd>(s: S, block: &Block, from: [f32; 3], time: f32, bound: f32) -> Mask {
    let at = rows(s, &block.ends[0]);
    let (x, y, z) = (at[0] - s.splat(from[0]), at[1] - s.splat(from[1]), at[2] - s.splat(from[2]));
    let time = s.splat(time);
    let exists = s.le(s.load(&block.begin), time) & s.lt(time, s.load(&block.end));
    exists & s.le(squared::<S>(x, y, z), s.splat(bound))
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
