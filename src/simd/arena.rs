//! Memory in lines of 64 bytes: one AVX-512 register, one cache line.

use super::fill::fill;
use super::huge_pages::huge_vec;
use super::lanes::LANES;
use super::prefetch::prefetch;

/// One line; its alignment keeps a node's rows from straddling cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LANES]);

/// A growing array of words (f32 or u32, by access) that begins on a cache line.
///
/// Positions are in words; a caller that stores them in fewer bits checks that they fit.
#[derive(Default)]
pub(crate) struct Arena {
    lines: Vec<Line>,
    words: usize,
}

impl Clone for Arena {
    /// A copy is on huge pages as well, if the system grants them.
    fn clone(&self) -> Arena {
        let mut lines = huge_vec(self.lines.len());
        lines.extend_from_slice(&self.lines);
        Arena { lines, words: self.words }
    }
}

impl Extend<[u32; LANES]> for Arena {
    /// Appends whole lines, given as the bits of their words.
    fn extend<I: IntoIterator<Item = [u32; LANES]>>(&mut self, lines: I) {
        self.lines.extend(lines.into_iter().map(|line| {
            // A loop, which becomes a copy; `map` of an array does not.
            let mut words = [0.0; LANES];
            for (word, bits) in words.iter_mut().zip(line) {
                *word = f32::from_bits(bits);
            }
            Line(words)
        }));
        self.align();
    }
}

impl Arena {
    /// Bytes allocated.
    pub(crate) fn bytes(&self) -> usize {
        self.lines.capacity() * size_of::<Line>()
    }

    /// Appends `words` zero words and returns the position of the first.
    pub(crate) fn grow(&mut self, words: usize) -> usize {
        let at = self.words;
        self.words += words;
        let lines = self.words.div_ceil(LANES);
        if lines > self.lines.capacity() {
            let mut larger = huge_vec(2 * lines);
            larger.extend_from_slice(&self.lines);
            self.lines = larger;
        }
        self.lines.resize(lines, Line([0.0; LANES]));
        at
    }

    /// The free capacity in words.
    pub(crate) fn room(&self) -> usize {
        (self.lines.capacity() - self.lines.len()) * LANES
    }

    /// Makes room for so many more words: exactly that at first, at least doubling later.
    pub(crate) fn reserve(&mut self, words: usize) {
        if self.room() < words {
            self.reserve_exact(words.max(self.lines.len() * LANES));
        }
    }

    /// Makes room for exactly so many more words.
    pub(crate) fn reserve_exact(&mut self, words: usize) {
        let mut larger = huge_vec(self.lines.len() + words.div_ceil(LANES));
        larger.extend_from_slice(&self.lines);
        self.lines = larger;
    }

    /// Appends the lines of another arena and returns the position of the first word.
    pub(crate) fn append(&mut self, other: &Arena) -> usize {
        self.align();
        let at = self.words;
        self.reserve(other.lines.len() * LANES);
        self.lines.extend_from_slice(&other.lines);
        self.align();
        at
    }

    /// Removes all words and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.lines.clear();
        self.words = 0;
    }

    /// Words in use.
    pub(crate) fn len(&self) -> usize {
        self.words
    }

    /// Pads the last line, so that the next block begins on a cache line.
    pub(crate) fn align(&mut self) {
        self.words = self.lines.len() * LANES;
    }

    /// Moves the words into memory of exactly their size, on huge pages if the system grants them.
    ///
    /// Queries access the arena at random; with pages of 4 KiB most accesses to a large tree also miss the TLB, which
    /// costs more than the cache miss.
    pub(crate) fn compact(&mut self) {
        let lines = self.lines.len() + LANES;
        // Memory that fits to a few percent already is kept.
        let capacity = self.lines.capacity();
        if capacity < lines || capacity > lines + lines / 32 {
            let mut fitting = huge_vec(lines);
            fill(&mut fitting, self.lines.len(), |i| self.lines[i]);
            self.lines = fitting;
        }
        self.lines.resize(lines, Line([0.0; LANES]));
    }

    /// All words as floats, including the padding of the last line.
    #[inline(always)]
    pub(crate) fn floats(&self) -> &[f32] {
        let lines = self.lines.as_slice();
        // SAFETY: `Line` is `repr(C)` around sixteen f32 without padding (64 bytes, 64-aligned), so the
        // lines are `len * 16` consecutive initialized f32.
        unsafe { core::slice::from_raw_parts(lines.as_ptr().cast(), lines.len() * LANES) }
    }

    /// The words of sixteen lines from word `at`, which begins a line. Blocks are shorter than that; a compacted arena
    /// has that many lines after its last block.
    #[inline(always)]
    pub(crate) fn block(&self, at: usize) -> &[f32; LANES * LANES] {
        let line = at / LANES;
        let lines: &[Line; LANES] = self.lines[line..line + LANES].try_into().expect("a slice of sixteen");
        // SAFETY: `Line` is `repr(C)` around `[f32; 16]` without padding.
        unsafe { &*core::ptr::from_ref(lines).cast() }
    }

    /// Prefetches the lines of a block that will be read soon; a hint.
    #[inline(always)]
    pub(crate) fn prefetch(&self, at: usize, lines: usize) {
        for line in self.lines.iter().skip(at / LANES).take(lines) {
            prefetch(line);
        }
    }

    /// Prefetches a dozen lines of a block, the length of most, without computing its length; a hint.
    #[inline(always)]
    pub(crate) fn prefetch_block(&self, at: usize) {
        let block: &[Line; 12] = self.lines[at / LANES..at / LANES + 12].try_into().expect("a slice of a dozen");
        prefetch(block);
    }

    /// All words as integers: the bits of the floats.
    #[inline(always)]
    pub(crate) fn ints(&self) -> &[u32] {
        let lines = self.lines.as_slice();
        // SAFETY: as in `floats`; f32 and u32 have the same size and alignment and every bit pattern is
        // a valid u32.
        unsafe { core::slice::from_raw_parts(lines.as_ptr().cast(), lines.len() * LANES) }
    }

    /// All words as mutable integers.
    #[inline(always)]
    pub(crate) fn ints_mut(&mut self) -> &mut [u32] {
        let lines = self.lines.as_mut_slice();
        // SAFETY: as in `ints`; every u32 is a valid f32 and the borrow of `self` is exclusive.
        unsafe { core::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), lines.len() * LANES) }
    }
}
