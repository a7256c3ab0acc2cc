//! A forest in the wind: one tree of leaves with a thousand instances, each swaying about its own axis.
//!
//! `cargo run --release --example instances`

use mbkd::glam::{DQuat, DVec3, Vec3};
use mbkd::{BuildParams, Instance, InstanceTree, Pose, Ray, RayTree, TriangleMesh, WideParams};
use std::sync::Arc;

/// Leaves of the crown.
const LEAVES: u32 = 20_000;

/// Trees along each side of the forest.
const SIDE: u32 = 32;

/// A quasi-random point: fractional parts of multiples of irrational numbers, evenly distributed.
fn spread(i: u32) -> Vec3 {
    (Vec3::new(0.7549, 0.5698, 0.8192) * i as f32).fract()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A fluttering crown: leaves as loose triangles, built once.
    let corners = |wind: f32| {
        let leaf = move |i: u32| {
            let at = (spread(i) - 0.5) * 2.0 + Vec3::Z * 3.0;
            [at, at + Vec3::new(0.05, 0.0, wind), at + Vec3::new(0.0, 0.05, -wind)]
        };
        (0..LEAVES).flat_map(leaf).collect::<Vec<_>>()
    };
    let leaves = (0..LEAVES).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let crown = TriangleMesh::new(leaves, vec![corners(0.0), corners(0.02)]);
    let crown = Arc::new(RayTree::build(&[crown], &BuildParams::default())?);

    // The trees stand in rows, and each leans in the wind while the shutter is open: a rotation about its foot.
    let tree = |i: u32| {
        let lean = |angle: f64| Pose {
            scale: DVec3::splat(0.8 + 0.4 * f64::from(spread(i).x)),
            rotation: DQuat::from_rotation_y(angle) * DQuat::from_rotation_z(f64::from(i)),
            translation: DVec3::new(f64::from(i % SIDE), f64::from(i / SIDE), 0.0) * 3.0,
        };
        Instance::new(crown.clone(), vec![lean(0.0), lean(0.2 * f64::from(spread(i).y))])
    };
    let forest = InstanceTree::build((0..SIDE * SIDE).map(tree).collect(), &WideParams::default())?;
    println!("{}", forest.statistics());

    // One ray down at the forest, at three times.
    for time in [0.0, 0.5, 1.0] {
        let ray = Ray::new(Vec3::new(-5.0, 40.3, 8.0), Vec3::new(1.0, 0.1, -0.12)).at_time(time);
        match forest.closest_hit(&ray) {
            Some(found) => println!(
                "time {time:.1}: tree {}, leaf {}, at {:.3}, normal {:.3}",
                found.path[0],
                found.hit.primitive,
                ray.point(found.hit.t),
                forest.triangle_normal(&found, time)
            ),
            None => println!("time {time:.1}: nothing"),
        }
    }
    Ok(())
}
