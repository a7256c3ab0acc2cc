//! A tree as a search over a range of times sees it.

use super::moving_reference::phase;
use crate::geometry::{KeyTime, TimeInterval};
use crate::simd::{LANES, Lanes};
use glam::{DVec3, Vec3};

/// A point between two keys, as a search over a range of times sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub(super) id: u32,
    pub(super) open: [f64; 3],
    pub(super) close: [f64; 3],
    /// The whole life, not a piece of it.
    pub(super) life: TimeInterval,
}

impl Flight {
    /// Both ends of a point that is kept in f32.
    pub(super) fn ends(&self) -> [[f32; 3]; 2] {
        [self.open, self.close].map(|p| p.map(|x| x as f32))
    }

    /// Where queries at a time see a point that is kept in f32.
    pub(super) fn position(&self, at: KeyTime) -> Vec3 {
        let [open, close] = self.ends();
        at.position(open.into(), close.into())
    }
}

/// Sixteen points between two keys, kept in f32, in rows; where there is none, the id is `u32::MAX`.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct FlightRows {
    pub(super) open: [Lanes<f32>; 3],
    pub(super) close: [Lanes<f32>; 3],
    /// Whole lives, with the end bound.
    pub(super) begin: Lanes<f32>,
    pub(super) end: Lanes<f32>,
    pub(super) id: Lanes<u32>,
}

impl FlightRows {
    /// Points that live throughout.
    #[inline(always)]
    pub(super) fn everlasting(open: &[Lanes<f32>; 3], close: &[Lanes<f32>; 3], id: &Lanes<u32>) -> FlightRows {
        let life = TimeInterval::FULL;
        let (begin, end) = ([life.begin(); LANES], [life.end_bound(); LANES]);
        FlightRows { open: *open, close: *close, begin, end, id: *id }
    }

    /// One of the points.
    #[inline(always)]
    pub(super) fn flight(&self, lane: usize) -> Option<Flight> {
        let life = TimeInterval::half_open(self.begin[lane], self.end[lane])?;
        let [open, close] = [self.open, self.close].map(|rows| rows.map(|row| f64::from(row[lane])));
        (self.id[lane] != u32::MAX).then_some(Flight { id: self.id[lane], open, close, life })
    }
}

/// A tree whose points are kept in f32, sixteen in a block.
pub(super) trait InRows: Boxed {
    /// The points of a block.
    fn rows(&self, block: usize) -> FlightRows;
    /// Whether some points do not live throughout.
    fn mortal(&self) -> bool;
}

/// A tree whose boxes can be looked at over a range of times. Times are f64 within the shutter.
pub(super) trait Boxed {
    /// How far faces may be off by rounding, relative to their size: for each segment between keys, because of times that
    /// are rounded, and besides.
    const SLACK: [f64; 2] = [1e-6, 1e-12];
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
    /// Whether a lane of a block counts at a time.
    fn counts(&self, block: usize, lane: usize, time: f32) -> bool;
    /// A point of a block.
    fn flight(&self, block: usize, lane: usize) -> Option<Flight>;
    /// Where queries at a time see a point.
    fn position(&self, flight: &Flight, time: f32) -> DVec3 {
        flight.position(KeyTime::new(time, self.part().0)).as_dvec3()
    }
    /// Where a time lies between the keys.
    fn phase(&self, time: f32) -> f64 {
        let (keys, segment, _) = self.part();
        phase(KeyTime::new(time, keys), segment).into()
    }
}
