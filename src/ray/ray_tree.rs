//! The tree that answers ray queries: primitives and one layout over them.

use super::filter::{Offer, Visible};
use super::kernel::outline::Outline;
use super::layout::Layout;
use super::queries::{Batched, Target};
use super::traversal::batch::Task;
use super::{Hit, Indices, Ray, Space, answer_in_order};
use crate::error::BuildError;
use crate::geometry::Frame;
use crate::layout::{RefitPlan, Statistics, TreeBox, ValidationError};
use crate::parallel;
use crate::params::BuildParams;
use crate::primitive::{Primitive, PrimitiveSet, Scene, ShapeList, TriangleMesh, no_shapes};
use crate::progress::{Callback, Progress};
use crate::simd::SimdLevel;
use crate::tuning::wide::CACHED;
use core::ops::ControlFlow;

/// An acceleration structure over moving primitives, for ray queries and closest-point queries at any time of the shutter.
///
/// It is built once, over triangle meshes ([`RayTree::build`]), or over meshes, spheres and custom primitives
/// ([`RayTree::of_scene`]). Queries take `&self` and may run on any number of threads. Every answer equals that of testing all
/// primitives one by one ([`BruteForce`](crate::baseline::BruteForce)), bit for bit. It does not depend on the parameters of the
/// build.
///
/// ```
/// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
/// let open = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
/// let close = open.iter().map(|p| p + Vec3::Z).collect();
/// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
/// let ray = Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z).at_time(0.5);
/// let hit = tree.closest_hit(&ray).unwrap();
/// assert_eq!((hit.mesh, hit.primitive, hit.t), (0, 0, 4.5));
/// assert_eq!(tree.surface_normal(&ray, &hit), Vec3::Z);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
///
/// A clone is a tree of its own: it copies everything but spheres and custom primitives, which both trees share. So one of them may
/// be refitted for the next frame while the other still answers.
#[derive(Clone)]
pub struct RayTree {
    pub(super) scene: Scene,
    pub(super) layout: Layout,
    /// Which rays miss everything.
    pub(super) outline: Outline,
    pub(super) statistics: Statistics,
    /// Whether the tree was read from a file, which does not contain the triangles of the build.
    pub(super) from_file: bool,
    /// The refit plan; `None` before the first refit.
    pub(super) plan: Option<Box<RefitPlan>>,
    pub(super) simd: SimdLevel,
}

/// The mask of a batch and its filter, which gets the index of a hit's ray.
pub(super) type InBatch<'a> = Option<Visible<&'a (dyn Fn(usize, &Hit) -> bool + Sync)>>;

impl core::fmt::Debug for RayTree {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        // What is known without visiting the tree.
        let layout = match &self.layout {
            Layout::Wide(_) => "wide",
            Layout::Kd(_) => "k-d",
            Layout::Lazy(_) => "lazy",
        };
        let mut tree = f.debug_struct("RayTree");
        tree.field("primitives", &self.scene.len()).field("layout", &layout).finish_non_exhaustive()
    }
}

impl RayTree {
    /// The tree of a layout over its primitives.
    pub(super) fn assemble(scene: Scene, layout: Layout, statistics: Statistics, from_file: bool) -> RayTree {
        let (simd, outline) = (SimdLevel::best(), layout.outline(scene.frame()));
        RayTree { scene, layout, outline, statistics, from_file, plan: None, simd }
    }

    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.scene.len()
    }

    /// Whether there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The tree in the form that queries take.
    pub(super) fn target(&self) -> Target<'_> {
        Target { layout: &self.layout, scene: &self.scene, outline: Some(&self.outline), simd: self.simd }
    }

    /// The closest hit of a ray: the hit with the least `t`. Ties go to the lowest (mesh, primitive).
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let moved = corners.iter().map(|p| p + Vec3::Z).collect();
    /// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![corners, moved])], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
    /// assert_eq!([0.0, 0.5, 1.0].map(|time| tree.closest_hit(&ray.at_time(time)).unwrap().t), [1.0, 1.5, 2.0]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.target().closest(ray)
    }

    /// Whether the ray hits anything (occlusion). The search stops at the first hit found.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// // From a point towards a light, which is at t = 1.
    /// let shadow = |light: Vec3| Ray::new(Vec3::new(0.2, 0.2, -1.0), light).between(0.0, 1.0);
    /// assert_eq!([0.5, 2.0].map(|z| tree.any_hit(&shadow(Vec3::Z * z))), [false, true]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.target().any(ray)
    }

    /// [`RayTree::closest_hit`] of a ray that does not miss the [outline](RayTree::outline).
    pub(crate) fn closest_hit_inside(&self, ray: &Ray) -> Option<Hit> {
        Target { outline: None, ..self.target() }.closest(ray)
    }

    /// [`RayTree::any_hit`] of a ray that does not miss the [outline](RayTree::outline).
    pub(crate) fn any_hit_inside(&self, ray: &Ray) -> bool {
        Target { outline: None, ..self.target() }.any(ray)
    }

    /// Calls `visitor` with every primitive that the ray hits, until it breaks. Each primitive is reported once, with its
    /// closest hit, in no particular order. Returns the last return value of `visitor`.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::X + Vec3::Z, Vec3::Y + Vec3::Z];
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2], [3, 4, 5]], positions);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let mut hits = Vec::new();
    /// let _ = tree.all_hits(&Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z), |hit| {
    ///     hits.push(hit.t);
    ///     ControlFlow::Continue(())
    /// });
    /// hits.sort_by(f32::total_cmp);
    /// assert_eq!(hits, [1.0, 2.0]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn all_hits(&self, ray: &Ray, mut visitor: impl FnMut(Hit) -> ControlFlow<()>) -> ControlFlow<()> {
        self.target().all(ray, &mut visitor)
    }

    /// [`RayTree::closest_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order. If
    /// the caller reuses it, little else is allocated: a list of tasks, and a few megabytes if rays are sorted.
    ///
    /// In a wide tree, coherent rays, as from a camera, are traversed in streams, which is faster than one by one. For incoherent
    /// rays, a batch is also faster per thread than single queries if the tree is larger than the processor's caches: the rays are
    /// sorted by origin and direction, and several rays are traversed interleaved while memory is prefetched, if that
    /// pays. In other trees, and with SSE2, rays are traced one by one.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let ray = |x: f32| Ray::new(Vec3::new(x, 0.2, 1.0), Vec3::NEG_Z);
    /// let mut hits = Vec::new();
    /// tree.closest_hits(&[ray(0.2), ray(5.0)], &mut hits);
    /// assert_eq!(hits.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn closest_hits(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.closest_batch(rays, None, hits);
    }

    /// [`RayTree::any_hit`] for many rays, in parallel. `hits` is cleared and gets one answer per ray, in order. In a wide tree
    /// all rays are traversed in streams (with SSE2 one by one), which is faster if rays that begin near each other come one after
    /// the other.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let rays = [0.2, 5.0].map(|x| Ray::new(Vec3::new(x, 0.2, 1.0), Vec3::NEG_Z));
    /// let mut hits = Vec::new();
    /// tree.any_hits(&rays, &mut hits);
    /// assert_eq!(hits, [true, false]);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn any_hits(&self, rays: &[Ray], hits: &mut Vec<bool>) {
        self.any_batch(rays, None, hits);
    }

    /// The closest hits that pass the mask and the filter.
    pub(super) fn closest_batch(&self, rays: &[Ray], visible: InBatch<'_>, hits: &mut Vec<Option<Hit>>) {
        let incoherent = if self.interleaving_pays() { Target::closest_interleaved } else { Target::closest_singly };
        self.batch(rays, visible, hits, [Target::closest_in_streams, incoherent]);
    }

    /// Whether there are hits that pass the mask and the filter.
    pub(super) fn any_batch(&self, rays: &[Ray], visible: InBatch<'_>, hits: &mut Vec<bool>) {
        self.batch(rays, visible, hits, [Target::any_in_streams; 2]);
    }

    /// Interleaving pays for the closest hit in trees that move, are larger than the caches and have a temporal split (measured;
    /// see docs/notes_rays.md).
    fn interleaving_pays(&self) -> bool {
        let large = self.statistics.bytes > CACHED;
        matches!(&self.layout, Layout::Wide(tree) if large && tree.moves() && tree.time_slices() > 1)
    }

    /// Answers a batch: rays of similar direction by `together`, others by `incoherent`.
    fn batch<'a, R: Copy + Default + Send>(
        &'a self,
        rays: &[Ray],
        visible: InBatch<'_>,
        answers: &mut Vec<R>,
        [together, incoherent]: [Batched<'a, R>; 2],
    ) {
        answers.clear();
        answers.resize(rays.len(), R::default());
        let space = match &self.layout {
            Layout::Wide(tree) => {
                let cached = self.statistics.bytes <= CACHED;
                Space::new(self.scene.frame().bounds, tree.time_slices(), cached)
            }
            // These trees are queried ray by ray, in the caller's order.
            Layout::Kd(_) | Layout::Lazy(_) => Space::new(self.scene.frame().bounds, 1, true),
        };
        let fill = |coherent: bool, indices: Indices<'_>, rays: &[Ray], answers: &mut [R]| {
            let by = if coherent { together } else { incoherent };
            match visible {
                None => by(self.target(), Task { rays, answers, visible: None }),
                Some(Visible { mask, accept: None }) => {
                    by(self.target(), Task { rays, answers, visible: Some(Visible { mask, accept: None }) });
                }
                Some(Visible { mask, accept: Some(accept) }) => {
                    let accept = |&(i, ref hit): &Offer| accept(indices.of(i), hit);
                    by(self.target(), Task { rays, answers, visible: Some(Visible { mask, accept: Some(&accept) }) });
                }
            }
        };
        answer_in_order(rays, answers, space, fill);
    }

    /// Checks the structure of the tree: links, depth, and coverage. This is for tests, and takes far longer than the build.
    ///
    /// - In the k-d layout, each primitive must be found in every cell that it reaches, at sampled times. These include
    ///   every time at which an interval of a reference begins or ends.
    /// - In the wide layout, each primitive must be in some leaf block. At nine times, the boxes above must hold the corners
    ///   of each triangle that was not split.
    /// - In a lazy tree, the coarse tree and the subtrees built so far are checked. No subtree is built.
    ///
    /// # Errors
    /// The first violation found, which is a defect of this crate.
    pub fn validate(&self) -> Result<(), ValidationError> {
        match &self.layout {
            Layout::Kd(tree) => tree.validate(&self.scene),
            Layout::Wide(tree) => tree.validate(&self.scene),
            Layout::Lazy(tree) => tree.validate(&self.scene),
        }
    }

    /// Calls `visitor` with the boxes of all nodes and leaf blocks at a time of the shutter, parents before children. This
    /// serves to draw a tree, or to find out why it is slow. The boxes are as wide as those of queries, up to a few
    /// roundings. `visitor` is never called for the k-d policies, whose nodes have no boxes, nor for a time outside
    /// [0, 1]. The time is proportional to the size of the tree.
    ///
    /// ```
    /// use mbkd::{BuildParams, RayTree, TriangleMesh, glam::Vec3};
    /// // A thousand triangles in a row.
    /// let positions = (0..1000).flat_map(|i| [Vec3::ZERO, Vec3::Y, Vec3::Z].map(|p| p + Vec3::X * i as f32)).collect();
    /// let mesh = TriangleMesh::fixed((0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let mut leaves = 0;
    /// tree.boxes(0.5, |b| leaves += usize::from(b.leaf));
    /// assert!(leaves > 1000 / 16);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn boxes(&self, time: f32, mut visitor: impl FnMut(TreeBox)) {
        if !(0.0..=1.0).contains(&time) {
            return;
        }
        match &self.layout {
            Layout::Wide(tree) => tree.boxes(time, *self.scene.frame(), 1, &mut |b, _| visitor(b)),
            Layout::Lazy(tree) => tree.boxes(time, *self.scene.frame(), &mut visitor),
            Layout::Kd(_) => {}
        }
    }

    /// Which rays miss everything.
    pub(crate) fn outline(&self) -> &Outline {
        &self.outline
    }

    /// The map between world and tree space.
    pub(crate) fn frame(&self) -> &Frame {
        self.scene.frame()
    }

    /// Selects another instruction set of this CPU for queries, for tests and measurements. Answers do not change. The
    /// default is the widest instruction set available.
    pub fn with_simd(self, simd: SimdLevel) -> RayTree {
        RayTree { simd, ..self }
    }

    /// The sizes and counts of the tree. For a lazy tree, they cover the coarse tree and the subtrees built so far; this
    /// call visits every subtree, and all leaf blocks of a tree with temporal splits of what exists for a part of the shutter.
    pub fn statistics(&self) -> Statistics {
        match &self.layout {
            Layout::Lazy(tree) => tree.statistics(&self.scene),
            Layout::Wide(tree) => Statistics { left_out: tree.left_out(&self.scene), ..self.statistics },
            Layout::Kd(_) => self.statistics,
        }
    }
}

impl RayTree {
    /// Builds a tree of triangle meshes.
    ///
    /// *Time*: O(n log n) for `n` triangles. The build runs in parallel with the feature `rayon`, and the tree is the same
    /// for any number of threads.
    ///
    /// *Memory*: the default build holds several hundred bytes per triangle at its peak, the finished tree included.
    /// [`WideParams::bytes_per_primitive`](crate::WideParams::bytes_per_primitive) bounds the tree, and
    /// docs/measurements_rays.md has measured sizes.
    ///
    /// # Errors
    /// A [`BuildError`] that names the invalid mesh or parameter. An empty tree is valid, and no ray hits anything.
    /// Degenerate triangles are kept. Those with two equal corners are never hit; others only by rays that meet their line.
    pub fn build(meshes: &[TriangleMesh], params: &BuildParams) -> Result<RayTree, BuildError> {
        of_scene(meshes, no_shapes(), params, None)
    }

    /// Builds a tree of triangle meshes and shapes: spheres, custom primitives, or several types of them as
    /// [`Shape`](crate::Shape)s. A [`Hit`] on one of `shapes` has the number of meshes as its [`mesh`](Hit::mesh), and the index
    /// into `shapes` as its [`primitive`](Hit::primitive). Without shapes, this is [`RayTree::build`].
    ///
    /// Triangles and shapes are in separate subtrees below common nodes. A list of one custom type is traversed faster than one of
    /// `Shape`s, whose custom primitives are scattered over memory.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, MovingSphere, Ray, RayTree, TriangleMesh};
    /// let floor = vec![Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)];
    /// let floor = TriangleMesh::fixed(vec![[0, 1, 2]], floor);
    /// // A ball that rolls by.
    /// let ball = MovingSphere::new(vec![(DVec3::new(-2.0, 0.0, 1.0), 1.0), (DVec3::new(2.0, 0.0, 1.0), 1.0)]);
    /// let tree = RayTree::of_scene(&[floor], vec![ball], &BuildParams::default())?;
    /// let down = Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z);
    /// let what = |time| tree.closest_hit(&down.at_time(time)).map(|hit| (hit.mesh, hit.primitive, hit.t));
    /// assert_eq!(what(0.0), Some((0, 0, 5.0))); // the floor
    /// assert_eq!(what(0.5), Some((1, 0, 3.0))); // the ball
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::build`]; [`BuildError::BadBounds`] for a shape whose bounds are not finite.
    pub fn of_scene<P: Primitive + 'static>(
        meshes: &[TriangleMesh],
        shapes: Vec<P>,
        params: &BuildParams,
    ) -> Result<RayTree, BuildError> {
        of_scene(meshes, Box::new(shapes), params, None)
    }

    /// [`RayTree::build`] that calls `progress` from time to time with the finished fraction (above 0, and at the end 1), from any
    /// of its threads. `Break` cancels the build, which then returns [`BuildError::Cancelled`].
    ///
    /// Fractions increase by a tenth of a percent at least, mostly by little more, and 1 comes last. They are about proportional to
    /// time, as far as it is known what follows: a moving scene may turn out to need time slices, and a tree that exceeds its
    /// budget is built again within what is left. One thread calls at a time. After `Break` there is no further call, and the build
    /// ends within a few percent of its time.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{BuildError, BuildParams, RayTree, TriangleMesh, glam::Vec3};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let stop = |_: f32| ControlFlow::Break(());
    /// let tree = RayTree::build_with_progress(&[mesh], &BuildParams::default(), &stop);
    /// assert_eq!(tree.unwrap_err(), BuildError::Cancelled);
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::build`]; [`BuildError::Cancelled`] if `progress` broke.
    pub fn build_with_progress(
        meshes: &[TriangleMesh],
        params: &BuildParams,
        progress: Callback<'_>,
    ) -> Result<RayTree, BuildError> {
        of_scene(meshes, no_shapes(), params, Some(progress))
    }

    /// [`RayTree::of_scene`] that calls `progress` as [`RayTree::build_with_progress`] does.
    ///
    /// # Errors
    /// As [`RayTree::of_scene`]; [`BuildError::Cancelled`] if `progress` broke.
    pub fn of_scene_with_progress<P: Primitive + 'static>(
        meshes: &[TriangleMesh],
        shapes: Vec<P>,
        params: &BuildParams,
        progress: Callback<'_>,
    ) -> Result<RayTree, BuildError> {
        of_scene(meshes, Box::new(shapes), params, Some(progress))
    }
}

/// The share of reading the input in a build, about.
const READING: f64 = 0.05;

/// A tree of a scene, on one thread if it is small.
fn of_scene(
    meshes: &[TriangleMesh],
    shapes: Box<dyn ShapeList>,
    params: &BuildParams,
    progress: Option<Callback<'_>>,
) -> Result<RayTree, BuildError> {
    params.validate()?;
    let primitives = shapes.count() + meshes.iter().map(TriangleMesh::len).sum::<usize>();
    parallel::entered(primitives, || {
        let progress = Progress::new(progress);
        let mut scene = Scene::read(meshes, shapes, &progress.subtask(READING))?;
        let (layout, statistics) = Layout::build(&mut scene, params, &progress.rest(1.0))?;
        scene.input_error()?;
        if progress.complete() {
            return Err(BuildError::Cancelled);
        }
        Ok(RayTree::assemble(scene, layout, statistics, false))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use glam::Vec3;

    /// Interleaving and streams are tested here directly: a batch uses at most one of them.
    #[test]
    fn interleaved_rays_and_streams_get_the_answers_of_single_rays() {
        let nothing = RayTree::build(&[], &BuildParams::default()).expect("an empty tree");
        let hall = scene::find("hall").expect("a scene of the catalogue");
        check_batches(nothing, &(hall.make)(10).camera);
        for (name, triangles, divided) in [("hall", 4000, false), ("building", 3000, false), ("tornado", 6000, true)] {
            let made = (scene::find(name).expect("a scene of the catalogue").make)(triangles);
            let tree = RayTree::build(&made.meshes, &BuildParams::default()).expect("a tree");
            let Layout::Wide(wide) = &tree.layout else { panic!("the default is wide") };
            assert_eq!(wide.time_slices() > 1, divided, "{name}");
            check_batches(tree, &made.camera);
        }
    }

    fn check_batches(mut tree: RayTree, camera: &scene::Camera) {
        for level in SimdLevel::available() {
            tree = tree.with_simd(level);
            // Fewer rays than a group, just as many, and more; some of them are invalid, some begin behind their
            // origin.
            for count in [0, 1, 2, 3, 7, 8, 9, 31, 32, 33, 700] {
                let rays: Vec<Ray> = (0..count)
                    .map(|i| {
                        let at = |by: usize| (i * by % 97) as f32 / 97.0;
                        // First at random positions in the picture, then side by side, the last ones at nearly one
                        // time.
                        let (x, y) = if i < 200 { (at(31), at(57)) } else { (i as f32 / 700.0, 0.4 + 0.01 * at(57)) };
                        let ray = camera.ray(x, y, 1.0, if i < 450 { at(13) } else { 0.3 + 0.001 * at(13) });
                        match i % 30 {
                            3 => Ray { dir: Vec3::NAN, ..ray },
                            7 => ray.between(-10.0, f32::INFINITY),
                            11 => Ray { dir: Vec3::Z, ..ray },
                            _ => ray,
                        }
                    })
                    .collect();
                let rays = &rays[..];
                let accept = |&(i, hit): &Offer| !(i + hit.primitive as usize).is_multiple_of(3);
                for visible in [None, Some(Visible { mask: 1, accept: Some(&accept as _) })] {
                    let (mut hits, mut of_streams, mut shadows) =
                        (vec![None; count], vec![None; count], vec![false; count]);
                    tree.target().closest_interleaved(Task { rays, answers: &mut hits, visible });
                    tree.target().closest_in_streams(Task { rays, answers: &mut of_streams, visible });
                    tree.target().any_in_streams(Task { rays, answers: &mut shadows, visible });
                    for (i, ray) in rays.iter().enumerate() {
                        let hit = match visible {
                            None => tree.closest_hit(ray),
                            Some(_) => tree.closest_hit_filtered(ray, 1, |&hit| accept(&(i, hit))),
                        };
                        assert_eq!((hits[i], of_streams[i]), (hit, hit), "{level}, {count} rays, ray {i}");
                        assert_eq!(shadows[i], hit.is_some(), "{level}, {count} rays, ray {i}");
                    }
                }
            }
        }
    }
}
