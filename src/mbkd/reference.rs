//! References: an object in a node, for a time.

use super::classify::Rounding;
use crate::geometry::{Extent, LinearBox3, Plane, TimeInterval};

/// One entry of an object in a node under construction.
///
/// The same object may have several references in different nodes. Those of objects with an extent may overlap in
/// time: all that counts is that at every time each place where the object is has one. Of those of a point exactly
/// one counts at every time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference<B> {
    /// The object.
    pub id: u32,
    /// When it counts in this node.
    pub interval: TimeInterval,
    /// Where it is during the interval: linear bounds, or the trajectory of a point.
    pub bounds: B,
    /// Whether it takes part in choosing planes.
    pub in_sah: bool,
}

impl<B> Reference<B> {
    /// The time of its interval that is nearest to the plane time: where a reference is then decides in which
    /// child it is a Normal reference. For a reference that lives at mid-shutter that is mid-shutter.
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

/// Objects that a k-d tree is built over, and what differs between their kinds.
pub(crate) trait Moving: Sync {
    /// What a reference knows of where its object is.
    type Bounds: Copy + Send + Sync;

    /// How the times are rounded at which an object crosses a plane.
    const ROUNDING: Rounding;

    /// The time at which planes are chosen.
    fn plane_time(&self) -> f32;

    /// What a reference occupies along an axis during its interval.
    fn extent(&self, reference: &Reference<Self::Bounds>, axis: usize) -> Extent;

    /// The plane that divides a node with this cell (at shutter open and close) and these references, the Normal ones
    /// first; `None` where a leaf is the better choice.
    fn choose(
        &self,
        normal: &[Reference<Self::Bounds>],
        bp: &[Reference<Self::Bounds>],
        cell: LinearBox3,
    ) -> Option<Plane>;

    /// Whether children with so many references are worth having in place of a leaf of `before`.
    fn worthwhile(&self, before: usize, children: [usize; 2]) -> bool;

    /// `child`, which is `parent` with another interval, with its bounds for a child's cell (at shutter open and
    /// close); `None` where the object is not in the cell after all. `crosses` where it has a part on the other side too.
    fn fitted(
        &self,
        child: Reference<Self::Bounds>,
        parent: &Reference<Self::Bounds>,
        cell: LinearBox3,
        crosses: bool,
    ) -> Option<Reference<Self::Bounds>>;
}
