//! The candidates of a search, as a structure of arrays, so that sixteen are appended or removed at a time.

use crate::point::neighbor::Neighbor;
use crate::simd::{LANES, Mask, Simd, lanes_at, lanes_at_mut};

/// Memory for candidates: separate arrays of distances and ids, with room for one vector at the end.
#[derive(Clone, Debug, Default)]
pub(in crate::point) struct Candidates {
    pub(in crate::point) distances: Vec<f32>,
    pub(in crate::point) ids: Vec<u32>,
    pub(in crate::point) count: usize,
    /// Distances of a search's first leaves, before there is a threshold.
    pub(super) raw: Vec<f32>,
    pub(in crate::point) packed: Vec<u64>,
}

impl Candidates {
    /// Reserves room for `more` candidates and one vector.
    #[inline(always)]
    pub(in crate::point) fn reserve(&mut self, more: usize) {
        if self.count + more + LANES > self.distances.len() {
            self.grow(more);
        }
    }

    #[cold]
    fn grow(&mut self, more: usize) {
        let size = (2 * (self.count + more + LANES)).next_multiple_of(LANES);
        self.distances.resize(size, 0.0);
        self.ids.resize(size, 0);
        self.raw.resize(size, 0.0);
    }

    pub(in crate::point) fn bytes(&self) -> usize {
        4 * (self.distances.capacity() + self.ids.capacity() + self.raw.capacity()) + 8 * self.packed.capacity()
    }

    /// Ids and squared distances.
    #[inline(always)]
    pub(in crate::point) fn pairs(&self) -> impl Iterator<Item = (u32, f32)> {
        self.ids[..self.count].iter().copied().zip(self.distances.iter().copied())
    }

    /// Appends the lanes of a mask; the room must have been reserved.
    #[inline(always)]
    pub(in crate::point) fn push<S: Simd>(&mut self, s: S, distance: S::F, id: S::U, mask: u16) {
        self.count = append(s, &mut self.distances, &mut self.ids, self.count, (distance, id), mask);
    }

    /// Overwrites sixteen distances.
    #[inline(always)]
    pub(super) fn write<S: Simd>(&mut self, s: S, at: usize, distance: S::F) {
        s.store(distance, lanes_at_mut(&mut self.raw, at));
    }

    /// Removes all candidates above the threshold. The rest of the last vector must be above it.
    #[inline(always)]
    pub(super) fn retain<S: Simd>(&mut self, s: S, threshold: f32) {
        let count = core::mem::take(&mut self.count);
        for at in (0..count).step_by(LANES) {
            let distance = s.load(lanes_at(&self.distances, at));
            let id = s.load_u(lanes_at(&self.ids, at));
            self.push(s, distance, id, s.le(distance, s.splat(threshold)));
        }
    }

    /// Keeps the k least pairs and returns the greatest of them. For sets with so many equal distances that no threshold
    /// separates them.
    #[cold]
    #[inline(never)]
    pub(super) fn retain_exactly(&mut self, k: usize) -> Neighbor {
        let pairs = self.distances.iter().zip(&self.ids).take(self.count);
        self.packed.clear();
        self.packed.extend(pairs.map(|(&distance, &id)| pack(distance, id)));
        let (_, &mut last, _) = self.packed.select_nth_unstable(k - 1);
        for (i, &key) in self.packed[..k].iter().enumerate() {
            let pair = unpack(key);
            (self.distances[i], self.ids[i]) = (pair.distance_squared, pair.id);
        }
        self.count = k;
        unpack(last)
    }
}

/// Writes the lanes of a mask at offset `end` and returns the new end. (As a value of its own, the end
/// stays in a register.)
#[inline(always)]
pub(in crate::point) fn append<S: Simd>(
    s: S,
    distances: &mut [f32],
    ids: &mut [u32],
    end: usize,
    (distance, id): (S::F, S::U),
    mask: Mask,
) -> usize {
    s.store_compressed(distance, mask, lanes_at_mut(distances, end));
    s.store_compressed_u(id, mask, lanes_at_mut(ids, end));
    end + mask.count_ones() as usize
}

/// A distance and an id as one number that sorts like the pair.
#[inline(always)]
pub(in crate::point) fn pack(distance: f32, id: u32) -> u64 {
    u64::from(distance.to_bits()) << 32 | u64::from(id)
}

/// The pair that was packed.
#[inline(always)]
pub(in crate::point) fn unpack(key: u64) -> Neighbor {
    Neighbor { id: key as u32, distance_squared: f32::from_bits((key >> 32) as u32) }
}
