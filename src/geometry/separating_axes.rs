//! The separating axis test of a moving triangle and a cell that its box overlaps.
//!
//! A diagonal triangle has a large box and touches few of the cells that the box overlaps. Clipping proves that at one
//! instant; an axis that separates triangle and cell at both ends of a linear motion proves it for all times
//! between: projected on a fixed axis `n` every corner moves linearly, and so does the farthest point of the
//! cell, because which of its corners that is depends on the signs of `n` alone. Their difference is linear, and
//! positive in between if it is at both ends.
//!
//! The axes tried are those of the separating axis theorem for a triangle and a box, at the middle instant:
//! the triangle's normal and the products of its edges with the axes (the axes themselves are the
//! bounding box). The proof holds for any axis, so the rounding of the axis does not matter.

use super::box3::{Box3, ULP};
use glam::Vec3;

/// The largest number of instants; motion with more keys in the interval is not tested.
pub(crate) const INSTANTS: usize = 6;

/// A triangle and a cell at one instant.
#[derive(Clone, Copy)]
pub(crate) struct Instant {
    pub corners: [Vec3; 3],
    pub cell: Box3,
}

/// Whether triangle and cell are proved disjoint at the instants and at all times between successive
/// ones, if both move linearly there up to `slack` per coordinate.
///
/// If no coordinate is larger than `m`, an inner product of differences errs by less than 16 ULP of `m` times the sum of
/// the axis's components; the margin of 64 covers the two that are compared, the rounding of a moving cell, and the
/// kernel's own rounding that grows with the triangle ([`KERNEL_ULPS`](crate::geometry::KERNEL_ULPS)).
pub(crate) fn are_disjoint(instants: &[Instant], slack: f32) -> bool {
    disjoint_by(instants, slack, MARGIN_ULPS)
}

/// The margin in ULP of the largest coordinate, as derived above.
const MARGIN_ULPS: f32 = 64.0;

/// The same with another margin.
#[inline(always)]
fn disjoint_by(instants: &[Instant], slack: f32, margin: f32) -> bool {
    let Some(middle) = instants.get(instants.len() / 2) else { return false };
    // No axis separates a cell from a corner that is in it, and most triangles that are tested have one there.
    if instants.iter().any(|i| i.corners.into_iter().any(|p| i.cell.holds(p))) {
        return false;
    }
    let [a, b, c] = middle.corners;
    let edges = [b - a, c - b, a - c];
    let largest = |i: &Instant| i.corners.into_iter().fold(i.cell, Box3::include).magnitude();
    let magnitude = instants.iter().map(largest).fold(0.0, f32::max);
    let clear = |n: Vec3| {
        let size = n.abs();
        // Products may underflow, each by half the least denormal.
        let margin = size.element_sum() * (slack + margin * ULP * magnitude) + f32::MIN_POSITIVE;
        let (mut above, mut below) = (true, true);
        for Instant { corners, cell } in instants {
            let center = (cell.min + cell.max) * 0.5;
            let reach = size.dot((cell.max - cell.min) * 0.5) + margin;
            let at = corners.map(|p| n.dot(p - center));
            above &= at[0].min(at[1]).min(at[2]) > reach;
            below &= at[0].max(at[1]).max(at[2]) < -reach;
        }
        above || below
    };
    clear(edges[0].cross(edges[1]))
        || edges.into_iter().any(|e| {
            // e x X, e x Y, e x Z.
            clear(Vec3::new(0.0, e.z, -e.y)) || clear(Vec3::new(-e.z, 0.0, e.x)) || clear(Vec3::new(e.y, -e.x, 0.0))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clip::clip_triangle;
    use crate::random::Random;

    /// Cells of one point, exactly on a triangle: whole numbers, and the point is a whole number of quarters of two edges
    /// away from a corner. (With a margin of 0, one in ninety is called clear.)
    #[test]
    fn a_triangle_is_not_clear_of_its_points_and_would_be_without_the_margin() {
        let mut random = Random(5);
        let mut whole = |size: f32| (random.vec() * size).round();
        let mut lost = [0, 0];
        for _ in 0..20_000 {
            let (a, e, f) = (whole(1e6), whole(2e5), whole(2e5));
            let corners = [a, a + e * 4.0, a + f * 4.0];
            let at = a + e + f;
            let instants = [Instant { corners, cell: Box3 { min: at, max: at } }; 2];
            for (lost, margin) in lost.iter_mut().zip([MARGIN_ULPS, 0.0]) {
                *lost += usize::from(disjoint_by(&instants, 0.0, margin));
            }
        }
        assert!(lost[0] == 0 && lost[1] > 100, "{lost:?}");
    }

    #[test]
    fn what_is_called_clear_never_touches_and_diagonals_are_found() {
        let mut random = Random(1);
        let (mut clear, mut boxes) = (0, 0);
        for _ in 0..20_000 {
            let [a, b, c] = core::array::from_fn(|_| random.vec());
            let motion = random.vec() * 0.2;
            let low = random.vec();
            let cell = Box3 { min: low, max: low + Vec3::splat(0.3) };
            let drift = random.vec() * 0.1;
            let moved = Box3 { min: cell.min + drift, max: cell.max + drift };
            let end = [a + motion, b + motion * 0.5, c - motion];
            let instants = [Instant { corners: [a, b, c], cell }, Instant { corners: end, cell: moved }];
            let sampled = (0..=32).any(|i| {
                let w = i as f32 / 32.0;
                let corners = core::array::from_fn(|k| instants[0].corners[k].lerp(end[k], w));
                let cell = Box3 { min: cell.min + drift * w, max: cell.max + drift * w };
                !clip_triangle(corners, cell).is_empty()
            });
            let overlap =
                |i: Instant| !i.corners.into_iter().fold(Box3::EMPTY, Box3::include).intersection(i.cell).is_empty();
            let found = are_disjoint(&instants, 0.0);
            assert!(!(found && sampled), "{a} {b} {c} {cell:?}");
            // A power of two rounds nothing, but then products of three lengths underflow.
            let tiny = instants.map(|Instant { corners, cell }| {
                let scale = 2f32.powi(-49);
                Instant {
                    corners: corners.map(|p| p * scale),
                    cell: Box3 { min: cell.min * scale, max: cell.max * scale },
                }
            });
            assert!(!(are_disjoint(&tiny, 0.0) && sampled), "{a} {b} {c} {cell:?}");
            if instants.into_iter().any(overlap) && !sampled {
                boxes += 1;
                clear += u32::from(found);
            }
        }
        assert!(boxes > 500 && clear * 10 > boxes * 7, "{clear} of {boxes} found");
    }
}
