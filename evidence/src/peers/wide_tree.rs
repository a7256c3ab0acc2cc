//! A binary tree collapsed to a wide layout: nodes of sixteen children, traversed front to back.

use super::Nearest;
use super::boxes::SlabRay;
use super::collapse::children;
use super::subtree::{ActiveInterval, Content, Subtree};
use super::wide_node::{Row, WideNode};
use mbkd::baseline::TriangleTests;
use mbkd::{Hit, Observer, Ray};
use std::cell::Cell;

/// Marks a leaf among children.
const LEAF: u32 = 1 << 31;

/// The indices of a leaf.
#[derive(Clone, Copy)]
struct Leaf {
    first: u32,
    count: u32,
}

/// The finished tree.
pub struct WideTree {
    /// A node, or a leaf with [`LEAF`] added; `None` without triangles.
    root: Option<u32>,
    nodes: Vec<WideNode>,
    /// The active intervals of each node's children: beginnings and ends. Empty if all are active throughout.
    node_active: Vec<[Row; 2]>,
    leaves: Vec<Leaf>,
    indices: Vec<u32>,
    /// The active interval of each index; empty if all are active throughout.
    intervals: Vec<ActiveInterval>,
}

thread_local! {
    /// The traversal stack, reused from ray to ray: allocating room for the deepest tree for each ray would be slow.
    static WAITING: Cell<Vec<(u32, f32)>> = const { Cell::new(Vec::new()) };
}

impl WideTree {
    /// Lays out a tree.
    pub fn new(root: &Subtree) -> WideTree {
        let mut tree = WideTree {
            root: None,
            nodes: Vec::new(),
            node_active: Vec::new(),
            leaves: Vec::new(),
            indices: Vec::new(),
            intervals: Vec::new(),
        };
        if !root.is_empty() {
            tree.root = Some(tree.place(root));
        }
        let always = |[begin, end]: &[Row; 2]| {
            begin.iter().zip(end).all(|(&begin, &end)| ActiveInterval { begin, end }.is_always())
        };
        if tree.node_active.iter().all(always) {
            tree.node_active = Vec::new();
        }
        if tree.intervals.iter().all(|active| active.is_always()) {
            tree.intervals = Vec::new();
        }
        tree.nodes.shrink_to_fit();
        tree.node_active.shrink_to_fit();
        tree.leaves.shrink_to_fit();
        tree.indices.shrink_to_fit();
        tree.intervals.shrink_to_fit();
        tree
    }

    /// Writes a subtree and returns its index. The recursion is as deep as the tree, which the build bounds.
    fn place(&mut self, subtree: &Subtree) -> u32 {
        match &subtree.content {
            Content::Leaf { indices, intervals } => {
                let leaf = Leaf { first: self.indices.len() as u32, count: indices.len() as u32 };
                self.indices.extend_from_slice(indices);
                self.intervals
                    .extend((0..indices.len()).map(|i| intervals.get(i).copied().unwrap_or(ActiveInterval::ALWAYS)));
                self.leaves.push(leaf);
                (self.leaves.len() - 1) as u32 | LEAF
            }
            Content::Inner(halves) => {
                let at = self.nodes.len();
                self.nodes.push(WideNode::EMPTY);
                self.node_active.push([[ActiveInterval::ALWAYS.begin; _], [ActiveInterval::ALWAYS.end; _]]);
                for (lane, child) in children(halves).into_iter().enumerate() {
                    let place = self.place(child);
                    self.nodes[at].set(lane, child.bounds.padded(), place);
                    let [begin, end] = &mut self.node_active[at];
                    (begin[lane], end[lane]) = (child.active.begin, child.active.end);
                }
                at as u32
            }
        }
    }

    /// The numbers of inner nodes, leaves, and references in leaves.
    pub fn sizes(&self) -> [usize; 3] {
        [self.nodes.len(), self.leaves.len(), self.indices.len()]
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<WideNode>()
            + self.node_active.capacity() * size_of::<[Row; 2]>()
            + self.leaves.capacity() * size_of::<Leaf>()
            + self.indices.capacity() * size_of::<u32>()
            + self.intervals.capacity() * size_of::<ActiveInterval>()
    }

    /// The closest hit. Misses none for the reasons of
    /// [`BinaryTree::closest_hit`](super::binary_tree::BinaryTree::closest_hit): every box holds its contents whenever
    /// they are active, and a culled box begins farther away than the reach of the best hit.
    pub fn closest_hit(&self, tests: &TriangleTests, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        let (ray, root) = (tests.prepare(ray)?, self.root?);
        let slabs = SlabRay::new(&ray);
        let mut nearest = Nearest::new(&ray);
        // Only a triangle in several leaves can be met again.
        let mut mailbox = (self.indices.len() > tests.len()).then_some(Mailbox::EMPTY);
        let mut waiting = WAITING.take();
        waiting.clear();
        waiting.push((root, slabs.begin));
        while let Some((place, begin)) = waiting.pop() {
            if begin > nearest.reach {
                continue;
            }
            if place & LEAF == 0 {
                observer.node();
                self.enter(place as usize, &slabs, nearest.reach, &mut waiting);
                continue;
            }
            observer.leaf();
            let Leaf { first, count } = self.leaves[(place & !LEAF) as usize];
            for at in first as usize..(first + count) as usize {
                if self.intervals.get(at).is_some_and(|active| !active.holds(slabs.time)) {
                    observer.time_skip();
                    continue;
                }
                observer.primitive_tests(1);
                let index = self.indices[at];
                if mailbox.as_mut().is_none_or(|mailbox| mailbox.insert(index)) {
                    nearest.test(tests, &ray, index);
                }
            }
        }
        WAITING.set(waiting);
        nearest.found.map(|(hit, _)| hit)
    }

    /// Pushes the children of a node that the ray enters, the nearest on top.
    #[inline(always)]
    fn enter(&self, node: usize, ray: &SlabRay, reach: f32, waiting: &mut Vec<(u32, f32)>) {
        let (begin, mut hits) = self.nodes[node].enter(ray, reach);
        if let Some([from, to]) = self.node_active.get(node) {
            let mut live = 0;
            for (lane, (from, to)) in from.iter().zip(to).enumerate() {
                live |= u32::from(*from <= ray.time && ray.time < *to) << lane;
            }
            hits &= live;
        }
        let bottom = waiting.len();
        while hits != 0 {
            let lane = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            let entry = (self.nodes[node].children[lane], begin[lane]);
            waiting.push(entry);
            let mut at = waiting.len() - 1;
            while at > bottom && waiting[at - 1].1 < entry.1 {
                waiting[at] = waiting[at - 1];
                at -= 1;
            }
            waiting[at] = entry;
        }
    }
}

/// The triangles that a ray was tested against lately (a direct-mapped mailbox, as in the library's k-d trees). A
/// triangle in several leaves has the same answer in all of them.
struct Mailbox([u32; 256]);

impl Mailbox {
    const EMPTY: Mailbox = Mailbox([u32::MAX; 256]);

    /// Returns whether the triangle is absent, and inserts it.
    #[inline(always)]
    fn insert(&mut self, index: u32) -> bool {
        std::mem::replace(&mut self.0[index as usize % 256], index) != index
    }
}
