//! Closest approaches, compared with the exact ones.

use super::DOUBT;
use super::cases::PointCase;
use super::neighbors::Points;
use super::tally::OrderTally;
use crate::oracle::{ExactApproach, Given, approach, ulp32};
use mbkd::{PointError, PointStructure, TimeInterval};
use mbkd_scenes::Random;

/// Compares trees, one per structure, with the exact closest approaches of `count` moving queries.
///
/// # Errors
/// If a tree cannot be built.
pub fn compare_approaches(
    case: &PointCase,
    structures: &[PointStructure],
    count: usize,
    random: &mut Random,
) -> Result<Vec<OrderTally>, PointError> {
    let set = Points::new(case, random);
    let trees = set.trees(structures)?;
    let keys = set.keys.len();
    let mut tallies = vec![OrderTally::default(); trees.len()];
    let crossings = Points::crossings(case, &trees, random);
    for _ in 0..count {
        let begin = match &crossings {
            Some(crossings) => crossings.beside(random).0.min(0.8),
            None => random.unit_f64() as f32 * 0.8,
        };
        let part =
            TimeInterval::new(begin, begin + 0.2 * random.unit_f64() as f32 + 1e-3).unwrap_or(TimeInterval::FULL);
        let times = [TimeInterval::FULL, part][random.below(2)];
        let (from, to) = (set.query(case, times.begin(), random), set.query(case, times.end(), random));
        let exact: Vec<Option<ExactApproach>> = (0..set.active.len())
            .map(|i| approach((from, to), times, set.given, keys, set.active[i], |k| set.keys[k][i]))
            .collect();
        let best = exact.iter().flatten().min_by(|a, b| a.squared.cmp(&b.squared));
        for (tree, tally) in trees.iter().zip(&mut tallies) {
            tally.queries += 1;
            let found = if set.given == Given::F64 {
                tree.closest_approach(from, to, times)
            } else {
                tree.closest_approach(from.as_vec3(), to.as_vec3(), times)
            };
            let (Some(found), Some(best)) = (found, best) else {
                tally.wrong_count += usize::from(found.is_some() != best.is_some());
                continue;
            };
            let Some(own) = &exact[found.id as usize] else {
                tally.wrong_count += 1;
                continue;
            };
            let excess = (own.squared.to_f64() - best.squared.to_f64()) / (own.unit() + best.unit());
            tally.worst_order = tally.worst_order.max(excess);
            tally.wrong_order += usize::from(excess > DOUBT);
            // The square of an f32 number is exact in f64.
            let squared = f64::from(found.distance).powi(2);
            tally.distance.add(own.squared.error_of(squared), own.squared.to_f64(), own.doubt);
            // Square roots of quotients with a relative error of 2^-51.
            let [own_length, least] = [own, best].map(|exact| exact.squared.to_f64().max(0.0).sqrt());
            tally.as_given.add(f64::from(found.distance) - own_length, own_length, 0.0);
            tally.worst_as_given = tally.worst_as_given.max((own_length - least) / ulp32(least));
            // With more keys several times may be equally near.
            if keys <= 2 {
                tally.time.add(own.time.error_of(found.time), own.time.to_f64(), own.time_doubt);
            }
        }
    }
    Ok(tallies)
}
