//! Builds both BVHs, top down: BVH_i by object splits, MSBVH by object or spatial splits, whichever is cheaper.
//!
//! Splits are chosen at mid-shutter, by the boxes at that time; all boxes of the tree hold their contents at every
//! time. The tree does not depend on the number of threads: budgets are divided between children by a fixed rule.

use super::boxes::{Box3, MovingBox};
use super::object_split::ObjectSplit;
use super::spatial_split::SpatialSplit;
use super::subtree::Subtree;
use super::{DEPTH, PARALLEL_FROM, STEP, TEST};
use mbkd::TimeInterval;
use mbkd::baseline::TriangleTests;

/// How a BVH is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BvhParams {
    /// References per triangle that spatial splits may make, at least 1; 1 makes a BVH_i.
    pub max_references: f32,
}

impl BvhParams {
    /// Object splits only.
    pub const BVH_I: BvhParams = BvhParams { max_references: 1.0 };
    /// Also spatial splits, which make at most two references per triangle.
    pub const MSBVH: BvhParams = BvhParams { max_references: 2.0 };
}

/// Leaves with more references are split even if that does not seem to pay.
const LARGEST_LEAF: usize = 16;

/// Spatial splits are tried if the children of the best object split overlap by more than this part of the root's area,
/// as in SBVH.
const OVERLAP: f32 = 1e-5;

/// A triangle, or its part in a cell.
#[derive(Clone, Copy)]
pub struct Reference {
    pub index: u32,
    pub bounds: MovingBox,
    /// Its box at mid-shutter.
    pub middle: Box3,
    /// The cell in which the part lies at mid-shutter.
    pub cell: Box3,
}

impl Reference {
    fn whole(tests: &TriangleTests, index: u32) -> Reference {
        let of = tests.bounds(index, TimeInterval::FULL);
        // These come from f32, so the conversion is exact.
        let narrow = |b: mbkd::Aabb| Box3 { min: b.min.as_vec3(), max: b.max.as_vec3() };
        let bounds = MovingBox { open: narrow(of.begin), close: narrow(of.end) };
        Reference { index, bounds, middle: Box3::of(tests.corners(index, 0.5)), cell: Box3::ALL }
    }
}

/// The expected cost of a ray that meets a node, if it is split into children with these boxes and counts.
pub fn split_cost(node: Box3, left: (Box3, usize), right: (Box3, usize)) -> f32 {
    let area = node.half_area();
    if area <= 0.0 {
        return STEP + TEST * (left.1 + right.1) as f32;
    }
    STEP + TEST * (left.0.half_area() * left.1 as f32 + right.0.half_area() * right.1 as f32) / area
}

/// Builds a tree of all triangles.
pub fn build(tests: &TriangleTests, params: BvhParams) -> Subtree {
    let references: Vec<Reference> = (0..tests.len() as u32).map(|index| Reference::whole(tests, index)).collect();
    let root = references.iter().fold(Box3::EMPTY, |b, r| b.union(r.middle)).half_area();
    let budget = (references.len() as f64 * f64::from(params.max_references.max(1.0))) as usize;
    Builder { tests, root, spatial: params.max_references > 1.0 }.build(references, budget, 0)
}

struct Builder<'a> {
    tests: &'a TriangleTests,
    /// Half the area of the root box at mid-shutter.
    root: f32,
    spatial: bool,
}

impl Builder<'_> {
    /// The subtree of some references that may become at most `budget`. The recursion is bounded by [`DEPTH`].
    fn build(&self, references: Vec<Reference>, budget: usize, depth: usize) -> Subtree {
        let references = match self.split(references, budget, depth) {
            Ok([left, right]) => {
                let [l, r] = [left.len(), right.len()];
                let spare = budget.saturating_sub(l + r) as f64 / (l + r) as f64;
                let share = |n: usize| n + (spare * n as f64) as usize;
                let deeper = |side: Vec<Reference>, n| self.build(side, share(n), depth + 1);
                let children = match l.min(r) >= PARALLEL_FROM {
                    true => rayon::join(|| deeper(left, l), || deeper(right, r)).into(),
                    false => [deeper(left, l), deeper(right, r)],
                };
                return Subtree::inner(children);
            }
            Err(references) => references,
        };
        let bounds = references.iter().fold(MovingBox::EMPTY, |b, r| b.union(r.bounds));
        let mut indices: Vec<u32> = references.iter().map(|r| r.index).collect();
        indices.sort_unstable();
        indices.dedup();
        Subtree::leaf(bounds, indices)
    }

    /// The references of both children, or those of the leaf.
    fn split(
        &self,
        mut references: Vec<Reference>,
        budget: usize,
        depth: usize,
    ) -> Result<[Vec<Reference>; 2], Vec<Reference>> {
        let n = references.len();
        if n < 2 || depth >= DEPTH {
            return Err(references);
        }
        let node = references.iter().fold(Box3::EMPTY, |b, r| b.union(r.middle));
        let mut object = ObjectSplit::best(&references, node);
        let overlap = object.as_ref().map_or(f32::INFINITY, |split| split.overlap);
        let spatial = (self.spatial && budget > n && overlap > OVERLAP * self.root)
            .then(|| SpatialSplit::best(&references, node, budget, self.tests))
            .flatten();
        let cost = |of: Option<f32>| of.unwrap_or(f32::INFINITY);
        let (by_object, by_plane) = (cost(object.as_ref().map(|s| s.cost)), cost(spatial.as_ref().map(|s| s.cost)));
        if by_object.min(by_plane) >= TEST * n as f32 && n <= LARGEST_LEAF {
            return Err(references);
        }
        if let Some(split) = spatial.filter(|_| by_plane < by_object) {
            let children = split.apply(references, self.tests);
            if children.iter().all(|child| !child.is_empty()) {
                return Ok(children);
            }
            // All references are on one side after splitting.
            references = children.concat();
            object = ObjectSplit::best(&references, node);
        }
        match object {
            Some(split) => Ok(split.apply(references)),
            None if n > LARGEST_LEAF => {
                let right = references.split_off(n / 2);
                Ok([references, right])
            }
            None => Err(references),
        }
    }
}
