//! Memory that queries share.

use crate::point::query::NeighborBuffer;

/// Memory of gathers. Reused from one to the next, a loop allocates nothing once it has grown to what its queries need.
#[derive(Clone, Debug, Default)]
pub struct GatherScratch {
    pub(super) buffer: NeighborBuffer,
}

impl GatherScratch {
    /// Nothing yet; it grows with the first queries.
    pub fn new() -> GatherScratch {
        GatherScratch::default()
    }
}
