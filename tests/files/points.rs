//! Point trees of every structure are restored bit for bit, and hostile files are rejected or give arbitrary answers without a
//! panic.

use super::support::{Random, hostile, is_broken, rounds};
use core::fmt::Write;
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    FileError, MovingPoint, NeighborLists, PointArrays, PointLayerKind, PointParams, PointStructure, PointTree,
    SimdLevel, TimeInterval, TreePoint, Visitor,
};
use std::collections::BTreeSet;

fn fixed(n: usize, random: &mut Random) -> Vec<Vec3> {
    (0..n).map(|_| random.vec()).collect()
}

fn moving(n: usize, random: &mut Random) -> Vec<MovingPoint> {
    (0..n)
        .map(|i| {
            let open = random.vec();
            let speed = if i % 50 == 0 { 2.0 } else { 0.05 };
            MovingPoint::new(open, open + random.vec() * speed)
        })
        .collect()
}

/// Points with active intervals.
fn with_active_intervals(n: usize, random: &mut Random) -> Vec<MovingPoint> {
    let mut points = moving(n, random);
    for point in &mut points {
        let (a, b) = (random.unit(), random.unit());
        *point = point.with_active(TimeInterval::new(a.min(b), a.max(b) + 1e-6).unwrap_or(TimeInterval::FULL));
    }
    points
}

/// A few clusters far from each other, in f64.
fn far(n: usize, keys: usize, speed: f64, random: &mut Random) -> Vec<Vec<DVec3>> {
    let first: Vec<DVec3> = (0..n).map(|i| random.vec().as_dvec3() + DVec3::X * (i % 3) as f64 * 1e7).collect();
    (0..keys).map(|key| first.iter().map(|&p| p + random.vec().as_dvec3() * speed * key as f64).collect()).collect()
}

/// A tree for each structure, with its name.
pub fn trees() -> Vec<(String, PointTree)> {
    let mut random = Random(11);
    let of = |structure| PointParams { structure, ..PointParams::default() };
    let mut trees = Vec::new();
    for n in [0, 1, 16, 17, 300, 6000] {
        let tree = PointTree::build(&fixed(n, &mut random), &PointParams::default()).unwrap();
        trees.push((format!("{n} static"), tree));
    }
    let structures =
        [PointStructure::Automatic, PointStructure::Linear, PointStructure::TimeSlices(3), PointStructure::Kd];
    for structure in structures {
        for n in [1, 20, 700] {
            let tree = PointTree::build(&moving(n, &mut random), &of(structure)).unwrap();
            trees.push((format!("{n} moving, {structure:?}"), tree));
            let tree = PointTree::build(&with_active_intervals(n, &mut random), &of(structure)).unwrap();
            trees.push((format!("{n} with active intervals, {structure:?}"), tree));
        }
        let keys: Vec<Vec<Vec3>> = (0..4).map(|_| fixed(200, &mut random)).collect();
        let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
        let ids: Vec<u32> = (0..200).map(|i| 1_000_000_007u32.wrapping_mul(i / 2)).collect();
        let set = PointArrays { keys: &keys, active: &[], ids: &ids };
        trees.push((format!("4 keys, {structure:?}"), PointTree::build(&set, &of(structure)).unwrap()));
    }
    // Static points in a layer of their own.
    let mut some = moving(100, &mut random);
    some.extend(fixed(600, &mut random).into_iter().map(MovingPoint::fixed));
    trees.push(("some moving".into(), PointTree::build(&some, &PointParams::default()).unwrap()));
    for (keys, speed) in [(1, 0.0), (2, 0.1), (4, 0.1), (2, 1e-9)] {
        for structure in [PointStructure::Automatic, PointStructure::TimeSlices(2)] {
            let keys = far(300, keys, speed, &mut random);
            let keys: Vec<&[DVec3]> = keys.iter().map(Vec::as_slice).collect();
            let active: Vec<TimeInterval> = (0..300)
                .map(|i| if i % 5 == 0 { TimeInterval::new(0.2, 0.6).unwrap() } else { TimeInterval::FULL })
                .collect();
            for active in [&active[..], &[]] {
                let set = PointArrays { keys: &keys, active, ids: &[] };
                let name = format!("f64, {} keys, {} active intervals, {structure:?}", keys.len(), active.len());
                trees.push((name, PointTree::build(&set, &of(structure)).unwrap()));
            }
        }
    }
    trees
}

/// A large static tree with a few points far from the others.
fn large() -> PointTree {
    let mut random = Random(5);
    let mut points = fixed(270_000, &mut random);
    for (i, point) in points.iter_mut().enumerate() {
        *point *= if i % 3000 == 0 { 1e6 } else { 1.0 };
    }
    PointTree::build(&points, &PointParams::default()).unwrap()
}

/// The file of a tree.
pub fn file(tree: &PointTree) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<PointTree, FileError> {
    PointTree::read_from(&mut &bytes[..])
}

/// Visits a few hundred points.
struct Few(usize);

impl Visitor<TreePoint> for Few {
    fn enter(&mut self, _: &mbkd::Aabb) -> Option<f32> {
        Some(0.0)
    }
    fn visit(&mut self, _: TreePoint) -> ControlFlow<()> {
        self.0 += 1;
        if self.0 < 300 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }
}

/// What a tree answers to all kinds of searches, as text with every bit.
fn answers(tree: &PointTree, searches: usize, seed: u64) -> String {
    let (mut random, mut out) = (Random(seed), String::new());
    let mut queries = Vec::new();
    for i in 0..searches {
        let time = [0.0, 1.0, random.unit(), random.unit()][i % 4];
        let at = random.vec() + Vec3::X * [0.0, 1e7][i % 2];
        let radius = [0.05, 0.4, 1e6][i % 3];
        let k = [1, 4, 40, 2000][i % 4];
        let query = || tree.query(at, time);
        write!(out, "{:?} {:?} ", query().nearest(), query().radius(radius).nearest_n(k)).unwrap();
        write!(out, "{:?} {} ", query().radius(0.3).collect_sorted(), query().radius(radius).count()).unwrap();
        write!(out, "{:?} ", query().filter(|id| id % 2 == 0).nearest_n(3)).unwrap();
        write!(out, "{:?} ", query().approximate(0.5).nearest_n(5)).unwrap();
        let (begin, end) = (random.unit() * 0.5, 0.5 + random.unit() * 0.5);
        if let Ok(interval) = TimeInterval::new(begin, end) {
            writeln!(out, "{:?}", tree.closest_approach(at, at + random.vec(), interval)).unwrap();
        }
        queries.push((at, time));
    }
    writeln!(out, "{:?}", tree.nearest_batch(&queries)).unwrap();
    let mut visitor = Few(0);
    let _ = tree.traverse(0.4, &mut visitor);
    if tree.len() > 50_000 {
        return out;
    }
    let mut lists = NeighborLists::default();
    let made = tree.neighbor_lists(0.3, 0.02).sorted().with_distances().run(&mut lists);
    writeln!(out, "{} {made:?} {:?}", visitor.0, lists.iter().take(50).collect::<Vec<_>>()).unwrap();
    let made = tree.neighbor_lists(0.7, 0.02).in_order().run(&mut lists);
    writeln!(out, "{made:?} {}", lists.iter().count()).unwrap();
    if let Ok(interval) = TimeInterval::new(0.2, 0.3) {
        let swept =
            tree.neighbor_lists_swept(interval, 0.01).collect().map(|lists| format!("{:?}", lists.encounters()));
        writeln!(out, "{swept:?}").unwrap();
    }
    out
}

/// Writes and reads a tree, and compares all that it tells.
fn check(name: &str, tree: PointTree) {
    let bytes = file(&tree);
    let again = read(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert!(file(&again) == bytes, "{name}: written again it is another file");
    assert_eq!(answers(&again, 24, 5), answers(&tree, 24, 5), "{name}");
    assert_eq!((again.len(), again.origin()), (tree.len(), tree.origin()), "{name}");
    for (new, old) in again.statistics().layers.iter().zip(&tree.statistics().layers) {
        let counts = |s: &mbkd::PointLayerStatistics| (s.kind, s.points, s.references, s.nodes, s.levels);
        assert_eq!((counts(new), &new.why), (counts(old), &old.why), "{name}");
    }
    let (mut new, mut old) = (again, tree);
    let mut seen = BTreeSet::new();
    let ids: Vec<u32> = new.ids().filter(|&id| seen.insert(id)).collect();
    assert_eq!(ids, old.take_order(), "{name}");
    assert_eq!(ids, new.take_order(), "{name}");
}

#[test]
fn trees_come_back_bit_for_bit() {
    for (name, tree) in trees() {
        check(&name, tree);
    }
}

/// 40 000 points of which every `one_in`th moves up to `fast` along each axis, and the others hardly. `active` gives
/// the active intervals of the others.
fn with_fast_points(
    (one_in, fast): (usize, f32),
    active: impl Fn(&mut Random) -> TimeInterval,
    random: &mut Random,
) -> Vec<MovingPoint> {
    let point = |i: usize| {
        let open = random.vec();
        if i.is_multiple_of(one_in) {
            return MovingPoint::new(open, open + random.vec() * fast);
        }
        MovingPoint::new(open, open + random.vec() * 1e-3).with_active(active(random))
    };
    (0..40_000).map(point).collect()
}

/// The tree of points of which the automatic choice puts the fast ones in a layer of their own: with only two time slices
/// allowed, that is by far the cheapest.
fn separated(points: &[MovingPoint]) -> PointTree {
    let tree = PointTree::build(points, &PointParams { max_references: 2.0, ..PointParams::default() }).unwrap();
    let layers = &tree.statistics().layers;
    let moving = layers.iter().filter(|layer| matches!(layer.kind, PointLayerKind::Linear { .. }));
    let moving: Vec<usize> = moving.map(|layer| layer.points).collect();
    assert_eq!((moving.len(), moving.iter().sum()), (2, points.len()), "{layers:?}");
    tree
}

/// Fast points leave empty lanes in the leaves of the others.
#[test]
fn trees_with_fast_points_apart_come_back_bit_for_bit() {
    let mut random = Random(3);
    let tree = separated(&with_fast_points((20, 1.0), |_| TimeInterval::FULL, &mut random));
    check("fast points apart", tree);
}

/// The leaves that have empty lanes have active intervals too, and so do the nodes above them, some of which lack a leaf.
#[test]
fn trees_with_fast_points_apart_and_active_intervals_come_back_bit_for_bit() {
    let mut random = Random(3);
    let half = |random: &mut Random| {
        let begin = random.unit() * 0.5;
        TimeInterval::new(begin, begin + 0.5).unwrap()
    };
    let tree = separated(&with_fast_points((12, 3.0), half, &mut random));
    check("fast points apart, with active intervals", tree);
}

#[test]
fn large_trees_come_back() {
    let tree = large();
    let bytes = file(&tree);
    let again = read(&bytes).unwrap();
    assert!(file(&again) == bytes);
    let mut random = Random(1);
    for _ in 0..500 {
        let at = random.vec() * 1.2;
        assert_eq!(again.nearest_n(at, 0.0, 9), tree.nearest_n(at, 0.0, 9));
    }
}

#[test]
fn files_are_the_same_for_any_number_of_threads_and_instruction_set() {
    let mut random = Random(3);
    let points = moving(30_000, &mut random);
    let of = |threads: usize, simd: SimdLevel| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| file(&PointTree::build(&points, &PointParams { simd, ..PointParams::default() }).unwrap()))
    };
    let one = of(1, SimdLevel::BASELINE);
    for (threads, simd) in [(3, SimdLevel::BASELINE), (2, SimdLevel::best())] {
        assert!(of(threads, simd) == one, "{threads} threads, {simd}");
    }
}

#[test]
fn trees_go_on_from_step_to_step_after_loading() {
    let mut random = Random(9);
    let mut points = fixed(5000, &mut random);
    let mut tree = PointTree::build(&points, &PointParams::default()).unwrap();
    for step in 0..6 {
        points.iter_mut().for_each(|p| *p += random.vec() * 0.02);
        let kept = tree.rebuild(&points, &PointParams::default()).unwrap();
        let mut loaded = read(&file(&tree)).unwrap();
        points.iter_mut().for_each(|p| *p += random.vec() * 0.02);
        let other = loaded.rebuild(&points, &PointParams::default()).unwrap();
        assert_eq!(tree.rebuild(&points, &PointParams::default()).unwrap(), other, "step {step}, {kept}");
        assert!(file(&tree) == file(&loaded), "step {step}");
    }
}

/// Runs all queries on a tree, and builds from it.
fn run_queries(mut tree: PointTree, seed: u64) {
    answers(&tree, 9, seed);
    let points = vec![Vec3::ZERO; tree.len().min(10_000)];
    tree.take_order();
    let _ = tree.rebuild(&points, &PointParams::default());
}

/// Files with a right checksum and wrong contents: thousands of them.
#[test]
fn hostile_files_are_refused_or_answer_something() {
    let mut counts = [0; 2];
    for (number, (name, tree)) in trees().into_iter().enumerate() {
        hostile((&name, number), &file(&tree), rounds() / 4, &mut counts, read, is_broken, run_queries);
    }
    println!("{} refused, {} answered", counts[0], counts[1]);
    assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
    hostile(("large", 1000), &file(&large()), rounds() / 20, &mut counts, read, is_broken, run_queries);
}

#[test]
fn damaged_files_are_refused() {
    for (name, tree) in trees() {
        let bytes = file(&tree);
        for at in (0..bytes.len()).step_by(bytes.len() / 100 + 1) {
            match read(&bytes[..at]) {
                Err(FileError::Length { .. }) => {}
                other => panic!("{name}, the first {at} bytes: {other:?}"),
            }
            let mut damaged = bytes.clone();
            damaged[at] ^= 4;
            assert!(read(&damaged).is_err(), "{name}: byte {at}");
        }
    }
    let (_, tree) = trees().swap_remove(3);
    let mut other = Vec::new();
    tree.write_to(&mut other).unwrap();
    assert!(matches!(mbkd::RayTree::read_from(&mut &other[..]), Err(FileError::Kind { .. })));
}
