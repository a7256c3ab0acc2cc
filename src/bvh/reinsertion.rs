//! Moving subtrees of a finished binary tree to better places.
//!
//! Object splits are decided from the top down, where it is not known yet what they will separate. Some primitives end up below
//! nodes that would be much smaller without them: the parts of a floor that runs below several rooms, or something large beside
//! something small. So the subtrees that are visited most often are taken out and inserted again where that increases the visits of
//! nodes least.
//!
//! Sources: J. Bittner, M. Hapala and V. Havran, "Fast Insertion-Based Optimization of Bounding Volume Hierarchies" (2013); the
//! search for a place, from that of the subtree upward, is that of D. Meister and J. Bittner, "Parallel Reinsertion for Bounding
//! Volume Hierarchy Optimization" (2018). Here only the top of the tree is improved, which is where most can be gained in little
//! time, and only as long as that pays: a tree over evenly sized primitives is left as it is.

use super::builder::{BinaryNode, BinaryTree};
use super::costs::motion_factor;
use super::reference::Reference;
use super::replace_subtree::ReplacedSubtree;
use super::visits::SurfaceDensity;
use crate::geometry::LinearBox3;
use crate::progress::Progress;
use crate::simd::LANES;
use crate::tuning::reinsertion::{LEAST_GAIN, LEAST_NODES, MOST_STEPS, ROUNDS, SHARE};
use core::cmp::Reverse;
use std::collections::BinaryHeap;

/// The share of each round in the rest of the draft, about: the search takes that long, and is repeated for twice as many subtrees.
const ROUND_SHARE: f64 = 0.02;

/// Subtrees between two reports of progress. Not fitted: trying them takes about a millisecond.
const REPORTED: usize = 512;

/// A changed tree is at most so many levels deep above what is not changed. Few moves make a tree deeper at all.
const MOST_LEVELS: u32 = 128;

/// Moves subtrees and returns the better tree; `None` if little is to be gained. Replaced subtrees are moved as a whole, and get
/// their new nodes, which are leaves.
///
/// References stay where they are. So those below a node are no longer side by side, unless the node may be a leaf block: then they
/// are appended in its order. The cost of a tree of `n` nodes is that of copying it, and of some hundred nanoseconds for each of
/// the few percent of its subtrees that are tried. Once `progress` is cancelled, no more are.
pub(crate) fn reinsert(
    nodes: &[BinaryNode],
    references: &mut Vec<Reference>,
    replaced: &mut [ReplacedSubtree],
    density: SurfaceDensity,
    progress: &Progress,
) -> Option<BinaryTree> {
    if nodes.len() < LEAST_NODES {
        return None;
    }
    let mut tree = Reinsertion::new(nodes, replaced.iter().map(|subtree| subtree.node).collect(), density);
    tree.improve(progress).then(|| tree.write(references, replaced)).flatten()
}

/// The bounds of a subtree, and whether any reference in it moves.
#[derive(Clone, Copy)]
struct Bounds {
    linear: LinearBox3,
    moving: bool,
}

impl Bounds {
    #[inline(always)]
    fn union(&self, other: &Bounds) -> Bounds {
        let begin = self.linear.begin.union(other.linear.begin);
        let moving = self.moving | other.moving;
        // Where nothing moves, half of the work.
        let end = if moving { self.linear.end.union(other.linear.end) } else { begin };
        Bounds { linear: LinearBox3 { begin, end }, moving }
    }
}

/// A node whose subtree is no longer that of the given tree.
struct Changed {
    bounds: Bounds,
    children: [u32; 2],
    count: u32,
}

/// A tree that is being changed.
pub(super) struct Reinsertion<'a> {
    nodes: &'a [BinaryNode],
    /// Nodes whose subtrees stay as they are, in order.
    whole: Vec<u32>,
    density: SurfaceDensity,
    /// The parents of the nodes that were reached from above.
    parent: Vec<u32>,
    /// One more than the place of each changed node in `changed`; 0 for the others.
    slot: Vec<u32>,
    changed: Vec<Changed>,
    /// Subtrees to be searched: what is gained if the moved one is inserted there at no cost, and their nodes.
    stack: Vec<(f32, u32)>,
}

impl<'a> Reinsertion<'a> {
    /// A tree that is not changed yet. The subtrees of the nodes in `whole`, which are in order, stay as they are.
    pub(super) fn new(nodes: &'a [BinaryNode], whole: Vec<u32>, density: SurfaceDensity) -> Reinsertion<'a> {
        let (parent, slot) = (vec![0; nodes.len()], vec![0; nodes.len()]);
        Reinsertion { nodes, whole, density, parent, slot, changed: Vec::new(), stack: Vec::new() }
    }

    fn changed(&self, x: u32) -> Option<&Changed> {
        self.changed.get((self.slot[x as usize] as usize).wrapping_sub(1))
    }

    /// The children of a node; `None` for leaves and subtrees that stay whole.
    fn children(&self, x: u32) -> Option<[u32; 2]> {
        if let Some(changed) = self.changed(x) {
            return Some(changed.children);
        }
        let right = self.nodes[x as usize].right;
        (right > 0 && self.whole.binary_search(&x).is_err()).then_some([x + 1, x + right])
    }

    #[inline(always)]
    fn bounds(&self, x: u32) -> Bounds {
        match self.changed(x) {
            Some(changed) => changed.bounds,
            None => Bounds { linear: self.nodes[x as usize].bounds, moving: self.nodes[x as usize].moving },
        }
    }

    fn count(&self, x: u32) -> u32 {
        self.changed(x).map_or(self.nodes[x as usize].count, |changed| changed.count)
    }

    /// How often a node with these bounds is visited, by cost.
    #[inline(always)]
    fn visits(&self, bounds: &Bounds) -> f32 {
        motion_factor(bounds.moving)
            * match bounds.moving {
                true => self.density.visits(&bounds.linear),
                false => self.density.visits_of_static(&bounds.linear.begin),
            }
    }

    fn cost(&self, x: u32) -> f32 {
        self.visits(&self.bounds(x))
    }

    fn sibling(&self, x: u32) -> u32 {
        let [a, b] = self.children(self.parent[x as usize]).unwrap_or([x; 2]);
        if a == x { b } else { a }
    }

    /// The children of a node, whose parent is then known.
    pub(super) fn open(&mut self, x: u32) -> Option<[u32; 2]> {
        let children = self.children(x)?;
        for child in children {
            self.parent[child as usize] = x;
        }
        Some(children)
    }

    /// Moves subtrees as long as that pays, twice as many in each round: a move makes others worthwhile. Returns whether any was
    /// moved.
    ///
    /// Nobody knows how many rounds there will be, so each takes a share of what is left of `progress`.
    fn improve(&mut self, progress: &Progress) -> bool {
        let count = ((self.nodes.len() as f32 * SHARE) as usize).max(LEAST_NODES);
        for round in 0..ROUNDS {
            let largest = self.largest(count << round);
            let cost: f32 = largest.iter().map(|&x| self.cost(x)).sum();
            if round == 0 {
                let progress = progress.rest(ROUND_SHARE);
                let (progress, mut promised) = (progress.in_units(largest.len()), 0.0);
                for some in largest.chunks(REPORTED) {
                    if progress.cancelled() {
                        return false;
                    }
                    promised = some.iter().filter_map(|&x| self.find(x)).fold(promised, |sum, (_, gain)| sum + gain);
                    progress.finished(some.len() as f64);
                }
                if promised < LEAST_GAIN * cost {
                    return false;
                }
            }
            let progress = progress.rest(ROUND_SHARE * f64::from(1 << round));
            let (progress, mut gained) = (progress.in_units(largest.len()), 0.0);
            for some in largest.chunks(REPORTED).take_while(|_| !progress.cancelled()) {
                for &x in some {
                    if let Some((to, gain)) = self.find(x) {
                        self.insert(x, to);
                        gained += gain;
                    }
                }
                progress.finished(some.len() as f64);
            }
            if gained < LEAST_GAIN * cost {
                break;
            }
        }
        !self.changed.is_empty()
    }

    /// The nodes that are visited most often: each is visited less often than its parent, so they are at the top.
    fn largest(&mut self, count: usize) -> Vec<u32> {
        let (mut found, mut next) = (Vec::with_capacity(count), BinaryHeap::new());
        let mut x = 0;
        loop {
            for child in self.open(x).into_iter().flatten() {
                next.push((self.cost(child).to_bits(), Reverse(child)));
            }
            match next.pop() {
                Some((_, Reverse(largest))) if found.len() < count => x = largest,
                _ => return found,
            }
            found.push(x);
        }
    }

    /// The best place for a subtree, that is, its sibling there, and the visits that are saved; `None` if it is at the best
    /// already.
    fn find(&mut self, x: u32) -> Option<(u32, f32)> {
        let (own, parent, beside) = (self.bounds(x), self.parent[x as usize], self.sibling(x));
        if parent == 0 {
            return None;
        }
        let own_cost = self.visits(&own);
        let mut best = (0, self.cost(0) * 1e-6);
        // What is gained without the subtree below the pivot: its parent is, and the nodes above are smaller.
        let (mut pivot, mut sibling, mut gained, mut without) =
            (parent, beside, self.cost(parent), self.bounds(beside));
        let mut steps = 0;
        loop {
            self.stack.push((gained, sibling));
            while let Some((gained, to)) = self.stack.pop() {
                // Any place below costs at least as much as the subtree itself. (Not a number is no gain.)
                let may_gain = gained - own_cost > best.1;
                if steps == MOST_STEPS || !may_gain {
                    continue;
                }
                steps += 1;
                let there = self.bounds(to);
                let gain = gained - self.visits(&there.union(&own));
                if gain > best.1 && to != beside {
                    best = (to, gain);
                }
                // Further below, this node grows.
                let below = gain + self.visits(&there);
                if below - own_cost > best.1
                    && let Some(children) = self.open(to)
                {
                    self.stack.extend(children.map(|child| (below, child)));
                }
            }
            if pivot != parent {
                without = without.union(&self.bounds(sibling));
                gained += self.cost(pivot) - self.visits(&without);
            }
            if pivot == 0 {
                return (best.0 != 0).then_some(best);
            }
            (sibling, pivot) = (self.sibling(pivot), self.parent[pivot as usize]);
        }
    }

    /// Moves one of two subtrees beside the other and returns the parent of both. Their parents are known, and the root stays where
    /// it is.
    pub(super) fn join(&mut self, a: u32, b: u32) -> u32 {
        let (moved, to) = if self.parent[b as usize] != 0 { (b, a) } else { (a, b) };
        let parent = self.parent[moved as usize];
        if parent != 0 {
            self.insert(moved, to);
        }
        parent
    }

    /// Moves a subtree beside another one. Its former parent becomes the parent of both.
    fn insert(&mut self, x: u32, to: u32) {
        let (parent, sibling) = (self.parent[x as usize], self.sibling(x));
        let above = self.parent[parent as usize];
        self.replace(above, parent, sibling);
        self.replace(self.parent[to as usize], to, parent);
        self.change(parent).children = [to, x];
        self.parent[to as usize] = parent;
        self.refit(above);
        self.refit(parent);
    }

    /// Replaces a child.
    fn replace(&mut self, of: u32, child: u32, by: u32) {
        self.parent[by as usize] = of;
        for own in self.change(of).children.iter_mut().filter(|own| **own == child) {
            *own = by;
        }
    }

    fn change(&mut self, x: u32) -> &mut Changed {
        if self.slot[x as usize] == 0 {
            let children = self.children(x).unwrap_or([x; 2]);
            self.changed.push(Changed { bounds: self.bounds(x), children, count: self.count(x) });
            self.slot[x as usize] = self.changed.len() as u32;
        }
        &mut self.changed[self.slot[x as usize] as usize - 1]
    }

    /// Bounds a node and all above it.
    fn refit(&mut self, mut x: u32) {
        loop {
            let [a, b] = self.change(x).children;
            let (count, bounds) = (self.count(a) + self.count(b), self.bounds(a).union(&self.bounds(b)));
            let changed = self.change(x);
            (changed.bounds, changed.count) = (bounds, count);
            if x == 0 {
                return;
            }
            x = self.parent[x as usize];
        }
    }

    /// The changed tree in preorder; `None` if it has become too deep.
    pub(super) fn write(
        &self,
        references: &mut Vec<Reference>,
        replaced: &mut [ReplacedSubtree],
    ) -> Option<BinaryTree> {
        let mut out = BinaryTree::with_capacity(self.nodes.len());
        // Subtrees to be written: their levels, and whose right children they are.
        let mut waiting = vec![(0, 0, None)];
        while let Some((x, level, right_of)) = waiting.pop() {
            let at = out.len();
            if let Some(parent) = right_of {
                out[parent as usize].right = at as u32 - parent;
            }
            let end = self.end(x);
            let inside =
                self.whole.partition_point(|&whole| whole < x)..self.whole.partition_point(|&whole| whole < end);
            if self.changed(x).is_none() && inside.is_empty() {
                out.extend_from_slice(&self.nodes[x as usize..end as usize]);
                continue;
            }
            let Bounds { linear: bounds, moving } = self.bounds(x);
            let node = BinaryNode { bounds, moving, count: self.count(x), right: 0, ..self.nodes[x as usize] };
            out.push(node);
            let Some([left, right]) = self.children(x) else {
                replaced[inside.start].node = at as u32;
                continue;
            };
            if level == MOST_LEVELS {
                return None;
            }
            if self.changed(x).is_some() && node.count as usize <= LANES {
                out[at].first = self.gather(x, references);
            }
            waiting.push((right, level + 1, Some(at as u32)));
            waiting.push((left, level + 1, None));
        }
        replaced.sort_unstable_by_key(|subtree| subtree.node);
        Some(out)
    }

    /// The end of a subtree of the given tree.
    fn end(&self, mut x: u32) -> u32 {
        while self.nodes[x as usize].right > 0 {
            x += self.nodes[x as usize].right;
        }
        x + 1
    }

    /// Copies the references below a node to the end, and returns the index of the first.
    fn gather(&self, x: u32, references: &mut Vec<Reference>) -> u32 {
        let first = references.len();
        let mut waiting = vec![x];
        while let Some(x) = waiting.pop() {
            match self.changed(x) {
                Some(changed) => waiting.extend(changed.children),
                None => {
                    let BinaryNode { first, count, .. } = self.nodes[x as usize];
                    references.extend_from_within(first as usize..(first + count) as usize);
                }
            }
        }
        first as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::builder::build_binary;
    use crate::geometry::Box3;
    use crate::random::Random;
    use glam::Vec3;

    const DENSITY: SurfaceDensity = SurfaceDensity(1.0);

    /// Boxes of very different sizes, a few of them long walls. Some move.
    fn rooms(random: &mut Random, count: u32) -> Vec<Reference> {
        (0..count)
            .map(|id| {
                let at = Vec3::new(4.0 * random.unit(), random.unit(), 4.0 * random.unit());
                let mut size = Vec3::splat(0.02 * random.unit());
                if id % 20 == 0 {
                    size[id as usize / 20 % 3] = 3.0 * random.unit();
                    size[(id as usize / 20 + 1) % 3] = random.unit();
                }
                let end = if id % 7 == 3 { Vec3::new(0.0, 0.02, 0.0) } else { Vec3::ZERO };
                let [begin, end] = [Vec3::ZERO, end].map(|by| Box3 { min: at + by, max: at + by + size });
                Reference::new(LinearBox3 { begin, end }, id)
            })
            .collect()
    }

    /// Checks that a tree is one in preorder over all references, with correct bounds, counts and flags, but for subtrees that stay
    /// whole. Returns the visits of inner nodes.
    fn checked(nodes: &[BinaryNode], references: &[Reference], whole: &[ReplacedSubtree], ids: u32) -> f32 {
        let (mut visits, mut seen, mut met) = (0.0, vec![0; ids as usize], 0);
        // From the last node to the first: ends of subtrees.
        let mut ends = vec![0; nodes.len()];
        for (x, node) in nodes.iter().enumerate().rev() {
            let replaced = whole.iter().any(|w| w.node as usize == x);
            met += usize::from(replaced);
            if node.right == 0 {
                ends[x] = x + 1;
                let of = &references[node.first as usize..][..node.count as usize];
                of.iter().for_each(|r| seen[r.id() as usize] += 1);
                let bounds = of.iter().fold(LinearBox3::EMPTY, |b, r| b.union(r.bounds()));
                assert_eq!((bounds, of.iter().any(Reference::moving)), (node.bounds, node.moving));
                continue;
            }
            assert!(!replaced, "a subtree that stays whole is one leaf");
            let (l, r) = (x + 1, x + node.right as usize);
            assert_eq!(ends[l], r);
            ends[x] = ends[r];
            assert_eq!(node.bounds, nodes[l].bounds.union(nodes[r].bounds));
            assert_eq!((node.count, node.moving), (nodes[l].count + nodes[r].count, nodes[l].moving | nodes[r].moving));
            if node.count <= 16 {
                // It may be a leaf block: its references are those of the leaves below.
                let mut own: Vec<u32> =
                    references[node.first as usize..][..node.count as usize].iter().map(Reference::id).collect();
                let leaves = nodes[x..ends[x]].iter().filter(|n| n.right == 0);
                let mut below: Vec<u32> = leaves
                    .flat_map(|n| &references[n.first as usize..][..n.count as usize])
                    .map(Reference::id)
                    .collect();
                own.sort_unstable();
                below.sort_unstable();
                assert_eq!(own, below);
            }
            visits += DENSITY.visits(&node.bounds) * motion_factor(node.moving);
        }
        assert_eq!((ends[0], met), (nodes.len(), whole.len()));
        assert!(seen.iter().all(|&n| n == 1), "each reference is in one leaf");
        visits
    }

    #[test]
    fn better_trees_hold_the_same_references() {
        let mut random = Random(31);
        for count in [200, 3000, 20_000] {
            let mut references = rooms(&mut random, count);
            let nodes = build_binary(&mut references, 8..=16, None, Some(DENSITY), &Progress::new(None));
            let before = checked(&nodes, &references, &[], count);
            let better = reinsert(&nodes, &mut references, &mut [], DENSITY, &Progress::new(None))
                .expect("walls are in the way");
            let after = checked(&better, &references, &[], count);
            let most = if count < 1000 { 1.0 } else { 0.97 };
            assert!(after < most * before, "{count}: {before} {after}");
        }
    }

    #[test]
    fn replaced_subtrees_are_moved_as_a_whole() {
        let mut random = Random(32);
        let mut references = rooms(&mut random, 5000);
        let nodes = build_binary(&mut references, 4..=8, None, Some(DENSITY), &Progress::new(None));
        let mut replaced: Vec<ReplacedSubtree> = Vec::new();
        let mut x = 1;
        while x < nodes.len() {
            let node = &nodes[x];
            if (100..300).contains(&node.count) && replaced.len() < 9 {
                replaced.push(ReplacedSubtree { node: x as u32, cost: 1.0 + x as f32 });
                while nodes[x].right > 0 {
                    x += nodes[x].right as usize;
                }
            }
            x += 1;
        }
        let first_of = |nodes: &[BinaryNode], replaced: &[ReplacedSubtree]| {
            let mut of: Vec<(u32, u32, u32)> = replaced
                .iter()
                .map(|r| (r.cost.to_bits(), nodes[r.node as usize].first, nodes[r.node as usize].count))
                .collect();
            of.sort_unstable();
            of
        };
        let before = first_of(&nodes, &replaced);
        assert_eq!(before.len(), 9);
        let better = reinsert(&nodes, &mut references, &mut replaced, DENSITY, &Progress::new(None)).unwrap();
        checked(&better, &references, &replaced, 5000);
        assert_eq!(first_of(&better, &replaced), before);
        assert!(replaced.is_sorted_by_key(|r| r.node));
    }

    #[test]
    fn trees_of_which_little_is_to_be_gained_stay_as_they_are() {
        let of = |count: u32| {
            let mut references: Vec<Reference> = (0..count)
                .map(|id| {
                    let at = Vec3::new((id % 16) as f32, (id / 16 % 16) as f32, (id / 256) as f32);
                    let b = Box3 { min: at, max: at + 0.9 };
                    Reference::new(LinearBox3 { begin: b, end: b }, id)
                })
                .collect();
            let nodes = build_binary(&mut references, 8..=16, None, None, &Progress::new(None));
            reinsert(&nodes, &mut references, &mut [], DENSITY, &Progress::new(None)).is_some()
        };
        assert_eq!([1, 20, 4096].map(of), [false; 3]);
    }

    #[test]
    fn boxes_within_boxes_do_not_make_trees_of_any_depth() {
        let mut references: Vec<Reference> = (0..4000)
            .map(|id| {
                let size = 1.01f32.powi(id as i32 % 2000) * 1e-4;
                let b = Box3 { min: Vec3::splat(-size), max: Vec3::new(size, size, size * 0.5) };
                Reference::new(LinearBox3 { begin: b, end: b }, id)
            })
            .collect();
        let nodes = build_binary(&mut references, 1..=1, None, None, &Progress::new(None));
        let better = reinsert(&nodes, &mut references, &mut [], DENSITY, &Progress::new(None)).expect("a better tree");
        checked(&better, &references, &[], 4000);
        let (mut deepest, mut waiting) = (0, vec![(0, 0)]);
        while let Some((x, depth)) = waiting.pop() {
            deepest = deepest.max(depth);
            if better[x as usize].right > 0 {
                waiting.extend([(x + 1, depth + 1), (x + better[x as usize].right, depth + 1)]);
            }
        }
        assert!(deepest <= 256, "{deepest}");
    }
}
