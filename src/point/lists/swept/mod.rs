//! Neighbour lists over an interval of time: who comes within a radius of whom, and when.
//!
//! The same three sieves as for lists at a time, over boxes and points swept during the interval. What a group of leaves has
//! in common of its motion is taken off everything first, so that points that move together sweep little. What passes a
//! test of sixteen pairs in f32 is decided by [`encounter`], in f64, four pairs at a time. Where the
//! shutter is divided, a pair may pass in several time slices and is reported in one: [`time_slices`] says in which, and
//! why none is lost by it. Then [`merge`] merges the lists of a point.
//!
//! **Why no encounter is lost.** Let two points be within the radius at time t*. Each has one reference whose box holds it
//! at t*; faces of boxes are lines between keys, so at t* the box lies within the hull of where its faces are at both ends
//! of the range of times that is looked at. The same motion, linear in time, is taken off points and boxes. So the hulls
//! come as near as the points do. Let M be the magnitude of the coordinates of a box and M' that of the group and its
//! drift, and u = 2^-24. Faces and positions are computed in f64 and rounded to f32 with the drift taken off, each wrong by
//! at most (M + M')u; the way of a point is the rounded difference of two such, its end their rounded sum, wrong by 5 and
//! 7 times as much; differences of two points add their own rounding. Hulls are widened by 64(M + M')u, the radius of a
//! pair is too, and by a millionth, which covers the squares. The test of sixteen pairs in f32 finds the time of the
//! nearest approach with an error δ, which adds |v|²δ² to the squared distance, v being the relative motion: with
//! δ ≤ 8u(|d|/|v| + 1) that is (8u)²(|d| + |v|)², below the square of the slack. Fused multiplication rounds less.

mod certify;
mod encounter;
mod flights;
mod lists;
mod merge;
mod near;
mod sweep;
mod time_slices;

pub use certify::certified_duration;
pub use encounter::Encounter;
pub use lists::EncounterLists;
