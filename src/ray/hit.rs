//! The answers of ray queries.

/// A hit of a ray on a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray's direction: the point is `origin + t * dir`. Always finite, and within the ray's
    /// range; never -0.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex; on a [sphere](crate::MovingSphere) the x of the unit normal, on a custom
    /// primitive the value that it returned.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, where the first has `1 - u - v`; on a sphere the y of the unit normal, on
    /// a custom primitive the value that it returned.
    pub v: f32,
    /// The mesh, as an index into the meshes that the tree was built of; for one of the other shapes of a scene the number of
    /// meshes ([`RayTree::mesh_count`](crate::RayTree::mesh_count)), so 0 for a tree of shapes only.
    pub mesh: u32,
    /// The triangle within its mesh, or the shape's index.
    pub primitive: u32,
}

/// A hit as reported by the intersection kernels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SetHit {
    /// The answer's `t`, rounded once.
    pub t: f32,
    /// A distance in tree space beyond which no hit can have a `t` as small as this.
    pub reach: f32,
    pub u: f32,
    pub v: f32,
}

impl SetHit {
    /// The public hit, given the primitive's mesh and index.
    #[inline(always)]
    pub fn answer(self, (mesh, primitive): (u32, u32)) -> Hit {
        Hit { t: self.t, u: self.u, v: self.v, mesh, primitive }
    }
}
