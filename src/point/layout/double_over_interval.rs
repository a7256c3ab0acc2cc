//! Trees over f64 points for searches over a range of times.
//!
//! Beyond the ends of a time slice, faces go on along their lines: searches that take a common motion off everything need lines.

use super::double_box::DoubleNode;
use super::double_tree::{DoubleBlock, DoubleTree, between};
use crate::point::layout::over_interval::{BlockTree, BoxTree, PathRows, PointPath, greater, lesser, throughout};
use crate::point::layout::shape::Shape;
use crate::simd::{LANES, Lanes};
use glam::DVec3;

impl BoxTree for DoubleTree {
    fn shape(&self) -> &Shape {
        &self.shape
    }
    #[inline(always)]
    fn times(&self, node: usize) -> [Lanes<f32>; 2] {
        if let Some(times) = self.node_times.get(node) {
            return [times.begin, times.end];
        }
        throughout(&self.nodes[node].boxes.lo[0])
    }
    #[inline(always)]
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let (DoubleNode { middle, displacement, boxes }, slopes) = (&self.nodes[node], self.slopes.get(node));
        let still = [[0.0; LANES]; 3];
        let (slopes_lo, slopes_hi) = slopes.map_or((&still, &still), |slopes| (&slopes.lo, &slopes.hi));
        let mut w = [0.0; LANES];
        for (w, &phase) in w.iter_mut().zip(phase) {
            *w = self.fraction(phase);
        }
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, (boxes, slopes)) in faces.iter_mut().zip([(&boxes.lo, slopes_lo), (&boxes.hi, slopes_hi)]) {
            for axis in 0..3 {
                for lane in 0..LANES {
                    let middle = middle[axis] + displacement[axis] * w[lane];
                    let slope = f64::from(slopes[axis][lane]);
                    faces[axis][lane] = middle + (f64::from(boxes[axis][lane]) + slope * w[lane]);
                }
            }
        }
        faces
    }
    fn is_active(&self, block: usize, lane: usize, time: f32) -> bool {
        self.block_times.get(block).is_none_or(|times| times.is_active(lane, time))
    }
    fn phase(&self, time: f32) -> f64 {
        self.phase_at(time)
    }
    fn position(&self, point: &PointPath, time: f32) -> DVec3 {
        between([point.open, point.close].map(DVec3::from_array), self.phase_at(time))
    }
}

impl BlockTree for DoubleTree {
    type Coordinate = f64;
    #[inline(always)]
    fn rows(&self, block: usize) -> PathRows<f64> {
        let DoubleBlock { begin, id } = &self.blocks[block];
        PathRows::new(&begin.0, &self.ends.get(block).unwrap_or(begin).0, id, self.active.get(block))
    }
    fn has_active_intervals(&self) -> bool {
        !self.active.is_empty()
    }
    fn timed(&self) -> bool {
        !self.node_times.is_empty()
    }
    fn begins_at(&self, time: f32) -> bool {
        self.active.iter().any(|active| active.begin.contains(&time))
    }
    #[inline(always)]
    fn center(&self, node: usize, phase: f64) -> [f64; 3] {
        self.nodes[node].middle_at(self.fraction(phase))
    }
    fn displacements(&self) -> [[f64; 3]; 2] {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (number, DoubleBlock { begin, id }) in self.blocks.iter().enumerate() {
            let end = self.ends.get(number).unwrap_or(begin);
            for axis in 0..3 {
                for lane in (0..LANES).filter(|&lane| id[lane] != u32::MAX) {
                    let displacement = end.0[axis][lane] - begin.0[axis][lane];
                    (lo[axis], hi[axis]) = (lesser(lo[axis], displacement), greater(hi[axis], displacement));
                }
            }
        }
        [lo, hi]
    }
}
