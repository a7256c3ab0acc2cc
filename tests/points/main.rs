//! Neighbours against comparing all points: every structure and instruction set, properties, the interface.

#[cfg(feature = "rayon")]
mod api;
mod exact;
mod property;
mod support;
