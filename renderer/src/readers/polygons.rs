//! Faces with any number of corners, and their division into triangles.
//!
//! Corners are projected to the plane of the face's Newell normal, which is defined for faces that are not quite plane, too. Where
//! the fan from the first corner covers the face it is kept, as for all convex faces; others are divided by ear clipping.

use super::FormatError;
use earcut::Earcut;
use mbkd::glam::{DVec2, DVec3, Vec3};

/// The most corners of a face that is not a fan: ear clipping may take quadratic time.
const MOST_CORNERS: usize = 1 << 20;

/// Faces of three corners or more.
#[derive(Default, PartialEq)]
pub struct Polygons {
    /// The vertices of all faces, one after another.
    corners: Vec<u32>,
    /// The number of corners of each face.
    sizes: Vec<u32>,
}

impl Polygons {
    /// Adds a face; one with fewer than three corners covers nothing, and is left out.
    pub fn push(&mut self, corners: &[u32]) {
        if corners.len() >= 3 {
            self.corners.extend_from_slice(corners);
            self.sizes.push(corners.len() as u32);
        }
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.sizes.is_empty()
    }

    /// The corners of each face.
    fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let mut rest = &self.corners[..];
        self.sizes.iter().map(move |&size| {
            let (face, after) = rest.split_at(size as usize);
            rest = after;
            face
        })
    }

    /// The triangles of all faces, divided as fits these positions; all indices must be in range.
    pub fn triangles(&self, positions: &[Vec3]) -> Result<Vec<[u32; 3]>, FormatError> {
        let mut triangles = Vec::with_capacity(self.corners.len() - 2 * self.sizes.len());
        let (mut flat, mut earcut, mut ears) = (Vec::new(), Earcut::new(), Vec::new());
        for (number, face) in self.faces().enumerate() {
            if face.len() > 3 && !project(face, positions, &mut flat) {
                if face.len() > MOST_CORNERS {
                    let what = format!("{} corners are more than the {MOST_CORNERS} of a concave face", face.len());
                    return Err(FormatError::new(format!("face {number}"), what));
                }
                earcut.earcut_slice(&flat, &[], &mut ears);
                triangles
                    .extend(ears.as_chunks().0.iter().map(|ear: &[u32; 3]| ear.map(|corner| face[corner as usize])));
            } else {
                triangles.extend(face[1..].windows(2).map(|edge| [face[0], edge[0], edge[1]]));
            }
        }
        Ok(triangles)
    }
}

/// Projects the corners of a face to its plane, such that it is positively oriented there. Returns whether the fan from its first
/// corner covers it: no triangle of the fan is negatively oriented.
fn project(face: &[u32], positions: &[Vec3], flat: &mut Vec<[f64; 2]>) -> bool {
    // Relative to a corner, so that faces far from zero lose nothing.
    let first = positions[face[0] as usize].as_dvec3();
    let at = |corner: &u32| positions[*corner as usize].as_dvec3() - first;
    let normal: DVec3 = face.windows(2).map(|edge| at(&edge[0]).cross(at(&edge[1]))).sum();
    let Some(normal) = normal.try_normalize() else { return true };
    let (x, y) = normal.any_orthonormal_pair();
    flat.clear();
    flat.extend(face.iter().map(|corner| [at(corner).dot(x), at(corner).dot(y)]));
    flat[1..].windows(2).all(|edge| DVec2::from(edge[0]).perp_dot(DVec2::from(edge[1])) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn polygon(corners: usize) -> Polygons {
        let mut polygons = Polygons::default();
        polygons.push(&(0..corners as u32).collect::<Vec<_>>());
        polygons
    }

    /// A flat polygon in space: turned, scaled, moved.
    fn placed(flat: &[[f32; 2]], plane: usize) -> Vec<Vec3> {
        flat.iter()
            .map(|&[x, y]| match plane {
                0 => Vec3::new(x, y, 7.0),
                1 => Vec3::new(7.0, x, y),
                2 => Vec3::new(y, -3.0, x),
                _ => Vec3::new(x + 0.25 * y, y - 0.5 * x, x + y) * 3.0 + Vec3::splat(100.0),
            })
            .collect()
    }

    /// Twice the vector areas of triangles.
    fn areas(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<DVec3> {
        let at = |i: u32| positions[i as usize].as_dvec3();
        triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a))).collect()
    }

    /// Checks that triangles cover a simple polygon once and share their edges, with its orientation.
    fn assert_divided(flat: &[[f32; 2]], plane: usize) {
        let positions = placed(flat, plane);
        let triangles = polygon(flat.len()).triangles(&positions).unwrap();
        assert_eq!(triangles.len(), flat.len() - 2, "{flat:?} in plane {plane}");
        let fan: Vec<_> = (1..flat.len() as u32 - 1).map(|i| [0, i, i + 1]).collect();
        let whole: DVec3 = areas(&fan, &positions).into_iter().sum();
        let parts = areas(&triangles, &positions);
        let all: f64 = parts.iter().map(|part| part.length()).sum();
        assert!(parts.iter().all(|part| part.dot(whole) >= 0.0), "{triangles:?} of {flat:?} in plane {plane}");
        assert!((all - whole.length()).abs() < 1e-5 * all, "{all} of {whole}: {triangles:?}");
        // Edges of the polygon are used once, all others once in each direction.
        let edges: Vec<_> = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        let different: HashSet<_> = edges.iter().copied().collect();
        assert_eq!(edges.len(), different.len());
        let n = flat.len() as u32;
        for &(a, b) in &edges {
            assert!((a + 1) % n == b || different.contains(&(b, a)), "edge {a} {b} of {triangles:?}");
        }
    }

    #[test]
    fn convex_faces_and_those_that_their_first_corner_sees_are_fans() {
        let flat = [[0.0, 0.0], [2.0, 0.0], [3.0, 2.0], [1.0, 3.0], [-1.0, 2.0]];
        let dart = [[0.0, 0.0], [4.0, -2.0], [0.0, 4.0], [-4.0, -2.0]];
        for plane in 0..4 {
            assert_eq!(polygon(5).triangles(&placed(&flat, plane)).unwrap(), [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
            assert_eq!(polygon(4).triangles(&placed(&dart, plane)).unwrap(), [[0, 1, 2], [0, 2, 3]]);
        }
        // Of no area, and not plane.
        assert_eq!(polygon(4).triangles(&[Vec3::ONE; 4]).unwrap(), [[0, 1, 2], [0, 2, 3]]);
        let bent = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 1.0), Vec3::Y];
        assert_eq!(polygon(4).triangles(&bent).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn concave_faces_are_covered_once_from_every_first_corner() {
        let ell = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        // With corners on straight edges.
        let flat_corners = [
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [2.0, 1.0],
            [1.5, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.5, 2.0],
            [0.0, 2.0],
            [0.0, 1.0],
        ];
        let dart = [[0.0, 0.0], [4.0, -2.0], [0.0, 4.0], [-4.0, -2.0]];
        let mut comb = vec![[0.0, 0.0], [40.0, 0.0]];
        for tooth in (0..20).rev() {
            let x = tooth as f32 * 2.0;
            comb.extend([[x + 1.5, 5.0], [x + 0.5, 1.0]]);
        }
        let spiral: Vec<[f32; 2]> = (0..100)
            .map(|i| {
                // Outward on one side, back on the other.
                let (step, radius) = if i < 50 { (i, 1.0) } else { (99 - i, 1.5) };
                let (sin, cos) = (step as f32 * 0.3).sin_cos();
                let radius = radius + step as f32 * 0.1;
                [radius * cos, radius * sin]
            })
            .collect();
        for shape in [&ell[..], &flat_corners, &dart, &comb, &spiral] {
            for plane in 0..4 {
                for first in 0..shape.len() {
                    let mut turned = shape.to_vec();
                    turned.rotate_left(first);
                    assert_divided(&turned, plane);
                    turned.reverse();
                    assert_divided(&turned, plane);
                }
            }
        }
    }

    #[test]
    fn an_ell_lacks_its_notch() {
        let ell = [[1.0, 2.0], [0.0, 2.0], [0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]];
        let positions = placed(&ell, 0);
        let triangles = polygon(6).triangles(&positions).unwrap();
        let covers = |x: f64, y: f64| {
            let point = DVec3::new(x, y, 7.0);
            let inside = |&[a, b, c]: &[u32; 3]| {
                let [a, b, c] = [a, b, c].map(|i| positions[i as usize].as_dvec3() - point);
                [a.cross(b).z, b.cross(c).z, c.cross(a).z].iter().all(|&side| side > 0.0)
            };
            triangles.iter().filter(|triangle| inside(triangle)).count()
        };
        for i in 0..40 {
            for j in 0..40 {
                let (x, y) = (f64::from(i) * 0.05 + 0.0123, f64::from(j) * 0.05 + 0.0331);
                let expected = usize::from(x < 1.0 || y < 1.0);
                assert_eq!(covers(x, y), expected, "{x} {y}");
            }
        }
    }

    #[test]
    fn faces_that_cross_themselves_give_triangles_of_their_corners() {
        for round in 0..4000 {
            let random = |i: u64| (crate::sampling::mix(round, i) >> 16) as u32;
            let n = 4 + (round % 120) as u32;
            // Corners of a grid: many coincide.
            let axis = |i: u32, k: u64| (random(u64::from(i) * 3 + k) % (3 + n / 4)) as f32;
            let positions: Vec<Vec3> = (0..n).map(|i| Vec3::new(axis(i, 0), axis(i, 1), axis(i, 2) * 1e-3)).collect();
            let triangles = polygon(n as usize).triangles(&positions).unwrap();
            assert!(triangles.len() <= n as usize - 2, "{} of {n}", triangles.len());
            assert!(triangles.iter().flatten().all(|&i| i < n));
        }
    }

    #[test]
    fn too_large_concave_faces_are_refused() {
        // A zigzag.
        let corners = MOST_CORNERS as u32 + 1;
        let positions: Vec<Vec3> = (0..corners).map(|i| Vec3::new(i as f32, (i % 2) as f32, 0.0)).collect();
        let error = polygon(corners as usize).triangles(&positions).unwrap_err();
        assert!(error.place == "face 0" && error.what.contains("1048577 corners"), "{error:?}");
    }
}
