//! The points that are near a block, gathered in rows.

/// Points in rows.
#[derive(Clone, Debug, Default)]
pub(super) struct PointRows {
    /// Positions: these, or those in f64.
    pub(super) at: [Vec<f32>; 3],
    pub(super) exact: [Vec<f64>; 3],
    pub(super) id: Vec<u32>,
}

impl PointRows {
    pub(super) fn bytes(&self) -> usize {
        let at = self.at.iter().map(Vec::capacity).sum::<usize>();
        4 * (at + self.id.capacity()) + 8 * self.exact.iter().map(Vec::capacity).sum::<usize>()
    }
}
