//! Animation channels: values at keyframes and their interpolation (STEP, LINEAR, CUBICSPLINE).

use super::super::FormatError;
use super::accessor::Data;
use gltf::animation::{Interpolation, Property};
use mbkd::glam::{DQuat, DVec3};

/// A clip: its channels and its time span.
pub struct Clip {
    /// Name in the file.
    pub name: String,
    /// The animated properties.
    pub channels: Vec<Channel>,
    /// First and last keyframe of all channels, in seconds.
    pub span: (f64, f64),
}

/// One property of one node.
pub struct Channel {
    /// The node.
    pub node: usize,
    /// The animated property, with its keyframes.
    pub track: Track,
}

/// Keyframes of a property.
pub enum Track {
    /// Position relative to the parent.
    Translation(Keyframes<DVec3>),
    /// Orientation relative to the parent.
    Rotation(Keyframes<DQuat>),
    /// Scale.
    Scale(Keyframes<DVec3>),
    /// Weights of all morph targets.
    Weights(Keyframes<Vec<f32>>),
}

/// Values at times, in increasing order.
pub struct Keyframes<T> {
    times: Vec<f32>,
    /// For a spline three per time: in-tangent, value, out-tangent.
    values: Vec<T>,
    interpolation: Interpolation,
}

/// A type of values that keyframes can have.
pub trait Value: Clone {
    /// Interpolates between two keyframes, `s` from 0 to 1.
    fn linear(a: &Self, b: &Self, s: f64) -> Self;
    /// A weighted sum of four values, normalized to a valid value.
    fn sum(terms: [(&Self, f64); 4]) -> Self;
}

impl Value for DVec3 {
    fn linear(a: &DVec3, b: &DVec3, s: f64) -> DVec3 {
        *a + (*b - *a) * s
    }
    fn sum(terms: [(&DVec3, f64); 4]) -> DVec3 {
        terms.into_iter().map(|(v, w)| *v * w).sum()
    }
}

impl Value for Vec<f32> {
    fn linear(a: &Vec<f32>, b: &Vec<f32>, s: f64) -> Vec<f32> {
        a.iter().zip(b).map(|(a, b)| a + (b - a) * s as f32).collect()
    }
    fn sum(terms: [(&Vec<f32>, f64); 4]) -> Vec<f32> {
        let at = |i: usize| terms.iter().map(|(v, w)| f64::from(v[i]) * w).sum::<f64>() as f32;
        (0..terms[0].0.len()).map(at).collect()
    }
}

impl Value for DQuat {
    /// Spherical interpolation along the shorter arc.
    ///
    /// sin(s x) / sin(x), with the distance 2 sin(x/2) of the two, by series: the platform's sine and arc sine would
    /// make pictures differ between machines.
    fn linear(a: &DQuat, b: &DQuat, s: f64) -> DQuat {
        let b = if a.dot(*b) < 0.0 { -*b } else { *b };
        let half_sine = (0.5 * (b - *a).length()).min(1.0);
        let angle = 2.0 * arc_sine(half_sine);
        let sine = |x: f64| crate::sampling::cos_sin_f64(x / std::f64::consts::TAU).1;
        let whole = sine(angle);
        if whole < 1e-9 {
            return (*a * (1.0 - s) + b * s).normalize();
        }
        (*a * (sine((1.0 - s) * angle) / whole) + b * (sine(s * angle) / whole)).normalize()
    }
    fn sum(terms: [(&DQuat, f64); 4]) -> DQuat {
        let sum = terms.into_iter().fold(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), |sum, (q, w)| sum + *q * w);
        unit(sum)
    }
}

/// A rotation from any four numbers; the identity from zero.
pub fn unit(q: DQuat) -> DQuat {
    let length = q.length();
    if length > 1e-12 && length.is_finite() { q * (1.0 / length) } else { DQuat::IDENTITY }
}

/// The angle in [0, pi/2] with this sine, by halving until a short series is exact.
fn arc_sine(sine: f64) -> f64 {
    let (mut s, mut scale) = (sine.clamp(0.0, 1.0), 1.0);
    for _ in 0..4 {
        // sin(x/2) = sin x / sqrt(2 (1 + cos x)): no cancellation for x up to pi/2.
        let cosine = ((1.0 - s) * (1.0 + s)).sqrt();
        s /= (2.0 * (1.0 + cosine)).sqrt();
        scale *= 2.0;
    }
    let s2 = s * s;
    let series =
        1.0 + s2 * (1.0 / 6.0 + s2 * (3.0 / 40.0 + s2 * (15.0 / 336.0 + s2 * (105.0 / 3456.0 + s2 * 945.0 / 42240.0))));
    scale * s * series
}

impl<T: Value> Keyframes<T> {
    fn new(
        place: &str,
        times: Vec<f32>,
        values: Vec<T>,
        interpolation: Interpolation,
    ) -> Result<Keyframes<T>, FormatError> {
        let per_time = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        if times.is_empty() || values.len() != times.len() * per_time {
            let what = format!("{} keyframes have {} values; {per_time} each are needed", times.len(), values.len());
            return Err(FormatError::new(place, what));
        }
        let increasing = times.windows(2).all(|pair| pair[0] < pair[1]) && times.iter().all(|t| t.is_finite());
        if !increasing {
            return Err(FormatError::new(place, "the times of its keyframes do not increase"));
        }
        Ok(Keyframes { times, values, interpolation })
    }

    /// The value at a time; clamped to the first and the last keyframe.
    pub fn at(&self, time: f64) -> T {
        let spline = self.interpolation == Interpolation::CubicSpline;
        let value = |i: usize| &self.values[if spline { 3 * i + 1 } else { i }];
        let after = self.times.partition_point(|&t| f64::from(t) <= time);
        if after == 0 {
            return value(0).clone();
        }
        let before = after - 1;
        if after == self.times.len() {
            return value(before).clone();
        }
        let (t0, t1) = (f64::from(self.times[before]), f64::from(self.times[after]));
        let (span, s) = (t1 - t0, (time - t0) / (t1 - t0));
        match self.interpolation {
            Interpolation::Step => value(before).clone(),
            Interpolation::Linear => T::linear(value(before), value(after), s),
            Interpolation::CubicSpline => {
                // Hermite: the tangents are per second.
                let (s2, s3) = (s * s, s * s * s);
                T::sum([
                    (value(before), 2.0 * s3 - 3.0 * s2 + 1.0),
                    (&self.values[3 * before + 2], span * (s3 - 2.0 * s2 + s)),
                    (value(after), -2.0 * s3 + 3.0 * s2),
                    (&self.values[3 * after], span * (s3 - s2)),
                ])
            }
        }
    }

    fn span(&self) -> (f64, f64) {
        (f64::from(self.times[0]), f64::from(self.times[self.times.len() - 1]))
    }
}

/// Reads an animation; `targets` gives the number of morph targets of a node.
pub fn clip(animation: &gltf::Animation, data: &Data, targets: impl Fn(usize) -> usize) -> Result<Clip, FormatError> {
    let mut channels = Vec::new();
    let mut span = (f64::INFINITY, f64::NEG_INFINITY);
    for channel in animation.channels() {
        let place = format!("animation {}, channel {}", animation.index(), channel.index());
        let (sampler, target) = (channel.sampler(), channel.target());
        let node = target.node().index();
        let times: Vec<f32> = data.floats::<1>(&sampler.input())?.into_iter().map(|[t]| t).collect();
        let (output, way) = (sampler.output(), sampler.interpolation());
        let vectors = || -> Result<Vec<DVec3>, FormatError> {
            finite(&place, data.floats::<3>(&output)?.into_iter().map(|v| DVec3::from(v.map(f64::from))))
        };
        let (track, (first, last)) = match target.property() {
            Property::Translation => {
                let keys = Keyframes::new(&place, times, vectors()?, way)?;
                let span = keys.span();
                (Track::Translation(keys), span)
            }
            Property::Scale => {
                let keys = Keyframes::new(&place, times, vectors()?, way)?;
                let span = keys.span();
                (Track::Scale(keys), span)
            }
            Property::Rotation => {
                let rows = data.floats::<4>(&output)?.into_iter().map(|q| DQuat::from_array(q.map(f64::from)));
                let tangents = way == Interpolation::CubicSpline;
                // Tangents are not rotations and keep their length.
                let values =
                    finite(&place, rows.enumerate().map(|(i, q)| if tangents && i % 3 != 1 { q } else { unit(q) }))?;
                let keys = Keyframes::new(&place, times, values, way)?;
                let span = keys.span();
                (Track::Rotation(keys), span)
            }
            Property::MorphTargetWeights => {
                let count = targets(node);
                if count == 0 {
                    return Err(FormatError::new(place, "animates the weights of a node without morph targets"));
                }
                let flat: Vec<f32> = data.floats::<1>(&output)?.into_iter().map(|[w]| w).collect();
                if flat.iter().any(|w| !w.is_finite()) {
                    return Err(FormatError::new(place, "has a value that is not finite"));
                }
                let keys = Keyframes::new(&place, times, flat.chunks(count).map(<[f32]>::to_vec).collect(), way)?;
                if !flat.len().is_multiple_of(count) {
                    return Err(FormatError::new(
                        place,
                        format!("{} weights are not {count} for each keyframe", flat.len()),
                    ));
                }
                let span = keys.span();
                (Track::Weights(keys), span)
            }
        };
        span = (span.0.min(first), span.1.max(last));
        channels.push(Channel { node, track });
    }
    if channels.is_empty() {
        span = (0.0, 0.0);
    }
    Ok(Clip { name: animation.name().unwrap_or("").into(), channels, span })
}

/// All values, if they are finite.
fn finite<T: Finite>(place: &str, values: impl Iterator<Item = T>) -> Result<Vec<T>, FormatError> {
    let values: Vec<T> = values.collect();
    match values.iter().position(|v| !v.finite()) {
        Some(i) => Err(FormatError::new(place, format!("value {i} is not finite"))),
        None => Ok(values),
    }
}

trait Finite {
    fn finite(&self) -> bool;
}

impl Finite for DVec3 {
    fn finite(&self) -> bool {
        self.is_finite()
    }
}

impl Finite for DQuat {
    fn finite(&self) -> bool {
        self.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_sine_and_slerp_agree_with_the_platform() {
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            assert!((arc_sine(x) - x.asin()).abs() < 1e-12, "{x}");
            let q = |angle: f64| DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), angle);
            let found = DQuat::linear(&q(0.2), &-q(0.2 + 2.8 * x), 0.3);
            let wanted = q(0.2 + 0.84 * x);
            assert!(found.dot(wanted).abs() > 1.0 - 1e-12, "{x}");
        }
    }

    #[test]
    fn splines_steps_and_ends() {
        let keys = |interpolation, values: &[f64]| {
            let values = values.iter().map(|&v| DVec3::splat(v)).collect();
            Keyframes::new("", vec![1.0, 3.0], values, interpolation).map_err(|e| e.what)
        };
        let step = keys(Interpolation::Step, &[5.0, 7.0]).unwrap();
        assert_eq!([0.0, 1.0, 2.9, 3.0, 9.0].map(|t| step.at(t).x), [5.0, 5.0, 5.0, 7.0, 7.0]);
        // x^2 from 1 to 3: slopes 2 and 6, which a cubic reproduces.
        let spline = keys(Interpolation::CubicSpline, &[0.0, 1.0, 2.0, 6.0, 9.0, 0.0]).unwrap();
        for t in [1.0, 1.5, 2.0, 2.7, 3.0] {
            assert!((spline.at(t).x - t * t).abs() < 1e-12);
        }
        assert!(keys(Interpolation::Linear, &[1.0]).err().unwrap().contains("values"));
    }
}
