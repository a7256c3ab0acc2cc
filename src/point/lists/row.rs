//! The lists of the points of a block, from the candidates of its group.

use super::columns::Columns;
use super::gather::{BoxRows, Candidates, Picks};
use super::group::Member;
use super::question::Listing;
use super::radii::{Radii, bound_of, squared_radius};
use crate::point::snapshot::{rows, squared};
use crate::simd::{LANES, Lanes, Mask, Simd};

/// Lists in the making, one behind the other.
#[derive(Clone, Debug, Default)]
pub(super) struct Lists {
    pub(super) columns: Columns,
    /// Neighbours so far.
    pub(super) len: usize,
    /// Ids of the points, and where their lists end.
    pub(super) points: Vec<u32>,
    pub(super) ends: Vec<usize>,
    /// Keys of a list to be sorted, and a column on its way.
    keys: Vec<u64>,
    column: Vec<f32>,
}

/// Memory for the lists of a block.
#[derive(Clone, Debug, Default)]
pub(super) struct Near {
    boxes: BoxRows,
    picks: Picks,
}

impl Near {
    pub(super) fn bytes(&self) -> usize {
        self.boxes.bytes() + self.picks.bytes()
    }

    /// Appends the lists of a member of a group.
    #[inline(always)]
    pub(super) fn list<S: Simd>(
        &mut self,
        s: S,
        listing: &Listing,
        member: &Member,
        candidates: &Candidates,
        lists: &mut Lists,
    ) {
        self.boxes.clear();
        for i in 0..candidates.boxes.vectors() {
            let (boxes, there) = candidates.boxes.vector(s, i);
            let near = boxes.near(s, member.lo, member.hi, member.bound) & there;
            if near != 0 {
                self.boxes.push(s, &boxes, near);
            }
        }
        let larger = matches!(listing.radii, Radii::Larger { .. });
        match (candidates.elsewhere, larger, listing.once) {
            (false, false, false) => self.rows::<S, false, false, false>(s, listing, member, candidates, lists),
            (false, false, true) => self.rows::<S, false, false, true>(s, listing, member, candidates, lists),
            (false, true, false) => self.rows::<S, false, true, false>(s, listing, member, candidates, lists),
            (false, true, true) => self.rows::<S, false, true, true>(s, listing, member, candidates, lists),
            (true, false, false) => self.rows::<S, true, false, false>(s, listing, member, candidates, lists),
            (true, false, true) => self.rows::<S, true, false, true>(s, listing, member, candidates, lists),
            (true, true, false) => self.rows::<S, true, true, false>(s, listing, member, candidates, lists),
            (true, true, true) => self.rows::<S, true, true, true>(s, listing, member, candidates, lists),
        }
    }

    /// The same for one kind of question.
    #[inline(always)]
    fn rows<S: Simd, const TORUS: bool, const LARGER: bool, const ONCE: bool>(
        &mut self,
        s: S,
        listing: &Listing,
        member: &Member,
        candidates: &Candidates,
        lists: &mut Lists,
    ) {
        let spots = &member.spots;
        for lane in 0..LANES {
            let at = spots.at.map(|row| row[lane]);
            if at[0] == f32::INFINITY {
                continue;
            }
            let id = spots.id[lane];
            let bound = match listing.radii {
                Radii::Equal(radius) => squared_radius(radius),
                Radii::Own(own) | Radii::Larger { own, .. } => bound_of(own, id),
            };
            let picks = self.picks.near_point(s, &self.boxes, at, bound);
            let begin = lists.len;
            lists.reserve(picks.len() * LANES, listing);
            let point = [s.splat(at[0]), s.splat(at[1]), s.splat(at[2])];
            let own = s.splat_u(if listing.other_set && !ONCE { u32::MAX } else { id });
            let bounds = s.splat(bound);
            for &pick in picks {
                let block = &candidates.blocks[pick as usize];
                let [x, y, z] = rows(s, &block.at);
                let (mut x, mut y, mut z) = (x - point[0], y - point[1], z - point[2]);
                if TORUS {
                    x = listing.torus.nearest(s, x, 0);
                    y = listing.torus.nearest(s, y, 1);
                    z = listing.torus.nearest(s, z, 2);
                }
                let distance = squared::<S>(x, y, z);
                let bounds = if LARGER { s.max(bounds, s.load(&candidates.bounds[pick as usize])) } else { bounds };
                let ids = s.load_u(&block.id);
                let others = if ONCE { s.lt_u(own, ids) } else { !s.eq_u(own, ids) };
                let hits = s.le(distance, bounds) & others;
                lists.push(s, listing, (ids, distance, [x, y, z]), hits);
            }
            if listing.sorted {
                lists.sort(begin, listing);
            }
            lists.points.push(id);
            lists.ends.push(lists.len);
        }
    }
}

impl Lists {
    pub(super) fn clear(&mut self) {
        self.len = 0;
        self.points.clear();
        self.ends.clear();
    }

    pub(super) fn bytes(&self) -> usize {
        self.columns.bytes()
            + self.points.capacity() * 4
            + (self.ends.capacity() + self.keys.capacity()) * 8
            + self.column.capacity() * 4
    }

    /// Makes room for `more` neighbours and a vector.
    #[inline(always)]
    fn reserve(&mut self, more: usize, listing: &Listing) {
        if self.len + more + LANES > self.columns.ids.len() {
            self.grow(more, listing);
        }
        if listing.distances || listing.displacements {
            self.match_columns(listing);
        }
    }

    #[cold]
    fn grow(&mut self, more: usize, listing: &Listing) {
        self.columns.ids.resize(2 * (self.len + more + LANES), 0);
        self.match_columns(listing);
    }

    /// Gives all columns that are asked for the length of the ids.
    fn match_columns(&mut self, listing: &Listing) {
        let size = self.columns.ids.len();
        if listing.distances && self.columns.distances.len() != size {
            self.columns.distances.resize(size, 0.0);
        }
        if listing.displacements && self.columns.displacements[0].len() != size {
            self.columns.displacements.iter_mut().for_each(|column| column.resize(size, 0.0));
        }
    }

    /// Appends the lanes of a mask; there must be room.
    #[inline(always)]
    fn push<S: Simd>(&mut self, s: S, listing: &Listing, (ids, distance, way): (S::U, S::F, [S::F; 3]), hits: Mask) {
        let at = self.len;
        let to: &mut Lanes<u32> = (&mut self.columns.ids[at..at + LANES]).try_into().expect("sixteen");
        s.store_u(s.compress_u(ids, hits), to);
        if listing.distances {
            write(s, &mut self.columns.distances, at, s.compress(distance, hits));
        }
        if listing.displacements {
            let [x, y, z] = &mut self.columns.displacements;
            write(s, x, at, s.compress(way[0], hits));
            write(s, y, at, s.compress(way[1], hits));
            write(s, z, at, s.compress(way[2], hits));
        }
        self.len += hits.count_ones() as usize;
    }

    /// Sorts the list that begins at `begin` and ends the last by id.
    fn sort(&mut self, begin: usize, listing: &Listing) {
        let list = begin..self.len;
        if !listing.distances && !listing.displacements {
            return self.columns.ids[list].sort_unstable();
        }
        self.keys.clear();
        let ids = self.columns.ids[list.clone()].iter();
        self.keys.extend((0..).zip(ids).map(|(place, &id)| u64::from(id) << 32 | place));
        self.keys.sort_unstable();
        for (id, key) in self.columns.ids[list.clone()].iter_mut().zip(&self.keys) {
            *id = (key >> 32) as u32;
        }
        for (asked, column) in listing.columns().into_iter().zip(self.columns.floats()) {
            if asked {
                self.column.clear();
                self.column.extend_from_slice(&column[list.clone()]);
                for (to, key) in column[list.clone()].iter_mut().zip(&self.keys) {
                    *to = self.column[*key as u32 as usize];
                }
            }
        }
    }
}

#[inline(always)]
fn write<S: Simd>(s: S, column: &mut [f32], at: usize, x: S::F) {
    let to: &mut Lanes<f32> = (&mut column[at..at + LANES]).try_into().expect("sixteen");
    s.store(x, to);
}
