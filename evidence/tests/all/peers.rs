//! Every exact structure answers as brute force does, bit for bit.

use mbkd::baseline::BruteForce;
use mbkd::glam::Vec3;
use mbkd::{BuildParams, Counters, Hit, KdParams, Ray, TimeInterval, TriangleMesh};
use mbkd_evidence::peers::{BvhParams, Collapsed, FourDParams, Peer, Structure, at_time};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use proptest::prelude::*;
use rayon::prelude::*;

/// All that are exact, the peers with small budgets and with large ones, binary and laid out wide.
fn exact() -> Vec<Structure> {
    let wide = collapsed().into_iter().map(Structure::Collapsed);
    binary().into_iter().chain(wide).collect()
}

/// Binary trees that are laid out wide: with and without parts of triangles, times and intervals.
fn collapsed() -> [Collapsed; 6] {
    [
        Collapsed::Bvh(BvhParams::BVH_I),
        Collapsed::Bvh(BvhParams { max_references: 8.0 }),
        Collapsed::FourD(FourDParams { max_references: 100.0, max_halvings: 20 }),
        Collapsed::Kd(KdParams::classic()),
        Collapsed::Kd(KdParams { max_references: 100.0, ..KdParams::paper() }),
        Collapsed::Kd(KdParams::default()),
    ]
}

fn binary() -> Vec<Structure> {
    vec![
        Structure::BvhI,
        Structure::msbvh(),
        Structure::Msbvh(BvhParams { max_references: 8.0 }),
        Structure::FourD(FourDParams::default()),
        Structure::FourD(FourDParams { max_references: 100.0, max_halvings: 20 }),
        Structure::FourD(FourDParams { max_halvings: 0, ..FourDParams::default() }),
        Structure::Library(BuildParams::default()),
        Structure::Portable(BuildParams::default()),
        Structure::Library(BuildParams::paper()),
        Structure::Library(BuildParams::kd(KdParams::default())),
        Structure::Library(BuildParams::kd(KdParams::classic())),
    ]
}

fn bits(hit: Option<Hit>) -> Option<[u32; 5]> {
    hit.map(|hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.mesh, hit.primitive])
}

/// Asks all structures all rays; how many hit.
fn compare(meshes: &[TriangleMesh], rays: &[Ray]) -> usize {
    let oracle = BruteForce::new(meshes).unwrap();
    let expected: Vec<_> = rays.iter().map(|ray| bits(oracle.closest_hit(ray))).collect();
    for structure in exact() {
        let peer = Peer::build(&structure, meshes).unwrap();
        for (ray, expected) in rays.iter().zip(&expected) {
            assert_eq!(bits(peer.closest_hit(ray)), *expected, "{structure:?} {ray:?}");
        }
    }
    expected.iter().flatten().count()
}

/// A place: anywhere, on a grid where planes and corners meet, or far out.
fn place() -> impl Strategy<Value = Vec3> {
    let anywhere = (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0).prop_map(Vec3::from);
    let grid = (-2i8..=2, -2i8..=2, -2i8..=2).prop_map(|(x, y, z)| Vec3::new(x as f32, y as f32, z as f32) * 0.5);
    let far = (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0).prop_map(|p| Vec3::from(p) * 40.0);
    prop_oneof![5 => anywhere, 4 => grid, 1 => far]
}

/// Corners of a triangle at all keys: loose, small and moving as a whole, or without area.
fn triangle(keys: usize) -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let loose = proptest::collection::vec([place(), place(), place()], keys);
    let small = (place(), [place(), place(), place()], proptest::collection::vec(place(), keys)).prop_map(
        |(at, corners, ways)| ways.into_iter().map(|way| corners.map(|c| at + c * 0.1 + way * 0.3)).collect(),
    );
    let flat = (place(), place(), proptest::collection::vec(place(), keys))
        .prop_map(|(a, b, ways)| ways.into_iter().map(|way| [a + way, b + way, a + way]).collect());
    prop_oneof![4 => loose, 4 => small, 1 => flat]
}

/// A mesh of up to 60 triangles, perhaps only there for a while.
fn mesh() -> impl Strategy<Value = TriangleMesh> {
    let active = prop_oneof![
        4 => Just(TimeInterval::FULL),
        1 => (0u8..4, 1u8..4).prop_map(|(a, n)| {
            TimeInterval::new(f32::from(a) / 8.0, f32::from(a + n) / 8.0).unwrap()
        }),
    ];
    let triangles = (1usize..5).prop_flat_map(|keys| proptest::collection::vec(triangle(keys), 1..60));
    (triangles, active).prop_map(|(triangles, active)| {
        let keys = triangles[0].len();
        let positions: Vec<Vec<Vec3>> = (0..keys).map(|key| triangles.iter().flat_map(|t| t[key]).collect()).collect();
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(indices, positions).with_active(active)
    })
}

/// A ray from anywhere to anywhere, often at an end of the shutter or along an axis.
fn ray() -> impl Strategy<Value = Ray> {
    let time = prop_oneof![Just(0.0f32), Just(1.0), Just(0.5), 0.0f32..1.0];
    (place(), place(), time, 0u8..5).prop_map(|(from, to, time, axis)| {
        let mut dir = to - from;
        if axis < 3 {
            dir = Vec3::ZERO.with_x(1.0);
            (0..axis).for_each(|_| dir = Vec3::new(dir.z, dir.x, dir.y));
        }
        Ray::new(from, dir).at_time(time)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn exact_structures_equal_brute_force(
        meshes in proptest::collection::vec(mesh(), 1..4),
        rays in proptest::collection::vec(ray(), 40),
    ) {
        // Half of the rays are aimed at corners, as they are at the ray's time.
        let corner = |i: usize, time: f32| {
            let mesh = at_time(&meshes[i % meshes.len()], time);
            let mbkd::Keys::F32(keys) = mesh.keys else { return Vec3::ZERO };
            keys[0][i * 7 % keys[0].len()]
        };
        let aimed = rays.iter().enumerate().map(|(i, ray)| {
            let dir = corner(i, ray.time) - ray.origin.as_vec3();
            Ray { dir, ..*ray }
        });
        let all: Vec<Ray> = rays.iter().copied().chain(aimed).collect();
        compare(&meshes, &all);
    }
}

#[test]
fn exact_structures_equal_brute_force_on_scenes() {
    ["hall", "hairball", "hand", "tornado", "needles30"].par_iter().for_each(|name| {
        let scene = (scene::find(name).unwrap().make)(3000);
        let mut random = Random(5);
        let mut unit = || random.unit_f64() as f32;
        let mut rays: Vec<Ray> = (0..1500).map(|_| scene.camera.ray(unit(), unit(), 1.0, unit())).collect();
        rays.extend((0..200).map(|i| scene.camera.ray(unit(), unit(), 1.0, (i % 2) as f32)));
        assert!(compare(&scene.meshes, &rays) > 20, "{name}");
    });
}

#[test]
fn nothing_is_hit_where_nothing_is() {
    compare(&[], &[Ray::new(Vec3::ZERO, Vec3::X)]);
    compare(&[TriangleMesh::fixed(vec![], vec![])], &[Ray::new(Vec3::ZERO, Vec3::X)]);
}

/// Triangles in one place cannot be told apart; the lowest is hit, and no build runs away.
#[test]
fn a_thousand_equal_triangles() {
    let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let moved = corners.iter().map(|p| p + Vec3::Z).collect();
    let mesh = TriangleMesh::new(vec![[0, 1, 2]; 1000], vec![corners, moved]);
    let rays: Vec<Ray> =
        (0..50).map(|i| Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z).at_time(i as f32 / 49.0)).collect();
    assert_eq!(compare(&[mesh], &rays), 50);
}

#[test]
fn structures_are_the_same_on_any_number_of_threads() {
    let scene = scene::hairball(20_000);
    // What is laid out wide is so by one thread, the library's k-d trees after a way through a file.
    let kd = Structure::Collapsed(Collapsed::Kd(KdParams::paper()));
    for structure in [Structure::BvhI, Structure::msbvh(), Structure::FourD(FourDParams::default()), kd] {
        let work = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let peer = pool.install(|| Peer::build(&structure, &scene.meshes).unwrap());
            let mut random = Random(9);
            let mut unit = || random.unit_f64() as f32;
            let mut counters = Counters::default();
            for _ in 0..500 {
                peer.closest_hit_observed(&scene.camera.ray(unit(), unit(), 1.0, unit()), &mut counters);
            }
            (peer.statistics(), counters)
        };
        assert!(work(1) == work(3), "{structure:?}");
    }
}

/// The budget of references holds, and spatial splits make use of it.
#[test]
fn budgets_hold() {
    let scene = scene::needles(5000, 0.05);
    let n = scene.triangles() as f32;
    for max_references in [1.0, 1.2, 2.0, 8.0] {
        let msbvh = Peer::build(&Structure::Msbvh(BvhParams { max_references }), &scene.meshes).unwrap().statistics();
        let params = FourDParams { max_references, ..FourDParams::default() };
        let four_d = Peer::build(&Structure::FourD(params), &scene.meshes).unwrap().statistics();
        assert!(msbvh.references as f32 <= max_references * n && four_d.references as f32 <= max_references * n);
        assert!(max_references < 2.0 || msbvh.references as f32 > 1.1 * n, "{msbvh:?}");
    }
}

/// A tree laid out wide has the leaves of the binary one (of a k-d tree those that are not empty) and their references, in
/// nodes that are full but for the lowest.
#[test]
fn laid_out_wide_a_tree_keeps_its_leaves() {
    let scene = scene::hairball(20_000);
    let kd = |params| Structure::Library(BuildParams::kd(params));
    for (binary, wide) in [
        (Structure::BvhI, Collapsed::Bvh(BvhParams::BVH_I)),
        (Structure::msbvh(), Collapsed::Bvh(BvhParams::MSBVH)),
        (Structure::FourD(FourDParams::default()), Collapsed::FourD(FourDParams::default())),
        (kd(KdParams::classic()), Collapsed::Kd(KdParams::classic())),
        (kd(KdParams::paper()), Collapsed::Kd(KdParams::paper())),
        (kd(KdParams::default()), Collapsed::Kd(KdParams::default())),
    ] {
        let of = |structure| Peer::build(&structure, &scene.meshes).unwrap().statistics();
        let (before, after) = (of(binary), of(Structure::Collapsed(wide)));
        let is_bvh = matches!(wide, Collapsed::Bvh(_));
        assert_eq!(before.references, after.references, "{wide:?}");
        assert!(if is_bvh { before.leaves == after.leaves } else { before.leaves >= after.leaves }, "{wide:?}");
        let children = (after.nodes + after.leaves - 1) as f32 / after.nodes as f32;
        assert!((4.0..=16.0).contains(&children), "{wide:?}: {children}");
    }
}

/// What time slices get wrong is the time: at a slice's own time they are exact.
#[test]
fn time_slices_are_exact_at_their_times() {
    let scene = scene::tornado(2000);
    let slices = Peer::build(&Structure::Slices(4, BuildParams::default()), &scene.meshes).unwrap();
    let oracle = BruteForce::new(&scene.meshes).unwrap();
    let mut random = Random(3);
    let (mut wrong, mut hits) = (0, 0);
    for i in 0..400 {
        let (x, y) = (random.unit_f64() as f32, random.unit_f64() as f32);
        let at = |time: f32| scene.camera.ray(x, y, 1.0, time);
        let exact = (i % 4) as f32 / 4.0 + 0.125;
        // Positions are rounded to f32 before the kernel sees them, where it interpolates in f64.
        let (a, b) = (slices.closest_hit(&at(exact)), oracle.closest_hit(&at(exact)));
        assert!(a.map(|h| h.primitive) == b.map(|h| h.primitive), "{a:?} {b:?}");
        hits += usize::from(a.is_some());
        let other = (exact + 0.12).min(1.0);
        wrong +=
            usize::from(slices.closest_hit(&at(other)).map(|h| h.t) != oracle.closest_hit(&at(other)).map(|h| h.t));
    }
    assert!(hits > 30 && wrong > hits / 4, "{wrong} of {hits}");
}
