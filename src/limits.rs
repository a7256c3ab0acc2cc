//! The limits of what the crate takes.

/// The largest magnitude a coordinate may have. Beyond it builds return an error.
pub const MAX_COORDINATE: f64 = 1e30;
