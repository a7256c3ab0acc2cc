//! The triangles or spheres of a leaf block at a time, sixteen at once.

use super::keyed::KeyedLeaf;
use super::spheres::SPHERE_ROWS;
use crate::geometry::KeyTime;
use crate::layout::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS, shared_count};
use crate::simd::{Arena, Rows, Simd, lanes_at};

/// The corners of up to sixteen triangles. Lanes beyond their number are unspecified.
pub(crate) struct CornerLanes<S: Simd> {
    /// Three corners, three coordinates each.
    pub corners: [[S::F; 3]; 3],
    pub count: usize,
    /// The first word of their ids.
    pub ids: usize,
    /// The word of the sizes of the block ([`crate::layout::block_sizes`]).
    pub sizes: u32,
}

impl<S: Simd> CornerLanes<S> {
    /// The corners in a leaf block of triangles at a time, bit for bit as `KeyTime::position` computes them, up to signs of zeros.
    #[inline(always)]
    pub fn of(s: S, arena: &Arena, leaf: ChildRef, time: f32) -> CornerLanes<S> {
        let (at, n) = (leaf.at(), leaf.len());
        let linear = Between::of_two(time);
        match leaf.kind() {
            Kind::StaticLeaf => CornerLanes::own::<false>(s, arena, (at, n, at + CORNER_ROWS * n + 1), linear),
            Kind::SharedLeaf => CornerLanes::shared::<true>(s, arena, (at, n, at + 2 * VERTEX_ROWS * n), linear),
            Kind::SharedStaticLeaf => CornerLanes::shared::<false>(s, arena, (at, n, at + VERTEX_ROWS * n), linear),
            Kind::OtherLeaf => {
                let keyed = KeyedLeaf::read(arena.ints(), leaf);
                let time = KeyTime::new(time, keyed.segments + 1);
                let (rows, between) = (at + keyed.rows(time.segment), Between::new(time));
                match keyed.shared {
                    true => CornerLanes::shared::<true>(s, arena, (rows, n, at + keyed.vertices()), between),
                    false => CornerLanes::own::<true>(s, arena, (rows, n, at + keyed.ids()), between),
                }
            }
            _ => CornerLanes::own::<true>(s, arena, (at, n, at + 2 * CORNER_ROWS * n + 1), linear),
        }
    }

    /// For triangles without shared vertices: the beginning and length of the rows, and the beginning of the ids.
    #[inline(always)]
    fn own<const MOVING: bool>(
        s: S,
        arena: &Arena,
        (at, n, ids): (usize, usize, usize),
        between: Between,
    ) -> CornerLanes<S> {
        let count = if MOVING { 2 * CORNER_ROWS } else { CORNER_ROWS };
        let rows = Rows::new(&arena.floats()[at..], n, count);
        let (base, other) = if MOVING { between.rows(CORNER_ROWS) } else { (0, 0) };
        let fraction = s.splat(between.fraction);
        let [mut first, mut second, mut third] = [[fraction; 3]; 3];
        for axis in 0..3 {
            let [a, b, c] = s.load_thirds(&rows, base + axis);
            (first[axis], second[axis], third[axis]) = (a, b, c);
            if MOVING {
                let [a2, b2, c2] = s.load_thirds(&rows, other + axis);
                first[axis] = a + (a2 - a) * fraction;
                second[axis] = b + (b2 - b) * fraction;
                third[axis] = c + (c2 - c) * fraction;
            }
        }
        CornerLanes { corners: [first, second, third], count: n, ids, sizes: arena.ints()[ids - 1] }
    }

    /// For triangles with shared vertices: the beginning and length of the rows, and the beginning of the vertex
    /// numbers.
    #[inline(always)]
    fn shared<const MOVING: bool>(
        s: S,
        arena: &Arena,
        (at, n, numbers): (usize, usize, usize),
        between: Between,
    ) -> CornerLanes<S> {
        let count = if MOVING { 2 * VERTEX_ROWS } else { VERTEX_ROWS };
        let rows = Rows::new(&arena.floats()[at..], n, count);
        let (base, other) = if MOVING { between.rows(VERTEX_ROWS) } else { (0, 0) };
        let words = lanes_at(arena.ints(), numbers);
        let triangles = shared_count(words[0]);
        let places = s.load_u(words);
        let fraction = s.splat(between.fraction);
        let [mut first, mut second, mut third] = [[fraction; 3]; 3];
        for axis in 0..3 {
            let vertices = s.load_row(&rows, base + axis);
            let vertices =
                if MOVING { vertices + (s.load_row(&rows, other + axis) - vertices) * fraction } else { vertices };
            first[axis] = s.permute(vertices, places);
            second[axis] = s.permute(vertices, s.shift_right::<4>(places));
            third[axis] = s.permute(vertices, s.shift_right::<8>(places));
        }
        CornerLanes { corners: [first, second, third], count: triangles, ids: numbers + triangles, sizes: words[0] }
    }
}

/// A time between two keys, as leaf blocks use it: from the nearer key towards the other.
///
/// `b + s (b - a)` with negative `s` is `b + (-s) (a - b)` bit for bit, since changing both signs of a product changes
/// nothing. (Of two keys at -0 the first sum is -0 and the second is not.) So both halves of a segment read two rows, in one order
/// or the other.
#[derive(Clone, Copy)]
pub(crate) struct Between {
    /// Whether the later key is the nearer one.
    from_end: bool,
    /// The fraction of the segment, from the nearer key, in [0, 1/2].
    pub(crate) fraction: f32,
}

impl Between {
    /// For static geometry.
    pub(crate) const NEVER: Between = Between { from_end: false, fraction: 0.0 };

    #[inline(always)]
    pub(crate) fn new(keys: KeyTime) -> Between {
        Between { from_end: keys.from_end, fraction: if keys.from_end { -keys.s } else { keys.s } }
    }

    /// Between the two keys of linear motion.
    #[inline(always)]
    pub(crate) fn of_two(time: f32) -> Between {
        Between::new(KeyTime::new(time, 2))
    }

    /// The first row of the nearer key, and of the other, if a key has this many rows.
    #[inline(always)]
    pub(crate) fn rows(self, per_key: usize) -> (usize, usize) {
        let base = per_key * usize::from(self.from_end);
        (base, per_key - base)
    }
}

/// A row of the spheres of a block at a time: one coordinate of the centers relative to an origin, or the radii relative to zero.
/// For culling only.
#[inline(always)]
pub(crate) fn sphere_row<S: Simd, const MOVING: bool>(s: S, rows: &Rows, at: Between, row: usize, origin: f32) -> S::F {
    let (base, other) = at.rows(SPHERE_ROWS);
    let (near, origin) = (s.load_row(rows, base + row), s.splat(origin));
    if MOVING {
        s.mul_add(s.load_row(rows, other + row) - near, s.splat(at.fraction), near - origin)
    } else {
        near - origin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn leaf_blocks_interpolate_as_keys_do() {
        let mut random = Random(3);
        for _ in 0..10_000 {
            let (a, b) = (random.vec(), random.vec());
            let keys = KeyTime::new(random.signed().abs(), 2);
            let between = Between::new(keys);
            let (at, other) = if between.rows(9) == (0, 9) { (a, b) } else { (b, a) };
            assert_eq!(at + (other - at) * between.fraction, keys.position(a, b));
        }
    }
}
