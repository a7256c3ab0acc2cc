//! The building blocks of all scenes: tubes, closed or open, and boxes, collected into a mesh.
//!
//! Picture a stack of rings of points around some curve, neighbouring rings joined by triangles, and the
//! ends closed by a fan to a tip. A sphere, a hair, a column, a finger are all such tubes.

use engine::TriangleMesh;
use glam::{Mat3, Vec3};

/// Triangles under construction, at one instant.
#[derive(Default)]
pub struct Shape {
    indices: Vec<[u32; 3]>,
    positions: Vec<Vec3>,
}

impl Shape {
    /// Joins `rings` rings of `around` points each; `start` and `end` are tips that close it.
    ///
    /// Rings run counter-clockwise as seen from the end, for normals that point outward.
    pub fn tube(
        &mut self,
        start: Option<Vec3>,
        rings: usize,
        around: usize,
        point: impl Fn(usize, usize) -> Vec3,
        end: Option<Vec3>,
    ) {
        let first = self.positions.len() as u32;
        let (n, last) = (around as u32, first + ((rings - 1) * around) as u32);
        for ring in 0..rings {
            self.positions.extend((0..around).map(|k| point(ring, k)));
        }
        for row in (first..last).step_by(around) {
            for k in 0..n {
                let next = (k + 1) % n;
                self.indices.push([row + k, row + next, row + n + next]);
                self.indices.push([row + k, row + n + next, row + n + k]);
            }
        }
        if let Some(tip) = start {
            let at = self.vertex(tip);
            self.indices.extend((0..n).map(|k| [at, first + (k + 1) % n, first + k]));
        }
        if let Some(tip) = end {
            let at = self.vertex(tip);
            self.indices.extend((0..n).map(|k| [at, last + k, last + (k + 1) % n]));
        }
    }

    /// The image of the cube [-1, 1]^3.
    pub fn cuboid(&mut self, centre: Vec3, half: Mat3) {
        let first = self.positions.len() as u32;
        for corner in 0..8u32 {
            let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            self.positions.push(centre + half * Vec3::new(sign(0), sign(1), sign(2)));
        }
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for [a, b, c, d] in faces {
            self.indices.push([first + a, first + b, first + c]);
            self.indices.push([first + a, first + c, first + d]);
        }
    }

    /// A box with faces along the axes.
    pub fn block(&mut self, min: Vec3, max: Vec3) {
        self.cuboid((min + max) * 0.5, Mat3::from_diagonal((max - min) * 0.5));
    }

    /// One triangle of its own corners.
    pub fn triangle(&mut self, corners: [Vec3; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.indices.push([first, first + 1, first + 2]);
    }

    /// Rotates, then translates, all triangles so far.
    pub fn place(&mut self, turn: Mat3, shift: Vec3) {
        for p in &mut self.positions {
            *p = turn * *p + shift;
        }
    }

    fn vertex(&mut self, position: Vec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    /// The shape as a static mesh.
    pub fn fixed(self) -> TriangleMesh {
        TriangleMesh::fixed(self.indices, self.positions)
    }
}

/// A mesh from its poses at `keys` times spaced evenly over the shutter.
///
/// `pose` must build the same triangles in the same order at every time.
pub(super) fn animate(keys: usize, pose: impl Fn(f32) -> Shape) -> TriangleMesh {
    let mut shapes = (0..keys).map(|key| pose(key as f32 / (keys - 1).max(1) as f32)).collect::<Vec<_>>();
    let indices = std::mem::take(&mut shapes[0].indices);
    TriangleMesh::new(indices, shapes.into_iter().map(|shape| shape.positions).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::super::turn::cos_sin;
    use super::*;
    use std::collections::HashMap;

    /// Every edge of a closed surface is used once in each direction, and its volume is positive when
    /// triangles face outward.
    fn volume_of_closed(shape: &Shape) -> f32 {
        let mut edges = HashMap::<(u32, u32), i32>::new();
        for &[a, b, c] in &shape.indices {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|&sum| sum == 0), "open or badly oriented");
        let p = |i: u32| shape.positions[i as usize];
        shape.indices.iter().map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0).sum()
    }

    #[test]
    fn tubes_and_boxes_close_and_face_outward() {
        let mut shape = Shape::default();
        shape.block(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0));
        assert!((volume_of_closed(&shape) - 6.0).abs() < 1e-5);
        let mut shape = Shape::default();
        let ring = |ring: usize, k: usize| {
            let (c, s) = cos_sin(k as f32 / 64.0);
            Vec3::new(c, s, ring as f32)
        };
        shape.tube(Some(Vec3::ZERO), 3, 64, ring, Some(Vec3::new(0.0, 0.0, 2.0)));
        assert_eq!(shape.indices.len(), 64 * 6);
        assert!((volume_of_closed(&shape) - 2.0 * std::f32::consts::PI).abs() < 0.02);
    }
}
