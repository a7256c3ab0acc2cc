//! Geometry in space and time for all layers above: boxes, boxes that move linearly, time intervals, keys,
//! the local space of a tree, clipping, separating axes, sines, Morton codes.
//!
//! The shutter is the normalized time range `[0, 1]` of one build. Positions are given at `n` keys
//! spaced evenly over it (one key: static) and are linear between keys.

mod aabb;
mod box3;
mod clip;
mod closest_on_triangle;
mod corner_bounds;
mod double_double;
mod in_file;
mod interval;
mod keys;
mod lane_bounds;
mod local_space;
mod morton;
mod placement;
mod plane;
mod ray;
mod separating_axes;
mod sine;

pub use aabb::{Aabb, LinearBounds};
pub(crate) use box3::{AxisExtent, Box3, KERNEL_ULPS, LEAST_SQUARED, Line, LinearBox3, ULP};
pub(crate) use clip::{Polygon, clip_triangle};
pub(crate) use closest_on_triangle::{OnTriangle, closest_on_triangle};
pub(crate) use corner_bounds::CornerBounds;
pub(crate) use double_double::DoubleDouble;
pub use interval::TimeInterval;
pub(crate) use keys::{KeyPhase, KeyTime, lerp};
pub(crate) use lane_bounds::LaneBounds;
pub(crate) use local_space::Frame;
pub use morton::morton_code;
pub(crate) use placement::{Placement, Preimage};
pub(crate) use plane::Plane;
pub use ray::Ray;
pub(crate) use separating_axes::{INSTANTS, Instant, are_disjoint};
pub(crate) use sine::{angle_of_chord, sine_and_cosine};
