//! Writes the model of the README's animated picture: `cargo run --release --example biplane`.

use std::path::Path;

fn main() -> std::io::Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/biplane.glb");
    let bytes = mbkd_renderer::biplane::biplane();
    std::fs::write(&path, &bytes)?;
    println!("wrote {}: {} bytes", path.display(), bytes.len());
    Ok(())
}
