//! How far points of one set reach: the largest radius below each lane of each node.

use super::radii::radius_of;
use crate::point::layout::over_interval::BoxTree;
use crate::point::search::layers::Layer;
use crate::simd::{LANES, Lanes};

/// The largest radius below each lane of the nodes of a tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Reach {
    /// By node.
    pub(super) nodes: Vec<Lanes<f32>>,
    /// The largest of all.
    pub(super) most: f32,
    /// The lowest id of a point that counts and for which there is no radius.
    pub(super) missing: Option<u32>,
}

impl Reach {
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Lanes<f32>>()
    }

    /// That of the points of a layer that exist at a time.
    pub(super) fn measure_at(&mut self, layer: &Layer, time: f32, radii: &[f32]) {
        let slice = layer.slice_at(time);
        match layer {
            Layer::Static(tree) => self.measure(tree, None, radii),
            Layer::Moving(trees) => self.measure(&trees[slice], Some(time), radii),
            Layer::Double(trees) => self.measure(&trees[slice], Some(time), radii),
            Layer::Kd(_) => unreachable!("`PointTree::box_tree_at` puts them into boxes before lists are made"),
        }
    }

    /// That of the points of a tree, of those that exist at a time if one is given.
    pub(super) fn measure<T: BoxTree + ?Sized>(&mut self, tree: &T, time: Option<f32>, radii: &[f32]) {
        let mut missing: Option<u32> = None;
        self.measure_blocks(tree, |block| {
            let mut largest = 0.0f32;
            for (lane, &id) in tree.block_ids(block).iter().enumerate() {
                // Which points the tree holds that do not exist at the time depends on its time slices.
                if id == u32::MAX || !time.is_none_or(|time| tree.is_active(block, lane, time)) {
                    continue;
                }
                largest = largest.max(radius_of(radii, id));
                if id as usize >= radii.len() {
                    missing = Some(missing.map_or(id, |other| other.min(id)));
                }
            }
            largest
        });
        self.missing = missing;
    }

    /// The largest of what each block of a tree has.
    pub(super) fn measure_blocks<T: BoxTree + ?Sized>(&mut self, tree: &T, mut of_block: impl FnMut(usize) -> f32) {
        let (level, node) = tree.shape().root();
        self.missing = None;
        self.nodes.clear();
        self.nodes.resize(node + 1, [0.0; LANES]);
        self.most = self.largest_below(tree, (level, node), &mut of_block);
    }

    /// The largest below a node, of which that of each lane is written. As deep as the tree, at most nine levels.
    fn largest_below<T: BoxTree + ?Sized>(
        &mut self,
        tree: &T,
        (level, node): (usize, usize),
        of_block: &mut impl FnMut(usize) -> f32,
    ) -> f32 {
        let (first, stride) = tree.shape().children(level, node);
        let begins = tree.times(node)[0];
        let mut most = 0.0f32;
        for lane in (0..LANES).filter(|&lane| begins[lane] < f32::INFINITY) {
            let mut below = 0.0f32;
            if level > 0 {
                below = self.largest_below(tree, (level - 1, first + lane), of_block);
            } else {
                for block in first + lane * stride..first + (lane + 1) * stride {
                    below = below.max(of_block(block));
                }
            }
            self.nodes[node][lane] = below;
            most = most.max(below);
        }
        most
    }
}
