//! Grids of cells as wide as the radius, sorted by counting, as in particle codes.
//!
//! The peer in vectors is written with intrinsics, which are `unsafe` to call.
#![allow(unsafe_code)]

use mbkd::glam::{IVec3, Vec3};

/// A grid's memory and the lists that it makes.
#[derive(Default)]
pub struct Grid {
    begins: Vec<u32>,
    at: [Vec<f32>; 3],
    id: Vec<u32>,
    pub offsets: Vec<usize>,
    pub points: Vec<u32>,
    pub ids: Vec<u32>,
    /// The number of neighbours; `ids` may be longer.
    pub len: usize,
    near: [Vec<f32>; 3],
    near_id: Vec<u32>,
    low: Vec3,
    scale: f32,
    size: IVec3,
}

/// The greatest number of cells along an axis: wider sets get wider cells.
const MOST: f32 = 400.0;

impl Grid {
    fn cell(&self, p: Vec3) -> IVec3 {
        ((p - self.low) * self.scale).as_ivec3().min(self.size - 1)
    }

    fn number(&self, c: IVec3) -> usize {
        ((c.z * self.size.y + c.y) * self.size.x + c.x) as usize
    }

    fn sort(&mut self, points: &[Vec3], radius: f32) {
        self.low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
        let width = (radius * 1.000_01).max((high - self.low).max_element() / MOST);
        self.scale = 1.0 / width;
        self.size = ((high - self.low) * self.scale).as_ivec3() + 1;
        let cells = (self.size.x * self.size.y * self.size.z) as usize;
        self.begins.clear();
        self.begins.resize(cells + 2, 0);
        // Counted two positions further, so that each count becomes the beginning and then the end of its cell.
        let numbers: Vec<u32> = points.iter().map(|p| self.number(self.cell(*p)) as u32).collect();
        numbers.iter().for_each(|&n| self.begins[n as usize + 2] += 1);
        (1..cells + 2).for_each(|i| self.begins[i] += self.begins[i - 1]);
        for row in &mut self.at {
            row.resize(points.len() + 16, f32::INFINITY);
        }
        self.id.resize(points.len() + 16, u32::MAX);
        for (id, (p, &n)) in points.iter().zip(&numbers).enumerate() {
            let place = &mut self.begins[n as usize + 1];
            for axis in 0..3 {
                self.at[axis][*place as usize] = p[axis];
            }
            self.id[*place as usize] = id as u32;
            *place += 1;
        }
        self.offsets.clear();
        self.points.clear();
        self.ids.clear();
        self.offsets.push(0);
    }

    /// Ranges of sorted points in the rows of cells around a cell.
    fn rows(&self, middle: IVec3) -> impl Iterator<Item = core::ops::Range<usize>> {
        let (first, last) = ((middle - 1).max(IVec3::ZERO), (middle + 1).min(self.size - 1));
        (first.z..=last.z).flat_map(move |z| (first.y..=last.y).map(move |y| (y, z))).map(move |(y, z)| {
            let [begin, end] = [first.x, last.x].map(|x| self.number(IVec3::new(x, y, z)));
            self.begins[begin] as usize..self.begins[end + 1] as usize
        })
    }

    fn place(&self, i: usize) -> Vec3 {
        Vec3::new(self.at[0][i], self.at[1][i], self.at[2][i])
    }

    fn lists(&mut self, square: impl Fn(u32) -> f32) {
        let mut ids = core::mem::take(&mut self.ids);
        for i in 0..self.id.len() - 16 {
            let (p, own) = (self.place(i), self.id[i]);
            let bound = square(own);
            for range in self.rows(self.cell(p)) {
                for j in range {
                    if self.place(j).distance_squared(p) <= bound && self.id[j] != own {
                        ids.push(self.id[j]);
                    }
                }
            }
            self.points.push(own);
            self.offsets.push(ids.len());
        }
        self.len = ids.len();
        self.ids = ids;
    }
}

/// The plain grid: one particle after the other.
pub fn plain(points: &[Vec3], radius: f32, grid: &mut Grid) {
    grid.id.clear();
    grid.at.iter_mut().for_each(Vec::clear);
    grid.sort(points, radius);
    grid.lists(|_| radius * radius);
}

/// The plain grid with a radius for each particle.
pub fn plain_own(points: &[Vec3], own: &[f32], grid: &mut Grid) {
    grid.id.clear();
    grid.at.iter_mut().for_each(Vec::clear);
    grid.sort(points, own.iter().copied().fold(0.0, f32::max));
    grid.lists(|id| own[id as usize] * own[id as usize]);
}

/// Candidates of a cell are copied into rows once, then tested sixteen at a time for each of its particles. Without
/// AVX-512 the plain grid.
pub fn vectors(points: &[Vec3], radius: f32, grid: &mut Grid) {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx512f") {
        grid.id.clear();
        grid.at.iter_mut().for_each(Vec::clear);
        let mut ids = core::mem::take(&mut grid.ids);
        grid.sort(points, radius);
        core::mem::swap(&mut grid.ids, &mut ids);
        // SAFETY: the CPU has the instructions.
        unsafe { lists_avx512(grid, radius) };
        return;
    }
    plain(points, radius, grid);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn lists_avx512(grid: &mut Grid, radius: f32) {
    use core::arch::x86_64::*;
    let bound = _mm512_set1_ps(radius * radius);
    let mut near = core::mem::take(&mut grid.near);
    let mut near_id = core::mem::take(&mut grid.near_id);
    let mut len = 0;
    for z in 0..grid.size.z {
        for y in 0..grid.size.y {
            for x in 0..grid.size.x {
                let cell = IVec3::new(x, y, z);
                let number = grid.number(cell);
                let own = grid.begins[number] as usize..grid.begins[number + 1] as usize;
                if own.is_empty() {
                    continue;
                }
                let mut count = 0;
                for range in grid.rows(cell) {
                    let needed = count + range.len() + 16;
                    if near_id.len() < needed {
                        near.iter_mut().for_each(|row| row.resize(2 * needed, f32::INFINITY));
                        near_id.resize(2 * needed, u32::MAX);
                    }
                    for (to, from) in near.iter_mut().zip(&grid.at) {
                        to[count..count + range.len()].copy_from_slice(&from[range.clone()]);
                    }
                    near_id[count..count + range.len()].copy_from_slice(&grid.id[range.clone()]);
                    count += range.len();
                }
                near[0][count..count + 16].fill(f32::INFINITY);
                for i in own {
                    if grid.ids.len() < len + count + 16 {
                        grid.ids.resize(2 * (len + count + 16), 0);
                    }
                    let at = [0, 1, 2].map(|axis| _mm512_set1_ps(grid.at[axis][i]));
                    let id = _mm512_set1_epi32(grid.id[i] as i32);
                    for first in (0..count).step_by(16) {
                        let there = first..first + 16;
                        // SAFETY: the slices are sixteen long, and there is room for sixteen more ids.
                        unsafe {
                            let [x, y, z] = [0, 1, 2].map(|axis| {
                                _mm512_sub_ps(_mm512_loadu_ps(near[axis][there.clone()].as_ptr()), at[axis])
                            });
                            let square = _mm512_fmadd_ps(z, z, _mm512_fmadd_ps(y, y, _mm512_mul_ps(x, x)));
                            let others = _mm512_loadu_si512(near_id[there].as_ptr().cast());
                            let hits =
                                _mm512_cmp_ps_mask::<_CMP_LE_OQ>(square, bound) & _mm512_cmpneq_epi32_mask(others, id);
                            let packed = _mm512_maskz_compress_epi32(hits, others);
                            _mm512_storeu_si512(grid.ids[len..len + 16].as_mut_ptr().cast(), packed);
                            len += hits.count_ones() as usize;
                        }
                    }
                    grid.points.push(grid.id[i]);
                    grid.offsets.push(len);
                }
            }
        }
    }
    grid.len = len;
    (grid.near, grid.near_id) = (near, near_id);
}
