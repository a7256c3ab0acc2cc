//! Lists of encounters, one for each point, in memory of the caller.

use super::coordinate::SweptCoordinate;
use super::encounter::{Encounter, EncounterLanes, FourPoints, Visitor, WIDTH};
use super::sweep::{Sweep, Worker};
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::layout::over_interval::PointPath;
use crate::point::lists::error::ListError;
use crate::point::lists::in_order::{in_order, room_for};
use crate::point::lists::radii::is_bad;
use crate::point::tree::PointTree;
use crate::simd::huge_vec;

/// Groups of points for each thread whose lists are on their way: few, because the lists of one are a few hundred kilobytes.
const SHARES: usize = 2;

/// Who comes within a radius of whom during an interval, and when: a list for each point.
///
/// ```
/// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
/// let points = [MovingPoint::new(Vec3::NEG_X, Vec3::X), MovingPoint::fixed(Vec3::Y * 0.3)];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.5)?;
/// let (_, row) = lists.iter().find(|(id, _)| *id == 0).unwrap();
/// assert_eq!((row.len(), row[0].id, row[0].closest), (1, 1, 0.5));
/// assert!((row[0].enter - 0.3).abs() < 1e-6 && (row[0].leave - 0.7).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Memory of the caller: handed to [`PointTree::neighbor_lists_swept_into`] again and again, it grows until it fits the
/// largest lists.
#[derive(Clone, Debug)]
pub struct EncounterLists {
    /// Begin of each list, and the end of the last.
    pub(super) offsets: Vec<usize>,
    pub(super) points: Vec<u32>,
    /// Longer than what is in use, so that nothing is cleared from query to query.
    pub(super) encounters: Vec<Encounter>,
    /// Lists on their way, of one group of points each.
    shares: Vec<EncounterLists>,
}

impl Default for EncounterLists {
    fn default() -> EncounterLists {
        EncounterLists { offsets: vec![0], points: Vec::new(), encounters: Vec::new(), shares: Vec::new() }
    }
}

impl PartialEq for EncounterLists {
    fn eq(&self, other: &EncounterLists) -> bool {
        self.offsets == other.offsets && self.points == other.points && self.encounters() == other.encounters()
    }
}

impl EncounterLists {
    /// No lists, no memory.
    pub fn new() -> EncounterLists {
        EncounterLists::default()
    }

    /// Number of lists: one for each point that exists at any time of the interval, and possibly some that do not.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Where each list begins in [`encounters`](EncounterLists::encounters), and where the last one ends.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The id of the point that each list belongs to.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// All encounters, list after list.
    pub fn encounters(&self) -> &[Encounter] {
        &self.encounters[..self.end()]
    }

    /// The encounters of list `row`.
    ///
    /// ```
    /// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let points = [MovingPoint::new(Vec3::NEG_X, Vec3::X), MovingPoint::fixed(Vec3::Y * 0.3)];
    /// let lists = PointTree::build(&points, &PointParams::default())?.neighbor_lists_swept(TimeInterval::FULL, 0.5)?;
    /// for (row, &point) in lists.points().iter().enumerate() {
    ///     assert_eq!((lists.row(row).len(), lists.row(row)[0].id), (1, 1 - point));
    /// }
    /// assert_eq!(lists.offsets(), [0, 1, 2]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    /// If `row` is not less than [`EncounterLists::len`].
    pub fn row(&self, row: usize) -> &[Encounter] {
        &self.encounters[self.offsets[row]..self.offsets[row + 1]]
    }

    /// The lists, each with the id of its point.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, &[Encounter])> {
        let rows = self.offsets.windows(2).map(|ends| &self.encounters[ends[0]..ends[1]]);
        self.points.iter().copied().zip(rows)
    }

    /// Bytes allocated, for the lists and for making them.
    pub fn bytes(&self) -> usize {
        let shares: usize = self.shares.iter().map(EncounterLists::bytes).sum();
        self.offsets.capacity() * size_of::<usize>()
            + self.points.capacity() * size_of::<u32>()
            + self.encounters.capacity() * size_of::<Encounter>()
            + self.shares.capacity() * size_of::<EncounterLists>()
            + shares
    }
}

impl PointTree {
    /// For every point all others that come within `radius` at some time of the interval, both ends included, with
    /// the times: what a step of a simulation needs in which nothing may pass unseen.
    ///
    /// Decided in f64 for exact linear motion between the positions at the keys, in f32 or f64. Points meet while both exist: not
    /// if one begins to exist where the other ends, as [`TimeInterval::contains`] has it. So an encounter begins before both
    /// active intervals end; if the two are still approaching each other at the end, [`Encounter::closest`] and
    /// [`Encounter::leave`] are the end itself, the limit of the times at which both exist. At a key, a point that
    /// begins or ends there counts only on its own side. This also holds for the float next to a key that is no float
    /// (5/6, say). An interval that ends just below such a key does not contain points that begin at it.
    /// (A [`closest_approach`](PointTree::closest_approach) may also be at the end alone.)
    ///
    /// The encounters do not depend on the structure, the number of threads or the instruction set. The order of lists, and of
    /// the encounters within them, is that of the tree, or that of ids where it consists of several; a point that does not exist in
    /// the interval may have an empty list or none. Points with the same
    /// id are no neighbours of each other; where the tree consists of several, they have one list together.
    ///
    /// Cost: several times that of lists at a time, even of points that do not move, as each encounter is computed in f64, while points
    /// move less than their spacing relative to their neighbours. Motion that all have in common adds little.
    ///
    /// # Errors
    /// [`ListError::Radius`] for a radius that is negative or NaN.
    pub fn neighbor_lists_swept(&self, interval: TimeInterval, radius: f32) -> Result<EncounterLists, ListError> {
        let mut lists = EncounterLists::new();
        self.neighbor_lists_swept_into(interval, radius, &mut lists)?;
        Ok(lists)
    }

    /// The same into memory of the caller, in place of what `lists` held.
    ///
    /// ```
    /// use mbkd::{EncounterLists, MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
    /// let mut lists = EncounterLists::new(); // memory that is used again in the next step
    /// for step in 0..3 {
    ///     let points = [MovingPoint::new(Vec3::X * step as f32, Vec3::ZERO), MovingPoint::fixed(Vec3::Y * 0.3)];
    ///     let tree = PointTree::build(&points, &PointParams::default())?;
    ///     tree.neighbor_lists_swept_into(TimeInterval::FULL, 0.5, &mut lists)?;
    ///     assert_eq!(lists.encounters().len(), 2);
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`PointTree::neighbor_lists_swept`]; `lists` then holds none.
    pub fn neighbor_lists_swept_into(
        &self,
        interval: TimeInterval,
        radius: f32,
        lists: &mut EncounterLists,
    ) -> Result<(), ListError> {
        parallel::entered(self.len(), || self.sweep_into(interval, radius, lists))
    }

    fn sweep_into(&self, interval: TimeInterval, radius: f32, lists: &mut EncounterLists) -> Result<(), ListError> {
        lists.clear();
        if is_bad(radius) {
            return Err(ListError::Radius { id: None });
        }
        let times = [interval.begin(), interval.end()];
        let boxed = self.box_tree(times);
        let tree = boxed.as_ref().unwrap_or(self);
        if self.precise.is_empty() {
            lists.make::<f32>(&Sweep::new(tree, times, radius, None));
        } else {
            lists.make::<f64>(&Sweep::new(tree, times, radius, None));
        }
        Ok(())
    }
}

impl Visitor for EncounterLists {
    const EXCLUDES_LISTED: bool = false;

    #[inline(always)]
    fn begin(&mut self, own: &PointPath) {
        self.points.push(own.id);
        self.offsets.push(self.end());
    }

    #[inline(always)]
    fn visit<C: SweptCoordinate>(&mut self, _own: &PointPath, others: &FourPoints<C>, encounters: &EncounterLanes) {
        let Some(end) = self.offsets.last_mut() else { return };
        if self.encounters.len() < *end + WIDTH {
            grow(&mut self.encounters, *end + WIDTH);
        }
        let to: &mut [Encounter; WIDTH] = (&mut self.encounters[*end..*end + WIDTH]).try_into().expect("four");
        *end += encounters.write(others, to);
    }
}

/// At least this length, with room to grow; on huge pages.
#[cold]
fn grow(encounters: &mut Vec<Encounter>, length: usize) {
    let mut larger = huge_vec(length + length / 2 + 64 * WIDTH);
    larger.extend_from_slice(encounters);
    larger.resize(larger.capacity(), Encounter::NONE);
    *encounters = larger;
}

impl EncounterLists {
    /// Where the last list ends.
    #[inline(always)]
    pub(super) fn end(&self) -> usize {
        self.offsets.last().map_or(0, |end| *end)
    }

    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.offsets.clear();
        self.offsets.push(0);
    }

    /// Room for so many encounters.
    pub(super) fn make_room(&mut self, length: usize) {
        if self.encounters.len() < length {
            grow(&mut self.encounters, length);
        }
    }

    /// Makes the lists.
    fn make<C: SweptCoordinate>(&mut self, sweep: &Sweep<'_, C>) {
        if !sweep.once {
            self.merge(&sweep.run(EncounterLists::new));
        } else if parallel::threads() == 1 {
            let mut worker = Worker::new(core::mem::take(self));
            sweep.run_on_one_thread(&mut worker);
            *self = worker.visitor;
        } else {
            self.make_in_parallel(sweep);
        }
    }

    /// Makes the lists on several threads.
    fn make_in_parallel<C: SweptCoordinate>(&mut self, sweep: &Sweep<'_, C>) {
        let mut shares = core::mem::take(&mut self.shares);
        // What is left of the lists before says nothing about these.
        shares.iter_mut().for_each(EncounterLists::clear);
        shares.resize(SHARES * parallel::threads(), EncounterLists::new());
        let mut workers: Vec<_> = shares.into_iter().map(Worker::new).collect();
        let (groups, mut done) = (sweep.groups(), 0);
        while done < groups {
            let EncounterLists { offsets, points, encounters, .. } = &mut *self;
            let begin = offsets.last().map_or(0, |end| *end);
            let mut room = encounters.get_mut(begin..).unwrap_or_default();
            let assign = |worker: &Worker<EncounterLists, C>| {
                let share = &worker.visitor;
                let (own, rest) = core::mem::take(&mut room).split_at_mut_checked(share.end())?;
                room = rest;
                let begin = offsets.last().map_or(0, |end| *end);
                points.extend_from_slice(&share.points);
                offsets.extend(share.offsets[1..].iter().map(|end| begin + end));
                Some(own)
            };
            let make = |group: usize, worker: &mut Worker<EncounterLists, C>| {
                worker.visitor.clear();
                sweep.run_group(group, worker);
            };
            let copy = |worker: &Worker<EncounterLists, C>, room: &mut [Encounter]| {
                room.copy_from_slice(worker.visitor.encounters());
            };
            done = in_order(done..groups, &mut workers, make, assign, copy);
            if done < groups {
                let made = workers.iter().map(|worker| worker.visitor.end());
                self.make_room(room_for(self.end(), done, groups - done, made));
            }
        }
        self.shares = workers.into_iter().map(|worker| worker.visitor).collect();
    }
}
