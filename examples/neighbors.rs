//! Neighbours of moving points at any time: queries on a swarm of sparks between its keys.
//!
//! `cargo run --release --example neighbors`

use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborBuffer, PointParams, PointTree, TimeInterval};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A spinning disc of sparks; every third one exists only in the middle of the shutter.
    let sparks: Vec<MovingPoint> = (0..30_000)
        .map(|i| {
            let (ring, along) = ((i % 173) as f32 / 173.0, i as f32 * 0.618_034);
            let at = |turn: f32| {
                // A rational parametrization of half a circle, and its reflection: no trigonometry, so the same on every machine.
                let halves = 2.0 * (along + turn);
                let h = 2.0 * halves.fract() - 1.0;
                let radius = if (halves as u32).is_multiple_of(2) { ring } else { -ring };
                let (x, y) = ((1.0 - h * h) / (1.0 + h * h), 2.0 * h / (1.0 + h * h));
                Vec3::new(radius * x, radius * y, 0.1 * (1.0 - ring))
            };
            let spark = MovingPoint::new(at(0.0), at(0.02));
            Ok(if i % 3 == 0 { spark.with_active(TimeInterval::new(0.4, 0.6)?) } else { spark })
        })
        .collect::<Result<_, mbkd::IntervalError>>()?;
    let tree = PointTree::build(&sparks, &PointParams::default())?;
    println!("{} sparks\n{}", tree.len(), tree.statistics());

    // With the buffer the loop does not allocate.
    let mut buffer = NeighborBuffer::new();
    let probe = Vec3::new(0.5, 0.1, 0.05);
    for time in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let near = tree.query(probe, time).radius(0.05).collect_into(&mut buffer).len();
        let nearest = tree.query(probe, time).filter(|id| id % 2 == 0).nearest_n_into(3, &mut buffer);
        let ids: Vec<u32> = nearest.iter().map(|n| n.id).collect();
        println!("time {time}: {near} sparks within 0.05, nearest even ones {ids:?}");
    }

    if let Some(meeting) = tree.closest_approach(probe, -probe, TimeInterval::FULL) {
        println!(
            "a probe flying through the swarm comes closest to spark {} at time {:.3}, at a distance of {:.5}",
            meeting.id, meeting.time, meeting.distance
        );
    }
    Ok(())
}
