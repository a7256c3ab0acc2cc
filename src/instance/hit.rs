//! What a ray hit or a point has nearest, and in which instance.

use crate::ray::{ClosestPoint, Hit};
use core::fmt;

/// Levels of instances: a tree of instances of trees of triangles has one.
pub const MAX_NESTING: usize = 4;

/// No instance has this number.
const NONE: u32 = u32::MAX;

/// The instances that lead to a tree: an index into those of the outermost tree, then into those of the tree placed there,
/// and so on. In the order of the indices.
///
/// ```
/// use mbkd::InstancePath;
/// assert!(InstancePath::default().is_empty());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InstancePath([u32; MAX_NESTING]);

impl InstancePath {
    /// The path with another level. (There is room: deeper trees are not built.)
    pub(crate) fn then(mut self, instance: u32) -> InstancePath {
        if let Some(level) = self.0.iter_mut().find(|level| **level == NONE) {
            *level = instance;
        }
        self
    }
}

impl Default for InstancePath {
    fn default() -> InstancePath {
        InstancePath([NONE; MAX_NESTING])
    }
}

impl core::ops::Deref for InstancePath {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        let levels = self.0.iter().take_while(|&&level| level != NONE).count();
        &self.0[..levels]
    }
}

impl fmt::Debug for InstancePath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// An answer of a ray query in an [`InstanceTree`](crate::InstanceTree).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceHit {
    /// Which instance, outermost first.
    pub path: InstancePath,
    /// What was hit of the tree placed there. `t` is that of the ray as it was asked.
    pub hit: Hit,
}

/// The nearest point on anything in an [`InstanceTree`](crate::InstanceTree), as
/// [`InstanceTree::closest_point`](crate::InstanceTree::closest_point) finds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstancePoint {
    /// Which instance, outermost first.
    pub path: InstancePath,
    /// On what of the tree placed there; distance and point are in the coordinates of the tree that was asked.
    pub near: ClosestPoint,
}
