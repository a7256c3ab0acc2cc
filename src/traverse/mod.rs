//! Ways through the layouts that queries share.

mod wide;

pub(crate) use wide::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal, children_of};
