//! Building a tree over f64 points.

use super::linear_box::{FULL, LinearBox, Node, NodeRows};
use super::order::{Place, order};
use super::tree::{Block, PreciseTree, Rows, between};
use crate::geometry::TimeInterval;
use crate::point::moving_leaf::Times;
use crate::point::moving_reference::TimeSlice;
use crate::point::order::ORDERING;
use crate::point::source::Source;
use crate::progress::Progress;
use crate::simd::{LANES, huge_vec_of};

impl PreciseTree {
    /// The tree of a time slice over some points of a set. Unless it `moves`, all points must be static
    /// and exist throughout the shutter.
    pub(in crate::point) fn build(
        source: &Source,
        slice: TimeSlice,
        points: impl Iterator<Item = usize>,
        moves: bool,
        progress: &Progress,
    ) -> PreciseTree {
        let later = (slice.segment + 1).min(slice.keys - 1);
        let keys = |point: usize| [source.exact(point, slice.segment), source.exact(point, later)];
        let middle = 0.5 * (slice.phases[0] + slice.phases[1]);
        let place = |point: usize| {
            source.alive(point).intersect(slice.interval)?;
            Some(Place { at: between(keys(point), middle), point: point as u32 })
        };
        let mut places: Vec<Place> = points.filter_map(place).collect();
        let shape = PreciseTree::shape(places.len(), moves);
        order(&mut places, shape.leaf(), &progress.part(ORDERING));
        let leaves = places.len().div_ceil(shape.leaf());
        let blocks = leaves * shape.leaf_blocks;
        let life = |place: &Place| source.alive(place.point as usize);
        let mortal = places.iter().any(|place| life(place) != TimeInterval::FULL);
        let timed = places.iter().any(|place| life(place).intersect(slice.interval) != Some(slice.interval));
        let mut tree = PreciseTree {
            slice,
            shape,
            nodes: huge_vec_of(Node::NONE, shape.nodes()),
            slopes: huge_vec_of(Node::STILL, if moves { shape.nodes() } else { 0 }),
            blocks: huge_vec_of(Block::EMPTY, blocks),
            ends: huge_vec_of(Rows::ABSENT, if moves { blocks } else { 0 }),
            node_times: Vec::new(),
            block_times: vec![Times::NEVER; if timed { blocks } else { 0 }],
            lives: vec![Times::NEVER; if mortal { blocks } else { 0 }],
            references: places.len(),
        };
        let mut boxes_below = Vec::with_capacity(leaves);
        for (leaf, places) in places.chunks(shape.leaf()).enumerate() {
            let mut bounds = LinearBox::NONE;
            for (i, place) in places.iter().enumerate() {
                let (block, lane) = (leaf * shape.leaf_blocks + i / LANES, i % LANES);
                let point = place.point as usize;
                let (keys, life) = (keys(point), life(place));
                let [begin, end] = keys.map(|p| p.to_array());
                let alive = life.intersect(slice.interval).unwrap_or(slice.interval);
                for axis in 0..3 {
                    tree.blocks[block].begin.0[axis][lane] = begin[axis];
                    if moves {
                        tree.ends[block].0[axis][lane] = end[axis];
                    }
                }
                tree.blocks[block].id[lane] = source.id(point);
                let set = |to: &mut [Times], interval: TimeInterval| {
                    if let Some(to) = to.get_mut(block) {
                        (to.begin[lane], to.end[lane]) = (interval.begin(), interval.end_bound());
                    }
                };
                set(&mut tree.block_times, alive);
                set(&mut tree.lives, life);
                let ends = slice.phases.map(|phase| between(keys, phase));
                bounds = bounds.union(&LinearBox::of_point(ends, keys, [alive.begin(), alive.end_bound()]));
            }
            boxes_below.push(bounds);
        }
        drop(places);
        for level in 0..shape.levels {
            let mut above = Vec::with_capacity(boxes_below.len().div_ceil(LANES));
            // Even a tree without points has a root.
            for i in 0..shape.begin[level + 1] - shape.begin[level] {
                let children =
                    &boxes_below[(i * LANES).min(boxes_below.len())..((i + 1) * LANES).min(boxes_below.len())];
                let (NodeRows { node, slopes, times }, bounds) = Node::over(children, moves, FULL);
                let number = shape.begin[level] + i;
                tree.nodes[number] = node;
                if moves {
                    tree.slopes[number] = slopes;
                }
                if timed {
                    tree.node_times.push(times);
                }
                above.push(bounds);
            }
            boxes_below = above;
        }
        progress.finished(1.0 - ORDERING);
        tree
    }
}
