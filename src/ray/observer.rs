//! Counting the steps of a query, at no cost where no observer is given.

/// Is called for each step of a query. All methods do nothing unless implemented.
///
/// A query without an observer is compiled without one, so the hooks cost it nothing. (On SSE2, in lazy trees, and for closest
/// points in k-d trees it is not: there they cost a test for each step.)
///
/// ```
/// use mbkd::{BuildParams, Observer, Ray, RayTree, TriangleMesh, glam::Vec3};
/// /// Counts leaves only.
/// struct Leaves(usize);
/// impl Observer for Leaves {
///     fn leaf(&mut self) {
///         self.0 += 1;
///     }
/// }
/// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
/// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
/// let mut leaves = Leaves(0);
/// tree.closest_hit_observed(&Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z), &mut leaves);
/// assert!(leaves.0 >= 1);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
pub trait Observer {
    /// An inner node is visited.
    #[inline(always)]
    fn node(&mut self) {}
    /// A leaf is visited.
    #[inline(always)]
    fn leaf(&mut self) {}
    /// A reference is skipped because its time interval excludes the ray's time.
    #[inline(always)]
    fn time_skip(&mut self) {}
    /// `count` primitives are tested. (The k-d layout counts each reference that is active at the ray's time, as the
    /// paper does, though a primitive that the ray met in another leaf just before is not tested again.)
    #[inline(always)]
    fn primitive_tests(&mut self, count: usize) {
        let _ = count;
    }
}

/// The observer that does nothing.
impl Observer for () {}

impl Observer for &mut dyn Observer {
    fn node(&mut self) {
        (**self).node();
    }
    fn leaf(&mut self) {
        (**self).leaf();
    }
    fn time_skip(&mut self) {
        (**self).time_skip();
    }
    fn primitive_tests(&mut self, count: usize) {
        (**self).primitive_tests(count);
    }
}

/// An optional observer.
impl Observer for Option<&mut dyn Observer> {
    #[inline(always)]
    fn node(&mut self) {
        if let Some(observer) = self {
            observer.node();
        }
    }
    #[inline(always)]
    fn leaf(&mut self) {
        if let Some(observer) = self {
            observer.leaf();
        }
    }
    #[inline(always)]
    fn time_skip(&mut self) {
        if let Some(observer) = self {
            observer.time_skip();
        }
    }
    #[inline(always)]
    fn primitive_tests(&mut self, count: usize) {
        if let Some(observer) = self {
            observer.primitive_tests(count);
        }
    }
}

/// Counts all steps; counters are added with `+`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Inner nodes visited.
    pub nodes: u64,
    /// Leaves visited.
    pub leaves: u64,
    /// References skipped by their time interval.
    pub time_skips: u64,
    /// Primitives tested, in the k-d layout by reference ([`Observer::primitive_tests`]).
    pub primitive_tests: u64,
}

impl Counters {
    /// Nodes and leaves together: the paper's traversal steps.
    pub fn steps(&self) -> u64 {
        self.nodes + self.leaves
    }
}

impl core::ops::Add for Counters {
    type Output = Counters;

    fn add(self, other: Counters) -> Counters {
        Counters {
            nodes: self.nodes + other.nodes,
            leaves: self.leaves + other.leaves,
            time_skips: self.time_skips + other.time_skips,
            primitive_tests: self.primitive_tests + other.primitive_tests,
        }
    }
}

impl Observer for Counters {
    fn node(&mut self) {
        self.nodes += 1;
    }
    fn leaf(&mut self) {
        self.leaves += 1;
    }
    fn time_skip(&mut self) {
        self.time_skips += 1;
    }
    fn primitive_tests(&mut self, count: usize) {
        self.primitive_tests += count as u64;
    }
}
