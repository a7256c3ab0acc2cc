//! Making lists over an interval, on one thread or several, always the same ones.

use super::candidate_points::{FourPoints, WIDTH};
use super::coordinate::SweptCoordinate;
use super::encounter::{Encounter, EncounterLanes, EncounterVisitor};
use super::encounter_lists::{EncounterLists, EncounterRows, grow};
use super::merge::unite;
use super::sweep::{Sweep, Worker};
use crate::parallel;
use crate::point::layout::over_interval::PointPath;
use crate::point::lists::scheduling::append_in_order;

/// Groups of points for each thread whose lists are on their way: few, because the lists of one are a few hundred kilobytes.
const SHARES: usize = 2;

/// Shares of points for each thread whose lists are made before it is seen whether to merge them: some thousand points.
const SHARES_AT_ONCE: usize = 4;

/// The most encounters that wait for being merged (100 MB), unless they are fewer than twice those that have been: merging what
/// will be merged again takes time, with 2^18 a tenth to a third of that of the lists (a throw-away program).
const MOST_WAITING: usize = 1 << 22;

/// Lists in the making, which drop those with too many encounters.
struct Maker {
    lists: EncounterRows,
    /// The greatest number of encounters of a point.
    most: usize,
    /// Whether points that meet nothing have a list. (Where the shutter is divided, nearly all lists of points at rest are empty.)
    empty: bool,
    /// The lowest id of a point that has more.
    crowded: Option<u32>,
}

impl Maker {
    fn new(mut lists: EncounterRows, most: usize, empty: bool) -> Maker {
        // What is left of the lists before says nothing about these.
        lists.clear();
        Maker { lists, most, empty, crowded: None }
    }

    /// Ends the list of the point that came last.
    #[inline(always)]
    fn end_list(&mut self) {
        let (Some(&id), [.., begin, end]) = (self.lists.points.last(), &mut self.lists.offsets[..]) else { return };
        if *end - *begin > self.most {
            *end = *begin;
            self.crowded = Some(self.crowded.map_or(id, |other| other.min(id)));
        }
        if !self.empty && end == begin {
            self.lists.points.pop();
            self.lists.offsets.pop();
        }
    }
}

impl EncounterVisitor for Maker {
    const EXCLUDES_LISTED: bool = false;

    /// All do, until a list is too long. Then only those of lower ids may change the error.
    #[inline(always)]
    fn wants(&self, id: u32) -> bool {
        self.crowded.is_none_or(|crowded| id < crowded)
    }

    #[inline(always)]
    fn begin(&mut self, own: &PointPath) {
        self.end_list();
        self.lists.points.push(own.id);
        self.lists.offsets.push(self.lists.end());
    }

    #[inline(always)]
    fn visit<C: SweptCoordinate>(&mut self, _own: &PointPath, others: &FourPoints<C>, encounters: &EncounterLanes) {
        let EncounterRows { offsets, data: written, .. } = &mut self.lists;
        let Some(end) = offsets.last_mut() else { return };
        if written.len() < *end + WIDTH {
            grow(written, *end + WIDTH);
        }
        let to: &mut [Encounter; WIDTH] = (&mut written[*end..*end + WIDTH]).try_into().expect("four");
        *end += encounters.write(others, to);
    }

    fn end_of_several_images(&mut self) {
        let EncounterRows { offsets, data: encounters, .. } = &mut self.lists;
        if let [.., begin, end] = &mut offsets[..] {
            *end = *begin + unite(&mut encounters[*begin..*end]);
        }
    }
}

/// Makes the lists of a sweep; returns the lowest id of a point that has more than `most` neighbours, whose list is then
/// incomplete.
pub(super) fn lists<C: SweptCoordinate>(lists: &mut EncounterLists, sweep: &Sweep<'_, C>, most: usize) -> Option<u32> {
    if !sweep.ids_come_up_once() {
        return merged(&mut lists.rows, sweep, most, MOST_WAITING);
    }
    if parallel::threads() > 1 {
        return in_parallel(lists, sweep, most);
    }
    let mut worker = Worker::new(Maker::new(core::mem::take(&mut lists.rows), most, true));
    sweep.run_on_one_thread(&mut worker);
    worker.visitor.end_list();
    lists.rows = worker.visitor.lists;
    worker.visitor.crowded
}

/// Makes lists of which a point has several, and merges these: again and again, as soon as more than `most_waiting` encounters have
/// come, and twice as many as all before. A pair may meet in thousands of time slices, and is not to be kept for each.
fn merged<C: SweptCoordinate>(
    lists: &mut EncounterRows,
    sweep: &Sweep<'_, C>,
    most: usize,
    most_waiting: usize,
) -> Option<u32> {
    // None of the lists of a point is longer than all together, unless several points have the same id.
    let most_of_one = if sweep.has_distinct_ids() { most } else { usize::MAX };
    let too_long = |lists: &EncounterRows, most: usize| {
        let lists = lists.points.iter().zip(lists.offsets.windows(2));
        lists.filter(|(_, ends)| ends[1] - ends[0] > most).map(|(&id, _)| id).min()
    };
    // Those of all slices so far that have been merged, and behind them those that have not.
    let (mut parts, mut waiting, mut crowded) = (vec![EncounterRows::default()], 0, None);
    let (shares, at_once) = (sweep.shares(), SHARES_AT_ONCE * parallel::threads());
    for begin in (0..shares).step_by(at_once) {
        let start = || Maker { crowded, ..Maker::new(EncounterRows::default(), most_of_one, false) };
        for mut maker in sweep.run_shares(begin..shares.min(begin + at_once), start) {
            maker.end_list();
            crowded = lowest(crowded, maker.crowded);
            waiting += maker.lists.end();
            parts.push(maker.lists);
        }
        if waiting > most_waiting.max(2 * parts[0].end()) {
            let mut all = EncounterRows::default();
            all.merge(&parts, Vec::new());
            // They are as long as all that a pair of ids has met in so far, and will not be shorter.
            crowded = lowest(crowded, too_long(&all, most));
            all.data.truncate(all.end());
            all.data.shrink_to_fit();
            (parts, waiting) = (vec![all], 0);
        }
    }
    lists.merge(&parts, sweep.ids());
    lowest(crowded, too_long(lists, most))
}

/// The lower of two ids, as far as there are any.
fn lowest(a: Option<u32>, b: Option<u32>) -> Option<u32> {
    a.into_iter().chain(b).min()
}

/// Makes lists on several threads.
fn in_parallel<C: SweptCoordinate>(lists: &mut EncounterLists, sweep: &Sweep<'_, C>, most: usize) -> Option<u32> {
    let mut shares = core::mem::take(&mut lists.shares);
    shares.resize(SHARES * parallel::threads(), EncounterRows::default());
    let mut workers: Vec<_> = shares.into_iter().map(|share| Worker::new(Maker::new(share, most, true))).collect();
    let make = |group: usize, worker: &mut Worker<Maker, C>| {
        worker.visitor.lists.clear();
        sweep.run_group(group, worker);
        worker.visitor.end_list();
    };
    append_in_order(sweep.groups(), &mut workers, &mut lists.rows, make, |worker| &worker.visitor.lists);
    let crowded = workers.iter().filter_map(|worker| worker.visitor.crowded).min();
    lists.shares = workers.into_iter().map(|worker| worker.visitor.lists).collect();
    crowded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point::params::PointParams;
    use crate::primitive::PointArrays;
    use crate::random::Random;
    use crate::{PointTree, TimeInterval};
    use glam::Vec3;

    /// Each pair meets in most of the segments, and is not kept for each.
    #[test]
    fn pairs_that_meet_in_many_time_slices_are_kept_a_few_times() {
        const POINTS: usize = 400;
        let mut random = Random(9);
        let keys: Vec<Vec<Vec3>> = (0..300).map(|_| (0..POINTS).map(|_| random.vec()).collect()).collect();
        let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
        let points = PointArrays { keys: &keys, active: &[], ids: &[] };
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let sweep = Sweep::<f32>::new((&tree, None), [0.0, 1.0], 0.5f32.into(), [None; 2]);
        let run = |most: usize, most_waiting: usize| {
            let mut lists = EncounterLists::new();
            let long = merged(&mut lists.rows, &sweep, most, most_waiting);
            (long, lists)
        };
        let [(_, at_once), (long, in_steps)] = [usize::MAX, 100].map(|most_waiting| run(usize::MAX, most_waiting));
        assert_eq!((long, in_steps.encounters().len()), (None, POINTS * (POINTS - 1)));
        assert!(in_steps == at_once, "merging in between changed a list");
        // What wait for the last merging are twice as many as those before, and a step more, at most.
        assert!(in_steps.bytes() * 3 < at_once.bytes(), "{} {}", in_steps.bytes(), at_once.bytes());
        for most_waiting in [usize::MAX, 100] {
            assert_eq!(run(100, most_waiting).0, Some(0), "all points meet more than 100 others");
            assert_eq!(run(POINTS - 1, most_waiting).0, None);
        }
    }

    /// Points at rest come up in each segment of those that move, but nothing is kept of those that meet nothing there.
    #[test]
    fn points_that_meet_nothing_in_a_time_slice_take_no_memory_for_it() {
        const SEGMENTS: usize = 500;
        let mut random = Random(8);
        let first: Vec<Vec3> = (0..300).map(|_| random.vec()).collect();
        let mut key = |_| first.iter().enumerate().map(|(i, &p)| if i < 298 { p } else { random.vec() }).collect();
        let keys: Vec<Vec<Vec3>> = (0..=SEGMENTS).map(&mut key).collect();
        let keys: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
        let points = PointArrays { keys: &keys, active: &[], ids: &[] };
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let sweep = Sweep::<f32>::new((&tree, None), [0.0, 1.0], 0.02f32.into(), [None; 2]);
        assert!(!sweep.ids_come_up_once());
        let mut makers = sweep.run(|| Maker::new(EncounterRows::default(), usize::MAX, false));
        makers.iter_mut().for_each(Maker::end_list);
        let (mut kept, mut met) = (0, 0);
        for maker in &makers {
            kept += maker.lists.points.len();
            met += maker.lists.end();
        }
        assert!(0 < kept && kept <= met && kept < 20 * SEGMENTS, "{kept} lists of {met} encounters");
        let lists = tree.neighbor_lists_swept(TimeInterval::FULL, 0.02).collect().unwrap();
        assert_eq!(lists.points(), Vec::from_iter(0..300));
        // Among points with many keys, those at rest have a slice for each segment, and each id once.
        let still = PointTree::build(&first, &PointParams::default()).unwrap();
        let sweep = Sweep::<f32>::new((&still, Some(&tree)), [0.0, 1.0], 0.02f32.into(), [None; 2]);
        let mut ids = sweep.ids();
        ids.sort_unstable();
        assert_eq!(ids, Vec::from_iter(0..300));
        let lists = still.neighbor_lists_swept(TimeInterval::FULL, 0.02).among(&tree).collect().unwrap();
        assert_eq!(lists.points(), ids);
    }
}
