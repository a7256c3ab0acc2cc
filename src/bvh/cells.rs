//! The top levels of a binary tree, by a grid.
//!
//! Object splits visit every reference once per level. If only the first levels are wanted, one pass is enough: all
//! references are binned into the cells of a grid by their centres, and object splits then partition the cells. A
//! single cell with too many references is split as usual, so scenes that are concentrated in a small region cost no
//! more than a full build.

use super::binning::summary;
use super::builder::{BinaryNode, BinaryTree, build_binary};
use super::reference::{Packed, Reference};
use crate::geometry::Box3;
use crate::parallel;
use crate::simd::{SimdLevel, huge_vec};
use glam::Vec4;

/// The greatest number of cells along an axis.
const MOST: usize = 16;

/// References that are binned per task.
const BIN_CHUNK: usize = 1 << 16;

/// A binary tree whose leaves have at most `most` references, and the ids of these in the order of the tree. The id of
/// each reference must be its index.
pub(crate) fn coarse_tree(references: &[Reference], most: usize) -> (BinaryTree, Vec<u32>) {
    if references.is_empty() {
        return (BinaryTree::new(), Vec::new());
    }
    let grid = Grid::around(references, most);
    let tasks = parallel::map(references.len().div_ceil(BIN_CHUNK), |i| {
        grid.bin(&references[i * BIN_CHUNK..references.len().min((i + 1) * BIN_CHUNK)])
    });
    let (mut sum, mut begins) = (0, vec![0; grid.cells()]);
    let mut cells = Vec::new();
    let mut cell_references = Vec::new();
    for (key, begin) in begins.iter_mut().enumerate() {
        *begin = sum;
        sum += tasks.iter().map(|binned| binned.counts[key] as usize).sum::<usize>();
        if sum > *begin {
            let bounds = tasks.iter().fold(Packed::EMPTY, |all, binned| all.least(binned.bounds[key]));
            cell_references.push(Reference::of(bounds, cells.len() as u32));
            cells.push(*begin..sum);
        }
    }
    let mut sorted = huge_vec(references.len());
    sorted.resize(references.len(), 0);
    for (id, &key) in tasks.iter().flat_map(|task| &task.keys).enumerate() {
        sorted[begins[key as usize]] = id as u32;
        begins[key as usize] += 1;
    }
    let tree = build_binary(&mut cell_references, 1..=1, None, None);
    let cells: Vec<&[u32]> = cell_references.iter().map(|r| &sorted[cells[r.id() as usize].clone()]).collect();
    let ids = huge_vec(references.len());
    let mut builder = CoarseBuilder { references, tree: &tree, cells: &cells, most, binary: BinaryTree::new(), ids };
    builder.node(0);
    (builder.binary, builder.ids)
}

/// A grid over a box.
struct Grid {
    low: Vec4,
    /// Cells per length.
    scale: Vec4,
    side: usize,
}

/// One chunk of references, binned into the cells of the grid.
struct Binned {
    /// The cell of each reference.
    keys: Vec<u16>,
    /// For each cell the number of references, and their bounds.
    counts: Vec<u32>,
    bounds: Vec<Packed>,
}

impl Grid {
    /// A grid around the centres of references, as fine as leaves of at most `most` need.
    fn around(references: &[Reference], most: usize) -> Grid {
        let (_, Box3 { min, max }) = summary(SimdLevel::best(), references);
        // Most scenes are surfaces: of `side` cubed cells about `side` squared are not empty.
        let side = ((4 * references.len() / most) as f32).sqrt().ceil().clamp(1.0, MOST as f32);
        let scale = (max - min).map(|extent| if extent > 0.0 { side / extent } else { 0.0 });
        Grid { low: min.extend(0.0), scale: scale.extend(0.0), side: side as usize }
    }

    fn cells(&self) -> usize {
        self.side.pow(3)
    }

    /// The cell of a reference.
    fn key(&self, r: &Reference) -> usize {
        let cell = ((r.centre() - self.low) * self.scale).as_uvec4().min(glam::UVec4::splat(self.side as u32 - 1));
        (cell.z as usize * self.side + cell.y as usize) * self.side + cell.x as usize
    }

    /// Bins references into the cells.
    fn bin(&self, references: &[Reference]) -> Binned {
        let mut keys = Vec::with_capacity(references.len());
        let (mut counts, mut bounds) = (vec![0; self.cells()], vec![Packed::EMPTY; self.cells()]);
        for r in references {
            let key = self.key(r);
            keys.push(key as u16);
            counts[key] += 1;
            bounds[key] = bounds[key].least(*r.packed());
        }
        Binned { keys, counts, bounds }
    }
}

/// Turns the tree over cells into the tree of references: subtrees with few enough references become leaves.
struct CoarseBuilder<'a> {
    references: &'a [Reference],
    tree: &'a [BinaryNode],
    /// The ids in each cell, in the order of the tree.
    cells: &'a [&'a [u32]],
    most: usize,
    binary: BinaryTree,
    ids: Vec<u32>,
}

impl CoarseBuilder<'_> {
    /// Appends a node of the tree over cells, and its subtree.
    fn node(&mut self, x: usize) {
        let node = self.tree[x];
        let cells = &self.cells[node.first as usize..][..node.count as usize];
        let (at, first) = (self.binary.len(), self.ids.len() as u32);
        let count: usize = cells.iter().map(|ids| ids.len()).sum();
        if count > self.most && node.right == 0 {
            let mut references: Vec<Reference> =
                cells.iter().copied().flatten().map(|&id| self.references[id as usize]).collect();
            let below = build_binary(&mut references, self.most..=self.most, None, None);
            self.binary.extend(below.iter().map(|node| BinaryNode { first: first + node.first, ..*node }));
            self.ids.extend(references.iter().map(Reference::id));
            return;
        }
        self.binary.push(BinaryNode { first, count: count as u32, right: 0, ..node });
        if count <= self.most {
            self.ids.extend(cells.iter().copied().flatten());
            return;
        }
        self.node(x + 1);
        self.binary[at].right = (self.binary.len() - at) as u32;
        self.node(x + node.right as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::LinearBox3;
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
        // Spread over a box, all but a few in a corner of it, in a plane, at one point.
        for spread in [Vec3::ONE, Vec3::splat(1e-4), Vec3::new(1.0, 0.0, 1.0), Vec3::ZERO] {
            for (n, most) in [(1, 1), (40, 1), (3000, 7), (150_000, 100), (5000, 5000)] {
                let references: Vec<Reference> = (0..n)
                    .map(|id| {
                        let far = if id % 999 == 0 && spread != Vec3::ZERO { 1.0 } else { 0.0 };
                        let p = Vec3::new(random.unit(), random.unit(), random.unit()) * spread + far;
                        let of = |p: Vec3| Box3 { min: p, max: p + 0.01 * spread };
                        let end = if id % 3 == 0 { p + 0.1 * spread } else { p };
                        Reference::new(LinearBox3 { begin: of(p), end: of(end) }, id)
                    })
                    .collect();
                let (tree, mut ids) = coarse_tree(&references, most);
                assert_eq!(check(&references, &tree, &ids, 0, most), tree.len());
                let leaves = tree.iter().filter(|node| node.right == 0).count();
                assert!(leaves <= 8 * (n as usize).div_ceil(most), "{leaves} leaves for {n}, {most} in each");
                ids.sort_unstable();
                assert!(ids.into_iter().eq(0..n));
            }
        }
    }
}
