//! What a tree consists of, and why.

use core::fmt;

/// Which structure holds a part of the points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PointLayerKind {
    /// The complete static tree.
    Static,
    /// Moving trees with linear boxes, `parts` of them for each segment between keys.
    Linear {
        /// Trees side by side in time.
        parts: usize,
    },
    /// The paper's k-d tree, one for each segment between keys: what crosses a plane is on both sides of it.
    Mbkd,
}

/// One layer of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct PointLayerStatistics {
    /// The structure.
    pub kind: PointLayerKind,
    /// Points in it.
    pub points: usize,
    /// References to them: more than points where they cross planes or are in several trees.
    pub references: usize,
    /// Nodes: of sixteen boxes each, or planes in a k-d tree.
    pub nodes: usize,
    /// Levels of nodes of the deepest tree.
    pub levels: usize,
    /// Keys that are kept: keys on the straight lines between others are not, nor keys of what stands still.
    pub keys: usize,
    /// Bytes allocated.
    pub bytes: usize,
    /// Why this structure, in a sentence.
    pub why: String,
}

/// What a point tree consists of.
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

    /// References per point; 1 where nothing is duplicated, 0 without points.
    pub fn references_per_point(&self) -> f64 {
        let points: usize = self.layers.iter().map(|layer| layer.points).sum();
        let references: usize = self.layers.iter().map(|layer| layer.references).sum();
        references as f64 / points.max(1) as f64
    }
}

impl fmt::Display for PointStatistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for layer in &self.layers {
            writeln!(
                f,
                "{:?}: {} points at {} keys, {} references, {} nodes in {} levels, {} bytes; {}",
                layer.kind,
                layer.points,
                layer.keys,
                layer.references,
                layer.nodes,
                layer.levels,
                layer.bytes,
                layer.why
            )?;
        }
        Ok(())
    }
}
