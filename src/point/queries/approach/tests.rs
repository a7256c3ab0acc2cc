//! The bounds of boxes that closest approaches use, and how many nodes they visit.

use super::*;
use crate::point::build::time_slices::time_slices;
use crate::point::leaf_order::moving_reference::MovingReference;
use crate::point::{PointArrays, PointParams, PointStructure, Precision};
use crate::progress::Progress;
use crate::random::Random;
use core::cell::Cell;
use glam::Vec3;

const RUNNERS: usize = 100;

/// Points of a time slice in which the median moves with the velocity `plane` and is at zero at the end, like the plane through
/// it, with points on either side; and runners with a velocity of their own that cross the plane about then.
fn crossing_at_the_end(
    slice: &SegmentSlice,
    plane: f32,
    runners: f32,
    sides: [usize; 2],
    random: &mut Random,
) -> Vec<MovingReference> {
    let [left, right] = sides;
    let reference = |id: usize| {
        let (close, velocity) = match id {
            0..RUNNERS => (3.0 * f32::EPSILON * random.signed() * (plane - runners).abs(), runners),
            RUNNERS => (0.0, plane),
            _ => ((0.5 + 0.5 * random.unit()) * if id <= RUNNERS + left { -1.0 } else { 1.0 }, plane),
        };
        let (open, close) = ([close - velocity / (slice.keys - 1) as f32, 0.0, 0.0], [close, 0.0, 0.0]);
        let (interval, active) = (slice.interval, TimeInterval::FULL);
        MovingReference { open, close, interval, active, id: id as u32, fast: false }
    };
    (0..RUNNERS + 1 + left + right).map(reference).collect()
}

/// Counts runners that are not found by queries that meet them at the end of the segment, if something is known that is just as
/// near as far as f64 tells. The queries come from beyond the plane.
fn lost([plane, runners]: [f32; 2], sides: [usize; 2], slack: impl Fn(&KdPoints, u32, &Plane) -> f64) -> usize {
    let (mut random, mut lost) = (Random(43), 0);
    // The slices that end before the key does, in segments.
    let slices = (500..540).flat_map(|keys| time_slices(keys, 1));
    let behind = |slice: &SegmentSlice, time: f32| exact_phase(time, slice.keys, slice.segment) - 1.0;
    let size = |slice: &SegmentSlice| (slice.keys - 1) as f64 / 16_777_216.0;
    for slice in slices.filter(|slice| behind(slice, slice.interval.end()) < -0.7 * size(slice)) {
        let references = crossing_at_the_end(&slice, plane, runners, sides, &mut random);
        let tree = KdPoints::build(&references, slice, 16.0, &Progress::new(None));
        let times = [slice.interval.end(), slice.interval.end() + f32::EPSILON];
        for m in &references[..RUNNERS] {
            let [from, to] = times.map(|time| {
                let way = behind(&slice, time) / size(&slice) * f64::from(plane - runners).signum();
                DVec3::X * (f64::from(m.close[0]) + way)
            });
            let times = times.map(f64::from);
            let path = QueryPath { from, to, times, keys: slice.keys };
            let mut search = Search::new(1.5e-14);
            path.search_kd(&tree, &slack, &|id| id == m.id, &mut search);
            lost += usize::from(search.pending.is_empty() && search.best.is_none());
        }
    }
    lost
}

#[test]
fn planes_at_the_end_of_a_segment_exclude_no_answer_and_would_with_less_slack() {
    let fast_runners = ([0.0, 1.0], [RUNNERS, 2 * RUNNERS - 1]);
    let fast_plane = ([1.0, 0.0], [RUNNERS + 1, 0]);
    for (velocities, sides) in [fast_runners, fast_plane] {
        assert_eq!(lost(velocities, sides, plane_slack), 0, "{velocities:?}");
        assert!(lost(velocities, sides, |_, _, plane| plane_error(plane)) > 100, "{velocities:?}");
    }
    assert!(lost(fast_plane.0, fast_plane.1, |tree, node, _| tree.slack(node)) > 100);
}

/// A query that crosses a set is never near most of the boxes which it passes along each axis.
#[test]
fn a_long_path_visits_the_nodes_along_it() {
    let mut random = Random(44);
    let mut place = || Vec3::from_array(core::array::from_fn(|_| random.signed()));
    let set: Vec<Vec3> = (0..100_000).map(|_| place()).collect();
    let tree = PointTree::build(&set[..], &PointParams::default()).unwrap();
    let Layer::Static(boxes) = &tree.layers[0] else { panic!("points at rest") };
    let mut visited = 0;
    for _ in 0..50 {
        let [from, to] = [place(), place()].map(Vec3::as_dvec3);
        let path = QueryPath { from, to: from + (to - from) * 10.0, times: [0.0, 1.0], keys: 1 };
        let mut search = Search::new(f64::INFINITY);
        path.search_boxes(tree.simd, boxes, &|_| true, &mut search);
        search.resolve(&path);
        let best = search.best.map(|best| best.answer.distance).unwrap();
        let (way, length) = ((path.to - path.from).normalize(), (path.to - path.from).length());
        let off = |p: &Vec3| {
            let offset = p.as_dvec3() - path.from;
            (offset - way * offset.dot(way).clamp(0.0, length)).length()
        };
        let least = set.iter().map(off).fold(f64::INFINITY, f64::min);
        assert!((f64::from(best) - least).abs() <= 1e-6 * least, "{best} instead of {least}");
        visited += search.visited;
    }
    // 23 for a query; 53 if boxes are only compared axis by axis.
    assert!(visited < 50 * 35, "{visited}");
}

#[test]
fn a_long_path_through_a_kd_tree_visits_the_nodes_along_it() {
    let mut random = Random(45);
    let mut place = || Vec3::from_array(core::array::from_fn(|_| random.signed()));
    let open: Vec<Vec3> = (0..30_000).map(|_| place()).collect();
    let close: Vec<Vec3> = open.iter().map(|&at| at + 0.01 * place()).collect();
    let params = PointParams { structure: PointStructure::Kd, ..PointParams::default() };
    let tree = PointTree::build(&PointArrays { keys: &[&open, &close], active: &[], ids: &[] }, &params).unwrap();
    let Layer::Kd(slices) = &tree.layers[0] else { panic!("a k-d tree") };
    let planes = Cell::new(0);
    for _ in 0..50 {
        let [from, to] = [place(), place()].map(Vec3::as_dvec3);
        let path = QueryPath { from, to: from + (to - from) * 10.0, times: [0.0, 1.0], keys: 2 };
        let mut search = Search::new(f64::INFINITY);
        let counted = |tree: &KdPoints, node: u32, plane: &Plane| {
            planes.update(|count| count + 1);
            plane_slack(tree, node, plane)
        };
        slices.iter().for_each(|slice| path.search_kd(slice, counted, &|_| true, &mut search));
        search.resolve(&path);
        let best = search.best.map(|best| best.answer).unwrap();
        let all = |_| true;
        let [from, to] = [path.from, path.to].map(|p| p.as_vec3());
        let same = tree.approach_within([from, to], TimeInterval::FULL, f64::INFINITY, &all).unwrap();
        assert!((best.distance - same.distance).abs() < 1e-6, "{best:?} and {same:?}");
    }
    assert!(planes.get() < 50 * 700, "{}", planes.get());
}

/// How many points of 20 000 in a row pass the bounds of a search, and its answer.
fn compared(
    structure: PointStructure,
    precision: Precision,
    keys: &[Vec<DVec3>],
    path: [DVec3; 2],
) -> (usize, Approach) {
    let keys: Vec<&[DVec3]> = keys.iter().map(|key| &key[..]).collect();
    let params = PointParams { structure, precision, ..PointParams::default() };
    let tree = PointTree::build(&PointArrays { keys: &keys, active: &[], ids: &[] }, &params).unwrap();
    let count = Cell::new(0);
    let count_all = |_| {
        count.update(|count| count + 1);
        true
    };
    let answer = tree.closest_approach_filtered(path[0], path[1], TimeInterval::FULL, count_all).unwrap();
    (count.get(), answer)
}

/// The first time at which a query that goes along an axis is beside a point that moves along it too.
fn first_to_meet(keys: &[Vec<DVec3>], path: [DVec3; 2], axis: usize) -> f32 {
    let [from, to] = path.map(|p| p[axis]);
    let (open, close) = (&keys[0], &keys[keys.len() - 1]);
    let time = |(a, b): (&DVec3, &DVec3)| (a[axis] - from) / ((to - from) - (b[axis] - a[axis]));
    open.iter().zip(close).map(time).fold(f64::INFINITY, f64::min) as f32
}

/// All points of a row come as near to a query that goes along it. The first is the answer, whichever that is.
#[test]
fn few_points_of_a_row_beside_a_path_are_compared() {
    use PointStructure::{Automatic, Kd, Linear, TimeSlices};
    let random = &mut Random(46);
    let places: Vec<f32> = (0..20_000).map(|_| random.signed()).collect();
    for (axis, beside) in [(0, 0.0), (1, 0.5), (2, 7.0)] {
        let (way, side) = (DVec3::AXES[axis], DVec3::AXES[(axis + 1) % 3] * beside);
        let still: Vec<DVec3> = places.iter().map(|&x| way * f64::from(x)).collect();
        let moved: Vec<DVec3> = still.iter().map(|&p| p + way * f64::from(0.1 * random.unit())).collect();
        for keys in [vec![still.clone()], vec![still.clone(), moved]] {
            for structure in [Automatic, Linear, TimeSlices(3), Kd] {
                for precision in [Precision::Single, Precision::Double] {
                    if structure == Kd && precision == Precision::Double {
                        continue;
                    }
                    for sign in [1.0, -1.0] {
                        let path = [side - way * (1.5 * sign), side + way * (1.5 * sign)];
                        let (count, answer) = compared(structure, precision, &keys, path);
                        let what =
                            format!("{structure:?}, {precision:?}, axis {axis}, {beside} away, {} keys", keys.len());
                        assert!(answer.distance == beside as f32, "{what}: {answer:?}");
                        // A node of nodes that were found before the first point is compared as a whole. Planes are in f32, too
                        // coarse for ties at a distance.
                        let planes = structure == Kd && keys.len() > 1 && beside > 0.0;
                        assert!(count < 5000 || planes, "{what}: {count}");
                        let exact = first_to_meet(&keys, path, axis);
                        // Where moving points are met, their distances are what is rounded, and only some are zero.
                        let all_tie = beside > 0.0 || keys.len() == 1;
                        let late = answer.time - exact;
                        assert!(late > -1e-6 && (!all_tie || late < 1e-6), "{what}: {answer:?} instead of {exact}");
                    }
                }
            }
        }
    }
}
