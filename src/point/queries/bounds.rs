//! The box around all points of a [`PointTree`].

use crate::geometry::Aabb;
use crate::point::layout::kd_points::KdPoints;
use crate::point::layout::over_interval::BoxTree;
use crate::point::search::layers::Layer;
use crate::point::tree::PointTree;
use crate::simd::LANES;
use glam::DVec3;

impl PointTree {
    /// A box around all points over the shutter, slightly enlarged for rounding; `None` if there are none. Points with active
    /// intervals count while they exist, and may enlarge it by what their motion would add in the rest of a time slice. Reads the
    /// root of each tree only.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, glam::{DVec3, Vec3}};
    /// let points = [MovingPoint::new(Vec3::ZERO, Vec3::X), MovingPoint::fixed(Vec3::Y)];
    /// let bounds = PointTree::build(&points, &PointParams::default())?.bounds().unwrap();
    /// assert!(bounds.contains(DVec3::ZERO) && bounds.contains(DVec3::X) && bounds.contains(DVec3::Y));
    /// assert!(bounds.max.abs_diff_eq(DVec3::new(1.0, 1.0, 0.0), 1e-5));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn bounds(&self) -> Option<Aabb> {
        let of_layer = |layer: &Layer| match layer {
            Layer::Static(tree) => swept_root(tree),
            Layer::Moving(trees) => union(trees.iter().map(swept_root)),
            Layer::Kd(trees) => union(trees.iter().map(KdPoints::bounds)),
            Layer::Double(trees) => union(trees.iter().map(swept_root)),
        };
        let Aabb { min, max } = union(self.layers.iter().map(of_layer));
        let origin = self.origin_of_positions();
        let all = Aabb { min: min + origin, max: max + origin };
        // No point may exist in the time slices of a tree that stands for another (`PointTree::box_tree`).
        (all.min.x <= all.max.x).then_some(all)
    }
}

fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::EMPTY, Aabb::union)
}

/// The box that the root of a tree sweeps during its time slice. Its faces move linearly, so those at the ends suffice.
fn swept_root(tree: &impl BoxTree) -> Aabb {
    let ((_, root), slice) = (tree.shape().root(), tree.slice());
    let [begin, _] = tree.times(root);
    let present = || (0..LANES).filter(|&lane| begin[lane].is_finite());
    let phases = slice.range([slice.interval.begin(), slice.interval.end()]);
    union(phases.into_iter().flat_map(|phase| {
        let faces = tree.faces(root, &[phase; LANES]);
        present().map(move |lane| {
            let [min, max] = faces.map(|face| DVec3::from_array(face.map(|row| row[lane])));
            Aabb { min, max }
        })
    }))
}
