//! Periodic boxes: a query in a periodic box runs as queries of its images among the points themselves.
//!
//! The distance to a point is that to its nearest image, as in scipy. Only images are searched from which the box around all
//! points is within reach. Most queries have one, as their neighbours are nearer than the faces of the box.

use core::ops::RangeInclusive;
use mbkd::{Neighbor, NeighborBuffer, PointTree};

/// A box that is periodic along some axes.
pub struct Periods {
    /// The period along each axis; 0 if the axis is not periodic.
    pub lengths: [f64; 3],
    /// The box around all points over the whole shutter.
    pub bounds: [[f64; 3]; 2],
    /// Up to this radius, no point is within reach of two images.
    apart: f64,
}

/// Memory of queries in periodic boxes.
#[derive(Default)]
pub struct Memory {
    buffer: NeighborBuffer,
    images: Vec<Image>,
    ids: Vec<i32>,
}

/// An image of a query.
struct Image {
    place: [f64; 3],
    /// The squared distance from the box around all points.
    distance: f64,
}

/// The greatest number of images along an axis, on either side of the query.
const MOST: f64 = 4.0;

impl Periods {
    /// `None` if no axis is periodic. `bounds` are those of all points over the whole shutter.
    pub fn new(lengths: [f64; 3], bounds: [[f64; 3]; 2]) -> Result<Option<Periods>, String> {
        if let Some(length) = lengths.iter().find(|length| !(**length >= 0.0 && length.is_finite())) {
            return Err(format!(
                "boxsize must be positive, or 0 or infinite for axes that are not periodic, not {length}"
            ));
        }
        for axis in (0..3).filter(|&axis| lengths[axis] > 0.0) {
            let [lo, hi] = bounds.map(|corner| corner[axis]);
            let most = MOST * lengths[axis];
            if lo < -most || hi > most {
                return Err(format!(
                    "points are more than {MOST} periods away from the periodic box along axis {axis}"
                ));
            }
        }
        let shortest = lengths.iter().copied().filter(|length| *length > 0.0).fold(f64::INFINITY, f64::min);
        // Below half a period by more than the rounding of images and distances in f32, and of squares that are denormal.
        let apart = 0.4999 * shortest - 1e-18;
        Ok((lengths != [0.0; 3]).then_some(Periods { lengths, bounds, apart }))
    }

    /// The periods in the form that neighbour lists take.
    pub fn for_lists(&self) -> [Option<f64>; 3] {
        self.lengths.map(|length| (length > 0.0).then_some(length))
    }

    /// Whether both boxes have the same periods.
    pub fn same(&self, other: &Periods) -> bool {
        self.lengths == other.lengths
    }

    /// Appends the `k` nearest points within the radius, in the order of (distance, id).
    pub fn nearest(
        &self,
        tree: &PointTree,
        (place, time): ([f64; 3], f32),
        (radius, eps): (f32, f32),
        k: usize,
        Memory { buffer, images, .. }: &mut Memory,
        found: &mut Vec<Neighbor>,
    ) {
        let home = self.home(place);
        let (begin, mut bound, mut reach) = (found.len(), square(radius), radius);
        // Appends what is nearer from an image; updates the bound.
        let mut search = |image: [f64; 3], bound: &mut f64| {
            let query = tree.query(image, time).radius(reach).approximate(eps);
            match (k, found.get_mut(begin)) {
                (1, Some(best)) => {
                    let order = |near: Neighbor| (near.distance_squared, near.id);
                    if let Some(near) = query.nearest().filter(|near| order(*near) < order(*best)) {
                        *best = near;
                    }
                }
                (1, None) => found.extend(query.nearest()),
                (_, before) => {
                    let first = before.is_none();
                    let near = query.nearest_n_into(k, buffer);
                    found.extend_from_slice(near);
                    if !first && !near.is_empty() {
                        if bound.sqrt() > self.apart {
                            let order = |near: &Neighbor| (near.id, near.distance_squared.to_bits());
                            found[begin..].sort_unstable_by_key(order);
                            keep_first(found, begin, |near| near.id);
                        }
                        let order = |near: &Neighbor| (near.distance_squared.to_bits(), near.id);
                        found[begin..].sort_unstable_by_key(order);
                        found.truncate(begin.saturating_add(k));
                    }
                }
            }
            if let Some(last) = found[begin..].get(k.wrapping_sub(1)) {
                *bound = bound.min(last.distance_squared.into());
                // The square of the next number is not less than the bound, so ties are found.
                reach = reach.min(last.distance_squared.sqrt().next_up());
            }
        };
        let first = self.nearest_image(home);
        if is_beyond(first.distance, bound) {
            return;
        }
        search(first.place, &mut bound);
        if first.place == home && self.has_only(home, bound) {
            return;
        }
        self.images_within(home, bound, images);
        images.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        for image in images.iter().filter(|image| image.place != first.place) {
            if is_beyond(image.distance, bound) {
                break;
            }
            search(image.place, &mut bound);
        }
    }

    /// Appends the ids of all points within the radius, each once, in no particular order.
    pub fn within(
        &self,
        tree: &PointTree,
        (place, time): ([f64; 3], f32),
        radius: f32,
        Memory { buffer, images, .. }: &mut Memory,
        ids: &mut Vec<i32>,
    ) {
        let begin = ids.len();
        self.images_within(self.home(place), square(radius), images);
        for image in &*images {
            let near = tree.query(image.place, time).radius(radius).collect_into(buffer);
            ids.extend(near.iter().map(|near| near.id as i32));
        }
        if images.len() > 1 && f64::from(radius) > self.apart {
            ids[begin..].sort_unstable();
            keep_first(ids, begin, |id| *id);
        }
    }

    /// The number of points within the radius.
    pub fn count(&self, tree: &PointTree, at: ([f64; 3], f32), radius: f32, memory: &mut Memory) -> usize {
        let (place, time) = at;
        let images = &mut memory.images;
        self.images_within(self.home(place), square(radius), images);
        if images.len() > 1 && f64::from(radius) > self.apart {
            let mut ids = core::mem::take(&mut memory.ids);
            ids.clear();
            self.within(tree, at, radius, memory, &mut ids);
            memory.ids = ids;
            return memory.ids.len();
        }
        images.iter().map(|image| tree.query(image.place, time).radius(radius).count()).sum()
    }

    /// The image of a place that lies in the periodic box.
    #[inline]
    fn home(&self, mut place: [f64; 3]) -> [f64; 3] {
        for (x, &length) in place.iter_mut().zip(&self.lengths) {
            // Most places are there already, and the remainder is slow.
            if length > 0.0 && !(0.0..length).contains(x) {
                *x = x.rem_euclid(length);
            }
        }
        place
    }

    /// The squared distance of a coordinate from the box around all points.
    #[inline]
    fn outside(&self, axis: usize, x: f64) -> f64 {
        let far = (self.bounds[0][axis] - x).max(x - self.bounds[1][axis]).max(0.0);
        far * far
    }

    /// Whether a place of the periodic box has no other image along an axis from which the bound reaches a point.
    #[inline]
    fn is_only(&self, axis: usize, home: f64, bound: f64) -> bool {
        let (lo, hi, length) = (self.bounds[0][axis], self.bounds[1][axis], self.lengths[axis]);
        let gap = (lo - (home - length)).min(home + length - hi);
        length <= 0.0 || gap > 0.0 && is_beyond(gap * gap, bound)
    }

    /// The same along all axes.
    #[inline]
    fn has_only(&self, home: [f64; 3], bound: f64) -> bool {
        self.is_only(0, home[0], bound) && self.is_only(1, home[1], bound) && self.is_only(2, home[2], bound)
    }

    /// The images along an axis to which some point may be nearest and within the bound: from how many periods before the place to
    /// how many after it. Some are beyond the bound.
    #[inline]
    fn along(&self, axis: usize, home: f64, bound: f64) -> RangeInclusive<i32> {
        let (lo, hi, length) = (self.bounds[0][axis], self.bounds[1][axis], self.lengths[axis]);
        if lo > hi || self.is_only(axis, home, bound) {
            return 0..=0;
        }
        floor((lo - home) / length)..=-floor((home - hi) / length)
    }

    /// The image so many periods from a place along an axis, and its squared distance from the box around all points.
    #[inline]
    fn image(&self, axis: usize, home: f64, periods: i32) -> (f64, f64) {
        let x = home + f64::from(periods) * self.lengths[axis];
        (x, self.outside(axis, x))
    }

    /// The image that is nearest to the box around all points.
    #[inline]
    fn nearest_image(&self, home: [f64; 3]) -> Image {
        let mut nearest = Image { place: home, distance: 0.0 };
        for (axis, &home) in home.iter().enumerate() {
            let mut least = self.outside(axis, home);
            if least > 0.0 {
                for periods in self.along(axis, home, f64::INFINITY) {
                    let (x, distance) = self.image(axis, home, periods);
                    if distance < least {
                        (nearest.place[axis], least) = (x, distance);
                    }
                }
            }
            nearest.distance += least;
        }
        nearest
    }

    /// The images to which some point may be nearest and within the bound.
    #[inline]
    fn images_within(&self, home: [f64; 3], bound: f64, images: &mut Vec<Image>) {
        images.clear();
        let mut add = |place, distance| {
            if !is_beyond(distance, bound) {
                images.push(Image { place, distance });
            }
        };
        if self.has_only(home, bound) {
            return add(home, self.outside(0, home[0]) + self.outside(1, home[1]) + self.outside(2, home[2]));
        }
        let [ys, zs] = [1, 2].map(|axis| self.along(axis, home[axis], bound));
        for periods in self.along(0, home[0], bound) {
            let (x, far_x) = self.image(0, home[0], periods);
            if is_beyond(far_x, bound) {
                continue;
            }
            for periods in ys.clone() {
                let (y, far_y) = self.image(1, home[1], periods);
                if is_beyond(far_x + far_y, bound) {
                    continue;
                }
                for periods in zs.clone() {
                    let (z, far_z) = self.image(2, home[2], periods);
                    add([x, y, z], far_x + far_y + far_z);
                }
            }
        }
    }
}

/// Whether a squared distance from the box around all points is more than the bound of those that count, by more than the
/// rounding of images and distances in f32.
#[inline]
fn is_beyond(distance: f64, bound: f64) -> bool {
    distance * (1.0 - 1e-5) > bound
}

/// The square of a radius, exactly.
#[inline]
fn square(radius: f32) -> f64 {
    f64::from(radius) * f64::from(radius)
}

/// The greatest whole number that is not above `x`. That of the standard library is a call, as SSE2 has no instruction for it.
#[inline]
fn floor(x: f64) -> i32 {
    let whole = x as i32;
    whole - i32::from(f64::from(whole) > x)
}

/// Keeps the first of equal neighbours in the elements from `begin` on.
fn keep_first<T: Copy, K: PartialEq>(all: &mut Vec<T>, begin: usize, key: impl Fn(&T) -> K) {
    let mut kept = begin;
    for i in begin..all.len() {
        if kept == begin || key(&all[kept - 1]) != key(&all[i]) {
            all[kept] = all[i];
            kept += 1;
        }
    }
    all.truncate(kept);
}
