//! Neighbours against comparing all points: every structure and instruction set, properties, the interface.

#[cfg(feature = "rayon")]
mod api;
mod exact;
#[cfg(feature = "rayon")]
mod lists;
mod property;
mod support;
