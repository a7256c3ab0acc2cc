//! How answers are compared: bit for bit, and a difference is an error that says what was found.

use mbkd::{ClosestPoint, Hit};

/// The outcome of a case, or of a part of it.
pub type Outcome = Result<(), String>;

/// Returns an error from the function unless both are equal.
macro_rules! same {
    ($found:expr, $expected:expr, $($what:tt)+) => {{
        let (found, expected) = (&$found, &$expected);
        if found != expected {
            return Err(format!("{}: {found:?} instead of {expected:?}", format_args!($($what)+)));
        }
    }};
}

/// Returns an error from the function unless both lists are equal; it says where they first differ.
macro_rules! same_lists {
    ($found:expr, $expected:expr, $($what:tt)+) => {{
        let (found, expected) = (&$found[..], &$expected[..]);
        if found != expected {
            let same = found.iter().zip(expected).take_while(|(a, b)| a == b).count();
            let (one, other) = (found.get(same), expected.get(same));
            let lengths = (found.len(), expected.len());
            let what = format_args!($($what)+);
            return Err(format!("{what}: at {same} of {lengths:?}: {one:?} instead of {other:?}"));
        }
    }};
}

/// Returns an error from the function unless the condition holds.
macro_rules! ensure {
    ($condition:expr, $($what:tt)+) => {
        if !$condition {
            return Err(format!($($what)+));
        }
    };
}

/// The bits of a hit.
pub fn bits(hit: &Hit) -> [u32; 5] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.mesh, hit.primitive]
}

/// The bits of a closest point.
pub fn point_bits(near: &ClosestPoint) -> ([u64; 3], [u32; 5]) {
    let words = [near.distance.to_bits(), near.u.to_bits(), near.v.to_bits(), near.mesh, near.primitive];
    (near.point.to_array().map(f64::to_bits), words)
}
