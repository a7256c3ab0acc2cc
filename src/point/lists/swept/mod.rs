//! Neighbour lists over an interval of time: who comes within a radius of whom, and when.
//!
//! The same three culling steps as for lists at a time, over boxes and points swept during the interval. What a group of leaves has
//! in common of its motion is taken off everything first, so that points that move together sweep little. What passes a
//! test of sixteen pairs in f32 is decided by [`encounter`], in f64, four pairs at a time. Where the
//! shutter is divided, a pair may meet in several time slices and is reported in one: [`time_slices`] says in which, and
//! why none is lost by it. Then [`merge`] merges the lists of a point.
//!
//! **Why no encounter is lost.** Let two points be within the radius at time t*. Each has one reference whose box holds it
//! at t*; faces of boxes are lines between keys, so at t* the box lies within the hull of where its faces are at both ends
//! of the range of times that is looked at. The same motion, linear in time, is taken off points and boxes. So the hulls
//! come as near as the points do. Let M be the magnitude of the coordinates of a box and M' that of the group and its
//! drift, and u = 2^-24. Faces and positions are computed in f64 and rounded to f32 with the drift taken off, each wrong by
//! at most (M + M')u; the displacement of a point is the rounded difference of two such, its end their rounded sum, wrong by 5 and
//! 7 times as much; differences of two points add their own rounding. Hulls are widened by 64(M + M')u, and the radius of a
//! pair is too. The test of sixteen pairs in f32 finds the time of the
//! nearest approach with an error δ, which adds |v|²δ² to the squared distance, v being the relative motion: with
//! δ ≤ 8u(|d|/|v| + 1) that is (8u)²(|d| + |v|)², below the square of the slack. Fused multiplication rounds less.
//!
//! **Why squares need no margin of their own.** With S = M + M' the positions of two points at the same time differ by at most
//! √3·S, so where the radius r is above 2S all pairs pass. Otherwise let the exact distance be at most r. The computed one is
//! wrong by 14Su along an axis, 24Su altogether, and the time adds (8u)²(|d| + |v|)² ≤ (56Su)² to its square. So the square
//! is below (r + 24Su)² + (56Su)², which is less than the bound (r + 64Su)² by at least 80rSu ≥ 40r²u and by a twelfth of (64Su)².
//! The squares, their sum, and the rounding of the bound are 6u of the square. Hulls have more to spare. What underflows is
//! covered by `UNDERFLOW` for pairs, and for hulls by `squared_up`.
//!
//! **Why large keys need no margin.** A point may be at a fraction of its coordinates at the keys a and b, of which f64 loses
//! less than 2^-50 (|a| + |b − a|) (65536 segments lose more in the phase, but then the range of phases is as much wider). Faces
//! of moving boxes stay outside of a point by (max(|a|, |b|) + |b − a|)u and by as much of their own lines
//! (`point/layout/linear_bounds.rs`). So f64 is covered by what the tree pads, and M is at least this: 64Mu is at least 2^-42 (max(|a|,
//! |b|) + |b − a|). The range of times of the group is at least u wide, so its points pass (b − a)u in it, and M' is at least
//! half of that: 64M'u is at least 2^-43 |b − a|. Faces of static boxes are not rounded.

mod candidates;
mod certify;
mod encounter;
mod lists;
mod merge;
mod pair_filter;
mod sweep;
mod time_slices;

pub use certify::certified_duration;
pub use encounter::Encounter;
pub use lists::EncounterLists;
