//! Files with words changed and the checksum corrected: what does not describe a tree is refused, each word for itself.

use super::support::{Random, seal};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, MovingPoint, MovingSphere, PointParams, PointStructure, PointTree, Ray, RayTree,
    Shape, TriangleMesh,
};

/// Words of the header.
const HEADER: usize = 8;

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect()
}

/// The file with some words changed.
fn with(bytes: &[u8], changes: &[(usize, u32)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for &(at, word) in changes {
        bytes[4 * at..4 * at + 4].copy_from_slice(&word.to_le_bytes());
    }
    seal(&mut bytes);
    bytes
}

fn point_file(tree: &PointTree) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    bytes
}

fn reads_points(bytes: &[u8]) -> bool {
    PointTree::read_from(&mut &bytes[..]).is_ok()
}

fn loose(triangles: usize, keys: usize, random: &mut Random) -> TriangleMesh {
    let indices = (0..triangles as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let key = |_| (0..3 * triangles).map(|_| random.vec()).collect::<Vec<Vec3>>();
    TriangleMesh::new(indices, (0..keys).map(key).collect::<Vec<_>>())
}

#[test]
fn positions_where_there_is_no_point_are_refused() {
    let mut random = Random(41);
    let points: Vec<MovingPoint> = (0..20).map(|_| MovingPoint::new(random.vec(), random.vec())).collect();
    let params = PointParams { structure: PointStructure::Linear, ..PointParams::default() };
    let bytes = point_file(&PointTree::build(&points, &params).unwrap());
    let all = words(&bytes);
    let absent: Vec<usize> = (HEADER..all.len()).filter(|&at| all[at] == f32::MAX.to_bits()).collect();
    assert!(absent.len() >= 6 * 12, "{}", absent.len());
    assert!(absent.iter().all(|&at| !reads_points(&with(&bytes, &[(at, 0)]))));
}

#[test]
fn boxes_around_nothing_are_refused() {
    let mut random = Random(42);
    let points: Vec<DVec3> = (0..40).map(|_| random.vec().as_dvec3() * (1.0 + 1e-12)).collect();
    let bytes = point_file(&PointTree::build(&points, &PointParams::default()).unwrap());
    let all = words(&bytes);
    let (low, high) = (f32::INFINITY.to_bits(), f32::NEG_INFINITY.to_bits());
    let rows = |lane: usize| (0..3).map(move |axis| lane + 16 * axis);
    let is_empty =
        |&lane: &usize| rows(lane).all(|at| all[at] == low && all.get(at + 48).is_some_and(|&word| word == high));
    let lanes: Vec<usize> = (HEADER..all.len() - 48).filter(is_empty).collect();
    assert!(lanes.len() >= 12, "{}", lanes.len());
    for lane in lanes {
        let changes: Vec<(usize, u32)> = rows(lane).flat_map(|at| [(at, 0), (at + 48, 0)]).collect();
        assert!(!reads_points(&with(&bytes, &changes)), "lane at {lane}");
    }
}

#[test]
fn boxes_around_nothing_are_refused_in_ray_trees() {
    let mut random = Random(43);
    let tree = RayTree::build(&[loose(40, 1, &mut random)], &BuildParams::default()).unwrap();
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    let all = words(&bytes);
    let absent: Vec<usize> = (HEADER..all.len()).filter(|&at| f32::from_bits(all[at]).abs() == 1e30).collect();
    assert!(absent.len() > 6, "{}", absent.len());
    for at in absent {
        assert!(RayTree::read_from(&mut &with(&bytes, &[(at, 0)])[..]).is_err(), "word {at}");
    }
}

#[test]
fn blocks_of_triangles_in_a_tree_of_shapes_are_refused() {
    let mut random = Random(45);
    let balls: Vec<MovingSphere> = (0..200).map(|_| MovingSphere::fixed(random.vec().as_dvec3(), 0.1)).collect();
    let tree = RayTree::of_scene(&[], balls, &BuildParams::default()).unwrap();
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    let all = words(&bytes);
    // Wide; root; not pre-split; one slice; lists from word 0; the number of lines that follow.
    let begins = |&at: &usize| {
        let lines = ((all.len() - at - 8) / 16) as u32;
        all[at] == 0 && all[at + 2..at + 8] == [0, 1, 0, 0, lines, 0]
    };
    let layouts: Vec<usize> = (HEADER..all.len() - 8).filter(begins).collect();
    let [layout] = layouts[..] else { panic!("{layouts:?}") };
    let read = |bytes: &[u8]| RayTree::read_from(&mut &bytes[..]);
    assert!(read(&bytes).is_ok());
    for lists in [[1, 0], [u32::MAX; 2]] {
        let forged = with(&bytes, &[(layout + 4, lists[0]), (layout + 5, lists[1])]);
        assert!(read(&forged).unwrap_err().to_string().contains("blocks of triangles"), "{lists:?}");
    }
}

/// Any small word may be a number of keys. With another one, the file is refused or its tree answers something.
#[test]
fn other_numbers_of_keys_are_refused_or_answer_something() {
    let mut random = Random(44);
    let sphere = |keys: usize| MovingSphere::new((0..keys).map(|_| (random.vec().as_dvec3(), 1.5)).collect());
    let spheres: Vec<Shape> = [2, 5, 9].into_iter().cycle().take(10).map(sphere).map(Shape::from).collect();
    let meshes = [5, 7, 2, 1].map(|keys| loose(10, keys, &mut random));
    let tree = RayTree::of_scene(&meshes, spheres, &BuildParams::default()).unwrap();
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    let all = words(&bytes);
    let (mut refused, mut read) = (0, 0);
    for at in (HEADER..all.len()).filter(|&at| (1..=9).contains(&all[at])) {
        for other in (1..=12).filter(|&other| other != all[at]) {
            let Ok(tree) = RayTree::read_from(&mut &with(&bytes, &[(at, other)])[..]) else {
                refused += 1;
                continue;
            };
            read += 1;
            for _ in 0..10 {
                let ray = Ray::new(random.vec() * 2.0, random.vec()).at_time(random.unit());
                let _ = (tree.any_hit(&ray), tree.closest_hit(&ray));
                let _ = tree.closest_point(&ClosestPointQuery::new(random.vec().as_dvec3(), random.unit()));
            }
        }
    }
    assert!(refused > 100 && read > 0, "{refused} refused, {read} read");
}
