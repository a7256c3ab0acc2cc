//! Samples of a tree that is not built yet: groups of neighbouring references.

use super::binning::{Table, find_split, summary};
use super::partition::partition;
use super::reference::Reference;
use crate::geometry::Box3;
use crate::parallel;

/// The greatest number of references that sample boxes are found among; if there are more, evenly spaced ones are used.
const SAMPLED: usize = 4096;

/// The least number of references per task when neighbours are collected.
const PER_TASK: usize = 16384;

/// Groups of about `most` neighbours around evenly spaced references: samples of the tree over all references.
///
/// Object splits of a subset of the references find a box around each sample; one pass over all references collects
/// those with their centres in it.
pub(crate) fn neighbourhoods(references: &[Reference], count: usize, most: usize) -> Vec<Vec<Reference>> {
    let step = references.len() / SAMPLED + 1;
    let mut few: Vec<Reference> = references.iter().step_by(step).copied().collect();
    let places: Vec<Box3> = (0..count)
        .map(|i| {
            let at = (2 * i + 1) * few.len() / (2 * count);
            summary(isolate(&mut few, at, most / step)).1
        })
        .collect();
    let chunk = PER_TASK.max(references.len() / 64);
    let found = parallel::map(references.len().div_ceil(chunk), |task| {
        let mut found = vec![Vec::new(); count];
        for r in &references[task * chunk..references.len().min((task + 1) * chunk)] {
            for (place, found) in places.iter().zip(&mut found) {
                if place.holds(r.centre().truncate()) {
                    found.push(*r);
                }
            }
        }
        found
    });
    let mut all = vec![Vec::new(); count];
    for found in found {
        for (all, found) in all.iter_mut().zip(found) {
            all.extend(found.into_iter().take(2 * most - all.len()));
        }
    }
    all
}

/// Reorders references by object splits until index `at` is in a group of at most `most` neighbours, and returns the
/// group.
fn isolate(mut references: &mut [Reference], mut at: usize, most: usize) -> &mut [Reference] {
    let (_, mut centres) = summary(references);
    while references.len() > most.max(1) {
        let Some(split) = Table::lend(|table| find_split(references, centres, false, table)) else { break };
        let [low, high] = partition(references, &split);
        let sides = references.split_at_mut(split.middle);
        (references, centres, at) =
            if at < split.middle { (sides.0, low, at) } else { (sides.1, high, at - split.middle) };
    }
    references
}
