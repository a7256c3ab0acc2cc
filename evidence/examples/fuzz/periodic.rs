//! Queries in periodic boxes against all distances from all images of the query point.

use crate::clouds::Cloud;
use crate::compare::Outcome;
use crate::random::Random;
use mbkd::glam::DVec3;
use mbkd::{MAX_POINT_COORDINATE, Neighbor, NeighborBuffer, PeriodError, PointTree};

/// The greatest number of distances that a query is compared with.
const MOST: usize = 200_000;

/// The query point moved by whole periods to all places around a box, and farther; `None` if these are too many.
fn images(place: DVec3, lengths: [Option<f64>; 3], (low, high): (DVec3, DVec3), most: usize) -> Option<Vec<DVec3>> {
    let mut images = vec![place];
    for axis in 0..3 {
        let Some(length) = lengths[axis] else { continue };
        let x = place[axis];
        let home = if (0.0..length).contains(&x) { x } else { x.rem_euclid(length) };
        let first = ((low[axis] - home) / length).floor() as i64 - 2;
        let last = ((high[axis] - home) / length).ceil() as i64 + 2;
        if last - first > 40 || images.len() * (last - first + 1) as usize > most {
            return None;
        }
        let along: Vec<f64> = (first..=last).map(|periods| home + periods as f64 * length).collect();
        let moved = |image: &DVec3, x: f64| {
            let mut image = *image;
            image[axis] = x;
            image
        };
        images = images.iter().flat_map(|image| along.iter().map(move |&x| moved(image, x))).collect();
    }
    Some(images)
}

/// Compares all forms of one query in a box whose lengths are about those of the set.
pub fn check(random: &mut Random, tree: &PointTree, cloud: &Cloud, (q, time): (DVec3, f32), what: &str) -> Outcome {
    let places = || cloud.keys.iter().flatten().copied();
    let Some(first) = places().next() else { return Ok(()) };
    let (low, high) = (places().fold(first, DVec3::min), places().fold(first, DVec3::max));
    let size = (high - low).max_element().max(cloud.places.scale * 1e-3);
    let lengths = [0, 1, 2].map(|_| (!random.one_in(3)).then(|| size * random.pick(&[0.1, 0.4, 0.9, 1.1, 3.0])));
    let q = q + random.vec() * size * random.pick(&[0.0, 0.0, 1.0, 30.0]);
    let q = if cloud.double { q } else { q.as_vec3().as_dvec3() };
    if q.abs().max_element() > MAX_POINT_COORDINATE {
        return Ok(());
    }
    let Some(images) = images(q, lengths, (low, high), MOST / cloud.len()) else { return Ok(()) };
    let what = format!("{what}, periods {lengths:?} from {q}");
    let periodic = match tree.periodic(lengths) {
        // The tree's box may be larger than the set.
        Err(PeriodError::Extent { axis }) => {
            let extent = tree.bounds().map_or(0.0, |of| of.max[axis] - of.min[axis]);
            ensure!(lengths[axis].is_some_and(|length| extent > 16.0 * length), "{what}: {extent} along axis {axis}");
            return Ok(());
        }
        Err(PeriodError::FarFromPeriod { axis }) => {
            let most = tree.bounds().map_or(0.0, |of| of.max[axis].abs().max(of.min[axis].abs()));
            ensure!(lengths[axis].is_some_and(|length| most > 1e12 * length), "{what}: {most} along axis {axis}");
            return Ok(());
        }
        periodic => periodic.map_err(|error| format!("{what}: {error}"))?,
    };
    let seen = |image: &DVec3| if cloud.double { *image } else { image.as_vec3().as_dvec3() };
    let mut all: Vec<Neighbor> = images.iter().flat_map(|image| cloud.sorted(seen(image), time)).collect();
    all.sort_by_key(|near| (near.id, near.distance_squared.to_bits()));
    all.dedup_by_key(|near| near.id);
    all.sort_by_key(|near| (near.distance_squared.to_bits(), near.id));
    let mut buffer = NeighborBuffer::new();
    same!(periodic.query(q, time).nearest(), all.first().copied(), "{what}: nearest");
    for k in [0, 1, 7, random.below(all.len() + 20)] {
        let nearest = &all[..k.min(all.len())];
        same!(periodic.query(q, time).nearest_n_into(k, &mut buffer), nearest, "{what}: {k} nearest");
    }
    let at = |i: usize| all.get(i).map_or(1.0, |n| n.distance_squared.sqrt());
    let some = at(random.below(all.len()));
    for radius in [0.0, at(0), some, some.next_down(), some.next_up(), f32::INFINITY] {
        let what = format!("{what}, radius {radius}");
        let within = |n: &&Neighbor| radius >= 0.0 && n.distance_squared <= radius * radius;
        let inside: Vec<Neighbor> = all.iter().filter(within).copied().collect();
        let query = || periodic.query(q, time).radius(radius);
        same!(query().collect_sorted_into(&mut buffer), &inside, "{what}: collect_sorted");
        same!(query().count(), inside.len(), "{what}: count");
        same!(query().nearest_n(5), inside[..inside.len().min(5)], "{what}: 5 nearest");
        let kept: Vec<Neighbor> = inside.iter().filter(|n| n.id % 2 == 1).copied().collect();
        same!(query().filter(|id| id % 2 == 1).nearest_n(9), kept[..kept.len().min(9)], "{what}: 9 filtered");
        let near = query().approximate(0.5).nearest_n(6);
        same!(near.len(), inside.len().min(6), "{what}: 6 up to a half");
        for (found, exact) in near.iter().zip(&inside) {
            let [found, exact] = [found, exact].map(|n| f64::from(n.distance_squared).sqrt());
            ensure!(found <= exact * 1.5 || found == exact, "{what}: {found} for {exact}");
        }
    }
    Ok(())
}

/// Where points share ids, those of one id may count as one point, the nearest: no neighbour is farther away than if they do, and
/// none is missing.
pub fn check_repeated(random: &mut Random, tree: &PointTree, cloud: &Cloud, at: (DVec3, f32), what: &str) -> Outcome {
    let (q, time) = at;
    let places = || cloud.keys.iter().flatten().copied();
    let Some(first) = places().next() else { return Ok(()) };
    let (low, high) = (places().fold(first, DVec3::min), places().fold(first, DVec3::max));
    let size = (high - low).max_element().max(cloud.places.scale * 1e-3);
    let lengths = [0, 1, 2].map(|_| (!random.one_in(3)).then(|| size * random.pick(&[0.4, 0.9, 1.1, 3.0])));
    let Some(images) = images(q, lengths, (low, high), MOST / cloud.len()) else { return Ok(()) };
    let Ok(periodic) = tree.periodic(lengths) else { return Ok(()) };
    let what = format!("{what}, periods {lengths:?} from {q} at {time}, ids repeat");
    let seen = |image: &DVec3| if cloud.double { *image } else { image.as_vec3().as_dvec3() };
    let mut all: Vec<Neighbor> = images.iter().flat_map(|image| cloud.sorted(seen(image), time)).collect();
    all.sort_by_key(|near| (near.distance_squared.to_bits(), near.id));
    let mut known = std::collections::HashSet::new();
    let once: Vec<Neighbor> = all.iter().filter(|near| known.insert(near.id)).copied().collect();
    same!(periodic.query(q, time).nearest(), once.first().copied(), "{what}: nearest");
    for k in [1, 2, 5, random.below(once.len() + 5)] {
        let found = periodic.query(q, time).nearest_n(k);
        ensure!(found.len() >= k.min(once.len()), "{what}: {k} nearest: {found:?} of {once:?}");
        ensure!(found.iter().all(|near| all.contains(near)), "{what}: {k} nearest: {found:?} of {all:?}");
        ensure!(
            found.is_sorted_by_key(|near| (near.distance_squared.to_bits(), near.id)),
            "{what}: {k} nearest: {found:?}"
        );
        for (found, once) in found.iter().zip(&once) {
            ensure!(
                found.distance_squared.to_bits() <= once.distance_squared.to_bits(),
                "{what}: {k} nearest: {found:?}, not {once:?}"
            );
        }
    }
    let radius = once.get(random.below(once.len())).map_or(1.0, |near| near.distance());
    let inside = |near: &&Neighbor| near.distance_squared <= radius * radius;
    let found = periodic.query(q, time).radius(radius).collect();
    for near in once.iter().filter(inside) {
        ensure!(found.contains(near), "{what}: {near:?} is missing within {radius}");
    }
    ensure!(found.iter().all(|near| all.contains(near)), "{what}: within {radius}: {found:?}");
    same!(periodic.query(q, time).radius(radius).count(), found.len(), "{what}: count within {radius}");
    Ok(())
}
