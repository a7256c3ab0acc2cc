//! Neighbour lists of whole sets against comparing all pairs: at a time with all options, around positions, and over an interval;
//! and that lists with a skin hold as long as they say.

use crate::clouds::{Cloud, params};
use crate::compare::Outcome;
use crate::encounter::{Pair, images};
use crate::random::Random;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Encounter, EncounterLists, ListError, NeighborLists, PointError, PointParams, PointStructure, PointTree, Precision,
    Radii,
};

/// A neighbour: id, squared distance, displacement.
pub type Entry = (u32, u32, [u32; 3]);

/// The parameters of lists at a time.
#[derive(Clone, Debug)]
struct Request<'a> {
    time: f32,
    radii: Radii<'a>,
    periods: [Option<f64>; 3],
    once: bool,
    other: bool,
    displacements: bool,
}

/// All kinds of radii: one for all points, or those of points and of what is listed.
pub fn kinds_of_radii<'a>(one: f32, own: &'a [f32], others: &'a [f32]) -> [Radii<'a>; 4] {
    [Radii::Equal(one), Radii::Own(own), Radii::Larger { own, others }, Radii::Sum { own, others }]
}

/// How far a point may be from one that its list holds.
pub fn radius_of_pair(radii: &Radii<'_>, own: u32, other: u32) -> f32 {
    match *radii {
        Radii::Equal(radius) => radius,
        Radii::Own(of) => of[own as usize],
        Radii::Larger { own: of, others } => of[own as usize].max(others[other as usize]),
        Radii::Sum { own: of, others } => of[own as usize] + others[other as usize],
    }
}

/// The displacement between the nearest images of two positions, and its square, as lists at a time compute them.
pub fn squared(double: bool, periods: [Option<f64>; 3], from: DVec3, to: DVec3) -> ([f32; 3], f32) {
    if double {
        let near = [0, 1, 2].map(|axis| {
            let d = to[axis] - from[axis];
            periods[axis].map_or(d, |length| d - (d * (1.0 / length)).round_ties_even() * length)
        });
        let squared = (near[0] * near[0] + near[1] * near[1]) + near[2] * near[2];
        return (near.map(|x| x as f32), squared as f32);
    }
    let d: Vec3 = to.as_vec3() - from.as_vec3();
    let near = [0, 1, 2].map(|axis| {
        let length = periods[axis].map(|length| length as f32);
        length.map_or(d[axis], |length| d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length)
    });
    (near, (near[0] * near[0] + near[1] * near[1]) + near[2] * near[2])
}

impl Request<'_> {
    fn bound(&self, own: u32, other: u32) -> f32 {
        let radius = radius_of_pair(&self.radii, own, other);
        (radius * radius).min(f32::MAX)
    }

    /// All lists by id.
    fn expected(&self, own: &Cloud, among: &Cloud) -> Vec<Vec<Entry>> {
        let mut lists = vec![Vec::new(); own.len()];
        let places: Vec<DVec3> = (0..among.len()).map(|j| among.at(j, self.time)).collect();
        for i in (0..own.len()).filter(|&i| own.active[i].contains(self.time)) {
            let (p, id) = (own.at(i, self.time), own.ids[i]);
            for (j, place) in places.iter().enumerate().filter(|(j, _)| among.active[*j].contains(self.time)) {
                let other = among.ids[j];
                let (near, squared) = squared(own.double, self.periods, p, *place);
                let wanted = if self.once { other > id } else { self.other || other != id };
                if wanted && squared <= self.bound(id, other) {
                    let near = if self.displacements { near.map(|x| (x + 0.0).to_bits()) } else { [0; 3] };
                    lists[id as usize].push((other, squared.to_bits(), near));
                }
            }
        }
        lists.iter_mut().for_each(|list| list.sort_unstable());
        lists
    }

    fn check(&self, trees: [&PointTree; 2], expected: &[Vec<Entry>], what: &str) -> Outcome {
        let mut query = trees[0].neighbor_lists(self.time, self.radii).periodic(self.periods);
        query = if self.once { query.pairs_once() } else { query };
        query = if self.other { query.among(trees[1]) } else { query };
        let mut lists = NeighborLists::new();
        let all = query.in_order().sorted().with_distances();
        let all = if self.displacements { all.with_displacements() } else { all };
        match all.run(&mut lists) {
            // The faces of boxes may reach farther than points.
            Err(ListError::FarFromPeriod { .. }) if self.periods.iter().any(Option::is_some) => return Ok(()),
            result => same!(result, Ok(()), "{what}: {self:?}"),
        }
        same!(lists.len(), expected.len(), "{what}: {self:?}: lists");
        for (i, list) in expected.iter().enumerate() {
            let [x, y, z] = lists.displacements();
            let moved = |n: usize| if x.is_empty() { [0; 3] } else { [x[n], y[n], z[n]].map(|x| (x + 0.0).to_bits()) };
            let entry = |n: usize| (lists.ids()[n], lists.distances_squared()[n].to_bits(), moved(n));
            let found: Vec<Entry> = lists.range(i).map(entry).collect();
            same_lists!(found, list, "{what}: {self:?}: list {i}");
        }
        same!(query.run(&mut lists), Ok(()), "{what}: {self:?}");
        let mut count = 0;
        for (id, row) in lists.iter() {
            let mut row = row.to_vec();
            row.sort_unstable();
            let ids: Vec<u32> = expected[id as usize].iter().map(|entry| entry.0).collect();
            same_lists!(row, ids, "{what}: {self:?}: unsorted list of {id}");
            count += row.len();
        }
        same!(count, expected.iter().map(Vec::len).sum::<usize>(), "{what}: {self:?}: neighbours in all");
        Ok(())
    }
}

/// Pairs of points and images that a case compares at most.
const MOST: usize = 2_000_000;

/// Lengths of a box about as large as two sets, as lists use them, and by how much points are moved to all images that may be
/// nearest to another point; often none.
pub fn periodic_box(random: &mut Random, clouds: [&Cloud; 2]) -> ([Option<f64>; 3], Vec<DVec3>) {
    let none = ([None; 3], vec![DVec3::ZERO]);
    let places = || clouds.iter().flat_map(|cloud| &cloud.keys).flatten().copied();
    let Some(first) = places().next().filter(|_| random.one_in(2)) else { return none };
    let extent = places().fold(first, DVec3::max) - places().fold(first, DVec3::min);
    let size = extent.max_element().max(clouds[0].places.scale * 1e-3);
    let lengths = [0; 3].map(|_| (!random.one_in(3)).then(|| size * random.pick(&[0.1, 0.4, 0.9, 1.1, 3.0])));
    let lengths = lengths.map(|length| length.filter(|&length| (length as f32).is_normal()));
    let most = (0..3).filter_map(|axis| Some((extent[axis] / lengths[axis]?) as i32 + 1)).max().unwrap_or(0);
    let along = |length: &Option<f64>| if length.is_some() { 2 * most as usize + 1 } else { 1 };
    if lengths.iter().map(along).product::<usize>() * clouds[0].len() * clouds[1].len() > MOST {
        return none;
    }
    let rounded = |length: f64| if clouds[0].double { length } else { f64::from(length as f32) };
    (lengths, images(lengths.map(|length| length.map(rounded)), most))
}

/// Whether lists over an interval may refuse a box: points are far from zero or far apart, the boxes of the tree included.
pub fn may_refuse(error: &ListError, clouds: [&Cloud; 2], periods: [Option<f64>; 3]) -> bool {
    let (ListError::Extent { axis } | ListError::FarFromPeriod { axis }) = *error else { return false };
    let places = clouds.iter().flat_map(|cloud| &cloud.keys).flatten();
    let most = places.fold(0.0, |most, p| p[axis].abs().max(most));
    let periods_away = if matches!(error, ListError::Extent { .. }) { 2.0 } else { 1e5 };
    periods[axis].is_some_and(|length| most > periods_away * length)
}

/// The encounter of two points in any images, by comparing them.
pub fn meet(
    clouds: [&Cloud; 2],
    [i, j]: [usize; 2],
    images: &[DVec3],
    times: [f64; 2],
    square: f64,
) -> Option<Encounter> {
    let pair = Pair {
        id: clouds[1].ids[j],
        segments: clouds.map(Cloud::segments),
        keys: &|k, key| clouds[k].key(key, [i, j][k]),
        active: [0, 1].map(|k| clouds[k].active[[i, j][k]]),
        images,
    };
    pair.meet(times, square)
}

/// Encounters without the least distance of points that nearly meet, and without its time: there the rounding of positions in f64
/// changes bits of f32.
pub fn without_noise(row: &[Encounter], scale: f32) -> Vec<Encounter> {
    let noise = (scale * 1e-8).powi(2);
    let known = |e: &Encounter| match e.distance_squared <= noise {
        true => Encounter { distance_squared: 0.0, closest: 0.0, ..*e },
        false => *e,
    };
    row.iter().map(known).collect()
}

/// The same tree or cloud twice, or one and another.
fn pair_of<T>([own, others]: &[T; 2], other: bool) -> [&T; 2] {
    [own, if other { others } else { own }]
}

fn check_swept(random: &mut Random, trees: &[([PointTree; 2], String)], clouds: &[Cloud; 2], radius: f32) -> Outcome {
    let other = random.one_in(3);
    let clouds = pair_of(clouds, other);
    let [cloud, among] = clouds;
    let interval = random.interval();
    let times = [interval.begin(), interval.end()].map(f64::from);
    let mut some =
        |count: usize| -> Vec<f32> { (0..count).map(|_| scaled(radius, random.pick(&[0.0, 0.3, 1.0, 2.0]))).collect() };
    let [own, of_others] = [some(cloud.len()), some(among.len())];
    let (own, others) = (&own[..], if other { &of_others[..] } else { &own[..] });
    let radii = random.pick(&kinds_of_radii(radius, own, others));
    let once = random.one_in(3);
    let (periods, images) = periodic_box(random, clouds);
    if clouds.iter().map(|cloud| cloud.segments() * cloud.len()).product::<usize>() * images.len() > 5 * MOST {
        return Ok(());
    }
    let mut expected = vec![Vec::new(); cloud.len()];
    for i in 0..cloud.len() {
        let listed = |&j: &usize| if once { among.ids[j] > cloud.ids[i] } else { other || j != i };
        let others = (0..among.len()).filter(listed);
        let square = |j: usize| f64::from(radius_of_pair(&radii, cloud.ids[i], among.ids[j])).powi(2);
        let row: Vec<Encounter> = others.filter_map(|j| meet(clouds, [i, j], &images, times, square(j))).collect();
        expected[cloud.ids[i] as usize] = row;
    }
    expected.iter_mut().for_each(|row| row.sort_unstable_by_key(|e| e.id));
    let mut first: Option<Vec<Option<Vec<Encounter>>>> = None;
    let [in_order, limited] = [random.one_in(2), random.one_in(2)];
    for (pair, what) in trees {
        let [tree, among_tree] = pair_of(pair, other);
        let mut lists = EncounterLists::new();
        let what = &format!("{what}, among the other {other}, periods {periods:?}");
        let mut query = tree.neighbor_lists_swept(interval, radii).periodic(periods).max_neighbors(among.len());
        if other {
            query = query.among(among_tree);
        }
        if once {
            query = query.pairs_once();
        }
        if in_order {
            query = query.sorted().in_order();
        }
        let result = query.run(&mut lists);
        if result.as_ref().is_err_and(|error| may_refuse(error, clouds, periods)) {
            return Ok(());
        }
        same!(result, Ok(()), "{what}: swept over {interval:?}, {radii:?}");
        let most = lists.iter().map(|(_, row)| row.len()).max().unwrap_or(0);
        if limited && most > 0 {
            let longest = lists.iter().filter(|(_, row)| row.len() == most).map(|(id, _)| id).min();
            let error = Err(ListError::TooManyNeighbors { id: longest.unwrap_or(u32::MAX) });
            same!(
                query.max_neighbors(most - 1).collect().map(|_| ()),
                error,
                "{what}: at most {} neighbours",
                most - 1
            );
        }
        let mut rows = vec![None; cloud.len()];
        for (id, row) in lists.iter() {
            let mut row = row.to_vec();
            row.sort_unstable_by_key(|e| e.id);
            ensure!(rows[id as usize].replace(row).is_none(), "{what}: two lists of {id}, swept over {interval:?}");
        }
        let first = first.get_or_insert_with(|| rows.clone());
        for (i, (row, other)) in rows.iter().zip(first).enumerate() {
            let [row, other] = [row, other].map(|row| row.as_deref().unwrap_or_default());
            same_lists!(row, other, "{what}: {i} swept over {interval:?} within {radii:?}, other than {}", trees[0].1);
        }
        // An active interval that ends with the float next to a key that is no float may end with the key.
        let exact = clouds.iter().all(|cloud| cloud.segments().is_power_of_two());
        for (i, (row, expected)) in rows.iter().zip(&expected).enumerate().filter(|_| exact) {
            let scale = cloud.places.scale as f32;
            let [row, expected] = [row.as_deref().unwrap_or_default(), expected].map(|row| without_noise(row, scale));
            same_lists!(row, expected, "{what}: {i} swept over {interval:?} within {radii:?}");
        }
    }
    Ok(())
}

/// Until the time that is certified, no pair within its radius is missing.
fn check_skin(random: &mut Random, trees: &[PointTree; 2], clouds: &[Cloud; 2], radius: f32, what: &str) -> Outcome {
    let other = random.one_in(3);
    let ([tree, among_tree], clouds) = (pair_of(trees, other), pair_of(clouds, other));
    let [cloud, among] = clouds;
    let (time, until) = (random.time(), random.time());
    let (time, until) = (time.min(until), time.max(until));
    let skin = scaled(radius, random.pick(&[0.0, 0.01, 0.3, 2.0]));
    let needed = [radii(random, cloud.len(), radius), radii(random, among.len(), radius)];
    let listed = needed.each_ref().map(|radii| radii.iter().map(|radius| radius + skin).collect::<Vec<f32>>());
    let kind = random.pick(&[0, 1, 2, 3]);
    let of_others = usize::from(other);
    let [needed, listed] = [(radius, &needed), (radius + skin, &listed)]
        .map(|(one, radii)| kinds_of_radii(one, &radii[0], &radii[of_others])[kind]);
    let mut lists = NeighborLists::new();
    let once = random.one_in(3);
    let (periods, _) = periodic_box(random, clouds);
    let what = format!("{what}: from {time} to {until} within {needed:?}, skin {skin}, once {once}");
    let what = format!("{what}, among the other {other}, periods {periods:?}");
    let good = match (other, periods, needed, once) {
        (false, [None, None, None], Radii::Equal(radius), false) => {
            tree.neighbor_lists_with_skin(time, radius, skin, until, &mut lists)
        }
        _ => {
            let query = tree.neighbor_lists(time, listed).periodic(periods);
            let query = if other { query.among(among_tree) } else { query };
            let query = if once { query.pairs_once() } else { query };
            query.run(&mut lists).and_then(|()| query.certified_until(needed, until))
        }
    };
    if good.as_ref().is_err_and(|error| may_refuse(error, clouds, periods)) {
        return Ok(());
    }
    let good = good.map_err(|error| format!("{what}: {error}"))?;
    ensure!((time..=until).contains(&good), "{what}: certified until {good}");
    let mut listed = vec![false; cloud.len() * among.len()];
    for (id, row) in lists.iter() {
        row.iter().for_each(|&other| listed[id as usize * among.len() + other as usize] = true);
    }
    for _ in 0..6 {
        let at = random.pick(&[time, good.next_down(), time + (good - time) * random_part(good)]);
        if at < time || at >= good {
            continue;
        }
        for i in (0..cloud.len()).filter(|&i| cloud.active[i].contains(at)) {
            let (place, id) = (cloud.at(i, at), cloud.ids[i]);
            for j in (0..among.len()).filter(|&j| among.active[j].contains(at)) {
                let other_id = among.ids[j];
                let wanted = if once { other_id > id } else { other || other_id != id };
                let missing = wanted && !listed[id as usize * among.len() + other_id as usize];
                let radius = radius_of_pair(&needed, id, other_id);
                let near = squared(cloud.double, periods, place, among.at(j, at)).1 <= radius * radius;
                ensure!(!(missing && near), "{what}: certified until {good}, {i} and {j} are missing at {at}");
            }
        }
    }
    Ok(())
}

/// Some number in [0, 1) that depends on another.
fn random_part(of: f32) -> f32 {
    Random::new(u64::from(of.to_bits())).unit()
}

/// A multiple of a radius that may be infinite.
fn scaled(radius: f32, by: f32) -> f32 {
    if by > 0.0 { radius * by } else { 0.0 }
}

pub fn radii(random: &mut Random, count: usize, radius: f32) -> Vec<f32> {
    (0..count).map(|_| scaled(radius, random.pick(&[0.0, 0.1, 0.5, 1.0, 2.0]))).collect()
}

/// Lists around positions.
pub fn check_positions(
    random: &mut Random,
    tree: &PointTree,
    cloud: &Cloud,
    time: f32,
    radius: f32,
    what: &str,
) -> Outcome {
    // In f32 they are f32 numbers.
    let queries: Vec<DVec3> = (0..random.below(60)).map(|_| cloud.query(random, time)).collect();
    let own = radii(random, queries.len(), radius);
    let each = random.one_in(2);
    let mut lists = NeighborLists::new();
    let query = if each { Radii::Own(&own) } else { Radii::Equal(radius) };
    let result = tree.within_lists(&queries, time, query).with_distances().in_order().run(&mut lists);
    same!(result, Ok(()), "{what}: around {} positions", queries.len());
    for (i, &q) in queries.iter().enumerate() {
        let radius = if each { own[i] } else { radius };
        let mut expected: Vec<(u32, u32)> = cloud
            .sorted(q, time)
            .iter()
            .filter(|n| n.distance_squared <= radius * radius)
            .map(|n| (n.id, n.distance_squared.to_bits()))
            .collect();
        let of = lists.range(i);
        let mut found: Vec<(u32, u32)> = of.map(|n| (lists.ids()[n], lists.distances_squared()[n].to_bits())).collect();
        expected.sort_unstable();
        found.sort_unstable();
        same_lists!(found, expected, "{what}: around {q} at {time} within {radius}");
    }
    Ok(())
}

pub fn case(random: &mut Random) -> Outcome {
    let double = random.one_in(5);
    let most = random.pick(&[50, 200, 600]);
    let mut clouds = [Cloud::random(random, most, double), Cloud::random(random, 150, double)];
    let widened = !double && random.one_in(8);
    if widened {
        clouds.iter_mut().for_each(Cloud::widen);
    }
    let (double, precision) = (double || widened, if widened { Precision::Double } else { Precision::Automatic });
    let mut trees = Vec::new();
    for _ in 0..2 {
        let params = PointParams { precision, ..params(random) };
        let pair = [clouds[0].tree(&params), clouds[1].tree(&params)];
        let refused = |tree: &Result<PointTree, PointError>| matches!(tree, Err(PointError::Parameter { .. }));
        if double && params.structure == PointStructure::Kd && pair.iter().any(refused) {
            continue;
        }
        let [own, other] = pair;
        let name = |error| format!("{params:?}: {error}");
        let what = format!("{} points, {} keys, {params:?}", clouds[0].len(), clouds[0].segments() + 1);
        trees.push(([own.map_err(name)?, other.map_err(name)?], what));
    }
    // Whether a key is on a line is a matter of rounding where it is just as far from it as is allowed.
    let kept = |tree: &PointTree| tree.statistics().layers.iter().map(|layer| layer.keys).max().unwrap_or(1).max(2);
    let differs = |(tree, cloud): (&PointTree, &Cloud)| kept(tree) != cloud.segments() + 1;
    if trees.iter().any(|(pair, _)| pair.iter().zip(&clouds).any(differs)) {
        return Ok(());
    }
    let scale = clouds[0].places.scale as f32;
    let radius = scale * random.pick(&[0.0, 1e-3, 0.03, 0.1, 0.1, 0.3, 3.0, 1e19]);
    let radius = if random.one_in(25) { random.pick(&[f32::MAX, f32::INFINITY]) } else { radius };
    let (own, others) = (radii(random, clouds[0].len(), radius), radii(random, clouds[1].len(), radius));
    for _ in 0..3 {
        let other = random.one_in(3);
        let periods = [0; 3].map(|_| {
            let length = clouds[0].places.scale * random.pick(&[0.2, 0.9, 1.7, 2.5, 8.0]);
            (length > 1e-30 && random.one_in(3)).then_some(length)
        });
        let (own, others) = (&own[..], if other { &others[..] } else { &own[..] });
        let mixed = if random.one_in(2) { Radii::Larger { own, others } } else { Radii::Sum { own, others } };
        let request = Request {
            time: random.time(),
            radii: match random.below(3) {
                0 => Radii::Own(own),
                1 => mixed,
                _ => Radii::Equal(radius),
            },
            periods: if random.one_in(2) { periods } else { [None; 3] },
            once: random.one_in(3),
            other,
            displacements: random.one_in(2),
        };
        let expected = request.expected(&clouds[0], &clouds[usize::from(other)]);
        for (pair, what) in &trees {
            request.check([&pair[0], &pair[1]], &expected, what)?;
            check_positions(random, &pair[0], &clouds[0], request.time, radius, what)?;
        }
    }
    if clouds[0].len() < 250 {
        check_swept(random, &trees, &clouds, radius)?;
        for (pair, what) in &trees {
            check_skin(random, pair, &clouds, radius, what)?;
        }
    }
    Ok(())
}
