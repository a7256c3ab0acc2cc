//! Refitting: the same tree over primitives at other positions, as in the next frame of an animation.

use super::RayTree;
use super::layout::Layout;
use crate::error::RefitError;
use crate::geometry::TimeInterval;
use crate::layout::{BuiltPlace, Moved, WideSource};
use crate::parallel;
use crate::primitive::{OtherShapes, Primitive, PrimitiveSet, Scene, ShapeList, TriangleMesh};

/// The result of a refit ([`RayTree::refit`]): the work done, and the quality of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refit {
    /// Nodes whose boxes were rewritten.
    pub nodes: usize,
    /// Leaf blocks in which a primitive changed.
    pub leaves: usize,
    /// Blocks that were visited and did not change.
    pub kept: usize,
    /// Blocks that were not visited.
    pub skipped: usize,
    /// Expected cost of a ray that hits the root box, relative to that when the tree was built: the sum over nodes and leaf blocks
    /// of cost times area, as in the surface area heuristic. The time per ray grows about as much. If the root box has grown since
    /// the build, it is the larger of that and the cost of a ray that hits the box that it had then: so that what flies off does
    /// not hide that rays in the rest take longer. A new tree may gain where this is 1: if the pose of the frame makes any tree
    /// cheaper than the pose that was built, as when a figure spreads its limbs.
    pub cost: f64,
}

impl Refit {
    /// Whether a rebuild is recommended: [`cost`](Refit::cost) is above [`Refit::WORN`].
    pub fn is_worn(&self) -> bool {
        self.cost > Refit::WORN
    }

    /// The relative cost above which a rebuild pays if the rays of a frame take twice as long as a build.
    ///
    /// A new tree saves `cost - 1` times the rays' time in the next frame; if that is more than the time of a build,
    /// one frame pays for it. A caller that knows both times does better by adding the losses up: rebuild when the sum
    /// of `cost - 1` over the frames since the last build, times the time of a frame's rays, exceeds the time of a
    /// build. For any motion that takes at most twice as long as the best choice in hindsight (the ski rental problem:
    /// buy the skis when the rents have added up to their price).
    pub const WORN: f64 = 1.5;
}

/// Which queries see what: the masks of a scene and, unless everything exists throughout the shutter, its active intervals.
fn seen(scene: &Scene) -> (Vec<u32>, Vec<TimeInterval>) {
    (scene.masks(), if scene.always_active() { Vec::new() } else { scene.active_intervals() })
}

impl RayTree {
    /// Refits the tree to another scene with the same primitives.
    fn refit_to(&mut self, scene: Scene, moved: Moved) -> Result<Refit, RefitError> {
        // If the tree space changed, all coordinates did.
        let moved = if self.scene.frame().maps_as(scene.frame()) { moved } else { Moved::All };
        let seen_differ = seen(&self.scene) != seen(&scene);
        let bounds = if self.plan.is_none() { self.linear_bounds() } else { None };
        let first = bounds.map(|bounds| BuiltPlace::new(&bounds));
        self.scene = scene;
        self.rewrite(&moved, seen_differ, first)
    }

    /// Rewrites the tree for a scene that has changed; `place` is where the tree was if this is its first refit.
    fn rewrite(&mut self, moved: &Moved, seen_differ: bool, place: Option<BuiltPlace>) -> Result<Refit, RefitError> {
        let Layout::Wide(tree) = &mut self.layout else { return Err(RefitError::Policy) };
        let (done, of_root) = tree.refit(&self.scene, moved, &mut self.plan);
        if seen_differ {
            tree.summarize_blocks(&self.scene);
        }
        self.scene.release_build_data();
        let blocks = tree.counts.nodes + tree.counts.leaves;
        let cost = of_root.max(self.cost_in_place(place));
        self.outline = self.layout.outline(self.scene.frame());
        self.statistics.cost = cost;
        self.scene.input_error()?;
        let (nodes, leaves) = (done.nodes, done.leaves);
        Ok(Refit { nodes, leaves, kept: done.visited - nodes - leaves, skipped: blocks - done.visited, cost })
    }

    /// The relative cost of rays that meet the box that the root had when the tree was built, if it has grown; 0 otherwise.
    fn cost_in_place(&mut self, first: Option<BuiltPlace>) -> f64 {
        let (Layout::Wide(tree), Some(plan)) = (&self.layout, &mut self.plan) else { return 0.0 };
        plan.place = plan.place.or(first);
        let frame = self.scene.frame();
        let (Some(place), Some(bounds)) = (plan.place, tree.linear_bounds(frame)) else { return 0.0 };
        if !place.is_outgrown(&bounds) {
            return 0.0;
        }
        let built = place.cost(plan.built);
        if built > 0.0 { tree.cost_within(frame.outward(place.bounds())) / built } else { 0.0 }
    }

    /// An error if the tree left out one of so many meshes, or of the shapes behind them, with these active intervals at some of
    /// their times.
    fn existed_before(&self, meshes: usize, active: impl Iterator<Item = TimeInterval>) -> Result<(), RefitError> {
        let Layout::Wide(tree) = &self.layout else { return Ok(()) };
        match tree.first_lacking(active) {
            Some(mesh) if mesh < meshes => Err(RefitError::Active { mesh }),
            Some(index) => Err(RefitError::ActiveShape { shape: index - meshes }),
            None => Ok(()),
        }
    }

    fn can_be_refitted(&self) -> Result<(), RefitError> {
        match self.layout {
            Layout::Kd(_) => Err(RefitError::Policy),
            Layout::Lazy(_) => Err(RefitError::Lazy),
            Layout::Wide(_) if self.from_file => Err(RefitError::FromFile),
            Layout::Wide(_) => Ok(()),
        }
    }
}

impl RayTree {
    /// Moves the vertices of the meshes to other positions, for the next frame of an animation. This takes a part of the
    /// time of a new build. Every answer then equals that of brute force over these meshes, bit for bit.
    ///
    /// The meshes must have the triangles that the tree was built of; positions, [`active`](TriangleMesh::active) and
    /// [`mask`](TriangleMesh::mask) may differ, and so may the number of keys, as long as the number of keys after merging
    /// redundant ones is the same; [`TriangleMesh::keep_keys`] keeps these where another frame needs them. Shapes beside the meshes
    /// stay as they are. A tree with temporal splits may have left out what did not exist in a time slice when it was built, and
    /// any tree leaves out the keys of a mesh or sphere with more than two at times when it did not exist; then active intervals
    /// may become shorter, but no longer than they were.
    ///
    /// The tree keeps its structure, which groups primitives that were near each other when it was built. So rays
    /// become slower as the motion goes on, and [`Refit::cost`] estimates by how much. If nothing moved, the tree does
    /// not change. Triangles that were split into several references before the build stay split.
    ///
    /// Takes O(n) time, in parallel with the feature `rayon`, with the same result for any number of threads. The first
    /// refit takes a few times as long, since it indexes the tree (docs/measurements_rays.md).
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(-1.0, -1.0, z), Vec3::new(1.0, -1.0, z), Vec3::new(0.0, 1.0, z)];
    /// let moving = |from: f32, to: f32| TriangleMesh::new(vec![[0, 1, 2]], vec![at(from), at(to)]);
    /// let mut tree = RayTree::build(&[moving(0.0, 1.0)], &BuildParams::default())?;
    /// let down = Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z).at_time(0.5);
    /// assert_eq!(tree.closest_hit(&down).unwrap().t, 8.5);
    /// let refit = tree.refit(&[moving(1.0, 3.0)]).unwrap();
    /// assert_eq!(tree.closest_hit(&down).unwrap().t, 7.0);
    /// assert!(!refit.is_worn());
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    ///
    /// # Errors
    /// [`RefitError`] if this tree cannot hold the meshes; it is then unchanged. (Except that if one of the custom
    /// primitives returns bad bounds over a part of the shutter, the tree has the new positions, and treats that shape as
    /// unbounded.)
    pub fn refit(&mut self, meshes: &[TriangleMesh]) -> Result<Refit, RefitError> {
        self.refit_scene(meshes, None, Moved::All)
    }

    /// [`RayTree::refit`] where only the meshes with these indices differ from the last time; this is not checked. All
    /// meshes must be there and valid.
    ///
    /// From the second refit of a tree on, it takes the time that these meshes take: subtrees without them are not visited, and of
    /// the other meshes only the triangles are read that share a leaf block with one that moved. If tree space changes, everything
    /// is read and rewritten: where the extent of the scene passes a power of two, or moves while it is far from zero.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let at = |z: f32| vec![Vec3::new(-1.0, -1.0, z), Vec3::new(1.0, -1.0, z), Vec3::new(0.0, 1.0, z)];
    /// let mut meshes = [TriangleMesh::fixed(vec![[0, 1, 2]], at(0.0)), TriangleMesh::fixed(vec![[0, 1, 2]], at(1.0))];
    /// let mut tree = RayTree::build(&meshes, &BuildParams::default())?;
    /// meshes[1] = TriangleMesh::fixed(vec![[0, 1, 2]], at(0.5));
    /// tree.refit_moved(&meshes, &[1]).unwrap();
    /// assert_eq!(tree.closest_hit(&Ray::new(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z)).unwrap().t, 1.5);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::refit`]; [`RefitError::NoMesh`] for an index beyond the meshes.
    pub fn refit_moved(&mut self, meshes: &[TriangleMesh], moved: &[usize]) -> Result<Refit, RefitError> {
        self.refit_scene(meshes, None, Moved::Some(moved_flags(meshes, moved, false)?))
    }

    /// [`RayTree::refit_with_shapes`] where of the meshes only those with these indices differ from the last time, as for
    /// [`RayTree::refit_moved`]; any of the shapes may. All meshes are read, and only the parts of the tree are rewritten that hold
    /// these meshes or shapes.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, MovingSphere, Ray, RayTree, TriangleMesh};
    /// let floor = [TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::NEG_ONE, Vec3::X, Vec3::Y])];
    /// let ball = |z: f64| vec![MovingSphere::fixed(DVec3::new(0.0, 0.0, z), 1.0)];
    /// let mut tree = RayTree::of_scene(&floor, ball(2.0), &BuildParams::default())?;
    /// tree.refit_moved_with_shapes(&floor, &[], ball(3.0)).unwrap();
    /// assert_eq!(tree.closest_hit(&Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z)).unwrap().t, 5.0);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::refit_moved`] and [`RayTree::refit_with_shapes`].
    pub fn refit_moved_with_shapes<P: Primitive + 'static>(
        &mut self,
        meshes: &[TriangleMesh],
        moved: &[usize],
        shapes: Vec<P>,
    ) -> Result<Refit, RefitError> {
        self.refit_scene(meshes, Some(Box::new(shapes)), Moved::Some(moved_flags(meshes, moved, true)?))
    }

    /// [`RayTree::refit`] of a tree with spheres and custom primitives, as many as before ([`RayTree::of_scene`]). After an error,
    /// `shapes` are dropped: a caller that goes on needs what they were made of.
    ///
    /// Spheres may have other keys. If some need keys that their leaf block does not have ([`Primitive::merge_keys`]), those of the
    /// block are tested one by one from then on, which is slower; a new build tests them together again.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, MovingSphere, Ray, RayTree};
    /// let ball = |z: f64| vec![MovingSphere::fixed(DVec3::new(0.0, 0.0, z), 1.0)];
    /// let mut tree = RayTree::of_scene(&[], ball(0.0), &BuildParams::default())?;
    /// tree.refit_with_shapes(&[], ball(3.0)).unwrap();
    /// assert_eq!(tree.closest_hit(&Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z)).unwrap().t, 5.0);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RayTree::refit`]; [`RefitError::Shapes`] for another number of shapes.
    pub fn refit_with_shapes<P: Primitive + 'static>(
        &mut self,
        meshes: &[TriangleMesh],
        shapes: Vec<P>,
    ) -> Result<Refit, RefitError> {
        self.refit_scene(meshes, Some(Box::new(shapes)), Moved::All)
    }

    fn refit_scene(
        &mut self,
        meshes: &[TriangleMesh],
        shapes: Option<Box<dyn ShapeList>>,
        moved: Moved,
    ) -> Result<Refit, RefitError> {
        self.can_be_refitted()?;
        parallel::entered(self.scene.len(), || {
            let shapes = shapes.map(|shapes| self.scene.other_shapes(shapes)).transpose()?;
            // With another number of meshes there is another error.
            if meshes.len() == self.scene.triangles.mesh_count() {
                let of_shapes = shapes.iter().flat_map(OtherShapes::active);
                self.existed_before(meshes.len(), meshes.iter().map(|mesh| mesh.active).chain(of_shapes))?;
            }
            // Other shapes have to be put among the primitives, which takes all meshes.
            if shapes.is_none()
                && let Some(refit) = self.refit_some(meshes, &moved)?
            {
                return Ok(refit);
            }
            let scene = self.scene.again(meshes, shapes)?;
            self.refit_to(scene, moved)
        })
    }

    /// Refits a tree of which only some meshes moved, without reading the others; `None` if all have to be read.
    fn refit_some(&mut self, meshes: &[TriangleMesh], moved: &Moved) -> Result<Option<Refit>, RefitError> {
        let (Layout::Wide(tree), Some(plan), Moved::Some(flags)) = (&self.layout, &self.plan, moved) else {
            return Ok(None);
        };
        // With another number of meshes there is an error.
        if meshes.len() != self.scene.triangles.mesh_count() {
            return Ok(None);
        }
        let of_moved: usize = meshes.iter().zip(flags).filter(|&(_, &moved)| moved).map(|(mesh, _)| mesh.len()).sum();
        // If most vertices are needed, it is faster to read all.
        let Some(most) = (self.scene.len() / 2).checked_sub(of_moved) else { return Ok(None) };
        let Some(beside) = tree.beside(&self.scene, flags, plan, most) else { return Ok(None) };
        let before = seen(&self.scene);
        if !self.scene.move_meshes(meshes, flags, &beside)? {
            return Ok(None);
        }
        let seen_differ = before != seen(&self.scene);
        self.rewrite(moved, seen_differ, None).map(Some)
    }
}

/// Whether each mesh is named as moved, and after them whether shapes move.
fn moved_flags(meshes: &[TriangleMesh], moved: &[usize], shapes: bool) -> Result<Vec<bool>, RefitError> {
    let mut flags = vec![false; meshes.len()];
    for &mesh in moved {
        *flags.get_mut(mesh).ok_or(RefitError::NoMesh { mesh, meshes: meshes.len() })? = true;
    }
    flags.push(shapes);
    Ok(flags)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{BuildParams, Division, WideParams};
    use crate::primitive::Keys;
    use crate::random::Random;
    use crate::scene;
    use glam::Vec3;

    /// One frame of the hall with a running figure; some of its triangles are split before the build.
    fn hall(frame: usize) -> Vec<TriangleMesh> {
        scene::walking_from(9000, 3, 0.5 * frame as f32).meshes
    }

    /// All vertices displaced.
    fn shaken(meshes: &[TriangleMesh], by: f32) -> Vec<TriangleMesh> {
        let mut random = Random(5);
        let mut shake = |p: &Vec3| *p + random.vec() * by;
        let mesh = |mesh: &TriangleMesh| {
            let Keys::F32(keys) = &mesh.keys else { panic!("f32") };
            let keys: Vec<Vec<Vec3>> = keys.iter().map(|key| key.iter().map(&mut shake).collect()).collect();
            TriangleMesh { keys: keys.into(), ..mesh.clone() }
        };
        meshes.iter().map(mesh).collect()
    }

    fn build(meshes: &[TriangleMesh], division: Division, max_references: f32) -> RayTree {
        let params = BuildParams::wide(WideParams { division, max_references, ..WideParams::default() });
        RayTree::build(meshes, &params).expect("a tree")
    }

    fn words(tree: &RayTree) -> &[u32] {
        match &tree.layout {
            Layout::Wide(tree) => tree.arena.ints(),
            Layout::Kd(_) | Layout::Lazy(_) => &[],
        }
    }

    #[test]
    fn refitting_there_and_back_restores_every_word_of_the_build() {
        let first = hall(0);
        let mut tree = build(&first, Division::Whole, 1.0);
        let before = words(&tree).to_vec();
        let refit = tree.refit(&shaken(&first, 0.01)).expect("the same triangles");
        assert!(refit.kept == 0 && refit.skipped == 0 && words(&tree) != before, "{refit:?}");
        tree.refit(&first).expect("the same triangles");
        assert!(words(&tree) == before);
        assert_eq!(tree.refit(&first).map(|refit| (refit.nodes, refit.leaves)), Ok((0, 0)));
    }

    #[test]
    fn results_do_not_depend_on_threads_or_on_the_meshes_named_as_moved() {
        for (division, most) in
            [(Division::Automatic, 1.5), (Division::SharedLeaves(3), 1.5), (Division::SeparateTrees(2), 1.0)]
        {
            let first = hall(0);
            let figure = [first.len() - 2, first.len() - 1];
            let mut trees: Vec<RayTree> = (0..4).map(|_| build(&first, division, most)).collect();
            for frame in 1..4 {
                let now = hall(frame);
                let mut refits = Vec::new();
                for (tree, threads) in trees.iter_mut().zip([1, 2, 5, 2]) {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                    let told = refits.len() == 3;
                    let refit = pool.install(|| if told { tree.refit_moved(&now, &figure) } else { tree.refit(&now) });
                    refits.push(refit.expect("the same triangles"));
                }
                assert!(trees.iter().all(|tree| words(tree) == words(&trees[0])), "{division:?}, frame {frame}");
                assert!(refits[1] == refits[0] && refits[2] == refits[0] && refits[3].cost == refits[0].cost);
                assert!(refits[0].skipped == 0 && refits[3].skipped > 0, "{refits:?}");
            }
        }
    }
}
