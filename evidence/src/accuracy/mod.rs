//! The library's answers compared with the oracle's, over numerically difficult inputs.
//!
//! Errors are counted in two ways. In **ulp** of f32, where the problem is *well conditioned*: where changing every
//! input number by half an ulp, all in the worst directions at once, moves the exact answer by no more than [`WELL`]
//! ulp. And everywhere in **units**, one of which is that movement plus half an ulp for rounding the answer; an answer
//! with an error of `n` units is the exact answer, rounded, for input with an error of at most `n` half ulps.

mod approaches;
mod cases;
mod closest_points;
mod crossings;
mod neighbors;
mod rays;
mod spheres;
mod tally;
mod watertight;

pub use approaches::compare_approaches;
pub use cases::{PointCase, RayCase, closest_point_cases, point_cases, ray_cases, sphere_cases};
pub use closest_points::compare_closest_points;
use mbkd_scenes::Random;
pub use neighbors::{compare_neighbors, structures};
pub use rays::{SceneUnderTest, compare_rays, policies};
pub use spheres::compare_spheres;
pub use tally::{Errors, OrderTally, RayTally};
pub use watertight::{ClosedMesh, Leak, WatertightKind, closed_meshes, shoot};

/// A problem counts as well conditioned if half an ulp of input moves its answer by at most this many ulp.
pub const WELL: f64 = 2.0;

/// Verdicts (hit or miss, one neighbour before another) that an input error of this many units can change are not
/// counted as wrong.
pub const DOUBT: f64 = 4.0;

/// A time: often 0, 1, a key or an ulp beside one, otherwise any.
fn special_time(random: &mut Random, keys: usize) -> f32 {
    let key = random.below(keys.max(2)) as f32 / (keys.max(2) - 1) as f32;
    let time = match random.below(8) {
        0 => 0.0,
        1 => 1.0,
        2 => key,
        3 => key.next_up(),
        4 => key.next_down(),
        _ => random.unit_f64() as f32,
    };
    time.clamp(0.0, 1.0)
}
