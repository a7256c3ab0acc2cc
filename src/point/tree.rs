//! The point tree as callers build and query it.

use super::build::automatic::{moving_layers, slices_for_all};
use super::build::layer_request::{ChosenLayer, LayerRequest};
use super::build::source::{Input, Source};
use super::build::static_apart::{Partition, static_apart};
use super::build::time_slices::{double_layer, kd_layer, moving_layer, static_double_layer, time_slices};
use super::error::PointError;
use super::layout::kd_points::KdPoints;
use super::layout::static_tree::StaticTree;
use super::params::{PointParams, PointStructure, Precision};
use super::search::layers::{Layer, LayerView};
use super::statistics::{PointLayerKind, PointLayerStatistics, PointStatistics};
use crate::parallel;
use crate::primitive::PointSet;
use crate::progress::{Callback, Progress};
use crate::simd::{PointBlock, SimdLevel};
use crate::tuning::points::MIN_STATIC_SHARE;
use glam::DVec3;

/// A tree over moving points that answers neighbour queries exactly at any time of the shutter.
///
/// Every answer equals that of comparing all points. The position of a point at time t is interpolated in f32 from the nearer of
/// two keys a and b: with the phase s between them, it is `a + (b - a) * s` if s is below 0.5, and `b + (b - a) * (s - 1)`
/// otherwise. (Of n keys, the phase is the fraction of `t * (n - 1)`.) The squared distance is `(dx·dx + dy·dy) + dz·dz` in f32.
/// Neighbours are ordered by it, ties by id. For positions kept in f64, all of this is computed in f64, and the square is rounded
/// to f32 once. Answers do not depend on the number of threads or the instruction set.
///
/// A query finds nothing if its time is outside [0, 1], if its point is not finite or farther from the origin than
/// [`MAX_POINT_COORDINATE`](crate::MAX_POINT_COORDINATE), or if its radius is negative or NaN. Differences of coordinates below
/// about 1e-19 have squares that are denormal in f32 and lose bits, and below 2e-23 they are zero: such points count as equally
/// far.
///
/// ```
/// use mbkd::{PointParams, PointTree};
/// let points = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let found = tree.nearest_n([0.9f32, 0.0, 0.0], 0.0, 2);
/// assert_eq!([found[0].id, found[1].id], [1, 0]);
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone)]
pub struct PointTree {
    pub(super) origin: DVec3,
    pub(super) simd: SimdLevel,
    /// What it consists of: as a rule one layer, or one of static points and another.
    pub(super) layers: Vec<Layer>,
    pub(super) statistics: PointStatistics,
    pub(super) len: usize,
    /// Whether it is certain that no two points have the same id.
    pub(super) distinct: bool,
}

/// The approximate fraction of a build that reading the input takes.
const READING: f64 = 0.1;

/// The approximate fraction of a build that choosing a structure for points in f64 takes. The trees of the choice are not used.
const PLANNING: f64 = 0.15;

/// Why a tree has only a static layer.
pub(super) const ALL_STATIC: &str = "all points are static";

/// The most trees, one for each time slice of each segment between keys, unless there is one per segment.
const MAX_POINT_TREES: usize = 1 << 14;

impl PointTree {
    /// Selects another instruction set of this CPU for queries, as [`PointParams::simd`] does for a build: of a tree from a file,
    /// which has the widest, or for tests and measurements. Answers do not change.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree, SimdLevel};
    /// let points = [[0.0f32; 3], [1.0; 3]];
    /// let mut tree = PointTree::build(&points, &PointParams::default())?;
    /// for level in SimdLevel::available() {
    ///     tree = tree.with_simd(level);
    ///     assert_eq!(tree.nearest([0.8f32; 3], 0.0).unwrap().id, 1);
    /// }
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn with_simd(self, simd: SimdLevel) -> PointTree {
        PointTree { simd, ..self }
    }

    /// Builds the tree of a set of points: a slice, array or vector of positions (`Vec3`, `DVec3`,
    /// `[f32; 3]`, `[f64; 3]`) or of [`MovingPoint`](crate::MovingPoint)s, [`PointArrays`](crate::PointArrays),
    /// [`PointColumns`](crate::PointColumns), or your own [`PointSet`]. Positions are kept in f32 or f64 as they need it
    /// ([`Precision`]).
    ///
    /// The time is O(n log n). The tree takes 17 or 18 bytes per static point and 31 or more per moving point (in f64: 30
    /// and 55); the build needs two to three times as much. The set is read at the beginning
    /// only. It may be asked for the same position, interval or id several times, and must answer alike. The tree of an
    /// empty set finds nothing.
    ///
    /// # Errors
    /// Coordinates that are not finite or too large, arrays of different length, and parameters out of range.
    pub fn build<P: PointSet + ?Sized>(points: &P, params: &PointParams) -> Result<PointTree, PointError> {
        PointTree::build_reporting(points, params, &Progress::new(None))
    }

    /// [`PointTree::build`] that calls `progress` with the finished fraction (above 0, and at the end 1) from time to time, from
    /// any of its threads. `Break` cancels the build, which then returns [`PointError::Cancelled`].
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{PointError, PointParams, PointTree};
    /// let points: Vec<[f32; 3]> = (0..100_000).map(|i| [i as f32, 0.0, 0.0]).collect();
    /// let stop = |done: f32| if done < 0.5 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    /// let tree = PointTree::build_with_progress(&points, &PointParams::default(), &stop);
    /// assert_eq!(tree.unwrap_err(), PointError::Cancelled);
    /// ```
    ///
    /// # Errors
    /// As [`PointTree::build`]; [`PointError::Cancelled`] if `progress` broke.
    pub fn build_with_progress<P: PointSet + ?Sized>(
        points: &P,
        params: &PointParams,
        progress: Callback<'_>,
    ) -> Result<PointTree, PointError> {
        PointTree::build_reporting(points, params, &Progress::new(Some(progress)))
    }

    pub(super) fn build_reporting<P: PointSet + ?Sized>(
        points: &P,
        params: &PointParams,
        progress: &Progress,
    ) -> Result<PointTree, PointError> {
        parallel::entered(work_of(points), || PointTree::read_and_build(points, params, progress))
    }

    fn read_and_build<P: PointSet + ?Sized>(
        points: &P,
        params: &PointParams,
        progress: &Progress,
    ) -> Result<PointTree, PointError> {
        params.validate()?;
        let read = || {
            progress.finished(READING);
            if progress.cancelled() { Err(PointError::Cancelled) } else { Ok(progress.rest(1.0)) }
        };
        // A cancelled build ends early, with an incomplete tree.
        let tree = match Input::read(points, params.precision)? {
            Input::Static(len, rows) => PointTree::of_static(len, rows, params, &read()?),
            Input::Other(source) => PointTree::of(&source, params, &read()?)?,
        };
        if progress.complete() { Err(PointError::Cancelled) } else { Ok(tree) }
    }

    /// A tree without layers.
    pub(super) fn without_layers(len: usize, origin: DVec3, simd: SimdLevel, distinct: bool) -> PointTree {
        let statistics = PointStatistics::default();
        PointTree { origin, simd, layers: Vec::new(), statistics, len, distinct }
    }

    /// Builds the tree of a static set that was read into rows.
    fn of_static(len: usize, rows: Vec<PointBlock>, params: &PointParams, progress: &Progress) -> PointTree {
        let mut tree = PointTree::without_layers(len, DVec3::ZERO, params.simd, true);
        let layer = Layer::Static(StaticTree::build(len, rows, |index| index, progress));
        tree.add(layer, PointLayerKind::Static, len, ALL_STATIC.into());
        tree
    }

    /// Builds the tree of a set that was read.
    pub(super) fn of(source: &Source, params: &PointParams, progress: &Progress) -> Result<PointTree, PointError> {
        if let PointStructure::TimeSlices(slices @ 2..) = params.structure
            && slices * source.keys.saturating_sub(1) > MAX_POINT_TREES
        {
            let expected = "one with at most 16384 time slices in all, those of each segment between keys";
            return Err(PointError::Parameter { name: "structure", expected });
        }
        if params.structure == PointStructure::Kd && source.is_double() {
            let expected = "one without planes where positions are kept in f64 (or ask for `Precision::Single`)";
            return Err(PointError::Parameter { name: "structure", expected });
        }
        let mut tree = PointTree::without_layers(source.len, source.origin, params.simd, source.ids_are_indices());
        let (partition, len) = (Partition::of(source), source.len);
        let count = partition.static_count;
        let apart = || match params.structure {
            PointStructure::Automatic if source.is_double() => count as f64 >= MIN_STATIC_SHARE * len as f64,
            PointStructure::Automatic => static_apart(source, count, params.simd),
            _ => false,
        };
        if count == len || apart() {
            let progress = progress.rest(count as f64 / len.max(1) as f64);
            let layer = if source.is_double() {
                static_double_layer(source, partition.static_points(), &progress)
            } else {
                Layer::Static(source.static_tree(count, partition.static_points(), &progress))
            };
            let why = if count == len { ALL_STATIC.into() } else { partition.why() };
            tree.add(layer, PointLayerKind::Static, count, in_precision(source, why));
        }
        if count < len {
            let all = tree.layers.is_empty();
            let points = if all { (0..len as u32).collect() } else { partition.moving_points() };
            tree.add_moving((source, &partition), &points, params, progress);
        }
        Ok(tree)
    }

    /// Adds the layers of points that are not in a static one.
    fn add_moving(
        &mut self,
        (source, partition): (&Source, &Partition),
        points: &[u32],
        params: &PointParams,
        progress: &Progress,
    ) {
        let requested = in_precision(source, "as requested".into());
        let (slices, why) = match params.structure.requested_slices() {
            Some(slices) => (slices, requested),
            None if params.structure == PointStructure::Kd => {
                let layer = kd_layer(source, points, params.max_references, progress);
                return self.add(layer, PointLayerKind::Kd, points.len(), requested);
            }
            None if source.is_double() => {
                let (moving, planning) = (partition.moving_points(), progress.rest(PLANNING));
                let (slices, why) = slices_for_all(request_for(source, &moving, params, &planning));
                (slices, format!("{why}; trials used positions rounded to f32"))
            }
            None => {
                let progress = progress.rest(1.0);
                for chosen in moving_layers(request_for(source, points, params, &progress)) {
                    let ChosenLayer { layer, time_slices, points, why } = chosen;
                    self.add(layer, PointLayerKind::Linear { time_slices }, points, why);
                }
                return;
            }
        };
        let layer = if source.is_double() {
            double_layer(source, points, slices, progress)
        } else {
            moving_layer(source, points, &time_slices(source.keys, slices), Vec::new(), progress)
        };
        self.add(layer, PointLayerKind::Linear { time_slices: slices }, points.len(), why);
    }

    pub(super) fn add(&mut self, layer: Layer, kind: PointLayerKind, points: usize, why: String) {
        self.statistics.layers.push(PointLayerStatistics::of(&layer, kind, points, why));
        self.layers.push(layer);
    }

    /// The tree with moving boxes in place of k-d trees between two times; `None` if it has no k-d trees.
    pub(super) fn box_tree(&self, [begin, end]: [f32; 2]) -> Option<PointTree> {
        let between = |tree: &&KdPoints| {
            let interval = tree.slice.interval;
            interval.begin() <= end && begin <= interval.end()
        };
        self.replaced(|layer| match layer {
            Layer::Kd(trees) => Layer::Moving(trees.iter().filter(between).map(KdPoints::box_tree).collect()),
            _ => layer.clone(),
        })
    }

    /// The tree with static boxes in place of k-d trees at a time; `None` if it has no k-d trees.
    pub(super) fn box_tree_at(&self, time: f32) -> Option<PointTree> {
        self.replaced(|layer| match layer.at(DVec3::ZERO, time) {
            LayerView::Kd(view) => Layer::Static(view.tree.static_tree_at(time)),
            _ => layer.clone(),
        })
    }

    /// The tree with its k-d trees replaced; `None` if it has none.
    fn replaced(&self, replacement: impl Fn(&Layer) -> Layer) -> Option<PointTree> {
        if !self.layers.iter().any(|layer| matches!(layer, Layer::Kd(_))) {
            return None;
        }
        let layers = self.layers.iter().map(replacement).collect();
        // The trees of boxes have each point once, as this one does.
        Some(PointTree { layers, statistics: self.statistics.clone(), ..*self })
    }

    /// The numbers that positions are kept in: [`Precision::Single`] or [`Precision::Double`], of an empty tree the former.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree, Precision};
    /// let of = |x: f64| PointTree::build(&[[-x, 0.0, 0.0], [x, 0.0, 0.0]], &PointParams::default());
    /// assert_eq!([of(0.5)?.precision(), of(0.1)?.precision()], [Precision::Single, Precision::Double]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn precision(&self) -> Precision {
        if self.is_double() { Precision::Double } else { Precision::Single }
    }

    /// Whether positions are kept in f64.
    #[inline(always)]
    pub(super) fn is_double(&self) -> bool {
        matches!(self.layers[..], [Layer::Double(_), ..])
    }

    /// What the positions in its layers are relative to.
    pub(super) fn origin_of_positions(&self) -> DVec3 {
        if self.is_double() { DVec3::ZERO } else { self.origin }
    }

    /// The largest number of keys of a layer, at least 1.
    pub(super) fn keys(&self) -> usize {
        self.statistics.layers.iter().map(|layer| layer.keys).max().unwrap_or(1)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The layers of the tree, their sizes, and why they were chosen.
    pub fn statistics(&self) -> &PointStatistics {
        &self.statistics
    }

    /// The position in the caller's coordinates that limits of magnitude and f32 positions are relative to: zero for f32 input, and
    /// for f64 input of which all coordinates are f32 numbers, on both sides of zero; otherwise the middle of the set.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }
}

impl core::fmt::Debug for PointTree {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("PointTree")
            .field("len", &self.len)
            .field("statistics", &self.statistics)
            .finish_non_exhaustive()
    }
}

/// The work of building a tree, in triangles: a static point takes less than an eighth of the time of one.
pub(super) fn work_of<P: PointSet + ?Sized>(points: &P) -> usize {
    if points.keys() == 1 { points.len() / 8 } else { points.len() }
}

/// Why a structure was chosen, and what positions are kept in if that is f64.
fn in_precision(source: &Source, why: String) -> String {
    if source.is_double() { format!("{why}; positions in f64") } else { why }
}

/// What layers of some points of a set are built for.
fn request_for<'a>(
    source: &'a Source,
    points: &'a [u32],
    params: &PointParams,
    progress: &'a Progress<'a>,
) -> LayerRequest<'a> {
    LayerRequest { source, points, max_references: params.max_references, simd: params.simd, progress }
}
