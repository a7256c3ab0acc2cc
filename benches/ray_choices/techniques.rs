//! Techniques switched off, one at a time: by a parameter if there is one, otherwise by giving the same triangles in a
//! form to which the technique does not apply.

use crate::Args;
use crate::measure::{Built, Row};
use mbkd::glam::Vec3;
use mbkd::{BuildError, BuildParams, Division, KdParams, Keys, SimdLevel, TriangleMesh, WideParams};
use mbkd_evidence::scene_rays::Rays;
use mbkd_evidence::triangles::scene_size;
use mbkd_scenes::Scene;

/// A row of the table.
pub struct Technique {
    /// Its position in the table.
    pub order: usize,
    pub name: &'static str,
    pub scene: String,
    pub speed: Row,
}

/// Larger scenes are not built as k-d trees: their build takes a hundred times as long.
const KD_TRIANGLES: usize = 500_000;

/// Switches off each technique that applies to the scene.
pub fn switched_off(args: &Args, scene: &Scene, automatic: &Built, rays: &Rays) -> Result<Vec<Technique>, BuildError> {
    let mut rows = Vec::new();
    let mut add = |order: usize, name: &'static str, speed: Row| {
        rows.push(Technique { order, name, scene: scene.name.clone(), speed });
    };
    let params = BuildParams::default;
    let work = automatic.work(rays);
    let against = |without: &Built| Row::speed(automatic, without, rays, args.runs);

    for (order, name, params) in [
        (0, "shutter divided", BuildParams::wide(WideParams { division: Division::Whole, ..WideParams::default() })),
        (1, "long triangles pre-split", BuildParams::wide(WideParams { max_references: 1.0, ..WideParams::default() })),
    ] {
        let without = Built::new(&scene.meshes, &params)?;
        if without.work(rays) != work {
            add(order, name, against(&without));
        }
    }
    if scene.meshes.iter().any(|mesh| mesh.keys.len() == 1) {
        let without = Built::new(&stirred(&scene.meshes), &params())?;
        add(2, "static nodes and blocks", against(&without));
    }
    let without = Built::new(&scene.meshes.iter().map(loose).collect::<Vec<_>>(), &params())?;
    if without.tree.statistics().bytes != automatic.tree.statistics().bytes {
        add(3, "shared vertices in blocks", against(&without));
    }
    add(4, "batches instead of single rays", Row::batches(automatic, rays, args.runs));
    if SimdLevel::best().name() != "avx2" {
        for level in SimdLevel::available().into_iter().filter(|level| level.name() == "avx2") {
            let without = Built::new(&scene.meshes, &params())?;
            let without = Built { tree: without.tree.with_simd(level), ..without };
            add(5, "the widest instructions instead of AVX2", against(&without));
        }
    }
    let without = Built::new(&scene.meshes, &params())?;
    let without = Built { tree: without.tree.with_simd(SimdLevel::BASELINE), ..without };
    add(6, "the widest instructions instead of portable code", against(&without));
    if scene.triangles() <= KD_TRIANGLES {
        let without = Built::new(&scene.meshes, &BuildParams::kd(KdParams::default()))?;
        add(7, "the wide layout instead of the k-d tree", against(&without));
    }
    Ok(rows)
}

/// The meshes, with static ones moved by a hundred-thousandth of the scene's size.
fn stirred(meshes: &[TriangleMesh]) -> Vec<TriangleMesh> {
    let by = Vec3::splat(1e-5 * scene_size(meshes));
    let mut stirred = meshes.to_vec();
    for mesh in &mut stirred {
        if let Keys::F32(keys) = &mut mesh.keys
            && keys.len() == 1
        {
            keys.push(keys[0].iter().map(|p| *p + by).collect());
        }
    }
    stirred
}

/// The mesh with three vertices of its own for each triangle.
fn loose(mesh: &TriangleMesh) -> TriangleMesh {
    let mut loose = mesh.clone();
    if let Keys::F32(keys) = &mut loose.keys {
        for key in keys {
            *key = mesh.indices.iter().flatten().map(|&i| key[i as usize]).collect();
        }
        loose.indices = (0..mesh.indices.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }
    loose
}
