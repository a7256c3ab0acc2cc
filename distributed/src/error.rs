//! What can be wrong with a call, the same on every rank.

use core::fmt;

/// Why a call was refused. All ranks get the same error, also those whose own arguments were fine, so that none waits
/// for another.
///
/// ```
/// use mbkd_distributed::{Particle, Problem, Reach, Step, Threads};
/// let errors = Threads::run(2, |ranks| {
///     let place = if mbkd_distributed::Exchange::rank(ranks) == 1 { f32::NAN } else { 0.0 };
///     Step::new(ranks, &[Particle::fixed(5, [place; 3])], &Reach::within(1.0)).map(|_| ()).unwrap_err()
/// });
/// assert_eq!(errors[0], errors[1]);
/// assert_eq!((errors[0].rank, errors[0].problem), (1, Problem::Coordinate { id: 5 }));
/// println!("{}", errors[0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error {
    /// The lowest rank with a problem, or the lowest whose arguments are not those of rank 0.
    pub rank: usize,
    /// What is wrong there.
    pub problem: Problem,
}

/// What is wrong on a rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Problem {
    /// A coordinate of a particle is not finite or its magnitude is above [`mbkd::MAX_POINT_COORDINATE`].
    Coordinate {
        /// The particle.
        id: u64,
    },
    /// Along a periodic axis a particle is more than [`MOST_PERIODS`](crate::MOST_PERIODS) periods from zero.
    FarFromPeriod {
        /// The particle.
        id: u64,
    },
    /// A period is below [`SHORTEST_PERIOD`](crate::SHORTEST_PERIOD), above [`LONGEST_PERIOD`](crate::LONGEST_PERIOD), or NaN.
    Period {
        /// The axis.
        axis: usize,
    },
    /// A radius is negative or NaN.
    Radius,
    /// A radius is larger than the one that the step was prepared for.
    BeyondReach,
    /// A time is outside [0, 1] or NaN.
    Time,
    /// A query is not finite or too far from zero; along a periodic axis, more than
    /// [`MOST_PERIODS`](crate::MOST_PERIODS) periods.
    Query {
        /// Its index on its rank.
        index: usize,
    },
    /// An array has another length than the one that it belongs to.
    Length {
        /// Its length.
        found: usize,
    },
    /// A rank would hold more particles than 32-bit numbers can name, copies of others' included.
    TooMany {
        /// How many.
        found: usize,
    },
    /// A [`Route`](crate::Route) was made by more or fewer ranks than are to use it.
    Ranks {
        /// By how many.
        found: usize,
    },
    /// An argument, or the call itself, is not that of rank 0.
    Differs {
        /// Which.
        argument: &'static str,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rank {}: {}", self.rank, self.problem)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Problem::Coordinate { id } => write!(f, "a coordinate of particle {id} is not finite or too large"),
            Problem::FarFromPeriod { id } => {
                write!(f, "particle {id} is more than {} periods from zero; move it into the box", crate::MOST_PERIODS)
            }
            Problem::Period { axis } => {
                write!(
                    f,
                    "the period of axis {axis} must be from {:e} to {:e}",
                    crate::SHORTEST_PERIOD,
                    crate::LONGEST_PERIOD
                )
            }
            Problem::Radius => f.write_str("a radius is negative or NaN"),
            Problem::BeyondReach => f.write_str("a radius is larger than the one that the step was prepared for"),
            Problem::Time => f.write_str("a time is not in [0, 1]"),
            Problem::Query { index } => write!(f, "query {index} is not finite or too far from zero"),
            Problem::Length { found } => write!(f, "an array of {found} elements has not one for each particle"),
            Problem::TooMany { found } => {
                write!(
                    f,
                    "{found} particles, copies included, are more than one rank can hold; use more ranks or a smaller reach"
                )
            }
            Problem::Ranks { found } => write!(f, "a route between {found} ranks is used by another number of ranks"),
            Problem::Differs { argument } => write!(f, "{argument} is not that of rank 0"),
        }
    }
}

impl core::error::Error for Error {}

impl Problem {
    /// As two numbers; the first is not zero.
    pub(crate) fn encode(self) -> [u64; 2] {
        match self {
            Problem::Coordinate { id } => [1, id],
            Problem::FarFromPeriod { id } => [2, id],
            Problem::Period { axis } => [3, axis as u64],
            Problem::Radius => [4, 0],
            Problem::BeyondReach => [5, 0],
            Problem::Time => [6, 0],
            Problem::Query { index } => [7, index as u64],
            Problem::Length { found } => [8, found as u64],
            Problem::TooMany { found } => [9, found as u64],
            Problem::Ranks { found } => [10, found as u64],
            Problem::Differs { .. } => unreachable!("found out by comparing, not sent"),
        }
    }

    /// From two numbers; nothing where the first is zero.
    pub(crate) fn decode([kind, number]: [u64; 2]) -> Option<Problem> {
        let (id, index) = (number, number as usize);
        Some(match kind {
            1 => Problem::Coordinate { id },
            2 => Problem::FarFromPeriod { id },
            3 => Problem::Period { axis: index },
            4 => Problem::Radius,
            5 => Problem::BeyondReach,
            6 => Problem::Time,
            7 => Problem::Query { index },
            8 => Problem::Length { found: index },
            9 => Problem::TooMany { found: index },
            10 => Problem::Ranks { found: index },
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_arrive_as_they_were_sent() {
        for kind in 1..=10 {
            let problem = Problem::decode([kind, 2]).expect("all kinds have names");
            assert_eq!(problem.encode()[0], kind);
            assert_eq!(Problem::decode(problem.encode()), Some(problem));
        }
        assert_eq!((Problem::decode([0, 7]), Problem::decode([11, 0])), (None, None));
    }
}
