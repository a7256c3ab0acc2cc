//! A map of a draft for the whole shutter: where shorter time slices would make boxes smaller.
//!
//! The tree is divided into some hundred *treelets*, and a small sample of what changes in each shows how much smaller its boxes
//! would be if they were made for each half of the shutter. Static and coherently moving geometry that always exists gains nothing.
//! A motion that turns around, like that of a fan that turns once or of a foot in one step, fills the same boxes in half the time
//! and smaller ones only in a shorter time, so bent motion that gains nothing in halves is tried in a few of the shortest slices.
//! So is what comes and goes, since what exists for half of the shutter may exist in both halves.

use super::draft::Draft;
use super::slice_bounds::include_slice_bounds;
use super::time_slice::TimeSlice;
use crate::bvh::{Reference, mean_half_area};
use crate::geometry::LinearBox3;
use crate::limits::MAX_TIME_SLICES;
use crate::parallel;
use crate::primitive::{Intervals, PrimitiveSet};
use crate::tuning::slices::{AIMED, MAX_AREA_OF_HALVES, SHORT_SLICES, TREELET_SAMPLE, TREELETS};

/// A small subtree and its estimates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Treelet {
    pub node: u32,
    /// Expected cost of a ray in it. Rays of a picture meet what is small in a large scene more often than rays from everywhere do,
    /// so it is at least the share of [`AIMED`] rays in the whole cost that its primitives have.
    pub cost: f32,
    /// Area of its boxes when made for slices of the shutter, relative to the area for the whole: for halves, or for the shortest
    /// slices if halves gain nothing.
    pub in_slices: f32,
}

/// Divides a draft into treelets, in order: at most [`TREELETS`] of about the same size, which is `least` at least.
pub(super) fn treelets<S: PrimitiveSet>(set: &S, draft: &Draft, least: usize) -> Vec<Treelet> {
    let Some(root) = draft.binary.first().filter(|_| draft.changes(set, 0)) else { return Vec::new() };
    let most = (root.count as usize / TREELETS).max(least) as u32;
    let (mut nodes, mut stack) = (Vec::new(), vec![0]);
    while let Some(x) = stack.pop() {
        let node = &draft.binary[x as usize];
        if node.count <= most || node.right == 0 {
            nodes.push(x);
        } else {
            stack.extend([x + node.right, x + 1]);
        }
    }
    parallel::map(nodes.len(), |i| {
        let (sample, share) = changing_sample(set, draft, nodes[i]);
        let in_slices = (1.0 - share) + share * area_in_slices(set, draft, sample);
        let aimed = AIMED * draft.binary[nodes[i] as usize].count as f32 / root.count as f32;
        let cost = draft.collapse.cost(nodes[i]).max(aimed * draft.collapse.total());
        Treelet { node: nodes[i], cost, in_slices }
    })
}

/// The area of the boxes of a small subtree when made for slices of the shutter, relative to the area for the whole.
fn area_in_slices<S: PrimitiveSet>(set: &S, draft: &Draft, x: u32) -> f32 {
    if !draft.changes(set, x) {
        return 1.0;
    }
    let whole = whole_area(draft, x);
    let relative = |area: f32| if whole > 0.0 { (area / whole).min(1.0) } else { 1.0 };
    let halves = relative(mean_area_in(set, draft, x, [0, 1].map(|index| TimeSlice { index, of: 2 })));
    let first = draft.references(&draft.binary[x as usize]).first();
    // With three keys both halves are straight.
    let bent = first.is_some_and(|r| set.leaf_kind(r.id()) > 3);
    if halves < MAX_AREA_OF_HALVES || !bent && set.always_active() {
        return halves;
    }
    let index = |i: usize| (2 * i + 1) * MAX_TIME_SLICES / (2 * SHORT_SLICES);
    let slices: [TimeSlice; SHORT_SLICES] =
        core::array::from_fn(|i| TimeSlice { index: index(i), of: MAX_TIME_SLICES });
    relative(mean_area_in(set, draft, x, slices)).min(halves)
}

/// The sum of the areas of the boxes of a small subtree when made for a time slice, in the mean over some.
fn mean_area_in<S: PrimitiveSet, const N: usize>(set: &S, draft: &Draft, x: u32, slices: [TimeSlice; N]) -> f32 {
    let (over, times) = (slices.map(TimeSlice::interval), slices.map(TimeSlice::query_times));
    let mut over = Intervals::new(&over);
    let mut bounds = |of: &[Reference]| {
        let mut boxes = [LinearBox3::EMPTY; N];
        include_slice_bounds(set, of, draft, (&mut over, &times), &mut boxes);
        boxes
    };
    let mut areas = [0.0; N];
    add_areas(draft, x, &mut bounds, &mut areas);
    areas.iter().sum::<f32>() / N as f32
}

/// The sum of the areas of the boxes of a subtree.
fn whole_area(draft: &Draft, x: u32) -> f32 {
    let node = &draft.binary[x as usize];
    let below = if node.right == 0 { 0.0 } else { whole_area(draft, x + 1) + whole_area(draft, x + node.right) };
    below + mean_half_area(&node.bounds)
}

/// Adds the areas of the boxes of a small subtree with other bounds of its references, several at once; returns its boxes.
fn add_areas<const N: usize>(
    draft: &Draft,
    x: u32,
    bounds: &mut impl FnMut(&[Reference]) -> [LinearBox3; N],
    areas: &mut [f32; N],
) -> [LinearBox3; N] {
    let node = &draft.binary[x as usize];
    let union = |a: [LinearBox3; N], b: [LinearBox3; N]| core::array::from_fn(|i| a[i].union(b[i]));
    let boxes = if node.right == 0 {
        bounds(draft.references(node))
    } else {
        union(add_areas(draft, x + 1, bounds, areas), add_areas(draft, x + node.right, bounds, areas))
    };
    for (area, bounds) in areas.iter_mut().zip(&boxes) {
        *area += mean_half_area(bounds);
    }
    boxes
}

/// A small subtree in the middle of the cost of what changes below a node, and the share of the cost that changes. (Where both
/// children do, the share in one of them stands for both.)
fn changing_sample<S: PrimitiveSet>(set: &S, draft: &Draft, mut x: u32) -> (u32, f32) {
    let (mut share, mut at) = (1.0, 0.5);
    loop {
        let node = &draft.binary[x as usize];
        if node.count <= TREELET_SAMPLE || node.right == 0 {
            return (x, share);
        }
        let children = [x + 1, x + node.right];
        let low = draft.low_share(x);
        match children.map(|child| draft.changes(set, child)) {
            [true, false] => (x, share) = (children[0], share * low),
            [false, true] => (x, share) = (children[1], share * (1.0 - low)),
            _ if at < low => (x, at) = (children[0], at / low),
            _ => (x, at) = (children[1], (at - low) / (1.0 - low)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    /// What moves and what does not are side by side. The reference in the middle of a treelet may be static though most of the
    /// cost is of what moves.
    #[test]
    fn samples_of_treelets_in_which_something_moves_move() {
        let (set, draft) = Draft::of_scene(&scene::mixed(60_000));
        let mut static_middle = 0;
        for treelet in treelets(&set, &draft, 256) {
            let node = &draft.binary[treelet.node as usize];
            let (sample, share) = changing_sample(&set, &draft, treelet.node);
            assert_eq!(draft.binary[sample as usize].moving, node.moving);
            assert!(share > 0.0 && share <= 1.0, "{share}");
            let references = draft.references(node);
            let moving = references.iter().filter(|r| r.moving()).count();
            if (1..references.len()).contains(&moving) {
                static_middle += usize::from(!references[references.len() / 2].moving());
            }
        }
        assert!(static_middle > 0);
    }
}
