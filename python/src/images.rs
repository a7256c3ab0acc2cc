//! Periodic boxes: a query in a periodic box runs as queries of its images among the points themselves.
//!
//! The distance to a point is that to its nearest image, as in scipy. Images of the query are searched in the order of their
//! distance from the box around all points, until the remaining images are farther away than the answer.

use mbkd::{Neighbor, NeighborBuffer, PointTree};

/// A box that is periodic along some axes.
pub struct Periods {
    /// The period along each axis; 0 if the axis is not periodic.
    pub lengths: [f64; 3],
    /// The box around all points over the whole shutter.
    pub bounds: [[f64; 3]; 2],
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
        Ok((lengths != [0.0; 3]).then_some(Periods { lengths, bounds }))
    }

    /// The periods in the form that neighbour lists take.
    pub fn for_lists(&self) -> [Option<f64>; 3] {
        self.lengths.map(|length| (length > 0.0).then_some(length))
    }

    /// Whether both boxes have the same periods.
    pub fn same(&self, other: &Periods) -> bool {
        self.lengths == other.lengths
    }

    /// The images of a place to which some point may be nearest, and their squared distances from the box, nearest
    /// first.
    fn images(&self, place: [f64; 3]) -> Vec<(f64, [f64; 3])> {
        let mut images = vec![(0.0, place)];
        for axis in 0..3 {
            let ([lo, hi], length) = (self.bounds.map(|corner| corner[axis]), self.lengths[axis]);
            let mut next = Vec::new();
            for (distance, image) in images {
                let home = if length > 0.0 { image[axis].rem_euclid(length) } else { image[axis] };
                let (first, last) = match length > 0.0 && lo <= hi {
                    true => (((lo - home) / length).floor() as i32, ((hi - home) / length).ceil() as i32),
                    false => (0, 0),
                };
                for shift in first..=last {
                    let mut image = image;
                    image[axis] = home + f64::from(shift) * length;
                    let outside = (lo - image[axis]).max(image[axis] - hi).max(0.0);
                    next.push((distance + outside * outside, image));
                }
            }
            images = next;
        }
        images.sort_by(|a, b| a.0.total_cmp(&b.0));
        images
    }

    /// Adds the neighbours of all images to `found`, each point once, in the order of (distance, id): the `k` nearest,
    /// or all within the radius.
    pub fn neighbors(
        &self,
        tree: &PointTree,
        (place, time): ([f64; 3], f32),
        (radius, eps): (f32, f32),
        k: Option<usize>,
        buffer: &mut NeighborBuffer,
        found: &mut Vec<Neighbor>,
    ) {
        let begin = found.len();
        let mut bound = f64::from(radius) * f64::from(radius);
        for (distance, image) in self.images(place) {
            // Lowered by more than the rounding of images and distances in f32.
            if distance * (1.0 - 1e-5) > bound {
                break;
            }
            let query = tree.query(image, time).radius(radius).approximate(eps);
            found.extend_from_slice(match k {
                Some(k) => query.nearest_n_into(k, buffer),
                None => query.collect_into(buffer),
            });
            let k = k.unwrap_or(usize::MAX);
            let all = &mut found[begin..];
            all.sort_unstable_by(|a, b| {
                (a.id, a.distance_squared)
                    .partial_cmp(&(b.id, b.distance_squared))
                    .unwrap_or(core::cmp::Ordering::Equal)
            });
            let mut kept = begin;
            for i in begin..found.len() {
                if kept == begin || found[kept - 1].id != found[i].id {
                    found[kept] = found[i];
                    kept += 1;
                }
            }
            found.truncate(kept);
            found[begin..]
                .sort_unstable_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
            found.truncate(begin.saturating_add(k));
            if let Some(last) = found[begin..].get(k.wrapping_sub(1)) {
                bound = bound.min(last.distance_squared.into());
            }
        }
    }
}
