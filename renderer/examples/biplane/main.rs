//! The model of the README's animated picture: a biplane that tows a banner around a small planet.
//!
//! The model consists of solids of revolution, wings and boxes made by this program, so that anyone may change and use
//! it: nodes that sway and spin, two skins (banner and scarf), and glTF materials.
//! `cargo run --release --example biplane` writes it to `renderer/models/biplane.glb`, with the same bytes on every
//! machine. The clip `fly` lasts 1.6 seconds and loops.
//!
//! Lengths are those of a toy: the plane is two units long, flies along x and has y up; the file has a camera of its
//! own.

mod cloth;
mod glb;
mod paint;
mod plane;
mod planet;
mod solids;
#[cfg(test)]
mod tests;

use clap::Parser;
use glb::Writer;
use mbkd::glam::Vec3;
use std::path::{Path, PathBuf};

/// Length of the clip in seconds.
const SECONDS: f32 = 1.6;

#[derive(Parser)]
#[command(about = "Writes the model of a biplane that tows a banner around a small planet, as a GLB file")]
struct Args {
    /// The file, by default the one in the repository.
    #[arg(short, long, default_value_os_t = path())]
    output: PathBuf,
}

fn main() -> std::io::Result<()> {
    let (path, bytes) = (Args::parse().output, biplane());
    std::fs::write(&path, &bytes)?;
    println!("wrote {}: {} bytes", path.display(), bytes.len());
    Ok(())
}

/// The path of the model.
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

/// A camera that looks at the plane from the front and slightly above: rotated about its target, then moved away from
/// it.
fn camera(file: &mut Writer) {
    let target = file.node("target", None, Vec3::new(-1.25, -0.2, 0.0));
    file.turn(target, Vec3::Y, 0.085);
    let height = file.node("height", Some(target), Vec3::ZERO);
    file.turn(height, Vec3::X, -0.02);
    let camera = file.node("camera", Some(height), Vec3::Z * 7.6);
    file.camera(camera, 0.46);
}
