//! Batches of rays, which are traversed in streams, give the answers of single rays.

use crate::brute_force::Brick;
use crate::common::{Random, divided, soup};
use mbkd::glam::Vec3;
use mbkd::{BuildParams, Division, Hit, MovingSphere, Ray, RayTree, Shape, SimdLevel, TimeInterval, TriangleMesh};

/// All kinds of leaves: triangles that are static, move, have many keys, exist for a while and are kept in f64, spheres
/// and bricks.
fn tree(division: Division, level: SimdLevel) -> RayTree {
    let some_time = TimeInterval::new(0.2, 0.8).unwrap();
    let meshes = [
        soup(400, 1, 0.2, 0.0, 1).with_mask(0b01),
        soup(300, 2, 0.2, 0.3, 2).with_mask(0b10),
        soup(200, 5, 0.2, 0.2, 3).with_active(some_time).with_mask(0b11),
        soup(100, 2, 0.2, 0.2, 4).precise().with_mask(0b01),
    ];
    let mut random = Random(9);
    let shapes = (0..60).map(|i| {
        let at = random.vec().as_dvec3();
        if i % 10 == 3 {
            return Shape::custom(Brick::new(at, 0.2));
        }
        MovingSphere::new(vec![(at, 0.1), (at + random.vec().as_dvec3() * 0.3, 0.05)]).into()
    });
    RayTree::of_scene(&meshes, shapes.collect(), &divided(division)).unwrap().with_simd(level)
}

/// Rays in nearly the same direction from nearly the same origin, some of them of another kind than the others.
fn pencil(random: &mut Random, count: usize) -> Vec<Ray> {
    // From nearby and from far away; also along axes, where some components are zero or nearly so.
    let from = random.vec() * [0.5, 3.0, 300.0][random.below(3)];
    let mut toward = random.vec() * 0.3 - from;
    if random.below(3) == 0 {
        toward[random.below(3)] = [0.0, -0.0, 1e-30][random.below(3)];
    }
    let spread = [0.0, 1e-4, 0.1][random.below(3)];
    let times = if random.below(2) == 0 { [0.4, 0.0] } else { [0.0, 1.0] };
    let ray = |random: &mut Random| {
        let time = times[0] + times[1] * random.unit();
        let ray =
            Ray::new(from + random.vec() * spread, toward + random.vec() * (spread * toward.length())).at_time(time);
        match random.below(40) {
            0 => ray.between(-1.0, f32::INFINITY),
            1 => ray.between(0.5, 1.2),
            2 => Ray { dir: -ray.dir, ..ray },
            3 => Ray { dir: Vec3::NAN, ..ray },
            4 => ray.between(0.0, 0.0),
            _ => ray,
        }
    };
    (0..count).map(|_| ray(random)).collect()
}

/// Rays in all directions from nearly the same origin, of any length, some of them invalid.
fn burst(random: &mut Random, count: usize) -> Vec<Ray> {
    let from = random.vec() * [0.5, 3.0][random.below(2)];
    let length = [0.05, 0.3, f32::INFINITY][random.below(3)];
    let ray = |random: &mut Random| {
        let ray = Ray::new(from + random.vec() * 0.1, random.vec()).at_time(random.unit()).between(0.0, length);
        match random.below(40) {
            0 => ray.between(-1.0, 1.0),
            1 => ray.between(1.0, 0.0),
            2 => ray.at_time(1.5),
            3 => ray.at_time(1.0),
            _ => ray,
        }
    };
    (0..count).map(|_| ray(random)).collect()
}

#[test]
fn rays_that_look_the_same_way_answer_as_single_rays() {
    answer_as_single_rays(pencil, 10_000);
}

#[test]
fn rays_in_all_directions_answer_as_single_rays() {
    answer_as_single_rays(burst, 5_000);
}

fn answer_as_single_rays(make: impl Fn(&mut Random, usize) -> Vec<Ray>, least_hits: usize) {
    let mut random = Random(11);
    let (mut hits, mut shadows) = (Vec::new(), Vec::new());
    for division in [Division::Automatic, Division::SharedLeaves(3)] {
        for level in SimdLevel::available() {
            let tree = tree(division, level);
            let mut found = 0;
            for round in 0..120 {
                let count = [300, 33, 1000, 32, 31][round % 5];
                let rays = make(&mut random, count);
                tree.closest_hits(&rays, &mut hits);
                tree.any_hits(&rays, &mut shadows);
                assert_filtered(&tree, &rays, [u32::MAX, 0b10, 0][round % 3]);
                for (i, ray) in rays.iter().enumerate() {
                    let alone = tree.closest_hit(ray);
                    assert_eq!((hits[i], shadows[i]), (alone, alone.is_some()), "{level}, ray {i} of {count}: {ray:?}");
                    found += usize::from(alone.is_some());
                }
            }
            assert!(found > least_hits, "{found}");
        }
    }
}

/// Batches with a mask, alone and with a filter of its own for each ray.
pub fn assert_filtered(tree: &RayTree, rays: &[Ray], mask: u32) {
    let accept = |i: usize, hit: &Hit| !(hit.primitive as usize + i).is_multiple_of(3);
    let (mut hits, mut shadows) = (Vec::new(), Vec::new());
    tree.closest_hits_filtered(rays, mask, accept, &mut hits);
    tree.any_hits_filtered(rays, mask, accept, &mut shadows);
    assert_eq!((hits.len(), shadows.len()), (rays.len(), rays.len()));
    for (i, ray) in rays.iter().enumerate() {
        let alone = tree.closest_hit_filtered(ray, mask, |hit| accept(i, hit));
        assert_eq!((hits[i], shadows[i]), (alone, alone.is_some()), "{mask:b}, ray {i}: {ray:?}");
    }
    tree.closest_hits_masked(rays, mask, &mut hits);
    tree.any_hits_masked(rays, mask, &mut shadows);
    assert_eq!((hits.len(), shadows.len()), (rays.len(), rays.len()));
    for (i, ray) in rays.iter().enumerate() {
        let alone = tree.closest_hit_masked(ray, mask);
        assert_eq!((hits[i], shadows[i]), (alone, alone.is_some()), "{mask:b}, ray {i}: {ray:?}");
    }
}

#[test]
fn filters_get_the_indices_of_their_rays_on_any_number_of_threads() {
    let tree = tree(Division::Automatic, SimdLevel::best());
    let mut random = Random(13);
    for make in [pencil, burst] {
        // More than one window of rays, in several tasks.
        let rays: Vec<Ray> = (0..70).flat_map(|_| make(&mut random, 1000)).collect();
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| assert_filtered(&tree, &rays, u32::MAX));
        }
    }
}

#[test]
fn order_changes_nothing_nor_does_time_where_all_stands_still() {
    // The same rays, alone in a batch and among others, in any order.
    let tree = tree(Division::Automatic, SimdLevel::best());
    let mut random = Random(12);
    let rays = pencil(&mut random, 512);
    let (mut hits, mut reversed) = (Vec::new(), Vec::new());
    tree.closest_hits(&rays, &mut hits);
    let backward: Vec<Ray> = rays.iter().rev().copied().collect();
    tree.closest_hits(&backward, &mut reversed);
    reversed.reverse();
    assert_eq!(hits, reversed);
    let still: Vec<TriangleMesh> = vec![soup(300, 1, 0.3, 0.0, 5)];
    let tree = RayTree::build(&still, &BuildParams::default()).unwrap();
    // A static tree gives the same answers at every time.
    let at_once: Vec<Ray> = rays.iter().map(|ray| ray.at_time(0.5)).collect();
    tree.closest_hits(&rays, &mut hits);
    tree.closest_hits(&at_once, &mut reversed);
    assert_eq!(hits, reversed);
    tree.closest_hits(&[], &mut hits);
    assert!(hits.is_empty());
}
