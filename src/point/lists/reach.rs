//! How far points of one set reach: the largest radius behind each lane of each node.

use super::radii::radius_of;
use crate::point::layout::view::CoordinateView;
use crate::simd::{Kernel, LANES, Lanes, Simd};
use glam::Vec3;

/// The largest radius behind each lane of the nodes of a view.
#[derive(Clone, Debug, Default)]
pub(super) struct Reach {
    /// By node.
    pub(super) nodes: Vec<Lanes<f32>>,
    /// The largest of all.
    pub(super) most: f32,
    /// The lowest id of a point that exists at the time and for which there is no radius.
    pub(super) missing: Option<u32>,
}

impl Reach {
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Lanes<f32>>()
    }
}

/// Fills a [`Reach`] for the nodes of a view.
pub(super) struct MeasureReach<'a, V> {
    pub(super) view: V,
    pub(super) radii: &'a [f32],
    pub(super) reach: &'a mut Reach,
}

impl<V: CoordinateView> Kernel for MeasureReach<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let MeasureReach { view, radii, reach } = self;
        let (level, node) = view.root();
        reach.missing = None;
        reach.nodes.clear();
        reach.nodes.resize(node + 1, [0.0; LANES]);
        let most = s.call(MeasureNode { view: &view, level, node, radii, reach });
        reach.most = most;
    }
}

/// The largest radius below a node. As deep as the tree, at most nine levels.
struct MeasureNode<'a, V> {
    view: &'a V,
    level: usize,
    node: usize,
    radii: &'a [f32],
    reach: &'a mut Reach,
}

impl<V: CoordinateView> Kernel for MeasureNode<'_, V> {
    type Output = f32;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> f32 {
        let MeasureNode { view, level, node, radii, reach } = self;
        let target = view.target(s, Vec3::ZERO);
        let mut lanes = view.present(s, &target, node);
        let mut most = 0.0f32;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let below = if level > 0 {
                let node = view.first_child(level, node) + lane;
                s.call(MeasureNode { view, level: level - 1, node, radii, reach })
            } else {
                let first = view.first_block(node) + lane * view.leaf_blocks();
                let mut most = 0.0f32;
                for block in first..first + view.leaf_blocks() {
                    let [x, ..] = view.positions(s, &target, block);
                    // Other points do not exist at the time. Which of them the tree holds depends on its time slices.
                    let mut points = s.lt(x, s.splat(f32::MAX));
                    while points != 0 {
                        let id = view.ids(block)[points.trailing_zeros() as usize % LANES];
                        points &= points - 1;
                        most = most.max(radius_of(radii, id));
                        if id as usize >= radii.len() {
                            reach.missing = Some(reach.missing.map_or(id, |other| other.min(id)));
                        }
                    }
                }
                most
            };
            reach.nodes[node][lane] = below;
            most = most.max(below);
        }
        most
    }
}
