//! The layout of BVH_i and MSBVH: binary nodes with a box at shutter open and one at close, traversed front to back.

use super::boxes::{MovingBox, SlabRay};
use super::subtree::{Content, Subtree};
use super::{DEPTH, Nearest};
use mbkd::baseline::TriangleTests;
use mbkd::{Hit, Observer, Ray};

/// A node: 56 bytes. Both children of an inner node are adjacent in memory.
#[derive(Clone, Copy)]
#[repr(C)]
struct Node {
    bounds: MovingBox,
    /// Inner: the first child. Leaf: the first of its indices.
    first: u32,
    /// Inner: 0. Leaf: the number of indices, at least 1.
    count: u32,
}

/// The finished tree.
pub struct BinaryTree {
    /// The root first; empty without triangles.
    nodes: Vec<Node>,
    indices: Vec<u32>,
}

impl BinaryTree {
    /// Lays out a tree whose references are active throughout the shutter.
    pub fn new(root: &Subtree) -> BinaryTree {
        let mut tree = BinaryTree { nodes: Vec::new(), indices: Vec::new() };
        if !root.is_empty() {
            tree.nodes.push(Node { bounds: MovingBox::EMPTY, first: 0, count: 0 });
            tree.fill(0, root);
        }
        tree.nodes.shrink_to_fit();
        tree.indices.shrink_to_fit();
        tree
    }

    /// Writes a subtree. The recursion is as deep as the tree, which the build bounds.
    fn fill(&mut self, at: usize, subtree: &Subtree) {
        let bounds = subtree.bounds.padded();
        match &subtree.content {
            Content::Leaf { indices, .. } => {
                let first = self.indices.len() as u32;
                self.indices.extend_from_slice(indices);
                self.nodes[at] = Node { bounds, first, count: indices.len() as u32 };
            }
            Content::Inner(children) => {
                let first = self.nodes.len();
                self.nodes[at] = Node { bounds, first: first as u32, count: 0 };
                self.nodes.extend([Node { bounds, first: 0, count: 0 }; 2]);
                for (i, child) in children.iter().enumerate() {
                    self.fill(first + i, child);
                }
            }
        }
    }

    /// The numbers of inner nodes, leaves, and references in leaves.
    pub fn sizes(&self) -> [usize; 3] {
        let leaves = self.nodes.iter().filter(|node| node.count > 0).count();
        [self.nodes.len() - leaves, leaves, self.indices.len()]
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.indices.capacity() * size_of::<u32>()
    }

    /// The closest hit.
    ///
    /// A hit lies in the boxes of all nodes above it, within the ray's slack in the slab test: every leaf's box holds
    /// its triangles, or the part of one that was split (and every point of a triangle is in some part), every other
    /// box both of its children's, and each is padded by [`MovingBox::padded`]. A culled box begins farther away than
    /// the reach of the best hit, so nothing at the same `t` is lost.
    pub fn closest_hit(&self, tests: &TriangleTests, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        let ray = tests.prepare(ray)?;
        let slabs = SlabRay::new(&ray);
        let mut nearest = Nearest::new(&ray);
        let mut node = self.nodes.first()?;
        node.bounds.entry(&slabs, nearest.reach)?;
        let mut stack = [(0u32, 0f32); DEPTH + 1];
        let mut waiting = 0;
        loop {
            if node.count > 0 {
                observer.leaf();
                observer.primitive_tests(node.count as usize);
                for &index in &self.indices[node.first as usize..][..node.count as usize] {
                    nearest.test(tests, &ray, index);
                }
            } else {
                observer.node();
                let first = node.first as usize;
                let (left, right) = (&self.nodes[first], &self.nodes[first + 1]);
                let entries = [left, right].map(|child| child.bounds.entry(&slabs, nearest.reach));
                match entries {
                    [Some(a), Some(b)] => {
                        let left_first = a <= b;
                        let far = if left_first { (node.first + 1, b) } else { (node.first, a) };
                        stack[waiting] = far;
                        waiting += 1;
                        node = if left_first { left } else { right };
                        continue;
                    }
                    [Some(_), None] => {
                        node = left;
                        continue;
                    }
                    [None, Some(_)] => {
                        node = right;
                        continue;
                    }
                    [None, None] => {}
                }
            }
            loop {
                if waiting == 0 {
                    return nearest.found.map(|(hit, _)| hit);
                }
                waiting -= 1;
                let (next, entry) = stack[waiting];
                if entry <= nearest.reach {
                    node = &self.nodes[next as usize];
                    break;
                }
            }
        }
    }
}
