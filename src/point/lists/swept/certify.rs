//! Lists with a skin (Verlet lists), and how long they are valid.
//!
//! A list of all neighbours within a radius and a skin serves several steps of a simulation, until a pair that is not
//! in it comes within the radius. Usually that time is guessed. For linear motion it can be computed: it is the first
//! encounter of a pair that was left out.

use super::encounter::{EncounterLanes, FourPoints, Visitor};
use super::sweep::Sweep;
use crate::geometry::KeyTime;
use crate::point::layout::linear_face::rounded_down;
use crate::point::layout::over_interval::PointPath;
use crate::point::lists::csr::NeighborCsr;
use crate::point::lists::error::ListError;
use crate::point::lists::radii::squared_radius;
use crate::point::search::layers::Layer;
use crate::point::tree::PointTree;
use glam::Vec3;

impl PointTree {
    /// The neighbour lists at `time` with a radius of `radius + skin`, and until when they hold every pair within
    /// `radius`.
    ///
    /// What is certain: at each time from `time` to before the returned one, every pair that
    /// [`PointTree::neighbor_lists`] finds within `radius` is in these lists, whatever the rounding. The verdict is exact
    /// for the linear motion between keys, not a bound on speeds, and on the safe side by a few units in the last
    /// place of the coordinates in the radius: by 2e-6 of the set's largest coordinate with two keys, and by 5e-7 more for each further one.
    ///
    /// If that is more than a third of the skin, two points that are just not in the lists may be near enough already. Then nothing is
    /// certain, and the answer is `time` itself: a loop that goes on to the answer has to stop there, or use a wider skin. (If nothing
    /// moves or begins to exist, the lists hold until `until` in any case.)
    ///
    /// Looks ahead to `until`, but not beyond the next key. If nothing is missing by then, that is what is returned;
    /// otherwise just before the first time at which a pair is. Points that begin to exist later count too. Cost: the
    /// lists, and those of [`neighbor_lists_swept`](PointTree::neighbor_lists_swept) over the time looked ahead.
    /// If not the motion but a bound on all speeds is known: [`certified_duration`].
    ///
    /// ```
    /// use mbkd::{MovingPoint, NeighborCsr, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * 4.0, Vec3::ZERO)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut lists = NeighborCsr::new();
    /// // Four apart, not in the lists; one apart after three quarters of the time.
    /// let valid_until = tree.neighbor_lists_with_skin(0.0, 1.0, 0.5, 1.0, &mut lists)?;
    /// assert!(lists.neighbors() == 0 && (valid_until - 0.75).abs() < 1e-5 && valid_until <= 0.75);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A radius or skin that is negative or NaN, a time outside the shutter, an `until` before it or beyond the shutter, and
    /// [`ListError::Double`] for a tree that holds positions in f64; `lists` then holds none.
    pub fn neighbor_lists_with_skin(
        &self,
        time: f32,
        radius: f32,
        skin: f32,
        until: f32,
        lists: &mut NeighborCsr,
    ) -> Result<f32, ListError> {
        lists.offsets.clear();
        lists.points.clear();
        if !self.precise.is_empty() {
            return Err(ListError::Double);
        }
        if skin.is_nan() || skin < 0.0 {
            return Err(ListError::Skin);
        }
        if radius.is_nan() || radius < 0.0 {
            return Err(ListError::Radius { id: None });
        }
        if !(time..=1.0).contains(&until) {
            return Err(ListError::Time);
        }
        self.neighbor_lists(time, radius + skin).run(lists)?;
        // Positions are the same numbers at all times.
        if self.layers.iter().all(|layer| matches!(layer, Layer::Static(_))) {
            return Ok(until);
        }
        let keys = self.keys();
        let at = KeyTime::new(time, keys);
        let next_key = (at.segment + 1) as f64 / (keys.max(2) - 1) as f64;
        // The f32 nearest to the key needs no rounding down: what is certain ends before it, and all f32 before it are
        // before the key. But queries may locate the last of them at the key: a point that begins to exist then is not in this
        // segment.
        let next_key = (next_key as f32).min(KeyTime::first_time(at.segment + 1, keys));
        let until = until.min(next_key).max(time);
        let bound = squared_radius(radius + skin);
        let listed = |a: &PointPath, b: &PointPath| {
            let key = |p: [f64; 3]| Vec3::from_array(p.map(|x| x as f32));
            let position = |point: &PointPath| at.position(key(point.open), key(point.close));
            let d = position(b) - position(a);
            let both = a.active.contains(time) && b.active.contains(time);
            both && (d.x * d.x + d.y * d.y) + d.z * d.z <= bound
        };
        let boxed = self.box_tree([time, until]);
        let sweep = Sweep::new(boxed.as_ref().unwrap_or(self), [time, until], radius, Some(at.segment))
            .exclude_lists_of(radius + skin)
            .allow_for_rounding();
        let firsts = sweep.run(|| First { time: f32::INFINITY, listed: &listed });
        let first = firsts.iter().fold(f32::INFINITY, |least, first| least.min(first.time));
        // No margin is needed. The radius r is widened by Δ, at least 28·2^-24 of the largest coordinate M, and a pair that a
        // query finds at time t is within r + 0.9 Δ in truth: see `Sweep::rounding`. What f64 rounds in the discriminant is a
        // change of the widened radius, of less than 2^-44 M² in its square, where (r + Δ)² exceeds (r + 0.9 Δ)² by more than
        // 2^-41 M². What it rounds in the quotient is less than 2^-50 of it, in which the two move by less than 2^-47 M. So the
        // computed time is before t. No f32 lies between a time and the f32 nearest to it, so t is not before that either.
        Ok(first.min(until))
    }
}

/// Finds the first encounter of a pair that is not listed.
struct First<'a, F> {
    time: f32,
    listed: &'a F,
}

impl<F: Fn(&PointPath, &PointPath) -> bool> Visitor for First<'_, F> {
    const EXCLUDES_LISTED: bool = true;

    #[inline(always)]
    fn begin(&mut self, _own: &PointPath) {}

    #[inline(always)]
    fn visit(&mut self, own: &PointPath, others: &FourPoints, encounters: &EncounterLanes) {
        for (lane, time) in encounters.entering() {
            if time < self.time && !(self.listed)(own, &others.point_path(lane)) {
                self.time = time;
            }
        }
    }
}

/// How long lists with a skin hold every pair within `radius`, if no point is ever faster than `speed`: rounded down,
/// infinite if nothing moves or the lists hold all pairs, 0 for arguments that are negative or NaN.
///
/// A pair that is not in the lists is farther apart than `radius + skin`, and two points approach each other by at most
/// twice the speed: it takes `skin / (2·speed)`. No point may have moved by more than its speed times that, rounding of
/// its positions included. The lists compare squares computed in f32, which are wrong by less than
/// 2^-21 of themselves, and the sum of radius and skin is rounded; the skin that counts is that much less.
///
/// ```
/// let step = mbkd::certified_duration(0.1, 0.02, 0.5);
/// assert!(step <= 0.02 && step > 0.0199);
/// ```
pub fn certified_duration(radius: f32, skin: f32, speed: f32) -> f32 {
    // Also for NaN.
    if !(radius >= 0.0 && skin >= 0.0 && speed >= 0.0) {
        return 0.0;
    }
    let reach = radius + skin;
    if speed == 0.0 || reach == f32::INFINITY {
        return f32::INFINITY;
    }
    let reach = f64::from(reach) * (1.0 - 1.0 / f64::from(1 << 21));
    rounded_down((reach - f64::from(radius)).max(0.0) / (2.0 * f64::from(speed)))
}
