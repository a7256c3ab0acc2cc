//! Leaf blocks: one ray against up to sixteen triangles at a time.
//!
//! The corners of all triangles of a block are brought to the ray's time, moved to its origin and sheared onto its direction in
//! f32; the signs of the edge functions rule most of them out, up to a margin, and the few that are left are decided one
//! by one in f64 ([`super::triangle`]). That arithmetic is the same as brute force does, with nothing fused.

use super::collect::{Collect, Found};
use super::filter::Filter;
use super::intersect::RaySource;
use super::observer::Observer;
use super::shear::margin;
use super::traverser::Traverser;
use super::tree_ray::TreeRay;
use crate::geometry::{KERNEL_ULPS, KeyTime, ULP};
use crate::layout::{Between, CORNER_ROWS, ChildRef, KeyedLeaf, VERTEX_ROWS, block_sizes, shared_count};
use crate::simd::{LANES, Mask, Rows, Simd, lanes_at};
use glam::DVec3;

impl<G: RaySource, F: Filter> Traverser<'_, G, F> {
    /// Tests the triangles of a leaf block; true ends the query.
    #[inline(always)]
    pub(super) fn leaf<S: Simd, const MOVING: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        of: &LeafRay,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        let LeafRows { at, n, behind } = leaf;
        observer.leaf();
        observer.primitive_tests(n);
        let block = &self.arena.floats()[at..];
        let count = if MOVING { 2 * CORNER_ROWS } else { CORNER_ROWS };
        let rows = Rows::new(block, n, count);
        let of = of.read();
        let between = if MOVING { of.between } else { Between::NEVER };
        let ([kx, ky, kz], [ox, oy, oz]) = (of.axes, of.origin);
        let [za, zb, zc] = corners::<S, MOVING>(s, &rows, between, kz, oz);
        let [xa, xb, xc] = corners::<S, MOVING>(s, &rows, between, kx, ox);
        let [ya, yb, yc] = corners::<S, MOVING>(s, &rows, between, ky, oy);
        // Sheared exactly as by `Sheared::corner`.
        let (sx, sy) = (s.splat(of.sx), s.splat(of.sy));
        let a = (xa - sx * za, ya - sy * za);
        let b = (xb - sx * zb, yb - sy * zb);
        let c = (xc - sx * zc, yc - sy * zc);
        let aside = s.max(farther(s, a.0, a.1), s.max(farther(s, b.0, b.1), farther(s, c.0, c.1)));
        let ahead = s.max(farther(s, za, zb), farther(s, zc, zc));
        let stray = s.mul_add(aside + ahead, s.splat(KERNEL_ULPS * ULP), s.splat(2.0 * of.slack));
        // As `margin` has it.
        let margin = s.mul_add(s.splat(16.0) * stray, aside + stray, s.splat(f32::MIN_POSITIVE));
        let mut inside = maybe_inside(s, a, b, c, margin) & ((1u32 << n) - 1) as Mask;
        let (base, other) = between.rows(CORNER_ROWS);
        while inside != 0 {
            let i = inside.trailing_zeros() as usize % LANES;
            inside &= inside - 1;
            // Each by itself: a closure becomes a call, which pushes the query out of registers.
            let corners = [
                fine_vertex::<MOVING>(block, n, i, base, other, between),
                fine_vertex::<MOVING>(block, n, i, base + 3, other + 3, between),
                fine_vertex::<MOVING>(block, n, i, base + 6, other + 6, between),
            ];
            if self.offer(corners, behind + i, ray, collect) {
                return true;
            }
        }
        false
    }

    /// Tests the triangles of a leaf block that share vertices; true ends the query.
    #[inline(always)]
    pub(super) fn shared<S: Simd, const MOVING: bool>(
        &self,
        s: S,
        leaf: LeafRows,
        ray: &TreeRay,
        of: &LeafRay,
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
        let of = of.read();
        let between = if MOVING { of.between } else { Between::NEVER };
        let ([kx, ky, kz], [ox, oy, oz]) = (of.axes, of.origin);
        let z = vertices::<S, MOVING>(s, &rows, between, kz, oz);
        let x = vertices::<S, MOVING>(s, &rows, between, kx, ox) - s.splat(of.sx) * z;
        let y = vertices::<S, MOVING>(s, &rows, between, ky, oy) - s.splat(of.sy) * z;
        let first = s.load_u(words);
        let (second, third) = (s.shift_right::<4>(first), s.shift_right::<8>(first));
        let a = (s.permute(x, first), s.permute(y, first));
        let b = (s.permute(x, second), s.permute(y, second));
        let c = (s.permute(x, third), s.permute(y, third));
        let (size, extent) = block_sizes(words[0]);
        let margin = margin(2.0 * extent, KERNEL_ULPS * ULP * size + of.slack);
        let mut inside = maybe_inside(s, a, b, c, s.splat(margin)) & ((1u32 << n) - 1) as Mask;
        let (base, other) = between.rows(VERTEX_ROWS);
        while inside != 0 {
            let i = inside.trailing_zeros() as usize % LANES;
            inside &= inside - 1;
            let (width, numbers) = (leaf.n, words[i] as usize);
            let corners = [
                fine_vertex::<MOVING>(block, width, numbers & 15, base, other, between),
                fine_vertex::<MOVING>(block, width, numbers >> 4 & 15, base, other, between),
                fine_vertex::<MOVING>(block, width, numbers >> 8 & 15, base, other, between),
            ];
            if self.offer(corners, at + n + i, ray, collect) {
                return true;
            }
        }
        false
    }

    /// Decides about a triangle of these corners, whose id is at word `id`; true ends the query.
    #[inline(always)]
    fn offer(&self, corners: [DVec3; 3], id: usize, ray: &TreeRay, collect: &mut impl Collect) -> bool {
        let Some(hit) = ray.decide(corners, collect.limit()) else { return false };
        let id = self.arena.ints()[id];
        self.sees(id, ray) && collect.offer(Found { hit, id })
    }

    /// Asks the primitives of a list themselves; true ends the query.
    #[inline(always)]
    pub(super) fn list(
        &self,
        leaf: ChildRef,
        ray: &TreeRay,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        observer.leaf();
        observer.primitive_tests(leaf.len());
        for &id in &self.arena.ints()[leaf.at()..leaf.at() + leaf.len()] {
            if self.sees(id, ray)
                && let Some(hit) = self.set.intersect(id, ray)
                && hit.t <= collect.limit()
                && collect.offer(Found { hit, id })
            {
                return true;
            }
        }
        false
    }

    /// Whether a primitive exists at the ray's time and the query sees it. Asked of hits only, so that boxes and
    /// leaf blocks need not know.
    #[inline(always)]
    fn sees(&self, id: u32, ray: &TreeRay) -> bool {
        (self.set.always_active() || self.set.active(id).contains(ray.time)) && self.filter.sees(|| self.set.mask(id))
    }
}

/// Where the rows of a leaf block are that are read at a time.
#[derive(Clone, Copy)]
pub(super) struct LeafRows {
    /// The first word of the rows.
    at: usize,
    /// Floats in a row.
    n: usize,
    /// The first word of the ids, or of the numbers of shared vertices.
    behind: usize,
}

impl LeafRows {
    /// A block of `count` rows that begin it, the ids or numbers right behind them.
    #[inline(always)]
    pub(super) fn first(leaf: ChildRef, count: usize) -> LeafRows {
        LeafRows { at: leaf.at(), n: leaf.len(), behind: leaf.at() + count * leaf.len() }
    }

    /// The rows of a block of many keys in a segment between them.
    #[inline(always)]
    pub(super) fn keyed(leaf: ChildRef, keyed: &KeyedLeaf, segment: usize) -> LeafRows {
        let behind = if keyed.shared { keyed.vertices() } else { keyed.ids() };
        LeafRows { at: leaf.at() + keyed.rows(segment), n: leaf.len(), behind: leaf.at() + behind }
    }
}

/// Lanes whose triangles the edge functions in f32 do not rule out, up to a margin (see [`margin`]).
#[inline(always)]
fn maybe_inside<S: Simd>(s: S, a: (S::F, S::F), b: (S::F, S::F), c: (S::F, S::F), margin: S::F) -> Mask {
    let u = c.0 * b.1 - c.1 * b.0;
    let v = a.0 * c.1 - a.1 * c.0;
    let w = b.0 * a.1 - b.1 * a.0;
    let least = s.min(u, s.min(v, w));
    let greatest = s.max(u, s.max(v, w));
    !(s.lt(least, s.splat(0.0) - margin) & s.lt(margin, greatest))
}

/// The greater of two sizes.
#[inline(always)]
fn farther<S: Simd>(s: S, a: S::F, b: S::F) -> S::F {
    let size = s.splat_u(0x7fff_ffff);
    s.max_signed(s.from_bits(s.to_bits(a) & size), s.from_bits(s.to_bits(b) & size))
}

/// One coordinate of the three corners of a block's triangles at the ray's time, exactly as `KeyTime::position`
/// computes it, less the origin.
#[inline(always)]
fn corners<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, origin: f32) -> [S::F; 3] {
    let origin = s.splat(origin);
    let (base, other) = between.rows(CORNER_ROWS);
    let [a, b, c] = s.load_thirds(rows, base + axis);
    if !MOVING {
        return [a - origin, b - origin, c - origin];
    }
    let [a2, b2, c2] = s.load_thirds(rows, other + axis);
    let f = s.splat(between.fraction);
    [a + (a2 - a) * f - origin, b + (b2 - b) * f - origin, c + (c2 - c) * f - origin]
}

/// One coordinate of a block's shared vertices, likewise.
#[inline(always)]
fn vertices<S: Simd, const MOVING: bool>(s: S, rows: &Rows, between: Between, axis: usize, origin: f32) -> S::F {
    let origin = s.splat(origin);
    let (base, other) = between.rows(VERTEX_ROWS);
    let at = s.load_row(rows, base + axis);
    if !MOVING {
        return at - origin;
    }
    at + (s.load_row(rows, other + axis) - at) * s.splat(between.fraction) - origin
}

/// A vertex in f64, whose coordinates at the nearer key and at the other begin with these rows of `n`.
#[inline(always)]
fn fine_vertex<const MOVING: bool>(
    block: &[f32],
    n: usize,
    lane: usize,
    base: usize,
    other: usize,
    between: Between,
) -> DVec3 {
    let at = base * n + lane;
    let near = [block[at], block[at + n], block[at + 2 * n]];
    if !MOVING {
        return DVec3::new(f64::from(near[0]), f64::from(near[1]), f64::from(near[2]));
    }
    let at = other * n + lane;
    let far = [block[at], block[at + n], block[at + 2 * n]];
    DVec3::new(between.fine(near[0], far[0]), between.fine(near[1], far[1]), between.fine(near[2], far[2]))
}

/// What leaf blocks need of a ray, in memory.
#[derive(Clone, Copy)]
pub(super) struct LeafRay {
    /// The axes `kx`, `ky` and `kz` of the shear, and the ray's origin along them.
    axes: [usize; 3],
    origin: [f32; 3],
    /// The slopes of the shear.
    sx: f32,
    sy: f32,
    /// The ray's slack.
    slack: f32,
    /// The ray's time between keys; with two of them, unless a block says otherwise.
    between: Between,
}

impl LeafRay {
    #[inline(always)]
    pub(super) fn new(ray: &TreeRay) -> LeafRay {
        let (o, k) = ([ray.origin.x, ray.origin.y, ray.origin.z, 0.0], &ray.shear);
        LeafRay {
            axes: [k.kx, k.ky, k.kz],
            origin: [o[k.kx & 3], o[k.ky & 3], o[k.kz & 3]],
            sx: k.sx,
            sy: k.sy,
            slack: ray.slack,
            between: Between::new(KeyTime::new(ray.time, 2)),
        }
    }

    /// The same ray with another time between keys.
    #[inline(always)]
    pub(super) fn between(&self, between: Between) -> LeafRay {
        LeafRay { between, ..*self }
    }

    /// The ray for one leaf block. What the black box hides is not prepared for blocks that may never be met.
    #[inline(always)]
    pub(super) fn read(&self) -> LeafRay {
        *core::hint::black_box(self)
    }
}
