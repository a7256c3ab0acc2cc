//! The exact bits of each scene: changing one changes every golden count that depends on it.

use super::*;
use engine::{BuildParams, Keys, RayTree};
use glam::DVec3;

/// FNV-1a over indices and the bits of all coordinates.
fn checksum(scene: &Scene) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut add = |word: u32| hash = (hash ^ u64::from(word)).wrapping_mul(0x100_0000_01b3);
    for mesh in &scene.meshes {
        mesh.indices.iter().flatten().for_each(|&i| add(i));
        let Keys::F32(keys) = &mesh.keys else { unreachable!("scenes are single precision") };
        keys.iter().flatten().for_each(|p| p.to_array().into_iter().for_each(|x| add(x.to_bits())));
    }
    hash
}

/// Triangles, vertices at all keys, checksum, and the swept box in hundredths.
type Golden = (&'static str, usize, usize, u64, [i32; 6]);

fn describe(recipe: &Recipe) -> Golden {
    let scene = (recipe.make)(12_000);
    RayTree::build(&scene.meshes, &BuildParams::default()).expect("a scene is a valid input");
    let (mut a, mut b, mut vertices) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0);
    for mesh in &scene.meshes {
        let Keys::F32(keys) = &mesh.keys else { unreachable!("scenes are single precision") };
        for p in keys.iter().flatten() {
            (a, b, vertices) = (a.min(p.as_dvec3()), b.max(p.as_dvec3()), vertices + 1);
        }
    }
    let hundredths = |x: f64| (x * 100.0).round() as i32;
    (recipe.name, scene.triangles(), vertices, checksum(&scene), [a.x, a.y, a.z, b.x, b.y, b.z].map(hundredths))
}

#[test]
fn scenes_are_the_same_everywhere() {
    let found: Vec<Golden> = CATALOGUE.iter().map(describe).collect();
    let golden: &[Golden] = &[
        ("hairball", 11985, 12410, 0x37d59cbe03a22bdb, [-116, -127, -142, 108, 114, 134]),
        ("tornado", 12000, 72000, 0x1e18d3da60566557, [-208, -43, -192, 134, 450, 163]),
        ("hall", 15342, 9986, 0xcefa59527869d8ae, [-6000, -50, -6000, 6000, 700, 6000]),
        ("camera", 13382, 7946, 0x7c00caa8a70697ac, [-6000, -50, -6000, 6000, 700, 6000]),
        ("hand", 11616, 29100, 0xbd65513f83cb5120, [-80, -170, -25, 46, 110, 76]),
        ("coherent", 11664, 11668, 0x895defe366725cf7, [-105, -109, -115, 113, 104, 102]),
        ("needles", 12000, 54000, 0xadf20cfb3923c7be, [-103, -110, -109, 101, 105, 105]),
        ("needles30", 12000, 54000, 0x3776d98141020a8f, [-144, -159, -157, 150, 152, 146]),
        ("debris", 11968, 12716, 0xaa75edd1e1803258, [-242, -246, -252, 227, 234, 231]),
        ("mixed", 21222, 33870, 0x7e281476bb43d744, [-6000, -50, -6000, 6000, 700, 6000]),
        ("building", 15832, 9928, 0xc01e46b7ba5572ce, [-4000, -60, -3000, 4000, 890, 3000]),
        ("visited", 19996, 14970, 0x2ed3ef5f0c8fc213, [-4000, -60, -3000, 4000, 890, 3000]),
        ("distant", 11560, 11640, 0x6229a0bdff3a8e98, [-35, -6, -28, 52, 177, 32]),
        ("crowd", 11520, 11680, 0x1883b2847b095c97, [-35, -6, -32, 172, 177, 34]),
    ];
    assert_eq!(found, golden, "a scene changed; if on purpose, these are the new figures:\n{found:#?}");
}

#[test]
fn sizes_are_about_what_was_asked() {
    for recipe in CATALOGUE {
        let scene = (recipe.make)(30_000);
        let share = scene.triangles() as f64 / 30_000.0;
        assert!((0.75..1.2).contains(&share), "{}: {share}", recipe.name);
        assert_eq!(scene.looks.len(), scene.meshes.len());
        assert!(scene.name == recipe.name && !scene.camera.keys.is_empty());
        // The smallest scene is not empty, and a budget of zero does not panic.
        assert!((recipe.make)(0).triangles() > 0);
    }
}

#[test]
fn what_should_move_moves_by_that_much() {
    for (name, low, high) in [
        ("hairball", 0.04, 0.1001),
        ("tornado", 0.38, 0.42),
        ("needles", 0.099, 0.101),
        ("needles30", 0.59, 0.61),
        ("coherent", 0.1, 0.2),
    ] {
        let scene = (find(name).unwrap().make)(3000);
        let Keys::F32(keys) = &scene.meshes.last().unwrap().keys else { unreachable!() };
        let ways: Vec<f32> = keys[0].iter().zip(&keys[1]).map(|(a, b)| a.distance(*b)).collect();
        let mean = ways.iter().sum::<f32>() / ways.len() as f32;
        assert!((low..high).contains(&mean), "{name}: {mean}");
    }
}

#[test]
fn flake_spheres_touch_their_parents_at_every_key() {
    let (spheres, _) = flake(91);
    assert_eq!(spheres.iter().map(|s| s.level).collect::<Vec<_>>()[..11], [0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2]);
    for (i, s) in spheres.iter().enumerate().skip(1) {
        let parent = spheres[(i - 1) / 9];
        for key in 0..3 {
            let apart = s.centers[key].distance(parent.centers[key]);
            assert!((apart - s.radius - parent.radius).abs() < 1e-5, "sphere {i} at key {key}: {apart}");
        }
    }
    let sum = spheres.iter().flat_map(|s| s.centers).fold(0u64, |hash, p| {
        p.to_array().into_iter().fold(hash, |hash, x| hash.rotate_left(5) ^ u64::from(x.to_bits()))
    });
    assert_eq!(sum, 436170522581974660, "the flake changed");
}
