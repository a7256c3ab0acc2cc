//! Trees of rays: closest, any and all hits, masks, filters, batches and closest points of several trees over one scene against
//! brute force; refits from frame to frame against brute force over the frame; files against the trees that were written.

use crate::POOLS;
use crate::blob::Blob;
use crate::compare::{Outcome, bits, point_bits};
use crate::random::{Random, direction};
use crate::scenes::{Scene, is_documented, params};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Aabb, BuildError, BuildParams, ClosestPoint, ClosestPointQuery, Counters, FileError, Hit, Keys, MovingSphere,
    Policy, Primitive, Ray, RayTree, RefitError, Shape, SimdLevel, TreePrimitive, Visitor,
};

/// A ray that is critical in some way, towards something in the scene.
pub fn ray(random: &mut Random, scene: &Scene) -> Ray {
    let (time, size) = (random.any_time(), scene.places.scale);
    let target = scene.target(random, time);
    let origin = match random.below(9) {
        // On a surface.
        0 => scene.target(random, time),
        // Beside the target along one axis.
        1 | 2 => target + DVec3::AXES[random.below(3)] * size * random.pick(&[1.0, -1.0, 2.0, 1e3, -1e-3]),
        3 => target + random.vec() * size * random.power(-6, 9),
        4 => scene.places.place(random),
        5 => target,
        _ => scene.places.offset + random.vec() * 2.0 * size,
    };
    let mut ray = Ray::new(origin, direction(random, target - origin)).at_time(time);
    match random.below(12) {
        0 => ray = ray.between(f32::NEG_INFINITY, f32::INFINITY),
        1 => ray = ray.between(-2.0, 0.9),
        2 => ray = ray.between(0.5, 1.0),
        3 => ray = ray.between(1.0, 1.0),
        _ => {}
    }
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, 1e-45];
    match random.below(150) {
        0 => ray.dir[random.below(3)] = random.pick(&bad),
        1 => ray.origin[random.below(3)] = f64::from(random.pick(&bad)),
        2 => ray.t_max = random.pick(&bad),
        3 => ray.t_min = random.pick(&bad),
        4 => ray.dir = Vec3::ZERO,
        _ => {}
    }
    ray
}

pub fn closest_point_query(random: &mut Random, scene: &Scene) -> ClosestPointQuery {
    let time = random.any_time();
    let (near, size) = (scene.target(random, time), scene.places.scale);
    let far = random.pick(&[0.0, 1e-6, 0.1, 1.0, 3.0, 1e6]);
    let query = ClosestPointQuery::new(near + random.vec() * size * far, time);
    let most = [0.0, size as f32 * 0.1, size as f32, f32::INFINITY, -1.0, f32::NAN];
    if random.one_in(3) { query.within(random.pick(&most)) } else { query }
}

/// The queries of a case.
pub struct Queries {
    pub rays: Vec<Ray>,
    pub points: Vec<ClosestPointQuery>,
    mask: u32,
    modulus: u32,
    /// The masks of meshes, and of the shapes behind them.
    masks: [Vec<u32>; 2],
}

impl Queries {
    pub fn new(random: &mut Random, scene: &Scene, oracle: &BruteForce, count: usize) -> Queries {
        let mut rays: Vec<Ray> = (0..count).map(|_| ray(random, scene)).collect();
        // Rays that end or begin exactly at a hit.
        for i in (0..count).step_by(3) {
            let Some(hit) = oracle.closest_hit(&rays[i]) else { continue };
            let end = random.pick(&[hit.t, hit.t.next_down(), hit.t.next_up()]);
            let ray = rays[i];
            rays.push(if random.one_in(2) { Ray { t_max: end, ..ray } } else { Ray { t_min: end, ..ray } });
        }
        // Rays side by side, as from a camera.
        if random.one_in(3) {
            let first = ray(random, scene);
            let step = random.pick(&[0.0, 1e-3, 0.05]) * first.dir.length();
            let beside = |i: u32| Vec3::new((i % 8) as f32 * step, (i / 8) as f32 * step, 0.0);
            let time = |random: &mut Random| if random.one_in(2) { first.time } else { random.time() };
            // More than one task of a batch.
            let many = if count < 40 { 72 } else { random.pick(&[72, 72, 72, 300]) };
            rays.extend((0..many).map(|i| Ray { dir: first.dir + beside(i), time: time(random), ..first }));
        }
        let mut points: Vec<_> = (0..count / 2).map(|_| closest_point_query(random, scene)).collect();
        for i in 0..points.len() / 3 {
            let Some(near) = oracle.closest_point(&points[i]) else { continue };
            let most = random.pick(&[near.distance, near.distance.next_down()]);
            points.push(points[i].within(most));
        }
        let of_meshes = scene.meshes.iter().map(|mesh| mesh.mask).collect();
        let masks = [of_meshes, scene.balls.iter().map(|(ball, _)| ball.mask).collect()];
        let mask = random.pick(&[u32::MAX, 1, 2, 0b100, 0]);
        Queries { rays, points, mask, modulus: 2 + random.below(3) as u32, masks }
    }

    /// The hits that the mask lets through.
    fn seen(&self, mut hits: Vec<Hit>) -> Vec<Hit> {
        let [of_meshes, of_shapes] = &self.masks;
        let mask_of =
            |hit: &Hit| of_meshes.get(hit.mesh as usize).unwrap_or_else(|| &of_shapes[hit.primitive as usize]);
        hits.retain(|hit| mask_of(hit) & self.mask != 0);
        hits
    }

    fn accepts(&self, i: usize, primitive: u32) -> bool {
        !(primitive + i as u32).is_multiple_of(self.modulus)
    }
}

/// What all trees have to answer.
#[derive(Debug, PartialEq)]
pub struct Answers {
    all: Vec<Vec<Hit>>,
    closest: Vec<Option<Hit>>,
    all_masked: Vec<Vec<Hit>>,
    masked: Vec<Option<Hit>>,
    filtered: Vec<Option<Hit>>,
    points: Vec<Option<ClosestPoint>>,
    masked_points: Vec<Option<ClosestPoint>>,
    filtered_points: Vec<Option<ClosestPoint>>,
}

impl Answers {
    pub fn of_brute_force(of: &BruteForce, queries: &Queries) -> Answers {
        let (rays, points, mask) = (queries.rays.iter().enumerate(), queries.points.iter().enumerate(), queries.mask);
        let accepts = |i, primitive| queries.accepts(i, primitive);
        Answers {
            all: rays.clone().map(|(_, ray)| of.all_hits(ray)).collect(),
            closest: rays.clone().map(|(_, ray)| of.closest_hit(ray)).collect(),
            all_masked: rays.clone().map(|(_, ray)| queries.seen(of.all_hits(ray))).collect(),
            masked: rays.clone().map(|(_, ray)| of.closest_hit_filtered(ray, mask, |_| true)).collect(),
            filtered: rays.map(|(i, ray)| of.closest_hit_filtered(ray, mask, |h| accepts(i, h.primitive))).collect(),
            points: points.clone().map(|(_, query)| of.closest_point(query)).collect(),
            masked_points: points.clone().map(|(_, query)| of.closest_point_filtered(query, mask, |_| true)).collect(),
            filtered_points: points
                .map(|(i, query)| of.closest_point_filtered(query, mask, |p| accepts(i, p.primitive)))
                .collect(),
        }
    }

    pub fn check(&self, tree: &RayTree, queries: &Queries, what: &str) -> Outcome {
        let (rays, mask) = (&queries.rays, queries.mask);
        for (i, ray) in rays.iter().enumerate() {
            let about = |query: &str| format!("{what}: {query} of {ray:?}, mask {mask:b}");
            let word = |hit: &Option<Hit>| hit.as_ref().map(bits);
            let accept = |hit: &Hit| queries.accepts(i, hit.primitive);
            same!(word(&tree.closest_hit(ray)), word(&self.closest[i]), "{}", about("closest hit"));
            same!(tree.any_hit(ray), self.closest[i].is_some(), "{}", about("any hit"));
            let mut all = Vec::new();
            let mut keep = |hit: Hit| {
                all.push(hit);
                ControlFlow::Continue(())
            };
            ensure!(tree.all_hits(ray, &mut keep).is_continue(), "{}", about("flow"));
            all.sort_by_key(|hit| (hit.mesh, hit.primitive));
            let words = |hits: &[Hit]| hits.iter().map(bits).collect::<Vec<_>>();
            same_lists!(words(&all), words(&self.all[i]), "{}", about("all hits"));
            let (masked, filtered) = (&self.masked[i], &self.filtered[i]);
            same!(word(&tree.closest_hit_masked(ray, mask)), word(masked), "{}", about("masked hit"));
            same!(tree.any_hit_masked(ray, mask), masked.is_some(), "{}", about("any masked hit"));
            same!(word(&tree.closest_hit_filtered(ray, mask, accept)), word(filtered), "{}", about("filtered hit"));
            same!(tree.any_hit_filtered(ray, mask, accept), filtered.is_some(), "{}", about("any filtered hit"));
            let (mut all, mut counters) = (Vec::new(), Counters::default());
            let _ = tree.all_hits_masked(ray, mask, |hit| {
                all.push(hit);
                ControlFlow::Continue(())
            });
            all.sort_by_key(|hit| (hit.mesh, hit.primitive));
            same_lists!(words(&all), words(&self.all_masked[i]), "{}", about("all masked hits"));
            let closest = tree.closest_hit_observed(ray, &mut counters);
            same!(word(&closest), word(&self.closest[i]), "{}", about("observed hit"));
            same!(tree.any_hit_observed(ray, &mut counters), closest.is_some(), "{}", about("any observed hit"));
            let mut count = 0;
            let _ = tree.all_hits_observed(ray, &mut counters, |_| {
                count += 1;
                ControlFlow::Continue(())
            });
            same!(count, self.all[i].len(), "{}", about("all observed hits"));
            let mut best: Option<Hit> = None;
            let _ = tree.all_hits_filtered(ray, mask, accept, |hit| {
                let order = |hit: &Hit| (hit.mesh, hit.primitive);
                if best.is_none_or(|b| hit.t < b.t || (hit.t == b.t && order(&hit) < order(&b))) {
                    best = Some(hit);
                }
                ControlFlow::Continue(())
            });
            same!(word(&best), word(filtered), "{}", about("best of all filtered hits"));
        }
        let near_bits = |near: &Option<ClosestPoint>| near.as_ref().map(point_bits);
        for (i, query) in queries.points.iter().enumerate() {
            let near = tree.closest_point(query);
            same!(near_bits(&near), near_bits(&self.points[i]), "{what}: {query:?}");
            let near = tree.closest_point_filtered(query, mask, |p| queries.accepts(i, p.primitive));
            same!(near_bits(&near), near_bits(&self.filtered_points[i]), "{what}: {query:?}, filtered, {mask:b}");
            let near = tree.closest_point_masked(query, mask);
            same!(near_bits(&near), near_bits(&self.masked_points[i]), "{what}: {query:?}, {mask:b}");
            let near = tree.closest_point_observed(query, &mut Counters::default());
            same!(near_bits(&near), near_bits(&self.points[i]), "{what}: {query:?}, observed");
        }
        self.check_batches(tree, queries, what)
    }

    fn check_batches(&self, tree: &RayTree, queries: &Queries, what: &str) -> Outcome {
        let (rays, mask) = (&queries.rays, queries.mask);
        let accept = |i: usize, hit: &Hit| queries.accepts(i, hit.primitive);
        let near = |i: usize, p: &ClosestPoint| queries.accepts(i, p.primitive);
        let found = |hits: &[Option<Hit>]| hits.iter().map(Option::is_some).collect::<Vec<_>>();
        let (mut hits, mut any, mut points) = (vec![None; 3], vec![true], Vec::new());
        tree.closest_hits(rays, &mut hits);
        same_lists!(hits, self.closest, "{what}: batch of {}", rays.len());
        tree.any_hits(rays, &mut any);
        same_lists!(any, found(&self.closest), "{what}: any hits of {}", rays.len());
        tree.closest_hits_masked(rays, mask, &mut hits);
        same_lists!(hits, self.masked, "{what}: masked batch {mask:b} of {}", rays.len());
        tree.any_hits_masked(rays, mask, &mut any);
        same_lists!(any, found(&self.masked), "{what}: any masked hits {mask:b} of {}", rays.len());
        tree.closest_hits_filtered(rays, mask, accept, &mut hits);
        same_lists!(hits, self.filtered, "{what}: filtered batch {mask:b} of {}", rays.len());
        tree.any_hits_filtered(rays, mask, accept, &mut any);
        same_lists!(any, found(&self.filtered), "{what}: any filtered hits {mask:b} of {}", rays.len());
        tree.closest_points(&queries.points, &mut points);
        same_lists!(points, self.points, "{what}: batch of closest points");
        tree.closest_points_masked(&queries.points, mask, &mut points);
        same_lists!(points, self.masked_points, "{what}: masked batch of closest points, {mask:b}");
        tree.closest_points_filtered(&queries.points, mask, near, &mut points);
        same_lists!(points, self.filtered_points, "{what}: filtered batch of closest points, {mask:b}");
        Ok(())
    }
}

/// A scene, its frames, and the trees over it.
pub fn case(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 20_000, 28);
    if scene.meshes.is_empty() && random.one_in(2) {
        return shapes_only(random, &scene);
    }
    let oracle =
        BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| format!("brute force: {error}"))?;
    let queries = Queries::new(random, &scene, &oracle, if scene.len() > 3000 { 15 } else { 40 });
    let answers = Answers::of_brute_force(&oracle, &queries);
    let mut first: Option<RayTree> = None;
    for _ in 0..3 {
        let params = params(random);
        let tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &params) {
            Err(error) if is_documented(&error) => continue,
            tree => tree.map_err(|error| format!("{params:?}: {error}"))?,
        };
        let level = random.pick(&SimdLevel::available());
        let tree = tree.with_simd(level);
        let what = format!("{params:?}, {level}");
        valid(&scene, &tree, &params, &what)?;
        answers.check(&tree, &queries, &what)?;
        valid(&scene, &tree, &params, &format!("{what}, after queries"))?;
        same_triangles(random, &scene, &tree, first.as_ref(), &what)?;
        secondary_rays(random, &tree, &queries, &what)?;
        visits_all(random, &scene, &tree, &what)?;
        same_in_file(&scene, &tree, &params, &answers, &queries, &what)?;
        first = Some(frames(random, &scene, tree, &what)?);
    }
    Ok(())
}

/// The structure of a tree. In k-d trees, this check takes the square of the number of primitives.
fn valid(scene: &Scene, tree: &RayTree, params: &BuildParams, what: &str) -> Outcome {
    if !matches!(params.policy, Policy::Kd(_)) || scene.len() < 200 {
        same!(tree.validate(), Ok(()), "{what}");
    }
    Ok(())
}

/// Corners of triangles are the same in every tree.
fn same_triangles(random: &mut Random, scene: &Scene, tree: &RayTree, other: Option<&RayTree>, what: &str) -> Outcome {
    let Some(other) = other else { return Ok(()) };
    for (i, mesh) in scene.meshes.iter().enumerate().filter(|(_, mesh)| !mesh.is_empty()) {
        let (triangle, time) = (random.below(mesh.len()) as u32, random.time());
        if mesh.active.contains(time) {
            let corners = |tree: &RayTree| tree.triangle(i as u32, triangle, time);
            same!(corners(tree), corners(other), "{what}: triangle {triangle} of mesh {i} at {time}");
        }
    }
    Ok(())
}

/// Secondary rays do not hit the triangle that they leave.
fn secondary_rays(random: &mut Random, tree: &RayTree, queries: &Queries, what: &str) -> Outcome {
    for ray in queries.rays.iter().take(10) {
        let Some(hit) = tree.closest_hit(ray) else { continue };
        let normal = tree.triangle_normal(&hit, ray.time);
        if normal == Vec3::ZERO {
            continue;
        }
        let any = random.vec().as_vec3().normalize_or_zero();
        let away = normal * random.pick(&[1.0, -1.0]) * random.power(-4, 1) as f32;
        let next = tree.secondary_ray(ray, &hit, any - normal * any.dot(normal) + away);
        // Where the origin moves by less than half of the least `t` above 0, nothing tells the two sides of the triangle apart.
        let [a, b, c] = tree.triangle(hit.mesh, hit.primitive, ray.time);
        let longest = (a - b).length().max((b - c).length()).max((c - a).length());
        if longest * 2f64.powi(-36) < 7e-46 * next.dir.as_dvec3().length() {
            continue;
        }
        let mut same = false;
        let _ = tree.all_hits(&next, |other| {
            same = (other.mesh, other.primitive) == (hit.mesh, hit.primitive);
            if same { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        same!(same, false, "{what}: {next:?} leaves what {ray:?} hit, {hit:?}");
    }
    Ok(())
}

/// Sees all primitives.
struct Everything(Vec<(u32, u32)>);

impl Visitor<TreePrimitive> for Everything {
    fn enter(&mut self, _: &Aabb) -> Option<f32> {
        Some(0.0)
    }

    fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
        self.0.push((item.mesh, item.primitive));
        ControlFlow::Continue(())
    }
}

/// A visitor that enters everything sees what exists at the time.
fn visits_all(random: &mut Random, scene: &Scene, tree: &RayTree, what: &str) -> Outcome {
    let (time, mut all) = (random.time(), Everything(Vec::new()));
    ensure!(tree.traverse(time, &mut all).is_continue(), "{what}: traverse at {time}");
    let of = tree.statistics();
    // Where everything is there at all times, each reference is visited.
    let whole = of.time_nodes == 0 && of.timed == 0.0 && scene.exist_at(time).len() == scene.len();
    ensure!(!whole || all.0.len() == of.references, "{what}: {} visited of {of:?}", all.0.len());
    same!(of.built_subtrees, of.subtrees, "{what}: subtrees after a visit");
    all.0.sort_unstable();
    all.0.dedup();
    same_lists!(all.0, scene.exist_at(time), "{what}: visited at {time}");
    Ok(())
}

/// A tree that is written and read has the same answers, and is written the same again.
fn same_in_file(
    scene: &Scene,
    tree: &RayTree,
    params: &BuildParams,
    answers: &Answers,
    queries: &Queries,
    what: &str,
) -> Outcome {
    let (mut bytes, mut again) = (Vec::new(), Vec::new());
    match tree.write_to(&mut bytes) {
        Ok(()) => {}
        Err(FileError::Lazy) if matches!(params.policy, Policy::Lazy(_)) => return Ok(()),
        Err(error) => return Err(format!("{what}: write: {error}")),
    }
    let alone = RayTree::read_from(&mut bytes.as_slice());
    let mut read = if scene.has_custom_shapes() {
        ensure!(matches!(alone, Err(FileError::CustomShapes { .. })), "{what}: read without the shapes: {alone:?}");
        RayTree::read_with_shapes_from(&mut bytes.as_slice(), scene.shapes())
    } else {
        alone
    }
    .map_err(|error| format!("{what}: read: {error}"))?;
    answers.check(&read, queries, &format!("{what}, from a file"))?;
    read.write_to(&mut again).map_err(|error| format!("{what}: write again: {error}"))?;
    ensure!(bytes == again, "{what}: written, read and written: other bytes");
    ensure!(read.refit(&scene.meshes).is_err(), "{what}: a tree of a file was refitted");
    // Smaller trees are built on one thread anyway.
    if scene.len() < 500 {
        return Ok(());
    }
    let [one, two] = [0, 1].map(|i| {
        let mut bytes = Vec::new();
        let tree = POOLS[i].install(|| RayTree::of_scene(&scene.meshes, scene.shapes(), params));
        tree.is_ok_and(|tree| tree.write_to(&mut bytes).is_ok()).then_some(bytes)
    });
    ensure!(one == two, "{what}: other bytes on two threads than on one");
    Ok(())
}

/// Refits a tree to some frames, in any of the ways there are. Returns a tree of the first frame.
fn frames(random: &mut Random, scene: &Scene, mut tree: RayTree, what: &str) -> Result<RayTree, String> {
    let mut now = scene.clone();
    for frame in 1..=random.below(4) {
        let (mut next, differ) = now.moved(random);
        let (way, result) = match random.below(4) {
            0 => ("refit_moved", tree.refit_moved(&next.meshes, &differ)),
            1 => ("refit_moved", tree.refit_moved(&next.meshes, &differ)),
            2 if next.balls.len() < 300 => {
                next = next.with_other_balls(random);
                ("refit_with_shapes", tree.refit_with_shapes(&next.meshes, next.shapes()))
            }
            _ => ("refit", tree.refit(&next.meshes)),
        };
        let what = format!("{what}, {way} to frame {frame}, {differ:?} differ: {result:?}");
        match result {
            Ok(_) => now = next,
            Err(RefitError::Policy | RefitError::Lazy) => break,
            Err(
                RefitError::Keys { .. }
                | RefitError::Active { .. }
                | RefitError::ActiveShape { .. }
                | RefitError::Input(BuildError::TooLarge { .. }),
            ) => {}
            Err(_) => return Err(what),
        }
        // Input that is refused leaves the tree as it is.
        if random.one_in(4) {
            refused(random, &now, &mut tree, &what)?;
        }
        same!(tree.validate(), Ok(()), "{what}");
        let oracle = BruteForce::of_scene(&now.meshes, now.shapes()).map_err(|error| format!("{what}: {error}"))?;
        let queries = Queries::new(random, &now, &oracle, 15);
        let answers = Answers::of_brute_force(&oracle, &queries);
        answers.check(&tree, &queries, &what)?;
        if random.one_in(3) {
            same_in_file(&now, &tree, &BuildParams::default(), &answers, &queries, &what)?;
        }
    }
    let params = BuildParams::default();
    RayTree::of_scene(&scene.meshes, scene.shapes(), &params).map_err(|error| format!("{what}: default: {error}"))
}

/// Refits that must fail.
fn refused(random: &mut Random, now: &Scene, tree: &mut RayTree, what: &str) -> Outcome {
    let mut bad = now.meshes.clone();
    let i = random.below(bad.len());
    let Some(mesh) = bad.get_mut(i).filter(|mesh| !mesh.is_empty()) else { return Ok(()) };
    let value = random.pick(&[f32::NAN, f32::INFINITY, 2e30]);
    let vertex = mesh.indices[0][0] as usize;
    match (random.below(3), &mut mesh.keys) {
        (0, _) => mesh.indices[0].rotate_left(1),
        (1, _) => mesh.indices.push([0; 3]),
        (_, Keys::F32(keys)) => keys[0][vertex].y = value,
        (_, Keys::F64(keys) | Keys::Precise(keys)) => keys[0][vertex].y = f64::from(value),
    }
    if bad[i].indices == now.meshes[i].indices && random.one_in(2) && matches!(bad[i].keys, Keys::F32(_)) {
        bad.pop();
    }
    if bad == now.meshes {
        return Ok(());
    }
    let result =
        if random.one_in(2) { tree.refit_moved(&bad, &[i.min(bad.len().saturating_sub(1))]) } else { tree.refit(&bad) };
    ensure!(result.is_err(), "{what}: bad meshes were taken: {result:?}");
    Ok(())
}

/// Trees of shapes of one type without meshes: of which none, some or all are spheres.
fn shapes_only(random: &mut Random, scene: &Scene) -> Outcome {
    match random.below(4) {
        0 => of_type(random, scene, |(ball, _)| Blob::hidden(ball.clone())),
        1 => of_type(random, scene, |(ball, _)| ball.clone()),
        2 => of_type(random, scene, |(ball, own)| Blob { named: !own, ..Blob::hidden(ball.clone()) }),
        _ => of_type(random, scene, |(ball, own)| match own {
            true => Shape::from(Blob::hidden(ball.clone())),
            false => Shape::from(ball.clone()),
        }),
    }
}

fn of_type<P: Primitive + 'static>(
    random: &mut Random,
    scene: &Scene,
    shape: impl Fn(&(MovingSphere, bool)) -> P,
) -> Outcome {
    let shapes = |scene: &Scene| scene.balls.iter().map(&shape).collect::<Vec<P>>();
    let oracle = BruteForce::of_scene(&[], shapes(scene)).map_err(|error| error.to_string())?;
    let queries = Queries::new(random, scene, &oracle, 40);
    let answers = Answers::of_brute_force(&oracle, &queries);
    for _ in 0..3 {
        let (params, level) = (params(random), random.pick(&SimdLevel::available()));
        let mut tree = match RayTree::of_scene(&[], shapes(scene), &params) {
            Err(error) if is_documented(&error) => continue,
            tree => tree.map_err(|error| format!("{params:?}: {error}"))?.with_simd(level),
        };
        let mut what = format!("{} shapes, {params:?}, {level}", scene.len());
        valid(scene, &tree, &params, &what)?;
        answers.check(&tree, &queries, &what)?;
        shapes_in_file(&tree, shapes(scene), &answers, &queries, &what)?;
        let mut held = Vec::new();
        let mut now = scene.clone();
        for _ in 0..1 + random.below(3) {
            held.extend(random.one_in(2).then(|| (tree.clone(), now.clone())));
            let next = now.clone().with_other_balls(random);
            match tree.refit_with_shapes(&[], shapes(&next)) {
                Ok(_) => now = next,
                Err(RefitError::Policy | RefitError::Lazy | RefitError::ActiveShape { .. }) => break,
                Err(RefitError::Input(BuildError::TooLarge { .. })) => break,
                Err(error) => return Err(format!("{what}: refit: {error}")),
            }
            what += ", refitted";
            let oracle = BruteForce::of_scene(&[], shapes(&now)).map_err(|error| error.to_string())?;
            let queries = Queries::new(random, &now, &oracle, 20);
            same!(tree.validate(), Ok(()), "{what}");
            let answers = Answers::of_brute_force(&oracle, &queries);
            answers.check(&tree, &queries, &what)?;
            shapes_in_file(&tree, shapes(&now), &answers, &queries, &what)?;
        }
        for (tree, scene) in held {
            let oracle = BruteForce::of_scene(&[], shapes(&scene)).map_err(|error| error.to_string())?;
            let queries = Queries::new(random, &scene, &oracle, 10);
            Answers::of_brute_force(&oracle, &queries).check(&tree, &queries, &format!("{what}, a clone before"))?;
        }
    }
    Ok(())
}

/// A tree that is written, and read with its shapes handed in again.
fn shapes_in_file<P: Primitive + 'static>(
    tree: &RayTree,
    shapes: Vec<P>,
    answers: &Answers,
    queries: &Queries,
    what: &str,
) -> Outcome {
    let (mut bytes, mut again) = (Vec::new(), Vec::new());
    match tree.write_to(&mut bytes) {
        Err(FileError::Lazy) => return Ok(()),
        result => result.map_err(|error| format!("{what}: write: {error}"))?,
    }
    let read = RayTree::read_with_shapes_from(&mut bytes.as_slice(), shapes);
    let read = read.map_err(|error| format!("{what}: read: {error}"))?;
    answers.check(&read, queries, &format!("{what}, from a file"))?;
    read.write_to(&mut again).map_err(|error| format!("{what}: write again: {error}"))?;
    ensure!(bytes == again, "{what}: written, read and written: other bytes");
    Ok(())
}
