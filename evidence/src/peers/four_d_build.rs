//! Builds the 4D k-d tree: space and time are split alike, and every triangle in a cell during its time is in its leaf.
//!
//! Planes are chosen by the surface area heuristic over boxes swept during the cell's time, clipped to the cell, as in
//! the library's classic tree over the whole shutter. A split of time halves it. A greedy choice never sees the gain of
//! that within one step, since it only makes swept boxes smaller; so its cost is one step and the mean of the costs of
//! the best planes in both halves.

use super::boxes::{Box3, MovingBox};
use super::four_d::{FourD, Node};
use super::object_split::BINS;
use super::{DEPTH, PARALLEL_FROM, STEP, TEST, ULP};
use mbkd::TimeInterval;
use mbkd::baseline::TriangleTests;
use mbkd::glam::Vec3;

/// How a 4D k-d tree is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FourDParams {
    /// References per triangle, at least 1; when they run out the cell becomes a leaf.
    pub max_references: f32,
    /// The greatest number of halvings of the shutter above a leaf; 0 makes an ordinary k-d tree over swept boxes.
    pub max_halvings: u32,
}

impl Default for FourDParams {
    /// As many references as the library's k-d trees may have; 1024 time slices.
    fn default() -> FourDParams {
        FourDParams { max_references: 8.0, max_halvings: 10 }
    }
}

/// The cost of a plane with one side empty is multiplied by this, as in the library's k-d trees.
const EMPTY: f32 = 0.8;

/// The distance of the outermost reference from a plane that cuts off empty space.
const MARGIN: f32 = 1e-5;

/// Splits of time are tried if swept boxes are wider than static ones by this factor.
const MOVING: f32 = 1.05;

/// A triangle during the time of a cell.
#[derive(Clone, Copy)]
struct Reference {
    index: u32,
    /// From the beginning to the end of that time.
    bounds: MovingBox,
}

/// A cell about to be split or made a leaf.
struct Cell {
    bounds: Box3,
    begin: f32,
    end: f32,
    references: Vec<Reference>,
    /// The greatest total number of references in the leaves below.
    budget: usize,
    depth: usize,
    halvings: u32,
}

/// The kind of a cell's split.
#[derive(Clone, Copy)]
enum Split {
    Space { axis: usize, at: f32 },
    Time,
}

/// Builds a tree of all triangles.
pub fn build(tests: &TriangleTests, params: FourDParams) -> FourD {
    let references: Vec<Reference> = (0..tests.len() as u32).map(|index| reference(tests, index, 0.0, 1.0)).collect();
    let root = references.iter().fold(Box3::EMPTY, |b, r| b.union(r.bounds.swept()));
    let root = if references.is_empty() { Box3 { min: Vec3::ZERO, max: Vec3::ZERO } } else { root };
    let root = root.pad(1e-5 * root.magnitude());
    // As deep as the library's k-d trees, plus the halvings of time.
    let bits = usize::BITS - references.len().leading_zeros();
    let depth = ((8 + 13 * bits / 10 + params.max_halvings) as usize).min(DEPTH);
    let budget = (references.len() as f64 * f64::from(params.max_references.max(1.0))) as usize;
    let cell = Cell { bounds: root, begin: 0.0, end: 1.0, references, budget, depth, halvings: params.max_halvings };
    let mut tree = FourD::new(root);
    Builder { tests, magnitude: root.magnitude() }.build(cell, &mut tree);
    tree.shrink();
    tree
}

/// A triangle during a time.
fn reference(tests: &TriangleTests, index: u32, begin: f32, end: f32) -> Reference {
    let of = tests.bounds(index, TimeInterval::new(begin, end).unwrap_or(TimeInterval::FULL));
    let narrow = |b: mbkd::Aabb| Box3 { min: b.min.as_vec3(), max: b.max.as_vec3() };
    Reference { index, bounds: MovingBox { open: narrow(of.begin), close: narrow(of.end) } }
}

struct Builder<'a> {
    tests: &'a TriangleTests,
    /// The largest coordinate of the scene.
    magnitude: f32,
}

impl Builder<'_> {
    /// Appends the subtree of a cell. The recursion is bounded by the cell's depth.
    fn build(&self, cell: Cell, out: &mut FourD) {
        let Some((split, [left, right])) = self.split(&cell) else {
            let mut indices: Vec<u32> = cell.references.iter().map(|r| r.index).collect();
            indices.sort_unstable();
            return out.push_leaf(&indices);
        };
        let large = left.references.len().min(right.references.len()) >= PARALLEL_FROM;
        let middle = 0.5 * (cell.begin + cell.end);
        drop(cell);
        let at = out.push(Node::Leaf { first: 0, count: 0 });
        if large {
            let subtree = |cell: Cell| {
                let mut tree = FourD::new(Box3::EMPTY);
                self.build(cell, &mut tree);
                tree
            };
            let (left, right) = rayon::join(|| subtree(left), || subtree(right));
            out.append(left);
            out.set(at, node(split, middle, out.len()));
            out.append(right);
        } else {
            self.build(left, out);
            out.set(at, node(split, middle, out.len()));
            self.build(right, out);
        }
    }

    /// The cheapest split and its children; `None` if the cell becomes a leaf.
    fn split(&self, cell: &Cell) -> Option<(Split, [Cell; 2])> {
        let n = cell.references.len();
        if n < 2 || cell.depth == 0 {
            return None;
        }
        let leaf = TEST * n as f32;
        let space = best_plane(&cell.references, cell.bounds).filter(|(cost, ..)| *cost < leaf);
        if cell.halvings > 0 && moves(&cell.references) {
            let halves = self.halves(cell);
            let cost_of = |half: &Vec<Reference>| {
                let leaf = TEST * half.len() as f32;
                best_plane(half, cell.bounds).map_or(leaf, |(cost, ..)| cost.min(leaf))
            };
            let cost = STEP + 0.5 * (cost_of(&halves[0]) + cost_of(&halves[1]));
            // Half of the budget is reserved for planes: otherwise halvings near the root would use it up.
            let fits = 2 * (halves[0].len() + halves[1].len()) <= cell.budget;
            if fits && cost < space.map_or(leaf, |(cost, ..)| cost) {
                return Some((Split::Time, children(cell, Split::Time, halves)?));
            }
        }
        let (_, axis, at) = space?;
        let sides = [false, true].map(|above| self.side(cell, axis, at, above));
        let split = Split::Space { axis, at };
        Some((split, children(cell, split, sides)?))
    }

    /// The contents of the cell during the first and the second half of its time.
    fn halves(&self, cell: &Cell) -> [Vec<Reference>; 2] {
        let middle = 0.5 * (cell.begin + cell.end);
        [(cell.begin, middle), (middle, cell.end)].map(|(begin, end)| {
            let of = cell.references.iter().map(|r| reference(self.tests, r.index, begin, end));
            of.filter(|r| self.meets(&r.bounds, cell.bounds)).collect()
        })
    }

    /// The contents of one side of a plane. References that only touch the plane are on the other side, and those in it
    /// on the left: a ray that passes the plane there visits both sides.
    fn side(&self, cell: &Cell, axis: usize, at: f32, above: bool) -> Vec<Reference> {
        let side = cell.bounds.side(axis, at, above);
        let there = |r: &Reference| {
            let swept = r.bounds.swept();
            let (min, max) = (swept.min[axis], swept.max[axis]);
            let touches = if above { max <= at } else { min >= at && max > at };
            !touches && self.meets(&r.bounds, side)
        };
        cell.references.iter().copied().filter(there).collect()
    }

    /// Whether a moving box meets a closed cell at some time: along each axis both overlap during an interval.
    fn meets(&self, of: &MovingBox, cell: Box3) -> bool {
        let (mut from, mut to) = (0.0f64, 1.0f64);
        let slack = f64::from(ULP * self.magnitude);
        // Keeps the times at which a linear function is at least zero.
        let mut keep = |a: f64, b: f64| {
            let (a, b) = (a + slack, b + slack);
            match (a >= 0.0, b >= 0.0) {
                (true, true) => {}
                (true, false) => to = to.min(a / (a - b) + 1e-9),
                (false, true) => from = from.max(a / (a - b) - 1e-9),
                (false, false) => to = -1.0,
            }
        };
        for axis in 0..3 {
            let difference = |a: f32, b: f32| f64::from(a) - f64::from(b);
            keep(difference(cell.max[axis], of.open.min[axis]), difference(cell.max[axis], of.close.min[axis]));
            keep(difference(of.open.max[axis], cell.min[axis]), difference(of.close.max[axis], cell.min[axis]));
        }
        from <= to
    }
}

/// The children, if the budget suffices.
fn children(cell: &Cell, split: Split, [left, right]: [Vec<Reference>; 2]) -> Option<[Cell; 2]> {
    let sum = left.len() + right.len();
    if sum > cell.budget {
        return None;
    }
    let spare = (cell.budget - sum) as f64 / sum.max(1) as f64;
    let child = |above: bool, references: Vec<Reference>| {
        let middle = 0.5 * (cell.begin + cell.end);
        let (bounds, begin, end, halvings) = match split {
            Split::Space { axis, at } => (cell.bounds.side(axis, at, above), cell.begin, cell.end, cell.halvings),
            Split::Time if above => (cell.bounds, middle, cell.end, cell.halvings - 1),
            Split::Time => (cell.bounds, cell.begin, middle, cell.halvings - 1),
        };
        let budget = references.len() + (spare * references.len() as f64) as usize;
        Cell { bounds, begin, end, references, budget, depth: cell.depth - 1, halvings }
    };
    Some([child(false, left), child(true, right)])
}

fn node(split: Split, middle: f32, right: u32) -> Node {
    match split {
        Split::Space { axis, at } => Node::Space { axis: axis as u8, at, right },
        Split::Time => Node::Time { at: middle, right },
    }
}

/// Whether references move enough for a split of time to matter.
fn moves(references: &[Reference]) -> bool {
    let width = |b: Box3| (b.max - b.min).element_sum();
    let (mut swept, mut still) = (0.0, 0.0);
    for r in references {
        swept += width(r.bounds.swept());
        still += 0.5 * (width(r.bounds.open) + width(r.bounds.close));
    }
    swept > MOVING * still
}

/// The cheapest plane through a cell: cost, axis and position.
fn best_plane(references: &[Reference], cell: Box3) -> Option<(f32, usize, f32)> {
    let mut best: Option<(f32, usize, f32)> = None;
    let area = cell.half_area();
    let parts = |r: &Reference| r.bounds.swept().intersection(cell);
    let all = references.iter().fold(Box3::EMPTY, |b, r| b.union(parts(r)));
    let width = (all.max - all.min) / BINS as f32;
    let scale = Vec3::ONE / width;
    let wide = [0, 1, 2].map(|axis| width[axis] > 0.0 && scale[axis].is_finite());
    // The numbers of references that begin, and that end, before each edge of each axis.
    let (mut begun, mut ended) = ([[0usize; BINS + 2]; 3], [[0usize; BINS + 2]; 3]);
    for r in references {
        let part = parts(r);
        for axis in (0..3).filter(|&axis| wide[axis]) {
            let (low, min, max) = (all.min[axis], part.min[axis], part.max[axis]);
            let edge = |x: f32| (((x - low) * scale[axis]).max(0.0) as usize).min(BINS - 1) + 1;
            begun[axis][if min <= low { 0 } else { edge(min) }] += 1;
            ended[axis][edge(max)] += 1;
        }
    }
    for axis in (0..3).filter(|&axis| wide[axis]) {
        let (low, high, width) = (all.min[axis], all.max[axis], width[axis]);
        let (begun, ended) = (&begun[axis], &ended[axis]);
        let (mut left, mut gone) = (0, 0);
        for k in 0..=BINS {
            // Up to the edge before the first reference nothing has begun.
            left += if k == 0 { 0 } else { begun[k] + if k == 1 { begun[0] } else { 0 } };
            gone += ended[k];
            let at = match k {
                0 => low - MARGIN,
                BINS => high + MARGIN,
                _ => low + width * k as f32,
            };
            if !(cell.min[axis] < at && at < cell.max[axis]) {
                continue;
            }
            let right = references.len() - gone;
            let areas = cell.side(axis, at, false).half_area() * left as f32
                + cell.side(axis, at, true).half_area() * right as f32;
            let mut cost = STEP + TEST * areas / area;
            if left == 0 || right == 0 {
                cost *= EMPTY;
            }
            if best.is_none_or(|(b, ..)| cost < b) {
                best = Some((cost, axis, at));
            }
        }
    }
    best
}
