//! What "the conventional SAH" may mean in the paper's claim about time weights: three ways to count what crosses a plane, in
//! trees that are alike in all else.
//!
//! The library's k-d build knows two of them, time weights and one on each side. The third, a surface area heuristic at
//! mid-shutter that knows nothing of motion, has no parameter there. So this is a small k-d build of its own: the paper's
//! duplication and propagation over linear boxes, every node split to a given depth by the cheapest of some planes, and
//! the references in its leaves counted.

use mbkd::baseline::TriangleTests;
use mbkd::{LinearBounds, TimeInterval};

/// How a reference that crosses a plane counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// Where it is at mid-shutter only.
    Middle,
    /// One on each side.
    Both,
    /// On each side the time that it spends there: the paper's.
    Weighted,
}

/// References in the leaves.
#[derive(Clone, Copy, Debug, Default)]
pub struct Leaves {
    /// All.
    pub references: usize,
    /// Those that are there for part of the shutter.
    pub timed: usize,
}

/// Planes per axis.
const PLANES: usize = 16;
/// Nodes with fewer references are leaves, whatever the depth.
const SMALL: usize = 4;
/// Leaves hold at most this many references per triangle together.
const BUDGET: usize = 60;

/// A triangle during a part of the shutter.
#[derive(Clone, Copy)]
struct Reference {
    index: u32,
    begin: f64,
    end: f64,
    /// Whether it came to this node by crossing a plane, so that it does not vote (the paper's BP reference).
    bp: bool,
}

/// Counts the leaves of a tree of some depth.
pub fn leaves(tests: &TriangleTests, counts: Counts, depth: u32) -> Leaves {
    let bounds: Vec<LinearBounds> = (0..tests.len() as u32).map(|i| tests.bounds(i, TimeInterval::FULL)).collect();
    let swept = bounds.iter().fold(mbkd::Aabb::EMPTY, |b, of| b.union(of.swept()));
    let all = (0..tests.len() as u32).map(|index| Reference { index, begin: 0.0, end: 1.0, bp: false }).collect();
    let mut model = Model { bounds, counts, leaves: Leaves::default() };
    model.split(all, [swept.min.to_array(), swept.max.to_array()], depth);
    model.leaves
}

struct Model {
    bounds: Vec<LinearBounds>,
    counts: Counts,
    leaves: Leaves,
}

/// The part of `[begin, end]` in which a linear function, known at times 0 and 1, is below zero.
fn negative(at_0: f64, at_1: f64, begin: f64, end: f64) -> Option<(f64, f64)> {
    let at = |t: f64| at_0 + (at_1 - at_0) * t;
    let zero = at_0 / (at_0 - at_1);
    match (at(begin) < 0.0, at(end) < 0.0) {
        (true, true) => Some((begin, end)),
        (true, false) => Some((begin, zero.clamp(begin, end))),
        (false, true) => Some((zero.clamp(begin, end), end)),
        (false, false) => None,
    }
}

impl Model {
    /// When a reference reaches below a plane, and when above.
    fn sides(&self, r: &Reference, axis: usize, at: f64) -> [Option<(f64, f64)>; 2] {
        let of = &self.bounds[r.index as usize];
        let below = negative(of.begin.min[axis] - at, of.end.min[axis] - at, r.begin, r.end);
        let above = negative(at - of.begin.max[axis], at - of.end.max[axis], r.begin, r.end);
        // What lies in the plane is on the left.
        if below.is_none() && above.is_none() { [Some((r.begin, r.end)), None] } else { [below, above] }
    }

    /// What a reference counts on both sides of a plane.
    fn counted(&self, r: &Reference, axis: usize, at: f64) -> [f64; 2] {
        let sides = self.sides(r, axis, at);
        match self.counts {
            Counts::Both => sides.map(|side| f64::from(u8::from(side.is_some()))),
            Counts::Weighted => sides.map(|side| side.map_or(0.0, |(begin, end)| end - begin)),
            Counts::Middle => {
                let home = 0.5f64.clamp(r.begin, r.end);
                sides.map(|side| f64::from(u8::from(side.is_some_and(|(begin, end)| begin <= home && home <= end))))
            }
        }
    }

    fn split(&mut self, references: Vec<Reference>, cell: [[f64; 3]; 2], depth: u32) {
        let plane = if depth == 0 || references.len() < SMALL { None } else { self.plane(&references, cell) };
        let full = self.leaves.references > BUDGET * self.bounds.len();
        let Some((axis, at)) = plane.filter(|_| !full) else {
            self.leaves.references += references.len();
            self.leaves.timed += references.iter().filter(|r| r.begin > 0.0 || r.end < 1.0).count();
            return;
        };
        let mut children = [Vec::new(), Vec::new()];
        for r in &references {
            let sides = self.sides(r, axis, at);
            let home = 0.5f64.clamp(r.begin, r.end);
            let crosses = sides.iter().flatten().any(|side| *side != (r.begin, r.end));
            for (child, side) in children.iter_mut().zip(sides) {
                if let Some((begin, end)) = side {
                    // Normal where it lies at mid-shutter, or where it does not cross.
                    let bp = crosses && !(begin <= home && home <= end);
                    child.push(Reference { index: r.index, begin, end, bp });
                }
            }
        }
        drop(references);
        for (i, child) in children.into_iter().enumerate() {
            let mut part = cell;
            part[1 - i][axis] = at;
            self.split(child, part, depth - 1);
        }
    }

    /// The cheapest of evenly spaced planes, by the references that vote.
    fn plane(&self, references: &[Reference], cell: [[f64; 3]; 2]) -> Option<(usize, f64)> {
        let area = |low: [f64; 3], high: [f64; 3]| {
            let d: [f64; 3] = std::array::from_fn(|k| (high[k] - low[k]).max(0.0));
            d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
        };
        let voters: Vec<&Reference> = references.iter().filter(|r| !r.bp).collect();
        if voters.len() < 2 {
            return None;
        }
        let mut best: Option<(f64, usize, f64)> = None;
        for axis in 0..3 {
            for k in 1..PLANES {
                let at = cell[0][axis] + (cell[1][axis] - cell[0][axis]) * k as f64 / PLANES as f64;
                let (mut left, mut right) = (0.0, 0.0);
                for r in &voters {
                    let [l, r] = self.counted(r, axis, at);
                    (left, right) = (left + l, right + r);
                }
                let (mut high, mut low) = (cell[1], cell[0]);
                (high[axis], low[axis]) = (at, at);
                let cost = left * area(cell[0], high) + right * area(low, cell[1]);
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, at));
                }
            }
        }
        best.map(|(_, axis, at)| (axis, at))
    }
}
