//! The paper's rule for points: cut what crosses a split plane, where and when it crosses it.
//!
//! Recursive division of references by planes at mid-part, as in a k-d tree. A reference that crosses
//! the plane goes to both sides, to each for the time it spends there; the two half-open intervals share
//! one crossing time, so at every time a point is in exactly one leaf (sections 3.1.1 and 3.1.2 of the
//! paper; for points, duplication and propagation are the same step repeated). What may be cut, and how
//! many references may be added, is up to the caller; the rest goes where it lies at mid-part, and its
//! linear box takes care of the motion.

use super::linear_bounds::Hull;
use super::moving_reference::{Mover, Part};
use super::moving_tree::{Assembly, MovingTree, magnitude};
use super::order::{Item, widest_axis};
use super::select::select;
use crate::geometry::{Extent, Line, Plane, TimeInterval};
use crate::mbkd::{Rounding, classify};
use crate::simd::LANES;

/// Builds the tree of one part, cutting movers that may be cut, as long as there are at most
/// `references` of them for each mover.
pub(super) fn build(movers: Vec<Mover>, part: Part, references: f32) -> MovingTree {
    // What stands still or may not be cut adds nothing; room is kept only for what may.
    let cuttable = movers.iter().filter(|m| m.cut && m.open != m.close).count();
    let added = (movers.len() as f64 * f64::from(references - 1.0)).min(cuttable as f64 * MOST_CUTS);
    let most = movers.len() + added.max(0.0) as usize;
    // Room for all of them with leaves three quarters full.
    let (mut levels, mut room) = (1, LANES * LANES);
    while room * 3 / 4 < most {
        levels += 1;
        room *= LANES;
    }
    let middle = f64::from(part.phase(part.middle()));
    let mortal = movers.iter().any(|m| m.life != TimeInterval::FULL);
    let mut cutter = Cutter { part, middle, tree: Assembly::new(levels, magnitude(&movers)) };
    let spare = most - movers.len();
    cutter.node(movers, levels - 1, room, spare);
    cutter.tree.finish(part, true, mortal)
}

/// References that room is kept for with each mover that may be cut.
const MOST_CUTS: f64 = 8.0;

struct Cutter {
    part: Part,
    middle: f64,
    tree: Assembly,
}

/// References on their way into children of one node, which are `slots` at most, and how many more
/// references may come from cutting them.
struct Share {
    movers: Vec<Mover>,
    slots: usize,
    spare: usize,
}

impl Cutter {
    /// Builds the node over `movers`, of which it has room for `room`. Recursion is as deep as the tree.
    fn node(&mut self, movers: Vec<Mover>, level: usize, room: usize, spare: usize) -> Hull {
        let child_room = room / LANES;
        let mut shares = Vec::with_capacity(LANES);
        self.divide(Share { movers, slots: LANES, spare }, child_room, &mut shares);
        let first = self.tree.next(level.checked_sub(1));
        let mut children = Vec::with_capacity(shares.len());
        for share in shares {
            children.push(match level {
                0 => self.tree.leaf(&self.part, &share.movers),
                _ => self.node(share.movers, level - 1, child_room, share.spare),
            });
        }
        self.tree.node(level, first, &children)
    }

    /// Divides references until each share fits one child. At most four levels deep.
    fn divide(&mut self, share: Share, room: usize, done: &mut Vec<Share>) {
        // As many children as it takes with what will be added: all that may come further down, little
        // among leaves, which would stay half empty otherwise.
        let count = share.movers.len();
        let (wish, enough) = if room <= LANES {
            (count + share.spare.min(count / 8), count <= room)
        } else {
            (count + share.spare, count + share.spare <= room || count <= LANES)
        };
        if enough || share.slots == 1 {
            if count > 0 {
                done.push(share);
            }
            return;
        }
        let needed = wish.div_ceil(room).clamp(2, share.slots);
        let left_needed = needed.div_ceil(2);
        let left_slots = (share.slots * left_needed).div_ceil(needed).min(share.slots - 1);
        let slots = [left_slots, share.slots - left_slots];
        let aim = count * left_needed / needed;
        let rank = aim.clamp(count.saturating_sub(slots[1] * room).max(1), (slots[0] * room).min(count - 1));
        let [left, right] = self.halve(share.movers, rank, slots.map(|s| s * room), share.spare);
        let spare = share.spare - (left.len() + right.len() - count);
        let part = (spare as f64 * (left.len() as f64 / (left.len() + right.len()) as f64)) as usize;
        self.divide(Share { movers: left, slots: slots[0], spare: part }, room, done);
        self.divide(Share { movers: right, slots: slots[1], spare: spare - part }, room, done);
    }

    /// Two halves, `rank` references on the left before anything is cut; cut only if both halves stay
    /// within their room and the added references within `spare`.
    fn halve(&self, movers: Vec<Mover>, rank: usize, room: [usize; 2], spare: usize) -> [Vec<Mover>; 2] {
        let phase = |m: &Mover| {
            let span = [m.alive.begin(), m.alive.end_bound()].map(|t| f64::from(self.part.phase(t)));
            self.middle.clamp(span[0], span[1])
        };
        let velocity = mean_velocity(&movers, &self.part);
        let mut items: Vec<Item> = movers
            .iter()
            .enumerate()
            .map(|(i, m)| {
                let phase = phase(m);
                Item { at: core::array::from_fn(|axis| m.at(axis, phase) as f32), index: i as u32 }
            })
            .collect();
        let axis = widest_axis(&items);
        // The plane moves with its surroundings: where everything moves alike, nothing crosses it.
        let plane_velocity = velocity[axis] as f32;
        for item in &mut items {
            let m = &movers[item.index as usize];
            let time = self.part.middle().clamp(m.alive.begin(), m.alive.end());
            item.at[axis] -= plane_velocity * time;
        }
        select(&mut items, rank, axis);
        let plane = Plane { axis, position: items[rank].at[axis], velocity: plane_velocity };
        let sides = |m: &Mover| {
            let ends = [m.alive.begin(), m.alive.end()].map(|t| m.at(axis, f64::from(self.part.phase(t))));
            let line = Line { begin: ends[0], end: ends[1] };
            classify(Extent { interval: m.alive, lower: line, upper: line }, plane, Rounding::ExactlyOnce)
        };
        let cut: Vec<_> = movers.iter().map(|m| m.cut.then(|| sides(m))).collect();
        let crossing = cut.iter().flatten().filter(|s| s.left.is_some() && s.right.is_some()).count();
        if crossing > 0 && crossing <= spare {
            let mut halves = [Vec::with_capacity(rank + crossing), Vec::with_capacity(movers.len() - rank + crossing)];
            for (place, item) in items.iter().enumerate() {
                let mover = movers[item.index as usize];
                match cut[item.index as usize] {
                    Some(sides) => {
                        halves[0].extend(sides.left.map(|alive| Mover { alive, ..mover }));
                        halves[1].extend(sides.right.map(|alive| Mover { alive, ..mover }));
                    }
                    None => halves[usize::from(place >= rank)].push(mover),
                }
            }
            if halves[0].len() <= room[0]
                && halves[1].len() <= room[1]
                && !halves[0].is_empty()
                && !halves[1].is_empty()
            {
                return halves;
            }
        }
        let take = |items: &[Item]| items.iter().map(|i| movers[i.index as usize]).collect();
        [take(&items[..rank]), take(&items[rank..])]
    }
}

/// Mean velocity per shutter, each reference weighted by how long it counts.
fn mean_velocity(movers: &[Mover], part: &Part) -> [f64; 3] {
    let (mut sum, mut weight) = ([0.0; 3], 0.0);
    for m in movers {
        let duration = f64::from(m.alive.duration());
        for (axis, sum) in sum.iter_mut().enumerate() {
            *sum += duration * (f64::from(m.close[axis]) - f64::from(m.open[axis]));
        }
        weight += duration;
    }
    let segments = (part.keys.max(2) - 1) as f64;
    if weight > 0.0 { sum.map(|x| x * segments / weight) } else { [0.0; 3] }
}
