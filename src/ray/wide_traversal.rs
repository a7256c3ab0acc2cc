//! Traversal of the wide layout: one ray against sixteen boxes at a time, down to the leaf blocks.
//!
//! Boxes at the ray's time are one multiply-add per face away from the node's rows. A face `f` is met at
//! `(f - o) / d`, and with `r = 1 / d` computed once, `f * r + (-o r -+ slack |r|)` grows the box by the slack as well, where
//! it costs nothing.
//!
//! Proof that nothing is culled that a leaf would accept: along each axis the computed distance is
//! `(f - o) r -+ slack |r|` up to four roundings relative to `(|f| + |o| + slack) |r|` (two products and the
//! sum of the constant term, the sum with the face's, which is fused or has a product more), below 5 ULP of
//! `(|f| + |o|) |r|`, and `r`, which is in both terms alike, is rounded itself (1). That and what the kernel may stray
//! ([`KERNEL_ULPS`](crate::geometry::KERNEL_ULPS)) grows with the coordinates of what is hit and with the origin's: boxes are
//! padded by the first when they are written, rays have slack for the second. So one vertex far away
//! makes no other box larger. Distances that tie with the limit are kept, since the comparison is `<=`.
//! A ray that begins behind its origin counts distances from its begin, so that none that matters is below zero and
//! integers order like numbers: three more roundings, of sums with that begin, for which its slack is larger.
//! Everything stays finite: coordinates are below 2^102 and reciprocals at most 2^24.
//!
//! A query waits for the chain from one node's rows to the next node's address (some forty cycles, whatever else is done
//! beside it), for memory and for mispredicted branches, more than for arithmetic. So the code is written for short
//! chains, for knowing early what will be read, and for few branches that depend on the ray.

use super::collect::Collect;
use super::filter::Filter;
use super::intersect::RaySource;
use super::leaf::{Between, LeafRay};
use super::observer::Observer;
use super::traverser::Scene;
use super::tree_ray::TreeRay;
use super::walk::Walk;
use crate::geometry::KeyTime;
use crate::layout::{CORNER_ROWS, ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS, WideTree};
use crate::simd::{LANES, Lanes, Mask, Simd, Stack, StackMemory, lanes_at};
use glam::Vec3A;

/// Places on the stack that are there without asking the heap: enough for a tree of ten levels.
const STACK: usize = 352;

/// Words of a tree from which on the blocks that a ray will visit are asked for ahead of time: then they are often not
/// in the cache, and what lies in the cache only pays for the asking.
const AHEAD: usize = 8 << 20;

/// Memory for the stack of one ray.
pub(super) type StackOf = StackMemory<u64, STACK>;

/// A ray as the slab test wants it, per axis.
struct Slabs {
    /// Words from an axis' pair of rows to that of the near faces: none, or a row where the ray goes backward.
    near: [usize; 3],
    inverse: Vec3A,
    near_offset: Vec3A,
    far_offset: Vec3A,
    /// What distances along the ray are greater by here, so that none that counts is below zero; 0 for nearly all rays.
    shift: f32,
    /// Where the ray begins, shifted.
    begin: f32,
    /// When it looks.
    time: f32,
}

impl Slabs {
    #[inline(always)]
    fn new(ray: &TreeRay) -> Slabs {
        let inverse = ray.inverse;
        let at_origin = -Vec3A::from(ray.origin) * inverse + ray.behind;
        let pad = inverse.abs() * ray.slack;
        Slabs {
            near: [backward(ray.world.dir.x), backward(ray.world.dir.y), backward(ray.world.dir.z)],
            inverse,
            near_offset: at_origin - pad,
            far_offset: at_origin + pad,
            shift: ray.behind,
            begin: ray.begin + ray.behind,
            time: ray.time,
        }
    }

    /// A limit for distances, as boxes are compared with it.
    #[inline(always)]
    fn limit(&self, limit: f32) -> f32 {
        limit + self.shift
    }
}

/// A row's words where the sign is negative.
#[inline(always)]
fn backward(component: f32) -> usize {
    (component.to_bits() >> 31) as usize * LANES
}

/// The wide layout with an instruction set to walk it by.
pub(crate) struct Wide<'a, S> {
    pub tree: &'a WideTree,
    pub simd: S,
    /// What waits on the way. It is there before the ray is looked at: the call that a deep tree needs for it would
    /// push the ray out of registers.
    pub stack: Stack<'a, u64>,
}

impl<S: Simd> Walk for Wide<'_, S> {
    #[inline(always)]
    fn walk<G: RaySource>(
        self,
        set: &G,
        ray: &TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        if self.tree.root == ChildRef::NOTHING {
            return;
        }
        let scene = Scene { arena: &self.tree.arena, set, filter, ahead: self.tree.arena.len() > AHEAD };
        let forms = Forms::new(ray);
        let mut journey = Journey::new(self.tree.root, self.stack);
        while scene.advance(self.simd, ray, &forms, &mut journey, collect, observer) {}
    }
}

/// A ray as nodes and as leaf blocks want it.
///
/// This stays in memory. As values that the compiler may keep where it likes, it would spread all of it over
/// vector registers before the first node, which takes longer than some rays live.
pub(super) struct Forms {
    slabs: Slabs,
    leaf: LeafRay,
}

impl Forms {
    #[inline(always)]
    pub fn new(ray: &TreeRay) -> Forms {
        Forms { slabs: Slabs::new(ray), leaf: LeafRay::new(ray) }
    }
}

/// A ray on its way through the tree.
pub(super) struct Journey<'a> {
    /// The block to visit next.
    pub at: ChildRef,
    /// Blocks to visit later: distances in the high halves, references in the low.
    stack: Stack<'a, u64>,
}

impl<'a> Journey<'a> {
    #[inline(always)]
    pub fn new(root: ChildRef, stack: Stack<'a, u64>) -> Journey<'a> {
        Journey { at: root, stack }
    }

    /// Begins anew.
    #[inline(always)]
    pub fn restart(&mut self, root: ChildRef) {
        self.at = root;
        self.stack.clear();
    }
}

impl<G: RaySource, F: Filter> Scene<'_, G, F> {
    /// Visits the next block of a journey, and offers the hits found in it to `collect`. False at the journey's end.
    #[inline(always)]
    pub fn advance<S: Simd, C: Collect>(
        &self,
        s: S,
        ray: &TreeRay,
        forms: &Forms,
        journey: &mut Journey<'_>,
        collect: &mut C,
        observer: &mut impl Observer,
    ) -> bool {
        let at = journey.at;
        let (slabs, leaf_ray, stack) = (&forms.slabs, &forms.leaf, &mut journey.stack);
        let end = match at.kind() {
            Kind::Node => {
                observer.node();
                match self.step::<S, NODE_ROWS, _>(s, at, slabs, collect, stack, observer) {
                    Some(next) => {
                        journey.at = next;
                        return true;
                    }
                    None => false,
                }
            }
            Kind::StillNode => {
                observer.node();
                match self.step::<S, STILL_NODE_ROWS, _>(s, at, slabs, collect, stack, observer) {
                    Some(next) => {
                        journey.at = next;
                        return true;
                    }
                    None => false,
                }
            }
            Kind::Time => {
                let words = &self.arena.ints()[at.at()..];
                let part = KeyTime::new(ray.time, words[0] as usize + 1).segment;
                journey.at = ChildRef(words[1 + part]);
                return true;
            }
            Kind::Leaf => self.leaf::<S, true>(s, at, ray, leaf_ray, collect, observer),
            Kind::StillLeaf => self.leaf::<S, false>(s, at, ray, leaf_ray, collect, observer),
            Kind::SharedLeaf => self.shared::<S, true>(s, at, ray, leaf_ray, collect, observer),
            Kind::SharedStillLeaf => self.shared::<S, false>(s, at, ray, leaf_ray, collect, observer),
            Kind::OwnLeaf if G::LISTS => self.list(at, ray, collect, observer),
            Kind::OwnLeaf => {
                let segments = self.arena.ints()[at.at() + (2 * CORNER_ROWS + 1) * at.len()] as usize;
                let between = Between::new(KeyTime::new(ray.time, segments + 1));
                self.leaf::<S, true>(s, at, ray, &leaf_ray.between(between), collect, observer)
            }
        };
        if end {
            return false;
        }
        // What begins beyond the limit is of no interest any more. Distances below zero were stored as
        // zero, so the bits order like the numbers.
        let limit = u64::from(slabs.limit(collect.reach()).max(0.0).to_bits());
        loop {
            match stack.pop() {
                Some(entry) if entry >> 32 <= limit => {
                    journey.at = ChildRef(entry as u32);
                    return true;
                }
                Some(_) => {}
                None => return false,
            }
        }
    }

    /// Tests the sixteen boxes of a node, pushes all that are met but one, and returns that: the nearest, or any where
    /// order does not matter.
    ///
    /// Where it does not, a node of the same kind on top of the stack is tested as well: its rows are fetched and its
    /// masks made while those of the first are.
    #[inline(always)]
    fn step<S: Simd, const ROWS: usize, C: Collect>(
        &self,
        s: S,
        node: ChildRef,
        slabs: &Slabs,
        collect: &C,
        stack: &mut Stack<'_, u64>,
        observer: &mut impl Observer,
    ) -> Option<ChildRef> {
        if !C::ORDERED
            && let Some(top) = stack.top()
            && let top = ChildRef(top as u32)
            && top.kind() == node.kind()
        {
            stack.pop();
            observer.node();
            let a = self.meet::<S, ROWS, C>(s, node, slabs, collect);
            let b = self.meet::<S, ROWS, C>(s, top, slabs, collect);
            for (mask, _, children) in [b, a] {
                if self.ahead {
                    self.expect(children, mask);
                }
                stack.push_lanes(s, s.compress_u(s.to_bits(s.load(children)), mask), mask.count_ones() as usize);
            }
            return None;
        }
        let (mask, enter, children) = self.meet::<S, ROWS, C>(s, node, slabs, collect);
        if mask == 0 {
            return None;
        }
        let lane = Mask::BITS - 1 - mask.leading_zeros();
        let first = ChildRef(children[lane as usize % LANES].to_bits());
        let others = mask ^ (1 << lane);
        if self.ahead {
            self.expect(children, mask);
        }
        if !C::ORDERED {
            stack.push_lanes(s, s.compress_u(s.to_bits(s.load(children)), others), others.count_ones() as usize);
            return Some(first);
        }
        if others == 0 {
            return Some(first);
        }
        Some(push_hits::<S>(s, mask, enter, children, stack))
    }

    /// The boxes of a node that are met, where, and its children.
    #[inline(always)]
    fn meet<S: Simd, const ROWS: usize, C: Collect>(
        &self,
        s: S,
        node: ChildRef,
        slabs: &Slabs,
        collect: &C,
    ) -> (Mask, S::F, &Lanes<f32>) {
        let block = self.arena.block(node.at());
        let time = s.splat(slabs.time);
        // Written out: closures would be compiled without the instruction set.
        let near = [
            face_distance::<S, ROWS, 0>(s, block, slabs.near[0], time, slabs.inverse.x, slabs.near_offset.x),
            face_distance::<S, ROWS, 1>(s, block, slabs.near[1], time, slabs.inverse.y, slabs.near_offset.y),
            face_distance::<S, ROWS, 2>(s, block, slabs.near[2], time, slabs.inverse.z, slabs.near_offset.z),
        ];
        let far = [
            face_distance::<S, ROWS, 0>(s, block, slabs.near[0] ^ LANES, time, slabs.inverse.x, slabs.far_offset.x),
            face_distance::<S, ROWS, 1>(s, block, slabs.near[1] ^ LANES, time, slabs.inverse.y, slabs.far_offset.y),
            face_distance::<S, ROWS, 2>(s, block, slabs.near[2] ^ LANES, time, slabs.inverse.z, slabs.far_offset.z),
        ];
        // All that count are above zero, where integers order like numbers.
        let enter = s.max_signed(s.max_signed(near[0], near[1]), s.max_signed(near[2], s.splat(slabs.begin)));
        let limit = s.splat(slabs.limit(collect.reach()));
        let leave = s.min_signed(s.min_signed(far[0], far[1]), s.min_signed(far[2], limit));
        (s.le_signed(enter, leave), enter, lanes_at(block, (ROWS - 1) * LANES))
    }

    /// Asks for the blocks of some children of a node.
    #[inline(always)]
    fn expect(&self, children: &Lanes<f32>, mut mask: Mask) {
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            self.arena.prefetch_block(ChildRef(children[lane].to_bits()).at());
        }
    }
}

/// Distance along the ray at which it meets one face of every box of a node: `side` words behind the pair of rows.
#[inline(always)]
fn face_distance<S: Simd, const ROWS: usize, const AXIS: usize>(
    s: S,
    block: &[f32; LANES * LANES],
    side: usize,
    time: S::F,
    inverse: f32,
    offset: f32,
) -> S::F {
    // The mask keeps the compiler from checking bounds.
    let row = 2 * AXIS * LANES + (side & LANES);
    let at = s.load(lanes_at(block, row));
    let face = if ROWS == NODE_ROWS { s.mul_add(s.load(lanes_at(block, row + 6 * LANES)), time, at) } else { at };
    s.mul_add(face, s.splat(inverse), s.splat(offset))
}

/// Pushes the children of the mask, of which there are at least two, farthest first, and returns the nearest.
#[inline(always)]
fn push_hits<S: Simd>(
    s: S,
    mask: Mask,
    distances: S::F,
    children: &Lanes<f32>,
    stack: &mut Stack<'_, u64>,
) -> ChildRef {
    let n = mask.count_ones() as usize;
    let packed = s.compress(distances, mask);
    let mut d = [0; LANES];
    let mut c = [0; LANES];
    s.store_u(s.to_bits(packed), &mut d);
    s.store_u(s.compress_u(s.to_bits(s.load(children)), mask), &mut c);
    let entry = |i: usize| u64::from(d[i]) << 32 | u64::from(c[i]);
    if n <= 4 {
        // A sorting network of four, the missing ones nearest and so last; the nearest that is there waits for
        // two comparisons only.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Frame;
    use crate::ray::Ray;
    use crate::ray::tree_ray::LEAST_COMPONENT;
    use glam::Vec3;

    #[test]
    fn a_grown_slab_holds_the_exact_one() {
        for (o, d) in [(0.3f32, 0.9f32), (-7.0, -1e-3), (1e4, 1e-20), (0.0, -0.0), (0.1, -1.0)] {
            let ray = Ray::new(Vec3::new(0.0, o, 0.0), Vec3::new(1.0, d, 0.0));
            let frame = Frame { reach: 1e5, ..Frame::WORLD };
            let ray = TreeRay::new(&ray, &frame).unwrap();
            let slabs = Slabs::new(&ray);
            let (low, high) = (-0.25f32, 0.5f32);
            let (near, far) = if slabs.near[1] == 0 { (low, high) } else { (high, low) };
            let enter = near.mul_add(slabs.inverse[1], slabs.near_offset[1]);
            let leave = far.mul_add(slabs.inverse[1], slabs.far_offset[1]);
            if d.abs() > LEAST_COMPONENT {
                let exact = |f: f32| (f64::from(f) - f64::from(o)) / f64::from(d);
                assert!(f64::from(enter) < exact(near) && f64::from(leave) > exact(far), "{o} {d}");
            } else {
                let inside = low <= o && o <= high;
                assert_eq!(enter < 1e5 && leave > -1e5 && enter < leave, inside, "{o} {d}");
            }
        }
    }
}
