//! Dividing points by their motion where several flows pass through each other.
//!
//! A leaf of points that are close together in the middle of a time slice has a large box if they come from different flows: linear
//! faces that hold points on both ways at the ends of the slice are as far apart in its middle. Points of one flow lie farther apart,
//! since only some of the points of a place belong to it, but their leaves stay small. So a tree may divide a range of points by their
//! motion instead of their positions. The cost of both is compared on a sample of the range: the number of leaves that a ball of their
//! size meets, averaged over the slice.
//!
//! Flows also turn, stretch and shear. This is motion that a division by positions takes care of, so motion is considered relative to
//! the affine motion of the range, fitted to the sample by least squares.
//!
//! Compare the choice between axes of position and of velocity in trees of moving points: Tao, Papadias and Sun, "The TPR*-tree", 2003.

use super::point_rows::PointRows;
use crate::simd::{Item, LANES};
use crate::tuning::points::MAX_GROUP_COST;
use glam::{DMat3, DVec3};

/// Writes the displacement of points during a time slice, given their numbers. A number that is `u32::MAX` stands for no point.
pub(super) type Displacements<'a> = &'a (dyn Fn(&[u32], &mut [[f32; 3]]) + Sync);

/// A division by motion.
pub(super) struct MotionDivision {
    /// The key of each point, by which points are divided.
    pub(super) keys: Vec<f32>,
    /// The number of points with the lowest keys.
    pub(super) left: usize,
}

/// Points of the range that are examined, about.
const SAMPLE: usize = 128;

/// The spread of evenly distributed numbers, relative to their standard deviation.
const SPREAD: f64 = 3.4641;

/// The mean size of a box with linear faces around points at one place: half of the spread of their displacements.
const SIZE: f64 = 0.5 * SPREAD;

/// The division by motion of a range of points into subtrees of `block` each; `None` if a division by positions is better.
pub(super) fn divide_by_motion(rows: &PointRows, block: usize, displacements: Displacements<'_>) -> Option<MotionDivision> {
    let count = rows.len();
    let sample = Sample::of(rows, displacements);
    let leaf = sample.leaf(count);
    let whole = sample.whole();
    let apart = cost(leaf, 1.0, whole.spread());
    if MAX_GROUP_COST * apart < cost(leaf, 1.0, DVec3::ZERO) {
        return None;
    }
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        let mut order: Vec<&DVec3> = sample.off.iter().collect();
        order.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
        let (mut low, mut taken) = (Moments::default(), 0);
        for left in (block..count).step_by(block) {
            let share = left as f64 / count as f64;
            let upto = (share * order.len() as f64).round() as usize;
            order[taken..upto].iter().for_each(|off| low.add(**off));
            taken = upto;
            let high = whole.without(&low);
            let cost = share * cost(leaf, share, low.spread()) + (1.0 - share) * cost(leaf, 1.0 - share, high.spread());
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, left));
            }
        }
    }
    let (_, axis, left) = best.filter(|best| best.0 < MAX_GROUP_COST * apart)?;
    Some(MotionDivision { keys: sample.keys(rows, axis, displacements), left })
}

/// The number of leaves that a ball meets, relative to that of the leaves that points have without motion. These are `leaf` long; those of
/// a `share` of the points are larger.
fn cost(leaf: DVec3, share: f64, spread: DVec3) -> f64 {
    // As long as the leaves of points in space or on a surface.
    let ball = leaf.max_element().min(leaf.x + leaf.y + leaf.z - leaf.max_element() - leaf.min_element());
    let size = leaf / share.cbrt() + ball + spread * SIZE;
    size.x * size.y * size.z
}

/// Some of the points of a range.
struct Sample {
    /// Positions relative to `middle`, extents.
    middle: DVec3,
    extent: DVec3,
    /// Displacement of the range, in the middle and by position.
    displacement: DVec3,
    by_position: DMat3,
    /// How far each point is displaced relative to that.
    off: Vec<DVec3>,
}

fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

impl Sample {
    fn of(rows: &PointRows, displacements: Displacements<'_>) -> Sample {
        let step = (rows.len() / SAMPLE).max(1);
        let items = (0..rows.len()).step_by(step).map(|i| rows.get(i)).filter(|item| item.at[0] < f32::INFINITY);
        let items: Vec<Item> = items.collect();
        let numbers: Vec<u32> = items.iter().map(|item| item.index).collect();
        let mut by = vec![[0.0; 3]; items.len()];
        displacements(&numbers, &mut by);
        let points: Vec<(DVec3, DVec3)> = items.iter().zip(by).map(|(item, by)| (wide(item.at), wide(by))).collect();
        let n = points.len() as f64;
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut middle, mut mean) = (DVec3::ZERO, DVec3::ZERO);
        for (at, by) in &points {
            (lo, hi) = (lo.min(*at), hi.max(*at));
            (middle, mean) = (middle + *at / n, mean + *by / n);
        }
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        let (mut squares, mut products) = (DMat3::ZERO, DMat3::ZERO);
        for (at, by) in &points {
            squares += outer(*at - middle, *at - middle);
            products += outer(*by - mean, *at - middle);
        }
        // Where points lie in a plane or a line, the motion across it is taken as zero.
        let extent = hi - lo;
        let least = extent.length_squared() * n * 1e-6 + f64::MIN_POSITIVE;
        let by_position = products * (squares + DMat3::from_diagonal(DVec3::splat(least))).inverse();
        let mut sample = Sample { middle, extent, displacement: mean, by_position, off: Vec::new() };
        sample.off = points.iter().map(|(at, by)| *by - sample.expected(*at)).collect();
        sample
    }

    fn expected(&self, at: DVec3) -> DVec3 {
        self.displacement + self.by_position * (at - self.middle)
    }

    /// How far points are displaced along an axis relative to what is expected.
    fn keys(&self, rows: &PointRows, axis: usize, displacements: Displacements<'_>) -> Vec<f32> {
        let mut by = vec![[0.0; 3]; rows.len()];
        displacements(rows.index, &mut by);
        let by_position = self.by_position.row(axis);
        let constant = self.displacement[axis] - by_position.dot(self.middle);
        let key = |(i, by): (usize, &[f32; 3])| {
            let at = wide(rows.get(i).at);
            // Behind the last point there are infinite ones.
            if at.x < f64::INFINITY { (f64::from(by[axis]) - constant - by_position.dot(at)) as f32 } else { f32::INFINITY }
        };
        by.iter().enumerate().map(key).collect()
    }

    /// The size of the leaves of `count` such points.
    fn leaf(&self, count: usize) -> DVec3 {
        let mut size = self.extent;
        let mut count = count;
        while count > LANES {
            let axis = if size.x >= size.y.max(size.z) { 0 } else if size.y >= size.z { 1 } else { 2 };
            size[axis] *= 0.5;
            count /= 2;
        }
        size
    }

    fn whole(&self) -> Moments {
        let mut all = Moments::default();
        self.off.iter().for_each(|off| all.add(*off));
        all
    }
}

/// Sums of numbers and their squares.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: DVec3,
    squares: DVec3,
}

impl Moments {
    fn add(&mut self, x: DVec3) {
        self.count += 1.0;
        self.sum += x;
        self.squares += x * x;
    }
    fn without(&self, part: &Moments) -> Moments {
        Moments { count: self.count - part.count, sum: self.sum - part.sum, squares: self.squares - part.squares }
    }
    /// The standard deviation.
    fn spread(&self) -> DVec3 {
        if self.count < 1.0 {
            return DVec3::ZERO;
        }
        let mean = self.sum / self.count;
        (self.squares / self.count - mean * mean).max(DVec3::ZERO).map(f64::sqrt)
    }
}
