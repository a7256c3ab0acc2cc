//! Traversals of the caller's own through a [`PointTree`].

use super::moving_reference::phase;
use super::over_interval::Boxed;
use super::partition::Layer;
use super::tree::PointTree;
use crate::geometry::{Aabb, KeyTime};
use crate::simd::LANES;
use crate::traverse::{Hierarchy, Visitor, traverse};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

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
    fn bounds(&self, min: [f32; 3], max: [f32; 3]) -> Aabb {
        Aabb { min: self.to_world(min), max: self.to_world(max) }
    }

    fn to_world(&self, p: [f32; 3]) -> DVec3 {
        Vec3::from(p).as_dvec3() + self.tree.origin
    }

    fn expand_in(
        &self,
        tree: &impl Boxed,
        place: Place,
        children: &mut Vec<(Aabb, Place)>,
        items: &mut Vec<TreePoint>,
    ) {
        let (keys, segment, _) = tree.part();
        let at = KeyTime::new(self.time, keys);
        let Some(level) = place.level else {
            for block in place.at..place.at + place.blocks {
                for lane in (0..LANES).filter(|&lane| tree.counts(block, lane, self.time)) {
                    if let Some(flight) = tree.flight(block, lane) {
                        let position = at.position(
                            Vec3::from(flight.open.map(|x| x as f32)),
                            Vec3::from(flight.close.map(|x| x as f32)),
                        );
                        items.push(TreePoint { id: flight.id, position: self.to_world(position.to_array()) });
                    }
                }
            }
            return;
        };
        let (first, stride) = tree.behind(level, place.at);
        let [begin, end] = tree.times(place.at);
        let [min, max] = tree.faces_at(place.at, phase(at, segment));
        let time = f64::from(self.time);
        for lane in (0..LANES).filter(|&lane| begin[lane] <= time && time <= end[lane]) {
            let (level, blocks) = (level.checked_sub(1), if level == 0 { stride } else { 0 });
            let child = Place { level, at: first + lane * stride, blocks, ..place };
            children.push((self.bounds(min.map(|row| row[lane]), max.map(|row| row[lane])), child));
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
    }

    fn expand(&self, place: Place, children: &mut Vec<(Aabb, Place)>, items: &mut Vec<TreePoint>) {
        match &self.tree.layers[place.layer] {
            Layer::Still(tree) => self.expand_in(tree, place, children, items),
            Layer::Moving(parts) => self.expand_in(&parts[place.part], place, children, items),
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
