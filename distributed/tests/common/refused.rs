//! Calls that are refused, on every rank with the same error.

use mbkd::TimeInterval;
use mbkd_distributed::{Error, Exchange, Particle, Problem, Query, Reach, Step, distribute};

/// Refused calls, each wrong on the last rank only, with what is said of it.
pub fn refused(ranks: &impl Exchange) {
    let last = ranks.size() - 1;
    let wrong = ranks.rank() == last;
    let error = |problem| Some(Error { rank: last, problem });
    let pick = |right: f32, bad: f32| if wrong { bad } else { right };
    let at = |x: f32| [Particle::fixed(3, [0.5, 0.5, 0.5]), Particle::fixed(4, [x, 0.0, 0.0])];
    let torus = [None, Some(2.0), None];

    for bad in [f32::NAN, f32::INFINITY, 2e18] {
        let problem = Problem::Coordinate { id: 4 };
        assert_eq!(distribute(ranks, &at(pick(0.0, bad)), &[], [None; 3]).err(), error(problem));
        assert_eq!(Step::new(ranks, &at(pick(0.0, bad)), &Reach::within(1.0)).err(), error(problem));
    }
    assert_eq!(
        distribute(ranks, &at(0.0), if wrong { &[1] } else { &[] }, torus).err(),
        error(Problem::Length { found: 1 })
    );
    let far = Step::new(ranks, &at(pick(0.0, 9.0)), &Reach { radius: 0.1, periods: [Some(2.0), None, None] });
    assert_eq!(far.err(), error(Problem::FarFromPeriod { id: 4 }));
    for bad in [f32::NAN, 0.0, -1.0, f32::INFINITY, 1e-39, 1e-20] {
        let periods = [None, Some(pick(1.0, bad)), None];
        assert_eq!(distribute(ranks, &[], &[], periods).err(), error(Problem::Period { axis: 1 }));
    }
    for bad in [f32::NAN, -1.0] {
        assert_eq!(Step::new(ranks, &[], &Reach::within(pick(1.0, bad))).err(), error(Problem::Radius));
    }

    let step = Step::new(ranks, &at(0.0), &Reach { radius: 0.5, periods: torus }).unwrap();
    for bad in [f32::NAN, -0.1, 1.1] {
        assert_eq!(step.neighbor_lists(pick(0.5, bad), 0.5).err(), error(Problem::Time));
        assert_eq!(step.k_nearest(&[], pick(0.5, bad), 1).err(), error(Problem::Time));
    }
    assert_eq!(step.neighbor_lists(0.5, pick(0.5, 0.6)).err(), error(Problem::BeyondReach));
    assert_eq!(step.neighbor_lists(0.5, pick(0.5, -0.6)).err(), error(Problem::Radius));
    assert_eq!(step.neighbor_lists_swept(TimeInterval::FULL, pick(0.5, f32::NAN)).err(), error(Problem::Radius));
    for bad in [f32::NAN, 3e18, 8.1] {
        let queries = [0.0, pick(0.0, bad)].map(|y| Query { at: [0.0, y, 0.0], except: None });
        assert_eq!(step.k_nearest(&queries, 0.5, 1).err(), error(Problem::Query { index: 1 }));
    }
    let values = if wrong { &[1.0; 3][..] } else { &[1.0; 2] };
    assert_eq!(step.halo_route().carry(ranks, values).err(), error(Problem::Length { found: 3 }));

    // One rank alone agrees with itself.
    let differs = |argument| if last > 0 { error(Problem::Differs { argument }) } else { None };
    assert_eq!(step.neighbor_lists(0.5, pick(0.5, 0.4)).err(), differs("the radius"));
    assert_eq!(step.neighbor_lists(pick(0.5, 0.4), 0.5).err(), differs("the time"));
    assert_eq!(step.k_nearest(&[], 0.5, if wrong { 2 } else { 3 }).err(), differs("k"));
    assert_eq!(distribute(ranks, &[], &[], if wrong { torus } else { [None; 3] }).err(), differs("a period"));
    let mixed = match wrong {
        true => step.neighbor_lists(0.5, 0.5).err(),
        false => step.neighbor_lists_swept(TimeInterval::FULL, 0.5).err(),
    };
    assert_eq!(mixed, differs("the call"));
    // And no rank is left behind.
    assert!(step.neighbor_lists(0.5, 0.5).is_ok());
}
