//! Reusable memory of gathers.

use crate::point::queries::query::NeighborBuffer;

/// Memory of gathers. If it is reused, a loop allocates nothing once the memory has grown to what its queries need.
#[derive(Clone, Debug, Default)]
pub struct GatherScratch {
    pub(super) buffer: NeighborBuffer,
}

impl GatherScratch {
    /// An empty buffer; it grows with the first queries.
    pub fn new() -> GatherScratch {
        GatherScratch::default()
    }
}
