//! From primitives to the wide layout.
//!
//! Primitives are grouped by how they move. What stands still or moves linearly becomes one tree;
//! meshes with more keys get a time node with one tree per key segment. Within the linear part, time
//! segments are tried: the leaf blocks stay, only the nodes above them are built anew for each part of
//! the shutter, and the estimated cost of a ray decides.

use super::emit::{Nodes, set_children, write_node, write_time};
use super::layout::ChildRef;
use super::leaf::WideSource;
use crate::build::object::{BinaryNode, BinaryTree, Collapse, Prices, Reference, build_binary};
use crate::error::BuildError;
use crate::motion::{LinearBox3, TimeInterval};
use crate::simd::{Arena, LANES};

/// Prices of a query's steps, measured relative to each other.
const PRICES: Prices = Prices { node: 2.0, leaf: 1.0, primitive: 0.15, still: 0.7, most: 16 };

/// References at which the binary tree stops; the collapse joins its leaves again.
const BINARY_LEAF: usize = 4;

/// A finer division of the shutter is taken where it costs less than this part of the coarser one.
const WORTH_DIVIDING: f32 = 0.9;

/// Most time segments of one subtree.
const MOST_SEGMENTS: usize = 16;

/// A built tree: the arena and where it begins.
pub(crate) struct WideTree {
    pub arena: Arena,
    pub root: ChildRef,
}

impl WideTree {
    /// Builds over all primitives of a set.
    pub fn build<S: WideSource>(set: &S) -> Result<WideTree, BuildError> {
        let mut tree = WideTree { arena: Arena::default(), root: ChildRef::NOTHING };
        let mut groups: Vec<(usize, Vec<u32>)> = Vec::new();
        for id in 0..set.len() as u32 {
            let keys = set.keys(id).max(2);
            match groups.iter_mut().find(|g| g.0 == keys) {
                Some(group) => group.1.push(id),
                None => groups.push((keys, vec![id])),
            }
        }
        groups.sort_by_key(|g| g.0);
        let mut parts = Vec::new();
        for (keys, ids) in groups {
            parts.push(tree.group(set, keys, &ids)?);
        }
        tree.root = tree.join(parts)?;
        tree.arena.align();
        tree.arena.settle();
        Ok(tree)
    }

    /// Builds the primitives of one number of keys (2: at most linear motion).
    fn group<S: WideSource>(&mut self, set: &S, keys: usize, ids: &[u32]) -> Result<Part, BuildError> {
        if keys == 2 {
            return self.linear(set, ids, TimeInterval::FULL, 0);
        }
        let mut refs = Vec::new();
        let mut whole = LinearBox3::EMPTY;
        for segment in 0..keys - 1 {
            let over = part_of_shutter(segment, keys - 1);
            let part = self.linear(set, ids, over, segment)?;
            // As a box over the whole shutter: swept, since a line over a part says nothing outside it.
            let swept = part.bounds.swept();
            whole = whole.union(LinearBox3 { begin: swept, end: swept });
            refs.push(part.root);
        }
        Ok(Part { bounds: whole, root: write_time(&mut self.arena, &refs)? })
    }

    /// Builds primitives whose motion is linear over the interval.
    fn linear<S: WideSource>(
        &mut self,
        set: &S,
        ids: &[u32],
        over: TimeInterval,
        segment: usize,
    ) -> Result<Part, BuildError> {
        let mut references: Vec<Reference> = ids.iter().map(|&id| reference(set, id, over)).collect();
        let binary = build_binary(&mut references, BINARY_LEAF);
        let collapse = Collapse::new(&binary, PRICES, |node| {
            (node.count as usize <= PRICES.most).then_some(PRICES.leaf + PRICES.primitive * node.count as f32)
        });
        let bounds = binary[0].bounds;
        if binary[0].moving
            && over == TimeInterval::FULL
            && let Some(segments) = Segments::choose(set, &references, &binary, &collapse)
        {
            let root = self.segments(set, &references, &segments)?;
            return Ok(Part { bounds, root });
        }
        let root = Nodes {
            binary: &binary,
            collapse: &collapse,
            over,
            leaf: |arena: &mut Arena, node: &BinaryNode| leaf(arena, set, &references, node, segment),
        }
        .write(&mut self.arena)?;
        Ok(Part { bounds, root })
    }

    /// Writes the leaf blocks once and the nodes above them for each segment.
    fn segments<S: WideSource>(
        &mut self,
        set: &S,
        references: &[Reference],
        segments: &Segments,
    ) -> Result<ChildRef, BuildError> {
        let mut blocks = Vec::with_capacity(segments.clusters.len());
        for node in &segments.clusters {
            blocks.push(leaf(&mut self.arena, set, references, node, 0)?);
        }
        let mut parts = Vec::new();
        for tree in &segments.trees {
            parts.push(
                Nodes {
                    binary: &tree.binary,
                    collapse: &tree.collapse,
                    over: tree.over,
                    leaf: |_: &mut Arena, node: &BinaryNode| Ok(blocks[tree.order[node.first as usize] as usize]),
                }
                .write(&mut self.arena)?,
            );
        }
        write_time(&mut self.arena, &parts)
    }

    /// Puts a node above several trees.
    fn join(&mut self, mut parts: Vec<Part>) -> Result<ChildRef, BuildError> {
        while parts.len() > 1 {
            let mut joined = Vec::new();
            for some in parts.chunks(LANES) {
                let boxes: Vec<LinearBox3> = some.iter().map(|p| p.bounds).collect();
                let root = write_node(&mut self.arena, &boxes, TimeInterval::FULL)?;
                let refs: Vec<ChildRef> = some.iter().map(|p| p.root).collect();
                set_children(&mut self.arena, root, &refs);
                joined.push(Part { bounds: boxes.into_iter().fold(LinearBox3::EMPTY, LinearBox3::union), root });
            }
            parts = joined;
        }
        Ok(parts.first().map_or(ChildRef::NOTHING, |p| p.root))
    }
}

/// A subtree that is written: where it is over the whole shutter, and its root.
struct Part {
    bounds: LinearBox3,
    root: ChildRef,
}

fn reference<S: WideSource>(set: &S, id: u32, over: TimeInterval) -> Reference {
    let bounds = set.bounds(id, over);
    Reference { bounds, id, moving: bounds.begin != bounds.end }
}

fn leaf<S: WideSource>(
    arena: &mut Arena,
    set: &S,
    references: &[Reference],
    node: &BinaryNode,
    segment: usize,
) -> Result<ChildRef, BuildError> {
    let of = &references[node.first as usize..][..node.count as usize];
    let mut ids = [0; LANES];
    for (id, r) in ids.iter_mut().zip(of) {
        *id = r.id;
    }
    let ids = &mut ids[..of.len()];
    // In the order of ids the first of several equally near hits is the one that wins.
    ids.sort_unstable();
    arena.align();
    let shape = set.leaf_shape(ids);
    let at = set.write_leaf(arena, shape, ids, segment);
    ChildRef::new(shape.kind(), at, ids.len()).ok_or(BuildError::TooLargeTree)
}

/// Part `i` of `n` equal parts of the shutter, a little wider on both sides: queries find their part by
/// `t * n` rounded, which is off by less than 2^-23 of the shutter.
fn part_of_shutter(i: usize, n: usize) -> TimeInterval {
    let begin = (i as f64 / n as f64 - 2.4e-7) as f32;
    let end = if i + 1 == n { 2.0 } else { ((i + 1) as f64 / n as f64 + 2.4e-7) as f32 };
    TimeInterval::half_open(begin, end).expect("a part of the shutter is not empty")
}

/// Several hierarchies over the same leaf blocks, one for each part of the shutter.
struct Segments {
    /// The binary nodes that are leaf blocks.
    clusters: Vec<BinaryNode>,
    trees: Vec<Segment>,
}

struct Segment {
    over: TimeInterval,
    binary: BinaryTree,
    collapse: Collapse,
    /// The cluster at each place of the binary tree's order.
    order: Vec<u32>,
}

impl Segments {
    /// Divides the shutter in 2, 4, 8, … as long as the expected cost of a ray falls enough; nothing where
    /// already two parts do not pay.
    fn choose<S: WideSource>(
        set: &S,
        references: &[Reference],
        binary: &[BinaryNode],
        collapse: &Collapse,
    ) -> Option<Segments> {
        let clusters = collapse.leaves(binary);
        let mut best = None;
        let mut cost = collapse.total;
        let mut parts = 2;
        while parts <= MOST_SEGMENTS {
            let trees: Vec<Segment> =
                (0..parts).map(|i| Segment::build(set, references, &clusters, part_of_shutter(i, parts))).collect();
            let divided = trees.iter().map(|t| t.collapse.total).sum::<f32>() / parts as f32;
            if divided > cost * WORTH_DIVIDING {
                break;
            }
            cost = divided;
            best = Some(trees);
            parts *= 2;
        }
        best.map(|trees| Segments { clusters, trees })
    }
}

impl Segment {
    fn build<S: WideSource>(set: &S, references: &[Reference], clusters: &[BinaryNode], over: TimeInterval) -> Segment {
        let mut blocks: Vec<Reference> = clusters
            .iter()
            .enumerate()
            .map(|(i, node)| {
                let of = &references[node.first as usize..][..node.count as usize];
                let bounds = of.iter().fold(LinearBox3::EMPTY, |b, r| b.union(set.bounds(r.id, over)));
                Reference { bounds, id: i as u32, moving: node.moving }
            })
            .collect();
        let binary = build_binary(&mut blocks, 1);
        let collapse = Collapse::new(&binary, PRICES, |node| {
            (node.count == 1).then(|| {
                let block = &clusters[blocks[node.first as usize].id as usize];
                PRICES.leaf + PRICES.primitive * block.count as f32
            })
        });
        Segment { over, binary, collapse, order: blocks.iter().map(|b| b.id).collect() }
    }
}
