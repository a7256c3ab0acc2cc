//! Cloth in the wind: a sheet that follows a chain of joints with travelling waves.
//!
//! The sheet is attached at x = 0 and streams along -x. Each column of vertices follows the two joints next to it. The
//! angles of the joints grow towards the free end, and each lags behind that of the joint before it.

use super::glb::Writer;
use super::paint::Paint;
use gltf::json::{Index, Node};
use mbkd::glam::Vec3;
use mbkd_renderer::sampling::cos_sin;

/// A sheet of square cells.
pub struct Cloth<'a> {
    /// A string for each row of cells, top row first: `#` is a cell of the second paint.
    pub pattern: &'a [&'a str],
    /// Edge of a cell.
    pub cell: f32,
    /// Its two paints.
    pub paints: [Paint; 2],
    /// Joints of the chain.
    pub joints: usize,
    /// Waves that pass during the clip.
    pub waves: f32,
    /// Angle at the free end, in turns.
    pub swing: f32,
}

impl Cloth<'_> {
    /// Adds the sheet, its chain and its motion, and attaches it to a node.
    pub fn hang(&self, file: &mut Writer, name: &str, parent: Index<Node>) {
        let (rows, columns) = (self.pattern.len(), self.pattern[0].len());
        let spacing = columns as f32 * self.cell / (self.joints - 1) as f32;

        let (mut positions, mut pairs) = (Vec::new(), Vec::new());
        for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
            let x = (columns - column) as f32 * self.cell;
            positions.push(Vec3::new(-x, (0.5 * rows as f32 - row as f32) * self.cell, 0.0));
            let at = x / spacing;
            let joint = (at as usize).min(self.joints - 2);
            pairs.push(([joint as u8, joint as u8 + 1], ((at - joint as f32) * 255.0).round() as u8));
        }
        let mut vertices = file.positions(&positions);
        file.follow(&mut vertices, &pairs);

        let mut primitives = Vec::new();
        for (paint, sign) in self.paints.into_iter().zip(['.', '#']) {
            let mut triangles = Vec::new();
            for (row, text) in self.pattern.iter().enumerate() {
                for column in text.char_indices().filter(|c| c.1 == sign).map(|c| c.0) {
                    let a = (row * (columns + 1) + column) as u32;
                    let below = a + columns as u32 + 1;
                    triangles.extend([[a, below, below + 1], [a, below + 1, a + 1]]);
                }
            }
            if !triangles.is_empty() {
                primitives.push(file.primitive(vertices.clone(), &triangles, paint));
            }
        }

        let mut chain = Vec::new();
        let mut last = parent;
        for joint in 0..self.joints {
            let way = if joint == 0 { 0.0 } else { spacing };
            last = file.node(&format!("{name} joint {joint}"), Some(last), Vec3::X * -way);
            chain.push((last, Vec3::X * (-spacing * joint as f32)));
            // About an axis between the vertical and the viewing direction: the sheet waves sideways and up and down.
            let turns = |time: f32| self.angle(joint, time) - joint.checked_sub(1).map_or(0.0, |j| self.angle(j, time));
            file.spin(&[last], Vec3::new(0.0, 0.8, 0.6), 8 * self.waves as usize + 1, turns);
        }
        let skin = file.skin(&chain);
        let sheet = file.node(name, None, Vec3::ZERO);
        let mesh = file.mesh_of(name, primitives);
        file.show(sheet, mesh, Some(skin));
    }

    /// The angle of a joint to the direction of the wind.
    fn angle(&self, joint: usize, time: f32) -> f32 {
        let along = joint as f32 / (self.joints - 1) as f32;
        let (_, s) = cos_sin(self.waves * time - 1.1 * along);
        self.swing * (0.35 + 0.65 * along) * s
    }
}
