//! What comparisons count.

use super::WELL;
use crate::oracle::ulp32;

/// Errors of one kind of answer.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// In ulp, of the well-conditioned answers.
    ulps: Vec<f32>,
    /// Of all answers.
    units: Vec<f32>,
}

impl Errors {
    /// Counts an answer of about `size` that is off by `error`, where half an ulp of input moves it by `doubt`.
    pub fn add(&mut self, error: f64, size: f64, doubt: f64) {
        let ulp = ulp32(size);
        let error = error.abs();
        // A doubt that is not finite is no problem to be measured.
        if !doubt.is_finite() {
            return;
        }
        self.units.push((error / (doubt + ulp / 2.0)) as f32);
        if doubt <= WELL * ulp {
            self.ulps.push((error / ulp) as f32);
        }
    }

    /// Adds what another one counted.
    pub fn merge(&mut self, other: Errors) {
        self.ulps.extend(other.ulps);
        self.units.extend(other.units);
    }

    /// Number of answers.
    pub fn len(&self) -> usize {
        self.units.len()
    }

    /// Whether there were none.
    pub fn is_empty(&self) -> bool {
        self.units.is_empty()
    }

    /// The share of the well-conditioned ones.
    pub fn well(&self) -> f64 {
        self.ulps.len() as f64 / self.units.len().max(1) as f64
    }

    /// The greatest error in ulp among the well-conditioned answers; 0 without any.
    pub fn worst_ulps(&self) -> f64 {
        self.ulps.iter().copied().fold(0.0, f32::max).into()
    }

    /// The greatest error in units.
    pub fn worst_units(&self) -> f64 {
        self.units.iter().copied().fold(0.0, f32::max).into()
    }

    /// The error in ulp that the share `q` of the well-conditioned answers stays within.
    pub fn quantile_ulps(&self, q: f64) -> f64 {
        let mut sorted = self.ulps.clone();
        sorted.sort_by(f32::total_cmp);
        let at = ((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1));
        sorted.get(at).copied().unwrap_or(0.0).into()
    }
}

/// What rays found, compared with what they meet.
#[derive(Clone, Debug, Default)]
pub struct RayTally {
    /// Rays asked.
    pub rays: usize,
    /// Hits that the exact answer has.
    pub hits: usize,
    /// Exact hits beyond doubt that were not reported.
    pub false_misses: usize,
    /// Reported hits that are none beyond doubt.
    pub false_hits: usize,
    /// The greatest doubt, in units, with which a wrong verdict can be excused.
    pub worst_verdict: f64,
    /// Closest hits that are farther than another one beyond doubt.
    pub wrong_closest: usize,
    /// Hits with a distance that is outside the ray's range or not finite.
    pub outside_range: usize,
    /// Queries of the same ray that contradict each other.
    pub contradictions: usize,
    /// Distances.
    pub t: Errors,
    /// Barycentrics.
    pub weights: Errors,
}

impl RayTally {
    /// Adds what another one counted.
    pub fn merge(&mut self, other: RayTally) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.false_misses += other.false_misses;
        self.false_hits += other.false_hits;
        self.worst_verdict = self.worst_verdict.max(other.worst_verdict);
        self.wrong_closest += other.wrong_closest;
        self.outside_range += other.outside_range;
        self.contradictions += other.contradictions;
        self.t.merge(other.t);
        self.weights.merge(other.weights);
    }

    /// Whether every verdict stands.
    pub fn is_right(&self) -> bool {
        self.false_misses + self.false_hits + self.wrong_closest + self.outside_range + self.contradictions == 0
    }
}

/// What neighbour queries found, compared with exact distances.
#[derive(Clone, Debug, Default)]
pub struct OrderTally {
    /// Queries.
    pub queries: usize,
    /// Answers that are farther than the exact one of the same place, beyond doubt.
    pub wrong_order: usize,
    /// The same in units, the worst.
    pub worst_order: f64,
    /// Points missing or too many, beyond doubt.
    pub wrong_count: usize,
    /// Approximate answers that break their promise.
    pub broken_promises: usize,
    /// Squared distances.
    pub distance: Errors,
    /// Times of closest approach.
    pub time: Errors,
    /// Distances of closest approach beside the exact ones of the input as it stands, without any doubt of it.
    pub as_given: Errors,
    /// How much farther the point that was found comes than the nearest one, in ulp of the distance, the worst.
    pub worst_as_given: f64,
}

impl OrderTally {
    /// Adds what another one counted.
    pub fn merge(&mut self, other: OrderTally) {
        self.queries += other.queries;
        self.wrong_order += other.wrong_order;
        self.worst_order = self.worst_order.max(other.worst_order);
        self.wrong_count += other.wrong_count;
        self.broken_promises += other.broken_promises;
        self.distance.merge(other.distance);
        self.time.merge(other.time);
        self.as_given.merge(other.as_given);
        self.worst_as_given = self.worst_as_given.max(other.worst_as_given);
    }

    /// Whether every answer stands.
    pub fn is_right(&self) -> bool {
        self.wrong_order + self.wrong_count + self.broken_promises == 0
    }
}
