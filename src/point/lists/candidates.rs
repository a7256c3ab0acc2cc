//! Candidates: the boxes that a group of leaves can reach, and the points in them.

use super::group::{BlockPoints, Group};
use super::list_request::Listing;
use super::radii::{Margin, Radii, radius_of};
use super::reach::Reach;
use crate::point::layout::view::{CoordinateView, DoubleRows, squared};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, first_lanes, lanes_at, lanes_at_mut};
use glam::Vec3;

/// Boxes in rows, each with the candidate it is around and how far the points in it reach.
#[derive(Clone, Debug, Default)]
pub(super) struct BoxRows {
    lo: [Vec<f32>; 3],
    hi: [Vec<f32>; 3],
    /// Largest radius in it; zero where only the radius of the point counts whose list is made.
    reach: Vec<f32>,
    candidate: Vec<u32>,
    len: usize,
}

/// How near boxes have to be.
#[derive(Clone, Copy)]
pub(super) enum Within<'a> {
    /// Within a distance, of which this is the square.
    Squared(f32),
    /// As near as neighbours of points with radii up to this one.
    Radius(&'a Radii<'a>, f32, Margin),
}

impl Within<'_> {
    /// The squared distance up to which boxes are near in which points reach so far. (Sums and squares grow with the radii, rounded
    /// ones too.)
    #[inline(always)]
    fn squared<S: Simd>(self, s: S, reach: S::F) -> S::F {
        match self {
            Within::Squared(bound) => s.splat(bound),
            Within::Radius(radii, radius, margin) => margin.squared(s, radii.joint(s, s.splat(radius), reach)),
        }
    }
}

/// Sixteen boxes.
#[derive(Clone, Copy)]
pub(super) struct BoxVector<S: Simd> {
    pub(super) lo: [S::F; 3],
    pub(super) hi: [S::F; 3],
    pub(super) reach: S::F,
    pub(super) candidate: S::U,
}

impl<S: Simd> BoxVector<S> {
    /// Boxes that may hold neighbours of points in a box `[lo, hi]`.
    #[inline(always)]
    pub(super) fn near(&self, s: S, lo: [f32; 3], hi: [f32; 3], within: Within) -> Mask {
        let (x, y, z) = (self.gap(s, lo, hi, 0), self.gap(s, lo, hi, 1), self.gap(s, lo, hi, 2));
        s.le(squared::<S>(x, y, z), within.squared(s, self.reach))
    }

    /// How far the boxes are from `[lo, hi]` along an axis. Of an infinite side, it is the other that counts.
    #[inline(always)]
    fn gap(&self, s: S, lo: [f32; 3], hi: [f32; 3], axis: usize) -> S::F {
        s.max_with_zero(self.lo[axis] - s.splat(hi[axis]), s.splat(lo[axis]) - self.hi[axis])
    }
}

impl BoxRows {
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Number of vectors that hold all boxes.
    pub(super) fn vectors(&self) -> usize {
        self.len.div_ceil(LANES)
    }

    /// The candidates that the boxes are around.
    pub(super) fn candidates(&self) -> &[u32] {
        &self.candidate[..self.len]
    }

    /// Vector `i`, and which of its lanes are boxes.
    #[inline(always)]
    pub(super) fn vector<S: Simd>(&self, s: S, i: usize) -> (BoxVector<S>, Mask) {
        let at = i * LANES;
        let boxes = BoxVector {
            lo: read(s, &self.lo, at),
            hi: read(s, &self.hi, at),
            reach: s.load(lanes_at(&self.reach, at)),
            candidate: s.load_u(lanes_at(&self.candidate, at)),
        };
        (boxes, first_lanes(self.len - at))
    }

    /// Appends the lanes of a mask.
    #[inline(always)]
    pub(super) fn push<S: Simd>(&mut self, s: S, boxes: &BoxVector<S>, mask: Mask) {
        if self.len + 2 * LANES > self.candidate.len() {
            self.grow();
        }
        let at = self.len;
        for axis in 0..3 {
            write(s, &mut self.lo[axis], at, boxes.lo[axis], mask);
            write(s, &mut self.hi[axis], at, boxes.hi[axis], mask);
        }
        write(s, &mut self.reach, at, boxes.reach, mask);
        s.store_compressed_u(boxes.candidate, mask, lanes_at_mut(&mut self.candidate, at));
        self.len += mask.count_ones() as usize;
    }

    #[cold]
    fn grow(&mut self) {
        let size = 2 * (self.candidate.len() + 4 * LANES);
        for row in self.lo.iter_mut().chain(&mut self.hi).chain([&mut self.reach]) {
            row.resize(size, 0.0);
        }
        self.candidate.resize(size, 0);
    }

    pub(super) fn bytes(&self) -> usize {
        let rows = self.lo.iter().chain(&self.hi).chain([&self.reach]);
        4 * (rows.map(Vec::capacity).sum::<usize>() + self.candidate.capacity())
    }
}

#[inline(always)]
fn read<S: Simd>(s: S, rows: &[Vec<f32>; 3], at: usize) -> [S::F; 3] {
    [s.load(lanes_at(&rows[0], at)), s.load(lanes_at(&rows[1], at)), s.load(lanes_at(&rows[2], at))]
}

/// Writes the lanes of a mask to index `at` and on, and anything to the rest of a vector there.
#[inline(always)]
pub(super) fn write<S: Simd>(s: S, column: &mut [f32], at: usize, x: S::F, mask: Mask) {
    s.store_compressed(x, mask, lanes_at_mut(column, at));
}

/// All that a group can reach. Box i is around block i.
#[derive(Clone, Debug, Default)]
pub(super) struct Candidates {
    /// Where the tree has them, not at their nearest images.
    pub(super) boxes: BoxRows,
    pub(super) blocks: Vec<BlockPoints>,
    /// Their positions in f64, where those are rounded.
    pub(super) double: Vec<DoubleRows>,
    /// Radii of the points in the blocks, where these count.
    pub(super) radii: Vec<Lanes<f32>>,
    /// Whether the nearest image of any candidate is a wrapped one for any point of the group.
    pub(super) wrapped: bool,
    /// Which candidates these are, sixteen in each mask; empty where nothing is periodic.
    wrapped_ones: Vec<Mask>,
    /// Nodes still to be visited: level and number.
    open: Vec<(usize, usize)>,
}

impl Candidates {
    pub(super) fn clear(&mut self) {
        self.boxes.clear();
        self.blocks.clear();
        self.double.clear();
        self.radii.clear();
        self.wrapped = false;
        self.wrapped_ones.clear();
    }

    /// Whether the nearest image of a candidate, in a group with any such, is a wrapped one for any point of the group.
    #[inline(always)]
    pub(super) fn is_wrapped(&self, candidate: usize) -> bool {
        self.wrapped_ones[candidate / LANES] >> (candidate % LANES) & 1 != 0
    }

    /// Whether that holds for any candidate in vector `i` of the boxes.
    #[inline(always)]
    pub(super) fn is_any_wrapped(&self, i: usize) -> bool {
        self.wrapped_ones[i] != 0
    }

    pub(super) fn bytes(&self) -> usize {
        self.boxes.bytes()
            + self.blocks.capacity() * size_of::<BlockPoints>()
            + self.double.capacity() * size_of::<DoubleRows>()
            + self.radii.capacity() * size_of::<Lanes<f32>>()
            + self.wrapped_ones.capacity() * size_of::<Mask>()
            + self.open.capacity() * size_of::<(usize, usize)>()
    }

    /// Marks the candidates from `begin` on, which are lanes of a mask, some of them wrapped: see [`Candidates::is_wrapped`].
    fn mark(&mut self, begin: usize, mut lanes: Mask, wrapped: Mask) {
        self.wrapped_ones.resize(self.blocks.len().div_ceil(LANES), 0);
        for candidate in begin..self.blocks.len() {
            let bit = wrapped >> lanes.trailing_zeros() & 1;
            self.wrapped_ones[candidate / LANES] |= bit << (candidate % LANES);
            lanes &= lanes - 1;
        }
    }
}

/// Adds what a group can reach in a view, or what can reach the group. Stops with `false` once there are more blocks than `most`.
pub(super) struct AddCandidates<'a, V> {
    pub(super) view: V,
    pub(super) candidates: &'a mut Candidates,
    pub(super) group: &'a Group,
    pub(super) listing: &'a Listing<'a>,
    pub(super) reach: Option<&'a Reach>,
    pub(super) most: usize,
}

impl<V: CoordinateView> Kernel for AddCandidates<'_, V> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let AddCandidates { view, candidates, group, listing: Listing { radii, periodic_box, .. }, reach, most } = self;
        let target = view.target(s, Vec3::ZERO);
        let within = Within::Radius(radii, group.radius, group.margin);
        candidates.open.clear();
        candidates.open.push(view.root());
        while let Some((level, node)) = candidates.open.pop() {
            let (lo, hi) = view.faces(s, &target, node);
            let mut boxes = BoxVector::<S> { lo, hi, reach: s.splat(0.0), candidate: s.splat_u(0) };
            let present = s.le(lo[0], hi[0]);
            if let Some(reach) = reach {
                boxes.reach = s.load(&reach.nodes[node]);
            }
            let (mut near, wrapped);
            if periodic_box.any {
                let moved = periodic_box.wrap(s, (lo, hi), (group.lo, group.hi));
                let images = BoxVector { lo: moved.lo, hi: moved.hi, ..boxes };
                near = images.near(s, group.lo, group.hi, within) & present;
                wrapped = near & moved.wrapped;
                candidates.wrapped |= level == 0 && wrapped != 0;
            } else {
                near = boxes.near(s, group.lo, group.hi, within) & present;
                wrapped = 0;
            }
            if level > 0 {
                let first = view.first_child(level, node);
                while near != 0 {
                    // The first lane is popped first.
                    let lane = Mask::BITS - 1 - near.leading_zeros();
                    near ^= 1 << lane;
                    candidates.open.push((level - 1, first + lane as usize));
                }
                continue;
            }
            let (first, stride) = (view.first_block(node), view.leaf_blocks());
            for part in 0..stride {
                let base = candidates.blocks.len() as u32;
                let mut number = [0; LANES];
                let mut rest = near;
                while rest != 0 {
                    let lane = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    number[lane] = candidates.blocks.len() as u32;
                    let block = first + lane * stride + part;
                    let points = BlockPoints::of_block(s, &view, &target, block);
                    candidates.double.extend(view.double_positions(s, block));
                    if let Some(others) = radii.others() {
                        let mut radii = [0.0; LANES];
                        for (radius, &id) in radii.iter_mut().zip(&points.id) {
                            *radius = radius_of(others, id);
                        }
                        candidates.radii.push(radii);
                    }
                    candidates.blocks.push(points);
                }
                debug_assert_eq!(candidates.blocks.len() as u32 - base, near.count_ones());
                if periodic_box.any {
                    candidates.mark(base as usize, near, wrapped);
                }
                candidates.boxes.push(s, &BoxVector { candidate: s.load_u(&number), ..boxes }, near);
            }
            if candidates.blocks.len() > most {
                return false;
            }
        }
        true
    }
}

/// The indices of the candidates that are near enough, filled without a branch.
#[derive(Clone, Debug, Default)]
pub(super) struct Selection {
    list: Vec<u32>,
}

impl Selection {
    /// The candidates whose boxes are near a box.
    #[inline(always)]
    pub(super) fn near<S: Simd>(
        &mut self,
        s: S,
        boxes: &BoxRows,
        (lo, hi): ([f32; 3], [f32; 3]),
        within: Within,
    ) -> &[u32] {
        let vectors = boxes.vectors();
        if self.list.len() < (vectors + 1) * LANES {
            self.list.resize((vectors + 1) * LANES, 0);
        }
        let (list, mut len) = (&mut self.list[..], 0);
        for i in 0..vectors {
            let (vector, valid) = boxes.vector(s, i);
            let near = vector.near(s, lo, hi, within) & valid;
            s.store_compressed_u(vector.candidate, near, lanes_at_mut(list, len));
            len += near.count_ones() as usize;
        }
        &self.list[..len]
    }

    pub(super) fn bytes(&self) -> usize {
        4 * self.list.capacity()
    }
}
