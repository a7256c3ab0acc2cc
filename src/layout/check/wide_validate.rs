//! Checking a finished wide tree.

use super::validation_error::ValidationError;
use crate::geometry::Box3;
use crate::layout::leaf::source::WideSource;
use crate::layout::wide_node::{ChildRef, Kind, node_rows};
use crate::layout::wide_tree::WideTree;
use crate::primitive::{PrimitiveSet, Triangles};
use crate::simd::LANES;
use crate::time::TimeSlice;
use glam::Vec3;

/// Times at which a tree is checked; the odd values fall into every time slice and on no boundary.
pub(in crate::layout) const TIMES: [f32; 9] = [0.0, 0.03, 0.17, 0.29, 0.43, 0.61, 0.79, 0.97, 1.0];

/// By how much queries enlarge boxes at least.
const LEAST_PADDING: f64 = f32::MIN_POSITIVE as f64;

/// The whole space.
const UNBOUNDED: Box3 = Box3 { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };

impl WideTree {
    /// Checks that all blocks lie inside the arena and are reached once, and that at a number of times every primitive
    /// that exists is in some leaf block, and every such triangle of a block within the boxes above it. (Of triangles that were
    /// pre-split each of their boxes holds a part only.)
    pub fn validate<S: WideSource>(&self, set: &S) -> Result<(), ValidationError> {
        let hidden = set.hidden();
        let all: Vec<u32> = (0..set.len() as u32).filter(|id| hidden.binary_search(id).is_err()).collect();
        self.validate_ids(set, &all)?;
        // The recorded leaf block of each triangle holds it, and so does the block of each time slice in which it exists where
        // there are several.
        let triangles = set.triangles();
        for (id, triangles) in triangles.into_iter().flat_map(|t| (0..t.len() as u32).map(move |id| (id, t))) {
            if set.is_listed(id) {
                continue;
            }
            let (first, count) = triangles.entries_of(id, self.slices);
            let times = |index: usize| TimeSlice { index, of: count }.query_times();
            let exists = |&index: &usize| count == 1 || triangles.active(id).intersect(times(index)).is_some();
            for slice in (0..count).filter(exists) {
                let leaf = self.blocks.get(first + slice).map(|&leaf| ChildRef(leaf));
                if !leaf.and_then(|leaf| self.ids(leaf)).is_some_and(|ids| ids.contains(&id)) {
                    return Err(ValidationError::References { node: 0 });
                }
            }
        }
        Ok(())
    }

    /// Checks everything except the recorded blocks, for a tree over these primitives, sorted.
    pub(in crate::layout) fn validate_ids<S: WideSource>(&self, set: &S, ids: &[u32]) -> Result<(), ValidationError> {
        self.validate_where(set, ids, |id, time| set.exists_at(id, time))
    }

    /// The same for ids of whatever exists at the times for which `exists` says so.
    pub(in crate::layout) fn validate_where<S: WideSource>(
        &self,
        set: &S,
        ids: &[u32],
        exists: impl Fn(u32, f32) -> bool,
    ) -> Result<(), ValidationError> {
        TIMES.into_iter().try_for_each(|time| self.validate_at(set, ids, time, |id| exists(id, time)))
    }

    fn validate_at<S: WideSource>(
        &self,
        set: &S,
        ids: &[u32],
        time: f32,
        exists: impl Fn(u32) -> bool,
    ) -> Result<(), ValidationError> {
        let words = self.arena.ints().len();
        let mut seen = vec![false; ids.len()];
        let mut visited = 0;
        let mut stack = vec![(self.root, UNBOUNDED)];
        while let Some((at, bounds)) = stack.pop() {
            if at == ChildRef::NOTHING {
                continue;
            }
            let node = at.at() / LANES;
            visited += 1;
            // More blocks than lines: some are reached repeatedly.
            if at.at() + node_rows(at.kind()) * LANES > words || visited * LANES > words {
                return Err(ValidationError::Links { node });
            }
            if at.kind().is_leaf() {
                let triangles = set.triangles().filter(|_| !self.presplit && !self.is_list(at));
                for &id in self.ids(at).ok_or(ValidationError::Links { node })? {
                    seen[ids.binary_search(&id).map_err(|_| ValidationError::References { node })?] = true;
                    if triangles.is_some_and(|triangles| exists(id) && !self.holds(triangles, id, time, bounds)) {
                        return Err(ValidationError::Bounds { primitive: id, time, node });
                    }
                }
            } else if at.kind() == Kind::Time {
                stack.push((self.child_at(at, time), bounds));
            } else {
                for (lane, child) in self.lanes(at) {
                    stack.push((child, bounds.intersection(self.lane_box(at, lane, time))));
                }
            }
        }
        match (0..ids.len()).find(|&i| !seen[i] && exists(ids[i])) {
            Some(i) => Err(ValidationError::Missing { primitive: ids[i], time, node: 0 }),
            None => Ok(()),
        }
    }

    /// Whether a box holds the corners of a triangle at a time. The padding of coordinates that are nearly denormal is zero: of
    /// those, queries enlarge boxes by more than the least normal number.
    fn holds(&self, set: &Triangles, id: u32, time: f32, bounds: Box3) -> bool {
        // A tree without recorded blocks belongs to a set that has its vertices.
        let of_tree = || if self.blocks.is_empty() { set.fine_corners(id, time) } else { self.corners(set, id, time) };
        let corners = set.precise_corners(id, time).unwrap_or_else(of_tree);
        let (min, max) = (bounds.min.as_dvec3() - LEAST_PADDING, bounds.max.as_dvec3() + LEAST_PADDING);
        corners.into_iter().all(|corner| (corner.cmpge(min) & corner.cmple(max)).all())
    }
}
