//! The model of the README's animated picture: a biplane that tows a banner around a small planet.
//!
//! Everything is made here of solids of revolution, wings and boxes, so that anyone may change it and use it: nodes that sway, turn and
//! spin, two skins (banner and scarf), materials of glTF. `cargo run --release --example biplane` writes it as
//! `renderer/models/biplane.glb`, with the same bytes on every machine. The clip `fly` lasts 1.6 seconds and ends as it began.
//!
//! Lengths are those of a toy: the plane is two units long, flies along x and has y up; the file has a camera of its own.

mod cloth;
mod glb;
mod paint;
mod plane;
mod planet;
mod solids;
#[cfg(test)]
mod tests;

use glb::Writer;
use mbkd::glam::Vec3;
use std::path::{Path, PathBuf};

/// Seconds that the clip lasts.
const SECONDS: f32 = 1.6;

fn main() -> std::io::Result<()> {
    let (path, bytes) = (path(), biplane());
    std::fs::write(&path, &bytes)?;
    println!("wrote {}: {} bytes", path.display(), bytes.len());
    Ok(())
}

/// Where the model is.
fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models/biplane.glb")
}

/// The bytes of the GLB file.
fn biplane() -> Vec<u8> {
    let mut file = Writer::new("fly", SECONDS);
    plane::add(&mut file);
    planet::add(&mut file);
    camera(&mut file);
    file.finish()
}

/// A camera that looks at the plane from the front and a little from above: turned about what it looks at, then put away from it.
fn camera(file: &mut Writer) {
    let target = file.node("target", None, Vec3::new(-1.25, -0.2, 0.0));
    file.turn(target, Vec3::Y, 0.085);
    let height = file.node("height", Some(target), Vec3::ZERO);
    file.turn(height, Vec3::X, -0.02);
    let camera = file.node("camera", Some(height), Vec3::Z * 7.6);
    file.camera(camera, 0.46);
}
