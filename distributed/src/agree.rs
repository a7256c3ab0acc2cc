//! Before ranks do anything together, they compare their arguments: one small message from each rank to all.

use crate::error::{Error, Problem};
use crate::exchange::{Exchange, gather};
use bytemuck::{Pod, Zeroable};

/// The arguments of a call, which must be the same on all ranks. Floats are compared by their bits, with one zero;
/// what a call does not take is zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Arguments {
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

impl Arguments {
    pub(crate) fn new(call: Call) -> Arguments {
        Arguments { call: call as u64, ..Arguments::default() }
    }

    /// Zero stands for an axis that is not periodic, which no period is.
    pub(crate) fn periods(self, periods: [Option<f32>; 3]) -> Arguments {
        Arguments { periods: periods.map(|length| length.map_or(0, |length| length.to_bits() | 1 << 31)), ..self }
    }

    pub(crate) fn radius(self, radius: f32) -> Arguments {
        Arguments { radius: (radius + 0.0).to_bits(), ..self }
    }

    pub(crate) fn times(self, times: [f32; 2]) -> Arguments {
        Arguments { times: times.map(|time| (time + 0.0).to_bits()), ..self }
    }

    pub(crate) fn k(self, k: usize) -> Arguments {
        Arguments { k: k as u64, ..self }
    }

    /// What is not the same.
    fn differs(&self, other: &Arguments) -> Option<&'static str> {
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
    arguments: Arguments,
    problem: [u64; 2],
}

/// The same answer on every rank: the problem of the lowest rank that has one, or else an argument that differs.
pub(crate) fn agree(exchange: &impl Exchange, arguments: Arguments, checked: Result<(), Problem>) -> Result<(), Error> {
    let problem = checked.err().map_or([0, 0], Problem::encode);
    let all = gather(exchange, &[Says { arguments, problem }]);
    let said = || (0..).zip(all.iter().flatten());
    let first = |(rank, says): (usize, &Says)| Problem::decode(says.problem).map(|problem| Error { rank, problem });
    if let Some(error) = said().find_map(first) {
        return Err(error);
    }
    let differs = |(rank, says): (usize, &Says)| {
        let argument = says.arguments.differs(&all[0][0].arguments)?;
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
            agree(ranks, Arguments::new(Call::Step).radius(ranks.rank() as f32), checked)
        });
        let error = Error { rank: 2, problem: Problem::Coordinate { id: 9 } };
        assert_eq!(answers, [Err(error); 4]);
    }

    #[test]
    fn arguments_and_calls_that_differ_are_named() {
        let arguments = Arguments::new(Call::Lists).radius(1.0);
        let others = [
            (Arguments::new(Call::Swept).radius(1.0), "the call"),
            (arguments.radius(2.0), "the radius"),
            (arguments.times([0.5; 2]), "the time"),
            (arguments.k(3), "k"),
            (arguments.periods([None, Some(0.0), None]), "a period"),
        ];
        for (other, argument) in others {
            let answers =
                Threads::run(3, |ranks| agree(ranks, if ranks.rank() == 1 { other } else { arguments }, Ok(())));
            assert_eq!(answers, [Err(Error { rank: 1, problem: Problem::Differs { argument } }); 3]);
        }
        assert_eq!(Threads::run(3, |ranks| agree(ranks, arguments, Ok(()))), [Ok(()); 3]);
    }
}
