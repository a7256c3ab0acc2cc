//! Trees in files: what comes back, what is refused, and what a file made to deceive can not do.

#[path = "../support/blob.rs"]
mod blob;
mod damage;
mod points;
mod rays;
mod support;
