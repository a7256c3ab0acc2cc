//! The points that are near a block, gathered in rows.

/// Points in rows.
#[derive(Clone, Debug, Default)]
pub(super) struct PointRows {
    /// Positions: these, or those in f64.
    pub(super) at: [Vec<f32>; 3],
    pub(super) exact: [Vec<f64>; 3],
    /// What is taken off differences to get those to the nearest images: this, or that in f64.
    pub(super) shift: [Vec<f32>; 3],
    pub(super) exact_shift: [Vec<f64>; 3],
    pub(super) id: Vec<u32>,
}

impl PointRows {
    pub(super) fn bytes(&self) -> usize {
        let single = self.at.iter().chain(&self.shift).map(Vec::capacity).sum::<usize>();
        let double = self.exact.iter().chain(&self.exact_shift).map(Vec::capacity).sum::<usize>();
        4 * (single + self.id.capacity()) + 8 * double
    }
}
