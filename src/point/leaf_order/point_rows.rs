//! Points in four rows: three of coordinates, one of indices.

use crate::simd::{Item, LANES, Mask, PointBlock, Simd, WordBlock, lanes_at, lanes_at_mut};

/// Points in rows of any length, in memory of someone else.
pub(in crate::point) struct PointRows<'a> {
    pub(in crate::point) at: [&'a mut [f32]; 3],
    pub(in crate::point) index: &'a mut [u32],
}

/// Sixteen points.
#[derive(Clone, Copy)]
pub(in crate::point) struct PointVector<S: Simd> {
    pub(in crate::point) at: [S::F; 3],
    pub(in crate::point) index: S::U,
}

/// A point of rows. This and the functions below are for rows of fixed length, too, whose checks of indices then disappear.
#[inline(always)]
pub(super) fn item([x, y, z]: [&[f32]; 3], index: &[u32], i: usize) -> Item {
    Item { at: [x[i], y[i], z[i]], index: index[i] }
}

/// Sets a point of rows.
#[inline(always)]
pub(super) fn set_item([x, y, z]: [&mut [f32]; 3], index: &mut [u32], i: usize, item: &Item) {
    (x[i], y[i], z[i], index[i]) = (item.at[0], item.at[1], item.at[2], item.index);
}

/// The sixteen points of rows from `at` on.
#[inline(always)]
pub(super) fn vector<S: Simd>(s: S, [x, y, z]: [&[f32]; 3], index: &[u32], at: usize) -> PointVector<S> {
    PointVector {
        at: [s.load(lanes_at(x, at)), s.load(lanes_at(y, at)), s.load(lanes_at(z, at))],
        index: s.load_u(lanes_at(index, at)),
    }
}

/// Writes the lanes of a mask to index `at` of rows and on, and anything to the rest of a vector there.
#[inline(always)]
pub(super) fn store_compressed<S: Simd>(
    s: S,
    [x, y, z]: [&mut [f32]; 3],
    index: &mut [u32],
    at: usize,
    (points, mask): (&PointVector<S>, Mask),
) {
    s.store_compressed(points.at[0], mask, lanes_at_mut(x, at));
    s.store_compressed(points.at[1], mask, lanes_at_mut(y, at));
    s.store_compressed(points.at[2], mask, lanes_at_mut(z, at));
    s.store_compressed_u(points.index, mask, lanes_at_mut(index, at));
}

impl<'a> PointRows<'a> {
    /// Room for `count` points in the memory of blocks, rounded up to a vector.
    pub(in crate::point) fn in_blocks<B: WordBlock>(blocks: &'a mut [B], count: usize) -> PointRows<'a> {
        let ([x, y, z], index) = B::rows(blocks);
        let room = count.next_multiple_of(LANES);
        PointRows { at: [&mut x[..room], &mut y[..room], &mut z[..room]], index: &mut index[..room] }
    }

    /// Memory for `count` points.
    pub(in crate::point) fn memory(count: usize) -> Vec<PointBlock> {
        PointBlock::zeroed(count.div_ceil(LANES))
    }

    /// Room for `count` points in memory that grows if it is not enough.
    pub(in crate::point) fn in_memory(memory: &'a mut Vec<PointBlock>, count: usize) -> PointRows<'a> {
        let blocks = count.div_ceil(LANES);
        if memory.len() < blocks {
            *memory = PointRows::memory(count);
        }
        PointRows::in_blocks(&mut memory[..blocks], count)
    }

    pub(in crate::point) fn len(&self) -> usize {
        self.index.len()
    }

    /// Sets a point.
    #[inline(always)]
    pub(in crate::point) fn set(&mut self, i: usize, item: &Item) {
        let [x, y, z] = &mut self.at;
        set_item([x, y, z], self.index, i, item);
    }

    /// A point.
    #[inline(always)]
    pub(in crate::point) fn get(&self, i: usize) -> Item {
        let [x, y, z] = &self.at;
        item([x, y, z], self.index, i)
    }

    /// Writes items, and makes the rest of the last vector no points: at infinity, behind all others along every axis.
    pub(in crate::point) fn take(&mut self, items: impl Iterator<Item = Item>) {
        let mut count = 0;
        let ([x, y, z], index) = (&mut self.at, &mut self.index);
        let to = x.iter_mut().zip(y.iter_mut()).zip(z.iter_mut()).zip(index.iter_mut());
        for ((((x, y), z), index), item) in to.zip(items) {
            ([*x, *y, *z], *index) = (item.at, item.index);
            count += 1;
        }
        for i in count..self.len() {
            self.set(i, &NO_POINT);
        }
    }

    /// Copies all points of other rows of the same length.
    pub(in crate::point) fn copy(&mut self, from: &PointRows) {
        for (to, from) in self.at.iter_mut().zip(&from.at) {
            to.copy_from_slice(from);
        }
        self.index.copy_from_slice(from.index);
    }

    /// So many points at a time, each part with the number of its first point.
    pub(in crate::point) fn chunks(self, count: usize) -> Vec<(usize, PointRows<'a>)> {
        let (mut rest, mut first, mut chunks) = (self, 0, Vec::new());
        while rest.len() > count {
            let (chunk, more) = rest.split_at(count);
            chunks.push((first, chunk));
            (rest, first) = (more, first + count);
        }
        chunks.push((first, rest));
        chunks
    }

    /// The first `count` points, and the others.
    pub(in crate::point) fn split_at(self, count: usize) -> (PointRows<'a>, PointRows<'a>) {
        let [x, y, z] = self.at.map(|row| row.split_at_mut(count));
        let index = self.index.split_at_mut(count);
        (PointRows { at: [x.0, y.0, z.0], index: index.0 }, PointRows { at: [x.1, y.1, z.1], index: index.1 })
    }

    /// The same rows for a while.
    pub(in crate::point) fn borrow(&mut self) -> PointRows<'_> {
        let [x, y, z] = &mut self.at;
        PointRows { at: [x, y, z], index: self.index }
    }

    /// The sixteen points from `at` on.
    #[inline(always)]
    pub(in crate::point) fn vector<S: Simd>(&self, s: S, at: usize) -> PointVector<S> {
        let [x, y, z] = &self.at;
        vector(s, [x, y, z], self.index, at)
    }

    /// Writes the lanes of a mask to index `at` and on, and anything to the rest of a vector there.
    #[inline(always)]
    pub(in crate::point) fn store_compressed<S: Simd>(&mut self, s: S, at: usize, points: &PointVector<S>, mask: Mask) {
        let [x, y, z] = &mut self.at;
        store_compressed(s, [x, y, z], self.index, at, (points, mask));
    }

    /// The same without writing to anything behind the last of these lanes.
    #[inline(always)]
    pub(in crate::point) fn store_compressed_only<S: Simd>(
        &mut self,
        s: S,
        at: usize,
        points: &PointVector<S>,
        mask: Mask,
    ) {
        if at + LANES <= self.len() {
            return self.store_compressed(s, at, points, mask);
        }
        let mut memory = [PointBlock::EMPTY];
        let mut packed = PointRows::in_blocks(&mut memory, LANES);
        packed.store_compressed(s, 0, points, mask);
        for i in 0..mask.count_ones() as usize {
            self.set(at + i, &packed.get(i));
        }
    }
}

/// What fills the last vector.
pub(in crate::point) const NO_POINT: Item = Item { at: [f32::INFINITY; 3], index: u32::MAX };
