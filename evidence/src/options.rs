//! The command lines of benchmarks.

/// The options that the caller gave; cargo passes `--bench` to every benchmark, which says nothing.
pub fn options<Options: clap::Parser>() -> Options {
    Options::parse_from(std::env::args_os().filter(|argument| argument != "--bench"))
}
