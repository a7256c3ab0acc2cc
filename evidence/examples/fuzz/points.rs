//! Trees of points: nearest, k nearest, within a radius, approximate, filtered, in batches and visited, against all distances
//! in order; closest approaches against those of each point alone; files and rebuilds.

use crate::clouds::{Cloud, params};
use crate::compare::Outcome;
use crate::periodic;
use crate::random::Random;
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{
    Aabb, Approach, Neighbor, NeighborBuffer, PointError, PointLayerKind, PointStructure, PointTree, Precision,
    TreePoint, Visitor,
};

fn in_order(mut found: Vec<Neighbor>) -> Vec<Neighbor> {
    found.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.id.cmp(&b.id)));
    found
}

/// Compares all forms of one query.
pub fn check(random: &mut Random, tree: &PointTree, all: &[Neighbor], q: DVec3, time: f32, what: &str) -> Outcome {
    let mut buffer = NeighborBuffer::new();
    same!(tree.nearest(q, time), all.first().copied(), "{what}: nearest");
    for k in [0, 1, 7, 33, random.below(all.len() + 20), usize::MAX] {
        let nearest = &all[..k.min(all.len())];
        same!(tree.query(q, time).nearest_n_into(k, &mut buffer), nearest, "{what}: {k} nearest");
    }
    let at = |i: usize| all.get(i).map_or(1.0, |n| n.distance_squared.sqrt());
    let some = at(random.below(all.len()));
    for radius in [0.0, at(0), some, some.next_down(), some.next_up(), f32::INFINITY, -1.0, f32::NAN] {
        let what = format!("{what}, radius {radius}");
        let within = |n: &&Neighbor| radius >= 0.0 && n.distance_squared <= radius * radius;
        let inside: Vec<Neighbor> = all.iter().filter(within).copied().collect();
        let query = || tree.query(q, time).radius(radius);
        same!(in_order(query().collect()), inside, "{what}: collect");
        same!(query().collect_sorted_into(&mut buffer), &inside, "{what}: collect_sorted");
        same!(query().count(), inside.len(), "{what}: count");
        same!(query().nearest(), inside.first().copied(), "{what}: nearest");
        same!(in_order(query().iter().collect()), inside, "{what}: iter");
        same!(tree.nearest_n_within(q, time, 5, radius), inside[..inside.len().min(5)], "{what}: 5 nearest");
        let modulus = 2 + random.below(3) as u32;
        let keep = |id: u32| id.is_multiple_of(modulus);
        let kept: Vec<Neighbor> = inside.iter().filter(|n| keep(n.id)).copied().collect();
        same!(query().filter(keep).collect_sorted(), kept, "{what}: filtered by {modulus}");
        same!(query().filter(keep).nearest(), kept.first().copied(), "{what}: nearest filtered by {modulus}");
        let k = random.below(40);
        same!(query().filter(keep).nearest_n(k), kept[..k.min(kept.len())], "{what}: {k} filtered by {modulus}");
        let epsilon = random.pick(&[0.0, 0.1, 2.0, f32::INFINITY, f32::NAN]);
        let near = query().approximate(epsilon).nearest_n(k);
        same!(near.len(), inside.len().min(k), "{what}: {k} up to {epsilon}");
        let most = if epsilon > 0.0 { 1.0 + f64::from(epsilon) } else { 1.0 };
        for (found, exact) in near.iter().zip(&inside) {
            let [found_at, exact_at] = [found, exact].map(|n| f64::from(n.distance_squared).sqrt());
            ensure!(found_at <= exact_at * most || found_at == exact_at, "{what}: {epsilon}, {found:?} for {exact:?}");
            ensure!(inside.contains(found), "{what}: {epsilon}, {found:?}");
        }
        let mut seen = 0;
        let flow = query().for_each(|_| {
            seen += 1;
            if seen == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        same!((seen, flow.is_break()), (inside.len().min(3), inside.len() >= 3), "{what}: for_each");
    }
    Ok(())
}

/// Batches answer like single queries.
pub fn check_batches(tree: &PointTree, queries: &[(DVec3, f32)], radius: f32, what: &str) -> Outcome {
    let accept = |i: usize, id: u32| !(i + id as usize).is_multiple_of(3);
    let (nearest, some, within) =
        (tree.nearest_batch(queries), tree.nearest_n_batch(queries, 6), tree.within_batch(queries, radius));
    let filtered = tree.nearest_batch_with(queries, |i, query| query.filter(move |id| accept(i, id)));
    let some_filtered = tree.nearest_n_batch_with(queries, 6, |i, query| {
        query.radius(radius).approximate(0.1).filter(move |id| accept(i, id))
    });
    let within_filtered =
        tree.within_batch_with(queries, |i, query| query.radius(radius).filter(move |id| accept(i, id)));
    for (i, &(q, time)) in queries.iter().enumerate() {
        let query = || tree.query(q, time).filter(|id| accept(i, id));
        same!(nearest[i], tree.nearest(q, time), "{what}: batch, {q} at {time}");
        same!(some.row(i), tree.nearest_n(q, time, 6), "{what}: batch of 6, {q} at {time}");
        same!(within.row(i), tree.query(q, time).radius(radius).collect_sorted(), "{what}: within, {q} at {time}");
        same!(filtered[i], query().nearest(), "{what}: filtered batch, {q} at {time}");
        let some = query().radius(radius).approximate(0.1).nearest_n(6);
        same!(some_filtered.row(i), some, "{what}: batch of 6 with options, {q} at {time}");
        let near = query().radius(radius).collect_sorted();
        same!(within_filtered.row(i), near, "{what}: filtered, within {radius}, {q} at {time}");
    }
    Ok(())
}

/// Sees all points, and whether they are in a box that it entered.
struct Everything {
    boxes: Vec<Aabb>,
    found: Vec<TreePoint>,
    outside: bool,
}

impl Visitor<TreePoint> for Everything {
    fn enter(&mut self, of: &Aabb) -> Option<f32> {
        self.boxes.push(*of);
        Some(0.0)
    }

    fn visit(&mut self, point: TreePoint) -> ControlFlow<()> {
        self.outside |= !self.boxes.iter().any(|b| b.contains(point.position));
        self.found.push(point);
        ControlFlow::Continue(())
    }
}

pub fn check_visitor(tree: &PointTree, cloud: &Cloud, time: f32, what: &str) -> Outcome {
    let mut all = Everything { boxes: Vec::new(), found: Vec::new(), outside: false };
    ensure!(tree.traverse(time, &mut all).is_continue(), "{what}: traverse");
    // A k-d tree may be a single leaf, which has no box.
    let cells = tree.statistics().layers.iter().any(|layer| matches!(layer.kind, PointLayerKind::Kd));
    ensure!(cells || !all.outside, "{what}: a point is in no box at {time}");
    let mut found: Vec<(u32, [u64; 3])> = all
        .found
        .iter()
        .map(|p| (p.id, (p.position - tree.origin()).to_array().map(|x| (x + 0.0).to_bits())))
        .collect();
    found.sort_unstable();
    found.dedup();
    let exist = (0..cloud.len()).filter(|&i| cloud.active[i].contains(time));
    let origin = if cloud.double { tree.origin() } else { DVec3::ZERO };
    let place = |i: usize| (cloud.at(i, time) - origin).to_array().map(|x| (x + 0.0).to_bits());
    let mut expected: Vec<(u32, [u64; 3])> = exist.map(|i| (cloud.ids[i], place(i))).collect();
    expected.sort_unstable();
    expected.dedup();
    if cloud.double || tree.origin() == DVec3::ZERO {
        same!(found, expected, "{what}: visited at {time}");
    }
    Ok(())
}

/// The closest approach is the best of those of each point alone; the distance is that of the paths.
fn check_approach(random: &mut Random, trees: &[PointTree], cloud: &Cloud, what: &str) -> Outcome {
    let interval = random.interval();
    let (from, to) = (cloud.query(random, interval.begin()), cloud.query(random, interval.end()));
    let to = if random.one_in(5) { from } else { to };
    let what = format!("{what}: from {from} to {to} in {interval:?}");
    let order = |a: &Approach| (a.distance, a.time, a.id);
    let mut best: Option<Approach> = None;
    for &id in cloud.ids.iter().filter(|_| cloud.len() < 400) {
        let alone = trees[0].closest_approach_filtered(from, to, interval, |other| other == id);
        if alone.is_some_and(|alone| best.is_none_or(|best| order(&alone) < order(&best))) {
            best = alone;
        }
    }
    for tree in trees {
        let found = tree.closest_approach(from, to, interval);
        same!(found, trees[0].closest_approach(from, to, interval), "{what}: other structures differ");
        if cloud.len() < 400 {
            same!(found, best, "{what}: best of all alone");
        }
    }
    Ok(())
}

pub fn case(random: &mut Random) -> Outcome {
    let double = random.one_in(3);
    let mut cloud = Cloud::random(random, 20_000, double);
    // Several points may have the same id.
    let distinct = !random.one_in(8);
    if !distinct {
        cloud.ids.iter_mut().for_each(|id| *id = 7 * random.below(1 + *id as usize) as u32);
    }
    let rounded = double && random.one_in(3);
    let widened = !double && random.one_in(6);
    if widened {
        cloud.widen();
    }
    let precision = match (rounded, widened) {
        (true, _) => Precision::Single,
        (_, true) => Precision::Double,
        _ => Precision::Automatic,
    };
    let mut trees = Vec::new();
    for _ in 0..3 {
        let params = mbkd::PointParams { precision, ..params(random) };
        match cloud.tree(&params) {
            Err(PointError::Parameter { name: "structure", .. })
                if cloud.double && !rounded && params.structure == PointStructure::Kd => {}
            tree => trees.push((tree.map_err(|error| format!("{params:?}: {error}"))?, format!("{params:?}"))),
        }
    }
    let Some((first, _)) = trees.first() else { return Ok(()) };
    let origin = first.origin();
    if rounded {
        cloud.round(origin);
    }
    // What the caller's coordinates are relative to.
    let shift = if rounded { origin } else { DVec3::ZERO };
    let mut queries = Vec::new();
    for _ in 0..if cloud.len() > 4000 { 3 } else { 8 } {
        let time = random.any_time();
        let q = cloud.query(random, time);
        // As the tree sees it.
        let seen = if rounded { (q + shift - origin).as_vec3().as_dvec3() } else { q };
        let all = if (0.0..=1.0).contains(&time) { cloud.sorted(seen, time) } else { Vec::new() };
        for (tree, params) in &trees {
            let what = format!("{} points, {params}, {q} at {time}", cloud.len());
            check(random, tree, &all, q + shift, time, &what)?;
            if (0.0..=1.0).contains(&time) {
                check_visitor(tree, &cloud, time, &what)?;
                if distinct && !rounded {
                    periodic::check(random, tree, &cloud, (q, time), &what)?;
                }
            }
        }
        queries.push((q + shift, time));
    }
    let radius = (cloud.places.scale * f64::from(random.unit())) as f32;
    let mut plain = Vec::new();
    for (tree, params) in trees {
        check_batches(&tree, &queries, radius, &params)?;
        let mut bytes = Vec::new();
        tree.write_to(&mut bytes).map_err(|error| format!("{params}: {error}"))?;
        let read = PointTree::read_from(&mut bytes.as_slice()).map_err(|error| format!("{params}: read: {error}"))?;
        let mut again = Vec::new();
        read.write_to(&mut again).map_err(|error| format!("{params}: {error}"))?;
        ensure!(bytes == again, "{params}: written, read and written: other bytes");
        for &(q, time) in &queries {
            same!(read.nearest_n(q, time, 9), tree.nearest_n(q, time, 9), "{params}, from a file");
        }
        plain.push(tree);
    }
    if !rounded {
        check_approach(random, &plain, &cloud, "closest approach")?;
    }
    rebuilds(random, cloud, plain.swap_remove(0))
}

/// The tree built again from step to step.
fn rebuilds(random: &mut Random, mut cloud: Cloud, mut tree: PointTree) -> Outcome {
    for step in 0..random.below(3) {
        if cloud.double || cloud.len() == 0 {
            return Ok(());
        }
        let far = cloud.places.scale * random.pick(&[1e-3, 0.1, 2.0]);
        let params = params(random);
        cloud.keys.truncate(1);
        cloud.active.fill(mbkd::TimeInterval::FULL);
        cloud.ids = (0..cloud.len() as u32).collect();
        cloud.keys[0].iter_mut().for_each(|p| *p += random.vec() * far);
        if random.one_in(6) {
            let more = cloud.keys[0].len() / 2;
            cloud.keys[0].truncate(more);
            cloud.active.truncate(more);
            cloud.ids.truncate(more);
        }
        cloud.round(DVec3::ZERO);
        if random.one_in(4) {
            tree.take_order();
        }
        let points: Vec<_> = cloud.keys[0].iter().map(|p| p.as_vec3()).collect();
        let kept = tree.rebuild(&points, &params).map_err(|error| format!("rebuild: {error}"))?;
        let time = random.time();
        let q = cloud.query(random, time);
        let what = format!("{} points, {params:?}, {q} at {time}, step {step}, kept {kept}", cloud.len());
        check(random, &tree, &cloud.sorted(q, time), q, time, &what)?;
    }
    Ok(())
}
