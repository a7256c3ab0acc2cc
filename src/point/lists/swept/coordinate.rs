//! What is different where positions are kept in f32 and in f64: the trees, what is rounded, and the arithmetic of queries at a
//! time.

use crate::geometry::KeyTime;
use crate::point::layout::double_tree::{DoubleTree, between};
use crate::point::layout::moving_tree::MovingTree;
use crate::point::layout::over_interval::{BlockTree, PointPath};
use crate::point::layout::static_tree::StaticTree;
use crate::point::leaf_order::segment_slice::exact_phase;
use crate::point::lists::periodic_box::PeriodicBox;
use crate::point::lists::radii::Allowance;
use crate::point::search::layers::Layer;
use crate::point::tree::PointTree;
use crate::simd::Simd;
use glam::DVec3;

/// What the rounding of a radius and of squared distances allows for: 8·2^-24 of the radius.
const RADIUS_ROUNDING: f64 = 1.0 + 8.0 / 16_777_216.0;

/// Points that one structure holds.
pub(super) enum SweptLayer<'a, C: SweptCoordinate> {
    /// Static points that exist throughout the shutter.
    Static(&'a C::Static),
    /// One tree for each time slice, in the order of time.
    Moving(&'a [C::Moving]),
}

/// A number that positions of moving points are kept in.
pub(super) trait SweptCoordinate: Copy + Default + Into<f64> + Send + Sync {
    /// The trees of static points and of others.
    type Static: BlockTree<Coordinate = Self>;
    type Moving: BlockTree<Coordinate = Self>;

    /// The layers of a tree.
    fn layers(tree: &PointTree) -> Vec<SweptLayer<'_, Self>>;
    /// What the positions near one are measured from.
    fn center(x: f64) -> f64;
    /// The lengths of a periodic box, zero along axes that are not periodic.
    fn lengths(periodic_box: &PeriodicBox) -> [f64; 3];
    /// The displacement between two keys.
    fn displacement(open: Self, close: Self) -> f64;
    /// Four of them side by side.
    fn load_four<S: Simd>(s: S, four: &[Self; 4]) -> S::D;

    /// What [`SweptCoordinate::excess`] has of the magnitude of coordinates, for each segment and one more. Zero where the slack
    /// covers it.
    const OF_MAGNITUDE: f64;
    /// How far beyond the radius, apart from what f32 rounds, two points may be whose encounter is reported: see [`super`].
    /// `motion` is the most by which displacements between two keys differ along an axis.
    fn excess(segments: usize, magnitude: impl FnOnce() -> f64, motion: f64) -> f64;
    /// By how much the distances of points that queries at a time take for within a radius may exceed it, or those of
    /// encounters fall short of the exact ones: see [`Sweep::for_certificate`](super::sweep::Sweep::for_certificate).
    fn rounding(segments: usize, magnitude: f64, motion: f64) -> Allowance;
    /// The distance up to which pairs are excluded by their positions in f32, given that up to which they may be in truth, the
    /// slack of the test, and by how much they move in it before the first time.
    fn excluded_within(distance: f64, slack: f64, moved: f64) -> f64;

    /// The segment between keys in which queries find a time.
    fn segment(time: f32, keys: usize) -> usize;
    /// A time such that queries find all times before it in this segment or one before, and all these are before the later key.
    fn segment_end(segment: usize, keys: usize) -> f32;
    /// The squared distance of two points, of sets with so many keys, as lists at a time compute it.
    fn squared_distance(points: [&PointPath; 2], time: f32, keys: [usize; 2], periodic_box: &PeriodicBox) -> f32;
}

impl SweptCoordinate for f32 {
    type Static = StaticTree;
    type Moving = MovingTree;

    fn layers(tree: &PointTree) -> Vec<SweptLayer<'_, f32>> {
        let layers = tree.layers.iter().filter_map(|layer| match layer {
            Layer::Static(tree) => Some(SweptLayer::Static(tree)),
            Layer::Moving(trees) => Some(SweptLayer::Moving(&trees[..])),
            // See `PointTree::box_tree`.
            Layer::Kd(_) => Some(SweptLayer::Moving(&[])),
            Layer::Double(_) => None,
        });
        layers.collect()
    }
    /// Zero loses no bits.
    fn center(_x: f64) -> f64 {
        0.0
    }
    fn lengths(periodic_box: &PeriodicBox) -> [f64; 3] {
        periodic_box.period.map(f64::from)
    }
    #[inline(always)]
    fn displacement(open: f32, close: f32) -> f64 {
        f64::from(close - open)
    }
    #[inline(always)]
    fn load_four<S: Simd>(s: S, four: &[f32; 4]) -> S::D {
        s.widen_four(four)
    }
    const OF_MAGNITUDE: f64 = 0.0;
    /// The slack covers it.
    fn excess(_segments: usize, _magnitude: impl FnOnce() -> f64, _motion: f64) -> f64 {
        0.0
    }
    fn rounding(segments: usize, magnitude: f64, _motion: f64) -> Allowance {
        Allowance { factor: RADIUS_ROUNDING, sum: (8 * segments + 20) as f64 * magnitude / 16_777_216.0 + 1e-18 }
    }
    #[inline(always)]
    fn excluded_within(distance: f64, _slack: f64, _moved: f64) -> f64 {
        distance
    }
    fn segment(time: f32, keys: usize) -> usize {
        KeyTime::new(time, keys).segment
    }
    fn segment_end(segment: usize, keys: usize) -> f32 {
        // Not the f32 nearest to the key: queries may locate that in the segment before the key, or an earlier one at the key,
        // where a point that begins to exist is not in this segment. The product with the number of segments is rounded, but not to
        // less than an integer that it exceeds. So times that are located before the key are before it.
        KeyTime::first_time(segment + 1, keys)
    }
    fn squared_distance([a, b]: [&PointPath; 2], time: f32, keys: [usize; 2], periodic_box: &PeriodicBox) -> f32 {
        let [at, other_at] = keys.map(|keys| KeyTime::new(time, keys));
        let [x, y, z] = periodic_box.nearest_of_pair((b.position(other_at) - a.position(at)).to_array());
        (x * x + y * y) + z * z
    }
}

impl SweptCoordinate for f64 {
    type Static = DoubleTree;
    type Moving = DoubleTree;

    fn layers(tree: &PointTree) -> Vec<SweptLayer<'_, f64>> {
        let layers = tree.layers.iter().filter_map(|layer| match layer {
            Layer::Double(trees) => Some(match &trees[..] {
                [tree] if !tree.moves() => SweptLayer::Static(tree),
                trees => SweptLayer::Moving(trees),
            }),
            // A tree without points.
            Layer::Static(_) | Layer::Moving(_) | Layer::Kd(_) => None,
        });
        layers.collect()
    }
    fn center(x: f64) -> f64 {
        x
    }
    fn lengths(periodic_box: &PeriodicBox) -> [f64; 3] {
        periodic_box.double_period
    }
    #[inline(always)]
    fn displacement(open: f64, close: f64) -> f64 {
        close - open
    }
    #[inline(always)]
    fn load_four<S: Simd>(s: S, four: &[f64; 4]) -> S::D {
        s.load_d(four)
    }
    const OF_MAGNITUDE: f64 = 1.0 / (1u64 << 47) as f64;
    fn excess(segments: usize, magnitude: impl FnOnce() -> f64, motion: f64) -> f64 {
        (segments + 1) as f64 * magnitude() * Self::OF_MAGNITUDE + motion * 2f64.powi(-22)
    }
    fn rounding(segments: usize, magnitude: f64, motion: f64) -> Allowance {
        Allowance { factor: RADIUS_ROUNDING, sum: f64::excess(segments, || magnitude, motion) + 1e-18 }
    }
    #[inline(always)]
    fn excluded_within(distance: f64, slack: f64, moved: f64) -> f64 {
        distance - slack - moved
    }
    fn segment(time: f32, keys: usize) -> usize {
        let segments = keys.max(2) - 1;
        // The product is exact.
        ((f64::from(time) * segments as f64) as usize).min(segments - 1)
    }
    fn segment_end(segment: usize, keys: usize) -> f32 {
        KeyTime::not_before(segment + 1, keys.max(2))
    }
    fn squared_distance([a, b]: [&PointPath; 2], time: f32, keys: [usize; 2], periodic_box: &PeriodicBox) -> f32 {
        let place = |point: &PointPath, keys: usize| {
            let phase = exact_phase(time, keys, f64::segment(time, keys));
            between([point.open, point.close].map(DVec3::from_array), phase)
        };
        let (a, b) = (place(a, keys[0]), place(b, keys[1]));
        let [x, y, z] = periodic_box.nearest_of_pair_double((b - a).to_array());
        ((x * x + y * y) + z * z) as f32
    }
}
