//! Distributing references to the children of a split plane: the paper's duplication (section 3.1.1) and
//! propagation (section 3.1.2).
//!
//! A node under construction has Normal references, which are in its cell at mid-shutter and choose its plane,
//! and BP references, which enter the cell at another time only. Both are classified against the plane
//! with the same code ([`classify`]); this is called duplication for the first and propagation
//! for the second.

use super::classify::classify;
use super::reference::{Moving, Reference};
use crate::geometry::{LinearBox3, Plane};

/// The references of a node under construction.
#[derive(Debug)]
pub(crate) struct References<B> {
    /// In the cell at mid-shutter.
    pub normal: Vec<Reference<B>>,
    /// In the cell at another time: the paper's virtual BP node.
    pub bp: Vec<Reference<B>>,
}

impl<B> References<B> {
    const NONE: References<B> = References { normal: Vec::new(), bp: Vec::new() };

    pub fn len(&self) -> usize {
        self.normal.len() + self.bp.len()
    }

    pub fn iter(&self) -> impl Iterator<Item = &Reference<B>> {
        self.normal.iter().chain(&self.bp)
    }
}

/// The two children of a node while references are distributed to them.
pub(crate) struct Children<'a, M: Moving> {
    objects: &'a M,
    plane: Plane,
    /// Cells at shutter open and close: left, right.
    pub cells: [LinearBox3; 2],
    pub references: [References<M::Bounds>; 2],
}

impl<'a, M: Moving> Children<'a, M> {
    pub fn new(objects: &'a M, plane: Plane, cell: LinearBox3) -> Children<'a, M> {
        // A moving plane may leave the parent's cell at other times. Using the plane as the child's face anyway
        // keeps the cell a superset of the true one, which is sufficient.
        let (open, close) = (plane.position, plane.position + plane.velocity);
        let (mut left, mut right) = (cell, cell);
        left.begin.max[plane.axis] = open;
        left.end.max[plane.axis] = close;
        right.begin.min[plane.axis] = open;
        right.end.min[plane.axis] = close;
        Children { objects, plane, cells: [left, right], references: [References::NONE, References::NONE] }
    }

    /// Duplication: a Normal reference that crosses the plane goes to the Normal node of the side where it is at
    /// mid-shutter and, duplicated, to the BP node of the other (the paper's four cases from the left and four
    /// from the right). One that lies across the plane at mid-shutter goes to both Normal nodes, one that never
    /// crosses to one.
    pub fn duplicate(&mut self, reference: &Reference<M::Bounds>) {
        self.assign(reference, reference.in_sah);
    }

    /// Propagation: a BP reference that does not cross this plane becomes a Normal reference of the one child, or
    /// of both if it lies across the plane throughout; one that crosses becomes Normal where it is at
    /// mid-shutter, or at the time of its interval that comes nearest, and stays BP on the other side: with the
    /// mirrored ones, six cases.
    pub fn propagate(&mut self, reference: &Reference<M::Bounds>, propagated_vote: bool) {
        self.assign(reference, propagated_vote);
    }

    fn assign(&mut self, reference: &Reference<M::Bounds>, in_sah: bool) {
        let sides = classify(self.objects.extent(reference, self.plane.axis), self.plane, M::ROUNDING);
        let both = sides.left.is_some() && sides.right.is_some();
        let time = reference.representative_time(self.objects.plane_time());
        for (side, interval) in [sides.left, sides.right].into_iter().enumerate() {
            let Some(interval) = interval else { continue };
            let normal = !both || interval.contains(time);
            let child = Reference { interval, in_sah: normal && in_sah, ..*reference };
            let Some(child) = self.objects.fitted(child, reference, self.cells[side], both) else { continue };
            let lists = &mut self.references[side];
            if normal { lists.normal.push(child) } else { lists.bp.push(child) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::kd::primitives::Primitives;
    use crate::primitive::{TriangleMesh, Triangles};
    use glam::Vec3;

    /// The result of the reference on each side: Normal or BP, and its interval.
    type Sides = [Option<(&'static str, f32, f32)>; 2];

    fn sides(children: &Children<Primitives<Triangles>>) -> Sides {
        [0, 1].map(|side| {
            let References { normal, bp } = &children.references[side];
            assert!(normal.len() + bp.len() <= 1);
            let seen = |kind, r: &Reference<_>| (kind, r.interval.begin(), r.interval.end());
            normal.first().map(|r| seen("Normal", r)).or(bp.first().map(|r| seen("BP", r)))
        })
    }

    fn assert_sides(got: Sides, expected: Sides, what: &str) {
        for (g, e) in got.iter().zip(&expected) {
            match (g, e) {
                (None, None) => {}
                (Some(g), Some(e)) => {
                    assert!(g.0 == e.0 && (g.1 - e.1).abs() < 1e-5 && (g.2 - e.2).abs() < 1e-5, "{what}: {got:?}")
                }
                _ => panic!("{what}: {got:?} instead of {expected:?}"),
            }
        }
    }

    #[test]
    fn duplication_and_the_six_cases_of_propagation() {
        for sign in [1.0f32, -1.0] {
            // x in [-1, -0.8] at shutter open, [0.2, 0.4] at shutter close; y from -1 to 1 throughout.
            let at = |x: f32| {
                [Vec3::new(x, -1.0, 0.0), Vec3::new(x + 0.2, 1.0, 0.0), Vec3::new(x, 1.0, 0.5)]
                    .map(|p| Vec3::new(p.x * sign, p.y, p.z))
            };
            // Two static points make tree space equal to world space.
            let frame = [Vec3::NEG_ONE, Vec3::ONE];
            let key = |x: f32| at(x).into_iter().chain(frame).collect::<Vec<Vec3>>();
            let mesh = TriangleMesh::new(vec![[0, 1, 2]], vec![key(-1.0), key(0.2)]);
            let set = Triangles::new(&[mesh]).unwrap();
            let params = crate::params::KdParams::paper();
            let source = Primitives { set: &set, params: &params };
            let cube = Box3 { min: Vec3::NEG_ONE, max: Vec3::ONE };
            let root = LinearBox3 { begin: cube, end: cube };
            let reference = source.reference(0);
            let plane = |axis: usize, position: f32| {
                let position = if axis == 0 { position * sign } else { position };
                Plane { axis, position, velocity: 0.0 }
            };
            let order = |sides: Sides| if sign > 0.0 { sides } else { [sides[1], sides[0]] };

            // Left at mid-shutter, across from 2/3, past at 5/6 + ...: Normal on the left, BP on the right.
            let mut top = Children::new(&source, plane(0, 0.0), root);
            top.duplicate(&reference);
            let cross = [Some(("Normal", 0.0, 5.0 / 6.0)), Some(("BP", 2.0 / 3.0, 1.0))];
            assert_sides(order(sides(&top)), cross, "duplication");
            let right = usize::from(sign > 0.0);
            let bp = top.references[right].bp[0];
            let cell = top.cells[right];
            let propagated = |axis, position| {
                let mut children = Children::new(&source, plane(axis, position), cell);
                children.propagate(&bp, true);
                children
            };
            // Does not cross: the one child, or the other, or both throughout.
            let one = Some(("Normal", 2.0 / 3.0, 1.0));
            assert_sides(order(sides(&propagated(0, 0.9))), [one, None], "stays before the plane");
            assert_sides(order(sides(&propagated(0, -0.5))), [None, one], "stays beyond the plane");
            assert_sides(sides(&propagated(1, 0.0)), [one, one], "lies across the plane");
            // Crosses: Normal on the side where it is when nearest to mid-shutter, BP on the other.
            let later = [one, Some(("BP", 11.0 / 12.0, 1.0))];
            assert_sides(order(sides(&propagated(0, 0.3))), later, "comes to cross the plane");
        }
    }
}
