//! The part of a moving triangle that is in a cell at mid-shutter, and its bounds over the shutter.
//!
//! A part is a polygon whose corners are fixed points of the triangle (barycentric weights) and move along with it. A
//! point of the triangle that is in the cell at mid-shutter is in the polygon at every other time as well: this is how
//! MSBVH bounds the parts of a spatial split. Cells that share a face clip the triangle at the same points up to
//! rounding in f64, which is far less than the padding of boxes.

use super::ULP;
use super::boxes::{Box3, MovingBox};
use mbkd::baseline::TriangleTests;
use mbkd::glam::{DVec3, Vec3};

/// Weights of the triangle's corners.
type Place = [f64; 3];

/// Three corners, one more for each of the six clipping planes, and a reserve for rounding of slivers.
const MOST: usize = 16;

/// The bounds of a part.
pub struct Part {
    /// Over the shutter.
    pub bounds: MovingBox,
    /// At mid-shutter, where splits are chosen.
    pub middle: Box3,
}

/// The part of a triangle in a cell; `None` if no point of it is there at mid-shutter.
pub fn part_in(tests: &TriangleTests, index: u32, cell: Box3) -> Option<Part> {
    let corners = tests.corners(index, 0.5).map(Vec3::as_dvec3);
    let mut polygon = [[0.0; 3]; MOST];
    polygon[..3].copy_from_slice(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let mut n = 3;
    for axis in 0..3 {
        for (sign, face) in [(1.0, cell.min[axis]), (-1.0, cell.max[axis])] {
            if face.is_finite() {
                n = cut(&mut polygon, n, |place| sign * (at(corners, place)[axis] - f64::from(face)));
            }
        }
    }
    let places = &polygon[..n];
    if places.is_empty() {
        return None;
    }
    let keys = tests.keys(index);
    let last = (keys - 1).max(1);
    let mut magnitude = 0.0f32;
    let mut at_key = |key: usize| {
        let corners = tests.corners(index, key as f32 / last as f32);
        magnitude = magnitude.max(Box3::of(corners).magnitude());
        box_of(corners.map(Vec3::as_dvec3), places)
    };
    let mut bounds = MovingBox { open: at_key(0), close: at_key(keys - 1) };
    // Bent motion: the linear interpolation of both ends, moved outward until it holds the inner keys.
    for key in 1..last {
        let inner = at_key(key);
        let t = key as f32 / last as f32;
        let min = bounds.open.min + (bounds.close.min - bounds.open.min) * t;
        let max = bounds.open.max + (bounds.close.max - bounds.open.max) * t;
        let (low, high) = ((min - inner.min).max(Vec3::ZERO), (inner.max - max).max(Vec3::ZERO));
        (bounds.open.min, bounds.close.min) = (bounds.open.min - low, bounds.close.min - low);
        (bounds.open.max, bounds.close.max) = (bounds.open.max + high, bounds.close.max + high);
    }
    // The error of the kernel's corners at a time is at most 4 ULP, and 2 more for each segment, whose number the time
    // is multiplied by; each shift above is rounded by at most 8.
    let by = (8 + 10 * keys) as f32 * ULP * magnitude;
    let bounds = MovingBox { open: bounds.open.pad(by), close: bounds.close.pad(by) };
    Some(Part { bounds, middle: box_of(corners, places).intersection(cell) })
}

/// A point of a triangle by its weights.
fn at(corners: [DVec3; 3], place: Place) -> DVec3 {
    corners[0] * place[0] + corners[1] * place[1] + corners[2] * place[2]
}

fn box_of(corners: [DVec3; 3], places: &[Place]) -> Box3 {
    Box3::of(places.iter().map(|place| at(corners, *place).as_vec3()))
}

/// Clips a polygon with `n` corners to distances of at least zero (Sutherland and Hodgman); returns the new number of
/// corners.
fn cut(polygon: &mut [Place; MOST], n: usize, distance: impl Fn(Place) -> f64) -> usize {
    let (mut kept, mut m) = ([[0.0; 3]; MOST], 0);
    let mut keep = |place: Place| {
        if m < MOST {
            kept[m] = place;
            m += 1;
        }
    };
    for i in 0..n {
        let (p, q) = (polygon[i], polygon[(i + 1) % n]);
        let (a, b) = (distance(p), distance(q));
        if a >= 0.0 {
            keep(p);
        }
        if (a >= 0.0) != (b >= 0.0) {
            let s = a / (a - b);
            keep(std::array::from_fn(|k| p[k] + (q[k] - p[k]) * s));
        }
    }
    *polygon = kept;
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd::TriangleMesh;

    #[test]
    fn both_parts_of_a_split_triangle_hold_it_at_every_time() {
        let open = vec![Vec3::new(-1.0, -0.5, 0.1), Vec3::new(0.9, -0.2, 0.3), Vec3::new(0.1, 0.8, -0.6)];
        let close = vec![Vec3::new(-0.2, 0.5, 0.4), Vec3::new(0.5, 0.6, -0.3), Vec3::new(-0.7, -0.8, 0.2)];
        let middle = vec![Vec3::new(0.3, -0.5, 0.9), Vec3::new(0.5, 0.2, -0.3), Vec3::new(-0.7, 0.1, 0.2)];
        let tests = TriangleTests::new(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, middle, close])]).unwrap();
        let halves = [false, true].map(|above| part_in(&tests, 0, Box3::ALL.side(0, 0.05, above)).unwrap());
        for time in (0..=64).map(|i| i as f32 / 64.0) {
            let corners = tests.corners(0, time);
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (u, v) = (i as f32 / 20.0, j as f32 / 20.0);
                    let p = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
                    let holds = |part: &Part| {
                        let MovingBox { open, close } = part.bounds.padded();
                        let low = open.min + (close.min - open.min) * time;
                        let high = open.max + (close.max - open.max) * time;
                        p.cmpge(low).all() && p.cmple(high).all()
                    };
                    assert!(halves.iter().any(holds), "{p} at {time}");
                }
            }
        }
        let whole = part_in(&tests, 0, Box3::ALL).unwrap().bounds.swept().half_area();
        assert!(halves.iter().all(|half| half.bounds.swept().half_area() < whole));
    }

    #[test]
    fn triangles_outside_of_a_cell_have_no_part() {
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let tests = TriangleTests::new(&[TriangleMesh::fixed(vec![[0, 1, 2]], corners)]).unwrap();
        assert!(part_in(&tests, 0, Box3::ALL.side(2, 0.5, true)).is_none());
        assert!(part_in(&tests, 0, Box3::ALL.side(2, 0.0, true)).is_some(), "closed cells");
    }
}
