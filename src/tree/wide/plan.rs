//! What to build, chosen by the expected cost of a ray.
//!
//! The cost of a tree is the sum over its nodes and leaf blocks of price times mean area, which the collapse
//! returns. A greedy decision at one node cannot see what a division of time gains further down, so whole
//! alternatives are made and compared:
//! - *cuts*: spatial splits under a budget of references, where primitives fill little of their boxes;
//! - *segments*: several hierarchies over the same leaf blocks, one per part of the shutter;
//! - *copies*: separate trees per part of the shutter, where neighbours part company so fast that even leaf
//!   blocks should be formed anew.
//!
//! Each is tried only where a cheap sign says that it may pay, and further only while the last step paid.

use super::build::Step;
use super::leaf::WideSource;
use crate::build::BuildParams;
use crate::build::object::{BinaryNode, BinaryTree, Collapse, Ends, Prices, Reference, build_binary};
use crate::error::BuildError;
use crate::motion::{LinearBox3, TimeInterval, ULP};
use crate::simd::huge_vec;

/// Prices of a query's steps, relative to each other. Speed depends little on them: half or one and a half
/// times those of nodes and primitives make no difference beyond noise on the scenes hall and coherent.
const PRICES: Prices = Prices { node: 2.0, leaf: 1.0, primitive: 0.15, still: 0.7, most: 16 };

/// References at which the binary tree stops; the collapse joins its leaves again.
const BINARY_LEAF: usize = 4;

/// A finer division of the shutter into segments is taken where it costs less than this part of the coarser.
const WORTH_SEGMENTS: f32 = 0.9;

/// Two segments that cost less than this part of the whole say that neighbours part company: try copies.
const INCOHERENT: f32 = 0.7;

/// Twice as many copies are taken where they cost less than this part.
const WORTH_COPIES: f32 = 0.75;

/// Cuts are taken where they cost less than this part: they also take memory.
const WORTH_CUTS: f32 = 0.95;

/// Cuts are tried where the boxes have more than this many times the area of the triangles in them.
const HOLLOW: f64 = 8.0;

/// Up to this many references the whole scene is cut to find out.
const SMALL: usize = 100_000;

/// How many samples of how many references decide whether a bigger scene is worth cutting.
const SAMPLES: usize = 4;
const SAMPLE: usize = 4096;

/// Most segments or copies.
const MOST_PARTS: usize = 16;

/// Bytes that a reference costs in nodes and leaf blocks together, roughly.
const BYTES_PER_REFERENCE: f64 = 110.0;

/// Copies never make the tree larger than this, three quarters of what its references can number.
const MOST_BYTES: f64 = 1.5 * (1u64 << 30) as f64;

/// A planned tree over an interval of the shutter in which all motion is linear.
pub(super) struct Plan {
    pub over: TimeInterval,
    /// The key segment that leaf blocks are written for.
    pub segment: usize,
    pub references: Vec<Reference>,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    pub segments: Option<Segments>,
}

impl Plan {
    fn cost(&self) -> f32 {
        self.segments.as_ref().map_or(self.collapse.total(), |s| s.cost)
    }
}

/// Several hierarchies over the same leaf blocks, one for each part of the shutter.
pub(super) struct Segments {
    /// The binary nodes that are leaf blocks.
    pub clusters: Vec<BinaryNode>,
    pub trees: Vec<Segment>,
    cost: f32,
}

/// One of them.
pub(super) struct Segment {
    pub over: TimeInterval,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    /// The cluster at each place of the binary tree's order.
    pub order: Vec<u32>,
}

/// Part `i` of `n` equal parts of the shutter, a little wider on both sides: queries find their part by
/// `t * n` rounded, which is off by less than 2^-23 of the shutter.
pub(super) fn part_of_shutter(i: usize, n: usize) -> TimeInterval {
    if n == 1 {
        return TimeInterval::FULL;
    }
    let begin = (i as f64 / n as f64 - 2.4e-7) as f32;
    let end = if i + 1 == n { 2.0 } else { ((i + 1) as f64 / n as f64 + 2.4e-7) as f32 };
    TimeInterval::half_open(begin, end).expect("a part of the shutter is not empty")
}

/// Plans for equal parts of the shutter (often one), whichever number costs least.
pub(super) fn plan_copies<S: WideSource>(
    set: &S,
    ids: &[u32],
    params: &BuildParams,
    step: Step<'_>,
) -> Result<Vec<Plan>, BuildError> {
    let first = plan_tree(set, ids, TimeInterval::FULL, 0, params);
    step(0.5)?;
    if !first.binary.first().is_some_and(|root| root.moving) {
        step(0.25)?;
        return Ok(vec![first]);
    }
    let halves = Segments::build(set, &first, 2);
    step(0.25)?;
    if halves.cost < first.cost() * INCOHERENT {
        let copies = more_copies(set, ids, params, halves.cost);
        if !copies.is_empty() {
            return Ok(copies);
        }
    }
    Ok(vec![with_segments(set, first, halves)])
}

/// Separate plans for 2, 4, 8, … parts as long as they pay; none where already two cost more than `cost`
/// or the memory does not suffice.
fn more_copies<S: WideSource>(set: &S, ids: &[u32], params: &BuildParams, mut cost: f32) -> Vec<Plan> {
    let mut best = Vec::new();
    let mut parts = 2;
    let fits = |parts: usize| {
        let each = parts as f64 * BYTES_PER_REFERENCE;
        each <= f64::from(params.bytes_per_primitive) && each * ids.len() as f64 <= MOST_BYTES
    };
    while parts <= MOST_PARTS && fits(parts) {
        let plans: Vec<Plan> = (0..parts).map(|i| plan_tree(set, ids, part_of_shutter(i, parts), 0, params)).collect();
        let divided = plans.iter().map(Plan::cost).sum::<f32>() / parts as f32;
        // The first step competes with segments, which cost hardly any memory.
        if divided > cost * if best.is_empty() { 1.0 } else { WORTH_COPIES } {
            break;
        }
        (cost, best) = (divided, plans);
        parts *= 2;
    }
    best
}

/// Adds as many segments as pay.
fn with_segments<S: WideSource>(set: &S, plan: Plan, halves: Segments) -> Plan {
    let mut best = None;
    let mut cost = plan.cost();
    let mut next = halves;
    while next.cost <= cost * WORTH_SEGMENTS {
        cost = next.cost;
        let parts = 2 * next.trees.len();
        best = Some(next);
        if parts > MOST_PARTS {
            break;
        }
        next = Segments::build(set, &plan, parts);
    }
    Plan { segments: best, ..plan }
}

/// Plans one tree, with cuts where they pay.
pub(super) fn plan_tree<S: WideSource>(
    set: &S,
    ids: &[u32],
    over: TimeInterval,
    segment: usize,
    params: &BuildParams,
) -> Plan {
    let mut references = huge_vec(ids.len());
    references.extend(ids.iter().map(|&id| reference(set, id, over)));
    let plain = plan_with(set, references, over, segment, 1.0);
    let budget = params.wide_references.min(params.bytes_per_primitive / BYTES_PER_REFERENCE as f32);
    if budget <= 1.0 || hollowness(set, &plain.references, over) < HOLLOW || !cuts_pay(set, &plain, budget) {
        return plain;
    }
    let cut = plan_with(set, plain.references.clone(), over, segment, budget);
    if cut.cost() < plain.cost() * WORTH_CUTS { cut } else { plain }
}

/// Whether cuts pay in a few samples of neighbouring references; big scenes need not be cut to find out.
fn cuts_pay<S: WideSource>(set: &S, plain: &Plan, budget: f32) -> bool {
    let n = plain.references.len();
    if n <= SMALL {
        return true;
    }
    let (mut with, mut without) = (0.0, 0.0);
    for i in 0..SAMPLES {
        let first = (2 * i + 1) * n / (2 * SAMPLES) - SAMPLE / 2;
        let sample = &plain.references[first..first + SAMPLE];
        with += plan_with(set, sample.to_vec(), plain.over, plain.segment, budget).cost();
        without += plan_with(set, sample.to_vec(), plain.over, plain.segment, 1.0).cost();
    }
    with < without * WORTH_CUTS
}

/// Plans one tree with room for `budget` references per primitive.
fn plan_with<S: WideSource>(
    set: &S,
    mut references: Vec<Reference>,
    over: TimeInterval,
    segment: usize,
    budget: f32,
) -> Plan {
    let n = references.len();
    if let Some(&any) = references.first() {
        references.resize((n as f64 * f64::from(budget)) as usize, any);
    }
    let binary = build_binary(&mut references, n, BINARY_LEAF, &|id| set.ends(id, over));
    let collapse = Collapse::new(&binary, PRICES, |node| {
        (node.count as usize <= PRICES.most).then_some(PRICES.leaf + PRICES.primitive * node.count as f32)
    });
    Plan { over, segment, references, binary, collapse, segments: None }
}

/// Half-areas of the boxes, summed, per area of the triangles in them; 0 for what cannot be cut.
fn hollowness<S: WideSource>(set: &S, references: &[Reference], over: TimeInterval) -> f64 {
    let (mut boxes, mut triangles) = (0.0, 0.0);
    // A few thousand tell.
    for r in references.iter().step_by(references.len() / 4096 + 1) {
        let Some(ends) = set.ends(r.id(), over) else { return 0.0 };
        let [a, b, c] = ends.begin;
        boxes += f64::from(r.bounds().begin.half_area());
        triangles += f64::from((b - a).cross(c - a).length() * 0.5);
    }
    if triangles > 0.0 { boxes / triangles } else { 0.0 }
}

fn reference<S: WideSource>(set: &S, id: u32, over: TimeInterval) -> Reference {
    Reference::new(set.bounds(id, over), id)
}

/// Bounds of a reference, which are linear over `whole`, in a part of that time: what the primitive's own
/// bounds in that part and the reference's (cut to a cell, perhaps) both hold.
fn part_bounds<S: WideSource>(set: &S, r: &Reference, whole: TimeInterval, over: TimeInterval) -> LinearBox3 {
    let (own, bounds) = (set.bounds(r.id(), over), r.bounds());
    if !r.moving() {
        return own.tighter(bounds);
    }
    let at = |t: f32| {
        let w = ((t - whole.begin()) / whole.duration()).clamp(0.0, 1.0);
        // One interpolation: three roundings at sizes of at most 2.
        bounds.at(w).pad(8.0 * ULP)
    };
    own.tighter(LinearBox3 { begin: at(over.begin()), end: at(over.end()) })
}

impl Segments {
    /// Rebuilds the nodes above a plan's leaf blocks for `parts` equal parts of the shutter.
    fn build<S: WideSource>(set: &S, plan: &Plan, parts: usize) -> Segments {
        let clusters = plan.collapse.leaves(&plan.binary, 0);
        let trees: Vec<Segment> =
            (0..parts).map(|i| Segment::build(set, plan, &clusters, part_of_shutter(i, parts))).collect();
        let cost = trees.iter().map(|t| t.collapse.total()).sum::<f32>() / parts as f32;
        Segments { clusters, trees, cost }
    }
}

impl Segment {
    fn build<S: WideSource>(set: &S, plan: &Plan, clusters: &[BinaryNode], over: TimeInterval) -> Segment {
        let block = |(i, node): (usize, &BinaryNode)| {
            let of = &plan.references[node.first as usize..][..node.count as usize];
            let bounds = of.iter().fold(LinearBox3::EMPTY, |b, r| b.union(part_bounds(set, r, plan.over, over)));
            Reference::new(bounds, i as u32)
        };
        let mut blocks: Vec<Reference> = clusters.iter().enumerate().map(block).collect();
        let n = blocks.len();
        let binary = build_binary(&mut blocks, n, 1, &|_| None::<Ends>);
        let collapse = Collapse::new(&binary, PRICES, |node| {
            (node.count == 1).then(|| {
                let block = &clusters[blocks[node.first as usize].id() as usize];
                PRICES.leaf + PRICES.primitive * block.count as f32
            })
        });
        Segment { over, binary, collapse, order: blocks.iter().map(Reference::id).collect() }
    }
}
