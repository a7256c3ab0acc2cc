//! What layers are built for, and the layers that are chosen.

use super::source::Source;
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::SimdLevel;

/// What layers are built for: some points of a set, at least one.
#[derive(Clone, Copy)]
pub(in crate::point) struct LayerRequest<'a> {
    pub(in crate::point) source: &'a Source,
    pub(in crate::point) points: &'a [u32],
    /// The allowed number of references per point, for each segment between keys.
    pub(in crate::point) max_references: f32,
    /// The instruction set of the searches that are counted.
    pub(in crate::point) simd: SimdLevel,
    pub(in crate::point) progress: &'a Progress<'a>,
}

/// A layer, and the reason for its number of time slices.
pub(in crate::point) struct ChosenLayer {
    pub(in crate::point) layer: Layer,
    /// Of each segment between keys.
    pub(in crate::point) time_slices: usize,
    /// Number of points.
    pub(in crate::point) points: usize,
    pub(in crate::point) why: String,
}

/// What so many time slices of each segment are called.
pub(in crate::point) fn slices_named(per_segment: usize) -> String {
    match per_segment {
        1 => "one linear tree".to_string(),
        slices => format!("{slices} time slices"),
    }
}
