//! Sorting candidates: by squared distance, ties by id.
//!
//! Up to 256 candidates are sorted in registers. A key is a distance whose low eight bits are replaced by
//! the candidate's index in the buffer; a bitonic network of minima and maxima sorts the keys without a
//! branch. Pairs that the lost bits leave undecided are corrected in the pass that fetches the ids, by
//! insertion, which is seldom needed.

use super::candidates::{Candidates, pack, unpack};
use crate::point::neighbor::Neighbor;
use crate::simd::{Kernel, LANES, Simd, SimdLevel, dispatch, first_lanes, lanes_at, merge_lanes};

/// The largest number of candidates that the network sorts.
const MOST: usize = 16 * LANES;

/// The bits of a key that hold the index of the candidate.
const INDEX: u32 = MOST as u32 - 1;

/// The number of insertion moves above which ordinary sorting takes over.
const MOST_MOVES: usize = 4 * MOST;

/// Writes the `k` nearest candidates into `found`, in order.
#[inline(always)]
pub(in crate::point) fn nearest_in_order(
    simd: SimdLevel,
    k: usize,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    let k = k.min(candidates.count);
    found.clear();
    if candidates.count <= MOST {
        candidates.reserve(0);
        // A separate dispatch: the networks are compiled once and not into every search.
        if dispatch(simd, Network { k, candidates, found }) {
            return;
        }
    }
    by_comparison(k, candidates, found);
}

/// Writes all candidates into `found`, in order.
#[inline(always)]
pub(in crate::point) fn all_in_order(simd: SimdLevel, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    nearest_in_order(simd, candidates.count, candidates, found);
}

struct Network<'a> {
    k: usize,
    candidates: &'a Candidates,
    found: &'a mut Vec<Neighbor>,
}

impl Kernel for Network<'_> {
    /// Whether sorting succeeded; false if too many distances are nearly equal.
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Network { k, candidates, found } = self;
        let Candidates { distances, ids, count, .. } = candidates;
        let count = *count;
        match count.div_ceil(LANES) {
            0 => true,
            1 => few_in_order(s, k, candidates, found) || sorted::<S, 1>(s, k, count, distances, ids, found),
            2 => sorted::<S, 2>(s, k, count, distances, ids, found),
            3 => sorted::<S, 3>(s, k, count, distances, ids, found),
            4 => sorted::<S, 4>(s, k, count, distances, ids, found),
            5 | 6 => sorted::<S, 6>(s, k, count, distances, ids, found),
            7 | 8 => sorted::<S, 8>(s, k, count, distances, ids, found),
            9..=12 => sorted::<S, 12>(s, k, count, distances, ids, found),
            _ => sorted::<S, 16>(s, k, count, distances, ids, found),
        }
    }
}

/// Writes the `k` nearest of at most sixteen candidates into `found`, in order, in registers. Does nothing and
/// returns false if there are more or if keys leave the order undecided.
#[inline(always)]
pub(in crate::point) fn few_in_order<S: Simd>(
    s: S,
    k: usize,
    candidates: &Candidates,
    found: &mut Vec<Neighbor>,
) -> bool {
    let count = candidates.count;
    if count > LANES || candidates.ids.len() < LANES {
        return false;
    }
    let (distance, id) = (s.load(lanes_at(&candidates.distances, 0)), s.load_u(lanes_at(&candidates.ids, 0)));
    let index = s.load_u(&INDICES[0]);
    let bits = s.splat_u(!(LANES as u32 - 1));
    let key = s.select_u(first_lanes(count), (s.to_bits(distance) & bits) | index, s.splat_u(u32::MAX));
    let key = s.sort_u(key);
    // Each compared with the next one; lanes beyond the last are NaN, which equals nothing.
    let next = s.permute(s.from_bits(key), s.add_u(index, s.splat_u(1)));
    let (this, next) = (s.from_bits(key & bits), s.from_bits(s.to_bits(next) & bits));
    let undecided = s.eq(this, next) & !(1 << (LANES - 1));
    let (distance, id) = (s.permute(distance, key), s.to_bits(s.permute(s.from_bits(id), key)));
    if undecided != 0 {
        // Points in one place come in the order of their ids, unless they are in several leaves.
        let second = s.add_u(index, s.splat_u(1));
        let (farther, higher) = (s.permute(distance, second), s.to_bits(s.permute(s.from_bits(id), second)));
        let decided = s.lt(distance, farther) | (s.eq(distance, farther) & s.lt_u(id, higher));
        if undecided & !decided != 0 {
            return false;
        }
    }
    let (mut distances, mut ids) = ([0.0; LANES], [0; LANES]);
    s.store(distance, &mut distances);
    s.store_u(id, &mut ids);
    // A loop: a function from indices to neighbours becomes a call.
    let mut pairs = [Neighbor { id: 0, distance_squared: 0.0 }; LANES];
    for (pair, (&id, &distance_squared)) in pairs.iter_mut().zip(ids.iter().zip(&distances)) {
        *pair = Neighbor { id, distance_squared };
    }
    found.clear();
    found.extend_from_slice(&pairs);
    found.truncate(k.min(count));
    true
}

/// Fetches the nearest `k` in the order of their keys and puts right what the keys leave undecided.
#[inline(never)]
fn in_place(k: usize, keys: &[u32], distances: &[f32], ids: &[u32], found: &mut Vec<Neighbor>) -> bool {
    // Those that the keys can not tell from the last one belong to the choice.
    let mut chosen = k;
    while chosen > 0 && chosen < keys.len() && (keys[chosen] ^ keys[chosen - 1]) <= INDEX {
        chosen += 1;
    }
    let neighbor = |key: &u32| {
        let index = (key & INDEX) as usize;
        Neighbor { id: ids[index], distance_squared: distances[index] }
    };
    found.extend(keys[..chosen].iter().map(neighbor));
    let key = |n: &Neighbor| pack(n.distance_squared, n.id);
    let mut moves = 0;
    for i in 1..chosen {
        let next = found[i];
        if key(&found[i - 1]) <= key(&next) {
            continue;
        }
        let mut at = i;
        while at > 0 && key(&found[at - 1]) > key(&next) {
            found[at] = found[at - 1];
            at -= 1;
            moves += 1;
        }
        found[at] = next;
        if moves > MOST_MOVES {
            return false;
        }
    }
    found.truncate(k);
    true
}

/// Sorts the keys of `N` vectors of distances and fetches the neighbours.
#[inline(always)]
fn sorted<S: Simd, const N: usize>(
    s: S,
    k: usize,
    count: usize,
    distances: &[f32],
    ids: &[u32],
    found: &mut Vec<Neighbor>,
) -> bool {
    let last = s.splat_u(u32::MAX);
    let mut lanes = [last; N];
    for (i, lanes) in lanes.iter_mut().enumerate() {
        if i * LANES < count {
            let key = (s.to_bits(s.load(lanes_at(distances, i * LANES))) & s.splat_u(!INDEX)) | s.load_u(&INDICES[i]);
            *lanes = s.select_u(first_lanes(count - i * LANES), key, last);
        }
    }
    for x in &mut lanes {
        *x = s.sort_u(*x);
    }
    // Runs of `run` vectors are in order; two at a time become one of twice the length. Vectors beyond the
    // last count as infinite: a comparison with one of them changes nothing.
    let mut run = 1;
    while run < N {
        let mut begin = 0;
        while begin + run < N {
            for i in 0..run {
                let mirror = begin + 2 * run - 1 - i;
                if mirror < N {
                    let (low, high) = (lanes[begin + i], s.swap_lanes_u::<15>(lanes[mirror]));
                    lanes[begin + i] = s.min_u(low, high);
                    lanes[mirror] = s.swap_lanes_u::<15>(s.max_u(low, high));
                }
            }
            begin += 2 * run;
        }
        let mut apart = run / 2;
        while apart > 0 {
            for i in 0..N {
                if i & apart == 0 && i + apart < N {
                    let (low, high) = (lanes[i], lanes[i + apart]);
                    lanes[i] = s.min_u(low, high);
                    lanes[i + apart] = s.max_u(low, high);
                }
            }
            apart /= 2;
        }
        for x in &mut lanes {
            *x = merge_lanes(s, *x);
        }
        run *= 2;
    }
    let mut keys = [[0; LANES]; N];
    for (x, to) in lanes.iter().zip(&mut keys) {
        s.store_u(*x, to);
    }
    in_place(k, &keys.as_flattened()[..count], distances, ids, found)
}

/// The index of each lane of each vector in the buffer.
static INDICES: [[u32; LANES]; MOST / LANES] = {
    let mut indices = [[0; LANES]; MOST / LANES];
    let mut i = 0;
    while i < MOST {
        indices[i / LANES][i % LANES] = i as u32;
        i += 1;
    }
    indices
};

/// Ordinary selection and sorting. Not inlined: it is rare or long.
#[inline(never)]
fn by_comparison(k: usize, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    let Candidates { distances, ids, count, packed, .. } = candidates;
    packed.clear();
    packed.extend(distances.iter().zip(&*ids).take(*count).map(|(&distance, &id)| pack(distance, id)));
    if k < packed.len() {
        packed.select_nth_unstable(k);
        packed.truncate(k);
    }
    packed.sort_unstable();
    found.clear();
    found.extend(packed.iter().map(|&key| unpack(key)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn check(simd: SimdLevel, k: usize, pairs: &[(f32, u32)]) {
        let mut candidates = Candidates::default();
        candidates.reserve(pairs.len());
        for (i, &(distance, id)) in pairs.iter().enumerate() {
            (candidates.distances[i], candidates.ids[i]) = (distance, id);
        }
        candidates.count = pairs.len();
        let mut expected: Vec<u64> = pairs.iter().map(|&(distance, id)| pack(distance, id)).collect();
        expected.sort_unstable();
        let expected: Vec<Neighbor> = expected.into_iter().take(k).map(unpack).collect();
        let mut found = Vec::new();
        nearest_in_order(simd, k, &mut candidates, &mut found);
        assert_eq!(found, expected, "{simd}, {k} of {}", pairs.len());
    }

    /// Every count on every instruction set: distances far apart, equal up to the bits that keys lose,
    /// equal throughout, the least and the greatest there are.
    #[test]
    fn every_count_comes_into_order() {
        let mut random = Random(5);
        let mut next = || (random.bits() >> 33) as u32;
        for count in (0..=MOST + 2).chain([500]) {
            let mut ids: Vec<u32> = (0..count as u32).collect();
            for i in 1..count {
                ids.swap(i, next() as usize % (i + 1));
            }
            let mut distance = |kind: u32| match kind {
                0 => (next() % (1 << 24)) as f32,
                1 => f32::from_bits(0x4000_0000 + next() % 700),
                2 => 1.0,
                3 => f32::from_bits(next() % 3000),
                _ => f32::from_bits(f32::MAX.to_bits() - next() % 300),
            };
            for kind in 0..5 {
                let pairs: Vec<(f32, u32)> = ids.iter().map(|&id| (distance(kind), id)).collect();
                for simd in SimdLevel::available() {
                    for k in [1, count / 2, count.saturating_sub(1), count, count + 3] {
                        check(simd, k, &pairs);
                    }
                }
            }
        }
    }
}
