//! Custom traversals of point trees: every point is visited once, at its position, inside the boxes above it.

use crate::support::Random;
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Aabb, MovingPoint, PointParams, PointStructure, PointTree, TimeInterval, TreePoint, Visitor};

/// Visits all points of a region.
struct Region {
    region: Aabb,
    found: Vec<TreePoint>,
    /// Boxes that were offered.
    boxes: usize,
}

impl Visitor<TreePoint> for Region {
    fn enter(&mut self, b: &Aabb) -> Option<f32> {
        self.boxes += 1;
        let apart = b.min.cmpgt(self.region.max).any() || self.region.min.cmpgt(b.max).any();
        (!apart).then_some(0.0)
    }

    fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
        self.found.push(point);
        ControlFlow::Continue(())
    }
}

impl Region {
    fn of(tree: &PointTree, time: f32, region: Aabb) -> Region {
        let mut query = Region { region, found: Vec::new(), boxes: 0 };
        assert!(tree.traverse(time, &mut query).is_continue());
        query.found.sort_by_key(|point| point.id);
        query
    }
}

#[test]
fn every_point_is_visited_once_at_its_position() {
    let mut rng = Random(5);
    let some_time = TimeInterval::new(0.25, 0.75).unwrap();
    let moving: Vec<MovingPoint> = (0..3000)
        .map(|i| {
            let from = rng.vec();
            let point = MovingPoint::new(from, from + rng.vec() * if i % 20 == 0 { 1.5 } else { 0.1 });
            if i % 3 == 0 { point.with_active(some_time) } else { point }
        })
        .collect();
    let still: Vec<MovingPoint> = (0..3000).map(|_| MovingPoint::fixed(rng.vec())).collect();
    use PointStructure::{Automatic, Kd, Linear, TimeSlices};
    let everywhere = Aabb { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
    for points in [&moving, &still] {
        for structure in [Automatic, Linear, TimeSlices(3), Kd] {
            let params = PointParams { structure, ..PointParams::default() };
            let tree = PointTree::build(points, &params).unwrap();
            for time in [0.0, 0.2, 0.5, 1.0] {
                let all = Region::of(&tree, time, everywhere);
                // Exactly those that a search without a bound finds, at the positions that it computes.
                let mut found = tree.within(Vec3::ZERO, time, f32::INFINITY);
                found.sort_by_key(|neighbor| neighbor.id);
                assert!(all.found.iter().map(|p| p.id).eq(found.iter().map(|n| n.id)), "{structure:?} at {time}");
                for (point, neighbor) in all.found.iter().zip(&found) {
                    let p = point.position.as_vec3();
                    assert_eq!((p.x * p.x + p.y * p.y) + p.z * p.z, neighbor.distance_squared);
                }
                for point in all.found.iter().step_by(97) {
                    let only = Region::of(&tree, time, Aabb { min: point.position, max: point.position });
                    assert!(only.found.iter().any(|p| p.id == point.id), "{structure:?} at {time}: {point:?}");
                    assert!(only.boxes < all.boxes && only.found.len() < all.found.len() / 2);
                }
            }
            assert_eq!(Region::of(&tree, 1.5, everywhere).found.len(), 0);
        }
    }
}
