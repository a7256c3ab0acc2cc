//! How far points spread along the axes.

use core::ops::Sub;

/// Most points that are examined to find the widest axis.
const SAMPLE: usize = 128;

/// Grows a box to hold a point. Comparisons, because `min` and `max` take care of NaN, which is not here.
#[inline(always)]
pub(in crate::point) fn include<T: PartialOrd + Copy>(lo: &mut [T; 3], hi: &mut [T; 3], at: [T; 3]) {
    for axis in 0..3 {
        lo[axis] = if at[axis] < lo[axis] { at[axis] } else { lo[axis] };
        hi[axis] = if at[axis] > hi[axis] { at[axis] } else { hi[axis] };
    }
}

/// The axis along which `count` points spread most, judged by a sample where there are many. Points at infinity do not count.
pub(in crate::point) fn widest_axis<T>(count: usize, at: impl Fn(usize) -> [T; 3]) -> usize
where
    T: PartialOrd + Copy + Sub<Output = T> + From<f32>,
{
    let (step, infinity) = ((count / SAMPLE).max(1), T::from(f32::INFINITY));
    let (mut lo, mut hi) = ([infinity; 3], [T::from(f32::NEG_INFINITY); 3]);
    for at in (0..count).step_by(step).map(at) {
        if at[0] < infinity {
            include(&mut lo, &mut hi, at);
        }
    }
    longest([hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]])
}

/// The axis of the greatest of three sizes.
pub(in crate::point) fn longest<T: PartialOrd>(size: [T; 3]) -> usize {
    let yz = if size[1] >= size[2] { 1 } else { 2 };
    if size[0] >= size[yz] { 0 } else { yz }
}
