//! `PointTree::bounds` holds all points at all times, and little more.

use super::support::{Random, cloud};
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{
    Aabb, MovingPoint, PointArrays, PointParams, PointStructure, PointTree, Precision, TreePoint, Visitor, glam::Vec3,
};

/// The smallest box around what queries see at a time.
struct Seen(Aabb);

impl Visitor<TreePoint> for Seen {
    fn enter(&mut self, _: &Aabb) -> Option<f32> {
        Some(0.0)
    }

    fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
        self.0 = self.0.union(Aabb::of_points([point.position]));
        ControlFlow::Continue(())
    }
}

/// Checks the bounds of a tree; `most` is how much larger than needed they may be, relative to their size.
fn check(tree: &PointTree, most: f64, what: &str) {
    let bounds = tree.bounds().expect("there are points");
    let mut seen = Seen(Aabb::EMPTY);
    let times = (0..=200).map(|i| i as f32 / 200.0);
    for time in times.chain([0.5f32.next_down(), 0.5f32.next_up(), 1.0f32.next_down()]) {
        assert!(tree.traverse(time, &mut seen).is_continue());
    }
    let Aabb { min, max } = seen.0;
    assert!(bounds.contains(min) && bounds.contains(max), "{what}: {bounds:?} around {min}, {max}");
    let more = (min - bounds.min).max(bounds.max - max).max_element();
    assert!(more <= most * (max - min).max_element(), "{what}: {bounds:?} around {min}, {max}");
}

#[test]
fn bounds_hold_all_points_at_all_times_and_little_more() {
    let mut rng = Random(7);
    for kind in ["uniform", "random", "fast few", "flows", "converging", "coherent", "short intervals"] {
        let cloud = cloud(kind, 500, &mut rng);
        let points: Vec<MovingPoint> = (0..500)
            .map(|i| {
                let [open, close] = [0, 1].map(|key| cloud.keys[key.min(cloud.keys.len() - 1)][i]);
                MovingPoint { open, close, active: cloud.active[i] }
            })
            .collect();
        use PointStructure::{Automatic, Kd, Linear, TimeSlices};
        for structure in [Automatic, Linear, TimeSlices(3), Kd] {
            let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
            check(&tree, 0.1, &format!("{kind}, {structure:?}"));
        }
    }
}

#[test]
fn bounds_are_in_the_callers_coordinates_for_all_precisions_and_keys() {
    let mut rng = Random(8);
    let far = DVec3::new(1e9, -3e9, 7.0);
    let keys: Vec<Vec<DVec3>> = (0..4).map(|_| (0..300).map(|_| far + rng.vec().as_dvec3()).collect()).collect();
    for precision in [Precision::Automatic, Precision::Single, Precision::Double] {
        for keys in [&keys[..1], &keys[..2], &keys[..]] {
            let keys: Vec<&[DVec3]> = keys.iter().map(|key| &key[..]).collect();
            let set = PointArrays { keys: &keys, active: &[], ids: &[] };
            let tree = PointTree::build(&set, &PointParams { precision, ..PointParams::default() }).unwrap();
            check(&tree, 0.1, &format!("{precision:?}, {} keys", keys.len()));
        }
    }
}

#[test]
fn no_points_have_no_bounds() {
    let tree = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    assert_eq!(tree.bounds(), None);
}
