//! Traversals that queries of rays, points and regions share.

mod faces;
mod visitor;
mod wide;

pub(crate) use faces::Faces;
pub use visitor::Visitor;
pub(crate) use visitor::{Hierarchy, traverse};
pub(crate) use wide::{Cursor, NodeBlock, STACK, StackOf, WideQuery, WideTraversal, children_of, of_time_slice};
