//! The cost of temporal splits of a region, found by building them over samples of it.
//!
//! The samples are subtrees that stand for equal shares of the region's cost. Each tries one slice of a division, another one in
//! each sample, and compares its cost with that of the undivided tree during the same slice. Trees for the shortest slices come
//! first: no division costs a ray fewer steps, so they tell which ones are worth a trial at all.

use super::draft::{Draft, PresplitDecision};
use super::drafting::{DraftParams, WhenToReinsert, draft_tree};
use super::existence::{held_in, share_of_slices, slices_with};
use super::shared_leaves::SharedLeaves;
use super::time_slice::TimeSlice;
use crate::bvh::Reference;
use crate::limits::MAX_TIME_SLICES;
use crate::parallel;
use crate::params::Division;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use crate::tuning::slices::{
    ENOUGH, KEY_LATENCY_SHARE, LEAST_SAMPLE, MAX_FURTHER_TIME, MAX_SEPARATE_TIME, MAX_SPLIT_COST, MAX_TWO_SLICES_COST,
    NODE_BYTES_SHARE, NODE_LATENCY_SHARE, SAMPLED, SAMPLES,
};
use crate::tuning::wide::{BYTES_PER_REFERENCE, CACHED};
use std::sync::OnceLock;

/// The share of each trial of a division in the rest of the build, about.
const TRIAL: f64 = 0.02;

/// The division of a region that takes the least time; `None` if none pays. A region may grow by the factor `most`. Nobody knows
/// how many trials there will be, so each takes a share of what is left of `progress`.
pub(super) fn decide<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    region: u32,
    most: f32,
    params: &DraftParams,
    progress: &Progress,
) -> Option<Trial> {
    let samples = Samples::new(set, draft, region, params, progress);
    if samples.changing.is_empty() {
        return None;
    }
    let mut search = Search { least: samples.least_cost(), most, samples, best: None, limit: MAX_SPLIT_COST };
    let two = search.try_kind(Division::SharedLeaves);
    match search.best {
        None if two.is_none_or(|two| two > MAX_TWO_SLICES_COST && !gains_in_short_slices(set)) => return None,
        // A tree that exceeds the caches already slows down by more than others when it grows.
        None if draft.references.len() as f32 * BYTES_PER_REFERENCE > CACHED as f32 => search.limit *= MAX_FURTHER_TIME,
        None => {}
        // Bent motion is divided for its chords, and what comes and goes is left out: shared leaves do either nearly as well.
        Some(Trial { time, .. }) if gains_in_short_slices(set) => search.limit = MAX_SEPARATE_TIME * time,
        Some(Trial { time, .. }) => search.limit = MAX_FURTHER_TIME * time,
    }
    search.try_kind(Division::SeparateTrees);
    search.best
}

/// A division that was tried: its cost in steps and tests, and its time, relative to none.
#[derive(Clone, Copy)]
pub(super) struct Trial {
    pub division: Division,
    pub cost: f32,
    pub time: f32,
}

/// The search for the best division.
struct Search<'a, S> {
    samples: Samples<'a, S>,
    /// The factor by which the region may grow.
    most: f32,
    /// The cost of trees for the shortest slices, relative to none.
    least: f32,
    best: Option<Trial>,
    /// The next one must take less time than this.
    limit: f32,
}

impl<S: PrimitiveSet> Search<'_, S> {
    /// Tries more and more slices as long as that pays. Some sets may gain in short slices only, so the shortest slices are tried
    /// then, and twice as long ones. Returns the cost of two slices if they were tried.
    fn try_kind(&mut self, kind: fn(usize) -> Division) -> Option<f32> {
        let mut two = None;
        // The first step may fall a little short.
        let mut last = 1.1 * MAX_SPLIT_COST;
        for count in [2, 4, 8, MAX_TIME_SLICES] {
            let Some(Trial { cost, time, .. }) = self.try_division(kind(count), count) else { continue };
            if count == 2 {
                two = Some(cost);
            }
            if time >= last {
                if count == 2 && gains_in_short_slices(self.samples.set) {
                    for count in [MAX_TIME_SLICES, MAX_TIME_SLICES / 2] {
                        self.try_division(kind(count), count);
                    }
                }
                break;
            }
            last = time;
        }
        two
    }

    /// Tries a division into so many slices, unless it is too large or cannot cost little enough.
    fn try_division(&mut self, division: Division, count: usize) -> Option<Trial> {
        let share = self.samples.share_of_slices(count);
        let fits = growth(division, NODE_BYTES_SHARE, share) <= self.most;
        // Once a division has paid, the estimate may fall a little short too.
        let limit = if self.best.is_some() { 1.1 * self.limit } else { self.limit };
        let latency = latency(division, self.samples.keys);
        if !fits || latency * self.least_cost(count) >= limit || self.samples.progress.cancelled() {
            return None;
        }
        let cost = self.samples.cost(division);
        let trial = Trial { division, cost, time: latency * cost };
        if trial.time < self.limit {
            self.best = Some(trial);
            self.limit = trial.time;
            if let Division::SeparateTrees(_) = division {
                self.limit *= MAX_FURTHER_TIME;
            }
        }
        Some(trial)
    }

    /// What so many slices cost at least. Boxes exceed those for an instant by lengths that are proportional to the duration of a
    /// slice, if motion is straight, so their areas by at most its square.
    fn least_cost(&self, count: usize) -> f32 {
        let further = if self.samples.set.bent() { 0.0 } else { (1.0 - self.least).max(0.0) };
        self.least + further / (count * count) as f32
    }
}

/// Whether primitives may gain in short time slices though they gain nothing in halves of the shutter: motion that turns around
/// fills the same boxes in each half, and what exists for half of the shutter may exist in both.
fn gains_in_short_slices<S: PrimitiveSet>(set: &S) -> bool {
    set.bent() || !set.always_active()
}

/// The factor by which a division multiplies a tree's bytes, if nodes are this share of them, and each slice has a share of the
/// primitives.
fn growth(division: Division, nodes: f32, share: f32) -> f32 {
    match division {
        Division::Automatic | Division::Whole => 1.0,
        Division::SharedLeaves(count) => 1.0 + nodes * (count as f32 * share - 1.0),
        Division::SeparateTrees(count) => count as f32 * share,
    }
}

/// The time of a step or test with a division of primitives that have so many keys on average, relative to none. It is longer in a
/// larger tree because of cache misses. The fourth root was measured for single rays on coherent, debris, needles, needles30 and
/// tornado, 10 to 280 MB. With more keys leaf blocks are a larger part of the tree, which hierarchies share, and of which separate
/// trees hold the keys of their slices ("What growing costs, by keys" in docs/notes_rays.md). Where primitives come and go, trees
/// grow less, but rays at other times read other blocks all the same ("Active intervals" in docs/notes_rays.md).
fn latency(division: Division, keys: f32) -> f32 {
    let nodes = NODE_LATENCY_SHARE / (NODE_LATENCY_SHARE + KEY_LATENCY_SHARE * keys);
    let grown = match division {
        Division::SeparateTrees(count) => count as f32 * (nodes + (1.0 - nodes) * keys_in_slice(keys, count) / keys),
        _ => growth(division, nodes, 1.0),
    };
    grown.sqrt().sqrt()
}

/// The number of keys that a tree for one of equal slices holds of a primitive: one more than the motion segments in the slice.
fn keys_in_slice(keys: f32, count: usize) -> f32 {
    1.0 + ((keys - 1.0) / count as f32).max(1.0)
}

/// Samples of a region in which its divisions are tried.
struct Samples<'a, S> {
    set: &'a S,
    draft: &'a Draft,
    region: u32,
    params: &'a DraftParams,
    /// The subtrees that change during the shutter.
    changing: Vec<u32>,
    /// How many shares of the cost each of them stands for, and how many those that do not change.
    shares: Vec<f32>,
    unchanged: f32,
    /// The mean number of keys, at least two, of the primitives in those that change.
    keys: f32,
    /// Their costs with shared leaves for 1, 2, 4, 8 and 16 slices, as far as they were needed.
    shared: [OnceLock<Vec<f32>>; MAX_TIME_SLICES.ilog2() as usize + 1],
    /// The share of the cost of nodes that are larger than samples, which gain nothing from straight motion. From bent motion they
    /// do: it makes all boxes larger, not only those of neighbours that separate. And if less exists, fewer nodes are above it.
    above: f32,
    progress: &'a Progress<'a>,
}

impl<'a, S: PrimitiveSet> Samples<'a, S> {
    fn new(
        set: &'a S,
        draft: &'a Draft,
        region: u32,
        params: &'a DraftParams,
        progress: &'a Progress<'a>,
    ) -> Samples<'a, S> {
        let (samples, most) = samples(draft, region);
        let changes = |&&(x, _): &&(u32, f32)| draft.changes(set, x);
        let (changing, shares): (Vec<u32>, Vec<f32>) = samples.iter().filter(changes).copied().unzip();
        let unchanged = samples.iter().filter(|sample| !changes(sample)).map(|(_, shares)| shares).sum();
        let keys = mean_keys(set, changing.iter().flat_map(|&x| draft.references(&draft.binary[x as usize])));
        let above = if gains_in_short_slices(set) {
            0.0
        } else {
            cost_above(draft, region, most) / draft.collapse.cost(region)
        };
        Samples {
            set,
            draft,
            region,
            params,
            changing,
            shares,
            unchanged,
            keys,
            shared: Default::default(),
            above,
            progress,
        }
    }

    /// The cost of trees for the shortest slices, relative to no division.
    fn least_cost(&self) -> f32 {
        self.separate_trees(MAX_TIME_SLICES, self.params)
    }

    /// The cost of a division, relative to none.
    fn cost(&self, division: Division) -> f32 {
        match division {
            Division::SharedLeaves(count) => {
                let costs = self.shared_leaves(count);
                self.relative(|i| {
                    let (slices, existing) = self.slices(i, count);
                    [existing * costs[i], self.whole(i, count, &slices)]
                })
            }
            Division::SeparateTrees(count) => {
                let params = self.params.of_each_tree(count, self.share_of_slices(count));
                self.separate_trees(count, &params)
            }
            Division::Automatic | Division::Whole => 1.0,
        }
    }

    /// The mean cost of each sample during the slices that are tried in it, with shared leaves.
    fn shared_leaves(&self, count: usize) -> &[f32] {
        self.shared[count.ilog2() as usize].get_or_init(|| {
            let (samples, progress) = (self.changing.len(), self.progress.rest(TRIAL));
            let progress = progress.in_units(samples);
            parallel::map(samples, |i| {
                self.shared_leaves_in(i, count, &self.slices(i, count).0, &progress.subtask(1.0))
            })
        })
    }

    /// The mean cost of a sample during some of `count` slices, with shared leaves.
    fn shared_leaves_in(&self, i: usize, count: usize, slices: &[usize], progress: &Progress) -> f32 {
        SharedLeaves::build(self.set, self.draft, self.changing[i], count, slices, progress).cost()
    }

    /// The cost of separate trees for some of `count` slices, relative to no division. Whether long triangles are pre-split is
    /// decided in the first tree.
    ///
    /// If primitives come and go, more may exist in these slices than in others; then separate trees are compared with shared
    /// leaves there, whose cost is known for all slices.
    fn separate_trees(&self, count: usize, params: &DraftParams) -> f32 {
        let shared = if self.set.always_active() { &[] } else { self.shared_leaves(count) };
        let progress = self.progress.rest(TRIAL);
        let progress = progress.in_units(self.changing.len());
        let costs = |i: usize, mut decided: Option<PresplitDecision>| {
            let progress = progress.subtask(1.0);
            let (ids, (slices, existing)) = (self.draft.primitives_below(self.changing[i]), self.tree_slices(i, count));
            let mut sum = 0.0;
            for &index in &slices {
                let slice = TimeSlice { index, of: count };
                let params = DraftParams { decided, ..*params };
                let held = held_in(self.set, &ids, slice);
                let (density, progress) = (Some(self.draft.density), progress.subtask(1.0 / slices.len() as f64));
                let draft = draft_tree(self.set, &held, slice, &params, density, WhenToReinsert::Later, &progress);
                let Some(draft) = draft else { return ([1.0; 2], decided) };
                sum += draft.collapse.total();
                decided = Some(draft.decided());
            }
            let mut mean = sum / slices.len() as f32;
            if let Some(cost) = shared.get(i) {
                let there = self.shared_leaves_in(i, count, &slices, &progress);
                mean *= if there > 0.0 { cost / there } else { 1.0 };
            }
            ([existing * mean, self.whole(i, count, &slices)], decided)
        };
        let (first, decided) = costs(0, params.decided);
        self.relative(|i| if i == 0 { first } else { costs(i, decided).0 })
    }

    /// The mean ratio of two costs of each sample.
    fn relative(&self, each: impl Fn(usize) -> [f32; 2] + Sync) -> f32 {
        let costs = parallel::map(self.changing.len(), each);
        let changing: f32 =
            costs.iter().zip(&self.shares).map(|([with, without], shares)| shares * with / without).sum();
        let below = (changing + self.unchanged) / (self.shares.iter().sum::<f32>() + self.unchanged);
        self.above + (1.0 - self.above) * below
    }

    /// The mean cost of a sample during some of `count` slices, without a division: boxes may be larger at the ends of the shutter
    /// than in its middle.
    fn whole(&self, i: usize, count: usize, slices: &[usize]) -> f32 {
        let cost = |&index: &usize| self.draft.cost_during(self.changing[i], TimeSlice { index, of: count });
        slices.iter().map(cost).sum::<f32>() / slices.len() as f32
    }

    /// The slices of `count` that are tried in sample `i`, another one in each, spread evenly; two in a single sample. If
    /// primitives come and go, all in which something of the sample exists. And the share of the slices for which these stand.
    fn slices(&self, i: usize, count: usize) -> (Vec<usize>, f32) {
        let existing = slices_with(self.set, self.references(self.changing[i]), count);
        let share = existing.len() as f32 / count as f32;
        (if self.set.always_active() { self.spread(i, &existing) } else { existing }, share)
    }

    /// The slices for which separate trees are tried: those in the middle half of the shutter. The primitives of a sample are
    /// neighbours in the middle of the shutter and disperse before and after; a tree for a slice finds other neighbours. If
    /// primitives come and go, in the middle half of the slices in which something of the sample exists.
    fn tree_slices(&self, i: usize, count: usize) -> (Vec<usize>, f32) {
        let existing = slices_with(self.set, self.references(self.changing[i]), count);
        let quarter = existing.len() / 4;
        (self.spread(i, &existing[quarter..existing.len() - quarter]), existing.len() as f32 / count as f32)
    }

    fn spread(&self, i: usize, slices: &[usize]) -> Vec<usize> {
        let samples = self.changing.len();
        let all = samples.max(2);
        (i..all).step_by(samples).map(|i| slices[(2 * i + 1) * slices.len() / (2 * all)]).collect()
    }

    /// The references below a node.
    fn references(&self, x: u32) -> &[Reference] {
        self.draft.references(&self.draft.binary[x as usize])
    }

    /// The mean share of slices in which a primitive of the region exists.
    fn share_of_slices(&self, count: usize) -> f32 {
        share_of_slices(self.set, self.references(self.region).iter().map(Reference::id), count)
    }
}

/// The mean number of keys of some primitives, each at least two.
fn mean_keys<'a, S: PrimitiveSet>(set: &S, references: impl Iterator<Item = &'a Reference>) -> f32 {
    let (all, keys) = references.fold((0, 0), |(n, keys), r| (n + 1, keys + set.leaf_kind(r.id()).max(2)));
    if all > 0 { keys as f32 / all as f32 } else { 2.0 }
}

/// Subtrees of a region to decide on, each in the middle of one or more equal shares of its cost; and their greatest size.
fn samples(draft: &Draft, region: u32) -> (Vec<(u32, f32)>, u32) {
    let n = draft.binary[region as usize].count as usize;
    let all = (n / *SAMPLED.end()).max(ENOUGH.min(n / *SAMPLED.start())).max(n.min(2 * LEAST_SAMPLE));
    let count = (all / LEAST_SAMPLE).clamp(1, SAMPLES);
    let most = (all / count) as u32;
    let at = |i: usize| (i as f32 + 0.5) / count as f32;
    let mut samples: Vec<(u32, f32)> = Vec::with_capacity(count);
    for x in (0..count).map(|i| descend_by_cost(draft, region, at(i), most)) {
        match samples.last_mut() {
            Some((last, shares)) if *last == x => *shares += 1.0,
            _ => samples.push((x, 1.0)),
        }
    }
    (samples, most)
}

/// The cost of a subtree but for its subtrees of at most `most` references.
fn cost_above(draft: &Draft, of: u32, most: u32) -> f32 {
    let (mut below, mut stack) = (0.0, vec![of]);
    while let Some(x) = stack.pop() {
        let node = &draft.binary[x as usize];
        if node.count <= most || node.right == 0 {
            below += draft.collapse.cost(x);
        } else {
            stack.extend([x + 1, x + node.right]);
        }
    }
    (draft.collapse.cost(of) - below).max(0.0)
}

/// The subtree of at most `most` references at a fraction of the cost of a subtree; or its leaf.
fn descend_by_cost(draft: &Draft, mut x: u32, mut at: f32, most: u32) -> u32 {
    loop {
        let node = &draft.binary[x as usize];
        if node.count <= most || node.right == 0 {
            return x;
        }
        let share = draft.low_share(x);
        (x, at) = if at < share { (x + 1, at / share) } else { (x + node.right, (at - share) / (1.0 - share)) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::WideParams;
    use crate::scene;

    fn params() -> DraftParams {
        DraftParams::new(WideParams::default())
    }

    #[test]
    fn samples_lie_in_the_middle_of_equal_shares_of_the_cost() {
        let (_, draft) = Draft::of_scene(&scene::mixed(60_000));
        let (found, most) = samples(&draft, 0);
        assert_eq!(found.iter().map(|(_, shares)| shares).sum::<f32>(), SAMPLES as f32);
        let mut share = 0.0;
        for (x, shares) in found {
            assert!(draft.binary[x as usize].count <= most);
            // The share of the cost on the left of the sample, and its own, as the descent counts them.
            let (mut at, mut before, mut own) = (0, 0.0, 1.0);
            while at != x {
                let right = at + draft.binary[at as usize].right;
                let [low, high] = [at + 1, right].map(|child| draft.collapse.cost(child));
                if x < right {
                    (at, own) = (at + 1, own * low / (low + high));
                } else {
                    (at, before, own) = (right, before + own * low / (low + high), own * high / (low + high));
                }
            }
            for middle in [share + 0.5, share + shares - 0.5].map(|middle| middle / SAMPLES as f32) {
                assert!(before <= middle + 1e-5 && middle <= before + own + 1e-5, "{x}: {before} {own} {middle}");
            }
            share += shares;
        }
        assert!(cost_above(&draft, 0, most) > 0.0 && cost_above(&draft, 0, u32::MAX) == 0.0);
    }

    #[test]
    fn samples_try_slices_evenly_and_separate_trees_those_in_the_middle() {
        let scene = scene::tornado(60_000);
        let (set, draft) = Draft::of_scene(&scene);
        let (params, progress) = (params(), Progress::new(None));
        let samples = Samples::new(&set, &draft, 0, &params, &progress);
        let tried = |count: usize| (0..SAMPLES).flat_map(|i| samples.slices(i, count).0).collect::<Vec<_>>();
        assert_eq!([tried(2), tried(4), tried(8)], [vec![0, 0, 1, 1], vec![0, 1, 2, 3], vec![1, 3, 5, 7]]);
        let trees = |count: usize| (0..SAMPLES).flat_map(|i| samples.tree_slices(i, count).0).collect::<Vec<_>>();
        assert_eq!([trees(2), trees(4), trees(8)], [vec![0, 0, 1, 1], vec![1, 1, 2, 2], vec![2, 3, 4, 5]]);
        let single = Samples { changing: samples.changing[..1].to_vec(), shares: vec![1.0], ..samples };
        assert_eq!([single.slices(0, 2).0, single.slices(0, 16).0], [vec![0, 1], vec![4, 12]]);
    }

    #[test]
    fn growing_costs_less_the_more_keys_there_are() {
        for count in [2, 4, 8, 16] {
            let kinds = [Division::SharedLeaves(count), Division::SeparateTrees(count)];
            let [shared, separate] = kinds.map(|kind| [2.0, 9.0, 33.0].map(|keys| latency(kind, keys).powi(4)));
            // Of two keys, nodes are four fifths.
            let of_two = [(shared[0], 0.2 + 0.8 * count as f32), (separate[0], count as f32)];
            assert!(of_two.iter().all(|(found, expected)| (found / expected - 1.0).abs() < 1e-5), "{of_two:?}");
            assert!(
                [shared, separate].iter().all(|of| of.is_sorted_by(|more, less| more > less)),
                "{shared:?} {separate:?}"
            );
            for keys in [2, 3, 5, 9, 17, 33] {
                let [first, last] = TimeSlice { index: 0, of: count }.segments(keys);
                assert_eq!(keys_in_slice(keys as f32, count), (last - first + 2) as f32, "{keys} keys");
            }
        }
        assert_eq!(latency(Division::Whole, 9.0), 1.0);
    }

    /// The mean area of a box over time is the mean of those over slices; its volume is taken at the middle.
    #[test]
    fn the_cost_during_slices_adds_up_to_the_cost_of_the_whole() {
        let (_, draft) = Draft::of_scene(&scene::mixed(20_000));
        let whole = draft.collapse.total();
        for of in [1, 2, 8] {
            let slices = (0..of).map(|index| draft.cost_during(0, TimeSlice { index, of }));
            let mean = slices.sum::<f32>() / of as f32;
            assert!((mean / whole - 1.0).abs() < 0.05, "{of}: {mean} instead of {whole}");
        }
    }

    #[test]
    fn some_of_the_slices_with_shared_leaves_are_those_of_all() {
        let (set, draft) = Draft::of_scene(&scene::tornado(4000));
        let costs = |slices: &[usize]| {
            let shared = SharedLeaves::build(&set, &draft, 0, 4, slices, &Progress::new(None));
            shared.trees.iter().map(|tree| tree.collapse.total()).collect::<Vec<_>>()
        };
        let all = costs(&[0, 1, 2, 3]);
        assert_eq!(costs(&[0, 3]), [all[0], all[3]]);
        assert_eq!(costs(&[2]), [all[2]]);
    }

    /// Trials tell what the whole would cost: two trees of the tornado's dust, each built over everything.
    #[test]
    fn trials_of_samples_predict_the_cost_of_the_whole() {
        let (set, draft) = Draft::of_scene(&scene::tornado(60_000));
        let params = params();
        let ids = draft.primitives_below(0);
        for count in [2, 4] {
            let predicted =
                Samples::new(&set, &draft, 0, &params, &Progress::new(None)).cost(Division::SeparateTrees(count));
            let tree = |index: usize| {
                let params = params.of_each_tree(count, 1.0);
                draft_tree(
                    &set,
                    &ids,
                    TimeSlice { index, of: count },
                    &params,
                    Some(draft.density),
                    WhenToReinsert::Later,
                    &Progress::new(None),
                )
                .expect("a draft")
                .collapse
                .total()
            };
            let actual = (0..count).map(tree).sum::<f32>() / count as f32 / draft.collapse.total();
            assert!((0.75..1.4).contains(&(predicted / actual)), "{count}: {predicted} instead of {actual}");
        }
    }
}
