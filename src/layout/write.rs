//! Writing nodes into the arena.
//!
//! Subtrees up to a fixed size are written separately by any thread and concatenated ([`super::serialize`]). The few
//! nodes above them follow.

use super::serialize::{Fragment, write_in_order};
use super::wide_node::{ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS, children_mut};
use crate::bvh::{BinaryNode, Collapse, WideChild, mean_half_area};
use crate::error::BuildError;
use crate::geometry::{Box3, KERNEL_ULPS, LinearBox3, TimeInterval, ULP};
use crate::simd::{Arena, LANES};
use glam::Vec3;

/// A face at time 0 and its velocity: the line that a query evaluates as `at + velocity * t`.
#[derive(Clone, Copy)]
struct Face {
    at: f32,
    velocity: f32,
}

/// The line through a bound at both ends of an interval, moved toward `side` (+1 up, -1 down) until the *computed*
/// `at + velocity * t` holds the bound at every time of the interval.
///
/// Proof: the computed value differs from `at + velocity * t` by at most two roundings of sizes below
/// |at| + |velocity| (one where it is fused), that is by less than 2^-23 (|at| + |velocity|); `at` is moved by
/// twice that and then by one float. Both the bound and the line are linear in t, so it is enough that the line lies
/// beyond the bound at both ends; this is ensured in f64, whose own rounding (2^-53) is negligible beside the float
/// step. A static face is moved by `pad` and rounded outward.
fn face(begin: f32, end: f32, over: TimeInterval, side: f64, pad: f64) -> Face {
    face_by(begin, end, over, side, pad, ROUNDINGS)
}

/// By how many times the rounding of the query a face is moved.
const ROUNDINGS: f64 = 2.0;

/// [`face`] with another multiple of the rounding of the query.
#[inline(always)]
fn face_by(begin: f32, end: f32, over: TimeInterval, side: f64, pad: f64, roundings: f64) -> Face {
    let outward = |x: f64| {
        let at = x as f32;
        // The nearest float may lie inside of the bound.
        if side * (f64::from(at) - x) >= 0.0 {
            at
        } else if side > 0.0 {
            at.next_up()
        } else {
            at.next_down()
        }
    };
    if begin == end {
        return Face { at: outward(f64::from(begin) + side * pad), velocity: 0.0 };
    }
    let (t0, t1) = (f64::from(over.begin()), f64::from(over.end()));
    let (b0, b1) = (f64::from(begin), f64::from(end));
    let velocity = if t1 > t0 { ((b1 - b0) / (t1 - t0)) as f32 } else { 0.0 };
    let v = f64::from(velocity);
    let line = side * (side * (b0 - v * t0)).max(side * (b1 - v * t1));
    let slack = f64::from(f32::EPSILON) * roundings * (line.abs() + v.abs());
    let at = (line + side * (slack + pad)) as f32;
    Face { at: if side > 0.0 { at.next_up() } else { at.next_down() }, velocity }
}

/// The padding of the faces of a box, so that a ray that hits a primitive in it also meets the box: the part of the
/// kernel's rounding that grows with the coordinates of the primitive. The other part, which grows with those of the
/// origin, is added to the ray. Sums and products of f32 are exact in f64 here.
fn kernel_pad(b: &LinearBox3) -> f64 {
    f64::from(KERNEL_ULPS * ULP) * f64::from(b.begin.magnitude().max(b.end.magnitude()))
}

/// Bounds that no ray meets, for the lanes without a child: from far on one side to far on the other. Scaled by the
/// reciprocal of any direction it stays finite.
pub(super) const NOWHERE: f32 = 1e30;

/// Writes the node's boxes and returns its reference; the children follow with [`set_children`].
pub(crate) fn write_node(arena: &mut Arena, boxes: &[LinearBox3], over: TimeInterval) -> Result<ChildRef, BuildError> {
    let moving = boxes.iter().any(|b| b.begin != b.end);
    let rows = if moving { NODE_ROWS } else { STATIC_NODE_ROWS };
    arena.align();
    let at = arena.grow(rows * LANES);
    let kind = if moving { Kind::Node } else { Kind::StaticNode };
    let node = ChildRef::new(kind, at, 1).ok_or(BuildError::TooLargeTree)?;
    let words = &mut arena.ints_mut()[at..at + rows * LANES];
    for lane in 0..LANES {
        write_box(words, kind, lane, boxes.get(lane), over);
    }
    Ok(node)
}

/// Writes one of the boxes of the node that begins at `words[0]`; for a static node, `of` must be static.
///
/// Not inlined: in the loop over lanes it would be compiled sixteen times, which takes seconds.
#[inline(never)]
pub(super) fn write_box(words: &mut [u32], kind: Kind, lane: usize, of: Option<&LinearBox3>, over: TimeInterval) {
    let pad = of.map_or(0.0, kernel_pad);
    for axis in 0..3 {
        let (low, high) = match of {
            Some(b) => (
                face(b.begin.min[axis], b.end.min[axis], over, -1.0, pad),
                face(b.begin.max[axis], b.end.max[axis], over, 1.0, pad),
            ),
            None => (Face { at: NOWHERE, velocity: 0.0 }, Face { at: -NOWHERE, velocity: 0.0 }),
        };
        let row = 2 * axis;
        words[row * LANES + lane] = low.at.to_bits();
        words[(row + 1) * LANES + lane] = high.at.to_bits();
        if kind == Kind::Node {
            words[(row + 6) * LANES + lane] = low.velocity.to_bits();
            words[(row + 7) * LANES + lane] = high.velocity.to_bits();
        }
    }
}

/// Linear bounds of the contents of a box of the node that begins at `words[0]`, slightly wider than those that were
/// written.
///
/// Products of f32 are exact in f64, and the rounding of the sum is far less than the f32 step that each face is moved
/// outward.
pub(super) fn read_box(words: &[u32], kind: Kind, lane: usize, over: TimeInterval) -> LinearBox3 {
    let word = |row: usize| f32::from_bits(words[row * LANES + lane]);
    let face = |row: usize, time: f32, side: f64| {
        let velocity = if kind == Kind::Node { word(row + 6) } else { 0.0 };
        match velocity {
            0.0 => word(row),
            _ => {
                let at = (f64::from(word(row)) + f64::from(velocity) * f64::from(time)) as f32;
                if side > 0.0 { at.next_up() } else { at.next_down() }
            }
        }
    };
    let at = |time: f32| Box3 {
        min: Vec3::from([0, 2, 4].map(|row| face(row, time, -1.0))),
        max: Vec3::from([1, 3, 5].map(|row| face(row, time, 1.0))),
    };
    LinearBox3 { begin: at(over.begin()), end: at(over.end()) }
}

/// Fills in the children of a node.
pub(crate) fn set_children(arena: &mut Arena, node: ChildRef, children: &[ChildRef]) {
    let all = children.iter().chain(core::iter::repeat(&ChildRef::NOTHING));
    for (word, child) in children_mut(arena, node).iter_mut().zip(all) {
        *word = child.0;
    }
}

/// Writes a time node over equal time slices of the shutter.
pub(crate) fn write_time(arena: &mut Arena, slices: &[ChildRef]) -> Result<ChildRef, BuildError> {
    arena.align();
    let at = arena.grow(1 + slices.len());
    arena.ints_mut()[at] = slices.len() as u32;
    for (i, slice) in slices.iter().enumerate() {
        arena.ints_mut()[at + 1 + i] = slice.0;
    }
    ChildRef::new(Kind::Time, at, 1).ok_or(BuildError::TooLargeTree)
}

/// Subtrees with fewer references are written separately. Fixed, so that the arena does not depend on threads.
const MAX_FRAGMENT: u32 = 4096;

/// Gives the leaf blocks of binary nodes. Called through `dyn`, so that the code that writes nodes is compiled once.
pub(crate) type LeafWriter<'a> =
    &'a (dyn Fn(&mut Arena, &[BinaryNode], &mut [ChildRef]) -> Result<(), BuildError> + Sync);

/// Leaf blocks that are written per task.
const BLOCKS: usize = 512;

/// Writes a leaf block for each of some binary nodes and returns them in order.
pub(crate) fn write_blocks(
    arena: &mut Arena,
    of: &[BinaryNode],
    leaves: LeafWriter<'_>,
) -> Result<Vec<ChildRef>, BuildError> {
    let tasks: Vec<&[BinaryNode]> = of.chunks(BLOCKS).collect();
    let write = |task: usize, fragment: &mut Fragment| {
        fragment.tops.resize(tasks[task].len(), ChildRef::NOTHING);
        leaves(&mut fragment.arena, tasks[task], &mut fragment.tops)
    };
    write_in_order(arena, &vec![1; tasks.len()], &|_| true, &write)
}

/// Writes the nodes of a collapsed binary tree, each directly followed by its leaf blocks, and returns the root. The
/// nodes above the separately written subtrees come last.
pub(crate) struct Nodes<'a> {
    pub binary: &'a [BinaryNode],
    pub collapse: &'a Collapse,
    pub over: TimeInterval,
    pub leaves: LeafWriter<'a>,
    /// Whether `leaves` writes the blocks, or returns blocks that are in the final arena already.
    pub writes: bool,
}

impl Nodes<'_> {
    /// Writes the whole tree (which must not be empty).
    pub fn write(&self, arena: &mut Arena) -> Result<ChildRef, BuildError> {
        if self.collapse.is_leaf(0) {
            let mut block = ChildRef::NOTHING;
            (self.leaves)(arena, &self.binary[..1], core::slice::from_mut(&mut block))?;
            return Ok(block);
        }
        let mut roots = Vec::new();
        self.find_fragments(0, &mut roots);
        // Moving subtrees take about twice as much.
        let size = |node: &BinaryNode| node.count * (1 + u32::from(node.moving));
        let sizes: Vec<u32> = roots.iter().map(|&root| size(&self.binary[root as usize])).collect();
        // Time nodes are not written here: they are in the final arena already.
        let inside = |child: ChildRef| child.kind() != Kind::Time && (self.writes || !child.kind().is_leaf());
        let write = |i: usize, fragment: &mut Fragment| {
            let root = self.node(&mut fragment.arena, roots[i], &mut fragment.nodes, &mut None)?;
            fragment.tops.push(root);
            Ok(())
        };
        let done = write_in_order(arena, &sizes, &inside, &write)?;
        self.node(arena, 0, &mut Vec::new(), &mut Some(done.into_iter()))
    }

    /// The subtrees to be written separately, in the order in which [`Nodes::node`] reaches them.
    fn find_fragments(&self, of: u32, roots: &mut Vec<u32>) {
        if self.binary[of as usize].count <= MAX_FRAGMENT {
            roots.push(of);
            return;
        }
        for child in self.children(of).iter().filter(|c| !c.leaf) {
            self.find_fragments(child.node, roots);
        }
    }

    /// The children of a node in the order of its lanes.
    ///
    /// Occlusion queries visit the highest lane first. So leaf blocks come last, the largest at the very end: those
    /// most likely end such a query soonest.
    fn children(&self, of: u32) -> Vec<WideChild> {
        let mut children = Vec::with_capacity(LANES);
        self.collapse.children(self.binary, of, &mut children);
        children.sort_by_cached_key(|c| {
            let node = &self.binary[c.node as usize];
            // A node that is too large for a block is a replaced subtree, written before.
            (c.leaf && node.count as usize <= LANES, mean_half_area(&node.bounds).to_bits())
        });
        children
    }

    /// Writes a node and its subtree; the subtrees in `written` are in place already. The recursion is as deep as the
    /// wide tree, which the binary build bounds.
    fn node(
        &self,
        arena: &mut Arena,
        of: u32,
        nodes: &mut Vec<ChildRef>,
        written: &mut Option<std::vec::IntoIter<ChildRef>>,
    ) -> Result<ChildRef, BuildError> {
        if self.binary[of as usize].count <= MAX_FRAGMENT
            && let Some(done) = written.as_mut().and_then(Iterator::next)
        {
            return Ok(done);
        }
        let children = self.children(of);
        let boxes: Vec<LinearBox3> = children.iter().map(|c| self.binary[c.node as usize].bounds).collect();
        let node = write_node(arena, &boxes, self.over)?;
        nodes.push(node);
        let leaves: Vec<BinaryNode> =
            children.iter().filter(|c| c.leaf).map(|c| self.binary[c.node as usize]).collect();
        let mut blocks = vec![ChildRef::NOTHING; leaves.len()];
        (self.leaves)(arena, &leaves, &mut blocks)?;
        let (mut refs, mut blocks) = (Vec::with_capacity(children.len()), blocks.into_iter());
        for child in &children {
            let below = match child.leaf {
                true => blocks.next().unwrap_or(ChildRef::NOTHING),
                false => self.node(arena, child.node, nodes, written)?,
            };
            refs.push(below);
        }
        set_children(arena, node, &refs);
        Ok(node)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// If the rounding of the query were ignored, one face in a hundred would be computed inside of its bound.
    #[test]
    fn faces_lie_beyond_their_bounds_as_the_query_computes_them() {
        let lost = faces_inside(ROUNDINGS);
        assert!(lost == 0, "{lost} of 1.8 million");
        assert!(faces_inside(0.0) > 1000, "the slack is not needed");
    }

    /// Counts faces, moved by so many roundings, that are computed on the wrong side of their bounds.
    fn faces_inside(roundings: f64) -> usize {
        let mut lost = 0;
        let mut random = Random(1);
        for i in 0..100_000 {
            let scale = if i % 3 == 0 { 1e-4 } else { 1.0 };
            let (a, b) = (random.signed().abs() * scale + 0.5 * random.signed().abs(), random.signed().abs());
            let Some(over) = TimeInterval::half_open(a.min(b), a.max(b)) else { continue };
            let (begin, end) = (random.signed(), random.signed() * scale);
            for side in [-1.0f32, 1.0] {
                let f = face_by(begin, end, over, f64::from(side), 0.0, roundings);
                for j in 0..=8 {
                    let t = (over.begin() + over.duration() * (j as f32 / 8.0)).min(over.end());
                    let w = f64::from(t - over.begin()) / f64::from(over.end() - over.begin()).max(1e-30);
                    let bound = f64::from(begin) + (f64::from(end) - f64::from(begin)) * w.min(1.0);
                    for computed in [f.velocity.mul_add(t, f.at), f.velocity * t + f.at] {
                        // The bound itself is computed with the rounding of f64 and of t - begin in f32.
                        let slack = 2.0 * f64::from(f32::EPSILON) * f64::from((end - begin).abs()) * w;
                        lost += usize::from(f64::from(side) * (f64::from(computed) - bound) < -slack);
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn a_static_face_is_its_bound() {
        let still = face(0.1, 0.1, TimeInterval::FULL, 1.0, 0.0);
        assert_eq!((still.at, still.velocity), (0.1, 0.0));
    }
}
