//! The search for all encounters of a set with itself or another one during an interval.

use super::candidates::{AddCandidates, Behind, SweptCandidates};
use super::coordinate::{SweptCoordinate, SweptLayer};
use super::criteria::Criteria;
use super::encounter::EncounterVisitor;
use super::group::{SweptGroup, TakeGroup};
use super::images::Images;
use super::pair_filter::{PairFilter, ShowBlock};
use super::time_slices::{
    OwnExcess, Pairing, SweptSlice, SweptTree, begins_with_a_slice, excesses, magnitude, pairings, time_slices_of,
};
use super::window::{Segment, Window};
use crate::parallel;
use crate::point::layout::over_interval::{greater, lesser};
use crate::point::lists::error::RadiusOf;
use crate::point::lists::group::MOST_BLOCKS;
use crate::point::lists::radii::{Allowance, Radii};
use crate::point::lists::reach::Reach;
use crate::point::tree::PointTree;
use crate::simd::{Kernel, LANES, Simd, dispatch};
use core::ops::Range;

/// A search for all encounters of a set with itself or another one.
pub(super) struct Sweep<'a, C: SweptCoordinate> {
    tree: &'a PointTree,
    /// The set of the others; none if it is the same.
    among: Option<&'a PointTree>,
    /// The slices of the tree, and then of the other one.
    slices: Vec<SweptSlice<'a, C>>,
    /// How many of these are the tree's own.
    own: usize,
    pairings: Vec<Pairing>,
    /// Pairing and bottom node of each group.
    groups: Vec<(usize, usize)>,
    times: [f64; 2],
    criteria: Criteria<'a>,
    /// For each slice the greatest radii of its points, where those of listed points count.
    reaches: Vec<Reach>,
    /// The greatest of these.
    most_reach: f32,
    /// The largest number of segments between keys, and the most by which displacements between two keys differ along an axis; that
    /// is of no account for f32.
    segments: usize,
    pub(super) motion: f64,
    /// See [`SweptCoordinate::excess`]: for all points, or else, in each slice, for those of a node.
    excess: f64,
    own_excess: Option<OwnExcess>,
    excesses: Vec<Reach>,
    /// Whether each point is in one slice, once unless ids repeat.
    undivided: bool,
}

/// Groups that one task processes.
const SHARE: usize = 8;

impl<'a, C: SweptCoordinate> Sweep<'a, C> {
    /// Between two times of the shutter, of a tree among itself or another; where segments between keys are given, in these only.
    pub(super) fn new(
        (tree, among): (&'a PointTree, Option<&'a PointTree>),
        times: [f32; 2],
        radii: Radii<'a>,
        segments: [Option<usize>; 2],
    ) -> Sweep<'a, C> {
        let (own_layers, other_layers) = (C::layers(tree), among.map(C::layers));
        let keys = [tree.keys(), among.unwrap_or(tree).keys()];
        let same_keys = keys[0] == keys[1];
        let divided = keys.map(|count| (!same_keys && count > 2).then_some(count));
        let of_any = || own_layers.iter().chain(other_layers.iter().flatten());
        let begins = of_any().any(|layer| begins_with_a_slice(layer, times[1]));
        let mut slices = Vec::new();
        let mut append = |layers: &[SweptLayer<'a, C>], set: usize| -> Vec<Range<usize>> {
            let append_layer = |layer| {
                let begin = slices.len();
                slices.extend(time_slices_of(layer, times, begins, (segments[set], divided[set])));
                begin..slices.len()
            };
            layers.iter().map(append_layer).collect()
        };
        let of_own = append(&own_layers, 0);
        let own = of_own.last().map_or(0, |layer| layer.end);
        let own_once = of_own.iter().all(|layer| layer.len() <= 1);
        let layers = other_layers.as_ref().map_or(of_own, |layers| append(layers, 1));
        let pairings = pairings(&slices, own, &layers, times);
        let nodes = |(number, pairing): (usize, &Pairing)| {
            let nodes = slices[pairing.own].bottom_nodes();
            nodes.into_iter().map(move |node| (number, node))
        };
        let groups = pairings.iter().enumerate().flat_map(nodes).collect();
        // Several references with the same id and disjoint active intervals are the same point.
        let undivided = pairings.len() == own
            && own_once
            && layers.iter().all(|layer| layer.len() <= 1)
            && !slices.iter().any(SweptSlice::timed);
        let criteria = Criteria {
            radii,
            allowance: Allowance::default(),
            own: 0.0,
            pairs_once: false,
            other_set: among.is_some(),
            first_time: times[0],
            excluded_within: None,
            has_active_intervals: slices.iter().any(|slice| slice.points().has_active_intervals()),
            images: Images::default(),
        };
        let times = times.map(f64::from);
        let segments =
            slices.iter().filter_map(|slice| slice.segment).map(|(keys, _)| keys.max(2) - 1).max().unwrap_or(1);
        let motion = relative_motion(&slices, same_keys);
        let reach = |radii: &[f32]| parallel::map(slices.len(), |i| slices[i].reach(radii));
        let reaches = radii.others().map_or_else(Vec::new, reach);
        let (excess, own_excess, excesses) = excesses(&slices, segments, (motion, same_keys), || radii.least());
        let most_reach = reaches.iter().fold(0.0, |most: f32, reach| most.max(reach.most));
        Sweep {
            tree,
            among,
            own,
            segments,
            motion,
            excess,
            own_excess,
            excesses,
            slices,
            pairings,
            groups,
            times,
            criteria,
            reaches,
            most_reach,
            undivided,
        }
    }

    /// With images in a periodic box.
    pub(super) fn in_box(mut self, images: Images) -> Sweep<'a, C> {
        self.criteria.images = images;
        if images.any() {
            // Where each point has an excess of its own, the length of the box comes on top.
            let of_points = if self.own_excess.is_some() { [0.0; 2] } else { [magnitude(&self.slices), self.motion] };
            let [magnitude, motion] = of_points;
            self.excess = f64::excess(self.segments, || magnitude + images.longest(), motion);
        }
        self
    }

    /// Widens radii by what the positions, distances and bounds of queries at a time, which are computed in f32, may differ
    /// from exact ones, and excludes the pairs that lists at the first time contain for certain, where visitors want that: those
    /// lists have no pair with a radius less than `listed_within`.
    ///
    /// **The radius.** With u = 2^-24, M the largest coordinate and n segments between keys, the phase between the keys is rounded
    /// by nu, which moves a point by 2Mnu; interpolation adds 4Mu, the difference of two points 2Mu; the square and its comparison
    /// with the rounded square of the radius are wrong by 4u of themselves. Along three axes, and for both points, that is below
    /// (4n + 10)·1.8Mu + 4ur.
    ///
    /// Queries among points in f64 find their phases exactly. With ε, A and R as in [`super`], their positions and those here are
    /// wrong by 5εA each, and phases here by what moves two points by 16nεA: together (35 + 28n)εA in space. The square of a query
    /// is rounded once, and so is that of the radius: ur. The allowance is [`SweptCoordinate::excess`] and 8ur.
    ///
    /// Lists in a periodic box take kL off differences in f32, which is wrong by (2M + L)u, and so is the result: as much as
    /// another segment adds, with M + L in place of M. Of two images that are as far away as f32 tells, they may take the one that
    /// is farther by 12(M + L)u along an axis. So a pair may be farther apart in the lists than its nearest image is: for that
    /// there is room in the second half below. In f64 there is room for both.
    ///
    /// **Listed pairs.** Positions are rounded both there and here, so the allowance for rounding counts twice. The second half
    /// covers that here both positions and their difference are rounded (3·1.8Mu), and the squares are (8ur). For points in f64
    /// positions are rounded relative to a group, which its slack covers, and those at the begin of its range of times are
    /// compared, which is a little before the first time. Until then a pair moves by a share of what it moves in the range: along
    /// an axis, at most 2M' in the group, and 2M and the drift in the other block, less than 6 (M + M') altogether.
    pub(super) fn for_certificate(mut self, listed_within: f32) -> Sweep<'a, C> {
        let magnitude = magnitude(&self.slices) + self.criteria.images.longest();
        let segments = self.segments + usize::from(self.criteria.images.any());
        self.criteria.allowance = C::rounding(segments, magnitude, self.motion);
        let rounding = self.criteria.allowance.added_to(listed_within) - f64::from(listed_within);
        // NaN for lists of all pairs, which counts as the greatest distance there is.
        self.criteria.excluded_within = Some(f64::from(listed_within) - 2.0 * rounding);
        self
    }

    /// The lowest id, of a point that exists at some time of the interval, that has none of these radii.
    pub(super) fn lowest_without(&self, radii: Radii<'_>) -> Option<RadiusOf> {
        let without = |slices: &[SweptSlice<'a, C>], radii: &[f32], of: fn(u32) -> RadiusOf| {
            let lowest = |ids: Vec<u32>| ids.into_iter().filter(|&id| id as usize >= radii.len()).min();
            ids_of(slices).filter_map(lowest).min().map(of)
        };
        let slices_of_own = &self.slices[..self.own];
        let slices_of_others = if self.among.is_some() { &self.slices[self.own..] } else { slices_of_own };
        let of_own = radii.own().and_then(|own| without(slices_of_own, own, RadiusOf::Point));
        of_own.or_else(|| radii.others().and_then(|others| without(slices_of_others, others, RadiusOf::Listed)))
    }

    /// With each pair in the list of the lower id only.
    pub(super) fn pairs_once(mut self, pairs_once: bool) -> Sweep<'a, C> {
        self.criteria.pairs_once = pairs_once;
        self
    }

    /// Shows all points and their encounters to visitors, one for each share of the points, whose order is always the
    /// same.
    pub(super) fn run<V: EncounterVisitor + Send>(&self, start: impl Fn() -> V + Sync) -> Vec<V> {
        self.run_shares(0..self.shares(), start)
    }

    /// The number of shares of the points.
    pub(super) fn shares(&self) -> usize {
        self.groups.len().div_ceil(SHARE)
    }

    /// The same for some of the shares.
    pub(super) fn run_shares<V>(&self, shares: Range<usize>, start: impl Fn() -> V + Sync) -> Vec<V>
    where
        V: EncounterVisitor + Send,
    {
        parallel::map(shares.len(), |share| {
            let share = shares.start + share;
            let groups = &self.groups[share * SHARE..self.groups.len().min((share + 1) * SHARE)];
            let mut worker = Worker::new(start());
            self.work(groups, &mut worker);
            worker.visitor
        })
    }

    /// Whether no two points of a set have the same id for certain.
    pub(super) fn has_distinct_ids(&self) -> bool {
        self.tree.distinct && self.among.is_none_or(|among| among.distinct)
    }

    /// Whether each id comes up once, as that of a point and as that of another which it meets.
    pub(super) fn ids_come_up_once(&self) -> bool {
        let differ = |slices: &[SweptSlice<'a, C>]| {
            let mut ids: Vec<u32> = ids_of(slices).flatten().collect();
            ids.sort_unstable();
            ids.is_sorted_by(|a, b| a < b)
        };
        let (own, others) = self.slices.split_at(self.own);
        self.undivided && (self.has_distinct_ids() || differ(own) && differ(others))
    }

    /// The ids of all points that exist at some time of the interval; some several times.
    pub(super) fn ids(&self) -> Vec<u32> {
        ids_of(&self.slices[..self.own]).flatten().collect()
    }

    /// The number of groups of points.
    pub(super) fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Shows the points of one group to a visitor.
    pub(super) fn run_group<V: EncounterVisitor>(&self, group: usize, worker: &mut Worker<V, C>) {
        self.work(&self.groups[group..=group], worker);
    }

    /// Shows them all to one visitor, in the same order.
    pub(super) fn run_on_one_thread<V: EncounterVisitor>(&self, worker: &mut Worker<V, C>) {
        self.work(&self.groups, worker);
    }

    fn work<V: EncounterVisitor>(&self, groups: &[(usize, usize)], worker: &mut Worker<V, C>) {
        dispatch(self.tree.simd, Share { sweep: self, groups, worker });
    }

    /// The times during which points of two slices are compared. Slices of the same set are not in different segments.
    fn window(&self, a: &SweptSlice<'a, C>, b: &SweptSlice<'a, C>) -> Window {
        // What is at rest is where it is in any segment.
        let segments = [a.segment.or(b.segment), b.segment.or(a.segment)];
        let segments =
            segments.map(|segment| segment.unwrap_or((1, 0))).map(|(keys, number)| Segment::new(keys, number));
        Window::of_segments(segments, self.times).reported_by([a.reports, b.reports])
    }
}

/// The ids of the points of each tree that exist at some time of its slice. (Points at rest have one tree, which may come up in as
/// many slices as there are segments.)
fn ids_of<C: SweptCoordinate>(slices: &[SweptSlice<'_, C>]) -> impl Iterator<Item = Vec<u32>> {
    slices.chunk_by(SweptSlice::has_same_points).map(|slices| slices[0].ids())
}

/// The most by which displacements differ along an axis. Points of two sets with different keys pass only a part of theirs while
/// they are compared: so there it is the most by which any parts of displacements differ.
fn relative_motion<C: SweptCoordinate>(slices: &[SweptSlice<'_, C>], same_keys: bool) -> f64 {
    let [mut lo, mut hi] = if same_keys { [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]] } else { [[0.0; 3]; 2] };
    for [least, most] in slices.iter().map(|slice| slice.points().displacements()) {
        for axis in 0..3 {
            (lo[axis], hi[axis]) = (lesser(lo[axis], least[axis]), greater(hi[axis], most[axis]));
        }
    }
    (0..3).fold(0.0, |most, axis| greater(most, hi[axis] - lo[axis]))
}

/// A visitor, and memory for what is shown to it.
pub(super) struct Worker<V, C> {
    pub(super) visitor: V,
    group: SweptGroup<C>,
    /// A point of the group, where its points are searched for one by one.
    alone: SweptGroup<C>,
    candidates: SweptCandidates<C>,
    filter: PairFilter,
}

impl<V, C: SweptCoordinate> Worker<V, C> {
    pub(super) fn new(visitor: V) -> Worker<V, C> {
        Worker {
            visitor,
            group: SweptGroup::default(),
            alone: SweptGroup::default(),
            candidates: SweptCandidates::default(),
            filter: PairFilter::default(),
        }
    }
}

/// A share of the groups.
struct Share<'a, V, C: SweptCoordinate> {
    sweep: &'a Sweep<'a, C>,
    groups: &'a [(usize, usize)],
    worker: &'a mut Worker<V, C>,
}

/// Adds all candidates of a group, of one pairing; see [`AddCandidates`].
struct AddAll<'a, C: SweptCoordinate> {
    sweep: &'a Sweep<'a, C>,
    pairing: &'a Pairing,
    group: &'a SweptGroup<C>,
    candidates: &'a mut SweptCandidates<C>,
    criteria: &'a Criteria<'a>,
    most: usize,
}

impl<C: SweptCoordinate> Kernel for AddAll<'_, C> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let AddAll { sweep, pairing, group, candidates, criteria, most } = self;
        let slice = &sweep.slices[pairing.own];
        candidates.clear();
        for &other in &pairing.others {
            let reach = sweep.reaches.get(other).map_or(&[][..], |reach| &reach.nodes);
            let excess = sweep.excesses.get(other).map_or(&[][..], |excess| &excess.nodes);
            let behind = Behind { reach, excess };
            let other = &sweep.slices[other];
            let (candidates, window) = (&mut *candidates, sweep.window(slice, other));
            let all = match other.tree {
                SweptTree::Static(tree) => {
                    s.call(AddCandidates { candidates, tree, group, window, behind, criteria, most })
                }
                SweptTree::Moving(tree) => {
                    s.call(AddCandidates { candidates, tree, group, window, behind, criteria, most })
                }
            };
            if !all {
                return false;
            }
        }
        true
    }
}

impl<V: EncounterVisitor, C: SweptCoordinate> Kernel for Share<'_, V, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Share { sweep, groups, worker: Worker { visitor, group, alone, candidates, filter } } = self;
        for &(number, node) in groups {
            let pairing = &sweep.pairings[number];
            let mut excess = sweep.excess;
            if let Some(excesses) = sweep.excesses.get(pairing.own) {
                excess += f64::from(excesses.nodes[node].into_iter().fold(0.0, f32::max));
            }
            let slice = &sweep.slices[pairing.own];
            match slice.tree {
                SweptTree::Static(tree) => s.call(TakeGroup { group, tree, node, times: pairing.times, excess }),
                SweptTree::Moving(tree) => s.call(TakeGroup { group, tree, node, times: pairing.times, excess }),
            }
            let mut wanted = group.blocks.iter().flat_map(|block| block.points.id);
            if !wanted.any(|id| visitor.wants(id)) {
                continue;
            }
            let first_time = pairing.times[0];
            let mut criteria = Criteria { first_time, ..sweep.criteria };
            // It holds for positions at the first time of all only.
            criteria.excluded_within = criteria.excluded_within.filter(|_| f64::from(first_time) == sweep.times[0]);
            for block in &group.blocks {
                criteria.own = criteria.own.max(criteria.greatest(&block.points.id));
            }
            // Few points among many others lie far apart in a tree of their own, and one that has left the others lies far from
            // those that it shares a node with.
            let scattered = criteria.other_set && group.is_scattered(&criteria, sweep.most_reach);
            let lanes = group.blocks.len() * LANES;
            let most = if group.is_coarse(&criteria, sweep.most_reach) {
                0
            } else if scattered {
                MOST_BLOCKS * lanes
            } else {
                usize::MAX
            };
            if s.call(AddAll { sweep, pairing, group, candidates, criteria: &criteria, most }) {
                for block in &group.blocks {
                    if block.points.id.iter().any(|&id| visitor.wants(id)) {
                        s.call(ShowBlock { block, candidates, criteria: &criteria, filter, visitor });
                    }
                }
                continue;
            }
            for lane in 0..lanes {
                let own_excess = |points: &_| sweep.own_excess.map_or(0.0, |own| own.of(points));
                if !alone.take_one(group, (lane / LANES, lane % LANES), sweep.excess, own_excess) {
                    continue;
                }
                let block = &alone.blocks[0];
                criteria.own = criteria.greatest(&block.points.id);
                let (criteria, most) = (&criteria, usize::MAX);
                s.call(AddAll { sweep, pairing, group: alone, candidates, criteria, most });
                s.call(ShowBlock { block, candidates, criteria, filter, visitor });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::candidate_points::FourPoints;
    use super::super::encounter::EncounterLanes;
    use super::super::encounter_lists::EncounterLists;
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::point::layout::over_interval::PointPath;
    use crate::primitive::PointArrays;
    use crate::random::Random;
    use crate::{MovingPoint, PointParams, PointStructure, Precision};
    use glam::Vec3;

    /// Counts the encounters that are reported to it.
    struct Reported(usize);

    impl EncounterVisitor for Reported {
        const EXCLUDES_LISTED: bool = false;
        fn begin(&mut self, _own: &PointPath) {}
        fn visit<C: SweptCoordinate>(
            &mut self,
            _own: &PointPath,
            _others: &FourPoints<C>,
            encounters: &EncounterLanes,
        ) {
            self.0 += encounters.entering().count();
        }
    }

    /// How many encounters are reported, and the number of pairings.
    fn reported<C: SweptCoordinate>(tree: &PointTree, times: [f32; 2], radius: f32) -> [usize; 2] {
        let boxed = tree.box_tree(times);
        let sweep = Sweep::<C>::new((boxed.as_ref().unwrap_or(tree), None), times, radius.into(), [None; 2]);
        [sweep.run(|| Reported(0)).iter().map(|reported| reported.0).sum(), sweep.pairings.len()]
    }

    /// Whatever the time slices, a pair is reported once in a segment between keys: visitors see as many encounters as
    /// the merged lists have.
    #[test]
    fn an_encounter_is_reported_in_one_time_slice() {
        let mut random = Random(3);
        let mut random_vec = |by: f32| Vec3::from_array(core::array::from_fn(|_| random.signed() * by));
        let first: Vec<Vec3> = (0..600).map(|_| random_vec(1.0)).collect();
        // Some stand still, a few are fast.
        let speed = |i: usize| [0.0, 0.3, 0.3, if i.is_multiple_of(16) { 3.0 } else { 0.3 }][i % 4];
        let mut moved =
            |from: &[Vec3]| from.iter().enumerate().map(|(i, p)| *p + random_vec(speed(i))).collect::<Vec<_>>();
        let second = moved(&first);
        let third = moved(&second);
        let active = (0..600u16).map(|i| {
            let (begin, end) = [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0), (0.25, 0.75)][usize::from(i % 7 % 4)];
            TimeInterval::new(begin, end).unwrap()
        });
        let active: Vec<_> = active.collect();
        let mut divided = 0;
        for (keys, active) in [
            (&[&first[..], &second][..], &[][..]),
            (&[&first, &second], &active),
            (&[&first, &second, &third], &[]),
            (&[&first, &second, &third], &active),
        ] {
            for (begin, end) in [(0.0, 1.0), (0.25, 0.5), (0.3, 0.8)] {
                let interval = TimeInterval::new(begin, end).unwrap();
                let mut of_linear = None;
                for (structure, precision) in [
                    (PointStructure::Linear, Precision::Single),
                    (PointStructure::TimeSlices(2), Precision::Single),
                    (PointStructure::TimeSlices(8), Precision::Single),
                    (PointStructure::Automatic, Precision::Single),
                    (PointStructure::Kd, Precision::Single),
                    (PointStructure::Linear, Precision::Double),
                    (PointStructure::TimeSlices(8), Precision::Double),
                    (PointStructure::Automatic, Precision::Double),
                ] {
                    let params = PointParams { structure, precision, ..PointParams::default() };
                    let tree = PointTree::build(&PointArrays { keys, active, ids: &[] }, &params).unwrap();
                    for radius in [0.2, 9.0] {
                        let (keys, intervals) = (keys.len(), active.len());
                        let what = format!(
                            "{keys} keys, {intervals} intervals, {structure:?}, {precision:?}, radius {radius}"
                        );
                        let mut lists = EncounterLists::new();
                        tree.neighbor_lists_swept(interval, radius).run(&mut lists).unwrap();
                        let [reported, pairings] = match precision {
                            Precision::Double => reported::<f64>(&tree, [begin, end], radius),
                            _ => reported::<f32>(&tree, [begin, end], radius),
                        };
                        let found = lists.encounters().len();
                        if keys == 2 {
                            assert_eq!(reported, found, "{what}");
                        }
                        assert!(reported <= found * (keys - 1), "{what}: {reported} for {found}");
                        divided += usize::from(pairings > 1);
                        if radius < 1.0 {
                            assert_eq!(found, *of_linear.get_or_insert(found), "{what}");
                        }
                    }
                }
            }
        }
        assert!(divided > 40, "{divided}");
    }

    /// Points sixteen periods apart, whose nearest images are always within the radius: few others are as near.
    #[test]
    fn a_radius_beyond_all_distances_reaches_few_images() {
        let mut random = Random(6);
        let mut row = |by: f32| -> Vec<Vec3> {
            (0..24).map(|_| Vec3::from_array(core::array::from_fn(|_| random.signed() * by))).collect()
        };
        let (first, motion) = (row(7.5), row(0.2));
        let last: Vec<Vec3> = first.iter().zip(motion).map(|(&at, by)| at + by).collect();
        let points = PointArrays { keys: &[&first[..], &last], active: &[], ids: &[] };
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let images = Images::new::<f32>([Some(1.0); 3], (&tree, None)).unwrap();
        let radii = [f32::INFINITY; 24];
        for radii in [
            Radii::Equal(f32::INFINITY),
            Radii::Own(&radii),
            Radii::Larger { own: &radii, others: &radii },
            Radii::Sum { own: &radii, others: &radii },
        ] {
            let mut memory = [Vec::new(), Vec::new()];
            let radii = images.shortened(radii, &mut memory);
            let sweep = Sweep::<f32>::new((&tree, None), [0.0, 1.0], radii, [None; 2]).in_box(images);
            let reported: usize = sweep.run(|| Reported(0)).iter().map(|reported| reported.0).sum();
            // A sum is twice as long.
            let most = if matches!(radii, Radii::Sum { .. }) { 50 } else { 10 };
            assert!((24 * 23..most * 24 * 23).contains(&reported), "{reported}, {radii:?}");
        }
    }

    /// Ten points among many: far apart, as they are, each is searched for alone. In a tree of their own they are one group, whose
    /// box holds nearly all of the others.
    #[test]
    fn scattered_points_gather_little() {
        let mut random = Random(8);
        let mut set = |count: usize| -> Vec<MovingPoint> {
            let mut random_vec = |by: f32| Vec3::from_array(core::array::from_fn(|_| random.signed() * by));
            let moving = |_| {
                let at = random_vec(1.0);
                MovingPoint::new(at, at + random_vec(0.01))
            };
            (0..count).map(moving).collect()
        };
        let [many, few] = [20_000, 10].map(|count| PointTree::build(&set(count), &PointParams::default()).unwrap());
        let sweep = Sweep::<f32>::new((&few, Some(&many)), [0.0, 1.0], 0.1.into(), [None; 2]);
        let mut worker = Worker::new(Reported(0));
        sweep.run_on_one_thread(&mut worker);
        let found = (few.neighbor_lists_swept(TimeInterval::FULL, 0.1).among(&many)).collect().unwrap();
        assert_eq!(worker.visitor.0, found.encounters().len());
        assert!(worker.visitor.0 > 50);
        let gathered = worker.candidates.blocks.capacity();
        assert!(gathered < 800, "{gathered} of more than 1250 blocks");
    }
}
