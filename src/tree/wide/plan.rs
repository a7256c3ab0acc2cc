//! What to build, chosen by the expected cost of a ray.
//!
//! The cost of a tree is the sum over its nodes and leaf blocks of price times mean area, which the collapse
//! returns. A greedy decision at one node cannot see what a division of time gains further down, so
//! alternatives are compared as whole trees, but over samples: a few neighbourhoods of some hundred references
//! each. The alternatives:
//! - *cuts*: long primitives as several references under a budget, where they fill little of their boxes;
//! - *segments*: several hierarchies over the same leaf blocks, one per part of the shutter;
//! - *copies*: separate trees per part of the shutter, where neighbours part company so fast that even leaf
//!   blocks should be formed anew.
//!
//! Each is tried only where a cheap sign says that it may pay, and further only while the last step paid. Only
//! what was chosen is built of everything.

use super::build::Step;
use super::leaf::WideSource;
use super::segments::Segments;
use crate::build::BuildParams;
use crate::build::object::{BinaryTree, Collapse, Prices, Reference, build_binary, cut, neighbourhoods};
use crate::error::BuildError;
use crate::motion::TimeInterval;
use crate::parallel;
use crate::simd::huge_vec;

/// Prices of a query's steps, relative to each other. A primitive at .15 instead of about .07 makes smaller leaves,
/// which costs 4 to 10 % of the speed on the scenes coherent, debris and tornado.
pub(super) const PRICES: Prices = Prices { node: 2.0, leaf: 1.0, primitive: 0.07, still: 0.7, most: 16 };

/// References at which the binary tree stops; the collapse joins its leaves again.
const BINARY_LEAF: usize = 6;

/// A finer division of the shutter into segments is taken where it costs less than this part of the coarser.
const WORTH_SEGMENTS: f32 = 0.9;

/// Two segments that cost less than this part of the whole say that neighbours part company: try copies.
const INCOHERENT: f32 = 0.7;

/// Twice as many copies are taken where they cost less than this part; and where they are more bytes than caches
/// hold, less than that: on the scene tornado the work that the step from 4 to 8 copies (137 MB) saves, a quarter, is
/// lost again by waiting for memory.
const WORTH_COPIES: f32 = 0.85;
const WORTH_LARGE_COPIES: f32 = 0.7;
const CACHES: f64 = 32.0 * (1u64 << 20) as f64;

/// Cuts are taken where they cost less than this part: they also take memory.
const WORTH_CUTS: f32 = 0.95;

/// Cuts are tried where the boxes have more than this many times the area of the triangles in them.
const HOLLOW: f64 = 8.0;

/// A division of time is decided on so many subtrees, that together are a sixteenth of all references, each of so
/// many. Smaller ones would say too little for copies: what meets in them at mid-shutter parts company.
const TIME_SAMPLES: core::ops::RangeInclusive<usize> = 4..=16;
const TIME_SAMPLE: core::ops::RangeInclusive<usize> = 1024..=4096;

/// Cuts are decided on neighbourhoods of a sixteenth of all references together, each in these bounds.
const CUT_SAMPLES: usize = 2;
const CUT_SAMPLE: core::ops::RangeInclusive<usize> = 512..=4096;

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
    /// Whether references may be parts of primitives.
    pub cut: bool,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    pub segments: Option<Segments>,
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

/// How the shutter is divided.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Division {
    Whole,
    Segments(usize),
    Copies(usize),
}

/// What costs a ray least.
pub(super) enum Choice {
    /// One tree, perhaps with segments.
    One(Plan),
    /// So many trees for equal parts of the shutter, not planned yet: one at a time takes less memory.
    Copies(usize),
}

/// Plans for the whole shutter, or says into how many copies to divide it.
pub(super) fn choose<S: WideSource>(
    set: &S,
    ids: &[u32],
    params: &BuildParams,
    step: Step<'_>,
) -> Result<Choice, BuildError> {
    let mut whole = plan_tree(set, ids, TimeInterval::FULL, 0, params);
    step(0.5)?;
    let choice = match divide(set, &whole, params) {
        Division::Whole => Choice::One(whole),
        Division::Segments(parts) => {
            whole.segments = Some(Segments::build(set, &whole, 0, parts));
            Choice::One(whole)
        }
        Division::Copies(parts) => Choice::Copies(parts),
    };
    step(0.25)?;
    Ok(choice)
}

/// Decides on a division of the shutter by what it would cost in samples of a plan for the whole.
fn divide<S: WideSource>(set: &S, plan: &Plan, params: &BuildParams) -> Division {
    let samples = samples(plan);
    let sum = |costs: Vec<f32>| costs.into_iter().sum::<f32>();
    let still =
        sum(samples.iter().filter(|&&x| !plan.binary[x as usize].moving).map(|&x| plan.collapse.cost(x)).collect());
    let moving: Vec<u32> = samples.into_iter().filter(|&x| plan.binary[x as usize].moving).collect();
    if moving.is_empty() {
        return Division::Whole;
    }
    let whole = still + sum(moving.iter().map(|&x| plan.collapse.cost(x)).collect());
    let segments = |parts: usize| {
        still + sum(parallel::map(moving.len(), |i| Segments::build(set, plan, moving[i], parts).cost()))
    };
    let halves = segments(2);
    if halves < whole * INCOHERENT {
        let copies = |parts: usize| {
            let each = |i: usize| copies_cost(set, plan, moving[i], parts);
            still + sum(parallel::map(moving.len(), each))
        };
        let n = plan.binary[0].count as f64;
        let fits = |parts: usize| {
            let each = parts as f64 * BYTES_PER_REFERENCE;
            each <= f64::from(params.bytes_per_primitive) && each * n <= MOST_BYTES
        };
        // The first step competes with segments, which cost hardly any memory.
        let (mut best, mut cost, mut worth) = (1, halves, 1.0);
        while 2 * best <= MOST_PARTS && fits(2 * best) {
            let next = copies(2 * best);
            if next > cost * worth {
                break;
            }
            (best, cost) = (2 * best, next);
            let bytes = 2.0 * best as f64 * BYTES_PER_REFERENCE * n;
            worth = if bytes > CACHES { WORTH_LARGE_COPIES } else { WORTH_COPIES };
        }
        if best > 1 {
            return Division::Copies(best);
        }
    }
    let (mut best, mut cost, mut next) = (1, whole, halves);
    while next <= cost * WORTH_SEGMENTS {
        (best, cost) = (2 * best, next);
        if 2 * best > MOST_PARTS {
            break;
        }
        next = segments(2 * best);
    }
    if best > 1 { Division::Segments(best) } else { Division::Whole }
}

/// Evenly spaced subtrees of a plan to decide on; the root alone of a small one.
fn samples(plan: &Plan) -> Vec<u32> {
    let Some(root) = plan.binary.first() else { return Vec::new() };
    let n = root.count as usize;
    let size = (n / 64).clamp(*TIME_SAMPLE.start(), *TIME_SAMPLE.end());
    let count = (n / (16 * size)).clamp(*TIME_SAMPLES.start(), *TIME_SAMPLES.end());
    let mut samples = Vec::with_capacity(count);
    for i in 0..count {
        let (mut x, mut at) = (0, ((2 * i + 1) * n / (2 * count)) as u32);
        loop {
            let node = &plan.binary[x as usize];
            if node.count as usize <= size || node.right == 0 {
                break;
            }
            let left = plan.binary[x as usize + 1].count;
            if at < left {
                x += 1;
            } else {
                (x, at) = (x + node.right, at - left);
            }
        }
        if samples.last() != Some(&x) {
            samples.push(x);
        }
    }
    samples
}

/// Mean cost of separate trees for equal parts of the shutter over the primitives of a subtree.
fn copies_cost<S: WideSource>(set: &S, plan: &Plan, of: u32, parts: usize) -> f32 {
    let mut ids: Vec<u32> =
        plan.collapse.leaves(&plan.binary, of).iter().flat_map(|leaf| references_of(plan, leaf)).collect();
    ids.sort_unstable();
    ids.dedup();
    let cost = |i: usize| {
        let over = part_of_shutter(i, parts);
        plan_with(references(set, &ids, over), over, 0, false).collapse.total()
    };
    (0..parts).map(cost).sum::<f32>() / parts as f32
}

fn references_of<'a>(plan: &'a Plan, node: &crate::build::object::BinaryNode) -> impl Iterator<Item = u32> + use<'a> {
    plan.references[node.first as usize..][..node.count as usize].iter().map(Reference::id)
}

/// Plans one tree, with cuts where they pay.
pub(super) fn plan_tree<S: WideSource>(
    set: &S,
    ids: &[u32],
    over: TimeInterval,
    segment: usize,
    params: &BuildParams,
) -> Plan {
    let mut references = references(set, ids, over);
    let budget = params.wide_references.min(params.bytes_per_primitive / BYTES_PER_REFERENCE as f32);
    let worth = budget > 1.0
        && hollowness(set, &references, over) >= HOLLOW
        && cuts_pay(set, &references, over, segment, budget);
    if worth {
        cut(&mut references, |id| set.ends(id, over), budget);
    }
    plan_with(references, over, segment, worth)
}

fn references<S: WideSource>(set: &S, ids: &[u32], over: TimeInterval) -> Vec<Reference> {
    let mut references = huge_vec(ids.len());
    parallel::fill(&mut references, ids.len(), |i| Reference::new(set.bounds(ids[i], over), ids[i]));
    references
}

/// Whether cuts pay in a few samples of neighbouring references.
fn cuts_pay<S: WideSource>(set: &S, references: &[Reference], over: TimeInterval, segment: usize, budget: f32) -> bool {
    let n = references.len();
    let most = (n / (16 * CUT_SAMPLES)).clamp(*CUT_SAMPLE.start(), *CUT_SAMPLE.end());
    let (mut with, mut without) = (0.0, 0.0);
    for sample in neighbourhoods(references, CUT_SAMPLES, most) {
        let cost = |references: Vec<Reference>| plan_with(references, over, segment, true).collapse.total();
        let mut parts = sample.clone();
        cut(&mut parts, |id| set.ends(id, over), budget);
        with += cost(parts);
        without += cost(sample);
    }
    with < without * WORTH_CUTS
}

/// Plans one tree; `cut` says whether references may be parts of primitives.
fn plan_with(mut references: Vec<Reference>, over: TimeInterval, segment: usize, cut: bool) -> Plan {
    let binary = build_binary(&mut references, BINARY_LEAF);
    let collapse = Collapse::new(&binary, PRICES, |node| {
        (node.count as usize <= PRICES.most).then_some(PRICES.leaf + PRICES.primitive * node.count as f32)
    });
    Plan { over, segment, references, cut, binary, collapse, segments: None }
}

/// Half-areas of the boxes, summed, per area of the triangles in them; 0 for what cannot be cut.
fn hollowness<S: WideSource>(set: &S, references: &[Reference], over: TimeInterval) -> f64 {
    let (mut boxes, mut triangles) = (0.0, 0.0);
    // A few thousand tell.
    for r in references.iter().step_by(references.len() / 4096 + 1) {
        let Some(ends) = set.ends(r.id(), over) else { return 0.0 };
        boxes += f64::from(r.bounds().begin.half_area());
        triangles += f64::from(ends.area());
    }
    if triangles > 0.0 { boxes / triangles } else { 0.0 }
}
