//! A motion-blurred picture in ASCII characters: a card turns and a ball rolls by while the shutter is open.
//!
//! `cargo run --release --example rays`

use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Hit, MovingSphere, Ray, RayTree, TriangleMesh};

/// Size of the picture in characters, and rays per character, each at a different time.
const WIDTH: usize = 72;
const HEIGHT: usize = 28;
const SAMPLES: usize = 32;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Two triangles at five keys; their corners move on straight lines between keys.
    let card = |key: usize| {
        let (sin, cos) = (0.35 * key as f32).sin_cos();
        let corner = |x: f32, y: f32| Vec3::new(x * cos - 1.2, y, x * sin);
        vec![corner(-0.8, -0.8), corner(0.8, -0.8), corner(0.8, 0.8), corner(-0.8, 0.8)]
    };
    let card = TriangleMesh::new(vec![[0, 1, 2], [0, 2, 3]], (0..5).map(card).collect::<Vec<_>>());
    let ball = MovingSphere::new(vec![(DVec3::new(0.4, 0.0, 0.0), 0.6), (DVec3::new(1.6, 0.0, 0.0), 0.6)]);
    let tree = RayTree::of_scene(&[card], vec![ball], &BuildParams::default())?;

    // All rays in one batch, parallel to each other, each at its own time.
    let ray = |i: usize| {
        let (character, sample) = (i / SAMPLES, i % SAMPLES);
        let at = |along: usize, size: usize| (along as f32 + 0.5) / size as f32 - 0.5;
        let from = Vec3::new(6.0 * at(character % WIDTH, WIDTH), -4.6 * at(character / WIDTH, HEIGHT), 5.0);
        Ray::new(from, Vec3::NEG_Z).at_time((sample as f32 + 0.5) / SAMPLES as f32)
    };
    let rays: Vec<Ray> = (0..WIDTH * HEIGHT * SAMPLES).map(ray).collect();
    let mut hits = Vec::new();
    tree.closest_hits(&rays, &mut hits);

    for line in hits.chunks(WIDTH * SAMPLES) {
        println!("{}", line.chunks(SAMPLES).map(shade).collect::<String>());
    }
    Ok(())
}

/// Darker for geometry that covers more of the shutter; letters for the ball, whose mesh index follows the one mesh.
fn shade(hits: &[Option<Hit>]) -> char {
    let of = |mesh: u32| hits.iter().flatten().filter(|hit| hit.mesh == mesh).count();
    let (card, ball) = (of(0), of(1));
    let ramp = if card >= ball { [' ', '.', ':', '+', '#'] } else { [' ', 'o', 'o', 'O', '@'] };
    ramp[(card.max(ball) * 4).div_ceil(SAMPLES).min(4)]
}
