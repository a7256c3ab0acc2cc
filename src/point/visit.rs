//! Traversals of the caller's own through a [`PointTree`].

use super::over_interval::Boxed;
use super::partition::Layer;
use super::tree::PointTree;
use crate::geometry::Aabb;
use crate::simd::LANES;
use crate::traverse::{Hierarchy, Visitor, traverse};
use core::ops::ControlFlow;
use glam::DVec3;

/// A point in a leaf of a [`PointTree`], as a [`Visitor`] meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreePoint {
    /// The point's id.
    pub id: u32,
    /// Where it is at the time of the traversal, as queries see it.
    pub position: DVec3,
}

/// A node of one of the trees, or a leaf.
#[derive(Clone, Copy)]
struct Place {
    layer: usize,
    /// Which of the trees side by side in time.
    part: usize,
    /// `None` for a leaf: then `at` is its first block, and `blocks` their number.
    level: Option<usize>,
    at: usize,
    blocks: usize,
}

/// All layers at a time.
struct LayersAt<'a> {
    tree: &'a PointTree,
    time: f32,
}

impl LayersAt<'_> {
    /// Children or points of a place in a tree whose positions are relative to `origin`.
    fn expand_in(
        &self,
        tree: &impl Boxed,
        origin: DVec3,
        place: Place,
        children: &mut Vec<(Aabb, Place)>,
        items: &mut Vec<TreePoint>,
    ) {
        let Some(level) = place.level else {
            for block in place.at..place.at + place.blocks {
                for lane in (0..LANES).filter(|&lane| tree.counts(block, lane, self.time)) {
                    if let Some(flight) = tree.flight(block, lane) {
                        items.push(TreePoint { id: flight.id, position: tree.position(&flight, self.time) + origin });
                    }
                }
            }
            return;
        };
        let (first, stride) = tree.behind(level, place.at);
        let [begin, end] = tree.times(place.at);
        let [min, max] = tree.faces(place.at, &[tree.phase(self.time); LANES]);
        let time = f64::from(self.time);
        for lane in (0..LANES).filter(|&lane| begin[lane] <= time && time <= end[lane]) {
            let (level, blocks) = (level.checked_sub(1), if level == 0 { stride } else { 0 });
            let child = Place { level, at: first + lane * stride, blocks, ..place };
            let corner = |faces: [[f64; LANES]; 3]| DVec3::from_array(faces.map(|row| row[lane])) + origin;
            children.push((Aabb { min: corner(min), max: corner(max) }, child));
        }
    }
}

impl Hierarchy for LayersAt<'_> {
    type Node = Place;
    type Item = TreePoint;

    fn roots(&self, roots: &mut Vec<Place>) {
        for (layer, of) in self.tree.layers.iter().enumerate() {
            let part = of.part_at(self.time);
            let (level, at) = match of {
                Layer::Still(tree) => tree.top(),
                Layer::Moving(parts) => parts[part].top(),
            };
            roots.push(Place { layer, part, level: Some(level), at, blocks: 0 });
        }
        for (number, of) in self.tree.precise.iter().enumerate() {
            let (layer, part) = (self.tree.layers.len() + number, of.part_at(self.time));
            let (level, at) = of.parts[part].top();
            roots.push(Place { layer, part, level: Some(level), at, blocks: 0 });
        }
    }

    fn expand(&self, place: Place, children: &mut Vec<(Aabb, Place)>, items: &mut Vec<TreePoint>) {
        let origin = self.tree.origin;
        match self.tree.layers.get(place.layer) {
            Some(Layer::Still(tree)) => self.expand_in(tree, origin, place, children, items),
            Some(Layer::Moving(parts)) => self.expand_in(&parts[place.part], origin, place, children, items),
            None => {
                let layer = &self.tree.precise[place.layer - self.tree.layers.len()];
                self.expand_in(&layer.parts[place.part], DVec3::ZERO, place, children, items);
            }
        }
    }
}

impl PointTree {
    /// Leads a [`Visitor`] through the tree as it is at a time of the shutter: a traversal of the caller's own, for
    /// questions that no other query answers. Returns what the visitor said last; at a time outside `[0, 1]` it sees
    /// nothing.
    ///
    /// Each point that exists at the time is met in one leaf. A visitor is shown sixteen boxes per node, one after the
    /// other: this is for questions asked now and then rather than a million times.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{Aabb, MovingPoint, PointParams, PointTree, TreePoint, Visitor, glam::{DVec3, Vec3}};
    ///
    /// /// Finds the points that are above a plane, whose normal is `normal`.
    /// struct Above {
    ///     normal: DVec3,
    ///     offset: f64,
    ///     found: Vec<u32>,
    /// }
    /// impl Visitor<TreePoint> for Above {
    ///     fn enter(&mut self, b: &Aabb) -> Option<f32> {
    ///         // The corner that is farthest along the normal.
    ///         let corner = DVec3::select(self.normal.cmpge(DVec3::ZERO), b.max, b.min);
    ///         (self.normal.dot(corner) >= self.offset).then_some(0.0)
    ///     }
    ///     fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
    ///         if self.normal.dot(point.position) >= self.offset {
    ///             self.found.push(point.id);
    ///         }
    ///         ControlFlow::Continue(())
    ///     }
    /// }
    ///
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::Z * 10.0), MovingPoint::fixed(Vec3::Z * 3.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut above = Above { normal: DVec3::Z, offset: 4.0, found: Vec::new() };
    /// assert!(tree.traverse(0.5, &mut above).is_continue());
    /// assert_eq!(above.found, [0]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn traverse(&self, time: f32, visitor: &mut impl Visitor<TreePoint>) -> ControlFlow<()> {
        if !(0.0..=1.0).contains(&time) {
            return ControlFlow::Continue(());
        }
        traverse(&LayersAt { tree: self, time }, visitor)
    }
}
