//! Lists of few points that are scattered among many others: the answers of single queries and of comparing all pairs, without a
//! look at most of the others.

use crate::support::Random;
use mbkd::{
    EncounterLists, MovingPoint, Neighbor, NeighborLists, PointParams, PointStructure, PointTree, Precision, Radii,
    TimeInterval,
    glam::{DVec3, Vec3},
};

fn points(count: usize, rng: &mut Random) -> Vec<MovingPoint> {
    let mut at = |by: f32| Vec3::from_array(core::array::from_fn(|_| (2.0 * rng.unit() - 1.0) * by));
    let moving = |_| {
        let begin = at(1.0);
        MovingPoint::new(begin, begin + at(0.02))
    };
    (0..count).map(moving).collect()
}

fn tree(points: &[MovingPoint], structure: PointStructure, precision: Precision) -> PointTree {
    PointTree::build(points, &PointParams { structure, precision, ..PointParams::default() }).unwrap()
}

/// Structures and precisions.
const KINDS: [(PointStructure, Precision); 5] = [
    (PointStructure::Linear, Precision::Single),
    (PointStructure::TimeSlices(3), Precision::Single),
    (PointStructure::Kd, Precision::Single),
    (PointStructure::Linear, Precision::Double),
    (PointStructure::TimeSlices(2), Precision::Double),
];

#[test]
fn they_equal_single_queries() {
    let mut rng = Random(71);
    let (others, mut lists, mut found) = (points(12_000, &mut rng), NeighborLists::new(), 0);
    for (structure, precision) in KINDS {
        let tree = tree(&others, structure, precision);
        for count in [2, 10, 40, 300] {
            let queries: Vec<Vec3> = points(count, &mut rng).iter().map(|point| point.open).collect();
            let radii: Vec<f32> = (0..count).map(|_| 0.15 * rng.unit()).collect();
            for (time, periods) in [(0.0, [None; 3]), (0.4, [Some(2.5), None, Some(2.1)])] {
                let by_own = |i: usize| radii[i];
                let equal = |_: usize| 0.1;
                let cases: [(Radii, &dyn Fn(usize) -> f32); 2] = [(0.1.into(), &equal), (Radii::Own(&radii), &by_own)];
                for (radii, radius) in cases {
                    let query = tree.within_lists(&queries, time, radii).periodic(periods);
                    query.with_distances().sorted().in_order().run(&mut lists).unwrap();
                    assert_eq!(lists.len(), count);
                    for (i, &query) in queries.iter().enumerate() {
                        let of_row = lists.range(i);
                        let (ids, squares) = (&lists.ids()[of_row.clone()], &lists.distances_squared()[of_row]);
                        // Across faces, the two round differently.
                        let expected: Vec<Neighbor> = match periods {
                            [None, ..] => tree.query(query, time).radius(radius(i)).collect_sorted(),
                            _ => tree.periodic(periods).unwrap().query(query, time).radius(radius(i)).collect_sorted(),
                        };
                        let mut expected: Vec<_> = expected.iter().map(|n| (n.id, n.distance_squared)).collect();
                        expected.sort_by_key(|n| n.0);
                        assert_eq!(ids, expected.iter().map(|n| n.0).collect::<Vec<_>>(), "{structure:?}, {count}");
                        for (square, (_, expected)) in squares.iter().zip(&expected) {
                            let off = (square - expected).abs();
                            assert!(off == 0.0 || (periods[0].is_some() && off < 2e-7), "{square} {expected}");
                        }
                        found += ids.len();
                    }
                }
            }
        }
    }
    assert!(found > 20_000, "{found}");
}

#[test]
fn their_encounters_equal_comparing_all_pairs() {
    let mut rng = Random(72);
    let (others, mut lists, mut found) = (points(6000, &mut rng), EncounterLists::new(), 0);
    let of_others: Vec<f32> = others.iter().map(|_| 0.03 * rng.unit()).collect();
    for (structure, precision) in KINDS {
        let among = tree(&others, structure, precision);
        for count in [2, 10, 70] {
            let own = points(count, &mut rng);
            let of_own: Vec<f32> = (0..count).map(|_| 0.1 * rng.unit()).collect();
            let tree = tree(&own, PointStructure::Linear, precision);
            for (period, sum) in [(None, false), (None, true), (Some(2.1f32), false), (Some(2.1), true)] {
                let radii = if sum { Radii::Sum { own: &of_own, others: &of_others } } else { Radii::Equal(0.08) };
                let query = tree.neighbor_lists_swept(TimeInterval::FULL, radii).among(&among);
                query.periodic([period, None, None]).sorted().in_order().run(&mut lists).unwrap();
                for (i, point) in own.iter().enumerate() {
                    let mut row = lists.row(i).iter().map(|encounter| encounter.id).peekable();
                    for (j, other) in others.iter().enumerate() {
                        let radius = if sum { f64::from(of_own[i] + of_others[j]) } else { f64::from(0.08f32) };
                        let nearest = least_distance(point, other, period.map(f64::from));
                        let listed = row.next_if_eq(&(j as u32)).is_some();
                        let certain = (nearest - radius).abs() > 1e-9;
                        assert!(!certain || listed == (nearest < radius), "{structure:?}, {count}, {i}, {j}");
                        found += usize::from(listed);
                    }
                    assert_eq!(row.next(), None);
                }
            }
        }
    }
    assert!(found > 1000, "{found}");
}

/// The least distance of two points during the shutter.
fn least_distance(a: &MovingPoint, b: &MovingPoint, period: Option<f64>) -> f64 {
    let of_image = |shift: f64| {
        let [from, to] = [b.open.as_dvec3() - a.open.as_dvec3(), b.close.as_dvec3() - a.close.as_dvec3()]
            .map(|d| d + DVec3::X * shift);
        let path = to - from;
        let time = if path == DVec3::ZERO { 0.0 } else { (-from.dot(path) / path.dot(path)).clamp(0.0, 1.0) };
        (from + path * time).length()
    };
    let shifts = period.map_or(vec![0.0], |period| vec![-period, 0.0, period]);
    shifts.into_iter().map(of_image).fold(f64::INFINITY, f64::min)
}

/// In a tree of their own, ten points are one leaf, whose box holds nearly all of the others.
#[test]
fn they_gather_little() {
    let mut rng = Random(73);
    let others = points(20_000, &mut rng);
    let of_others: Vec<f32> = others.iter().map(|_| 0.05 * rng.unit()).collect();
    let all: usize = 20_000 / 16 * 256;
    for precision in [Precision::Single, Precision::Double] {
        let among = tree(&others, PointStructure::Linear, precision);
        let own = tree(&points(10, &mut rng), PointStructure::Linear, precision);
        let (equal, zeros) = (Radii::Equal(0.1), [0.0; 10]);
        for radii in [equal, Radii::Sum { own: &zeros, others: &of_others }] {
            let mut lists = NeighborLists::new();
            own.neighbor_lists(0.5, radii).among(&among).run(&mut lists).unwrap();
            // The reach of nodes is measured for all of them.
            let measured = if matches!(radii, Radii::Equal(_)) { 0 } else { 20_000 / 4 };
            assert!(lists.bytes() < all / 2 + measured, "{} of {all} bytes, {precision:?}", lists.bytes());
            assert!(lists.neighbors() > 0);
        }
    }
}
