//! A distant point must not make searches among the others slower: counted work with and without it.

use crate::support::Random;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborWork, PointParams, PointStructure, PointTree, Precision};

/// Work of searches among the points of the unit cube, for few and for many neighbours.
fn work(tree: &PointTree) -> [NeighborWork; 2] {
    [1, 20].map(|k| {
        let mut rng = Random(77);
        let mut sum = NeighborWork::default();
        for _ in 0..300 {
            let work = tree.query((rng.vec() + 1.0) * 0.5, rng.unit()).work(k);
            (sum.nodes, sum.blocks) = (sum.nodes + work.nodes, sum.blocks + work.blocks);
        }
        sum
    })
}

/// The work with outliers may be that without them, half as much again, and a descent to each of their references: one,
/// or up to nine if fast points are split.
fn compare(points: &[MovingPoint], structure: PointStructure, precision: Precision) {
    let params = PointParams { structure, precision, ..PointParams::default() };
    let alone = work(&PointTree::build(points, &params).unwrap());
    let one = MovingPoint::fixed;
    let outliers = [
        vec![one(Vec3::splat(1e6))],
        vec![one(Vec3::splat(-1e6))],
        vec![one(Vec3::new(0.5, 1e9, 0.5))],
        vec![MovingPoint::new(Vec3::splat(-1e6), Vec3::splat(1e6))],
        vec![one(Vec3::new(1e6, -1e6, 0.0)), one(Vec3::new(-1e6, 1e6, 3e5)), one(Vec3::splat(-1e9))],
    ];
    for outliers in outliers {
        let all: Vec<MovingPoint> = points.iter().chain(&outliers).copied().collect();
        let tree = PointTree::build(&all, &params).unwrap();
        for (with, without) in work(&tree).into_iter().zip(alone) {
            let [with, without] = [with, without].map(|w| w.nodes + w.blocks);
            let sides = if structure == PointStructure::Kd { 9 } else { 1 };
            let most = without * 3 / 2 + 300 * (4 + 4 * sides) * outliers.len() as u64;
            assert!(
                with <= most,
                "{structure:?}, {precision:?}, {} points, {outliers:?}: {with} for {without}",
                points.len()
            );
        }
    }
}

#[test]
fn moving_points() {
    let mut rng = Random(1);
    let mut point = |_| {
        let p = (rng.vec() + 1.0) * 0.5;
        MovingPoint::new(p, p + rng.vec() * 0.01)
    };
    let points: Vec<MovingPoint> = (0..200_000).map(&mut point).collect();
    use PointStructure::*;
    for structure in [Linear, TimeSlices(2), Kd, Automatic] {
        compare(&points, structure, Precision::Single);
    }
    for structure in [Linear, TimeSlices(2), Automatic] {
        compare(&points[..50_000], structure, Precision::Double);
    }
}

/// A set with leaves of two blocks, and a larger one with leaves of one.
#[test]
fn still_points() {
    let mut rng = Random(2);
    let points: Vec<MovingPoint> = (0..700_000).map(|_| MovingPoint::fixed((rng.vec() + 1.0) * 0.5)).collect();
    compare(&points[..100_000], PointStructure::Automatic, Precision::Single);
    compare(&points, PointStructure::Automatic, Precision::Single);
    compare(&points[..100_000], PointStructure::Automatic, Precision::Double);
}
