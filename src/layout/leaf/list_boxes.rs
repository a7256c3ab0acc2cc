//! Leaf blocks of shapes other than spheres: lists of ids, and behind them the boxes of the shapes, sixteen of which a query tests
//! at once. Each shape takes a call of its own function, so most of those in a leaf are ruled out by their boxes first.
//!
//! | words | |
//! |---|---|
//! | n | ids |
//! | 1 | [`STILL`] or [`MOVING`] |
//! | 2 | begin and end of the interval of the boxes |
//! | | up to the next whole line, if there are sixteen boxes: unused |
//! | 6 or 12 rows of n | the boxes in the rows of a node without references to children; 6 rows if they do not move |
//!
//! The boxes are padded like those of nodes.

use crate::geometry::{LinearBox3, TimeInterval};
use crate::layout::node_boxes::BoxRows;
use crate::layout::wide_node::{Kind, NODE_ROWS, STATIC_NODE_ROWS};
use crate::primitive::PrimitiveSet;
use crate::simd::{LANES, Mask, Rows, SimdLevel};

/// The word behind the ids, where [`SphereLeaf`](super::spheres::SphereLeaf) has a number of keys.
pub(in crate::layout) const STILL: u32 = u32::MAX;
pub(in crate::layout) const MOVING: u32 = u32::MAX - 1;

/// Words between the ids and the end of the interval.
const HEADER: usize = 3;

/// The boxes behind a list of ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ListBoxes {
    /// The offset of the rows. Rows of sixteen are whole lines.
    at: usize,
    pub moving: bool,
}

impl ListBoxes {
    /// The boxes of a block of `n` ids that begins at `words[0]`, if it has any.
    #[inline(always)]
    pub fn of(words: &[u32], n: usize) -> Option<ListBoxes> {
        let kind = words[n];
        (kind >= MOVING).then(|| ListBoxes::new(n, kind == MOVING))
    }

    #[inline(always)]
    fn new(n: usize, moving: bool) -> ListBoxes {
        let lines = if n == LANES { LANES } else { 1 };
        ListBoxes { at: (n + HEADER).next_multiple_of(lines), moving }
    }

    /// The number of rows.
    #[inline(always)]
    fn count(&self) -> usize {
        if self.moving { NODE_ROWS - 1 } else { STATIC_NODE_ROWS - 1 }
    }

    /// The rows of a block of `n` ids that begins at `words[0]`, one less than a node with such boxes has. (A constant number, so
    /// that the compiler knows which rows exist.)
    #[inline(always)]
    pub fn rows<'a, const ROWS: usize>(&self, words: &'a [f32], n: usize) -> Rows<'a> {
        Rows::new(&words[self.at..], n, ROWS - 1)
    }

    /// The number of words of a block of `n` ids with these boxes.
    pub fn words(&self, n: usize) -> usize {
        self.at + self.count() * n
    }

    /// The number of words of a block of `n` ids, at most; `None` if it is a list without boxes, as a single shape has its box
    /// above.
    pub fn most_words(n: usize) -> Option<usize> {
        (n > 1).then(|| ListBoxes::new(n, true).words(n))
    }
}

/// The boxes of some shapes over an interval.
pub(in crate::layout) struct Boxed {
    rows: BoxRows,
    over: TimeInterval,
    pub of: ListBoxes,
}

impl Boxed {
    pub fn new<S: PrimitiveSet + ?Sized>(set: &S, ids: &[u32], over: TimeInterval) -> Boxed {
        let (mut rows, mut moving) = (BoxRows::NONE, false);
        for (lane, &id) in ids.iter().enumerate() {
            let bounds = set.bounds(id, over);
            moving |= bounds.begin != bounds.end;
            rows.set(lane, &bounds);
        }
        Boxed { rows, over, of: ListBoxes::new(ids.len(), moving) }
    }

    /// Writes the header and the boxes behind the ids of a block that begins at `words[0]`.
    pub fn write(&self, words: &mut [u32], n: usize) {
        let [begin, end] = self.over.to_bounds().map(f32::to_bits);
        let (mark, kind) = if self.of.moving { (MOVING, Kind::Node) } else { (STILL, Kind::StaticNode) };
        words[n..n + HEADER].copy_from_slice(&[mark, begin, end]);
        let level = SimdLevel::best();
        let mut rows = [0; (NODE_ROWS - 1) * LANES];
        self.rows.write(&mut rows, kind, Mask::MAX, self.over, level);
        let to = words[self.of.at..self.of.words(n)].chunks_exact_mut(n);
        to.zip(rows.as_chunks::<LANES>().0).for_each(|(to, row)| to.copy_from_slice(&row[..n]));
    }

    /// Rewrites the boxes of a block that has some: of shapes that move where there is no room for velocities, those that they
    /// sweep.
    pub fn rewrite<S: PrimitiveSet + ?Sized>(set: &S, words: &mut [u32], ids: &[u32]) {
        let n = ids.len();
        let Some(of) = ListBoxes::of(words, n) else { return };
        let interval = TimeInterval::half_open(f32::from_bits(words[n + 1]), f32::from_bits(words[n + 2]));
        let mut boxed = Boxed::new(set, ids, interval.unwrap_or(TimeInterval::FULL));
        if boxed.of.moving && !of.moving {
            for (lane, &id) in ids.iter().enumerate() {
                let swept = set.bounds(id, boxed.over).swept();
                boxed.rows.set(lane, &LinearBox3 { begin: swept, end: swept });
            }
        }
        boxed.of = of;
        boxed.write(words, n);
    }
}
