//! References: an object in a node, for a time.

use super::classify::Rounding;
use crate::geometry::{AxisExtent, LinearBox3, Plane, TimeInterval};

/// One entry of an object in a node under construction.
///
/// The same object may have several references in different nodes. Those of objects with an extent may overlap in
/// time: it is sufficient that at every time each place where the object is has one. Of the references of a point exactly
/// one is active at every time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference<B> {
    /// The object.
    pub id: u32,
    /// Its active interval in this node.
    pub interval: TimeInterval,
    /// Its bounds during the interval: linear bounds, or the trajectory of a point.
    pub bounds: B,
    /// Whether it contributes to the choice of planes.
    pub in_sah: bool,
}

impl<B> Reference<B> {
    /// The time of its interval that is nearest to the plane time: its position then decides in which
    /// child it is a Normal reference. For a reference that is active at mid-shutter that is mid-shutter.
    #[inline]
    pub fn representative_time(&self, plane_time: f32) -> f32 {
        representative_time(self.interval, plane_time)
    }
}

/// The time of an interval that is nearest to the plane time.
#[inline]
pub(crate) fn representative_time(interval: TimeInterval, plane_time: f32) -> f32 {
    plane_time.clamp(interval.begin(), interval.end_bound().next_down())
}

/// Objects that a k-d tree is built over: the differences between primitives and points.
pub(crate) trait Moving: Sync {
    /// The bounds of a reference.
    type Bounds: Copy + Send + Sync;

    /// The rounding of the times at which an object crosses a plane.
    const ROUNDING: Rounding;

    /// The time at which planes are chosen.
    fn plane_time(&self) -> f32;

    /// The extent of a reference along an axis during its interval.
    fn extent(&self, reference: &Reference<Self::Bounds>, axis: usize) -> AxisExtent;

    /// The plane that divides a node with this cell (at shutter open and close) and these references, the Normal ones
    /// first; `None` if a leaf is better.
    fn choose(
        &self,
        normal: &[Reference<Self::Bounds>],
        bp: &[Reference<Self::Bounds>],
        cell: LinearBox3,
    ) -> Option<Plane>;

    /// Whether two children with this many references are better than a leaf of `before`.
    fn worthwhile(&self, before: usize, children: [usize; 2]) -> bool;

    /// `child`, which is `parent` with another interval, with its bounds for a child's cell (at shutter open and
    /// close); `None` if the object is not in the cell after all. `crosses` if it has a part on the other side too.
    fn fitted(
        &self,
        child: Reference<Self::Bounds>,
        parent: &Reference<Self::Bounds>,
        cell: LinearBox3,
        crosses: bool,
    ) -> Option<Reference<Self::Bounds>>;
}
