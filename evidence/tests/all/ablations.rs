//! The page on the paper's ablations shows what the code does now.

use mbkd::KdParams;
use mbkd_evidence::ablations::{measure, rays, variants};

/// The rows of one scene are counted anew.
#[test]
fn the_page_has_the_counts_of_this_state() {
    let page = include_str!("../../../docs/ablations.md");
    let scene = (mbkd_scenes::find("hand").unwrap().make)(30_000);
    let rays = rays(128, |x, y, time| scene.camera.ray(x, y, 1.0, time));
    for max_references in [40.0, 6.0] {
        for (name, params) in variants(KdParams { max_references, ..KdParams::paper() }) {
            let row = measure(&scene.meshes, &rays, params).unwrap().cells("hand", name);
            assert!(page.contains(&row), "`cargo bench --bench ablations` gives another row: {row}");
        }
    }
}
