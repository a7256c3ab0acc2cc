//! From a set of points to layers: checking the input, taking apart what stands still, dividing the
//! shutter into parts.

use super::error::PointError;
use super::moving_reference::{Mover, Part};
use super::moving_tree::MovingTree;
use super::order::Item;
use super::partition::Layer;
use super::plane_tree::PlaneTree;
use super::static_tree::StaticTree;
use crate::geometry::TimeInterval;
use crate::limits::{MAX_KEYS, MAX_POINT_COORDINATE};
use crate::primitive::PointSet;
use glam::DVec3;

/// How moving points are put into trees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Plan {
    /// Trees of boxes, so many side by side in time for each segment between keys.
    Boxes(usize),
    /// One k-d tree for each segment, with at most so many references for each point.
    Planes(f32),
}

impl Plan {
    /// Trees for each segment between keys.
    pub(super) fn parts(self) -> usize {
        match self {
            Plan::Boxes(parts) => parts,
            Plan::Planes(_) => 1,
        }
    }

    /// The layer over `movers` of each of these parts of the shutter.
    pub(super) fn layer(self, parts: &[Part], movers: impl Fn(&Part) -> Vec<Mover>) -> Layer {
        match self {
            Plan::Boxes(_) => Layer::Moving(parts.iter().map(|p| MovingTree::build(&movers(p), *p)).collect()),
            Plan::Planes(most) => Layer::Planes(parts.iter().map(|p| PlaneTree::build(&movers(p), *p, most)).collect()),
        }
    }
}

/// Checks everything that can be wrong with a set, and finds the origin its positions are relative to.
pub(super) fn check<P: PointSet + ?Sized>(points: &P) -> Result<DVec3, PointError> {
    let (len, keys) = (points.len(), points.keys());
    if let Some((name, expected, found)) = points.mismatch() {
        return Err(PointError::Length { name, expected, found });
    }
    if len > 0 && keys == 0 {
        return Err(PointError::NoKeys);
    }
    if keys > MAX_KEYS {
        return Err(PointError::TooManyKeys { found: keys });
    }
    if len >= u32::MAX as usize {
        return Err(PointError::TooManyPoints { found: len });
    }
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for key in 0..keys {
        for point in 0..len {
            let at = points.position(point, key);
            if !at.is_finite() {
                return Err(PointError::NonFinite { point, key });
            }
            lo = lo.min(at);
            hi = hi.max(at);
        }
    }
    if let Some(point) = (0..len).find(|&point| points.id(point) == u32::MAX) {
        return Err(PointError::ReservedId { point });
    }
    let origin = if P::WIDE && len > 0 { lo * 0.5 + hi * 0.5 } else { DVec3::ZERO };
    if len > 0 && ((hi - origin).max(origin - lo)).max_element() > MAX_POINT_COORDINATE {
        let far = |(point, key): &(usize, usize)| {
            (points.position(*point, *key) - origin).abs().max_element() > MAX_POINT_COORDINATE
        };
        let all = (0..keys).flat_map(|key| (0..len).map(move |point| (point, key)));
        if let Some((point, key)) = all.into_iter().find(far) {
            return Err(PointError::TooLarge { point, key });
        }
    }
    Ok(origin)
}

/// A set, its origin, and which of its points need moving trees.
pub(super) struct Source<'a, P: ?Sized> {
    pub(super) points: &'a P,
    pub(super) origin: DVec3,
}

impl<P: PointSet + ?Sized> Source<'_, P> {
    /// Position of a point at a key as the trees hold it.
    #[inline(always)]
    pub(super) fn at(&self, point: usize, key: usize) -> [f32; 3] {
        (self.points.position(point, key) - self.origin).as_vec3().to_array()
    }

    /// Whether a point neither moves nor lives for a part of the shutter only.
    pub(super) fn stands_still(&self, point: usize) -> bool {
        let first = self.at(point, 0);
        self.points.alive(point) == TimeInterval::FULL
            && (1..self.points.keys()).all(|key| self.at(point, key) == first)
    }

    /// A static tree of `count` of the points.
    pub(super) fn still_tree(&self, count: usize, select: impl Iterator<Item = usize>) -> StaticTree {
        let item = |i: usize| Item { at: self.at(i, 0), index: i as u32 };
        StaticTree::build(count, select.map(item), |i| self.points.id(i as usize))
    }

    /// The movers of a part of the shutter among some of the points.
    pub(super) fn movers(
        &self,
        part: &Part,
        select: impl Iterator<Item = usize>,
        id: impl Fn(usize) -> u32,
    ) -> Vec<Mover> {
        let later = (part.segment + 1).min(part.keys - 1);
        select
            .filter_map(|i| {
                let life = self.points.alive(i);
                let alive = life.intersect(part.interval)?;
                let (open, close) = (self.at(i, part.segment), self.at(i, later));
                Some(Mover { open, close, alive, life, id: id(i), fast: false })
            })
            .collect()
    }
}

/// The parts into which the shutter is divided: `per_segment` for each segment between keys.
pub(super) fn parts(keys: usize, per_segment: usize) -> Vec<Part> {
    let segments = (keys - 1).max(1);
    let count = segments * per_segment;
    let bound = |i: usize| if i == count { 2.0 } else { boundary(i, per_segment, keys) };
    let part = |i: usize| {
        let interval = TimeInterval::half_open(bound(i), bound(i + 1))?;
        Some(Part { keys, segment: i / per_segment, interval })
    };
    (0..count).filter_map(part).collect()
}

/// Begin of part `i`. At keys: the least float that queries count to the later segment.
fn boundary(i: usize, per_segment: usize, keys: usize) -> f32 {
    use crate::geometry::KeyTime;
    let segments = (keys - 1).max(1);
    let near = (i as f64 / (segments * per_segment) as f64) as f32;
    if !i.is_multiple_of(per_segment) || i == 0 {
        return near;
    }
    let segment = i / per_segment;
    let mut t = near;
    while KeyTime::new(t, keys).segment < segment {
        t = t.next_up();
    }
    while KeyTime::new(t.next_down(), keys).segment >= segment {
        t = t.next_down();
    }
    t
}

/// Builds a moving layer of some of the points.
pub(super) fn moving_layer<P: PointSet + ?Sized>(
    source: &Source<'_, P>,
    select: impl Iterator<Item = usize> + Clone,
    plan: Plan,
) -> Layer {
    let parts = parts(source.points.keys(), plan.parts());
    plan.layer(&parts, |part| source.movers(part, select.clone(), |i| source.points.id(i)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::KeyTime;

    #[test]
    fn every_time_is_in_one_part_and_in_its_segment() {
        for keys in [1, 2, 3, 4, 8, 11, 26] {
            for per_segment in [1, 2, 3, 8] {
                let parts = parts(keys, per_segment);
                assert_eq!(parts.len(), (keys - 1).max(1) * per_segment);
                let bounds = parts.iter().flat_map(|p| [p.interval.begin(), p.interval.end()]);
                let near = bounds.flat_map(|t| [t.next_down(), t, t.next_up()]);
                for t in near.chain((0..=997).map(|i| i as f32 / 997.0)).filter(|t| (0.0..=1.0).contains(t)) {
                    let holding: Vec<&Part> = parts.iter().filter(|p| p.interval.contains(t)).collect();
                    assert_eq!(holding.len(), 1, "{keys} keys, {per_segment} parts each, time {t}");
                    assert_eq!(KeyTime::new(t, keys).segment, holding[0].segment, "{keys} keys, time {t}");
                }
            }
        }
    }
}
