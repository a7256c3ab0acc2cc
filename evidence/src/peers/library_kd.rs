//! The k-d trees of the library, for the wide layout: read from the file format (docs/files.md), since the library
//! exposes its nodes nowhere else.

use super::boxes::Box3;
use super::cell::{Cell, Cells};
use super::subtree::{ActiveInterval, Subtree};
use mbkd::baseline::TriangleTests;
use mbkd::glam::Vec3;
use mbkd::{FileError, RayTree};

/// The version of the format that this reads.
const VERSION: u32 = 10;
/// The number of the k-d layout.
const KD: u32 = 1;
/// Added to the number of keys of a mesh that is stored in f64.
const IN_F64: u32 = 1 << 31;
/// Replaces the axis in a leaf.
const LEAF: u32 = 3;

/// Three words: a node or a reference.
type Words = [u32; 3];

/// A k-d tree of the library.
pub struct LibraryKd {
    root: Box3,
    nodes: Vec<Words>,
    references: Vec<Words>,
}

impl LibraryKd {
    /// The nodes of a tree.
    ///
    /// Errors of writing, and [`FileError::Broken`] if the tree is not a k-d tree, or the file format is not the one
    /// expected here.
    pub fn of(tree: &RayTree) -> Result<LibraryKd, FileError> {
        let mut bytes = Vec::new();
        tree.write_to(&mut bytes)?;
        read(&mut File { bytes: &bytes, at: 0 }).ok_or(FileError::Broken { what: "it is no k-d tree as expected" })
    }

    /// The tree with boxes.
    pub fn subtree(&self, tests: &TriangleTests) -> Subtree {
        Cells::whole(self.cells(tests, 0, Cell::root(self.root)))
    }

    /// The recursion is as deep as the tree, which the library bounds.
    fn cells(&self, tests: &TriangleTests, node: usize, cell: Cell) -> Option<Cells> {
        let [a, b, link] = *self.nodes.get(node)?;
        if link & 3 == LEAF {
            let of = |&[index, begin, end]: &Words| {
                (index, ActiveInterval { begin: f32::from_bits(begin), end: f32::from_bits(end) })
            };
            let references: Vec<(u32, ActiveInterval)> =
                self.references[a as usize..][..b as usize].iter().map(of).collect();
            return Cells::leaf(tests, cell, &references, self.root.magnitude());
        }
        let (position, velocity) = (f32::from_bits(a), f32::from_bits(b));
        let [below, above] = cell.sides((link & 3) as usize, position, position + velocity);
        Cells::join([self.cells(tests, node + 1, below), self.cells(tests, (link >> 2) as usize, above)])
    }
}

/// The k-d tree in a file of a ray tree.
fn read(file: &mut File) -> Option<LibraryKd> {
    file.take(8)?;
    if file.word()? != VERSION {
        return None;
    }
    // The kind, length and checksum; tree space; the counts of vertices.
    file.take(4 + 8 + 8)?;
    file.take(9 * 8 + 8 + 4)?;
    file.take(2 * 8)?;
    let meshes = file.array(24)?;
    let in_f64 = meshes.chunks_exact(24).any(|mesh| word(&mesh[4..]) >= IN_F64);
    // Positions and corners, likewise of meshes in f64.
    let skipped: &[usize] = if in_f64 { &[12, 12, 24, 12] } else { &[12, 12] };
    for &size in skipped {
        file.array(size)?;
    }
    // The box of shapes; their numbers of keys, times and masks; the keys of spheres.
    file.take(6 * 8)?;
    for size in [4, 8, 4, 32] {
        file.array(size)?;
    }
    if file.word()? != KD {
        return None;
    }
    let mut vector = || Some(Vec3::from([file.word()?, file.word()?, file.word()?].map(f32::from_bits)));
    let root = Box3 { min: vector()?, max: vector()? };
    let _depth = file.word()?;
    let mut words = || Some(file.array(12)?.chunks_exact(12).map(|of| [0, 4, 8].map(|at| word(&of[at..]))).collect());
    Some(LibraryKd { root, nodes: words()?, references: words()? })
}

/// Four bytes as a number.
fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// The bytes of a file, and the read position.
struct File<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> File<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(taken)
    }

    fn word(&mut self) -> Option<u32> {
        Some(word(self.take(4)?))
    }

    /// The bytes of an array of items of some size.
    fn array(&mut self, size: usize) -> Option<&'a [u8]> {
        let (low, high) = (self.word()?, self.word()?);
        self.at = self.at.next_multiple_of(64);
        let count = usize::try_from(u64::from(high) << 32 | u64::from(low)).ok()?;
        self.take(count.checked_mul(size)?)
    }
}
