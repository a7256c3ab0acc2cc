//! Memory in lines of 64 bytes: one AVX-512 register, one cache line.

use super::huge_pages::huge_vec;
use super::lanes::LANES;
use super::prefetch::prefetch;
use crate::parallel;

/// One line; the alignment keeps a node's rows from straddling cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LANES]);

/// A growing block of words (f32 or u32 by turns) that begins on a cache line.
///
/// Positions are in words; who stores them in fewer bits checks that they fit.
#[derive(Clone, Default)]
pub(crate) struct Arena {
    lines: Vec<Line>,
    words: usize,
}

impl Extend<[u32; LANES]> for Arena {
    /// Appends whole lines, given as the bits of their words.
    fn extend<I: IntoIterator<Item = [u32; LANES]>>(&mut self, lines: I) {
        self.lines.extend(lines.into_iter().map(|line| Line(line.map(f32::from_bits))));
        self.align();
    }
}

impl Arena {
    /// Bytes allocated.
    pub(crate) fn bytes(&self) -> usize {
        self.lines.capacity() * size_of::<Line>()
    }

    /// Adds `words` zero words behind the last ones and returns where they begin.
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

    /// Words for which there is room.
    pub(crate) fn room(&self) -> usize {
        (self.lines.capacity() - self.lines.len()) * LANES
    }

    /// Makes room for so many more words: just that at first, at least doubling later.
    pub(crate) fn reserve(&mut self, words: usize) {
        if self.room() < words {
            self.reserve_exact(words.max(self.lines.len() * LANES));
        }
    }

    /// Makes room for so many more words and no others.
    pub(crate) fn reserve_exact(&mut self, words: usize) {
        let mut larger = huge_vec(self.lines.len() + words.div_ceil(LANES));
        larger.extend_from_slice(&self.lines);
        self.lines = larger;
    }

    /// Adds the lines of another arena and returns the word where they begin.
    pub(crate) fn append(&mut self, other: &Arena) -> usize {
        self.align();
        let at = self.words;
        self.reserve(other.lines.len() * LANES);
        self.lines.extend_from_slice(&other.lines);
        self.align();
        at
    }

    /// Forgets all words and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.lines.clear();
        self.words = 0;
    }

    /// Words in use.
    pub(crate) fn len(&self) -> usize {
        self.words
    }

    /// Fills up the last line, so that what comes next begins on a cache line.
    pub(crate) fn align(&mut self) {
        self.words = self.lines.len() * LANES;
    }

    /// Keeps the words in memory of just their size, on huge pages where the system grants them.
    ///
    /// Queries jump through the arena at random; with pages of 4 KiB most jumps of a big tree also miss the
    /// address cache, which costs more than the data does.
    pub(crate) fn settle(&mut self) {
        let lines = self.lines.len() + LANES;
        // Memory that fits already to a few percent is kept.
        let capacity = self.lines.capacity();
        if capacity < lines || capacity > lines + lines / 32 {
            let mut fitting = huge_vec(lines);
            parallel::fill(&mut fitting, self.lines.len(), |i| self.lines[i]);
            self.lines = fitting;
        }
        self.lines.resize(lines, Line([0.0; LANES]));
    }

    /// All words as floats, the last line to its end.
    #[inline(always)]
    pub(crate) fn floats(&self) -> &[f32] {
        let lines = self.lines.as_slice();
        // SAFETY: `Line` is `repr(C)` around sixteen f32 without padding (64 bytes, 64-aligned), so the
        // lines are `len * 16` consecutive initialized f32.
        unsafe { core::slice::from_raw_parts(lines.as_ptr().cast(), lines.len() * LANES) }
    }

    /// The words of sixteen lines from word `at`, which begins a line. Blocks are shorter than that; the arena keeps
    /// as many lines behind its last block once it is settled.
    #[inline(always)]
    pub(crate) fn block(&self, at: usize) -> &[f32; LANES * LANES] {
        let line = at / LANES;
        let lines: &[Line; LANES] = self.lines[line..line + LANES].try_into().expect("a slice of sixteen");
        // SAFETY: `Line` is `repr(C)` around `[f32; 16]` without padding.
        unsafe { &*core::ptr::from_ref(lines).cast() }
    }

    /// Asks for the lines of a block that will be read soon; a hint.
    #[inline(always)]
    pub(crate) fn prefetch(&self, at: usize, lines: usize) {
        for line in self.lines.iter().skip(at / LANES).take(lines) {
            prefetch(line);
        }
    }

    /// Asks for the lines of a block without looking at how many there are: a dozen, as many as most have. A hint.
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

    /// All words as integers, to be written.
    #[inline(always)]
    pub(crate) fn ints_mut(&mut self) -> &mut [u32] {
        let lines = self.lines.as_mut_slice();
        // SAFETY: as in `ints`; every u32 is a valid f32 and the borrow of `self` is exclusive.
        unsafe { core::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), lines.len() * LANES) }
    }
}
