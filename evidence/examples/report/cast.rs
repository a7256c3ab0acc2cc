//! Who takes part in sections 1 to 3: the structures, the scenes, the rays.

use mbkd::glam::Vec3;
use mbkd::{BuildError, BuildParams, KdParams, Ray, RayTree, SimdLevel, TriangleMesh};
use mbkd_evidence::peers::{BvhParams, Collapsed, FourDParams, Peer, Structure};
use mbkd_scenes::Random;
use mbkd_scenes::Scene;

/// A structure under its name.
pub struct Member {
    /// Its name in tables and legends.
    pub name: &'static str,
    /// How it is built.
    pub structure: Structure,
    /// Whether it is the library's default.
    pub ours: bool,
}

/// The exact structures: binary ones first, BVH_i at their head, then the library's wide tree.
pub fn exact() -> Vec<Member> {
    let member = |name, structure| Member { name, structure, ours: false };
    let kd = |params| Structure::Library(BuildParams::kd(params));
    vec![
        member("BVH_i", Structure::BvhI),
        member("MSBVH", Structure::msbvh()),
        member("classic k-d", kd(KdParams::classic())),
        member("4D k-d", Structure::FourD(FourDParams::default())),
        member("MBKD (the paper's)", kd(KdParams::paper())),
        member("MBKD, moving planes", kd(KdParams::default())),
        Member { name: "wide tree (default)", structure: Structure::wide(), ours: true },
    ]
}

/// The binary ones of [`exact`] in their order, laid out wide, and the library's wide tree on the instruction set that the
/// peers are compiled for.
pub fn laid_out_wide() -> Vec<Member> {
    let member = |name, of| Member { name, structure: Structure::Collapsed(of), ours: false };
    vec![
        member("BVH_i, wide", Collapsed::Bvh(BvhParams::BVH_I)),
        member("MSBVH, wide", Collapsed::Bvh(BvhParams::MSBVH)),
        member("classic k-d, wide", Collapsed::Kd(KdParams::classic())),
        member("4D k-d, wide", Collapsed::FourD(FourDParams::default())),
        member("MBKD (the paper's), wide", Collapsed::Kd(KdParams::paper())),
        member("MBKD, moving planes, wide", Collapsed::Kd(KdParams::default())),
        Member { name: "wide tree, portable", structure: Structure::Portable(BuildParams::default()), ours: true },
    ]
}

/// The instruction set that the peers are compiled for.
pub fn compiled_for() -> &'static str {
    if cfg!(target_feature = "avx512f") {
        "avx512"
    } else if cfg!(target_feature = "avx2") {
        "avx2"
    } else {
        SimdLevel::BASELINE.name()
    }
}

/// The procedural scene of that name and about that size.
pub fn scene(name: &str, triangles: usize) -> Result<Scene, String> {
    let recipe = mbkd_scenes::find(name).ok_or_else(|| format!("there is no scene {name}"))?;
    Ok((recipe.make)(triangles))
}

/// The flake as triangles, a twenty-faced ball for each sphere, all moving as the spheres do.
pub fn flake(triangles: usize) -> Vec<TriangleMesh> {
    // The regular icosahedron: cyclic permutations of (0, ±1, ±golden ratio).
    let g = 1.618_034f32;
    let corners: Vec<Vec3> = [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)]
        .into_iter()
        .flat_map(|(a, b)| [Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)])
        .map(Vec3::normalize)
        .collect();
    // Its faces: three corners that are each other's neighbours.
    let near = |a: usize, b: usize| corners[a].distance(corners[b]) < 1.1;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            faces.extend((b + 1..12).filter(|&c| near(a, b) && near(b, c) && near(a, c)).map(|c| [a, b, c]));
        }
    }
    let (spheres, _) = mbkd_scenes::flake(triangles / faces.len().max(1));
    let (mut indices, mut keys) = (Vec::new(), vec![Vec::new(); 3]);
    for (i, sphere) in spheres.iter().enumerate() {
        indices.extend(faces.iter().map(|face| face.map(|k| (12 * i + k) as u32)));
        for (key, center) in keys.iter_mut().zip(sphere.centers) {
            key.extend(corners.iter().map(|corner| center + corner * sphere.radius));
        }
    }
    vec![TriangleMesh::new(indices, keys)]
}

/// Camera rays, `side` times `side` pixels row by row, each at a random place of its pixel and a random time.
pub fn camera_rays(scene: &Scene, side: usize, random: &mut Random) -> Vec<Ray> {
    let mut unit = || random.unit_f64() as f32;
    (0..side * side)
        .map(|i| {
            let (x, y) = ((i % side) as f32 + unit(), (i / side) as f32 + unit());
            scene.camera.ray(x / side as f32, y / side as f32, 1.0, unit())
        })
        .collect()
}

/// From each place that a ray hits, a ray in a random direction off the surface (cosine-weighted), at the same time.
pub fn bounce_rays(meshes: &[TriangleMesh], rays: &[Ray], random: &mut Random) -> Result<Vec<Ray>, BuildError> {
    let tree = RayTree::build(meshes, &BuildParams::default())?;
    let bounce = |ray: &Ray| {
        let hit = tree.closest_hit(ray)?;
        let normal = tree.triangle_normal(&hit, ray.time).normalize_or_zero();
        let normal = if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
        let on_sphere = loop {
            let p = random.dvec().as_vec3();
            if (0.01..1.0).contains(&p.length_squared()) {
                break p.normalize();
            }
        };
        let dir = normal + on_sphere * 0.999;
        let origin = ray.point(hit.t) + (normal * 1e-4 * hit.t).as_dvec3();
        Some(Ray::new(origin, dir).at_time(ray.time))
    };
    Ok(rays.iter().filter_map(bounce).collect())
}

/// Asks a structure some rays.
pub fn run(peer: &Peer, rays: &[Ray]) {
    std::hint::black_box(rays.iter().filter(|ray| peer.closest_hit(ray).is_some()).count());
}
