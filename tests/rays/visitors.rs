//! Custom traversals visit all primitives of a region, inside their boxes, and can prune and stop.

use crate::common::{Random, divided, soup, variants};
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{Aabb, BuildParams, Division, RayTree, TimeInterval, TreePrimitive, TriangleMesh, Visitor, WideParams};

/// Visits all primitives in a region, or all if there is no region.
struct Region {
    region: Option<Aabb>,
    found: Vec<TreePrimitive>,
    /// Boxes that were offered.
    boxes: usize,
    /// Number of primitives to be visited before it breaks.
    most: usize,
}

impl Region {
    fn new(region: Option<Aabb>) -> Region {
        Region { region, found: Vec::new(), boxes: 0, most: usize::MAX }
    }

    /// The visited primitives, each once.
    fn sorted(mut self) -> Vec<TreePrimitive> {
        self.found.sort();
        self.found.dedup();
        self.found
    }
}

impl Visitor<TreePrimitive> for Region {
    fn enter(&mut self, b: &Aabb) -> Option<f32> {
        self.boxes += 1;
        assert!(b.min.cmple(b.max).all(), "{b:?}");
        let apart = self.region.is_some_and(|r| b.min.cmpgt(r.max).any() || r.min.cmpgt(b.max).any());
        (!apart).then_some(0.0)
    }

    fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
        self.found.push(item);
        if self.found.len() == self.most { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

fn meshes() -> Vec<TriangleMesh> {
    let some_time = TimeInterval::new(0.25, 0.75).unwrap();
    vec![soup(300, 2, 0.2, 0.6, 1), soup(200, 4, 0.3, 0.4, 2), soup(200, 1, 0.5, 0.0, 3).with_active(some_time)]
}

fn trees(meshes: &[TriangleMesh]) -> Vec<RayTree> {
    let cut = BuildParams::wide(WideParams { max_references: 4.0, ..WideParams::default() });
    variants()
        .iter()
        .chain([&cut, &divided(Division::SharedLeaves(3))])
        .map(|params| RayTree::build(meshes, params).unwrap())
        .collect()
}

#[test]
fn all_primitives_with_a_point_in_a_region_are_visited() {
    let meshes = meshes();
    let exists = |mesh: u32, time: f32| meshes[mesh as usize].active.contains(time);
    let mut random = Random(5);
    for tree in trees(&meshes) {
        for time in [0.0, 0.3, 0.75, 1.0] {
            let mut all = Vec::new();
            for (mesh, of) in (0..).zip(&meshes).filter(|(mesh, _)| exists(*mesh, time)) {
                all.extend((0..of.len() as u32).map(|primitive| TreePrimitive { mesh, primitive }));
            }
            let mut everything = Region::new(None);
            assert!(tree.traverse(time, &mut everything).is_continue());
            let boxes = everything.boxes;
            assert_eq!(everything.sorted(), all, "{tree:?} at {time}");
            let mut offered = 0;
            for _ in 0..30 {
                // A region around a point of a triangle, as small as a point.
                let TreePrimitive { mesh, primitive } = all[random.below(all.len())];
                let [a, b, c] = tree.triangle(mesh, primitive, time);
                let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let at = [a, a + (b - a) * u + (c - a) * v][random.below(2)];
                // An inner point is rounded in f64.
                let region = Aabb { min: at, max: at }.pad(1e-14);
                let mut query = Region::new(Some(region));
                assert!(tree.traverse(time, &mut query).is_continue());
                offered += query.boxes;
                let met = query.sorted();
                assert!(met.contains(&TreePrimitive { mesh, primitive }), "{tree:?} {time} {at}");
            }
            // Most primitives are culled, though a point of a wide triangle may be in many boxes.
            assert!(offered < 25 * boxes, "{offered} of {}", 30 * boxes);
        }
    }
}

/// Counts primitives in boxes nearer to a point than a distance that is known only after entering them.
struct Nearest {
    to: DVec3,
    best: f64,
    visited: usize,
}

impl Visitor<TreePrimitive> for Nearest {
    fn enter(&mut self, b: &Aabb) -> Option<f32> {
        Some((self.to.clamp(b.min, b.max) - self.to).length() as f32)
    }

    fn wants(&self, priority: f32) -> bool {
        f64::from(priority) <= self.best
    }

    fn visit(&mut self, _: TreePrimitive) -> ControlFlow<()> {
        self.visited += 1;
        ControlFlow::Continue(())
    }
}

#[test]
fn visitors_can_stop_and_visit_nothing_outside_the_shutter() {
    let meshes = meshes();
    for tree in trees(&meshes) {
        let mut three = Region { most: 3, ..Region::new(None) };
        assert!(tree.traverse(0.5, &mut three).is_break());
        assert_eq!(three.found.len(), 3);
        for time in [-0.1, 1.1, f32::NAN] {
            let mut nothing = Region::new(None);
            assert!(tree.traverse(time, &mut nothing).is_continue());
            assert_eq!((nothing.boxes, nothing.found.len()), (0, 0));
        }
        // With a distance that no primitive has: boxes are deferred and then culled.
        let mut far = Nearest { to: DVec3::splat(50.0), best: 1.0, visited: 0 };
        assert!(tree.traverse(0.5, &mut far).is_continue());
        assert!(far.visited == 0);
        let mut near = Nearest { to: DVec3::splat(50.0), best: 1e3, visited: 0 };
        assert!(tree.traverse(0.5, &mut near).is_continue());
        assert!(near.visited >= 700);
    }
    let empty = RayTree::build(&[], &BuildParams::default()).unwrap();
    assert!(empty.traverse(0.5, &mut Region::new(None)).is_continue());
}
