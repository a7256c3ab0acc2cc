//! When does a robot arm that moves come too near to what a scanner saw?
//!
//! `cargo run --release --example clearance`

use mbkd::glam::{DQuat, DVec3, Vec3};
use mbkd::{
    BuildParams, ClosestPointQuery, Instance, InstanceError, InstanceTree, Pose, RayTree, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// How near is too near, and by how much more something may already count as that, in metres.
const LEAST: f32 = 0.05;
const TOLERANCE: f32 = 1e-3;

/// Turns of the shoulder and of the elbow from the begin of the motion to its end, in radians.
const SHOULDER: f64 = 1.2;
const ELBOW: f64 = -0.7;

/// A box from the joint at zero to one metre along x.
fn link() -> TriangleMesh {
    let corner = |i: u32| Vec3::new((i & 1) as f32, ((i >> 1 & 1) as f32 - 0.5) * 0.1, ((i >> 2) as f32 - 0.5) * 0.1);
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    TriangleMesh::fixed(triangles.collect(), (0..8).map(corner).collect())
}

/// Both links at seventeen keys, between which each turns uniformly and its joint moves along a chord.
fn arm() -> Result<InstanceTree, InstanceError> {
    let link = Arc::new(RayTree::build(&[link()], &BuildParams::default())?);
    let key = |i: i32| {
        let time = f64::from(i) / 16.0;
        let upper = DQuat::from_rotation_z(SHOULDER * time);
        let lower = upper * DQuat::from_rotation_z(ELBOW * time);
        let at = |rotation: DQuat, translation: DVec3| Pose { rotation, translation, ..Pose::IDENTITY };
        (at(upper, DVec3::ZERO), at(lower, upper * DVec3::X))
    };
    let (upper, lower): (Vec<Pose>, Vec<Pose>) = (0..=16).map(key).unzip();
    InstanceTree::build(vec![Instance::new(link.clone(), upper), Instance::new(link, lower)], &WideParams::default())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arm = arm()?;
    // Points on a wall that the arm swings towards.
    let on_wall = |i: u32| DVec3::new(f64::from(i % 200) * 0.02 - 2.0, 1.4, f64::from(i / 200) * 0.02 - 1.0);
    let mut cloud: Vec<DVec3> = (0..20_000).map(on_wall).collect();
    // No point of the arm is faster: the elbow is one metre from the shoulder, the hand two.
    let speed = (2.0 * SHOULDER.abs() + ELBOW.abs()) as f32 * 1.01;

    // Steps that are as long as nothing can have come too near.
    let (mut time, mut answers) = (0.0f32, Vec::new());
    loop {
        // What is farther away stays so until the end.
        let reach = LEAST + speed * (1.0 - time);
        let queries: Vec<_> = cloud.iter().map(|&point| ClosestPointQuery::new(point, time).within(reach)).collect();
        arm.closest_points(&queries, &mut answers);
        cloud = cloud.iter().zip(&answers).filter(|(_, near)| near.is_some()).map(|(&point, _)| point).collect();
        let Some(found) = answers.iter().flatten().min_by(|a, b| a.near.distance.total_cmp(&b.near.distance)) else {
            println!("the arm stays clear");
            return Ok(());
        };
        let distance = found.near.distance;
        println!("time {time:.4}: {distance:.4} m, {} points left", cloud.len());
        if distance <= LEAST + TOLERANCE {
            println!("link {} is too near, at {:.3}", found.path[0], found.near.point);
            return Ok(());
        }
        time += (distance - LEAST) / speed;
        if time > 1.0 {
            println!("the arm stays clear");
            return Ok(());
        }
    }
}
