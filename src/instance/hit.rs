//! The answers of queries over instances.

use crate::ray::{ClosestPoint, Hit};
use core::fmt;

/// Levels of instances: a tree of instances of trees of triangles has one.
pub const MAX_NESTING: usize = 4;

/// No instance has this index.
const NONE: u32 = u32::MAX;

/// The instances that lead to a tree: an index into those of the outermost tree, then into those of the tree placed
/// there, and so on. Paths of one tree are ordered lexicographically.
///
/// ```
/// use mbkd::InstancePath;
/// assert!(InstancePath::default().is_empty());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InstancePath([u32; MAX_NESTING]);

impl InstancePath {
    /// The path of these instances, outermost first, to ask a tree about a hit that was stored elsewhere. `None` if there are more
    /// than [`MAX_NESTING`], or one is `u32::MAX`, which no instance is.
    ///
    /// ```
    /// use mbkd::InstancePath;
    /// assert_eq!(InstancePath::new(&[3, 0]).unwrap()[..], [3, 0]);
    /// assert!(InstancePath::new(&[0; 5]).is_none() && InstancePath::new(&[u32::MAX, 0]).is_none());
    /// ```
    pub fn new(instances: &[u32]) -> Option<InstancePath> {
        let mut path = InstancePath::default();
        path.0.get_mut(..instances.len())?.copy_from_slice(instances);
        (path.len() == instances.len()).then_some(path)
    }

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
    /// The instance, outermost index first.
    pub path: InstancePath,
    /// The hit in the placed tree. `t` is that of the caller's ray.
    pub hit: Hit,
}

/// The closest point in an [`InstanceTree`](crate::InstanceTree), as returned by
/// [`InstanceTree::closest_point`](crate::InstanceTree::closest_point).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstancePoint {
    /// The instance, outermost index first.
    pub path: InstancePath,
    /// The closest point in the placed tree; distance and point are in the coordinates of the queried tree.
    pub near: ClosestPoint,
}
