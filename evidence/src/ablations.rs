//! The paper's ablations (section 3.1.1 of the paper, measured on the procedural scenes): duplicates with time-weighted and with
//! plain counts, traversal steps and intersections with planes chosen at times 0, 0.5 and 1; and two choices of this crate:
//! whether propagated references contribute to SAH, and moving planes.

use mbkd::{BuildError, BuildParams, Counters, KdParams, Ray, RayTree, TriangleMesh};

/// The counts of one tree.
#[derive(Clone, Copy)]
pub struct Row {
    /// Per triangle.
    pub references: f64,
    /// References beyond the first of each triangle, in percent of all.
    pub duplicates: f64,
    /// Visits of inner nodes and leaves per ray.
    pub steps: f64,
    /// Tests of triangles per ray.
    pub tests: f64,
}

impl Row {
    /// The row of the table.
    pub fn cells(&self, scene: &str, variant: &str) -> String {
        let Row { references, duplicates, steps, tests } = self;
        format!("| {scene} | {variant} | {references:.2} | {duplicates:.1} | {steps:.1} | {tests:.1} |")
    }
}

/// The paper's tree, and what is changed in it.
pub fn variants(paper: KdParams) -> [(&'static str, KdParams); 6] {
    [
        ("the paper's tree", paper),
        ("plain counts", KdParams { time_weighted: false, ..paper }),
        ("planes at t = 0", KdParams { plane_time: 0.0, ..paper }),
        ("planes at t = 1", KdParams { plane_time: 1.0, ..paper }),
        ("propagated references do not vote", KdParams { propagated_vote: false, ..paper }),
        ("moving planes", KdParams { moving_planes: true, ..paper }),
    ]
}

/// Rays of a camera, which are given by a place in the picture and a time, with times distributed over the shutter: a fixed
/// pattern, the same for every tree.
pub fn rays(side: u32, camera: impl Fn(f32, f32, f32) -> Ray) -> Vec<Ray> {
    let mut rays = Vec::new();
    for y in 0..side {
        for x in 0..side {
            // The golden ratio separates the times of neighbouring pixels.
            let time = ((x * 7 + y * 13) as f32 * 0.618_034).fract();
            let at = |i: u32| (i as f32 + 0.5) / side as f32;
            rays.push(camera(at(x), at(y), time));
        }
    }
    rays
}

/// Builds a tree and counts what the closest hits of the rays take.
pub fn measure(meshes: &[TriangleMesh], rays: &[Ray], params: KdParams) -> Result<Row, BuildError> {
    let tree = RayTree::build(meshes, &BuildParams::kd(params))?;
    let mut counters = Counters::default();
    for ray in rays {
        tree.closest_hit_observed(ray, &mut counters);
    }
    let statistics = tree.statistics();
    let n = rays.len() as f64;
    Ok(Row {
        references: statistics.references_per_primitive(),
        duplicates: 100.0 * statistics.duplicates,
        steps: counters.steps() as f64 / n,
        tests: counters.primitive_tests as f64 / n,
    })
}
