//! Neighbour lists over an interval of time: who comes within a radius of whom, and when.
//!
//! The same three culling steps as for lists at a time, over boxes and points swept during the interval. What a group of leaves has
//! in common of its motion is taken off everything first, so that points that move together sweep little. What passes a
//! test of sixteen pairs in f32 is decided in f64, four pairs at a time ([`evaluation`]). Where the
//! shutter is divided, a pair may meet in several time slices and is reported in one: [`time_slices`] says in which, and
//! why none is lost by it. Then [`merge`] merges the lists of a point. [`images`] treats periodic boxes.
//!
//! Data flows `query` or `certify` (the request) → `time_slices` (which trees are compared when) → `sweep` (all groups) → `group`
//! (the points of one) → `candidates` (the blocks that it can come near) → `pair_filter` (f32) → `evaluation` (f64) → `make` (the
//! lists) → `merge` → `encounter_lists` (all lists in one array).
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
//! **Why large keys need no margin.** A point may be at a fraction of its coordinates at the keys a and b, of which f64 loses less
//! than 2^-50 (|a| + |b − a|) (65536 segments lose more in the phase, but then the range of phases is as much wider). Faces of
//! moving boxes stay outside of a point by (max(|a|, |b|) + |b − a|)u and by as much of their own lines
//! (`point/layout/linear_bounds.rs`). So f64 is covered by what the tree pads, and M is at least this: 64Mu is at least 2^-42 (m +
//! |b − a|), m being the larger of |a| and |b|. The range of times of the group is at least u wide, so its points pass (b − a)u in
//! it, and M' is at least half of that: 64M'u is at least 2^-43 |b − a|. Faces of static boxes are not rounded.
//!
//! **Points far from the others** make everything coarse that is measured together with them. So a group that is too coarse is
//! divided into its points, each measured from its own place where this is in f64, relative to its own motion: then the drift is at
//! least |b − a|u, so that M' is. And where the box of a block is too coarse, pairs are tested with the magnitude of the block's
//! points as M, which is what their positions are rounded by, and with 2^-42 of their coordinates at keys for what f64 loses.
//!
//! **Radii of their own.** Boxes and blocks are culled by the greatest radius that a point of the group can have with one in them,
//! a pair by its own: all of the above holds for any radius that is at least that of the pair.
//!
//! **Points in f64** are culled by the same tests in f32, relative to a place in the middle of the group ([`coordinate`]). Then M
//! and M' count from there, and do not cover what f64 rounds. So radii and hulls are wider by
//! [`SweptCoordinate::excess`](coordinate::SweptCoordinate::excess) as well. Let ε = 2^-53, A the largest coordinate of a point at
//! a key, n the number of segments, and R the most by which displacements between two keys differ along an axis
//! (those of two sets with different keys, or any parts of them: while two points are compared, each may pass a part of its own).
//! - A position is `a + (b − a) s`. That makes 5εA. Taking off the place and the drift, each at most 2A away, makes 6εA more in the
//!   tests, but none where a pair is decided. Faces are computed in f64 as well, from a centre and a face relative to it, and have
//!   4εA in place of 5: they hold the exact positions for all phases of a slice (`point/layout/double_box.rs`).
//! - The phase of a time is wrong by 4nε where the time is that of a key. A point moves by 8nεA then.
//! - So what the tests compare and what decides differ by (32 + 16n)εA along an axis, below (56 + 28n)εA altogether.
//! - An encounter is reported in the slice that holds the computed time at which it begins. There the two are farther apart than
//!   the radius r: with `first` and v as in [`evaluation`], the discriminant divided by v² is wrong by at most (16 |first|² +
//!   4r²)ε, and |first| is at most r + |v|. So the squared distance exceeds r² by at most 36εr² and 32ε|v|², the distance by 2^-24
//!   |v|, which is at most 2^-23 R: the two move differently by at most R along each axis. (That is not relative to what they move
//!   in the slice, which may be much shorter than the segment.)
//!
//! The excess is 64(n + 1)εA + 2^-22 R. Of a pair, A is at most the sum of what it is for either point, and R at most the sum of
//! what the displacement of either differs from any third. So where the excess is something beside the radius, it counts for the
//! points of a group, and again for those in a box or block that it is compared with. A point that is far from the others, or
//! faster, makes coarse what is tested together with it, and nothing else.
//!
//! Beyond the ends of a slice its faces go on along their lines, so that the hull argument holds for the wider range of times. The
//! points of a slice that have left the hull there are farther from the middle than M by less than 2^-7 M and 2^-22 R, of which f32
//! rounds u.

mod candidate_points;
mod candidates;
mod certify;
mod coordinate;
mod criteria;
mod encounter;
mod encounter_lists;
mod evaluation;
#[cfg(test)]
mod far_points_tests;
mod group;
mod images;
mod make;
mod merge;
mod pair_filter;
mod query;
mod sweep;
mod time_slices;
mod window;

pub use certify::certified_duration;
pub use encounter::Encounter;
pub use encounter_lists::EncounterLists;
pub use query::SweptQuery;
