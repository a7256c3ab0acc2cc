//! The order in which the rays of a large batch are answered.
//!
//! Rays of similar direction, as from a camera, are traversed in streams. For other rays on a tree larger than the
//! cache, traversal is fastest where successive rays visit the same nodes. Rays that already come in such an order, as
//! from the pixels of a tile, keep it. All others are sorted: by time slice of the shutter where the tree has one
//! hierarchy per slice, by the grid cell of their origin along the Morton curve, and by the octant of their direction.
//! Answers do not depend on the order.

use crate::geometry::{Aabb, Ray, morton_code};
use crate::parallel;
use crate::simd::fill;
use glam::DVec3;

/// Rays that are sorted together: enough that every cell has several of them, and few enough that buffers stay small.
const WINDOW: usize = 1 << 16;

/// Rays per task.
const CHUNK: usize = 256;

/// The space that origins and times are binned in.
#[derive(Clone, Copy)]
pub(crate) struct Space {
    centre: DVec3,
    /// Scales distances from the centre to at most 1 within the scene.
    scale: f64,
    /// The number of equal time slices of the shutter with a hierarchy each.
    pub slices: usize,
    /// Whether the tree fits the cache, so that sorting incoherent rays does not pay.
    pub cached: bool,
}

impl Space {
    /// The space of a scene with these bounds.
    pub fn new(bounds: Aabb, slices: usize, cached: bool) -> Space {
        let half = bounds.max * 0.5 - bounds.min * 0.5;
        let scale = half.max_element().max(f64::MIN_POSITIVE).recip();
        Space { centre: bounds.min + half, scale, slices, cached }
    }
}

/// The greatest number of time slices that sorting distinguishes.
const MAX_SLICES: usize = 16;

/// The coherence of a batch.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Coherence {
    /// Most rays have nearly the direction of the ray before, as from a camera.
    Direction,
    /// Most rays begin near the origin of the ray before, in the same time slice.
    Origin,
    /// Neither.
    Incoherent,
}

/// The indices of the rays of a task in the caller's batch.
#[derive(Clone, Copy)]
pub(crate) struct Indices<'a> {
    first: usize,
    /// The indices from `first` on, if the rays are sorted.
    order: Option<&'a [u32]>,
}

impl Indices<'_> {
    /// The index of the task's ray `i`.
    #[inline]
    pub fn of(&self, i: usize) -> usize {
        self.first + self.order.map_or(i, |order| order[i] as usize)
    }
}

/// Answers a batch by `fill`, which is told whether the rays of a task have similar directions. Others are sorted first if the tree
/// is larger than the cache.
pub(crate) fn answer_in_order<T: Copy + Send>(
    rays: &[Ray],
    answers: &mut [T],
    space: Space,
    fill: impl Fn(bool, Indices<'_>, &[Ray], &mut [T]) + Sync,
) {
    for (window, (rays, answers)) in rays.chunks(WINDOW).zip(answers.chunks_mut(WINDOW)).enumerate() {
        let window = window * WINDOW;
        let coherence = coherence(rays, space);
        if coherence == Coherence::Incoherent && !space.cached {
            let order = sorted(rays, space);
            let in_order: Vec<Ray> = order.iter().map(|&i| rays[i as usize]).collect();
            let mut found = answers.to_vec();
            in_tasks(&in_order, &mut found, |first, rays, answers| {
                fill(false, Indices { first: window, order: Some(&order[first..]) }, rays, answers);
            });
            for (&i, answer) in order.iter().zip(found) {
                answers[i as usize] = answer;
            }
        } else {
            in_tasks(rays, answers, |first, rays, answers| {
                fill(coherence == Coherence::Direction, Indices { first: window + first, order: None }, rays, answers);
            });
        }
    }
}

/// Answers queries one by one in the given order, in parallel; `one` also gets the index of each. `answers` is cleared
/// first.
pub(crate) fn answer_each<Q: Sync, T: Copy + Default + Send>(
    queries: &[Q],
    answers: &mut Vec<T>,
    one: impl Fn(usize, &Q) -> T + Sync,
) {
    answers.clear();
    answers.resize(queries.len(), T::default());
    in_tasks(queries, answers, |first, queries, answers| {
        for (i, (query, answer)) in queries.iter().zip(answers).enumerate() {
            *answer = one(first + i, query);
        }
    });
}

/// Calls `answer` for each task with the index of its first query, its queries and their answers.
fn in_tasks<Q: Sync, T: Send>(queries: &[Q], answers: &mut [T], answer: impl Fn(usize, &[Q], &mut [T]) + Sync) {
    let mut tasks: Vec<_> = queries.chunks(CHUNK).zip(answers.chunks_mut(CHUNK)).enumerate().collect();
    parallel::each(&mut tasks, |(task, (queries, answers))| answer(*task * CHUNK, queries, answers));
}

/// Estimates the coherence of a batch from a sample of successive pairs.
fn coherence(rays: &[Ray], space: Space) -> Coherence {
    const SAMPLES: usize = 64;
    /// The cosine of about eight degrees. (Not fitted.)
    const SAME_WAY: f32 = 0.99;
    /// A distance in units of half the largest extent of the scene. (Not fitted.)
    const NEAR: f64 = 0.4;
    let step = rays.len().div_ceil(SAMPLES).max(1);
    let (mut together, mut near, mut pairs) = (0, 0, 0);
    for pair in rays.windows(2).step_by(step) {
        let [a, b] = [pair[0], pair[1]];
        let close = (a.origin - b.origin).length() * space.scale < NEAR;
        together += usize::from(a.dir.normalize_or_zero().dot(b.dir.normalize_or_zero()) > SAME_WAY);
        near += usize::from(close && time_slice(&a, space.slices) == time_slice(&b, space.slices));
        pairs += 1;
    }
    if 2 * together > pairs {
        Coherence::Direction
    } else if 2 * near > pairs {
        Coherence::Origin
    } else {
        Coherence::Incoherent
    }
}

/// The time slice that contains the ray's time. (Casts saturate, and NaN becomes 0.)
fn time_slice(ray: &Ray, slices: usize) -> usize {
    let slices = slices.clamp(1, MAX_SLICES);
    ((ray.time * slices as f32) as usize).min(slices - 1)
}

/// The indices of at most [`WINDOW`] rays in the order in which they are answered.
fn sorted(rays: &[Ray], space: Space) -> Vec<u32> {
    /// Bits per coordinate of a cell.
    const BITS: u32 = 4;
    let mut keys = Vec::with_capacity(rays.len());
    fill(&mut keys, rays.len(), |i| {
        let ray = &rays[i];
        let at = ((ray.origin - space.centre) * space.scale + 1.0) * (0.5 * f64::from(1 << BITS));
        let cell = |x: f64| (x as u32).min((1 << BITS) - 1);
        let cell = morton_code([cell(at.x), cell(at.y), cell(at.z)]) as usize;
        let backward = |x: f32| (x.to_bits() >> 31) as usize;
        let octant = backward(ray.dir.x) | backward(ray.dir.y) << 1 | backward(ray.dir.z) << 2;
        (time_slice(ray, space.slices) << (3 * BITS) | cell) << 3 | octant
    });
    let different = space.slices.clamp(1, MAX_SLICES) << (3 * BITS + 3);
    if rays.len() < different / 16 {
        let mut order: Vec<u32> = (0..rays.len() as u32).collect();
        order.sort_unstable_by_key(|&i| (keys[i as usize], i));
        return order;
    }
    // Few keys are possible, so counting sort: each key has an offset.
    let mut begins = vec![0u32; different];
    for &key in &keys {
        begins[key] += 1;
    }
    let mut sum = 0;
    for begin in &mut begins {
        sum += core::mem::replace(begin, sum);
    }
    let mut order = vec![0; rays.len()];
    for (i, &key) in keys.iter().enumerate() {
        order[begins[key] as usize] = i as u32;
        begins[key] += 1;
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const SPACE: Space = Space { centre: DVec3::ZERO, scale: 1.0, slices: 1, cached: false };
    const DIVIDED: Space = Space { slices: 4, ..SPACE };

    fn camera(i: usize) -> Ray {
        Ray::new(Vec3::ZERO, Vec3::new(i as f32 * 1e-3, 1.0, 2.0)).at_time((i % 2) as f32)
    }

    fn near(i: usize) -> Ray {
        let any_way = Vec3::new((i * 31 % 17) as f32 - 8.0, (i % 3) as f32, 1.0);
        Ray::new(Vec3::splat(i as f32 * 1e-3), any_way).at_time((i % 2) as f32)
    }

    fn scattered(i: usize) -> Ray {
        let at = |by: usize| (i * by % 97) as f64 / 48.5 - 1.0;
        Ray { origin: DVec3::new(at(31), at(57), at(89)), ..near(i) }
    }

    #[test]
    fn coherence_is_recognized_and_depends_on_the_time_slices_of_the_tree() {
        for count in [2, 9, 256] {
            let come =
                |ray: &dyn Fn(usize) -> Ray, space: Space| coherence(&(0..count).map(ray).collect::<Vec<_>>(), space);
            assert_eq!((come(&camera, SPACE), come(&camera, DIVIDED)), (Coherence::Direction, Coherence::Direction));
            assert_eq!((come(&near, SPACE), come(&near, DIVIDED)), (Coherence::Origin, Coherence::Incoherent));
            assert_eq!(come(&|i| near(i).at_time(0.5), DIVIDED), Coherence::Origin);
            assert_eq!(
                (come(&scattered, SPACE), come(&scattered, DIVIDED)),
                (Coherence::Incoherent, Coherence::Incoherent)
            );
        }
        let nowhere = Ray { dir: Vec3::NAN, origin: DVec3::NAN, time: f32::NAN, ..camera(0) };
        for few in [&[][..], &[camera(0)], &[nowhere; 4]] {
            assert_ne!(coherence(few, SPACE), Coherence::Direction);
            assert!(sorted(few, DIVIDED).into_iter().eq(0..few.len() as u32));
        }
    }

    #[test]
    fn sorted_rays_are_a_permutation_by_time_slice_with_near_neighbours() {
        // Few, sorted by comparisons, and many, by counting.
        for (count, space) in [(5000, DIVIDED), (5000, SPACE), (20_000, DIVIDED)] {
            let rays: Vec<Ray> = (0..count).map(scattered).collect();
            let order = sorted(&rays, space);
            let mut all = order.clone();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..rays.len() as u32));
            let in_order: Vec<Ray> = order.iter().map(|&i| rays[i as usize]).collect();
            assert!(in_order.is_sorted_by_key(|ray| time_slice(ray, space.slices)));
            let way =
                |rays: &[Ray]| rays.windows(2).map(|pair| (pair[0].origin - pair[1].origin).length()).sum::<f64>();
            assert!(way(&in_order) < 0.3 * way(&rays), "{} instead of {}", way(&in_order), way(&rays));
        }
    }

    #[test]
    fn every_ray_gets_its_own_answer_whatever_the_order() {
        for rays in [near, scattered] {
            let rays: Vec<Ray> = (0..WINDOW + 700).map(|i| rays(i).between(0.0, i as f32)).collect();
            let mut answers = vec![-1.0; rays.len()];
            answer_in_order(&rays, &mut answers, SPACE, |_, indices, rays, answers| {
                for (i, (ray, answer)) in rays.iter().zip(answers).enumerate() {
                    assert_eq!(ray.t_max, indices.of(i) as f32);
                    *answer = ray.t_max;
                }
            });
            assert!(answers.iter().enumerate().all(|(i, &answer)| answer == i as f32));
        }
    }
}
