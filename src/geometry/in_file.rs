//! Time intervals, boxes and local spaces in files.

use super::aabb::Aabb;
use super::box3::{Box3, ULP};
use super::interval::TimeInterval;
use super::local_space::Frame;
use crate::file::{Decoder, Encoder, FileError, broken, record_fields, require};
use crate::limits::MAX_COORDINATE;
use glam::{DVec3, Vec3};

impl TimeInterval {
    /// Its begin, and its end as a bound.
    pub(crate) fn to_bounds(self) -> [f32; 2] {
        [self.begin(), self.end_bound()]
    }

    /// The interval with these bounds, or an error if there is none.
    pub(crate) fn of_bounds(bounds: [f32; 2]) -> Result<TimeInterval, FileError> {
        match TimeInterval::half_open(bounds[0], bounds[1]) {
            Some(interval) if interval.to_bounds() == bounds => Ok(interval),
            _ => broken("a time interval is invalid"),
        }
    }
}

record_fields!(Box3 { min: Vec3, max: Vec3 });

impl Frame {
    pub(crate) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put([self.origin, self.bounds.min, self.bounds.max])?;
        to.put(self.scale)?;
        to.put(self.reach)
    }

    /// Reads a frame; an error unless it could have been computed from coordinates.
    pub(crate) fn decode(from: &mut Decoder<'_>) -> Result<Frame, FileError> {
        let [origin, min, max] = from.get::<[DVec3; 3]>()?;
        let (scale, reach) = (from.get::<f64>()?, from.get::<f32>()?);
        let within = |p: DVec3| p.abs().cmple(DVec3::splat(MAX_COORDINATE)).all();
        require(within(origin) && within(min) && within(max) && min.cmple(max).all(), "its bounds are not a box")?;
        // A power of two between those of the largest and of the smallest scenes.
        let power = scale.to_bits() << 12 == 0 && SCALES.contains(&scale);
        require(power && (1.0..=1.0 + 4.0 * ULP).contains(&reach), "its scale is not that of its bounds")?;
        Ok(Frame { origin, scale, reach, bounds: Aabb { min, max } })
    }
}

/// The scales of the largest and of the smallest scene.
const SCALES: core::ops::RangeInclusive<f64> =
    1.0 / (1u128 << 104) as f64..=(1u128 << 100) as f64 * (1u64 << 50) as f64;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::{FileKind, write};

    fn read_again(frame: &Frame) -> Result<Frame, FileError> {
        let mut bytes = Vec::new();
        write(&mut bytes, FileKind::Rays, |to| frame.encode(to))?;
        let mut source = &bytes[..];
        Decoder::begin(&mut source, FileKind::Rays, None)?.whole(Frame::decode, Ok)
    }

    #[test]
    fn frames_of_all_sizes_come_back_and_others_do_not() {
        for size in [0.0, 1e-300, 1e-46, 1e-40, 1.0, 7e5, MAX_COORDINATE] {
            let swept = Aabb { min: DVec3::splat(-size), max: DVec3::splat(size) };
            for frame in [Frame::around(swept), Frame::exact(swept), Frame::around(Aabb::EMPTY)] {
                assert_eq!(read_again(&frame).unwrap(), frame);
                for scale in [3.0, -1.0, 0.0, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE] {
                    assert!(matches!(read_again(&Frame { scale, ..frame }), Err(FileError::Broken { .. })));
                }
                for reach in [0.5, 2.0, f32::NAN] {
                    assert!(matches!(read_again(&Frame { reach, ..frame }), Err(FileError::Broken { .. })));
                }
            }
        }
    }
}
