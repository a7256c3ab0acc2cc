//! Neighbour lists over an interval of time: who comes within a radius of whom, and when.
//!
//! The same three sieves as for lists at a time, over boxes swept during the interval. What a group of leaves has in
//! common of its motion is taken off everything first, so that points that move together sweep little. What is left is
//! decided by [`encounter`], in f64, once for each pair and segment between keys, whatever the structure.
//!
//! **Why no encounter is lost.** Let two points be within the radius at time t*. Each has one reference whose box holds it
//! at t*; faces of boxes are lines between keys, so at t* the box lies within the hull of where its faces are at both ends
//! of the range of times that is looked at. The same motion, linear in time, is taken off points and boxes. So the hulls
//! come as near as the points do. Faces and positions are computed in f64 and rounded to f32 with the drift taken off:
//! with M the magnitude of coordinates and drift and u = 2^-24, by Mu, and differences of two by as much again. Hulls are
//! widened by 64(M + M')u, M' being that of the group; the radius of a pair likewise. The test of sixteen pairs in f32
//! finds the time of the nearest approach with an error δ, which adds |v|²δ² to the squared distance, v being the relative
//! motion: with δ ≤ 8u(|d|/|v| + 1) that is below (8u)²(|d| + |v|)², far below the square of the slack.

mod certify;
mod encounter;
mod flights;
mod lists;
mod near;

pub use certify::certified_duration;
pub use encounter::Encounter;
pub use lists::EncounterLists;
