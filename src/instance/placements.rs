//! Instances as the build of the wide tree sees them: a set of boxes, one per leaf.

use super::bounds::{ROUNDING, greatest_offset, grow};
use super::distortion::{Distortion, MAPPED, MAX_DEVIATION};
use super::error::{InstanceError, MAX_PLACED};
use super::extent::Extent;
use super::motion::{Motion, Motions};
use crate::geometry::{Aabb, Frame, LinearBounds, LinearBox3, TimeInterval, ULP};
use crate::layout::WideSource;
use crate::parallel;
use crate::primitive::PrimitiveSet;
use crate::ray::{INNER_ULPS, Outline, TreeRay};
use glam::DVec3;

/// The data of an instance that queries use, in two cache lines.
#[derive(Clone)]
#[repr(align(64))]
pub(super) struct Placed {
    pub motion: Motion,
    pub active: TimeInterval,
    pub mask: u32,
    /// Index of its tree among the distinct trees.
    pub tree: u32,
}

/// How far hits of an instance may lie outside of its box, beyond `per_distance` ULP of the distance to the ray's
/// origin.
#[derive(Clone, Copy)]
struct Slack {
    per_distance: f64,
    fixed: DVec3,
    /// How far the image of a point is off, relative to the size of the numbers that make it.
    rounding: f64,
}

/// All instances of a tree.
#[derive(Clone)]
pub(super) struct Placements {
    pub placed: Vec<Placed>,
    pub motions: Motions,
    /// The outlines of the distinct trees.
    pub outlines: Vec<Outline>,
    frame: Frame,
    always_active: bool,
    /// The greatest [`Slack::per_distance`].
    pub deviation: f64,
    /// Instances that are a point at all times, or of nothing, ascending.
    hidden: Vec<u32>,
    /// Data for the build only: the distinct trees, and for each instance its slack, its bounds over the shutter without padding,
    /// and their padding for rays that are not far away.
    extents: Vec<Extent>,
    slacks: Vec<Slack>,
    whole: Vec<LinearBounds>,
    paddings: Vec<DVec3>,
    /// The greatest coordinate in tree space of the origin of a ray that is not [far](Placements::is_far) away.
    near: f64,
}

/// Distances within which origins count as near, at most, in sizes of the scene.
const NEAR: f64 = 3.0;

/// The least padding for distances that counts as large, in sizes of an instance. Rays from where more than a sixteenth of all
/// instances need more are far away. Else boxes would be useless for small instances near each other, in a scene that is a million
/// times as large.
const LARGE: f64 = 1.0 / 16.0;

/// Rays that begin farther away than this, in sizes of the scene, hit nothing: 2^96. Their slack might not be finite.
///
/// A placed tree reports no hits of origins farther away than 2^32 times its reach. Boxes are padded by more than 2^-14 of the
/// image of that reach ([`Slack::fixed`]), so the scene is at least that large, and what is hit is nearer than 2^47 sizes of it.
/// With each further level of instances it may be 2^14 times as far away: less than 2^90.
const FARTHEST: f64 = (1u128 << 96) as f64;

impl Placements {
    /// Takes instances of trees with these extents, each with its motion's [`Distortion`], or none if it is hidden. `padding`
    /// scales the padding of boxes and rays for rounding: 1, or less in tests.
    pub fn new(
        placed: Vec<(Placed, Option<Distortion>)>,
        motions: Motions,
        extents: Vec<Extent>,
        padding: f64,
    ) -> Result<Placements, InstanceError> {
        let (mut slacks, mut deviation, mut all) =
            (Vec::with_capacity(placed.len()), 0.0f64, Vec::with_capacity(placed.len()));
        let (mut hidden, mut always_active) = (Vec::new(), true);
        for (instance, (one, distortion)) in placed.into_iter().enumerate() {
            let Some(distortion) = distortion.filter(|_| !extents[one.tree as usize].subtrees.is_empty()) else {
                hidden.push(instance as u32);
                slacks.push(Slack { per_distance: 0.0, fixed: DVec3::ZERO, rounding: ROUNDING });
                all.push(one);
                continue;
            };
            always_active &= one.active == TimeInterval::FULL;
            let slack = Slack::new(&distortion, &extents[one.tree as usize]);
            if slack.per_distance.is_nan() || slack.per_distance > MAX_DEVIATION {
                return Err(InstanceError::Distorted { instance });
            }
            deviation = deviation.max(slack.per_distance * padding);
            slacks.push(Slack { per_distance: slack.per_distance * padding, fixed: slack.fixed * padding, ..slack });
            all.push(one);
        }
        let outlines = extents.iter().map(|of| of.outline).collect();
        let mut set = Placements {
            placed: all,
            motions,
            outlines,
            frame: Frame::WORLD,
            always_active,
            deviation,
            hidden,
            extents,
            slacks,
            whole: Vec::new(),
            paddings: Vec::new(),
            near: 0.0,
        };
        set.whole = parallel::map(set.placed.len(), |id| set.exact_bounds(id as u32, TimeInterval::FULL));
        // Relative to zero unless that is far away, so that boxes near zero are precise however far others are.
        let origin = Frame::exact_in_f64(set.union(|id| set.whole[id].swept())?).origin;
        let distances: Vec<f64> = set.whole.iter().map(|of| greatest_offset(of.swept(), origin)).collect();
        let near = set.near(&distances);
        let padding = |id: usize| set.slacks[id].padding(near + distances[id]);
        set.paddings = (0..set.placed.len()).map(padding).collect();
        set.frame = Frame::scaled(set.union(|id| grow(set.whole[id].swept(), set.paddings[id]))?, origin);
        set.near = near * set.frame.scale;
        Ok(set)
    }

    /// The union of boxes of the instances that are not hidden.
    ///
    /// # Errors
    /// If one is too large, or not a number.
    fn union(&self, of: impl Fn(usize) -> Aabb) -> Result<Aabb, InstanceError> {
        let mut all = Aabb::EMPTY;
        for instance in (0..self.placed.len()).filter(|&id| !self.is_hidden(id as u32)) {
            let of = of(instance);
            if !of.min.abs().max(of.max.abs()).cmple(DVec3::splat(MAX_PLACED)).all() {
                return Err(InstanceError::TooLarge { instance });
            }
            all = all.union(of);
        }
        Ok(all)
    }

    /// The distance from which on rays are far away: at most [`NEAR`] sizes of the scene, and not so far that paddings are
    /// [`LARGE`]. `distances` are those of the instances' farthest points from the origin of tree space.
    fn near(&self, distances: &[f64]) -> f64 {
        let shown = (0..self.placed.len()).filter(|&id| !self.is_hidden(id as u32));
        let most = shown.clone().map(|id| distances[id]).fold(0.0, f64::max);
        let mut fine: Vec<f64> = shown
            .map(|id| {
                let size = self.whole[id].begin;
                LARGE * (size.max - size.min).max_element() / self.slacks[id].relative()
            })
            .collect();
        let few = fine.len() / 16;
        let fine = if fine.is_empty() { 0.0 } else { *fine.select_nth_unstable_by(few, f64::total_cmp).1 };
        fine.min(NEAR * most)
    }

    /// Linear bounds in world space, without padding for rounding.
    fn exact_bounds(&self, id: u32, over: TimeInterval) -> LinearBounds {
        let one = &self.placed[id as usize];
        let rounding = self.slacks[id as usize].rounding;
        self.motions.bounds(&one.motion, &self.extents[one.tree as usize].subtrees, over, (1.0, rounding))
    }

    /// Whether an instance is a point at all times, or of nothing: no query sees it.
    fn is_hidden(&self, id: u32) -> bool {
        self.hidden.binary_search(&id).is_ok()
    }

    /// A box around those instances while they exist that are not hidden, with padding; `None` if there are none.
    pub fn bounds(&self) -> Option<Aabb> {
        let of = |id: usize| {
            let active = self.placed[id].active;
            let bounds =
                if active == TimeInterval::FULL { self.whole[id] } else { self.exact_bounds(id as u32, active) };
            grow(bounds.swept(), self.paddings[id])
        };
        let parts = parallel::chunks(self.placed.len(), |range| {
            range.filter(|&id| !self.is_hidden(id as u32)).map(of).reduce(Aabb::union)
        });
        parts.into_iter().flatten().reduce(Aabb::union)
    }

    /// Whether a ray in tree space begins so far away that it needs more slack than the padding of boxes.
    #[inline(always)]
    pub fn is_far(&self, ray: &TreeRay) -> bool {
        let [x, y, z, _] = ray.from;
        DVec3::new(x, y, z).abs().max_element() > self.near
    }

    /// Recomputes a ray in tree space that is not regular or far away ([`TreeRay::recompute`]). A ray that begins far away
    /// gets more slack, by its greatest deviation when it is mapped into an instance's space: the padding of an instance's box
    /// is enough for the distance of the instance from the origin of tree space, and this for that of the ray.
    #[cold]
    #[inline(never)]
    pub fn recompute(&self, ray: &mut TreeRay) {
        let frame = &self.frame;
        if !self.is_far(ray) {
            return ray.recompute(frame, f32::INFINITY);
        }
        let [x, y, z, _] = ray.from;
        let away = DVec3::new(x, y, z).abs().max_element();
        if away > FARTHEST * f64::from(frame.reach) {
            (ray.begin, ray.end) = (1.0, 0.0);
            return;
        }
        let more = (self.deviation * away * (2.0 * f64::from(ULP) + ROUNDING)) as f32;
        match TreeRay::with_slack(ray.original, &Frame { reach: frame.reach + 2.0 * more, ..*frame }, more) {
            Some(of) => *ray = of,
            None => (ray.begin, ray.end) = (1.0, 0.0),
        }
    }
}

impl Slack {
    /// Let a ray hit a primitive of the instance at `X` in the world, exactly: at the computed `t` on the caller's ray. `X` lies
    /// outside of the instance's exact bounds by at most, per axis and in ULP of the largest coordinate of `X - O`: the effect of
    /// rounding the direction ([`Distortion::skeel`]; a millionth of [`Distortion::norm`] for small components), [`MAPPED`] where
    /// the determinant is small, 1 for the rounding of `t`, and the deviation of a placed tree of instances from far away, which
    /// passes through both matrices; and by `|M|` times the rounding of the tree's own kernel.
    fn new(distortion: &Distortion, of: &Extent) -> Slack {
        let Distortion { skeel, norm, per_determinant, rows } = *distortion;
        let mapped = MAPPED * per_determinant;
        let per_distance =
            2.0 * (skeel + 1.0 + norm / 1024.0 / 1024.0 + mapped / f64::from(ULP)) + 4.0 * norm * of.deviation;
        let fixed = rows * ((INNER_ULPS + 4.0 * of.deviation) * f64::from(ULP) * of.reach);
        Slack { per_distance, fixed, rounding: ROUNDING.max(mapped) }
    }

    /// How far hits may lie outside of the instance's box, relative to the distance to the ray's origin.
    fn relative(&self) -> f64 {
        self.per_distance * (f64::from(ULP) + ROUNDING)
    }

    /// How far hits may lie outside of the instance's box, if that box and the ray's origin together are no farther than `distance`
    /// from the origin of tree space. The hit may be farther away by as much as it lies outside.
    fn padding(&self, distance: f64) -> DVec3 {
        let relative = self.relative();
        let most = (self.fixed.max_element() + relative * distance) / (1.0 - relative);
        self.fixed + relative * (distance + most)
    }
}

impl PrimitiveSet for Placements {
    /// Testing one instance takes longer than many nodes.
    fn per_leaf(&self) -> usize {
        1
    }

    fn len(&self) -> usize {
        self.placed.len()
    }

    fn hidden(&self) -> &[u32] {
        &self.hidden
    }

    fn active(&self, id: u32) -> TimeInterval {
        self.placed[id as usize].active
    }

    fn always_active(&self) -> bool {
        self.always_active
    }

    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let over_shutter = over == TimeInterval::FULL;
        let bounds = if over_shutter { self.whole[id as usize] } else { self.exact_bounds(id, over) };
        let padding = self.paddings[id as usize];
        let outward = |b: Aabb| self.frame.outward(grow(b, padding));
        LinearBox3 { begin: outward(bounds.begin), end: outward(bounds.end) }
    }

    fn mask(&self, id: u32) -> u32 {
        self.placed[id as usize].mask
    }

    fn masks(&self) -> Vec<u32> {
        self.placed.iter().map(|placed| placed.mask).collect()
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn bytes(&self) -> usize {
        self.placed.capacity() * size_of::<Placed>()
            + self.outlines.capacity() * size_of::<Outline>()
            + self.hidden.capacity() * size_of::<u32>()
            + self.motions.bytes()
    }
}

impl WideSource for Placements {
    /// Releases the data of the build.
    fn release_build_data(&mut self) {
        (self.extents, self.slacks, self.whole, self.paddings) = Default::default();
    }
}
