//! The numbers that positions are kept in.

/// The numbers that a tree keeps positions in.
///
/// ```
/// use mbkd::{NeighborLists, PointParams, PointTree, Precision};
/// let in_f64 = PointParams { precision: Precision::Double, ..PointParams::default() };
/// // All of the wall's coordinates are f32 numbers, those of the fluid are not.
/// let wall = PointTree::build(&[[-1.0f64, 0.0, 0.0], [1.0, 0.0, 0.0]], &in_f64)?;
/// let fluid = PointTree::build(&[[0.1f64, 0.0, 0.0], [1.1, 0.0, 0.0]], &in_f64)?;
/// let mut lists = NeighborLists::new();
/// fluid.neighbor_lists(0.0, 0.5).among(&wall).in_order().run(&mut lists)?;
/// assert_eq!((lists.offsets(), lists.ids()), (&[0, 0, 1][..], &[1][..]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Precision {
    /// f32 positions in f32. f64 positions in f64, unless all coordinates are f32 numbers and lie on both sides of zero, or at it,
    /// along each axis: then in f32, and query points are rounded to f32 too. So one more point may change how the others are
    /// searched; ask for one of the others if that matters.
    #[default]
    Automatic,
    /// f32. Positions given in f64 are rounded relative to the middle of the set, by up to 2^-25 of its size, unless they are f32
    /// numbers as above.
    Single,
    /// f64, whatever they are given in: differences and squared distances are computed in f64, and the latter rounded to f32 in the
    /// end. Takes about twice the memory and 1 to 1.9 times the time.
    Double,
}
