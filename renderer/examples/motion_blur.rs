//! Renders moving scenes with motion blur: `cargo run --release --example motion_blur`, `--help` for the rest.

fn main() -> std::process::ExitCode {
    mbkd_renderer::main()
}
