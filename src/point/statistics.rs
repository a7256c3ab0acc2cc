//! Statistics of a point tree: its layers, their sizes, and why they were chosen.

use super::search::layers::Layer;
use core::fmt;

/// The structure of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PointLayerKind {
    /// The complete static tree.
    Static,
    /// Moving trees with linear boxes, one for each time slice.
    Linear {
        /// Number of time slices of each segment between keys.
        time_slices: usize,
    },
    /// The paper's k-d tree, one for each segment between keys: points that cross a plane are on both sides of it.
    Kd,
}

/// One layer of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct PointLayerStatistics {
    /// The structure.
    pub kind: PointLayerKind,
    /// Points in it.
    pub points: usize,
    /// References to them: more than points if points cross planes or are in several trees.
    pub references: usize,
    /// Nodes: of sixteen boxes each, or planes in a k-d tree.
    pub nodes: usize,
    /// Levels of nodes of the deepest tree.
    pub levels: usize,
    /// Keys that are kept: not those on straight lines between others, and one key for static points.
    pub keys: usize,
    /// Bytes allocated.
    pub bytes: usize,
    /// Why this structure was chosen, in a sentence.
    pub why: String,
}

impl PointLayerStatistics {
    pub(super) fn of(layer: &Layer, kind: PointLayerKind, points: usize, why: String) -> Self {
        let trees = layer.trees();
        let sizes: Vec<_> = trees.iter().map(|tree| tree.size()).collect();
        PointLayerStatistics {
            kind,
            points,
            references: sizes.iter().map(|size| size.references).sum(),
            nodes: sizes.iter().map(|size| size.nodes).sum(),
            levels: sizes.iter().map(|size| size.levels).max().unwrap_or(0),
            keys: trees.first().map_or(1, |tree| tree.slice().keys),
            bytes: sizes.iter().map(|size| size.bytes).sum(),
            why,
        }
    }
}

/// The layers of a point tree. Printed with `{}`, there is a line for each of them.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PointStatistics {
    /// The layers, in the order in which they are searched.
    pub layers: Vec<PointLayerStatistics>,
}

impl PointStatistics {
    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.layers.iter().map(|layer| layer.bytes).sum()
    }

    /// References per point; 1 if nothing is duplicated, 0 without points.
    pub fn references_per_point(&self) -> f64 {
        let points: usize = self.layers.iter().map(|layer| layer.points).sum();
        let references: usize = self.layers.iter().map(|layer| layer.references).sum();
        references as f64 / points.max(1) as f64
    }
}

impl fmt::Display for PointStatistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, layer) in self.layers.iter().enumerate() {
            let PointLayerStatistics { kind, points, keys, references, nodes, levels, bytes, why } = layer;
            let begin = if i > 0 { "\n" } else { "" };
            let s = if *keys == 1 { "" } else { "s" };
            write!(
                f,
                "{begin}{kind:?}: {points} points at {keys} key{s}, {references} references, {nodes} nodes in {levels} levels, \
                 {bytes} bytes; {why}"
            )?;
        }
        Ok(())
    }
}
