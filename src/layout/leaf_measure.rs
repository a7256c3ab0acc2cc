//! Bounds and sizes of the triangles of a leaf block, sixteen at once, from the rows of the block.
//!
//! The numbers are those that `PrimitiveSet::bounds` and [`Sizes`] compute triangle by triangle, bit for bit (but for the
//! signs of zeros): the same operations on the same operands, and the greatest of some numbers is the same in any order.
//! Lower bounds are negated throughout, so that all results are maxima.
//!
//! For more than two keys this is the computation of [`Window`]. There the tube of a vertex that several triangles share
//! is computed once.

use super::keyed_leaf::KeyedLeaf;
use super::leaf_block::{MovedLeaf, bounds_of};
use super::wide_node::{CORNER_ROWS, Kind, Sizes, VERTEX_ROWS};
use crate::geometry::{Box3, KeyTime, LinearBox3, TimeInterval, ULP};
use crate::primitive::{TUBE_ULPS, Triangles, Window};
use crate::simd::{Kernel, LANES, Lanes, Mask, Rows, Simd, as_floats, dispatch, greatest_of_each, lanes_of};
use glam::Vec3;

/// The bounds of the triangles in a block over an interval, and the sizes at all of its keys ([`Sizes::word`]).
pub(super) struct Measured {
    pub bounds: LinearBox3,
    pub sizes: u32,
}

impl Triangles {
    /// Measures a block that begins at `words[0]` and has the coordinates of this set.
    pub(super) fn measured(&self, words: &[u32], of: MovedLeaf<'_>) -> Measured {
        let MovedLeaf { leaf, ids, over, level } = of;
        let n = leaf.len();
        let (shared, keys) = match leaf.kind() {
            Kind::StaticLeaf => (false, 1),
            Kind::SharedStaticLeaf => (true, 1),
            Kind::SharedLeaf => (true, 2),
            Kind::OtherLeaf => return self.measured_keys(words, of),
            _ => (false, 2),
        };
        let rows = keys * if shared { VERTEX_ROWS } else { CORNER_ROWS };
        let numbers = if shared { lanes_of(&words[rows * n..], ids.len()) } else { [0; LANES] };
        let rows = Rows::new(as_floats(words), n, rows);
        let triangles = InRows { rows, shared, numbers, count: ids.len() };
        measured_of(dispatch(level, Linear { triangles, keys, strides: &self.strides(ids), over }))
    }

    /// For triangles with more than two keys.
    fn measured_keys(&self, words: &[u32], of: MovedLeaf<'_>) -> Measured {
        let MovedLeaf { ids, over, level, .. } = of;
        let leaf = KeyedLeaf::of(words, of.leaf.len());
        let keys = leaf.segments + 1;
        let window = Window::new(over, keys);
        let numbers = if leaf.shared { lanes_of(&words[leaf.vertices()..], ids.len()) } else { [0; LANES] };
        // The largest coordinates at the keys around the interval that the block does not hold.
        let mut beyond = [0.0f32; LANES];
        let held = leaf.first..leaf.first + leaf.keys;
        for key in window.around.clone().filter(|key| !held.contains(key)) {
            for (size, &id) in beyond.iter_mut().zip(ids) {
                for corner in self.corners_at_key(id, key) {
                    *size = size.max(corner.abs().max_element());
                }
            }
        }
        let (segments, slack) = ([window.begin.segment, window.end.segment], Triangles::slack(keys, 1.0));
        let done = segments.iter().all(|&segment| leaf.holds([segment; 2])).then(|| {
            let words = &as_floats(words)[leaf.front()..];
            dispatch(level, Bent { words, leaf, numbers, window, beyond: &beyond, slack })
        });
        match done.flatten() {
            Some(greatest) => measured_of(greatest),
            None => Measured { bounds: bounds_of(self, ids, over), sizes: self.sizes(ids, held) },
        }
    }
}

/// The results from the greatest of each.
fn measured_of(greatest: Lanes<f32>) -> Measured {
    let [a, b, c, d, e, f, g, h, i, j, k, l, size, extent, ..] = greatest;
    // Not the negative, which would be a negative zero.
    let low = |x: f32, y: f32, z: f32| Vec3::ZERO - Vec3::new(x, y, z);
    let begin = Box3 { min: low(a, b, c), max: Vec3::new(d, e, f) };
    let end = Box3 { min: low(g, h, i), max: Vec3::new(j, k, l) };
    Measured { bounds: LinearBox3 { begin, end }, sizes: Sizes::word_of(size, extent) }
}

/// The rows of the triangles at one key or two.
struct InRows<'a> {
    rows: Rows<'a>,
    shared: bool,
    numbers: Lanes<u32>,
    count: usize,
}

/// Bounds in lanes: for each axis the negated lower one, and the upper one.
type Faces<S> = [[<S as Simd>::F; 2]; 3];

impl InRows<'_> {
    /// One coordinate of the three corners at a key.
    #[inline(always)]
    fn corners<S: Simd>(&self, s: S, key: usize, axis: usize) -> [S::F; 3] {
        match self.shared {
            true => at_corners(s, s.load_row(&self.rows, VERTEX_ROWS * key + axis), s.load_u(&self.numbers)),
            false => s.load_thirds(&self.rows, CORNER_ROWS * key + axis),
        }
    }
}

/// The values of the vertices at the three corners of each triangle.
#[inline(always)]
fn at_corners<S: Simd>(s: S, vertices: S::F, numbers: S::U) -> [S::F; 3] {
    [
        s.permute(vertices, numbers),
        s.permute(vertices, s.shift_right::<4>(numbers)),
        s.permute(vertices, s.shift_right::<8>(numbers)),
    ]
}

/// The negated least and the greatest of three.
#[inline(always)]
fn faces_of<S: Simd>(s: S, [a, b, c]: [S::F; 3]) -> [S::F; 2] {
    [s.splat(0.0) - s.min(s.min(a, b), c), s.max(s.max(a, b), c)]
}

/// The greatest of all faces, which is the largest magnitude of a coordinate.
#[inline(always)]
fn magnitude<S: Simd>(s: S, faces: &Faces<S>) -> S::F {
    let [[a, b], [c, d], [e, f]] = *faces;
    s.max(s.max(s.max(a, b), s.max(c, d)), s.max(e, f))
}

/// The largest extent along an axis.
#[inline(always)]
fn extent<S: Simd>(s: S, faces: &Faces<S>) -> S::F {
    let [x, y, z] = *faces;
    s.max(s.max(x[0] + x[1], y[0] + y[1]), z[0] + z[1])
}

/// Triangles that move linearly or are static.
struct Linear<'a> {
    triangles: InRows<'a>,
    keys: usize,
    /// Static triangles have 0.
    strides: &'a Lanes<u32>,
    over: TimeInterval,
}

impl Kernel for Linear<'_> {
    type Output = Lanes<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Lanes<f32> {
        let Linear { triangles, keys, strides, over } = self;
        let zero = s.splat(0.0);
        let mut at = [[[zero; 2]; 3]; 2];
        // At the ends of the interval, if those are not keys.
        let mut ends = [[[zero; 2]; 3]; 2];
        let part = keys > 1 && over != TimeInterval::FULL;
        let times = [KeyTime::new(over.begin(), 2), KeyTime::new(over.end(), 2)];
        for axis in 0..3 {
            let first = triangles.corners(s, 0, axis);
            at[0][axis] = faces_of(s, first);
            at[1][axis] = at[0][axis];
            if keys > 1 {
                let last = triangles.corners(s, 1, axis);
                at[1][axis] = faces_of(s, last);
                if part {
                    for (end, time) in ends.iter_mut().zip(times) {
                        end[axis] = faces_of(s, between(s, time, first, last));
                    }
                }
            }
        }
        let size = s.max(magnitude(s, &at[0]), magnitude(s, &at[1]));
        let extents = s.max(extent(s, &at[0]), extent(s, &at[1]));
        let moving = s.lt_u(s.splat_u(0), s.load_u(strides));
        let slack = s.select(moving, size * s.splat(Triangles::slack(2, 1.0)), zero);
        let ends = if part { ends } else { at };
        greatest(s, ends, slack, [size, extents], triangles.count)
    }
}

/// Corners at a time between two keys, as [`KeyTime::position`] computes them.
#[inline(always)]
fn between<S: Simd>(s: S, time: KeyTime, [a, b, c]: [S::F; 3], [a2, b2, c2]: [S::F; 3]) -> [S::F; 3] {
    let fraction = s.splat(time.s);
    let at = |x: S::F, y: S::F| (if time.from_end { y } else { x }) + (y - x) * fraction;
    [at(a, a2), at(b, b2), at(c, c2)]
}

/// The greatest among the first `count` lanes: of the padded faces at both ends, the size and the extent.
#[inline(always)]
fn greatest<S: Simd>(
    s: S,
    [begin, end]: [Faces<S>; 2],
    pad: S::F,
    [size, extent]: [S::F; 2],
    count: usize,
) -> Lanes<f32> {
    let present = (u32::MAX >> (32 - count as u32)) as Mask;
    let least = s.splat(f32::NEG_INFINITY);
    let mut all = [least; LANES];
    for axis in 0..3 {
        all[axis] = begin[axis][0] + pad;
        all[axis + 3] = begin[axis][1] + pad;
        all[axis + 6] = end[axis][0] + pad;
        all[axis + 9] = end[axis][1] + pad;
    }
    (all[12], all[13]) = (size, extent);
    for lanes in all.iter_mut().take(14) {
        *lanes = s.select(present, *lanes, least);
    }
    let mut to = [0.0; LANES];
    s.store(greatest_of_each(s, all), &mut to);
    to
}

/// Triangles with more than two keys.
struct Bent<'a> {
    /// The rows of all keys.
    words: &'a [f32],
    leaf: KeyedLeaf,
    numbers: Lanes<u32>,
    window: Window,
    /// The largest coordinate of each triangle at keys that are not in the block.
    beyond: &'a Lanes<f32>,
    /// The slack of vertices, per magnitude.
    slack: f32,
}

/// One tube per lane, of a vertex or of one of the corners.
#[derive(Clone, Copy)]
struct Tubes<S: Simd> {
    /// At the begin and the end of the interval.
    ends: [Faces<S>; 2],
    /// The largest coordinate.
    size: S::F,
}

impl<S: Simd> Tubes<S> {
    /// Replaces each number by a function of it and another's.
    #[inline(always)]
    fn replace(&mut self, by: &Tubes<S>, f: impl Fn(S::F, S::F) -> S::F) {
        for (faces, others) in self.ends.iter_mut().zip(&by.ends) {
            for (sides, others) in faces.iter_mut().zip(others) {
                for (side, &other) in sides.iter_mut().zip(others) {
                    *side = f(*side, other);
                }
            }
        }
        self.size = f(self.size, by.size);
    }
}

impl Kernel for Bent<'_> {
    type Output = Option<Lanes<f32>>;

    /// Returns `None` if a triangle's bounds are the same at both ends.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<Lanes<f32>> {
        let numbers = s.load_u(&self.numbers);
        let Tubes { ends, size } = match self.leaf.shared {
            true => {
                let tubes = self.tubes(s, 0);
                let mut all = tubes;
                all.replace(&tubes, |_, x| {
                    let [a, b, c] = at_corners(s, x, numbers);
                    s.max(s.max(a, b), c)
                });
                all
            }
            false => {
                let mut all = self.tubes(s, 0);
                all.replace(&self.tubes(s, 3), |a, b| s.max(a, b));
                all.replace(&self.tubes(s, 6), |a, b| s.max(a, b));
                all
            }
        };
        let at_keys = size;
        let size = s.max(size, s.load(self.beyond));
        let pad = size * s.splat(self.slack) * s.splat(2.0) + size * s.splat(TUBE_ULPS * ULP);
        let mut still = (u32::MAX >> (32 - self.leaf.count as u32)) as Mask;
        for (begin, end) in ends[0].as_flattened().iter().zip(ends[1].as_flattened()) {
            still &= s.eq(*begin + pad, *end + pad);
        }
        if still != 0 {
            return None;
        }
        let [beyond, extents] = self.sizes(s, numbers);
        Some(greatest(s, ends, pad, [s.max(beyond, at_keys), extents], self.leaf.count))
    }
}

impl Bent<'_> {
    /// The rows of a key.
    #[inline(always)]
    fn rows(&self, key: usize) -> Rows<'_> {
        let words = self.leaf.key_words();
        Rows::new(&self.words[(key - self.leaf.first) * words..], self.leaf.width, words / self.leaf.width)
    }

    /// The points whose coordinates are in three successive rows, at a time between keys of the block.
    #[inline(always)]
    fn state<S: Simd>(&self, s: S, time: KeyTime, row: usize) -> [S::F; 3] {
        let (low, high) = (self.rows(time.segment), self.rows(time.segment + 1));
        let mut state = [s.splat(0.0); 3];
        for (axis, state) in state.iter_mut().enumerate() {
            let (a, b) = (s.load_row(&low, row + axis), s.load_row(&high, row + axis));
            *state = (if time.from_end { b } else { a }) + (b - a) * s.splat(time.s);
        }
        state
    }

    /// The tubes of the points whose coordinates are in three successive rows.
    #[inline(always)]
    fn tubes<S: Simd>(&self, s: S, row: usize) -> Tubes<S> {
        let zero = s.splat(0.0);
        let window = &self.window;
        let (begin, end) = (self.state(s, window.begin, row), self.state(s, window.end, row));
        let way = [end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]];
        let (mut below, mut above) = ([zero; 3], [zero; 3]);
        // The coordinates on both sides of zero that are farthest from it.
        let (mut least, mut most) = (zero, zero);
        for key in window.inner.clone() {
            let (rows, w) = (self.rows(key), s.splat(window.fraction(key)));
            for axis in 0..3 {
                let place = s.load_row(&rows, row + axis);
                let off = place - (begin[axis] + way[axis] * w);
                below[axis] = s.min(below[axis], off);
                above[axis] = s.max(above[axis], off);
                (least, most) = (s.min(least, place), s.max(most, place));
            }
        }
        let held = self.leaf.first..self.leaf.first + self.leaf.keys;
        for key in window.around.clone().filter(|key| held.contains(key) && !window.inner.contains(key)) {
            let rows = self.rows(key);
            for axis in 0..3 {
                let place = s.load_row(&rows, row + axis);
                (least, most) = (s.min(least, place), s.max(most, place));
            }
        }
        let (mut first, mut last) = ([[zero; 2]; 3], [[zero; 2]; 3]);
        for axis in 0..3 {
            first[axis] = [zero - (begin[axis] + below[axis]), begin[axis] + above[axis]];
            last[axis] = [zero - (end[axis] + below[axis]), end[axis] + above[axis]];
        }
        Tubes { ends: [first, last], size: s.max(most, zero - least) }
    }

    /// The largest coordinate of each triangle at the keys of the block that are not around the interval, and the largest
    /// extent at all keys of the block.
    #[inline(always)]
    fn sizes<S: Simd>(&self, s: S, numbers: S::U) -> [S::F; 2] {
        let zero = s.splat(0.0);
        let (mut size, mut extents) = (zero, zero);
        for key in self.leaf.first..self.leaf.first + self.leaf.keys {
            let rows = self.rows(key);
            let within = self.window.holds(key);
            for axis in 0..3 {
                let [a, b, c] = match self.leaf.shared {
                    true => at_corners(s, s.load_row(&rows, axis), numbers),
                    false => s.load_thirds(&rows, axis),
                };
                let (low, high) = (s.min(s.min(a, b), c), s.max(s.max(a, b), c));
                // The second one of equal numbers, so that zeros stay positive.
                extents = s.max(high - low, extents);
                if !within {
                    size = s.max(s.max(high, zero - low), size);
                }
            }
        }
        [size, extents]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{ChildRef, WideTree};
    use crate::params::{Division, WideParams};
    use crate::primitive::{Keys, Scene, TriangleMesh};
    use crate::progress::Progress;
    use crate::random::Random;
    use crate::scene;
    use crate::simd::SimdLevel;
    use crate::time::time_slice;

    /// Meshes of one key to seventeen, with shared vertices and without; parts of them do not move.
    fn meshes() -> Vec<TriangleMesh> {
        let mut meshes = scene::walking_from(6000, 2, 0.0).meshes;
        meshes.extend(scene::walking_from(3000, 9, 0.0).meshes);
        meshes.extend(scene::turning(1000, 17).meshes);
        let mut random = Random(8);
        for keys in [1, 2, 3, 6] {
            let places: Vec<Vec3> = (0..900).map(|_| random.vec() * 0.05 + random.vec()).collect();
            let key = |_| places.iter().map(|&p| p + random.vec() * 0.1).collect::<Vec<Vec3>>();
            let mut keys: Vec<Vec<Vec3>> = (0..keys).map(key).collect();
            for vertex in 0..90 {
                let still = keys[0][vertex];
                keys.iter_mut().for_each(|key| key[vertex] = still);
            }
            meshes.push(TriangleMesh::new((0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), Keys::F32(keys)));
        }
        meshes
    }

    #[test]
    fn blocks_measure_as_their_triangles_on_all_instruction_sets() {
        let set = Scene::new(&meshes(), Vec::new()).expect("a scene");
        let mut kinds = Vec::new();
        for division in [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(4)] {
            let params = WideParams { division, ..WideParams::default() };
            let tree = WideTree::build(&set, &params, &Progress::new(None)).expect("a tree");
            let mut blocks = tree.blocks.clone();
            blocks.sort_unstable();
            blocks.dedup();
            for leaf in blocks.into_iter().map(ChildRef) {
                let (words, ids) = (&tree.arena.ints()[leaf.at()..], tree.ids::<Scene>(leaf).expect("a leaf block"));
                let sizes = {
                    let keyed = (leaf.kind() == Kind::OtherLeaf).then(|| KeyedLeaf::of(words, leaf.len()));
                    let most = ids.iter().map(|&id| set.triangles.keys(id)).max().unwrap_or(1);
                    set.triangles.sizes(ids, keyed.map_or(0..most, |leaf| leaf.first..leaf.first + leaf.keys))
                };
                for over in [TimeInterval::FULL, time_slice(0, 3), time_slice(2, 5)] {
                    let bounds = bounds_of(&set.triangles, ids, over);
                    for level in SimdLevel::available() {
                        let measured = set.triangles.measured(words, MovedLeaf { leaf, ids, over, level });
                        assert_eq!(measured.bounds, bounds, "{:?}, {over:?}, {level}", leaf.kind());
                        assert_eq!(measured.sizes, sizes, "{:?}, {level}", leaf.kind());
                    }
                }
                kinds.push(leaf.kind() as u8);
            }
        }
        kinds.sort_unstable();
        kinds.dedup();
        assert_eq!(kinds.len(), 5, "all kinds of leaf blocks");
    }
}
