//! The wide layout: sixteen-way nodes with boxes that move linearly, and leaf blocks of up to sixteen
//! primitives, all in one arena.
//!
//! The picture to have in mind: a node is twelve rows of sixteen floats (lower and upper faces at time 0,
//! and how fast each moves) and a row of references to its children; one SIMD step tests a ray against all
//! sixteen boxes at the ray's own time. Where nothing moves the six velocity rows are left out. A leaf
//! block holds its triangles' corners in rows too, at both ends of their motion, and is tested in one
//! step; where triangles share vertices it holds each vertex once. A time node picks one child by the ray's time, and
//! may stand anywhere in the tree; its children may share leaf blocks.
//!
//! The files in the order in which data flows: a tree is planned (`plan`), it is decided what divides the shutter
//! (`divide`, `segments`), and blocks are written (`build`, `emit`, `leaf`) as `layout` says and put together
//! (`assemble`). Then the tree is walked once (`survey`): leaf blocks are the only place where corners are kept, and
//! whoever wants those of a triangle finds them there (`corners`).

mod assemble;
mod boxes;
mod build;
mod corners;
mod divide;
mod emit;
mod layout;
mod leaf;
mod plan;
mod segments;
mod survey;
mod validate;

pub use boxes::TreeBox;
pub(crate) use build::WideTree;
pub(crate) use layout::{CORNER_ROWS, ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS, VERTEX_ROWS, shared_count};
pub(crate) use leaf::WideSource;

#[cfg(test)]
mod tests;
