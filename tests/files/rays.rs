//! Ray trees of every layout are restored bit for bit, and hostile files are rejected or give arbitrary answers without a panic.

use super::blob::Blob;
use super::support::{HEADER, Random, hostile, is_broken, rounds, seal};
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Division, FileError, Instance, InstanceTree, KdParams, MovingSphere, Pose, Ray,
    RayTree, Shape, TimeInterval, TreePrimitive, TriangleMesh, Visitor, WideParams,
};
use std::path::Path;
use std::sync::Arc;

/// Loose triangles, or strips of them that share vertices, at some keys.
fn mesh(n: usize, keys: usize, shared: bool, random: &mut Random) -> TriangleMesh {
    let mut positions = vec![Vec::new(); keys];
    let vertices = if shared { n + 2 } else { 3 * n };
    let mut at = random.vec();
    for vertex in 0..vertices {
        at = match () {
            () if !shared && vertex % 3 == 0 || vertex % 40 == 0 => random.vec(),
            () => at + random.vec() * 0.1,
        };
        for (key, positions) in positions.iter_mut().enumerate() {
            let by = if key == 0 { Vec3::ZERO } else { random.vec() * 0.2 };
            positions.push(at + by);
        }
    }
    let corners = |i: u32| if shared { [i, i + 1, i + 2] } else { [3 * i, 3 * i + 1, 3 * i + 2] };
    TriangleMesh::new((0..n as u32).map(corners).collect(), positions)
}

/// A scene with all kinds of primitives.
fn everything(random: &mut Random) -> (Vec<TriangleMesh>, Vec<Shape>) {
    let half = TimeInterval::new(0.25, 0.75).unwrap();
    let meshes = vec![
        mesh(70, 1, true, random),
        mesh(40, 1, false, random),
        TriangleMesh::fixed(vec![], vec![]),
        mesh(60, 2, true, random).with_mask(6),
        mesh(40, 2, false, random).with_active(half),
        mesh(60, 4, true, random),
        mesh(30, 5, false, random),
    ];
    let mut key = || (random.vec().as_dvec3(), f64::from(random.unit()) * 0.2);
    let spheres = (0..20).map(|i| match i % 3 {
        0 => MovingSphere::new(vec![key()]),
        1 => MovingSphere::new(vec![key(), key()]).with_mask(5),
        _ => MovingSphere::new(vec![key(), key(), key()]).with_active(half),
    });
    let shapes = spheres.map(Shape::from).collect();
    (meshes, shapes)
}

/// A tree for each layout, with its name.
pub fn trees() -> Vec<(String, RayTree)> {
    let mut random = Random(7);
    let build = |meshes: &[TriangleMesh], params: &BuildParams| RayTree::build(meshes, params).unwrap();
    let default = BuildParams::default();
    let divided = |division| BuildParams::wide(WideParams { division, ..WideParams::default() });
    let mut trees = vec![
        ("nothing".to_string(), build(&[], &default)),
        ("one".into(), build(&[mesh(1, 1, false, &mut random)], &default)),
        ("one, k-d".into(), build(&[mesh(1, 1, false, &mut random)], &BuildParams::paper())),
        ("nothing, k-d".into(), build(&[], &BuildParams::paper())),
    ];
    for (keys, shared) in [(1, false), (1, true), (2, false), (2, true), (5, false), (5, true)] {
        let meshes = [mesh(150, keys, shared, &mut random)];
        trees.push((format!("{keys} keys, shared {shared}"), build(&meshes, &default)));
        trees.push((format!("{keys} keys, k-d"), build(&meshes, &BuildParams::kd(KdParams::default()))));
    }
    for division in [Division::SharedLeaves(3), Division::SeparateTrees(4)] {
        let meshes = [mesh(90, 2, true, &mut random), mesh(80, 4, false, &mut random)];
        trees.push((format!("{division:?}"), build(&meshes, &divided(division))));
    }
    for params in
        [default, divided(Division::SeparateTrees(2)), BuildParams::paper(), BuildParams::kd(KdParams::classic())]
    {
        let (meshes, shapes) = everything(&mut random);
        trees.push((format!("everything, {params:?}"), RayTree::of_scene(&meshes, shapes, &params).unwrap()));
    }
    trees
}

/// The file of a tree.
pub fn file(tree: &RayTree) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<RayTree, FileError> {
    RayTree::read_from(&mut &bytes[..])
}

/// Visits everything.
struct All(usize);

impl Visitor<TreePrimitive> for All {
    fn enter(&mut self, _: &mbkd::Aabb) -> Option<f32> {
        Some(0.0)
    }
    fn visit(&mut self, _: TreePrimitive) -> ControlFlow<()> {
        self.0 += 1;
        // A hostile tree may reach the same leaf from every node.
        if self.0 < 10_000 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }
}

/// What a tree answers to all kinds of queries, as text with every bit.
fn answers(tree: &RayTree, rays: usize, seed: u64) -> String {
    use std::fmt::Write;
    let (mut random, mut out) = (Random(seed), String::new());
    let mut batch = Vec::new();
    for i in 0..rays {
        let time = [0.0, 1.0, random.unit(), random.unit()][i % 4];
        let (origin, target) = (random.vec() * 2.0, random.vec() * 0.7);
        let ray = Ray::new(origin, target - origin).at_time(time);
        let hit = tree.closest_hit(&ray);
        write!(out, "{hit:?} {} ", tree.any_hit(&ray)).unwrap();
        let mut all: Vec<String> = Vec::new();
        let _ = tree.all_hits(&ray, |hit| {
            all.push(format!("{hit:?}"));
            ControlFlow::Continue(())
        });
        all.sort();
        let filtered = tree.closest_hit_filtered(&ray, 2, |hit| hit.t > 0.1);
        let near = tree.closest_point(&ClosestPointQuery::new(origin, time).within(3.0));
        writeln!(out, "{all:?} {filtered:?} {near:?}").unwrap();
        batch.push(ray);
    }
    let mut hits = Vec::new();
    tree.closest_hits(&batch, &mut hits);
    let mut visitor = All(0);
    let _ = tree.traverse(0.3, &mut visitor);
    let mut boxes = 0;
    tree.boxes(0.6, |_| boxes += 1);
    writeln!(out, "{hits:?} {} {boxes}", visitor.0).unwrap();
    out
}

#[test]
fn trees_come_back_bit_for_bit() {
    for (name, tree) in trees() {
        let bytes = file(&tree);
        let again = read(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(file(&again) == bytes, "{name}: written again it is another file");
        assert_eq!(answers(&again, 60, 5), answers(&tree, 60, 5), "{name}");
        assert_eq!(again.validate(), Ok(()), "{name}");
        let corners = |tree: &RayTree| -> Vec<_> {
            let times = [0.0f32, 0.2, 0.9, 1.0];
            (0..8)
                .flat_map(|m| (0..9).flat_map(move |t| times.map(move |time| (m, 11 * t, time))))
                .map(|(m, t, time)| tree.triangle(m, t, time).map(|p| p.to_array().map(f64::to_bits)))
                .collect()
        };
        assert_eq!(corners(&again), corners(&tree), "{name}");
        let (new, old) = (again.statistics(), tree.statistics());
        let counts = |s: mbkd::ray::Statistics| {
            let parts = [s.primitives, s.nodes, s.leaves, s.references, s.positions, s.kept_positions, s.time_nodes];
            (parts, s.static_references, s.depth, s.duplicates.to_bits(), s.timed.to_bits())
        };
        assert_eq!(counts(new), counts(old), "{name}");
    }
}

#[test]
fn what_is_behind_a_tree_is_left_to_others() {
    let trees = trees();
    let mut stream: Vec<u8> = trees.iter().flat_map(|(_, tree)| file(tree)).collect();
    stream.extend(b"more");
    let mut rest = &stream[..];
    for (name, tree) in &trees {
        let again = RayTree::read_from(&mut rest).unwrap();
        assert_eq!(answers(&again, 5, 1), answers(tree, 5, 1), "{name}");
    }
    assert_eq!(rest, b"more");
}

#[test]
fn files_are_saved_whole_and_loaded() {
    let folder = std::env::temp_dir().join(format!("mbkd-files-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("tree");
    let (_, tree) = trees().pop().unwrap();
    tree.save(&path).unwrap();
    assert_eq!(answers(&RayTree::load(&path).unwrap(), 20, 2), answers(&tree, 20, 2));
    // Overwrites the existing file, and leaves no other file behind.
    tree.save(&path).unwrap();
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
    let mut longer = file(&tree);
    longer.push(0);
    std::fs::write(&path, &longer).unwrap();
    // Errors name the path that was given, whatever is wrong.
    let error_at = |path: &Path, error: FileError| {
        let FileError::At { path: named, error } = error else { panic!("{error}") };
        assert_eq!(named, path);
        *error
    };
    assert!(matches!(error_at(&path, RayTree::load(&path).unwrap_err()), FileError::Length { .. }));
    let (none, nowhere) = (folder.join("none"), folder.join("none").join("tree"));
    assert!(matches!(error_at(&none, RayTree::load(&none).unwrap_err()), FileError::Io(_)));
    assert!(matches!(error_at(&nowhere, tree.save(&nowhere).unwrap_err()), FileError::Io(_)));
    let text = tree.save(&nowhere).unwrap_err().to_string();
    assert!(text.starts_with(nowhere.to_str().unwrap()) && text.contains("failed"), "{text}");
    // Custom primitives, which are handed in again.
    let blobs: Vec<_> = (0..50).map(|i| Blob::hidden(MovingSphere::fixed(DVec3::X * f64::from(i), 0.6))).collect();
    let tree = RayTree::of_scene(&[], blobs.clone(), &BuildParams::default()).unwrap();
    tree.save(&path).unwrap();
    let load = |blobs: &[Blob]| RayTree::load_with_shapes(&path, blobs.to_vec());
    assert_eq!(answers(&load(&blobs).unwrap(), 20, 2), answers(&tree, 20, 2));
    assert!(matches!(load(&blobs[1..]).unwrap_err().cause(), FileError::OtherShapes { .. }));
    assert!(matches!(RayTree::load(&path).unwrap_err().cause(), FileError::CustomShapes { custom: 50 }));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Whoever loads meanwhile finds one of the trees, whole.
#[test]
fn threads_may_save_to_the_same_path() {
    let folder = std::env::temp_dir().join(format!("mbkd-same-path-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("tree");
    let trees: Vec<RayTree> = trees().into_iter().map(|(_, tree)| tree).take(2).collect();
    let whole: Vec<Vec<u8>> = trees.iter().map(file).collect();
    trees[0].save(&path).unwrap();
    std::thread::scope(|threads| {
        for tree in &trees {
            threads.spawn(|| (0..40).for_each(|_| tree.save(&path).unwrap()));
        }
        for _ in 0..40 {
            let found = std::fs::read(&path).unwrap();
            assert!(whole.contains(&found), "{} bytes", found.len());
        }
    });
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "no temporary file is left");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(unix)]
#[test]
fn a_file_keeps_its_permissions_when_it_is_replaced() {
    use std::os::unix::fs::PermissionsExt;
    let path = std::env::temp_dir().join(format!("mbkd-permissions-{}", std::process::id()));
    let (_, tree) = trees().pop().unwrap();
    for mode in [0o600, 0o400, 0o644] {
        std::fs::write(&path, b"before").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        tree.save(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, mode);
        assert_eq!(std::fs::read(&path).unwrap(), file(&tree));
        std::fs::remove_file(&path).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_what_is_no_file_is_written_to() {
    let folder = std::env::temp_dir().join(format!("mbkd-links-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (path, link) = (folder.join("tree"), folder.join("link"));
    let (_, tree) = trees().pop().unwrap();
    std::fs::write(&path, b"before").unwrap();
    std::os::unix::fs::symlink(&path, &link).unwrap();
    tree.save(&link).unwrap();
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(std::fs::read(&path).unwrap(), file(&tree));
    // To a file that does not exist yet, by a link that is relative to its folder.
    let (inner, chain) = (folder.join("inner"), folder.join("chain"));
    std::fs::create_dir(&inner).unwrap();
    std::os::unix::fs::symlink("../later", inner.join("link")).unwrap();
    std::os::unix::fs::symlink("inner/link", &chain).unwrap();
    tree.save(&chain).unwrap();
    assert!([&chain, &inner.join("link")].iter().all(|link| std::fs::symlink_metadata(link).unwrap().is_symlink()));
    assert_eq!(std::fs::read(folder.join("later")).unwrap(), file(&tree));
    assert_eq!((std::fs::read_dir(&folder).unwrap().count(), std::fs::read_dir(&inner).unwrap().count()), (5, 1));
    assert!(matches!(tree.save(&folder).unwrap_err().cause(), FileError::Io(_)), "a folder");
    let nowhere = Path::new("/dev/null");
    if nowhere.exists() {
        tree.save(nowhere).unwrap();
        assert!(!std::fs::metadata(nowhere).unwrap().is_file());
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let scene = crate::scene::mixed(20_000);
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            [BuildParams::default(), BuildParams::paper()]
                .map(|params| file(&RayTree::build(&scene.meshes, &params).unwrap()))
        })
    };
    let one = of(1);
    for threads in [2, 5] {
        assert!(of(threads) == one, "{threads} threads write another file");
    }
    // Errors of the reader as well.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    pool.install(|| one.iter().for_each(|one| assert!(file(&read(one).unwrap()) == *one)));
}

#[test]
fn custom_primitives_are_handed_in_again_with_all_shapes() {
    let ball = |x: f64| MovingSphere::new(vec![(DVec3::X * x, 0.5), (DVec3::new(x, 1.0, 0.0), 0.4)]);
    let meshes = [TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y])];
    // Every third is a sphere, before others and after others.
    let shapes = |balls: Vec<MovingSphere>| {
        let shape = |(i, ball)| if i % 3 == 1 { Shape::from(ball) } else { Blob::hidden(ball).into() };
        balls.into_iter().enumerate().map(shape).collect::<Vec<_>>()
    };
    let balls: Vec<MovingSphere> = (0..50).map(|i| ball(f64::from(i))).collect();
    for (params, meshes) in [BuildParams::default(), BuildParams::paper()]
        .into_iter()
        .flat_map(|params| [(params, &meshes[..]), (params, &[])])
    {
        let tree = RayTree::of_scene(meshes, shapes(balls.clone()), &params).unwrap();
        let mut bytes = Vec::new();
        tree.write_to(&mut bytes).unwrap();
        let read = |balls: Vec<MovingSphere>| RayTree::read_with_shapes_from(&mut &bytes[..], shapes(balls));
        let again = read(balls.clone()).unwrap();
        assert_eq!(answers(&again, 60, 3), answers(&tree, 60, 3));
        assert_eq!(file(&again), bytes);
        // The number; the bounds of a custom primitive; a sphere; active intervals; masks.
        for wrong in 0..5 {
            let mut other = balls.clone();
            match wrong {
                0 => drop(other.pop()),
                1 => other[48] = ball(60.0),
                2 => other[4].keys[0].1 = 0.4,
                3 => other[3].active = TimeInterval::new(0.0, 0.5).unwrap(),
                _ => other[3].mask = 1,
            }
            assert!(matches!(read(other), Err(FileError::OtherShapes { .. })), "{wrong}");
        }
        let as_spheres = RayTree::read_with_shapes_from(&mut &bytes[..], balls.clone());
        assert!(matches!(as_spheres, Err(FileError::OtherShapes { .. })));
        let nowhere = vec![MovingSphere::fixed(DVec3::NAN, 1.0); 50];
        assert!(matches!(read(nowhere), Err(FileError::Shapes(_))));
        let without = RayTree::read_from(&mut &bytes[..]).unwrap_err();
        assert!(matches!(without, FileError::CustomShapes { custom: 33 }), "{without}");
    }
}

/// Runs all queries on a tree, on each instruction set.
fn run_queries(tree: RayTree, seed: u64) {
    let _ = tree.validate();
    let mut tree = tree;
    for level in mbkd::SimdLevel::available() {
        tree = tree.with_simd(level);
        answers(&tree, 12, seed);
    }
    for (mesh, triangle) in [(0, 0), (1, 7), (3, 20), (6, 29), (9, 0)] {
        for time in [0.0, 0.5, 1.0, 7.0, f32::NAN] {
            tree.triangle(mesh, triangle, time);
        }
    }
    if let Ok(placed) = InstanceTree::build(vec![Instance::new(Arc::new(tree), Pose::IDENTITY)], &WideParams::default())
    {
        placed.closest_hit(&Ray::new(Vec3::splat(2.0), -Vec3::ONE).at_time(0.4));
    }
}

#[test]
fn hostile_files_are_refused_or_answer_something() {
    let mut counts = [0; 2];
    for (number, (name, tree)) in trees().into_iter().enumerate() {
        hostile((&name, number), &file(&tree), rounds(), &mut counts, read, is_broken, run_queries);
    }
    println!("{} refused, {} answered", counts[0], counts[1]);
    assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
}

/// Files of trees over the caller's primitives, which rays are tested against by their boxes.
#[test]
fn files_of_custom_primitives_come_back_and_hostile_ones_are_refused_or_answer_something() {
    let mut random = Random(17);
    let mut counts = [0; 2];
    for (number, (keys, division)) in
        [(1, Division::Whole), (2, Division::Whole), (2, Division::SeparateTrees(2))].into_iter().enumerate()
    {
        let mut key = || (random.vec().as_dvec3(), f64::from(random.unit()) * 0.2);
        let blobs: Vec<Blob> =
            (0..90).map(|_| Blob::hidden(MovingSphere::new((0..keys).map(|_| key()).collect()))).collect();
        let params = BuildParams::wide(WideParams { division, ..WideParams::default() });
        let tree = RayTree::of_scene(&[], blobs.clone(), &params).unwrap();
        let mut bytes = Vec::new();
        tree.write_to(&mut bytes).unwrap();
        let read = |bytes: &[u8]| RayTree::read_with_shapes_from(&mut &bytes[..], blobs.clone());
        assert_eq!(answers(&read(&bytes).unwrap(), 60, 5), answers(&tree, 60, 5));
        let refused = |error: &_| is_broken(error) || matches!(error, FileError::OtherShapes { .. });
        let name = format!("{keys} keys, {division:?}");
        hostile((&name, number), &bytes, rounds(), &mut counts, read, refused, |mut tree, seed| {
            let _ = tree.validate();
            for level in mbkd::SimdLevel::available() {
                tree = tree.with_simd(level);
                answers(&tree, 12, seed);
            }
        });
    }
    println!("{} refused, {} answered", counts[0], counts[1]);
    assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
}

/// Lengths beyond the end of the file allocate no memory.
#[test]
fn a_lying_length_is_refused_without_memory_for_it() {
    for (_, tree) in trees() {
        let bytes = file(&tree);
        // Every word in turn is set to four billion, including halves of lengths.
        for at in (HEADER..bytes.len().min(400)).step_by(4) {
            let mut hostile = bytes.clone();
            hostile[at..at + 4].copy_from_slice(&0xffff_fff0u32.to_le_bytes());
            seal(&mut hostile);
            // A header with a larger length.
            let _ = read(&hostile);
            hostile[16..24].copy_from_slice(&(1u64 << 60).to_le_bytes());
            assert!(read(&hostile).is_err());
        }
    }
}

/// A reference that no leaf has any more, in a file with a right checksum, to a primitive that is not there.
#[test]
fn references_of_k_d_trees_are_checked_even_where_no_leaf_has_them() {
    let ball = |x: f64| {
        let active = TimeInterval::new(0.0, 0.5).unwrap();
        Shape::from(MovingSphere::fixed(DVec3::X * x, 1.0).with_active(active))
    };
    let params = BuildParams::kd(KdParams { max_depth: Some(0), ..KdParams::classic() });
    let tree = RayTree::of_scene(&[], vec![ball(0.0), ball(0.5)], &params).unwrap();
    let mut bytes = file(&tree);
    let last = bytes.len() - 12;
    assert_eq!(bytes[last..last + 4], 1u32.to_le_bytes());
    bytes[last..last + 4].copy_from_slice(&0x20_0000u32.to_le_bytes());
    for word in (HEADER..last).step_by(4) {
        // One of the words has the number of references of the leaf, in some of its bits.
        for bit in 0..32 {
            let mut hostile = bytes.clone();
            let value = u32::from_le_bytes(hostile[word..word + 4].try_into().unwrap());
            hostile[word..word + 4].copy_from_slice(&value.wrapping_sub(1 << bit).to_le_bytes());
            seal(&mut hostile);
            assert!(read(&hostile).is_err(), "word {word}, bit {bit}");
        }
    }
}
