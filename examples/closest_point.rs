//! The distance of a flying drone from a flapping sail while the shutter is open.
//!
//! `cargo run --release --example closest_point`

use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, ClosestPointQuery, RayTree, TriangleMesh};

/// Vertices along each side of the sail.
const SIDE: u32 = 100;

/// The sail at one key: a square that bulges by `wind`.
fn sail(wind: f32) -> Vec<Vec3> {
    let at = |i: u32| i as f32 / (SIDE - 1) as f32;
    let vertex = |x: f32, y: f32| Vec3::new(x, y, 16.0 * wind * x * (1.0 - x) * y * (1.0 - y));
    (0..SIDE * SIDE).map(|i| vertex(at(i % SIDE), at(i / SIDE))).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let corner = |x: u32, y: u32| y * SIDE + x;
    let quads = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| (x, y)));
    let triangles = quads.flat_map(|(x, y)| {
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [[a, b, c], [a, c, d]]
    });
    let mesh = TriangleMesh::new(triangles.collect(), vec![sail(-0.2), sail(0.1), sail(0.3)]);
    let tree = RayTree::build(&[mesh], &BuildParams::default())?;

    // The drone flies past the sail; each query uses the position of both at the same time.
    let drone = |time: f32| DVec3::new(f64::from(time), 0.4, 0.5 - 0.2 * f64::from(time));
    let queries: Vec<ClosestPointQuery> =
        (0..=10).map(|i| i as f32 / 10.0).map(|time| ClosestPointQuery::new(drone(time), time).within(0.4)).collect();
    let mut answers = Vec::new();
    tree.closest_points(&queries, &mut answers);
    for (query, answer) in queries.iter().zip(&answers) {
        match answer {
            Some(near) => println!(
                "time {:.1}: triangle {} at {:.3}, {:.4} away",
                query.time, near.primitive, near.point, near.distance
            ),
            None => println!("time {:.1}: nothing within {}", query.time, query.max_distance),
        }
    }
    Ok(())
}
