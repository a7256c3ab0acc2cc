//! Sets of points with inconsistent answers: an error or a tree, never a panic.

use mbkd::glam::DVec3;
use mbkd::{PointError, PointParams, PointSet, PointStructure, PointTree, TimeInterval};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// The answer that changes with the number of calls.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fickle {
    Length,
    Keys,
    Position,
    NaN,
    Infinite,
    Huge,
    Active,
    Id,
    ReservedId,
    SameId,
}

const KINDS: [Fickle; 10] = {
    use Fickle::*;
    [Length, Keys, Position, NaN, Infinite, Huge, Active, Id, ReservedId, SameId]
};

/// 3000 points whose answers change after a number of calls.
struct Set {
    kind: Fickle,
    moves: bool,
    calls: AtomicUsize,
    after: usize,
}

impl Set {
    fn changed(&self, kind: Fickle) -> Option<usize> {
        let call = self.calls.fetch_add(1, Relaxed);
        (self.kind == kind && call >= self.after).then_some(call)
    }
}

impl PointSet for Set {
    const WIDE: bool = false;
    fn len(&self) -> usize {
        if self.changed(Fickle::Length).is_some() { 3500 } else { 3000 }
    }
    fn keys(&self) -> usize {
        let keys = if self.moves { 3 } else { 1 };
        if self.changed(Fickle::Keys).is_some() { keys + 2 } else { keys }
    }
    fn position(&self, point: usize, key: usize) -> DVec3 {
        let at = DVec3::new((point * 7919 % 3001) as f64, (point * 31 % 97) as f64, (key * (point % 5)) as f64);
        let at = match self.changed(Fickle::Position) {
            Some(call) => at + DVec3::splat((call * 7919 % 1001) as f64),
            None => at,
        };
        let bad = [(Fickle::NaN, f64::NAN), (Fickle::Infinite, f64::INFINITY), (Fickle::Huge, 1e300)];
        match bad.into_iter().find(|(kind, _)| *kind == self.kind) {
            Some((kind, bad)) if self.changed(kind).is_some() => DVec3::splat(bad),
            _ => at,
        }
    }
    fn active(&self, point: usize) -> TimeInterval {
        match self.changed(Fickle::Active) {
            Some(call) => TimeInterval::new((call % 9) as f32 / 10.0, 1.0 - (point % 2) as f32 * 0.05).unwrap(),
            None => TimeInterval::FULL,
        }
    }
    fn id(&self, point: usize) -> u32 {
        if self.changed(Fickle::ReservedId).is_some() {
            return u32::MAX;
        }
        let same = self.kind == Fickle::SameId;
        self.changed(Fickle::Id).map_or(if same { 7 } else { point as u32 }, |call| call as u32)
    }
}

#[test]
fn contradictions_never_panic() {
    use PointStructure::*;
    let (mut errors, mut trees) = (0, 0);
    for kind in KINDS {
        for moves in [false, true] {
            for structure in [Automatic, Linear, TimeSlices(3), Kd] {
                for after in [0, 1, 2, 3, 1000, 9003, 12_500, 20_000, 40_000, 60_000] {
                    let set = Set { kind, moves, calls: AtomicUsize::new(0), after };
                    let params = PointParams { structure, ..PointParams::default() };
                    match PointTree::build(&set, &params) {
                        Err(PointError::NonFinite { .. } | PointError::TooLarge { .. }) => errors += 1,
                        Err(PointError::ReservedId { .. }) => errors += 1,
                        Err(e) => panic!("{kind:?}, {structure:?}, after {after}: {e}"),
                        Ok(tree) => {
                            trees += 1;
                            let found = tree.within([0.0f32; 3], 1.0, f32::INFINITY).len();
                            let interval = kind == Fickle::Active;
                            assert!(found == tree.len() || interval, "{kind:?}, {structure:?}, after {after}: {found}");
                        }
                    }
                }
            }
        }
    }
    assert!(errors > 50 && trees > 500, "{errors} errors, {trees} trees");
}
