//! Trees over shapes of the caller's, whose leaf blocks have the boxes of the shapes: at rest, moving, with divided time, and
//! refitted.

use crate::common::{Blob, Random, difference, divided, random_ray};
use mbkd::baseline::BruteForce;
use mbkd::{BuildParams, ClosestPointQuery, Division, MovingSphere, RayTree, SimdLevel, WideParams, glam::DVec3};

/// Some blobs that move that far between each of their keys.
fn blobs(count: usize, keys: usize, motion: f64, seed: u64) -> Vec<Blob> {
    let mut random = Random(seed);
    let mut one = || {
        let (from, by) = (random.vec().as_dvec3(), random.vec().as_dvec3() * motion);
        let radius = f64::from(0.02 + 0.1 * random.unit());
        let keys = (0..keys).map(|key| (from + by * (key as f64 * if key % 2 == 0 { 1.0 } else { 0.3 }), radius));
        Blob::hidden(MovingSphere::new(keys.collect()))
    };
    (0..count).map(|_| one()).collect()
}

fn assert_same(mut tree: RayTree, blobs: &[Blob]) {
    assert_eq!(tree.validate(), Ok(()));
    let oracle = BruteForce::of_scene(&[], blobs.to_vec()).unwrap();
    let mut random = Random(12);
    let (mut hits, mut points) = (0, 0);
    let levels = SimdLevel::available();
    for &level in &levels {
        tree = tree.with_simd(level);
        for i in 0..450 / levels.len() {
            let mut ray = random_ray(&mut random, 1.2);
            if i % 3 == 0 {
                // Also behind the origin.
                ray = ray.between(-1.5, 0.8);
            }
            assert_eq!(difference(&tree, &oracle, &ray), None, "{level}");
            hits += usize::from(tree.any_hit(&ray));
            let query = ClosestPointQuery::new(random.vec() * 1.5, random.unit()).within(0.4);
            let found = tree.closest_point(&query);
            assert_eq!(found, oracle.closest_point(&query), "{level}");
            points += usize::from(found.is_some());
        }
    }
    if blobs.len() > 100 {
        assert!(hits > 100 && points > 100, "{hits} {points}");
    }
}

#[test]
fn rays_and_closest_points_equal_brute_force() {
    let divisions = [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(4)];
    for (keys, motion) in [(1, 0.0), (2, 0.2), (5, 0.1)] {
        // One shape has its box in a node only, and seventeen do not fit a block.
        for count in [1, 2, 16, 17, 400] {
            let blobs = blobs(count, keys, motion, 3);
            for division in divisions {
                assert_same(RayTree::of_scene(&[], blobs.clone(), &divided(division)).unwrap(), &blobs);
            }
        }
    }
}

/// Blocks of shapes that were at rest have no room for velocities.
#[test]
fn refitted_trees_equal_brute_force() {
    let divisions = [Division::Whole, Division::SharedLeaves(3), Division::SeparateTrees(4)];
    for division in divisions {
        for (keys, motion) in [(1, 0.0), (2, 0.2)] {
            let mut tree = RayTree::of_scene(&[], blobs(300, keys, motion, 3), &divided(division)).unwrap();
            for (now_keys, now_motion, seed) in [(2, 0.1, 4), (1, 0.0, 5), (2, 0.3, 6)] {
                let now = blobs(300, now_keys, now_motion, seed);
                tree.refit_with_shapes(&[], now.clone()).unwrap();
                assert_eq!(tree.validate(), Ok(()));
                let oracle = BruteForce::of_scene(&[], now).unwrap();
                let mut random = Random(13);
                for _ in 0..200 {
                    assert_eq!(difference(&tree, &oracle, &random_ray(&mut random, 1.2)), None);
                    let query = ClosestPointQuery::new(random.vec() * 1.5, random.unit());
                    assert_eq!(tree.closest_point(&query), oracle.closest_point(&query));
                }
            }
        }
    }
}

/// Pairs of shapes that fly far in all directions: nothing else needs so much memory. The least budget suffices nevertheless.
#[test]
fn the_least_budget_suffices() {
    let mut random = Random(21);
    for count in [50, 1000, 5000] {
        let one = |of: usize| {
            let pair = (of / 2) as f64;
            let place = DVec3::new((pair * 0.618).fract(), (pair * 0.755).fract(), (pair * 0.57).fract());
            let (from, by) = (place + random.vec().as_dvec3() * 1e-4, random.vec().as_dvec3());
            Blob::hidden(MovingSphere::new(vec![(from, 0.001), (from + by, 0.001)]))
        };
        let blobs: Vec<Blob> = (0..count).map(one).collect();
        let least = WideParams { bytes_per_primitive: 128.0, ..WideParams::default() };
        let tree = RayTree::of_scene(&[], blobs.clone(), &BuildParams::wide(least)).unwrap();
        assert!(tree.statistics().bytes <= 128 * count + 8192, "{}", tree.statistics().bytes);
        assert_eq!(tree.validate(), Ok(()));
        let oracle = BruteForce::of_scene(&[], blobs).unwrap();
        for _ in 0..50 {
            let query = ClosestPointQuery::new(random.vec(), random.unit());
            assert_eq!(tree.closest_point(&query), oracle.closest_point(&query));
        }
    }
}
