//! Shading normals, which make a coarse mesh look smooth.
//!
//! Every corner of a triangle gets the mean normal of those triangles around its vertex that form no crease with it,
//! weighted by area. Vertices with the same position at the first key count as one, since files split them for texture
//! coordinates; creases are decided at that key only, so that they do not appear and disappear during the shutter.

use mbkd::glam::Vec3;
use std::collections::HashMap;

/// Cosine of the angle from which an edge is a crease: about 45 degrees.
const CREASE: f32 = 0.7;
/// The greatest number of triangles around a vertex that are considered; more are a degenerate fan.
const MOST_AROUND: usize = 64;

/// Normals of the three corners of every triangle at every key.
#[derive(Clone, Debug, Default)]
pub struct Normals {
    keys: Vec<Vec<[Vec3; 3]>>,
}

impl Normals {
    /// Normals for triangles and positions at each key.
    pub fn new(indices: &[[u32; 3]], keys: &[Vec<Vec3>]) -> Normals {
        let Some(first) = keys.first() else { return Normals::default() };
        let faces = |positions: &[Vec3]| -> Vec<Vec3> { indices.iter().map(|t| face(positions, *t)).collect() };
        // The triangles that meet at each position.
        let place = |vertex: u32| first[vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
        let mut around = HashMap::<[u32; 3], Vec<u32>>::new();
        for (triangle, corners) in indices.iter().enumerate() {
            for &vertex in corners {
                let there = around.entry(place(vertex)).or_default();
                if there.len() < MOST_AROUND && there.last() != Some(&(triangle as u32)) {
                    there.push(triangle as u32);
                }
            }
        }
        // Those of them that belong to each corner.
        let units: Vec<Vec3> = faces(first).into_iter().map(Vec3::normalize_or_zero).collect();
        let mut belonging = Vec::with_capacity(3 * indices.len());
        for (triangle, corners) in indices.iter().enumerate() {
            for &vertex in corners {
                let near = |&&other: &&u32| units[other as usize].dot(units[triangle]) > CREASE;
                belonging.push(around[&place(vertex)].iter().filter(near).copied().collect::<Vec<u32>>());
            }
        }
        let at_key = |positions: &Vec<Vec3>| {
            let faces = faces(positions);
            let corner = |triangle: usize, k: usize| {
                let sum: Vec3 = belonging[3 * triangle + k].iter().map(|&other| faces[other as usize]).sum();
                sum.normalize_or(faces[triangle].normalize_or_zero())
            };
            (0..indices.len()).map(|triangle| [0, 1, 2].map(|k| corner(triangle, k))).collect()
        };
        Normals { keys: keys.iter().map(at_key).collect() }
    }

    /// The normal at a point of a triangle given by barycentric weights, at a time; zero if undefined.
    pub fn at(&self, triangle: usize, [a, b, c]: [f32; 3], time: f32) -> Vec3 {
        let Some(last) = self.keys.len().checked_sub(1) else { return Vec3::ZERO };
        let at = time * last as f32;
        let segment = (at as usize).min(last.saturating_sub(1));
        let s = at - segment as f32;
        let normal = |key: usize| self.keys[key].get(triangle).map_or(Vec3::ZERO, |n| n[0] * a + n[1] * b + n[2] * c);
        normal(segment).lerp(normal((segment + 1).min(last)), s).normalize_or_zero()
    }
}

/// Twice the area along the normal.
fn face(positions: &[Vec3], [a, b, c]: [u32; 3]) -> Vec3 {
    let [a, b, c] = [a, b, c].map(|i| positions[i as usize]);
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gentle_edges_are_smooth_and_creases_stay() {
        // Three squares along x, at 0, 30 and 120 degrees to the ground, with separate vertices.
        let steps = [(1.0, 0.0), (0.866, 0.5), (-0.5, 0.866)];
        let (mut positions, mut indices, mut from) = (Vec::new(), Vec::new(), Vec3::ZERO);
        for (x, y) in steps {
            let (to, first) = (from + Vec3::new(x, y, 0.0), positions.len() as u32);
            positions.extend([from, from + Vec3::Z, to + Vec3::Z, to]);
            indices.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            from = to;
        }
        let normals = Normals::new(&indices, &[positions.clone(), positions]);
        let corner = |triangle: usize, k: usize| {
            let mut weights = [0.0; 3];
            weights[k] = 1.0;
            normals.at(triangle, weights, 0.5)
        };
        assert!((corner(0, 0) - Vec3::Y).length() < 1e-5, "nothing else is there");
        let bent = corner(1, 2);
        assert!(bent.x < -0.1 && (corner(2, 0) - bent).length() < 0.2, "{bent}, smooth across 30 degrees");
        assert!((corner(3, 2) - Vec3::new(-0.5, 0.866, 0.0)).length() < 1e-2, "90 degrees are a crease");
        assert_eq!(Normals::default().at(0, [1.0, 0.0, 0.0], 0.5), Vec3::ZERO);
    }
}
