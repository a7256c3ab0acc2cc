//! Comparing the same moving set as points and as spheres of radius zero.

use super::kd_tree::{KdTree, KdView};
use super::partition::{Children, References};
use super::primitives::Primitives;
use super::reference::Moving;
use super::sah::{Bounds, BoxReference};
use super::trajectories::{PointReference, Trajectories, Trajectory, build_kd_over_points};
use crate::geometry::{LinearBox3, Plane, TimeInterval};
use crate::params::KdParams;
use crate::primitive::{MovingSphere, PrimitiveSet, Scene};
use crate::progress::Progress;
use crate::random::Random;
use glam::Vec3;
use std::collections::BTreeSet;

const POINTS: Trajectories = Trajectories { segments: 1, segment: 0, middle: 0.5 };

/// Points that move within the cube, every third active for a part of the shutter only, and the same as spheres.
fn both_kinds(count: usize) -> (Vec<PointReference>, Scene) {
    let mut random = Random(17);
    let paths: Vec<[Vec3; 2]> = (0..count)
        .map(|i| {
            let p = random.vec();
            // Still, slow, and far.
            [p, (p + random.vec() * [0.0, 0.05, 1.0][i % 3]).clamp(Vec3::NEG_ONE, Vec3::ONE)]
        })
        .collect();
    let active = |i: usize| match i % 3 {
        0 => TimeInterval::new(0.1, 0.7).unwrap(),
        _ => TimeInterval::FULL,
    };
    let sphere = |(i, keys): (usize, &[Vec3; 2])| {
        MovingSphere::new(keys.map(|p| (p.as_dvec3(), 0.0)).to_vec()).with_active(active(i))
    };
    let spheres = Scene::new(&[], Box::new(paths.iter().enumerate().map(sphere).collect::<Vec<_>>())).unwrap();
    let frame = spheres.frame();
    let point = |(i, keys): (usize, &[Vec3; 2])| {
        let [open, close] = keys.map(|p| frame.point(p.as_dvec3()).to_array());
        PointReference { id: i as u32, interval: active(i), bounds: Trajectory { open, close }, in_sah: true }
    };
    (paths.iter().enumerate().map(point).collect(), spheres)
}

/// The children of a plane, with the references distributed to them.
fn parted<'a, M: Moving>(
    objects: &'a M,
    plane: Plane,
    cell: LinearBox3,
    all: &References<M::Bounds>,
) -> Children<'a, M> {
    let mut children = Children::new(objects, plane, cell);
    all.normal.iter().for_each(|r| children.duplicate(r));
    all.bp.iter().for_each(|r| children.propagate(r, true));
    children
}

/// How far outside of a half-space something in it may seem to be: bounds are rounded outward to f32 and padded, times
/// are rounded outward by up to two steps.
const ROUNDING: f64 = 4e-7;

struct Compared {
    /// References in leaves: of points, of spheres, of those that only the rounding makes, and of those that touch.
    counts: [usize; 4],
    /// Spheres on the other side of a plane that their centre moves in: planes move with the median of velocities, so there is
    /// one now and then. A point is on one side of such a plane, a sphere touches both.
    in_planes: BTreeSet<u32>,
}

impl Compared {
    /// Distributes the references of both kinds down a finished tree and compares them below every plane.
    fn descend(
        &mut self,
        tree: &KdTree,
        node: usize,
        cell: LinearBox3,
        points: References<Trajectory>,
        (spheres, boxes): (&Primitives<'_, Scene>, References<Bounds>),
    ) {
        let KdView::Inner { plane, right } = tree.nodes[node].view() else {
            self.counts[0] += points.len();
            self.counts[1] += boxes.len();
            let alone = boxes.iter().filter(|r| points.iter().all(|p| p.id != r.id));
            let (touching, rounded): (Vec<&BoxReference>, Vec<&BoxReference>) =
                alone.partition(|r| self.in_planes.contains(&r.id));
            self.counts[2] += rounded.len();
            self.counts[3] += touching.len();
            return;
        };
        let (of_points, of_boxes) = (parted(&POINTS, plane, cell, &points), parted(spheres, plane, cell, &boxes));
        let cells = of_points.cells;
        let sides = of_points.references.into_iter().zip(of_boxes.references).zip(cells);
        for (side, ((points, boxes), cell)) in sides.enumerate() {
            for point in points.iter() {
                let around: Vec<&BoxReference> = boxes.iter().filter(|r| r.id == point.id).collect();
                let [around] = around[..] else { panic!("{} references around {point:?}", around.len()) };
                let (inner, outer) = (point.interval, around.interval);
                let holds = outer.begin() <= inner.begin() && inner.end_bound() <= outer.end_bound();
                assert!(holds, "{outer:?} does not hold {inner:?} of {}", point.id);
            }
            for outer in boxes.iter() {
                let LinearBox3 { begin, end } = outer.bounds.whole;
                let mut farthest: f64 = 0.0;
                for (t, b) in [(outer.interval.begin(), begin), (outer.interval.end(), end)] {
                    let x = 0.5 * (f64::from(b.min[plane.axis]) + f64::from(b.max[plane.axis]));
                    let outside = if side == 0 { x - plane.at(t) } else { plane.at(t) - x };
                    farthest = farthest.max(outside.abs());
                    assert!(outside <= ROUNDING, "{outer:?} counts {outside} outside of its side at {t}");
                }
                let long = outer.interval.end() - outer.interval.begin() > 0.01;
                if long && farthest <= ROUNDING && points.iter().all(|p| p.id != outer.id) {
                    self.in_planes.insert(outer.id);
                }
            }
            let child = if side == 0 { node + 1 } else { right as usize };
            self.descend(tree, child, cell, points, (spheres, boxes));
        }
    }
}

#[test]
fn points_and_spheres_of_radius_zero_differ_by_the_rounding_only() {
    let (points, set) = both_kinds(600);
    let params = KdParams::default();
    let spheres = Primitives { set: &set, params: &params };
    let tree = build_kd_over_points(POINTS, points.clone(), 8.0 * points.len() as f64, &Progress::new(None));
    assert!(tree.depth >= 5 && tree.references.len() > points.len() * 5 / 4, "{} references", tree.references.len());
    let boxes = (0..set.len() as u32).map(|id| spheres.reference(id)).collect();
    let cell = LinearBox3 { begin: tree.root, end: tree.root };
    let mut compared = Compared { counts: [0; 4], in_planes: BTreeSet::new() };
    let points = References { normal: points, bp: Vec::new() };
    compared.descend(&tree, 0, cell, points, (&spheres, References { normal: boxes, bp: Vec::new() }));
    let [of_points, of_spheres, by_rounding, touching] = compared.counts;
    assert_eq!(of_points, tree.references.len(), "the build made other references");
    assert_eq!(of_spheres, of_points + by_rounding + touching);
    assert!(by_rounding * 100 < of_points, "{by_rounding} of {of_spheres} references by rounding alone");
    assert_eq!(touching, compared.in_planes.len(), "each touches one plane, and on one leaf's side");
}

#[test]
fn every_point_is_in_one_leaf_at_every_time() {
    let (points, _) = both_kinds(2000);
    let tree = build_kd_over_points(POINTS, points.clone(), 8.0 * points.len() as f64, &Progress::new(None));
    let crossings = tree.references.iter().flat_map(|r| [r.begin, r.begin.next_down(), r.end.min(1.0)]);
    let times: Vec<f32> = crossings.step_by(97).chain([0.0, 0.5, 1.0]).filter(|t| (0.0..=1.0).contains(t)).collect();
    assert!(times.len() > 50);
    for time in times {
        let mut counts = vec![0; points.len()];
        tree.references.iter().filter(|r| r.is_active_at(time)).for_each(|r| counts[r.id as usize] += 1);
        for (point, count) in points.iter().zip(counts) {
            assert_eq!(count, usize::from(point.interval.contains(time)), "{} at {time}", point.id);
        }
    }
}

#[cfg(feature = "rayon")]
#[test]
fn the_same_tree_of_points_on_any_number_of_threads() {
    let (points, _) = both_kinds(20_000);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build_kd_over_points(POINTS, points.clone(), 3.0 * points.len() as f64, &Progress::new(None)))
    };
    let one = on(1);
    assert!(one == on(2) && one == on(5));
}

#[test]
fn budgets_and_equal_points_make_leaves() {
    let (points, _) = both_kinds(2000);
    for most in [1.0, 1.2, 2.0] {
        let tree = build_kd_over_points(POINTS, points.clone(), most * 2000.0, &Progress::new(None));
        assert!(tree.references.len() <= (most * 2000.0) as usize);
    }
    let equal: Vec<_> = points.iter().map(|r| PointReference { bounds: points[0].bounds, ..*r }).collect();
    let tree = build_kd_over_points(POINTS, equal, 1e6, &Progress::new(None));
    assert_eq!((tree.nodes.len(), tree.references.len()), (1, 2000));
    assert_eq!(build_kd_over_points(POINTS, Vec::new(), 0.0, &Progress::new(None)).nodes.len(), 1);
}
