//! Putting candidates into order: by squared distance, ties by id.

use super::k_nearest::Candidates;
use crate::neighbor::Neighbor;
use crate::simd::{LANES, Simd, lanes_at};

/// Above this many, sorting by counting loses to ordinary sorting.
const COUNTED: usize = 208;

/// Writes the `k` nearest candidates into `found`, in order.
#[inline(always)]
pub(in crate::neighbor) fn nearest_in_order<S: Simd>(
    s: S,
    k: usize,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    let k = k.min(candidates.count);
    found.clear();
    if candidates.count <= COUNTED && by_rank(s, k, candidates, found) {
        return;
    }
    by_comparison(k, candidates, found);
}

/// Writes all candidates into `found`, in order.
#[inline(always)]
pub(in crate::neighbor) fn all_in_order<S: Simd>(s: S, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    nearest_in_order(s, candidates.count, candidates, found);
}

/// The place of each is the number of those that are nearer. False where two are equally far: then two
/// would claim the same place.
#[inline(always)]
fn by_rank<S: Simd>(s: S, k: usize, candidates: &mut Candidates, found: &mut Vec<Neighbor>) -> bool {
    candidates.reserve(0);
    let Candidates { distances, ids, count, .. } = candidates;
    let count = *count;
    distances[count..count + LANES].fill(f32::INFINITY);
    found.resize(k, Neighbor { id: 0, distance_squared: 0.0 });
    let vectors = count.div_ceil(LANES);
    let (distances, ids) = (&distances[..vectors * LANES], &ids[..count]);
    let mut places = 0;
    for (&distance, &id) in distances.iter().zip(ids) {
        let this = s.splat(distance);
        let mut rank = 0;
        for at in (0..distances.len()).step_by(LANES) {
            rank += s.lt(s.load(lanes_at(distances, at)), this).count_ones() as usize;
        }
        places += rank;
        if let Some(place) = found.get_mut(rank) {
            *place = Neighbor { id, distance_squared: distance };
        }
    }
    places == count * count.saturating_sub(1) / 2
}

/// A distance and an id as one number that sorts like the pair.
#[inline(always)]
pub(in crate::neighbor) fn pack(distance: f32, id: u32) -> u64 {
    u64::from(distance.to_bits()) << 32 | u64::from(id)
}

/// The pair behind such a number.
#[inline(always)]
pub(in crate::neighbor) fn unpack(key: u64) -> Neighbor {
    Neighbor { id: key as u32, distance_squared: f32::from_bits((key >> 32) as u32) }
}

/// Ordinary selection and sorting. A function of its own: it is rare or long.
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
