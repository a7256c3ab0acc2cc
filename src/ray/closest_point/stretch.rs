//! By how much distances count more in some directions of a placed tree: an instance that is scaled differently along its axes, or
//! sheared, is searched in a stretched space, in which distances are those of its images.

use crate::geometry::{Preimage, ULP};
use crate::simd::Simd;
use glam::{DMat3, DVec3, Vec3};

/// A map of vectors that makes none shorter, relative to the direction in which distances shrink most: factors along the axes, or
/// for a shear three rows.
///
/// Factors are less than the true ones by 7 ULP at least, or are 1: more than two products in f32 round up.
#[derive(Clone, Copy)]
pub(super) struct Stretch {
    factors: [f32; 3],
    rows: [Vec3; 3],
    kind: Kind,
    /// [`Stretch::most`], which each leaf block asks for.
    most: f32,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Nothing,
    Axes,
    Shear,
}

/// Greater factors would let squares overflow early, and rule out nothing more in any real scene.
const MOST: f64 = 1e6;

/// By how many ULP a row's product with a vector is off, in f32, relative to the sum of the magnitudes of its terms: one each for
/// the entry, its product and two sums, with a margin.
const PRODUCT_ULPS: f32 = 6.0;

impl Stretch {
    pub const NONE: Stretch = Stretch { factors: [1.0; 3], rows: [Vec3::ZERO; 3], kind: Kind::Nothing, most: 1.0 };

    /// For a placed tree, and the least length of an image per length there, to which the factors are relative.
    pub fn new(of: &Preimage) -> (Stretch, f64) {
        let all = of.least.min_element();
        let factor = |least: f64| match least > all {
            true => ((least / all).min(MOST) * (1.0 - 8.0 * f64::from(ULP))).max(1.0) as f32,
            false => 1.0,
        };
        let factors = of.least.to_array().map(factor);
        let rows = of.shear.map(|shear| shear * all.recip()).filter(|rows| largest(*rows) < MOST);
        let kind = match rows {
            Some(_) => Kind::Shear,
            None if factors == [1.0; 3] => Kind::Nothing,
            None => Kind::Axes,
        };
        let rows = rows.map_or([Vec3::ZERO; 3], rows_of);
        let sheared = 2.0 * rows.iter().map(|row| row.length_squared()).sum::<f32>().sqrt();
        let most = factors.into_iter().fold(sheared, f32::max);
        (Stretch { factors, rows, kind, most }, all)
    }

    /// Factors by which distances along the axes count more at least.
    #[inline(always)]
    pub fn factors(&self) -> [f32; 3] {
        self.factors
    }

    /// By how much lengths grow at most. For a shear it is twice as much, which leaves room for what its products round.
    #[inline(always)]
    pub fn most(&self) -> f32 {
        self.most
    }

    /// By how much the length of a stretched vector is off at most, as computed in f32, relative to that of the vector itself; 0 if
    /// it is only off relative to the stretched length.
    #[inline(always)]
    pub fn rounding(&self) -> f64 {
        if self.kind == Kind::Shear { f64::from(PRODUCT_ULPS * ULP * self.most()) } else { 0.0 }
    }

    /// A stretched vector, but for rounding.
    #[cfg(test)]
    pub fn exactly(&self, by: DVec3) -> DVec3 {
        match self.kind {
            Kind::Shear => DVec3::from(self.rows.map(|row| row.as_dvec3().dot(by))),
            _ => Vec3::from_array(self.factors).as_dvec3() * by,
        }
    }

    /// Stretched vectors.
    #[inline(always)]
    pub fn of<S: Simd>(&self, s: S, [x, y, z]: [S::F; 3]) -> [S::F; 3] {
        match self.kind {
            Kind::Nothing => [x, y, z],
            Kind::Axes => {
                let [a, b, c] = self.factors;
                [x * s.splat(a), y * s.splat(b), z * s.splat(c)]
            }
            Kind::Shear => {
                let [a, b, c] = self.rows;
                [
                    x * s.splat(a.x) + y * s.splat(a.y) + z * s.splat(a.z),
                    y * s.splat(b.y) + z * s.splat(b.z),
                    z * s.splat(c.z),
                ]
            }
        }
    }

    /// The least lengths, along each axis of the stretched space, of vectors that along the axes of the tree's own are at least
    /// `below` and at most the negative of `above`. Negative lengths stand for zero.
    ///
    /// Under a shear, such vectors fill a parallelepiped; these are the distances from zero of the box around it.
    #[inline(always)]
    pub fn gaps<S: Simd>(&self, s: S, below: [S::F; 3], above: [S::F; 3]) -> [S::F; 3] {
        if self.kind == Kind::Shear {
            let x = self.gap::<S, 0>(s, below, above);
            return [x, self.gap::<S, 1>(s, below, above), self.gap::<S, 2>(s, below, above)];
        }
        let mut gaps = below;
        for axis in 0..3 {
            gaps[axis] = s.max(below[axis], above[axis]);
        }
        self.of(s, gaps)
    }

    /// One of the gaps under a shear.
    #[inline(always)]
    fn gap<S: Simd, const AXIS: usize>(&self, s: S, below: [S::F; 3], above: [S::F; 3]) -> S::F {
        let zero = s.splat(0.0);
        let (mut least, mut greatest, mut size) = (zero, zero, zero);
        for along in AXIS..3 {
            // Of the two parts of an entry, one is zero.
            let entry = self.rows[AXIS][along];
            let (up, down) = (s.splat(entry.max(0.0)), s.splat((-entry).max(0.0)));
            let (low, high) = (below[along], above[along]);
            least = least + (up * low + down * high);
            greatest = greatest + (up * high + down * low);
            size = size + (up + down) * s.max(s.max(low, zero - low), s.max(high, zero - high));
        }
        s.max(least, greatest) - s.splat(2.0 * PRODUCT_ULPS * ULP) * size
    }
}

/// The largest entry of an upper triangular matrix.
fn largest(m: DMat3) -> f64 {
    [m.x_axis, m.y_axis, m.z_axis].map(|column| column.abs().max_element()).into_iter().fold(0.0, f64::max)
}

/// The rows of an upper triangular matrix, rounded.
fn rows_of(m: DMat3) -> [Vec3; 3] {
    [m.row(0), m.row(1), m.row(2)].map(DVec3::as_vec3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Aabb, Placement};
    use crate::random::Random;
    use crate::simd::{LANES, Portable};
    use glam::DAffine3;

    /// Boxes of many sizes around and beside zero, in spaces that are sheared more or less: no point of a box is nearer than the
    /// gaps say; small boxes are hardly farther away; and without the margin some points would be nearer.
    #[test]
    fn gaps_of_boxes_in_sheared_spaces_are_lower_bounds() {
        let mut random = Random(5);
        let (mut tested, mut lost, mut lost_without, mut tight) = (0, 0, 0, 0);
        for round in 0..4000 {
            let mut vec = || random.vec().as_dvec3();
            let mut matrix = DAffine3::from_scale(vec() + 1.1);
            matrix.matrix3 = DMat3::from_quat(glam::DQuat::from_scaled_axis(vec())) * matrix.matrix3;
            let by = vec() * [0.3, 3.0, 30.0][round % 3];
            matrix.matrix3.y_axis += matrix.matrix3.x_axis * by.x;
            matrix.matrix3.z_axis += matrix.matrix3.x_axis * by.y + matrix.matrix3.y_axis * by.z;
            let nowhere = Aabb { min: DVec3::ZERO, max: DVec3::ZERO };
            let preimage = Placement::new(matrix).preimage(DVec3::ZERO, nowhere);
            let (stretch, least) = Stretch::new(&preimage);
            if stretch.kind != Kind::Shear {
                continue;
            }
            let (middle, half) = (random.vec(), random.vec().abs() * [1.0, 1e-2, 1e-7][round % 5 % 3]);
            let (low, high) = (middle - half, middle + half);
            let s = Portable;
            let rows = |v: Vec3| v.to_array().map(|x| s.splat(x));
            let gaps = stretch.gaps(s, rows(low), rows(-high)).map(|gap| f64::from(s.lane(gap, LANES - 1)).max(0.0));
            let gap = DVec3::from(gaps).length();
            // A corner alone, without the margin.
            let without = stretch.rows.map(|row| f64::from((low * row).element_sum()));
            lost_without += usize::from(DVec3::from(without).length() > stretch.exactly(low.as_dvec3()).length());
            for i in 0..20 {
                let corner = Vec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
                let inner = low + (high - low) * (random.vec() * 0.5 + 0.5);
                let point = if i < 8 { corner } else { inner.clamp(low, high) }.as_dvec3();
                let image = matrix.transform_vector3(point).length();
                assert!(gap * least <= image * (1.0 + 1e-6), "{gap} {image} {matrix:?}");
                tested += 1;
                lost += usize::from(gap > stretch.exactly(point).length());
                tight += usize::from(gap * least > 0.99 * image);
            }
        }
        assert!(lost == 0 && lost_without > 300, "{lost} {lost_without}");
        assert!(tested > 50_000 && tight * 4 > tested, "{tight} of {tested}");
    }
}
