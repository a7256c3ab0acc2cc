//! Custom traversals of a [`PointTree`].

use crate::geometry::{Aabb, KeyTime};
use crate::kd::KdView;
use crate::point::layout::kd_points::KdPoints;
use crate::point::layout::over_interval::{BlockTree, BoxTree, PointPath, all_lanes};
use crate::point::search::layers::Layer;
use crate::point::tree::PointTree;
use crate::simd::LANES;
use crate::traverse::{Hierarchy, Visitor, traverse};
use core::ops::ControlFlow;
use glam::DVec3;

/// A point in a leaf of a [`PointTree`], as a [`Visitor`] gets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreePoint {
    /// The point's id.
    pub id: u32,
    /// Its position at the time of the traversal, as queries see it.
    pub position: DVec3,
}

/// A node of one of the trees, or a leaf.
#[derive(Clone, Copy)]
struct Entry {
    layer: usize,
    /// The time slice: the index of the tree in its layer.
    slice: usize,
    /// `None` for a leaf: then `at` is its first block, and `blocks` their number.
    level: Option<usize>,
    at: usize,
    blocks: usize,
    /// Its cell, in a k-d tree, where `at` is a node in any case.
    cell: Aabb,
}

/// All layers at a time.
struct LayersAt<'a> {
    tree: &'a PointTree,
    time: f32,
}

impl LayersAt<'_> {
    /// Children or points of an entry in a tree of boxes.
    fn expand_boxes(
        &self,
        tree: &impl BlockTree,
        entry: Entry,
        children: &mut Vec<(Aabb, Entry)>,
        items: &mut Vec<TreePoint>,
    ) {
        let origin = self.tree.origin_of_positions();
        let Some(level) = entry.level else {
            for (block, lane) in all_lanes(entry.at..entry.at + entry.blocks) {
                if tree.is_active(block, lane, self.time) {
                    let at = |point: &PointPath| tree.position(point, self.time) + origin;
                    items.extend(tree.rows(block).point_path(lane).map(|f| TreePoint { id: f.id, position: at(&f) }));
                }
            }
            return;
        };
        let (first, stride) = tree.shape().children(level, entry.at);
        let [begin, end] = tree.times(entry.at);
        let [min, max] = tree.faces(entry.at, &[tree.phase(self.time); LANES]);
        for lane in (0..LANES).filter(|&lane| begin[lane] <= self.time && self.time <= end[lane]) {
            let (level, blocks) = (level.checked_sub(1), if level == 0 { stride } else { 0 });
            let child = Entry { level, at: first + lane * stride, blocks, ..entry };
            let corner = |faces: [[f64; LANES]; 3]| DVec3::from_array(faces.map(|row| row[lane])) + origin;
            children.push((Aabb { min: corner(min), max: corner(max) }, child));
        }
    }

    /// [`LayersAt::expand_boxes`] for a k-d tree: cells of its planes at the time, grown by their slack.
    fn expand_kd(&self, tree: &KdPoints, entry: Entry, children: &mut Vec<(Aabb, Entry)>, items: &mut Vec<TreePoint>) {
        match tree.node(entry.at as u32) {
            KdView::Leaf { first, count } => {
                let at = KeyTime::new(self.time, tree.slice.keys);
                for (block, lane) in all_lanes(first as usize..(first + count) as usize) {
                    if tree.leaves.is_active(block, lane, self.time) {
                        let position = |point: &PointPath| point.position(at).as_dvec3() + self.tree.origin;
                        let point = tree.leaves.paths(block).point_path(lane);
                        items.extend(point.map(|f| TreePoint { id: f.id, position: position(&f) }));
                    }
                }
            }
            KdView::Inner { plane, right } => {
                let (axis, left, right) = (plane.axis, entry.at as u32 + 1, right);
                let face = |by: f64| plane.at(self.time) + by + self.tree.origin[axis];
                let (mut below, mut above) = (entry.cell, entry.cell);
                below.max[axis] = below.max[axis].min(face(tree.slack(left)));
                above.min[axis] = above.min[axis].max(face(-tree.slack(right)));
                for (node, cell) in [(left, below), (right, above)] {
                    children.push((cell, Entry { at: node as usize, cell, ..entry }));
                }
            }
        }
    }
}

impl Hierarchy for LayersAt<'_> {
    type Node = Entry;
    type Item = TreePoint;

    fn roots(&self, roots: &mut Vec<Entry>) {
        for (layer, of) in self.tree.layers.iter().enumerate() {
            let slice = of.slice_at(self.time);
            let entry = Entry { layer, slice, level: None, at: 0, blocks: 0, cell: Aabb::EMPTY };
            let top = |(level, at)| Entry { level: Some(level), at, ..entry };
            roots.push(match of {
                Layer::Static(tree) => top(tree.shape().root()),
                Layer::Moving(trees) => top(trees[slice].shape().root()),
                Layer::Kd(trees) => {
                    let Aabb { min, max } = trees[slice].bounds();
                    Entry { cell: Aabb { min: min + self.tree.origin, max: max + self.tree.origin }, ..entry }
                }
                Layer::Double(trees) => top(trees[slice].shape().root()),
            });
        }
    }

    fn expand(&self, entry: Entry, children: &mut Vec<(Aabb, Entry)>, items: &mut Vec<TreePoint>) {
        match &self.tree.layers[entry.layer] {
            Layer::Static(tree) => self.expand_boxes(tree, entry, children, items),
            Layer::Moving(trees) => self.expand_boxes(&trees[entry.slice], entry, children, items),
            Layer::Kd(trees) => self.expand_kd(&trees[entry.slice], entry, children, items),
            Layer::Double(trees) => self.expand_boxes(&trees[entry.slice], entry, children, items),
        }
    }
}

impl PointTree {
    /// Traverses the tree as it is at a time of the shutter with a [`Visitor`]: a custom traversal, for
    /// queries that the library does not have. Returns what the visitor returned last; at a time outside `[0, 1]` it
    /// visits nothing.
    ///
    /// Each point that exists at the time is in exactly one leaf. A visitor gets the sixteen boxes of a node one after the
    /// other, which is much slower than the queries of the library: it is meant for occasional use.
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

    /// All points that exist at a time of the shutter, where queries see them then, in the order of the tree; none at a time
    /// outside `[0, 1]`. Linear time.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, glam::{DVec3, Vec3}};
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::Z * 10.0), MovingPoint::fixed(Vec3::Z * 3.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut now = tree.points_at(0.5);
    /// now.sort_by_key(|point| point.id);
    /// assert_eq!(now.iter().map(|point| point.position).collect::<Vec<_>>(), [DVec3::Z * 5.0, DVec3::Z * 3.0]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn points_at(&self, time: f32) -> Vec<TreePoint> {
        let mut all = All(Vec::with_capacity(self.len()));
        let _ = self.traverse(time, &mut all);
        all.0
    }
}

/// Takes all points.
struct All(Vec<TreePoint>);

impl Visitor<TreePoint> for All {
    fn enter(&mut self, _: &Aabb) -> Option<f32> {
        Some(0.0)
    }

    fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
        self.0.push(point);
        ControlFlow::Continue(())
    }
}
