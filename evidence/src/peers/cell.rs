//! Cells of k-d trees as subtrees with boxes of their own.
//!
//! A k-d tree finds a hit because its point lies in the cell of some leaf, at the hit's time, and the triangle has a
//! reference there that is active at that time. A box for that leaf must hold all such points. Three boxes do:
//!
//! - the moving box around the triangles during the shutter;
//! - the cell itself, whose faces move with its planes;
//! - the static box around the parts of the triangles swept inside of the cell while their references are active.
//!
//! A face of any of them is a bound of its own, linear in time, so each face is taken from whichever is tightest at the
//! middle of the leaf's active interval. Boxes above hold those below, or the static boxes below, face by face
//! likewise.

use super::ULP;
use super::boxes::{Box3, MovingBox};
use super::subtree::{ActiveInterval, Content, Subtree};
use mbkd::TimeInterval;
use mbkd::baseline::TriangleTests;
use mbkd::glam::Vec3;

/// A cell during the descent.
#[derive(Clone, Copy)]
pub struct Cell {
    bounds: MovingBox,
    pub active: ActiveInterval,
}

impl Cell {
    /// The root cell: a box around the whole scene.
    pub fn root(bounds: Box3) -> Cell {
        Cell { bounds: MovingBox { open: bounds, close: bounds }, active: ActiveInterval::ALWAYS }
    }

    /// The cells below and above a plane with one position at shutter open and another at shutter close. It may leave
    /// the cell in between: then these are larger than necessary.
    pub fn sides(self, axis: usize, open: f32, close: f32) -> [Cell; 2] {
        let (mut below, mut above) = (self, self);
        (below.bounds.open.max[axis], below.bounds.close.max[axis]) = (open, close);
        (above.bounds.open.min[axis], above.bounds.close.min[axis]) = (open, close);
        [below, above]
    }

    /// The cell before a time and from it on.
    pub fn halves(self, at: f32) -> [Cell; 2] {
        let ActiveInterval { begin, end } = self.active;
        [
            Cell { active: ActiveInterval { begin, end: at }, ..self },
            Cell { active: ActiveInterval { begin: at, end }, ..self },
        ]
    }

    /// The box that the cell sweeps during a time.
    fn swept(self, active: ActiveInterval) -> Box3 {
        [active.begin, active.end.min(1.0)].map(|time| at(self.bounds, time)).into_iter().fold(Box3::EMPTY, Box3::union)
    }
}

/// A subtree of cells.
pub struct Cells {
    pub subtree: Subtree,
    /// The bounds of its contents, swept while they are active.
    still: Box3,
}

impl Cells {
    /// A leaf with some references; `None` without any. No coordinate of the scene is larger than `magnitude`.
    ///
    /// The library computes positions of planes within 4 ULP of it, and moving planes have other roundings when they
    /// are interpolated between both ends: boxes are padded as the k-d traversals pad their planes.
    pub fn leaf(
        tests: &TriangleTests,
        cell: Cell,
        references: &[(u32, ActiveInterval)],
        magnitude: f32,
    ) -> Option<Cells> {
        let (&(_, active), _) = references.split_first()?;
        let (mut moving, mut still, mut active) = (MovingBox::EMPTY, Box3::EMPTY, active);
        let mut sorted = references.to_vec();
        sorted.sort_unstable_by_key(|(index, _)| *index);
        for &(index, of) in &sorted {
            moving = moving.union(bounds(tests, index, TimeInterval::FULL));
            let during = TimeInterval::new(of.begin, of.end.min(1.0)).unwrap_or(TimeInterval::FULL);
            still = still.union(bounds(tests, index, during).swept().intersection(cell.swept(of)));
            active = active.union(of);
        }
        let magnitude = magnitude.max(cell.bounds.swept().magnitude());
        let by = TriangleTests::padding(magnitude) + 8.0 * ULP * magnitude;
        let still = still.pad(by);
        let candidates = [moving, cell.bounds].map(|b| MovingBox { open: b.open.pad(by), close: b.close.pad(by) });
        let bounds = tightest([candidates[0], candidates[1], standing(still)], active);
        let (indices, intervals) = sorted.into_iter().unzip();
        Some(Cells { subtree: Subtree { bounds, active, content: Content::Leaf { indices, intervals } }, still })
    }

    /// Joins both sides of a plane or of a time; returns the other side if one is empty.
    pub fn join(sides: [Option<Cells>; 2]) -> Option<Cells> {
        match sides {
            [Some(a), Some(b)] => {
                let still = a.still.union(b.still);
                let mut subtree = Subtree::inner([a.subtree, b.subtree]);
                subtree.bounds = tightest([subtree.bounds, standing(still)], subtree.active);
                Some(Cells { subtree, still })
            }
            [one, other] => one.or(other),
        }
    }

    /// The whole tree, which may be empty.
    pub fn whole(cells: Option<Cells>) -> Subtree {
        cells.map_or_else(|| Subtree::leaf(MovingBox::EMPTY, Vec::new()), |cells| cells.subtree)
    }
}

/// A triangle's bounds at both ends of a time, as a moving box. Its interpolation is valid for the whole shutter only.
fn bounds(tests: &TriangleTests, index: u32, over: TimeInterval) -> MovingBox {
    let of = tests.bounds(index, over);
    let narrow = |b: mbkd::Aabb| Box3 { min: b.min.as_vec3(), max: b.max.as_vec3() };
    MovingBox { open: narrow(of.begin), close: narrow(of.end) }
}

fn standing(still: Box3) -> MovingBox {
    MovingBox { open: still, close: still }
}

fn at(moving: MovingBox, time: f32) -> Box3 {
    let between = |open: Vec3, close: Vec3| open + (close - open) * time;
    Box3 { min: between(moving.open.min, moving.close.min), max: between(moving.open.max, moving.close.max) }
}

/// Each face from the box in which it is tightest at the middle of a time.
fn tightest<const N: usize>(boxes: [MovingBox; N], active: ActiveInterval) -> MovingBox {
    let time = active.middle();
    let mut best = boxes[0];
    for other in boxes {
        let (now, then) = (at(best, time), at(other, time));
        for axis in 0..3 {
            if then.min[axis] > now.min[axis] {
                (best.open.min[axis], best.close.min[axis]) = (other.open.min[axis], other.close.min[axis]);
            }
            if then.max[axis] < now.max[axis] {
                (best.open.max[axis], best.close.max[axis]) = (other.open.max[axis], other.close.max[axis]);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd::TriangleMesh;
    use mbkd_scenes::Random;

    /// The parts of triangles in a cell while their references are active are in the box of the leaf, and in those
    /// above.
    #[test]
    fn boxes_hold_the_contents_of_their_cells() {
        const TRIANGLES: u32 = 4;
        let mut random = Random(12);
        let (mut held, mut smaller) = (0, 0);
        for _ in 0..300 {
            let mut key = || (0..3 * TRIANGLES).map(|_| random.dvec().as_vec3()).collect::<Vec<Vec3>>();
            let keys = vec![key(), key(), key()];
            let indices = (0..TRIANGLES).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let tests = TriangleTests::new(&[TriangleMesh::new(indices, keys)]).unwrap();
            let all = Box3::of((0..TRIANGLES).flat_map(|i| [0.0, 0.5, 1.0].map(|t| tests.corners(i, t))).flatten());
            let mut number = || random.unit_f64() as f32 - 0.5;
            let (x, y, displacement) = (number(), number(), number());
            let [below, above] = Cell::root(all).sides(0, x, x + displacement);
            let [_, above] = above.sides(1, y, y);
            let [first, second] = above.halves(0.25 + 0.5 * (number() + 0.5));
            let mut leaves = [below, first, second].map(|cell| {
                let of = |index| {
                    let ActiveInterval { begin, end } = cell.active;
                    let length = end.min(1.0) - begin;
                    let begin = begin + length * 0.3 * (number() + 0.5);
                    let of = ActiveInterval { begin, end: begin + length * 0.5 * (number() + 0.6) };
                    (index, if index == 0 { cell.active } else { of })
                };
                (cell, (0..TRIANGLES).map(of).collect::<Vec<(u32, ActiveInterval)>>())
            });
            leaves.sort_by_key(|(cell, _)| cell.active.begin.to_bits());
            let leaf =
                |of: &(Cell, Vec<(u32, ActiveInterval)>)| Cells::leaf(&tests, of.0, &of.1, all.magnitude()).unwrap();
            let joined = leaves.each_ref().map(leaf);
            let whole = {
                let [a, b, c] = leaves.each_ref().map(leaf);
                Cells::join([Some(a), Cells::join([Some(b), Some(c)])]).unwrap()
            };
            let mut check = |point: Vec3, time: f32, of: &Cells| {
                let now = at(of.subtree.bounds, time);
                assert!(point.cmpge(now.min).all() && point.cmple(now.max).all(), "{point} at {time}: {now:?}");
                assert!(of.subtree.active.holds(time));
                held += 1;
            };
            for ((cell, references), leaf) in leaves.iter().zip(&joined) {
                for &(index, active) in references {
                    for time in (0..=32).map(|i| i as f32 / 32.0).filter(|time| active.holds(*time)) {
                        let [a, b, c] = tests.corners(index, time);
                        let now = at(cell.bounds, time);
                        for (i, j) in (0..=8).flat_map(|i| (0..=8 - i).map(move |j| (i, j))) {
                            let point = a + (b - a) * (i as f32 / 8.0) + (c - a) * (j as f32 / 8.0);
                            if point.cmpge(now.min).all() && point.cmple(now.max).all() {
                                check(point, time, leaf);
                                check(point, time, &whole);
                            }
                        }
                    }
                }
                let all = references
                    .iter()
                    .fold(MovingBox::EMPTY, |b, (index, _)| b.union(bounds(&tests, *index, TimeInterval::FULL)));
                smaller += usize::from(leaf.subtree.bounds.swept().half_area() < 0.9 * all.swept().half_area());
            }
        }
        assert!(held > 100_000 && smaller > 300, "{held} {smaller}");
    }
}
