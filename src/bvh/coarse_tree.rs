//! The coarse tree of a lazy one: the top levels of a binary tree, by grids.
//!
//! Object splits visit every reference once per level. If only the first levels are wanted, one pass over the primitives is enough:
//! each is put into the cell of a grid that holds its centre, and object splits then partition the cells. No reference is stored: a
//! primitive leaves its bounds in its cell, and the number of the cell. A single cell with too many primitives is split as usual,
//! or by a grid of its own if it has very many, but not more than half of all, as where a scene is concentrated in a small region:
//! then grid after grid might separate little.
//!
//! Where the tree ends is decided from the leaves up: a subtree is one leaf unless its parts are expected to cost less, since they
//! are needed less often. Rays of a picture are close together, so whether any of them enters a box depends on its size: the chance
//! grows with the root of the area, not with the area.

use super::builder::{BinaryNode, BinaryTree, build_binary};
use super::reference::Reference;
use super::visits::mean_half_area;
use crate::geometry::{LaneBounds, LinearBox3};
use crate::parallel;
use crate::progress::Progress;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch, huge_vec};
use crate::tuning::lazy::{CELLS, CROWDED, PLACED, SUBTREE_COST};
use core::ops::Range;
use glam::Vec4;

/// Primitives that are binned per task if there are several threads.
const BIN_CHUNK: usize = 1 << 16;

/// Primitives whose bounds are found before they are binned: they stay in a near cache.
const BLOCK: usize = 256;

/// Primitives between two reports of progress while they are binned: a multiple of [`BLOCK`]. Not fitted: they take a few hundred
/// microseconds.
const REPORTED: usize = 16 * BLOCK;

/// The share of binning in the whole, about.
const BINNING: f64 = 0.8;

/// Writes the bounds of some primitives, in ascending order. Called through `dyn`, since a grid within a cell asks for those of
/// others.
pub(crate) type BoundsOf<'a> = dyn Fn(&[u32], &mut [LaneBounds]) + Sync + 'a;

/// A binary tree over `0..n` whose leaves have at most `most` primitives, and the ids of these in the order of the tree; those of a
/// leaf are a few ascending runs. `bounds` writes those of some primitives in ascending order. Once `progress` is cancelled, the
/// tree is of no use.
pub(crate) fn coarse_tree(n: usize, bounds: &BoundsOf<'_>, most: usize, progress: &Progress) -> (BinaryTree, Vec<u32>) {
    if n == 0 {
        return (BinaryTree::new(), Vec::new());
    }
    let grid = Grid::around(n, bounds, most);
    let chunk = if parallel::threads() == 1 { n } else { BIN_CHUNK };
    let binning = progress.subtask(BINNING);
    let binning = binning.in_units(n);
    let tasks = parallel::map(n.div_ceil(chunk), |i| grid.binned(bounds, i * chunk..n.min((i + 1) * chunk), &binning));
    if progress.cancelled() {
        return (BinaryTree::new(), Vec::new());
    }
    let mut counts = vec![0u32; grid.cells()];
    let mut cells = Vec::new();
    for (key, count) in counts.iter_mut().enumerate() {
        let some = tasks.iter().filter(|task| task.counts[key] > 0);
        *count = some.clone().map(|task| task.counts[key]).sum();
        if let Some(bounds) = some.map(|task| task.bounds[key]).reduce(LaneBounds::union) {
            cells.push(Reference::new(bounds.bounds(), key as u32));
        }
    }
    let tree = build_binary(&mut cells, 1..=1, None, None, &Progress::new(None));
    // Where the ids of each cell begin, in the order of the tree.
    let (mut first, mut places) = (0, vec![0u32; grid.cells()]);
    for cell in &cells {
        places[cell.id() as usize] = first;
        first += counts[cell.id() as usize];
    }
    let mut ids = huge_vec(n);
    ids.resize(n, 0);
    for (id, &key) in (0..).zip(tasks.iter().flat_map(|task| &task.keys)) {
        let place = &mut places[key as usize];
        ids[*place as usize] = id;
        *place += 1;
    }
    let counts: Vec<u32> = cells.iter().map(|cell| counts[cell.id() as usize]).collect();
    let parts = parts(&tree, &counts, most);
    let (binary, progress) = (BinaryTree::new(), progress.in_units(n));
    let mut builder = CoarseBuilder { bounds, tree: &tree, parts: &parts, most, binary, ids, progress: &progress };
    builder.node(0, 0);
    (builder.binary, builder.ids)
}

/// A grid over a box. Outside the box there is one more layer of cells on each side.
struct Grid {
    low: Vec4,
    /// Cells per length.
    scale: Vec4,
    /// Cells along an axis, with both layers.
    side: usize,
}

/// Some primitives, binned into the cells of the grid.
struct Binned {
    /// The cell of each.
    keys: Vec<u16>,
    /// For each cell the number of primitives, and their bounds.
    counts: Vec<u32>,
    bounds: Vec<LaneBounds>,
}

/// Adding this constant rounds a small float to the nearest integer, which is then in its low bits.
const ROUND: f32 = 8_388_608.0;

impl Grid {
    /// A grid around the centres of most primitives, as fine as leaves of at most `most` need.
    fn around(n: usize, bounds: &BoundsOf<'_>, most: usize) -> Grid {
        let (mut min, mut max) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let few: Vec<u32> = (0..n as u32).step_by(n / PLACED + 1).collect();
        let mut boxes = vec![LaneBounds::EMPTY; few.len()];
        bounds(&few, &mut boxes);
        for centre in boxes.iter().map(LaneBounds::centre) {
            (min, max) = (min.min(centre), max.max(centre));
        }
        // Most scenes are surfaces: of `side` cubed cells about `side` squared are not empty.
        let side = ((4 * n / most) as f32).sqrt().ceil().clamp(1.0, CELLS as f32);
        let extent = max - min;
        let scale = |extent: f32| {
            let scale = side / extent;
            if scale.is_finite() { scale } else { 0.0 }
        };
        let scale = Vec4::new(scale(extent.x), scale(extent.y), scale(extent.z), 0.0);
        Grid { low: min, scale, side: side as usize + 2 }
    }

    fn cells(&self) -> usize {
        self.side.pow(3)
    }

    /// The cell of a centre, in the units of [`LaneBounds::centre`].
    #[inline(always)]
    fn key(&self, centre: Vec4) -> usize {
        // Half a cell less than the layer outside: rounding to the nearest is rounding down.
        let at = (centre - self.low) * self.scale + Vec4::splat(0.5);
        let at = at.max(Vec4::ZERO).min(Vec4::splat((self.side - 1) as f32)) + Vec4::splat(ROUND);
        let [x, y, z, _] = at.to_array().map(|at| (at.to_bits() & 0xff) as usize);
        (z * self.side + y) * self.side + x
    }

    /// Bins some primitives into the cells.
    fn binned(&self, of: &BoundsOf<'_>, ids: Range<usize>, progress: &Progress) -> Binned {
        let mut bounds = huge_vec(self.cells());
        bounds.resize(self.cells(), LaneBounds::EMPTY);
        let mut binned = Binned { keys: Vec::with_capacity(ids.len()), counts: vec![0; self.cells()], bounds };
        let (mut block_ids, mut block) = ([0; BLOCK], [LaneBounds::EMPTY; BLOCK]);
        let simd = SimdLevel::best();
        for first in ids.clone().step_by(BLOCK) {
            if (first - ids.start).is_multiple_of(REPORTED) {
                if progress.cancelled() {
                    break;
                }
                progress.finished(REPORTED.min(ids.end - first) as f64);
            }
            let count = BLOCK.min(ids.end - first);
            let (block_ids, block) = (&mut block_ids[..count], &mut block[..count]);
            (first as u32..).zip(&mut *block_ids).for_each(|(id, to)| *to = id);
            of(block_ids, block);
            dispatch(simd, Bin { grid: self, block, binned: &mut binned });
        }
        binned
    }
}

/// Bins primitives with these bounds.
struct Bin<'a> {
    grid: &'a Grid,
    block: &'a [LaneBounds],
    binned: &'a mut Binned,
}

impl Kernel for Bin<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Bin { grid, block, binned: Binned { keys, counts, bounds } } = self;
        let before = keys.len();
        keys.extend(block.iter().map(|b| grid.key(b.centre()) as u16));
        for (b, &key) in block.iter().zip(&keys[before..]) {
            let key = key as usize;
            counts[key] += 1;
            let cell = &mut bounds[key].0;
            s.store(s.min(s.load(cell), s.load(&b.0)), cell);
        }
    }
}

/// A part of the tree over cells.
#[derive(Clone, Copy)]
struct Part {
    /// The number of primitives in its cells.
    count: u32,
    /// Whether it is better one leaf, or a single cell.
    whole: bool,
    /// The expected cost, in primitives times the size of the boxes that they are needed with.
    cost: f32,
}

/// For each node of the tree over cells, whether it becomes a leaf. `counts` has the number of primitives in each cell.
fn parts(tree: &[BinaryNode], counts: &[u32], most: usize) -> Vec<Part> {
    let mut parts = vec![Part { count: 0, whole: true, cost: 0.0 }; tree.len()];
    for (x, node) in tree.iter().enumerate().rev() {
        let below = (node.right > 0).then(|| [parts[x + 1], parts[x + node.right as usize]]);
        let count = below.map_or_else(|| counts[node.first as usize], |[l, r]| l.count + r.count);
        let cost = mean_half_area(&node.bounds).sqrt() * (count as f32 + SUBTREE_COST);
        let whole = Part { count, whole: true, cost };
        parts[x] = match below.map(|[l, r]| l.cost + r.cost) {
            Some(divided) if count as usize > most || divided < cost => Part { whole: false, cost: divided, ..whole },
            _ => whole,
        };
    }
    parts
}

/// Turns the tree over cells into the tree of primitives.
struct CoarseBuilder<'a> {
    bounds: &'a BoundsOf<'a>,
    tree: &'a [BinaryNode],
    parts: &'a [Part],
    most: usize,
    binary: BinaryTree,
    /// All ids, those of each cell together.
    ids: Vec<u32>,
    /// In primitives.
    progress: &'a Progress<'a>,
}

impl CoarseBuilder<'_> {
    /// Appends a node of the tree over cells, and its subtree, whose primitives begin at index `first`. Returns where they end.
    fn node(&mut self, x: usize, first: u32) -> u32 {
        let (node, Part { count, whole, .. }) = (self.tree[x], self.parts[x]);
        if whole && count as usize > self.most {
            self.crowded_cell(first, count);
            return first + count;
        }
        let at = self.binary.len();
        self.binary.push(BinaryNode { first, count, right: 0, ..node });
        if whole {
            self.progress.finished(count.into());
        } else {
            let middle = self.node(x + 1, first);
            self.binary[at].right = (self.binary.len() - at) as u32;
            self.node(x + node.right as usize, middle);
        }
        first + count
    }

    /// Appends a subtree over the primitives of one cell.
    fn crowded_cell(&mut self, first: u32, count: u32) {
        let all = self.ids.len();
        let progress = self.progress.subtask(count.into());
        let ids = &mut self.ids[first as usize..][..count as usize];
        if ids.len() > CROWDED * self.most && ids.len() <= all / 2 {
            let (bounds, given) = (self.bounds, ids.to_vec());
            let of = |places: &[u32], out: &mut [LaneBounds]| {
                let ids: Vec<u32> = places.iter().map(|&at| given[at as usize]).collect();
                bounds(&ids, out);
            };
            let (below, order) = coarse_tree(given.len(), &of, self.most, &progress);
            self.binary.extend(below.iter().map(|node| BinaryNode { first: first + node.first, ..*node }));
            ids.iter_mut().zip(order).for_each(|(id, at)| *id = given[at as usize]);
            return;
        }
        let mut references = vec![Reference::new(LinearBox3::EMPTY, 0); ids.len()];
        let mut block = [LaneBounds::EMPTY; BLOCK];
        for (ids, references) in ids.chunks(BLOCK).zip(references.chunks_mut(BLOCK)) {
            (self.bounds)(ids, &mut block[..ids.len()]);
            Reference::write(ids, &block, references);
        }
        let below = build_binary(&mut references, self.most..=self.most, None, None, &progress);
        self.binary.extend(below.iter().map(|node| BinaryNode { first: first + node.first, ..*node }));
        for (id, r) in ids.iter_mut().zip(&references) {
            *id = r.id();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::random::Random;
    use glam::Vec3;

    /// Checks a subtree; returns its number of nodes.
    fn check(references: &[Reference], tree: &BinaryTree, ids: &[u32], x: usize, most: usize) -> usize {
        let node = &tree[x];
        let below = &ids[node.first as usize..][..node.count as usize];
        let united = below.iter().map(|&id| references[id as usize].bounds()).reduce(LinearBox3::union);
        assert_eq!(united, Some(node.bounds));
        if node.right == 0 {
            assert!(below.len() <= most, "{} of {most}", below.len());
            return 1;
        }
        let right = x + node.right as usize;
        assert_eq!((tree[x + 1].first, tree[right].first), (node.first, node.first + tree[x + 1].count));
        assert_eq!(tree[x + 1].count + tree[right].count, node.count);
        let left = check(references, tree, ids, x + 1, most);
        assert_eq!(left + 1, node.right as usize);
        1 + left + check(references, tree, ids, right, most)
    }

    #[test]
    fn every_reference_is_in_one_leaf_and_all_boxes_hold_their_subtrees() {
        let mut random = Random(5);
        // Spread over a box, a third of them close together, all but a few in a corner of it, in a plane, at one point.
        let plane = Vec3::new(1.0, 0.0, 1.0);
        for (spread, third) in
            [(Vec3::ONE, 1.0), (Vec3::ONE, 1e-3), (Vec3::splat(1e-4), 1.0), (plane, 1.0), (Vec3::ZERO, 1.0)]
        {
            for (n, most) in [(1, 1), (40, 1), (3000, 7), (150_000, 100), (5000, 5000)] {
                let references: Vec<Reference> = (0..n)
                    .map(|id| {
                        let far = if id % 999 == 0 && spread != Vec3::ZERO { 1.0 } else { 0.0 };
                        let size = if id % 3 == 1 { third } else { 1.0 };
                        let p = Vec3::new(random.unit(), random.unit(), random.unit()) * spread * size + far;
                        let of = |p: Vec3| Box3 { min: p, max: p + 0.01 * spread };
                        let end = if id % 3 == 0 { p + 0.1 * spread } else { p };
                        Reference::new(LinearBox3 { begin: of(p), end: of(end) }, id)
                    })
                    .collect();

                let bounds = |id: u32| references[id as usize].bounds();
                let bounds = |ids: &[u32], out: &mut [LaneBounds]| {
                    ids.iter().zip(out).for_each(|(&id, to)| *to = LaneBounds::of(&bounds(id)));
                };
                let (tree, mut ids) = coarse_tree(n as usize, &bounds, most, &Progress::new(None));
                assert_eq!(check(&references, &tree, &ids, 0, most), tree.len());
                let leaves = tree.iter().filter(|node| node.right == 0).count();
                assert!(leaves <= 8 * (n as usize).div_ceil(most), "{leaves} leaves for {n}, {most} in each");
                ids.sort_unstable();
                assert!(ids.into_iter().eq(0..n));
            }
        }
    }

    #[test]
    fn primitives_far_apart_are_in_different_leaves() {
        let leaves = |distance: f32| {
            let mut random = Random(6);
            let references: Vec<LinearBox3> = (0..600)
                .map(|id| {
                    let offset = Vec3::X * distance * (id % 2) as f32;
                    let p = Vec3::new(random.unit(), random.unit(), random.unit()) + offset;
                    let b = Box3 { min: p, max: p + 0.01 };
                    LinearBox3 { begin: b, end: b }
                })
                .collect();
            let bounds = |ids: &[u32], out: &mut [LaneBounds]| {
                ids.iter().zip(out).for_each(|(&id, to)| *to = LaneBounds::of(&references[id as usize]));
            };
            coarse_tree(600, &bounds, 2048, &Progress::new(None)).0.iter().filter(|node| node.right == 0).count()
        };
        assert_eq!([0.0, 1.0].map(leaves), [1, 1]);
        assert!(leaves(20.0) > 1);
    }
}
