//! Trees of instances, nested up to three times, against brute force on the ray in the space of every instance. Closest points
//! against the nearest of all primitives, each found by itself through a filter.

use crate::compare::{Outcome, bits, point_bits};
use crate::random::{Random, direction};
use crate::scenes::{Scene, is_documented, params, wide};
use core::f64::consts::{FRAC_PI_2, PI};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use mbkd::{
    ClosestPointQuery, Counters, Instance, InstanceError, InstanceHit, InstanceOf, InstancePoint, InstanceTree, Pose,
    Ray, RayTree, SimdLevel, TimeInterval, Transform, WideParams,
};
use std::sync::Arc;

/// Brute force over a placed tree, and the masks of all primitives of each of its meshes; its shapes count as one more.
pub struct Leaf {
    pub brute: BruteForce,
    pub masks: Vec<Vec<u32>>,
}

/// The contents of an instance, for brute force.
#[derive(Clone)]
pub enum Brute {
    Tree(Arc<Leaf>),
    Instances(Arc<Placed>),
}

/// A tree of instances with what brute force needs to know of them.
pub struct Placed {
    pub tree: Arc<InstanceTree>,
    pub instances: Vec<(Instance, Brute)>,
}

/// Path and bits of a hit.
type Found = (Vec<u32>, [u32; 5]);

fn found(hit: &InstanceHit) -> Found {
    (hit.path.to_vec(), bits(&hit.hit))
}

/// The nearest; of several the first path and the lowest primitive.
fn closest(hits: &[Found]) -> Option<Found> {
    let order = |hit: &&Found| (hit.0.clone(), hit.1[3], hit.1[4]);
    let t = |hit: &&Found| f32::from_bits(hit.1[0]);
    hits.iter().min_by(|a, b| t(a).total_cmp(&t(b)).then(order(a).cmp(&order(b)))).cloned()
}

impl Placed {
    /// All hits on what a mask lets through; without one, everything.
    fn hits(&self, ray: &Ray, mask: Option<u32>) -> Vec<Found> {
        let mut all = Vec::new();
        for (i, (instance, brute)) in (0u32..).zip(&self.instances) {
            let sees = |of: u32| mask.is_none_or(|mask| mask & of != 0);
            if !instance.active.contains(ray.time) || !sees(instance.mask) {
                continue;
            }
            let Some(local) = self.tree.local_ray(i, ray) else { continue };
            match brute {
                Brute::Tree(of) => {
                    let seen = of
                        .brute
                        .all_hits(&local)
                        .into_iter()
                        .filter(|h| sees(of.masks[h.mesh as usize][h.primitive as usize]));
                    all.extend(seen.map(|h| (vec![i], bits(&h))));
                }
                Brute::Instances(of) => {
                    let below = of.hits(&local, mask).into_iter();
                    all.extend(below.map(|(path, hit)| ([vec![i], path].concat(), hit)));
                }
            }
        }
        all
    }

    fn check(&self, ray: &Ray, mask: u32, what: &str) -> Outcome {
        let mut expected = self.hits(ray, None);
        expected.sort();
        let nearest = closest(&expected);
        let what = format!("{what}: {ray:?}, mask {mask:b}");
        same!(self.tree.closest_hit(ray).as_ref().map(found), nearest, "{what}, closest hit");
        same!(self.tree.any_hit(ray), nearest.is_some(), "{what}, any hit");
        let mut all = Vec::new();
        let _ = self.tree.all_hits(ray, |hit| {
            all.push(found(&hit));
            ControlFlow::Continue(())
        });
        all.sort();
        same!(all, expected, "{what}, all hits");
        let masked = closest(&self.hits(ray, Some(mask)));
        same!(self.tree.closest_hit_masked(ray, mask).as_ref().map(found), masked, "{what}, masked hit");
        same!(self.tree.any_hit_masked(ray, mask), masked.is_some(), "{what}, any masked hit");
        let mut all = Vec::new();
        let _ = self.tree.all_hits_masked(ray, mask, |hit| {
            all.push(found(&hit));
            ControlFlow::Continue(())
        });
        all.sort();
        let mut expected = self.hits(ray, Some(mask));
        expected.sort();
        same!(all, expected, "{what}, all masked hits");
        let mut counters = Counters::default();
        same!(self.tree.closest_hit_observed(ray, &mut counters).as_ref().map(found), nearest, "{what}, observed");
        same!(self.tree.any_hit_observed(ray, &mut counters), nearest.is_some(), "{what}, any hit observed");
        let Some(first) = &nearest else { return Ok(()) };
        let mut others = self.hits(ray, Some(mask));
        others.retain(|hit| hit != first);
        let other = |hit: &InstanceHit| found(hit) != *first;
        let second = self.tree.closest_hit_filtered(ray, mask, other).as_ref().map(found);
        same!(second, closest(&others), "{what}, second hit");
        same!(self.tree.any_hit_filtered(ray, mask, other), second.is_some(), "{what}, any second hit");
        Ok(())
    }

    fn check_batches(&self, rays: &[Ray], mask: u32, what: &str) -> Outcome {
        let tree = &self.tree;
        let accept = |i: usize, hit: &InstanceHit| !(i + hit.hit.primitive as usize).is_multiple_of(3);
        let (mut hits, mut any, mut masked, mut filtered) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut any_masked, mut any_filtered) = (Vec::new(), Vec::new());
        tree.closest_hits(rays, &mut hits);
        tree.any_hits(rays, &mut any);
        tree.closest_hits_masked(rays, mask, &mut masked);
        tree.any_hits_masked(rays, mask, &mut any_masked);
        tree.closest_hits_filtered(rays, mask, accept, &mut filtered);
        tree.any_hits_filtered(rays, mask, accept, &mut any_filtered);
        for (i, ray) in rays.iter().enumerate() {
            same!(hits[i], tree.closest_hit(ray), "{what}: {ray:?} in a batch");
            same!(any[i], hits[i].is_some(), "{what}: {ray:?} in a batch of any hits");
            same!(masked[i], tree.closest_hit_masked(ray, mask), "{what}: {ray:?} in a masked batch {mask:b}");
            same!(any_masked[i], masked[i].is_some(), "{what}: {ray:?} in a batch of any masked hits {mask:b}");
            let single = tree.closest_hit_filtered(ray, mask, |hit| accept(i, hit));
            same!(filtered[i], single, "{what}: {ray:?} in a filtered batch {mask:b}");
            same!(any_filtered[i], single.is_some(), "{what}: {ray:?} in a batch of any filtered hits {mask:b}");
        }
        Ok(())
    }

    /// The numbers of instances at all levels, hidden ones included, and of primitives that are not hidden.
    fn count(&self) -> [u64; 2] {
        let mut all = [0, 0];
        for (instance, brute) in &self.instances {
            let [instances, primitives] = match brute {
                Brute::Tree(of) => [0, of.masks.iter().map(|of| of.len() as u64).sum()],
                Brute::Instances(of) => of.count(),
            };
            let shown = !is_hidden(&instance.transform);
            all = [all[0] + 1 + instances, all[1] + u64::from(shown) * primitives];
        }
        all
    }

    /// Whether a mask lets a primitive through, and all instances on the path to it.
    fn sees(&self, path: &[u32], name: (u32, u32), mask: u32) -> bool {
        let (instance, brute) = &self.instances[path[0] as usize];
        let below = match brute {
            Brute::Tree(of) => of.masks[name.0 as usize][name.1 as usize] & mask != 0,
            Brute::Instances(of) => of.sees(&path[1..], name, mask),
        };
        instance.mask & mask != 0 && below
    }

    /// The corners of a triangle in world space; none of another primitive.
    fn corners(&self, path: &[u32], (mesh, primitive): (u32, u32), time: f32) -> Vec<DVec3> {
        let (tree, matrix) = (self.tree.tree(path), self.tree.matrix(path, time));
        let (Some(tree), Some(matrix)) = (tree.filter(|tree| (mesh as usize) < tree.mesh_count()), matrix) else {
            return Vec::new();
        };
        tree.triangle(mesh, primitive, time).map(|corner| matrix.transform_point3(corner)).to_vec()
    }

    /// Paths and names of all primitives, in order; `None` if they are more than that.
    fn primitives(&self, most: usize) -> Option<Vec<(Vec<u32>, u32, u32)>> {
        let mut all = Vec::new();
        for (i, (_, brute)) in (0u32..).zip(&self.instances) {
            let of_this: Vec<_> = match brute {
                Brute::Tree(of) if of.masks.iter().map(Vec::len).sum::<usize>() <= most => {
                    let names =
                        (0u32..).zip(&of.masks).flat_map(|(mesh, of)| (0..of.len() as u32).map(move |j| (mesh, j)));
                    names.map(|(mesh, primitive)| (vec![i], mesh, primitive)).collect()
                }
                Brute::Tree(_) => return None,
                Brute::Instances(of) => {
                    let below = of.primitives(most)?.into_iter();
                    below.map(|(path, mesh, primitive)| ([vec![i], path].concat(), mesh, primitive)).collect()
                }
            };
            all.extend(of_this);
            if all.len() > most {
                return None;
            }
        }
        Some(all)
    }

    /// A closest point is as far away as it says, and no corner of its triangle is nearer.
    fn check_distance(&self, query: &ClosestPointQuery, found: &InstancePoint, what: &str) -> Outcome {
        let (near, distance) = (&found.near, f64::from(found.near.distance));
        let size = near.point.abs().max(query.point.abs()).max_element();
        let apart = near.point.distance(query.point);
        let differs = (apart - distance).abs() > 1e-6 * apart.max(distance) + 1e-12 * size + 1e-30;
        ensure!(!differs, "{what}: {query:?}: {found:?} is {apart} away");
        for corner in self.corners(&found.path, (near.mesh, near.primitive), query.time) {
            let (to, size) = (corner.distance(query.point), size.max(corner.abs().max_element()));
            let nearer = to < distance * (1.0 - 1e-5) - 1e-5 * size;
            ensure!(!nearer, "{what}: {query:?}: {found:?}, but {corner} is {to} away");
        }
        Ok(())
    }

    /// The closest point is the nearest of those of the primitives, each the only one that a filter accepts.
    fn check_closest_point(
        &self,
        query: &ClosestPointQuery,
        primitives: &[(Vec<u32>, u32, u32)],
        what: &str,
    ) -> Outcome {
        let mut best: Option<InstancePoint> = None;
        for (path, mesh, primitive) in primitives {
            let only =
                |p: &InstancePoint| p.path[..] == path[..] && (p.near.mesh, p.near.primitive) == (*mesh, *primitive);
            let near = self.tree.closest_point_filtered(query, u32::MAX, only);
            if let Some(near) = near {
                self.check_distance(query, &near, what)?;
            }
            if near.is_some_and(|near| best.is_none_or(|best| near.near.distance < best.near.distance)) {
                best = near;
            }
        }
        let word = |near: Option<InstancePoint>| near.map(|near| (near.path.to_vec(), point_bits(&near.near)));
        let all = self.tree.closest_point_filtered(query, u32::MAX, |_| true);
        same!(word(all), word(best), "{what}: {query:?}");
        let mut batch = Vec::new();
        self.tree.closest_points(&[*query, *query], &mut batch);
        same!(word(batch[1]), word(self.tree.closest_point(query)), "{what}: {query:?} in a batch");
        for mask in [1, 2, 0b110] {
            let seen = |p: &InstancePoint| self.sees(&p.path, (p.near.mesh, p.near.primitive), mask);
            let masked = self.tree.closest_point_masked(query, mask);
            let expected = self.tree.closest_point_filtered(query, u32::MAX, seen);
            same!(word(masked), word(expected), "{what}: {query:?}, mask {mask:b}");
            self.tree.closest_points_masked(&[*query, *query], mask, &mut batch);
            same!(word(batch[1]), word(masked), "{what}: {query:?}, mask {mask:b}, in a batch");
            let odd = |p: &InstancePoint| p.near.primitive % 2 == 1;
            self.tree.closest_points_filtered(&[*query, *query], mask, |_, p| odd(p), &mut batch);
            let expected = self.tree.closest_point_filtered(query, u32::MAX, |p| seen(p) && odd(p));
            same!(word(batch[1]), word(expected), "{what}: {query:?}, mask {mask:b}, odd ones in a batch");
        }
        let observed = self.tree.closest_point_observed(query, &mut Counters::default());
        same!(word(observed), word(self.tree.closest_point(query)), "{what}: {query:?}, observed");
        Ok(())
    }
}

fn pose(random: &mut Random, scale: f64, apart: f64) -> Pose {
    let axis = random.vec().try_normalize().unwrap_or(DVec3::X);
    let random_angle = random.signed();
    let angle = random.pick(&[0.0, FRAC_PI_2, PI, 3.1, 3.1 * random_angle]);
    let even = random.one_in(2);
    let signs = if random.one_in(3) { random.vec().signum() } else { DVec3::ONE };
    Pose {
        scale: if even { signs * scale } else { signs * (random.vec() * 0.6 + 1.0) * scale },
        rotation: DQuat::from_axis_angle(if random.one_in(2) { DVec3::Z } else { axis }, angle),
        translation: if random.one_in(4) { DVec3::ZERO } else { random.vec() * apart },
    }
}

/// Whether an instance has no size at any time.
fn is_hidden(transform: &Transform) -> bool {
    match transform {
        Transform::Matrices(keys) => keys.iter().all(|key| key.matrix3 == DMat3::ZERO),
        Transform::Poses(keys) => keys.iter().all(|key| key.scale == DVec3::ZERO),
    }
}

/// Static, moving on lines, and on arcs; upright, mirrored and sheared. Sometimes invalid.
fn transform(random: &mut Random, scale: f64, apart: f64) -> Transform {
    let first = pose(random, scale, apart);
    let keys = random.pick(&[1, 2, 2, 3, 4, 9]);
    let kinds = if random.one_in(4) { 7 } else { 6 };
    match random.below(kinds) {
        0 => Transform::default(),
        6 => vec![Pose { scale: DVec3::ZERO, ..first }; keys].into(),
        1 => first.into(),
        2 => {
            let shear = DMat3::from_cols(DVec3::X, DVec3::new(random.signed(), 1.0, 0.2), DVec3::Z);
            Transform::from(first.matrix() * DAffine3::from_mat3(shear))
        }
        3 => {
            let keys = (0..keys).map(|_| {
                let mut key = first.matrix();
                key.matrix3.x_axis += key.matrix3.y_axis * random.signed();
                key.translation += random.vec() * scale;
                key
            });
            keys.collect::<Vec<_>>().into()
        }
        4 => {
            // The same scale throughout, turning and moving.
            let turned = |random: &mut Random| Pose { scale: first.scale, ..pose(random, scale, apart) };
            (0..keys).map(|_| turned(random)).collect::<Vec<_>>().into()
        }
        _ => (0..keys).map(|_| pose(random, scale, scale)).collect::<Vec<_>>().into(),
    }
}

/// Trees over scenes around zero, with brute force and a scale.
fn prototype(random: &mut Random, level: SimdLevel) -> Result<Option<(InstanceOf, Brute, f64)>, String> {
    let power = random.pick(&[0, 0, 0, 20]);
    let scene = Scene::random(random, 300, power);
    let params = params(random);
    let tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &params) {
        Err(error) if is_documented(&error) => return Ok(None),
        tree => tree.map_err(|error| format!("{params:?}: {error}"))?.with_simd(level),
    };
    let brute = BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| error.to_string())?;
    let of_balls = scene.balls.iter().map(|(ball, _)| ball.mask).collect();
    let masks = scene.meshes.iter().map(|mesh| vec![mesh.mask; mesh.len()]).chain([of_balls]).collect();
    let leaf = Leaf { brute, masks };
    Ok(Some((InstanceOf::Tree(Arc::new(tree)), Brute::Tree(Arc::new(leaf)), scene.places.scale)))
}

/// A ray at something in an instance, from nearby or far away.
fn ray(random: &mut Random, placed: &Placed, size: f64) -> Ray {
    let (mut path, mut of, time) = (Vec::new(), placed.tree.as_ref(), random.time());
    loop {
        path.push(random.below(of.len()) as u32);
        match of.placed(path[path.len() - 1]) {
            Some(InstanceOf::Instances(inner)) if !inner.is_empty() => of = inner,
            _ => break,
        }
    }
    let matrix = placed.tree.matrix(&path, time).unwrap_or_default();
    let target = matrix.transform_point3(random.vec() * size);
    let origin = match random.below(4) {
        0 => matrix.transform_point3(random.vec() * size),
        1 => target + matrix.transform_vector3(DVec3::AXES[random.below(3)] * size),
        _ => target + random.vec() * matrix.transform_vector3(DVec3::X).length() * size * random.power(-3, 4),
    };
    let ray = Ray::new(origin, direction(random, target - origin)).at_time(time);
    match random.below(8) {
        0 => ray.between(-3.0, 0.7),
        1 => ray.between(0.1, 1.0),
        _ => ray,
    }
}

pub fn case(random: &mut Random) -> Outcome {
    let level = random.pick(&SimdLevel::available());
    let mut among = Vec::new();
    for _ in 0..1 + random.below(3) {
        among.extend(prototype(random, level)?);
    }
    for depth in 1..=random.pick(&[1, 1, 2, 2, 3, 4]) {
        if among.is_empty() {
            return Ok(());
        }
        let count = 1 + random.pick(&[1, 3, 10, 40]) / depth;
        let mut instances = Vec::new();
        let mut size = 0f64;
        for _ in 0..1 + random.below(count) {
            let (of, brute, own) = among[random.below(among.len())].clone();
            let scale = random.pick(&[1.0, 0.3, 0.01, 10.0]);
            let transform = transform(random, scale, own * 3.0);
            size = size.max(own);
            let active = if random.one_in(4) { random.interval() } else { TimeInterval::FULL };
            let mask = random.pick(&[u32::MAX, u32::MAX, 1, 2, 0b110, 0]);
            let instance = Instance::new(of, transform).with_mask(mask).with_active(active);
            // What alone is refused is left out.
            match InstanceTree::build(vec![instance.clone()], &WideParams::default()) {
                Ok(_) => instances.push((instance, brute)),
                Err(InstanceError::Build(error)) => return Err(format!("instance {instance:?}: {error}")),
                Err(_) => {}
            }
        }
        let params = wide(random);
        let tree = match InstanceTree::build(instances.iter().map(|(i, _)| i.clone()).collect(), &params) {
            Err(InstanceError::Build(error)) if is_documented(&error) => return Ok(()),
            tree => tree.map_err(|error| format!("{params:?}: {error}"))?.with_simd(level),
        };
        let placed = Placed { tree: Arc::new(tree), instances };
        check(random, &placed, size, &format!("depth {depth}, {params:?}, {level}"))?;
        if placed.tree.is_empty() {
            return Ok(());
        }
        let extent = placed.tree.bounds().map_or(1.0, |b| b.max.abs().max(b.min.abs()).max_element()).max(1e-20);
        let group = (InstanceOf::Instances(placed.tree.clone()), Brute::Instances(Arc::new(placed)), extent);
        among.truncate(1);
        among.push(group);
    }
    Ok(())
}

/// A secondary ray does not hit the triangle that it leaves.
fn secondary_ray(random: &mut Random, tree: &InstanceTree, ray: &Ray, what: &str) -> Outcome {
    let Some(hit) = tree.closest_hit(ray) else { return Ok(()) };
    let of_shape = tree.tree(&hit.path).is_none_or(|of| hit.hit.mesh as usize >= of.mesh_count());
    let normal = tree.triangle_normal(&hit, ray.time);
    if of_shape || normal == Vec3::ZERO {
        return Ok(());
    }
    let any = random.vec().as_vec3().normalize_or_zero();
    let away = normal * random.pick(&[1.0, -1.0]) * random.power(-4, 1) as f32;
    let next = tree.secondary_ray(ray, &hit, any - normal * any.dot(normal) + away);
    let [a, b, c] = tree.vertices(&hit, ray.time);
    // Where the origin moves by less than the least `t` above 0, nothing tells the two sides of the triangle apart.
    if (a - b).length().max((b - c).length()).max((c - a).length()) < 1e-30 {
        return Ok(());
    }
    let mut same = false;
    let _ = tree.all_hits(&next, |other| {
        let name = |hit: &InstanceHit| (hit.path, hit.hit.mesh, hit.hit.primitive);
        same = name(&other) == name(&hit);
        if same { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    same!(same, false, "{what}: {next:?} leaves what {ray:?} hit, {hit:?}");
    Ok(())
}

pub fn check(random: &mut Random, placed: &Placed, size: f64, what: &str) -> Outcome {
    same!(placed.tree.validate(), Ok(()), "{what}");
    let statistics = placed.tree.statistics();
    same!([statistics.instances, statistics.primitives], placed.count(), "{what}: {statistics}");
    let mask = random.pick(&[u32::MAX, 1, 2, 0b100]);
    let rays: Vec<Ray> = (0..40).map(|_| ray(random, placed, size)).collect();
    for ray in &rays {
        placed.check(ray, mask, what)?;
    }
    placed.check_batches(&rays, mask, what)?;
    for ray in rays.iter().take(15) {
        secondary_ray(random, &placed.tree, ray, what)?;
    }
    let primitives = placed.primitives(150);
    for _ in 0..6 {
        let Some(primitives) = &primitives else { break };
        let from = ray(random, placed, size);
        let query = ClosestPointQuery::new(from.origin, from.time);
        let query = if random.one_in(3) { query.within((random.signed().abs() * size) as f32) } else { query };
        placed.check_closest_point(&query, primitives, what)?;
    }
    Ok(())
}
