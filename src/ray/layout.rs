//! The layouts that a ray tree may have.

use super::kernel::outline::Outline;
use crate::error::BuildError;
use crate::geometry::{Frame, LinearBounds};
use crate::kd::{KdTree, build_kd};
use crate::layout::{LazyTree, Statistics, WideSource, WideTree};
use crate::params::{BuildParams, Policy};
use crate::primitive::Scene;
use crate::progress::Progress;

/// The arrays that queries traverse.
#[derive(Clone)]
pub(super) enum Layout {
    Wide(WideTree),
    Kd(KdTree),
    Lazy(LazyTree),
}

impl Layout {
    /// Builds the layout that the parameters choose.
    pub fn build(
        scene: &mut Scene,
        params: &BuildParams,
        progress: &Progress,
    ) -> Result<(Layout, Statistics), BuildError> {
        match &params.policy {
            Policy::Wide(params) => {
                let tree = WideTree::build(scene, params, progress)?;
                scene.release_build_data();
                let statistics = tree.statistics(scene);
                Ok((Layout::Wide(tree), statistics))
            }
            Policy::Kd(params) => {
                let (tree, times) = build_kd(scene, params, progress)?;
                let statistics = tree.statistics(scene).with_times(times);
                Ok((Layout::Kd(tree), statistics))
            }
            Policy::Lazy(params) => {
                let tree = LazyTree::build(scene, params, progress)?;
                let statistics = tree.statistics(scene);
                Ok((Layout::Lazy(tree), statistics))
            }
        }
    }

    /// The wide tree at the top: all of a wide tree, or what is above the subtrees of a lazy one.
    pub fn top(&self) -> Option<&WideTree> {
        match self {
            Layout::Wide(tree) => Some(tree),
            Layout::Lazy(tree) => Some(&tree.top),
            Layout::Kd(_) => None,
        }
    }

    /// The outline of a tree with this layout.
    pub fn outline(&self, frame: &Frame) -> Outline {
        let bounds = self.top().and_then(|tree| tree.linear_bounds(&Frame::WORLD));
        let swept = || LinearBounds::fixed(Frame::WORLD.box_to_world(frame.outward(frame.bounds)));
        Outline::new(&bounds.unwrap_or_else(swept), frame)
    }

    /// Whether a query with this mask is known to see everything, so that it may do without the mask.
    pub fn hides_nothing_from(&self, mask: u32) -> bool {
        match self {
            Layout::Wide(tree) => tree.masks.hide_nothing_from(mask),
            Layout::Kd(_) | Layout::Lazy(_) => false,
        }
    }

    /// Whether a ray may find a primitive in several leaves.
    pub fn repeats(&self) -> bool {
        !matches!(self, Layout::Wide(tree) if !tree.presplit)
    }
}
