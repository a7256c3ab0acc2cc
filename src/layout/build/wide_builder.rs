//! The build of a wide tree from primitives.
//!
//! There are two groups of primitives: triangles, whose corners are in leaf blocks, and others, which leaves list
//! (spheres, whose positions follow such a list, and custom primitives). If nothing else keeps the budget, each kind of both
//! is a group. Each group is first drafted: the binary tree and its collapse are made (`time/drafting.rs`), and the subtrees
//! that get a temporal split are chosen (`time/regions.rs`). Those are written first, each below a time node of its own; then
//! the rest of the tree, in which they are children like leaf blocks.

use super::budget::{ATTEMPTS, allowed_bytes, further_key_bytes, with_less};
use super::write::{Nodes, set_children, words_of_nodes, write_blocks, write_node, write_time};
use crate::bvh::{BinaryNode, Reference, ReplacedSubtree};
use crate::error::BuildError;
use crate::geometry::{LinearBox3, TimeInterval};
use crate::layout::leaf::keyed::KeyedRows;
use crate::layout::leaf::source::WideSource;
use crate::layout::wide_node::ChildRef;
use crate::layout::wide_tree::WideTree;
use crate::parallel;
use crate::params::{Division, WideParams};
use crate::progress::Progress;
use crate::simd::{Arena, LANES, fill, huge_vec};
use crate::time::{
    Draft, DraftParams, Region, SharedLeaves, TimeSlice, WhenToReinsert, any_changes, any_is_left_out, draft_sample,
    draft_tree, held_in, regions, share_of_slices,
};
use crate::tuning::lazy::NEIGHBOURS;
use crate::tuning::slices::LEAST_TREELET;
use crate::tuning::wide::NEAR;

/// A written subtree: its bounds over the whole shutter, and its root.
struct WrittenTree {
    bounds: LinearBox3,
    root: ChildRef,
}

impl WideTree {
    /// Builds over all primitives of a set within the bytes that the parameters allow.
    pub fn build<S: WideSource>(set: &S, params: &WideParams, progress: &Progress) -> Result<WideTree, BuildError> {
        let mut held = huge_vec(set.len());
        fill(&mut held, set.len(), |id| id as u32);
        let hidden = set.hidden();
        if !hidden.is_empty() {
            held.retain(|id| hidden.binary_search(id).is_err());
        }
        let listed: Vec<u32> = held.extract_if(.., |id| set.is_listed(*id)).collect();
        let budget = allowed_bytes(params, set.len(), set.further_key_bytes());
        let of_tree = progress.subtask(1.0 - INDEXING);
        let mut tree = WideTree::fitted(set, [&held, &listed], &DraftParams::new(*params), budget, &of_tree)?;
        let bytes = tree.arena.bytes();
        if bytes > budget && !params.division.is_forced() {
            return Err(BuildError::OverBudget { bytes, budget });
        }
        drop(of_tree);
        progress.check()?;
        (tree.counts, tree.blocks) = tree.index_leaves(set);
        tree.near = tree.fine_within();
        tree.summarize_blocks(set);
        if tree.leaves_out {
            tree.existing = set.active_intervals();
        } else if !set.always_active() {
            tree.existing = set.intervals_of_keys();
            if tree.existing.iter().all(|&of| of == TimeInterval::FULL) {
                tree.existing = Vec::new();
            }
        }
        Ok(tree)
    }

    /// Builds over some primitives, mostly in spatial order, on one thread; the leaf blocks of single triangles are not
    /// recorded.
    ///
    /// The tree may be larger than the parameters allow. Fails only beyond the size that
    /// [`most_in_subtree`](super::budget::most_in_subtree) gives.
    pub(in crate::layout) fn subtree<S: WideSource>(
        set: &S,
        ids: &[u32],
        params: &DraftParams,
    ) -> Result<WideTree, BuildError> {
        parallel::alone(|| {
            // Several ascending runs, of which a merge sort is made.
            let mut ids = ids.to_vec();
            ids.sort();
            // The sample that decided may have been of others, which change.
            let mut params = *params;
            if params.wide.division != Division::Whole && !any_changes(set, &ids) {
                params.wide.division = Division::Whole;
            }
            let further = ids.iter().map(|&id| further_key_bytes(set, id)).sum();
            let budget = allowed_bytes(&params.wide, ids.len(), further);
            let (listed, held): (Vec<u32>, Vec<u32>) = ids.iter().partition(|&&id| set.is_listed(id));
            let fitted =
                |params: &DraftParams| WideTree::fitted(set, [&held, &listed], params, budget, &Progress::new(None));
            let mut tree = match fitted(&params) {
                // The division counts as forced, also where it was decided.
                Err(BuildError::TooLargeTree) => {
                    params.wide = WideParams { max_references: 1.0, division: Division::Whole, ..params.wide };
                    fitted(&params)?
                }
                built => built?,
            };
            tree.counts = tree.counted(set);
            tree.summarize_blocks(set);
            Ok(tree)
        })
    }

    /// Decides by a sample of a few neighbourhoods whether to pre-split, and on the temporal split: trying it with all primitives
    /// of a subtree would take several times as long as building it.
    pub(in crate::layout) fn decided<S: WideSource>(set: &S, sample: &[u32], params: &WideParams) -> DraftParams {
        parallel::alone(|| {
            let (draft, presplit) = draft_sample(set, sample, params);
            let params = DraftParams { wide: *params, decided: Some(presplit) };
            let division = match (params.wide.division, draft) {
                (Division::Automatic, Some(draft)) => division_of_most(set, &draft, &params),
                (Division::Automatic, None) => Division::Whole,
                (given, _) => given,
            };
            DraftParams { wide: WideParams { division, ..params.wide }, ..params }
        })
    }

    /// Builds over triangles and listed primitives within the allowed bytes, or else with as few as possible.
    fn fitted<S: WideSource>(
        set: &S,
        ids: [&[u32]; 2],
        params: &DraftParams,
        budget: usize,
        progress: &Progress,
    ) -> Result<WideTree, BuildError> {
        let primitives = ids.iter().map(|ids| ids.len()).sum();
        let mut wide = params.wide;
        for (attempt, share) in ATTEMPT.into_iter().enumerate() {
            let progress = progress.rest(share);
            let groups = ids.map(|ids| vec![ids]);
            let built = WideTree::unlimited(set, ids, &groups, &DraftParams { wide, ..*params }, &progress);
            let bytes = match &built {
                Ok(tree) => Some(tree.arena.bytes()),
                // More than an arena holds.
                Err(BuildError::TooLargeTree) => None,
                Err(_) => return built,
            };
            let smallest = attempt + 1 == ATTEMPTS && !set.kinds_differ();
            if bytes.is_some_and(|bytes| bytes <= budget) || params.wide.division.is_forced() || smallest {
                return built;
            }
            drop(built);
            wide = with_less(wide, bytes.map(|bytes| budget as f32 / bytes as f32), primitives, attempt);
        }
        // Blocks hold primitives of one kind. Where kinds lie among each other, blocks are filled poorly unless each kind has a
        // tree of its own.
        let sorted = ids.map(|ids| {
            let mut ids = ids.to_vec();
            ids.sort_by_key(|&id| set.leaf_kind(id));
            ids
        });
        let ids = sorted.each_ref().map(|ids| &ids[..]);
        let groups = ids.map(|ids| ids.chunk_by(|&a, &b| set.leaf_kind(a) == set.leaf_kind(b)).collect());
        WideTree::unlimited(set, ids, &groups, &DraftParams { wide, ..*params }, &progress.rest(1.0))
    }

    /// Builds over triangles and listed primitives without a limit. Each of their groups gets a tree of its own.
    fn unlimited<S: WideSource>(
        set: &S,
        ids: [&[u32]; 2],
        groups: &[Vec<&[u32]>; 2],
        params: &DraftParams,
        progress: &Progress,
    ) -> Result<WideTree, BuildError> {
        let mut tree = WideTree::empty(if set.triangles().is_some() { usize::MAX } else { 0 });
        let all = ids.iter().map(|ids| ids.len()).sum::<usize>() as f64;
        let mut subtrees = Vec::new();
        for (listed, groups) in groups.iter().enumerate() {
            for ids in groups.iter().filter(|ids| !ids.is_empty()) {
                let share = ids.len() as f64 / all;
                if listed > 0 {
                    // All blocks written from now on are lists.
                    tree.lists = tree.lists.min(tree.arena.len());
                }
                subtrees.push(tree.group(set, ids, params, &progress.subtask(share))?);
            }
        }
        tree.root = tree.join(subtrees)?;
        tree.keyed_rows = KeyedRows::of(set, ids[0], tree.slices);
        tree.arena.align();
        tree.arena.compact();
        Ok(tree)
    }

    /// Builds over the primitives of one group.
    fn group<S: WideSource>(
        &mut self,
        set: &S,
        ids: &[u32],
        params: &DraftParams,
        progress: &Progress,
    ) -> Result<WrittenTree, BuildError> {
        if let Division::SeparateTrees(count) = params.wide.division {
            return self.separate_trees(set, ids, count, params, progress);
        }
        let when = if params.wide.division == Division::Whole { WhenToReinsert::Now } else { WhenToReinsert::OfStatic };
        let may_divide = params.wide.division != Division::Whole && some_change(set, ids);
        let share = if may_divide { DRAFT_BEFORE_SLICES } else { DRAFT };
        let draft = draft_tree(set, ids, TimeSlice::WHOLE, params, None, when, &progress.subtask(share));
        let mut draft = draft.ok_or(BuildError::Cancelled)?;
        let regions = regions(set, &draft, params, LEAST_TREELET, progress);
        progress.check()?;
        if let [Region { node: 0, division: Division::SeparateTrees(count), .. }] = regions[..] {
            // The draft is dropped before the trees are made: holding one at a time takes less memory.
            drop(draft);
            let params = params.of_each_tree(count, share_of_slices(set, ids.iter().copied(), count));
            return self.separate_trees(set, ids, count, &params, &progress.rest(1.0));
        }
        let work = |region: &Region| f64::from(draft.binary[region.node as usize].count) * work(region.division);
        let mut left = draft.references.len() as f64 + regions.iter().map(work).sum::<f64>();
        let (mut replaced, mut roots) = (Vec::new(), Vec::new());
        for region in regions {
            let node = draft.binary[region.node as usize];
            let share = if region.node == 0 { 1.0 } else { work(&region) / left };
            left -= work(&region);
            let progress = progress.rest(share);
            let root = match region.division {
                Division::SeparateTrees(count) => {
                    let ids = draft.primitives_below(region.node);
                    let params = params.of_each_tree(count, share_of_slices(set, ids.iter().copied(), count));
                    self.separate_trees(set, &ids, count, &params, &progress)?.root
                }
                Division::SharedLeaves(count) => {
                    let slices: Vec<usize> = (0..count).collect();
                    let of_nodes = progress.subtask(SHARED_NODES);
                    let shared = SharedLeaves::build(set, &draft, region.node, count, &slices, &of_nodes);
                    drop(of_nodes);
                    progress.check()?;
                    self.write_shared_leaves(set, &draft, &shared, &progress)?
                }
                Division::Automatic | Division::Whole => continue,
            };
            if region.node == 0 {
                return Ok(WrittenTree { bounds: node.bounds, root });
            }
            replaced.push(ReplacedSubtree { node: region.node, cost: region.cost });
            roots.push((node.first, root));
        }
        draft.replace_subtrees(set, &mut replaced, progress);
        progress.check()?;
        self.write_draft(set, &draft, &roots, progress)
    }

    /// Builds a separate tree for each of equal time slices, over what exists in it.
    fn separate_trees<S: WideSource>(
        &mut self,
        set: &S,
        ids: &[u32],
        count: usize,
        params: &DraftParams,
        progress: &Progress,
    ) -> Result<WrittenTree, BuildError> {
        self.slices = self.slices.max(count);
        let mut written = Vec::with_capacity(count);
        for slice in (0..count).map(|index| TimeSlice { index, of: count }) {
            let held = held_in(set, ids, slice);
            self.leaves_out |= held.len() < ids.len();
            let progress = progress.subtask(1.0 / count as f64);
            let draft = draft_tree(set, &held, slice, params, None, WhenToReinsert::Now, &progress.subtask(DRAFT));
            let draft = draft.ok_or(BuildError::Cancelled)?;
            let before = self.arena.len();
            written.push(self.write_draft(set, &draft, &[], &progress)?);
            if slice.index == 0 {
                // The others will have about the same size; growing step by step would hold most of it twice.
                self.arena.reserve((self.arena.len() - before) * (count - 1) / 50 * 51);
            }
        }
        self.over_time(written)
    }

    /// Puts a time node above trees for equal time slices.
    fn over_time(&mut self, mut slices: Vec<WrittenTree>) -> Result<WrittenTree, BuildError> {
        if slices.len() == 1 {
            return Ok(slices.remove(0));
        }
        // Linear bounds of a slice are not valid outside it, so above the time node the boxes are swept.
        let swept = slices.iter().map(|slice| slice.bounds.swept()).reduce(|a, b| a.union(b));
        let roots: Vec<ChildRef> = slices.iter().map(|slice| slice.root).collect();
        let root = write_time(&mut self.arena, &roots)?;
        let bounds = swept.map_or(LinearBox3::EMPTY, |b| LinearBox3 { begin: b, end: b });
        Ok(WrittenTree { bounds, root })
    }

    /// Writes a draft; `replaced` are subtrees that are written already, with their first references, in order.
    fn write_draft<S: WideSource>(
        &mut self,
        set: &S,
        draft: &Draft,
        replaced: &[(u32, ChildRef)],
        progress: &Progress,
    ) -> Result<WrittenTree, BuildError> {
        self.presplit |= draft.presplit;
        let leaves = |arena: &mut Arena, of: &[BinaryNode], blocks: &mut [ChildRef]| {
            // A node that is too large for a block is a replaced subtree; those come first.
            let large = of.iter().take_while(|node| node.count as usize > LANES).count();
            for (node, root) in of[..large].iter().zip(&mut *blocks) {
                let at = replaced.binary_search_by_key(&node.first, |g| g.0);
                *root = replaced[at.expect("only a replaced subtree is larger than a block")].1;
            }
            leaf_blocks(arena, set, draft, &of[large..], &mut blocks[large..])
        };
        let (binary, collapse) = (&draft.binary, &draft.collapse);
        let nodes = Nodes { binary, collapse, over: draft.over, leaves: &leaves, writes: true, progress };
        Ok(WrittenTree { bounds: draft.binary[0].bounds, root: nodes.write(&mut self.arena)? })
    }

    /// Writes the leaf blocks once and the nodes above them for each time slice.
    fn write_shared_leaves<S: WideSource>(
        &mut self,
        set: &S,
        draft: &Draft,
        shared: &SharedLeaves,
        progress: &Progress,
    ) -> Result<ChildRef, BuildError> {
        self.presplit |= draft.presplit;
        // A block may be in a slice without some of its primitives, which its box there does not hold.
        let of_blocks = shared.leaves.iter().flat_map(|block| draft.references(block)).map(Reference::id);
        self.leaves_out |= any_is_left_out(set, of_blocks, shared.trees.len());
        let leaves =
            |arena: &mut Arena, of: &[BinaryNode], blocks: &mut [ChildRef]| leaf_blocks(arena, set, draft, of, blocks);
        // Room for everything at once: growing later would copy all leaf blocks.
        let further = shared.trees.iter().map(|tree| words_of_nodes(&tree.binary, &tree.collapse)).sum::<usize>();
        // The sizes of blocks of sub-references of one primitive are slightly too large.
        let mut words = Vec::new();
        fill(&mut words, shared.leaves.len(), |i| {
            let of = draft.references(&shared.leaves[i]);
            set.leaf_words(&Reference::ids(of)[..of.len()], draft.slice).next_multiple_of(LANES) as u32
        });
        let blocks =
            write_blocks(&mut self.arena, &shared.leaves, &words, further, &leaves, &progress.rest(SHARED_BLOCKS))?;
        let mut slices = Vec::new();
        let rest = progress.rest(1.0);
        for tree in &shared.trees {
            let progress = &rest.subtask(1.0 / shared.trees.len() as f64);
            let leaves = |_: &mut Arena, of: &[BinaryNode], known: &mut [ChildRef]| {
                for (node, block) in of.iter().zip(known) {
                    *block = blocks[tree.order[node.first as usize] as usize];
                }
                Ok(())
            };
            let (binary, collapse) = (&tree.binary, &tree.collapse);
            let nodes = Nodes { binary, collapse, over: tree.over, leaves: &leaves, writes: false, progress };
            slices.push(nodes.write(&mut self.arena)?);
        }
        write_time(&mut self.arena, &slices)
    }

    /// Puts a node above several trees.
    fn join(&mut self, mut subtrees: Vec<WrittenTree>) -> Result<ChildRef, BuildError> {
        while subtrees.len() > 1 {
            let mut joined = Vec::new();
            for some in subtrees.chunks(LANES) {
                let boxes: Vec<LinearBox3> = some.iter().map(|subtree| subtree.bounds).collect();
                let root = write_node(&mut self.arena, &boxes, TimeInterval::FULL)?;
                let refs: Vec<ChildRef> = some.iter().map(|subtree| subtree.root).collect();
                set_children(&mut self.arena, root, &refs);
                joined.push(WrittenTree { bounds: boxes.into_iter().fold(LinearBox3::EMPTY, LinearBox3::union), root });
            }
            subtrees = joined;
        }
        Ok(subtrees.first().map_or(ChildRef::NOTHING, |subtree| subtree.root))
    }
}

/// Shares of the steps of a build, about, for its progress: of the index of leaf blocks in the whole; of each attempt but one in
/// what is left, where most builds need only one; of the draft in an attempt, if nothing changes and if time slices may follow; of
/// hierarchies for shared leaves in their region, and of writing these leaves in the rest.
const INDEXING: f64 = 0.03;
const ATTEMPT: [f64; ATTEMPTS] = [0.95, 0.5, 0.5];
const DRAFT: f64 = 0.8;
const DRAFT_BEFORE_SLICES: f64 = 0.4;
const SHARED_NODES: f64 = 0.6;
const SHARED_BLOCKS: f64 = 0.7;

/// The work of writing a region, about, per reference; that of what is not divided is 1.
fn work(division: Division) -> f64 {
    match division {
        Division::Automatic | Division::Whole => 1.0,
        Division::SharedLeaves(count) => 1.0 + 0.3 * count as f64,
        Division::SeparateTrees(count) => 4.0 * count as f64,
    }
}

/// Whether any of a few evenly spaced primitives changes during the shutter.
fn some_change<S: WideSource>(set: &S, ids: &[u32]) -> bool {
    let few: Vec<u32> = ids.iter().step_by(ids.len() / 256 + 1).copied().collect();
    any_changes(set, &few)
}

/// The division of the largest region of a sample, if all regions together have at least half of it.
fn division_of_most<S: WideSource>(set: &S, draft: &Draft, params: &DraftParams) -> Division {
    let regions = regions(set, draft, params, NEIGHBOURS, &Progress::new(None));
    let count = |region: &Region| draft.binary[region.node as usize].count as usize;
    if 2 * regions.iter().map(count).sum::<usize>() < draft.references.len() {
        return Division::Whole;
    }
    regions.iter().max_by_key(|region| count(region)).map_or(Division::Whole, |region| region.division)
}

/// Writes leaf blocks. In large scenes their primitives come from memory, so the next ones are prefetched.
fn leaf_blocks<S: WideSource>(
    arena: &mut Arena,
    set: &S,
    draft: &Draft,
    of: &[BinaryNode],
    blocks: &mut [ChildRef],
) -> Result<(), BuildError> {
    let far = set.bytes() > NEAR;
    for (i, (node, block)) in of.iter().zip(blocks).enumerate() {
        if far {
            draft.prefetch(set, of, i, draft.over);
        }
        let of = draft.references(node);
        let ids = &mut Reference::ids(of)[..of.len()];
        // Sorted, so that a block does not depend on the order of references in the build.
        ids.sort_unstable();
        *block = set.write_leaf(arena, distinct(ids), draft.slice).ok_or(BuildError::TooLargeTree)?;
    }
    Ok(())
}

/// The sorted ids without duplicates: several sub-references of one primitive may be in one leaf block.
fn distinct(ids: &mut [u32]) -> &[u32] {
    let mut n = 0;
    for i in 0..ids.len() {
        if n == 0 || ids[i] != ids[n - 1] {
            ids[n] = ids[i];
            n += 1;
        }
    }
    &ids[..n]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{Scene, TriangleMesh, no_shapes};
    use crate::random::Random;

    /// With a budget that parameters do not allow, which no tree keeps.
    #[test]
    fn a_tree_that_is_larger_than_its_budget_is_an_error_unless_its_division_is_forced() {
        let mut random = Random(3);
        let mut key = || (0..6000).map(|_| random.vec()).collect::<Vec<_>>();
        let mesh = TriangleMesh::new((0..2000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), vec![key(), key()]);
        let set = Scene::new(&[mesh], no_shapes()).expect("a good mesh");
        for division in [Division::Automatic, Division::Whole, Division::SeparateTrees(2)] {
            let params = WideParams { bytes_per_primitive: 1.0, division, ..WideParams::default() };
            match WideTree::build(&set, &params, &Progress::new(None)) {
                Ok(_) => assert!(division.is_forced(), "{division:?}"),
                Err(BuildError::OverBudget { bytes, budget }) => {
                    assert!(!division.is_forced() && bytes > budget, "{division:?}");
                    assert_eq!(budget, 2000 + 8192);
                }
                Err(other) => panic!("{other}"),
            }
        }
    }
}
