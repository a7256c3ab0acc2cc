//! The layout of the 4D k-d tree and its traversal: front to back in space, one side in time.

use super::boxes::Box3;
use super::cell::{Cell, Cells};
use super::subtree::{ActiveInterval, Subtree};
use super::{DEPTH, Nearest, ULP};
use mbkd::baseline::TriangleTests;
use mbkd::{Hit, Observer, Ray};

/// An inner node, whose left child is the next one, or a leaf.
#[derive(Clone, Copy)]
pub enum Node {
    /// A plane.
    Space { axis: u8, at: f32, right: u32 },
    /// Earlier times are on the left.
    Time { at: f32, right: u32 },
    /// Some indices.
    Leaf { first: u32, count: u32 },
}

/// As small as the library's k-d nodes.
const _: () = assert!(size_of::<Node>() == 12);

/// The finished tree.
pub struct FourD {
    root: Box3,
    nodes: Vec<Node>,
    indices: Vec<u32>,
}

impl FourD {
    /// A tree without nodes.
    pub fn new(root: Box3) -> FourD {
        FourD { root, nodes: Vec::new(), indices: Vec::new() }
    }

    pub fn len(&self) -> u32 {
        self.nodes.len() as u32
    }

    /// Appends a node and returns its index.
    pub fn push(&mut self, node: Node) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    pub fn push_leaf(&mut self, indices: &[u32]) {
        let first = self.indices.len() as u32;
        self.indices.extend_from_slice(indices);
        self.nodes.push(Node::Leaf { first, count: indices.len() as u32 });
    }

    pub fn set(&mut self, at: usize, node: Node) {
        self.nodes[at] = node;
    }

    /// Appends a subtree.
    pub fn append(&mut self, other: FourD) {
        let (nodes, indices) = (self.nodes.len() as u32, self.indices.len() as u32);
        self.nodes.extend(other.nodes.into_iter().map(|node| match node {
            Node::Space { axis, at, right } => Node::Space { axis, at, right: right + nodes },
            Node::Time { at, right } => Node::Time { at, right: right + nodes },
            Node::Leaf { first, count } => Node::Leaf { first: first + indices, count },
        }));
        self.indices.extend(other.indices);
    }

    pub fn shrink(&mut self) {
        self.nodes.shrink_to_fit();
        self.indices.shrink_to_fit();
    }

    /// The numbers of inner nodes, leaves, and references in leaves.
    pub fn sizes(&self) -> [usize; 3] {
        let leaves = self.nodes.iter().filter(|node| matches!(node, Node::Leaf { .. })).count();
        [self.nodes.len() - leaves, leaves, self.indices.len()]
    }

    /// The number of nodes that split time.
    pub fn time_nodes(&self) -> usize {
        self.nodes.iter().filter(|node| matches!(node, Node::Time { .. })).count()
    }

    /// The tree with boxes, for the wide layout.
    pub fn subtree(&self, tests: &TriangleTests) -> Subtree {
        Cells::whole(self.cells(tests, 0, Cell::root(self.root)))
    }

    /// The recursion is as deep as the tree, which the build bounds.
    fn cells(&self, tests: &TriangleTests, node: u32, cell: Cell) -> Option<Cells> {
        let (sides, right) = match *self.nodes.get(node as usize)? {
            Node::Leaf { first, count } => {
                let indices = &self.indices[first as usize..][..count as usize];
                let references: Vec<(u32, ActiveInterval)> =
                    indices.iter().map(|&index| (index, cell.active)).collect();
                return Cells::leaf(tests, cell, &references, self.root.magnitude());
            }
            Node::Space { axis, at, right } => (cell.sides(usize::from(axis), at, at), right),
            Node::Time { at, right } => (cell.halves(at), right),
        };
        Cells::join([self.cells(tests, node + 1, sides[0]), self.cells(tests, right, sides[1])])
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.indices.capacity() * size_of::<u32>()
    }

    /// The closest hit.
    ///
    /// Why none is missed: a hit belongs to a point of the triangle, which is in its bounds at the ray's time and in
    /// the closed cell of some leaf; every cell whose closure the bounds meet has the reference. The ray passes that
    /// point within the ray's slack and the padding for the scene's largest coordinate `m` (cells have no boxes of
    /// their own); crossing a plane, `(s - o) / d`, is rounded by less than `4u (m + |o|) / |d|`. The range of each
    /// node along the ray is extended by the sum of these at both ends.
    pub fn closest_hit(&self, tests: &TriangleTests, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        let ray = tests.prepare(ray)?;
        let mut nearest = Nearest::new(&ray);
        let (origin, inverse) = (ray.origin().to_array(), ray.inverse().to_array());
        let magnitude = self.root.magnitude();
        let rounding = 8.0 * ULP * (magnitude + ray.origin().abs().max_element());
        let slack = ray.slack() + TriangleTests::padding(magnitude) + rounding;
        let pad = inverse.map(|i| slack * i.abs());
        let crossing = |axis: usize, at: f32| (at - origin[axis]) * inverse[axis];
        let (mut begin, mut end) = ray.range();
        for (axis, pad) in pad.iter().enumerate() {
            let (a, b) = (crossing(axis, self.root.min[axis]), crossing(axis, self.root.max[axis]));
            begin = begin.max(a.min(b) - pad);
            end = end.min(a.max(b) + pad);
        }
        if begin > end || self.nodes.is_empty() {
            return None;
        }
        let mut stack = [(0u32, 0f32, 0f32); DEPTH + 1];
        let mut waiting = 0;
        let mut node = 0u32;
        loop {
            match self.nodes[node as usize] {
                Node::Time { at, right } => {
                    observer.node();
                    node = if ray.time() < at { node + 1 } else { right };
                    continue;
                }
                Node::Space { axis, at, right } => {
                    observer.node();
                    let axis = usize::from(axis);
                    let (at, pad) = (crossing(axis, at), pad[axis]);
                    let (near, far) = if inverse[axis] > 0.0 { (node + 1, right) } else { (right, node + 1) };
                    if begin <= at + pad {
                        if at - pad <= end {
                            stack[waiting] = (far, begin.max(at - pad), end);
                            waiting += 1;
                        }
                        end = end.min(at + pad);
                        node = near;
                    } else {
                        begin = begin.max(at - pad);
                        node = far;
                    }
                    continue;
                }
                Node::Leaf { first, count } => {
                    observer.leaf();
                    observer.primitive_tests(count as usize);
                    for &index in &self.indices[first as usize..][..count as usize] {
                        nearest.test(tests, &ray, index);
                    }
                }
            }
            loop {
                if waiting == 0 {
                    return nearest.found.map(|(hit, _)| hit);
                }
                waiting -= 1;
                if stack[waiting].1 <= nearest.reach {
                    (node, begin, end) = stack[waiting];
                    end = end.min(nearest.reach);
                    break;
                }
            }
        }
    }
}
