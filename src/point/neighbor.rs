//! The result of a neighbour query.

/// A point that a query found.
#[derive(Clone, Copy, PartialEq, Debug)]
#[repr(C)]
pub struct Neighbor {
    /// The point's id: its index unless ids were given.
    pub id: u32,
    /// The squared distance, computed in f32 as `(dx·dx + dy·dy) + dz·dz`.
    pub distance_squared: f32,
}

impl Neighbor {
    /// The distance.
    pub fn distance(self) -> f32 {
        self.distance_squared.sqrt()
    }
}
