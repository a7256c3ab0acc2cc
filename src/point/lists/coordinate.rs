//! How far neighbours are from a point: the arithmetic of single queries, in f32 and in f64.

use super::candidates::Candidates;
use super::gathered_points::{GatheredPoints, GatheredRows};
use super::group::Group;
use super::periodic_box::PeriodicBox;
use crate::point::layout::view::squared;
use crate::simd::{Lanes, Mask, Simd};

/// A number that coordinates are stored in.
pub(super) trait Coordinate: Copy {
    /// No point is there.
    const INFINITY: Self;
    /// The points of a member of a group.
    fn of_member(group: &Group, member: usize) -> &[Lanes<Self>; 3];
    /// The points of a block of candidates.
    fn of_block(candidates: &Candidates, block: usize) -> &[Lanes<Self>; 3];
    /// The points that were gathered.
    fn gathered(points: &GatheredPoints) -> &GatheredRows<Self>;
    /// The same, to be written.
    fn gathered_mut(points: &mut GatheredPoints) -> &mut GatheredRows<Self>;
    /// Writes by how much differences change for images that are so many periods away, as [`Coordinate::store_compressed`] does.
    fn store_shifts<S: Simd>(
        s: S,
        periods: S::F,
        periodic_box: &PeriodicBox,
        axis: usize,
        mask: Mask,
        to: &mut Lanes<Self>,
    );
    /// Writes the lanes of a mask one behind the other, and anything behind them.
    fn store_compressed<S: Simd>(s: S, row: &Lanes<Self>, mask: Mask, to: &mut Lanes<Self>);
    /// Sixteen points seen from one; if `PERIODIC`, their nearest images in a periodic box.
    fn seen<S: Simd, const PERIODIC: bool>(
        s: S,
        rows: [&Lanes<Self>; 3],
        from: [Self; 3],
        periodic_box: &PeriodicBox,
    ) -> Seen<S>;
    /// Sixteen points seen from one, at the images that these shifts lead to.
    fn seen_shifted<S: Simd>(s: S, rows: [&Lanes<Self>; 3], shifts: [&Lanes<Self>; 3], from: [Self; 3]) -> Seen<S>;
    /// Only the squared distances of the points as they are.
    fn squared<S: Simd>(s: S, rows: [&Lanes<Self>; 3], from: [Self; 3]) -> S::F;
}

/// Displacements along the axes, and squared distances.
#[derive(Clone, Copy)]
pub(super) struct Seen<S: Simd> {
    pub(super) displacements: [S::F; 3],
    pub(super) squared: S::F,
}

impl Coordinate for f32 {
    const INFINITY: f32 = f32::INFINITY;

    #[inline(always)]
    fn of_member(group: &Group, member: usize) -> &[Lanes<f32>; 3] {
        &group.members[member].points.at
    }
    #[inline(always)]
    fn of_block(candidates: &Candidates, block: usize) -> &[Lanes<f32>; 3] {
        &candidates.blocks[block].at
    }
    #[inline(always)]
    fn gathered(points: &GatheredPoints) -> &GatheredRows<f32> {
        &points.single
    }
    #[inline(always)]
    fn gathered_mut(points: &mut GatheredPoints) -> &mut GatheredRows<f32> {
        &mut points.single
    }
    #[inline(always)]
    fn store_shifts<S: Simd>(
        s: S,
        periods: S::F,
        periodic_box: &PeriodicBox,
        axis: usize,
        mask: Mask,
        to: &mut Lanes<f32>,
    ) {
        s.store_compressed(periodic_box.shift(s, periods, axis), mask, to);
    }
    #[inline(always)]
    fn store_compressed<S: Simd>(s: S, row: &Lanes<f32>, mask: Mask, to: &mut Lanes<f32>) {
        s.store_compressed(s.load(row), mask, to);
    }
    #[inline(always)]
    fn seen<S: Simd, const PERIODIC: bool>(
        s: S,
        rows: [&Lanes<f32>; 3],
        from: [f32; 3],
        periodic_box: &PeriodicBox,
    ) -> Seen<S> {
        let [mut x, mut y, mut z] = apart(s, rows, from);
        if PERIODIC {
            x = periodic_box.nearest(s, x, 0);
            y = periodic_box.nearest(s, y, 1);
            z = periodic_box.nearest(s, z, 2);
        }
        Seen { displacements: [x, y, z], squared: squared::<S>(x, y, z) }
    }
    #[inline(always)]
    fn seen_shifted<S: Simd>(s: S, rows: [&Lanes<f32>; 3], shifts: [&Lanes<f32>; 3], from: [f32; 3]) -> Seen<S> {
        let [x, y, z] = apart(s, rows, from);
        let (x, y, z) = (x - s.load(shifts[0]), y - s.load(shifts[1]), z - s.load(shifts[2]));
        Seen { displacements: [x, y, z], squared: squared::<S>(x, y, z) }
    }
    #[inline(always)]
    fn squared<S: Simd>(s: S, rows: [&Lanes<f32>; 3], from: [f32; 3]) -> S::F {
        let [x, y, z] = apart(s, rows, from);
        squared::<S>(x, y, z)
    }
}

/// The displacements of points from one.
#[inline(always)]
fn apart<S: Simd>(s: S, rows: [&Lanes<f32>; 3], from: [f32; 3]) -> [S::F; 3] {
    [s.load(rows[0]) - s.splat(from[0]), s.load(rows[1]) - s.splat(from[1]), s.load(rows[2]) - s.splat(from[2])]
}

/// Four points seen from one, from their differences: their squared distances.
#[inline(always)]
fn squared_of_four<S: Simd>([x, y, z]: [[S::D; 4]; 3], four: usize) -> S::D {
    (x[four] * x[four] + y[four] * y[four]) + z[four] * z[four]
}

impl Coordinate for f64 {
    const INFINITY: f64 = f64::INFINITY;

    #[inline(always)]
    fn of_member(group: &Group, member: usize) -> &[Lanes<f64>; 3] {
        &group.double[member].0
    }
    #[inline(always)]
    fn of_block(candidates: &Candidates, block: usize) -> &[Lanes<f64>; 3] {
        &candidates.double[block].0
    }
    #[inline(always)]
    fn gathered(points: &GatheredPoints) -> &GatheredRows<f64> {
        &points.double
    }
    #[inline(always)]
    fn gathered_mut(points: &mut GatheredPoints) -> &mut GatheredRows<f64> {
        &mut points.double
    }
    #[inline(always)]
    fn store_shifts<S: Simd>(
        s: S,
        periods: S::F,
        periodic_box: &PeriodicBox,
        axis: usize,
        mask: Mask,
        to: &mut Lanes<f64>,
    ) {
        s.store_compressed_d(&periodic_box.double_shifts(s, periods, axis), mask, to);
    }
    #[inline(always)]
    fn store_compressed<S: Simd>(s: S, row: &Lanes<f64>, mask: Mask, to: &mut Lanes<f64>) {
        s.store_compressed_d(row, mask, to);
    }
    #[inline(always)]
    fn seen<S: Simd, const PERIODIC: bool>(
        s: S,
        rows: [&Lanes<f64>; 3],
        from: [f64; 3],
        periodic_box: &PeriodicBox,
    ) -> Seen<S> {
        let zero = s.splat_d(0.0);
        let (mut apart, mut squares) = ([[zero; 4]; 3], [zero; 4]);
        for four in 0..4 {
            for axis in 0..3 {
                let d = s.load_d(&rows[axis].as_chunks().0[four]) - s.splat_d(from[axis]);
                apart[axis][four] = if PERIODIC { periodic_box.nearest_double(s, d, axis) } else { d };
            }
            squares[four] = squared_of_four::<S>(apart, four);
        }
        let displacements = [s.narrow_all(apart[0]), s.narrow_all(apart[1]), s.narrow_all(apart[2])];
        Seen { displacements, squared: s.narrow_all(squares) }
    }
    #[inline(always)]
    fn seen_shifted<S: Simd>(s: S, rows: [&Lanes<f64>; 3], shifts: [&Lanes<f64>; 3], from: [f64; 3]) -> Seen<S> {
        let zero = s.splat_d(0.0);
        let (mut apart, mut squares) = ([[zero; 4]; 3], [zero; 4]);
        for four in 0..4 {
            for axis in 0..3 {
                let d = s.load_d(&rows[axis].as_chunks().0[four]) - s.splat_d(from[axis]);
                apart[axis][four] = d - s.load_d(&shifts[axis].as_chunks().0[four]);
            }
            squares[four] = squared_of_four::<S>(apart, four);
        }
        let displacements = [s.narrow_all(apart[0]), s.narrow_all(apart[1]), s.narrow_all(apart[2])];
        Seen { displacements, squared: s.narrow_all(squares) }
    }
    #[inline(always)]
    fn squared<S: Simd>(s: S, [x, y, z]: [&Lanes<f64>; 3], from: [f64; 3]) -> S::F {
        s.squared_distances([x, y, z], from)
    }
}
