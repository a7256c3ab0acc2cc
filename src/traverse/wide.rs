//! The traversal of the wide layout, for any query: rays, points and regions.
//!
//! A query ([`WideQuery`]) tests sixteen boxes at a time and returns which of them to enter with a key for each, visits
//! leaf blocks, and gives the limit above which keys are culled. The traversal handles the rest: kinds of blocks, the
//! hierarchy of the query's time slice, the order of visits, the stack and prefetching.
//!
//! Latency dominates, not arithmetic: of the dependency chain from one node's rows to the next node's address (some
//! forty cycles), of memory, and of mispredicted branches. So the code is written for short dependency chains, for
//! early knowledge of the addresses that will be read, and for few branches that depend on the query.

use crate::geometry::KeyTime;
use crate::layout::{ChildRef, KeyedRows, Kind, NODE_ROWS, STATIC_NODE_ROWS, WideTree};
use crate::simd::{Arena, LANES, Lanes, Mask, Simd, Stack, StackMemory, lanes_at};
use crate::tuning::wide::{AHEAD, KEYED_AHEAD};
use core::ops::ControlFlow;

/// Stack entries that need no heap allocation: a page of memory, enough for a tree of fifteen levels.
pub(crate) const STACK: usize = 512;

/// Cache lines of a block of many keys: of its front, and of the rows of two keys of a dozen vertices, as many as most blocks have.
const FRONT_LINES: usize = 2;
const ROW_LINES: usize = 6;

/// Memory for the stack of one query.
pub(crate) type StackOf = StackMemory<u64, STACK>;

/// The rows of a node.
pub(crate) type NodeBlock = [f32; LANES * LANES];

/// A query of a tree in the wide layout.
pub(crate) trait WideQuery<S: Simd> {
    /// Whether children are visited front to back; otherwise in any order.
    const ORDERED: bool;
    /// The time of the query in the shutter.
    fn time(&self) -> f32;
    /// Whether everything in a block is hidden from the query, so that it need not be visited.
    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        let _ = block;
        false
    }
    /// A node is about to be tested.
    fn node(&mut self);
    /// The children of a node of `ROWS` rows that are to be visited, and a key for each: smaller keys are visited
    /// first. A key below zero counts as zero. Lanes without a child have boxes from 1e30 down to -1e30.
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F);
    /// Children with a greater key are culled. Not below zero.
    fn limit(&self) -> f32;
    /// Visits a leaf block; `Break` ends the query.
    fn leaf(&mut self, s: S, leaf: ChildRef) -> ControlFlow<()>;
}

/// The state of a traversal: the next block and the stack.
pub(crate) struct Cursor<'a> {
    /// The block to visit next.
    pub at: ChildRef,
    /// Blocks to visit later: keys in the high halves, child references in the low.
    stack: Stack<'a, u64>,
}

impl<'a> Cursor<'a> {
    #[inline(always)]
    pub fn new(root: ChildRef, stack: Stack<'a, u64>) -> Cursor<'a> {
        Cursor { at: root, stack }
    }

    /// Starts again at the root.
    #[inline(always)]
    pub fn restart(&mut self, root: ChildRef) {
        self.at = root;
        self.stack.clear();
    }
}

/// A tree to be traversed.
#[derive(Clone, Copy)]
pub(crate) struct WideTraversal<'a> {
    arena: &'a Arena,
    /// What is prefetched of the blocks that a query will visit: [`NOTHING`], [`ALL`], or, from [`KEYS`] on, blocks of many
    /// keys as well, of which the query reads the rows of key `ahead - KEYS` and of the next. One number, so that most
    /// queries make one comparison per node.
    ahead: u32,
}

/// What is prefetched.
const NOTHING: u32 = 0;
const ALL: u32 = 1;
const KEYS: u32 = 2;

impl<'a> WideTraversal<'a> {
    /// For a query that is traversed alone.
    #[inline(always)]
    pub fn new(arena: &'a Arena) -> WideTraversal<'a> {
        WideTraversal { arena, ahead: if arena.len() > AHEAD { ALL } else { NOTHING } }
    }

    /// For a query at one time, traversed alone. In large trees the rows of that time are prefetched as well.
    #[inline(always)]
    pub fn at_time(tree: &'a WideTree, time: f32) -> WideTraversal<'a> {
        match tree.keyed_rows.at(time) {
            Some(key) if tree.arena.len() > KEYED_AHEAD => WideTraversal { arena: &tree.arena, ahead: KEYS + key },
            _ => WideTraversal::new(&tree.arena),
        }
    }

    /// For several interleaved queries, each of which prefetches its next block itself.
    #[inline(always)]
    pub fn interleaved(arena: &'a Arena) -> WideTraversal<'a> {
        WideTraversal { arena, ahead: NOTHING }
    }

    /// Visits the next block. `Break` when the traversal is complete.
    #[inline(always)]
    pub fn advance<S: Simd, Q: WideQuery<S>>(self, s: S, cursor: &mut Cursor<'_>, query: &mut Q) -> ControlFlow<()> {
        let at = cursor.at;
        let next = match at.kind() {
            _ if query.hides(at) => None,
            Kind::Node => self.step::<S, NODE_ROWS, Q>(s, at, query, &mut cursor.stack),
            Kind::StaticNode => self.step::<S, STATIC_NODE_ROWS, Q>(s, at, query, &mut cursor.stack),
            Kind::Time => Some(of_time_slice(self.arena, at, query.time())),
            _ => {
                query.leaf(s, at)?;
                None
            }
        };
        if let Some(next) = next {
            cursor.at = next;
            return ControlFlow::Continue(());
        }
        let limit = u64::from(query.limit().to_bits());
        loop {
            match cursor.stack.pop() {
                Some(entry) if entry >> 32 <= limit => {
                    cursor.at = ChildRef(entry as u32);
                    return ControlFlow::Continue(());
                }
                Some(_) => {}
                None => return ControlFlow::Break(()),
            }
        }
    }

    /// Tests the sixteen boxes of a node, pushes all children that are to be visited but one, and returns that one: the
    /// nearest, or any where order does not matter.
    ///
    /// Unordered queries also test the node on top of the stack if it is of the same kind, so that loads and masks of
    /// the two nodes overlap.
    #[inline(always)]
    fn step<S: Simd, const ROWS: usize, Q: WideQuery<S>>(
        self,
        s: S,
        node: ChildRef,
        query: &mut Q,
        stack: &mut Stack<'_, u64>,
    ) -> Option<ChildRef> {
        query.node();
        if !Q::ORDERED
            && let Some(top) = stack.top()
            && let top = ChildRef(top as u32)
            && top.kind() == node.kind()
        {
            stack.pop();
            query.node();
            let (a, b) = (self.arena.block(node.at()), self.arena.block(top.at()));
            let (in_a, _) = query.enter::<ROWS>(s, a);
            let (in_b, _) = query.enter::<ROWS>(s, b);
            for (mask, block) in [(in_b, b), (in_a, a)] {
                let children = children_of::<ROWS>(block);
                self.prefetch::<ROWS>(children, mask);
                stack.push_lanes(s, s.to_bits(s.load(children)), mask);
            }
            return None;
        }
        let block = self.arena.block(node.at());
        let (mask, keys) = query.enter::<ROWS>(s, block);
        let children = children_of::<ROWS>(block);
        if mask == 0 {
            return None;
        }
        let lane = last_lane(mask);
        let first = ChildRef(children[lane as usize % LANES].to_bits());
        let others = mask ^ (1 << lane);
        self.prefetch::<ROWS>(children, mask);
        if !Q::ORDERED {
            stack.push_lanes(s, s.to_bits(s.load(children)), others);
            return Some(first);
        }
        if others == 0 {
            return Some(first);
        }
        Some(push_in_order::<S>(s, mask, keys, s.to_bits(s.load(children)), stack))
    }

    /// Prefetches the blocks of some children of a node, where that pays. Of a block of many keys these are the front and the
    /// rows of one key and the next: such a block is as long as a page, and the position of the rows would otherwise be known
    /// only after the front has arrived.
    #[inline(always)]
    fn prefetch<const ROWS: usize>(self, children: &Lanes<f32>, mut mask: Mask) {
        if self.ahead == NOTHING {
            return;
        }
        let all = self.arena.len() > AHEAD;
        // Blocks of many keys are below nodes with moving boxes.
        let keys = self.ahead >= KEYS && ROWS == NODE_ROWS;
        if !all && !keys {
            return;
        }
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            let child = ChildRef(children[lane].to_bits());
            if keys && child.kind() == Kind::OtherLeaf {
                self.arena.prefetch(child.at(), FRONT_LINES);
                self.arena.prefetch(KeyedRows::begin(child, self.ahead - KEYS), ROW_LINES);
            } else if all {
                self.arena.prefetch_block(child.at());
            }
        }
    }
}

/// The highest lane of a mask, which must not be 0.
#[inline(always)]
fn last_lane(mask: Mask) -> u32 {
    // Shifted up, since for the mask itself compilers emit `bsr`, which takes eight operations on some CPUs.
    Mask::BITS - 1 - (u32::from(mask) << Mask::BITS).leading_zeros()
}

/// The root of the hierarchy for the time slice that contains a time.
#[inline(always)]
pub(crate) fn of_time_slice(arena: &Arena, node: ChildRef, time: f32) -> ChildRef {
    let words = &arena.ints()[node.at()..];
    ChildRef(words[1 + KeyTime::new(time, words[0] as usize + 1).segment])
}

/// The row of a node's children.
#[inline(always)]
pub(crate) fn children_of<const ROWS: usize>(block: &NodeBlock) -> &Lanes<f32> {
    lanes_at(block, (ROWS - 1) * LANES)
}

/// Pushes the references of the mask, at least two, farthest first, and returns the nearest.
#[inline(always)]
fn push_in_order<S: Simd>(s: S, mask: Mask, keys: S::F, references: S::U, stack: &mut Stack<'_, u64>) -> ChildRef {
    let n = mask.count_ones() as usize;
    let mut d = [0; LANES];
    let mut c = [0; LANES];
    s.store_compressed_u(s.to_bits(keys), mask, &mut d);
    s.store_compressed_u(references, mask, &mut c);
    let entry = |i: usize| u64::from(d[i]) << 32 | u64::from(c[i]);
    if n <= 4 {
        // A sorting network of four, in which missing entries count as nearest and so end up last. The nearest entry
        // depends on two comparisons only.
        let entry_or = |i: usize, missing: u64| if i < n { entry(i) } else { missing };
        let nearest = entry(0).min(entry(1)).min(entry_or(2, u64::MAX).min(entry_or(3, u64::MAX)));
        let descending = |a: u64, b: u64| if a < b { (b, a) } else { (a, b) };
        let (a, b) = descending(entry(0), entry(1));
        let (c, d) = descending(entry_or(2, 0), entry_or(3, 0));
        let (a, c) = descending(a, c);
        let (b, d) = descending(b, d);
        let (b, c) = descending(b, c);
        let _ = d;
        stack.push_first([a, b, c], n - 1);
        return ChildRef(nearest as u32);
    }
    let packed = s.from_bits(s.load_u(&d));
    let valid = ((1u32 << n) - 1) as Mask;
    let mut places = [0; LANES];
    for (i, place) in places.iter_mut().enumerate().take(n) {
        let own = s.from_bits(s.splat_u(d[i]));
        let farther = s.lt(own, packed) & valid;
        let equal_before = s.eq(own, packed) & (((1u32 << i) - 1) as Mask);
        *place = (farther.count_ones() + equal_before.count_ones()) as usize;
    }
    stack.push_ranked(n, |i| (places[i], entry(i)));
    ChildRef(stack.pop().unwrap_or(0) as u32)
}
