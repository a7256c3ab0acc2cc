//! The points that are near a block, gathered in rows.

/// Points in rows.
#[derive(Clone, Debug, Default)]
pub(super) struct GatheredPoints {
    /// Where they are: these, or those in f64.
    pub(super) single: GatheredRows<f32>,
    pub(super) double: GatheredRows<f64>,
    pub(super) id: Vec<u32>,
}

/// Positions, and what is taken off differences to get those to the nearest images.
#[derive(Clone, Debug, Default)]
pub(super) struct GatheredRows<C> {
    pub(super) at: [Vec<C>; 3],
    pub(super) shift: [Vec<C>; 3],
}

impl<C> GatheredRows<C> {
    fn bytes(&self) -> usize {
        self.at.iter().chain(&self.shift).map(Vec::capacity).sum::<usize>() * size_of::<C>()
    }
}

impl GatheredPoints {
    pub(super) fn bytes(&self) -> usize {
        self.single.bytes() + self.double.bytes() + 4 * self.id.capacity()
    }
}
