//! Trees of points that live on: cloned, saved and loaded, renumbered in their order, and built again for sets of any kind. After
//! each step all queries and lists are compared with all pairs, also where points share ids.

use crate::clouds::{Cloud, params};
use crate::compare::Outcome;
use crate::lists::{
    Entry, kinds_of_radii, may_refuse, meet, periodic_box, radii, radius_of_pair, squared, without_noise,
};
use crate::periodic;
use crate::points;
use crate::random::Random;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Encounter, EncounterLists, ListError, NeighborLists, PointError, PointParams, PointStructure, PointTree, Precision,
    Radii, SimdLevel,
};
use std::collections::{BTreeMap, HashMap};

/// Pairs of points and images in pairs of segments between keys that a case compares at most.
const MOST: usize = 3_000_000;

/// Points and the tree over them.
struct Life {
    cloud: Cloud,
    tree: PointTree,
}

pub fn bytes(tree: &PointTree) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).expect("memory takes everything");
    bytes
}

/// A set that is kept in f64 or not, with ids that may repeat.
fn any_cloud(random: &mut Random, most: usize) -> Cloud {
    let double = random.one_in(3);
    let mut cloud = Cloud::random(random, most, double);
    if random.one_in(3) {
        let share = 1 + random.below(4) as u32;
        cloud.ids.iter_mut().for_each(|id| *id = 3 * (*id / share));
    }
    if !double && random.one_in(6) {
        cloud.widen();
    }
    cloud
}

/// Parameters that a set allows.
fn params_for(random: &mut Random, cloud: &Cloud) -> PointParams {
    let precision = if cloud.double { Precision::Double } else { Precision::Automatic };
    let params = PointParams { precision, ..params(random) };
    match params.structure {
        PointStructure::Kd if cloud.double => PointParams { structure: PointStructure::Automatic, ..params },
        PointStructure::TimeSlices(slices) if slices * cloud.segments() > 2000 => {
            PointParams { structure: PointStructure::Linear, ..params }
        }
        _ => params,
    }
}

/// The set as it may be in the next step: moved a little, at rest, another one of the same size, or another one.
fn next(random: &mut Random, cloud: &Cloud, most: usize) -> Cloud {
    let mut next = cloud.clone();
    let far = cloud.places.scale * random.pick(&[0.0, 1e-3, 0.1, 2.0]);
    match random.below(5) {
        0 => return any_cloud(random, most),
        1 => {}
        2 => next.ids = (0..cloud.len() as u32).collect(),
        _ => {
            next.keys.truncate(1);
            next.active.fill(mbkd::TimeInterval::FULL);
            next.ids = (0..cloud.len() as u32).collect();
        }
    }
    next.keys.iter_mut().flatten().for_each(|p| *p += random.vec() * far);
    if next.double && random.one_in(2) {
        next.widen();
    } else {
        next.round(DVec3::ZERO);
    }
    next
}

/// Renumbers the points as the tree does: those of an old id that got several new ones are told apart by where they are.
fn renumber(life: &mut Life, what: &str) -> Outcome {
    let Life { cloud, tree } = life;
    let order = tree.take_order();
    let mut numbers: HashMap<u32, Vec<u32>> = HashMap::new();
    (0u32..).zip(&order).for_each(|(new, old)| numbers.entry(*old).or_default().push(new));
    if numbers.values().all(|new| new.len() == 1) {
        let distinct = cloud.ids.iter().collect::<std::collections::HashSet<_>>().len();
        same!(order.len(), distinct, "{what}: numbers in the order");
        for id in &mut cloud.ids {
            *id = numbers.get(id).ok_or_else(|| format!("{what}: {id} is not in the order"))?[0];
        }
        return Ok(());
    }
    same!(order.len(), cloud.len(), "{what}: numbers in the order");
    // Only trees of one static structure do so.
    let origin = if cloud.double { DVec3::ZERO } else { tree.origin() };
    let mut places: HashMap<(u32, [u64; 3]), Vec<u32>> = HashMap::new();
    let key = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    for point in tree.points_at(0.0) {
        let old = order[point.id as usize];
        places.entry((old, key(point.position - origin))).or_default().push(point.id);
    }
    for i in 0..cloud.len() {
        let at = (cloud.ids[i], key(cloud.at(i, 0.0)));
        let new = places.get_mut(&at).and_then(Vec::pop);
        cloud.ids[i] = new.ok_or_else(|| format!("{what}: no point of id {} is at {}", at.0, cloud.at(i, 0.0)))?;
    }
    Ok(())
}

pub fn case(random: &mut Random) -> Outcome {
    let most = random.pick(&[20, 60, 200, 200, 3000]);
    let cloud = any_cloud(random, most);
    let first = params_for(random, &cloud);
    let tree = cloud.tree(&first).map_err(|error| format!("{first:?}: {error}"))?;
    let (mut life, mut what) = (Life { cloud, tree }, format!("{first:?}"));
    check(random, &life, &what)?;
    for _ in 0..1 + random.below(4) {
        let before = random.one_in(2).then(|| (life.tree.clone(), bytes(&life.tree)));
        match random.below(7) {
            0 => {
                what += "; file";
                life.tree =
                    PointTree::read_from(&mut bytes(&life.tree).as_slice()).map_err(|error| error.to_string())?;
            }
            1 => {
                what += "; order";
                renumber(&mut life, &what)?;
            }
            2 => life.tree = life.tree.with_simd(random.pick(&SimdLevel::available())),
            3 => {
                what += "; refused";
                refused(random, &mut life, &what)?;
            }
            _ => {
                life.cloud = next(random, &life.cloud, most);
                let params = params_for(random, &life.cloud);
                let kept = rebuild(&mut life.tree, &life.cloud, &params).map_err(|error| format!("{what}: {error}"))?;
                what += &format!("; rebuilt with {params:?}, kept {kept}");
                let fresh = life.cloud.tree(&params).map_err(|error| format!("{what}: {error}"))?;
                ensure!(kept || bytes(&fresh) == bytes(&life.tree), "{what}: not as built");
                same!(life.tree.precision(), fresh.precision(), "{what}: precision");
            }
        }
        check(random, &life, &what)?;
        if let Some((tree, before)) = before {
            ensure!(bytes(&tree) == before, "{what}: a clone has changed");
        }
    }
    Ok(())
}

fn rebuild(tree: &mut PointTree, cloud: &Cloud, params: &PointParams) -> Result<bool, PointError> {
    cloud.with_set(|single, double| match (single, double) {
        (Some(set), _) => tree.rebuild(&set, params),
        (_, Some(set)) => tree.rebuild(&set, params),
        _ => Ok(false),
    })
}

/// A step that must fail leaves the tree as it is.
fn refused(random: &mut Random, life: &mut Life, what: &str) -> Outcome {
    let before = bytes(&life.tree);
    let count = if random.one_in(2) { life.cloud.len() } else { 3 };
    let mut points = vec![Vec3::ONE; count];
    let params = params(random);
    let result = match points.last_mut() {
        Some(last) if random.one_in(2) => {
            *last = random.pick(&[Vec3::NAN, Vec3::INFINITY, Vec3::splat(1e19)]);
            life.tree.rebuild(&points, &params)
        }
        _ => life.tree.rebuild(&points, &PointParams { max_references: 0.0, ..params }),
    };
    ensure!(result.is_err(), "{what}: a bad set was taken");
    ensure!(bytes(&life.tree) == before, "{what}: the tree has changed");
    Ok(())
}

fn check(random: &mut Random, life: &Life, what: &str) -> Outcome {
    let Life { cloud, tree } = life;
    let what = &format!("{} points, {what}", cloud.len());
    same!(tree.len(), cloud.len(), "{what}: len");
    statistics(tree, cloud, what)?;
    // Whether a key is on a line is a matter of rounding where it is just as far from it as is allowed.
    let kept = tree.statistics().layers.iter().map(|layer| layer.keys).max().unwrap_or(1).max(2);
    if kept != cloud.segments() + 1 {
        return Ok(());
    }
    let mut queries = Vec::new();
    for _ in 0..2 {
        let time = random.any_time();
        let q = cloud.query(random, time);
        let exists = (0.0..=1.0).contains(&time);
        let all = if exists { cloud.sorted(q, time) } else { Vec::new() };
        points::check(random, tree, &all, q, time, &format!("{what}, {q} at {time}"))?;
        if exists {
            present(tree, cloud, time, what)?;
            if cloud.len() < 100 {
                periodic::check_repeated(random, tree, cloud, (q, time), what)?;
            }
        }
        queries.push((q, time));
    }
    let radius = cloud.places.scale as f32 * random.pick(&[0.0, 0.02, 0.1, 0.3, 3.0, f32::INFINITY]);
    points::check_batches(tree, &queries, radius, what)?;
    if cloud.len() > 220 {
        return Ok(());
    }
    let radii = radii(random, cloud.ids.iter().max().map_or(0, |most| *most as usize + 1), radius);
    lists(random, life, radius, &radii, what)?;
    around(random, life, radius, what)?;
    swept(random, life, radius, &radii, what)
}

/// What statistics say is what there is.
fn statistics(tree: &PointTree, cloud: &Cloud, what: &str) -> Outcome {
    let of = tree.statistics();
    let points: usize = of.layers.iter().map(|layer| layer.points).sum();
    let references: usize = of.layers.iter().map(|layer| layer.references).sum();
    same!(points, cloud.len(), "{what}: points of {of:?}");
    same!(references, tree.ids().count(), "{what}: references of {of:?}");
    Ok(())
}

/// Each point that exists is there once, where it should be, and within the bounds.
fn present(tree: &PointTree, cloud: &Cloud, time: f32, what: &str) -> Outcome {
    let origin = if cloud.double { DVec3::ZERO } else { tree.origin() };
    let bits = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    let mut found: Vec<_> = tree.points_at(time).iter().map(|p| (p.id, bits(p.position - origin))).collect();
    let exist: Vec<usize> = (0..cloud.len()).filter(|&i| cloud.active[i].contains(time)).collect();
    let mut expected: Vec<_> = exist.iter().map(|&i| (cloud.ids[i], bits(cloud.at(i, time)))).collect();
    found.sort_unstable();
    expected.sort_unstable();
    same_lists!(found, expected, "{what}: points at {time}");
    let bounds = tree.bounds();
    for i in exist {
        let at = cloud.at(i, time) + origin;
        ensure!(bounds.is_some_and(|bounds| bounds.contains(at)), "{what}: {at} at {time} is not in {bounds:?}");
    }
    Ok(())
}

/// Lists at a time, where each point has one, whatever ids they have.
fn lists(random: &mut Random, Life { cloud, tree }: &Life, radius: f32, own: &[f32], what: &str) -> Outcome {
    let (time, once) = (random.time(), random.one_in(3));
    let (periods, _) = periodic_box(random, [cloud, cloud]);
    let radii = random.pick(&kinds_of_radii(radius, own, own));
    let what = format!("{what}: lists at {time}, {radii:?}, once {once}, periods {periods:?}");
    let mut expected: Vec<(u32, Vec<Entry>)> = Vec::new();
    for i in (0..cloud.len()).filter(|&i| cloud.active[i].contains(time)) {
        let mut list = Vec::new();
        for j in (0..cloud.len()).filter(|&j| cloud.active[j].contains(time)) {
            let (id, other) = (cloud.ids[i], cloud.ids[j]);
            let bound = radius_of_pair(&radii, id, other);
            let (near, square) = squared(cloud.double, periods, cloud.at(i, time), cloud.at(j, time));
            let wanted = if once { other > id } else { other != id };
            if wanted && square <= (bound * bound).min(f32::MAX) {
                list.push((other, square.to_bits(), near.map(|x| (x + 0.0).to_bits())));
            }
        }
        list.sort_unstable();
        expected.push((cloud.ids[i], list));
    }
    expected.sort_unstable();
    let query = tree.neighbor_lists(time, radii).periodic(periods).with_distances().with_displacements();
    let query = if once { query.pairs_once() } else { query };
    let mut lists = NeighborLists::new();
    match query.run(&mut lists) {
        Err(ListError::FarFromPeriod { .. }) if periods.iter().any(Option::is_some) => return Ok(()),
        result => same!(result, Ok(()), "{what}"),
    }
    let [x, y, z] = lists.displacements();
    let entry = |n: usize| {
        let near = [x[n], y[n], z[n]].map(|x| (x + 0.0).to_bits());
        (lists.ids()[n], lists.distances_squared()[n].to_bits(), near)
    };
    let row = |i: usize| {
        let mut row: Vec<Entry> = lists.range(i).map(entry).collect();
        row.sort_unstable();
        (lists.points()[i], row)
    };
    let mut found: Vec<_> = (0..lists.len()).map(row).collect();
    found.sort_unstable();
    same_lists!(found, expected, "{what}");
    let most = expected.iter().map(|(_, list)| list.len()).max().unwrap_or(0);
    if most > 0 {
        let longest = expected.iter().filter(|(_, list)| list.len() >= most).map(|(id, _)| *id).min();
        let error = ListError::TooManyNeighbors { id: longest.unwrap_or(u32::MAX) };
        same!(query.max_neighbors(most - 1).run(&mut lists), Err(error), "{what}: at most {}", most - 1);
        same!(query.max_neighbors(most).run(&mut lists), Ok(()), "{what}: at most {most}");
    }
    Ok(())
}

/// Lists around positions, in a periodic box.
fn around(random: &mut Random, Life { cloud, tree }: &Life, radius: f32, what: &str) -> Outcome {
    let time = random.time();
    let (periods, _) = periodic_box(random, [cloud, cloud]);
    let queries: Vec<DVec3> = (0..random.below(40)).map(|_| cloud.query(random, time)).collect();
    let own = radii(random, queries.len(), radius);
    let of = if random.one_in(2) { Radii::Own(&own) } else { Radii::Equal(radius) };
    let what = format!("{what}: around {} positions at {time}, {of:?}, periods {periods:?}", queries.len());
    let mut expected = Vec::new();
    for (i, &q) in (0u32..).zip(&queries) {
        let bound = radius_of_pair(&of, i, 0);
        let near = |j: usize| {
            let (near, square) = squared(cloud.double, periods, q, cloud.at(j, time));
            let wanted = square <= (bound * bound).min(f32::MAX);
            wanted.then(|| (cloud.ids[j], square.to_bits(), near.map(|x| (x + 0.0).to_bits())))
        };
        let exist = (0..cloud.len()).filter(|&j| cloud.active[j].contains(time));
        let mut list: Vec<Entry> = exist.filter_map(near).collect();
        list.sort_unstable();
        expected.push(list);
    }
    let query = tree.within_lists(&queries, time, of).periodic(periods).with_distances().with_displacements();
    let mut lists = NeighborLists::new();
    match query.in_order().sorted().run(&mut lists) {
        Err(ListError::FarFromPeriod { .. }) if periods.iter().any(Option::is_some) => return Ok(()),
        result => same!(result, Ok(()), "{what}"),
    }
    same!(lists.len(), queries.len(), "{what}");
    for (i, list) in expected.iter().enumerate() {
        let [x, y, z] = lists.displacements();
        let near = |n: usize| [x[n], y[n], z[n]].map(|x| (x + 0.0).to_bits());
        let entry = |n: usize| (lists.ids()[n], lists.distances_squared()[n].to_bits(), near(n));
        let mut found: Vec<Entry> = lists.range(i).map(entry).collect();
        found.sort_unstable();
        same_lists!(found, list, "{what}: {i}");
    }
    Ok(())
}

/// Adds an encounter of the same two ids.
fn merge(into: &mut Encounter, other: Encounter) {
    if (other.distance_squared, other.closest) < (into.distance_squared, into.closest) {
        (into.distance_squared, into.closest) = (other.distance_squared, other.closest);
    }
    (into.enter, into.leave) = (into.enter.min(other.enter), into.leave.max(other.leave));
}

/// Lists over an interval, where points with the same id have one together.
fn swept(random: &mut Random, Life { cloud, tree }: &Life, radius: f32, own: &[f32], what: &str) -> Outcome {
    let (interval, once) = (random.interval(), random.one_in(3));
    let (periods, images) = periodic_box(random, [cloud, cloud]);
    if (cloud.segments() * cloud.len()).pow(2) * images.len() > MOST {
        return Ok(());
    }
    let radii: Radii = random.pick(&kinds_of_radii(radius, own, own));
    let what = format!("{what}: swept over {interval:?}, {radii:?}, once {once}, periods {periods:?}");
    let times = [interval.begin(), interval.end()].map(f64::from);
    let mut expected: BTreeMap<u32, BTreeMap<u32, Encounter>> = BTreeMap::new();
    for i in 0..cloud.len() {
        for j in 0..cloud.len() {
            let (id, other) = (cloud.ids[i], cloud.ids[j]);
            if if once { other <= id } else { other == id } {
                continue;
            }
            let square = f64::from(radius_of_pair(&radii, id, other)).powi(2);
            let Some(met) = meet([cloud, cloud], [i, j], &images, times, square) else { continue };
            let row = expected.entry(id).or_default();
            row.entry(other).and_modify(|all| merge(all, met)).or_insert(met);
        }
    }
    let query = tree.neighbor_lists_swept(interval, radii).periodic(periods).sorted();
    let query = if once { query.pairs_once() } else { query };
    let mut lists = EncounterLists::new();
    let result = query.run(&mut lists);
    if result.as_ref().is_err_and(|error| may_refuse(error, [cloud, cloud], periods)) {
        return Ok(());
    }
    same!(result, Ok(()), "{what}");
    let mut rows: BTreeMap<u32, Vec<Encounter>> = BTreeMap::new();
    for (id, row) in lists.iter() {
        ensure!(rows.insert(id, row.to_vec()).is_none(), "{what}: two lists of {id}");
    }
    rows.retain(|_, row| !row.is_empty());
    // An active interval that ends with the float next to a key that is no float may end with the key.
    if !cloud.segments().is_power_of_two() {
        return Ok(());
    }
    let scale = cloud.places.scale as f32;
    same_lists!(rows.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>(), "{what}: points with encounters");
    for ((id, row), of) in rows.iter().zip(expected.values()) {
        let of: Vec<Encounter> = of.values().copied().collect();
        same_lists!(without_noise(row, scale), without_noise(&of, scale), "{what}: {id}");
    }
    Ok(())
}
