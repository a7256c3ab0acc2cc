//! Lists with a skin (Verlet lists), and how long they are valid.
//!
//! A list of all neighbours within a radius and a skin serves several steps of a simulation, until a pair that is not
//! in it comes within the radius. Usually that time is guessed. For linear motion it can be computed: it is the first
//! encounter of a pair that was left out.

use super::candidate_points::FourPoints;
use super::coordinate::{SweptCoordinate, SweptLayer};
use super::encounter::{EncounterLanes, EncounterVisitor};
use super::images::Images;
use super::sweep::Sweep;
use crate::parallel;
use crate::point::layout::linear_face::rounded_down;
use crate::point::layout::over_interval::PointPath;
use crate::point::lists::error::ListError;
use crate::point::lists::list_request::ListRequest;
use crate::point::lists::neighbor_lists::NeighborLists;
use crate::point::lists::periodic_box::PeriodicBox;
use crate::point::lists::query::ListQuery;
use crate::point::lists::radii::{Radii, is_bad, squared_radius};
use crate::point::tree::PointTree;

impl PointTree {
    /// The neighbour lists at `time` with a radius of `radius + skin`, and until when they hold every pair within
    /// `radius`: see [`ListQuery::certified_until`], which tells this alone, of lists with other options, in periodic
    /// boxes or among another set.
    ///
    /// ```
    /// use mbkd::{MovingPoint, NeighborLists, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * 4.0, Vec3::ZERO)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let mut lists = NeighborLists::new();
    /// // Four apart, not in the lists; one apart after three quarters of the time.
    /// let valid_until = tree.neighbor_lists_with_skin(0.0, 1.0, 0.5, 1.0, &mut lists)?;
    /// assert!(lists.neighbors() == 0 && (valid_until - 0.75).abs() < 1e-5 && valid_until <= 0.75);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ListError::Skin`] for a skin that is negative or NaN, and as [`ListQuery::certified_until`]; `lists` then holds none.
    pub fn neighbor_lists_with_skin(
        &self,
        time: f32,
        radius: f32,
        skin: f32,
        until: f32,
        lists: &mut NeighborLists,
    ) -> Result<f32, ListError> {
        lists.clear();
        if is_bad(skin) {
            return Err(ListError::Skin);
        }
        let query = self.neighbor_lists(time, radius + skin);
        let until = query.certified_until(radius, until)?;
        query.run(lists)?;
        Ok(until)
    }
}

impl ListQuery<'_> {
    /// Until when these lists hold every pair within `radii`, which are less than those that they are made with: by the skin. In
    /// periodic boxes and among another set, too; the columns and the order of the lists make no difference.
    ///
    /// What is certain: at each time from that of the lists to before the returned one, every pair that the same request finds
    /// with `radii` is in these lists, whatever the rounding. The verdict is exact for the linear motion between keys, not a
    /// bound on speeds, and on the safe side by a few units in the last place of the coordinates in the radius: by 2e-6 of the
    /// set's largest coordinate with two keys, and by 5e-7 more for each further one. Of points kept in f64 it is 2e-14 and 1e-14
    /// of the largest coordinate, with 5e-7 of the radius and 3e-7 of the most by which displacements between two keys differ. (In
    /// a periodic box the greatest period is added to the largest coordinate, and there is another key.)
    ///
    /// If that is more than a third of the skin, two points that are just not in the lists may be near enough already. Then nothing
    /// is certain, and the answer is the time of the lists itself: a loop that goes on to the answer has to stop there, or use a
    /// wider skin. (If nothing moves or begins to exist, the lists hold until `until` in any case.)
    ///
    /// Looks ahead to `until`, but not beyond the next key. If nothing is missing by then, that is what is returned; otherwise just
    /// before the first time at which a pair is. Points that begin to exist later count too. Cost: that of
    /// [`neighbor_lists_swept`](PointTree::neighbor_lists_swept) over the time looked ahead, without writing lists, whatever
    /// `max_neighbors` is: where lists may be too long, make them first. If not the motion but a bound on all speeds is known:
    /// [`certified_duration`].
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, glam::Vec3};
    /// let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * 4.0, Vec3::X * 8.0)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// // In a box of length 10 the second point comes nearer to the first one across the face.
    /// let (radius, skin) = (3.0, 0.5);
    /// let query = tree.neighbor_lists(0.0, radius + skin).periodic([Some(10.0), None, None]).in_order();
    /// let lists = query.collect()?;
    /// let valid_until = query.certified_until(radius, 1.0)?;
    /// assert!(lists.neighbors() == 0 && (valid_until - 0.75).abs() < 1e-4 && valid_until <= 0.75);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// Points of different sizes have lists with [`Radii`] that are longer by a skin each:
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, Radii, glam::Vec3};
    /// let points = [MovingPoint::fixed(Vec3::ZERO), MovingPoint::new(Vec3::X * 4.0, Vec3::ZERO)];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let (radii, with_skin) = ([1.0, 0.5], [1.25, 0.75]);
    /// let lists = tree.neighbor_lists(0.0, Radii::Sum { own: &with_skin, others: &with_skin });
    /// let valid_until = lists.certified_until(Radii::Sum { own: &radii, others: &radii }, 1.0)?;
    /// // One and a half apart after five eighths of the time.
    /// assert!((valid_until - 0.625).abs() < 1e-5 && valid_until <= 0.625);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// - [`ListError::Radius`] for a radius that is negative or NaN, [`ListError::MissingRadius`] for a point without one.
    /// - [`ListError::Skin`] for a radius that is greater than that of the lists, [`ListError::RadiiDiffer`] for [`Radii`] of
    ///   another kind than those of the lists.
    /// - [`ListError::Origins`] and [`ListError::Double`] if the two trees keep their positions in different ways
    ///   ([`ListQuery::among`]).
    /// - [`ListError::Time`] for lists at a time outside the shutter, [`ListError::Until`] for an `until` before it or beyond the
    ///   shutter.
    /// - [`ListError::Period`], [`ListError::FarFromPeriod`] and [`ListError::Extent`] as
    ///   [`SweptQuery::run`](super::SweptQuery::run).
    pub fn certified_until<'r>(self, radii: impl Into<Radii<'r>>, until: f32) -> Result<f32, ListError> {
        let (request, radii) = (self.request, radii.into());
        request.check()?;
        radii.check()?;
        radii.check_within(&request.listing.radii)?;
        if !(request.time..=1.0).contains(&until) {
            return Err(ListError::Until);
        }
        let first_missing = if request.in_single() { first_missing::<f32> } else { first_missing::<f64> };
        parallel::entered(request.tree.len(), || first_missing(&request, radii, until))
    }
}

/// The first time until which no pair comes within its radius that is not in the lists of a request, but at most the next key.
fn first_missing<C: SweptCoordinate>(
    request: &ListRequest<'_>,
    radii: Radii<'_>,
    until: f32,
) -> Result<f32, ListError> {
    let ListRequest { tree, among, time, periods, listing, .. } = *request;
    let sets = [tree, request.others()];
    let images = Images::new::<C>(periods, (tree, among))?;
    // Positions are the same numbers at all times.
    let at_rest = sets.iter().flat_map(|tree| C::layers(tree)).all(|layer| matches!(layer, SweptLayer::Static(_)));
    if at_rest && matches!(radii, Radii::Equal(_)) {
        return Ok(until);
    }
    let keys = sets.map(PointTree::keys);
    let segments = keys.map(|keys| C::segment(time, keys));
    let ends = [0, 1].map(|set| C::segment_end(segments[set], keys[set]));
    let first_key = until.min(ends[0]).min(ends[1]).max(time);
    let periodic_box = PeriodicBox::new(periods);
    let listed = |a: &PointPath, b: &PointPath| {
        let both = a.active.contains(time) && b.active.contains(time);
        let within = || squared_radius(listing.radii.of_ids(a.id, b.id));
        both && C::squared_distance([a, b], time, keys, &periodic_box) <= within()
    };
    let (boxed, boxed_among) =
        (tree.box_tree([time, first_key]), among.and_then(|among| among.box_tree([time, first_key])));
    let sets = (boxed.as_ref().unwrap_or(tree), boxed_among.as_ref().or(among));
    let mut shortened = [Vec::new(), Vec::new()];
    let radii = images.shortened(radii, &mut shortened);
    // Where all pairs have the same radius, either point of a pair finds what the other does.
    let alike = matches!(radii, Radii::Equal(_)) && among.is_none();
    let sweep = Sweep::<C>::new(sets, [time, first_key], radii, segments.map(Some))
        .pairs_once(listing.once || alike)
        .in_box(images)
        .for_certificate(listing.radii.least());
    if let Some(of) = sweep.lowest_without(radii).or_else(|| sweep.lowest_without(listing.radii)) {
        return Err(ListError::MissingRadius { of });
    }
    if at_rest {
        return Ok(until);
    }
    let firsts = sweep.run(|| First { time: f32::INFINITY, listed: &listed });
    let first = firsts.iter().fold(f32::INFINITY, |least, first| least.min(first.time));
    // No margin is needed. A radius r is widened by Δ, at least 28·2^-24 of the largest coordinate M, and a pair that a query
    // finds at time t is within r + 0.9 Δ in truth: see `Sweep::for_certificate`. What f64 rounds in the discriminant is a
    // change of the widened radius, of less than 2^-44 M² in its square, where (r + Δ)² exceeds (r + 0.9 Δ)² by more than 2^-41
    // M². What it rounds in the quotient is less than 2^-50 of it, in which the two move by less than 2^-47 M. So the computed
    // time is before t. No f32 lies between a time and the f32 nearest to it, so t is not before that either.
    //
    // Of points in f64, with ε, A, R and n as in `super`, what a query finds is nearer here than r + Δ by 29εA + 36nεA + 2^-22
    // R and 6ur. What f64 rounds in the discriminant changes the square of the widened radius by less than (2^-23 R)² and
    // 36εr². What it rounds in the quotient and in the time is less than 3ε, in which the two move by less than 21nεA.
    Ok(first.min(first_key))
}

/// Finds the first encounter of a pair that is not listed.
struct First<'a, F> {
    time: f32,
    listed: &'a F,
}

impl<F: Fn(&PointPath, &PointPath) -> bool> EncounterVisitor for First<'_, F> {
    const EXCLUDES_LISTED: bool = true;

    #[inline(always)]
    fn begin(&mut self, _own: &PointPath) {}

    #[inline(always)]
    fn visit<C: SweptCoordinate>(&mut self, own: &PointPath, others: &FourPoints<C>, encounters: &EncounterLanes) {
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
/// A pair that is not in the lists is farther apart than `radius + skin`, and two points approach each other by at most twice the
/// speed: it takes `skin / (2·speed)`. No point may have moved by more than its speed times that, rounding of its positions
/// included. The lists compare squares computed in f32, which are wrong by less than 2^-21 of themselves or, where they are
/// denormal, by what changes distances by less than 1e-22, and the sum of radius and skin is rounded; the skin that counts is that
/// much less.
///
/// This also holds for lists of one set among another, and for [`Radii`]: `radius` is the largest of a pair, and
/// lists are made with every pair's radius longer by `skin`. In a periodic box differences are rounded at the size of coordinates,
/// so pass a skin that is less by 2^-19 of the largest coordinate or period.
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
    let reach = f64::from(reach) * (1.0 - 1.0 / f64::from(1 << 21)) - 1e-22;
    rounded_down((reach - f64::from(radius)).max(0.0) / (2.0 * f64::from(speed)))
}
