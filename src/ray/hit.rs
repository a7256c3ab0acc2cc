//! What a ray hit.

/// An answer of a ray query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray's direction: the point is `origin + t * dir`.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex; the first has `1 - u - v`.
    pub v: f32,
    /// The mesh, as an index into what the tree was built of (0 for the caller's own primitives).
    pub mesh: u32,
    /// The triangle within its mesh, or the primitive's index.
    pub primitive: u32,
}

/// A hit in tree space: `t` in units of the rescaled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SetHit {
    pub t: f32,
    pub u: f32,
    pub v: f32,
}
