//! Periodic lists where images are hard to tell: boxes of a few radii, and points near their faces, half a period apart, or many
//! periods away. Small sets, whose leaves are as large as the box.

use crate::list_case::ListCase;
use crate::set::Set;
use crate::support::Random;
use mbkd::{
    ListError, NeighborLists, PointArrays, PointParams, PointStructure, PointTree, Precision, Radii, SimdLevel,
    TimeInterval,
    glam::{DVec3, Vec3},
};

const LENGTHS: [f64; 3] = [1.0, 0.7, 1.9];

/// Points of a kind around a box with these lengths.
fn places(kind: &str, count: usize, rng: &mut Random) -> Vec<DVec3> {
    let mut along = |length: f64| {
        let unit = f64::from(rng.unit()) + f64::from(rng.unit()) * 1e-9;
        let whole = |most: usize, rng: &mut Random| rng.below(most) as f64;
        match kind {
            "in the box" => unit * length,
            // Up to roundings of f32 and of f64.
            "at the faces" => {
                let off = [0.0, 1e-16, -1e-16, 6e-8, -6e-8, 1e-3][rng.below(6)];
                length * (whole(2, rng) + off)
            }
            "half a period apart" => {
                let off = [0.0, 1e-16, -1e-16, 6e-8, -6e-8, 1e-2 * unit][rng.below(6)];
                length * (0.5 * whole(4, rng) + off)
            }
            "periods away" => length * (unit + whole(7, rng) - 3.0),
            "many periods away" => length * (unit + whole(3, rng) * 4321.0),
            _ => unreachable!("{kind}"),
        }
    };
    (0..count).map(|_| DVec3::from_array(LENGTHS.map(&mut along))).collect()
}

const KINDS: [&str; 5] = ["in the box", "at the faces", "half a period apart", "periods away", "many periods away"];

/// Radii from small ones, with which images of most leaves are certain, to those of more than half a period.
const RADII: [f32; 5] = [0.06, 0.14, 0.24, 0.36, 0.6];

const AXES: [[bool; 3]; 4] = [[true; 3], [true, true, false], [false, true, false], [true, false, true]];

#[test]
fn lists_equal_comparing_all_pairs() {
    let mut lists = NeighborLists::new();
    for (number, kind) in KINDS.into_iter().enumerate() {
        for count in [3, 40, 260, 700] {
            let mut rng = Random(10 * count as u64 + number as u64);
            let places = [count, 50].map(|count| places(kind, count, &mut rng));
            let [single, exact] =
                [true, false].map(|single| places.each_ref().map(|places| Set::new(vec![places.clone()], single)));
            for (turn, radius) in RADII.into_iter().enumerate() {
                let axes = AXES[(turn + count) % AXES.len()];
                let periods = [0, 1, 2].map(|axis| axes[axis].then_some(LENGTHS[axis]));
                let mut radii = |count| -> Vec<f32> { (0..count).map(|_| 2.0 * radius * rng.unit()).collect() };
                let (own, others) = (radii(count), radii(50));
                let alone = [
                    Radii::Equal(radius),
                    Radii::Own(&own),
                    Radii::Larger { own: &own, others: &own },
                    Radii::Sum { own: &own, others: &own },
                ];
                let among = [
                    Radii::Equal(radius),
                    Radii::Own(&own),
                    Radii::Larger { own: &own, others: &others },
                    Radii::Sum { own: &own, others: &others },
                ];
                let requests = [(alone, false, false), (alone, true, false), (among, false, true)];
                for (radii, once, other) in requests {
                    // The same for all, and one kind of radii of their own.
                    for radii in [radii[0], radii[1 + turn % 3]] {
                        let case = ListCase { time: 0.0, radii, periods, once, other };
                        for sets in [&single, &exact] {
                            let expected = case.expected([&sets[0], &sets[1]]);
                            for simd in SimdLevel::available() {
                                let [tree, among] =
                                    sets.each_ref().map(|set| set.tree(PointStructure::Automatic, simd));
                                let about = format!("{kind}, {count} points, {simd}, single {}", sets[0].single);
                                case.check(&expected, [&tree, &among], &sets[0], &mut lists, &about);
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Points with the same id are the same point, whatever their images.
#[test]
fn points_with_equal_ids_do_not_list_each_other() {
    let mut lists = NeighborLists::new();
    for kind in KINDS {
        let places = places(kind, 500, &mut Random(77));
        let (twice, ids) = (places.repeat(2), (0..500).chain(0..500).collect::<Vec<u32>>());
        for precision in [Precision::Single, Precision::Double] {
            let params = PointParams { precision, ..PointParams::default() };
            let set = |keys: &[DVec3], ids: &[u32]| {
                PointTree::build(&PointArrays { keys: &[keys], active: &[], ids }, &params).unwrap()
            };
            let (once, twice) = (set(&places, &[]), set(&twice, &ids));
            for radius in RADII {
                let run = |tree: &PointTree, lists: &mut NeighborLists| {
                    tree.neighbor_lists(0.0, radius).periodic(LENGTHS.map(Some)).sorted().run(lists).unwrap();
                };
                run(&once, &mut lists);
                let mut expected = vec![Vec::new(); 500];
                for (id, row) in lists.iter() {
                    expected[id as usize] = row.iter().flat_map(|&id| [id, id]).collect();
                }
                run(&twice, &mut lists);
                assert_eq!(lists.len(), 1000);
                for (id, row) in lists.iter() {
                    assert_eq!(row, expected[id as usize], "{kind}, {precision:?}, {radius}, point {id}");
                }
            }
        }
    }
}

/// The error names the lowest id whose list is too long, in whatever order the lists are made.
#[test]
fn the_lowest_id_with_too_many_neighbours_is_named_in_any_order() {
    let mut rng = Random(4);
    let count = 3000;
    for (periods, precision) in
        [(None, Precision::Single), (Some(3.0), Precision::Single), (Some(3.0), Precision::Double)]
    {
        for round in 0..4u32 {
            // Clumps of different sizes; ids ascend, descend or are mixed along the axis.
            let place = |i: u32| {
                Vec3::X * (i / 300) as f32 * 0.3 + rng.vec() * if (i / 300).is_multiple_of(2) { 1e-3 } else { 0.1 }
            };
            let mut points: Vec<Vec3> = (0..count).map(place).collect();
            match round {
                0 => {}
                1 => points.reverse(),
                _ => (1..count as usize).rev().for_each(|i| points.swap(i, rng.below(i + 1))),
            }
            let params = PointParams { precision, ..PointParams::default() };
            let tree = PointTree::build(&points, &params).unwrap();
            let mut lists = NeighborLists::new();
            let query = tree.neighbor_lists(0.0, 0.02).periodic([periods; 3]);
            query.in_order().run(&mut lists).unwrap();
            let lengths: Vec<usize> = lists.iter().map(|(_, row)| row.len()).collect();
            let mut swept = mbkd::EncounterLists::new();
            for most in [0, 5, 100, 298, 299] {
                let expected = lengths.iter().position(|&length| length > most);
                let expected = expected.map_or(Ok(()), |id| Err(ListError::TooManyNeighbors { id: id as u32 }));
                for threads in [1, 3] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    let found = pool.install(|| query.max_neighbors(most).run(&mut lists));
                    assert_eq!(found, expected, "{most}, {threads} threads");
                    if periods.is_none() {
                        let query = tree.neighbor_lists_swept(TimeInterval::FULL, 0.02).max_neighbors(most);
                        assert_eq!(pool.install(|| query.run(&mut swept)), expected, "{most}, {threads} threads");
                    }
                }
            }
        }
    }
}
