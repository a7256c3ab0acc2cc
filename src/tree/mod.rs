//! The layouts that queries walk.

pub(crate) mod wide;
