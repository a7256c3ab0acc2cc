//! A tree as a search over a range of times sees it.

use crate::geometry::TimeInterval;
use crate::simd::Lanes;

/// A point between two keys, as a search over a range of times sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub(super) id: u32,
    pub(super) open: [f32; 3],
    pub(super) close: [f32; 3],
    /// The whole life, not a piece of it.
    pub(super) life: TimeInterval,
}

/// A tree whose boxes can be looked at over a range of times. Times are f64 within the shutter.
pub(super) trait Boxed {
    /// Number of keys, the segment between two of them, and the times the tree answers for.
    fn part(&self) -> (usize, usize, [f64; 2]);
    /// Level and number of the root.
    fn top(&self) -> (usize, usize);
    /// Node, or block on level 0, behind lane 0, and how many each lane leads on by.
    fn behind(&self, level: usize, node: usize) -> (usize, usize);
    /// When each lane counts, begin and end; where it is absent, the begin is infinite.
    fn times(&self, node: usize) -> [Lanes<f64>; 2];
    /// Lower and upper faces, each lane at a phase of its own.
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2];
    /// Lower and upper faces at one phase, as queries at a time compute them.
    fn faces_at(&self, node: usize, phase: f32) -> [[Lanes<f32>; 3]; 2];
    /// Whether a lane of a block counts at a time.
    fn counts(&self, block: usize, lane: usize, time: f32) -> bool;
    /// A point of a block.
    fn flight(&self, block: usize, lane: usize) -> Option<Flight>;
}
