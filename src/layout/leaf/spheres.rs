//! Leaf blocks of shapes: lists of ids, and behind them the positions of spheres.
//!
//! | words | |
//! |---|---|
//! | n | ids |
//! | 1 | number of keys of each sphere; 0 if the block only lists ids, and then it ends here. With boxes ([`super::list_boxes`]) no number of keys |
//! | 3 | first key in the block; number of keys in it, and in the topmost bit whether the caller's numbers are in f64; sizes |
//! | rows of n | for each key in the block: x, y and z of the centers, and the radii, in tree space |
//! | n | if there are more than two keys: the number of keys that each sphere has itself |
//! | 4 n or 8 n | for each key in the block, sphere by sphere: the same as the caller gave them, in f32 if no bit is lost, otherwise in f64 |
//!
//! A block is made for spheres with one number of keys, or with one and two. After a refit some may have fewer, between which the
//! rows are interpolated.
//!
//! Queries use the rows to rule out spheres; what is left is decided by the caller's numbers. So nothing of the caller's shapes is
//! read, which would have to be fetched from three places. The header also has the greatest error of the rows: as in other blocks,
//! sizes are the exponents of two powers of two. No coordinate and no radius is larger than the first. At any time, the distance of
//! centers from those of [`MovingSphere::at`] and the difference of radii are together at most the second, but for roundings of
//! f32.

use super::list_boxes::{Boxed, ListBoxes, MOVING};
use super::needed_segments::needed_segments;
use crate::geometry::{Frame, KeyPhase, ULP};
use crate::layout::wide_node::{ChildRef, Kind, Sizes};
use crate::limits::MAX_MESH_KEYS;
use crate::primitive::{MovingSphere, PrimitiveSet, SPHERE_ROUNDING};
use crate::simd::Arena;
use crate::time::TimeSlice;
use glam::{DVec3, Vec3};

/// Rows of one key: the center and the radius.
pub(crate) const SPHERE_ROWS: usize = 4;

/// Words between the ids and the rows.
const HEADER: usize = 4;

/// In the word of the number of keys: whether the caller's numbers are in f64.
const FINE: u32 = 1 << 31;

/// Spheres farther away than this in tree space, or as large, are only listed: squares of such numbers do not overflow.
const FARTHEST: f64 = 4294967296.0;

/// The header of the rows behind a list of spheres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SphereLeaf {
    /// Keys of each sphere, at least one.
    pub keys: usize,
    /// The first key in the block, and the number of keys in it.
    pub first: usize,
    pub held: usize,
    /// Whether the caller's numbers are in f64.
    fine: bool,
    /// The word of the sizes ([`crate::layout::block_sizes`]).
    pub sizes: u32,
}

impl SphereLeaf {
    /// The rows of a block of `n` ids that begins at `words[0]`; `None` if it lists ids, with boxes or without.
    #[inline(always)]
    pub fn of(words: &[u32], n: usize) -> Option<SphereLeaf> {
        match words[n] {
            0 | MOVING.. => None,
            keys => {
                let &[first, held, sizes] = words[n + 1..].first_chunk().expect("a whole header");
                let (held, fine) = ((held & !FINE) as usize, held & FINE != 0);
                Some(SphereLeaf { keys: keys as usize, first: first as usize, held, fine, sizes })
            }
        }
    }

    /// The offset of the rows of the key at which a segment begins, in a block of `n` ids; the rows of the next key follow. For a
    /// segment that is not in the block, the offset of some rows of the block.
    #[inline(always)]
    pub fn rows(&self, n: usize, segment: usize) -> usize {
        let key = segment.saturating_sub(self.first).min(self.held.saturating_sub(2));
        n + HEADER + key * SPHERE_ROWS * n
    }

    /// The offset of the numbers of keys that spheres have themselves.
    #[inline(always)]
    fn own_keys(&self, n: usize) -> usize {
        n + HEADER + self.held * SPHERE_ROWS * n
    }

    /// The offset of the caller's numbers.
    #[inline(always)]
    fn given(&self, n: usize) -> usize {
        self.own_keys(n) + if self.keys > 2 { n } else { 0 }
    }

    /// Of a sphere with this many keys: the number of the block's segments in one of its own, the first of its keys in the block,
    /// and how many there are.
    #[inline(always)]
    fn own_range(&self, own: usize) -> (usize, usize, usize) {
        if own <= 1 || self.keys <= 2 {
            return (1, 0, self.held);
        }
        let step = (self.keys - 1) / (own - 1);
        let (first, last) = (self.first / step, (self.first + self.held - 2) / step + 1);
        (step, first, last + 1 - first)
    }

    /// The keys of a sphere that are in the block.
    fn keys_of<'a>(&self, sphere: &'a MovingSphere) -> &'a [(DVec3, f64)] {
        let (_, first, held) = self.own_range(sphere.keys.len());
        &sphere.keys[first..][..held.min(sphere.keys.len() - first)]
    }

    /// Whether a sphere with this many keys can be in the block.
    fn fits(&self, own: usize) -> bool {
        match own {
            0 => false,
            1 => true,
            _ => self.keys > 1 && (self.keys - 1).is_multiple_of(own - 1),
        }
    }

    /// Whether all spheres of a block of `n` ids can be in it.
    pub fn is_valid(&self, words: &[u32], n: usize) -> bool {
        self.keys <= 2 || words[self.own_keys(n)..][..n].iter().all(|&own| self.fits(own as usize))
    }

    /// The number of words of a sphere at a key, as the caller gave it.
    #[inline(always)]
    fn given_words(&self) -> usize {
        if self.fine { 2 * SPHERE_ROWS } else { SPHERE_ROWS }
    }

    /// The number of words of a block of `n` ids.
    fn words(&self, n: usize) -> usize {
        self.given(n) + self.held * self.given_words() * n
    }

    /// Center and radius of a sphere at a time, as [`MovingSphere::at`] computes them, from a block of `n` ids that begins at
    /// `words[0]`. `None` if the block does not have the keys around that time. That is possible within a rounding error of a key.
    #[inline(always)]
    pub fn at(&self, words: &[u32], n: usize, lane: usize, time: f32) -> Option<(DVec3, f64)> {
        let own = if self.keys > 2 { words[self.own_keys(n) + lane] as usize } else { self.keys };
        if own == 1 {
            let only = self.key(words, n, lane, 0)?;
            return Some(MovingSphere::between(only, only, 0.0));
        }
        let (_, first, held) = self.own_range(own);
        let KeyPhase { segment, w } = KeyPhase::new(time.into(), own);
        let segment = segment.checked_sub(first).filter(|segment| segment + 1 < held)?;
        let [before, after] = [self.key(words, n, lane, segment)?, self.key(words, n, lane, segment + 1)?];
        Some(MovingSphere::between(before, after, w))
    }

    /// Center and radius of a sphere at one of the keys that the block has. (Written out: `map` of an array would be a call, in the
    /// middle of a query.)
    #[inline(always)]
    fn key(&self, words: &[u32], n: usize, lane: usize, key: usize) -> Option<(DVec3, f64)> {
        let words = &words[self.given(n) + (key * n + lane) * self.given_words()..];
        if self.fine {
            let [a, b, c, d, e, f, g, h]: [u32; 2 * SPHERE_ROWS] = *words.first_chunk()?;
            return Some((DVec3::new(double(a, b), double(c, d), double(e, f)), double(g, h)));
        }
        let [x, y, z, radius]: [u32; SPHERE_ROWS] = *words.first_chunk()?;
        let center = Vec3::new(f32::from_bits(x), f32::from_bits(y), f32::from_bits(z));
        Some((center.as_dvec3(), f64::from(f32::from_bits(radius))))
    }

    /// The number of words of a block of `n` ids that begins at `words[0]`; `None` if it is incomplete.
    pub fn words_of_list(words: &[u32], n: usize) -> Option<usize> {
        let end = match words.get(n)? {
            0 => n + 1,
            MOVING.. => ListBoxes::of(words, n)?.words(n),
            _ if words.len() < n + HEADER => return None,
            _ => {
                let leaf = SphereLeaf::of(words, n)?;
                // Its size fits a number of 32 bits only if the rows do not exceed all words.
                if leaf.held > words.len() / (SPHERE_ROWS * n.max(1)) {
                    return None;
                }
                leaf.words(n)
            }
        };
        (end <= words.len()).then_some(end)
    }

    /// The rows of some shapes in a time slice, without their sizes; `None` if they are to be listed only: not all are spheres, or
    /// one has keys between those of another, or more than [`MAX_MESH_KEYS`].
    fn for_shapes<S: PrimitiveSet + ?Sized>(set: &S, ids: &[u32], slice: TimeSlice) -> Option<SphereLeaf> {
        let keys = ids.iter().map(|&id| set.sphere(id).map_or(0, |sphere| sphere.keys.len())).max().unwrap_or(0);
        if keys > MAX_MESH_KEYS {
            return None;
        }
        let [first, last] = if keys > 2 { needed_segments(set, ids, keys, slice) } else { [0, 0] };
        let held = if keys > 2 { last + 2 - first } else { keys };
        SphereLeaf { keys, first, held, fine: false, sizes: 0 }.with(set, ids)
    }

    /// The same rows for some shapes; `None` if not all are spheres that fit.
    fn with<S: PrimitiveSet + ?Sized>(self, set: &S, ids: &[u32]) -> Option<SphereLeaf> {
        let mut fine = false;
        for &id in ids {
            let sphere = set.sphere(id).filter(|sphere| self.fits(sphere.keys.len()))?;
            fine |= !self.keys_of(sphere).iter().all(is_in_f32);
        }
        Some(SphereLeaf { fine, ..self })
    }

    /// Writes the header and the rows; `false` if a sphere is too far away or too large.
    fn write<S: PrimitiveSet + ?Sized>(&self, set: &S, ids: &[u32], words: &mut [u32]) -> bool {
        let n = ids.len();
        let (mut size, mut error) = (0.0, 0.0);
        let (front, rows) = words[..self.words(n)].split_at_mut(n + HEADER);
        let (rows, given) = rows.split_at_mut(self.held * SPHERE_ROWS * n);
        let (own_keys, given) = given.split_at_mut(self.given(n) - self.own_keys(n));
        for (lane, &id) in ids.iter().enumerate() {
            // The caller's code may answer differently from one call to the next.
            let Some(sphere) = set.sphere(id).filter(|sphere| self.fits(sphere.keys.len())) else { return false };
            let last = sphere.keys.len() - 1;
            let Some(of) = MeasuredSphere::of(self.keys_of(sphere), last, set.frame()) else { return false };
            (size, error) = (of.size.max(size), of.error.max(error));
            let (step, own_first, _) = self.own_range(sphere.keys.len());
            if let Some(own) = own_keys.get_mut(lane) {
                *own = sphere.keys.len() as u32;
            }
            let keys = rows.chunks_exact_mut(SPHERE_ROWS * n).zip(given.chunks_exact_mut(self.given_words() * n));
            for (key, (rows, given)) in keys.enumerate() {
                let (before, inner) = ((self.first + key) / step, (self.first + key) % step);
                let [before, after] = [before, before + 1].map(|key| sphere.keys[key.min(last)]);
                let (center, radius) = MovingSphere::between(before, after, inner as f64 / step as f64);
                let at = set.frame().fine_point(center);
                let in_tree = [at.x, at.y, at.z, radius * set.frame().scale];
                for (row, x) in in_tree.into_iter().enumerate() {
                    rows[row * n + lane] = (x as f32).to_bits();
                }
                // There may be fewer of them than keys in the block.
                let (center, radius) = sphere.keys[(own_first + key).min(last)];
                let as_given = [center.x, center.y, center.z, radius];
                let given = &mut given[lane * self.given_words()..];
                if self.fine {
                    for (words, x) in given.as_chunks_mut().0.iter_mut().zip(as_given) {
                        *words = [x.to_bits() as u32, (x.to_bits() >> 32) as u32];
                    }
                } else {
                    given.iter_mut().zip(as_given).for_each(|(word, x)| *word = (x as f32).to_bits());
                }
            }
        }
        let sizes = Sizes::word_of(size as f32, error as f32);
        let held = self.held as u32 | if self.fine { FINE } else { 0 };
        front[n..].copy_from_slice(&[self.keys as u32, self.first as u32, held, sizes]);
        true
    }
}

/// Whether f32 has all numbers of a sphere at a key.
fn is_in_f32(&(center, radius): &(DVec3, f64)) -> bool {
    center.as_vec3().as_dvec3() == center && f64::from(radius as f32) == radius
}

/// The size of a sphere in tree space, and the error of its rows.
struct MeasuredSphere {
    size: f64,
    error: f64,
}

impl MeasuredSphere {
    /// Between some keys of a sphere that has `segments` segments; `None` if it is only listed.
    fn of(keys: &[(DVec3, f64)], segments: usize, frame: &Frame) -> Option<MeasuredSphere> {
        let (mut size, mut world, mut step) = (0.0f64, 0.0f64, 0.0f64);
        let mut before = None;
        for &(center, radius) in keys {
            let at = frame.fine_point(center);
            let place = [at.x, at.y, at.z, radius.abs() * frame.scale];
            for x in place {
                if x.is_nan() || x.abs() >= FARTHEST {
                    return None;
                }
                size = size.max(x.abs());
            }
            world = world.max(center.abs().max_element() + radius.abs());
            let here = (at, radius.abs() * frame.scale);
            let (from, was) = before.unwrap_or(here);
            step = step.max((here.0 - from).length() + (here.1 - was).abs());
            before = Some(here);
        }
        // A query's place between keys is rounded in f32: by an ULP of the number of segments, at most.
        let rounding = (segments + 1) as f64 * f64::from(ULP);
        Some(MeasuredSphere { size, error: SPHERE_ROUNDING * world * frame.scale + rounding * step })
    }
}

/// The number of words of a block of shapes, at most.
pub(in crate::layout) fn shapes_words<S: PrimitiveSet + ?Sized>(set: &S, ids: &[u32], slice: TimeSlice) -> usize {
    let n = ids.len();
    match SphereLeaf::for_shapes(set, ids, slice) {
        Some(leaf) => leaf.words(n),
        None => ListBoxes::most_words(n).unwrap_or(n + 1),
    }
}

/// Writes a block of shapes; `None` if the arena is full.
pub(in crate::layout) fn write_shapes<S: PrimitiveSet + ?Sized>(
    set: &S,
    arena: &mut Arena,
    ids: &[u32],
    slice: TimeSlice,
) -> Option<ChildRef> {
    arena.align();
    let n = ids.len();
    let spheres = SphereLeaf::for_shapes(set, ids, slice);
    let boxed = (spheres.is_none() && n > 1).then(|| Boxed::new(set, ids, slice.interval()));
    let at = arena.grow(match (&spheres, &boxed) {
        (Some(leaf), _) => leaf.words(n),
        (None, Some(boxed)) => boxed.of.words(n),
        (None, None) => n + 1,
    });
    let words = &mut arena.ints_mut()[at..];
    words[..n].copy_from_slice(ids);
    if let Some(boxed) = boxed {
        boxed.write(words, n);
    } else if !spheres.is_some_and(|leaf| leaf.write(set, ids, words)) {
        words[n] = 0;
    }
    ChildRef::new(Kind::OtherLeaf, at, n)
}

/// Rewrites a block of shapes with these ids that begins at `words[0]`. If shapes are no longer spheres, have keys that the block
/// does not, or no room for their bits, the block only lists them from then on.
pub(in crate::layout) fn rewrite_shapes<S: PrimitiveSet + ?Sized>(set: &S, words: &mut [u32], ids: &[u32]) {
    let Some(leaf) = SphereLeaf::of(words, ids.len()) else { return Boxed::rewrite(set, words, ids) };
    let fits = leaf.with(set, ids).is_some_and(|now| leaf.fine || !now.fine);
    if !(fits && leaf.write(set, ids, words)) {
        words[ids.len()] = 0;
    }
}

/// A number in f64 of two words, the lower one first.
#[inline(always)]
fn double(low: u32, high: u32) -> f64 {
    f64::from_bits(u64::from(high) << 32 | u64::from(low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::BuildError;
    use crate::geometry::KeyTime;
    use crate::layout::{Between, block_sizes, sphere_row};
    use crate::primitive::{Primitive, Scene};
    use crate::random::Random;
    use crate::simd::{LANES, Portable, Rows, Simd};

    #[test]
    fn forged_numbers_of_keys_are_refused_before_they_overflow() {
        let block = |held: u32| [vec![0; LANES], vec![2, 0, held, 0], vec![0; 12 * LANES]].concat();
        for (held, words) in [
            (1, Some(20 + 8 * LANES)),
            (2, None),
            (FINE - 1, None),
            (u32::MAX, None),
            (FINE | 1, Some(20 + 12 * LANES)),
        ] {
            assert_eq!(SphereLeaf::words_of_list(&block(held), LANES), words, "{held:x}");
        }
    }

    /// Spheres that need f64, or not.
    fn spheres_of(n: usize, keys: usize, fine: bool, seed: u64) -> Vec<MovingSphere> {
        let mut random = Random(seed);
        let mut key = || {
            let (center, radius) = (random.dvec(), random.dvec().x * 0.1);
            if fine { (center, radius) } else { (center.as_vec3().as_dvec3(), f64::from(radius as f32)) }
        };
        (0..n).map(|_| MovingSphere::new((0..keys).map(|_| key()).collect())).collect()
    }

    fn spheres(n: usize, keys: usize, seed: u64) -> Vec<MovingSphere> {
        spheres_of(n, keys, true, seed)
    }

    fn scene(spheres: Vec<MovingSphere>) -> Result<Scene, BuildError> {
        Scene::new(&[], Box::new(spheres))
    }

    fn block(set: &Scene, slice: TimeSlice) -> Vec<u32> {
        let ids: Vec<u32> = (0..set.len() as u32).collect();
        let mut arena = Arena::default();
        write_shapes(set, &mut arena, &ids, slice).expect("room");
        arena.ints().to_vec()
    }

    #[test]
    fn blocks_have_the_numbers_of_spheres_to_the_last_bit() {
        let mut random = Random(2);
        let (mut found, mut missing) = (0, 0);
        for (i, keys) in [1, 1, 2, 2, 3, 9, 9, 65].into_iter().enumerate() {
            let balls = spheres_of(7, keys, i % 2 == 0, keys as u64);
            let set = scene(balls.clone()).expect("valid spheres");
            for slices in [1, 4, 7] {
                for index in 0..slices {
                    let slice = TimeSlice { index, of: slices };
                    let words = block(&set, slice);
                    let leaf = SphereLeaf::of(&words, 7).expect("a block of spheres");
                    let [first, last] = slice.times();
                    let within = |random: &mut Random| first + (last - first) * random.unit();
                    for time in [first, last].into_iter().chain((0..40).map(|_| within(&mut random))) {
                        for (lane, ball) in balls.iter().enumerate() {
                            match leaf.at(&words, 7, lane, time) {
                                Some(at) => {
                                    found += 1;
                                    assert_eq!(at, ball.at(time), "{keys} keys at {time}");
                                }
                                None => missing += 1,
                            }
                        }
                    }
                }
            }
        }
        assert!(missing * 100 < found, "{missing} of {found}");
    }

    /// How far the rows of spheres with many keys, between keys as queries find them, are off at most, relative to the stated
    /// error.
    fn off(error_of: fn(&MovingSphere, &Frame) -> f64) -> f64 {
        let mut random = Random(5);
        let mut most = 0.0f64;
        for seed in 0..20 {
            let balls = spheres(16, 300, seed);
            let set = scene(balls.clone()).expect("valid spheres");
            let words = block(&set, TimeSlice::WHOLE);
            let leaf = SphereLeaf::of(&words, 16).expect("a block of spheres");
            let error = balls.iter().map(|ball| error_of(ball, set.frame())).fold(0.0, f64::max);
            assert!(f64::from(block_sizes(leaf.sizes).1) >= error);
            for _ in 0..200 {
                let time = random.unit();
                let at = KeyTime::new(time, 300);
                let rows = Rows::new(&crate::simd::as_floats(&words)[leaf.rows(16, at.segment)..], 16, 2 * SPHERE_ROWS);
                for (lane, ball) in balls.iter().enumerate() {
                    let row = |row: usize| {
                        let row = sphere_row::<_, true>(Portable, &rows, Between::new(at), row, 0.0);
                        f64::from(Portable.lane(row, lane))
                    };
                    let (center, radius) = ball.at(time);
                    let center = set.frame().fine_point(center);
                    let by = (DVec3::new(row(0), row(1), row(2)) - center).length();
                    let by = by + (row(3) - radius * set.frame().scale).abs();
                    // The roundings of f32 that queries allow for besides.
                    most = most.max((by - 16.0 * f64::from(ULP)) / error);
                }
            }
        }
        most
    }

    #[test]
    fn rows_of_many_keys_are_off_by_no_more_than_the_stated_error_and_would_be_without_the_steps() {
        assert!(off(|ball, frame| MeasuredSphere::of(&ball.keys, 299, frame).expect("near").error) <= 1.0);
        assert!(off(|_, _| SPHERE_ROUNDING) > 10.0, "an error that nothing needs");
    }

    #[test]
    fn blocks_hold_spheres_with_fewer_keys_that_the_keys_of_the_block_refine() {
        let of = |keys: usize, seed: u64| {
            scene(spheres(1, keys, seed)).expect("valid spheres").sphere(0).expect("a sphere").clone()
        };
        let before: Vec<MovingSphere> = (0..5).map(|i| of(13, i)).collect();
        let mixed: Vec<MovingSphere> =
            [1, 2, 3, 7, 13].into_iter().zip(5..).map(|(keys, seed)| of(keys, seed)).collect();
        let [before, now] = [before, mixed.clone()].map(|of| scene(of).expect("valid spheres"));
        let (mut random, ids) = (Random(4), [0, 1, 2, 3, 4]);
        let mut found = 0;
        for slices in [1, 4, 5] {
            for index in 0..slices {
                let slice = TimeSlice { index, of: slices };
                let mut words = block(&before, slice);
                rewrite_shapes(&now, &mut words, &ids);
                let leaf = SphereLeaf::of(&words, 5).expect("a block of spheres");
                assert!(leaf.is_valid(&words, 5));
                let [first, last] = slice.times();
                for time in [first, last].into_iter().chain((0..40).map(|_| first + (last - first) * random.unit())) {
                    for (lane, ball) in mixed.iter().enumerate() {
                        let Some(at) = leaf.at(&words, 5, lane, time) else { continue };
                        found += 1;
                        assert_eq!(at, ball.at(time));
                        let rows = leaf.rows(5, KeyTime::new(time, 13).segment);
                        let rows = Rows::new(&crate::simd::as_floats(&words)[rows..], 5, 2 * SPHERE_ROWS);
                        let row = |row: usize| {
                            let between = Between::new(KeyTime::new(time, 13));
                            Portable.lane(sphere_row::<_, true>(Portable, &rows, between, row, 0.0), lane)
                        };
                        let center = now.frame().fine_point(at.0);
                        let off = (DVec3::new(row(0).into(), row(1).into(), row(2).into()) - center).length();
                        assert!(off <= f64::from(block_sizes(leaf.sizes).1) + 16.0 * f64::from(ULP), "{off}");
                    }
                }
            }
        }
        assert!(found > 1900, "{found}");
        for wrong in [0, 6, 14, u32::MAX] {
            let mut words = block(&before, TimeSlice::WHOLE);
            let leaf = SphereLeaf::of(&words, 5).expect("a block of spheres");
            let at = leaf.own_keys(5);
            words[at] = wrong;
            assert!(!leaf.is_valid(&words, 5), "{wrong} keys of 13");
        }
    }

    #[test]
    fn shapes_that_are_no_spheres_any_more_are_only_listed() {
        let set = |keys: usize| scene(spheres(5, keys, 1)).expect("valid spheres");
        let ids = [0, 1, 2, 3, 4];
        for (before, after, held) in
            [(2, 2, true), (2, 1, true), (1, 2, false), (9, 9, true), (9, 1, true), (9, 2, true), (9, 4, false)]
        {
            let mut words = block(&set(before), TimeSlice::WHOLE);
            rewrite_shapes(&set(after), &mut words, &ids);
            let rows = SphereLeaf::of(&words, 5);
            assert_eq!(rows.is_some(), held, "{before} and {after} keys");
            assert_eq!(words[..5], ids);
            if let Some(rows) = rows {
                let ball = &set(after);
                assert_eq!(rows.at(&words, 5, 3, 0.3), ball.sphere(3).map(|ball| ball.at(0.3)));
            }
        }
        for (before, after, held) in
            [(false, false, true), (true, false, true), (true, true, true), (false, true, false)]
        {
            let set = |fine: bool| scene(spheres_of(5, 2, fine, 2)).expect("valid spheres");
            let mut words = block(&set(before), TimeSlice::WHOLE);
            rewrite_shapes(&set(after), &mut words, &ids);
            let rows = SphereLeaf::of(&words, 5);
            assert_eq!(rows.is_some(), held, "in f64 {before} and {after}");
            if let Some(rows) = rows {
                assert_eq!(rows.at(&words, 5, 3, 0.3), set(after).sphere(3).map(|ball| ball.at(0.3)));
            }
        }
        let [coarse, fine] = [false, true].map(|fine| {
            let set = scene(spheres_of(5, 2, fine, 2)).expect("valid spheres");
            shapes_words(&set, &ids, TimeSlice::WHOLE)
        });
        assert_eq!(fine - coarse, 5 * 2 * SPHERE_ROWS);
        let far = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::splat(1e25), 1.0)]);
        let far = far.with_active(crate::geometry::TimeInterval::new(0.0, 1e-30).expect("an interval"));
        assert!(far.bounds(far.active).swept().max.x < 2.0);
        let words = block(&scene(vec![far]).expect("a valid sphere"), TimeSlice::WHOLE);
        assert_eq!(SphereLeaf::of(&words, 1), None);
    }
}
