//! Leaf blocks: one ray against up to sixteen triangles at a time.
//!
//! In f32, the corners of all triangles of a block are interpolated at the ray's time, moved relative to its origin and sheared
//! along its direction. This rules out most of the triangles ([`super::candidates`]). The few that are left are decided one by one
//! in f64 (`ray/kernel/triangle.rs`), with the same arithmetic as brute force and without fused operations.

use super::candidates::{Candidates, Edges};
use super::collect::{Collect, Found};
use super::traverser::Traverser;
use crate::layout::{Between, CORNER_ROWS, ChildRef, KeyedLeaf, VERTEX_ROWS, block_sizes, shared_count};
use crate::primitive::PrimitiveSet;
use crate::ray::filter::Filter;
use crate::ray::kernel::shear::{Deviation, Sheared};
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{LANES, Mask, Rows, Simd, lanes_at};

impl<F: Filter> Traverser<'_, F> {
    /// Tests the triangles of a leaf block; true ends the query.
    #[inline(always)]
    pub(in crate::ray) fn leaf<S: Simd, const MOVING: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        at: (&Sheared, Between),
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        if S::HALVES && leaf.n <= LANES / 2 {
            return self.leaf_of::<S, MOVING, true>(s, leaf, ray, at, collect, observer);
        }
        self.leaf_of::<S, MOVING, false>(s, leaf, ray, at, collect, observer)
    }

    /// The test, compiled twice: if `FEW`, all triangles are in the lower half of the lanes.
    #[inline(always)]
    fn leaf_of<S: Simd, const MOVING: bool, const FEW: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        (of, between): (&Sheared, Between),
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        let LeafRows { at, n, behind: ids } = leaf;
        observer.leaf();
        observer.primitive_tests(n);
        let block = &self.arena.floats()[at..];
        let count = if MOVING { 2 * CORNER_ROWS } else { CORNER_ROWS };
        let rows = Rows::new(block, n, count);
        // The black box keeps the compiler from computing derived values ahead, for blocks that may never be visited.
        let of = core::hint::black_box(of);
        let [kx, ky, kz] = of.axes();
        let (ox, oy, oz) = (ray.origin[kx], ray.origin[ky], ray.origin[kz]);
        let [za, zb, zc] = corners::<S, MOVING>(s, &rows, between, kz, oz);
        let [xa, xb, xc] = corners::<S, MOVING>(s, &rows, between, kx, ox);
        let [ya, yb, yc] = corners::<S, MOVING>(s, &rows, between, ky, oy);
        let (sx, sy) = (s.splat(of.sx), s.splat(of.sy));
        let x = [s.negated_mul_add(sx, za, xa), s.negated_mul_add(sx, zb, xb), s.negated_mul_add(sx, zc, xc)];
        let y = [s.negated_mul_add(sy, za, ya), s.negated_mul_add(sy, zb, yb), s.negated_mul_add(sy, zc, yc)];
        let edges = Edges::new(s, x, y);
        let sizes = self.arena.ints()[ids - 1];
        let lanes = edges.may_be_hit(s, sizes, ray.slack) & first_lanes::<FEW>(n);
        if lanes == 0 {
            return false;
        }
        let scale = s.splat(of.inverse);
        let distances = [za * scale, zb * scale, zc * scale];
        let deviation = deviation::<S, MOVING>(s, sizes, ray);
        let mut candidates =
            Candidates::new::<S, _, FEW>(s, &edges, (lanes, distances, sizes), (ray, deviation), collect);
        if self.is_certainly_hit(&mut candidates, ids, ray, collect) {
            return true;
        }
        if self.keeps_f64() {
            match self.decide_kept(candidates, ids, (ray, of), collect) {
                Some(others) => candidates.lanes = others,
                None => return true,
            }
        }
        while let Some(i) = candidates.next(collect) {
            // Written out: a closure would be compiled to a call, which spills the registers of the query.
            let corners = [
                fine_corners::<S, MOVING>(s, &rows, between, kx, i),
                fine_corners::<S, MOVING>(s, &rows, between, ky, i),
                fine_corners::<S, MOVING>(s, &rows, between, kz, i),
            ];
            let alike = candidates.alike(s, &*collect, i);
            if alike == 0 {
                if self.offer(s, corners, ids + i, (ray, of), collect) {
                    return true;
                }
                continue;
            }
            // Copies of a mesh in one place.
            let same = alike & same_corners::<S, MOVING>(s, &rows, between, i);
            candidates.lanes &= !same;
            if self.offer_all(s, corners, (ids, same | 1 << i), (ray, of), collect) {
                return true;
            }
        }
        false
    }

    /// Tests the triangles of a leaf block that share vertices; true ends the query.
    #[inline(always)]
    pub(in crate::ray) fn shared<S: Simd, const MOVING: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        at: (&Sheared, Between),
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        if S::HALVES && shared_count(self.arena.ints()[leaf.behind]) <= LANES / 2 {
            return self.shared_of::<S, MOVING, true>(s, leaf, ray, at, collect, observer);
        }
        self.shared_of::<S, MOVING, false>(s, leaf, ray, at, collect, observer)
    }

    /// The test, compiled twice: if `FEW`, all triangles are in the lower half of the lanes.
    #[inline(always)]
    fn shared_of<S: Simd, const MOVING: bool, const FEW: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        (of, between): (&Sheared, Between),
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        let block = &self.arena.floats()[leaf.at..];
        let count = if MOVING { 2 * VERTEX_ROWS } else { VERTEX_ROWS };
        let rows = Rows::new(block, leaf.n, count);
        let at = leaf.behind;
        let words = lanes_at(self.arena.ints(), at);
        let n = shared_count(words[0]);
        observer.leaf();
        observer.primitive_tests(n);
        // The black box keeps the compiler from computing derived values ahead, for blocks that may never be visited.
        let of = core::hint::black_box(of);
        let [kx, ky, kz] = of.axes();
        let (ox, oy, oz) = (ray.origin[kx], ray.origin[ky], ray.origin[kz]);
        let z = vertices::<S, MOVING>(s, &rows, between, kz, oz);
        let x = s.negated_mul_add(s.splat(of.sx), z, vertices::<S, MOVING>(s, &rows, between, kx, ox));
        let y = s.negated_mul_add(s.splat(of.sy), z, vertices::<S, MOVING>(s, &rows, between, ky, oy));
        let first = s.load_u(words);
        let (second, third) = (s.shift_right::<4>(first), s.shift_right::<8>(first));
        let x = [s.permute(x, first), s.permute(x, second), s.permute(x, third)];
        let y = [s.permute(y, first), s.permute(y, second), s.permute(y, third)];
        let edges = Edges::new(s, x, y);
        let lanes = edges.may_be_hit(s, words[0], ray.slack) & first_lanes::<FEW>(n);
        if lanes == 0 {
            return false;
        }
        let distance = z * s.splat(of.inverse);
        let distances = [s.permute(distance, first), s.permute(distance, second), s.permute(distance, third)];
        let deviation = deviation::<S, MOVING>(s, words[0], ray);
        let mut candidates =
            Candidates::new::<S, _, FEW>(s, &edges, (lanes, distances, words[0]), (ray, deviation), collect);
        if self.is_certainly_hit(&mut candidates, at + n, ray, collect) {
            return true;
        }
        if self.keeps_f64() {
            match self.decide_kept(candidates, at + n, (ray, of), collect) {
                Some(others) => candidates.lanes = others,
                None => return true,
            }
        }
        while let Some(i) = candidates.next(collect) {
            let numbers = words[i];
            let corners = [
                fine_vertices::<S, MOVING>(s, &rows, between, kx, numbers),
                fine_vertices::<S, MOVING>(s, &rows, between, ky, numbers),
                fine_vertices::<S, MOVING>(s, &rows, between, kz, numbers),
            ];
            if self.offer(s, corners, at + n + i, (ray, of), collect) {
                return true;
            }
        }
        false
    }

    /// Ends the query if it accepts a hit anywhere, and some triangle that it sees is certainly hit. The ids of the block begin at
    /// word `ids`.
    #[inline(always)]
    pub(super) fn is_certainly_hit(
        &self,
        candidates: &mut Candidates,
        ids: usize,
        ray: &TreeRay,
        collect: &mut impl Collect,
    ) -> bool {
        while let Some(i) = candidates.certain() {
            if self.sees(self.arena.ints()[ids + i], ray) {
                collect.found();
                return true;
            }
        }
        false
    }

    /// Decides whether the triangle with these corners is hit; its id is at word `id`. True ends the query.
    #[inline(always)]
    fn offer<S: Simd>(
        &self,
        s: S,
        corners: [S::D; 3],
        id: usize,
        (ray, sheared): (&TreeRay, &Sheared),
        collect: &mut impl Collect,
    ) -> bool {
        let id = self.arena.ints()[id];
        if !self.sees(id, ray) {
            return false;
        }
        let Some(hit) = ray.decide(s, sheared, corners, collect.limit()) else {
            return false;
        };
        collect.offer(Found { hit, id }, ray, self.scene, self.filter)
    }

    /// The same for several triangles with these corners, whose ids begin at word `ids`: all are hit at the same place, or none is.
    #[inline(always)]
    fn offer_all<S: Simd>(
        &self,
        s: S,
        corners: [S::D; 3],
        (ids, mut lanes): (usize, Mask),
        (ray, sheared): (&TreeRay, &Sheared),
        collect: &mut impl Collect,
    ) -> bool {
        let Some(hit) = ray.decide(s, sheared, corners, collect.limit()) else {
            return false;
        };
        while lanes != 0 {
            let id = self.arena.ints()[ids + lanes.trailing_zeros() as usize];
            lanes &= lanes - 1;
            if self.sees(id, ray) && collect.offer(Found { hit, id }, ray, self.scene, self.filter) {
                return true;
            }
        }
        false
    }

    /// Whether any vertices are kept in f64: those in leaf blocks are rounded.
    #[inline(always)]
    fn keeps_f64(&self) -> bool {
        self.scene.triangles.any_precise()
    }

    /// Decides for the candidates whose vertices are kept in f64 whether they are hit, and returns the lanes of the others; `None`
    /// ends the query. The ids of the block begin at word `ids`.
    #[cold]
    #[inline(never)]
    fn decide_kept(
        &self,
        candidates: Candidates,
        ids: usize,
        of: (&TreeRay, &Sheared),
        collect: &mut impl Collect,
    ) -> Option<Mask> {
        let is_kept = |&lane: &usize| {
            let id = self.arena.ints()[ids + lane];
            candidates.lanes >> lane & 1 != 0 && self.scene.triangles.is_precise(id)
        };
        let kept = (0..LANES).filter(is_kept).fold(0, |lanes: Mask, lane| lanes | 1 << lane);
        let mut those = Candidates { lanes: kept, ..candidates };
        while let Some(i) = those.next(collect) {
            if self.decide(ids + i, of, collect) {
                return None;
            }
        }
        Some(candidates.lanes & !kept)
    }

    /// Whether a primitive exists at the ray's time and the query sees it. This is tested for few primitives only, so boxes and
    /// leaf blocks need not store it.
    #[inline(always)]
    pub(super) fn sees(&self, id: u32, ray: &TreeRay) -> bool {
        self.scene.exists_at(id, ray.time()) && self.filter.sees(|| self.scene.mask(id))
    }
}

/// The deviation of the corners of a block with these sizes.
#[inline(always)]
fn deviation<S: Simd, const MOVING: bool>(s: S, sizes: u32, ray: &TreeRay) -> Deviation {
    let (size, extent) = block_sizes(sizes);
    Deviation::of(s, extent, if MOVING { size } else { 0.0 }, ray.slack)
}

/// The first `n` lanes. If `FEW`, they are in the lower half; the mask tells the compiler so, and it drops the computations of the
/// upper half.
#[inline(always)]
fn first_lanes<const FEW: bool>(n: usize) -> Mask {
    let first = ((1u32 << n) - 1) as Mask;
    if FEW { first & Mask::MAX >> (LANES / 2) } else { first }
}

/// The position of the rows of a leaf block that a query at some time reads.
#[derive(Clone, Copy)]
pub(in crate::ray) struct LeafRows {
    /// The first word of the rows.
    at: usize,
    /// The number of floats in a row.
    n: usize,
    /// The first word of the ids, which follow the word of the sizes; or, with shared vertices, the first word of the vertex
    /// numbers.
    behind: usize,
}

impl LeafRows {
    /// For a block that begins with `count` rows, followed by the sizes and the ids.
    #[inline(always)]
    pub(in crate::ray) fn loose(leaf: ChildRef, count: usize) -> LeafRows {
        LeafRows { at: leaf.at(), n: leaf.len(), behind: leaf.at() + count * leaf.len() + 1 }
    }

    /// For a block that begins with `count` rows of shared vertices, followed by the vertex numbers.
    #[inline(always)]
    pub(in crate::ray) fn shared(leaf: ChildRef, count: usize) -> LeafRows {
        LeafRows { at: leaf.at(), n: leaf.len(), behind: leaf.at() + count * leaf.len() }
    }

    /// For a block with many keys: the rows of the segment between two keys.
    #[inline(always)]
    pub(in crate::ray) fn keyed(leaf: ChildRef, keyed: &KeyedLeaf, segment: usize) -> LeafRows {
        let behind = if keyed.shared { keyed.vertices() } else { keyed.ids() };
        LeafRows { at: leaf.at() + keyed.rows(segment), n: leaf.len(), behind: leaf.at() + behind }
    }
}

/// One coordinate of the three corners of a block's triangles at the ray's time, relative to the origin, within the error bounds of
/// [`crate::ray::kernel::shear`].
#[inline(always)]
fn corners<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, origin: f32) -> [S::F; 3] {
    let origin = s.splat(origin);
    let (base, other) = between.rows(CORNER_ROWS);
    let [a, b, c] = s.load_thirds(rows, base + axis);
    let at = [a - origin, b - origin, c - origin];
    if !MOVING {
        return at;
    }
    let [a2, b2, c2] = s.load_thirds(rows, other + axis);
    let f = s.splat(between.fraction);
    [s.mul_add(a2 - a, f, at[0]), s.mul_add(b2 - b, f, at[1]), s.mul_add(c2 - c, f, at[2])]
}

/// The triangles of a block whose corners are those of one of them at the keys around the ray's time, bit for bit.
#[inline(always)]
fn same_corners<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, lane: usize) -> Mask {
    let (base, other) = between.rows(CORNER_ROWS);
    let mut same = Mask::MAX;
    for axis in 0..3 {
        same &= same_thirds(s, rows, base + axis, lane);
        if MOVING {
            same &= same_thirds(s, rows, other + axis, lane);
        }
    }
    same
}

/// The triangles of a block that have a coordinate of their corners in common with one of them.
#[inline(always)]
fn same_thirds<S: Simd>(s: S, rows: &Rows, first: usize, lane: usize) -> Mask {
    let ([a, b, c], [x, y, z]) = (s.load_thirds(rows, first), rows.lane_of_thirds(first, lane));
    let (x, y, z) = (s.splat_u(x.to_bits()), s.splat_u(y.to_bits()), s.splat_u(z.to_bits()));
    s.eq_u(s.to_bits(a), x) & s.eq_u(s.to_bits(b), y) & s.eq_u(s.to_bits(c), z)
}

/// One coordinate of a block's shared vertices, with the same bounds.
#[inline(always)]
fn vertices<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, origin: f32) -> S::F {
    let origin = s.splat(origin);
    let (base, other) = between.rows(VERTEX_ROWS);
    let at = s.load_row(rows, base + axis);
    if !MOVING {
        return at - origin;
    }
    s.mul_add(s.load_row(rows, other + axis) - at, s.splat(between.fraction), at - origin)
}

/// One coordinate of the three corners of one triangle of a block in f64, exactly as `KeyTime::fine_position` computes it.
#[inline(always)]
fn fine_corners<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, lane: usize) -> S::D {
    let (base, other) = between.rows(CORNER_ROWS);
    let near = s.widen(rows.lane_of_thirds(base + axis, lane));
    if !MOVING {
        return near;
    }
    let far = s.widen(rows.lane_of_thirds(other + axis, lane));
    near + (far - near) * s.splat_d(f64::from(between.fraction))
}

/// One coordinate of three of a block's shared vertices, with the same arithmetic.
#[inline(always)]
fn fine_vertices<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, numbers: u32) -> S::D {
    let (base, other) = between.rows(VERTEX_ROWS);
    let near = s.pick_four(s.load_row(rows, base + axis), numbers);
    if !MOVING {
        return near;
    }
    let far = s.pick_four(s.load_row(rows, other + axis), numbers);
    near + (far - near) * s.splat_d(f64::from(between.fraction))
}
