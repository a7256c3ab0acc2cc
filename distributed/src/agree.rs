//! Before ranks do anything together, they compare what they were asked: one small message of each to all.

use crate::error::{Error, Problem};
use crate::exchange::{Exchange, gather};
use bytemuck::{Pod, Zeroable};

/// What ranks have to be asked alike. Floats are compared by their bits; what a call does not take is zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Asked {
    call: u64,
    k: u64,
    periods: [u32; 3],
    radius: u32,
    times: [u32; 2],
}

/// The calls that ranks make together.
#[derive(Clone, Copy)]
pub(crate) enum Call {
    Distribute = 1,
    Step,
    Lists,
    Swept,
    Nearest,
    Carry,
}

impl Asked {
    pub(crate) fn new(call: Call) -> Asked {
        Asked { call: call as u64, ..Asked::default() }
    }

    /// Zero stands for an axis that is not periodic, which no period is.
    pub(crate) fn periods(self, periods: [Option<f32>; 3]) -> Asked {
        Asked { periods: periods.map(|length| length.map_or(0, |length| length.to_bits() | 1 << 31)), ..self }
    }

    pub(crate) fn radius(self, radius: f32) -> Asked {
        Asked { radius: radius.to_bits(), ..self }
    }

    pub(crate) fn times(self, times: [f32; 2]) -> Asked {
        Asked { times: times.map(f32::to_bits), ..self }
    }

    pub(crate) fn k(self, k: usize) -> Asked {
        Asked { k: k as u64, ..self }
    }

    /// What is not the same.
    fn differs(&self, other: &Asked) -> Option<&'static str> {
        let pairs = [
            (self.call != other.call, "the call"),
            (self.k != other.k, "k"),
            (self.periods != other.periods, "a period"),
            (self.radius != other.radius, "the radius"),
            (self.times != other.times, "the time"),
        ];
        pairs.into_iter().find(|(differs, _)| *differs).map(|(_, name)| name)
    }
}

/// What a rank says of itself.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Says {
    asked: Asked,
    problem: [u64; 2],
}

/// The same answer on every rank: the problem of the lowest rank that has one, or else an argument that differs.
pub(crate) fn agree(exchange: &impl Exchange, asked: Asked, checked: Result<(), Problem>) -> Result<(), Error> {
    let problem = checked.err().map_or([0, 0], Problem::encode);
    let all = gather(exchange, &[Says { asked, problem }]);
    let said = || (0..).zip(all.iter().flatten());
    let first = |(rank, says): (usize, &Says)| Problem::decode(says.problem).map(|problem| Error { rank, problem });
    if let Some(error) = said().find_map(first) {
        return Err(error);
    }
    let differs = |(rank, says): (usize, &Says)| {
        let argument = says.asked.differs(&all[0][0].asked)?;
        Some(Error { rank, problem: Problem::Differs { argument } })
    };
    said().find_map(differs).map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Threads;

    #[test]
    fn every_rank_hears_of_the_lowest_with_a_problem() {
        let answers = Threads::run(4, |ranks| {
            let checked = if ranks.rank() >= 2 { Err(Problem::Coordinate { id: 9 }) } else { Ok(()) };
            agree(ranks, Asked::new(Call::Step).radius(ranks.rank() as f32), checked)
        });
        let error = Error { rank: 2, problem: Problem::Coordinate { id: 9 } };
        assert_eq!(answers, [Err(error); 4]);
    }

    #[test]
    fn arguments_and_calls_that_differ_are_named() {
        let asked = Asked::new(Call::Lists).radius(1.0);
        let others = [
            (Asked::new(Call::Swept).radius(1.0), "the call"),
            (asked.radius(2.0), "the radius"),
            (asked.times([0.5; 2]), "the time"),
            (asked.k(3), "k"),
            (asked.periods([None, Some(0.0), None]), "a period"),
        ];
        for (other, argument) in others {
            let answers = Threads::run(3, |ranks| agree(ranks, if ranks.rank() == 1 { other } else { asked }, Ok(())));
            assert_eq!(answers, [Err(Error { rank: 1, problem: Problem::Differs { argument } }); 3]);
        }
        assert_eq!(Threads::run(3, |ranks| agree(ranks, asked, Ok(()))), [Ok(()); 3]);
    }
}
