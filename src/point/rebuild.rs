//! From step to step of a simulation: a tree that begins with the order of the last one, and points in its order.

use super::build::source::Source;
use super::error::PointError;
use super::layout::slice_tree::all_ids;
use super::params::PointParams;
use super::search::layers::Layer;
use super::statistics::PointLayerKind;
use super::tree::{ALL_STATIC, PointTree, work_of};
use crate::parallel;
use crate::primitive::PointSet;
use crate::progress::Progress;
use crate::tuning::steps::MOST_EXCESS;
use std::collections::HashMap;

impl PointTree {
    /// Builds the tree again for the next step of a simulation, in which the points have moved a little: the same tree
    /// as [`PointTree::build`] gives, up to how fast it is, at a fraction of the cost.
    ///
    /// Points stay in the part of the tree where they were, and are put in order only among the few hundred around them. That is
    /// checked: where larger boxes have cost as much since all points were last put in order as doing so again costs, the tree is
    /// built afresh. Boxes are compared with those above them, so points may also be drawn together or apart. So it is if the set
    /// has another size, moves during the shutter, exists for a part of it, is kept in f64 or has ids of its own. Returns whether
    /// the order was kept.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let mut points: Vec<[f32; 3]> = (0..1000).map(|i| [i as f32, 0.0, 0.0]).collect();
    /// let mut tree = PointTree::build(&points, &PointParams::default())?;
    /// points.iter_mut().for_each(|p| p[0] += 0.25);
    /// assert!(tree.rebuild(&points, &PointParams::default())?);
    /// assert_eq!(tree.nearest([7.0f32, 0.0, 0.0], 0.0).unwrap().distance_squared, 0.0625);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    ///
    /// # Errors
    /// As [`PointTree::build`]; the tree is then as it was.
    pub fn rebuild<P: PointSet + ?Sized>(&mut self, points: &P, params: &PointParams) -> Result<bool, PointError> {
        parallel::entered(work_of(points), || self.read_and_rebuild(points, params))
    }

    fn read_and_rebuild<P: PointSet + ?Sized>(&mut self, points: &P, params: &PointParams) -> Result<bool, PointError> {
        let fits = points.len() == self.len() && points.keys() == 1 && matches!(self.layers[..], [Layer::Static(_)]);
        if !fits {
            *self = PointTree::build(points, params)?;
            return Ok(false);
        }
        params.validate()?;
        let source = Source::read(points, params.precision)?;
        if source.is_double() || !source.is_plain() || !self.has_ids_of(source.len) {
            *self = PointTree::of(&source, params, &Progress::new(None))?;
            return Ok(false);
        }
        let Some(Layer::Static(tree)) = self.layers.pop() else { unreachable!("the layer was looked at") };
        let mut tree = tree.moved(source.of_only_key());
        let kept = tree.excess() <= MOST_EXCESS;
        if !kept {
            tree = source.static_tree(source.len, 0..source.len, &Progress::new(None));
        }
        *self = PointTree::without_layers(source.len, source.origin, params.simd, true);
        let why = if kept { "all points are static; the order of the last step" } else { ALL_STATIC };
        self.add(Layer::Static(tree), PointLayerKind::Static, source.len, why.into());
        Ok(kept)
    }

    /// Whether the ids are 0, 1, 2, … `len - 1`, in any order.
    fn has_ids_of(&self, len: usize) -> bool {
        let mut seen = vec![0u64; len.div_ceil(64)];
        self.ids().all(|id| {
            let (word, bit) = (id as usize / 64, 1 << (id % 64));
            if id as usize >= len || seen[word] & bit != 0 {
                return false;
            }
            seen[word] |= bit;
            true
        })
    }

    /// The ids of all points in the order of the tree, in which points that are close in space are close together. A tree that
    /// consists of several, for time slices, has a point as many times as it is in these.
    ///
    /// ```
    /// use mbkd::{PointArrays, PointParams, PointTree};
    /// let set = PointArrays { keys: &[&[[0.0f32; 3], [1.0; 3]]], active: &[], ids: &[30, 20] };
    /// let tree = PointTree::build(&set, &PointParams::default())?;
    /// let mut ids: Vec<u32> = tree.ids().collect();
    /// ids.sort();
    /// assert_eq!(ids, [20, 30]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn ids(&self) -> impl Iterator<Item = u32> {
        self.layers.iter().flat_map(Layer::trees).flat_map(all_ids)
    }

    /// Hands out the order of the tree, in which points that are close in space are close together, and numbers the points by it:
    /// element `i` of what is returned is the id that point `i` had so far. (Points that share an id get one each in a tree of one
    /// static structure, and share the new one in all others.)
    ///
    /// A simulation that brings its arrays into this order finds neighbours close in memory, and may
    /// [`rebuild`](PointTree::rebuild) this tree from them.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let mut points = [[9.0f32; 3], [0.0; 3], [8.0; 3]];
    /// let mut tree = PointTree::build(&points, &PointParams::default())?;
    /// points = tree.take_order().iter().map(|&id| points[id as usize]).collect::<Vec<_>>().try_into().unwrap();
    /// let found = tree.nearest([8.1f32; 3], 0.0).unwrap();
    /// assert_eq!(points[found.id as usize], [8.0; 3]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn take_order(&mut self) -> Vec<u32> {
        let mut order = Vec::with_capacity(self.len());
        // Each point is in the tree once.
        let each_once = matches!(self.layers[..], [Layer::Static(_)]);
        let mut numbers = HashMap::with_capacity(if each_once { 0 } else { self.len() });
        for tree in self.layers.iter_mut().flat_map(Layer::trees_mut) {
            for block in 0..tree.block_count() {
                for id in tree.block_ids_mut(block).iter_mut().filter(|id| **id != u32::MAX) {
                    let mut next = || {
                        order.push(*id);
                        order.len() as u32 - 1
                    };
                    *id = if each_once { next() } else { *numbers.entry(*id).or_insert_with(next) };
                }
            }
        }
        order
    }
}
