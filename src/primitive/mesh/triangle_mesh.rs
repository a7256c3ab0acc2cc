//! Triangle meshes whose vertices move.

use super::merge_keys::{DOUBLE, SINGLE, kept_keys};
use crate::error::BuildError;
use crate::geometry::{Aabb, Box3, Frame, TimeInterval};
use crate::limits::{MAX_COORDINATE, MAX_MESH_KEYS};
use crate::parallel;
use crate::simd::{Kernel, LANES, Mask, Simd, SimdLevel, as_coordinates, dispatch, lanes_at, lanes_at_mut};
use core::ops::Range;
use core::sync::atomic::{AtomicBool, Ordering};
use glam::{DVec3, Vec3};

/// An error if a mesh cannot have so many keys.
fn check_number_of_keys(mesh: usize, found: usize) -> Result<(), BuildError> {
    match found {
        0 => Err(BuildError::NoKeys { mesh }),
        1..=MAX_MESH_KEYS => Ok(()),
        _ => Err(BuildError::TooManyKeys { mesh, found }),
    }
}

/// Vertex positions at each key: the outer list runs over keys, the inner over vertices.
#[derive(Clone, Debug, PartialEq)]
pub enum Keys {
    /// Single precision.
    F32(Vec<Vec<Vec3>>),
    /// Double precision, for scenes far from zero; the tree keeps f32 positions relative to the
    /// scene's centre. (If meshes of the other kinds are in the same tree, then relative to zero along each axis on which not all
    /// coordinates lie within a factor of two of each other, so that those meshes keep their bits.)
    F64(Vec<Vec<DVec3>>),
    /// Double precision, kept to the last bit: see [`TriangleMesh::precise`].
    Precise(Vec<Vec<DVec3>>),
}

impl Keys {
    /// Number of keys.
    pub fn len(&self) -> usize {
        match self {
            Keys::F32(keys) => keys.len(),
            Keys::F64(keys) | Keys::Precise(keys) => keys.len(),
        }
    }

    /// Whether there is no key.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of vertices of one key.
    pub(crate) fn vertices(&self, key: usize) -> usize {
        match self {
            Keys::F32(keys) => keys[key].len(),
            Keys::F64(keys) | Keys::Precise(keys) => keys[key].len(),
        }
    }

    /// A vertex at one key in double precision.
    #[inline(always)]
    pub(crate) fn position(&self, key: usize, vertex: usize) -> DVec3 {
        match self {
            Keys::F32(keys) => keys[key][vertex].as_dvec3(),
            Keys::F64(keys) | Keys::Precise(keys) => keys[key][vertex],
        }
    }
}

impl From<Vec<Vec<Vec3>>> for Keys {
    fn from(keys: Vec<Vec<Vec3>>) -> Self {
        Keys::F32(keys)
    }
}

impl From<Vec<Vec<DVec3>>> for Keys {
    fn from(keys: Vec<Vec<DVec3>>) -> Self {
        Keys::F64(keys)
    }
}

/// An indexed triangle mesh with vertex positions at one or more keys, spaced evenly over the shutter.
///
/// One key: a static mesh. Two: every vertex moves on a straight line (the paper's case). More:
/// piecewise linear motion. Errors in a mesh are reported when a tree is built of it.
///
/// Redundant keys cost only the time to read them: if all vertices stay within 4u (u = 2^-24, relative to the coordinate) of
/// the lines between every second, third, … key, a tree keeps only those, and a single key if all keys are equal. So a straight
/// motion may be given with any number of keys. A mesh keeps the same keys for all its vertices; two meshes that
/// share vertices move identically to the last bit if they keep the same number of keys. A refit needs as many keys as the build
/// kept, so what will move otherwise in later frames is built with [`TriangleMesh::keep_keys`].
///
/// ```
/// use mbkd::{TimeInterval, TriangleMesh, glam::Vec3};
/// let open = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
/// let close = open.iter().map(|p| p + Vec3::Z).collect();
/// let mesh = TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])
///     .with_active(TimeInterval::new(0.0, 0.5)?); // gone in the second half
/// assert_eq!((mesh.len(), mesh.keys.len()), (1, 2));
/// # Ok::<(), mbkd::IntervalError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    /// Three vertex indices per triangle. Vertices that no triangle has must be finite and take memory, but do not extend the
    /// scene.
    pub indices: Vec<[u32; 3]>,
    /// Vertex positions at the keys, all keys of equal length.
    pub keys: Keys,
    /// The active interval of the mesh; keys span the whole shutter regardless.
    pub active: TimeInterval,
    /// Visibility: a masked query sees the mesh if its mask and this one share a bit.
    pub mask: u32,
    /// Whether trees keep redundant keys ([`TriangleMesh::keep_keys`]).
    pub keep_keys: bool,
}

impl TriangleMesh {
    /// A mesh from indices and its positions at each key (`Vec<Vec<Vec3>>` or `Vec<Vec<DVec3>>`).
    pub fn new(indices: Vec<[u32; 3]>, keys: impl Into<Keys>) -> TriangleMesh {
        TriangleMesh { indices, keys: keys.into(), active: TimeInterval::FULL, mask: u32::MAX, keep_keys: false }
    }

    /// A mesh that does not move. (With f64 positions: [`TriangleMesh::new`] with one key.)
    pub fn fixed(indices: Vec<[u32; 3]>, positions: Vec<Vec3>) -> TriangleMesh {
        TriangleMesh::new(indices, vec![positions])
    }

    /// The mesh with an active interval. Queries at other times do not see the mesh, and where much comes and goes, trees leave it
    /// out of time slices in which it does not exist, so that rays do not pass by it.
    pub fn with_active(self, active: TimeInterval) -> TriangleMesh {
        TriangleMesh { active, ..self }
    }

    /// The mesh with a visibility mask. With a mask of 0, only queries without a mask see it.
    pub fn with_mask(self, mask: u32) -> TriangleMesh {
        TriangleMesh { mask, ..self }
    }

    /// The mesh with all keys kept, also those that are redundant in this frame.
    ///
    /// [`RayTree::refit`](crate::RayTree::refit) takes frames whose meshes keep as many keys as when the tree was built. A wheel
    /// that turns in one frame and only rolls straight ahead in the next needs three keys in the first and two in the second; what
    /// is at rest and moves later needs one, and then two. With all keys kept, the number that is given counts. Each key beyond the
    /// second takes memory and time in refits, whether it is needed or not.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(-1.0, -1.0, z), Vec3::new(1.0, -1.0, z), Vec3::new(0.0, 1.0, z)];
    /// let moving = |z: [f32; 2]| TriangleMesh::new(vec![[0, 1, 2]], z.map(at).to_vec()).keep_keys();
    /// // At rest when the tree is built.
    /// let mut tree = RayTree::build(&[moving([0.0, 0.0])], &BuildParams::default())?;
    /// tree.refit(&[moving([0.0, 2.0])]).unwrap();
    /// let down = Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z).at_time(0.5);
    /// assert_eq!(tree.closest_hit(&down).unwrap().t, 8.0);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn keep_keys(self) -> TriangleMesh {
        TriangleMesh { keep_keys: true, ..self }
    }

    /// The mesh with f64 positions kept exactly, instead of rounded to f32 relative to the centre of the scene: for
    /// maps in geocentric coordinates, and for machines with small parts far from the origin. An f32 mesh is unchanged,
    /// since it keeps every bit anyway.
    ///
    /// Rays, [`closest_point`](crate::RayTree::closest_point), refits, files and [`BruteForce`](crate::baseline::BruteForce) then
    /// use these positions, with every policy. The cost of other meshes in the same tree does not change.
    ///
    /// Boxes are f32 nevertheless: culling has a resolution of some 2^-19 of the largest coordinate (relative to
    /// the centre of all meshes, along axes where all coordinates are within a factor of two of each other; to zero along
    /// others), and rays test every triangle within that distance. So a city of 10 km in geocentric coordinates is resolved
    /// to 2 cm, two machines 1e7 m apart only to 20 m: for these one tree each, placed in an
    /// [`InstanceTree`](crate::InstanceTree) without a transform, is as exact and far faster.
    ///
    /// Triangles that f32 does not rule out are decided by their f64 vertices, which takes time and memory (docs/limits.md).
    /// Redundant keys are dropped here as well, where all vertices stay within 2^-50, relative to the coordinate, of the lines
    /// between those that are kept.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
    /// // Two slabs of a millimetre, one on either side of a distance of ten thousand kilometres.
    /// let slab = |x: f64| vec![DVec3::new(x, -1e-3, 0.0), DVec3::new(x, 1e-3, 0.0), DVec3::new(x, 0.0, 1e-3)];
    /// let at = [0.001, 0.002, 1e7 + 0.001, 1e7 + 0.002];
    /// let corners: Vec<DVec3> = at.into_iter().flat_map(slab).collect();
    /// let mesh = TriangleMesh::new(vec![[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]], vec![corners]);
    /// let ray = Ray::new(DVec3::new(1e7, 0.0, 0.0005), Vec3::X);
    /// let tree = RayTree::build(&[mesh.clone().precise()], &BuildParams::default())?;
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(hit.primitive, 2);
    /// assert!((hit.t - 0.001).abs() < 2e-9);
    /// // Rounded to f32, all of this coincides.
    /// let rounded = RayTree::build(&[mesh], &BuildParams::default())?;
    /// assert!(rounded.closest_hit(&ray).is_none_or(|hit| (hit.t - 0.001).abs() > 1e-4));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn precise(self) -> TriangleMesh {
        let keys = match self.keys {
            Keys::F64(keys) => Keys::Precise(keys),
            other => other,
        };
        TriangleMesh { keys, ..self }
    }

    /// Whether its positions are kept in f64.
    pub(in crate::primitive) fn is_precise(&self) -> bool {
        matches!(self.keys, Keys::Precise(_))
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Checks the mesh; `mesh` is its index in errors. `before` is its extent when it had the same triangles, if that is known.
    pub(in crate::primitive) fn extent(
        &self,
        mesh: usize,
        before: Option<&MeshExtent>,
    ) -> Result<MeshExtent, BuildError> {
        let (swept, vertices) = (self.validate(mesh)?, self.keys.vertices(0));
        if before.is_some_and(|before| before.all_used && before.vertices == vertices) {
            return Ok(MeshExtent { swept, vertices, all_used: true });
        }
        Ok(match self.used_vertices(vertices) {
            None => MeshExtent { swept, vertices, all_used: true },
            Some(used) => MeshExtent { swept: self.box_of_used(&used), vertices, all_used: false },
        })
    }

    /// Which vertices are corners of triangles, whose indices are valid; `None` if all are.
    fn used_vertices(&self, vertices: usize) -> Option<Vec<bool>> {
        if vertices <= u64::BITS as usize {
            let used = self.indices.iter().flatten().fold(0, |used, &i| used | 1u64 << i);
            let all = used.count_ones() as usize == vertices;
            return (!all).then(|| (0..vertices).map(|i| used >> i & 1 != 0).collect());
        }
        let used: Vec<AtomicBool> = (0..vertices).map(|_| AtomicBool::new(false)).collect();
        let mark = |of: Range<usize>| {
            self.indices[of].iter().flatten().for_each(|&i| used[i as usize].store(true, Ordering::Relaxed));
        };
        parallel::parts(self.indices.len(), mark).for_each(drop);
        let used: Vec<bool> = used.into_iter().map(AtomicBool::into_inner).collect();
        used.contains(&false).then_some(used)
    }

    /// The box of the vertices that are used, at all keys.
    fn box_of_used(&self, used: &[bool]) -> Aabb {
        let numbers = || (0..used.len()).filter(|&vertex| used[vertex]);
        let positions = (0..self.keys.len()).flat_map(|key| numbers().map(move |vertex| (key, vertex)));
        Aabb::of_points(positions.map(|(key, vertex)| self.keys.position(key, vertex)))
    }

    /// Checks all that a build requires of a mesh; `mesh` is its index in errors. Returns the box of all vertices at all keys.
    pub(crate) fn validate(&self, mesh: usize) -> Result<Aabb, BuildError> {
        check_number_of_keys(mesh, self.keys.len())?;
        let vertices = self.keys.vertices(0);
        let mut swept = Aabb::EMPTY;
        for key in 0..self.keys.len() {
            let found = self.keys.vertices(key);
            if found != vertices {
                return Err(BuildError::KeyLength { mesh, key, expected: vertices, found });
            }
            let parts = parallel::parts(vertices, |of| self.validate_positions(mesh, key, of));
            for part in parts {
                swept = swept.union(part?);
            }
        }
        let parts = parallel::parts(self.indices.len(), |of| {
            let outside = |corners: &[u32; 3]| corners.iter().find(|&&i| i as usize >= vertices).copied();
            let first = of.start;
            let mut wrong = self.indices[of].iter().enumerate().filter_map(|(i, corners)| Some((i, outside(corners)?)));
            wrong.next().map(|(i, index)| BuildError::IndexOutOfRange { mesh, triangle: first + i, index, vertices })
        });
        match parts.flatten().next() {
            Some(error) => Err(error),
            None => Ok(swept),
        }
    }

    /// The number of keys that a tree keeps: all, or those that are needed.
    pub(in crate::primitive) fn kept_keys(&self, frame: Frame) -> usize {
        if self.keep_keys { self.keys.len() } else { self.needed_keys(frame) }
    }

    /// The number of keys after merging ([`super::merge_keys`]): of coordinates as given, or as stored if f64 is not kept.
    pub(in crate::primitive) fn needed_keys(&self, frame: Frame) -> usize {
        let (keys, vertices) = (self.keys.len(), self.keys.vertices(0));
        match &self.keys {
            Keys::F32(at) => kept_keys(keys, vertices, SINGLE, |key, of, out| {
                out.iter_mut().zip(as_coordinates(&at[key][of])).for_each(|(out, &x)| *out = x.into());
            }),
            Keys::F64(at) => kept_keys(keys, vertices, SINGLE, |key, of, out| {
                let stored = at[key][of].iter().map(|&p| frame.point(p).as_dvec3().to_array());
                out.as_chunks_mut().0.iter_mut().zip(stored).for_each(|(out, p)| *out = p);
            }),
            Keys::Precise(at) => kept_keys(keys, vertices, DOUBLE, |key, of, out| {
                out.as_chunks_mut().0.iter_mut().zip(&at[key][of]).for_each(|(out, p)| *out = p.to_array());
            }),
        }
    }

    /// The box of some vertices at one key, if they are valid.
    fn validate_positions(&self, mesh: usize, key: usize, of: Range<usize>) -> Result<Aabb, BuildError> {
        // For few of them the loop below is as fast.
        if of.len() >= LANES
            && let Keys::F32(keys) = &self.keys
            && let Some(swept) = box_of_fine(&keys[key][of.clone()])
        {
            return Ok(swept);
        }
        let mut swept = Aabb::EMPTY;
        for vertex in of {
            let p = self.valid_position(mesh, key, vertex)?;
            swept = Aabb { min: swept.min.min(p), max: swept.max.max(p) };
        }
        Ok(swept)
    }

    /// The position of a vertex at one key, if it is valid.
    pub(in crate::primitive) fn valid_position(
        &self,
        mesh: usize,
        key: usize,
        vertex: usize,
    ) -> Result<DVec3, BuildError> {
        let p = self.keys.position(key, vertex);
        if !p.is_finite() {
            return Err(BuildError::NonFinite { mesh, key, vertex });
        }
        if p.abs().max_element() > MAX_COORDINATE {
            return Err(BuildError::TooLarge { mesh, key, vertex });
        }
        Ok(p)
    }
}

/// How far a mesh reaches.
#[derive(Clone, Copy)]
pub(in crate::primitive) struct MeshExtent {
    /// The box of its triangles at all keys.
    pub swept: Aabb,
    /// Number of vertices.
    pub vertices: usize,
    /// Whether each of them is a corner of a triangle.
    pub all_used: bool,
}

/// The box of positions if all are valid; the caller finds out which one is not.
fn box_of_fine(positions: &[Vec3]) -> Option<Aabb> {
    let (whole, rest) = as_coordinates(positions).as_chunks();
    let (mut box_of, mut finite) = dispatch(SimdLevel::best(), BoxOf(whole));
    for &p in &positions[positions.len() - rest.len() / 3..] {
        box_of = box_of.include(p);
        finite &= p.is_finite();
    }
    let swept = Aabb { min: box_of.min.as_dvec3(), max: box_of.max.as_dvec3() };
    let fine = finite && swept.min.abs().max(swept.max.abs()).max_element() <= MAX_COORDINATE;
    (fine && !positions.is_empty()).then_some(swept)
}

/// The box of sixteen positions in each element, and whether all coordinates are finite.
struct BoxOf<'a>(&'a [[f32; 3 * LANES]]);

impl Kernel for BoxOf<'_> {
    type Output = (Box3, bool);

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> (Box3, bool) {
        let zero = s.splat(0.0);
        let (mut min, mut max, mut sum) = ([s.splat(f32::INFINITY); 3], [s.splat(f32::NEG_INFINITY); 3], [zero; 3]);
        for sixteen in self.0 {
            for i in 0..3 {
                let x = s.load(lanes_at(sixteen, LANES * i));
                (min[i], max[i]) = (s.min(x, min[i]), s.max(x, max[i]));
                // Stays zero unless a coordinate is not finite, which minima may miss.
                sum[i] = sum[i] + x * zero;
            }
        }
        let (mut box_of, mut finite) = (Box3::EMPTY, true);
        let [mut low, mut high] = [[0.0; 3 * LANES]; 2];
        for i in 0..3 {
            s.store(min[i], lanes_at_mut(&mut low, LANES * i));
            s.store(max[i], lanes_at_mut(&mut high, LANES * i));
            finite &= s.eq(sum[i], zero) == Mask::MAX;
        }
        for i in 0..LANES {
            box_of.min = box_of.min.min(Vec3::from_slice(&low[3 * i..]));
            box_of.max = box_of.max.max(Vec3::from_slice(&high[3 * i..]));
        }
        (box_of, finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn boxes_hold_all_positions_and_only_finite_ones() {
        let mut random = Random(9);
        for count in [1, 2, 15, 16, 17, 32, 100, 1000] {
            let mut positions: Vec<Vec3> = (0..count).map(|_| random.vec() * 1e3).collect();
            let expected = positions
                .iter()
                .fold(Aabb::EMPTY, |all, p| Aabb { min: all.min.min(p.as_dvec3()), max: all.max.max(p.as_dvec3()) });
            assert_eq!(box_of_fine(&positions), Some(expected), "{count} positions");
            for (i, bad) in
                (0..count).step_by(5).zip([f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2e30].into_iter().cycle())
            {
                let good = core::mem::replace(&mut positions[i][i % 3], bad);
                assert_eq!(box_of_fine(&positions), None, "{bad} at {i} of {count}");
                positions[i][i % 3] = good;
            }
        }
        assert_eq!(box_of_fine(&[]), None);
    }

    #[test]
    fn more_keys_than_f32_can_number_are_an_error() {
        // A mesh of so many keys would take a gigabyte.
        assert_eq!(check_number_of_keys(3, 1 << 24), Ok(()));
        let found = (1 << 24) + 1;
        assert_eq!(check_number_of_keys(3, found), Err(BuildError::TooManyKeys { mesh: 3, found }));
    }
}
