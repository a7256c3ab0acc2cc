//! Traversal of the wide layout: one ray against sixteen boxes, then sixteen triangles, at a time.
//!
//! Boxes at the ray's time are one multiply-add per face away from the node's rows. They are grown by
//! [`hit_slack`](super::triangle::hit_slack) on the ray's side, where it costs nothing: a face `f` is met at
//! `(f - o) / d`, and with `r = 1 / d` computed once, `f * r + (-o -+ slack) * r` grows the box as well.
//!
//! Proof that nothing is culled that a leaf would accept: along each axis the computed distance is
//! `(f - o -+ slack) r` up to three roundings relative to `(|f| + |o| + slack) |r|` (the constant term, `r` in both
//! terms alike, the fused sum), below 4 ULP of `(1 + |o|) |r|`; an accepted hit lies within 10 ULP of
//! `1 + |o|` of its exact bounds; the slack is 16. Distances that tie with the limit are kept, since the
//! comparison is `<=`.

use super::collect::{Collect, Found};
use super::filter::Filter;
use super::observer::Observer;
use super::query_ray::TreeRay;
use super::triangle::{Sheared, hit_slack};
use crate::motion::{KeyTime, PrimitiveSet};
use crate::simd::{Arena, Kernel, LANES, Lanes, Mask, Rows, Simd, Stack, StackMemory, lanes_at};
use crate::tree::wide::{CORNER_ROWS, ChildRef, Kind, LeafShape, NODE_ROWS, STILL_NODE_ROWS, WideTree};

/// Places on the stack. A level of the tree leaves at most 15 behind, usually one or two.
const STACK: usize = 192;

/// Smaller components of a direction are taken as this: over any distance within reach the ray then
/// strays by less than a thousandth of the slack.
const LEAST_COMPONENT: f32 = 1e-12;

/// Slab constants of one axis.
#[derive(Clone, Copy)]
struct Axis {
    /// The row of near faces, and of far faces.
    near: usize,
    far: usize,
    inverse: f32,
    near_offset: f32,
    far_offset: f32,
}

impl Axis {
    #[inline(always)]
    fn new(axis: usize, origin: f32, direction: f32, slack: f32) -> Axis {
        let d = if direction.abs() < LEAST_COMPONENT { LEAST_COMPONENT.copysign(direction) } else { direction };
        let inverse = 1.0 / d;
        let (low, high) = (axis, axis + 3);
        if inverse > 0.0 {
            let (near_offset, far_offset) = ((-origin - slack) * inverse, (-origin + slack) * inverse);
            Axis { near: low, far: high, inverse, near_offset, far_offset }
        } else {
            let (near_offset, far_offset) = ((-origin + slack) * inverse, (-origin - slack) * inverse);
            Axis { near: high, far: low, inverse, near_offset, far_offset }
        }
    }
}

/// One ray's query, to be dispatched to an instruction set.
pub(crate) struct WideQuery<'a, G, F, C, O> {
    pub tree: &'a WideTree,
    pub set: &'a G,
    pub ray: &'a TreeRay,
    pub filter: &'a F,
    pub collect: &'a mut C,
    pub observer: &'a mut O,
}

impl<G: PrimitiveSet, F: Filter, C: Collect, O: Observer> Kernel for WideQuery<'_, G, F, C, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let scene = Scene { arena: &self.tree.arena, set: self.set, filter: self.filter };
        scene.trace(s, self.tree.root, self.ray, self.collect, self.observer);
    }
}

/// What does not change during a query.
struct Scene<'a, G, F> {
    arena: &'a Arena,
    set: &'a G,
    filter: &'a F,
}

impl<G: PrimitiveSet, F: Filter> Scene<'_, G, F> {
    /// Offers every hit that may matter to `collect`.
    #[inline(always)]
    fn trace<S: Simd>(
        &self,
        s: S,
        root: ChildRef,
        ray: &TreeRay,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        let slack = hit_slack(ray.origin);
        let axes: [Axis; 3] = core::array::from_fn(|i| Axis::new(i, ray.origin[i], ray.dir[i], slack));
        let shear = ray.shear;
        let mut memory = StackMemory::<u64, STACK>::new();
        let mut stack = memory.stack();
        let mut at = root;
        loop {
            match at.kind() {
                Kind::Node => {
                    observer.node();
                    if let Some(next) = self.step::<S, NODE_ROWS, _>(s, at, ray, &axes, collect, &mut stack) {
                        at = next;
                        continue;
                    }
                }
                Kind::StillNode => {
                    observer.node();
                    if let Some(next) = self.step::<S, STILL_NODE_ROWS, _>(s, at, ray, &axes, collect, &mut stack) {
                        at = next;
                        continue;
                    }
                }
                Kind::Leaf => {
                    observer.leaf();
                    observer.primitive_tests(at.len());
                    if self.leaf::<S, true>(s, at, ray, &shear, collect) {
                        return;
                    }
                }
                Kind::StillLeaf => {
                    observer.leaf();
                    observer.primitive_tests(at.len());
                    if self.leaf::<S, false>(s, at, ray, &shear, collect) {
                        return;
                    }
                }
                Kind::Time => {
                    let words = &self.arena.ints()[at.at()..];
                    let part = KeyTime::new(ray.time, words[0] as usize + 1).segment;
                    at = ChildRef(words[1 + part]);
                    continue;
                }
                Kind::ListLeaf => {
                    observer.leaf();
                    observer.primitive_tests(at.len());
                    for &id in &self.arena.ints()[at.at()..at.at() + at.len()] {
                        if self.sees(id, ray)
                            && let Some(hit) = self.set.intersect(id, ray)
                            && hit.t <= collect.limit()
                            && collect.offer(Found { hit, id })
                        {
                            return;
                        }
                    }
                }
                Kind::Nothing => {}
            }
            // What begins beyond the limit is of no interest any more. Distances below zero were stored as
            // zero, so the bits order like the numbers.
            let limit = u64::from(collect.limit().max(0.0).to_bits());
            at = loop {
                match stack.pop() {
                    Some(entry) if entry >> 32 <= limit => break ChildRef(entry as u32),
                    Some(_) => {}
                    None => return,
                }
            };
        }
    }

    /// Whether a primitive exists at the ray's time and the query sees it. Asked of hits only, so that boxes and
    /// leaf blocks need not know.
    #[inline(always)]
    fn sees(&self, id: u32, ray: &TreeRay) -> bool {
        (self.set.always_active() || self.set.active(id).contains(ray.time)) && self.filter.sees(|| self.set.mask(id))
    }

    /// Tests the sixteen boxes of a node, pushes all that are met but the nearest, and returns that.
    #[inline(always)]
    fn step<S: Simd, const ROWS: usize, C: Collect>(
        &self,
        s: S,
        node: ChildRef,
        ray: &TreeRay,
        axes: &[Axis; 3],
        collect: &C,
        stack: &mut Stack<'_, u64, STACK>,
    ) -> Option<ChildRef> {
        let rows = self.arena.rows(node.at());
        let time = s.splat(ray.time);
        let [x, y, z] = axes;
        let near = [
            face_distance::<S, ROWS>(s, rows, x.near, time, x.inverse, x.near_offset),
            face_distance::<S, ROWS>(s, rows, y.near, time, y.inverse, y.near_offset),
            face_distance::<S, ROWS>(s, rows, z.near, time, z.inverse, z.near_offset),
        ];
        let far = [
            face_distance::<S, ROWS>(s, rows, x.far, time, x.inverse, x.far_offset),
            face_distance::<S, ROWS>(s, rows, y.far, time, y.inverse, y.far_offset),
            face_distance::<S, ROWS>(s, rows, z.far, time, z.inverse, z.far_offset),
        ];
        let enter = s.max(s.max(near[0], near[1]), s.max(near[2], s.splat(ray.t_min)));
        let leave = s.min(s.min(far[0], far[1]), s.min(far[2], s.splat(collect.limit())));
        let mask = s.le(enter, leave);
        if mask == 0 {
            return None;
        }
        let children = lanes_at(self.arena.ints(), node.at() + (ROWS - 1) * LANES);
        if mask & (mask - 1) == 0 {
            return Some(ChildRef(children[mask.trailing_zeros() as usize % LANES]));
        }
        let distances = s.max(enter, s.splat(0.0));
        Some(push_hits::<S, C>(s, mask, distances, children, stack))
    }

    /// Tests the triangles of a leaf block; true ends the query.
    #[inline(always)]
    fn leaf<S: Simd, const MOVING: bool>(
        &self,
        s: S,
        leaf: ChildRef,
        ray: &TreeRay,
        shear: &Sheared,
        collect: &mut impl Collect,
    ) -> bool {
        let n = leaf.len();
        let ids = (if MOVING { LeafShape::Moving } else { LeafShape::Still }).ids(n);
        let block = &self.arena.floats()[leaf.at()..];
        let origin = ray.origin;
        let (keys, later) = if MOVING {
            let segments = self.arena.ints()[leaf.at() + ids + n] as usize;
            (KeyTime::new(ray.time, segments + 1), CORNER_ROWS)
        } else {
            (KeyTime { segment: 0, s: 0.0, from_end: false }, 0)
        };
        let corners = Corners::<S> {
            rows: Rows::new(block, n, CORNER_ROWS + later),
            base: if keys.from_end { later } else { 0 },
            later,
            fraction: s.splat(keys.s),
            shear,
            slopes: (s.splat(shear.sx), s.splat(shear.sy)),
            origin: [s.splat(origin[shear.kx]), s.splat(origin[shear.ky]), s.splat(origin[shear.kz])],
        };
        let a = corners.sheared::<MOVING>(s, 0);
        let b = corners.sheared::<MOVING>(s, 1);
        let c = corners.sheared::<MOVING>(s, 2);
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        let zero = s.splat(0.0);
        let least = s.min(u, s.min(v, w));
        let greatest = s.max(u, s.max(v, w));
        let outside = s.lt(least, zero) & s.lt(zero, greatest);
        let mut inside = !outside & (((1u32 << n) - 1) as Mask);
        if inside == 0 {
            return false;
        }
        while inside != 0 {
            let i = inside.trailing_zeros() as usize % LANES;
            inside &= inside - 1;
            let corners = [
                [s.lane(a.0, i), s.lane(a.1, i), s.lane(a.2, i)],
                [s.lane(b.0, i), s.lane(b.1, i), s.lane(b.2, i)],
                [s.lane(c.0, i), s.lane(c.1, i), s.lane(c.2, i)],
            ];
            if let Some(hit) = shear.decide(corners, ray.t_min, collect.limit()) {
                let id = self.arena.ints()[leaf.at() + ids + i];
                if self.sees(id, ray) && collect.offer(Found { hit, id }) {
                    return true;
                }
            }
        }
        false
    }
}

/// Distance along the ray at which it meets one face of every box of a node.
#[inline(always)]
fn face_distance<S: Simd, const ROWS: usize>(
    s: S,
    rows: &[Lanes<f32>; LANES],
    row: usize,
    time: S::F,
    inverse: f32,
    offset: f32,
) -> S::F {
    // The masks keep the compiler from checking bounds.
    let at = s.load(&rows[row & 7]);
    let face = if ROWS == NODE_ROWS { s.mul_add(s.load(&rows[(row & 7) + 6]), time, at) } else { at };
    s.mul_add(face, s.splat(inverse), s.splat(offset))
}

/// The corner rows of a leaf block and what turns them into corners as the ray sees them.
struct Corners<'a, S: Simd> {
    rows: Rows<'a>,
    /// First row at the key that is nearer in time, and at the later key.
    base: usize,
    later: usize,
    fraction: S::F,
    shear: &'a Sheared,
    slopes: (S::F, S::F),
    /// The origin along the shear's axes.
    origin: [S::F; 3],
}

impl<S: Simd> Corners<'_, S> {
    /// A coordinate at the ray's time, exactly as `KeyTime::position` computes it, less the origin.
    #[inline(always)]
    fn coordinate<const MOVING: bool>(&self, s: S, corner: usize, axis: usize, origin: S::F) -> S::F {
        let row = 3 * corner + axis;
        let at = s.load_row(&self.rows, self.base + row);
        if MOVING {
            let a = s.load_row(&self.rows, row);
            let b = s.load_row(&self.rows, self.later + row);
            at + (b - a) * self.fraction - origin
        } else {
            at - origin
        }
    }

    /// Corner `i` of every triangle: sheared x and y, and depth, exactly as `Sheared::corner` computes them.
    #[inline(always)]
    fn sheared<const MOVING: bool>(&self, s: S, i: usize) -> (S::F, S::F, S::F) {
        let z = self.coordinate::<MOVING>(s, i, self.shear.kz, self.origin[2]);
        let x = self.coordinate::<MOVING>(s, i, self.shear.kx, self.origin[0]);
        let y = self.coordinate::<MOVING>(s, i, self.shear.ky, self.origin[1]);
        (x - self.slopes.0 * z, y - self.slopes.1 * z, z)
    }
}

/// Pushes the children of the mask, farthest first where order matters, and returns the nearest.
#[inline(always)]
fn push_hits<S: Simd, C: Collect>(
    s: S,
    mask: Mask,
    distances: S::F,
    children: &[u32; LANES],
    stack: &mut Stack<'_, u64, STACK>,
) -> ChildRef {
    let n = mask.count_ones() as usize;
    let packed = s.compress(distances, mask);
    let mut d = [0; LANES];
    let mut c = [0; LANES];
    s.store_u(s.to_bits(packed), &mut d);
    s.store_u(s.compress_u(s.load_u(children), mask), &mut c);
    let entry = |i: usize| u64::from(d[i]) << 32 | u64::from(c[i]);
    if !C::ORDERED {
        for i in 1..n {
            stack.push(entry(i));
        }
        return ChildRef(c[0]);
    }
    let ordered = |a: u64, b: u64| if a < b { (a, b) } else { (b, a) };
    if n <= 4 {
        // A sorting network of four, the missing ones nearest: the far ones then lie lowest on the stack.
        let entry_or_none = |i: usize| if i < n { entry(i) } else { 0 };
        let (a, b) = ordered(entry(0), entry(1));
        let (c, d) = ordered(entry_or_none(2), entry_or_none(3));
        let (a, c) = ordered(a, c);
        let (b, d) = ordered(b, d);
        let (b, c) = ordered(b, c);
        stack.push_first([d, c, b, a], n);
    } else {
        let valid = ((1u32 << n) - 1) as Mask;
        let mut places = [0; LANES];
        for (i, place) in places.iter_mut().enumerate().take(n) {
            let own = s.from_bits(s.splat_u(d[i]));
            let farther = s.lt(own, packed) & valid;
            let equal_before = s.eq(own, packed) & (((1u32 << i) - 1) as Mask);
            *place = (farther.count_ones() + equal_before.count_ones()) as usize;
        }
        stack.push_ranked(n, |i| (places[i], entry(i)));
    }
    ChildRef(stack.pop().unwrap_or(0) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_grown_slab_holds_the_exact_one() {
        for (o, d) in [(0.3f32, 1.5f32), (-7.0, -1e-3), (1e4, 1e-20), (0.0, -0.0)] {
            let slack = hit_slack(Vec3::splat(o));
            let axis = Axis::new(1, o, d, slack);
            let (low, high) = (-0.25f32, 0.5f32);
            let (near, far) = if axis.near == 1 { (low, high) } else { (high, low) };
            let enter = near.mul_add(axis.inverse, axis.near_offset);
            let leave = far.mul_add(axis.inverse, axis.far_offset);
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
