//! A binary tree as built, before it is laid out.

use super::boxes::{Box3, MovingBox};

/// An active interval: `begin <= time < end`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveInterval {
    pub begin: f32,
    /// Beyond 1 if it lasts to the end of the shutter.
    pub end: f32,
}

impl ActiveInterval {
    /// The whole shutter.
    pub const ALWAYS: ActiveInterval = ActiveInterval { begin: 0.0, end: f32::INFINITY };

    pub fn is_always(self) -> bool {
        self.begin <= 0.0 && self.end > 1.0
    }

    #[inline(always)]
    pub fn holds(self, time: f32) -> bool {
        self.begin <= time && time < self.end
    }

    pub fn union(self, other: ActiveInterval) -> ActiveInterval {
        ActiveInterval { begin: self.begin.min(other.begin), end: self.end.max(other.end) }
    }

    /// Its share of the shutter.
    pub fn length(self) -> f32 {
        (self.end.min(1.0) - self.begin).max(0.0)
    }

    pub fn middle(self) -> f32 {
        0.5 * (self.begin + self.end.min(1.0))
    }
}

/// A subtree: bounds that hold its contents whenever they are active.
pub struct Subtree {
    pub bounds: MovingBox,
    pub active: ActiveInterval,
    pub content: Content,
}

/// The contents of a subtree.
pub enum Content {
    /// Triangles by their indices, in order, and their active intervals; no intervals if all are active throughout.
    Leaf { indices: Vec<u32>, intervals: Vec<ActiveInterval> },
    /// Two subtrees.
    Inner(Box<[Subtree; 2]>),
}

impl Subtree {
    /// A leaf whose references are active throughout the shutter.
    pub fn leaf(bounds: MovingBox, indices: Vec<u32>) -> Subtree {
        Subtree { bounds, active: ActiveInterval::ALWAYS, content: Content::Leaf { indices, intervals: Vec::new() } }
    }

    /// Two subtrees in the box around both.
    pub fn inner(children: [Subtree; 2]) -> Subtree {
        let [left, right] = &children;
        let (bounds, active) = (left.bounds.union(right.bounds), left.active.union(right.active));
        Subtree { bounds, active, content: Content::Inner(Box::new(children)) }
    }

    /// Whether the subtree is empty.
    pub fn is_empty(&self) -> bool {
        matches!(&self.content, Content::Leaf { indices, .. } if indices.is_empty())
    }

    /// How often rays visit it, relative to others: half the area at the middle of the shutter, times its active time.
    pub fn visits(&self) -> f32 {
        let MovingBox { open, close } = self.bounds;
        let middle = Box3 { min: 0.5 * (open.min + close.min), max: 0.5 * (open.max + close.max) };
        middle.half_area() * self.active.length()
    }
}
