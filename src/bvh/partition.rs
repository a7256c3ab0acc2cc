//! Partitioning the references of a node, in sixteen lanes.
//!
//! Small nodes stay in the caches and are partitioned in one sweep. In large ones the number of low references is
//! known, so the front part that they will fill is known too: the first high reference there is exchanged with the
//! first low one behind it, the second with the second, and so on. That touches half as much memory, and if the chunks
//! of a node were counted, threads know which pairs are theirs.

use super::binning::{HALF, PARALLEL, Split};
use super::reference::{Packed, Reference};
use crate::geometry::Box3;
use crate::parallel;
use crate::simd::{Kernel, Lanes, Simd, SimdLevel, dispatch};
use glam::Vec3;

/// Moves the low side of a split to the front; the order depends on the input only. Returns the boxes of the centres of both sides.
pub(super) fn partition(references: &mut [Reference], split: &Split) -> [Box3; 2] {
    let centres = match references.len() < PARALLEL {
        true => dispatch(SimdLevel::best(), Partition { references, split }),
        false => exchanged(references, split),
    };
    let at = |i: usize| Vec3::new(centres.0[i], centres.0[i + 1], centres.0[i + 2]);
    let boxed = |i: usize| Box3 { min: at(i), max: -at(i + 4) };
    [boxed(0), boxed(8)]
}

/// Partitions a node that stays in the caches.
struct Partition<'a> {
    references: &'a mut [Reference],
    split: &'a Split,
}

impl Kernel for Partition<'_> {
    /// The least coordinates of the centres and of the negated centres, in the low half of the lanes for the low side
    /// and in the high half for the high side.
    type Output = Packed;

    /// Every reference is exchanged with the first high one, whether it is low or not: this avoids unpredictable
    /// branches.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Packed {
        let Partition { references, split } = self;
        let sides = split.sides();
        let centre = s.load_u(&CENTRES);
        let signs = s.load(&SIGNS);
        let mut centres = s.splat(f32::INFINITY);
        let mut middle = 0;
        for i in 0..references.len() {
            let lanes = s.load(&references[i].0.0);
            let low = sides.is_low(&references[i]);
            let side = HALF ^ u16::from(low).wrapping_sub(1);
            centres = s.select(side, s.min(centres, s.permute(lanes, centre) * signs), centres);
            // As registers: the compiler would move references in halves, through the stack.
            let other = s.load(&references[middle].0.0);
            s.store(other, &mut references[i].0.0);
            s.store(lanes, &mut references[middle].0.0);
            middle += usize::from(low);
        }
        let mut packed = Packed::EMPTY;
        s.store(centres, &mut packed.0);
        packed
    }
}

/// Twice the centre and the negated centre, four lanes each.
const CENTRES: Lanes<u32> = [6, 7, 14, 14, 6, 7, 14, 14, 6, 7, 14, 14, 6, 7, 14, 14];
const SIGNS: Lanes<f32> = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0];

/// References that are classified before those on the wrong side are exchanged.
const BLOCK: usize = 64;

/// Exchanges the high references in `front` with the low ones in `back`, in order; there are equally many.
struct Exchange<'a> {
    front: &'a mut [Reference],
    back: &'a mut [Reference],
    split: &'a Split,
}

/// The indices of references on the wrong side of a split.
struct Misplaced {
    places: [usize; BLOCK],
    /// Those from `first` to `end` have not been exchanged yet.
    first: usize,
    end: usize,
    /// The number of references classified so far.
    seen: usize,
}

impl Misplaced {
    const NONE: Misplaced = Misplaced { places: [0; BLOCK], first: 0, end: 0, seen: 0 };

    /// Classifies the next references if none is pending; returns `centres` extended by theirs. `low` tells which side
    /// is the wrong one.
    #[inline(always)]
    fn classify<S: Simd>(
        &mut self,
        s: S,
        references: &[Reference],
        split: &Split,
        low: bool,
        mut centres: S::F,
    ) -> S::F {
        if self.first < self.end || self.seen == references.len() {
            return centres;
        }
        let sides = split.sides();
        let (centre, signs) = (s.load_u(&CENTRES), s.load(&SIGNS));
        (self.first, self.end) = (0, 0);
        let until = references.len().min(self.seen + BLOCK);
        for (i, r) in references.iter().enumerate().take(until).skip(self.seen) {
            let is_low = sides.is_low(r);
            let side = HALF ^ u16::from(is_low).wrapping_sub(1);
            centres = s.select(side, s.min(centres, s.permute(s.load(&r.0.0), centre) * signs), centres);
            self.places[self.end % BLOCK] = i;
            self.end += usize::from(is_low == low);
        }
        self.seen = until;
        centres
    }
}

impl Kernel for Exchange<'_> {
    type Output = Packed;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Packed {
        let Exchange { front, back, split } = self;
        let mut centres = s.splat(f32::INFINITY);
        let (mut high, mut low) = (Misplaced::NONE, Misplaced::NONE);
        loop {
            let seen = high.seen + low.seen;
            centres = high.classify(s, front, split, false, centres);
            centres = low.classify(s, back, split, true, centres);
            let pairs = (high.end - high.first).min(low.end - low.first);
            for i in 0..pairs {
                let (a, b) = (&mut front[high.places[high.first + i]].0.0, &mut back[low.places[low.first + i]].0.0);
                let (from_a, from_b) = (s.load(a), s.load(b));
                s.store(from_b, a);
                s.store(from_a, b);
            }
            high.first += pairs;
            low.first += pairs;
            if pairs == 0 && high.seen + low.seen == seen {
                break;
            }
        }
        let mut packed = Packed::EMPTY;
        s.store(centres, &mut packed.0);
        packed
    }
}

/// Partitions a large node, by several threads if it was counted in chunks.
fn exchanged(references: &mut [Reference], split: &Split) -> Packed {
    let borders = borders(references, split, parallel::threads());
    let (mut front, mut back) = references.split_at_mut(split.middle);
    let (mut done_front, mut done_back) = (0, split.middle);
    let mut tasks = Vec::with_capacity(borders.len() + 1);
    for (at_front, at_back) in borders {
        let own;
        (own, front) = front.split_at_mut(at_front - done_front);
        let own_back;
        (own_back, back) = back.split_at_mut(at_back - done_back);
        tasks.push((own, own_back));
        (done_front, done_back) = (at_front, at_back);
    }
    tasks.push((front, back));
    let simd = SimdLevel::best();
    let parts = parallel::each(&mut tasks, |(front, back)| dispatch(simd, Exchange { front, back, split }));
    parts.into_iter().fold(Packed::EMPTY, Packed::least)
}

/// The boundaries of the threads' shares: indices in front of and behind the middle with equally many references on the
/// wrong side before them.
fn borders(references: &[Reference], split: &Split, threads: usize) -> Vec<(usize, usize)> {
    let (n, middle, chunk) = (references.len(), split.middle, split.chunk);
    let sides = split.sides();
    let is_low = |r: &Reference| sides.is_low(r);
    // Low references before each chunk, and at the end.
    let mut low = vec![0];
    split.lows.iter().for_each(|lows| low.push(low[low.len() - 1] + lows));
    if low.len() == 1 {
        return Vec::new();
    }
    let begin = |c: usize| n.min(c * chunk);
    let inside = middle / chunk;
    let low_in_front = low[inside] + references[begin(inside)..middle].iter().filter(|r| is_low(r)).count();
    // The last chunk behind the middle (or the middle itself) with at most `wrong` low references before it, and their
    // number.
    let behind = |wrong: usize| {
        let chunks = (inside + 1..low.len()).rev().map(|c| (begin(c), low[c] - low_in_front));
        chunks.chain([(middle, 0)]).find(|&(_, lows)| lows <= wrong).unwrap_or((middle, 0))
    };
    let mut borders = Vec::new();
    for (c, low_before) in low.iter().enumerate().take(inside + 1).skip(1) {
        let wrong = begin(c) - low_before;
        let (mut at, mut lows) = behind(wrong);
        if borders.len() + 1 < threads && begin(c) + (at - middle) >= n * (borders.len() + 1) / threads {
            while lows < wrong && at < n {
                lows += usize::from(is_low(&references[at]));
                at += 1;
            }
            borders.push((begin(c), at));
        }
    }
    borders
}

#[cfg(all(test, feature = "rayon"))]
mod tests {
    use super::*;
    use crate::bvh::binning::{Table, find_split, summary};
    use crate::geometry::LinearBox3;
    use crate::random::Random;

    #[test]
    fn partitions_of_large_nodes_do_not_depend_on_the_number_of_threads() {
        let mut random = Random(3);
        let n = 3 * PARALLEL as u32 + 17;
        // In random order, sorted up, sorted down, and nearly all on one side.
        for order in 0..4 {
            let given: Vec<Reference> = (0..n)
                .map(|i| {
                    let along = i as f32 / n as f32;
                    let x = [
                        random.unit(),
                        along,
                        1.0 - along,
                        if i % 1000 == 999 { 5.0 + random.unit() } else { random.unit() },
                    ][order];
                    let at = Vec3::new(x, 0.01 * random.unit(), 0.01 * random.unit());
                    let b = Box3 { min: at, max: at + 1e-3 };
                    Reference::new(LinearBox3 { begin: b, end: b }, i)
                })
                .collect();
            let mut first = None;
            for threads in [1, 2, 3, 7] {
                let mut references = given.clone();
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let (split, centres) = pool.install(|| {
                    let (_, centres) = summary(&references);
                    let split = Table::lend(|table| find_split(&references, centres, false, table)).unwrap();
                    let centres = partition(&mut references, &split);
                    (split, centres)
                });
                let (sides, (low, high)) = (split.sides(), references.split_at(split.middle));
                assert!(low.iter().all(|r| sides.is_low(r)) && !high.iter().any(|r| sides.is_low(r)));
                assert_eq!(centres, [summary(low).1, summary(high).1]);
                let ids: Vec<u32> = references.iter().map(Reference::id).collect();
                let mut sorted = ids.clone();
                sorted.sort_unstable();
                assert!(sorted.into_iter().eq(0..n));
                assert_eq!(*first.get_or_insert_with(|| ids.clone()), ids, "{order} {threads}");
            }
        }
    }
}
