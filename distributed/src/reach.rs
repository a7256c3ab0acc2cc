//! Which space particles live in, and how far they look.

use crate::error::Problem;
use crate::particle::Particle;
use mbkd::MAX_POINT_COORDINATE;

/// How many periods from zero positions may be along a periodic axis.
pub const MOST_PERIODS: f32 = 4.0;

/// The longest period: images then are within what trees take.
pub const LONGEST_PERIOD: f32 = 1e16;

/// The shortest period: what boxes are grown by where squares underflow is far less.
pub const SHORTEST_PERIOD: f32 = 1e-12;

/// How far particles look, and along which axes space is periodic.
///
/// ```
/// use mbkd_distributed::Reach;
/// let slab = Reach { radius: 0.1, periods: [Some(1.0), Some(1.0), None] };
/// assert_eq!(Reach::within(0.1).periods, [None; 3]);
/// # let _ = slab;
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// The largest radius that lists of the step will be asked for. It may be more than half a period: particles count at their
    /// nearest images. Infinity copies every particle to every rank.
    pub radius: f32,
    /// Lengths of periodic axes, each from [`SHORTEST_PERIOD`] to [`LONGEST_PERIOD`]. Positions should lie within a period of zero
    /// or little beyond; more than [`MOST_PERIODS`] from zero is an error.
    pub periods: [Option<f32>; 3],
}

impl Reach {
    /// In space that is not periodic.
    pub fn within(radius: f32) -> Reach {
        Reach { radius, periods: [None; 3] }
    }

    pub(crate) fn check(&self) -> Result<(), Problem> {
        check_periods(self.periods)?;
        check_radius(self.radius)
    }
}

pub(crate) fn check_radius(radius: f32) -> Result<(), Problem> {
    if radius >= 0.0 { Ok(()) } else { Err(Problem::Radius) }
}

pub(crate) fn check_time(time: f32) -> Result<(), Problem> {
    if (0.0..=1.0).contains(&time) { Ok(()) } else { Err(Problem::Time) }
}

pub(crate) fn check_periods(periods: [Option<f32>; 3]) -> Result<(), Problem> {
    // False for NaN.
    let fine = |length: f32| (SHORTEST_PERIOD..=LONGEST_PERIOD).contains(&length);
    let bad = |axis: &usize| periods[*axis].is_some_and(|length| !fine(length));
    (0..3).find(bad).map_or(Ok(()), |axis| Err(Problem::Period { axis }))
}

pub(crate) fn check_particles(particles: &[Particle], periods: [Option<f32>; 3]) -> Result<(), Problem> {
    if particles.len() >= u32::MAX as usize {
        return Err(Problem::TooMany { found: particles.len() });
    }
    for &Particle { id, open, close } in particles {
        if !(fits(open) && fits(close)) {
            return Err(Problem::Coordinate { id });
        }
        if !(near_zero(open, periods) && near_zero(close, periods)) {
            return Err(Problem::FarFromPeriod { id });
        }
    }
    Ok(())
}

/// Whether coordinates are finite and not too large.
pub(crate) fn fits(at: [f32; 3]) -> bool {
    // False for NaN.
    at.iter().all(|x| x.abs() <= MAX_POINT_COORDINATE as f32)
}

/// Whether coordinates are few periods from zero.
pub(crate) fn near_zero(at: [f32; 3], periods: [Option<f32>; 3]) -> bool {
    at.iter().zip(periods).all(|(x, length)| length.is_none_or(|length| x.abs() <= MOST_PERIODS * length))
}
