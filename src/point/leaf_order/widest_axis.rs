//! How far points spread along the axes.

/// Most points that are examined to find the widest axis.
pub(in crate::point) const SAMPLE: usize = 128;

/// Grows a box to hold a point. Comparisons, because `min` and `max` take care of NaN, which is not here.
#[inline(always)]
pub(in crate::point) fn include<T: PartialOrd + Copy>(lo: &mut [T; 3], hi: &mut [T; 3], at: [T; 3]) {
    for axis in 0..3 {
        lo[axis] = if at[axis] < lo[axis] { at[axis] } else { lo[axis] };
        hi[axis] = if at[axis] > hi[axis] { at[axis] } else { hi[axis] };
    }
}

/// The axis along which `count` points spread most, judged by a sample where there are many. Points at infinity do not count.
pub(in crate::point) fn widest_axis(count: usize, at: impl Fn(usize) -> [f32; 3]) -> usize {
    let step = (count / SAMPLE).max(1);
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for at in (0..count).step_by(step).map(at) {
        if at[0] < f32::INFINITY {
            include(&mut lo, &mut hi, at);
        }
    }
    longest([hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]])
}

/// The axis of the greatest of three sizes.
pub(in crate::point) fn longest(size: [f32; 3]) -> usize {
    let yz = if size[1] >= size[2] { 1 } else { 2 };
    if size[0] >= size[yz] { 0 } else { yz }
}
