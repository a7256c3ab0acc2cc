//! Build parameters: the policy, the paper's choices, costs and budgets.

use crate::error::BuildError;
use crate::limits::{DEPTH_LIMIT, MAX_TIME_SLICES, MOST_REFERENCES};
use crate::tuning::lazy::SUBTREE;

/// The kind of tree that is built, with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Policy {
    /// A bounding volume hierarchy: sixteen-way nodes with boxes that move linearly, over leaf blocks for SIMD. The fastest, and
    /// the default.
    Wide(WideParams),
    /// A binary k-d tree: the paper's ([`KdParams::paper`]), the same with moving planes ([`KdParams::default`]), or an
    /// ordinary one over swept boxes ([`KdParams::classic`]).
    Kd(KdParams),
    /// A wide tree of which only the coarse top is built at once, and each subtree when a query first enters it.
    Lazy(LazyParams),
}

impl Default for Policy {
    fn default() -> Policy {
        Policy::Wide(WideParams::default())
    }
}

/// How a [`RayTree`](crate::RayTree) is built. The default is a wide tree, a bounding volume hierarchy with sixteen children in a
/// node.
///
/// ```
/// use mbkd::{BuildParams, KdParams, WideParams};
/// let wide = BuildParams::wide(WideParams { bytes_per_primitive: 256.0, ..WideParams::default() });
/// let kd = BuildParams::kd(KdParams { max_references: 4.0, ..KdParams::classic() });
/// assert!(wide.validate().is_ok() && kd.validate().is_ok());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BuildParams {
    /// The kind of tree.
    pub policy: Policy,
}

impl BuildParams {
    /// A wide tree.
    pub fn wide(params: WideParams) -> BuildParams {
        BuildParams { policy: Policy::Wide(params) }
    }

    /// A k-d tree.
    pub fn kd(params: KdParams) -> BuildParams {
        BuildParams { policy: Policy::Kd(params) }
    }

    /// A tree that is built on demand, where queries go.
    pub fn lazy(params: LazyParams) -> BuildParams {
        BuildParams { policy: Policy::Lazy(params) }
    }

    /// The tree exactly as in the paper: [`KdParams::paper`].
    pub fn paper() -> BuildParams {
        BuildParams::kd(KdParams::paper())
    }

    /// Checks that every parameter is in its range, as a build does. The parameters of an [`InstanceTree`](crate::InstanceTree) are
    /// checked as those of a wide tree.
    ///
    /// ```
    /// use mbkd::{BuildError, BuildParams, WideParams};
    /// let wrong = WideParams { max_references: 0.5, ..WideParams::default() };
    /// let error = BuildParams::wide(wrong).validate().unwrap_err();
    /// assert!(matches!(error, BuildError::Parameter { name: "max_references", .. }));
    /// ```
    ///
    /// # Errors
    /// [`BuildError::Parameter`] with the name of the first one that is not.
    pub fn validate(&self) -> Result<(), BuildError> {
        match &self.policy {
            Policy::Wide(params) => params.validate(),
            Policy::Kd(params) => params.validate(),
            Policy::Lazy(params) => params.validate(),
        }
    }
}

fn check(fine: bool, name: &'static str, expected: &'static str) -> Result<(), BuildError> {
    if fine { Ok(()) } else { Err(BuildError::Parameter { name, expected }) }
}

/// How a wide tree is built ([`Policy::Wide`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideParams {
    /// The largest number of references per primitive after pre-splits (early split clipping) of long triangles, in [1, 8].
    /// Triangles are split only if the expected cost of a ray falls enough; memory grows with the references. Default 1.58.
    pub max_references: f32,
    /// The budget of the tree, in bytes per primitive, in [128, 1e6]. Added to it are 36 bytes per triangle for each key beyond
    /// the second at which its motion changes, 50 bytes per key of a sphere, and 8 KiB per tree. If the tree cannot be made that
    /// small, the build fails with [`BuildError::OverBudget`].
    ///
    /// A larger budget allows more separate trees for parts of the shutter in regions with incoherent motion, including the
    /// share that the rest of the scene does not need. Without such regions, trees are far below the default of 1024
    /// (docs/measurements_rays.md).
    pub bytes_per_primitive: f32,
    /// The temporal splits. Default [`Division::Automatic`]. [`Division::SharedLeaves`] and [`Division::SeparateTrees`] ignore the
    /// budget.
    pub division: Division,
}

impl Default for WideParams {
    fn default() -> WideParams {
        WideParams { max_references: 1.58, bytes_per_primitive: 1024.0, division: Division::Automatic }
    }
}

impl WideParams {
    pub(crate) fn validate(&self) -> Result<(), BuildError> {
        check((1.0..=MOST_REFERENCES as f32).contains(&self.max_references), "max_references", "in [1, 8]")?;
        check((128.0..=1e6).contains(&self.bytes_per_primitive), "bytes_per_primitive", "in [128, 1e6]")?;
        check(self.division.is_valid(), "division", "of 2 to 16 time slices")
    }
}

/// How a wide tree divides the shutter.
///
/// If motion is incoherent, boxes over the whole shutter are wide. Then several hierarchies of nodes, each for its
/// own part of the shutter, are tighter. They share leaf blocks ([`Division::SharedLeaves`]), or each has its own
/// ([`Division::SeparateTrees`]), at a multiple of the memory.
///
/// ```
/// use mbkd::{BuildError, BuildParams, Division, WideParams};
/// let with = |division| BuildParams::wide(WideParams { division, ..WideParams::default() });
/// assert!(with(Division::SharedLeaves(4)).validate().is_ok());
/// assert!(matches!(with(Division::SeparateTrees(1)).validate(), Err(BuildError::Parameter { name: "division", .. })));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Division {
    /// For each region of the scene the division with the least cost of rays, estimated from samples, within
    /// [`WideParams::bytes_per_primitive`].
    #[default]
    Automatic,
    /// One hierarchy for the whole shutter everywhere: the quickest to build, for trees that are soon replaced (docs/rays.md).
    Whole,
    /// This many hierarchies (2 to 16) over common leaf blocks, for the whole scene, whatever their size: for comparisons.
    SharedLeaves(usize),
    /// This many separate trees (2 to 16), for the whole scene, whatever their size: for comparisons.
    SeparateTrees(usize),
}

impl Division {
    /// Whether it is used whatever its size.
    pub(crate) fn is_forced(self) -> bool {
        matches!(self, Division::SharedLeaves(_) | Division::SeparateTrees(_))
    }

    fn is_valid(self) -> bool {
        match self {
            Division::Automatic | Division::Whole => true,
            Division::SharedLeaves(n) | Division::SeparateTrees(n) => (2..=MAX_TIME_SLICES).contains(&n),
        }
    }
}

/// How a lazy tree is built ([`Policy::Lazy`]): for scenes of which queries visit a small part.
///
/// The build partitions the primitives into subtrees and makes the tree above them. The first query that enters a subtree
/// builds it, on its own thread; other queries that enter it meanwhile wait for it. Answers are those of every other
/// tree. The tree keeps the vertices of the meshes, from which subtrees are built.
///
/// ```
/// use mbkd::{BuildParams, LazyParams, Ray, RayTree, TriangleMesh, glam::Vec3};
/// // Ten thousand triangles in a row.
/// let positions = (0..10_000).flat_map(|i| [Vec3::ZERO, Vec3::Y, Vec3::Z].map(|p| p + Vec3::X * i as f32)).collect();
/// let mesh = TriangleMesh::fixed((0..10_000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions);
/// let tree = RayTree::build(&[mesh], &BuildParams::lazy(LazyParams::default()))?;
/// assert_eq!(tree.statistics().built_subtrees, 0);
/// assert!(tree.any_hit(&Ray::new(Vec3::new(99.5, 0.2, 0.2), Vec3::X).between(0.0, 1.0)));
/// let statistics = tree.statistics();
/// assert!(statistics.built_subtrees == 1 && statistics.subtrees > 1);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LazyParams {
    /// How subtrees are built. [`Division::Automatic`] chooses one division for neighbouring subtrees together, by samples of
    /// them; with [`Division::Whole`] they are built fastest, and rays take several times as long if motion is incoherent.
    /// [`WideParams::bytes_per_primitive`] is the budget of each of them; a subtree that cannot
    /// be made as small is larger, since a query has no error to return.
    pub wide: WideParams,
    /// The most primitives in a subtree, in [1, 65536]. With a larger number, more primitives are built that no query visits; with
    /// a smaller one, the coarse build takes longer. Default 2048.
    pub subtree: usize,
}

impl Default for LazyParams {
    fn default() -> LazyParams {
        LazyParams { wide: WideParams::default(), subtree: SUBTREE }
    }
}

impl LazyParams {
    fn validate(&self) -> Result<(), BuildError> {
        check((1..=65536).contains(&self.subtree), "subtree", "in [1, 65536]")?;
        self.wide.validate()
    }
}

/// How a k-d tree is built ([`Policy::Kd`]). The default is the paper's tree with moving planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KdParams {
    /// Whether a primitive that crosses a plane during the shutter is referenced on both sides, each with the time interval
    /// it spends there (the paper's tree). Otherwise an ordinary k-d tree over the boxes swept during the shutter: the
    /// simple method for motion in a k-d tree, for comparisons. Default true.
    pub intervals: bool,
    /// The time at which split planes are chosen. The paper compares 0, 0.5 and 1. Default 0.5.
    pub plane_time: f32,
    /// Whether the cost of a plane counts a primitive that crosses it by the time it spends on each side
    /// (the paper's time-weighted SAH) instead of once on each. Default true.
    pub time_weighted: bool,
    /// Whether a reference that was duplicated at some plane contributes to the choice of planes again once it lies
    /// on one side of a plane below for its whole interval. The paper is ambiguous. Default true.
    pub propagated_vote: bool,
    /// Whether split planes may move along with the primitives. The paper's planes are static, and so are all over swept
    /// boxes. Default true: fewer references cross a plane that moves with them.
    pub moving_planes: bool,
    /// Cost of a step through an inner node (the paper's K_T), > 0 and < 1e6. Only its ratio to
    /// [`intersection_cost`](KdParams::intersection_cost) matters. Default 1.
    pub traversal_cost: f32,
    /// Cost of testing a primitive (the paper's K_I), > 0 and < 1e6. Default 2.
    pub intersection_cost: f32,
    /// The cost of a plane with one side empty is multiplied by this, in (0, 1]: a value below 1 favours cutting off empty
    /// space. Default 0.8.
    pub empty_factor: f32,
    /// The greatest depth, at most 60. `None` (the default) is `8 + 1.3 b` for a number of primitives of `b` bits.
    pub max_depth: Option<u32>,
    /// The greatest number of references per primitive, in [1, 10000]. It is divided among subtrees by a fixed rule, so that
    /// the tree does not depend on the number of threads; when it is exhausted, nodes become leaves. Default 8.
    pub max_references: f32,
}

impl Default for KdParams {
    fn default() -> KdParams {
        KdParams {
            intervals: true,
            plane_time: 0.5,
            time_weighted: true,
            propagated_vote: true,
            moving_planes: true,
            traversal_cost: 1.0,
            intersection_cost: 2.0,
            empty_factor: 0.8,
            max_depth: None,
            max_references: 8.0,
        }
    }
}

impl KdParams {
    /// The tree exactly as in the paper: with static planes.
    pub fn paper() -> KdParams {
        KdParams { moving_planes: false, ..KdParams::default() }
    }

    /// An ordinary k-d tree over swept boxes.
    pub fn classic() -> KdParams {
        KdParams { intervals: false, ..KdParams::default() }
    }

    fn validate(&self) -> Result<(), BuildError> {
        let positive = |x: f32| x > 0.0 && x < 1e6;
        check((0.0..=1.0).contains(&self.plane_time), "plane_time", "in [0, 1]")?;
        check(positive(self.traversal_cost), "traversal_cost", "greater than 0 and less than 1e6")?;
        check(positive(self.intersection_cost), "intersection_cost", "greater than 0 and less than 1e6")?;
        check(self.empty_factor > 0.0 && self.empty_factor <= 1.0, "empty_factor", "in (0, 1]")?;
        check(self.max_depth.is_none_or(|d| d as usize <= DEPTH_LIMIT), "max_depth", "at most 60")?;
        check(self.max_references >= 1.0 && self.max_references <= 1e4, "max_references", "in [1, 10000]")
    }

    /// The depth budget for `n` primitives.
    pub(crate) fn depth_for(&self, n: usize) -> u32 {
        self.max_depth.unwrap_or(usual_depth(n)).min(DEPTH_LIMIT as u32)
    }
}

/// The default limit of the depth of a k-d tree over `n` objects.
pub(crate) fn usual_depth(n: usize) -> u32 {
    (8 + 13 * (usize::BITS - n.leading_zeros()) / 10).min(DEPTH_LIMIT as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(params: BuildParams) -> &'static str {
        match params.validate() {
            Err(BuildError::Parameter { name, .. }) => name,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let fine = KdParams::default;
        let kd = |params| wrong(BuildParams::kd(params));
        for params in [BuildParams::default(), BuildParams::paper(), BuildParams::kd(KdParams::classic())] {
            assert_eq!(params.validate(), Ok(()));
        }
        assert_eq!(kd(KdParams { plane_time: 1.5, ..fine() }), "plane_time");
        assert_eq!(kd(KdParams { plane_time: f32::NAN, ..fine() }), "plane_time");
        assert_eq!(kd(KdParams { traversal_cost: 0.0, ..fine() }), "traversal_cost");
        assert_eq!(kd(KdParams { intersection_cost: f32::INFINITY, ..fine() }), "intersection_cost");
        assert_eq!(kd(KdParams { empty_factor: 0.0, ..fine() }), "empty_factor");
        assert_eq!(kd(KdParams { max_depth: Some(61), ..fine() }), "max_depth");
        assert_eq!(kd(KdParams { max_references: 0.5, ..fine() }), "max_references");
        let fine = WideParams::default;
        let wide = |params| wrong(BuildParams::wide(params));
        assert_eq!(wide(WideParams { max_references: 9.0, ..fine() }), "max_references");
        assert_eq!(wide(WideParams { bytes_per_primitive: f32::NAN, ..fine() }), "bytes_per_primitive");
        for parts in [0, 1, 17, usize::MAX] {
            assert_eq!(wide(WideParams { division: Division::SharedLeaves(parts), ..fine() }), "division");
            assert_eq!(wide(WideParams { division: Division::SeparateTrees(parts), ..fine() }), "division");
        }
    }
}
