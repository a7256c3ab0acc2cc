//! The times at which primitives cross planes of trees.
//!
//! A tree shows what is in its leaves at a time. Where the leaves of a primitive change from one time to another, bisection finds
//! the two neighbouring floats between which they do: the begin or the end of one of its references, which the build made of
//! the time at which it crosses a plane.

use core::ops::ControlFlow;
use mbkd::{Aabb, PointTree, RayTree, TreePoint, TreePrimitive, Visitor};
use mbkd_scenes::Random;

/// A tree as it is at a time.
pub(super) trait Leaves {
    /// A number for the leaves that a primitive is in.
    fn leaves_of(&self, primitive: u32, time: f32) -> u64;
}

/// Enters all boxes in the order of the tree and numbers them.
struct Numbers {
    primitive: u32,
    boxes: u64,
    leaves: u64,
}

impl Numbers {
    fn of(primitive: u32, traverse: impl FnOnce(&mut Numbers) -> ControlFlow<()>) -> u64 {
        let mut numbers = Numbers { primitive, boxes: 0, leaves: 0 };
        let _ = traverse(&mut numbers);
        numbers.leaves
    }

    fn see(&mut self, primitive: u32) -> ControlFlow<()> {
        if primitive == self.primitive {
            self.leaves = (self.leaves ^ self.boxes).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        }
        ControlFlow::Continue(())
    }
}

impl Visitor<TreePrimitive> for Numbers {
    fn enter(&mut self, _: &Aabb) -> Option<f32> {
        self.boxes += 1;
        Some(0.0)
    }
    fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
        if item.mesh == 0 { self.see(item.primitive) } else { ControlFlow::Continue(()) }
    }
}

impl Visitor<TreePoint> for Numbers {
    fn enter(&mut self, _: &Aabb) -> Option<f32> {
        self.boxes += 1;
        Some(0.0)
    }
    fn visit(&mut self, item: TreePoint) -> ControlFlow<()> {
        self.see(item.id)
    }
}

impl Leaves for RayTree {
    fn leaves_of(&self, primitive: u32, time: f32) -> u64 {
        Numbers::of(primitive, |numbers| self.traverse(time, numbers))
    }
}

impl Leaves for PointTree {
    fn leaves_of(&self, primitive: u32, time: f32) -> u64 {
        Numbers::of(primitive, |numbers| self.traverse(time, numbers))
    }
}

/// Times at which the leaves of primitives change, each with the primitive.
pub(super) struct Crossings(Vec<(f32, usize)>);

impl Crossings {
    /// One of them, or a time up to three floats beside it, and the primitive.
    pub(super) fn beside(&self, random: &mut Random) -> (f32, usize) {
        let (time, primitive) = self.0[random.below(self.0.len())];
        let step = random.below(7) as i32 - 3;
        (f32::from_bits(time.to_bits().saturating_add_signed(step)).clamp(0.0, 1.0), primitive)
    }
}

/// Finds up to [`MOST`] crossings in each tree.
///
/// # Panics
/// If nothing crosses anything.
pub(super) fn crossings<T: Leaves>(trees: &[T], primitives: usize, random: &mut Random) -> Crossings {
    /// Times between which the leaves of a primitive are compared.
    const STEPS: usize = 40;
    let mut all = Vec::new();
    for tree in trees {
        let begin = all.len();
        // In some trees nothing crosses.
        for _ in 0..10 * MOST {
            let (primitive, step) = (random.below(primitives), random.below(STEPS));
            let leaves = |time: f32| tree.leaves_of(primitive as u32, time);
            let [mut before, mut behind] = [step, step + 1].map(|step| step as f32 / STEPS as f32);
            let first = leaves(before);
            if first == leaves(behind) {
                continue;
            }
            while before.next_up() < behind {
                let middle = f32::from_bits(before.to_bits().midpoint(behind.to_bits()));
                if leaves(middle) == first { before = middle } else { behind = middle }
            }
            all.push((behind, primitive));
            if all.len() == begin + MOST {
                break;
            }
        }
    }
    assert!(!all.is_empty(), "nothing crosses a plane");
    Crossings(all)
}

/// The most crossings that are looked for in one tree.
const MOST: usize = 100;
