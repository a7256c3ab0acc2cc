//! Static trees at several times, as in an accumulation buffer (Haeberli and Akeley, SIGGRAPH 1990). A ray takes the
//! tree of the nearest time, so its answers are those of another time than its own.

use mbkd::glam::DVec3;
use mbkd::{BuildError, BuildParams, Hit, Keys, Observer, Ray, RayTree, TriangleMesh};

/// A static tree for each time slice, of the scene at the middle of it.
pub struct TimeSlices {
    trees: Vec<RayTree>,
}

impl TimeSlices {
    /// Builds this number of trees, at least one.
    pub fn new(meshes: &[TriangleMesh], slices: usize, params: &BuildParams) -> Result<TimeSlices, BuildError> {
        let slices = slices.max(1);
        let tree = |i: usize| {
            let time = (i as f32 + 0.5) / slices as f32;
            let still: Vec<TriangleMesh> = meshes.iter().map(|mesh| at_time(mesh, time)).collect();
            RayTree::build(&still, params)
        };
        Ok(TimeSlices { trees: (0..slices).map(tree).collect::<Result<_, _>>()? })
    }

    fn tree(&self, ray: &Ray) -> &RayTree {
        let slices = self.trees.len();
        // Saturates; a NaN time takes the first tree, and hits nothing.
        &self.trees[((ray.time * slices as f32) as usize).min(slices - 1)]
    }

    /// The closest hit at the slice's time.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.tree(ray).closest_hit(ray)
    }

    /// [`TimeSlices::closest_hit`] with an observer.
    pub fn closest_hit_observed(&self, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        self.tree(ray).closest_hit_observed(ray, observer)
    }

    /// The trees.
    pub fn trees(&self) -> &[RayTree] {
        &self.trees
    }
}

/// A static mesh with the positions of one time of the shutter; without triangles if the mesh is not active then.
pub fn at_time(mesh: &TriangleMesh, time: f32) -> TriangleMesh {
    let keys = mesh.keys.len().max(1);
    let at = f64::from(time) * (keys - 1) as f64;
    let first = (at as usize).min(keys.saturating_sub(2));
    let (last, s) = ((first + 1).min(keys - 1), at - first as f64);
    let keys = match &mesh.keys {
        Keys::F32(keys) if !keys.is_empty() => {
            let between = |a: DVec3, b: DVec3| a.lerp(b, s).as_vec3();
            let points = keys[first].iter().zip(&keys[last]).map(|(a, b)| between(a.as_dvec3(), b.as_dvec3()));
            Keys::F32(vec![points.collect()])
        }
        Keys::F64(keys) | Keys::Precise(keys) if !keys.is_empty() => {
            Keys::F64(vec![keys[first].iter().zip(&keys[last]).map(|(a, b)| a.lerp(*b, s)).collect()])
        }
        empty => empty.clone(),
    };
    let indices = if mesh.active.contains(time) { mesh.indices.clone() } else { Vec::new() };
    TriangleMesh::new(indices, keys).with_mask(mesh.mask)
}
