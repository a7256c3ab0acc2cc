//! Point trees in files.

use super::build::time_slices::{double_time_slices, time_slices};
use super::layout::double_file::DoubleRecord;
use super::layout::kd_file::KdRecord;
use super::layout::moving_file::MovingRecord;
use super::layout::slice_tree::SliceTree;
use super::layout::static_file::StaticRecord;
use super::leaf_order::segment_slice::{SegmentSlice, segments};
use super::search::layers::Layer;
use super::statistics::{PointLayerKind, PointLayerStatistics};
use super::tree::PointTree;
use crate::file::{self, Decoder, Encoder, FileError, FileKind, broken, require};
use crate::limits::{MAX_KEYS, MAX_POINT_TIME_SLICES};
use crate::simd::SimdLevel;
use glam::DVec3;
use std::io::{Read, Write};
use std::path::Path;

/// The numbers of layer kinds in files.
const STATIC: u32 = 0;
const MOVING: u32 = 1;
const KD: u32 = 2;
const DOUBLE: u32 = 3;

/// Why a layer is rejected whose trees have too few or too many points.
const OTHER_POINTS: &str = "the number of points does not match its trees";

/// The contents of a file for the trees of a layer.
enum Trees {
    Static(StaticRecord),
    Moving(Vec<MovingRecord>),
    Kd(Vec<KdRecord>),
    Double(Vec<DoubleRecord>),
}

/// The contents of a file for a layer, not validated yet.
struct LayerRecord {
    /// Number of keys, and of trees for each segment between them.
    keys: usize,
    per_segment: usize,
    points: u64,
    why: Vec<u8>,
    trees: Trees,
}

impl PointTree {
    fn encode(&self, sink: &mut dyn Write) -> Result<(), FileError> {
        file::write(sink, FileKind::Points, |to| {
            to.put(self.origin)?;
            to.put(self.len as u64)?;
            to.put(self.layers.len() as u32)?;
            for (layer, statistics) in self.layers.iter().zip(&self.statistics.layers) {
                encode_layer(to, layer, statistics)?;
            }
            Ok(())
        })
    }

    /// Writes the tree, whatever its structure, with active intervals and ids of its points: about as many bytes as
    /// [`statistics`](PointTree::statistics) reports. They are the same on every machine and for any number of threads of
    /// the build. `docs/files.md` describes the format.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::X), MovingPoint::fixed(Vec3::Y)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut bytes = Vec::new();
    /// tree.write_to(&mut bytes)?;
    /// let again = PointTree::read_from(&mut bytes.as_slice())?;
    /// assert_eq!(again.nearest(Vec3::X, 0.75), tree.nearest(Vec3::X, 0.75));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_to(&self, sink: &mut impl Write) -> Result<(), FileError> {
        self.encode(sink)
    }

    /// [`PointTree::write_to`] a file, which appears under this name once it is complete, and not before: it is written next to it
    /// and then renamed. A symbolic link is followed; a pipe or device is written to directly.
    ///
    /// # Errors
    /// Errors of writing, with the path ([`FileError::At`]).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FileError> {
        file::save(path.as_ref(), |sink| self.encode(sink))
    }

    /// Reads a tree that [`PointTree::write_to`] wrote, and not a byte more. It answers every query as the written tree
    /// did, bit for bit, on any machine; queries run on the widest instruction set of this one.
    ///
    /// # Errors
    /// See [`FileError`]. Damage is found by the checksum. A file that was forged on purpose is rejected
    /// if it could break a search; its answers may be arbitrary.
    pub fn read_from(source: &mut impl Read) -> Result<PointTree, FileError> {
        PointTree::decode(source, None)
    }

    /// [`PointTree::read_from`] a file that holds nothing else. Faster, since the length of a file is known beforehand.
    ///
    /// ```no_run
    /// use mbkd::PointTree;
    /// let tree = PointTree::load("photons.mbkd")?;
    /// println!("{} points: {}", tree.len(), tree.statistics());
    /// # Ok::<(), mbkd::FileError>(())
    /// ```
    ///
    /// # Errors
    /// As [`PointTree::read_from`], with the path ([`FileError::At`]).
    pub fn load(path: impl AsRef<Path>) -> Result<PointTree, FileError> {
        file::load(path.as_ref(), PointTree::decode)
    }

    fn decode(source: &mut dyn Read, length: Option<u64>) -> Result<PointTree, FileError> {
        let raw = |from: &mut Decoder<'_>| {
            let (origin, len, layers) = (from.get::<DVec3>()?, from.get::<u64>()?, from.get::<u32>()?);
            let layers: Vec<LayerRecord> = (0..layers).map(|_| LayerRecord::decode(from)).collect::<Result<_, _>>()?;
            Ok((origin, len, layers))
        };
        Decoder::begin(source, FileKind::Points, length)?
            .whole(raw, |(origin, len, layers)| PointTree::checked(origin, len, layers))
    }

    /// The tree, or an error if searches cannot traverse it.
    fn checked(origin: DVec3, len: u64, layers: Vec<LayerRecord>) -> Result<PointTree, FileError> {
        require(origin.is_finite(), "its origin is not finite")?;
        let all = layers.iter().try_fold(0u64, |sum, layer| sum.checked_add(layer.points));
        require(all == Some(len) && len < u64::from(u32::MAX), "the number of points does not match its layers")?;
        let in_double = layers.iter().filter(|layer| matches!(layer.trees, Trees::Double(_))).count();
        require(in_double == 0 || in_double == layers.len(), "it has points in f32 and in f64")?;
        let mut tree = PointTree::without_layers(len as usize, origin, SimdLevel::best(), false);
        layers.into_iter().try_for_each(|layer| layer.checked(&mut tree))?;
        Ok(tree)
    }
}

/// Writes a layer: a header, and its trees.
fn encode_layer(to: &mut Encoder<'_>, layer: &Layer, statistics: &PointLayerStatistics) -> Result<(), FileError> {
    let number = match layer {
        Layer::Static(_) => STATIC,
        Layer::Moving(_) => MOVING,
        Layer::Kd(_) => KD,
        Layer::Double(_) => DOUBLE,
    };
    let per_segment = match statistics.kind {
        PointLayerKind::Linear { time_slices } => time_slices,
        PointLayerKind::Static | PointLayerKind::Kd => 1,
    };
    let trees = layer.trees();
    to.put([number, statistics.keys as u32, per_segment as u32, trees.len() as u32])?;
    to.put(statistics.points as u64)?;
    to.array(statistics.why.as_bytes())?;
    trees.iter().try_for_each(|tree| tree.encode(to))
}

impl LayerRecord {
    /// Reads a layer; validates only the fields that are needed to continue reading.
    fn decode(from: &mut Decoder<'_>) -> Result<LayerRecord, FileError> {
        let [number, keys, per_segment, trees] = from.get::<[u32; 4]>()?;
        let (points, why) = (from.get()?, from.array()?);
        fn all<T>(
            from: &mut Decoder<'_>,
            trees: u32,
            decode: fn(&mut Decoder<'_>) -> Result<T, FileError>,
        ) -> Result<Vec<T>, FileError> {
            (0..trees).map(|_| decode(from)).collect()
        }
        let trees = match number {
            STATIC => Trees::Static(StaticRecord::decode(from)?),
            MOVING => Trees::Moving(all(from, trees, MovingRecord::decode)?),
            KD => Trees::Kd(all(from, trees, KdRecord::decode)?),
            DOUBLE => Trees::Double(all(from, trees, DoubleRecord::decode)?),
            _ => return broken("it has an unknown structure"),
        };
        Ok(LayerRecord { keys: keys as usize, per_segment: per_segment as usize, points, why, trees })
    }

    /// Adds the layer to a tree, or returns an error if searches cannot traverse it.
    fn checked(self, tree: &mut PointTree) -> Result<(), FileError> {
        let LayerRecord { keys, per_segment, points, why, trees } = self;
        let points = points as usize;
        let Ok(why) = String::from_utf8(why) else { return broken("the reason of a layer is not valid UTF-8") };
        let slices_of = if matches!(trees, Trees::Double(_)) { double_time_slices } else { time_slices };
        let slices = |trees: usize| checked_slices(slices_of, (keys, per_segment), trees);
        match trees {
            Trees::Static(record) => {
                let static_tree = record.checked()?;
                require(points == static_tree.references, OTHER_POINTS)?;
                tree.add(Layer::Static(static_tree), PointLayerKind::Static, points, why);
            }
            Trees::Moving(records) => {
                let trees = checked_trees(slices(records.len())?, records, MovingRecord::checked)?;
                require_points(points, &trees)?;
                tree.add(Layer::Moving(trees), PointLayerKind::Linear { time_slices: per_segment }, points, why);
            }
            Trees::Kd(records) => {
                let trees = checked_trees(slices(records.len())?, records, KdRecord::checked)?;
                require(points <= trees.iter().map(|tree| tree.references).sum(), OTHER_POINTS)?;
                tree.add(Layer::Kd(trees), PointLayerKind::Kd, points, why);
            }
            Trees::Double(records) => {
                let moves = records.iter().any(DoubleRecord::moves);
                let kind =
                    if moves { PointLayerKind::Linear { time_slices: per_segment } } else { PointLayerKind::Static };
                let origin = tree.origin;
                let checked = |record: DoubleRecord, slice| record.checked(slice, origin);
                let trees = checked_trees(slices(records.len())?, records, checked)?;
                require_points(points, &trees)?;
                tree.add(Layer::Double(trees), kind, points, why);
            }
        }
        Ok(())
    }
}

/// The trees of time slices, or an error if searches cannot traverse one of them.
fn checked_trees<R, T>(
    slices: Vec<SegmentSlice>,
    records: Vec<R>,
    checked: impl Fn(R, SegmentSlice) -> Result<T, FileError>,
) -> Result<Vec<T>, FileError> {
    records.into_iter().zip(slices).map(|(record, slice)| checked(record, slice)).collect()
}

/// An error, unless each tree has at most all points, and all trees together have each point at least once.
fn require_points<T: SliceTree>(points: usize, trees: &[T]) -> Result<(), FileError> {
    let counts = || trees.iter().map(|tree| tree.size().references);
    require((counts().max().unwrap_or(0)..=counts().sum()).contains(&points), OTHER_POINTS)
}

/// The time slices of a layer with this many trees, made by `slices_of`.
fn checked_slices(
    slices_of: fn(usize, usize) -> Vec<SegmentSlice>,
    (keys, per_segment): (usize, usize),
    trees: usize,
) -> Result<Vec<SegmentSlice>, FileError> {
    let known = (1..=MAX_KEYS).contains(&keys) && (1..=MAX_POINT_TIME_SLICES).contains(&per_segment);
    // Some slices are so short that they contain no time.
    let few = known && segments(keys) * per_segment <= 8 * trees;
    let slices = if few { slices_of(keys, per_segment) } else { Vec::new() };
    require(few && slices.len() == trees, "the number of trees does not match the time slices")?;
    Ok(slices)
}
