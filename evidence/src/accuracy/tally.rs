//! The error counts of comparisons.

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
    /// Counts an answer of magnitude `size` with an error of `error`, where half an ulp of input moves it by `doubt`.
    pub fn add(&mut self, error: f64, size: f64, doubt: f64) {
        let ulp = ulp32(size);
        let error = error.abs();
        // Problems whose doubt is not finite cannot be measured.
        if !doubt.is_finite() {
            return;
        }
        self.units.push((error / (doubt + ulp / 2.0)) as f32);
        if doubt <= WELL * ulp {
            self.ulps.push((error / ulp) as f32);
        }
    }

    /// Adds the counts of another comparison.
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

    /// The share of well-conditioned answers.
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

    /// The quantile `q` of the errors in ulp of the well-conditioned answers.
    pub fn quantile_ulps(&self, q: f64) -> f64 {
        let mut sorted = self.ulps.clone();
        sorted.sort_by(f32::total_cmp);
        let at = ((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1));
        sorted.get(at).copied().unwrap_or(0.0).into()
    }
}

/// The hits of rays, compared with the exact ones.
#[derive(Clone, Debug, Default)]
pub struct RayTally {
    /// Rays traced.
    pub rays: usize,
    /// Hits that the exact answer has.
    pub hits: usize,
    /// Certain exact hits that were not reported.
    pub false_misses: usize,
    /// Reported hits that are certainly misses.
    pub false_hits: usize,
    /// The greatest certainty, in units, of an exact verdict that was missed.
    pub worst_verdict: f64,
    /// Closest hits that are certainly farther than another hit.
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
    /// Adds the counts of another comparison.
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

    /// Whether no answer is wrong.
    pub fn is_right(&self) -> bool {
        self.false_misses + self.false_hits + self.wrong_closest + self.outside_range + self.contradictions == 0
    }
}

/// The answers of neighbour queries, compared with exact distances.
#[derive(Clone, Debug, Default)]
pub struct OrderTally {
    /// Queries.
    pub queries: usize,
    /// Answers that are certainly farther than the exact one of the same rank.
    pub wrong_order: usize,
    /// The greatest such excess in units.
    pub worst_order: f64,
    /// Points that are certainly missing or superfluous.
    pub wrong_count: usize,
    /// Approximate answers beyond their guaranteed bound.
    pub broken_promises: usize,
    /// Squared distances.
    pub distance: Errors,
    /// Times of closest approach.
    pub time: Errors,
    /// Distances of closest approach compared with the exact ones of the input as given, without any input error.
    pub as_given: Errors,
    /// The greatest excess of the found point's distance over that of the nearest one, in ulp of the distance.
    pub worst_as_given: f64,
}

impl OrderTally {
    /// Adds the counts of another comparison.
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

    /// Whether no answer is wrong.
    pub fn is_right(&self) -> bool {
        self.wrong_order + self.wrong_count + self.broken_promises == 0
    }
}
