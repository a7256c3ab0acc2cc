//! How a tree is built: the policy, the paper's choices as parameters, costs and budgets.

use crate::error::BuildError;
use crate::limits::{DEPTH_LIMIT, MAX_TIME_SLICES};

/// What kind of tree is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// The engine: sixteen-way nodes with boxes that move linearly, over leaf blocks for SIMD.
    #[default]
    Wide,
    /// The paper's k-d tree: planes chosen at mid-shutter, what crosses a plane during the shutter counted on
    /// both sides, each with the time interval it spends there.
    Mbkd,
    /// An ordinary k-d tree over the boxes swept during the shutter: no intervals. The simple way to
    /// trace motion with a k-d tree, to compare with.
    ClassicKd,
}

/// How [`Policy::Wide`] divides the shutter.
///
/// Where neighbours part company, boxes over the whole shutter are wide. Then several hierarchies of nodes, each for its
/// own part of the shutter, are tighter; they share leaf blocks (segments) or not (copies, which take as
/// many times the memory).
///
/// ```
/// use mbkd::{BuildError, BuildParams, Division};
/// let params = BuildParams { division: Division::Segments(4), ..BuildParams::default() };
/// assert!(params.validate().is_ok());
/// let params = BuildParams { division: Division::Copies(1), ..BuildParams::default() };
/// assert!(matches!(params.validate(), Err(BuildError::Parameter { name: "division", .. })));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Division {
    /// Each part of the scene the division that costs its rays least, as samples of it say, within
    /// [`BuildParams::bytes_per_primitive`].
    #[default]
    Automatic,
    /// One hierarchy for the whole shutter everywhere.
    Whole,
    /// So many hierarchies (2 to 16) over common leaf blocks, for everything: to compare with.
    Segments(usize),
    /// So many separate trees (2 to 16), for everything, whatever they weigh: to compare with.
    Copies(usize),
}

impl Division {
    fn is_valid(self) -> bool {
        match self {
            Division::Automatic | Division::Whole => true,
            Division::Segments(n) | Division::Copies(n) => (2..=MAX_TIME_SLICES).contains(&n),
        }
    }
}

/// How a tree is built. Everything has a default; a struct literal changes what it names.
///
/// ```
/// use mbkd::{BuildParams, Policy};
/// let params = BuildParams { policy: Policy::ClassicKd, max_references: 4.0, ..BuildParams::default() };
/// assert!(params.validate().is_ok());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BuildParams {
    /// What kind of tree.
    pub policy: Policy,
    /// The time at which split planes are chosen. The paper compares 0, 0.5 and 1. Default 0.5.
    pub plane_time: f32,
    /// Whether the cost of a plane counts a primitive that crosses it by the time it spends on each side
    /// (the paper's time-weighted SAH) instead of once on each. Default true.
    pub time_weighted: bool,
    /// Whether a reference that was duplicated at some plane takes part in choosing planes again once it lies
    /// on one side of a plane below for its whole time. The paper can be read both ways. Default true.
    pub propagated_vote: bool,
    /// Whether split planes may move along with the primitives. The paper's stand still. Only for
    /// [`Policy::Mbkd`]. Default true: fewer references cross a plane that goes with them.
    pub moving_planes: bool,
    /// Cost of a step through an inner node (the paper's K_T), > 0. Only its ratio to
    /// [`intersection_cost`](BuildParams::intersection_cost) matters. Default 1.
    pub traversal_cost: f32,
    /// Cost of testing a primitive (the paper's K_I), > 0. Default 2.
    pub intersection_cost: f32,
    /// The cost of a plane with one side empty is multiplied by this, in (0, 1]: it favours cutting off empty
    /// space. Default 0.8.
    pub empty_factor: f32,
    /// The greatest depth, at most 60. `None` (the default) is `8 + 1.3 b` for a number of primitives of `b` bits.
    pub max_depth: Option<u32>,
    /// The greatest number of references per primitive, >= 1. It is divided among subtrees by rule, so that
    /// the tree does not depend on the number of threads; where it runs out there is a leaf. Default 8.
    pub max_references: f32,
    /// [`Policy::Wide`] only: references per primitive that cutting long triangles into parts may make, in [1, 8].
    /// They are made only where the expected cost of a ray falls enough; memory grows with them. Default 1.58.
    pub wide_references: f32,
    /// [`Policy::Wide`] only: bytes per primitive that the tree may take, at least 128. More lets those parts of a scene
    /// in which neighbours part company fast have more separate trees for parts of the shutter; what the rest of the
    /// scene does not need is theirs. Without such parts, trees take 35 to 150 bytes whatever this says. Default 1024.
    pub bytes_per_primitive: f32,
    /// [`Policy::Wide`] only: how the shutter is divided. Meshes with more than two keys are divided at their keys and at
    /// nothing else. Default [`Division::Automatic`].
    pub division: Division,
}

impl Default for BuildParams {
    fn default() -> BuildParams {
        BuildParams {
            policy: Policy::default(),
            plane_time: 0.5,
            time_weighted: true,
            propagated_vote: true,
            moving_planes: true,
            traversal_cost: 1.0,
            intersection_cost: 2.0,
            empty_factor: 0.8,
            max_depth: None,
            max_references: 8.0,
            wide_references: 1.58,
            bytes_per_primitive: 1024.0,
            division: Division::Automatic,
        }
    }
}

impl BuildParams {
    /// The paper's tree as the paper has it: [`Policy::Mbkd`] with planes that stand still.
    pub fn paper() -> BuildParams {
        BuildParams { policy: Policy::Mbkd, moving_planes: false, ..BuildParams::default() }
    }

    /// The parameters with another policy.
    pub fn with_policy(self, policy: Policy) -> BuildParams {
        BuildParams { policy, ..self }
    }

    /// Whether every parameter is in its range; the error names the one that is not.
    pub fn validate(&self) -> Result<(), BuildError> {
        let check = |fine: bool, name, expected| {
            if fine { Ok(()) } else { Err(BuildError::Parameter { name, expected }) }
        };
        let positive = |x: f32| x > 0.0 && x < 1e6;
        check((0.0..=1.0).contains(&self.plane_time), "plane_time", "in [0, 1]")?;
        check(positive(self.traversal_cost), "traversal_cost", "greater than 0 and less than 1e6")?;
        check(positive(self.intersection_cost), "intersection_cost", "greater than 0 and less than 1e6")?;
        check(self.empty_factor > 0.0 && self.empty_factor <= 1.0, "empty_factor", "in (0, 1]")?;
        check(self.max_depth.is_none_or(|d| d as usize <= DEPTH_LIMIT), "max_depth", "at most 60")?;
        check(self.max_references >= 1.0 && self.max_references <= 1e4, "max_references", "in [1, 10000]")?;
        check((1.0..=8.0).contains(&self.wide_references), "wide_references", "in [1, 8]")?;
        check((128.0..=1e6).contains(&self.bytes_per_primitive), "bytes_per_primitive", "in [128, 1e6]")?;
        check(self.division.is_valid(), "division", "of 2 to 16 parts")
    }

    /// The depth budget for `n` primitives.
    pub(crate) fn depth_for(&self, n: usize) -> u32 {
        self.max_depth.unwrap_or(usual_depth(n)).min(DEPTH_LIMIT as u32)
    }
}

/// The greatest depth of a k-d tree over `n` things unless another is asked for.
pub(crate) fn usual_depth(n: usize) -> u32 {
    (8 + 13 * (usize::BITS - n.leading_zeros()) / 10).min(DEPTH_LIMIT as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_out_of_range_are_named() {
        let fine = BuildParams::default;
        let name = |params: BuildParams| match params.validate() {
            Err(BuildError::Parameter { name, .. }) => name,
            other => panic!("{other:?}"),
        };
        assert_eq!(fine().validate(), Ok(()));
        assert_eq!(name(BuildParams { plane_time: 1.5, ..fine() }), "plane_time");
        assert_eq!(name(BuildParams { plane_time: f32::NAN, ..fine() }), "plane_time");
        assert_eq!(name(BuildParams { traversal_cost: 0.0, ..fine() }), "traversal_cost");
        assert_eq!(name(BuildParams { intersection_cost: f32::INFINITY, ..fine() }), "intersection_cost");
        assert_eq!(name(BuildParams { empty_factor: 0.0, ..fine() }), "empty_factor");
        assert_eq!(name(BuildParams { max_depth: Some(61), ..fine() }), "max_depth");
        assert_eq!(name(BuildParams { max_references: 0.5, ..fine() }), "max_references");
        assert_eq!(name(BuildParams { wide_references: 9.0, ..fine() }), "wide_references");
        assert_eq!(name(BuildParams { bytes_per_primitive: f32::NAN, ..fine() }), "bytes_per_primitive");
        for parts in [0, 1, 17, usize::MAX] {
            assert_eq!(name(BuildParams { division: Division::Segments(parts), ..fine() }), "division");
            assert_eq!(name(BuildParams { division: Division::Copies(parts), ..fine() }), "division");
        }
    }
}
