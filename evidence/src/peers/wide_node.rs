//! A node of sixteen children, whose boxes are tested together.

use super::boxes::{MovingBox, SlabRay};

/// The number of children of a node: that of the library's wide tree.
pub const WIDTH: usize = 16;

/// A number for each child.
pub type Row = [f32; WIDTH];

/// The boxes of the children at shutter open and their change, face by face, and the children: 832 bytes.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Lower x, y, z and upper x, y, z at shutter open.
    open: [Row; 6],
    /// The increase of each until shutter close.
    change: [Row; 6],
    pub children: [u32; WIDTH],
}

const _: () = assert!(size_of::<WideNode>() == 832);

/// The position of the faces in lanes without a child: upper ones below the lower ones, so far that no ray enters, and
/// so near that products with the inverse of a direction (2^24 at most) stay finite.
const NOWHERE: f32 = 1e30;

impl WideNode {
    /// A node without children.
    pub const EMPTY: WideNode = {
        let (low, high) = ([NOWHERE; WIDTH], [-NOWHERE; WIDTH]);
        WideNode { open: [low, low, low, high, high, high], change: [[0.0; WIDTH]; 6], children: [u32::MAX; WIDTH] }
    };

    /// Stores a child in a lane.
    pub fn set(&mut self, lane: usize, bounds: MovingBox, child: u32) {
        for axis in 0..3 {
            let faces = [(bounds.open.min, bounds.close.min), (bounds.open.max, bounds.close.max)];
            for (side, (open, close)) in faces.into_iter().enumerate() {
                self.open[3 * side + axis][lane] = open[axis];
                self.change[3 * side + axis][lane] = close[axis] - open[axis];
            }
        }
        self.children[lane] = child;
    }

    /// Where a ray enters each box as it is at the ray's time, and a mask of those entered no farther away than
    /// `reach`: the lowest bit is the first child's. The arithmetic is that of [`MovingBox::entry`].
    ///
    /// Plain loops over arrays, which compilers vectorize for the instruction set of the build.
    #[inline(always)]
    pub fn enter(&self, ray: &SlabRay, reach: f32) -> (Row, u32) {
        let (origin, inverse, pad) = (ray.origin.to_array(), ray.inverse.to_array(), ray.pad.to_array());
        let faces = |axis: usize| if inverse[axis] > 0.0 { [axis, axis + 3] } else { [axis + 3, axis] };
        let rows = [0, 1, 2].map(|axis| faces(axis).map(|face| (&self.open[face], &self.change[face])));
        let (mut begin, mut hits) = ([0.0; WIDTH], 0);
        for lane in 0..WIDTH {
            let (mut enter, mut leave) = (ray.begin, reach);
            for axis in 0..3 {
                let [near, far] = rows[axis].map(|(open, change)| {
                    let face = open[lane] + change[lane] * ray.time;
                    (face - origin[axis]) * inverse[axis]
                });
                let (near, far) = (near - pad[axis], far + pad[axis]);
                // As vector instructions compute it; no value is NaN here.
                enter = if near > enter { near } else { enter };
                leave = if far < leave { far } else { leave };
            }
            begin[lane] = enter;
            hits |= u32::from(enter <= leave) << lane;
        }
        (begin, hits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peers::boxes::Box3;
    use mbkd::glam::{Vec3, Vec3A};
    use mbkd_scenes::Random;

    #[test]
    fn sixteen_boxes_are_entered_like_single_ones() {
        let mut random = Random(4);
        let (mut entered, mut passed) = (0, 0);
        for round in 0..4000usize {
            let mut vec = || random.dvec().as_vec3();
            let mut end = || {
                let (middle, size) = (vec(), vec().abs());
                Box3 { min: middle - size, max: middle + size }
            };
            let boxes: Vec<MovingBox> = (0..round % 17).map(|_| MovingBox { open: end(), close: end() }).collect();
            let mut node = WideNode::EMPTY;
            for (lane, bounds) in boxes.iter().enumerate() {
                node.set(lane, *bounds, lane as u32);
            }
            // Including directions with the smallest components possible.
            let origin = vec() * 2.0;
            let dir = (vec() - origin) * Vec3::new(1.0, 1.0, [1.0, 1e-7][round % 2]);
            let inverse = Vec3A::from(Vec3::ONE / dir.abs().max(Vec3::splat(2f32.powi(-24))) * dir.signum());
            let ray = SlabRay {
                origin: Vec3A::from(origin),
                inverse,
                pad: inverse.abs() * 1e-6,
                begin: 0.0,
                time: vec().x.abs().min(1.0),
            };
            let reach = if round % 3 == 0 { 1.0 } else { f32::MAX };
            let (begin, hits) = node.enter(&ray, reach);
            for (lane, begin) in begin.into_iter().enumerate() {
                let alone = boxes.get(lane).and_then(|bounds| bounds.entry(&ray, reach));
                let together = (hits >> lane & 1 == 1).then_some(begin);
                assert_eq!(together.map(f32::to_bits), alone.map(f32::to_bits), "{ray:?} {:?}", boxes.get(lane));
                entered += usize::from(alone.is_some());
                passed += usize::from(alone.is_none() && lane < boxes.len());
            }
        }
        assert!(entered > 500 && passed > 500, "{entered} {passed}");
    }
}
