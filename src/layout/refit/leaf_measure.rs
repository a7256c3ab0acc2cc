//! Bounds and sizes of the triangles of a leaf block, sixteen at once, from the rows of the block.
//!
//! The numbers are those that `PrimitiveSet::bounds` and [`Sizes`] compute triangle by triangle, bit for bit (but for the
//! signs of zeros): the same operations on the same operands, and the greatest of some numbers is the same in any order.
//! Lower bounds are negated throughout, so that all results are maxima.
//!
//! For more than two keys `primitive/bounds/tubes.rs` computes the bounds.

use crate::geometry::{KeyTime, LinearBox3, TimeInterval};
use crate::layout::leaf::keyed::KeyedLeaf;
use crate::layout::leaf::source::{MovedLeaf, bounds_of};
use crate::layout::wide_node::{CORNER_ROWS, Kind, Sizes, VERTEX_ROWS};
use crate::primitive::{FaceLanes, RowsOfKeys, Shared, Triangles, Window, at_corners, bounds_of_faces};
use crate::simd::{
    Kernel, LANES, Lanes, Simd, SimdLevel, as_floats, dispatch, first_lanes, greatest_of_each, lanes_of,
};

/// The bounds of the triangles in a block over an interval, and the sizes at all of its keys ([`Sizes::word`]).
pub(in crate::layout) struct Measured {
    pub bounds: LinearBox3,
    pub sizes: u32,
}

impl Triangles {
    /// Measures a block that begins at `words[0]` and has the coordinates of this set.
    pub(in crate::layout) fn measured(&self, words: &[u32], of: MovedLeaf<'_>) -> Measured {
        if of.leaf.kind() == Kind::OtherLeaf {
            let sizes = KeyedLeaf::of(words, of.leaf.len()).sizes(words, of.level);
            return Measured { bounds: self.row_bounds(words, of), sizes };
        }
        let measured = self.measured_linear(words, of);
        if of.ids.iter().any(|&id| self.is_precise(id)) {
            // Their bounds are larger by their rounding.
            return Measured { bounds: bounds_of(self, of.ids, of.over), ..measured };
        }
        measured
    }

    /// The bounds alone.
    pub(in crate::layout) fn row_bounds(&self, words: &[u32], of: MovedLeaf<'_>) -> LinearBox3 {
        if of.ids.iter().any(|&id| self.is_precise(id)) {
            return bounds_of(self, of.ids, of.over);
        }
        match of.leaf.kind() {
            Kind::OtherLeaf => self.bent_row_bounds(words, of),
            _ => self.measured_linear(words, of).bounds,
        }
    }

    /// For triangles with at most two keys.
    fn measured_linear(&self, words: &[u32], MovedLeaf { leaf, ids, over, level }: MovedLeaf<'_>) -> Measured {
        let width = leaf.len();
        let (shared, keys) = match leaf.kind() {
            Kind::StaticLeaf => (false, 1),
            Kind::SharedStaticLeaf => (true, 1),
            Kind::SharedLeaf => (true, 2),
            _ => (false, 2),
        };
        let rows = if shared { VERTEX_ROWS } else { CORNER_ROWS };
        let numbers = if shared { lanes_of(&words[keys * rows * width..], ids.len()) } else { [0; LANES] };
        let rows = RowsOfKeys { words: as_floats(words), first: 0, keys, width, rows };
        let triangles = InRows { rows, shared, numbers, count: ids.len() };
        let greatest = dispatch(level, Linear { triangles, strides: &self.strides(ids), over });
        Measured { bounds: bounds_of_faces(&greatest), sizes: Sizes::word_of(greatest[SIZE], greatest[EXTENT]) }
    }

    /// The bounds of triangles with more than two keys.
    fn bent_row_bounds(&self, words: &[u32], MovedLeaf { leaf, ids, over, level }: MovedLeaf<'_>) -> LinearBox3 {
        let leaf = KeyedLeaf::of(words, leaf.len());
        let keys = leaf.segments + 1;
        let (window, slack) = (Window::new(over, keys), Triangles::slack(keys, 1.0));
        let triangles = leaf.triangles(words);
        if ![window.begin.segment, window.end.segment].iter().all(|&segment| leaf.holds([segment; 2])) {
            // The block of a time slice lacks a key next to it, since only roundings of its boxes reach there.
            let (around, words) = self.around(words, &leaf, ids, &window, level);
            let triangles = InRows { rows: around.rows_of_keys(&words), ..triangles };
            let bent = Bent { triangles, window, beyond: &[0.0; LANES], slack };
            return bounds_of_faces(&dispatch(level, bent));
        }
        // The largest coordinates at the keys around the interval that the block does not hold.
        let (mut beyond, held) = ([0.0f32; LANES], leaf.first..leaf.first + leaf.keys);
        for key in window.around.clone().filter(|key| !held.contains(key)) {
            for (size, &id) in beyond.iter_mut().zip(ids) {
                for corner in self.corners_at_key(id, key) {
                    *size = size.max(corner.abs().max_element());
                }
            }
        }
        bounds_of_faces(&dispatch(level, Bent { triangles, window, beyond: &beyond, slack }))
    }

    /// A block of the same triangles with all keys within and around an interval, of which only the rows are written.
    fn around(
        &self,
        words: &[u32],
        leaf: &KeyedLeaf,
        ids: &[u32],
        window: &Window,
        level: SimdLevel,
    ) -> (KeyedLeaf, Vec<u32>) {
        let (first, last) = (*window.around.start(), *window.around.end());
        let around = KeyedLeaf { first, keys: last + 1 - first, ..*leaf };
        let shared = leaf.shared.then(|| Shared::again(self, ids, &words[leaf.vertices()..], leaf.width));
        let mut rows = vec![0; around.words()];
        self.fill_keyed(&mut rows, &around, ids, shared.as_ref(), level);
        (around, rows)
    }
}

impl KeyedLeaf {
    /// The sizes of the block at all of its keys ([`Sizes::word`]).
    pub(in crate::layout) fn sizes(&self, words: &[u32], level: SimdLevel) -> u32 {
        let [size, extent] = dispatch(level, SizesOf(self.triangles(words)));
        Sizes::word_of(size, extent)
    }

    fn triangles<'a>(&self, words: &'a [u32]) -> InRows<'a> {
        let numbers = if self.shared { lanes_of(&words[self.vertices()..], self.count) } else { [0; LANES] };
        InRows { rows: self.rows_of_keys(words), shared: self.shared, numbers, count: self.count }
    }

    fn rows_of_keys<'a>(&self, words: &'a [u32]) -> RowsOfKeys<'a> {
        let rows = if self.shared { VERTEX_ROWS } else { CORNER_ROWS };
        let words = &as_floats(words)[self.front()..];
        RowsOfKeys { words, first: self.first, keys: self.keys, width: self.width, rows }
    }
}

/// Behind the twelve faces: the largest coordinate, and the largest extent.
const SIZE: usize = 12;
const EXTENT: usize = 13;

/// The triangles of a block in rows.
struct InRows<'a> {
    rows: RowsOfKeys<'a>,
    /// Whether the rows are of vertices. Then these are the lanes of the corners of each triangle, four bits for each.
    shared: bool,
    numbers: Lanes<u32>,
    /// Number of triangles.
    count: usize,
}

impl InRows<'_> {
    /// One coordinate of the three corners at a key.
    #[inline(always)]
    fn corners<S: Simd>(&self, s: S, key: usize, axis: usize) -> [S::F; 3] {
        let rows = self.rows.at(key);
        match self.shared {
            true => at_corners(s, s.load_row(&rows, axis), s.load_u(&self.numbers)),
            false => s.load_thirds(&rows, axis),
        }
    }
}

/// The negated least and the greatest of three.
#[inline(always)]
fn faces_of<S: Simd>(s: S, [a, b, c]: [S::F; 3]) -> [S::F; 2] {
    [s.splat(0.0) - s.min(s.min(a, b), c), s.max(s.max(a, b), c)]
}

/// The greatest of all faces, which is the largest magnitude of a coordinate.
#[inline(always)]
fn magnitude<S: Simd>(s: S, faces: &FaceLanes<S>) -> S::F {
    let [[a, b], [c, d], [e, f]] = *faces;
    s.max(s.max(s.max(a, b), s.max(c, d)), s.max(e, f))
}

/// The largest extent along an axis.
#[inline(always)]
fn extent<S: Simd>(s: S, faces: &FaceLanes<S>) -> S::F {
    let [x, y, z] = *faces;
    s.max(s.max(x[0] + x[1], y[0] + y[1]), z[0] + z[1])
}

/// Triangles that move linearly or are static.
struct Linear<'a> {
    triangles: InRows<'a>,
    /// Static triangles have 0.
    strides: &'a Lanes<u32>,
    over: TimeInterval,
}

impl Kernel for Linear<'_> {
    type Output = Lanes<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Lanes<f32> {
        let Linear { triangles, strides, over } = self;
        let (zero, keys) = (s.splat(0.0), triangles.rows.keys);
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
        let mut faces = [slack; 12];
        for axis in 0..3 {
            for side in 0..2 {
                faces[3 * side + axis] = ends[0][axis][side] + slack;
                faces[6 + 3 * side + axis] = ends[1][axis][side] + slack;
            }
        }
        greatest(s, &faces, [size, extents], triangles.count)
    }
}

/// Corners at a time between two keys, as [`KeyTime::position`] computes them.
#[inline(always)]
fn between<S: Simd>(s: S, time: KeyTime, [a, b, c]: [S::F; 3], [a2, b2, c2]: [S::F; 3]) -> [S::F; 3] {
    let fraction = s.splat(time.s);
    let at = |x: S::F, y: S::F| (if time.from_end { y } else { x }) + (y - x) * fraction;
    [at(a, a2), at(b, b2), at(c, c2)]
}

/// The greatest among the first `count` lanes: of the faces, the size and the extent.
#[inline(always)]
fn greatest<S: Simd>(s: S, faces: &[S::F; 12], [size, extent]: [S::F; 2], count: usize) -> Lanes<f32> {
    let present = first_lanes(count);
    let least = s.splat(f32::NEG_INFINITY);
    let mut all = [least; LANES];
    all[..12].copy_from_slice(faces);
    (all[SIZE], all[EXTENT]) = (size, extent);
    for lanes in all.iter_mut().take(EXTENT + 1) {
        *lanes = s.select(present, *lanes, least);
    }
    let mut to = [0.0; LANES];
    s.store(greatest_of_each(s, all), &mut to);
    to
}

/// The bounds of triangles with more than two keys.
struct Bent<'a> {
    triangles: InRows<'a>,
    window: Window,
    /// The largest coordinate of each triangle at keys that are not in the block.
    beyond: &'a Lanes<f32>,
    /// The slack of vertices, per magnitude.
    slack: f32,
}

impl Kernel for Bent<'_> {
    type Output = Lanes<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Lanes<f32> {
        let Bent { triangles: InRows { rows, shared, numbers, count }, window, beyond, slack } = self;
        let mut tubes = rows.tubes(s, &window, 0);
        if shared {
            tubes = tubes.of_triangles(s, s.load_u(&numbers));
        } else {
            tubes.unite(s, &rows.tubes(s, &window, 3));
            tubes.unite(s, &rows.tubes(s, &window, 6));
        }
        let size = s.max(tubes.size, s.load(beyond));
        let faces = tubes.padded(s, size, slack, first_lanes(count));
        greatest(s, &faces, [size; 2], count)
    }
}

/// The largest coordinate and the largest extent of triangles with more than two keys.
struct SizesOf<'a>(InRows<'a>);

impl Kernel for SizesOf<'_> {
    type Output = [f32; 2];

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> [f32; 2] {
        let triangles = self.0;
        let (mut size, mut extents) = (s.splat(0.0), s.splat(0.0));
        for key in triangles.rows.first..triangles.rows.first + triangles.rows.keys {
            for axis in 0..3 {
                let [low, high] = faces_of(s, triangles.corners(s, key, axis));
                // The second one of equal numbers, so that zeros stay positive.
                extents = s.max(high + low, extents);
                size = s.max(s.max(high, low), size);
            }
        }
        let greatest = greatest(s, &[size; 12], [size, extents], triangles.count);
        [greatest[SIZE], greatest[EXTENT]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{ChildRef, WideTree};
    use crate::params::{Division, WideParams};
    use crate::primitive::{Keys, Scene, TriangleMesh, no_shapes};
    use crate::progress::Progress;
    use crate::random::Random;
    use crate::scene;
    use crate::time::time_slice;
    use glam::Vec3;

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
        let set = Scene::new(&meshes(), no_shapes()).expect("a scene");
        let mut kinds = Vec::new();
        for division in [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(4)] {
            let params = WideParams { division, ..WideParams::default() };
            let tree = WideTree::build(&set, &params, &Progress::new(None)).expect("a tree");
            let mut blocks = tree.blocks.clone();
            blocks.sort_unstable();
            blocks.dedup();
            for leaf in blocks.into_iter().map(ChildRef) {
                let (words, ids) = (&tree.arena.ints()[leaf.at()..], tree.ids(leaf).expect("a leaf block"));
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
