//! A tree before it is written: references, binary tree, and how that collapses into wide nodes.
//!
//! Long primitives fill little of their boxes. Where that is so, they are cut into several references under a
//! budget before the build, if the expected cost of a ray falls enough in samples: a few neighbourhoods of some
//! hundred references, with and without cuts. The cost of a tree is the sum over its nodes and leaf blocks of price
//! times mean area, which the collapse returns.

use crate::bvh::{BinaryNode, BinaryTree, Collapse, Prices, Reference, build_binary, cut, neighbourhoods};
use crate::geometry::{Box3, TimeInterval};
use crate::parallel;
use crate::params::BuildParams;
use crate::primitive::PrimitiveSet;
use crate::simd::huge_vec;
use core::ops::RangeInclusive;

/// Prices of a query's steps, relative to each other. A primitive at .15 instead of about .07 makes smaller leaves,
/// which costs 4 to 10 % of the speed on the scenes coherent, debris and tornado.
pub(crate) const PRICES: Prices = Prices { node: 2.0, leaf: 1.0, primitive: 0.07, still: 0.7, most: 16 };

/// References at which the binary tree stops, or where they are crowded; the collapse joins its leaves again.
const BINARY_LEAF: RangeInclusive<usize> = 8..=16;

/// Cuts are taken where they cost less than this part: they also take memory.
const WORTH_CUTS: f32 = 0.95;

/// Where cuts cost so much instead of no cuts in one sample, the next is asked as well.
const DOUBTFUL: RangeInclusive<f32> = 0.9..=1.0;

/// Cuts are tried where the boxes have more than this many times the area of the triangles in them.
const HOLLOW: f64 = 8.0;

/// Cuts are decided on neighbourhoods of a sixteenth of all references together, each in these bounds.
const CUT_SAMPLES: usize = 2;
const CUT_SAMPLE: RangeInclusive<usize> = 512..=4096;

/// Bytes that a reference costs in nodes and leaf blocks together, at most about.
pub(crate) const BYTES_PER_REFERENCE: f32 = 110.0;

/// A planned tree over an interval of the shutter in which all motion is linear.
pub(crate) struct Plan {
    pub over: TimeInterval,
    /// The key segment that leaf blocks are written for.
    pub segment: usize,
    pub references: Vec<Reference>,
    /// Number of primitives that they are of.
    pub primitives: usize,
    /// Whether references may be parts of primitives.
    pub cut: bool,
    pub binary: BinaryTree,
    pub collapse: Collapse,
}

impl Plan {
    /// The references below a binary node.
    pub fn references(&self, node: &BinaryNode) -> &[Reference] {
        &self.references[node.first as usize..][..node.count as usize]
    }
}

/// Part `i` of `n` equal parts of the shutter, a little wider on both sides: queries find their part by
/// `t * n` rounded, which is off by less than 2^-23 of the shutter.
pub(crate) fn part_of_shutter(i: usize, n: usize) -> TimeInterval {
    if n == 1 {
        return TimeInterval::FULL;
    }
    let begin = (i as f64 / n as f64 - 2.4e-7) as f32;
    let end = if i + 1 == n { 2.0 } else { ((i + 1) as f64 / n as f64 + 2.4e-7) as f32 };
    TimeInterval::half_open(begin, end).expect("a part of the shutter is not empty")
}

/// Plans one tree, with cuts where they pay.
pub(crate) fn plan_tree<S: PrimitiveSet>(
    set: &S,
    ids: &[u32],
    over: TimeInterval,
    segment: usize,
    params: &BuildParams,
) -> Plan {
    let budget = params.wide_references.min(params.bytes_per_primitive / BYTES_PER_REFERENCE);
    let hollow = budget > 1.0 && hollowness(set, ids, over) >= HOLLOW;
    // Room for parts from the start: memory that is not touched costs nothing.
    let most = if hollow { (ids.len() as f64 * f64::from(budget)) as usize + 1 } else { ids.len() };
    let mut references = huge_vec(most);
    parallel::fill(&mut references, ids.len(), |i| Reference::new(set.bounds(ids[i], over), ids[i]));
    let worth = hollow && cuts_pay(set, &references, over, segment, budget);
    if worth {
        cut(&mut references, |id| set.ends(id, over), budget);
    }
    Plan { primitives: ids.len(), ..plan_with(references, over, segment, worth) }
}

/// Whether cuts pay in a few samples of neighbouring references.
fn cuts_pay<S: PrimitiveSet>(
    set: &S,
    references: &[Reference],
    over: TimeInterval,
    segment: usize,
    budget: f32,
) -> bool {
    let n = references.len();
    let most = (n / (16 * CUT_SAMPLES)).clamp(*CUT_SAMPLE.start(), *CUT_SAMPLE.end());
    let (mut with, mut without) = (0.0, 0.0);
    for sample in neighbourhoods(references, CUT_SAMPLES, most) {
        let cost = |references: Vec<Reference>| plan_with(references, over, segment, true).collapse.total();
        let mut parts = sample.clone();
        cut(&mut parts, |id| set.ends(id, over), budget);
        let (cut, uncut) = parallel::both(|| cost(parts), || cost(sample));
        with += cut;
        without += uncut;
        if !DOUBTFUL.contains(&(with / without)) {
            break;
        }
    }
    with < without * WORTH_CUTS
}

/// Plans one tree; `cut` says whether references may be parts of primitives.
fn plan_with(mut references: Vec<Reference>, over: TimeInterval, segment: usize, cut: bool) -> Plan {
    let binary = build_binary(&mut references, BINARY_LEAF);
    let collapse = Collapse::new(&binary, PRICES, |node| {
        (node.count as usize <= PRICES.most).then_some(PRICES.leaf + PRICES.primitive * node.count as f32)
    });
    let primitives = references.len();
    Plan { over, segment, references, primitives, cut, binary, collapse }
}

/// Half-areas of the boxes, summed, per area of the triangles in them; 0 for what cannot be cut.
fn hollowness<S: PrimitiveSet>(set: &S, ids: &[u32], over: TimeInterval) -> f64 {
    let (mut boxes, mut triangles) = (0.0, 0.0);
    // A thousand or two tell.
    for &id in ids.iter().step_by(ids.len() / 2048 + 1) {
        let Some(ends) = set.ends(id, over) else { return 0.0 };
        boxes += f64::from(ends.begin.into_iter().fold(Box3::EMPTY, Box3::include).half_area());
        triangles += f64::from(ends.area());
    }
    if triangles > 0.0 { boxes / triangles } else { 0.0 }
}

/// How many leaf blocks ahead the numbers of vertices are asked for; the vertices follow one block ahead.
const AHEAD: usize = 4;

/// Asks for what will be read when it is the turn of the blocks behind block `i`.
pub(crate) fn expect<S: PrimitiveSet>(set: &S, plan: &Plan, of: &[BinaryNode], i: usize) {
    let next = if i == 0 { 0..of.len().min(AHEAD + 1) } else { i + AHEAD..of.len().min(i + AHEAD + 1) };
    for node in of.get(next).unwrap_or_default() {
        plan.references(node).iter().for_each(|r| set.expect(r.id()));
    }
    for node in of.iter().skip(i + 1).take(1) {
        plan.references(node).iter().for_each(|r| set.expect_vertices(r.id()));
    }
}
